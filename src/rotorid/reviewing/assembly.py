"""The review of an ordinary flight in one call: each part is independent, and lists what it could not measure."""

from __future__ import annotations

import logging as logs
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeVar, Unpack, overload

from rotorid.autopilots.advice import flying_advice, logging_advice
from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.data.trust import RICH_KINDS
from rotorid.flights.agreement import channel_agreement
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.oscillations import (
    OscillationReview,
    describe,
    limits_shown,
    motors_limited,
    oscillation_findings,
    reviewed_oscillations,
)
from rotorid.flights.supports import END_FIRST, foreign_vehicle, rate_support, supports
from rotorid.flights.whole_flights import FlightData, flown
from rotorid.flying.next_steps import KnownOfLog, LoopChannels, next_steps
from rotorid.identifying.identify_many import identify_several
from rotorid.io.records import as_record, as_records
from rotorid.loops.filter_choice import FilterProposal
from rotorid.models.families import RATE_AXIS
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.reviewing.baseline import baseline_of, with_baseline
from rotorid.reviewing.filters import filters
from rotorid.reviewing.flight import flight, logging, vehicle
from rotorid.reviewing.inspection import foreseen
from rotorid.reviewing.loops import loops
from rotorid.reviewing.margins import margins
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.motors import motors
from rotorid.reviewing.noise import noise
from rotorid.reviewing.settings import ReviewSettings
from rotorid.reviewing.tracking import tracking
from rotorid.reviewing.values import (
    FlightSummary,
    LoggingReview,
    LoopReview,
    MarginReview,
    MotorReview,
    NoiseReview,
    Review,
    TrackingReview,
    VehicleReview,
)
from rotorid.settings.option import as_settings
from rotorid.settings.verbs import with_verbs
from rotorid.signal.airborne import control_of, not_flown
from rotorid.signal.bench import is_bench
from rotorid.signal.control import Control, shows_control
from rotorid.signal.dead_sensors import CHECK_SENSORS, dead_gyro, dead_sensor_findings
from rotorid.signal.oscillations import check_oscillations
from rotorid.typing import Axis

if TYPE_CHECKING:
    from rotorid.settings.option_types import ReviewOptions

_PROGRESS = logs.getLogger("rotorid.progress")
_OF_GYRO = ("oscillations", "loops", "tracking", "margins")
_STEPS = ("flight", "logging", "oscillations", "loops", "margins", "noise", "motors", "models")


Part = TypeVar("Part")


@overload
def review(  # type: ignore[overload-overlap]  # a text is a file, not a sequence of texts
    records: FlightRecord | str | Path, *, settings: ReviewSettings | None = None, **options: Unpack[ReviewOptions]
) -> Review: ...
@overload
def review(
    records: Sequence[FlightRecord | str | Path],
    *,
    settings: ReviewSettings | None = None,
    **options: Unpack[ReviewOptions],
) -> tuple[Review, ...]: ...
def review(
    records: FlightRecord | str | Path | Sequence[FlightRecord | str | Path],
    *,
    settings: ReviewSettings | None = None,
    **options: Unpack[ReviewOptions],
) -> Review | tuple[Review, ...]:
    """Review ordinary flights: loops, margins, models, noise, motors, and what the logs do not show.

    No test flight is needed: stick motion is enough to measure the loops, with intervals.

    Parameters
    ----------
    records
        A log or its file; several give a review each.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.reviewing.settings.ReviewSettings`, which go before ``settings``.

    Returns
    -------
    Review or tuple of Review
        One for each log. A number that was not measured is absent, and ``cannot_tell`` says why.

    Raises
    ------
    LogError
        A file cannot be read.
    UsageError
        The folder of earlier flights holds no log.

    Examples
    --------
    >>> import rotorid
    >>> reviewed = rotorid.review("flight.ulg")  # doctest: +SKIP
    >>> reviewed.loops["p"].numbers["rise_time_s"].value  # doctest: +SKIP
    0.031
    """
    chosen = as_settings(ReviewSettings, settings, options)
    if isinstance(records, FlightRecord | str | Path):
        return _compared(as_record(records), chosen)
    return tuple(_compared(record, chosen) for record in as_records(records))


def _compared(record: FlightRecord, chosen: ReviewSettings) -> Review:
    """The review of a log, beside its earlier flights where these were given."""
    reviewed = _review(record, models=chosen.models, known=chosen.known)
    if chosen.baseline is None:
        return reviewed

    def earlier(one: FlightRecord) -> Review:
        _PROGRESS.info(f"reviewing {one.source.name}")
        return _review(one, models=False, known=chosen.known)

    return with_baseline(reviewed, baseline_of(record, reviewed, chosen.baseline, earlier))


