"""Crazyflie logs, as its uSD deck writes them: from bytes to events, and from firmware variables to channels.

A log names its events and their variables first. Records follow, each a type, a stamp and the values, with a checksum
over the whole file and none over a record.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.advice import unread_words
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, LOWEST_RATE_HZ, STANDARD_UNITS, Channel, FlightRecord, Source, Topic, Unread
from rotorid.errors import LogError
from rotorid.frames import euler_from_quaternion
from rotorid.typing import AnyArray, FloatArray, IntArray
from rotorid.units import parse_unit

FORMAT = "Crazyflie uSD"

MAGIC = 0xBC
_STAMPS = {1: ("<u4", 1e-3), 2: ("<u8", 1e-6)}
"""Version to the type of its stamps and their unit in seconds."""

_TYPES = {"b": "i1", "B": "u1", "?": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4"}
_TYPES |= {"q": "<i8", "Q": "<u8", "e": "<f2", "f": "<f4", "d": "<f8"}

_LONGEST_NAME = 255
_CHECKSUM_BYTES = 4

_USUAL_STEP_S = 1.0
_LONGEST_PAUSE_S = 60.0
_LONGEST_FLIGHT_S = 1e8
_CHAIN = 3
_MOST_TRIES = 200_000

_FULL_THROTTLE = 65535.0
_FULL_COMMAND = 32767.0


class Meaning(NamedTuple):
    """The channel that a variable of the firmware is, its unit, and the sign or factor that comes before the unit."""

    channel: str
    unit: str
    scale: float = 1.0


def _rows(group: str, variables: str, channels: str, unit: str, *scales: float) -> dict[str, Meaning]:
    names = zip(variables.split(), channels.split(), scales or (1.0, 1.0, 1.0, 1.0), strict=False)
    return {f"{group}.{variable}": Meaning(channel, unit, scale) for variable, channel, scale in names}


_MOTORS = "motor_1 motor_2 motor_3 motor_4"
_OF_FULL_THROTTLE = 4 * (1.0 / _FULL_THROTTLE,)
_FLU = (1.0, -1.0, -1.0)
_ANGLES = "phi theta psi"
_POSITION = "north east down"
_VELOCITY = "velocity_north velocity_east velocity_down"
_ATTITUDE_SETPOINT = "phi_setpoint theta_setpoint psi_setpoint"
_RATE_SETPOINT = "p_setpoint q_setpoint r_setpoint"

# The firmware's axes are forward, left, up, so that y and z turn their sign. Its attitude, the set-points of it and
# everything that follows from them count the pitch angle the other way round, nose up, as this package does; the
# controllers of Lee and others that work with vectors keep its axes.
MEANINGS: Mapping[str, Meaning] = {
    **_rows("gyro", "x y z", "p q r", "deg/s", *_FLU),
    **_rows("stateEstimateZ", "rateRoll ratePitch rateYaw", "p q r", "mrad/s", 1.0, 1.0, -1.0),
    **_rows("ctrlLee", "omegax omegay omegaz", "p q r", "rad/s", *_FLU),
    **_rows("acc", "x y z", "ax ay az", "g", *_FLU),
    # Nearest to the motors first: what the timers got, the powers, and those before the battery compensation.
    **_rows("pwm", "m1_pwm m2_pwm m3_pwm m4_pwm", _MOTORS, "1", *_OF_FULL_THROTTLE),
    **_rows("motor", "m1 m2 m3 m4", _MOTORS, "1", *_OF_FULL_THROTTLE),
    **_rows("motor", "m1req m2req m3req m4req", _MOTORS, "1", *_OF_FULL_THROTTLE),
    **_rows("rpm", "m1 m2 m3 m4", "motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4", "rpm"),
    **_rows(
        "controller",
        "cmd_roll cmd_pitch cmd_yaw",
        "roll_command pitch_command yaw_command",
        "1",
        *3 * (1.0 / _FULL_COMMAND,),
    ),
    **_rows("controller", "cmd_thrust", "thrust_command", "1", 1.0 / _FULL_THROTTLE),
    **_rows("stabilizer", "thrust", "thrust_command", "1", 1.0 / _FULL_THROTTLE),
    **_rows("stateEstimate", "roll pitch yaw", _ANGLES, "deg", 1.0, 1.0, -1.0),
    **_rows("stabilizer", "roll pitch yaw", _ANGLES, "deg", 1.0, 1.0, -1.0),
    **_rows("ctrlLee", "rpyx rpyy rpyz", _ANGLES, "rad", *_FLU),
    **_rows("stateEstimate", "x y z", _POSITION, "m", *_FLU),
    **_rows("stateEstimate", "vx vy vz", _VELOCITY, "m/s", *_FLU),
    **_rows("stateEstimateZ", "x y z", _POSITION, "mm", *_FLU),
    **_rows("stateEstimateZ", "vx vy vz", _VELOCITY, "mm/s", *_FLU),
    **_rows("controller", "roll pitch yaw", _ATTITUDE_SETPOINT, "deg", 1.0, 1.0, -1.0),
    **_rows("controller", "rollRate pitchRate yawRate", _RATE_SETPOINT, "deg/s", 1.0, 1.0, -1.0),
    **_rows("ctrlLee", "rpydx rpydy rpydz", _ATTITUDE_SETPOINT, "rad", *_FLU),
    **_rows("ctrlLee", "omegarx omegary omegarz", _RATE_SETPOINT, "rad/s", *_FLU),
    # Its velocities are left out: some commanders give them in body axes, and the log does not say which did.
    **_rows("ctrltarget", "roll pitch", "phi_setpoint theta_setpoint", "deg"),
    # Under this name the firmware logs the rate: the angle is no part of this group.
    **_rows("ctrltarget", "yaw", "r_setpoint", "deg/s", -1.0),
    **_rows("ctrltarget", "x y z", "north_setpoint east_setpoint down_setpoint", "m", *_FLU),
    **_rows("ctrltargetZ", "x y z", "north_setpoint east_setpoint down_setpoint", "mm", *_FLU),
    **_rows("pm", "vbat", "battery_voltage", "V"),
    **_rows("pm", "vbatMV", "battery_voltage", "mV"),
    # Measured by a positioning system, and what the estimator is made of: behind everything else.
    **_rows("locSrv", "x y z", _POSITION, "m", *_FLU),
    **_rows("locSrvZ", "x y z", _POSITION, "mm", *_FLU),
}
"""Variable to channel, best first: of two that are the same channel in one event, the earlier one is used."""

_POSITIONING = ("locSrv.", "locSrvZ.")

QUATERNIONS: Mapping[str, str] = {
    "stateEstimate": _ANGLES,
    "ctrltarget": _ATTITUDE_SETPOINT,
    "locSrv": _ANGLES,
}
"""Groups with the variables ``qw qx qy qz``, and the angles that follow from them where no others are logged."""

COMPRESSED_QUATERNIONS: Mapping[str, str] = {"stateEstimateZ.quat": _ANGLES, "locSrvZ.quat": _ANGLES}
"""The same in 32 bits."""

UNREAD: Mapping[str, tuple[tuple[str, ...], str]] = {
    "ctrlrl.out": (("motor_", "thrust_command"), "what the outputs of a learned policy mean, only its builder knows"),
    "powerDist.m": (("motor_", "thrust_command"), "it is the force that the controller wanted, not what the motor got"),
    "erpm.": (("motor_speed_",), "electrical speeds need the number of poles"),
    "gyro.xRaw": (("p_raw", "q_raw", "r_raw"), "its counts are in the axes of the chip, which the log does not name"),
    "ctrlMel.cmd_": (
        tuple(f"{axis}_command" for axis in AXES),
        "the scale of these commands is that of the gains, which the log does not name",
    ),
    "stateEstimate.a": (("ax", "ay", "az"), "it is the acceleration of the earth's axes, without gravity"),
}
"""Beginning of variables near to channels, these channels, and why they are not read."""

_NEEDED = {
    "p": "the body rates: gyro.x, gyro.y, gyro.z",
    "az": "the specific force: acc.x, acc.y, acc.z",
    "thrust_command": "the outputs of all motors in one event: pwm.m1_pwm to pwm.m4_pwm, or motor.m1 to motor.m4",
}


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a Crazyflie uSD log: the magic byte, a known version, a readable name."""
    if len(head) < 8 or head[0] != MAGIC or int.from_bytes(head[1:3], "little") not in _STAMPS:
        return False
    name = head[7:].partition(b"\0")[0]
    return name.isascii() and name.decode("ascii").isprintable() and any(head[3:5])


