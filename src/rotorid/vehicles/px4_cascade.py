"""PX4's cascade from PX4's own parameters: one list of numbers that flies a simulation and fills its log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from rotorid.models.rotor_layout import UP, RotorLayout
from rotorid.simulate.autopilot import Autopilot, Guidance, RateLoop, Three
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

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
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> told = rotor_parameters(library_layout("quad.x"))
    >>> told["CA_ROTOR_COUNT"], told["CA_ROTOR2_KM"], "CA_ROTOR0_AX" in told
    (4.0, -0.05, False)
    """
    assert layout.axes is not None
    told = {"CA_ROTOR_COUNT": float(layout.rotors)}
    for index in range(layout.rotors):
        places = zip("XYZ", layout.positions[index], strict=True)
        told |= {f"CA_ROTOR{index}_P{letter}": float(place) for letter, place in places}
        told[f"CA_ROTOR{index}_KM"] = float(layout.spins[index]) * torque_per_thrust_m
        if tuple(layout.axes[index]) != UP:
            axes = zip("XYZ", layout.axes[index], strict=True)
            told |= {f"CA_ROTOR{index}_A{letter}": float(part) for letter, part in axes}
    return told


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
        What stands above the attitude; see :func:`stabilized` and :func:`held`.
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
    """PX4's mode Stabilized: sticks ask for tilt, yaw rate and thrust, and a heading is held while its stick rests.

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


def held(parameters: Mapping[str, float], *, climb_m_s: float = 3.0) -> Guidance:
    r"""A hover that is held in velocity and height, with sticks that ask for tilt and climb on top.

    PX4's loops of velocity give accelerations. Where they close over thrust, an acceleration of :math:`g` is the thrust
    that hovers, ``MPC_THR_HOVER``.

    Parameters
    ----------
    parameters
        With the ``MPC_*`` of :data:`PX4_PARAMETERS`.
    climb_m_s
        What a full stick asks for.

    Examples
    --------
    >>> guidance = held(PX4_PARAMETERS)
    >>> guidance.velocity_p_1_s, round(guidance.climb_p, 3)
    (1.8, 0.204)
    """
    per_acceleration = parameters["MPC_THR_HOVER"] / STANDARD_GRAVITY_M_S2
    tilt_rad = math.radians(parameters["MPC_MAN_TILT_MAX"])
    return Guidance(
        tilt_limit_rad=math.radians(parameters["MPC_TILTMAX_AIR"]),
        stick_tilt_rad=tilt_rad,
        stick_yaw_rate_rad_s=_yaw_rate(parameters),
        stick_climb_m_s=climb_m_s,
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
    """Yaw rate over stick where PX4 is told 0.4."""
    beyond = (_YAW_STICK - _DEAD_ZONE) / (1.0 - _DEAD_ZONE)
    share = (1.0 - _CUBIC) * beyond + _CUBIC * beyond**3
    return math.radians(parameters["MPC_MAN_Y_MAX"]) * share / _YAW_STICK
