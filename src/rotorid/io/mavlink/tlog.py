"""MAVLink telemetry (``.tlog``) as flight records: which field of which message is which channel, all on one clock.

Messages carry stamps of 32 or 64 bits since boot, or none at all; :class:`BootClock` brings them to seconds since the
autopilot booted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rotorid.autopilots.advice import unread_words
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic, Unread
from rotorid.errors import LogError
from rotorid.frames import euler_from_quaternion
from rotorid.io.ardupilot.dataflash import HEADER_BYTES, Format, Table
from rotorid.io.ardupilot.log import motor_topics, stick_topic
from rotorid.io.flags import MAV_TYPES, most_frequent, vehicle_findings
from rotorid.io.mavlink.messages import Messages, Telemetry, decode, starts_like_telemetry
from rotorid.io.parameters import kept_parameters
from rotorid.io.px4.outputs import motor_outputs
from rotorid.typing import AnyArray, BoolArray, FloatArray
from rotorid.units import parse_unit

FORMAT = "MAVLink telemetry"

ARDUPILOT, PX4 = 3, 12
"""``HEARTBEAT.autopilot`` of the two firmwares whose habits are known."""

_AUTOPILOT_COMPONENT = 1
_INTEGER_TYPES = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}
_REMEDY = "copy it again from the ground station"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a row of MAVLink frames behind eight-byte stamps."""
    return starts_like_telemetry(head)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a telemetry log.

    Telemetry is a decimated copy of what the autopilot knows, often 4 to 50 Hz, without a filter against aliasing: good
    for an overview and for slow modes, not for motor lag and delay. All stamps are seconds since the boot of the
    autopilot, as it sent them; messages without a stamp stand where the ground station received them. Only the
    autopilot that sent most is read. Positions are relative to the origin of the estimator.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read, holds no frame, or nothing that the package has a name for.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    telemetry = decode(data)
    if not telemetry.messages:
        raise LogError(
            f"{source.name} contains {telemetry.frames} MAVLink frames but no intact message of a known type",
            needed="telemetry of a flight, such as ATTITUDE",
            remedy=_REMEDY,
        )
    sender = _autopilot(telemetry.messages)
    messages = dict(_sent_by(telemetry.messages, sender))
    firmware = _firmware(messages)
    parameters = _parameters(messages, firmware)
    status = _status(messages)
    clock = BootClock.of(messages.values())
    topics = (
        *_message_topics(messages, clock, scaled_raw=firmware == ARDUPILOT),
        *(_pulse_topics(messages, clock, parameters) if firmware == ARDUPILOT else ()),
    )
    outputs, assumed = _px4_outputs(messages, clock, parameters) if firmware == PX4 else ((), ())
    topics = (*topics, *outputs)
    if not topics:
        raise LogError(
            f"{source.name} contains only {', '.join(messages) or 'no message'} of the autopilot {sender[0]}",
            needed="a telemetry log of a flight, such as ATTITUDE with SERVO_OUTPUT_RAW",
            remedy="raise the stream rates (SR0_EXTRA1, SR0_RAW_SENS, SR0_RC_CHAN), or use the log on the SD card",
        )
    unread = tuple(_unread(messages, topics))
    return FlightRecord(
        source=replace(source, firmware=_named(firmware, messages, status)),
        topics=topics,
        parameters=kept_parameters(parameters),
        instruments=_instruments(topics),
        status=status,
        unread=unread,
        findings=(
            *vehicle_findings(status),
            *_damage(telemetry, len(data)),
            *_others(telemetry.messages, sender),
            *clock.findings(),
            *assumed,
            _decimated(topics),
            *_missing(topics, unread),
        ),
    )


def _autopilot(messages: Mapping[str, Messages]) -> tuple[int, int]:
    """System and component that sent most, a flight controller rather than a camera or the ground station."""
    senders = np.concatenate([_senders(item) for item in messages.values()])
    found, count = np.unique(senders, return_counts=True)
    best = max(zip(found.tolist(), count.tolist(), strict=True), key=lambda it: (it[0] & 0xFF == 1, it[1]))[0]
    return best >> 8, best & 0xFF


