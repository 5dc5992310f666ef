"""Fit a structure: start values, local solver, the best of several starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.fit.start import start_values
from rotorid.typing import FloatArray


def fit(
    problem: FrequencyProblem,
    *,
    solver: LevenbergMarquardt | None = None,
    starts: Sequence[FloatArray] = (),
) -> Solution:
    """Fit the free parameters of a problem.

    Parameters
    ----------
    problem
        Structure, data, points.
    solver
        Local solver; the default suits problems of some ten parameters.
    starts
        Start values of the free parameters; by default the best three of a coarse grid.

    Raises
    ------
    InsufficientDataError
        There are fewer points than parameters.
    """
    solver = solver or LevenbergMarquardt()
    points = int(np.count_nonzero(problem.used))
    if 2 * points <= len(problem.parameters.free):
        raise InsufficientDataError(
            f"{points} usable frequencies came", needed=f"more than {len(problem.parameters.free) // 2}"
        )
    lower = np.array([problem.parameters[name].lower for name in problem.parameters.free])
    upper = np.array([problem.parameters[name].upper for name in problem.parameters.free])
    candidates = starts or start_values(problem)
    solutions = [solver.minimize(problem.residuals, start, lower, upper) for start in candidates]
    return min(solutions, key=lambda solution: solution.cost)
