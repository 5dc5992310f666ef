"""Betaflight and INAV logs as flight records: fields of a blackbox flight in the vocabulary of the package.

The flight controllers of this family count in x forward, y left, z up: a positive pitch rate takes the nose down, a
positive yaw rate takes it left. Signs of y and z change here and nowhere else.

Betaflight's CHIRP mode adds a sweep to the set-point of one axis. Its debug fields hold the phase of the sweep in units
of 1/5000 rad, the axis (−1 while it rests), the frequency in tenths of a hertz, and a thousand times the cosine of the
phase. Since the number of the debug mode changes with the firmware, the fields are recognized by that redundancy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.advice import unread_words
from rotorid.autopilots.betaflight.advice import field_advice
from rotorid.data.axes import ATTITUDE
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.ranges import RANGES
from rotorid.data.record import AXES, MOTORS, STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic, Unread
from rotorid.errors import LogError
from rotorid.frames import euler_from_quaternion
from rotorid.io.betaflight.blackbox import MAGIC, Flight, Header, flights, parameters_of
from rotorid.io.betaflight.status import status_of
from rotorid.io.parameters import parameters_changed
from rotorid.typing import Axis, BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FORMAT = "Betaflight blackbox"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a blackbox log.

    Examples
    --------
    >>> sniff(b"H Product:Blackbox flight data recorder by Nicholas Sherlock"), sniff(b"ULog")
    (True, False)
    """
    return head.lstrip(b"\xff\x00\r\n").startswith(MAGIC)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Every flight becomes a topic ``flight N`` on the flight controller's own clock, the longest first. Body rates are
    the gyro as the controllers saw it, behind its filters: a model fitted to them carries the filters' delay. The
    commands are the mix of the four motors of a quadrotor; for other vehicles the sums of the controllers. Where on
    Earth the flight was does not enter the record.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read, or none of its flights can.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    readable, unread = _sorted(data)
    if not readable:
        raise unread[0][1] if unread else _empty(source.name)
    return record_of(readable, unread, source)


def record_of(readable: Sequence[Flight], unread: Sequence[tuple[int, LogError]], source: Source) -> FlightRecord:
    """The flight record of decoded flights.

    Parameters
    ----------
    readable
        Flights with frames, the longest first.
    unread
        Numbers of the others, and why they cannot be read.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        No field is one that the package has a name for.
    """
    readable, later_s = _in_a_row(readable)
    longest = readable[0]
    topics = tuple(_main_topic(flight, _chirp_rows(flight)) for flight in readable)
    if not topics[0].channels:
        raise LogError(
            f"{source.name} contains no gyro, motors, sticks or set-points",
            needed="frames with fields such as gyroADC and motor",
            remedy="set blackbox_disable_gyro = OFF in the CLI",
        )
    return FlightRecord(
        source=replace(source, firmware=longest.header.values.get("Firmware revision", "")),
        topics=tuple(topic for topic in topics if topic.channels),
        parameters=parameters_of(longest.header),
        declared=tuple(maneuver for flight in readable for maneuver in _chirp_maneuvers(flight)),
        instruments=_instruments(topics),
        findings=findings_of(readable, unread, topics, later_s),
        status=status_of(readable),
        unread=tuple(_near(longest, topics[0])),
    )


_NEAR: Mapping[str, tuple[tuple[str, ...], str]] = MappingProxyType(
    {
        "eRPM[0]": (("motor_speed_",), "the header does not state the poles of the motors (motor_poles)"),
        "escRPM": (("motor_speed_",), "it is one number for all motors"),
        "accSmooth[0]": (("ax", "ay", "az"), "the header does not state what 1 g is (acc_1G)"),
        "vbatLatest": (("battery_voltage",), "its unit is known only for Betaflight 3.1 and newer"),
    }
)
"""Fields near to channels that a flight may lack: these, and why they do not come from there."""


def _near(flight: Flight, topic: Topic) -> Iterator[Unread]:
    logged = [channel.name for channel in topic.channels]
    for name, (channels, why) in _NEAR.items():
        item = Unread(name=name, channels=channels, why=why)
        if name in (*flight.fields, *flight.slow_fields) and not any(map(item.near, logged)):
            yield item


