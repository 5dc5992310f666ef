"""From measured responses to a fitted model with bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import RATE_AXES
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.feedback import feedback_bias
from rotorid.pipeline.judge import judge_band, judge_fit, judge_parameters
from rotorid.pipeline.measure import Measured
from rotorid.pipeline.resolve import chosen_parameters
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.support import require_known_gain, require_support
from rotorid.reduce.elimination import fit_and_drop
from rotorid.uncertainty.bounds import Bounds, bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A model with what is known about it.

    Parameters
    ----------
    problem
        What was fitted, without the parameters that were dropped.
    solution
        How the solver ended.
    parameters
        The identified values.
    bounds
        Their uncertainty.
    findings
        Remarks on data, fit and parameters.
    """

    problem: FrequencyProblem
    solution: Solution
    parameters: ParameterSet
    bounds: Bounds
    findings: tuple[Finding, ...]

    @property
    def structure(self) -> LinearStructure:
        return self.problem.structure

    @property
    def system(self) -> StateSpace:
        """The identified system as numbers."""
        return self.structure.matrices(self.parameters.values)

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """Lowest and highest fitted frequency."""
        return fitted_band(self.problem)


def fitted_band(problem: FrequencyProblem) -> tuple[float, float]:
    """Lowest and highest fitted frequency of a problem that has points."""
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    return float(omega[0]), float(omega[-1])


def pose(structure: LinearStructure, measured: Measured, settings: IdentifySettings) -> FrequencyProblem:
    """The problem of fitting a structure to the trusted points of measured responses.

    Raises
    ------
    InsufficientDataError
        There are no such points, or they end below what the model needs.
    """
    data = measured.response
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = measured.trusted_points(data, limit)
    require_support(measured, used, least_coherence=limit, rate_model=structure.name in RATE_AXES)
    return FrequencyProblem(
        structure=structure, parameters=chosen_parameters(structure, settings), data=data, used=used
    )


def fit_with_bounds(problem: FrequencyProblem, measured: Measured) -> Fitted:
    """Fit, drop what the data do not show, bound the rest, and remark on all of it.

    Raises
    ------
    InsufficientDataError
        Not even the sign of the gain is certain.
    """
    reduced = fit_and_drop(problem)
    problem, solution = reduced.problem, reduced.solution
    parameters = problem.parameters.unpack(solution.theta)
    limits = bounds(problem, solution)
    require_known_gain(problem.structure.gain, parameters, limits)
    costs = problem.costs(solution.theta)
    mean_cost = float(np.mean(costs[problem.used.any(axis=-1)]))
    findings = (
        *judge_band(measured, problem.used),
        *feedback_bias(measured, problem.used),
        *reduced.findings,
        *judge_parameters(parameters, limits),
        *judge_fit(problem, solution, mean_cost),
    )
    return Fitted(problem=problem, solution=solution, parameters=parameters, bounds=limits, findings=findings)
