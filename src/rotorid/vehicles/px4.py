r"""PX4's cascade from PX4's own parameters, and the quadrotor of its simulator, SIH, under it.

One list of parameters flies a simulation and fills its log; :func:`with_gains` takes the list of a log instead, one's
own controller around a vehicle of the library.

SIH has four rotors in an X with linear thrust, and a body with linear drag and damping:

.. math::

    T_i = 5\,\mathrm{N}\, x_i, \quad Q_i = 0.1\,\mathrm{N\,m}\, x_i, \quad 0.048\,\mathrm{s}\;\dot x_i = u_i - x_i,
    \quad F = -1.0 \, V, \quad M = -0.025 \, \omega

``SIH_MASS``, ``SIH_IXX``, ``SIH_IYY``, ``SIH_IZZ``, ``SIH_T_MAX``, ``SIH_Q_MAX``, ``SIH_L_ROLL``, ``SIH_L_PITCH``,
``SIH_KDV``, ``SIH_KDW`` and ``SIH_T_TAU`` of a log of PX4 1.17; the gains are those of the same log. Its lag of 50 ms
is integrated by Euler's rule in steps of 4 ms, which answers as 48 ms and 2 ms of delay.

What is ours: SIH updates rates with the thrust of the end of each step, so that a command shows in them 2 ms earlier
than it does by exact integration. A low-pass of 56 Hz on the gyroscopes, where SIH's log says 40 Hz, makes up for that:
as there, angular velocity follows the torque set-point with 5.3 ms of pure delay. Below 50 rad/s the two low-passes
differ in nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.registry import by_gains
from rotorid.errors import UsageError
from rotorid.models.rotors import UP, RotorLayout, library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop, Three
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.ardupilot import ardupilot_rates

RATE_HZ = 250.0
"""Of the loop, as in PX4's own simulator."""

PX4_PARAMETERS: Mapping[str, float] = MappingProxyType(
    {
        "SYS_AUTOSTART": 4001.0,
        "MAV_TYPE": 2.0,
        "CA_AIRFRAME": 0.0,
        "IMU_GYRO_CUTOFF": 40.0,
        "IMU_DGYRO_CUTOFF": 30.0,
        "IMU_ACCEL_CUTOFF": 30.0,
        "IMU_INTEG_RATE": 250.0,
        "MC_ROLL_P": 6.5,
        "MC_PITCH_P": 6.5,
        "MC_YAW_P": 2.8,
        "MC_ROLLRATE_P": 0.15,
        "MC_ROLLRATE_I": 0.2,
        "MC_ROLLRATE_D": 0.003,
        "MC_ROLLRATE_FF": 0.0,
        "MC_ROLLRATE_K": 1.0,
        "MC_ROLLRATE_MAX": 220.0,
        "MC_RR_INT_LIM": 0.3,
        "MC_PITCHRATE_P": 0.15,
        "MC_PITCHRATE_I": 0.2,
        "MC_PITCHRATE_D": 0.003,
        "MC_PITCHRATE_FF": 0.0,
        "MC_PITCHRATE_K": 1.0,
        "MC_PITCHRATE_MAX": 220.0,
        "MC_PR_INT_LIM": 0.3,
        "MC_YAWRATE_P": 0.2,
        "MC_YAWRATE_I": 0.1,
        "MC_YAWRATE_D": 0.0,
        "MC_YAWRATE_FF": 0.0,
        "MC_YAWRATE_K": 1.0,
        "MC_YAWRATE_MAX": 200.0,
        "MC_YR_INT_LIM": 0.3,
        "MC_YAW_TQ_CUTOFF": 2.0,
        "MPC_MAN_TILT_MAX": 35.0,
        "MPC_MAN_Y_MAX": 150.0,
        "MPC_TILTMAX_AIR": 45.0,
        "MPC_THR_HOVER": 0.5,
        "MPC_XY_VEL_P_ACC": 1.8,
        "MPC_XY_VEL_I_ACC": 0.4,
        "MPC_XY_P": 0.95,
        "MPC_Z_VEL_P_ACC": 4.0,
        "MPC_Z_VEL_I_ACC": 2.0,
        "MPC_Z_P": 1.0,
        "THR_MDL_FAC": 0.0,
    }
)
"""PX4 1.17's values as its own simulators fly, those that matter here; angles and rates in degrees, as PX4 has them."""

_STICK_THRUST = 0.45
"""Mean slope of thrust over stick about the middle, in the manual flights of PX4's own simulator."""

_STICK_CLIMB_M_S = 3.0
"""What a full stick asks for where the height is held."""

