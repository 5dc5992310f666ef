"""Test inputs of two levels: random binary signals, doublets and multisteps.

A random binary signal switches at random so that most of its energy lies in a band; it excites for identification.
Doublets and multisteps are short, and serve as maneuvers that a model has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import BoolArray, FloatArray

BANDWIDTH_TIMES_RISE = 0.35
"""Bandwidth in Hz times rise time from 10 to 90 %, of a first-order lag."""

_LEAST_LINES = 8
_LONG = 2**18


def band_of_rise_time(rise_time_s: float, std_s: float = 0.0) -> tuple[float, float]:
    r"""Bandwidth of a channel from the rise time of its step response: the upper edge of a band to excite.

    .. math:: \omega_b = 2 \pi \frac{0.35}{t_r}, \qquad \sigma_\omega = 2 \pi \frac{0.35}{t_r^2} \, \sigma_{t_r}

    exact for a first-order lag and within a tenth for second orders with a damping of 0.4 and more. It serves to begin
    with: it is known before the model.

    Parameters
    ----------
    rise_time_s
        From 10 to 90 % of the change.
    std_s
        Its standard deviation.

    Returns
    -------
    tuple
        Bandwidth and its standard deviation in rad/s.

    References
    ----------
    The design of the random binary signals of the Bebop 2, appendix "System bandwidth" and its footnote.

    Examples
    --------
    The pitch of the Bebop 2, 1.35 ± 0.28 Hz as printed:

    >>> [round(omega / (2.0 * math.pi), 2) for omega in band_of_rise_time(0.260, 0.055)]
    [1.35, 0.28]
    """
    if not rise_time_s > 0.0 or std_s < 0.0:
        raise UsageError(
            f"invalid rise time of {rise_time_s:g} s with a standard deviation of {std_s:g} s",
            needed="a positive time, and a deviation of 0 or more",
        )
    bandwidth = 2.0 * math.pi * BANDWIDTH_TIMES_RISE / rise_time_s
    return bandwidth, bandwidth * std_s / rise_time_s


def random_binary(
    *,
    amplitude: float,
    band_rad_s: tuple[float, float],
    duration_s: float,
    sample_rate_hz: float,
    rng: np.random.Generator,
    passes: int = 10,
    trim_s: float = 3.0,
) -> FloatArray:
    r"""Random signal of two levels with most of its energy in a band.

    .. math:: x_0 = A \, \mathrm{sgn}(B n), \qquad x_{i+1} = A \, \mathrm{sgn}(B x_i)

    with white Gaussian noise n and B, which keeps the band alone. No signal of two levels lies wholly inside a band: by
    the arcsine law the sign of noise has 73 to 79 % of its power in the band of the noise (:func:`share_of_sign`), the
    more the wider the band. Every further pass takes the two-level signal nearest to what lies inside, which
    cannot lower the share. Ten of them reach 80 to 86 %; then hardly a sample changes. Within the band the density
    stays even to 1 dB where the band is wider than an octave.

    Parameters
    ----------
    amplitude
        Height of both levels.
    band_rad_s
        Lowest and highest frequency. The highest is what the channel follows (:func:`band_of_rise_time`); the lowest
        comes from the room available, because slow signals carry the vehicle away.
    duration_s
        From the first to the last sample of the signal; it holds several cycles of the lowest frequency.
    sample_rate_hz
        Rate of the returned samples, at which it may switch; best that of the loop which takes it. Ten times the
        highest frequency in Hz and more; a coarse grid of switching times costs share.
    rng
        Source of the noise: the same state gives the same signal.
    passes
        How often the band is sharpened; 0 for the sign of noise.
    trim_s
        Zeros before and after.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``, spanning ``duration_s + 2 trim_s``.

    Raises
    ------
    UsageError
        The band does not rise below half the sample rate, or the duration resolves fewer than eight lines of it.

    References
    ----------
    Van Vleck and Middleton, *The Spectrum of Clipped Noise*, Proceedings of the IEEE 54, 1966. Van den Bos and Krol,
    *Synthesis of Discrete-Interval Binary Signals with Specified Fourier Amplitude Spectra*, International Journal of
    Control 30, 1979.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> signal = random_binary(amplitude=0.2, band_rad_s=(1.9, 8.5), duration_s=60.0, sample_rate_hz=20.0, rng=rng)
    >>> signal.size, np.unique(signal).tolist()
    (1320, [-0.2, 0.0, 0.2])
    """
    samples = round(duration_s * sample_rate_hz)
    inside = _lines(band_rad_s, samples, sample_rate_hz)
    signal = _sign(_filtered(rng.standard_normal(samples), inside))
    for _ in range(passes):
        signal = _sign(_filtered(signal, inside))
    return np.pad(amplitude * signal, round(trim_s * sample_rate_hz))


def share_of_sign(band_rad_s: tuple[float, float], *, sample_rate_hz: float) -> float:
    r"""Share of the power of the sign of band-limited noise that stays in the band.

    .. math:: R_{sgn}(\tau) = \frac{2}{\pi} \arcsin \rho(\tau)

    with the autocorrelation :math:`\rho` of white Gaussian noise between the edges of the band, which makes this the
    expectation for :func:`random_binary` without passes, long and with many samples per cycle. A narrow band keeps of
    the fundamental of a square wave, :math:`8 / \pi^2 = 81 %`, what the loss of the envelope of the noise does not
    spread beside it.

    Parameters
    ----------
    band_rad_s
        Lowest and highest frequency.
    sample_rate_hz
        Rate at which the signal may switch.

    Returns
    -------
    float
        0 to 1.

    References
    ----------
    Van Vleck and Middleton, *The Spectrum of Clipped Noise*, Proceedings of the IEEE 54, 1966.

    Examples
    --------
    >>> [round(share_of_sign((1.0, high), sample_rate_hz=200.0), 2) for high in (2.0, 5.0, 50.0)]
    [0.73, 0.75, 0.79]
    """
    inside = _lines(band_rad_s, _LONG, sample_rate_hz)
    correlation = np.fft.irfft(inside.astype(np.float64), _LONG)
    # Rounding alone puts it beyond one.
    of_sign = 2.0 / math.pi * np.arcsin(np.clip(correlation / correlation[0], -1.0, 1.0))
    power = np.fft.rfft(of_sign).real
    power[0] *= 0.5
    power[-1] *= 0.5
    return float(power[inside].sum() / power.sum())


def _lines(band_rad_s: tuple[float, float], samples: int, sample_rate_hz: float) -> BoolArray:
    low, high = band_rad_s
    omega = 2.0 * math.pi * np.fft.rfftfreq(max(samples, 1), 1.0 / sample_rate_hz)
    inside: BoolArray = (omega >= low) & (omega <= high)
    if not 0.0 < low < high < math.pi * sample_rate_hz or np.count_nonzero(inside) < _LEAST_LINES:
        raise UsageError(
            f"a random binary signal of {samples / sample_rate_hz:g} s is too short for {low:g} to {high:g} rad/s at "
            f"{sample_rate_hz:g} Hz",
            needed=f"a rising band below half the sample rate, with {_LEAST_LINES} cycles more at its upper edge than "
            "at its lower",
            remedy="lengthen the signal or widen the band",
        )
    return inside


def _filtered(values: FloatArray, inside: BoolArray) -> FloatArray:
    return np.fft.irfft(np.fft.rfft(values) * inside, values.size)


def _sign(values: FloatArray) -> FloatArray:
    return np.where(values >= 0.0, 1.0, -1.0)


BALANCED_HEIGHTS = (2.0 / 3.0, 1.0, 11.0 / 12.0, 11.0 / 12.0)
"""Heights 0.8, 1.2, 1.1, 1.1 of a 3-2-1-1 over the largest: as much area above zero as below."""


def multistep(
    widths: Sequence[float],
    *,
    amplitude: float,
    unit_s: float,
    sample_rate_hz: float,
    trim_s: float = 1.0,
    heights: Sequence[float] | None = None,
) -> FloatArray:
    """Steps of alternating sign.

    Parameters
    ----------
    widths
        Length of each step in units: ``(1, 1)`` is a doublet, ``(3, 2, 1, 1)`` the classic multistep, which spreads
        its energy over a wider band than a doublet of the same length.
    amplitude
        Height of the steps, in the unit of what is excited; negative begins the other way.
    unit_s
        Length of one unit. The energy of a doublet peaks near :math:`2.3 / unit` rad/s.
    sample_rate_hz
        Rate of the returned samples.
    trim_s
        Zeros before and after.
    heights
        Height of each step over the amplitude; all one by default.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``.

    Raises
    ------
    UsageError
        A step is shorter than one sample, or there are not as many heights as steps.

    Examples
    --------
    >>> multistep((2, 1), amplitude=1.0, unit_s=0.1, sample_rate_hz=10.0, trim_s=0.1)
    array([ 0.,  1.,  1., -1.,  0.])
    """
    # Edges are rounded, not widths, so that the errors of rounding do not add up.
    edges = np.round(np.concatenate([[0.0], np.cumsum(widths)]) * unit_s * sample_rate_hz).astype(np.int64)
    if edges.size < 2 or np.diff(edges).min() < 1:
        raise UsageError(
            f"steps of {list(widths)} times {unit_s:g} s are shorter than a sample at {sample_rate_hz:g} Hz",
            needed="steps of at least one sample",
            remedy="lengthen the unit or raise the sample rate",
        )
    if heights is not None and len(heights) != len(widths):
        raise UsageError(f"{len(heights)} heights do not fit {len(widths)} steps", needed="a height for each step")
    signs = np.where(np.arange(edges.size - 1) % 2 == 0, 1.0, -1.0)
    levels = amplitude * signs * (1.0 if heights is None else np.asarray(heights))
    return np.pad(np.repeat(levels, np.diff(edges)), round(trim_s * sample_rate_hz))


def doublet(*, amplitude: float, pulse_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """One step and its opposite, each ``pulse_s`` long; see :func:`multistep`.

    Parameters
    ----------
    amplitude
        Height of both steps.
    pulse_s
        Length of each.
    sample_rate_hz
        Samples per second.
    trim_s
        Length of the rest before and after it.

    Examples
    --------
    >>> doublet(amplitude=0.2, pulse_s=0.2, sample_rate_hz=10.0, trim_s=0.1)
    array([ 0. ,  0.2,  0.2, -0.2, -0.2,  0. ])
    """
    return multistep((1, 1), amplitude=amplitude, unit_s=pulse_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)


def three_two_one_one(*, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """The 3-2-1-1 of flight test, ``7 unit_s`` long; see :func:`multistep`.

    It holds its first sign for one unit more than the other, so an unstable vehicle ends away from trim.

    Parameters
    ----------
    amplitude
        Height of the steps.
    unit_s
        Length of the shortest step.
    sample_rate_hz
        Samples per second.
    trim_s
        Length of the rest before and after it.

    Examples
    --------
    >>> three_two_one_one(amplitude=1.0, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    array([ 1.,  1.,  1., -1., -1.,  1., -1.])
    """
    return multistep((3, 2, 1, 1), amplitude=amplitude, unit_s=unit_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)


def balanced_three_two_one_one(
    *, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0
) -> FloatArray:
    """A 3-2-1-1 of unequal heights, whose area above zero is that below; see :func:`multistep`.

    What integrates the input comes back to where it was. The amplitude is the height of the highest step, the second.

    Parameters
    ----------
    amplitude
        Height of the highest step.
    unit_s
        Length of the shortest step.
    sample_rate_hz
        Samples per second.
    trim_s
        Length of the rest before and after it.

    References
    ----------
    Jategaonkar, *Flight Vehicle System Identification*, 2nd edition, 2015, on multistep inputs.

    Examples
    --------
    >>> values = balanced_three_two_one_one(amplitude=1.2, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    >>> values.round(12).tolist()
    [0.8, 0.8, 0.8, -1.2, -1.2, 1.1, -1.1]
    """
    return multistep(
        (3, 2, 1, 1),
        amplitude=amplitude,
        unit_s=unit_s,
        sample_rate_hz=sample_rate_hz,
        trim_s=trim_s,
        heights=BALANCED_HEIGHTS,
    )


def two_one_one(*, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """The 2-1-1 of flight test, ``4 unit_s`` long; see :func:`multistep`.

    Shorter than a 3-2-1-1, and it reaches lower in frequency than a doublet of the same unit. It holds its first sign
    for two units more than the other.

    Parameters
    ----------
    amplitude
        Height of the steps.
    unit_s
        Length of the shortest step.
    sample_rate_hz
        Samples per second.
    trim_s
        Length of the rest before and after it.

    References
    ----------
    Morelli and Klein, *Aircraft System Identification*, 2nd edition, 2016, chapter 9.

    Examples
    --------
    >>> two_one_one(amplitude=1.0, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    array([ 1.,  1., -1.,  1.])
    """
    return multistep((2, 1, 1), amplitude=amplitude, unit_s=unit_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)
