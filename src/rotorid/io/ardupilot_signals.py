"""What each message of an ArduPilot log says of a flight: columns of the vocabulary in the log's units and directions.

The inverse of :mod:`rotorid.io.ardupilot_channels` and :mod:`rotorid.io.ardupilot_actuators`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.channel import MOTORS
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io.ardupilot_actuators import DSHOT_TYPES, STICKS, motor_channels
from rotorid.typing import AnyArray, FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Values: TypeAlias = Mapping[str, AnyArray | float]
"""Column to its values, one for every message or one for all of them."""

CHANNELS = 14
"""Channels of ``RCIN`` and ``RCOU``."""

DEGREES = 180.0 / math.pi
_THRUST_EXPO = 0.65
"""ArduPilot's ``MOT_THST_EXPO`` where nothing is set."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Logged:
    """The samples of a flight that become messages of one kind.

    Parameters
    ----------
    flown
        The flight.
    samples
        Their indices.
    parameters
        Parameters of the log.
    """

    flown: SimulatedFlight
    samples: IntArray
    parameters: Mapping[str, float]

    def __getitem__(self, name: str) -> FloatArray:
        """A column at those samples; zeros when the flight does not know it."""
        column = self.flown.columns.get(name)
        return np.zeros(self.samples.size) if column is None else column[self.samples]

    def degrees(self, **columns: str) -> dict[str, FloatArray]:
        """Columns in degrees, or degrees per second: ``R="p"``."""
        return {column: self[name] * DEGREES for column, name in columns.items()}

    def parameter(self, name: str, usual: float = 0.0) -> float:
        return self.parameters.get(name, usual)


def rate_values(logged: Logged) -> Values:
    """``RATE``: rates and their set-points, the mixer's inputs, and the vertical acceleration, upward."""
    return {
        **logged.degrees(R="p", P="q", Y="r", RDes="p_setpoint", PDes="q_setpoint", YDes="r_setpoint"),
        "ROut": logged["roll_command"],
        "POut": logged["pitch_command"],
        "YOut": logged["yaw_command"],
        "AOut": logged["thrust_command"],
        "A": _climbing_acceleration_cm_s2(logged),
    }


def _climbing_acceleration_cm_s2(logged: Logged) -> FloatArray:
    if "az" not in logged.flown.columns:
        return np.zeros(logged.samples.size)
    phi, theta = logged["phi"], logged["theta"]
    # Third row of the rotation from body to earth.
    down = -np.sin(theta) * logged["ax"] + np.cos(theta) * (np.sin(phi) * logged["ay"] + np.cos(phi) * logged["az"])
    climbing: FloatArray = -100.0 * (down + STANDARD_GRAVITY_M_S2)
    return climbing


def attitude_values(logged: Logged) -> Values:
    """``ATT``: roll and pitch as they are, yaw from 0 to 360 degrees."""
    level = logged.degrees(Roll="phi", DesRoll="phi_setpoint", Pitch="theta", DesPitch="theta_setpoint")
    return {**level, "Yaw": _heading(logged["psi"]), "DesYaw": _heading(logged["psi_setpoint"])}


def _heading(angle: FloatArray) -> FloatArray:
    return np.mod(angle * DEGREES, 360.0)


def angle_values(logged: Logged) -> Values:
    """``ANG``: the attitude of every turn of the loop."""
    return {**attitude_values(logged), "Dt": 1.0 / logged.flown.sample_rate_hz}


def imu_values(logged: Logged) -> Values:
    """``IMU``: rates and accelerations after the autopilot's filters."""
    gyro = {"GyrX": logged["p"], "GyrY": logged["q"], "GyrZ": logged["r"]}
    accelerometer = {"AccX": logged["ax"], "AccY": logged["ay"], "AccZ": logged["az"]}
    rate_hz = logged.flown.sample_rate_hz
    return {**gyro, **accelerometer, "GH": 1.0, "AH": 1.0, "GHz": rate_hz, "AHz": rate_hz}


def estimate_values(logged: Logged) -> Values:
    """``XKF1``: velocity, position and attitude of the estimator."""
    return {
        **logged.degrees(Roll="phi", Pitch="theta"),
        # Rounded to hundredths as the log holds it, 360 degrees are none.
        "Yaw": np.mod(np.round(_heading(logged["psi"]), 2), 360.0),
        "VN": logged["velocity_north"],
        "VE": logged["velocity_east"],
        "VD": logged["velocity_down"],
        "dPD": logged["velocity_down"],
        "PN": logged["north"],
        "PE": logged["east"],
        "PD": logged["down"],
    }


def battery_values(logged: Logged) -> Values:
    """``BAT``: the voltage, which also stands for the one at rest."""
    volts = logged["battery_voltage"]
    return {"Volt": volts, "VoltR": volts, "H": 1.0}


