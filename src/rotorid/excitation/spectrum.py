"""What a test input puts where: share of its energy inside a band, and how well it uses the room of its amplitude."""

from __future__ import annotations

import math

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray

_PADDING = 4


def energy_share(values: FloatArray, band_rad_s: tuple[float, float], *, sample_rate_hz: float) -> float:
    r"""Share of the energy of a test input that lies inside a band.

    .. math:: \int_{\omega_{min}}^{\omega_{max}} |X|^2 \, d\omega \; \Big/ \int_0^{\pi f_s} |X|^2 \, d\omega

    with the Fourier transform X of the samples, zero before and after them. Energy is counted up to half the sample
    rate; what a hold adds above is not in the samples. The edges of the band are resolved to a quarter of one over the
    length.

    Parameters
    ----------
    values
        Shape ``(samples,)``.
    band_rad_s
        Lowest and highest frequency, edges included.
    sample_rate_hz
        Rate of the samples.

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    UsageError
        The samples are all zero, or the band does not rise.

    Examples
    --------
    Fifty cycles of 1 Hz are not quite a line:

    >>> sine = np.sin(2.0 * np.pi * np.arange(0.0, 50.0, 0.01))
    >>> round(energy_share(sine, (6.0, 6.6), sample_rate_hz=100.0), 2)
    0.96
    """
    low, high = band_rad_s
    if not low < high or not np.any(values):
        raise UsageError(
            f"{values.size} samples up to {np.abs(values).max(initial=0.0):g}, and a band of {low:g} to {high:g} rad/s",
            needed="samples that are not all zero and a band that rises",
        )
    # Zeros behind the samples resolve the edges of the band; they change no energy.
    length = _PADDING * values.size
    energy = np.abs(np.fft.rfft(values, length)) ** 2
    # One-sided: every line but zero and the highest stands for two.
    energy[0] *= 0.5
    energy[-1] *= 0.5
    omega = 2.0 * math.pi * np.fft.rfftfreq(length, 1.0 / sample_rate_hz)
    return float(energy[(omega >= low) & (omega <= high)].sum() / energy.sum())


def relative_peak_factor(values: FloatArray) -> float:
    r"""Span of a signal over that of a sine of the same power.

    .. math:: \mathrm{RPF} = \frac{\max x - \min x}{2 \sqrt{2} \; x_{rms}}

    One for a sine, :math:`1/\sqrt 2` for two levels, which is the least; noise has about 2.5. What is limited in flight
    is the peak and what is learned grows with the power, so small is good.

    Parameters
    ----------
    values
        Shape ``(samples,)``, over whole periods, sampled finely enough to hold the peaks; not all zero.

    References
    ----------
    Morelli, *Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain*, 13th IFAC Symposium on
    System Identification, 2003.

    Examples
    --------
    >>> round(relative_peak_factor(np.sin(2.0 * np.pi * np.arange(1000) / 1000)), 6)
    1.0
    """
    rms = math.sqrt(float(np.mean(np.square(values))))
    if rms == 0.0:
        raise UsageError(f"{values.size} samples without any motion came", needed="a signal")
    return float(np.ptp(values)) / (2.0 * math.sqrt(2.0) * rms)
