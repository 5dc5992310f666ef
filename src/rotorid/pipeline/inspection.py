"""What a log holds, and which models it can support.

Channels with their rates and gaps, flights and excitations, whether sensors and clocks agree, the battery; and for each
rate model what it needs, what the log has of it, and what to change where it cannot be identified.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import html_table, lines_of
from rotorid.data.findings import Finding, remark, warn, worst_first
from rotorid.data.record import AXES, LOWEST_RATE_HZ, Channel, FlightRecord, Maneuver, Topic
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.screening import LOWEST_TOP_RAD_S
from rotorid.io.advice import flying_advice, logging_advice
from rotorid.models.library import RATE_AXES
from rotorid.pipeline.next_steps import KnownOfLog, next_steps
from rotorid.pipeline.preparation.consistency import ChannelSkew, check_consistency, stretches
from rotorid.pipeline.preparation.controllers import flown_firmware
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import axis_of, find_instrument, own_instrument
from rotorid.pipeline.provenance import LoggedManeuver, logged
from rotorid.signal.airborne import Airborne, airborne, told_by
from rotorid.signal.excitations import (
    candidate_excitations,
    find_excitations,
    motor_excitations,
    rich_excitations,
    still_declarations,
)
from rotorid.signal.kinematics import KinematicCheck
from rotorid.typing import Axis, FloatArray, IntArray

_PerAxis: TypeAlias = Mapping[str, Sequence[Maneuver]]


@dataclass(frozen=True, kw_only=True)
class Need(Immutable):
    """One thing that a model needs.

    Parameters
    ----------
    need
        What it is.
    there
        Whether the log has it.
    found
        What the log has of it.
    """

    need: str
    there: bool
    found: str


@dataclass(frozen=True, kw_only=True)
class Support(Immutable):
    """Whether a model can be identified from a log.

    Parameters
    ----------
    possible
        Whether it can.
    because
        Why, or why not.
    remedy
        What to change where it cannot.
    instrument
        Channel free of feedback that a joint estimate would use.
    needs
        What the model needs, one by one.
    """

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None
    needs: tuple[Need, ...] = ()


def supports(record: FlightRecord, found: _PerAxis, candidates: _PerAxis) -> dict[str, Support]:
    """Name of each rate model, and of each of a rig where single motors were tested, to whether the log supports it.

    Parameters
    ----------
    record
        The log.
    found, candidates
        Axis to excitations, and to stretches that may have been meant as such.
    """
    if record.status.foreign:
        because = f"the vehicle is a {record.status.vehicle}, as {record.status.named_in} says, and no multirotor"
        return {model: Support(possible=False, because=because) for model in RATE_AXES}
    rates = {model: _support(record, axis.input, axis.output, found, candidates) for model, axis in RATE_AXES.items()}
    return rates | _rig_supports(record)


_RIG_MODELS: Mapping[str, tuple[tuple[str, ...], tuple[Axis, ...], tuple[str, ...]]] = {
    "rig.roll": (("motor_3", "motor_4"), ("roll",), ("phi", "p")),
    "rig.attitude": (tuple(f"motor_{n}" for n in range(1, 5)), ("roll", "pitch"), ("phi", "theta", "psi")),
}
"""Inputs of each model of a vehicle on a pivot, the axes that have to be swept, and outputs of which one is enough."""


def _rig_supports(record: FlightRecord) -> dict[str, Support]:
    """Whether a record with test inputs of single motors supports the models of a vehicle on a pivot; else nothing."""
    if not motor_excitations(record):
        return {}
    return {name: _rig_support(record, *needed) for name, needed in _RIG_MODELS.items()}


def _rig_support(record: FlightRecord, motors: Sequence[str], axes: Sequence[Axis], outputs: Sequence[str]) -> Support:
    flights = [Flight(record, m) for axis in axes for m in rich_excitations(record, axis)]
    missing = [name for name in motors if name not in record.channel_names]
    instruments = [name for motor in motors if (name := own_instrument(flights, motor))] if flights else []
    unswept = [axis for axis in axes if not any(flight.axis == axis for flight in flights)]
    seen = [name for name in outputs if name in record.channel_names]
    rate = min((record.rate_hz(name) for name in (*motors, *seen)), default=0.0)
    needs = (
        Need(need=", ".join(motors), there=not missing, found=f"{rate:.3g} Hz" if not missing else "not all logged"),
        Need(need=" or ".join(outputs), there=bool(seen), found=", ".join(seen) or "not logged"),
        Need(
            need=f"single motors swept on {' and '.join(axes)}",
            there=not unswept,
            found=f"{len(flights)} sweep(s)" if flights else "none found",
        ),
        Need(
            need="their test inputs, free of feedback",
            there=len(instruments) == len(motors),
            found=", ".join(instruments) or "none that move",
        ),
    )
    if missing or not seen:
        lacking = missing or [" or ".join(outputs)]
        return Support(possible=False, because=f"the log lacks {' and '.join(lacking)}", needs=needs)
    if unswept:
        return Support(
            possible=False,
            because=f"no sweep of single motors turns the vehicle in {' or '.join(unswept)}",
            remedy="give a second log with it to identify",
            needs=needs,
        )
    free = needs[-1].there
    estimate = f"joint estimate with {', '.join(instruments)}" if free else "direct estimate only; feedback may bias it"
    return Support(
        possible=True,
        because=f"{len(flights)} rich excitation(s), {rate:.0f} Hz, {estimate}",
        instrument=", ".join(instruments) if free else None,
        needs=needs,
    )


def segment_of(axis: str, start_s: float, stop_s: float) -> str:
    """The value of ``--segment`` that takes an interval.

    Examples
    --------
    >>> segment_of("roll", 0.0, 17.5512)
    'roll:0.00:17.55'
    """
    return f"{axis}:{start_s:.2f}:{stop_s:.2f}"


def _support(record: FlightRecord, input: str, output: str, found: _PerAxis, candidates: _PerAxis) -> Support:
    name = axis_of(input)
    rates = {channel: record.rate_hz(channel) for channel in (input, output)}
    rich = rich_excitations(record, name)
    tried = max(candidates[name], key=lambda maneuver: maneuver.duration_s, default=None)
    moved = rich or ([tried] if tried else [])
    instrument = find_instrument([Flight(record, maneuver) for maneuver in moved], name) if moved else None
    verdict = _unlogged(record, rates) or _unflown(record, name, rich, found[name], tried)
    if verdict is None:
        estimate = f"joint estimate with {instrument}" if instrument else "direct estimate only; feedback may bias it"
        because = f"{len(rich)} rich excitation(s), {min(rates.values()):.0f} Hz, {estimate}"
        verdict = Support(possible=True, because=because, instrument=instrument)
    return replace(verdict, needs=_needs(rates, name, rich, instrument))


def _unlogged(record: FlightRecord, rates: Mapping[str, float]) -> Support | None:
    """The refusal of a log that lacks channels, or holds them too slowly."""
    missing = [name for name in rates if name not in record.channel_names]
    advice = logging_advice(record, min(rates.values()), tuple(missing))
    if missing:
        return Support(possible=False, because=f"the log lacks {' and '.join(missing)}", remedy=advice)
    slow = [f"{name} at {rate:.3g} Hz" for name, rate in rates.items() if rate < LOWEST_RATE_HZ]
    if slow:
        because = f"{' and '.join(slow)} is too slow; {LOWEST_RATE_HZ:.0f} Hz is the least"
        return Support(possible=False, because=because, remedy=advice)
    return None


def _unflown(
    record: FlightRecord, axis: Axis, rich: Sequence[Maneuver], found: Sequence[Maneuver], tried: Maneuver | None
) -> Support | None:
    """The refusal of a flight that does not excite an axis, or not fast enough; a candidate is pointed at."""
    if not rich:
        kinds = ", ".join(dict.fromkeys(maneuver.kind for maneuver in found))
        because = (
            f"only short maneuvers ({kinds}) excite this axis" if kinds else "no excitation of this axis was found"
        )
        remedy = flying_advice(record, axis)
        if tried is not None:
            remedy += f", or try --segment {segment_of(axis, tried.start_s, tried.stop_s)}"
        return Support(possible=False, because=because, remedy=remedy)
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s and maneuver.kind == "sweep"]
    if len(tops) == len(rich) and max(tops) < LOWEST_TOP_RAD_S:
        because = f"the sweeps end at {max(tops):.2g} rad/s; a rate model needs {LOWEST_TOP_RAD_S:g} rad/s and more"
        return Support(possible=False, because=because, remedy="fly a sweep that goes faster")
    return None


def _needs(
    rates: Mapping[str, float], axis: Axis, rich: Sequence[Maneuver], instrument: str | None
) -> tuple[Need, ...]:
    """What a rate model needs, each with what the log has of it; without the last, feedback may bias the model."""
    rates_needed = [
        Need(
            need=f"{name} at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=rate >= LOWEST_RATE_HZ,
            found=f"{rate:.3g} Hz" if rate else "not logged",
        )
        for name, rate in rates.items()
    ]
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s]
    reach = f" up to {max(tops):.3g} rad/s" if tops else ""
    flown = ", ".join(dict.fromkeys(maneuver.kind.replace("_", " ") for maneuver in rich))
    return (
        *rates_needed,
        Need(
            need=f"a sweep, multisine or random binary signal on {axis}",
            there=bool(rich),
            found=f"{len(rich)} ({flown}){reach}" if rich else "none found",
        ),
        Need(need="an instrument free of feedback", there=bool(instrument), found=instrument or "none found"),
    )


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
    """A channel in one topic: the same channel may stand in several.

    Parameters
    ----------
    name, unit, source
        As in :class:`rotorid.data.record.Channel`.
    topic
        The topic that holds it.
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
    """Voltage of the battery at both ends of its record, and the lowest in between."""

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
        How many parameters of the autopilot it holds.
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
        Commands that lead on from here; none where the log holds no flight.
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
        """What can be identified comes first, then what was flown, and what to know of it."""
        for model, support in self.supports.items():
            yield model, "yes" if support.possible else "no", support.because
        for flight in self.flights:
            yield "in the air", f"{flight.start_s:.1f} to {flight.stop_s:.1f} s", told_by(flight.seen_in)
        for maneuver in (*self.excitations, *self.candidates):
            origin = "candidate" if isinstance(maneuver, CandidateManeuver) else maneuver.origin
            interval = f"{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s"
            yield f"{maneuver.axis} {maneuver.kind}", interval, f"{origin} in {maneuver.signal}"
        for finding in self.findings:
            yield f"{finding.severity} {finding.kind}", finding.where, finding.message