_YAW_STICK = 0.4
_DEAD_ZONE, _CUBIC = 0.1, 0.6
"""Of PX4's yaw stick, which the simulation replaces by the straight line through what it makes of 0.4."""


def rotor_parameters(layout: RotorLayout, *, torque_per_thrust_m: float = 0.05) -> dict[str, float]:
    """``CA_ROTOR`` parameters that describe a layout.

    Parameters
    ----------
    layout
        The rotors; positions go to the log in its unit.
    torque_per_thrust_m
        ``CA_ROTORn_KM`` without its sign.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> placed = rotor_parameters(library_layout("quad.x"))
    >>> placed["CA_ROTOR_COUNT"], placed["CA_ROTOR2_KM"], "CA_ROTOR0_AX" in placed
    (4.0, -0.05, False)
    """
    assert layout.axes is not None
    parameters = {"CA_ROTOR_COUNT": float(layout.rotors)}
    for index in range(layout.rotors):
        places = zip("XYZ", layout.positions[index], strict=True)
        parameters |= {f"CA_ROTOR{index}_P{letter}": float(place) for letter, place in places}
        parameters[f"CA_ROTOR{index}_KM"] = float(layout.spins[index]) * torque_per_thrust_m
        if tuple(layout.axes[index]) != UP:
            axes = zip("XYZ", layout.axes[index], strict=True)
            parameters |= {f"CA_ROTOR{index}_A{letter}": float(part) for letter, part in axes}
    return parameters


def px4_autopilot(
    parameters: Mapping[str, float],
    *,
    guidance: Guidance,
    gyro_cutoff_hz: float | None = None,
    delay_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    mixer: FloatArray | None = None,
) -> Autopilot:
    """The cascade that PX4 flies with these parameters.

    Parameters
    ----------
    parameters
        By PX4's names, every one of the ``IMU_*`` and ``MC_*`` of :data:`PX4_PARAMETERS`. They go to the log as they
        are.
    guidance
        What stands above the attitude; see :func:`stabilized` and :func:`hover_guidance`.
    gyro_cutoff_hz
        Where the low-pass that flies is not that of ``IMU_GYRO_CUTOFF``.
    delay_s
        From each command to the motors: roll, pitch, yaw, thrust.
    mixer
        Where it is not the one of the layout.

    Examples
    --------
    >>> px4_autopilot(PX4_PARAMETERS, guidance=stabilized(PX4_PARAMETERS)).rates.proportional
    (0.15, 0.15, 0.2)
    """

    def each(pattern: str) -> Three:
        return (
            parameters[pattern.format("ROLL")],
            parameters[pattern.format("PITCH")],
            parameters[pattern.format("YAW")],
        )

    def scaled(letter: str) -> Three:
        # K scales P, I and D, and not the feedforward.
        p, q, r = (gain * k for gain, k in zip(each(f"MC_{{}}RATE_{letter}"), each("MC_{}RATE_K"), strict=True))
        return p, q, r

    fastest = each("MC_{}RATE_MAX")
    return Autopilot(
        kind="px4",
        rate_hz=RATE_HZ,
        rates=RateLoop(
            proportional=scaled("P"),
            integral=scaled("I"),
            derivative=scaled("D"),
            feedforward=each("MC_{}RATE_FF"),
            integral_limit=(parameters["MC_RR_INT_LIM"], parameters["MC_PR_INT_LIM"], parameters["MC_YR_INT_LIM"]),
            derivative_cutoff_hz=(parameters["IMU_DGYRO_CUTOFF"],) * 3,
            command_cutoff_hz=(0.0, 0.0, parameters["MC_YAW_TQ_CUTOFF"]),
        ),
        angle_1_s=each("MC_{}_P"),
        guidance=guidance,
        rate_limit_rad_s=(math.radians(fastest[0]), math.radians(fastest[1]), math.radians(fastest[2])),
        gyro_cutoff_hz=parameters["IMU_GYRO_CUTOFF"] if gyro_cutoff_hz is None else gyro_cutoff_hz,
        accelerometer_cutoff_hz=parameters["IMU_ACCEL_CUTOFF"],
        delay_s=delay_s,
        mixer=mixer,
        parameters=parameters,
    )