def throttle_values(logged: Logged) -> Values:
    """``CTUN``: throttle, altitude and climb."""
    pilot = "thrust_stick" if "thrust_stick" in logged.flown.columns else "thrust_command"
    height = -logged["down"]
    return {
        "ThI": logged[pilot],
        "ThO": logged["thrust_command"],
        "ThH": logged.parameter("MOT_THST_HOVER"),
        "Alt": height,
        "BAlt": height,
        "DSAlt": math.nan,
        "CRt": -100.0 * logged["velocity_down"],
    }


def lift_values(logged: Logged) -> Values:
    """``MOTB``: what the voltage leaves of the lift, as ArduPilot's compensation of the battery reckons it."""
    full, empty = logged.parameter("MOT_BAT_VOLT_MAX"), logged.parameter("MOT_BAT_VOLT_MIN")
    expo = logged.parameter("MOT_THST_EXPO", _THRUST_EXPO)
    known = "battery_voltage" in logged.flown.columns and 0.0 < empty < full
    part = np.clip(logged["battery_voltage"], empty, full) / full if known else np.ones(logged.samples.size)
    throttle = logged["thrust_command"]
    return {
        "LiftMax": (1.0 - expo) * part + expo * part**2,
        "BatVolt": part,
        "ThLimit": 1.0,
        "ThrAvMx": throttle,
        "ThrOut": throttle,
    }


def output_values(logged: Logged) -> Values:
    """``RCOU``: pulse widths of the motors on their channels, microseconds.

    Raises
    ------
    UsageError
        A motor stands on a channel that the message does not have, or on none.
    """
    low, high = logged.parameter("MOT_PWM_MIN"), logged.parameter("MOT_PWM_MAX")
    if int(logged.parameter("MOT_PWM_TYPE")) in DSHOT_TYPES:
        low, high = 1000.0, 2000.0
    channels = {motor: channel for channel, motor in motor_channels({}, logged.parameters).items()}
    values = {}
    for number in range(1, MOTORS + 1):
        if f"motor_{number}" in logged.flown.columns:
            if channels.get(number, CHANNELS + 1) > CHANNELS:
                raise UsageError(
                    f"motor {number} stands on no channel of RCOU",
                    needed=f"a parameter SERVOn_FUNCTION for it, n from 1 to {CHANNELS}",
                )
            values[f"C{channels[number]}"] = low + (high - low) * logged[f"motor_{number}"]
    return values


def stick_values(logged: Logged) -> Values:
    """``RCIN``: pulse widths of the sticks, with the calibration and direction of the parameters; others centered."""
    values: dict[str, AnyArray | float] = {f"C{channel}": 1500.0 for channel in range(1, CHANNELS + 1)}
    for axis, (name, usual) in STICKS.items():
        if f"{axis}_stick" in logged.flown.columns:
            channel = int(logged.parameter(name, usual))
            values[f"C{channel}"] = _pulse_widths(logged, axis, f"RC{channel}")
    return values


def _pulse_widths(logged: Logged, axis: str, prefix: str) -> FloatArray:
    low, high = logged.parameter(f"{prefix}_MIN", 1000.0), logged.parameter(f"{prefix}_MAX", 2000.0)
    span = high - low if high > low else 1000.0
    if axis == "thrust":
        return low + span * logged["thrust_stick"]
    reversed_ = logged.parameter(f"{prefix}_REVERSED") == 1.0 or logged.parameter(f"{prefix}_REV", 1.0) == -1.0
    slope = -0.5 * span if reversed_ else 0.5 * span
    return logged.parameter(f"{prefix}_TRIM", 1500.0) + slope * logged[f"{axis}_stick"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Signal:
    """A message at a fixed rate.

    Parameters
    ----------
    needed
        Columns without which it is not written.
    values
        What it says.
    rate_hz
        Its rate, whatever ``LOG_BITMASK`` says; without one every turn of the loop is logged.
    """

    needed: tuple[str, ...]
    values: Callable[[Logged], Values]
    rate_hz: float = math.inf


def _signals() -> Iterator[tuple[str, str, Callable[[Logged], Values], float]]:
    yield "ANG", "phi theta psi", angle_values, math.inf
    yield "RATE", "p q r roll_command pitch_command yaw_command thrust_command", rate_values, math.inf
    yield "IMU", "p q r ax ay az", imu_values, math.inf
    yield "XKF1", "velocity_north velocity_east velocity_down north east down", estimate_values, 25.0
    yield "BAT", "battery_voltage", battery_values, 10.0
    yield "CTUN", "thrust_command", throttle_values, 10.0
    yield "ATT", "phi theta psi", attitude_values, 10.0
    yield "MOTB", "battery_voltage thrust_command", lift_values, 10.0
    yield "RCIN", "roll_stick pitch_stick yaw_stick thrust_stick", stick_values, 10.0
    yield "RCOU", "motor_1", output_values, 10.0


SIGNALS: Mapping[str, Signal] = MappingProxyType(
    {
        name: Signal(needed=tuple(needed.split()), values=values, rate_hz=rate_hz)
        for name, needed, values, rate_hz in _signals()
    }
)
"""Message to what it says, with the rates of a vehicle that logs fast attitude and fast IMU."""