def _senders(messages: Messages) -> AnyArray:
    return messages.system.astype(np.int64) << 8 | messages.component


def _sent_by(messages: Mapping[str, Messages], sender: tuple[int, int]) -> Iterator[tuple[str, Messages]]:
    for name, item in messages.items():
        chosen = item.chosen(_senders(item) == (sender[0] << 8 | sender[1]))
        if chosen.fields.size:
            yield name, chosen


def _firmware(messages: Mapping[str, Messages]) -> int:
    beats = messages.get("HEARTBEAT")
    return -1 if beats is None else int(beats.fields["autopilot"][-1])


def _named(firmware: int, messages: Mapping[str, Messages], status: Status) -> str:
    """The firmware as its own logs name it, ``ArduCopter V4.6.2`` or ``PX4 1.15.0``; without what it did not send."""
    name = {ARDUPILOT: "ArduPilot", PX4: "PX4"}.get(firmware, "")
    packed = messages.get("AUTOPILOT_VERSION")
    number = 0 if packed is None else int(packed.fields["flight_sw_version"][-1])
    if not name or not number:
        return name
    version = ".".join(str(number >> place & 0xFF) for place in (24, 16, 8))
    if firmware == PX4:
        return f"PX4 {version}"
    return f"{'ArduCopter' if status.vehicle == 'multirotor' else 'ArduPilot'} V{version}"


def _status(messages: Mapping[str, Messages]) -> Status:
    """What kind of vehicle the autopilot says that it flies."""
    if "HEARTBEAT" not in messages:
        return Status()
    kind = most_frequent(messages["HEARTBEAT"].fields["type"])
    vehicle = MAV_TYPES.get(kind, "")
    return Status(vehicle=vehicle, named_in=f"HEARTBEAT.type {kind}" if vehicle else "")


def _parameters(messages: Mapping[str, Messages], firmware: int) -> dict[str, float]:
    """The autopilot's parameters as far as they were sent; of one that changed, the last value."""
    if "PARAM_VALUE" not in messages:
        return {}
    fields = messages["PARAM_VALUE"].fields
    found: dict[str, float] = {}
    for label, value, kind in zip(fields["param_id"], fields["param_value"], fields["param_type"], strict=True):
        # PX4 lays the bytes of an integer into the float; ArduPilot sends its value.
        whole = firmware == PX4 and int(kind) in _INTEGER_TYPES
        number = value.tobytes() if whole else b""
        plain = float(np.frombuffer(number, _INTEGER_TYPES[int(kind)])[0]) if whole else float(value)
        name = label.split(b"\0")[0].decode("ascii", errors="replace")
        if name and np.isfinite(plain):
            found[name] = plain
    return found


def _instruments(topics: tuple[Topic, ...]) -> dict[str, tuple[str, ...]]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    return {axis: (f"{axis}_stick",) for axis in ("roll", "pitch", "yaw", "thrust") if f"{axis}_stick" in logged}


def _damage(telemetry: Telemetry, size_bytes: int) -> Iterator[Finding]:
    if not telemetry.lost_bytes and not telemetry.failed:
        return
    where = f", first at byte {telemetry.first_byte} of {size_bytes}" if telemetry.lost_bytes else ""
    yield warn(
        "corrupt_log",
        "telemetry",
        f"{telemetry.lost_bytes} bytes of the file are not frames{where}, and {telemetry.failed} frames "
        f"have a wrong checksum; both were left out. A radio link may cause that; otherwise {_REMEDY}.",
        lost_bytes=telemetry.lost_bytes,
        places=telemetry.places,
        first_byte=telemetry.first_byte,
        wrong_checksums=telemetry.failed,
        frames=telemetry.frames,
    )


