"""Guided reduction: drop the parameters that the data do not show, one at a time, each with its reason.

As in *System Identification of an S500 Quadrotor UAV*, section III, after Tischler and Remple: converge; drop the most
insensitive parameter above 10 %, converge again; when none is left, the one of largest Cramér–Rao bound above 20 %;
keep a parameter without which the mean cost rises by more than 2. What is essential to the structure is never dropped.

In addition to CIFER's percents, a standard deviation as large as the value and a partner that the data cannot separate
speak against a parameter. At the end, what the cost does not miss is left out too, and what its bound has driven to
zero. Every step keeps its numbers and its reason, and the way back.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.trust import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import bounds

Action: TypeAlias = Literal["dropped", "kept", "protected"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Immutable):
    """One parameter that was considered, and the decision.

    Parameters
    ----------
    parameter
        Its name.
    action
        ``dropped``; ``kept`` because the model is worse or no model without it; ``protected`` because it is essential
        physics, which is never dropped.
    reason
        Why, in sentences for a person.
    doubtful
        The drop moved another parameter by more than three of its standard deviations.
    value_before
        In the unit of the parameter.
    insensitivity_percent, cramer_rao_percent
        CIFER's bounds in percent of the value, infinite at a value of zero.
    mean_cost_before, mean_cost_after
        Mean cost of the responses with the parameter and, refitted, without it; ``None`` where that was not tried.
    partner
        The parameter that it is most correlated with, where its effect is seen but not apart from others.
    parameters_before
        All parameters as they were identified before this step.
    """

    parameter: str
    action: Action
    reason: str
    doubtful: bool
    value_before: float
    insensitivity_percent: float
    cramer_rao_percent: float
    mean_cost_before: float
    mean_cost_after: float | None
    partner: str | None
    parameters_before: ParameterSet


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduction(Immutable):
    """A reduced model with its steps.

    Parameters
    ----------
    problem, solution
        The reduced problem and its solution.
    steps
        Every step in order, those that changed nothing included.
    """

    problem: FrequencyProblem
    solution: Solution
    steps: tuple[Step, ...]

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the dropped parameters, in the order in which they went."""
        return tuple(step.parameter for step in self.steps if step.action == "dropped")

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One remark for each dropped parameter; a warning where the drop moved the others."""
        return tuple(_finding(step) for step in self.steps if step.action == "dropped")

    def undone(self, index: int) -> FrequencyProblem:
        """The problem as it was before a step, with the values identified then.

        Parameters
        ----------
        index
            Of the step in :attr:`steps`, from zero.

        Raises
        ------
        UsageError
            There is no such step.
        """
        if not 0 <= index < len(self.steps):
            raise UsageError(
                f"there is no step {index}", needed=f"one of the {len(self.steps)} steps, counted from zero"
            )
        return self.problem.with_parameters(self.steps[index].parameters_before)


def _finding(step: Step) -> Finding:
    numbers = {
        "value": step.value_before,
        "insensitivity_percent": step.insensitivity_percent,
        "cramer_rao_percent": step.cramer_rao_percent,
        "mean_cost_before": step.mean_cost_before,
        "mean_cost_after": math.nan if step.mean_cost_after is None else step.mean_cost_after,
    }
    return (warn if step.doubtful else remark)(
        "dropped_parameter",
        step.parameter,
        step.reason,
        **{name: number for name, number in numbers.items() if math.isfinite(number)},
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """How well the data show one free parameter.

    Parameters
    ----------
    name, unit, value
        The parameter as identified.
    std
        Honest standard deviation; zero where the data state no errors, infinite where the parameter has no effect.
    insensitivity_percent, cramer_rao_percent
        CIFER's bounds in percent of the value, infinite at a value of zero.
    partner
        The parameter whose estimate is most correlated with it, ``None`` for a single parameter.
    """

    name: str
    unit: str
    value: float
    std: float
    insensitivity_percent: float
    cramer_rao_percent: float
    partner: str | None

    @property
    def insensitive(self) -> bool:
        """The cost barely depends on it."""
        return self.insensitivity_percent > INSENSITIVITY_GUIDELINE_PERCENT

    @property
    def uncertain(self) -> bool:
        """The data do not separate it from the others."""
        return self.cramer_rao_percent > CRAMER_RAO_GUIDELINE_PERCENT


def gather_evidence(problem: FrequencyProblem, solution: Solution) -> tuple[Evidence, ...]:
    """Evidence on every free parameter, or on those alone that change nothing in the fitted responses.

    As long as a parameter without any effect is free, the others have no bounds.
    """
    free = problem.parameters.free
    values = dict(zip(free, map(float, solution.theta), strict=True))
    units = {name: problem.parameters[name].unit for name in free}
    silent = [name for name, column in zip(free, solution.jacobian.T, strict=True) if not column.any()]
    if silent:
        return tuple(
            Evidence(
                name=name,
                unit=units[name],
                value=values[name],
                std=np.inf,
                insensitivity_percent=np.inf,
                cramer_rao_percent=np.inf,
                partner=None,
            )
            for name in silent
        )
    limits = bounds(problem, solution, model_errors=False)
    partners = _partners(solution.jacobian)
    return tuple(
        Evidence(
            name=name,
            unit=units[name],
            value=values[name],
            std=float(limits.std[i]),
            insensitivity_percent=_percent_of(limits.insensitivity[i], values[name]),
            cramer_rao_percent=_percent_of(limits.cramer_rao[i], values[name]),
            partner=free[partners[i]] if len(free) > 1 else None,
        )
        for i, name in enumerate(free)
    )


def worst(evidence: Collection[Evidence]) -> Evidence | None:
    """The parameter to look at next: the most insensitive, else the most uncertain; ``None`` if all are good."""
    if insensitive := [item for item in evidence if item.insensitive]:
        return max(insensitive, key=lambda item: (item.insensitivity_percent, item.cramer_rao_percent))
    return max((item for item in evidence if item.uncertain), key=lambda item: item.cramer_rao_percent, default=None)


def _percent_of(bound: float, value: float) -> float:
    return float(100.0 * bound / abs(value)) if value else np.inf


def _partners(jacobian: FloatArray) -> list[int]:
    """Index of the most correlated other parameter, from the curvature of the cost as the Cramér–Rao bound is."""
    unit = jacobian / np.sqrt(np.sum(jacobian**2, axis=0))
    _, singular, right = np.linalg.svd(unit, full_matrices=False)
    root = right.T / np.maximum(singular, np.finfo(float).eps * singular.max(initial=0.0))
    root /= np.sqrt(np.sum(root**2, axis=1, keepdims=True))
    correlation = np.abs(root @ root.T)
    np.fill_diagonal(correlation, -1.0)
    return [int(index) for index in np.argmax(correlation, axis=1)]


CERTAIN = 5.0
"""Standard deviations from zero beyond which a parameter is real, whatever the cost: small model errors make two or
three of them.
"""

CERTAIN_LEAD = 3.0
"""Standard deviations from zero below which a lead is not real, whatever the cost: missing dynamics look like a lead,
and it takes control power and damping with it.
"""

LARGEST_RISE = 2.0
"""A parameter is kept when leaving it out raises the mean cost by more than this (paper practice with CIFER)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """A fit after parameters without effect were dropped.

    Parameters
    ----------
    problem, solution
        The reduced problem and its solution.
    findings
        Why each parameter was dropped.
    """

    problem: FrequencyProblem
    solution: Solution
    findings: tuple[Finding, ...]