def read(path: Path, source: Source) -> FlightRecord:
    """Read a uSD log of version 1 or 2.

    Axes become FRD and NED: *north* is the x axis of the firmware's estimator, which points where the vehicle pointed
    when it was switched on, unless a positioning system says otherwise. Angles come as they are or from quaternions.
    ``thrust_command`` is the mean of the four motor outputs, 0 to 1, where an event holds all of them; they are those
    after the battery compensation, so that their gain to thrust changes with the voltage. Gyro and accelerometer have
    passed the firmware's low-pass filters (80 and 30 Hz unless changed), which a fitted delay contains.

    Parameters
    ----------
    path
        The log, as it stands on the card.
    source
        What is known of the file.

    Raises
    ------
    LogError
        The file cannot be read, its header is damaged, or it holds no variable that has a name here.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{source.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    if not sniff(data[:4096]):
        raise LogError(
            f"{source.name} does not start like a Crazyflie log of version 1 or 2",
            needed="the file that the uSD deck wrote",
            remedy="copy it again from the card",
        )
    log = decode(data)
    found = (topic for event in log.events if (topic := _topic(event)) is not None)
    topics = tuple(sorted(found, key=_is_positioning))
    if not any(event.time_s.size for event in log.events):
        raise LogError(
            f"{source.name} contains a header and no samples",
            needed="samples of variables such as gyro.x, acc.z, pwm.m1_pwm",
            remedy="write 1 in the fourth line of config.txt on the card (log from power-on), or set usd.logging = 1",
        )
    if not topics:
        column_names = ", ".join(repr(name)[1:-1] for event in log.events for name in event.columns) or "nothing"
        raise LogError(
            f"{source.name} has no samples of a variable with a known name; its header announces {column_names[:300]}",
            needed="variables such as gyro.x, acc.z, pwm.m1_pwm",
            remedy="name them in config.txt on the card before the next flight",
        )
    kept, remarks = _finite(topics)
    unread = tuple(_unread(log))
    findings = (*_damage(log), *remarks, *_missing(kept, unread), *_slow(kept))
    return FlightRecord(source=replace(source, firmware="Crazyflie"), topics=kept, findings=findings, unread=unread)


def _unread(log: UsdLog) -> Iterator[Unread]:
    """Variables near to channels, each kind once."""
    for beginning, (channels, why) in UNREAD.items():
        found = next(
            ((event, name) for event in log.events for name in event.columns if name.startswith(beginning)), None
        )
        if found is not None and found[1] not in MEANINGS:
            event, name = found
            span_s = float(np.ptp(event.time_s)) if event.time_s.size > 1 else 0.0
            rate_hz = (event.time_s.size - 1) / span_s if span_s > 0.0 else 0.0
            yield Unread(name=name, channels=channels, why=why, rate_hz=rate_hz)


def _is_positioning(topic: Topic) -> bool:
    """Whether a topic holds measurements of a positioning system only, which come after everything else."""
    return all(channel.source.startswith(_POSITIONING) for channel in topic.channels)


def _topic(event: Event) -> Topic | None:
    """The variables of an event that have a meaning, as channels on the event's clock."""
    rows: dict[str, tuple[str, FloatArray]] = {}
    for variable, meaning in MEANINGS.items():
        if variable in event.columns and meaning.channel not in rows:
            factor = meaning.scale * parse_unit(meaning.unit).factor
            rows[meaning.channel] = (variable, _doubles(event.columns[variable], factor))
    motors = _MOTORS.split()
    if set(motors) <= rows.keys():
        with np.errstate(invalid="ignore"):
            mean = np.mean([rows[motor][1] for motor in motors], axis=0)
        rows["thrust_command"] = (f"mean of {rows[motors[0]][0]} to {rows[motors[-1]][0]}", mean)
    for source, names, quaternion in _quaternions(event):
        # Angles that belong together: none of a quaternion next to one that was logged as it stands.
        if rows.keys().isdisjoint(names) and _is_rotation(quaternion):
            rows |= {name: (source, angle) for name, angle in zip(names, _angles(quaternion), strict=True)}
    if not rows or not event.time_s.size:
        return None
    return Topic(
        name=event.name,
        time_s=event.time_s,
        channels=tuple(
            Channel(name=name, unit=STANDARD_UNITS[name], source=source) for name, (source, _) in rows.items()
        ),
        values=np.stack([values for _, values in rows.values()]),
    )