def _others(messages: Mapping[str, Messages], sender: tuple[int, int]) -> Iterator[Finding]:
    if "ATTITUDE" not in messages:
        return
    item = messages["ATTITUDE"]
    systems = np.unique(item.system[item.component == _AUTOPILOT_COMPONENT])
    others = systems[systems != sender[0]].tolist()
    if others:
        yield warn(
            "several_vehicles",
            "telemetry",
            f"The log contains several vehicles. System {sender[0]} sent the most messages and was read; "
            f"{', '.join(map(str, others))} left out.",
            read_system=sender[0],
            other_systems=len(others),
        )


_MOTION = ("p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")


def _decimated(topics: tuple[Topic, ...]) -> Finding:
    moving = [topic for topic in topics if any(topic.row(name) is not None for name in _MOTION)]
    fastest = max(moving or topics, key=lambda topic: topic.sample_rate_hz)
    return remark(
        "decimated",
        "telemetry",
        "Telemetry is decimated without a filter, so that faster motion appears as slower: the fastest topic with "
        "motion, "
        f"{fastest.name}, comes at {fastest.sample_rate_hz:.0f} Hz. Use the log on the vehicle's SD card for motor "
        "lag, delay and anything above a fifth of that rate.",
        fastest_hz=fastest.sample_rate_hz,
    )


_NEAR: Mapping[str, tuple[str, str]] = {
    "SERVO_OUTPUT_RAW": ("motor_", "which of its outputs are motors is not known without parameters"),
    "ESC_TELEMETRY_1_TO_4": ("motor_speed_", "which motors it is of is not known without parameters"),
}
"""Messages near to channels that a log may lack: these, and why they do not come from there."""


def _unread(messages: Mapping[str, Messages], topics: tuple[Topic, ...]) -> Iterator[Unread]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    for name, (channels, why) in _NEAR.items():
        item = Unread(name=name, channels=(channels,), why=why)
        if name in messages and not any(map(item.near, logged)):
            yield item


def _missing(topics: tuple[Topic, ...], unread: tuple[Unread, ...]) -> Iterator[Finding]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    if not any(name.endswith("_command") or name.startswith("motor_") for name in logged):
        near = unread_words(unread, ("motor_1",))
        known = f"{near}. " if near else ""
        yield warn(
            "missing_channel",
            "motor_1",
            f"The motor commands are not in the log. {known}They need SERVO_OUTPUT_RAW and the parameters "
            "SERVOn_FUNCTION or FRAME_CLASS of ArduPilot or MAV_TYPE of PX4, or ACTUATOR_CONTROL_TARGET of PX4.",
        )


_UNITS_PER_S = {"time_boot_ms": 1e3, "time_usec": 1e6}
_LARGEST_DELAY_S = 60.0
"""A radio link that is later than this does not exist; a stamp that is, counts from another origin."""


