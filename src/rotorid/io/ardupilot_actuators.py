"""Motors and sticks of an ArduPilot log: which channel is which, and what its pulse widths mean."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.record import Topic
from rotorid.io.ardupilot_channels import Row, instances, topic_of
from rotorid.io.dataflash_formats import Table

MOTOR_FUNCTIONS: Mapping[int, int] = MappingProxyType(
    {function: function - 32 for function in range(33, 41)} | {function: function - 73 for function in range(82, 86)}
)
"""``SERVOn_FUNCTION`` to the number of the motor."""

FRAME_CLASS_MOTORS: Mapping[int, int] = MappingProxyType({1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10})
"""``FRAME_CLASS`` to the number of motors."""

FRAME_NAME_MOTORS: Mapping[str, int] = MappingProxyType(
    {"QUAD": 4, "HEXA": 6, "OCTA": 8, "OCTA_QUAD": 8, "OCTAQUAD": 8, "Y6": 6, "TRI": 3, "DECA": 10, "DODECAHEXA": 12}
)
"""The same as the message ``Frame: QUAD/X`` names it."""

DSHOT_TYPES = range(4, 8)
"""``MOT_PWM_TYPE`` of digital protocols, which know no limits but 1000 and 2000."""

STICKS: Mapping[str, tuple[str, int]] = MappingProxyType(
    {"roll": ("RCMAP_ROLL", 1), "pitch": ("RCMAP_PITCH", 2), "yaw": ("RCMAP_YAW", 4), "thrust": ("RCMAP_THROTTLE", 3)}
)
"""Axis to the parameter that names its stick's channel, and the usual channel."""


def motor_channels(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Mapping[int, int]:
    """Output channel to motor number, from 1; empty when the log does not say how many motors there are."""
    functions = {
        int(match[1]): int(value) for name, value in parameters.items() if (match := _SERVO_FUNCTION.fullmatch(name))
    }
    if functions:
        return {
            channel: MOTOR_FUNCTIONS[function]
            for channel, function in sorted(functions.items())
            if function in MOTOR_FUNCTIONS
        }
    count = FRAME_CLASS_MOTORS.get(int(parameters.get("FRAME_CLASS", 0.0)), 0) or _announced_motors(tables)
    return {motor: motor for motor in range(1, count + 1)}


_SERVO_FUNCTION = re.compile(r"SERVO(\d{1,2})_FUNCTION")


def _announced_motors(tables: Mapping[str, Table]) -> int:
    if "MSG" not in tables or not tables["MSG"].holds_text("Message"):
        return 0
    texts = tables["MSG"].column("Message").tolist()
    frames = (re.split(r"[ /]", text.removeprefix("Frame: "))[0] for text in texts if text.startswith("Frame: "))
    return next((FRAME_NAME_MOTORS[frame] for frame in frames if frame in FRAME_NAME_MOTORS), 0)


def motor_topics(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Iterator[Topic]:
    """Motor outputs, 0 to 1 over the range of the pulse width, and measured motor speeds."""
    motors = motor_channels(tables, parameters)
    if "RCOU" in tables:
        low, high = _motor_range(parameters)
        rows = [
            Row(f"C{channel}", f"motor_{motor}", "1", 1.0 / (high - low), -low / (high - low))
            for channel, motor in sorted(motors.items(), key=lambda pair: pair[1])
        ]
        topic = topic_of(tables["RCOU"], rows)
        if topic is not None:
            yield topic
    yield from _speed_topics(tables, motors)


def _motor_range(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Pulse widths of no and of full output: as set for the motors, or else the throttle stick's (old firmware)."""
    if int(parameters.get("MOT_PWM_TYPE", 0.0)) in DSHOT_TYPES:
        return 1000.0, 2000.0
    throttle = int(parameters.get("RCMAP_THROTTLE", 3.0))
    for low_name, high_name in (("MOT_PWM_MIN", "MOT_PWM_MAX"), (f"RC{throttle}_MIN", f"RC{throttle}_MAX")):
        low, high = parameters.get(low_name, 0.0), parameters.get(high_name, 0.0)
        if 0.0 < low < high:
            return low, high
    return 1000.0, 2000.0


def _speed_topics(tables: Mapping[str, Table], motors: Mapping[int, int]) -> Iterator[Topic]:
    """Speeds that the motor controllers report; each numbers itself by its output channel, from 0."""
    table = tables.get("ESC")
    numbers = None if table is None else instances(table)
    for channel, motor in motors.items():
        row = Row("RPM", f"motor_speed_{motor}", "rpm")
        topic = None
        if table is not None and numbers is not None and bool(np.any(numbers == channel - 1)):
            topic = topic_of(table, [row], name=f"ESC[{channel - 1}]", chosen=numbers == channel - 1)
        elif f"ESC{channel}" in tables:
            topic = topic_of(tables[f"ESC{channel}"], [row])
        if topic is not None:
            yield topic


def stick_topic(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Topic | None:
    """Sticks, −1 to 1 and 0 to 1 for the throttle, with the calibration and direction of the log's parameters."""
    if "RCIN" not in tables:
        return None
    return topic_of(tables["RCIN"], [_stick(axis, parameters) for axis in AXES])


def _stick(axis: str, parameters: Mapping[str, float]) -> Row:
    name, usual = STICKS[axis]
    channel = int(parameters.get(name, usual))
    low = parameters.get(f"RC{channel}_MIN", 1000.0)
    high = parameters.get(f"RC{channel}_MAX", 2000.0)
    span = high - low if high > low else 1000.0
    if axis == "thrust":
        return Row(f"C{channel}", "thrust_stick", "1", 1.0 / span, -low / span)
    center = parameters.get(f"RC{channel}_TRIM", 1500.0)
    reversed_ = parameters.get(f"RC{channel}_REVERSED", 0.0) == 1.0 or parameters.get(f"RC{channel}_REV", 1.0) == -1.0
    slope = (-2.0 if reversed_ else 2.0) / span
    return Row(f"C{channel}", f"{axis}_stick", "1", slope, -center * slope)
