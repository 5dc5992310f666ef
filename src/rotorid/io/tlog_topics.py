"""Which field of which MAVLink message is which channel, as a table, and the topics they make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.record import Topic
from rotorid.frames import euler_from_quaternion
from rotorid.io.ardupilot_actuators import motor_topics, stick_topic
from rotorid.io.dataflash_formats import HEADER_BYTES, Format, Table
from rotorid.io.mavlink import Messages
from rotorid.io.tlog_clock import BootClock
from rotorid.typing import BoolArray
from rotorid.units import parse_unit


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


def message_topics(messages: Mapping[str, Messages], clock: BootClock, *, scaled_raw: bool) -> Iterator[Topic]:
    """Topics of the messages in ``RULES``, best first.

    Parameters
    ----------
    messages
        Name to messages of one autopilot.
    clock
        Its clock.
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
            values=values * _factor(rule.unit),
        )


def _factor(unit: str) -> float:
    # A thousandth of standard gravity is a unit of this protocol alone.
    return 1e-3 * parse_unit("g").factor if unit == "mg" else parse_unit(unit).factor


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


def pulse_topics(
    messages: Mapping[str, Messages], clock: BootClock, parameters: Mapping[str, float]
) -> Iterator[Topic]:
    """Motors and sticks of an ArduPilot vehicle, as far as its parameters say which output is which motor.

    The messages are the ``RCOU`` and ``RCIN`` of its own logs under another name, so that the same rules hold.
    """
    servos, sticks = messages.get("SERVO_OUTPUT_RAW"), messages.get("RC_CHANNELS")
    if servos is not None:
        first_port = servos.chosen(servos.fields["port"] == 0)
        if first_port.fields.size:
            yield from motor_topics({"RCOU": _table("RCOU", first_port, clock, "servo", 16)}, parameters)
    if sticks is not None:
        topic = stick_topic({"RCIN": _table("RCIN", sticks, clock, "chan", 16)}, parameters)
        if topic is not None:
            yield topic


def _table(name: str, messages: Messages, clock: BootClock, stem: str, count: int) -> Table:
    """Pulse widths as a table of the autopilot's own kind: stamps in microseconds, then ``C1``, ``C2``, …."""
    labels = tuple(f"C{number}" for number in range(1, count + 1))
    kind = np.dtype([("head", f"S{HEADER_BYTES}"), ("TimeUS", "<u8"), *((label, "<u2") for label in labels)])
    rows = np.zeros(messages.fields.size, dtype=kind)
    rows["TimeUS"] = np.round(np.maximum(clock.stamps(messages), 0.0) * 1e6)
    for number, label in enumerate(labels, start=1):
        rows[label] = messages.fields[f"{stem}{number}_raw"]
    layout = Format(number=0, length=kind.itemsize, name=name, letters="Q" + "H" * count, columns=("TimeUS", *labels))
    positions = np.arange(rows.size, dtype=np.int64) * kind.itemsize
    return Table(format=layout, units={}, data=rows.view(np.uint8), positions=positions)