def _quaternions(event: Event) -> Iterator[tuple[str, list[str], FloatArray]]:
    """Source, angles, and rows w, x, y, z of the quaternions of an event."""
    for group, names in QUATERNIONS.items():
        parts = [f"{group}.q{axis}" for axis in "wxyz"]
        if all(part in event.columns for part in parts):
            values = np.stack([_doubles(event.columns[part], 1.0) for part in parts])
            yield f"{group}.qx to {group}.qw", names.split(), values
    for variable, names in COMPRESSED_QUATERNIONS.items():
        if variable in event.columns:
            yield variable, names.split(), decompressed(event.columns[variable])


_MOST_NORM_ERROR = 0.1


def _is_rotation(quaternion: FloatArray) -> bool:
    """Whether a quaternion was in use: one that is none stays at zero."""
    with np.errstate(invalid="ignore", over="ignore"):
        norms = np.sqrt(np.sum(quaternion**2, axis=0))
    return bool(norms.size and abs(float(np.median(norms)) - 1.0) < _MOST_NORM_ERROR)


def _angles(quaternion: FloatArray) -> FloatArray:
    """Angles of a quaternion that turns forward, left, up into the axes of the estimator."""
    with np.errstate(invalid="ignore", over="ignore"):
        return euler_from_quaternion(quaternion * np.array([1.0, *_FLU])[:, None])


