"""What a log contains, and which models it supports.

Channels with their rates and gaps, flights and excitations, whether sensors and clocks agree, the battery; and for each
rate model what it needs, what the log has, and what to change where it cannot be identified.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import capital, html_table, lines_of
from rotorid.data.findings import Finding, remark, warn, worst_first
from rotorid.data.record import AXES, Channel, FlightRecord, Maneuver, Topic
from rotorid.errors import FaultError, InsufficientDataError, reason_of
from rotorid.flights.agreement import channel_agreement
from rotorid.flights.consistency import ChannelSkew, Consistency, check_consistency, stretches
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.motor_stamps import stamp_findings
from rotorid.flights.rotor_order import order_of_log
from rotorid.flights.supports import Support, dwells_in, never_flown, ordinary_flights, segment_of, supports
from rotorid.flying.next_steps import KnownOfLog, next_steps
from rotorid.io.records import as_record
from rotorid.models.families import RATE_AXIS, family_of, rate_model_of
from rotorid.models.library import response_pairs
from rotorid.results.provenance import LoggedManeuver, logged
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verbs import with_verbs
from rotorid.signal.airborne import Airborne, airborne, evidence_words, not_flown
from rotorid.signal.battery import battery_voltages
from rotorid.signal.dead_sensors import dead_sensor_findings
from rotorid.signal.excitations import (
    candidate_excitations,
    find_excitations,
    still_declarations,
)
from rotorid.signal.kinematics import KinematicCheck
from rotorid.signal.motors import motor_limits
from rotorid.typing import Axis, FloatArray, IntArray

_GAP_STEPS = 2.5

_SETTINGS = (
    *("LOG_BITMASK", "SCHED_LOOP_RATE", "INS_GYRO_FILTER", "INS_ACCEL_FILTER", "MOT_THST_EXPO", "FRAME_CLASS"),
    *("FRAME_TYPE", "ATC_RAT_RLL_P", "ATC_RAT_PIT_P", "ATC_RAT_YAW_P", "SID_AXIS", "SID_MAGNITUDE"),
    *("SDLOG_PROFILE", "IMU_INTEG_RATE", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "IMU_ACCEL_CUTOFF", "THR_MDL_FAC"),
    *("CA_AIRFRAME", "MC_ROLLRATE_P", "MC_PITCHRATE_P", "MC_YAWRATE_P"),
)
"""Parameters of the autopilot that decide what is logged, filtered and fed back: the first ones to look at."""


@dataclass(frozen=True, kw_only=True)
class LoggedChannel(Immutable):
    """A channel in one topic: the same channel may be in several.

    Parameters
    ----------
    name, unit, source
        As in :class:`rotorid.data.record.Channel`.
    topic
        Its topic.
    rate_hz
        Usual rate of the topic.
    samples
        How many there are.
    start_s, stop_s
        First and last stamp on the log's own clock; ``None`` without samples.
    gaps
        Steps of more than 2.5 usual ones.
    longest_gap_s
        The longest of them; zero where there is none.
    """

    name: str
    unit: str
    source: str
    topic: str
    rate_hz: float
    samples: int
    start_s: float | None
    stop_s: float | None
    gaps: int
    longest_gap_s: float


@dataclass(frozen=True, kw_only=True)
class CandidateManeuver(LoggedManeuver):
    """A stretch that moves an axis enough to try; its fields are those of a maneuver."""

    @property
    def segment(self) -> str:
        """The value of ``--segment`` that takes it."""
        return segment_of(self.axis, self.start_s, self.stop_s)


@dataclass(frozen=True, kw_only=True)
class FlightInterval(Immutable):
    """An interval in the air, on the log's own clock, and what showed it."""

    start_s: float
    stop_s: float
    seen_in: str


@dataclass(frozen=True, kw_only=True)
class TimedCheck(KinematicCheck):
    """A sensor against the motion that attitude or velocities give, and the interval over which it was compared."""

    start_s: float
    stop_s: float


