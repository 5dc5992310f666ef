r"""Lag of one signal behind another, what a third one explains being taken out of both.

.. math:: \hat\tau = \arg\max_\tau \operatorname{corr}\bigl(x(t - \tau), y(t) \mid w(t)\bigr)

Where :math:`y = g\,x(t - \tau) + d\,w(t)`, as of a damped rotation or of an accelerometer that misses a part of the
drag, the plain correlation has its peak elsewhere: the two terms are out of phase. :mod:`rotorid.signal.skew` answers
for two channels that measure one motion, where there is no third one.

The random error is that of leaving out one block after another (Efron and Tibshirani, *An Introduction to the
Bootstrap*, 1993, chapter 11).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import Quantity
from rotorid.errors import InsufficientDataError
from rotorid.typing import BoolArray, FloatArray, IntArray

_FINE_S = 5e-4
_FEWEST_BLOCKS = 3


class LagPart(NamedTuple):
    """A stretch without gaps, on an even clock; all of shape ``(samples,)``.

    Parameters
    ----------
    cause, answer, third
        :math:`x`, :math:`y` and :math:`w`, in one band, without means.
    block
        Number of the block of each sample, rising.
    kept
        Whether a sample of the answer counts.
    """

    cause: FloatArray
    answer: FloatArray
    third: FloatArray
    block: IntArray
    kept: BoolArray


class Lag(NamedTuple):
    """Lag of the answer, its random standard deviation, and the partial correlation there."""

    seconds: float
    std: float
    correlation: float


@dataclass(frozen=True, eq=False)
class LagCurve(Immutable):
    """Sums over blocks of products of cause (at each lag), answer and third signal.

    Parameters
    ----------
    lags_s
        Shape ``(lags,)``.
    sums
        Of :math:`xy, xw, xx, yy, yw, ww`, shape ``(6, blocks, lags)``.
    """

    lags_s: FloatArray
    sums: FloatArray

    def __post_init__(self) -> None:
        self._set(
            lags_s=read_only(self.lags_s, np.float64, ndim=1),
            sums=read_only(self.sums, np.float64, ndim=3),
        )

    def lag(self) -> Lag:
        """The lag of the largest partial correlation."""
        total = self.sums.sum(axis=1, keepdims=True)
        found, _ = _peaks(self.lags_s, total - self.sums)
        (seconds,), (correlation,) = _peaks(self.lags_s, total)
        share = (found.size - 1) / found.size
        std = math.sqrt(share * float(np.sum((found - found.mean()) ** 2)))
        return Lag(float(seconds), std, float(correlation))


def lag_curve(parts: Iterable[LagPart], *, step_s: float, longest_s: float, where: str) -> LagCurve:
    """Sums for lags up to the longest, of either sign.

    Parameters
    ----------
    parts
        On clocks of one step.
    where
        What the error calls the signals.

    Raises
    ------
    InsufficientDataError
        Fewer than three blocks are inside of the parts by the longest lag.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> x, w = np.convolve(rng.normal(size=4010), np.hanning(9), "valid"), np.sin(np.arange(4002) / 30.0)
    >>> block, kept = np.arange(3992) // 200, np.ones(3992, dtype=np.bool_)
    >>> part = LagPart(x[10:], x[:-10] + 3.0 * w[10:], w[10:], block, kept)
    >>> lag = lag_curve([part], step_s=0.01, longest_s=0.3, where="y/x").lag()
    >>> round(lag.seconds, 3), round(lag.correlation, 2)
    (0.1, 1.0)
    """
    reach = math.ceil(longest_s / step_s)
    lags = np.arange(-reach, reach + 1)
    sums = []
    for part in parts:
        inside = np.arange(reach, part.answer.size - reach)
        inside = inside[part.kept[inside]]
        if not inside.size:
            continue
        x, y, w = part.cause[inside - lags[:, None]], part.answer[inside], part.third[inside]
        starts = np.flatnonzero(np.diff(part.block[inside], prepend=-1))
        rows = (x * y, x * w, x**2, *(np.broadcast_to(row, x.shape) for row in (y**2, y * w, w**2)))
        sums.append(np.stack([np.add.reduceat(row, starts, axis=1).T for row in rows]))
    blocks = sum(part.shape[1] for part in sums)
    if blocks < _FEWEST_BLOCKS:
        raise InsufficientDataError(
            f"{where} has {blocks} blocks without gaps", needed=f"{_FEWEST_BLOCKS}", remedy="log a longer flight"
        )
    return LagCurve(np.asarray(lags * step_s, dtype=np.float64), np.concatenate(sums, axis=1))


def together(lags: Iterable[Quantity]) -> Quantity:
    """Mean of lags that should be one, by inverse variance; half of their range is its error where that is more."""
    found = tuple(lags)
    values = np.array([lag.value for lag in found])
    weights = 1.0 / np.maximum([lag.std for lag in found], 1e-6) ** 2
    std = max(float(weights.sum()) ** -0.5, 0.5 * float(np.ptp(values)))
    return Quantity.normal(float(np.average(values, weights=weights)), std, "s")


def _peaks(lags_s: FloatArray, sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lag and size of the largest partial correlation, of each row of sums: shape ``(rows,)``."""
    from scipy.interpolate import CubicSpline

    xy, xw, xx, yy, yw, ww = sums
    ww = np.maximum(ww, np.finfo(np.float64).tiny)
    power = np.sqrt(np.maximum(xx - xw**2 / ww, 0.0) * np.maximum(yy - yw**2 / ww, 0.0))
    curves = np.divide(xy - xw * yw / ww, power, out=np.zeros_like(xy), where=power > 0.0)
    fine_s = np.arange(lags_s[0], lags_s[-1] + 0.5 * _FINE_S, _FINE_S)
    values = CubicSpline(lags_s, curves, axis=1)(fine_s)
    best = np.clip(np.argmax(values, axis=1), 1, fine_s.size - 2)
    before, at, after = (np.take_along_axis(values, (best + step)[:, None], 1)[:, 0] for step in (-1, 0, 1))
    bend = before - 2.0 * at + after
    offset = np.divide(0.5 * (before - after), bend, out=np.zeros_like(bend), where=bend < 0.0)
    return fine_s[best] + np.clip(offset, -1.0, 1.0) * _FINE_S, at