def has_answers(reviewed: Review) -> bool:
    """Whether a review has any result beyond what the log is."""
    identified = any(isinstance(model, IdentifiedModel) for model in reviewed.models.values())
    parts = (
        reviewed.oscillations,
        reviewed.calm,
        reviewed.loops,
        reviewed.tracking,
        reviewed.margins,
        reviewed.noise.maps,
        reviewed.noise.numbers,
        reviewed.motors.numbers,
        reviewed.flight.battery,
    )
    return bool(reviewed.flight.flights) and (identified or any(parts))


class _Parts:
    """Parts of a review as they are made, each on its own, and what none of them could measure."""

    def __init__(self) -> None:
        self.unavailable: list[Unavailable] = []

    def make(self, what: str, made_by: Callable[[], tuple[Part, Sequence[Unavailable]]], otherwise: Part) -> Part:
        """A part of the review; where there is none, its reason joins the list of what is unavailable."""
        if what in _STEPS:
            _PROGRESS.info(f"reviewing {what}", extra={"done": _STEPS.index(what), "total": len(_STEPS)})
        made, missing = section(what, made_by, otherwise)
        self.unavailable.extend(missing)
        return made

    def remarks(self, what: str, made_by: Callable[[], Sequence[Finding]]) -> Sequence[Finding]:
        """Findings of a part that makes nothing else."""
        none: Sequence[Finding] = ()
        return self.make(what, lambda: (made_by(), ()), none)


class _ByGyro(NamedTuple):
    """What a review measures by the gyro: oscillations first, since a swinging loop shows its limits only."""

    swinging: tuple[OscillationReview, ...] = ()
    calm: tuple[Axis, ...] = ()
    loops: Mapping[str, LoopReview] = MappingProxyType({})
    tracking: Mapping[str, TrackingReview] = MappingProxyType({})
    margins: Mapping[Axis, MarginReview] = MappingProxyType({})

    @property
    def bandwidths_rad_s(self) -> dict[str, float]:
        """Of the loops that have one, by the name of the loop."""
        name = "bandwidth_90deg_rad_s"
        return {loop: found.numbers[name].value for loop, found in self.loops.items() if name in found.numbers}


def _by_gyro(record: FlightRecord, air: FlightData, parts: _Parts) -> _ByGyro:
    none = _ByGyro()
    swinging, calm = parts.make("oscillations", lambda: _oscillations(record), (none.swinging, none.calm))
    return _ByGyro(
        swinging=swinging,
        calm=calm,
        loops=parts.make("loops", lambda: _loops_of(air, swinging), none.loops),
        tracking=parts.make("tracking", lambda: tracking(air), none.tracking),
        margins=parts.make("margins", lambda: _margins_of(air, swinging), none.margins),
    )


def _review(record: FlightRecord, *, models: bool, known: Mapping[str, float]) -> Review:
    parts = _Parts()
    summary = parts.make("flight", lambda: flight(record), FlightSummary(flights=(), seen_in=""))
    logged = parts.make("logging", lambda: logging(record), LoggingReview(rates_hz={}, longest_gap_s=0.0))
    air = parts.make("flight", lambda: (flown(record), ()), None)
    if air is not None and not summary.flights:
        summary = FlightSummary(flights=air.flights, seen_in=air.airborne.seen_in)
    moved, noise_review, worked = _ByGyro(), NoiseReview(), MotorReview()
    better: FilterProposal | None = None
    found: dict[str, IdentifiedModel | Refused] = {}
    still = dead_gyro(record)
    if air is not None and still:
        parts.unavailable += [Unavailable(what=step, why=f"{still}.", remedy=CHECK_SENSORS) for step in _OF_GYRO]
    elif air is not None:
        moved = _by_gyro(record, air, parts)
    if air is not None:
        widths = moved.bandwidths_rad_s
        noise_review = parts.make("noise", lambda: noise(record, bandwidths_rad_s=widths), noise_review)
        if not moved.swinging and not still:
            better = parts.make("filters", lambda: filters(record, moved.margins, parts.unavailable), better)
        worked = parts.make("motors", lambda: motors(record, mass_kg=known.get("m")), worked)
    unknown = VehicleReview(autopilot=record.source.format, firmware=record.source.firmware, kind="", frame="")
    # What the log does not say of the vehicle is a note of ``inspect``.
    kind = parts.make("vehicle", lambda: (vehicle(record)[0], ()), unknown)
    control = parts.make("control", lambda: _control(record, flown=air is not None), None)
    if air is not None and models:
        if motors_limited(moved.swinging):
            parts.unavailable.append(_hidden_by_limits("models", moved.swinging))
        else:
            found = parts.make("models", lambda: _models(record), found)
    summary, parts.unavailable = _with_thrust_of(found, summary, parts.unavailable)
    names: tuple[str, ...] = ()
    unsupported = parts.make("models.supports", lambda: (_unsupported(record, found), ()), names)
    sensors = dead_sensor_findings if air is not None else not_flown
    findings = [
        *(control.findings if control is not None else ()),
        *record.findings,
        *summary.findings,
        *parts.remarks("sensors", lambda: sensors(record)),
        *parts.remarks("controllers", lambda: controller_findings(record)),
        *parts.remarks("oscillations", lambda: oscillation_findings(moved.swinging)),
        *parts.remarks("channels", lambda: channel_agreement(record, summary.flights)),
        *(finding for loop in moved.loops.values() for finding in loop.findings),
        *(finding for margin in moved.margins.values() for finding in margin.findings),
        *noise_review.findings,
        *worked.findings,
    ]
    reviewed = Review(
        name=record.source.name,
        sha256=record.source.sha256,
        vehicle=kind,
        flight=summary,
        logging=logged,
        loops=moved.loops,
        tracking=moved.tracking,
        margins=moved.margins,
        models=found,
        models_sought=models,
        unsupported=unsupported,
        noise=noise_review,
        motors=worked,
        cannot_tell=(),
        next_commands=(),
        oscillations=moved.swinging,
        calm=moved.calm,
        control=control,
        filters=better,
    )
    commands = parts.make("next_commands", lambda: (next_commands(record, reviewed), ()), names)
    return _completed(reviewed, commands, findings, parts.unavailable)


