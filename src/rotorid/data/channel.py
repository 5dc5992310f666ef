"""A channel: what a row of numbers is, in which unit, and where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

MOTORS = 16

LOWEST_RATE_HZ = 40.0
"""Rates and commands logged more slowly show neither motor lag nor delay of a small multirotor."""

AXES = ("roll", "pitch", "yaw", "thrust")


_OF_AXES = ("command", "excitation", "setpoint_excitation", "stick")
"""Channels of each axis: what the mixer receives, what was added to it, what was added to a set-point, the stick."""


def _standard() -> Mapping[str, str]:
    units = {f"{axis}_{kind}": "1" for axis in AXES for kind in _OF_AXES}
    units |= {f"motor_{number}": "1" for number in range(1, MOTORS + 1)}
    units |= {f"motor_{number}_excitation": "1" for number in range(1, MOTORS + 1)}
    units |= {f"motor_speed_{number}": "rad/s" for number in range(1, MOTORS + 1)}
    groups = {
        "rad/s": "p q r",
        "rad": "phi theta psi",
        "m/s": "u v w velocity_north velocity_east velocity_down",
        "m": "north east down",
        "m/s^2": "ax ay az",
    }
    controlled = {name: unit for unit, names in groups.items() for name in names.split()}
    units |= controlled
    units |= {f"{name}_setpoint": unit for name, unit in controlled.items() if unit != "m/s^2"}
    units |= {f"{name}_dot": "rad/s^2" for name in "pqr"} | {f"{name}_dot": "m/s^2" for name in "uvw"}
    return MappingProxyType(units | {"battery_voltage": "V"})


STANDARD_UNITS: Mapping[str, str] = _standard()
"""Every channel name of the vocabulary and its SI unit. Axes are FRD/NED, angles radians."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Channel:
    """Name, unit and origin of one row of samples.

    Parameters
    ----------
    name
        A name of the vocabulary (``STANDARD_UNITS``) or one that the user gave.
    unit
        SI unit of the values.
    source
        Where the values stand in the log, as the log names it: ``SIDD.Gx``, ``vehicle_angular_velocity.xyz[0]``.
    """

    name: str
    unit: str
    source: str = ""
