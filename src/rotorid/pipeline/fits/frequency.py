r"""From measured responses to a fitted model with bounds.

What a careful engineer would remark on a fit.

Whether measured responses can support a model at all: the refusals, each with its reason.

Speed damping in two steps, as it is often done: X_u and Y_v first, from one response each, then the rest.

.. math:: \frac{\dot u}{\theta} = \frac{-s g}{s - X_u}, \qquad \frac{\dot v}{\phi} = \frac{s g}{s - Y_v}

Both leave out that a command pushes the vehicle sideways too (X_pitch, Y_roll). Where it does, the damping comes out
several times too small from slow responses and several times too large from fast ones, however good the data are. So
this is an option, and the remark says what it does and how well the first step fits at all.

Where the delay between a command and a sensor comes from.

.. math:: \tau_{y/u} = \tau_u + T_{motor} + \tau_y

The delay of the input holds what computation, transport and motor controllers need, the lag of the motors counts as a
delay of its time constant, which it is well below its corner, and the delay of the output is that of the sensor beyond
the others. What filters of the autopilot delay is in these numbers; where their settings are logged it is said how much
of the total they are. After *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via Closed-Loop
Flight Testing*, eq 21.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import AXES
from rotorid.data.trust import CERTAIN_SIGN, FITTED_SHARE, LARGEST_RANDOM_ERROR, LEAST_WIDTH, SMALL_ERROR
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency, refine, weights_of
from rotorid.fitting.frequency.problem import (
    ACCEPTABLE_COST,
    DB_PER_NEPER,
    DEG_PER_RAD,
    EXCELLENT_COST,
    FrequencyProblem,
    log_error,
    only_pairs,
    pair_names,
    within_bands,
)
from rotorid.fitting.frequency.screening import (
    LOWEST_TOP_RAD_S,
    SPEED_MODES,
    UnseenCoupling,
    above_speed_modes,
    is_coupling,
    without_structural_zeros,
    without_unseen_couplings,
)
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.models.library import MOTOR_LAG, RATE_AXES, speed_damping
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.fits.bootstrapping import Bootstrap
from rotorid.pipeline.fits.searching import Searched, judge_minima, searched
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.measure import Measured, feedback_bias, measure
from rotorid.pipeline.preparation.resolve import chosen_parameters
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.summary import Cost, DelayBudget, PairCost
from rotorid.reduction.guided import Step, fit_and_drop, reduce
from rotorid.typing import BoolArray, FloatArray
from rotorid.uncertainty.cramer_rao import (
    CRAMER_RAO_GUIDELINE_PERCENT,
    INSENSITIVITY_GUIDELINE_PERCENT,
    Bounds,
    Weights,
    bounds,
)
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.uncertainty.model_error import LARGEST_MODEL_ERROR
from rotorid.uncertainty.propagation import covariance_of_all

_INPUT_DELAYS = tuple(f"tau_{axis}" for axis in AXES)
_KNOWN = 0.25
"""Lag and delay count as told apart when each is known to a quarter of itself."""

_LARGEST_CORRELATION = 0.95
_NOTHING = 1e9


def judge_parameters(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Parameters above CIFER's guidelines, and lag and delay that the data hardly tell apart."""
    findings = []
    for name, cramer_rao, insensitivity in zip(bounds.names, bounds.cramer_rao, bounds.insensitivity, strict=True):
        value = abs(parameters[name].value)
        if value == 0.0:
            continue
        percents = (100.0 * cramer_rao / value, 100.0 * insensitivity / value)
        if percents[1] > INSENSITIVITY_GUIDELINE_PERCENT:
            findings.append(
                warn(
                    "insensitive_parameter",
                    name,
                    f"The response hardly depends on {name}: its insensitivity is {percents[1]:.0f} % "
                    f"(guideline {INSENSITIVITY_GUIDELINE_PERCENT:g} %).",
                    insensitivity_percent=percents[1],
                )
            )
        elif percents[0] > CRAMER_RAO_GUIDELINE_PERCENT:
            findings.append(
                warn(
                    "uncertain_parameter",
                    name,
                    f"{name} trades against other parameters: its Cramér–Rao bound is {percents[0]:.0f} % "
                    f"(guideline {CRAMER_RAO_GUIDELINE_PERCENT:g} %).",
                    cramer_rao_percent=percents[0],
                )
            )
    return (*findings, *_lag_and_delay(parameters, bounds))


