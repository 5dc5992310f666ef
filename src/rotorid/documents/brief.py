"""``rotorid review --json --brief``, schema ``rotorid.brief/1``: a review in less than 20 kB, for programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from rotorid.data.display import cut
from rotorid.documents.base import Document, to_json
from rotorid.documents.review import (
    ControlDocument,
    UnavailableDocument,
    VehicleReviewDocument,
    control_document,
)
from rotorid.results.summary import Color
from rotorid.reviewing.brief import brief_of, longest
from rotorid.uncertainty.differences import Verdict

if TYPE_CHECKING:
    from rotorid.reviewing.brief import BriefModel, BriefNumbers
    from rotorid.reviewing.values import Review

MOST_BYTES = 20_000
"""A brief is smaller, in UTF-8 on one line."""

_DIGITS = 5
"""More than any number of a review is known to."""

_LONGEST, _LONGEST_NAME = 400, 100
"""Characters of a text, and of a name."""

_MOST_SENTENCES = 6
"""Sentences on earlier flights."""

_SHORTENED = ("parts", "models", "findings", "cannot_tell", "next_commands")
"""Lists of a brief that may lose their last entries."""


class BriefNumberDocument(Document):
    """A number with its 95 % interval; an end is ``null`` where that side has no bound or no error was stated."""

    value: float
    lower: float | None
    upper: float | None
    unit: str


class BriefAnswerDocument(Document):
    """An answer: ``cannot`` is not enough data, ``part`` good as far as it was measured.

    ``evidence_s`` are the spans of the log that show it, a moment as two equal ends; empty where nothing does.
    """

    key: str
    title: str
    state: Literal["good", "look", "part", "cannot"]
    answer: str
    number: str = ""
    scale: str = ""
    details: str = ""
    remedy: str = ""
    evidence_s: list[tuple[float, float]]


class BriefPartDocument(Document):
    """Numbers of a part of the review, and the spans of the log that they come from.

    Those named in ``by_model`` lie beyond the measured band.
    """

    numbers: dict[str, BriefNumberDocument]
    by_model: list[str] = Field(default_factory=list)
    evidence_s: list[tuple[float, float]]


class BriefModelDocument(Document):
    """A model: the verdict on its fit (``gray`` is unknown), and the spans that it was fitted to."""

    verdict: str
    color: Color
    reason: str
    parameters: dict[str, BriefNumberDocument]
    evidence_s: list[tuple[float, float]]


class BriefFindingDocument(Document):
    """The first warning of a kind, how many there are, and the moments or spans that they name."""

    kind: str
    severity: Literal["warning", "error"]
    where: str
    message: str
    count: int
    evidence_s: list[tuple[float, float]]


class BriefBaselineDocument(Document):
    """The comparison with earlier flights."""

    verdict: Verdict
    flights: int
    sentences: list[str]


class LeftOutDocument(Document):
    """How many entries were left out to keep the brief small; ``review.json`` has all."""

    numbers: int = 0
    parameters: int = 0
    models: int = 0
    findings: int = 0
    notes: int = 0
    cannot_tell: int = 0
    next_commands: int = 0
    flights: int = 0


class BriefDocument(Document):
    """A review in brief. Spans are on the log's own clock: of several, the eight longest."""

    schema_name: Annotated[Literal["rotorid.brief/1"], Field(alias="schema")] = "rotorid.brief/1"
    name: str
    sha256: str
    vehicle: VehicleReviewDocument
    flights_s: list[tuple[float, float]]
    airborne_s: float
    control: ControlDocument | None
    answers: list[BriefAnswerDocument]
    parts: dict[str, BriefPartDocument]
    models: dict[str, BriefModelDocument]
    findings: list[BriefFindingDocument]
    cannot_tell: list[UnavailableDocument]
    next_commands: list[str]
    baseline: BriefBaselineDocument | None
    left_out: LeftOutDocument


class BriefsDocument(Document):
    """Several logs in brief, in the order in which they were given."""

    schema_name: Annotated[Literal["rotorid.briefs/1"], Field(alias="schema")] = "rotorid.briefs/1"
    reviews: list[BriefDocument]


def brief_document(review: Review) -> BriefDocument:
    """A review as a brief that is smaller than :data:`MOST_BYTES`.

    Parameters
    ----------
    review
        Its largest list loses its last entry, which is counted, until the brief is small enough.
    """
    document = _whole(review)
    while len(to_json(document, indent=None).encode()) >= MOST_BYTES and (smaller := _smaller(document)):
        document = smaller
    return document