_GAP_BETWEEN_FLIGHTS_S = 10.0
"""Between flights whose clocks were set apart."""


def _in_a_row(readable: Sequence[Flight]) -> tuple[list[Flight], dict[int, float]]:
    """The flights in their order, and by how much the clocks of some were set later.

    The flight controller counts from when it got its battery, and a flash holds flights of many batteries: their
    stamps may be those of a flight before, and no second may be of two flights.
    """
    later_s: dict[int, float] = {}
    end_s = -math.inf
    for flight in sorted(readable, key=lambda flight: flight.number):
        start_s, stop_s = float(flight.time_s[0]), float(flight.time_s[-1])
        if start_s <= end_s:
            later_s[flight.number] = math.ceil(end_s + _GAP_BETWEEN_FLIGHTS_S - start_s)
        end_s = stop_s + later_s.get(flight.number, 0.0)
    return [_later(flight, later_s.get(flight.number, 0.0)) for flight in readable], later_s


def _later(flight: Flight, by_s: float) -> Flight:
    if not by_s:
        return flight
    return replace(
        flight,
        time_s=flight.time_s + by_s,
        fix_time_s=flight.fix_time_s + by_s,
        slow_time_s=flight.slow_time_s + by_s,
    )


def _sorted(data: bytes) -> tuple[list[Flight], list[tuple[int, LogError]]]:
    """The flights that hold frames, longest first, and the others with the reason."""
    readable: list[Flight] = []
    unread: list[tuple[int, LogError]] = []
    for number, outcome in flights(data):
        if isinstance(outcome, LogError):
            unread.append((number, outcome))
        elif outcome.time_s.size:
            readable.append(outcome)
        else:
            unread.append((number, _empty(f"flight {number}")))
    return sorted(readable, key=lambda flight: -flight.duration_s), unread


def _instruments(topics: tuple[Topic, ...]) -> dict[str, tuple[str, ...]]:
    """Signals without feedback: the injected sweep where there is one, then the stick."""
    logged = {channel.name for topic in topics for channel in topic.channels}
    present = {axis: tuple(name for name in (f"{axis}_excitation", f"{axis}_stick") if name in logged) for axis in AXES}
    return {axis: names for axis, names in present.items() if names}


def _empty(name: str) -> LogError:
    return LogError(
        f"{name} contains a header and no frame that can be read",
        needed="at least one I frame",
        remedy="set blackbox_mode = NORMAL in the CLI, arm and fly; if it flew, download the log again",
    )


FRD = (1.0, -1.0, -1.0)
STICK_SPAN = 500.0
_LEAST_CORRELATION = 0.5
_CONTROLLER_SCALE = 1000.0
"""What the mixer divides the sums of the controllers by to make parts of the motors' range of them."""
QUAD_X: Mapping[str, tuple[float, float, float, float]] = MappingProxyType(
    {
        "roll_command": (-0.25, -0.25, 0.25, 0.25),
        "pitch_command": (-0.25, 0.25, -0.25, 0.25),
        "yaw_command": (-0.25, 0.25, 0.25, -0.25),
        "thrust_command": (0.25, 0.25, 0.25, 0.25),
    }
)
"""Inverse of the mixer for motors rear right, front right, rear left, front left; the first turns clockwise."""

_DEGREE = math.pi / 180.0


class Row(NamedTuple):
    """A channel and its samples."""

    name: str
    source: str
    values: FloatArray


def _main_topic(flight: Flight, extra: tuple[Row, ...] = ()) -> Topic:
    """Everything that a flight logs with its main frames, on one clock."""
    return _topic(f"flight {flight.number}", flight.time_s, (*_rows(flight), *extra))


def _topic(name: str, time_s: FloatArray, rows: tuple[Row, ...]) -> Topic:
    channels = tuple(Channel(name=row.name, unit=STANDARD_UNITS[row.name], source=row.source) for row in rows)
    # A flight of which no field has a name here is one without rows.
    values = np.array([row.values for row in rows]).reshape(len(rows), time_s.size)
    return Topic(name=name, time_s=time_s, channels=channels, values=values)