def fit_and_drop(problem: FrequencyProblem) -> Reduced:
    """Fit, then drop optional parameters that the data do not show.

    An optional parameter goes when the mean cost without it rises by no more than 2; one that several inputs share is
    judged by all their responses together. The least certain goes first, and none that lies more than five standard
    deviations from zero where errors are weighed by their covariance: CIFER's cost knows nothing of noise, and precise
    data show a lag that costs little, without which the others are biased. Any parameter whose bound of zero holds it
    goes too: it would have crossed into values that the vehicle cannot have. A lead that works against a lag, such as
    the spin-up of rotors, goes with it: alone it would be the derivative of a command. It also goes where it lies less
    than three standard deviations from zero.

    Parameters
    ----------
    problem
        With all parameters free that the user left free.
    """
    best, solution = problem, fit_frequency(problem)
    findings: list[Finding] = []
    kept: set[str] = set()
    while optional := [name for name in _optional(best) if name not in kept]:
        name = optional[0] if len(optional) == 1 else min(optional, key=_distances(best, solution).__getitem__)
        gone = (name, *_leads(best.structure, best.parameters, name))
        smaller = best.with_parameters(_drop(best.parameters, gone))
        trial = fit_frequency(smaller)
        rise = mean_cost(smaller, trial) - mean_cost(best, solution)
        missed = rise > LARGEST_RISE
        away = 0.0 if missed and not _is_lead(best, name) else _distances(best, solution)[name]
        # Model errors bring it nearer to zero: they are looked for only where that could change the decision.
        if (missed and away > 0.0) or away > CERTAIN:
            away = _distances(best, solution, model_errors=True)[name]
        if away > CERTAIN or (missed and not 0.0 < away < CERTAIN_LEAD):
            kept.add(name)
            continue
        if missed:
            findings.append(_no_lead(name, away, rise))
        else:
            inputs = len(problem.structure.inputs)
            findings += [_not_missed(best.parameters[name], rise, inputs=inputs) for name in gone]
        best, solution = smaller, trial
    for name in best.parameters.free:
        value = dict(zip(best.parameters.free, solution.theta, strict=True)).get(name)
        bounds = (best.parameters[name].lower, best.parameters[name].upper)
        if value == 0.0 and value in bounds:
            leads = _leads(best.structure, best.parameters, name)
            best = best.with_parameters(_drop(best.parameters, (name, *leads)))
            solution = fit_frequency(best)
            findings += [_at_zero(name), *(_without_lag(lead, name) for lead in leads)]
    return Reduced(problem=best, solution=solution, findings=tuple(findings))