def decompressed(values: AnyArray) -> FloatArray:
    r"""Rows w, x, y, z of quaternions that the firmware wrote in 32 bits.

    The two highest bits number the largest part, of x, y, z and w. The others follow, each as a sign and nine bits of
    :math:`\sqrt2` times its size; the largest is not negative and follows from the unit norm.

    Examples
    --------
    >>> turned = 3 << 30 | 511  # w is the largest; x and y are zero, z as large as w
    >>> decompressed(np.array([turned])).round(3).ravel().tolist()
    [0.707, 0.0, 0.0, 0.707]
    """
    words = values.astype(np.int64) & 0xFFFFFFFF
    largest, parts = words >> 30, np.zeros((4, words.size))
    for part in (3, 2, 1, 0):
        others = largest != part
        size = (words & 511) / (511.0 * np.sqrt(2.0))
        parts[part] = np.where(others, np.where(words >> 9 & 1, -size, size), 0.0)
        words = np.where(others, words >> 10, words)
    rest = np.sqrt(np.maximum(1.0 - np.sum(parts**2, axis=0), 0.0))
    parts[largest, np.arange(words.size)] = rest
    return parts[[3, 0, 1, 2]]


def _doubles(values: AnyArray, factor: float) -> FloatArray:
    """Values times a factor; what damage made of them may be no number, or none that fits, and is left out later."""
    with np.errstate(invalid="ignore", over="ignore"):
        scaled: FloatArray = values.astype(np.float64) * factor
    return scaled


