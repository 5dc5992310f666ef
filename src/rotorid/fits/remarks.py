"""Findings on a fit: its parameters, costs, structure and band."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import beyond, milliseconds, minus, percent
from rotorid.data.record import AXES
from rotorid.data.trust import (
    ACCEPTABLE_COST,
    CRAMER_RAO_GUIDELINE_PERCENT,
    EXCELLENT_COST,
    FITTED_SHARE,
    INSENSITIVITY_GUIDELINE_PERCENT,
    LARGEST_RANDOM_ERROR,
    MEANINGLESS_STRUCTURE_ERROR,
)
from rotorid.errors import ModelError
from rotorid.fits.data_requirements import main_pairs
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_names, random_costs
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.flights.measure import Measured
from rotorid.models.families import family_of
from rotorid.models.library import MOTOR_LAG, library_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.identifiability import Combination
from rotorid.uncertainty.model_error import LARGEST_MODEL_ERROR, Evidence, as_normal, model_error_evidence

_INPUT_DELAYS = tuple(f"tau_{axis}" for axis in AXES)

_KNOWN = 0.25
"""Lag and delay count as separated where each is known to a quarter of itself, and ..."""

_LARGEST_CORRELATION = 0.95
"""... their estimates are correlated by no more than this."""

NO_BOUND = 1e9
"""Stands for an infinite deviation in JSON."""


def judge_parameters(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Parameters above CIFER's guidelines, and lag and delay that the data barely separate."""
    findings = []
    for name, cramer_rao, insensitivity in zip(bounds.names, bounds.cramer_rao, bounds.insensitivity, strict=True):
        value = abs(parameters[name].value)
        if value == 0.0:
            continue
        percents, error = (100.0 * cramer_rao / value, 100.0 * insensitivity / value), _error_words(bounds, name, value)
        guidelines = (CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT)
        shown = [f"{beyond(found, limit)} %" for found, limit in zip(percents, guidelines, strict=True)]
        if percents[1] > INSENSITIVITY_GUIDELINE_PERCENT:
            findings.append(
                warn(
                    "insensitive_parameter",
                    name,
                    f"The data barely constrain {name}{error}: its insensitivity is {shown[1]}, usual up to "
                    f"{INSENSITIVITY_GUIDELINE_PERCENT:g} %.",
                    insensitivity_percent=percents[1],
                )
            )
        elif percents[0] > CRAMER_RAO_GUIDELINE_PERCENT:
            findings.append(
                warn(
                    "uncertain_parameter",
                    name,
                    f"{name}{error} trades off against other parameters: its Cramér–Rao bound is {shown[0]}, usual "
                    f"up to {CRAMER_RAO_GUIDELINE_PERCENT:g} %.",
                    cramer_rao_percent=percents[0],
                )
            )
    return (*findings, *_lag_and_delay(parameters, bounds))


def _error_words(bounds: Bounds, name: str, value: float) -> str:
    """The error of a parameter, so that nobody takes another percent for it."""
    error = 100.0 * bounds.stds[name] / value
    return f" (error ± {percent(error)} %)" if math.isfinite(error) else ""