def mean_cost(problem: FrequencyProblem, solution: Solution) -> float:
    """Cost of a solution per response that is used."""
    return solution.cost / max(int(problem.used.any(axis=-1).sum()), 1)


def _optional(problem: FrequencyProblem) -> list[str]:
    free = problem.parameters.free
    return [name for name in problem.structure.optional if name in free and _may_be_zero(problem.parameters[name])]


def _drop(parameters: ParameterSet, names: Iterable[str]) -> ParameterSet:
    for name in names:
        parameters = parameters.drop(name)
    return parameters


def _leads(structure: LinearStructure, parameters: ParameterSet, lag: str) -> tuple[str, ...]:
    """Optional parameters that work against a lag: without it they would be derivatives of a command."""
    without = parameters.drop(lag)
    rows = structure.condensed(without).M
    among = frozenset().union(*(entry.names for row in rows for entry in row))
    leads = tuple(name for name in structure.optional if name in among and name in without.free)
    if not leads or _each_state_moves(structure, without):
        return ()
    return leads if _each_state_moves(structure, _drop(without, leads)) else ()


def _each_state_moves(structure: LinearStructure, parameters: ParameterSet) -> bool:
    """Whether every state of what is left has a derivative."""
    left = structure.condensed(parameters)
    return bool(np.linalg.matrix_rank(left.matrices(left.parameters.values).M) == len(left.states))


def _is_lead(problem: FrequencyProblem, name: str) -> bool:
    """Whether a parameter works against one of the lags that may go."""
    lags = (name for name in problem.structure.optional if name in problem.parameters.free)
    return any(name in _leads(problem.structure, problem.parameters, lag) for lag in lags if lag != name)


def _distances(problem: FrequencyProblem, solution: Solution, *, model_errors: bool = False) -> dict[str, float]:
    """Standard deviations from zero of each parameter, where errors are weighed by their covariance.

    Where the data state no errors, or several parameters change nothing, there is no such number, and the cost alone
    decides.
    """
    variance = np.einsum("yuff->yuf", problem.data.covariance).real
    if not variance[problem.used].all():
        return dict.fromkeys(problem.parameters.free, 0.0)
    try:
        final = refine(problem, solution)
        limits = bounds(problem, final, weights="covariance", model_errors=model_errors)
    except InsufficientDataError:
        return dict.fromkeys(problem.parameters.free, 0.0)
    return dict(zip(limits.names, map(float, np.abs(final.theta) / limits.std), strict=True))


def _may_be_zero(parameter: Parameter) -> bool:
    return parameter.lower <= 0.0 <= parameter.upper