def _rows(flight: Flight) -> Iterator[Row]:
    header = flight.header
    motors = tuple(_motors(flight))
    yield from _commands(flight, motors)
    yield from motors
    tenths = _tenths(header)
    yield from _body(flight, "gyroADC", "p q r", gyro_scale(header))
    if header.number("acc_1G") > 0.0:
        yield from _body(flight, "accSmooth", "ax ay az", STANDARD_GRAVITY_M_S2 / header.number("acc_1G"))
    setpoint = "setpoint" if "setpoint[0]" in flight.fields else "axisRate"
    yield from _body(flight, setpoint, "p_setpoint q_setpoint r_setpoint", _DEGREE * tenths)
    yield from _body(flight, "rcCommand", "roll_stick pitch_stick yaw_stick", tenths / STICK_SPAN)
    if "rcCommand[3]" in flight.fields:
        throttle = _float(flight, "rcCommand[3]") * tenths
        yield Row("thrust_stick", "rcCommand[3]", (throttle - 1000.0) / 1000.0)
    yield from _motor_speeds(flight)
    yield from _attitude(flight)
    yield from _navigation(flight)
    yield from _battery(flight)
    yield from _terms(flight)
    yield from _unfiltered(flight)


def _body(flight: Flight, field: str, names: str, scale: float) -> Iterator[Row]:
    """Three axes of a vector; a flight that logs one of them only has only that one."""
    for index, name in enumerate(names.split()):
        source = f"{field}[{index}]"
        if source in flight.fields:
            yield Row(name, source, _float(flight, source) * (scale * FRD[index]))


def _float(flight: Flight, source: str) -> FloatArray:
    return flight.field(source).astype(np.float64)


def _tenths(header: Header) -> float:
    """Logs of high resolution count tenths."""
    return 0.1 if header.number("blackbox_high_resolution") > 0.0 else 1.0


def gyro_scale(header: Header) -> float:
    """Factor of the logged gyro to rad/s. The first loggers gave it in rad/µs, all later ones in deg/s."""
    scale = header.number("gyro_scale", 1.0) * _tenths(header)
    return scale * (_DEGREE if "Firmware type" in header.values else 1e6)


def _motors(flight: Flight) -> Iterator[Row]:
    """Motors as parts of the range between idle and full; ``motorOutput`` says which, once the throttle limits did."""
    header = flight.header
    limits = header.values.get("motorOutput", "").split(",")
    low, high = header.number("minthrottle", 1000.0), header.number("maxthrottle", 2000.0)
    if len(limits) == 2 and all(limit.isdigit() for limit in limits):
        low, high = float(limits[0]), float(limits[1])
    span = high - low if high > low else 1000.0
    for index in range(MOTORS):
        source = f"motor[{index}]"
        if source in flight.fields:
            yield Row(f"motor_{index + 1}", source, (_float(flight, source) - low) / span)


def _commands(flight: Flight, motors: tuple[Row, ...]) -> Iterator[Row]:
    """What the mixer put out, from the motors of a quadrotor; for others, what the controllers put in.

    The motors are the better source where their geometry is known: they hold what was left of a command after the
    mixer had made room for it, which is what moved the vehicle.
    """
    if len(motors) == len(QUAD_X):
        outputs = np.stack([motor.values for motor in motors])
        # A mix of what no motor puts out is no command; what stands in for it is left out with the motor's own sample.
        low, high = RANGES["motor_1"]
        possible = np.all((outputs >= low) & (outputs <= high), axis=0)
        outputs = np.where(possible, outputs, np.nan)
        for name, weights in QUAD_X.items():
            sign = -1.0 if name == "yaw_command" and _yaw_turned(flight, outputs) else 1.0
            yield Row(name, "motor mix", sign * np.array(weights) @ outputs)
        return
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        summed = _controller_sum(flight, index)
        if summed is not None:
            yield summed._replace(name=f"{axis}_command")
    if "setpoint[3]" in flight.fields:
        yield Row("thrust_command", "setpoint[3]", _float(flight, "setpoint[3]") / 1000.0)


