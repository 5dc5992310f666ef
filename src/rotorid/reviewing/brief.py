"""A review in brief, for programs: the answers, the numbers behind them, and the parts of the log that show them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.data.quantities import figure
from rotorid.data.quantity import Quantity
from rotorid.data.record import Intervals
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.results.summary import FitVerdict, ParameterEstimate
from rotorid.results.verdicts import verdict
from rotorid.reviewing.baseline import measures
from rotorid.reviewing.card import Card
from rotorid.reviewing.cards import cards
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.missing_words import gathered
from rotorid.reviewing.values import Review

MOST_SPANS = 8
"""Spans of one statement: the longest of them, in the order of the log."""

_AT = ("lost_at_s", "first_s")
"""Numbers of a finding that are a moment of the log."""


@dataclass(frozen=True, kw_only=True)
class BriefAnswer(Immutable):
    """An answer, with the spans of the log that show it; empty where nothing does."""

    card: Card
    evidence: Intervals


@dataclass(frozen=True, kw_only=True)
class BriefNumbers(Immutable):
    """Numbers of a part of the review, by name, with the spans of the log that they come from.

    ``by_model`` are names of those that a model of the plant predicts beyond the measured band.
    """

    numbers: Mapping[str, Quantity]
    evidence: Intervals
    by_model: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(numbers=self.numbers)


@dataclass(frozen=True, kw_only=True)
class BriefModel(Immutable):
    """A model, the verdict on its fit, its parameters, and the spans that it was fitted to; none where it has none."""

    verdict: FitVerdict
    parameters: Mapping[str, ParameterEstimate]
    evidence: Intervals

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters)


@dataclass(frozen=True, kw_only=True)
class BriefFinding(Immutable):
    """A warning with the spans that it names, and how many there are of its kind."""

    finding: Finding
    count: int
    evidence: Intervals


@dataclass(frozen=True, kw_only=True, eq=False)
class Brief(Immutable):
    """A review in brief.

    Parameters
    ----------
    review
        The whole of it: name, vehicle, flights, loss of control, comparison with earlier flights, next commands.
    answers
        Its cards, in their order.
    parts
        Part of the review (``loops.p``, ``margins.roll``, ``motors``) to its numbers; the parts and numbers that cards
        judge by come first.
    models
        Name to model; identified ones come first.
    findings
        Warnings and errors, the worst first, each kind once.
    notes
        How many other findings the review has.
    cannot_tell
        What was not measured, in words: a row for everything that has one reason.
    """

    review: Review
    answers: tuple[BriefAnswer, ...]
    parts: Mapping[str, BriefNumbers]
    models: Mapping[str, BriefModel]
    findings: tuple[BriefFinding, ...]
    notes: int
    cannot_tell: tuple[Unavailable, ...]

    def __post_init__(self) -> None:
        self._set(parts=self.parts, models=self.models)


def brief_of(review: Review) -> Brief:
    """A review in brief, with the evidence for each statement as spans on the log's own clock.

    Nothing is judged anew: what was not measured stays ``cannot`` in its answer and is listed in ``cannot_tell``.

    Parameters
    ----------
    review
        As :func:`rotorid.reviewing.assembly.review` returns it.

    Returns
    -------
    Brief
        Its document, :func:`rotorid.documents.brief.brief_document`, is smaller than 20 kB.

    Examples
    --------
    >>> import rotorid
    >>> brief = brief_of(rotorid.review("flight.ulg"))  # doctest: +SKIP
    >>> [(answer.card.key, answer.card.state, answer.evidence) for answer in brief.answers][0]  # doctest: +SKIP
    ('tracking', 'good', ((12.0, 95.5),))
    """
    models = _models(review)
    warnings = [finding for finding in review.findings if finding.severity != "info"]
    return Brief(
        review=review,
        answers=tuple(BriefAnswer(card=card, evidence=_of_card(card, review, models)) for card in cards(review)),
        parts=_parts(review),
        models=models,
        findings=_findings(warnings),
        notes=len(review.findings) - len(warnings),
        cannot_tell=gathered(review.cannot_tell),
    )


def longest(spans: Iterable[tuple[float, float]], most: int = MOST_SPANS) -> Intervals:
    """The longest of some spans, each once, in the order of the log.

    Examples
    --------
    >>> longest([(5.0, 6.0), (0.0, 2.0), (0.0, 2.0), (3.0, 3.0)], most=2)
    ((0.0, 2.0), (5.0, 6.0))
    """
    by_length = sorted(dict.fromkeys(spans), key=lambda span: span[0] - span[1])
    return tuple(sorted(by_length[:most]))


def _of_card(card: Card, review: Review, models: Mapping[str, BriefModel]) -> Intervals:
    """The spans that show an answer: moments where it is about these, maneuvers of models, or the flights."""
    if card.state == "cannot" and not card.number:
        return ()
    if card.key == "models":
        return longest(span for model in models.values() for span in model.evidence)
    lost = review.control
    if card.state == "look" and lost is not None and lost.lost_at_s is not None and card.key in ("motors", "power"):
        of_loss = (card.key == "power") == (lost.cause == "power lost")
        if of_loss:
            return ((lost.lost_at_s, max(lost.lost_at_s, lost.stop_s)),)
    if card.key == "motors" and card.state == "look" and review.motors.events:
        return longest((event, event) for event in review.motors.events)
    return longest(review.flight.flights)


def _parts(review: Review) -> dict[str, BriefNumbers]:
    """Numbers by part of the review; what cards judge by comes first, of parts and of numbers."""
    flight = review.flight
    numbers = measures(review)
    if flight.thrust_to_weight is not None:
        numbers["flight.thrust_to_weight"] = flight.thrust_to_weight
    others = {
        "wind": flight.wind,
        "drag": flight.drag,
        **{f"tracking.{name}": found.numbers for name, found in review.tracking.items()},
    }
    numbers |= {f"{part}.{name}": quantity for part, group in others.items() for name, quantity in group.items()}
    parts: dict[str, dict[str, Quantity]] = {}
    for path, quantity in sorted(numbers.items(), key=lambda entry: not _judged(entry[0])):
        part, _, name = path.rpartition(".")
        parts.setdefault(part, {})[name] = quantity
    evidence = longest(flight.flights)
    by_model = {f"margins.{axis}": margin.by_model for axis, margin in review.margins.items()}
    return {
        part: BriefNumbers(numbers=group, evidence=evidence, by_model=by_model.get(part, ()))
        for part, group in parts.items()
    }


def _judged(path: str) -> bool:
    """Whether a card judges by a number."""
    row = figure(path.rpartition(".")[2])
    return row is not None and bool(row.card)


def _models(review: Review) -> dict[str, BriefModel]:
    ordered = sorted(review.models.items(), key=lambda entry: isinstance(entry[1], Refused))
    return {name: _model(model) for name, model in ordered}


def _model(model: IdentifiedModel | Refused) -> BriefModel:
    if isinstance(model, Refused):
        return BriefModel(verdict=verdict(model), parameters={}, evidence=())
    kept = {name: value for name, value in model.parameters.items() if value.status != "dropped"}
    spans = ((maneuver.start_s, maneuver.stop_s) for maneuver in model.provenance.maneuvers)
    return BriefModel(verdict=verdict(model), parameters=kept, evidence=longest(spans))


def _findings(findings: Sequence[Finding]) -> tuple[BriefFinding, ...]:
    """Each kind of finding by its first, with the moments and spans that all of its kind name."""
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.severity, finding.kind), []).append(finding)
    return tuple(
        BriefFinding(finding=same[0], count=len(same), evidence=longest(span for each in same for span in _named(each)))
        for same in kinds.values()
    )


def _named(finding: Finding) -> Intervals:
    """The span or the moment of the log that a finding names in its numbers."""
    numbers = finding.numbers
    if {"start_s", "stop_s"} <= numbers.keys() and numbers["start_s"] <= numbers["stop_s"]:
        return ((numbers["start_s"], numbers["stop_s"]),)
    return tuple((numbers[name], numbers[name]) for name in _AT if name in numbers)