def _not_missed(parameter: Parameter, rise: float, *, inputs: int) -> Finding:
    # A lag that is not seen still delays; nothing else can take its place.
    absorbed = (
        f" and its effect is included in the {'delay' if inputs == 1 else 'delays'}" if parameter.unit == "s" else ""
    )
    return remark(
        "dropped_parameter",
        parameter.name,
        f"The data do not show {parameter.name} in addition to the other parameters: dropping it raises the cost "
        f"by only {max(rise, 0.0):.2f} (limit {LARGEST_RISE:g}), so it was set to zero{absorbed}.",
        cost_rise=rise,
        limit=LARGEST_RISE,
    )


def _no_lead(name: str, away: float, rise: float) -> Finding:
    return remark(
        "dropped_parameter",
        name,
        f"{name} is {away:.1f} standard deviations from zero, but a lead, which adds control power and damping, "
        f"needs {CERTAIN_LEAD:g}. It was dropped, although the cost rises by {rise:.1f}.",
        cost_rise=rise,
        deviations=away,
    )


def _without_lag(lead: str, lag: str) -> Finding:
    return warn(
        "dropped_parameter",
        lead,
        f"{lead} was dropped with {lag}, which is zero by the data: a lead needs a lag.",
    )


def _at_zero(name: str) -> Finding:
    return warn(
        "dropped_parameter",
        name,
        f"{name} was dropped at its bound of zero: the data would make it negative. "
        + (
            "A negative delay points to clocks that disagree, a filtered input, or a wrong channel."
            if name.startswith("tau_")
            else "The band reaches into speed modes or coupling that this model lacks, or is too narrow."
        ),
    )


SIGNIFICANT_STDS = 3.0
"""A value further from zero, or a parameter moved further, is no chance."""


def dropped_because(
    suspect: Evidence, before: Iterable[Evidence], after: Iterable[Evidence], cost_before: float, cost_after: float
) -> tuple[str, bool]:
    """Why a parameter was dropped, and whether the drop moved another one by more than chance.

    Parameters
    ----------
    before, after
        Evidence on the free parameters with and without it.
    cost_before, cost_after
        Mean costs with and without it.
    """
    sentences = [f"{_case(suspect)}.", f"Without it the mean cost goes from {cost_before:.2f} to {cost_after:.2f}, "]
    sentences[-1] += "so it was dropped."
    distance = _stds(suspect.value, suspect.std)
    if distance > SIGNIFICANT_STDS:
        sentences.append(
            f"It is nevertheless {distance:.1f} standard deviations from zero: by these data it is real, but it "
            "barely affects the cost."
        )
    moves = _moves(before, after)
    doubtful = bool(moves) and moves[0][0] > SIGNIFICANT_STDS
    if doubtful:
        distance, old, new = moves[0]
        sentences.append(
            f"Caution: {old.name} moved by {distance:.1f} standard deviations to compensate, from "
            f"{old.value:.4g} to {new.value:.4g} {old.unit}."
        )
    return " ".join(sentences), doubtful


def kept_because_of_cost(suspect: Evidence, cost_before: float, cost_after: float) -> str:
    """Why a parameter was kept without which the cost rises."""
    return (
        f"{_case(suspect)}. It was kept because without it the mean cost rises from {cost_before:.2f} to "
        f"{cost_after:.2f}, by more than {LARGEST_RISE:g}."
    )


def kept_because_certain(suspect: Evidence, distance: float) -> str:
    """Why a parameter was kept that the cost would not miss."""
    return (
        f"{_case(suspect)}. It was kept because it is {distance:.0f} standard deviations from zero with errors "
        "weighed by their covariance; dropping it would bias the others."
    )


def kept_because_of_obstacle(suspect: Evidence, obstacle: str) -> str:
    """Why a parameter was kept without which there is no model."""
    return f"{_case(suspect)}. It was kept because {obstacle}; {_remedy(suspect)}."


def protected_because(suspect: Evidence) -> str:
    """Why a parameter that the data barely show is kept."""
    return f"{_case(suspect)}. It was kept because it is essential physics of this model; {_remedy(suspect)}."


def _remedy(suspect: Evidence) -> str:
    if suspect.insensitive or suspect.partner is None:
        return "give its value if known, or excite these dynamics"
    return f"give its value or that of {suspect.partner} if one is known, or excite motion that separates them"


