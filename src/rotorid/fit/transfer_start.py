r"""Start values from the response as a fraction: linear least squares on numerator and denominator.

A transfer function :math:`T = B / A` is no linear function of its coefficients, but :math:`A T_{data} - B` is. Levy's
least squares on it weigh high frequencies too much, by :math:`|A|^2`; dividing by the denominator of the step before
takes that away (Sanathanan and Koerner, *Transfer function synthesis as a ratio of two complex polynomials*, IEEE
Transactions on Automatic Control, 1963). Any state space is such a fraction, with :math:`\det(j\omega M - F)` below the
line. Where its parameters stand in products, a step is one of Gauss and Newton, not the whole way.
"""

from __future__ import annotations

import numpy as np

from rotorid.fit.log_errors import equation_errors
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_STEPS = 8
_RANK = 1e-12


def fraction_starts(problem: FrequencyProblem, thetas: FloatArray, *, count: int = 2) -> tuple[FloatArray, ...]:
    """The best parameters met on the way of Sanathanan and Koerner from each of ``thetas``.

    Parameters
    ----------
    problem
        Structure, data, points.
    thetas
        Where to begin, shape ``(b, p)``. Delays stay as they are; give a grid of them, no coarser than half a radian at
        the highest frequency.
    count
        How many to give back, from different places on that grid.

    Returns
    -------
    tuple of numpy.ndarray
        Free parameters, each shape ``(p,)``, best first.
    """
    lower, upper = problem.box
    moving = ~delays(problem)
    weight = np.sqrt(problem.point_scales[0] ** 2 + problem.point_scales[1] ** 2)
    now = np.clip(thetas, lower, upper)
    best, cost = now, problem.many_costs(now)
    for _ in range(_STEPS):
        error, slope = equation_errors(problem.parameter_map, now, problem.points)
        step = np.zeros_like(now)
        step[:, moving] = _least_squares(weight * error, weight * slope[:, moving])
        now = np.clip(now + step, lower, upper)
        found = problem.many_costs(now)
        better = found < cost
        best, cost = np.where(better[:, None], now, best), np.where(better, found, cost)
    order = np.argsort(cost, kind="stable")[:count]
    return tuple(best[slot] for slot in order if np.isfinite(cost[slot]))


def delays(problem: FrequencyProblem) -> BoolArray:
    """Which free parameters stand in a delay, shape ``(p,)``."""
    _, slopes = problem.parameter_map.tangent(problem.parameters.pack())
    found = slopes.input_delays_s.any(axis=-1) | slopes.output_delays_s.any(axis=-1)
    return np.asarray(found, dtype=np.bool_)


def _least_squares(error: ComplexArray, slope: ComplexArray) -> FloatArray:
    """Steps that bring complex errors ``(b, n)`` nearest to zero, ``(b, k)``; the smallest of several, scaled."""
    real = np.concatenate([error.real, error.imag], axis=-1)
    columns = np.concatenate([slope.real, slope.imag], axis=-1)
    # Where the model has no response there is no step.
    whole = np.isfinite(real).all(axis=-1) & np.isfinite(columns).all(axis=(-1, -2))
    real, columns = np.where(whole[:, None], real, 0.0), np.where(whole[:, None, None], columns, 0.0)
    length = np.sqrt(np.sum(columns**2, axis=-1))
    length = np.where(length > 0.0, length, 1.0)
    inverse = np.linalg.pinv(np.swapaxes(columns / length[..., None], -1, -2), rcond=_RANK)
    return np.asarray(-(inverse @ real[..., None])[..., 0] / length)
