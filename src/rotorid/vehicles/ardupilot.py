r"""The default quadrotor of ArduPilot's simulator, an X of 3 kg, as in its logs.

With the output :math:`x`, the share :math:`c = (x - 0.15)/0.8` between the ends of its range, and the weight
:math:`m g`,

.. math::

    T_i = 18.83\,\mathrm{N}\; (0.35\, c_i + 0.65\, c_i^2), \qquad
    F = -0.723 \, V - 0.109 \, (u |u|, v |v|, w |w|)^T, \qquad M = -1.987\,\mathrm{s}^{-1} I \omega

without lag of the motors. Mass, inertia, arm, thrust, range and expo are those of its frame. The linear drag and the
damping were measured in flights in calm air, the drag that grows with the square follows from the simulator's reference
speed. The controller undoes the curve, so that thrust is linear in its demand: 20.29 N per unit, measured, of which
18.83 N are the largest thrust and the rest is what compensation of voltage and density added in that flight. Gains are
those of the log.

What is ours: the simulator's torque grows with thrust times output, ours with thrust alone and the same slope in hover.
The battery has 12.6 V throughout, as there, and the controller does not compensate it. No delay is set: a command that
is held for a turn of the loop, and rates that are logged as means over one, show 2.5 ms together, and that is what the
simulator's logs show (2.4 to 2.5 ms).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.thrust import Linearization
from rotorid.models.rotors import ardupilot_mixer, library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop, Three
from rotorid.simulation.multirotor import Battery, Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft

SOURCE = "ArduPilot's simulator (SIM_Frame, SIM_Motor) and logs of Copter 4.7 with its default quadrotor"

MASS_KG = 3.0
INERTIA_KG_M2 = (0.02297, 0.02297, 0.04594)
ARM_M = 0.35
"""Center to rotor, at 45°."""

LARGEST_THRUST_N = 18.83
"""Of each rotor."""

THRUST_PER_DEMAND_N = 20.29
"""Of each rotor, per unit of demand, measured."""

TORQUE_PER_THRUST_M = 0.01606
r"""Slope in hover of :math:`Q = 0.05 \cdot 0.35\,\mathrm{m} \cdot c\, T`."""

DRAG_1_S, DAMPING_1_S = 0.241, 1.987
"""Measured in hover in calm air: drag over mass, damping over inertia; the same on all axes."""

SQUARE_DRAG_N_S2_M2 = 0.109
"""Leans 45° at 15.08 m/s, less the drag of the rotors there."""

PARAMETERS: Mapping[str, float] = MappingProxyType(
    {
        "FRAME_CLASS": 1.0,
        "FRAME_TYPE": 1.0,
        "SCHED_LOOP_RATE": 400.0,
        "ANGLE_MAX": 3000.0,
        "PILOT_Y_RATE": 202.5,
        "INS_GYRO_FILTER": 20.0,
        "INS_ACCEL_FILTER": 20.0,
        "ATC_ANGLE_BOOST": 1.0,
        "ATC_ANG_RLL_P": 4.5,
        "ATC_ANG_PIT_P": 4.5,
        "ATC_ANG_YAW_P": 4.5,
        "ATC_RAT_RLL_P": 0.135,
        "ATC_RAT_RLL_I": 0.135,
        "ATC_RAT_RLL_D": 0.0036,
        "ATC_RAT_RLL_FF": 0.0,
        "ATC_RAT_RLL_IMAX": 0.5,
        "ATC_RAT_RLL_FLTT": 20.0,
        "ATC_RAT_RLL_FLTE": 0.0,
        "ATC_RAT_RLL_FLTD": 20.0,
        "ATC_RAT_PIT_P": 0.135,
        "ATC_RAT_PIT_I": 0.135,
        "ATC_RAT_PIT_D": 0.0036,
        "ATC_RAT_PIT_FF": 0.0,
        "ATC_RAT_PIT_IMAX": 0.5,
        "ATC_RAT_PIT_FLTT": 20.0,
        "ATC_RAT_PIT_FLTE": 0.0,
        "ATC_RAT_PIT_FLTD": 20.0,
        "ATC_RAT_YAW_P": 0.3,
        "ATC_RAT_YAW_I": 0.02,
        "ATC_RAT_YAW_D": 0.0,
        "ATC_RAT_YAW_FF": 0.0,
        "ATC_RAT_YAW_IMAX": 0.5,
        "ATC_RAT_YAW_FLTT": 20.0,
        "ATC_RAT_YAW_FLTE": 2.5,
        "ATC_RAT_YAW_FLTD": 20.0,
        "MOT_THST_EXPO": 0.65,
        "MOT_SPIN_MIN": 0.15,
        "MOT_SPIN_MAX": 0.95,
        "MOT_THST_HOVER": 0.363,
        "MOT_BAT_VOLT_MAX": 0.0,
        "MOT_BAT_VOLT_MIN": 0.0,
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
    }
)
"""Of the log, but for the hover thrust, which it had learned to 0.39, and the voltages, which it compensated."""

_SENSORS = Sensors(accelerometer_noise_m_s2=0.03)
"""After the filters of 20 Hz as quiet as in the log of calm air."""


def aircraft() -> Aircraft:
    """What flies; like the mode STABILIZE, in which height is the pilot's.

    Examples
    --------
    >>> flying = aircraft()
    >>> float(flying.autopilot.hover_commands(flying.vehicle)[3].round(4))
    0.3625
    """
    return Aircraft(vehicle=_vehicle(), autopilot=_autopilot(), sensors=_SENSORS)


def _linearization() -> Linearization:
    expo, low, high = (PARAMETERS[f"MOT_{name}"] for name in ("THST_EXPO", "SPIN_MIN", "SPIN_MAX"))
    return Linearization(expo=expo, low=low, high=high)


def _vehicle() -> Multirotor:
    line = _linearization()
    # The share c is a x - b; the rest is the curve in powers of x.
    a, b = 1.0 / (line.high - line.low), line.low / (line.high - line.low)
    powers = (
        -(1.0 - line.expo) * b + line.expo * b**2,
        (1.0 - line.expo) * a - 2.0 * line.expo * a * b,
        line.expo * a**2,
    )
    c_0, c_1, c_2 = (LARGEST_THRUST_N * power for power in powers)
    damping = -DAMPING_1_S * np.array(INERTIA_KG_M2)
    return Multirotor(
        name="ardupilot_quad",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(
            layout=library_layout("quad.x").scaled(ARM_M),
            thrust=(c_0, c_1, c_2),
            torque_per_thrust_m=TORQUE_PER_THRUST_M,
        ),
        aerodynamics=np.diag([*[-DRAG_1_S * MASS_KG] * 3, *damping]),
        quadratic_drag_n_s2_m2=(SQUARE_DRAG_N_S2_M2,) * 3,
        battery=Battery(
            full_v=12.6, empty_v=12.6, rated_v=12.6, resistance_ohm=0.0, capacity_ah=3.3, hover_current_a=29.3
        ),
        source=SOURCE,
    )


def ardupilot_rates(parameters: Mapping[str, float]) -> RateLoop:
    """The rate controllers that Copter flies with these parameters, every ``ATC_RAT_*`` of :data:`PARAMETERS`."""

    def each(name: str) -> Three:
        roll, pitch, yaw = (parameters[f"ATC_RAT_{axis}_{name}"] for axis in ("RLL", "PIT", "YAW"))
        return roll, pitch, yaw

    return RateLoop(
        proportional=each("P"),
        integral=each("I"),
        derivative=each("D"),
        feedforward=each("FF"),
        integral_limit=each("IMAX"),
        derivative_of_error=True,
        derivative_cutoff_hz=each("FLTD"),
        error_cutoff_hz=each("FLTE"),
        target_cutoff_hz=each("FLTT"),
    )


def _autopilot() -> Autopilot:
    tilt_rad = math.radians(PARAMETERS["ANGLE_MAX"] / 100.0)
    # What compensates voltage and density scales every demand alike.
    gain = THRUST_PER_DEMAND_N / LARGEST_THRUST_N
    return Autopilot(
        kind="ardupilot",
        rate_hz=PARAMETERS["SCHED_LOOP_RATE"],
        rates=ardupilot_rates(PARAMETERS),
        angle_1_s=(PARAMETERS["ATC_ANG_RLL_P"], PARAMETERS["ATC_ANG_PIT_P"], PARAMETERS["ATC_ANG_YAW_P"]),
        guidance=Guidance(
            tilt_limit_rad=tilt_rad,
            stick_tilt_rad=tilt_rad,
            stick_yaw_rate_rad_s=math.radians(PARAMETERS["PILOT_Y_RATE"]),
            stick_thrust=0.5,
            tilt_compensation=True,
        ),
        gyro_cutoff_hz=PARAMETERS["INS_GYRO_FILTER"],
        accelerometer_cutoff_hz=PARAMETERS["INS_ACCEL_FILTER"],
        mixer=gain * ardupilot_mixer(library_layout("quad.x")),
        linearization=_linearization(),
        parameters=PARAMETERS,
    )