def _whole(review: Review) -> BriefDocument:
    brief = brief_of(review)
    vehicle, flights = review.vehicle, review.flight.flights
    return BriefDocument(
        name=_name(review.name),
        sha256=review.sha256,
        vehicle=VehicleReviewDocument(
            autopilot=_name(vehicle.autopilot),
            firmware=_name(vehicle.firmware),
            kind=_name(vehicle.kind),
            frame=_name(vehicle.frame),
            motors=vehicle.motors,
        ),
        flights_s=_spans(longest(flights)),
        airborne_s=_rounded(sum(stop_s - start_s for start_s, stop_s in flights)),
        control=control_document(review),
        answers=[
            BriefAnswerDocument(
                key=answer.card.key,
                title=answer.card.title,
                state=answer.card.state,
                answer=_text(answer.card.headline),
                number=_text(answer.card.number),
                scale=answer.card.scale,
                details=_text(answer.card.details),
                remedy=_text(answer.card.remedy),
                evidence_s=_spans(answer.evidence),
            )
            for answer in brief.answers
        ],
        parts={name: _part(part) for name, part in brief.parts.items()},
        models={_name(name): _model(model) for name, model in brief.models.items()},
        findings=[
            BriefFindingDocument(
                kind=found.finding.kind,
                severity="error" if found.finding.severity == "error" else "warning",
                where=_name(found.finding.where),
                message=_text(found.finding.message),
                count=found.count,
                evidence_s=_spans(found.evidence),
            )
            for found in brief.findings
        ],
        cannot_tell=[
            UnavailableDocument(what=_text(gap.what), why=_text(gap.why), remedy=_text(gap.remedy))
            for gap in brief.cannot_tell
        ],
        next_commands=[_text(command) for command in review.next_commands],
        baseline=_baseline(review),
        left_out=LeftOutDocument(
            notes=brief.notes,
            flights=len(flights) - len(longest(flights)),
        ),
    )


def _part(part: BriefNumbers) -> BriefPartDocument:
    return BriefPartDocument(
        numbers={
            name: _number(quantity.value, quantity.lower, quantity.upper, quantity.unit)
            for name, quantity in part.numbers.items()
        },
        by_model=list(part.by_model),
        evidence_s=_spans(part.evidence),
    )


def _model(model: BriefModel) -> BriefModelDocument:
    return BriefModelDocument(
        verdict=model.verdict.word,
        color=model.verdict.color,
        reason=_text(model.verdict.reason),
        parameters={
            _name(name): _number(estimate.value, estimate.lower, estimate.upper, estimate.unit)
            for name, estimate in model.parameters.items()
        },
        evidence_s=_spans(model.evidence),
    )


def _baseline(review: Review) -> BriefBaselineDocument | None:
    found = review.baseline
    if found is None:
        return None
    sentences = [_text(sentence) for sentence in found.sentences[:_MOST_SENTENCES]]
    return BriefBaselineDocument(verdict=found.verdict, flights=len(found.flights), sentences=sentences)


def _number(value: float, lower: float | None, upper: float | None, unit: str) -> BriefNumberDocument:
    return BriefNumberDocument(value=_rounded(value), lower=_end(lower), upper=_end(upper), unit=unit)


def _end(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else _rounded(value)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _spans(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(round(start_s, 2), round(stop_s, 2)) for start_s, stop_s in spans]


def _text(text: str) -> str:
    return cut(text, _LONGEST)


def _name(text: str) -> str:
    return cut(text, _LONGEST_NAME)


def _smaller(document: BriefDocument) -> BriefDocument | None:
    """A brief whose largest list has lost its last entry, which is counted; ``None`` where all lists are empty."""
    lists = [name for name in _SHORTENED if getattr(document, name)]
    if not lists:
        return None
    largest = max(lists, key=lambda name: len(document.model_dump_json(include={name})))
    lost: dict[str, int]
    left: Any
    if largest == "parts":
        left, lost = _without_a_number(document.parts), {"numbers": 1}
    elif largest == "models":
        left, lost = _without_parameters(document.models)
    else:
        left, lost = getattr(document, largest)[:-1], {largest: 1}
    counts = {name: count + getattr(document.left_out, name) for name, count in lost.items()}
    return document.model_copy(update={largest: left, "left_out": document.left_out.model_copy(update=counts)})


def _without_a_number(parts: Mapping[str, BriefPartDocument]) -> dict[str, BriefPartDocument]:
    *others, last = parts
    numbers = dict(list(parts[last].numbers.items())[:-1])
    kept = {last: parts[last].model_copy(update={"numbers": numbers})} if numbers else {}
    return {name: parts[name] for name in others} | kept


def _without_parameters(
    models: Mapping[str, BriefModelDocument],
) -> tuple[dict[str, BriefModelDocument], dict[str, int]]:
    """Models of which the last with parameters has none any more, or without the last where none has any."""
    full = [name for name, model in models.items() if model.parameters]
    if not full:
        return dict(list(models.items())[:-1]), {"models": 1}
    bare = models[full[-1]].model_copy(update={"parameters": {}})
    return {**models, full[-1]: bare}, {"parameters": len(models[full[-1]].parameters)}