def _controller_sum(flight: Flight, index: int) -> Row | None:
    """What the controllers of an axis put in, where their terms are logged."""
    parts = [name for term in "PIDFS" if (name := f"axis{term}[{index}]") in flight.fields]
    whole = f"axisSum[{index}]"
    parts = [whole] if whole in flight.fields else parts
    if not parts:
        return None
    total = sum((_float(flight, part) for part in parts), start=np.zeros(flight.time_s.size))
    return Row("", " + ".join(parts), total * (FRD[index] / _CONTROLLER_SCALE))


def _yaw_turned(flight: Flight, outputs: FloatArray) -> bool:
    """Whether the motors turn the other way round: the mix then goes against the sum of the yaw controller's terms.

    Their regression shows it in every version; where the terms are not logged or explain too little of the mix, a
    setting shows it, which the headers of some versions lack.
    """
    correlation = _yaw_correlation(flight, outputs)
    return correlation < 0.0 if abs(correlation) > _LEAST_CORRELATION else _motors_reversed(flight.header)


def _yaw_correlation(flight: Flight, outputs: FloatArray) -> float:
    """Correlation of what the yaw controller put in with the mix that usual motors would have; outputs ``(4, n)``."""
    summed, mixed = _controller_sum(flight, 2), np.array(QUAD_X["yaw_command"]) @ outputs
    if summed is None or min(float(np.ptp(summed.values)), float(np.ptp(mixed))) == 0.0:
        return 0.0
    return float(np.corrcoef(summed.values, mixed)[0, 1])


def _motors_reversed(header: Header) -> bool:
    """Whether the motors turn the other way round than usual ("props out")."""
    return header.number("yaw_motors_reversed") == 1.0 or header.number("yaw_motor_direction", 1.0) == -1.0


def _motor_speeds(flight: Flight) -> Iterator[Row]:
    """Speeds from the electrical ones, which are logged in hundreds of turns per minute and count pairs of poles."""
    poles = flight.header.number("motor_poles")
    for index in range(MOTORS):
        source = f"eRPM[{index}]"
        if source in flight.fields and poles > 0.0:
            yield Row(
                f"motor_speed_{index + 1}",
                source,
                _float(flight, source) * (100.0 * 2.0 / poles * 2.0 * math.pi / 60.0),
            )


_QUATERNION_SCALE = 32767.0


def _attitude(flight: Flight) -> Iterator[Row]:
    """Angles: INAV's in tenths of a degree, pitch counted nose down; Betaflight's as a quaternion without its scalar.

    That is not negative by choice of the sign, so that it follows from the three others.
    """
    angles = [f"attitude[{index}]" for index in range(3)]
    if set(angles) <= set(flight.fields):
        for name, source, sign in zip(ATTITUDE, angles, (1.0, -1.0, 1.0), strict=True):
            yield Row(name, source, _float(flight, source) * (0.1 * _DEGREE * sign))
    vector = [f"imuQuaternion[{index}]" for index in range(3)]
    if set(vector) <= set(flight.fields):
        axes = np.stack([_float(flight, source) * sign for source, sign in zip(vector, FRD, strict=True)])
        axes /= _QUATERNION_SCALE
        scalar = np.sqrt(np.maximum(1.0 - np.sum(axes**2, axis=0), 0.0))
        for name, values in zip(ATTITUDE, euler_from_quaternion(np.stack([scalar, *axes])), strict=True):
            yield Row(name, "imuQuaternion", values)


def _navigation(flight: Flight) -> Iterator[Row]:
    """INAV's own estimate of position and velocity: centimeters, north, east, up."""
    for field, names in (
        ("navPos", "north east down"),
        ("navVel", "velocity_north velocity_east velocity_down"),
    ):
        for index, name in enumerate(names.split()):
            source = f"{field}[{index}]"
            if source in flight.fields:
                yield Row(name, source, _float(flight, source) * (-0.01 if index == 2 else 0.01))


def _battery(flight: Flight) -> Iterator[Row]:
    """Voltage, where the firmware's version says in what it was counted, and current."""
    name, version = flight.header.firmware
    if not name or (name == "Betaflight" and version < (3, 1)):
        return
    # INAV's own names come first; firmware before it used those of Betaflight.
    own = name == "INAV"
    voltage = "vbat" if own and "vbat" in flight.fields else "vbatLatest"
    if voltage in flight.fields:
        scale = 0.01 if own or version >= (4, 0) else 0.1
        yield Row("battery_voltage", voltage, _float(flight, voltage) * scale)
    current = "amperage" if own and "amperage" in flight.fields else "amperageLatest"
    if current in flight.fields:
        yield Row("battery_current", current, _float(flight, current) * 0.01)