def _completed(
    reviewed: Review, commands: tuple[str, ...], findings: Sequence[Finding], unavailable: Sequence[Unavailable]
) -> Review:
    """A review with what comes last, in its own words: next commands, gaps named once, and findings, worst first."""
    return replace(
        reviewed,
        next_commands=commands,
        cannot_tell=tuple(dict.fromkeys(replace(gap, remedy=with_verbs(gap.remedy, "review")) for gap in unavailable)),
        findings=worst_first([*_in_words_of_review(findings), *_faults(unavailable)]),
    )


def _control(record: FlightRecord, *, flown: bool) -> tuple[Control | None, list[Unavailable]]:
    """Loss of control or an end in the air, and whether the log could have shown one."""
    if not flown or shows_control(record):
        return control_of(record), []
    why = "Neither rates, attitude with set-points nor specific force are logged, so a loss of control does not show."
    missing = tuple(name for name in ("p", "q", "az") if name not in record)
    return control_of(record), [Unavailable(what="control", why=why, remedy=logging_advice(record, 0.0, missing))]


def _in_words_of_review(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Findings of other commands with the names of those commands behind options that ``review`` does not have."""
    for finding in findings:
        message = with_verbs(finding.message, "review")
        yield finding if message == finding.message else replace(finding, message=message)


def _faults(unavailable: Sequence[Unavailable]) -> Iterator[Finding]:
    """A warning for each part that rotorid itself failed to compute: no lack of data explains it."""
    for gap in unavailable:
        if gap.fault:
            yield warn("internal_error", gap.what, f"{gap.why} {capital(gap.remedy)}.")


def _oscillations(
    record: FlightRecord,
) -> tuple[tuple[tuple[OscillationReview, ...], tuple[Axis, ...]], list[Unavailable]]:
    """Axes that swing, axes that do not, and those that could not be checked."""
    check = check_oscillations(record)
    rates = {axis: record.rate_hz(f"{axis}_command") for axis in RATE_OF}
    unavailable = [
        Unavailable(
            what=f"oscillations.{axis}",
            why=why,
            remedy=logging_advice(record, rates[axis], () if rates[axis] else (f"{axis}_command",)),
        )
        for axis, why in check.unchecked.items()
    ]
    return (reviewed_oscillations(record), check.calm), unavailable


def _hidden_by_limits(what: str, swinging: tuple[OscillationReview, ...]) -> Unavailable:
    """What no axis of a flight shows: motors at their limits answer to no command, of a calm axis neither."""
    return Unavailable(what=what, why=limits_shown(swinging), remedy=END_FIRST)


def _loops_of(
    flight: FlightData, swinging: tuple[OscillationReview, ...]
) -> tuple[dict[str, LoopReview], Sequence[Unavailable]]:
    """Loops as flown, unless motors at their limits hide all of them."""
    return ({}, [_hidden_by_limits("loops", swinging)]) if motors_limited(swinging) else loops(flight)


def _margins_of(
    flight: FlightData, swinging: tuple[OscillationReview, ...]
) -> tuple[dict[Axis, MarginReview], Sequence[Unavailable]]:
    """Margins of the axes that do not swing: what a log shows of a swinging loop is its limits, not its plant."""
    if motors_limited(swinging):
        return {}, [_hidden_by_limits("margins", swinging)]
    axes = tuple(oscillation.axis for oscillation in swinging)
    why = f"{describe(swinging)} The log then shows the limits of the loop, not its margins." if axes else ""
    missing = [Unavailable(what=f"margins.{axis}", why=why, remedy=END_FIRST) for axis in axes]
    if len(axes) == len(RATE_OF):
        return {}, missing
    found, unavailable = margins(flight)
    kept = {axis: margin for axis, margin in found.items() if axis not in axes}
    return kept, [*missing, *(gap for gap in unavailable if gap.what.split(".")[1] not in axes)]


def _models(record: FlightRecord) -> tuple[dict[str, IdentifiedModel | Refused], list[Unavailable]]:
    if record.status.foreign:
        return {}, [
            Unavailable(what="models", why=f"{capital(foreign_vehicle(record))}. All models are of multirotors.")
        ]
    several = identify_several(record)
    lacking = {name: rate_support(record, name) for name in RATE_AXIS if name not in several}
    unsupported = [
        Unavailable(what=f"models.{name}", why=f"{capital(support.because)}.", remedy=support.remedy)
        for name, support in lacking.items()
    ]
    return dict(several), [*_refusals(several.refused, record), *unsupported]


def _unsupported(record: FlightRecord, found: Mapping[str, IdentifiedModel | Refused]) -> tuple[str, ...]:
    """Models that were refused and could not have been identified, as ``inspect`` answers before any fit."""
    refused = [name for name, answer in found.items() if isinstance(answer, Refused)]
    if not refused:
        return ()
    each = supports(record)
    return tuple(name for name in refused if not foreseen(record, name, each[name]).possible)


def _with_thrust_of(
    found: Mapping[str, IdentifiedModel | Refused], summary: FlightSummary, unavailable: list[Unavailable]
) -> tuple[FlightSummary, list[Unavailable]]:
    """The flight with the full thrust of a model of its motors, where there is one: a usual curve is a guess."""
    for model in found.values():
        if isinstance(model, IdentifiedModel) and model.motors is not None:
            ratio = model.motors.derived.get("thrust_to_weight")
            if ratio is not None and math.isfinite(ratio.value) and math.isfinite(ratio.std):
                quantity = Quantity.normal(ratio.value, ratio.std, "1")
                missing = [gap for gap in unavailable if gap.what != "flight.thrust_to_weight"]
                return replace(summary, thrust_to_weight=quantity), missing
    return summary, unavailable


def next_commands(record: FlightRecord, reviewed: Review) -> tuple[str, ...]:
    """The commands that lead on from here, for this very log."""
    identified = {name: model for name, model in reviewed.models.items() if isinstance(model, IdentifiedModel)}
    # A bench has nothing to review; its models are the answer.
    of_bench = [name for name, found in supports(record).items() if found.possible] if is_bench(record) else []
    known = KnownOfLog(record=record, models=(*identified, *of_bench), identified=tuple(identified.values()))
    if not reviewed.oscillations:
        # A log that swings shows the limits of its loops, and a sweep on top of them would not be a safe flight.
        loop = next(iter(reviewed.loops.values()), None)
        wanted = reviewed.models_sought and reviewed.flight.flights and reviewed.vehicle.kind in ("", "multirotor")
        known = replace(
            known,
            loop=None
            if loop is None
            else LoopChannels(reference=loop.reference, answer=loop.answer, direct=loop.instrument == "direct"),
            tunes=bool(record.parameters)
            and any(
                maneuver.kind in RICH_KINDS
                for name in RATE_AXIS.keys() & identified.keys()
                for maneuver in identified[name].provenance.maneuvers
            ),
            wanted_axes=tuple(axis for name, axis in RATE_AXIS.items() if name not in identified) if wanted else (),
        )
    return tuple(next_steps(known))


def _refusals(refused: dict[str, Refused], record: FlightRecord) -> Iterator[Unavailable]:
    for name, answer in refused.items():
        reasons = [finding.message for finding in answer.findings if finding.severity == "error"]
        axis = RATE_AXIS.get(name)
        short = {finding.kind for finding in answer.findings} & {"no_excitation", "low_coherence"}
        remedy = flying_advice(record, axis) if axis and short else ""
        yield Unavailable(
            what=f"models.{name}", why=reasons[0] if reasons else "The data cannot support it.", remedy=remedy
        )
