"""Fit a structure: start values, local solver, the best of several starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Minimum, Outcome, Solution
from rotorid.fit.start import own_starts, start_values
from rotorid.typing import FloatArray

_SAME_COST = 1e-6
_SAME_PLACE = 1e-3


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a start far off has a cost that is no number
def fit(
    problem: FrequencyProblem,
    *,
    solver: LevenbergMarquardt | None = None,
    starts: Sequence[FloatArray] = (),
    count: int = 3,
) -> Solution:
    """Fit the free parameters of a problem.

    The structure's own start values are tried first, where they are any good, then those that the data give. A start
    that ends no lower than the best so far, and no higher, ends the search if the cost is acceptable. Of minima with
    one cost the first counts, so that the data do not swap two poles that the structure tells apart. Other minima that
    were met are kept in ``others`` of the solution.

    Parameters
    ----------
    problem
        Structure, data, points.
    solver
        Local solver; the default suits problems of some ten parameters.
    starts
        Start values of the free parameters, best first; by default those of :mod:`rotorid.fit.start`.
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
            f"{points} usable frequencies came", needed=f"more than {len(problem.parameters.free) // 2}"
        )
    acceptable = ACCEPTABLE_COST * np.count_nonzero(problem.used.any(axis=-1))
    found: list[Solution] = []
    for start in starts or _starts(problem, count):
        solution = solver.minimize(problem.residuals, start, *problem.box)
        if not np.isfinite(solution.cost):
            continue
        lowest = min((one.cost for one in found), default=np.inf)
        found.append(solution)
        again = solution.outcome is Outcome.CONVERGED and _one_cost(solution.cost, lowest)
        if again and solution.cost <= acceptable:
            break
    if not found:
        raise InsufficientDataError(
            f"{problem.structure.name} has no response at any start",
            needed="parameters with which it has one at every used frequency",
            remedy="give other start values",
        )
    lowest = min(one.cost for one in found)
    best = next(one for one in found if _one_cost(one.cost, lowest))
    others = _others(best, found)
    return replace(best, others=others) if others else best


def _starts(problem: FrequencyProblem, count: int) -> Iterator[FloatArray]:
    yield from own_starts(problem)
    # These take longer to find, and are looked for only when they are needed.
    yield from start_values(problem, count=count)


def _one_cost(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME_COST * (1.0 + min(one, other))


def _one_place(one: Solution, other: Solution) -> bool:
    """Whether two searches ended in one place, as far as the residuals can tell."""
    moved = float(np.sum((one.jacobian @ (one.theta - other.theta)) ** 2))
    return _one_cost(one.cost, other.cost) and moved <= _SAME_PLACE**2 * (1.0 + one.cost)


def _others(best: Solution, found: Sequence[Solution]) -> tuple[Minimum, ...]:
    """Minima other than the best, each once, best first."""
    kept = [best]
    for solution in sorted(found, key=lambda one: one.cost):
        if solution.outcome is Outcome.CONVERGED and not any(_one_place(one, solution) for one in kept):
            kept.append(solution)
    return tuple(Minimum(one.cost, one.theta) for one in kept[1:])
