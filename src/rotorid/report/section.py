"""What the page says about one identification."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import get_args

from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.identification import Identification, Segment
from rotorid.plot.bode import bode
from rotorid.plot.excitation import timeline
from rotorid.plot.figure import Figure
from rotorid.plot.quantity import quantity
from rotorid.plot.time import verification
from rotorid.plot.view import Frequency, Magnitude
from rotorid.report.numbers import significant
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
from rotorid.report.wording import LEVELS, Verdict, cost_verdict, summary, worst_prediction
from rotorid.verify.verification import Scores


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure, and what it shows for those who cannot see it.

    Parameters
    ----------
    key
        Identifier on the page.
    description
        What it shows, in words.
    figure
        The picture as it is drawn first.
    views
        The same picture in other units, by frequency and magnitude: ``"Hz linear"``. Empty where there is one view.
    """

    key: str
    description: str
    figure: Figure
    views: Mapping[str, Figure] = field(default_factory=dict)


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
    command: str

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
        maneuvers=tuple(maneuver_row(segment.record, segment.maneuver) for segment in identified.segments),
        timelines=_timelines(identified, anchor),
        poles=pole_rows(document.poles),
        checks=_checks(identified, anchor),
        findings=finding_rows(document.findings),
        command=shlex.join(document.provenance.command),
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
    units: list[tuple[Frequency, Magnitude]] = list(product(get_args(Frequency), get_args(Magnitude)))
    views = {
        f"{frequency} {magnitude}": bode(
            identified.response,
            output=output,
            input=input,
            model=identified.model_response,
            beside=identified.beside,
            fitted=identified.fitted,
            least_coherence=identified.least_coherence,
            frequency=frequency,
            magnitude=magnitude,
        )
        for frequency, magnitude in units
    }
    return Picture(
        key=key,
        description=f"Bode plot of {quantity(output).words} over {quantity(input).words}, measured and model",
        figure=views["rad/s dB"],
        views=views,
    )


def _timelines(identified: Identification, anchor: str) -> tuple[Picture, ...]:
    # Each record has its own clock, so each gets its own picture.
    by_record: dict[str, list[Segment]] = {}
    for segment in identified.segments:
        by_record.setdefault(segment.record, []).append(segment)
    document = identified.document
    return tuple(
        Picture(
            key=f"{anchor}-timeline-{number}",
            description=f"Inputs and outputs over time in {record}, excitations shaded",
            figure=timeline(segments, inputs=document.inputs, outputs=document.outputs),
        )
        for number, (record, segments) in enumerate(by_record.items())
    )


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