@dataclass(frozen=True, kw_only=True, slots=True)
class BootClock:
    r"""The boot of the autopilot on the clock of the ground station.

    A message that was sent at :math:`t` after the boot is received at :math:`t + t_0 + d` with a delay
    :math:`d \ge 0`; the smallest difference of the two stamps is the best estimate of :math:`t_0`. It assumes that the
    two clocks run equally fast: a drift of 50 ppm is 90 ms in half an hour, which only messages without a stamp feel.

    Parameters
    ----------
    boot_s
        :math:`t_0`, seconds since 1970; the first reception when nothing in the log is stamped.
    restarts
        How often the autopilot began to count anew.
    """

    boot_s: float
    restarts: int = 0

    @classmethod
    def of(cls, messages: Iterable[Messages]) -> BootClock:
        """The clock of messages that carry ``time_boot_ms``."""
        messages = list(messages)
        stamped = [item for item in messages if "time_boot_ms" in (item.fields.dtype.names or ())]
        if not stamped:
            return cls(boot_s=min((float(item.received_us.min()) * 1e-6 for item in messages), default=0.0))
        longest = max(stamped, key=lambda item: item.fields.size)
        booted = [item.received_us * 1e-6 - item.fields["time_boot_ms"] * 1e-3 for item in stamped]
        # A restart takes the count back to zero; packets that overtake one another take it back by less than this.
        steps = np.diff(longest.fields["time_boot_ms"].astype(np.int64))
        return cls(
            boot_s=min(float(item.min()) for item in booted), restarts=int(np.count_nonzero(steps < -_RESTART_MS))
        )

    def stamps(self, messages: Messages) -> FloatArray:
        """Seconds since boot, shape ``(messages,)``: the message's own stamps, or when it was received.

        A stamp of 32 bits in microseconds wraps every 71.6 minutes; the time of reception says how often it did.
        """
        received = messages.received_us * 1e-6 - self.boot_s
        field = next((name for name in _UNITS_PER_S if name in (messages.fields.dtype.names or ())), None)
        if field is None:
            return np.asarray(received, dtype=np.float64)
        own = messages.fields[field] / _UNITS_PER_S[field]
        if field == "time_boot_ms":
            return np.asarray(own, dtype=np.float64)
        if messages.fields.dtype[field].itemsize == 4:
            span = 2.0**32 * 1e-6
            own = own + span * np.round((received - own) / span)
        # Some firmware stamps by the time of day instead of the time since boot.
        foreign = np.abs(received - own) > _LARGEST_DELAY_S
        return np.asarray(np.where(foreign, received, own), dtype=np.float64)

    def findings(self) -> Iterator[Finding]:
        """What to remark about the clock."""
        if self.restarts:
            yield warn(
                "clock_skew",
                "time_boot_ms",
                f"The autopilot restarted {self.restarts} times within the log, and its clock with it: stamps "
                "of the parts overlap. Cut the log at the restart and read the parts one by one.",
                restarts=self.restarts,
            )


_RESTART_MS = 5_000


@dataclass(frozen=True, kw_only=True, slots=True)
class Rule:
    """Fields of a message and the channels that they are; MAVLink speaks FRD and NED throughout.

    Parameters
    ----------
    message, fields
        As the protocol names them.
    channels
        One for each field; three Euler angles for the four parts of a quaternion.
    unit
        Unit of the numbers in the message.
    ignored_by
        Bits of ``type_mask`` that declare the fields void.
    """

    message: str
    fields: tuple[str, ...]
    channels: tuple[str, ...]
    unit: str
    ignored_by: int = 0


def _rule(message: str, fields: str, channels: str, unit: str, ignored_by: int = 0) -> Rule:
    return Rule(
        message=message,
        fields=tuple(fields.split()),
        channels=tuple(channels.split()),
        unit=unit,
        ignored_by=ignored_by,
    )


_GYRO, _ACCELEROMETER = ("xgyro ygyro zgyro", "p q r"), ("xacc yacc zacc", "ax ay az")
_COMMANDS = "roll_command pitch_command yaw_command thrust_command"
_TARGET_RATES = "body_roll_rate body_pitch_rate body_yaw_rate"
_INTEGER_IMUS = ("SCALED_IMU", "RAW_IMU", "SCALED_IMU2", "SCALED_IMU3")

