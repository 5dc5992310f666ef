"""Crazyflie: what is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from rotorid.autopilots.autopilot import Advice, Autopilot, Log, sweep_by_stick
from rotorid.data.display import listed

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord

_COMMANDS = ("roll", "pitch", "yaw", "thrust")
_GROUPS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("p", "q", "r"), "gyro.x, gyro.y, gyro.z"),
        **dict.fromkeys(("ax", "ay", "az"), "acc.x, acc.y, acc.z"),
        **dict.fromkeys(("phi", "theta", "psi"), "stateEstimate.roll, stateEstimate.pitch, stateEstimate.yaw"),
        **{f"{axis}_command": f"controller.cmd_{axis}" for axis in _COMMANDS},
        **{
            f"{name}_setpoint": f"controller.{axis}Rate"
            for name, axis in zip("pqr", ("roll", "pitch", "yaw"), strict=True)
        },
        **{
            f"{name}_setpoint": f"controller.{axis}"
            for name, axis in zip(("phi", "theta", "psi"), ("roll", "pitch", "yaw"), strict=True)
        },
        **{f"motor_{number}": f"pwm.m{number}_pwm" for number in range(1, 5)},
        **{f"motor_speed_{number}": f"rpm.m{number}" for number in range(1, 5)},
        "battery_voltage": "pm.vbatMV",
    }
)
"""Channel to the variables of the firmware that hold it."""


def _logging(_record: FlightRecord, _rate_hz: float, channels: tuple[str, ...]) -> str:
    """The variables to name, or the frequency where none is missing."""
    if variables := list(dict.fromkeys(_GROUPS[channel] for channel in channels if channel in _GROUPS)):
        return f"add {listed(variables)} to config.txt on the card"
    return "set a higher frequency in config.txt on the card"


def _sensors(record: FlightRecord, rate_hz: float) -> str:
    return _logging(record, rate_hz, () if rate_hz else ("p", "az"))


def _motors(record: FlightRecord) -> str:
    return _logging(record, 0.0, tuple(f"motor_{number}" for number in range(1, 5)))


CRAZYFLIE = Autopilot(
    name="Crazyflie",
    key="crazyflie",
    log=Log(own=True, outputs_scaled=True, fields_chosen=True),
    advice=Advice(
        logging=_logging,
        sensors=_sensors,
        motors=_motors,
        speeds=lambda _record: "add rpm.m1, rpm.m2, rpm.m3 and rpm.m4 to config.txt on the card",
        flying=sweep_by_stick,
    ),
    vehicle="crazyflie",
)