def _terms(flight: Flight) -> Iterator[Row]:
    """What each term of a controller puts into the mixer, in its units."""
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        for term in "PIDF":
            source = f"axis{term}[{index}]"
            if source in flight.fields:
                scale = FRD[index] / _CONTROLLER_SCALE
                yield Row(f"{axis}_{term.lower()}_term", source, _float(flight, source) * scale)


_UNFILTERED_FIELDS = ("gyroUnfilt", "gyroRaw")
"""Of Betaflight and of INAV."""
_UNFILTERED_MODES = {(3, 4): 6, (3, 1): 3}
"""``debug_mode`` whose debug fields hold the gyro before its filters, by the first version that numbers it so.

It was called GYRO, and then GYRO_SCALED; NOTCH of the older versions stands behind the low-pass.
"""
_SAME_SLOPE = 0.1
_SMOOTHED, _PLACES = 32, 1000


def _unfiltered(flight: Flight) -> Iterator[Row]:
    """The gyro before its filters: a field of its own in newer versions, debug fields in older ones."""
    names = "p_raw q_raw r_raw"
    own = next((field for field in _UNFILTERED_FIELDS if f"{field}[0]" in flight.fields), "")
    if own:
        yield from _body(flight, own, names, gyro_scale(flight.header))
        return
    firmware, version = flight.header.firmware
    if firmware != "Betaflight":
        return
    mode = next((mode for first, mode in _UNFILTERED_MODES.items() if version >= first), None)
    if flight.header.number("debug_mode") == mode and _follows_gyro(flight):
        yield from _body(flight, "debug", names, _DEGREE * _tenths(flight.header))


def _follows_gyro(flight: Flight) -> bool:
    """Whether the debug fields are the gyro's, as slow motion shows; numbers of debug modes move between versions."""
    if not {f"{field}[{index}]" for field in ("debug", "gyroADC") for index in range(3)} <= set(flight.fields):
        return False
    # Means over 32 frames in up to a thousand places show the motion without its noise.
    count = flight.time_s.size // _SMOOTHED
    places = np.linspace(0, count - 1, min(count, _PLACES)).astype(np.int64)[:, None] * _SMOOTHED + np.arange(_SMOOTHED)
    if count < 2:
        return False
    for index in range(2):
        raw, filtered = (
            np.diff(flight.field(f"{field}[{index}]")[places].mean(axis=1)) for field in ("debug", "gyroADC")
        )
        power = float(filtered @ filtered)
        if power == 0.0 or abs(float(raw @ filtered) / power - 1.0) > _SAME_SLOPE:
            return False
    return True


_PHASE_SCALE = 5000.0
COSINE_SCALE = 1000.0
SHORTEST_S = 1.0
_TOLERANCE = 20.0
"""Of the cosine, in thousandths: the controller's fast cosine and the rounding of the phase."""
_MOSTLY_AGREES = 0.999
"""Damage of single frames does not make another signal of the sweep."""
_DIRECT_HZ = 1.0
"""Below this frequency the controller lowers the amplitude in proportion to the frequency."""
_AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
_FIELDS = tuple(f"debug[{index}]" for index in range(4))


def _chirp_rows(flight: Flight) -> tuple[Row, ...]:
    """Excitation of every axis that was swept, in rad/s at the rate set-point.

    This is the sweep as generated, times its amplitude: the controller's lead–lag shaping, which follows, is a known
    linear filter and takes nothing from its use as an instrument.
    """
    if not is_chirp(flight):
        return ()
    axis, wave = flight.field("debug[1]"), _wave(flight)
    rows = []
    for index, name in enumerate(_AXES):
        amplitude = flight.header.number(f"chirp_amplitude_{name}") * math.pi / 180.0
        if np.any(axis == index):
            values = np.where(axis == index, wave, 0.0) * (amplitude * FRD[index])
            rows.append(Row(f"{name}_excitation", "debug[3]", values))
    return tuple(rows)