def _finite(topics: tuple[Topic, ...]) -> tuple[tuple[Topic, ...], tuple[Finding, ...]]:
    """Topics without the samples that are not numbers, and what was left out."""
    kept: list[Topic] = []
    findings: list[Finding] = []
    for topic in topics:
        good = np.isfinite(topic.values).all(axis=0)
        lost = int(good.size - np.count_nonzero(good))
        if lost:
            message = f"{lost} samples of {topic.name} are not numbers and were left out."
            numbers = {"lost_samples": float(lost)}
            findings.append(remark("gap", topic.name, message, **numbers))
        kept.append(replace(topic, time_s=topic.time_s[good], values=topic.values[:, good]) if lost else topic)
    return tuple(kept), tuple(findings)


def _damage(log: UsdLog) -> Iterator[Finding]:
    if log.checksum_holds and not log.gaps:
        return
    lost = sum(stop - start for start, stop in log.gaps)
    first = log.gaps[0][0] if log.gaps else log.size_bytes
    what = "does not match the content" if not log.checksum_holds else "matches, but records are of unknown types"
    yield warn(
        "corrupt_log",
        f"byte {first}",
        f"The checksum at the end of the log {what}: values may be wrong anywhere. {lost} bytes in "
        f"{len(log.gaps)} places were left out and the rest was read. A vehicle that loses power before the log is "
        "stopped writes none; otherwise copy the log again from the card.",
        first_byte=first,
        lost_bytes=lost,
        places=len(log.gaps),
        size_bytes=log.size_bytes,
    )


def _missing(topics: tuple[Topic, ...], unread: Sequence[Unread]) -> Iterator[Finding]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    for name, meaning in _NEEDED.items():
        if name not in logged:
            near = unread_words(unread, (name,))
            known = f"{near}. " if near else ""
            remedy = "Name them in config.txt on the card before the next flight."
            yield warn("missing_channel", name, f"The log does not contain {meaning}. {known}{remedy}")


