"""Physical limits of channels: bounds that no flying multirotor passes, wide enough for every sensor.

A value outside is damage of the log, not motion. The bounds hold in the units of the vocabulary; what drives a motor in
another one (volts, microseconds) is no share of full output, and has wider ones of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from rotorid.data.record import AXES, MOTORS, STANDARD_UNITS, Channel, units_of

FASTEST_RATE_RAD_S = math.radians(4000.0)
"""End of the range of the fastest gyros in flight controllers."""

HIGHEST_SHARE = 1.2
"""Motor output as a part of its range: pulses somewhat beyond the calibrated ones are real."""

_LOWEST_SHARE = -1.5
"""Reversed motors, and outputs without a pulse: 0 µs of a range from 1100 to 1900 µs is -1.4."""


def _ranges() -> Mapping[str, tuple[float, float]]:
    def within(names: str | list[str], bound: float) -> dict[str, tuple[float, float]]:
        return dict.fromkeys(names.split() if isinstance(names, str) else names, (-bound, bound))

    numbers = range(1, MOTORS + 1)
    found = dict.fromkeys([f"motor_{number}" for number in numbers], (_LOWEST_SHARE, HIGHEST_SHARE))
    found |= within([f"motor_{number}_excitation" for number in numbers], 2.0)
    found |= within([f"{name}_{number}" for name in ("motor_speed", "notch_frequency") for number in numbers], 2e4)
    # A mixer's input may well exceed one: nothing but a slip of units makes it a hundred.
    found |= within([f"{axis}_{kind}" for axis in AXES for kind in ("command", "excitation")], 100.0)
    found |= within([f"{axis}_setpoint_excitation" for axis in AXES], 100.0)
    found |= within([f"{axis}_stick" for axis in AXES], 5.0)
    found |= within("p q r p_setpoint q_setpoint r_setpoint", FASTEST_RATE_RAD_S)
    found |= within("p_raw q_raw r_raw p_filtered q_filtered r_filtered", FASTEST_RATE_RAD_S)
    found |= within([f"{axis}_{term}_term" for axis in AXES[:3] for term in "pidf"], 100.0)
    found |= dict.fromkeys([f"{axis}_slew_factor" for axis in AXES[:3]], (0.0, 2.0))
    found |= within("wind_north wind_east", 300.0) | {"accel_clips": (0.0, 1e10), "hover_thrust": (-1.0, 2.0)}
    accelerations = [f"{name}_{stage}" for name in ("ax", "ay", "az") for stage in ("raw", "filtered", "vibration")]
    found |= within(accelerations, 2000.0)
    # Angles may be unwrapped, over many turns in yaw.
    found |= within("phi theta phi_setpoint theta_setpoint", 100.0) | within("psi psi_setpoint", 1e4)
    speeds = "u v w velocity_north velocity_east velocity_down"
    found |= within(f"{speeds} {' '.join(f'{name}_setpoint' for name in speeds.split())}", 300.0)
    found |= within("velocity_forward velocity_right", 300.0)
    ways = ("north", "east", "down")
    found |= within([f"velocity_{way}_feedforward" for way in ways], 300.0)
    found |= within([f"acceleration_{way}_setpoint" for way in ways], 2000.0)
    places = "north east down"
    found |= within(f"{places} {' '.join(f'{name}_setpoint' for name in places.split())}", 1e6)
    # 200 g: what the coarsest accelerometers end at.
    found |= within("ax ay az u_dot v_dot w_dot", 2000.0) | within("p_dot q_dot r_dot", 1e5)
    found |= within("velocity_forward_dot velocity_right_dot velocity_down_dot", 2000.0)
    return MappingProxyType(found | {"battery_voltage": (-1.0, 1000.0), "battery_current": (-2000.0, 2000.0)})


RANGES: Mapping[str, tuple[float, float]] = _ranges()
"""Channel of the vocabulary to its lowest and highest possible value, in its standard unit."""

BENCH_RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"V": (-1000.0, 1000.0), "us": (-5000.0, 5000.0), "rad/s": (-2e4, 2e4)}
)
"""Unit of what drives a motor on a bench to its lowest and highest value; differences from trim are negative."""

_MOTIONS = "p q r phi theta psi u v w velocity_north velocity_east velocity_down north east down ax ay az"

MEASURED = frozenset(_MOTIONS.split())
"""Channels of sensors and estimators, which follow a motion: they cannot jump and be back one sample later."""

TURNING = frozenset({"phi", "theta", "psi", "phi_setpoint", "theta_setpoint", "psi_setpoint"})
"""Angles, which may step by a whole turn between two samples."""


def range_of(channel: Channel) -> tuple[float, float] | None:
    """Lowest and highest possible value of a channel, or ``None`` if unknown.

    Parameters
    ----------
    channel
        Its name and its unit; of what drives a motor in another unit than the vocabulary's only damage is known.

    Examples
    --------
    >>> range_of(Channel(name="motor_1", unit="1"))
    (-1.5, 1.2)
    >>> range_of(Channel(name="motor_1", unit="V")), range_of(Channel(name="p", unit="1"))
    ((-1000.0, 1000.0), None)
    """
    if channel.unit == STANDARD_UNITS.get(channel.name):
        return RANGES.get(channel.name)
    return BENCH_RANGES.get(channel.unit) if channel.unit in units_of(channel.name) else None
