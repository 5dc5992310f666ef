"""What the kernels of the nonlinear flight take: plain numbers and arrays under names, nothing else.

Value objects with checks and documentation make these (`rotorid.simulate.multirotor`, `autopilot`, `sensors`); compiled
code reads them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rotorid.typing import FloatArray, IntArray

STATES = 13
"""Position, velocity (north, east, down), quaternion (w, x, y, z; body to earth), rates. The rotors come after."""


class Body(NamedTuple):
    """A rigid body and its rotors. Forces and moments are about the center of gravity, in body axes."""

    mass: float
    gravity: float
    inertia: FloatArray
    """Shape ``(3, 3)``."""
    inverse_inertia: FloatArray
    aerodynamics: FloatArray
    """Force and moment per air velocity and rate, shape ``(6, 6)``."""
    has_aerodynamics: bool
    quadratic_drag: FloatArray
    """N/(m/s)² along each axis, shape ``(3,)``."""
    has_quadratic_drag: bool
    effectiveness: FloatArray
    """Force and moment per newton of thrust, without the torque of the rotors, shape ``(6, rotors)``."""
    torque_axes: FloatArray
    """Moment per newton meter of torque, shape ``(3, rotors)``."""
    hubs: FloatArray
    """Where the rotors sit, shape ``(rotors, 3)``."""
    thrust: FloatArray
    """Coefficients of the speed's powers 0 to 2, N."""
    torque: FloatArray
    """The same, N m."""
    lag_up: float
    lag_down: float
    has_lag: bool
    """Without one, the speeds are the outputs."""
    induced_drag: float
    """N/(m/s) at full speed."""
    inclined: bool
    inflow: float
    """Newtons of thrust per m/s of descent at full speed; negative for climb that unloads."""
    has_air: bool
    """Whether the rotors feel how they move through the air."""
    spin_momentum: FloatArray
    """Angular momentum of each rotor at full speed, shape ``(3, rotors)``."""
    has_spin: bool


class Supply(NamedTuple):
    """A battery."""

    voltage_full: float
    voltage_empty: float
    voltage_rated: float
    resistance_ohm: float
    capacity_as: float
    current_per_power: float
    """Ampere per newton to the power 1.5, all rotors together."""
    present: bool


class Senses(NamedTuple):
    """Sensors; noise is the standard deviation of each sample."""

    gyro_noise: float
    gyro_bias: FloatArray
    gyro_lag_s: float
    gyro_step: float
    gyro_vibration: float
    accelerometer_noise: float
    accelerometer_bias: FloatArray
    accelerometer_lag_s: float
    accelerometer_step: float
    accelerometer_vibration: float
    accelerometer_place: FloatArray
    attitude_noise: float
    velocity_noise: float
    position_noise: float
    blade_rad_s: float
    """Speed of a rotor at full output, for vibration."""


class Control(NamedTuple):
    """An autopilot. Arrays of three are roll, pitch, yaw."""

    tick_s: float
    substeps: int
    proportional: FloatArray
    integral: FloatArray
    derivative: FloatArray
    feedforward: FloatArray
    integral_limit: FloatArray
    derivative_of_error: bool
    derivative_keep: FloatArray
    """What first-order filters keep of the last sample: of the derivative, the error, the target, the command."""
    error_keep: FloatArray
    target_keep: FloatArray
    command_keep: FloatArray
    gyro_filter: FloatArray
    """b0 b1 b2 a1 a2 of the filter of the rates."""
    accelerometer_filter: FloatArray
    angle: FloatArray
    rate_limit: FloatArray
    tilt_limit: float
    velocity_p: float
    velocity_i: float
    position_p: float
    climb_p: float
    climb_i: float
    height_p: float
    hold_velocity: bool
    heading_follows: bool
    """Whether the heading set-point follows the vehicle while the yaw stick is out."""
    hold_height: bool
    tilt_compensation: bool
    stick_tilt: float
    stick_yaw_rate: float
    stick_climb: float
    stick_thrust: float
    hover_thrust: float
    mixer: FloatArray
    """Shape ``(rotors, 4)``."""
    low: float
    high: float
    expo: float
    output_low: float
    output_high: float
    voltage_max: float
    voltage_min: float
    delay_steps: IntArray
    """Of each command, in steps of the integrator."""


def plain(values: ArrayLike) -> FloatArray:
    """A fresh array. Kernels are compiled anew for integers, for read-only arrays and for other orders in memory."""
    return np.array(values, dtype=np.float64, order="C")
