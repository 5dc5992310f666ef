"""The fit of a structure to an expected response, as an identification goes about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.design.choices import FitChoices
from rotorid.design.planned import Planned
from rotorid.fit.covariance_fit import refine
from rotorid.fit.identify import fit
from rotorid.fit.problem import FrequencyProblem, usable_points
from rotorid.fit.solution import Solution
from rotorid.fit.structural_zeros import without_structural_zeros
from rotorid.typing import Axis, BoolArray
from rotorid.uncertainty.bounds import Weights

_LARGEST_RISE = 2.0
"""An identification keeps an optional parameter when the mean cost without it rises by more than this."""

_HALF_LINE = 1.5
"""Half the width of a window's spectral line, in units of one over its length: it must lie below the end of a sweep."""


class ExpectedFit(NamedTuple):
    """Where a fit to the expected response ends.

    Parameters
    ----------
    problem
        Without the parameters that were dropped.
    solution
        The end, with the weights below.
    weights
        CIFER's, or those of the covariance of all errors.
    dropped
        Parameters that an identification would leave out.
    """

    problem: FrequencyProblem
    solution: Solution
    weights: Weights
    dropped: tuple[str, ...]


def expected_fit(problem: FrequencyProblem, choices: FitChoices) -> ExpectedFit:
    """Fit from the parameters of a problem, which are those that are expected.

    Parameters
    ----------
    problem
        Structure, expected parameters, expected response and its usable points.
    choices
        How the flight will be identified.
    """
    problem = without_structural_zeros(problem)[0]
    problem, solution, dropped = _reduced(problem)
    weights = _weights(problem, choices)
    return ExpectedFit(
        problem=problem,
        solution=refine(problem, solution) if weights == "covariance" else solution,
        weights=weights,
        dropped=dropped,
    )


def usable(
    response: FrequencyResponse,
    planned: Planned,
    axes: Sequence[Axis],
    band_rad_s: tuple[float, float],
    choices: FitChoices,
) -> BoolArray:
    """Points that an identification would trust, shape ``(y, u, f)``.

    Parameters
    ----------
    response
        The expected one.
    planned, axes
        What is flown, and the axes of the inputs.
    band_rad_s, choices
        The band to look at, and how the flight will be identified.
    """
    line = _HALF_LINE * 2.0 * np.pi / min(response.windows_s)
    tops = [min(band_rad_s[1], planned.excited_to_rad_s(axis) - line) for axis in axes]
    each = [
        usable_points(response, coherence=choices.least_coherence, band_rad_s=(band_rad_s[0], top))[:, u]
        for u, top in enumerate(tops)
    ]
    return np.stack(each, axis=1)


def _reduced(problem: FrequencyProblem) -> tuple[FrequencyProblem, Solution, tuple[str, ...]]:
    """The fit from the values that were given, without parameters that it would drop, and their names."""
    solution = fit(problem, starts=[problem.parameters.pack()])
    responses = np.count_nonzero(problem.used.any(axis=-1))
    dropped: list[str] = []
    optional = [name for name in problem.structure.optional if name in problem.parameters.free]
    for name in (*optional, *(name for name in problem.parameters.free if name not in optional)):
        parameter = problem.parameters[name]
        value = float(solution.theta[problem.parameters.free.index(name)])
        at_zero = value == 0.0 and value in (parameter.lower, parameter.upper)
        may_go = name in optional and parameter.lower <= 0.0 <= parameter.upper
        if not (at_zero or may_go):
            continue
        left = problem.parameters.unpack(solution.theta).drop(name)
        smaller = problem.with_parameters(left)
        trial = fit(smaller, starts=[left.pack()])
        if at_zero or trial.cost - solution.cost <= _LARGEST_RISE * responses:
            problem, solution = smaller, trial
            dropped.append(name)
    return problem, solution, tuple(dropped)


def _weights(problem: FrequencyProblem, choices: FitChoices) -> Weights:
    if choices.weights != "auto":
        return choices.weights
    return "covariance" if np.count_nonzero(problem.used.any(axis=(1, 2))) > 1 else "cifer"