@dataclass(frozen=True, kw_only=True)
class Battery(Immutable):
    """Voltage of the battery at both ends of the flights, of the log where it never flew, and the lowest."""

    start_v: float
    stop_v: float
    lowest_v: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspection(Immutable):
    """Answer of :func:`inspect`.

    Parameters
    ----------
    name, format, firmware, sha256
        Of the log.
    start_s, stop_s
        First and last stamp on its own clock.
    parameters
        Number of logged parameters of the autopilot.
    channels
        Every channel of every topic.
    excitations
        Maneuvers that were declared or found, in order of time.
    supports
        Name of each rate model to whether the log supports it.
    findings
        Remarks, the grave ones first.
    candidates
        Stretches that may have been meant as excitations.
    flights
        Intervals in the air.
    kinematics
        Sensors against the kinematics.
    skews
        How far signals come after each other.
    battery
        Voltages, where they were logged.
    settings
        Parameters of the autopilot that decide what is logged, filtered and fed back.
    vehicle
        Kind of vehicle as the log says, such as ``multirotor`` or ``plane``; empty where it does not.
    next_commands
        Commands that lead on from here; none where the log contains no flight.
    """

    name: str
    format: str
    firmware: str
    sha256: str
    start_s: float
    stop_s: float
    parameters: int
    channels: tuple[LoggedChannel, ...]
    excitations: tuple[LoggedManeuver, ...]
    supports: Mapping[str, Support]
    findings: tuple[Finding, ...]
    candidates: tuple[CandidateManeuver, ...] = ()
    flights: tuple[FlightInterval, ...] = ()
    kinematics: tuple[TimedCheck, ...] = ()
    skews: tuple[ChannelSkew, ...] = ()
    battery: Battery | None = None
    settings: Mapping[str, float] = field(default_factory=dict)
    vehicle: str = ""
    next_commands: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(supports=self.supports, settings=self.settings)

    def __repr__(self) -> str:
        return lines_of(self._heading, list(self._rows()))

    def _repr_html_(self) -> str:
        return html_table(self._heading, ("what", "which", "says"), self._rows())

    @property
    def _heading(self) -> str:
        firmware = f", {self.firmware}" if self.firmware else ""
        names = len({channel.name for channel in self.channels})
        return f"{self.name}: {self.format}{firmware}, {self.start_s:.2f} to {self.stop_s:.2f} s, {names} channels"

    def _rows(self) -> Iterator[tuple[str, str, str]]:
        """Rows of what can be identified, of what was flown, and of findings."""
        for model, support in self.supports.items():
            yield model, "yes" if support.possible else "no", support.because
        for flight in self.flights:
            yield "in the air", f"{flight.start_s:.1f} to {flight.stop_s:.1f} s", evidence_words(flight.seen_in)
        for maneuver in (*self.excitations, *self.candidates):
            origin = "candidate" if isinstance(maneuver, CandidateManeuver) else maneuver.origin
            interval = f"{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s"
            yield f"{maneuver.axis} {maneuver.kind}", interval, f"{origin} in {maneuver.signal}"
        for finding in self.findings:
            yield f"{finding.severity} {finding.kind}", finding.where, finding.message


def inspect(record: FlightRecord | str | Path) -> Inspection:
    """Contents and use of a record: channels, rates, gaps, flights, excitations, consistency, models it supports.

    Parameters
    ----------
    record
        A log as :func:`rotorid.read` gives it, or its file.

    Returns
    -------
    Inspection
        What ``rotorid inspect`` shows. A model counts as supported when its channels are logged and its axis was
        excited, or flown by stick (:mod:`rotorid.flights.supports`); only ``identify`` shows whether it fits.
        Checks that were not possible are among the findings.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> from rotorid.data.record import Source, Topic
    >>> time_s = np.arange(0.0, 1.0, 0.01)
    >>> gyro = Topic(
    ...     name="gyro", time_s=time_s, channels=(Channel(name="p", unit="rad/s"),), values=np.zeros((1, 100))
    ... )
    >>> record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(gyro,))
    >>> inspect(record).supports["rate.roll"].because
    'the log lacks roll_command'
    """
    record = as_record(record)
    found = {axis: find_excitations(record, axis) for axis in AXES}  # type: ignore[arg-type]
    candidates = {axis: _candidates(record, axis) for axis in AXES}  # type: ignore[arg-type]
    flight, remarks = _flight(record)
    try:
        consistency = check_consistency(record, stretches(record, _in_time(*found.values()), flight))
    except Exception as error:
        # A part that fails leaves its reason, and all others as they are.
        consistency = Consistency(findings=(_failed(error, "consistency"),))
    inspection = Inspection(
        name=record.source.name,
        format=record.source.format,
        firmware=record.source.firmware,
        sha256=record.source.sha256,
        start_s=record.start_s,
        stop_s=record.stop_s,
        parameters=len(record.parameters),
        channels=tuple(channel for topic in record.topics for channel in _channels(topic)),
        excitations=tuple(logged(record, maneuver) for maneuver in _in_time(*found.values())),
        supports={
            name: _in_words_of_inspect(foreseen(record, name, support)) for name, support in supports(record).items()
        },
        findings=worst_first(
            (
                *(flight.control.findings if flight is not None and flight.control is not None else ()),
                *record.findings,
                *_alone("controllers", lambda: controller_findings(record)),
                *_alone("excitations", lambda: _still(record)),
                *remarks,
                *_alone("oscillations", lambda: _oscillations(record, flight)),
                *_alone("motors", lambda: motor_limits(record).remarks()),
                *_alone("motors.rotor_order", lambda: _order(record, flight)),
                *_alone("motors.stamps", lambda: stamp_findings(record) if flight is not None else ()),
                *_alone("channels", lambda: channel_agreement(record, flight.intervals if flight else ())),
                *consistency.findings,
            )
        ),
        vehicle=record.status.vehicle,
        candidates=tuple(logged(record, maneuver, CandidateManeuver) for maneuver in _in_time(*candidates.values())),
        flights=_flights(flight) if flight else (),
        kinematics=tuple(
            TimedCheck(start_s=stretch.start_s, stop_s=stretch.stop_s, **vars(check))
            for stretch, check in consistency.checks
        ),
        skews=consistency.skews,
        battery=_battery(record, flight),
        settings={name: record.parameters[name] for name in _SETTINGS if name in record.parameters},
    )
    return replace(inspection, next_commands=_next_commands(record, inspection))