def _slow(topics: tuple[Topic, ...]) -> Iterator[Finding]:
    for topic in topics:
        rate_hz = topic.sample_rate_hz
        if 0.0 < rate_hz < LOWEST_RATE_HZ and any(topic.row(name) is not None for name in _NEEDED):
            yield warn(
                "rate_too_low",
                topic.name,
                f"{topic.name} was logged at {rate_hz:.1f} Hz, too slow for motor-level work, which needs at "
                f"least {LOWEST_RATE_HZ:.0f} Hz; set a higher frequency in config.txt on the card.",
                rate_hz=rate_hz,
                needed_hz=LOWEST_RATE_HZ,
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Event:
    """All records of one event type.

    Parameters
    ----------
    name
        ``fixedFrequency`` for the periodic records, else the event that triggers them.
    time_s
        Stamps in s since the start of the firmware, shape ``(records,)``.
    columns
        Variable, such as ``acc.x``, to its values as logged, shape ``(records,)``.
    """

    name: str
    time_s: FloatArray
    columns: Mapping[str, AnyArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class UsdLog:
    """The events of a log, the byte intervals that were left out, and whether the checksum holds."""

    events: tuple[Event, ...]
    gaps: tuple[tuple[int, int], ...]
    checksum_holds: bool
    size_bytes: int


@dataclass(frozen=True, kw_only=True, slots=True)
class _Kind:
    number: int
    name: str
    variables: tuple[str, ...]
    layout: np.dtype[np.void]


def decode(data: bytes) -> UsdLog:
    r"""Take a log apart.

    A record carries no mark of its own, only the number of its type. After damage the walk goes on where three records
    in a row have known types and stamps that rise; what lies between is a gap. The checksum covers the whole file, so
    that it reports damage inside of values, which the walk cannot see.

    Parameters
    ----------
    data
        The file.

    Raises
    ------
    LogError
        The file ends inside its header, or the header contradicts itself.

    Examples
    --------
    >>> header = b"\xbc" + struct.pack("<HHH", 2, 1, 7) + b"tick\0" + struct.pack("<H", 1) + b"pm.vbat(f)\0"
    >>> body = header + b"".join(struct.pack("<HQf", 7, 1000 * n, 4.0) for n in range(3))
    >>> log = decode(body + struct.pack("<I", zlib.crc32(body)))
    >>> log.events[0].time_s.tolist(), log.checksum_holds
    ([0.0, 0.001, 0.002], True)
    """
    version, kinds, start = _header(data)
    body = len(data) - _CHECKSUM_BYTES
    holds = body >= start and zlib.crc32(memoryview(data)[:body]) == int.from_bytes(data[body:], "little")
    places, gaps = _Walk(data=data, kinds=kinds, version=version, stop=body if holds else len(data)).run(start)
    if not holds and gaps and gaps[-1] == (body, len(data)):
        gaps.pop()  # The records are all there; what does not hold is the checksum behind them.
    events = tuple(_event(data, kind, places[kind.number], version) for kind in kinds)
    return UsdLog(events=events, gaps=tuple(gaps), checksum_holds=holds, size_bytes=len(data))


def _header(data: bytes) -> tuple[int, tuple[_Kind, ...], int]:
    """Version, event types, and the place after them."""
    try:
        version, n_kinds = struct.unpack_from("<HH", data, 1)
        place, kinds = 5, []
        for _ in range(n_kinds):
            (number,) = struct.unpack_from("<H", data, place)
            name, place = _text(data, place + 2)
            (n_variables,) = struct.unpack_from("<H", data, place)
            texts, place = _texts(data, place + 2, n_variables)
            kinds.append(_kind(number, name, texts, version))
    except struct.error as error:
        raise LogError(
            f"the Crazyflie log of {len(data)} bytes ends inside its header",
            needed="a whole log",
            remedy="copy it again from the card",
        ) from error
    if len({kind.number for kind in kinds}) < len(kinds):
        raise _contradiction("two event types have the same number")
    return version, tuple(kinds), place


def _text(data: bytes, place: int) -> tuple[str, int]:
    stop = data.find(b"\0", place, place + _LONGEST_NAME + 1)
    if stop < 0:
        if place + _LONGEST_NAME >= len(data):
            raise struct.error
        raise _contradiction("a name has no end")
    return data[place:stop].decode("ascii", errors="replace"), stop + 1


def _texts(data: bytes, place: int, count: int) -> tuple[list[str], int]:
    texts = []
    for _ in range(count):
        text, place = _text(data, place)
        texts.append(text)
    return texts, place


def _kind(number: int, name: str, texts: Sequence[str], version: int) -> _Kind:
    pairs = [text.removesuffix(")").rpartition("(") for text in texts]
    variables, letters = tuple(pair[0] for pair in pairs), tuple(pair[2] for pair in pairs)
    strange = [text for text, letter in zip(texts, letters, strict=True) if letter not in _TYPES]
    if strange:
        raise _contradiction(f"the variable {strange[0][:40]!r} has no known type")
    if len(set(variables)) < len(variables):
        raise _contradiction(f"the event {name[:40]!r} names a variable twice")
    fields = [("number", "<u2"), ("stamp", _STAMPS[version][0])]
    fields += [(f"v{index}", _TYPES[letter]) for index, letter in enumerate(letters)]
    return _Kind(number=number, name=name or f"event {number}", variables=variables, layout=np.dtype(fields))


def _contradiction(reason: str) -> LogError:
    return LogError(
        f"the header of the Crazyflie log is damaged: {reason}",
        needed="an undamaged header, without which no record can be read",
        remedy="copy the log again from the card",
    )


class _Walk:
    """One pass over the records of a log; the lengths of their types are all that leads from one to the next."""

    def __init__(self, *, data: bytes, kinds: Sequence[_Kind], version: int, stop: int) -> None:
        self._data, self._stop = data, stop
        self._lengths = {kind.number: kind.layout.itemsize for kind in kinds}
        self._longest = max(self._lengths.values(), default=0)
        self._known = np.zeros(1 << 16, dtype=np.bool_)
        self._known[list(self._lengths)] = True
        code, self._tick_s = ("<HI", 1e-3) if version == 1 else ("<HQ", 1e-6)
        self._head = struct.Struct(code)
        self._tries = 0

    def run(self, place: int) -> tuple[Mapping[int, IntArray], list[tuple[int, int]]]:
        """Places of the records of each type, and the gaps between them."""
        places = {number: array("q") for number in self._lengths}
        gaps: list[tuple[int, int]] = []
        last_s: float | None = None
        while place < self._stop:
            number, length, stamp_s = self._peek(place)
            near = last_s is not None and abs(stamp_s - last_s) <= _USUAL_STEP_S
            if length and (near or self._is_chain(place, last_s)):
                places[number].append(place)
                place, last_s = place + length, stamp_s
                continue
            found = self._next_chain(place + 1, last_s)
            gaps.append((place, found))
            place = found
        return {number: np.frombuffer(held, dtype=np.int64) for number, held in places.items()}, gaps

    def _peek(self, place: int) -> tuple[int, int, float]:
        """Type, length and stamp of the record here; the length is zero where none fits."""
        if place + self._head.size > self._stop:
            return 0, 0, 0.0
        number, stamp = self._head.unpack_from(self._data, place)
        length = self._lengths.get(number, 0)
        return number, length if place + length <= self._stop else 0, stamp * self._tick_s

    def _is_chain(self, place: int, last_s: float | None) -> bool:
        """Whether records follow each other from here in rising time, three of them or up to the end."""
        for count in range(_CHAIN):
            _, length, stamp_s = self._peek(place)
            if not length:
                # The last records before a cut are followed by less than a record.
                return count > 0 and self._stop - place < self._longest
            low = 0.0 if last_s is None else last_s - _USUAL_STEP_S
            # Only from one record to the next is a long pause suspicious; what lies before may have been lost.
            high = last_s + _LONGEST_PAUSE_S if count and last_s is not None else _LONGEST_FLIGHT_S
            if not low <= stamp_s <= high:
                return False
            place, last_s = place + length, stamp_s
        return True

    def _next_chain(self, place: int, last_s: float | None) -> int:
        for candidate in self._candidates(place):
            self._tries += 1
            # A log of nothing but near hits is no log; without an end to the search it would take hours.
            if self._tries > _MOST_TRIES:
                return self._stop
            if self._is_chain(candidate, last_s):
                return candidate
        return self._stop

    def _candidates(self, place: int) -> Iterator[int]:
        """Places from here on where the number of a known type stands, looked for in growing pieces."""
        size = 256
        while place < self._stop - 1:
            piece = np.frombuffer(self._data[place : min(place + size, self._stop) + 1], dtype=np.uint8).astype(
                np.uint16
            )
            yield from (place + np.flatnonzero(self._known[piece[:-1] | piece[1:] << 8])).tolist()
            place, size = place + size, min(2 * size, 1 << 20)


def _event(data: bytes, kind: _Kind, places: IntArray, version: int) -> Event:
    length = kind.layout.itemsize
    if not places.size:
        rows = np.empty(0, dtype=kind.layout)
    else:
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, dtype=np.uint8), length)
        rows = windows[places].view(kind.layout)[:, 0]
    return Event(
        name=kind.name,
        time_s=rows["stamp"].astype(np.float64) * _STAMPS[version][1],
        columns={name: rows[f"v{index}"] for index, name in enumerate(kind.variables)},
    )
