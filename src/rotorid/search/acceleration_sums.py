r"""Sums of errors over all samples as functions of one gain, in a time that does not depend on the samples.

With :math:`r = a / x`, a sum of absolute errors is a sum of distances,

.. math:: \sum_k |a(k) - g x(k)| = \sum_k |x(k)| \, |g - r(k)|

which is piecewise linear in the gain. Once ratios are sorted and their weights are added up, it takes a search for the
piece that the gain lies on. A sum of squares is one parabola.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from rotorid.typing import FloatArray


class ErrorSum(Protocol):
    """Sum of errors of one channel at any number of gains."""

    @property
    def best(self) -> float:
        """A gain with the least sum; not a number where nothing depends on it."""
        ...

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        ...


class AbsoluteSum(NamedTuple):
    """Sum of absolute errors ``|a - g x|``.

    Parameters
    ----------
    best
        A gain with the least sum; distances are counted from there, so that rounding is small where the sum is.
    corners
        Gains less the best one at which an error changes its sign, ascending, shape ``(n,)``.
    level, slope
        The sum on each of the pieces between corners is ``level + slope (g - best)``, shapes ``(n + 1,)``.
    """

    best: float
    corners: FloatArray
    level: FloatArray
    slope: FloatArray

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        moved = gains - self.best
        piece = np.searchsorted(self.corners, moved)
        return np.asarray(self.level[piece] + self.slope[piece] * moved)


class SquaredSum(NamedTuple):
    """Sum of squares of errors ``a - g x``: ``least`` at the best gain, and a parabola about it."""

    best: float
    least: float
    curvature: float

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        return np.asarray(self.least + self.curvature * (gains - self.best) ** 2)


def absolute_sum(made: FloatArray, carried: FloatArray, weights: FloatArray | None = None) -> AbsoluteSum:
    """Of samples ``a`` and ``x``, both ``(n,)``, and their weights, one each by default.

    Examples
    --------
    >>> total = absolute_sum(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 3.0]))
    >>> total.best, total(np.array([0.0, 2.0, 3.0])).tolist()
    (3.0, [12.0, 4.0, 3.0])
    """
    weights = np.ones(made.size) if weights is None else weights
    moves = carried != 0.0
    constant = float(np.sum((weights * np.abs(made))[~moves]))
    ratios = made[moves] / carried[moves]
    order = np.argsort(ratios, kind="stable")
    corners, sizes = ratios[order], (weights[moves] * np.abs(carried[moves]))[order]
    passed = np.concatenate([[0.0], np.cumsum(sizes)])
    best = float(corners[np.searchsorted(passed[1:], 0.5 * passed[-1])]) if corners.size else np.nan
    corners = corners - best
    lever = np.concatenate([[0.0], np.cumsum(sizes * corners)])
    return AbsoluteSum(best, corners, constant + lever[-1] - 2.0 * lever, 2.0 * passed - passed[-1])


def squared_sum(made: FloatArray, carried: FloatArray, weights: FloatArray | None = None) -> SquaredSum:
    """The same of squares.

    Examples
    --------
    >>> total = squared_sum(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 3.0]))
    >>> round(total.best, 9), total(np.array([0.0, 3.0])).round(9).tolist()
    (2.727272727, [86.0, 5.0])
    """
    weights = np.ones(made.size) if weights is None else weights
    curvature = float(np.sum(weights * carried**2))
    best = float(np.sum(weights * made * carried)) / curvature if curvature else np.nan
    return SquaredSum(best, float(np.sum(weights * (made - best * carried) ** 2)), curvature)
