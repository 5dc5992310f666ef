"""What the page says about one identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.identification import Identification
from rotorid.plot.bode import bode
from rotorid.plot.quantity import quantity
from rotorid.plot.time import verification
from rotorid.report.numbers import significant
from rotorid.report.picture import Picture, in_all_units
from rotorid.report.tables import (
    CostRow,
    FindingRow,
    ManeuverRow,
    ParameterRow,
    PoleRow,
    ScoreRow,
    cost_rows,
    finding_rows,
    maneuver_row,
    parameter_rows,
    pole_rows,
    score_rows,
)
from rotorid.report.timelines import timelines
from rotorid.report.wording import LEVELS, Verdict, cost_verdict, summary, worst_prediction
from rotorid.verify.verification import Scores


@dataclass(frozen=True, kw_only=True)
class Check:
    """One unseen maneuver on the page."""

    maneuver: ManeuverRow
    scores: tuple[ScoreRow, ...]
    picture: Picture


@dataclass(frozen=True, kw_only=True)
class Section:
    """One identification on the page."""

    anchor: str
    title: str
    document: ResultDocument
    records: tuple[str, ...]
    sentences: tuple[str, ...]
    cost: Verdict | None
    unseen: Verdict | None
    parameters: tuple[ParameterRow, ...]
    costs: tuple[CostRow, ...]
    responses: tuple[Picture, ...]
    joint: bool
    least_coherence: float
    maneuvers: tuple[ManeuverRow, ...]
    timelines: tuple[Picture, ...]
    poles: tuple[PoleRow, ...]
    checks: tuple[Check, ...]
    findings: tuple[FindingRow, ...]

    @property
    def far_from_truth(self) -> bool:
        """Whether a known truth lies beyond what random errors explain."""
        return any(row.off.marked for row in self.parameters)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures of the section."""
        return (*self.responses, *self.timelines, *(check.picture for check in self.checks))


def section(identified: Identification, *, anchor: str, truth: Mapping[str, float]) -> Section:
    """Everything that the page says about one identification.

    Parameters
    ----------
    identified
        What ``identify`` found.
    anchor
        Prefix of the identifiers on the page, unique among its sections.
    truth
        True parameter values where they are known, as ``model.name`` or ``name``.
    """
    document = identified.document
    scores = [one for check in identified.verifications for one in check.scores.values()]
    return Section(
        anchor=anchor,
        title=_title(document),
        document=document,
        records=tuple(dict.fromkeys(segment.record for segment in identified.segments)),
        sentences=summary(document, scores=scores),
        cost=_cost(document.cost.average) if document.cost else None,
        unseen=_unseen(document, scores),
        parameters=parameter_rows(document, truth),
        costs=cost_rows(document),
        responses=_responses(identified, anchor),
        joint=identified.response.estimate == "joint",
        least_coherence=identified.least_coherence,
        maneuvers=tuple(maneuver_row(flown.record, flown) for flown in document.provenance.maneuvers),
        timelines=timelines(
            identified.segments,
            document.provenance.maneuvers,
            inputs=document.inputs,
            outputs=document.outputs,
            key=f"{anchor}-timeline",
        ),
        poles=pole_rows(document.poles),
        checks=_checks(identified, anchor),
        findings=finding_rows(document.findings),
    )


def _title(document: ResultDocument) -> str:
    # "Roll" for a single command, the model's name for anything richer.
    if len(document.inputs) == 1 and document.inputs[0].endswith("_command"):
        return document.inputs[0].removesuffix("_command").capitalize()
    return document.model


def _cost(cost: float) -> Verdict:
    return Verdict(cost_verdict(cost).level, f"cost {significant(cost)}")


def _unseen(document: ResultDocument, scores: Sequence[Scores]) -> Verdict | None:
    """The worse of what predictions and unseen sweeps say."""
    costs = document.verification.frequency.values()
    verdicts = [*([worst_prediction(scores)] if scores else []), *([_cost(max(costs))] if costs else [])]
    return max(verdicts, key=lambda verdict: LEVELS.index(verdict.level), default=None)


def _responses(identified: Identification, anchor: str) -> tuple[Picture, ...]:
    response = identified.response
    pairs = [
        (output, input)
        for y, output in enumerate(response.outputs)
        for u, input in enumerate(response.inputs)
        if identified.fitted[y, u].any()
    ]
    return tuple(
        _response(identified, f"{anchor}-response-{number}", output, input)
        for number, (output, input) in enumerate(pairs)
    )


def _response(identified: Identification, key: str, output: str, input: str) -> Picture:
    draw = partial(
        bode,
        identified.response,
        output=output,
        input=input,
        model=identified.model_response,
        beside=identified.beside,
        fitted=identified.fitted,
        least_coherence=identified.least_coherence,
    )
    description = f"Bode plot of {quantity(output).words} over {quantity(input).words}, measured and model"
    return in_all_units(draw, key=key, description=description, converted=True)


def _checks(identified: Identification, anchor: str) -> tuple[Check, ...]:
    return tuple(
        Check(
            maneuver=maneuver_row(check.record, check.maneuver),
            scores=score_rows(check),
            picture=Picture(
                key=f"{anchor}-check-{number}",
                description=f"Measured and predicted outputs of a {check.maneuver.kind} in {check.record}",
                figure=verification(check),
            ),
        )
        for number, check in enumerate(identified.verifications)
    )