RULES: tuple[Rule, ...] = (
    _rule("ACTUATOR_CONTROL_TARGET", "control0 control1 control2 control3", _COMMANDS, "1"),
    _rule("ATTITUDE_TARGET", "thrust", "thrust_command", "1", 64),
    _rule("HIGHRES_IMU", *_GYRO, "rad/s"),
    _rule("HIGHRES_IMU", *_ACCELEROMETER, "m/s^2"),
    _rule("ATTITUDE", "rollspeed pitchspeed yawspeed", "p q r", "rad/s"),
    _rule("ATTITUDE", "roll pitch yaw", "phi theta psi", "rad"),
    _rule("ATTITUDE_QUATERNION", "rollspeed pitchspeed yawspeed", "p q r", "rad/s"),
    _rule("ATTITUDE_QUATERNION", "q1 q2 q3 q4", "phi theta psi", "1"),
    *(_rule(name, *_GYRO, "mrad/s") for name in _INTEGER_IMUS),
    *(_rule(name, *_ACCELEROMETER, "mg") for name in _INTEGER_IMUS),
    _rule("LOCAL_POSITION_NED", "vx vy vz", "velocity_north velocity_east velocity_down", "m/s"),
    _rule("LOCAL_POSITION_NED", "x y z", "north east down", "m"),
    _rule("ATTITUDE_TARGET", "qw qx qy qz", "phi_setpoint theta_setpoint psi_setpoint", "1", 128),
    _rule("ATTITUDE_TARGET", _TARGET_RATES, "p_setpoint q_setpoint r_setpoint", "rad/s", 7),
    _rule("SYS_STATUS", "voltage_battery", "battery_voltage", "mV"),
)
"""In order of preference. The rates of ``ATTITUDE`` are finer than the whole milliradians of the integer sensors."""

_ATTITUDE_GROUP = 0
_UNKNOWN_VOLTAGE = 0xFFFF


def _message_topics(messages: Mapping[str, Messages], clock: BootClock, *, scaled_raw: bool) -> Iterator[Topic]:
    """Topics of the messages in ``RULES``, best first.

    Parameters
    ----------
    messages
        Name to messages of one autopilot.
    scaled_raw
        Whether ``RAW_IMU`` is in the units of ``SCALED_IMU``, as ArduPilot sends it; elsewhere its numbers are counts
        of an unknown converter, which are left out.
    """
    for rule in RULES:
        if rule.message not in messages or (rule.message == "RAW_IMU" and not scaled_raw):
            continue
        item = messages[rule.message].chosen(_valid(rule, messages[rule.message]))
        with np.errstate(invalid="ignore"):  # a payload may hold numbers that are none, which are left out
            values = np.stack([item.fields[field].astype(np.float64) for field in rule.fields])
        finite = np.isfinite(values).all(axis=0)
        if not finite.any():
            continue
        values, sources = values[:, finite], [f"{rule.message}.{field}" for field in rule.fields]
        if len(rule.channels) == 3 and len(sources) == 4:
            values, sources = euler_from_quaternion(values), [f"{rule.message}.q"] * 3
        yield Topic(
            name=rule.message,
            time_s=clock.stamps(item)[finite],
            channels=tuple(
                Channel(name=name, unit=STANDARD_UNITS[name], source=source)
                for name, source in zip(rule.channels, sources, strict=True)
            ),
            values=values * parse_unit(rule.unit).factor,
        )


def _valid(rule: Rule, messages: Messages) -> BoolArray:
    """Messages whose fields mean something: not masked, of the attitude group, not the code for "unknown"."""
    fields = messages.fields
    valid: BoolArray = np.ones(fields.size, dtype=np.bool_)
    if rule.ignored_by:
        valid = (fields["type_mask"] & rule.ignored_by) == 0
    elif rule.message == "ACTUATOR_CONTROL_TARGET":
        valid = fields["group_mlx"] == _ATTITUDE_GROUP
    elif rule.message == "SYS_STATUS":
        valid = fields["voltage_battery"] != _UNKNOWN_VOLTAGE
    return valid


def _pulse_topics(
    messages: Mapping[str, Messages], clock: BootClock, parameters: Mapping[str, float]
) -> Iterator[Topic]:
    """Motors and sticks of an ArduPilot vehicle, as far as its parameters say which output is which motor.

    The messages are the ``RCOU`` and ``RCIN`` of its own logs under another name, so that the same rules hold.
    """
    servos, sticks = messages.get("SERVO_OUTPUT_RAW"), messages.get("RC_CHANNELS")
    tables: dict[str, Table] = {}
    if servos is not None:
        first_port = servos.chosen(servos.fields["port"] == 0)
        if first_port.fields.size:
            tables["RCOU"] = _table("RCOU", first_port, clock, "servo", 16)
    if (speeds := _speeds(messages, clock)) is not None:
        tables["ESC"] = speeds
    yield from motor_topics(tables, parameters)
    if sticks is not None:
        topic = stick_topic({"RCIN": _table("RCIN", sticks, clock, "chan", 16)}, parameters)
        if topic is not None:
            yield topic