def _chirp_maneuvers(flight: Flight) -> tuple[Maneuver, ...]:
    """Sweeps of at least a second, with the band that was reached."""
    if not is_chirp(flight):
        return ()
    axis, tenths = flight.field("debug[1]"), flight.field("debug[2]")
    running = np.where(tenths > 0, axis, -1)
    borders = [0, *(np.flatnonzero(np.diff(running)) + 1).tolist(), running.size]
    found = []
    for first, stop in pairwise(borders):
        start_s, stop_s = float(flight.time_s[first]), float(flight.time_s[stop - 1])
        if running[first] < 0 or stop_s - start_s < SHORTEST_S:
            continue
        name = _AXES[int(running[first])]
        low, high = (float(edge) * 0.1 * 2.0 * math.pi for edge in (tenths[first], tenths[stop - 1]))
        found.append(
            Maneuver(
                axis=name,
                kind="sweep",
                start_s=start_s,
                stop_s=stop_s,
                band_rad_s=(min(low, high), max(low, high)),
                origin="declared",
                signal=f"{name}_excitation",
            )
        )
    return tuple(found)


def is_chirp(flight: Flight) -> bool:
    """Whether the debug fields are those of a sweep."""
    if not set(_FIELDS) <= set(flight.fields) or "chirp_time_seconds" not in flight.header.values:
        return False
    axis = flight.field("debug[1]")
    running = (axis >= 0) & (flight.field("debug[2]") > 0)
    if not running.any() or np.mean((axis >= -1) & (axis <= 2)) < _MOSTLY_AGREES:
        return False
    return float(np.mean(_agrees(flight)[running])) > _MOSTLY_AGREES


def _agrees(flight: Flight) -> BoolArray:
    cosine = COSINE_SCALE * np.cos(flight.field("debug[0]") / _PHASE_SCALE)
    logged = flight.field("debug[3]")
    lowered = flight.field("debug[2]") < 10.0 * _DIRECT_HZ + 1.0
    agrees: BoolArray = np.where(
        lowered, np.abs(logged) <= COSINE_SCALE + _TOLERANCE, np.abs(logged - cosine) < _TOLERANCE
    )
    return agrees


def _wave(flight: Flight) -> FloatArray:
    wave: FloatArray = flight.field("debug[3]") / COSINE_SCALE
    return wave


_NEEDED = (
    ("p", "the gyro is not logged, so that no response can be measured", "p"),
    ("az", "the accelerometer is not logged", "az"),
    ("roll_command", "neither the motors nor the sums of the controllers are logged", "motor_1"),
)


def findings_of(
    flights: Sequence[Flight],
    unread: Sequence[tuple[int, LogError]],
    topics: Sequence[Topic],
    later_s: Mapping[int, float],
) -> tuple[Finding, ...]:
    """All remarks on a log; ``flights`` and ``topics`` with the preferred flight first."""
    return (
        *_others(flights, later_s),
        *_other_settings(flights),
        *_turned_in_flight(flights),
        *(_unread(number, error) for number, error in unread),
        *(finding for flight in flights for finding in _damage(flight)),
        *_missing(flights[0], topics[0]),
        *_geometry(flights[0]),
    )


def _others(flights: Sequence[Flight], later_s: Mapping[int, float]) -> Iterator[Finding]:
    if len(flights) < 2:
        return
    first, *others = flights
    listed = ", ".join(f"flight {flight.number} ({_span(flight)})" for flight in others)
    moved = [f"those of flight {number} are {by_s:g} s later here than logged" for number, by_s in later_s.items()]
    clocks = f"; the clock restarted between them: {', '.join(moved)}" if moved else ""
    yield remark(
        "several_flights",
        "log",
        f"the log contains {len(flights)} flights; the longest, flight {first.number} ({_span(first)}), comes "
        f"first, and the others are {listed}{clocks}",
        flights=len(flights),
        longest_s=first.duration_s,
    )