def stabilized(parameters: Mapping[str, float]) -> Guidance:
    """PX4's mode Stabilized: sticks command tilt, yaw rate and thrust; heading is kept while the yaw stick is centered.

    PX4's yaw stick has a dead zone and is partly cubic. Here it is straight, and asks for what PX4's does at 0.4.

    Parameters
    ----------
    parameters
        With ``MPC_MAN_TILT_MAX`` and ``MPC_MAN_Y_MAX``.

    Examples
    --------
    >>> guidance = stabilized(PX4_PARAMETERS)
    >>> round(guidance.stick_tilt_rad, 3), round(0.4 * guidance.stick_yaw_rate_rad_s, 3)
    (0.611, 0.407)
    """
    tilt_rad = math.radians(parameters["MPC_MAN_TILT_MAX"])
    return Guidance(
        tilt_limit_rad=tilt_rad,
        stick_tilt_rad=tilt_rad,
        stick_yaw_rate_rad_s=_yaw_rate(parameters),
        stick_thrust=_STICK_THRUST,
        heading_follows=True,
    )


def hover_guidance(parameters: Mapping[str, float]) -> Guidance:
    r"""A hover with control of velocity and height, and sticks that add tilt and climb.

    PX4's loops of velocity give accelerations. Where they close over thrust, an acceleration of :math:`g` is the thrust
    that hovers, ``MPC_THR_HOVER``.

    Parameters
    ----------
    parameters
        With the ``MPC_*`` of :data:`PX4_PARAMETERS`.

    Examples
    --------
    >>> guidance = hover_guidance(PX4_PARAMETERS)
    >>> guidance.velocity_p_1_s, round(guidance.climb_p, 3)
    (1.8, 0.204)
    """
    per_acceleration = parameters["MPC_THR_HOVER"] / STANDARD_GRAVITY_M_S2
    tilt_rad = math.radians(parameters["MPC_MAN_TILT_MAX"])
    return Guidance(
        tilt_limit_rad=math.radians(parameters["MPC_TILTMAX_AIR"]),
        stick_tilt_rad=tilt_rad,
        stick_yaw_rate_rad_s=_yaw_rate(parameters),
        stick_climb_m_s=_STICK_CLIMB_M_S,
        heading_follows=True,
        velocity_p_1_s=parameters["MPC_XY_VEL_P_ACC"],
        velocity_i_1_s2=parameters["MPC_XY_VEL_I_ACC"],
        climb_p=per_acceleration * parameters["MPC_Z_VEL_P_ACC"],
        climb_i=per_acceleration * parameters["MPC_Z_VEL_I_ACC"],
        height_p_1_s=parameters["MPC_Z_P"],
        hold_velocity=True,
        hold_height=True,
        tilt_compensation=True,
    )


def _yaw_rate(parameters: Mapping[str, float]) -> float:
    """Yaw rate over stick with a parameter of 0.4."""
    beyond = (_YAW_STICK - _DEAD_ZONE) / (1.0 - _DEAD_ZONE)
    share = (1.0 - _CUBIC) * beyond + _CUBIC * beyond**3
    return math.radians(parameters["MPC_MAN_Y_MAX"]) * share / _YAW_STICK


SOURCE = "PX4 1.17, simulation in hardware (SIH), parameters SIH_* and MC_* of a log of its quadrotor"

MASS_KG = 1.0
INERTIA_KG_M2 = (0.025, 0.025, 0.030)
ARM_M = 0.2 * 2.0**0.5
"""Center to rotor; SIH has 0.2 m to each side and ahead."""

THRUST_N, TORQUE_N_M = 5.0, 0.1
"""Of each rotor at full output."""

LAG_S = 0.048
DRAG_N_S_M, DAMPING_N_M_S = 1.0, 0.025

GYRO_CUTOFF_HZ = 56.4
"""Delays by 3.3 ms at 250 Hz, where 40 Hz delays by 5.1 ms; see the head of the module."""

SENSORS = Sensors(gyro_noise_rad_s=0.066, accelerometer_noise_m_s2=1.06)
"""SIH has noise of 0.14, 0.07 and 0.03 rad/s, and of 0.5, 1.7 and 1.4 m/s²: their geometric means."""

PARAMETERS: Mapping[str, float] = MappingProxyType(
    {
        **PX4_PARAMETERS,
        "SYS_AUTOSTART": 10040.0,
        "MC_ROLL_P": 4.0,
        "MC_PITCH_P": 4.0,
        "IMU_GYRO_CUTOFF": GYRO_CUTOFF_HZ,
        "IMU_DGYRO_CUTOFF": 20.0,
        **rotor_parameters(library_layout("quad.x").scaled(2.0**0.5)),
        "SIH_MASS": MASS_KG,
        "SIH_IXX": INERTIA_KG_M2[0],
        "SIH_IYY": INERTIA_KG_M2[1],
        "SIH_IZZ": INERTIA_KG_M2[2],
        "SIH_T_MAX": THRUST_N,
        "SIH_Q_MAX": TORQUE_N_M,
        "SIH_L_ROLL": 0.2,
        "SIH_L_PITCH": 0.2,
        "SIH_KDV": DRAG_N_S_M,
        "SIH_KDW": DAMPING_N_M_S,
        "SIH_T_TAU": 0.05,
    }
)
"""Of the log, but for the filter of the gyroscopes.

``CA_ROTOR`` positions are placeholders there too: one unit ahead and to each side.
"""


