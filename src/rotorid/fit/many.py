"""Local minima from many starts at once: the steps of Levenberg and Marquardt on arrays of parameter vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.fit.levenberg_marquardt import LARGEST_DAMPING, LevenbergMarquardt
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Minimum
from rotorid.typing import BoolArray, FloatArray, IntArray

_SOLVER = LevenbergMarquardt(iterations=100, tolerance=1e-8)
_BLOCK_NUMBERS = 200_000
"""Numbers in the Jacobians of one block: they stay in the cache, and memory does not grow with the starts."""


def fit_many(
    problem: FrequencyProblem, starts: Sequence[FloatArray] | FloatArray, *, solver: LevenbergMarquardt = _SOLVER
) -> tuple[Minimum, ...]:
    """Where a local search ends from each of many starts.

    All starts take their steps together, so that the work is done by few calls on large arrays. The steps are those of
    :class:`rotorid.fit.levenberg_marquardt.LevenbergMarquardt`; a start whose model has no response is given back
    with an infinite cost.

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
    lower, upper = problem.box
    thetas = np.clip(np.array(starts, dtype=np.float64).reshape(-1, len(problem.parameters.free)), lower, upper)
    search = _Search.at(problem, thetas)
    damping = np.full(len(thetas), 1e-3)
    running = np.isfinite(search.cost)
    for _ in range(solver.iterations):
        index = np.flatnonzero(running)
        if index.size == 0:
            break
        done, search, damping = _advance(problem, search, damping, index, solver.tolerance)
        running[index[done]] = False
    return tuple(Minimum(float(cost), theta) for cost, theta in zip(search.cost, search.theta, strict=True))


@dataclass(frozen=True, eq=False)
class _Search:
    """Where all searches are: parameters ``(b, p)``, cost ``(b,)``, gradient ``(b, p)``, normal matrix ``(b, p, p)``.

    Gradient and normal matrix are those of half the cost.
    """

    theta: FloatArray
    cost: FloatArray
    gradient: FloatArray
    normal: FloatArray

    @classmethod
    def at(cls, problem: FrequencyProblem, thetas: FloatArray) -> _Search:
        count, size = thetas.shape
        cost, gradient, normal = np.empty(count), np.empty((count, size)), np.empty((count, size, size))
        numbers = 2 * problem.points.values.size * max(size, 1)
        step = max(_BLOCK_NUMBERS // max(numbers, 1), 1)
        for first in range(0, count, step):
            block = slice(first, first + step)
            residual, jacobian = problem.many_residuals(thetas[block])
            cost[block] = np.einsum("bn,bn->b", residual, residual)
            gradient[block] = (jacobian @ residual[..., None])[..., 0]
            normal[block] = jacobian @ np.swapaxes(jacobian, -1, -2)
        return cls(thetas, np.where(np.isfinite(cost), cost, np.inf), gradient, normal)

    def part(self, index: IntArray | BoolArray) -> _Search:
        return _Search(self.theta[index], self.cost[index], self.gradient[index], self.normal[index])

    def updated(self, index: IntArray, other: _Search) -> _Search:
        arrays = []
        for name in ("theta", "cost", "gradient", "normal"):
            array = getattr(self, name).copy()
            array[index] = getattr(other, name)
            arrays.append(array)
        return _Search(*arrays)


def _advance(
    problem: FrequencyProblem, search: _Search, damping: FloatArray, index: IntArray, tolerance: float
) -> tuple[BoolArray, _Search, FloatArray]:
    """One step of the searches ``index``: which of them are done, and where all are then."""
    lower, upper = problem.box
    now = search.part(index)
    scale = np.sqrt(np.maximum(np.einsum("bii->bi", now.normal), 1e-300))
    held = ((now.theta <= lower) & (now.gradient > 0.0)) | ((now.theta >= upper) & (now.gradient < 0.0))
    level = np.sqrt(1.0 + now.cost)
    flat = np.where(held, 0.0, np.abs(now.gradient / scale)).max(axis=-1, initial=0.0) <= 1e-14 * level
    trial = np.clip(now.theta + _steps(now, damping[index], held), lower, upper)
    new = _Search.at(problem, trial)
    length = np.abs((trial - now.theta) * scale).max(axis=-1, initial=0.0)
    better = new.cost < now.cost
    small = (length <= tolerance * level) | (
        (now.cost - new.cost <= tolerance * (1e-6 + now.cost)) & (damping[index] <= 1e-2)
    )
    stuck = (damping[index] > LARGEST_DAMPING) | (length <= 1e-13 * level)
    changed = damping.copy()
    changed[index] = np.where(better, np.maximum(damping[index] / 9.0, 1e-12), damping[index] * 6.0)
    accepted = better & ~flat
    return flat | np.where(better, small, stuck), search.updated(index[accepted], new.part(accepted)), changed


def _steps(now: _Search, damping: FloatArray, held: BoolArray) -> FloatArray:
    """Damped steps, zero along parameters that are held on a bound."""
    size = now.theta.shape[1]
    diagonal = np.einsum("bii->bi", now.normal)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    system = now.normal / (scale[:, :, None] * scale[:, None, :])
    system = np.where(held[:, :, None] | held[:, None, :], 0.0, system)
    alone = held | (diagonal <= 0.0)
    system = system + np.eye(size) * np.where(alone, 1.0, damping[:, None])[:, None, :]
    gradient = np.where(held, 0.0, now.gradient / scale)
    return np.asarray(-np.linalg.solve(system, gradient[..., None])[..., 0] / scale)
