"""Filters that are applied to every channel of a record alike.

They run in both directions, without phase, so that ratios between channels stay what they were. Filters that an
autopilot ran are in :mod:`rotorid.autopilots.filters`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError

Shape: TypeAlias = Literal["lowpass", "highpass", "bandpass"]

ORDER = 4
"""Order of the Butterworth filter that runs forward and backward."""

_SETTLED = 0.01


def low_pass(history: TimeHistory, *, cutoff_rad_s: float, order: int = ORDER) -> TimeHistory:
    r"""Keep what is slower than the cutoff, on all channels alike and without phase.

    A Butterworth filter forward and backward:

    .. math:: |H(\omega)|^2 = \frac{1}{\left(1 + (\omega / \omega_c)^{2 n}\right)^2}

    so half of the amplitude is left at the cutoff. Responses between channels do not change where signal is left.
    The filter runs into the ends with the signal's point reflection, and the stretch that this touches is written into
    ``processing``; inside it values and responses lean on the reflection. A step, a gap that was bridged or a jump of
    an angle by :math:`2 \pi` spreads over the same time.

    Parameters
    ----------
    history
        All channels are filtered.
    cutoff_rad_s
        Frequency at which half of the amplitude is left.
    order
        Order of one pass, 1 to 8.

    Raises
    ------
    UsageError
        The cutoff does not lie between zero and the Nyquist frequency, or the order is out of range.
    InsufficientDataError
        The record is shorter than the filter takes to settle, or a sample is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.record import Channel
    >>> time_s = np.arange(0.0, 20.0, 0.01)
    >>> history = TimeHistory(
    ...     values=(np.sin(2.0 * time_s) + np.sin(100.0 * time_s))[None], channels=(Channel(name="p", unit="rad/s"),),
    ...     sample_rate_hz=100.0, start_s=0.0,
    ... )
    >>> smooth = low_pass(history, cutoff_rad_s=20.0)
    >>> bool(np.abs(smooth["p"] - np.sin(2.0 * time_s))[200:-200].max() < 2e-3)
    True
    >>> smooth.processing
    ('zero-phase low-pass at 20 rad/s, order 4 twice; edge effects within 0.60 s of the ends',)
    """
    return _filtered(history, "lowpass", [cutoff_rad_s], order)


def high_pass(history: TimeHistory, *, cutoff_rad_s: float, order: int = ORDER) -> TimeHistory:
    r"""Keep what is faster than the cutoff, on all channels alike and without phase; means and drifts go.

    .. math:: |H(\omega)|^2 = \frac{1}{\left(1 + (\omega_c / \omega)^{2 n}\right)^2}

    Parameters, edge effects and errors are those of :func:`low_pass`.
    """
    return _filtered(history, "highpass", [cutoff_rad_s], order)


def band_pass(history: TimeHistory, *, band_rad_s: tuple[float, float], order: int = ORDER) -> TimeHistory:
    """Keep a band, on all channels alike and without phase; half of the amplitude is left at both ends of it.

    Edge effects and errors are those of :func:`low_pass`; they last as long as the lower end takes to settle.

    Parameters
    ----------
    history
        All channels are filtered.
    band_rad_s
        Lower and upper cutoff.
    order
        Order of one pass on each flank, 1 to 8.
    """
    low, high = band_rad_s
    if not low < high:
        raise UsageError(f"the band {low:g}:{high:g} rad/s is empty", needed="0 < low < high")
    return _filtered(history, "bandpass", [low, high], order)


def _filtered(history: TimeHistory, shape: Shape, cutoffs_rad_s: Sequence[float], order: int) -> TimeHistory:
    _require_cutoffs(cutoffs_rad_s, order, math.pi * history.sample_rate_hz)
    from scipy.signal import butter, sosfiltfilt

    settling_s = _settling_s(cutoffs_rad_s, order)
    reach = math.ceil(settling_s * history.sample_rate_hz)
    count = history.values.shape[1]
    if count <= reach:
        raise InsufficientDataError(
            f"got a record of {history.duration_s:.3g} s",
            needed=f"more than the {settling_s:.3g} s that the filter takes to settle",
            remedy="choose a higher cutoff or a longer stretch",
        )
    if not np.isfinite(history.values).all():
        raise InsufficientDataError(
            "got samples that are not finite", needed="finite samples on every channel", remedy="cut the stretch there"
        )
    corners = cutoffs_rad_s if shape == "bandpass" else cutoffs_rad_s[0]
    sections = butter(order, corners, btype=shape, output="sos", fs=2.0 * math.pi * history.sample_rate_hz)
    values = sosfiltfilt(sections, history.values, axis=1, padlen=reach)
    band = ":".join(f"{cutoff:.4g}" for cutoff in cutoffs_rad_s)
    name = f"{shape.removesuffix('pass')}-pass"
    note = f"zero-phase {name} at {band} rad/s, order {order} twice; edge effects within {settling_s:.2f} s of the ends"
    return replace(history, values=values, processing=(*history.processing, note))


def _require_cutoffs(cutoffs_rad_s: Sequence[float], order: int, nyquist_rad_s: float) -> None:
    for cutoff in cutoffs_rad_s:
        if not 0.0 < cutoff < nyquist_rad_s:
            raise UsageError(
                f"got a cutoff of {cutoff:.4g} rad/s",
                needed=f"between 0 and the Nyquist frequency of {nyquist_rad_s:.4g} rad/s",
            )
    if not 1 <= order <= 8:
        raise UsageError(f"got a filter of order {order}", needed="1 to 8")


def _settling_s(cutoffs_rad_s: Sequence[float], order: int) -> float:
    r"""Time until the slowest pole has fallen to a hundredth.

    A Butterworth pole stands at :math:`-\omega_c \sin(\pi / 2n)` or further left; on a flank of a band its frequency is
    at most as wide as the band.
    """
    width = min([cutoffs_rad_s[0], *np.diff(cutoffs_rad_s)])
    return -math.log(_SETTLED) / (float(width) * math.sin(math.pi / (2 * order)))
