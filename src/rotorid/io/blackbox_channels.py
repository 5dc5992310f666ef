"""Fields of a blackbox flight brought to the vocabulary of the package.

The flight controllers of this family count in x forward, y left, z up: a positive pitch rate takes the nose down, a
positive yaw rate takes it left. Signs of y and z change here and nowhere else.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.data.channel import MOTORS, STANDARD_UNITS, Channel
from rotorid.data.record import Topic
from rotorid.io.blackbox_decode import Flight
from rotorid.io.blackbox_header import Header
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FRD = (1.0, -1.0, -1.0)
STICK_SPAN = 500.0
CONTROLLER_SCALE = 1000.0
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
_REVISION = re.compile(r"(Betaflight|INAV)\D*(\d+)\.(\d+)")


class Row(NamedTuple):
    """A channel and its samples."""

    name: str
    source: str
    values: FloatArray


def main_topic(flight: Flight, extra: tuple[Row, ...] = ()) -> Topic:
    """Everything that a flight logs with its main frames, on one clock."""
    return _topic(f"flight {flight.number}", flight.time_s, (*_rows(flight), *extra))


def _topic(name: str, time_s: FloatArray, rows: tuple[Row, ...]) -> Topic:
    channels = tuple(Channel(name=row.name, unit=STANDARD_UNITS[row.name], source=row.source) for row in rows)
    return Topic(name=name, time_s=time_s, channels=channels, values=np.array([row.values for row in rows]))


def _rows(flight: Flight) -> Iterator[Row]:
    header = flight.header
    motors = tuple(_motors(flight))
    yield from _commands(flight, motors)
    yield from motors
    # High resolution counts tenths.
    tenths = 0.1 if header.number("blackbox_high_resolution") > 0.0 else 1.0
    yield from _body(flight, "gyroADC", "p q r", _gyro_scale(header) * tenths)
    if header.number("acc_1G") > 0.0:
        yield from _body(flight, "accSmooth", "ax ay az", STANDARD_GRAVITY_M_S2 / header.number("acc_1G"))
    setpoint = "setpoint" if "setpoint[0]" in flight.fields else "axisRate"
    yield from _body(flight, setpoint, "p_setpoint q_setpoint r_setpoint", _DEGREE * tenths)
    yield from _body(flight, "rcCommand", "roll_stick pitch_stick yaw_stick", tenths / STICK_SPAN)
    if "rcCommand[3]" in flight.fields:
        throttle = _float(flight, "rcCommand[3]") * tenths
        yield Row("thrust_stick", "rcCommand[3]", (throttle - 1000.0) / 1000.0)
    yield from _motor_speeds(flight)
    yield from _navigation(flight)
    yield from _battery(flight)


def _body(flight: Flight, field: str, names: str, scale: float) -> Iterator[Row]:
    """Three axes of a vector; a flight that logs one of them only has only that one."""
    for index, name in enumerate(names.split()):
        source = f"{field}[{index}]"
        if source in flight.fields:
            yield Row(name, source, _float(flight, source) * (scale * FRD[index]))


def _float(flight: Flight, source: str) -> FloatArray:
    return flight.field(source).astype(np.float64)


def _gyro_scale(header: Header) -> float:
    """Factor to rad/s. The first loggers gave it in rad/µs, all later ones in deg/s."""
    scale = header.number("gyro_scale", 1.0)
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
        for name, weights in QUAD_X.items():
            sign = -1.0 if name == "yaw_command" and motors_reversed(flight.header) else 1.0
            yield Row(name, "motor mix", sign * np.array(weights) @ outputs)
        return
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        parts = [name for term in "PIDFS" if (name := f"axis{term}[{index}]") in flight.fields]
        summed = f"axisSum[{index}]"
        parts = [summed] if summed in flight.fields else parts
        if parts:
            total = sum((_float(flight, part) for part in parts), start=np.zeros(flight.time_s.size)) * (
                FRD[index] / CONTROLLER_SCALE
            )
            yield Row(f"{axis}_command", " + ".join(parts), total)
    if "setpoint[3]" in flight.fields:
        yield Row("thrust_command", "setpoint[3]", _float(flight, "setpoint[3]") / 1000.0)


def motors_reversed(header: Header) -> bool:
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
    """Voltage, where the firmware's version says in what it was counted."""
    revision = _REVISION.search(flight.header.values.get("Firmware revision", ""))
    if revision is None:
        return
    name, version = revision[1], (int(revision[2]), int(revision[3]))
    source = "vbat" if name == "INAV" and "vbat" in flight.fields else "vbatLatest"
    if source not in flight.fields or (name == "Betaflight" and version < (3, 1)):
        return
    yield Row(
        "battery_voltage", source, _float(flight, source) * (0.01 if name == "INAV" or version >= (4, 0) else 0.1)
    )
