"""The filters that measurement and prediction pass alike before they are compared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray

Filter: TypeAlias = Callable[[FloatArray], FloatArray]
LowPass: TypeAlias = float | Literal["auto"] | None

VIBRATION_LOW_PASS_RAD_S = 100.0
"""First order, as the Hummingbird was verified (Niermeyer, Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics
Identification in Frequency Domain via Closed-Loop Flight Testing*, section V)."""

VIBRATING = 0.1
"""Share of power above the fitted band, relative to that in it, from which a low-pass is asked for."""

_LEAST_PERIODS = 1.5
_LEAST_PADDING_S = 3.0
_ORDER = 2
_HIGHEST = 0.9


def band_pass(band_rad_s: tuple[float, float], rate_hz: float, duration_s: float) -> Filter:
    """A zero-phase filter on the fitted band, for arrays ``(..., samples)``.

    A low-pass at the upper end and, where the record holds 1.5 periods of it, a high-pass at the lower end.

    Parameters
    ----------
    band_rad_s
        The fitted band.
    rate_hz, duration_s
        Of the record.
    """
    from scipy.signal import butter, sosfiltfilt

    low, high = (edge / (np.pi * rate_hz) for edge in band_rad_s)
    sections = []
    if high < _HIGHEST:
        sections.append(butter(_ORDER, high, output="sos"))
    least_s = _LEAST_PERIODS * 2.0 * np.pi / band_rad_s[0]
    high_pass = duration_s >= least_s and low < min(high, _HIGHEST)
    if high_pass:
        sections.append(butter(_ORDER, low, btype="high", output="sos"))
    if not sections:
        return np.asarray
    stacked = np.vstack(sections)
    # The high-pass filter rings at the ends of a trend; a padding as long as its slowest wave keeps that outside.
    padding_s = max(_LEAST_PADDING_S, least_s if high_pass else 0.0)
    return lambda values: np.asarray(
        sosfiltfilt(stacked, values, axis=-1, padlen=min(values.shape[-1] - 1, round(padding_s * rate_hz)))
    )


def low_pass(cutoff_rad_s: float, rate_hz: float) -> Filter:
    """A causal first-order low-pass that begins settled on the first sample, for arrays ``(..., samples)``.

    The model is linear: the filter on the inputs of a simulation, or on its outputs, is the same.

    Parameters
    ----------
    cutoff_rad_s
        Where the magnitude has fallen by 3 dB.
    rate_hz
        Of the record.

    Raises
    ------
    UsageError
        The cutoff does not lie between zero and half of the sample rate.
    """
    from scipy.signal import butter, lfilter, lfilter_zi

    if not 0.0 < cutoff_rad_s < np.pi * rate_hz:
        raise UsageError(
            f"a low-pass at {cutoff_rad_s:.4g} rad/s came",
            needed=f"between 0 and the Nyquist frequency of {np.pi * rate_hz:.4g} rad/s",
        )
    b, a = butter(1, cutoff_rad_s / (np.pi * rate_hz))
    settled = lfilter_zi(b, a)
    return lambda values: np.asarray(lfilter(b, a, values, axis=-1, zi=values[..., :1] * settled)[0])


def vibration(measured: FloatArray, band_rad_s: tuple[float, float], rate_hz: float) -> FloatArray:
    """Power of each output above the band relative to that below its upper end, shape ``(y,)``.

    Parameters
    ----------
    measured
        Shape ``(y, samples)``.
    band_rad_s
        The fitted band.
    rate_hz
        Sample rate.
    """
    spectrum = np.abs(np.fft.rfft((measured - measured.mean(axis=1, keepdims=True)) * np.hanning(measured.shape[1])))
    omega = 2.0 * np.pi * np.fft.rfftfreq(measured.shape[1], 1.0 / rate_hz)
    power = spectrum**2
    inside = power[:, omega <= band_rad_s[1]].sum(axis=1)
    share: FloatArray = power[:, omega > band_rad_s[1]].sum(axis=1) / np.where(inside > 0.0, inside, np.inf)
    return share


def chosen_low_pass(
    choice: LowPass, measured: FloatArray, band_rad_s: tuple[float, float], rate_hz: float
) -> float | None:
    """The low-pass to use: the one given, or 100 rad/s where an output vibrates, or none.

    Parameters
    ----------
    choice
        A cutoff in rad/s, ``auto`` to decide by the data, ``None`` for none.
    measured
        Shape ``(y, samples)``.
    band_rad_s
        The fitted band.
    rate_hz
        Sample rate.
    """
    if choice != "auto":
        return choice
    fast_enough = np.pi * rate_hz > VIBRATION_LOW_PASS_RAD_S
    if fast_enough and vibration(measured, band_rad_s, rate_hz).max() > VIBRATING:
        return VIBRATION_LOW_PASS_RAD_S
    return None