def _lag_and_delay(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Findings on whether the data separate motor lag and delay, with their sum."""
    delays = [name for name in bounds.names if name in _INPUT_DELAYS]
    if MOTOR_LAG not in bounds.names or not delays:
        return ()
    return tuple(_one_lag_and_delay(parameters, bounds, name) for name in delays)


def _one_lag_and_delay(parameters: ParameterSet, bounds: Bounds, delay: str) -> Finding:
    rows = [bounds.names.index(name) for name in (MOTOR_LAG, delay)]
    values = [parameters[name].value for name in (MOTOR_LAG, delay)]
    block = bounds.covariance[np.ix_(rows, rows)]
    lag_std, delay_std = (math.sqrt(block[row, row]) for row in range(2))
    together, std = sum(values), math.sqrt(max(float(block.sum()), 0.0))
    # Clocks blur each of them, and do not make one look like the other.
    random = bounds.random[np.ix_(rows, rows)]
    correlation = float(random[0, 1] / np.sqrt(random[0, 0] * random[1, 1]))
    known = lag_std <= _KNOWN * abs(values[0]) and delay_std <= _KNOWN * abs(values[1])
    separable = known and abs(correlation) <= _LARGEST_CORRELATION
    each = f"{milliseconds(values[0], lag_std)} ms and {milliseconds(values[1], delay_std)} ms"
    total = f"{milliseconds(together, std)} ms"
    correlated = minus(f"{correlation:.2f}")
    surer = ", more certain than either" if std < min(lag_std, delay_std) else ""
    trust = f" Trust their sum of {total}." if std < max(lag_std, delay_std) else ""
    message = (
        f"Motor lag and delay are {each}, correlated by {correlated}; their sum is {total}{surer}."
        if separable
        else f"Motor lag and delay can barely be separated: {each} with a correlation of {correlated}.{trust} A wider "
        f"band would separate them, or a lag from a bench or from measured motor speeds (--fix {MOTOR_LAG}=VALUE)."
    )
    return (remark if separable else warn)(
        "lag_plus_delay" if separable else "not_identifiable",
        f"{MOTOR_LAG}, {delay}",
        message,
        sum_s=together,
        std_s=std,
        correlation=correlation,
    )


def judge_assumed(structure: LinearStructure, given: Collection[str]) -> tuple[Finding, ...]:
    """A warning for each length of a rig that nobody gave: the gains of its rotors are torque over that length.

    Parameters
    ----------
    structure
        The model.
    given
        Names of parameters that the user gave.
    """
    lengths = family_of(structure).assumed
    if not lengths:
        return ()
    try:
        library = tuple(library_model(structure.name).parameters)
    except ModelError:
        # A model of one's own, with its own numbers.
        return ()
    return tuple(
        warn(
            "assumed_geometry",
            item.name,
            f"{item.name} = {item.value:g} {item.unit} was assumed; thrust gains and inertias depend on it. Measure "
            f"from pivot to rotor and give --fix {item.name}=VALUE.",
            assumed_m=item.value,
        )
        for item in structure.parameters
        if item.name in lengths and item.name not in given and item.status == "fixed" and item in library
    )


def judge_combinations(combinations: Sequence[Combination]) -> tuple[Finding, ...]:
    """A warning for each group of parameters that the data do not separate at all."""
    return tuple(
        warn(
            "not_identifiable",
            ", ".join(item.names or item.vector),
            item.words(),
            relative_std=min(item.relative_std, NO_BOUND),
        )
        for item in combinations
        if item.flat
    )


def judge_fit(problem: FrequencyProblem, solution: Solution, mean_cost: float) -> tuple[Finding, ...]:
    """How well the structure follows the data, and how the solver ended."""
    findings = []
    if mean_cost > EXCELLENT_COST:
        acceptable = mean_cost <= ACCEPTABLE_COST
        findings.append(
            (remark if acceptable else warn)(
                "poor_fit",
                problem.structure.name,
                f"The average cost is {mean_cost:.0f}: "
                + (
                    f"acceptable; below {EXCELLENT_COST:g} the model is practically indistinguishable from the flight."
                    if acceptable
                    else f"above the acceptable {ACCEPTABLE_COST:g}. Narrow the band, or use a model with the missing "
                    "dynamics."
                ),
                average_cost=mean_cost,
            )
        )
    for name, at_bound in zip(problem.parameters.free, solution.at_bound, strict=True):
        if at_bound:
            findings.append(
                warn(
                    "parameter_at_bound",
                    name,
                    f"{name} ended at a bound of the search, so its value is only a limit.",
                )
            )
    if solution.outcome is not Outcome.CONVERGED:
        findings.append(warn("not_converged", problem.structure.name, solution.outcome.value))
    return tuple(findings)


LARGEST_STRUCTURE_ERROR = 0.025
"""Relative model error of a main response above which the structure does not hold. Exact structures of simulated
vehicles, flown to amplitudes at which they bend, have up to 2.2 %."""

_CERTAIN = 2.0
"""Logarithm of the likelihood that a model error must gain: chance gives it to one of fifty exact structures."""

_NEAR_THE_END = 0.9
"""Of the largest model error that is looked for: beyond it the size is a limit."""

_MANY_TIMES = 6.0
"""Times the median cost, and ..."""

_COSTLY = 30.0
"""... cost, above both of which a response is named separately, unless ..."""

_BEYOND_CHANCE = 2.0
"""... its random errors alone cost half of that."""


def structure_evidence(problem: FrequencyProblem, limits: Bounds, theta: FloatArray) -> dict[str, Evidence]:
    """What residuals say of the model error of the main response to each input.

    Nothing of a response that shares the model error of another one.

    Parameters
    ----------
    theta
        The identified values of the free parameters.
    """
    errors = problem.stated_errors(theta, weights="covariance")
    if limits.model_error is None or errors is None:
        return {}
    names = np.array(pair_names(problem.data)).reshape(problem.used.shape[:2])
    main = [str(names[place]) for place in sorted(main_pairs(problem), key=lambda place: place[1])]
    residual, jacobian = problem.residuals(theta)
    normal = as_normal(residual, errors, problem.freedom)
    return model_error_evidence(limits.model_error, normal, jacobian, errors, main, asked=MEANINGLESS_STRUCTURE_ERROR)


def judge_structure(
    problem: FrequencyProblem, costs: FloatArray, limits: Bounds, evidence: Mapping[str, Evidence]
) -> tuple[Finding, ...]:
    """Where the structure does not hold, whatever its average cost is.

    The model error of the main response to an input, the one that is known best, is above 2.5 % and certain; or one
    response costs many times what the others do. A model error above 10 % that is not certain, and random errors that
    would hide one, are named as what they are.

    Parameters
    ----------
    evidence
        What residuals say of the model errors of the main responses, from :func:`structure_evidence`.
    """
    findings = []
    names = np.array(pair_names(problem.data)).reshape(costs.shape)
    found = limits.model_error
    for name, said in evidence.items():
        if found is not None and found.sizes[name] > LARGEST_STRUCTURE_ERROR and said.found > _CERTAIN:
            findings.append(_misses(name, found.deviations[name]))
        elif found is not None and found.sizes[name] > MEANINGLESS_STRUCTURE_ERROR:
            findings.append(
                warn(
                    "structure_error",
                    name,
                    f"The model may miss {name} by {100.0 * found.deviations[name]:.0f} % over frequency: its random "
                    "errors are too large to decide. Fly longer, with more excitation, or in calmer air.",
                    model_error_percent=100.0 * found.deviations[name],
                    log_likelihood=said.found,
                )
            )
        elif said.expected < _CERTAIN:
            findings.append(
                remark(
                    "structure_error",
                    name,
                    f"Not enough data to judge the structure by {name}: its random errors would hide a model error of "
                    f"{100.0 * MEANINGLESS_STRUCTURE_ERROR:.0f} %. Fly longer, with more excitation, or in calmer air.",
                    log_likelihood=said.expected,
                )
            )
    used = problem.used.any(axis=-1)
    typical = float(np.median(costs[used]))
    by_chance = _BEYOND_CHANCE * random_costs(problem.data.random_error, problem.weights)
    for y, u in np.argwhere(used & (costs > np.maximum(by_chance, max(_MANY_TIMES * typical, _COSTLY)))):
        findings.append(
            warn(
                "structure_error",
                str(names[y, u]),
                f"The model misses {names[y, u]} (cost {costs[y, u]:.0f}, half of the responses {typical:.0f} or "
                "less), so what it derives from this response may be far off.",
                cost=float(costs[y, u]),
                median_cost=typical,
            )
        )
    return tuple(findings)


def _misses(name: str, size: float) -> Finding:
    meaning = (
        "Its parameters follow the data but have no physical meaning; the true errors are probably larger."
        if size > MEANINGLESS_STRUCTURE_ERROR
        else "Dynamics are missing from the structure, so the true errors are probably larger than stated."
    )
    return warn(
        "structure_error",
        name,
        f"The model misses {name} by {100.0 * size:.{0 if size > MEANINGLESS_STRUCTURE_ERROR else 1}f} %"
        f"{' or more' if size > _NEAR_THE_END * LARGEST_MODEL_ERROR else ''} over frequency. {meaning}",
        model_error_percent=100.0 * size,
    )


_GIVEN_SHARE = 0.9
"""Share of the octaves of a band that was given for a response, below which a finding says how little was fitted."""


def _what_ends(measured: Measured, asked_to_rad_s: float, top: float) -> str:
    """Why the fitted band ends where it does."""
    if measured.excited_to_rad_s < asked_to_rad_s and top > 0.9 * measured.trusted_rad_s[1]:
        return f"the sweeps end at {measured.excited_to_rad_s:.3g} rad/s"
    return f"above, the coherence is too low or the error larger than {100.0 * LARGEST_RANDOM_ERROR:g} %"


def judge_band(
    measured: Measured, used: BoolArray, pairs: Mapping[str, tuple[float, float] | None]
) -> tuple[Finding, ...]:
    """How much of the band that was asked for could be used: of a response where one was given for it."""
    data = measured.response
    findings = []
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if not omega.size:
            continue
        given = pairs.get(f"{data.outputs[y]}/{data.inputs[u]}")
        low, high = given or measured.asked_rad_s
        if np.log(omega[-1] / omega[0]) < (_GIVEN_SHARE if given else FITTED_SHARE) * np.log(high / low):
            findings.append(
                warn(
                    "low_coherence",
                    f"{data.outputs[y]}/{data.inputs[u]}",
                    f"Only {omega[0]:.2g} to {omega[-1]:.3g} rad/s of the band {low:.2g} to {high:.3g} rad/s of "
                    f"{data.outputs[y]}/{data.inputs[u]} could be fitted; "
                    f"{_what_ends(measured, high, float(omega[-1]))}.",
                    low_rad_s=float(omega[0]),
                    high_rad_s=float(omega[-1]),
                )
            )
    return tuple(findings)