_OF_LOOPS = re.compile(
    r"(?:(?:roll|pitch|yaw|level)PID|[dp]_m(?:in|ax)|ff_weight|feedforward_weight|gyro_|dterm_|dyn_|rpm_filter|tpa_|"
    r"thrust_linear|anti_gravity_gain|pid_process_denom)\w{0,40}"
)
"""Settings that loops follow from; not the voltage that is logged with them, nor the rates of the sticks."""


def _other_settings(flights: Sequence[Flight]) -> Iterator[Finding]:
    """Flights of other settings than the longest, whose settings are taken for those of the log."""
    if not flights:
        return
    first, *others = flights
    known = parameters_of(first.header)
    for flight in others:
        own = parameters_of(flight.header)
        shared = filter(_OF_LOOPS.fullmatch, known.keys() & own.keys())
        changes = {name: (own[name], known[name]) for name in shared if own[name] != known[name]}
        if changes:
            why = f"Flight {flight.number} was flown with other settings than flight {first.number}"
            yield parameters_changed(changes, why, taken=f"those of flight {first.number}")


def _turned_in_flight(flights: Sequence[Flight]) -> Iterator[Finding]:
    """Flights in which the pilot turned gains away from those that their headers state."""
    for flight in flights:
        known = parameters_of(flight.header)
        turned = {name: value for name, value in flight.adjusted.items() if known.get(name, value) != value}
        if turned:
            why = f"The pilot adjusted gains in flight {flight.number}"
            changes = {name: (known[name], value) for name, value in turned.items()}
            yield parameters_changed(changes, why, taken="its first values")


def _span(flight: Flight) -> str:
    return f"{flight.time_s[0]:.1f} to {flight.time_s[-1]:.1f} s"


def _unread(number: int, error: LogError) -> Finding:
    return warn("corrupt_log", f"flight {number}", f"flight {number} was left out: {error.came}", flight=number)


def _damage(flight: Flight) -> Iterator[Finding]:
    damage, where = flight.damage, f"flight {flight.number}"
    if damage.skipped_bytes:
        yield warn(
            "corrupt_log",
            where,
            f"{damage.skipped_bytes} bytes in {damage.places} places of {where} are not frames and were "
            f"skipped, the first {damage.first_byte} bytes after its beginning; {damage.lost_frames} frames are "
            "missing, and the format has no checksum: other values may be wrong too",
            bytes=damage.skipped_bytes,
            places=damage.places,
            first_byte=damage.first_byte,
            lost_frames=damage.lost_frames,
        )
    elif damage.lost_frames:
        yield warn(
            "gap",
            where,
            f"{damage.lost_frames} frames of {where} were never written: the logger could not keep up; lower "
            "the logging rate, or use a faster card",
            lost_frames=damage.lost_frames,
            frames=len(flight.frames),
        )
    if damage.cut_bytes or not damage.ended:
        yield remark(
            "corrupt_log",
            where,
            f"{where} was not closed: it ends without the logger's last word, and {damage.cut_bytes} bytes of "
            "an incomplete frame were skipped",
            bytes=damage.cut_bytes,
            frames=len(flight.frames),
        )


def _missing(flight: Flight, topic: Topic) -> Iterator[Finding]:
    firmware, unread = flight.header.values.get("Firmware revision", ""), tuple(_near(flight, topic))
    for name, message, field in _NEEDED:
        if topic.row(name) is None:
            near = unread_words(unread, (name,))
            advice = field_advice(firmware, (field,))
            yield warn("missing_channel", topic.name, near or (f"{message}; {advice}" if advice else message))


def _geometry(flight: Flight) -> Iterator[Finding]:
    if sum(name.startswith("motor[") for name in flight.fields) != len(QUAD_X):
        return
    known = {"yaw_motors_reversed", "yaw_motor_direction"} & set(flight.header.values)
    outputs = np.stack([motor.values for motor in _motors(flight)])
    correlated = known or abs(_yaw_correlation(flight, outputs)) > _LEAST_CORRELATION
    turning = "" if correlated else ", and that the first motor turns clockwise seen from above"
    yield remark(
        "assumed_geometry",
        f"flight {flight.number}",
        "the commands are the mix of the four motors, assumed to be a quad X: rear right, "
        f"front right, rear left, front left; the log does not name the frame{turning}",
    )
