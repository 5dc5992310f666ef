"""Fit a structure: start values, local solver, the best of several starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.minima import best_of, same_cost
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.fit.start import own_starts, start_values
from rotorid.typing import FloatArray


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
        again = solution.outcome is Outcome.CONVERGED and same_cost(solution.cost, lowest)
        if again and solution.cost <= acceptable:
            break
    return best_of(found, name=problem.structure.name)


def _starts(problem: FrequencyProblem, count: int) -> Iterator[FloatArray]:
    yield from own_starts(problem)
    # These take longer to find, and are looked for only when they are needed.
    yield from start_values(problem, count=count)
