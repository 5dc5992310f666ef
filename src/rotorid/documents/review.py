"""``review.json``, schema ``rotorid.review/1``: the review of an ordinary flight, and its arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, create_model, model_serializer

from rotorid.data.display import capital, counted
from rotorid.data.quantities import Part, figures_of
from rotorid.documents.base import Document, FindingDocument, Shown, ShownDocument
from rotorid.documents.filters import FilterDocument, filter_documents
from rotorid.documents.result import ResultDocument, refused_document, result_document
from rotorid.documents.verdict import VerdictDocument, verdict_document
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import finite
from rotorid.reviewing.cards import cards
from rotorid.typing import Axis
from rotorid.uncertainty.differences import Verdict

if TYPE_CHECKING:
    from rotorid.data.quantity import Quantity
    from rotorid.flights.oscillations import OscillationReview
    from rotorid.reviewing.values import BaselineReview, LoopReview, MarginReview, Review


class QuantityDocument(Document):
    """A number with its error: one standard deviation, and an interval of 95 %."""

    value: float
    std: float | None
    lower: float | None
    upper: float | None
    unit: str


def quantity_documents(quantities: Mapping[str, Quantity]) -> dict[str, Any]:
    """Numbers with their intervals, by name."""
    return {name: QuantityDocument.model_validate(quantity) for name, quantity in quantities.items()}


def bounded_document(quantity: Quantity) -> QuantityDocument:
    """A number whose unknown ends are ``None``."""
    return QuantityDocument(
        value=quantity.value,
        std=finite(quantity.std),
        lower=finite(quantity.lower),
        upper=finite(quantity.upper),
        unit=quantity.unit,
    )


class _OmitsUnavailable(Document):
    """A part without the numbers that were not measured."""

    @model_serializer(mode="wrap")
    def _without_gaps(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = serialize(self)
        return {name: value for name, value in written.items() if value is not None}


class _Loop(_OmitsUnavailable):
    reference: str
    answer: str
    estimate: Literal["direct", "joint"]
    instrument: str
    band_rad_s: tuple[float, float]


class _Tracking(_OmitsUnavailable):
    reference: str
    answer: str
    rate_hz: float


class _Margin(_OmitsUnavailable):
    instrument: str


if TYPE_CHECKING:

    class _LoopFigures(_Loop):
        def __getattr__(self, name: str) -> QuantityDocument | None: ...

    class _TrackingFigures(_Tracking):
        def __getattr__(self, name: str) -> QuantityDocument | None: ...

    class _MarginFigures(_Margin):
        def __getattr__(self, name: str) -> QuantityDocument | None: ...

else:

    def _with_figures(base: type[Document], part: Part) -> type[Document]:
        """A document with a field for each figure of a part of the review."""
        fields = dict.fromkeys(figures_of(part), (QuantityDocument | None, None))
        return create_model(f"{base.__name__}Figures", __base__=base, __module__=__name__, **fields)

    _LoopFigures, _MarginFigures = _with_figures(_Loop, "loops"), _with_figures(_Margin, "margins")
    _TrackingFigures = _with_figures(_Tracking, "tracking")


class LoopReviewDocument(_LoopFigures):
    """A closed loop as it was flown."""

    by_size: dict[str, dict[str, QuantityDocument]] = Field(default_factory=dict)


class TrackingReviewDocument(_TrackingFigures):
    """How a set-point was followed in this flight, whoever made it."""


class MarginReviewDocument(_MarginFigures):
    """The broken rate loop of an axis as it was flown; ``verdict`` is that on its gains, with the angle loop too."""

    by_model: list[str] = Field(default_factory=list)
    verdict: VerdictDocument | None = None
    ends: dict[str, dict[str, QuantityDocument]] = Field(default_factory=dict)
    throttle: float | None = None
    explained: float | None = None


class GainChangeDocument(Document):
    """A parameter as flown, and as proposed for the next flight."""

    flown: float
    proposed: float


class OscillationDocument(Document):
    """An axis that oscillates: how fast, how much of its range the command uses, and what to change."""

    axis: Axis
    loop: Literal["rate", "attitude"]
    frequency_hz: float | None
    rms: float
    at_limit_percent: float | None
    error_rms_rad: float | None = None
    gains: dict[str, GainChangeDocument] = Field(default_factory=dict)


class VehicleReviewDocument(Document):
    """What flew."""

    autopilot: str
    firmware: str
    kind: str
    frame: str
    motors: int | None = None


class FlightReviewDocument(Document):
    """An interval in the air."""

    start_s: float
    stop_s: float


class PeakDocument(Document):
    """A line in the noise, and its cause."""

    channel: str
    frequency_hz: QuantityDocument
    height_db: float
    source: Literal["rotor", "frame", "unknown"]
    harmonic: int | None = None
    sentence: str = ""


class NoiseReviewDocument(Document):
    """Noise of the sensors, and noise at the motors."""

    peaks: list[PeakDocument] = Field(default_factory=list)
    numbers: dict[str, QuantityDocument] = Field(default_factory=dict)


class MotorReviewDocument(Document):
    """Motors: limits, balance, headroom."""

    means: dict[str, QuantityDocument] = Field(default_factory=dict)
    numbers: dict[str, QuantityDocument] = Field(default_factory=dict)
    pattern: str = ""
    events: list[float] = Field(default_factory=list)


class LoggingReviewDocument(Document):
    """Rates by channel, the longest gap, and what to change."""

    rates_hz: dict[str, float]
    longest_gap_s: float
    change: list[str] = Field(default_factory=list)


class UnavailableDocument(Document):
    """What was not measured, what was missing, and what would measure it."""

    what: str
    why: str
    remedy: str = ""


class ControlDocument(Document):
    """When and why control was lost, both null where it was kept, and whether the log ends before a landing.

    Null as a whole where neither was seen; ``cannot_tell`` names ``control`` where the log could not have shown it.
    """

    lost_at_s: float | None
    cause: str | None
    ends_in_air: bool


class LeftOutDocument(Document):
    """A log of the folder of earlier flights that was not used, and why."""

    log: str
    why: str


class BalanceChangeDocument(Document):
    """The balance of the motors compared with earlier flights.

    ``outputs`` is the relative change of each motor's output against the mean of all, ``rise`` that of ``motor`` alone.
    """

    verdict: Verdict
    probability: float
    motor: int | None
    patterns: list[str]
    usual: str
    outputs: dict[str, QuantityDocument]
    rise: QuantityDocument | None
    detectable_share: float | None
    flights: int


class FigureChangeDocument(Document):
    """A figure compared with earlier flights; ``expected`` is where it lies if nothing changed."""

    verdict: Verdict
    now: QuantityDocument
    expected: QuantityDocument | None
    flights: int
    share: float | None
    probability: float
    detectable_share: float | None


class BaselineDocument(Document):
    """The health of a flight compared with earlier flights of the vehicle.

    ``figures`` are named by their place in this document. Of a hundred flights in which nothing changed, one at most is
    ``changed``.
    """

    verdict: Verdict
    flights: list[str]
    left_out: list[LeftOutDocument] = Field(default_factory=list)
    sentences: list[str] = Field(default_factory=list)
    balance: BalanceChangeDocument | None = None
    figures: dict[str, FigureChangeDocument] = Field(default_factory=dict)


class CardDocument(Document):
    """An answer of the first screen."""

    key: str
    title: str
    state: Literal["good", "look", "part", "cannot"]
    word: str
    color: Literal["green", "yellow", "red", "gray"]
    number: str
    sentence: str


class ReviewDocument(ShownDocument):
    """``review.json``: the review of one ordinary flight."""

    schema_name: Annotated[Literal["rotorid.review/1"], Field(alias="schema")] = "rotorid.review/1"
    name: str
    sha256: str
    cards: list[CardDocument] = Field(default_factory=list)
    vehicle: VehicleReviewDocument
    flights: list[FlightReviewDocument]
    seen_in: str = ""
    control: ControlDocument | None = None
    modes: dict[str, float] = Field(default_factory=dict)
    battery: dict[str, QuantityDocument] = Field(default_factory=dict)
    hover_throttle: QuantityDocument | None = None
    thrust_to_weight: QuantityDocument | None = None
    wind: dict[str, QuantityDocument] = Field(default_factory=dict)
    drag: dict[str, QuantityDocument] = Field(default_factory=dict)
    yaw: dict[str, QuantityDocument] = Field(default_factory=dict)
    logging: LoggingReviewDocument
    oscillations: list[OscillationDocument] = Field(default_factory=list)
    loops: dict[str, LoopReviewDocument] = Field(default_factory=dict)
    tracking: dict[str, TrackingReviewDocument] = Field(default_factory=dict)
    margins: dict[str, MarginReviewDocument] = Field(default_factory=dict)
    models: dict[str, ResultDocument] = Field(default_factory=dict)
    noise: NoiseReviewDocument
    motors: MotorReviewDocument
    cannot_tell: list[UnavailableDocument] = Field(default_factory=list)
    next_commands: list[str] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    baseline: BaselineDocument | None = None
    filters: dict[str, FilterDocument] = Field(default_factory=dict)

    def shown(self) -> Shown:
        """The cards, warnings and next commands."""
        craft = ", ".join(
            part for part in (self.vehicle.frame, self.vehicle.firmware or self.vehicle.autopilot) if part
        )
        airborne_s = sum(flight.stop_s - flight.start_s for flight in self.flights)
        rows = [
            (card.word, f"{card.title} {card.sentence}{f' {capital(card.number)}.' if card.number else ''}")
            for card in self.cards
        ]
        rows += [(finding.severity, finding.message) for finding in self.findings if finding.severity != "info"]
        return Shown(
            f"{self.name}: {craft or 'unknown vehicle'}, {counted(len(self.flights), 'flight')}, {airborne_s:.0f} s",
            ("state", "answer"),
            [*rows, *(("next", command) for command in self.next_commands)],
        )

    @model_serializer(mode="wrap")
    def _refusals_without_parameters(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = serialize(self)
        for result in written["models"].values():
            if not result["parameters"]:
                del result["parameters"]
        return {name: value for name, value in written.items() if value is not None or name == "control"}


class ReviewsDocument(Document):
    """Several logs side by side, in the order in which they were given."""

    schema_name: Annotated[Literal["rotorid.reviews/1"], Field(alias="schema")] = "rotorid.reviews/1"
    reviews: list[ReviewDocument]


def review_document(review: Review) -> ReviewDocument:
    """A review as ``review.json`` holds it."""
    return ReviewDocument(
        name=review.name,
        sha256=review.sha256,
        cards=[CardDocument.model_validate(card) for card in cards(review)],
        vehicle=VehicleReviewDocument.model_validate(review.vehicle),
        flights=[FlightReviewDocument(start_s=start_s, stop_s=stop_s) for start_s, stop_s in review.flight.flights],
        seen_in=review.flight.seen_in,
        control=control_document(review),
        modes=dict(review.flight.modes),
        battery=quantity_documents(review.flight.battery),
        hover_throttle=_number(review.flight.hover_throttle),
        thrust_to_weight=_number(review.flight.thrust_to_weight),
        wind=quantity_documents(review.flight.wind),
        drag=quantity_documents(review.flight.drag),
        yaw=quantity_documents(review.flight.yaw),
        logging=LoggingReviewDocument(
            rates_hz=dict(review.logging.rates_hz),
            longest_gap_s=review.logging.longest_gap_s,
            change=list(review.logging.change),
        ),
        oscillations=[_oscillation(oscillation) for oscillation in review.oscillations],
        loops={name: _loop(loop) for name, loop in review.loops.items()},
        tracking={
            name: TrackingReviewDocument(
                reference=found.reference,
                answer=found.answer,
                rate_hz=found.rate_hz,
                **quantity_documents(found.numbers),
            )
            for name, found in review.tracking.items()
        },
        margins={axis: _margin(margin) for axis, margin in review.margins.items()},
        models={
            name: result_document(model) if isinstance(model, IdentifiedModel) else refused_document(model)
            for name, model in review.models.items()
        },
        filters=filter_documents(review.filters),
        noise=NoiseReviewDocument(
            peaks=[PeakDocument.model_validate(peak) for peak in review.noise.peaks],
            numbers=quantity_documents(review.noise.numbers),
        ),
        motors=MotorReviewDocument(
            means=quantity_documents(review.motors.means),
            numbers=quantity_documents(review.motors.numbers),
            pattern=review.motors.pattern,
            events=list(review.motors.events),
        ),
        cannot_tell=[UnavailableDocument.model_validate(gap) for gap in review.cannot_tell],
        next_commands=list(review.next_commands),
        findings=[FindingDocument.model_validate(finding) for finding in review.findings],
        baseline=None if review.baseline is None else _baseline(review.baseline),
    )


def _baseline(baseline: BaselineReview) -> BaselineDocument:
    balance = baseline.balance
    return BaselineDocument(
        verdict=baseline.verdict,
        flights=list(baseline.flights),
        left_out=[LeftOutDocument.model_validate(log) for log in baseline.left_out],
        sentences=list(baseline.sentences),
        balance=None
        if balance is None
        else BalanceChangeDocument(
            verdict=balance.verdict,
            probability=balance.probability,
            motor=balance.motor,
            patterns=list(balance.patterns),
            usual=balance.usual,
            outputs={f"motor_{number}": bounded_document(change) for number, change in balance.outputs.items()},
            rise=None if balance.rise is None else bounded_document(balance.rise),
            detectable_share=finite(balance.detectable),
            flights=balance.flights,
        ),
        figures={
            path: FigureChangeDocument(
                verdict=one.verdict,
                now=bounded_document(one.now),
                expected=None if one.expected is None else bounded_document(one.expected),
                flights=one.flights,
                share=finite(one.share),
                probability=one.probability,
                detectable_share=finite(one.detectable),
            )
            for path, one in baseline.figures.items()
        },
    )


def control_document(review: Review) -> ControlDocument | None:
    """A loss of control or an end in the air; a hard landing is among the findings."""
    found = review.control
    if found is None or (found.lost_at_s is None and not found.ends_in_air):
        return None
    return ControlDocument(lost_at_s=found.lost_at_s, cause=found.cause, ends_in_air=found.ends_in_air)


def _oscillation(found: OscillationReview) -> OscillationDocument:
    return OscillationDocument(
        axis=found.axis,
        loop=found.loop,
        frequency_hz=found.frequency_hz,
        rms=found.rms,
        at_limit_percent=found.at_limit_percent,
        error_rms_rad=found.error_rms_rad,
        gains={name: GainChangeDocument(flown=old, proposed=new) for name, (old, new) in found.gains.items()},
    )


def _loop(loop: LoopReview) -> LoopReviewDocument:
    return LoopReviewDocument(
        reference=loop.reference,
        answer=loop.answer,
        estimate="direct" if loop.instrument in ("direct", "setpoint") else "joint",
        instrument=loop.instrument,
        band_rad_s=loop.band_rad_s,
        by_size={name: quantity_documents(item.numbers) for name, item in loop.by_size.items()},
        **quantity_documents(loop.numbers),
    )


def _margin(margin: MarginReview) -> MarginReviewDocument:
    return MarginReviewDocument(
        instrument=margin.instrument,
        by_model=list(margin.by_model),
        verdict=verdict_document(margin.verdict),
        ends={name: quantity_documents(numbers) for name, numbers in margin.ends.items()},
        throttle=margin.throttle,
        explained=margin.explained,
        **quantity_documents(margin.numbers),
    )


def _number(quantity: Any) -> QuantityDocument | None:
    return None if quantity is None else QuantityDocument.model_validate(quantity)


def review_arrays(review: Review) -> dict[str, np.ndarray]:
    """Arrays of ``review.npz``: step responses, closed and broken loops, spectra and maps; no pickles."""
    arrays: dict[str, np.ndarray] = {}
    for name, loop in review.loops.items():
        arrays |= _response(f"loop_{name}", loop.response.omega_rad_s, loop.response)
        if loop.step is not None:
            for column in ("time_s", "value", "lower", "upper"):
                arrays[f"step_{name}_{column}"] = getattr(loop.step, column)
    for name, found in review.tracking.items():
        for column in ("time_s", "reference", "answer"):
            arrays[f"trace_{name}_{column}"] = getattr(found.trace, column)
    for axis, margin in review.margins.items():
        arrays |= _response(f"broken_{axis}", margin.loop.omega_rad_s, margin.loop)
    for number, noise_map in enumerate(review.noise.maps):
        key = f"noise_{noise_map.channel}_{noise_map.stage}_{number}"
        for column in ("level", "frequency_hz", "density", "windows", "average"):
            arrays[f"{key}_{column}"] = getattr(noise_map, column)
    return arrays


def _response(key: str, omega_rad_s: np.ndarray, response: Any) -> dict[str, np.ndarray]:
    return {
        f"{key}_omega_rad_s": omega_rad_s,
        f"{key}_values": response.values[0, 0],
        f"{key}_random_error": response.random_error[0, 0],
        f"{key}_coherence": response.coherence[0, 0],
    }
