"""Frequency sweeps: the exponential law that test pilots approximate, and the logarithmic chirp of ArduPilot."""

from __future__ import annotations

import math

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray

C1 = 4.0
C2 = 0.0187
"""Constants of the exponential law; 0.0187 is :math:`1 / (e^4 - 1)` as printed, so that K ends at 1.0023."""


def pilot_sweep(
    *,
    amplitude: float,
    band_rad_s: tuple[float, float],
    duration_s: float,
    sample_rate_hz: float,
    slow_cycles: float = 0.0,
    trim_s: float = 3.0,
    fade_s: float = 1.0,
    noise_fraction: float = 0.0,
    rng: np.random.Generator | None = None,
) -> FloatArray:
    r"""Exponential frequency sweep, as a pilot flies it.

    .. math:: \delta = A \sin \theta, \qquad
        \theta(t) = \omega_{min} t + (\omega_{max} - \omega_{min}) \, C_2
        \left[ \tfrac{T}{C_1} (e^{C_1 t / T} - 1) - t \right]

    which is the exact integral of :math:`\omega = \omega_{min} + K (\omega_{max} - \omega_{min})` with the share of the
    band that is passed after a share :math:`x` of the time, :math:`K(x) = C_2 \, (e^{C_1 x} - 1)`. It stays at low
    frequency longer than a linear sweep and reaches high frequency faster than a logarithmic one.

    A record resolves its lowest frequency when ``duration_s`` is 4 to 5 of its periods; a shorter one is flown as asked
    and answers less.

    Parameters
    ----------
    amplitude
        Peak, in the unit of what is excited.
    band_rad_s
        Lowest and highest frequency.
    duration_s
        From the first to the last motion, slow cycles included.
    sample_rate_hz
        Rate of the returned samples; 25 times the highest frequency in Hz is good practice.
    slow_cycles
        Periods at the lowest frequency before the sweep begins; two are customary.
    trim_s
        Zeros before and after.
    fade_s
        Raised-cosine fade at both ends of the motion.
    noise_fraction
        Root mean square of added white noise, low-passed at the highest frequency, as a fraction of the amplitude;
        0.1 fills the gaps of a sweep that is too regular.
    rng
        Source of that noise.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``, spanning ``duration_s + 2 trim_s``.

    Raises
    ------
    UsageError
        The band, the times or the noise do not make a sweep.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, AIAA, chapter 5. A version with misplaced
    brackets circulates, which does not start at zero.

    Examples
    --------
    >>> sweep = pilot_sweep(amplitude=0.1, band_rad_s=(0.6, 50.0), duration_s=45.0, sample_rate_hz=200.0)
    >>> sweep.shape, bool(abs(sweep).max() <= 0.1), float(sweep[0]), float(sweep[-1])
    ((10200,), True, 0.0, 0.0)
    """
    low, high = _checked_band(band_rad_s, sample_rate_hz)
    slow_s = slow_cycles * 2.0 * math.pi / low
    sweep_s = duration_s - slow_s
    if not sweep_s > 0.0 or fade_s < 0.0 or 2.0 * fade_s > duration_s:
        raise UsageError(
            f"a sweep of {duration_s:g} s is too short for {slow_cycles:g} slow cycles ({slow_s:g} s) and fades of "
            f"{fade_s:g} s",
            remedy="make the sweep longer or raise its lowest frequency",
        )
    time_s = np.arange(round(duration_s * sample_rate_hz)) / sample_rate_hz
    # Before the sweep begins its clock stands at zero, and only the slow oscillation advances the phase.
    swept_s = np.maximum(time_s - slow_s, 0.0)
    passed = C2 * (sweep_s / C1 * np.expm1(C1 * swept_s / sweep_s) - swept_s)
    values = amplitude * np.sin(low * time_s + (high - low) * passed)
    if noise_fraction > 0.0:
        values = values + noise_fraction * amplitude * _low_passed_noise(time_s.size, high / sample_rate_hz, rng)
    return _with_trim(values * _fade(time_s, duration_s, fade_s, fade_s), trim_s, sample_rate_hz)


