r"""A fit in the frequency domain: from measured responses to a model with bounds.

:func:`pose` chooses the points, and :func:`fit_with_bounds` fits, drops what the data do not show, and bounds the rest:
first in CIFER's cost, by which it is decided what is dropped, then with weights made of the covariance of all errors.
What cannot be fitted at all is refused before (:mod:`~rotorid.fits.data_requirements`), what does not hold
after (:mod:`~rotorid.fits.frequency.refusals`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import with_error
from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fits.bootstrapping import Bootstrap
from rotorid.fits.data_requirements import main_pairs, require_known_gain, require_support
from rotorid.fits.frequency.windows import measured_with_model
from rotorid.fits.remarks import NO_BOUND, judge_band, judge_fit, judge_parameters, judge_structure, structure_evidence
from rotorid.fits.searching import Searched, judge_minima, searched
from rotorid.fits.ties import judge_ties, with_rotor_share
from rotorid.fitting.frequency.fit import fit_frequency, refine, weights_of
from rotorid.fitting.frequency.problem import FrequencyProblem, only_pairs, within_bands
from rotorid.fitting.frequency.screening import (
    UnseenCoupling,
    is_coupling,
    without_silent_parameters,
    without_structural_zeros,
    without_unseen_couplings,
)
from rotorid.fitting.least_squares import Solution
from rotorid.flights.measure import Measured, feedback_bias
from rotorid.models.families import is_rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.reduction.guided import Step, fit_and_drop, reduce
from rotorid.results.summary import Cost, PairCost
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import chosen_parameters
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import (
    Bounds,
    Weights,
    bounds,
)
from rotorid.uncertainty.identifiability import unseen_combinations
from rotorid.uncertainty.ties import TieTest, tie_tests, with_dropped_delays, with_ties


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyFit:
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
    bootstrap
        Refits to noise drawn anew, where they were asked for.
    ties
        Tests of relations between its parameters.
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
    bootstrap: Bootstrap | None = None
    ties: tuple[TieTest, ...] = ()

    @property
    def listed(self) -> ParameterSet:
        """All parameters, those that were dropped among them."""
        return self.parameters

    @property
    def structure(self) -> LinearStructure:
        """Structure of the values, without states that a dropped lag has left without dynamics."""
        return self.problem.structure.condensed(self.parameters)

    @property
    def system(self) -> StateSpace:
        """The identified system as numbers."""
        return self.structure.matrices(self.parameters.values)

    @property
    def average_cost(self) -> float:
        """Mean cost of the responses that were fitted."""
        return float(np.mean(self.costs[self.problem.used.any(axis=-1)]))

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """Lowest and highest fitted frequency."""
        return fitted_band(self.problem)


def fitted_band(problem: FrequencyProblem) -> tuple[float, float]:
    """Lowest and highest fitted frequency of a problem that has points."""
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    return float(omega[0]), float(omega[-1])


def cost_of(problem: FrequencyProblem, costs: FloatArray) -> Cost:
    """The cost of each response that was fitted, and their mean."""
    pairs = {}
    for y, u in np.ndindex(problem.used.shape[:2]):
        omega = problem.data.omega_rad_s[problem.used[y, u]]
        if omega.size:
            name = f"{problem.data.outputs[y]}/{problem.data.inputs[u]}"
            band = (float(omega[0]), float(omega[-1]))
            pairs[name] = PairCost(value=float(costs[y, u]), band_rad_s=band, points=omega.size)
    return Cost(average=float(np.mean([pair.value for pair in pairs.values()])), pairs=pairs)


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
    require_support(
        measured,
        used,
        least_coherence=limit,
        rate_model=is_rate_model(structure),
        chosen=settings.band_rad_s is not None,
    )
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
) -> FrequencyFit:
    """Fit, drop parameters that the data do not show, bound the others, and add findings.

    The fit in CIFER's cost comes first, from the best of a search where one was asked for, and the reduction judges by
    it. Of several outputs the errors go together; then
    the fit goes on with weights made of their covariance, from which the values come. Where windows have added much to
    a response, it is measured anew with that model and fitted once more (:mod:`rotorid.fits.frequency.windows`).

    Raises
    ------
    InsufficientDataError
        Not even the sign of the gain is certain.
    """
    settings = settings or IdentifySettings()
    first = _fit(problem, measured, settings)
    if first.average_cost > ACCEPTABLE_COST:
        return first
    whole = replace(problem, used=first.problem.used)
    again = measured_with_model(whole, first.parameters, first.bounds, measured, settings)
    if again is None:
        return first
    once = replace(settings, search=None, evaluations=None, starts="default")
    return replace(_fit(_from_best_minimum(again, first.search), measured, once), search=first.search)


def _fit(problem: FrequencyProblem, measured: Measured, settings: IdentifySettings) -> FrequencyFit:
    """The fit of responses as they are."""
    problem, unseen = without_unseen_couplings(problem)
    problem, silent = without_silent_parameters(problem)
    library = problem.structure.parameters
    search = searched(problem, settings)
    reduced = fit_and_drop(_from_best_minimum(problem, search))
    problem, solution = reduced.problem, reduced.solution
    findings = (*map(_fixed_at_zero, unseen), *map(_not_flown, silent), *reduced.findings)
    steps: tuple[Step, ...] = ()
    if settings.reduce:
        reduction = reduce(problem, solution, distances=_distances(problem, solution, settings))
        problem, solution, steps = reduction.problem, reduction.solution, reduction.steps
        findings = (*findings, *reduction.findings)
    ended = _determined(problem, solution, settings, library)
    problem, solution, final, weights, limits = ended.problem, ended.solution, ended.final, ended.weights, ended.limits
    findings = (*findings, *ended.findings)
    parameters = problem.parameters.unpack(final.theta)
    ties = tie_tests(problem, final, weights=weights)
    limits = with_dropped_delays(with_ties(limits, ties), problem, final, weights=weights)
    limits = with_rotor_share(parameters, limits, problem.structure.name)
    require_known_gain(problem.structure.gain, parameters, limits)
    costs = problem.costs(final.theta)
    mean_cost = float(np.mean(costs[problem.used.any(axis=-1)]))
    remarks = (
        *judge_band(measured, problem.used, settings.pairs),
        *feedback_bias(measured, problem.used),
        *findings,
        *judge_parameters(parameters, limits),
        *judge_fit(problem, replace(solution, at_bound=final.at_bound), mean_cost),
        *judge_structure(problem, costs, limits, structure_evidence(problem, limits, final.theta)),
        *judge_minima(search, parameters, limits),
        *judge_ties(parameters, limits, ties),
    )
    return FrequencyFit(
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
        ties=ties,
    )


class _Determined(NamedTuple):
    """A fit all of whose parameters have a bound."""

    problem: FrequencyProblem
    solution: Solution
    final: Solution
    weights: Weights
    limits: Bounds
    findings: tuple[Finding, ...]


_UNBOUND = 10.0
"""Deviations over the value beyond which a parameter counts as one without a bound."""

_UNBOUND_COUPLING = 0.5
"""The same limit for a coupling, which is zero unless known better: beyond it its interval contains zero."""

_LOOP = 30.0
"""Deviation over that with all others known, beyond which parameters grow against each other. Both must be passed."""

_LARGEST_CHANGE = 1e3
"""Times from where it began, within which a parameter has stayed where it was."""


def _determined(
    problem: FrequencyProblem, solution: Solution, settings: IdentifySettings, library: ParameterSet
) -> _Determined:
    """The fit with its bounds, without what grows against other parameters with no bound.

    Parameters
    ----------
    problem, solution, settings
        What was fitted, and how.
    library
        As the parameters stand before any search: a coupling is zero there, and a flat direction stays near them.

    Raises
    ------
    InsufficientDataError
        A parameter without a bound cannot be left out.
    """
    findings: list[Finding] = []
    while True:
        weights = weights_of(problem, settings.weights)
        final = refine(problem, solution) if weights == "covariance" else solution
        limits = bounds(problem, final, weights=weights)
        loose = _without_bound(problem, final, limits, library)
        if not loose:
            return _Determined(problem, solution, final, weights, limits, tuple(findings))
        for name in loose:
            smaller = _without_parameter(problem, name)
            if smaller is not None:
                break
        else:
            raise _nothing_bounds(loose, problem.parameters.unpack(final.theta), limits)
        row = limits.names.index(name)
        findings.append(_unbound(name, float(final.theta[row]), float(limits.std[row])))
        problem, solution = smaller, fit_frequency(smaller)


def unbounded_parameters(parameters: ParameterSet, limits: Bounds, couplings: Collection[str] = ()) -> list[str]:
    """Parameters that grow against others with no bound, the least certain first.

    Parameters
    ----------
    parameters, limits
        What a fit found, and how certain it is.
    couplings
        Those that are zero unless known better.
    """
    size = np.array([abs(parameters[name].value) for name in limits.names])
    ratio = np.divide(limits.std, size, out=np.full(size.shape, np.inf), where=size > 0.0)
    largest = np.where([name in couplings for name in limits.names], _UNBOUND_COUPLING, _UNBOUND)
    loose = (ratio > largest) & (limits.cramer_rao > _LOOP * limits.insensitivity)
    return [limits.names[row] for row in np.argsort(-ratio, kind="stable").tolist() if loose[row]]


def _without_bound(problem: FrequencyProblem, final: Solution, limits: Bounds, library: ParameterSet) -> list[str]:
    """Parameters without a bound, the least certain first.

    A ratio or a product of which a structure shows no more, such as that of force and inertia, is no matter of the
    data: the response is known, and the parameters stay where they began. That is said with the answer.
    """
    parameters = problem.parameters.unpack(final.theta)
    loose = unbounded_parameters(
        parameters, limits, [parameter.name for parameter in library if is_coupling(parameter)]
    )
    if not loose:
        return []
    flat = {
        name
        for found in unseen_combinations(parameters, limits)
        if found.flat
        for name in found.names or [name for name, share in found.vector.items() if abs(share) > 0.1]
    }

    def stays(name: str) -> bool:
        size, began = abs(parameters[name].value), abs(library[name].value)
        return began / _LARGEST_CHANGE < size < began * _LARGEST_CHANGE

    return [name for name in loose if not (name in flat and stays(name))]


def _without_parameter(problem: FrequencyProblem, name: str) -> FrequencyProblem | None:
    """The problem without a parameter, where that leaves the main response to every input."""
    own = problem.parameters[name]
    if own.essential or not own.lower <= 0.0 <= own.upper:
        return None
    try:
        smaller = without_structural_zeros(problem.with_parameters(problem.parameters.drop(name)))[0]
    except ModelError:
        return None
    return smaller if all(smaller.used[place].any() for place in main_pairs(problem)) else None


def _nothing_bounds(names: Sequence[str], parameters: ParameterSet, limits: Bounds) -> InsufficientDataError:
    combination_words = " ".join(found.words() for found in unseen_combinations(parameters, limits) if found.flat)
    together = ", ".join(names)
    message = (
        combination_words or f"The responses do not determine {together}: other parameters compensate for any change."
    )
    return InsufficientDataError(
        f"not enough data for {together}. {message}",
        needed="responses that separate them from the other parameters",
        remedy="give some values with --fix NAME=VALUE, use a smaller model, or excite these dynamics",
        findings=[refusal("not_identifiable", together, message)],
    )


def _unbound(name: str, value: float, std: float) -> Finding:
    return warn(
        "dropped_parameter",
        name,
        f"{name} was dropped: at {with_error(value, std)} the data do not bound it, and other parameters grew to "
        "compensate it.",
        value=value,
        std=min(std, NO_BOUND),
    )


def _not_flown(name: str) -> Finding:
    return remark(
        "dropped_parameter",
        name,
        f"{name} was set to zero: nothing that was flown shows it. Excite its axis too, or give --fix {name}=VALUE.",
    )


def _fixed_at_zero(coupling: UnseenCoupling) -> Finding:
    would = coupling.shown_by
    shown = f"{' or '.join(would)} would, if coherent"
    return remark(
        "dropped_parameter",
        coupling.name,
        f"{coupling.name} was set to zero: no usable response shows it"
        + (f"; {shown}." if would else ", and no other response of these channels would."),
    )


def _from_best_minimum(problem: FrequencyProblem, search: Searched | None) -> FrequencyProblem:
    """The same problem at the best minimum of a search; its structure too, for later fits to parts of the data."""
    if search is None:
        return problem
    own, values = problem.structure.parameters, search.values(search.minima[0])
    known = {name: value for name, value in values.items() if own[name].status != "tied"}
    structure = replace(problem.structure, parameters=own.with_values(known))
    return replace(problem, structure=structure, parameters=problem.parameters.with_values(values))


def _distances(problem: FrequencyProblem, solution: Solution, settings: IdentifySettings) -> dict[str, float]:
    """How many standard deviations each parameter lies from zero, where errors are weighed by their covariance."""
    if weights_of(problem, settings.weights) == "cifer":
        return {}
    final = refine(problem, solution)
    limits = bounds(problem, final, weights="covariance", model_errors=False)
    return dict(zip(limits.names, map(float, np.abs(final.theta) / limits.std), strict=True))
