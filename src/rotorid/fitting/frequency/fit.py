r"""Fit a structure to frequency responses: in CIFER's cost from several starts, then with weights of the covariance.

Many searches take their steps of Levenberg and Marquardt together, on arrays of parameter vectors. Responses that a
structure cannot have, whatever its parameters are, are left out before.

CIFER's cost counts every response alike and every point by itself. But errors go together: of the rate and of the
angle each holds the same gust, and what they say about each other is known far better than either alone. With the
covariance :math:`C` of all residuals :math:`r`

.. math:: \min_\theta \; r^T (C + C_0)^{-1} r

of generalized least squares lets what is common to several outputs cancel. Of the linear unbiased estimates it has the
least variance (Aitken 1935). The covariance is taken about the fitted model and not about the estimate: an estimate has
adapted to its disturbance, and weights that know of it would pull the fit along. :math:`C_0` keeps it from believing
too much: one percent of error of the model at every point, and a tenth of each point's own variance that nothing else
shares. On simulated closed-loop flights of a quadrotor in turbulence standard deviations fall to a half and down to a
tenth of those of CIFER's weights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import cached_by_value
from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.pole_order import with_faster_motor
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.frequency.starts import own_starts, start_values
from rotorid.fitting.least_squares import (
    LARGEST_DAMPING,
    LevenbergMarquardt,
    Minimum,
    Outcome,
    Solution,
    best_of,
    same_cost,
)
from rotorid.fitting.problem import ResidualErrors
from rotorid.typing import BoolArray, FloatArray, IntArray


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a start far off has a cost that is no number
def fit_frequency(
    problem: FrequencyProblem,
    *,
    solver: LevenbergMarquardt | None = None,
    starts: Sequence[FloatArray] = (),
    count: int = 3,
) -> Solution:
    """Fit the free parameters of a problem.

    The structure's own start values are tried first, where they are any good, then those that the data give. A start
    that ends no lower than the best so far, and no higher, ends the search if the cost is acceptable. Of minima with
    one cost the first counts, so that the data do not swap two poles of the structure; where they did, the motor is
    made the faster one again. Other minima that were met are kept in ``others`` of the solution.

    Parameters
    ----------
    problem
        Structure, data, points.
    solver
        Local solver; the default suits problems of some ten parameters.
    starts
        Start values of the free parameters, best first; by default those of :mod:`rotorid.fitting.frequency.starts`.
    count
        How many starts from the data to try at most, where no ``starts`` are given.

    Raises
    ------
    InsufficientDataError
        There are fewer points than parameters, or no start at which the model has a response at all of them.
    """
    solver = solver or LevenbergMarquardt()
    points = problem.points.values.size
    if 2 * points <= len(problem.parameters.free):
        raise InsufficientDataError(
            f"only {points} usable frequencies", needed=f"more than {len(problem.parameters.free) // 2}"
        )
    acceptable = ACCEPTABLE_COST * np.count_nonzero(problem.used.any(axis=-1))
    found: list[Solution] = []
    for start in starts or _starts(problem, count):
        solution = solver.minimize(problem.residuals, start, *problem.box)
        if not np.isfinite(solution.cost):
            continue
        lowest = min((solution.cost for solution in found), default=np.inf)
        found.append(solution)
        again = solution.outcome is Outcome.CONVERGED and same_cost(solution.cost, lowest)
        if again and solution.cost <= acceptable:
            break
    best = best_of(found, name=problem.structure.name)
    exchanged = with_faster_motor(problem, best.theta)
    if exchanged is None:
        return best
    return best_of([solver.minimize(problem.residuals, exchanged, *problem.box), *found], name=problem.structure.name)


def _starts(problem: FrequencyProblem, count: int) -> Iterator[FloatArray]:
    yield from own_starts(problem)
    # These take longer to find, and are looked for only when they are needed.
    yield from start_values(problem, count=count)


ManyResiduals: TypeAlias = Callable[[FloatArray, IntArray], tuple[FloatArray, FloatArray]]
"""From parameters ``(b, p)`` of the searches ``(b,)`` to residuals ``(b, n)`` and their derivatives ``(b, p, n)``."""

_SOLVER = LevenbergMarquardt(iterations=100, tolerance=1e-8)
_BLOCK_NUMBERS = 200_000
"""Numbers in the Jacobians of one block: they stay in the cache, and memory does not grow with the searches."""


class Minima(NamedTuple):
    """Where many searches ended.

    Parameters
    ----------
    cost
        Sums of squared residuals, shape ``(b,)``; infinite where a start has none.
    theta
        Free parameters, shape ``(b, p)``.
    settled
        Which searches came to rest, shape ``(b,)``; the others ran out of iterations or never had a cost.
    """

    cost: FloatArray
    theta: FloatArray
    settled: BoolArray


def fit_many(
    problem: FrequencyProblem, starts: Sequence[FloatArray] | FloatArray, *, solver: LevenbergMarquardt = _SOLVER
) -> tuple[Minimum, ...]:
    """Where a local search ends from each of many starts.

    A start whose model has no response is given back with an infinite cost.

    Parameters
    ----------
    problem
        Structure, data, points.
    starts
        Free parameters, each shape ``(p,)``; they are brought into the bounds first.
    solver
        Iterations and tolerance; the default is less patient than that of a single fit, which may polish the best.

    Returns
    -------
    tuple of Minimum
        In the order of the starts.
    """
    thetas = np.array(starts, dtype=np.float64).reshape(-1, len(problem.parameters.free))
    size = 2 * problem.points.values.size

    def residuals(at: FloatArray, _: IntArray) -> tuple[FloatArray, FloatArray]:
        return problem.many_residuals(at)

    found = minimize_many(residuals, thetas, *problem.box, size=size, solver=solver)
    return tuple(Minimum(float(cost), theta) for cost, theta in zip(found.cost, found.theta, strict=True))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a step too far gives a cost that is no number
def minimize_many(
    residuals: ManyResiduals,
    starts: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    *,
    size: int,
    solver: LevenbergMarquardt = _SOLVER,
) -> Minima:
    """Minimize many sums of squares, each from its own start, with data of its own where ``residuals`` has them.

    All searches take their steps together, so that the work is done by few calls on large arrays. The steps are those
    of :class:`rotorid.fitting.least_squares.LevenbergMarquardt`.

    Parameters
    ----------
    residuals
        Residuals and derivatives of some of the searches; it receives which, as indices into ``starts``.
    starts
        Shape ``(b, p)``; they are brought into the box first.
    lower, upper
        The box, shape ``(p,)`` each.
    size
        Residuals of one search.
    solver
        Iterations and tolerance.

    Examples
    --------
    >>> data = np.array([1.0, 4.0, 9.0])
    >>> def roots(thetas, which):
    ...     return thetas**2 - data[which, None], 2.0 * thetas[:, :, None]
    >>> wide = np.array([np.inf])
    >>> minimize_many(roots, np.ones((3, 1)), -wide, wide, size=1).theta[:, 0].round(6).tolist()
    [1.0, 2.0, 3.0]
    """
    task = _Task(residuals, lower, upper, size)
    thetas = np.clip(starts, lower, upper)
    search = task.at(thetas, np.arange(len(thetas)))
    damping = np.full(len(thetas), 1e-3)
    running = np.isfinite(search.cost)
    settled = np.zeros(len(thetas), dtype=np.bool_)
    for _ in range(solver.iterations):
        index = np.flatnonzero(running)
        if index.size == 0:
            break
        done, search, damping = _advance(task, search, damping, index, solver.tolerance)
        running[index[done]] = False
        settled[index[done]] = True
    return Minima(search.cost, search.theta, settled)


@dataclass(frozen=True, eq=False)
class _Search:
    """Where all searches are: parameters ``(b, p)``, cost ``(b,)``, gradient ``(b, p)``, normal matrix ``(b, p, p)``.

    Gradient and normal matrix are those of half the cost.
    """

    theta: FloatArray
    cost: FloatArray
    gradient: FloatArray
    normal: FloatArray

    def part(self, index: IntArray | BoolArray) -> _Search:
        return _Search(self.theta[index], self.cost[index], self.gradient[index], self.normal[index])

    def updated(self, index: IntArray, other: _Search) -> _Search:
        arrays = []
        for name in ("theta", "cost", "gradient", "normal"):
            array = getattr(self, name).copy()
            array[index] = getattr(other, name)
            arrays.append(array)
        return _Search(*arrays)


@dataclass(frozen=True, eq=False)
class _Task:
    """Objective and box of a search, with the number of residuals."""

    residuals: ManyResiduals
    lower: FloatArray
    upper: FloatArray
    size: int

    def at(self, thetas: FloatArray, which: IntArray) -> _Search:
        count, width = thetas.shape
        cost, gradient, normal = np.empty(count), np.empty((count, width)), np.empty((count, width, width))
        step = max(_BLOCK_NUMBERS // max(self.size * max(width, 1), 1), 1)
        for first in range(0, count, step):
            block = slice(first, first + step)
            residual, jacobian = self.residuals(thetas[block], which[block])
            cost[block] = np.einsum("bn,bn->b", residual, residual)
            gradient[block] = (jacobian @ residual[..., None])[..., 0]
            normal[block] = jacobian @ np.swapaxes(jacobian, -1, -2)
        return _Search(thetas, np.where(np.isfinite(cost), cost, np.inf), gradient, normal)


def _advance(
    task: _Task, search: _Search, damping: FloatArray, index: IntArray, tolerance: float
) -> tuple[BoolArray, _Search, FloatArray]:
    """One step of the searches ``index``: which of them are done, and where all are then."""
    now = search.part(index)
    scale = np.sqrt(np.maximum(np.einsum("bii->bi", now.normal), 1e-300))
    at_bound = ((now.theta <= task.lower) & (now.gradient > 0.0)) | ((now.theta >= task.upper) & (now.gradient < 0.0))
    level = np.sqrt(1.0 + now.cost)
    flat = np.where(at_bound, 0.0, np.abs(now.gradient / scale)).max(axis=-1, initial=0.0) <= 1e-14 * level
    trial = np.clip(now.theta + _steps(now, damping[index], at_bound), task.lower, task.upper)
    promised = _promised(now, trial - now.theta)
    # A step that would be the last is not worth the evaluation.
    last = (damping[index] <= 1e-2) & (promised >= 0.0) & (promised <= tolerance * (1e-6 + now.cost))
    done = flat | last
    going = np.flatnonzero(~done)
    now, trial, scale, level, index = now.part(going), trial[going], scale[going], level[going], index[going]
    new = task.at(trial, index)
    length = np.abs((trial - now.theta) * scale).max(axis=-1, initial=0.0)
    better = new.cost < now.cost
    small = (length <= tolerance * level) | (
        (now.cost - new.cost <= tolerance * (1e-6 + now.cost)) & (damping[index] <= 1e-2)
    )
    stuck = (damping[index] > LARGEST_DAMPING) | (length <= 1e-13 * level)
    changed = damping.copy()
    changed[index] = np.where(better, np.maximum(damping[index] / 9.0, 1e-12), damping[index] * 6.0)
    done[going] = np.where(better, small, stuck)
    return done, search.updated(index[better], new.part(better)), changed


def _promised(now: _Search, step: FloatArray) -> FloatArray:
    """By how much the cost would fall along steps, were the residuals straight; shape ``(b,)``."""
    curved = (now.normal @ step[..., None])[..., 0]
    return -np.asarray(np.einsum("bp,bp->b", step, 2.0 * now.gradient + curved))


def _steps(now: _Search, damping: FloatArray, at_bound: BoolArray) -> FloatArray:
    """Damped steps, zero for parameters at a bound."""
    size = now.theta.shape[1]
    diagonal = np.einsum("bii->bi", now.normal)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    system = now.normal / (scale[:, :, None] * scale[:, None, :])
    system = np.where(at_bound[:, :, None] | at_bound[:, None, :], 0.0, system)
    fixed = at_bound | (diagonal <= 0.0)
    system = system + np.eye(size) * np.where(fixed, 1.0, damping[:, None])[:, None, :]
    gradient = np.where(at_bound, 0.0, now.gradient / scale)
    return np.asarray(-np.linalg.solve(system, gradient[..., None])[..., 0] / scale)


_ROUNDS = 2
"""Errors are evaluated at the model of the round before; they are frozen after two rounds."""


def weights_of(
    problem: FrequencyProblem, asked: Literal["auto", "cifer", "covariance"]
) -> Literal["cifer", "covariance"]:
    """How errors are weighed: as asked, or by their covariance where several outputs share them."""
    if asked != "auto":
        return asked
    return "covariance" if np.count_nonzero(problem.used.any(axis=(1, 2))) > 1 else "cifer"


@cached_by_value
def refine(problem: FrequencyProblem, solution: Solution) -> Solution:
    """Continue a fit from its solution in CIFER's cost to the one of least variance.

    Parameters
    ----------
    problem
        What was fitted. The errors of its data must be those it states; feedback and a wrong structure are not in them.
    solution
        Where to start.

    Returns
    -------
    Solution
        Its residuals are normalized: of a structure that fits their squares sum to about their number or less.
    """
    solver = LevenbergMarquardt()
    for _ in range(_ROUNDS):
        errors = problem.errors_about(solution.theta)

        def normalized(theta: FloatArray, errors: ResidualErrors = errors) -> tuple[FloatArray, FloatArray]:
            # Together: the time goes into reading the factor, once for all columns.
            white = errors.whitened(np.column_stack(problem.residuals(theta)))
            return white[:, 0], white[:, 1:]

        solution = solver.minimize(normalized, solution.theta, *problem.box)
    return solution
