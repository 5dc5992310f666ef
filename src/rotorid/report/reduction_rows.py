"""The steps of a reduction on the page, each with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotorid.pipeline.document import FindingDocument, ResultDocument, StepDocument
from rotorid.report.numbers import percent, significant


@dataclass(frozen=True, kw_only=True, slots=True)
class StepRow:
    """One parameter that was looked at, and what became of it."""

    anchor: str
    number: int
    parameter: str
    action: str
    reason: str
    cost: str
    cramer_rao: str
    insensitivity: str


def step_rows(steps: Sequence[StepDocument], *, anchor: str) -> tuple[StepRow, ...]:
    """One row for each step, in order.

    Parameters
    ----------
    steps
        Of the reduction.
    anchor
        Prefix of the identifiers of the section.
    """
    return tuple(
        StepRow(
            anchor=f"{anchor}-step-{number}",
            number=number + 1,
            parameter=step.parameter,
            action=step.action,
            reason=step.reason,
            cost=f"{significant(step.mean_cost_before)} → {significant(step.mean_cost_after)}"
            if step.mean_cost_after is not None
            else significant(step.mean_cost_before),
            cramer_rao=percent(step.cramer_rao_percent),
            insensitivity=percent(step.insensitivity_percent),
        )
        for number, step in enumerate(steps)
    )


def reduction_sentence(steps: Sequence[StepDocument]) -> str:
    """How many parameters went, and what it cost.

    Examples
    --------
    >>> step = StepDocument(parameter="Z_q", action="dropped", reason="", value_before=0.0, insensitivity_percent=None,
    ...     cramer_rao_percent=None, mean_cost_before=0.221, mean_cost_after=0.222)
    >>> reduction_sentence([step])
    '1 of 1 parameter looked at was dropped; the mean cost went from 0.221 to 0.222.'
    """
    if not steps:
        return ""
    dropped = [step for step in steps if step.action == "dropped"]
    looked = "1 parameter" if len(steps) == 1 else f"{len(steps)} parameters"
    verb = "was" if len(dropped) == 1 else "were"
    told = f"{len(dropped) or 'None'} of {looked} looked at {verb} dropped"
    if not dropped:
        return f"{told}."
    before, after = significant(steps[0].mean_cost_before), significant(dropped[-1].mean_cost_after)
    return f"{told}; the mean cost went from {before} to {after}."


def told_by_steps(finding: FindingDocument, document: ResultDocument) -> bool:
    """Whether a finding only repeats what the table of steps says; a warning is worth its repetition."""
    parameters = {step.parameter for step in document.reduction}
    return finding.kind == "dropped_parameter" and finding.severity == "info" and finding.where in parameters
