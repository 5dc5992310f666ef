"""From measured responses to a fitted model with bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.fit.covariance_fit import refine
from rotorid.fit.pairs import only_pairs, within_bands
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.fit.structural_zeros import without_structural_zeros
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import RATE_AXES
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.feedback import feedback_bias
from rotorid.pipeline.judge import judge_band, judge_fit, judge_parameters
from rotorid.pipeline.measure import Measured
from rotorid.pipeline.resolve import chosen_parameters
from rotorid.pipeline.searching import Searched, judge_minima, searched
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.support import require_known_gain, require_support
from rotorid.reduce.elimination import fit_and_drop
from rotorid.reduce.guided import reduce_guided
from rotorid.reduce.step import Step
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Bounds, Weights, bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A model with what is known about it.

    Parameters
    ----------
    problem
        What was fitted, without the parameters that were dropped.
    solution
        How the solver ended in CIFER's cost.
    final
        How it ended with the weights from which the values come.
    weights
        What the values come from: CIFER's cost, or weights of the measured covariance.
    costs
        CIFER's cost of each response at the identified values, shape ``(y, u)``.
    parameters
        The identified values.
    bounds
        Their uncertainty.
    steps
        How the model was reduced.
    findings
        Remarks on data, fit and parameters.
    search
        The search that the fit began at, if any.
    """

    problem: FrequencyProblem
    solution: Solution
    final: Solution
    weights: Weights
    costs: FloatArray
    parameters: ParameterSet
    bounds: Bounds
    steps: tuple[Step, ...]
    findings: tuple[Finding, ...]
    search: Searched | None = None

    @property
    def structure(self) -> LinearStructure:
        """What the values belong to, without states that a dropped lag has left without dynamics."""
        return self.problem.structure.condensed(self.parameters)

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

    Responses that the structure cannot have at all take no part.

    Raises
    ------
    InsufficientDataError
        There are no such points, or they end below what the model needs.
    """
    data = measured.response
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = measured.trusted_points(data, limit)
    if settings.pairs:
        used = only_pairs(used, data, settings.pairs)
        used = within_bands(used, data, {name: band for name, band in settings.pairs.items() if band is not None})
    require_support(measured, used, least_coherence=limit, rate_model=structure.name in RATE_AXES)
    problem = FrequencyProblem(
        structure=structure,
        parameters=chosen_parameters(structure, settings),
        data=data,
        used=used,
        pair_weights=settings.pair_weights,
    )
    return without_structural_zeros(problem)[0]


def fit_with_bounds(
    problem: FrequencyProblem,
    measured: Measured,
    settings: IdentifySettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Fitted:
    """Fit, drop what the data do not show, bound the rest, and remark on all of it.

    The fit in CIFER's cost comes first, from the best of a search where one was asked for, and the reduction judges by
    it. Of several outputs the errors go together; then
    the fit goes on with weights made of their covariance, from which the values come.

    Raises
    ------
    InsufficientDataError
        Not even the sign of the gain is certain.
    """
    settings = settings or IdentifySettings()
    search = searched(problem, settings, progress)
    reduced = fit_and_drop(_begun(problem, search))
    problem, solution, findings = reduced.problem, reduced.solution, reduced.findings
    steps: tuple[Step, ...] = ()
    if settings.reduce:
        reduction = reduce_guided(problem, solution, distances=_distances(problem, solution, settings))
        problem, solution, steps = reduction.problem, reduction.solution, reduction.steps
        findings = (*findings, *reduction.findings)
    weights = _weights(problem, settings)
    final = refine(problem, solution) if weights == "covariance" else solution
    parameters = problem.parameters.unpack(final.theta)
    limits = bounds(problem, final, weights=weights)
    require_known_gain(problem.structure.gain, parameters, limits)
    costs = problem.costs(final.theta)
    mean_cost = float(np.mean(costs[problem.used.any(axis=-1)]))
    remarks = (
        *judge_band(measured, problem.used),
        *feedback_bias(measured, problem.used),
        *findings,
        *judge_parameters(parameters, limits),
        *judge_fit(problem, replace(solution, at_bound=final.at_bound), mean_cost),
        *judge_minima(search, parameters, limits),
    )
    return Fitted(
        problem=problem,
        solution=solution,
        final=final,
        weights=weights,
        costs=costs,
        parameters=parameters,
        bounds=limits,
        steps=steps,
        findings=remarks,
        search=search,
    )


def _begun(problem: FrequencyProblem, search: Searched | None) -> FrequencyProblem:
    """The same problem at the best minimum of a search; its structure too, for later fits to parts of the data."""
    if search is None:
        return problem
    own, values = problem.structure.parameters, search.values(search.minima[0])
    known = {name: value for name, value in values.items() if own[name].status != "tied"}
    structure = replace(problem.structure, parameters=own.with_values(known))
    return replace(problem, structure=structure, parameters=problem.parameters.with_values(values))


def _distances(problem: FrequencyProblem, solution: Solution, settings: IdentifySettings) -> dict[str, float]:
    """How many standard deviations each parameter lies from zero, where errors are weighed by their covariance."""
    if _weights(problem, settings) == "cifer":
        return {}
    final = refine(problem, solution)
    limits = bounds(problem, final, weights="covariance")
    return dict(zip(limits.names, map(float, np.abs(final.theta) / limits.std), strict=True))


def _weights(problem: FrequencyProblem, settings: IdentifySettings) -> Weights:
    if settings.weights != "auto":
        return settings.weights
    several = int(problem.used.any(axis=(1, 2)).sum()) > 1
    return "covariance" if several else "cifer"
