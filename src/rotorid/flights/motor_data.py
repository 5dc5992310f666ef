"""From logs to records of motors: outputs, rates and specific force on one clock, over the stretches that moved.

The motors come from the best source that a log has (measured speeds, logged outputs, or commands through the mixer),
the rotors from its parameters or from the user. Filters that the log knows are passed on as impulse responses, so that
the model passes them too. Where thrust follows the battery and the battery sagged, all outputs are brought to one
voltage (:func:`common_voltage`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.autopilots.advice import logging_advice
from rotorid.autopilots.filters import combined_response
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Maneuver, MotorRecord, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.motors.fit import LEAST_SAMPLES
from rotorid.flights.differentiated import from_angles, with_velocities
from rotorid.flights.flights import Flight, longest_flight
from rotorid.flights.instruments import while_flying
from rotorid.flights.rotor_order import require_order, rotor_order
from rotorid.flights.segments import built
from rotorid.flights.selection import described, each_once, require_inside
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.rotors import RotorLayout
from rotorid.settings.motors import MotorSettings, chosen_layout
from rotorid.signal.autopilot_filters import filter_findings, given_filters, known_filters
from rotorid.signal.clock import interpolated, resample
from rotorid.signal.excitations import find_excitations
from rotorid.signal.kinematics import ACCELERATIONS, EARTH_VELOCITIES, VELOCITIES, ingredients
from rotorid.signal.motors import Kind, MotorHistory, linearization_of, motor_history, voltage_factor, with_motors
from rotorid.typing import Axis, FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")


_MEASURED = ("p", "q", "r", "az")
_COPIES = 3
_RINGING_S = 0.1


class MotorFlight(NamedTuple):
    """A stretch of a log.

    Parameters
    ----------
    record
        On one clock.
    maneuver
        Where in the log.
    kind
        What the outputs are.
    """

    record: MotorRecord
    maneuver: Maneuver
    kind: Kind


class Motors(NamedTuple):
    """Motors, and whether they are samples of something smooth that somebody had joined by straight lines."""

    history: MotorHistory
    smooth: bool


def true_motors(history: MotorHistory) -> Motors:
    """Motors without the straight lines that somebody drew between slower samples."""
    joined = interpolated(history.time_s, history.values)
    if joined is None:
        return Motors(_without_copies(history), False)
    findings = (*history.findings, joined.finding(history.source))
    return Motors(replace(history, time_s=joined.time_s, values=joined.values, findings=findings), True)


def _without_copies(history: MotorHistory) -> MotorHistory:
    """Motors without samples that only repeat the one before, where that is the rule: a table of a faster clock."""
    changed = np.flatnonzero(np.r_[True, np.any(np.diff(history.values, axis=1) != 0.0, axis=0)])
    if changed.size < LEAST_SAMPLES or np.median(np.diff(changed)) < _COPIES:
        return history
    kept = replace(history, time_s=history.time_s[changed], values=history.values[:, changed])
    message = (
        f"{history.source} is logged at {history.sample_rate_hz:.0f} Hz, but its motor values change only at "
        f"{kept.sample_rate_hz:.1f} Hz."
    )
    numbers = {"rate_hz": kept.sample_rate_hz, "logged_rate_hz": history.sample_rate_hz}
    remark = warn("interpolated_channel", history.source, message, **numbers)
    return replace(kept, findings=(*history.findings, remark))


class Channels(NamedTuple):
    """What of a flight goes on one clock with its motors.

    Parameters
    ----------
    measured
        Channels of the sensors, the slowest of which sets the clock.
    follow
        Others that come onto it.
    wanted
        What is made of them.
    """

    measured: tuple[str, ...]
    follow: tuple[str, ...]
    wanted: tuple[str, ...]


ChannelsOf: TypeAlias = Callable[[FlightRecord, Maneuver], Channels]


def motor_channels_of(record: FlightRecord, stretch: Maneuver) -> Channels:  # noqa: ARG001 - as all that choose
    """Rates and the force along the rotors, with the velocity along them where it is known."""
    followers = ingredients("w", record.channel_names)
    moving = "w" in record.channel_names or set(followers) <= set(record.channel_names)
    wanted = ("w",) if "w" in record.channel_names else followers
    return Channels(_MEASURED, wanted if moving else (), (*_MEASURED, "w") if moving else _MEASURED)


def with_velocity_of(record: FlightRecord, stretch: Maneuver) -> Channels:
    """The same with body velocities and attitude, where the log has them."""
    logged = set(record.channel_names)
    velocities = next((names for names in (EARTH_VELOCITIES, VELOCITIES) if set(names) <= logged), ())
    if not velocities or not set(ATTITUDE) <= logged:
        return motor_channels_of(record, stretch)
    return Channels(_MEASURED, (*velocities, *ATTITUDE), (*_MEASURED, *VELOCITIES, *ATTITUDE))


def on_one_clock(
    record: FlightRecord,
    motors: Motors,
    stretch: Maneuver,
    reference_v: float | None,
    channels_of: ChannelsOf = motor_channels_of,
) -> tuple[list[MotorFlight], list[Finding]]:
    """A stretch on the clock of its rates, in pieces where the log has gaps; pieces of a moment are left out.

    Parameters
    ----------
    reference_v
        Voltage at which thrust is given; ``None`` where it does not matter.
    channels_of
        What of the flight is wanted.
    """
    history = motors.history
    start_s = max(stretch.start_s, float(history.time_s[0]), record.start_s)
    stop_s = min(stretch.stop_s, float(history.time_s[-1]), record.stop_s)
    channels = channels_of(record, stretch)
    found = resample(
        with_motors(record, history),
        channels=channels.measured,
        auxiliary=channels.follow,
        start_s=start_s,
        stop_s=stop_s,
    )
    findings = [*found.findings]
    flights = []
    for part in found.histories:
        if part.time_s.size < LEAST_SAMPLES:
            continue
        item = built(part, channels.wanted)
        strength = np.ones(item.time_s.size)
        if reference_v is not None:
            strength = voltage_factor(record, item.time_s, reference_v=reference_v).values
        findings += _filtered(record, item)
        flights.append(MotorFlight(_record(record, motors, item, strength), stretch, history.kind))
    return flights, findings


def _record(record: FlightRecord, motors: Motors, part: TimeHistory, strength: FloatArray) -> MotorRecord:
    rows = {"force": ACCELERATIONS, "velocity": VELOCITIES, "attitude": ATTITUDE}
    return MotorRecord(
        name=record.source.name,
        sample_rate_hz=part.sample_rate_hz,
        outputs=_outputs(record, motors, part),
        rates=np.stack([part[name] for name in RATES]),
        az=part["az"],
        w=part["w"] if "w" in part.names else np.zeros(0),
        strength=strength,
        gyro_taps=_taps(record, part, RATES),
        accel_taps=_taps(record, part, ("az", *ACCELERATIONS)),
        start_s=part.start_s,
        between="lines" if motors.history.kind == "speed" else "held",
        **{name: np.stack([part[row] for row in of]) for name, of in rows.items() if {*of} <= {*part.names}},
    )


def _outputs(record: FlightRecord, motors: Motors, part: TimeHistory) -> FloatArray:
    """Mean output over each sample: constant until the next stamp, or interpolated if the loop was faster."""
    from scipy.interpolate import CubicSpline

    history, time_s = motors.history, part.time_s
    if motors.smooth:
        return np.asarray(CubicSpline(history.time_s, history.values, axis=1)(time_s), dtype=np.float64)
    if history.kind == "speed":
        return np.stack([np.interp(time_s, history.time_s, row) for row in history.values])
    late = np.searchsorted(history.time_s, time_s + 1e-9, side="right") - 1
    sampled = history.values[:, np.clip(late, 0, history.time_s.size - 1)]
    loops = np.round(record.parameters.get("SCHED_LOOP_RATE", 0.0) / history.sample_rate_hz)
    # Not a number, as a damaged parameter is, is not two and more.
    if not loops >= 2.0 or history.kind != "thrust_demand":
        return sampled
    # A loop that many times faster went on to the next logged demand by steps that nobody logged.
    share = (loops - 1) / (2.0 * loops)
    following = np.concatenate([sampled[:, 1:], sampled[:, -1:]], axis=1)
    return np.asarray((1.0 - share) * sampled + share * following)


def _taps(record: FlightRecord, part: TimeHistory, names: Sequence[str]) -> FloatArray:
    """Impulse response of the known filters of a sensor, by the first of its channels, at the rate of the record."""
    first, *others = (part.channels[part.names.index(name)] for name in dict.fromkeys(names) if name in part.names)
    filters = known_filters(record, first.source)
    given = given_filters(record, first.source)
    for other in others:
        if given_filters(record, other.source) != given:
            raise UsageError(
                f"{first.name} and {other.name} have different given filters",
                needed="channels of one sensor behind the same filters",
                remedy=f"give {first.name} and {other.name} the same --filter",
            )
    if not filters:
        return np.ones(1)
    count = 2 * max(16, round(_RINGING_S * part.sample_rate_hz))
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / part.sample_rate_hz), dtype=np.float64)
    taps = np.fft.irfft(combined_response(filters, omega), count)[: count // 2]
    # Ringing is small, and constant outputs must stay constant.
    return np.asarray(taps / taps.sum(), dtype=np.float64)


def _filtered(record: FlightRecord, part: TimeHistory) -> Iterator[Finding]:
    # A log without the parameters of an autopilot says nothing of filters, and need not say so.
    given = any(channel.filters for topic in record.topics for channel in topic.channels)
    if not record.parameters and not given:
        return
    for name in ("p", "az"):
        source = part.channels[part.names.index(name)].source
        if not source:  # a derivative, which no sensor filtered
            continue
        for finding in filter_findings(record, source):
            if finding.kind == "known_filter":
                message = f"{finding.message.rstrip('.')}. The model contains the same filters."
                yield replace(finding, message=message)
            else:
                yield finding


_SAGGING = 0.02


class FlownMotors(NamedTuple):
    """A stretch of a log with its motors."""

    record: FlightRecord
    motors: Motors
    stretch: Maneuver


class Voltage(NamedTuple):
    """The voltage at which thrust is given; ``None`` where it does not matter."""

    reference_v: float | None
    findings: tuple[Finding, ...] = ()


def common_voltage(flown: Sequence[FlownMotors], reference_v: float | None) -> Voltage:
    """One voltage for all stretches, where outputs follow the battery and it sagged in them."""
    if any(_compensated(item.record, item.motors.history) for item in flown):
        return Voltage(None)
    factors = []
    for item in flown:
        time_s = item.motors.history.time_s
        inside = time_s[(time_s >= item.stretch.start_s) & (time_s <= item.stretch.stop_s)]
        try:
            factors.append(voltage_factor(item.record, inside, reference_v=1.0).values)
        except InsufficientDataError:
            return Voltage(None)
    together = np.concatenate(factors) if factors else np.ones(1)
    if not together.size or together.min() <= 0.0:
        return Voltage(None)
    reference = float(np.sqrt(np.median(together))) if reference_v is None else reference_v
    spread = float(together.max() / together.min() - 1.0)
    if spread < _SAGGING and reference_v is None:
        return Voltage(None)
    message = (
        f"Battery voltage changes thrust by {100.0 * spread:.0f} % at the same output; thrust is given at "
        f"{reference:.3g} V."
    )
    numbers = {"spread": spread, "reference_v": reference}
    where = ", ".join(dict.fromkeys(item.record.source.name for item in flown))
    return Voltage(reference, (remark("battery_sag", where, message, **numbers),))


def _compensated(record: FlightRecord, history: MotorHistory) -> bool:
    """Whether thrust at a value of the motors does not follow the voltage: speeds, and demands corrected later.

    ArduPilot corrects behind what it logs. PX4 (``MC_BAT_SCALE_EN``) scales its set-points before it publishes them:
    what is logged is scaled, and thrust at it follows the voltage as that of an output does.
    """
    if history.kind == "speed":
        return True
    if history.kind == "output":
        return False
    known = linearization_of(record)
    return known is not None and known.compensates_voltage


_AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw", "thrust")
_TELLING = ("sweep", "random_binary", "doublet", "multistep", "multisine")
"""Kinds of excitations that are used, where there are any."""

_TOGETHER_S = 5.0
"""Excitations that follow each other within this time are one stretch."""

_MARGIN_S = 1.0
"""Taken along before and after each."""


class MotorData(NamedTuple):
    """Data for a fit of motors.

    Parameters
    ----------
    stretches
        Stretches of all logs, on one clock.
    layout
        The rotors, in meters where the arm is known.
    histories
        Motors of each log.
    flights
        Logs and what of them was used.
    straightened
        Whether thrust follows the motors in a line, because the autopilot takes their curve out.
    reference_v
        Voltage at which thrust is given; ``None`` where it is no matter.
    """

    stretches: tuple[MotorFlight, ...]
    layout: RotorLayout
    histories: tuple[MotorHistory, ...]
    flights: tuple[Flight, ...]
    findings: tuple[Finding, ...]
    straightened: bool = False
    reference_v: float | None = None

    @property
    def slow(self) -> bool:
        """Whether the motors of some log were logged more slowly than they act."""
        return min(history.sample_rate_hz for history in self.histories) < LOWEST_RATE_HZ

    @property
    def records(self) -> tuple[MotorRecord, ...]:
        """Motors, rates and specific force of the stretches."""
        return tuple(stretch.record for stretch in self.stretches)

    @property
    def response(self) -> None:
        """None was measured."""

    @property
    def sources(self) -> Mapping[str, str]:
        """Sources of the motor channels in the logs."""
        return {"motors": self.histories[0].source}

    @property
    def kind(self) -> Kind:
        """Kind of the outputs, common to all logs."""
        return self.stretches[0].kind


Stretches: TypeAlias = tuple[list[Maneuver], list[Finding]]


class Reading(NamedTuple):
    """What of the logs is used.

    Parameters
    ----------
    stretches
        Stretches of a log, with remarks on them.
    channels
        Channels of a stretch that go on one clock with the motors.
    """

    stretches: Callable[[FlightRecord, MotorSettings], Stretches]
    channels: ChannelsOf


def motor_data(
    records: Sequence[FlightRecord],
    choices: MotorSettings,
    *,
    reference_v: float | None = None,
    layout: RotorLayout | None = None,
    reading: Reading | None = None,
    translation: bool = False,
) -> MotorData:
    """Motors, rates and specific force of every log on one clock.

    Outputs are held from one stamp to the next, as a motor controller holds them; measured speeds are joined by lines.

    Parameters
    ----------
    records, choices
        As for :func:`rotorid.identifying.motors.Motors`.
    reference_v
        Voltage at which thrust is given; the median of all stretches by default.
    layout
        The rotors, where they are known from elsewhere; by default those of the choices, or of the logs.
    reading
        What of the logs is used; excitations, with rates and the force along the rotors, by default.
    translation
        Whether velocity and attitude are used too; always by ``accelerations``.

    Raises
    ------
    InsufficientDataError
        A log lacks motors, rotors or motion.
    UsageError
        Logs are of different vehicles, or of motors of different kind, or no given segment lies inside one.
    """
    translation = translation or choices.method == "accelerations"
    stretches_of, channels_of = reading or Reading(_stretches, with_velocity_of if translation else motor_channels_of)
    each_once(records)
    require_inside(records, choices.segments)
    differentiated: list[Finding] = []
    if choices.method == "accelerations":
        made = [from_angles(record, choices.outputs) for record in records]
        records = [record for record, _ in made]
        differentiated += [finding for _, findings in made for finding in findings]
    if translation:
        made = [with_velocities(record, choices.outputs) for record in records]
        records = [record for record, _ in made]
        differentiated += [finding for _, findings in made for finding in findings]
    # A vehicle that never flew is refused for that, before its rotors are asked for.
    has_motors = [not {"motor_1", "motor_speed_1"}.isdisjoint(record.channel_names) for record in records]
    flown_in = [
        stretches_of(record, choices) if there else None for record, there in zip(records, has_motors, strict=True)
    ]
    layout = layout or rotors_of(records, choices)
    findings: list[Finding] = [*layout.findings, *differentiated]
    flown: list[FlownMotors] = []
    for record, known in zip(records, flown_in, strict=True):
        _PROGRESS.info(f"{record.source.name}: motors")
        motors = true_motors(_motor_history(record, layout))
        if motors.history.motors != layout.rotors:
            raise UsageError(
                f"{record.source.name} has {motors.history.motors} motors, but {layout.name} has {layout.rotors} "
                "rotors",
                needed="the layout of the vehicle that flew",
                remedy="name it with --layout",
            )
        stretches, remarks = known or stretches_of(record, choices)
        ordered = require_order(rotor_order(record, layout), record.source.name)
        findings += [*motors.history.findings, *ordered, *remarks]
        flown += [FlownMotors(record, motors, stretch) for stretch in stretches]
    voltage = common_voltage(flown, reference_v) if choices.voltage else Voltage(None)
    findings += voltage.findings
    flights: list[MotorFlight] = []
    for item in flown:
        _PROGRESS.info(f"{item.record.source.name}: {item.stretch.start_s:.1f} to {item.stretch.stop_s:.1f} s")
        found, remarks = on_one_clock(item.record, item.motors, item.stretch, voltage.reference_v, channels_of)
        flights += found
        findings += remarks
    _require_one_kind(flights, records)
    return MotorData(
        tuple(flights),
        layout,
        tuple({id(item.record): item.motors.history for item in flown}.values()),
        tuple(Flight(item.record, item.stretch) for item in flown),
        _each_once(findings),
        straightened=all(_straightened(record, flights[0].kind) for record in records),
        reference_v=voltage.reference_v,
    )


def _motor_history(record: FlightRecord, layout: RotorLayout) -> MotorHistory:
    """Outputs of the motors, or why there are none, with what this firmware can log."""
    try:
        return motor_history(record, mixer_of(layout, record.source.format))
    except InsufficientDataError as error:
        raise InsufficientDataError(
            error.came, needed=error.needed, remedy=error.remedy or logging_advice(record, 0.0), findings=error.findings
        ) from error


def rotors_of(records: Sequence[FlightRecord], choices: MotorSettings) -> RotorLayout:
    """The rotors that were chosen, or those of the logs.

    Raises
    ------
    InsufficientDataError
        A log does not show them.
    UsageError
        Logs are of different vehicles.
    """
    formats = sorted({record.source.format for record in records})
    if len(formats) > 1:
        raise UsageError(
            f"the logs are from {' and '.join(formats)}", needed="logs of one vehicle", remedy="identify each by itself"
        )
    layouts = [chosen_layout(choices.layout)] if choices.layout else [layout_of(record) for record in records]
    first = layouts[0]
    for record, other in zip(records, layouts, strict=False):
        same = other.rotors == first.rotors and np.allclose(other.positions, first.positions)
        if not (same and np.array_equal(other.spins, first.spins)):
            raise UsageError(
                f"{record.source.name} is from {other.name}, but {records[0].source.name} from {first.name}",
                needed="logs of one vehicle",
                remedy="identify each vehicle by itself, or name the layout with --layout",
            )
    return first.scaled(choices.arm_m) if choices.arm_m else first


def given_stretches(record: FlightRecord, choices: MotorSettings) -> list[Maneuver]:
    """Segments that were given for a log."""
    given = (Flight(record, maneuver) for maneuver in choices.segments)
    return [described(maneuver).maneuver for maneuver in given if maneuver.inside]


def _stretches(record: FlightRecord, choices: MotorSettings) -> Stretches:
    """The given segments; else excitations, joined if consecutive; else the flight."""
    if choices.segments:
        return given_stretches(record, choices), []
    moved = [maneuver for axis in _AXES for maneuver in find_excitations(record, axis) if maneuver.kind in _TELLING]
    if moved:
        flown, remarks = while_flying([Flight(record, maneuver) for maneuver in _joined(moved)])
        return [maneuver.maneuver for maneuver in flown], remarks
    start_s, stop_s = longest_flight(record)
    whole = Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="found")
    message = f"No clear excitation in {record.source.name}; the flight from {start_s:.1f} to {stop_s:.1f} s was used."
    return [whole], [remark("no_excitation", record.source.name, message)]


def _joined(moved: Sequence[Maneuver]) -> list[Maneuver]:
    """Maneuvers with a second around them, those that follow within seconds as one."""
    joined: list[Maneuver] = []
    for maneuver in sorted(moved, key=lambda maneuver: maneuver.start_s):
        wider = replace(maneuver, start_s=maneuver.start_s - _MARGIN_S, stop_s=maneuver.stop_s + _MARGIN_S)
        if joined and wider.start_s <= joined[-1].stop_s + _TOGETHER_S:
            joined[-1] = replace(joined[-1], stop_s=max(joined[-1].stop_s, wider.stop_s))
        else:
            joined.append(wider)
    return joined


def _straightened(record: FlightRecord, kind: Kind) -> bool:
    """Whether the autopilot takes the curve of the motors out, so that thrust follows what was logged in a line."""
    if kind != "thrust_demand":
        return False
    return autopilot_of(record).log.straightened or record.parameters.get("THR_MDL_FAC", 0.0) > 0.0


def _require_one_kind(flights: Sequence[MotorFlight], records: Sequence[FlightRecord]) -> None:
    names = ", ".join(record.source.name for record in records)
    if not flights:
        message = f"{names} has no second without a gap."
        raise InsufficientDataError(
            message,
            needed="motors, rates and accelerometer logged without gaps",
            findings=[refusal("gap", names, message)],
        )
    if len(kinds := {flight.kind for flight in flights}) > 1:
        raise UsageError(
            f"{names} log motors in different ways: {' and '.join(sorted(kinds))}",
            needed="one way of logging motors",
            remedy="identify each kind separately",
        )


def _each_once(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings of several stretches, each once for a channel."""

    def identity(finding: Finding) -> tuple[str, str, str]:
        return finding.kind, finding.where, "" if finding.kind == "rate_too_low" else finding.message

    return tuple({identity(finding): finding for finding in reversed(findings)}.values())[::-1]
