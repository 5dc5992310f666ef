"""What a reduction leaves behind: every step with its numbers and its reason, and the way back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.models.parameter import ParameterSet

Action: TypeAlias = Literal["dropped", "kept", "protected"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Immutable):
    """One parameter that was looked at, and what became of it.

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
    """A reduced model and how it came about.

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
            raise UsageError(f"step {index} came", needed=f"one of the {len(self.steps)} steps, counted from zero")
        return self.problem.with_parameters(self.steps[index].parameters_before)


def _finding(step: Step) -> Finding:
    numbers = {
        "value": step.value_before,
        "insensitivity_percent": step.insensitivity_percent,
        "cramer_rao_percent": step.cramer_rao_percent,
        "mean_cost_before": step.mean_cost_before,
        "mean_cost_after": math.nan if step.mean_cost_after is None else step.mean_cost_after,
    }
    return Finding(
        kind="dropped_parameter",
        severity="warning" if step.doubtful else "info",
        where=step.parameter,
        message=step.reason,
        numbers={name: number for name, number in numbers.items() if math.isfinite(number)},
    )