def layout() -> RotorLayout:
    """The rotors, in meters.

    Examples
    --------
    >>> layout().positions[0].round(3).tolist()
    [0.2, 0.2, 0.0]
    """
    return library_layout("quad.x").scaled(ARM_M)


def aircraft() -> Aircraft:
    """What flies; in the mode Stabilized, as in the logs.

    Examples
    --------
    >>> aircraft().vehicle.hover_shares.round(4).tolist()
    [0.4903, 0.4903, 0.4903, 0.4903]
    """
    vehicle = Multirotor(
        name="px4_quad",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(
            layout=layout(),
            thrust=(0.0, THRUST_N, 0.0),
            torque_per_thrust_m=TORQUE_N_M / THRUST_N,
            lag_up_s=LAG_S,
        ),
        aerodynamics=-np.diag([DRAG_N_S_M] * 3 + [DAMPING_N_M_S] * 3),
        source=SOURCE,
    )
    autopilot = px4_autopilot(PARAMETERS, guidance=stabilized(PARAMETERS), gyro_cutoff_hz=GYRO_CUTOFF_HZ)
    return Aircraft(vehicle=vehicle, autopilot=autopilot, sensors=SENSORS)


_PX4 = ("MC_", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "IMU_ACCEL_CUTOFF", "MPC_MAN_TILT_MAX")
_ARDUPILOT = (
    "ATC_RAT_",
    "ATC_ANG_",
    "ATC_INPUT_TC",
    "ATC_ACC",
    "ATC_RATE_",
    "INS_GYRO_FILTER",
    "INS_ACCEL_FILTER",
)


def with_gains(aircraft: Aircraft, parameters: Mapping[str, float], *, source: str) -> Aircraft:
    """The same vehicle with the rate and attitude gains and filters of an autopilot's parameters.

    What stands above the attitude, the mixer, the delays and the rate of the loop stay those of the vehicle. A
    parameter that the log lacks stays too.

    Parameters
    ----------
    aircraft
        A vehicle whose autopilot is of the same kind.
    parameters
        By PX4's or ArduPilot's names.
    source
        What messages call the log.

    Raises
    ------
    UsageError
        The log holds no gains, or those of another autopilot.

    Examples
    --------
    >>> from rotorid.vehicles.catalog import aircraft
    >>> softer = with_gains(aircraft("x500"), {"MC_ROLLRATE_P": 0.08}, source="flight.ulg")
    >>> softer.autopilot.rates.proportional
    (0.08, 0.15, 0.2)
    """
    own = aircraft.autopilot
    found = by_gains(parameters)
    kind = found.key if found.takes_gains else ""
    if kind != own.kind:
        raise UsageError(
            f"{source} has {f'gains of {kind}' if kind else 'no gains'}, but {aircraft.name} flies {own.kind}",
            needed=f"a log of {own.kind} with its parameters",
            remedy="or name a vehicle with the autopilot of the log",
        )
    return replace(aircraft, autopilot=(_px4 if kind == "px4" else _ardupilot)(own, parameters))


def _px4(own: Autopilot, parameters: Mapping[str, float]) -> Autopilot:
    merged = {**PX4_PARAMETERS, **own.parameters, **_chosen(parameters, _PX4)}
    fresh = px4_autopilot(merged, guidance=own.guidance, delay_s=own.delay_s, mixer=own.mixer)
    return replace(fresh, rate_hz=own.rate_hz, linearization=own.linearization, motor_range=own.motor_range)


def _ardupilot(own: Autopilot, parameters: Mapping[str, float]) -> Autopilot:
    merged = {**own.parameters, **_chosen(parameters, _ARDUPILOT)}
    return replace(
        own,
        rates=ardupilot_rates(merged),
        angle_1_s=(merged["ATC_ANG_RLL_P"], merged["ATC_ANG_PIT_P"], merged["ATC_ANG_YAW_P"]),
        gyro_cutoff_hz=merged["INS_GYRO_FILTER"],
        accelerometer_cutoff_hz=merged["INS_ACCEL_FILTER"],
        parameters=merged,
    )


def _chosen(parameters: Mapping[str, float], prefixes: tuple[str, ...]) -> dict[str, float]:
    return {name: value for name, value in parameters.items() if name.startswith(prefixes)}
