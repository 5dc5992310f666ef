"""Steps that a mapping asks for on a channel: its derivative, and a low-pass without phase.

A file of motion capture may hold positions where velocities are wanted, and noise where a slow answer is. Both steps
see the samples as they stand in the file, before any resampling; what was done stands in the source of the channel,
and with it in every result.
"""

from __future__ import annotations

import numpy as np

from rotorid.errors import LogError
from rotorid.io.tables.mapping import Series
from rotorid.typing import FloatArray

_ORDER = 4
_UNEVEN = 0.5
"""Of a step: stamps that stray by more from a uniform clock are no samples of it."""

_SETTLING = 3.0
"""Periods of the cutoff that a record has to last."""


def describe_steps(series: Series) -> str:
    """Where the samples stand in the file, and what was done to them.

    Examples
    --------
    >>> describe_steps(Series(source="x", derivative=True, low_pass_hz=5.0))
    'derivative of x, zero-phase low-pass at 5 Hz'
    """
    text = f"derivative of {series.source}" if series.derivative else series.source
    return text if series.low_pass_hz is None else f"{text}, zero-phase low-pass at {series.low_pass_hz:g} Hz"


def processed(series: Series, time_s: FloatArray, values: FloatArray, file: str) -> FloatArray:
    """Samples after the steps of their mapping, first the derivative, then the low-pass.

    Parameters
    ----------
    time_s, values
        Stamps and samples, shape ``(n,)``.
    file
        For messages.

    Raises
    ------
    LogError
        Stamps stand still or step back, are not nearly even, or the record is too short or too slow for the filter.
    """
    if not series.derivative and series.low_pass_hz is None:
        return values
    if time_s.size < 3 or not np.diff(time_s).min() > 0.0:
        raise LogError(
            f"{file}: the clock of {series.source} stops or steps back",
            needed="stamps that rise, for a derivative or a low-pass",
            remedy="remove `derivative` and `low_pass_hz`, or correct the stamps",
        )
    if series.derivative:
        from scipy.interpolate import CubicSpline

        values = np.asarray(CubicSpline(time_s, values)(time_s, 1), dtype=np.float64)
    return values if series.low_pass_hz is None else _low_pass(series, series.low_pass_hz, time_s, values, file)


def _low_pass(series: Series, cutoff_hz: float, time_s: FloatArray, values: FloatArray, file: str) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    step_s = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    stray = float(np.abs(time_s - np.linspace(time_s[0], time_s[-1], time_s.size)).max())
    if stray > _UNEVEN * step_s:
        raise LogError(
            f"{file}: the stamps of {series.source} stray by {stray / step_s:.2g} steps from an even clock",
            needed="samples of a nearly even clock, for a low-pass",
            remedy="cut the file where it has gaps, or remove `low_pass_hz`",
        )
    lasts_s = step_s * (time_s.size - 1)
    if not 2.0 * cutoff_hz * step_s < 1.0 or lasts_s * cutoff_hz < _SETTLING:
        raise LogError(
            f"{file}: a low-pass at {cutoff_hz:g} Hz was asked of {lasts_s:.3g} s of {series.source} at "
            f"{1.0 / step_s:.3g} Hz",
            needed="a cutoff below half of the rate, and a record of three of its periods",
            remedy="change `low_pass_hz`",
        )
    sections = butter(_ORDER, cutoff_hz, fs=1.0 / step_s, output="sos")
    return np.asarray(sosfiltfilt(sections, values, padlen=min(values.size - 1, 30)), dtype=np.float64)