def inspect(record: FlightRecord) -> Inspection:
    """Say what a record holds: channels, rates, gaps, flights, excitations, whether it agrees with itself, and its use.

    Parameters
    ----------
    record
        A log as :func:`rotorid.read` gives it.

    Returns
    -------
    Inspection
        What ``rotorid inspect`` tells. A model counts as supported when its channels are logged fast enough
        and something rich enough was flown on its axis; whether the response is coherent only ``identify`` tells.
        Checks that cannot be done stand among the findings.

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
    found = {axis: find_excitations(record, axis) for axis in AXES}  # type: ignore[arg-type]
    candidates = {axis: candidate_excitations(record, axis) for axis in AXES}  # type: ignore[arg-type]
    flight, remarks = _flight(record)
    consistency = check_consistency(record, stretches(record, _in_time(*found.values()), flight))
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
        supports=supports(record, found, candidates),
        findings=worst_first(
            (
                *record.findings,
                *flown_firmware(record).findings,
                *_still(record),
                *remarks,
                *_oscillations(record, flight),
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
        battery=_battery(record),
        settings={name: record.parameters[name] for name in _SETTINGS if name in record.parameters},
    )
    return replace(inspection, next_commands=_next_commands(record, inspection))


def _next_commands(record: FlightRecord, inspection: Inspection) -> tuple[str, ...]:
    """What the log supports, else a candidate that identify would take, and the review of what was flown."""
    models = tuple(model for model, support in inspection.supports.items() if support.possible)
    open_axes = [axis for axis in AXES if f"rate.{_MODEL_OF.get(axis, axis)}" not in models]
    segment = next(
        (
            (f"rate.{_MODEL_OF.get(candidate.axis, candidate.axis)}", candidate.segment)
            for candidate in inspection.candidates
            if candidate.axis in open_axes and _would_identify(inspection, candidate)
        ),
        None,
    )
    known = KnownOfLog(record=record, models=models, segment=segment, reviewed=not inspection.flights)
    return tuple(next_steps(known))


_MODEL_OF = {"thrust": "vertical"}


def _would_identify(inspection: Inspection, candidate: CandidateManeuver) -> bool:
    """Whether all that the model of a candidate needs is there, but for the excitation that the candidate may be."""
    support = inspection.supports.get(f"rate.{_MODEL_OF.get(candidate.axis, candidate.axis)}")
    return support is not None and all(need.there for need in support.needs if not need.need.startswith("a sweep"))


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
    """The flights, or why they are not known: a log from the bench can be looked at too."""
    try:
        found = airborne(record)
    except InsufficientDataError as error:
        never = [warn(f.kind, f.where, f.message) for f in error.findings]
        unknown = remark("airborne", "log", f"When the vehicle flew is not known: {error.came.rstrip('.')}.")
        return None, tuple(never) or (unknown,)
    return found, found.findings


def _oscillations(record: FlightRecord, flight: Airborne | None) -> tuple[Finding, ...]:
    """Axes that swing by themselves: nothing else that such a log shows of its loops can be trusted."""
    from rotorid.pipeline.oscillations import oscillation_findings, reviewed_oscillations

    return oscillation_findings(reviewed_oscillations(record)) if flight is not None else ()


def _still(record: FlightRecord) -> Iterator[Finding]:
    """What the log declares as excitations, and is none."""
    for maneuver in still_declarations(record):
        interval = f"{maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s"
        message = f"The log declares a {maneuver.axis} {maneuver.kind} from {interval}, where {maneuver.signal} stands "
        yield warn("no_excitation", f"{maneuver.axis} {interval}", f"{message}still: there was none.")


def _flights(flight: Airborne) -> tuple[FlightInterval, ...]:
    return tuple(
        FlightInterval(start_s=start_s, stop_s=stop_s, seen_in=flight.seen_in) for start_s, stop_s in flight.intervals
    )


def _battery(record: FlightRecord) -> Battery | None:
    for topic, row in record.holding("battery_voltage"):
        volts = topic.values[row][np.isfinite(topic.values[row])]
        if volts.size:
            return Battery(start_v=float(volts[0]), stop_v=float(volts[-1]), lowest_v=float(volts.min()))
    return None


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