def logarithmic_sweep(
    *,
    amplitude: float,
    band_rad_s: tuple[float, float],
    duration_s: float,
    sample_rate_hz: float,
    constant_s: float = 0.0,
    fade_in_s: float = 1.0,
    fade_out_s: float = 1.0,
    trim_s: float = 3.0,
) -> FloatArray:
    r"""Logarithmic chirp, as ArduPilot's system-identification mode injects it.

    .. math:: \delta = A \sin\left[ \frac{\omega_{min} T}{B} \left(e^{B t / T} - 1\right) \right], \qquad
        B = \ln \frac{\omega_{max}}{\omega_{min}}

    where t counts from the end of a part of constant frequency, and T is what remains of the duration. Every octave
    gets the same time, so the highest frequencies get many cycles and the lowest few.

    Parameters
    ----------
    amplitude
        Peak, in the unit of what is excited.
    band_rad_s
        Lowest and highest frequency.
    duration_s
        From the first to the last motion.
    sample_rate_hz
        Rate of the returned samples.
    constant_s
        Time at the lowest frequency before the chirp (``SID_T_CONST_F`` there).
    fade_in_s, fade_out_s
        Raised-cosine fades (``SID_T_FADE_IN``, ``SID_T_FADE_OUT``).
    trim_s
        Zeros before and after.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``, spanning ``duration_s + 2 trim_s``.

    Raises
    ------
    UsageError
        The band or the times do not make a chirp.

    Examples
    --------
    >>> chirp = logarithmic_sweep(amplitude=0.1, band_rad_s=(0.3, 60.0), duration_s=60.0, sample_rate_hz=400.0)
    >>> chirp.size / 400.0
    66.0
    """
    low, high = _checked_band(band_rad_s, sample_rate_hz)
    sweep_s = duration_s - constant_s
    if not sweep_s > 0.0 or min(fade_in_s, fade_out_s) < 0.0 or fade_in_s + fade_out_s > duration_s:
        raise UsageError(
            f"a chirp of {duration_s:g} s is too short for {constant_s:g} s at constant frequency and fades of "
            f"{fade_in_s:g} s and "
            f"{fade_out_s:g} s",
            remedy="make the chirp longer or its parts shorter",
        )
    time_s = np.arange(round(duration_s * sample_rate_hz)) / sample_rate_hz
    swept_s = time_s - constant_s
    rise = math.log(high / low)
    chirp = low * sweep_s / rise * np.expm1(rise * np.maximum(swept_s, 0.0) / sweep_s)
    phase = np.where(swept_s < 0.0, low * swept_s, chirp)
    window = _fade(time_s, duration_s, fade_in_s, fade_out_s)
    return _with_trim(amplitude * np.sin(phase) * window, trim_s, sample_rate_hz)


def _checked_band(band_rad_s: tuple[float, float], sample_rate_hz: float) -> tuple[float, float]:
    low, high = band_rad_s
    if not 0.0 < low < high < math.pi * sample_rate_hz:
        raise UsageError(
            f"the band {low:g} to {high:g} rad/s does not fit a sample rate of {sample_rate_hz:g} Hz",
            needed="a rising band above zero and below half the sample rate",
            remedy="correct the band or raise the sample rate",
        )
    return low, high


def _fade(time_s: FloatArray, duration_s: float, fade_in_s: float, fade_out_s: float) -> FloatArray:
    rise = np.clip(time_s, 0.0, fade_in_s) / fade_in_s if fade_in_s else np.ones_like(time_s)
    fall = np.clip(duration_s - time_s, 0.0, fade_out_s) / fade_out_s if fade_out_s else np.ones_like(time_s)
    window: FloatArray = np.sin(0.5 * math.pi * rise) ** 2 * np.sin(0.5 * math.pi * fall) ** 2
    return window


def _low_passed_noise(samples: int, cutoff_per_sample_rad: float, rng: np.random.Generator | None) -> FloatArray:
    """First-order low-passed white noise with a root mean square of one."""
    from scipy.signal import lfilter

    if rng is None:
        raise UsageError("noise needs a random generator", remedy="pass rng=numpy.random.default_rng(seed)")
    decay = math.exp(-cutoff_per_sample_rad)
    # The innovation is scaled so that the stationary variance is one.
    noise: FloatArray = lfilter([math.sqrt(1.0 - decay**2)], [1.0, -decay], rng.standard_normal(samples))
    return noise


def _with_trim(values: FloatArray, trim_s: float, sample_rate_hz: float) -> FloatArray:
    return np.pad(values, round(trim_s * sample_rate_hz))