def _px4_outputs(
    messages: Mapping[str, Messages], clock: BootClock, parameters: Mapping[str, float]
) -> tuple[tuple[Topic, ...], tuple[Finding, ...]]:
    """Motors of a PX4 vehicle from the outputs that it sends: those of its own logs under another name."""
    servos = messages.get("SERVO_OUTPUT_RAW")
    main = None if servos is None else servos.chosen(servos.fields["port"] == 0)
    if main is None or not main.fields.size:
        return (), ()
    arrays: dict[str, AnyArray] = {
        "actuator_outputs/timestamp": np.round(np.maximum(clock.stamps(main), 0.0) * 1e6),
        **{f"actuator_outputs/output[{number}]": main.fields[f"servo{number + 1}_raw"] for number in range(16)},
    }
    if "HEARTBEAT" in messages:
        arrays["vehicle_status/system_type"] = messages["HEARTBEAT"].fields["type"]
    topics, findings, _ = motor_outputs(arrays, parameters)
    return tuple(_renamed(topic) for topic in topics), findings


def _renamed(topic: Topic) -> Topic:
    channels = [
        replace(channel, source=f"SERVO_OUTPUT_RAW.{channel.source.partition('.')[2]}") for channel in topic.channels
    ]
    return replace(topic, name="SERVO_OUTPUT_RAW", channels=tuple(channels))


_ESC_MESSAGES = ("ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8")


def _speeds(messages: Mapping[str, Messages], clock: BootClock) -> Table | None:
    """Speeds of the motor controllers that ever turned, as a table of the autopilot's own kind."""
    kind = np.dtype([("head", f"S{HEADER_BYTES}"), ("TimeUS", "<u8"), ("Instance", "u1"), ("RPM", "<f4")])
    parts = []
    for group, name in enumerate(_ESC_MESSAGES):
        item = messages.get(name)
        if item is None:
            continue
        for place in range(4):
            rpm = item.fields[f"rpm{place + 1}"]
            if rpm.any():
                rows = np.zeros(rpm.size, dtype=kind)
                rows["TimeUS"] = np.round(np.maximum(clock.stamps(item), 0.0) * 1e6)
                rows["Instance"], rows["RPM"] = 4 * group + place, rpm
                parts.append(rows)
    return _as_table("ESC", np.concatenate(parts), "QBf") if parts else None


def _table(name: str, messages: Messages, clock: BootClock, stem: str, count: int) -> Table:
    """Pulse widths as a table of the autopilot's own kind: stamps in microseconds, then ``C1``, ``C2``, …."""
    labels = tuple(f"C{number}" for number in range(1, count + 1))
    kind = np.dtype([("head", f"S{HEADER_BYTES}"), ("TimeUS", "<u8"), *((label, "<u2") for label in labels)])
    rows = np.zeros(messages.fields.size, dtype=kind)
    rows["TimeUS"] = np.round(np.maximum(clock.stamps(messages), 0.0) * 1e6)
    for number, label in enumerate(labels, start=1):
        rows[label] = messages.fields[f"{stem}{number}_raw"]
    return _as_table(name, rows, "Q" + "H" * count)


def _as_table(name: str, rows: AnyArray, letters: str) -> Table:
    """Rows of a head and columns, with the letters of the columns' types."""
    size, columns = rows.dtype.itemsize, (rows.dtype.names or ())[1:]
    layout = Format(number=0, length=size, name=name, letters=letters, columns=columns)
    positions = np.arange(rows.size, dtype=np.int64) * size
    return Table(format=layout, units={}, data=rows.view(np.uint8), positions=positions)