def _case(suspect: Evidence) -> str:
    """Evidence against a parameter, as the beginning of a sentence."""
    name, value = suspect.name, f"{suspect.value:.4g} {suspect.unit}".removesuffix(" 1")
    if math.isinf(suspect.std):
        return f"{name} has no effect on the fitted responses"
    if suspect.value == 0.0:
        return f"The best value of {name} is zero"
    if suspect.insensitive:
        return (
            f"The cost barely depends on {name}: its insensitivity is "
            f"{_percent_text(suspect.insensitivity_percent)} of the value {value} (guideline "
            f"{INSENSITIVITY_GUIDELINE_PERCENT:g} %)"
        )
    uncertain = (
        f"its Cramér–Rao bound is {_percent_text(suspect.cramer_rao_percent)} of the value {value} (guideline "
        f"{CRAMER_RAO_GUIDELINE_PERCENT:g} %)"
    )
    if suspect.partner is None:
        return f"{name} is uncertain: {uncertain}"
    return (
        f"{name} is hard to separate from {suspect.partner}, with which it is correlated most: {uncertain}, its "
        f"insensitivity only {_percent_text(suspect.insensitivity_percent)}"
    )


def _percent_text(number: float) -> str:
    if number >= 1000.0:
        return "more than 1000 %"
    return f"{number:.0f} %" if number >= 100.0 else f"{number:.1f} %"


def _moves(before: Iterable[Evidence], after: Iterable[Evidence]) -> list[tuple[float, Evidence, Evidence]]:
    """How far each parameter moved, in its standard deviations before, furthest first."""
    old = {item.name: item for item in before}
    pairs = [(old[item.name], item) for item in after if item.name in old]
    moves = [(_stds(new.value - was.value, was.std), was, new) for was, new in pairs]
    return sorted(moves, key=lambda move: -move[0])


def _stds(change: float, std: float) -> float:
    """Change in standard deviations; zero where none is known."""
    return abs(change) / std if 0.0 < std < math.inf else 0.0


_VANISHED = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    problem: FrequencyProblem
    solution: Solution

    @cached_property
    def evidence(self) -> tuple[Evidence, ...]:
        return gather_evidence(self.problem, self.solution)

    @property
    def mean_cost(self) -> float:
        return mean_cost(self.problem, self.solution)


def reduce(problem: FrequencyProblem, solution: Solution, *, distances: Mapping[str, float] | None = None) -> Reduction:
    """Drop what the data do not show, one parameter at a time, and keep every step.

    A parameter near zero has a large bound in percent of its value, so it goes first. One with a large Cramér–Rao bound
    and a small insensitivity is seen, but not apart from another: the step names that partner.

    CIFER's percents judge the shape of the cost and know nothing of the noise. With good data they would drop a
    parameter that is certain to be there, and bias the others. So one that lies more than five standard deviations from
    zero in a better fit is kept. Where there is none, the reason says how far it lay from zero in this one, and whether
    the others moved to replace it.

    Parameters
    ----------
    problem
        With all parameters free that may be identified or dropped. Essential parameters, and those that essential
        ones are tied to, are looked at and never dropped.
    solution
        Of this problem; taken as the start of another fit if it has not converged.
    distances
        Parameter to its distance from zero in standard deviations, from a fit that weighs errors by their covariance.

    Returns
    -------
    Reduction
        The reduced problem, its solution, and all steps, each of which can be undone.

    Raises
    ------
    InsufficientDataError
        An essential parameter changes nothing in the fitted responses.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, AIAA, chapter 13.
    """
    if solution.outcome is not Outcome.CONVERGED:
        solution = _converge(problem, solution.theta)
    state = _State(problem=problem, solution=solution)
    steps: list[Step] = []
    settled: set[str] = set()
    while suspect := worst([item for item in state.evidence if item.name not in settled]):
        step, state = _judge(state, suspect, (distances or {}).get(suspect.name, 0.0))
        steps.append(step)
        if step.action != "dropped":
            settled.add(suspect.name)
    if any(np.isinf(item.std) for item in state.evidence):
        # Refuses a parameter without effect that had to stay.
        bounds(state.problem, state.solution, model_errors=False)
    return Reduction(problem=state.problem, solution=state.solution, steps=tuple(steps))


