"""Guided reduction: drop the parameters that the data do not show, one at a time, each with its reason.

As in *System Identification of an S500 Quadrotor UAV*, section III, after Tischler and Remple: converge; drop the most
insensitive parameter above 10 %, converge again; when none is left, the one of largest Cramér–Rao bound above 20 %;
keep a parameter without which the mean cost rises by more than 2. What is essential to the structure is never dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotorid.errors import ModelError
from rotorid.fit.identify import fit
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.reduce.elimination import LARGEST_RISE, mean_cost
from rotorid.reduce.evidence import Evidence, gather_evidence, worst
from rotorid.reduce.reasons import (
    dropped_because,
    kept_because_certain,
    kept_because_of_cost,
    kept_because_of_obstacle,
    protected_because,
)
from rotorid.reduce.step import Action, Reduction, Step
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import bounds

CERTAIN = 5.0
"""Standard deviations from zero beyond which a parameter is there, whatever the cost says: small errors of the model
itself make two or three of them."""

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


def reduce_guided(
    problem: FrequencyProblem, solution: Solution, *, distances: Mapping[str, float] | None = None
) -> Reduction:
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
        bounds(state.problem, state.solution)
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
    """The fit without one parameter, or ``None`` and what stands in its way."""
    parameters = state.problem.parameters.unpack(state.solution.theta)
    if not parameters[name].lower <= 0.0 <= parameters[name].upper:
        return None, f"zero lies outside the bounds of {name}"
    try:
        smaller = state.problem.with_parameters(parameters.drop(name))
        obstacle = _obstacle(smaller)
    except ModelError as error:
        return None, f"at a value of zero {error.came}"
    except np.linalg.LinAlgError:
        obstacle = "without it the equations of the model have no solution"
    if obstacle:
        return None, obstacle
    solution = _converge(smaller, smaller.parameters.pack())
    if not np.isfinite(solution.cost):
        return None, "without it no fit converges"
    return _State(problem=smaller, solution=solution), ""


def _obstacle(problem: FrequencyProblem) -> str:
    """What keeps a fit from starting: a measured response of which the model leaves nothing, or a singular model."""
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
    solution = fit(problem, starts=[start])
    if solution.outcome is Outcome.CONVERGED:
        return solution
    return min(solution, fit(problem), key=lambda one: one.cost)
