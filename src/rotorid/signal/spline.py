r"""Cubic splines through samples, with continuous second derivative and "not-a-knot" ends.

Between samples the spline is

.. math:: s(t) = y_i + m_i h + c_1 h^2 + c_0 h^3, \qquad h = t - t_i

whose slopes :math:`m_i` make the second derivative continuous; the third derivative is continuous at the second and the
last but one sample. It is :class:`scipy.interpolate.CubicSpline` to the last bit, without the second that importing
:mod:`scipy.interpolate` takes, which is more than reading a log.

References
----------
de Boor, *A Practical Guide to Splines*, chapter IV.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from rotorid.typing import FloatArray

_FEWEST = 4
"""Of fewer samples the spline is a parabola or a line."""


def cubic_spline(
    time_s: FloatArray, values: FloatArray, at_s: FloatArray, *, derivative: Literal[0, 1] = 0
) -> FloatArray:
    """Values of the cubic spline through samples, or its slopes; shape ``(..., m)``.

    Outside the samples the first or last piece goes on, which is right only for a fraction of a step.

    Parameters
    ----------
    time_s
        Stamps, rising, shape ``(n,)``, two and more.
    values
        Finite samples, shape ``(..., n)``.
    at_s
        Where it is wanted, shape ``(m,)``.
    derivative
        0 for values, 1 for slopes per second.

    Examples
    --------
    >>> time_s = np.array([0.0, 1.0, 2.5, 3.0, 4.0])
    >>> cubic_spline(time_s, time_s**3, np.array([0.5, 3.5])).round(9).tolist()
    [0.125, 42.875]
    >>> cubic_spline(time_s, time_s**3, np.array([2.0]), derivative=1).round(9).tolist()
    [12.0]
    """
    if time_s.size < _FEWEST:
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(time_s, values, axis=-1)(at_s, derivative))
    flat = np.asarray(values, dtype=np.float64).reshape(-1, time_s.size)
    steps = np.diff(time_s)
    rises = np.diff(flat, axis=1) / steps
    slopes = _slopes(time_s, steps, rises)
    bend = (slopes[:, :-1] + slopes[:, 1:] - 2 * rises) / steps
    pieces = (flat[:, :-1], slopes[:, :-1], (rises - slopes[:, :-1]) / steps - bend, bend / steps)

    piece = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, time_s.size - 2)
    beyond = at_s - time_s[piece]
    if derivative:
        _, first, second, third = (part[:, piece] for part in pieces)
        found = first + second * beyond * 2.0 + third * (beyond * beyond) * 3.0
    else:
        level, first, second, third = (part[:, piece] for part in pieces)
        found = level + first * beyond + second * (beyond * beyond) + third * (beyond * beyond * beyond)
    return np.asarray(found.reshape(*np.shape(values)[:-1], np.size(at_s)))


def _slopes(time_s: FloatArray, steps: FloatArray, rises: FloatArray) -> FloatArray:
    """Slopes at the samples, shape ``(channels, n)``, from the tridiagonal equations of a continuous curvature."""
    from scipy.linalg import solve_banded

    bands = np.zeros((3, time_s.size))
    bands[1, 1:-1] = 2 * (steps[:-1] + steps[1:])
    bands[0, 2:], bands[2, :-2] = steps[:-1], steps[1:]
    right = np.empty((time_s.size, rises.shape[0]))
    right[1:-1] = (3 * (steps[1:] * rises[:, :-1] + steps[:-1] * rises[:, 1:])).T
    first, last = time_s[2] - time_s[0], time_s[-1] - time_s[-3]
    bands[1, 0], bands[0, 1] = steps[1], first
    right[0] = ((steps[0] + 2 * first) * steps[1] * rises[:, 0] + steps[0] ** 2 * rises[:, 1]) / first
    bands[1, -1], bands[2, -2] = steps[-2], last
    right[-1] = (steps[-1] ** 2 * rises[:, -2] + (2 * last + steps[-1]) * steps[-2] * rises[:, -1]) / last
    return np.asarray(solve_banded((1, 1), bands, right, overwrite_ab=True, overwrite_b=True, check_finite=False)).T