def _lag_and_delay(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Whether the data tell motor lag and delay apart, and their sum, which they know better than either."""
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
    apart = known and abs(correlation) <= _LARGEST_CORRELATION
    each = f"{1e3 * values[0]:.1f} ± {1e3 * lag_std:.1f} ms and {1e3 * values[1]:.1f} ± {1e3 * delay_std:.1f} ms"
    total = f"{1e3 * together:.1f} ± {1e3 * std:.1f} ms"
    message = (
        f"Motor lag and delay are told apart, as {each} with a correlation of {correlation:.2f}; together they are "
        f"{total}, which is known better than either."
        if apart
        else f"Motor lag and delay are hardly told apart: {each} with a correlation of {correlation:.2f}. Trust their "
        f"sum of {total}. A wider band would separate them, or the lag from a bench or from measured motor speeds "
        f"(--fix {MOTOR_LAG}=VALUE)."
    )
    return (remark if apart else warn)(
        "lag_plus_delay" if apart else "not_identifiable",
        f"{MOTOR_LAG}, {delay}",
        message,
        sum_s=together,
        std_s=std,
        correlation=correlation,
    )


def judge_combinations(combinations: Sequence[Combination]) -> tuple[Finding, ...]:
    """A warning for each group of parameters that the data do not tell apart at all."""
    return tuple(
        warn(
            "not_identifiable",
            ", ".join(item.names or item.vector),
            item.words(),
            relative_std=min(item.relative_std, _NOTHING),
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
                    f"acceptable, but above the {EXCELLENT_COST:g} of a model hardly to be told from the flight."
                    if acceptable
                    else f"above the {ACCEPTABLE_COST:g} of an acceptable model. Narrow the band, or take a "
                    "structure with the missing dynamics."
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
                    f"{name} ended on a bound of the search; its value says no more than that.",
                )
            )
    if solution.outcome is not Outcome.CONVERGED:
        findings.append(warn("not_converged", problem.structure.name, solution.outcome.value))
    return tuple(findings)


LARGEST_STRUCTURE_ERROR = 0.1
_MANY_TIMES = 6.0
_COSTLY = 30.0


def judge_structure(problem: FrequencyProblem, costs: FloatArray, limits: Bounds) -> tuple[Finding, ...]:
    """Where the structure does not hold, whatever its average cost is.

    The model error of the main response to an input, the one that is known best, is above 10 %; or one response costs
    many times what the others do.
    """
    findings = []
    names = np.array(pair_names(problem.data)).reshape(costs.shape)
    sizes = limits.model_error.sizes if limits.model_error else {}
    for place in sorted(_main_pairs(problem), key=lambda place: place[1]):
        name = str(names[place])
        if sizes.get(name, 0.0) > LARGEST_STRUCTURE_ERROR:
            findings.append(
                warn(
                    "structure_error",
                    name,
                    f"The structure does not hold in {name}: over frequency it misses the response by "
                    f"{100.0 * sizes[name]:.0f} %. The values follow the data and are no physics; their intervals are "
                    "a lower limit.",
                    model_error_percent=100.0 * sizes[name],
                )
            )
    used = problem.used.any(axis=-1)
    typical = float(np.median(costs[used]))
    for y, u in np.argwhere(used & (costs > max(_MANY_TIMES * typical, _COSTLY))):
        findings.append(
            warn(
                "structure_error",
                str(names[y, u]),
                f"{names[y, u]} costs {costs[y, u]:.0f}, and half of the responses cost {typical:.0f} or less: the "
                "structure does not hold there, and what it knows from this response may be far off.",
                cost=float(costs[y, u]),
                median_cost=typical,
            )
        )
    return tuple(findings)


def _what_ends(measured: Measured, top: float) -> str:
    """Why the fitted band ends where it does."""
    if measured.excited_to_rad_s < measured.asked_rad_s[1] and top > 0.9 * measured.trusted_rad_s[1]:
        return f"the sweeps end at {measured.excited_to_rad_s:.3g} rad/s"
    return f"the rest is not coherent enough, or its error is above {100.0 * LARGEST_RANDOM_ERROR:g} %"


def judge_band(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How much of the band that was asked for could be used."""
    data = measured.response
    findings = []
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if not omega.size:
            continue
        share = np.log(omega[-1] / omega[0]) / np.log(measured.asked_rad_s[1] / measured.asked_rad_s[0])
        if share < FITTED_SHARE:
            low, high = measured.asked_rad_s
            findings.append(
                warn(
                    "low_coherence",
                    f"{data.outputs[y]}/{data.inputs[u]}",
                    f"Of the band {low:.2g} to {high:.3g} rad/s only {omega[0]:.2g} to {omega[-1]:.3g} rad/s could "
                    f"be fitted; {_what_ends(measured, float(omega[-1]))}.",
                    low_rad_s=float(omega[0]),
                    high_rad_s=float(omega[-1]),
                )
            )
    return tuple(findings)


def require_support(
    measured: Measured, used: BoolArray, *, least_coherence: float, rate_model: bool, chosen: bool = True
) -> None:
    """Refuse a fit where the data end below, or hold less than, what the model needs.

    Parameters
    ----------
    measured
        The responses.
    used
        Points that can be trusted, shape ``(y, u, f)``.
    least_coherence
        The limit by which they were chosen.
    rate_model
        Whether the model needs data above the speed modes.
    chosen
        Whether the user gave the band; else it ends where the log does.

    Raises
    ------
    UsageError
        The band that the user gave cannot do.
    InsufficientDataError
        The excitation or the coherence ends too early, or what is left is too narrow.
    """
    low, high = measured.asked_rad_s
    needed = max(low, LOWEST_TOP_RAD_S) if rate_model else low
    if measured.excited_to_rad_s < needed:
        raise _not_excited(measured, needed)
    if high < needed and not chosen:
        raise _logged_too_slowly(measured, high, needed)
    if high < needed:
        raise UsageError(
            f"the band {low:g}:{high:g} rad/s ends below the {needed:g} rad/s that a rate model needs",
            needed="a band above the speed modes of the airframe, such as 1:60",
            remedy="widen --band",
        )
    omega = measured.response.omega_rad_s[used.any(axis=(0, 1))]
    if omega.size == 0:
        raise _not_coherent(measured, least_coherence)
    if omega[-1] < needed or omega[-1] < LEAST_WIDTH * omega[0]:
        raise _too_narrow(measured, float(omega[0]), float(omega[-1]), needed)


def _name(measured: Measured) -> str:
    return f"{measured.response.outputs[0]}/{measured.response.inputs[0]}"


def _logged_too_slowly(measured: Measured, high: float, needed: float) -> InsufficientDataError:
    message = f"Logged at this rate {_name(measured)} can be measured up to {high:.3g} rad/s."
    return InsufficientDataError(
        f"{_name(measured)} can be measured up to {high:.3g} rad/s at the rate of this log",
        needed=f"at least {needed:g} rad/s, above the speed modes of the airframe",
        remedy="log rates and commands faster",
        findings=[refusal("rate_too_low", _name(measured), message)],
    )


def _not_excited(measured: Measured, needed: float) -> InsufficientDataError:
    name, top = _name(measured), measured.excited_to_rad_s
    rounded = f"{top:.0f}" if top >= 2.0 else f"{top:.2g}"
    return InsufficientDataError(
        f"no excitation above {rounded} rad/s came for {name}",
        needed=f"excitation that goes on to {needed:.3g} rad/s and more",
        remedy="fly a sweep that goes faster",
        findings=[
            refusal(
                "no_excitation",
                name,
                f"There is no excitation above {rounded} rad/s in {name}; what is coherent above is feedback and "
                "noise.",
                highest_rad_s=top,
                needed_rad_s=needed,
            )
        ],
    )


def _not_coherent(measured: Measured, least_coherence: float) -> InsufficientDataError:
    data, name = measured.response, _name(measured)
    low, high = measured.trusted_rad_s
    inside = (data.omega_rad_s >= low) & (data.omega_rad_s <= high)
    best = float(data.coherence[:, :, inside].max(initial=0.0))
    error = float(data.random_error[:, :, inside].min(initial=np.inf))
    reason = f"reaches a coherence of {best:.3f} and an error of {100.0 * error:.0f} % at best"
    return InsufficientDataError(
        f"{name} {reason} inside {low:.3g} to {high:.3g} rad/s",
        needed=f"points with a coherence of {least_coherence:g} and {SMALL_ERROR}",
        remedy="excite the axis harder or longer, fly in calmer air, or lower --coherence",
        findings=[
            refusal(
                "low_coherence",
                name,
                f"No point of {name} can be used: it {reason}.",
                best_coherence=best,
                limit=least_coherence,
                least_error=min(error, 1e9),
            )
        ],
    )


def _too_narrow(measured: Measured, low: float, high: float, needed: float) -> InsufficientDataError:
    name = _name(measured)
    return InsufficientDataError(
        f"{name} can be used from {low:.3g} to {high:.3g} rad/s only",
        needed=f"at least an octave, and data up to {needed:.3g} rad/s and more",
        remedy="excite a wider band, or widen --band",
        findings=[
            refusal(
                "low_coherence",
                name,
                f"{name} is usable from {low:.3g} to {high:.3g} rad/s only; gain, damping and delay cannot be told "
                "apart in that.",
                low_rad_s=low,
                high_rad_s=high,
            )
        ],
    )


def require_known_gain(gain: str | None, parameters: ParameterSet, bounds: Bounds) -> None:
    """Refuse a model whose gain could as well have the other sign.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    if gain not in bounds.names:
        return
    value, std = parameters[gain].value, float(bounds.std[bounds.names.index(gain)])
    if abs(value) >= CERTAIN_SIGN * std:
        return
    found = f"{value:.2g} ± {std:.1g} {parameters[gain].unit}"
    raise InsufficientDataError(
        f"the data do not show {gain}: {found}",
        needed="a gain that differs from zero by two standard deviations",
        remedy="give longer segments or a wider band, or excite the axis harder",
        findings=[
            refusal(
                "not_identifiable",
                gain,
                f"Not even the sign of {gain} is certain: the fit gives {found}.",
                value=value,
                std=std,
            )
        ],
    )


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

    @property
    def listed(self) -> ParameterSet:
        """All parameters, those that were dropped among them."""
        return self.parameters

    @property
    def structure(self) -> LinearStructure:
        """What the values belong to, without states that a dropped lag has left without dynamics."""
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
        rate_model=structure.name in RATE_AXES,
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
    problem, unseen = without_unseen_couplings(problem)
    search = searched(problem, settings)
    reduced = fit_and_drop(_begun(problem, search))
    problem, solution = reduced.problem, reduced.solution
    findings = (*(_held_at_zero(coupling) for coupling in unseen), *reduced.findings)
    steps: tuple[Step, ...] = ()
    if settings.reduce:
        reduction = reduce(problem, solution, distances=_distances(problem, solution, settings))
        problem, solution, steps = reduction.problem, reduction.solution, reduction.steps
        findings = (*findings, *reduction.findings)
    ended = _determined(problem, solution, settings)
    problem, solution, final, weights, limits = ended.problem, ended.solution, ended.final, ended.weights, ended.limits
    findings = (*findings, *ended.findings)
    parameters = problem.parameters.unpack(final.theta)
    require_known_gain(problem.structure.gain, parameters, limits)
    costs = problem.costs(final.theta)
    mean_cost = float(np.mean(costs[problem.used.any(axis=-1)]))
    remarks = (
        *judge_band(measured, problem.used),
        *feedback_bias(measured, problem.used),
        *findings,
        *judge_parameters(parameters, limits),
        *judge_fit(problem, replace(solution, at_bound=final.at_bound), mean_cost),
        *judge_structure(problem, costs, limits),
        *judge_minima(search, parameters, limits),
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
    )


class _Determined(NamedTuple):
    """A fit all of whose parameters have a bound."""

    problem: FrequencyProblem
    solution: Solution
    final: Solution
    weights: Weights
    limits: Bounds
    findings: tuple[Finding, ...]


_UNBOUND, _UNBOUND_COUPLING = 10.0, 0.5
_LOOP = 30.0
"""A direction has no bound where a parameter is ten times less certain than it is large, and thirty times less than it
would be with the others known: they grow against each other. A coupling, which is zero unless known better, has none
where its interval holds zero."""

_GROWN = 1e3
"""Times from where it began, within which a parameter has stayed where it was."""


def _determined(problem: FrequencyProblem, solution: Solution, settings: IdentifySettings) -> _Determined:
    """The fit with its bounds, without what grows against other parameters with no bound.

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
        loose = _without_bound(problem, final, limits)
        if not loose:
            return _Determined(problem, solution, final, weights, limits, tuple(findings))
        for name in loose:
            smaller = _smaller(problem, name)
            if smaller is not None:
                break
        else:
            raise _nothing_bounds(loose, problem.parameters.unpack(final.theta), limits)
        row = limits.names.index(name)
        findings.append(_unbound(name, float(final.theta[row]), float(limits.std[row])))
        problem, solution = smaller, fit_frequency(smaller)


def grown(parameters: ParameterSet, limits: Bounds, couplings: Collection[str] = ()) -> list[str]:
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


def _without_bound(problem: FrequencyProblem, final: Solution, limits: Bounds) -> list[str]:
    """Parameters without a bound, the least certain first.

    A ratio or a product of which a structure shows no more, such as that of force and inertia, is no matter of the
    data: the response is known, and the parameters stay where they began. That is said with the answer.
    """
    parameters = problem.parameters.unpack(final.theta)
    loose = grown(parameters, limits, [one.name for one in problem.structure.parameters if is_coupling(one)])
    if not loose:
        return []
    flat = {
        name
        for found in unseen_combinations(parameters, limits)
        if found.flat
        for name in found.names or [name for name, share in found.vector.items() if abs(share) > 0.1]
    }

    def stays(name: str) -> bool:
        size, began = abs(parameters[name].value), abs(problem.structure.parameters[name].value)
        return began / _GROWN < size < began * _GROWN

    return [name for name in loose if not (name in flat and stays(name))]


def _smaller(problem: FrequencyProblem, name: str) -> FrequencyProblem | None:
    """The problem without a parameter, where that leaves the main response to every input."""
    own = problem.parameters[name]
    if own.essential or not own.lower <= 0.0 <= own.upper:
        return None
    try:
        smaller = without_structural_zeros(problem.with_parameters(problem.parameters.drop(name)))[0]
    except ModelError:
        return None
    return smaller if all(smaller.used[place].any() for place in _main_pairs(problem)) else None


def _nothing_bounds(names: Sequence[str], parameters: ParameterSet, limits: Bounds) -> InsufficientDataError:
    told = " ".join(found.words() for found in unseen_combinations(parameters, limits) if found.flat)
    together = ", ".join(names)
    message = told or f"The responses do not determine {together}: other parameters take over whatever they do."
    return InsufficientDataError(
        f"nothing bounds {together}. {message}",
        needed="responses that tell them apart from the other parameters",
        remedy="give some values with --fix NAME=VALUE, take a smaller model, or excite what shows them",
        findings=[refusal("not_identifiable", together, message)],
    )


def _unbound(name: str, value: float, std: float) -> Finding:
    return warn(
        "dropped_parameter",
        name,
        f"{name} was left out: at {value:.2g} ± {std:.1g} nothing bounds it, and other parameters grew against it.",
        value=value,
        std=min(std, _NOTHING),
    )


def _held_at_zero(coupling: UnseenCoupling) -> Finding:
    would = coupling.shown_by
    shown = f"{' or '.join(would)} would, where {'it is' if len(would) == 1 else 'they are'} coherent"
    return remark(
        "dropped_parameter",
        coupling.name,
        f"{coupling.name} is held at zero: no response that could be used shows it"
        + (f"; {shown}." if would else ", and no other response of these channels would."),
    )


WORST_PAIR_COST = 150.0
LONGEST_SPIN_UP_S = 1.0
"""Angular momentum of a rotor over twice its torque is 0.05 to 0.3 s; a second is none."""

LARGEST_DEVIATION_DB, LARGEST_DEVIATION_DEG = 2.0, 15.0
_LEFT_OUT_SHARE = 1.0 / 3.0
"""Of the responses at most: where more are not described, the structure does not hold at all. What one input does
beside its own axis may go whole: in wind a vehicle that yaws is pushed in ways that no model of hover has."""


def fit_sound(problem: FrequencyProblem, measured: Measured, settings: IdentifySettings) -> FrequencyFit:
    """Fit as :func:`fit_with_bounds` does, leave out what the structure cannot follow, and refuse what does not hold.

    A response that costs more than 150 and is off by more than 2 dB or 15°, as root mean squares, is left out with a
    finding, unless it is the main response to its input or they are more than a third, of several inputs. What is left
    must have converged, with an average cost of at most 100 and no pole that a sample could not show. A rate model that
    does not hold in a band that nobody chose is fitted above the speed modes of the airframe, which it has no place
    for, if it holds there.

    Raises
    ------
    InsufficientDataError
        The model does not describe what it was fitted to; its findings say why.
    """
    fitted, reasons = _with_reasons(problem, measured, settings)
    if not reasons:
        return fitted
    if problem.structure.name in SPEED_MODES and settings.band_rad_s is None:

        def tried(part: FrequencyProblem) -> tuple[FrequencyFit, float]:
            found, against = _with_reasons(part, measured, settings)
            return found, math.inf if against else found.average_cost

        above = above_speed_modes(problem, tried)
        if above is not None:
            return _without_speed_modes(above, fitted)
    name = problem.structure.name
    raise InsufficientDataError(
        f"{name} does not describe these flights: " + " ".join(reason.message for reason in reasons),
        needed="a model that follows the responses it is fitted to",
        remedy="take a structure with the missing dynamics, narrow --band, or choose responses with --pair",
        findings=reasons,
    )


def _with_reasons(
    problem: FrequencyProblem, measured: Measured, settings: IdentifySettings
) -> tuple[FrequencyFit, list[Finding]]:
    """The fit without responses that the structure cannot follow, and what speaks against it all the same.

    What is left out is decided with all parameters: a model that was reduced to follow such a response follows none.
    """
    whole = replace(settings, reduce=False)
    fitted = fit_with_bounds(problem, measured, whole)
    main, left_out = _main_pairs(problem), dict[tuple[int, int], Finding]()
    may_go = int(np.count_nonzero(problem.used.any(axis=-1)) * _LEFT_OUT_SHARE)
    while beside := {place: finding for place, finding in _poor_pairs(fitted).items() if place not in main}:
        gone = left_out | beside
        if len(gone) > may_go and len({u for _, u in gone}) > 1:
            break
        used = np.array(problem.used)
        for place in beside:
            used[place] = False
        smaller = replace(problem, used=used)
        try:
            fitted = fit_with_bounds(smaller, measured, whole)
        except InsufficientDataError:
            # Without them nothing shows some parameters: what is not described is what they were needed for.
            break
        problem, left_out = smaller, gone
    if settings.reduce:
        fitted = fit_with_bounds(problem, measured, settings)
    said = (replace(finding, message=f"{finding.message} It was left out.") for finding in left_out.values())
    fitted = replace(fitted, findings=(*said, *fitted.findings))
    poor = _poor_pairs(fitted)
    return fitted, [replace(finding, severity="error") for finding in poor.values()] + _unsound(fitted)


def _without_speed_modes(above: FrequencyFit, whole: FrequencyFit) -> FrequencyFit:
    name = above.problem.structure.name
    cost, before, low = above.average_cost, whole.average_cost, above.band_rad_s[0]
    said = warn(
        "speed_modes_left_out",
        name,
        f"Below {low:.2g} rad/s the vehicle's own speed turns it too, which {name} has no place for: with all that was "
        f"measured it costs {before:.0f}, from there on {cost:.0f}. That part alone was fitted. An axis or hover model "
        "describes both.",
        low_rad_s=low,
        average_cost=cost,
        whole_cost=before,
    )
    return replace(above, findings=(said, *above.findings))


def _main_pairs(problem: FrequencyProblem) -> set[tuple[int, int]]:
    """The response to each input that it is there for: of a vehicle's axis its own rate, else what is known best.

    Known best is what has the most points over their squared errors. In wind that may be a coupling, such as the side
    force of a vehicle that yaws.
    """
    own = {axis.input: axis.output for axis in RATE_AXES.values()}
    data = problem.data
    error = np.where(problem.used, data.random_error, np.inf)
    weight = np.sum(1.0 / np.maximum(error, 1e-3) ** 2, axis=-1)
    for u, name in enumerate(data.inputs):
        if own.get(name) in data.outputs:
            row = data.outputs.index(own[name])
            weight[row, u] = np.inf if weight[row, u] > 0.0 else 0.0
    return {(int(np.argmax(weight[:, u])), u) for u in range(weight.shape[1]) if weight[:, u].any()}


def _poor_pairs(fitted: FrequencyFit) -> dict[tuple[int, int], Finding]:
    """Responses that the model does not describe, with a warning each."""
    problem, costs = fitted.problem, fitted.costs
    values = problem.parameters.unpack(fitted.final.theta).values
    model = problem.structure.response(values, problem.data.omega_rad_s)
    names = np.array(pair_names(problem.data)).reshape(costs.shape)
    poor = {}
    for y, u in np.argwhere((costs > WORST_PAIR_COST) & problem.used.any(axis=-1)).tolist():
        used = problem.used[y, u]
        error = log_error(model[y, u, used], problem.data.values[y, u, used])
        off_db = DB_PER_NEPER * float(np.sqrt(np.mean(error.real**2)))
        off_deg = DEG_PER_RAD * float(np.sqrt(np.mean(error.imag**2)))
        if off_db > LARGEST_DEVIATION_DB or off_deg > LARGEST_DEVIATION_DEG:
            poor[y, u] = warn(
                "structure_error",
                str(names[y, u]),
                f"The model does not describe {names[y, u]}, which costs {costs[y, u]:.0f}: it is off by "
                f"{off_db:.1f} dB and {off_deg:.0f}°.",
                cost=float(costs[y, u]),
                off_db=off_db,
                off_deg=off_deg,
            )
    return poor


def _unsound(fitted: FrequencyFit) -> list[Finding]:
    problem, name = fitted.problem, fitted.problem.structure.name
    reasons = []
    if fitted.solution.outcome is not Outcome.CONVERGED:
        reasons.append(refusal("not_converged", name, f"The fit did not converge: {fitted.solution.outcome.value}"))
    reasons += faster_than_sampled(name, fitted.system, problem.data.sample_rate_hz)
    reasons += _led_by_feedback(fitted)
    reasons += _endless_spin_up(fitted)
    reasons += _pushed_on_by_speed(fitted)
    if fitted.average_cost > ACCEPTABLE_COST:
        message = (
            f"The average cost is {fitted.average_cost:.0f}, above the {ACCEPTABLE_COST:g} of an acceptable model."
        )
        reasons.append(refusal("poor_fit", name, message, average_cost=fitted.average_cost))
    return reasons


def faster_than_sampled(name: str, system: StateSpace, sample_rate_hz: float | None) -> Iterator[Finding]:
    """A pole that no sample shows: a lag that is not there, such as the second one of what is of first order."""
    fastest = float(np.abs(system.poles()).max(initial=0.0))
    if sample_rate_hz is not None and fastest > 2.0 * np.pi * sample_rate_hz:
        message = f"The model has a pole at {fastest:.3g} rad/s, beyond the sample rate of {sample_rate_hz:.3g} Hz."
        yield refusal("impossible_physics", name, message, pole_rad_s=fastest, sample_rate_hz=sample_rate_hz)


_NO_MODEL = 0.99
"""Of the largest model error, where the search for it ended at its limit."""


def _led_by_feedback(fitted: FrequencyFit) -> Iterator[Finding]:
    """A direct estimate whose model error is as large as any may be: part of it is the controller, not the vehicle."""
    problem, found = fitted.problem, fitted.bounds.model_error
    if problem.data.estimate != "direct" or found is None:
        return
    names = np.array(pair_names(problem.data)).reshape(problem.used.shape[:2])
    for name in (str(names[place]) for place in _main_pairs(problem)):
        share = found.sizes.get(name, 0.0)
        if share >= _NO_MODEL * LARGEST_MODEL_ERROR:
            message = (
                f"The structure misses {name}, estimated without an instrument, by {100.0 * share:.0f} % or more: in "
                "closed loop such a response lies between the vehicle and the inverse of its controller."
            )
            yield refusal("structure_error", name, message, model_error_percent=100.0 * share)


def _endless_spin_up(fitted: FrequencyFit) -> Iterator[Finding]:
    """A reaction to the spin-up of rotors that lasts longer than any rotor turns against its drag."""
    values = fitted.parameters.values
    if not values.get("N_spin") or not values.get("N_yaw"):
        return
    lead_s = values["N_spin"] / values["N_yaw"]
    if lead_s > LONGEST_SPIN_UP_S:
        yield refusal(
            "impossible_physics",
            "N_spin",
            f"N_spin is {lead_s:.2g} s of N_yaw, and no rotor reacts for longer than {LONGEST_SPIN_UP_S:g} s. A "
            "damping and a lag of the motors explain this response alike: leave it out with --fix N_spin=0.",
            lead_s=lead_s,
        )


def _pushed_on_by_speed(fitted: FrequencyFit) -> Iterator[Finding]:
    """Air slows a hovering vehicle: a force along its speed is what another axis did to this one."""
    if not fitted.problem.structure.name.startswith(("axis.", "hover.")):
        return
    deviations = dict(zip(fitted.bounds.names, fitted.bounds.std.tolist(), strict=True))
    for name in _STEPS:
        value, std = fitted.parameters.values.get(name, 0.0), deviations.get(name, math.inf)
        if value > CERTAIN_SIGN * std:
            yield refusal(
                "impossible_physics",
                name,
                f"{name} is {value:.2g} ± {std:.1g} 1/s: no air pushes a hovering vehicle along its own speed. What "
                "turns with it, or a speed that was not measured, has no place in this model: take a hover model, or "
                "hold the value with --fix.",
                value=value,
                std=std,
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
    if weights_of(problem, settings.weights) == "cifer":
        return {}
    final = refine(problem, solution)
    limits = bounds(problem, final, weights="covariance", model_errors=False)
    return dict(zip(limits.names, map(float, np.abs(final.theta) / limits.std), strict=True))


_STEPS = {"X_u": ("u_dot", "theta", "pitch"), "Y_v": ("v_dot", "phi", "roll")}
_NEGLECTED = {"X_u": "X_pitch", "Y_v": "Y_roll"}


@dataclass(frozen=True, kw_only=True)
class FirstStep:
    """What the first step found: parameters to hold, with the remark on each."""

    fix: dict[str, float]
    findings: tuple[Finding, ...]


def first_step(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> FirstStep:
    """X_u and Y_v, as far as the structure has them, each from the sweeps of its own axis.

    Parameters
    ----------
    structure
        What will be fitted in the second step.
    flights
        Maneuvers; attitude and acceleration along the body must be logged or follow from what is.
    settings
        Choices of the run; bands and instruments are those of the second step and not used here.

    Raises
    ------
    UsageError
        The structure has neither parameter.
    InsufficientDataError
        A channel is missing, or the response is not coherent.
    """
    names = [name for name in _STEPS if name in structure.parameters.free]
    if not names:
        raise UsageError(
            f"two steps of speed damping for {structure.name} came, which has no free X_u and no free Y_v",
            needed="a model with one of them, such as hover.longitudinal",
        )
    found = {name: _one(name, flights, settings) for name in names}
    return FirstStep(
        fix={name: value for name, (value, _) in found.items()}, findings=tuple(f for _, f in found.values())
    )


def _one(name: str, flights: Sequence[Flight], settings: IdentifySettings) -> tuple[float, Finding]:
    output, source, axis = _STEPS[name]
    own = [item for item in flights if item[1].axis == axis] or list(flights)
    plain = replace(
        settings, instruments=(), estimate="direct", pairs={}, pair_weights={}, shifts={}, correct_filters=False
    )
    measured = measure(own, inputs=(source,), outputs=(output,), settings=plain)
    structure = speed_damping(output, source)
    used = measured.trusted_points(measured.response, plain.least_coherence(joint=False))
    problem = FrequencyProblem(structure=structure, parameters=structure.parameters, data=measured.response, used=used)
    solution = fit_frequency(problem)
    value, std = float(solution.theta[0]), float(bounds(problem, solution).std[0])
    cost = float(problem.costs(solution.theta)[0, 0])
    omega = measured.response.omega_rad_s[used[0, 0]]
    return value, warn(
        "speed_damping_biased",
        name,
        f"{name} = {value:.3g} ± {std:.2g} 1/s was taken from {output}/{source} between {omega[0]:.2g} and "
        f"{omega[-1]:.3g} rad/s, at a cost of {cost:.0f}, and held. It leaves out {_NEGLECTED[name]}: "
        f"where the command pushes the vehicle sideways, {name} is off several times, too small from slow "
        "responses and too large from fast ones. The joint fit of all responses has no such bias.",
        value=value,
        std=std,
        cost=cost,
        low_rad_s=float(omega[0]),
        high_rad_s=float(omega[-1]),
    )


def delay_budget(
    structure: LinearStructure,
    parameters: ParameterSet,
    bounds: Bounds,
    fitted: BoolArray,
    known_filters_s: Mapping[str, float],
) -> dict[str, DelayBudget]:
    """Delays of every fitted response ``output/input``.

    Parameters
    ----------
    structure, parameters, bounds
        The identified model.
    fitted
        Which responses were fitted, shape ``(y, u)``.
    known_filters_s
        Output to the delay of the autopilot's filters in front of it, as far as the log tells.
    """
    covariance = covariance_of_all(parameters, bounds)
    system, derivatives = structure.matrices_and_jacobian(parameters.values, np.eye(len(parameters)))
    lag, slope = _motor_lag(parameters)
    budget = {}
    for y, u in np.argwhere(fitted):
        total = derivatives[5][:, u] + derivatives[6][:, y] + slope
        before, after = float(system.input_delays_s[u]), float(system.output_delays_s[y])
        spread = math.sqrt(max(float(total @ covariance @ total), 0.0))
        budget[f"{structure.outputs[y]}/{structure.inputs[u]}"] = DelayBudget(
            input_delay_s=before,
            motor_lag_s=lag,
            output_delay_s=after,
            total_s=before + lag + after,
            total_std_s=spread if spread > 0.0 else None,
            known_filters_s=known_filters_s.get(structure.outputs[y]),
        )
    return budget


def _motor_lag(parameters: ParameterSet) -> tuple[float, FloatArray]:
    """The lag of the motors, and how it moves with the parameters."""
    slope = np.array([float(name == MOTOR_LAG) for name in parameters.names])
    return (parameters[MOTOR_LAG].value if MOTOR_LAG in parameters.names else 0.0), slope