def _candidates(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """Likely excitations, without sines of one frequency, of which no model can be made."""
    dwells = [maneuver for maneuver, _ in dwells_in(record, axis)]
    return tuple(maneuver for maneuver in candidate_excitations(record, axis) if maneuver not in dwells)


def _order(record: FlightRecord, flight: Airborne | None) -> tuple[Finding, ...]:
    """Whether the motors sit and turn as the layout of the log says; nothing of logs without motors or flight."""
    order = order_of_log(record) if flight is not None else None
    return () if order is None else order.findings("motors")


def _next_commands(record: FlightRecord, inspection: Inspection) -> tuple[str, ...]:
    """What the log supports, else a candidate that identify would take, and the review of what was flown."""
    flown = ("excitation", "ordinary flight", "motor speeds")
    models = tuple(name for name, support in inspection.supports.items() if support.possible and support.by in flown)
    open_axes = [axis for axis in AXES if rate_model_of(axis) not in models]
    segment = next(
        (
            (rate_model_of(candidate.axis), candidate.segment)
            for candidate in inspection.candidates
            if candidate.axis in open_axes and _would_identify(inspection, candidate)
        ),
        None,
    )
    if not models and segment is None and (answers := answering_model(inspection)):
        models = (answers,)
    known = KnownOfLog(record=record, models=models, segment=segment, reviewed=not inspection.flights)
    return tuple(next_steps(known))


def answering_model(inspection: Inspection) -> str:
    """The model of answers to set-points, where each that has an answer moved; empty elsewhere."""
    pairs = response_pairs({channel.name for channel in inspection.channels})
    moved = {maneuver.signal for maneuver in (*inspection.excitations, *inspection.candidates)}
    grounded = any(finding.kind == "never_airborne" for finding in inspection.findings)
    answers = pairs and not grounded and moved.issuperset(setpoint for setpoint, _ in pairs)
    return "response.first_order_delay" if answers else ""


def _would_identify(inspection: Inspection, candidate: CandidateManeuver) -> bool:
    """Whether all that the model of a candidate needs is there, but for the excitation that the candidate may be."""
    support = inspection.supports.get(rate_model_of(candidate.axis))
    return support is not None and all(need.there for need in support.needs if not need.need.startswith("a sweep"))


_MOST_SAMPLES = 1_000_000
"""Samples of ordinary flying up to which its responses are measured here: some seconds of work."""


_OF_LAYOUT = (
    "add --layout quad.x (or quad.plus, hexa.x, …, or a TOML file of [[rotor]] tables) and --arm METERS: "
    "rotorid identify {log} --model {model} --layout quad.x --arm METERS"
)


def foreseen(record: FlightRecord, model: str, support: Support) -> Support:
    """A support, or the refusal with which ``identify`` would end before any fit.

    An excitation shows by itself that it will do. What a stick that flew for something else, several axes together or
    motors show is prepared as for a fit.

    Parameters
    ----------
    model
        Name of the model.
    support
        What :func:`rotorid.flights.supports.supports` answers for it.
    """
    # Preparing a flight through the air is preparing its motors once more, which is done for these.
    if not support.possible or support.by == "flight":
        return support
    if support.by == "excitation" and family_of(model).needs != "axes":
        return support
    if support.by == "ordinary flight":
        flown_s = sum(part.duration_s for part in ordinary_flights(record, RATE_AXIS[model]))
        if flown_s * record.rate_hz(f"{RATE_AXIS[model]}_command") > _MOST_SAMPLES:
            return support
    if support.by == "motors" and (never := never_flown(record)):
        return replace(never, needs=support.needs)
    from rotorid.identifying.families import require_ready

    try:
        require_ready(model, [record], IdentifySettings())
    except Exception as failure:
        # What one model makes of a log ends no other.
        error = reason_of(failure, model)
        findings = error.findings if isinstance(error, InsufficientDataError) else ()
        because, lacks = (findings[0].message, findings[0].kind) if findings else (error.came, "not_identifiable")
        remedy = error.remedy or support.remedy
        if remedy and remedy in because:
            because = because[: because.index(remedy)].rpartition(". ")[0]
        if findings and findings[0].where == "rotor layout":
            remedy = _OF_LAYOUT.format(log=record.source.name, model=model)
        return replace(support, possible=False, because=because.rstrip("."), remedy=remedy, by="", lacks=lacks)
    return support


def _in_words_of_inspect(support: Support) -> Support:
    """A support whose remedy names the command behind an option that ``inspect`` does not have."""
    return replace(support, remedy=with_verbs(support.remedy, "inspect"))


def _alone(what: str, make: Callable[[], Iterable[Finding]]) -> tuple[Finding, ...]:
    """Findings of a part; one that fails leaves its reason, and all others as they are."""
    try:
        return tuple(make())
    except Exception as error:
        return (_failed(error, what),)


def _failed(error: Exception, what: str) -> Finding:
    reason = reason_of(error, what)
    if isinstance(reason, FaultError):
        return warn("internal_error", what, f"{reason.reason} {capital(reason.remedy)}.")
    return remark("part_missing", what, f"{capital(what)} could not be checked: {with_verbs(reason.reason, 'inspect')}")


def coverage(time_s: FloatArray) -> tuple[tuple[float, float], ...]:
    """Stretches without a gap, shape of ``time_s`` ``(samples,)``: steps of more than 2.5 usual ones part them.

    Examples
    --------
    >>> coverage(np.array([0.0, 0.1, 0.2, 0.9, 1.0]))
    ((0.0, 0.2), (0.9, 1.0))
    """
    time_s = time_s[np.isfinite(time_s)]
    if not time_s.size:
        return ()
    breaks = _gaps(time_s)
    starts = np.concatenate([[0], breaks + 1])
    stops = np.concatenate([breaks, [time_s.size - 1]])
    return tuple((float(time_s[a]), float(time_s[b])) for a, b in zip(starts, stops, strict=True))


def _in_time(*groups: Sequence[Maneuver]) -> list[Maneuver]:
    return sorted((maneuver for group in groups for maneuver in group), key=lambda maneuver: maneuver.start_s)


def _flight(record: FlightRecord) -> tuple[Airborne | None, tuple[Finding, ...]]:
    """The flights, or why they are not known: a log from the bench can be inspected too."""
    try:
        found = airborne(record)
    except InsufficientDataError:
        return None, not_flown(record)
    return found, (*found.findings, *dead_sensor_findings(record))


def _oscillations(record: FlightRecord, flight: Airborne | None) -> tuple[Finding, ...]:
    """Axes that swing by themselves: nothing else that such a log shows of its loops can be trusted."""
    from rotorid.flights.oscillations import oscillation_findings, reviewed_oscillations

    return oscillation_findings(reviewed_oscillations(record)) if flight is not None else ()


def _still(record: FlightRecord) -> Iterator[Finding]:
    """What the log declares as excitations, and is none."""
    for maneuver in still_declarations(record):
        interval = f"{maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s"
        message = (
            f"The log declares a {maneuver.axis} {maneuver.kind} from {interval}, but {maneuver.signal} did not move."
        )
        yield warn("no_excitation", f"{maneuver.axis} {interval}", message)


def _flights(flight: Airborne) -> tuple[FlightInterval, ...]:
    return tuple(
        FlightInterval(start_s=start_s, stop_s=stop_s, seen_in=flight.seen_in) for start_s, stop_s in flight.intervals
    )


def _battery(record: FlightRecord, flight: Airborne | None) -> Battery | None:
    volts = battery_voltages(record, flight.intervals if flight else ())
    return Battery(**{name: quantity.value for name, quantity in volts.items()}) if volts else None


def _gaps(time_s: FloatArray) -> IntArray:
    """Index of the last sample before each gap."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if steps.size else 0.0
    return np.flatnonzero(steps > _GAP_STEPS * usual) if usual > 0.0 else np.empty(0, dtype=np.int64)


def _channels(topic: Topic) -> Iterator[LoggedChannel]:
    gaps = np.diff(topic.time_s)[_gaps(topic.time_s)]
    for channel in topic.channels:
        yield _channel(topic, channel, gaps)


def _channel(topic: Topic, channel: Channel, gaps: FloatArray) -> LoggedChannel:
    return LoggedChannel(
        name=channel.name,
        unit=channel.unit,
        source=channel.source,
        topic=topic.name,
        rate_hz=topic.sample_rate_hz,
        samples=topic.time_s.size,
        start_s=float(topic.time_s[0]) if topic.time_s.size else None,
        stop_s=float(topic.time_s[-1]) if topic.time_s.size else None,
        gaps=int(gaps.size),
        longest_gap_s=float(gaps.max()) if gaps.size else 0.0,
    )
