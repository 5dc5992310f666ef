"""An objective of every problem that the package can fit by least squares."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from rotorid.fit.nonlinear_problem import NonlinearProblem
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.time_problem import TimeProblem
from rotorid.search.box import search_box
from rotorid.search.design_of_starts import Scale, StartBox
from rotorid.search.frequency_objective import FrequencyObjective
from rotorid.search.time_objective import TimeObjective

SearchableProblem: TypeAlias = FrequencyProblem | TimeProblem | NonlinearProblem

_ABOUT_START = 0.1
_LEAST_START = 1e-3


def objective_of(problem: SearchableProblem, *, box: StartBox | None = None) -> FrequencyObjective | TimeObjective:
    """What a search minimizes to fit a problem.

    Parameters
    ----------
    problem
        In the frequency domain or in time.
    box
        Where to search; by default :func:`rotorid.search.box.search_box` of the parameters. Initial states and shifts
        of a nonlinear problem are searched close to what was measured, and left to the local search otherwise.

    Returns
    -------
    FrequencyObjective or TimeObjective
        The same cost that the problem's own fit minimizes.
    """
    if isinstance(problem, FrequencyProblem):
        return FrequencyObjective(problem=problem, box=box or search_box(problem.parameters))
    if box is None:
        box = search_box(problem.parameters)
        if isinstance(problem, NonlinearProblem):
            box = _with_nuisances(box, problem)
    return TimeObjective(problem=problem, box=box)


def _with_nuisances(box: StartBox, problem: NonlinearProblem) -> StartBox:
    count = len(box.scales)
    about = problem.start[count:]
    reach = _ABOUT_START * np.maximum(np.abs(about), _LEAST_START)
    linear: tuple[Scale, ...] = tuple("linear" for _ in about)
    return StartBox(
        lower=np.concatenate([box.lower, about - reach]),
        upper=np.concatenate([box.upper, about + reach]),
        scales=box.scales + linear,
    )