def _judge(state: _State, suspect: Evidence, distance: float) -> tuple[Step, _State]:
    """The step for one suspect, and the state after it."""
    if _is_essential(state.problem, suspect.name):
        return _step(state, suspect, "protected", protected_because(suspect)), state
    if distance > CERTAIN:
        return _step(state, suspect, "kept", kept_because_certain(suspect, distance)), state
    smaller, obstacle = _without(state, suspect.name)
    if smaller is None:
        return _step(state, suspect, "kept", kept_because_of_obstacle(suspect, obstacle)), state
    rise = smaller.mean_cost - state.mean_cost
    if rise > LARGEST_RISE:
        reason = kept_because_of_cost(suspect, state.mean_cost, smaller.mean_cost)
        return _step(state, suspect, "kept", reason, after=smaller), state
    silenced = [item.name for item in smaller.evidence if np.isinf(item.std)]
    if essential := [name for name in silenced if _is_essential(smaller.problem, name)]:
        obstacle = f"{essential[0]} has no effect on the responses"
        return _step(state, suspect, "kept", kept_because_of_obstacle(suspect, obstacle), after=smaller), state
    reason, doubtful = dropped_because(suspect, state.evidence, smaller.evidence, state.mean_cost, smaller.mean_cost)
    return _step(state, suspect, "dropped", reason, after=smaller, doubtful=doubtful), smaller


def _step(
    state: _State,
    suspect: Evidence,
    action: Action,
    reason: str,
    *,
    after: _State | None = None,
    doubtful: bool = False,
) -> Step:
    return Step(
        parameter=suspect.name,
        action=action,
        reason=reason,
        doubtful=doubtful,
        value_before=suspect.value,
        insensitivity_percent=suspect.insensitivity_percent,
        cramer_rao_percent=suspect.cramer_rao_percent,
        mean_cost_before=state.mean_cost,
        mean_cost_after=None if after is None else after.mean_cost,
        partner=None if suspect.insensitive else suspect.partner,
        parameters_before=state.problem.parameters.unpack(state.solution.theta),
    )


def _is_essential(problem: FrequencyProblem, name: str) -> bool:
    """Whether the parameter, or one that is tied to it, is essential."""
    moved = problem.parameters.directions[:, problem.parameters.free.index(name)]
    return any(parameter.essential and move for parameter, move in zip(problem.parameters, moved, strict=True))


def _without(state: _State, name: str) -> tuple[_State | None, str]:
    """The fit without one parameter, or ``None`` and the obstacle."""
    parameters = state.problem.parameters.unpack(state.solution.theta)
    if not parameters[name].lower <= 0.0 <= parameters[name].upper:
        return None, f"zero lies outside the bounds of {name}"
    if leads := _leads(state.problem.structure, parameters, name):
        return None, f"{', '.join(leads)} would be the derivative of a command without it"
    try:
        smaller = state.problem.with_parameters(parameters.drop(name))
        obstacle = _obstacle(smaller)
    except ModelError as error:
        return None, f"at zero {error.came}"
    except np.linalg.LinAlgError:
        obstacle = "without it the equations of the model have no solution"
    if obstacle:
        return None, obstacle
    solution = _converge(smaller, smaller.parameters.pack())
    if not np.isfinite(solution.cost):
        return None, "without it no fit converges"
    return _State(problem=smaller, solution=solution), ""


def _obstacle(problem: FrequencyProblem) -> str:
    """Obstacle to a fit: a measured response that vanishes from the model, or a singular model."""
    data, used = problem.data, problem.used
    model = problem.structure.response(problem.parameters.values, data.omega_rad_s)
    if not np.all(np.isfinite(model[used])):
        return "without it the equations of the model have no solution"
    gone = used & (np.abs(model) <= _VANISHED * np.abs(data.values))
    for y, u in np.argwhere(gone.any(axis=-1)):
        return f"without it the response {data.outputs[y]}/{data.inputs[u]} vanishes"
    return ""


def _converge(problem: FrequencyProblem, start: FloatArray) -> Solution:
    """Fit from where the parameters are; from the usual starts too if that does not converge."""
    solution = fit_frequency(problem, starts=[start])
    if solution.outcome is Outcome.CONVERGED:
        return solution
    return min(solution, fit_frequency(problem), key=lambda solution: solution.cost)
