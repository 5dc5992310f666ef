r"""The S500 quadrotor in hover, as published, and a vehicle that flies freely with the published derivatives.

**Published.** A kit-built quadrotor of 0.5 m and 1.4 kg with PX4, identified from piloted frequency sweeps (*System
Identification of an S500 Quadrotor UAV*, eqs 2 and 3, tables 4 and 7). In hover, with everything as a difference from
trim:

.. math::

    \dot q = M_q q + M_u u + M_w w + M_{pitch} \delta_{pitch}, \qquad
    \dot u = X_q q + X_u u - g \theta + X_{pitch} \delta_{pitch}

    \dot w = Z_u u + Z_w w + Z_{pitch} \delta_{pitch} + Z_{thrust} \delta_{thrust}, \qquad \dot \theta = q

    \dot p = L_r r + L_v v + L_{roll} \delta_{roll}, \qquad
    \dot r = N_p p + N_r r + N_{roll} \delta_{roll} + N_{yaw} \delta_{yaw}

    \dot v = Y_p p + Y_v v + g \phi + Y_{roll} \delta_{roll}, \qquad \dot \phi = p

and the accelerometer, as a difference from gravity, reads :math:`\dot u + g\theta`, :math:`\dot v - g\phi` and
:math:`\dot w`. Both motions are unstable without an autopilot, at 5 and 4 rad/s.

The printed numbers are used as they are. The printed longitudinal eigenvalues do not follow from them (2.86 ± 4.14j
against 2.66 ± 3.82j), the lateral ones do. The delay of the yaw command is not printed; here it is that of the roll
command, because the motors are the same. Hover thrust and gains are not published either: those below are ours.

**Flying.** In hover every derivative is the published one: those of stability are forces and moments in proportion to
the motion through the air, mass and inertia times the printed number, and those of control are what each rotor does,

.. math:: E = \mathrm{diag}(m, m, m, I_{xx}, I_{yy}, I_{zz}) \; B \; (S X)^{-1}

with the printed control derivatives :math:`B`, shape (6, 4), the mixer :math:`X` and the slope :math:`S` of thrust over
output. Away from hover the body tilts, turns and couples as any other. Each delay is the published one less the half
tick that a held command shows as; the low-passes of sensors are off, so that nothing adds to it.

What is ours, because it was not published: the inertia, the thrust curve, and everything of the autopilot. The thrust
curve is straight, and such that hover is at half of full output with the published slope; that leaves 0.30 of the
weight at zero output. Rotors have no lag, for the published delays hold it.

Derivatives of hover do not describe fast flight. Against the wind at :math:`u`, a nose that rises by :math:`\theta`
makes :math:`w = u \theta`, and the published M_w turns that into :math:`26.6 \, u \theta` more nose up, which no gains
hold with these delays once :math:`u` is large. A steady headwind of 2 m/s overturns this vehicle, and gusts of 0.5 m/s
(standard deviation) do so in one flight of ten minutes out of eight; in gusts of 0.4 m/s it stays below 0.25 rad. Wind
from behind or from the side does no harm. For the same reason, gains of pitch and roll are above those of the linear
vehicle (:data:`CONTROLLER`), whose gusts are 0.08 m/s; the distance of their loops from the critical point is 0.5
instead of 0.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.record import AXES
from rotorid.models.rotors import library_layout, px4_mixer
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import OUTPUTS, HoverController, HoverVehicle
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.px4 import PX4_PARAMETERS, RATE_HZ, hover_guidance, px4_autopilot, rotor_parameters

LONGITUDINAL: Mapping[str, float] = MappingProxyType(
    {
        "M_q": 0.9,
        "M_u": 10.8,
        "M_w": 26.6,
        "X_q": -0.08051,
        "X_u": -0.25,
        "X_w": 0.0,
        "Z_q": 0.0,
        "Z_u": 0.3558,
        "Z_w": 0.7,
        "M_pitch": 149.8,
        "M_thrust": 0.0,
        "X_pitch": -7.2,
        "X_thrust": 0.0,
        "Z_pitch": -5.7,
        "Z_thrust": -13.8,
        "tau_pitch": 0.037,
        "tau_thrust": 0.039,
    }
)
"""Table 4; a zero was dropped there. SI units and radians, commands of one."""

LATERAL: Mapping[str, float] = MappingProxyType(
    {
        "L_p": 0.0,
        "L_r": -21.6,
        "L_v": -6.7,
        "N_p": 0.06,
        "N_r": -3.8,
        "N_v": 0.0,
        "Y_p": 0.11,
        "Y_r": 0.0,
        "Y_v": -0.18,
        "L_roll": 153.4,
        "L_yaw": 0.0,
        "N_roll": -4.0,
        "N_yaw": 31.1,
        "Y_roll": 7.4,
        "Y_yaw": 0.0,
        "tau_roll": 0.041,
        "tau_yaw": 0.041,
    }
)
"""Table 7; a zero was dropped there."""

TRUTH: Mapping[str, float] = MappingProxyType({**LONGITUDINAL, **LATERAL})
"""Every parameter of the vehicle, by the names of the hover models."""

STATES = ("q", "u", "w", "theta", "p", "r", "v", "phi", "psi")
HOVER_THRUST = 0.5
CONTROLLER = HoverController(
    rate_p=(0.06, 0.07, 0.09),
    rate_i=(0.05, 0.06, 0.03),
    angle_p=(3.4, 4.6, 1.7),
    lean_rad_per_m_s=0.17,
    climb_p=0.2,
    climb_i=0.13,
)
"""Searched for the largest distance of every loop, the others closed, from the critical point: 0.6 or more."""


def longitudinal() -> StateSpace:
    """Bare airframe in pitch and heave: states ``q u w theta``, inputs pitch and thrust command.

    Outputs are ``q u w theta ax az``, differences from hover.

    Examples
    --------
    >>> longitudinal().poles().round(2)
    array([-0.18+0.j  , -4.19+0.j  ,  2.86-4.14j,  2.86+4.14j])
    """
    return _part(vehicle().system, ("q", "u", "w", "theta"), ("pitch", "thrust"), ("q", "u", "w", "theta", "ax", "az"))


def lateral() -> StateSpace:
    """Bare airframe in roll and yaw: states ``p r v phi``, inputs roll and yaw command.

    Outputs are ``p r v phi ay``.

    Examples
    --------
    >>> lateral().poles().round(2)
    array([-3.86-0.63j, -3.86+0.63j,  1.87-3.58j,  1.87+3.58j])
    """
    return _part(vehicle().system, ("p", "r", "v", "phi"), ("roll", "yaw"), ("p", "r", "v", "phi", "ay"))


def vehicle() -> HoverVehicle:
    """Both motions and the heading as one vehicle, with an autopilot that keeps it in hover.

    The motions do not couple: none was seen in flight.

    Examples
    --------
    >>> vehicle().system.G.shape, vehicle().hover_thrust
    ((9, 4), 0.5)
    """
    system = StateSpace(
        M=np.eye(len(STATES)),
        F=_matrix(STATES, STATES, _DYNAMICS),
        G=_matrix(STATES, AXES, _CONTROLS),
        H0=_matrix(OUTPUTS, STATES, {(name, name): 1.0 for name in STATES} | _GRAVITY),
        H1=_matrix(OUTPUTS, STATES, {("ax", "u"): 1.0, ("ay", "v"): 1.0, ("az", "w"): 1.0}),
        input_delays_s=np.array([TRUTH[f"tau_{axis}"] for axis in AXES]),
        output_delays_s=np.zeros(len(OUTPUTS)),
    )
    return HoverVehicle(name="S500", system=system, states=STATES, hover_thrust=HOVER_THRUST, controller=CONTROLLER)


Entries: TypeAlias = dict[tuple[str, str], float]

# A force or moment letter names the row of its derivatives.
_ROW = {"X": "u", "Y": "v", "Z": "w", "L": "p", "M": "q", "N": "r"}
_DERIVATIVES = {name: name.split("_") for name in TRUTH if not name.startswith("tau")}
_DYNAMICS: Entries = {
    (_ROW[force], of): TRUTH[name] for name, (force, of) in _DERIVATIVES.items() if of not in AXES
} | {
    ("u", "theta"): -STANDARD_GRAVITY_M_S2,
    ("v", "phi"): STANDARD_GRAVITY_M_S2,
    ("theta", "q"): 1.0,
    ("phi", "p"): 1.0,
    ("psi", "r"): 1.0,
}
_CONTROLS: Entries = {(_ROW[force], of): TRUTH[name] for name, (force, of) in _DERIVATIVES.items() if of in AXES}
_GRAVITY: Entries = {("ax", "theta"): STANDARD_GRAVITY_M_S2, ("ay", "phi"): -STANDARD_GRAVITY_M_S2}


def _matrix(rows: tuple[str, ...], columns: tuple[str, ...], entries: Entries) -> FloatArray:
    return np.array([[entries.get((row, column), 0.0) for column in columns] for row in rows])


def _part(system: StateSpace, states: tuple[str, ...], axes: tuple[str, ...], outputs: tuple[str, ...]) -> StateSpace:
    """The states, inputs and outputs named; exact, because nothing else acts on those states."""
    x = [STATES.index(name) for name in states]
    u = [AXES.index(name) for name in axes]
    y = [OUTPUTS.index(name) for name in outputs]
    return StateSpace(
        M=system.M[np.ix_(x, x)],
        F=system.F[np.ix_(x, x)],
        G=system.G[np.ix_(x, u)],
        H0=system.H0[np.ix_(y, x)],
        H1=system.H1[np.ix_(y, x)],
        input_delays_s=system.input_delays_s[u],
        output_delays_s=system.output_delays_s[y],
    )


SOURCE = "System Identification of an S500 Quadrotor UAV, tables 4 and 7; inertia, thrust curve and gains are ours"

MASS_KG = 1.4
ARM_M = 0.24
"""Half of a wheelbase of 0.48 m."""

INERTIA_KG_M2 = (0.0155, 0.0165, 0.029)
"""Chosen: what 1.4 kg give at a radius of gyration of 0.44 arms in roll; they divide out of every derivative."""

_FORCES = "XYZLMN"
_MOTIONS = "uvwpqr"
_HALF_TICK_S = 0.5 / RATE_HZ

PARAMETERS: Mapping[str, float] = MappingProxyType(
    {
        **PX4_PARAMETERS,
        **rotor_parameters(library_layout("quad.x").scaled(ARM_M)),
        "SYS_AUTOSTART": 4014.0,
        "MC_ROLL_P": 4.5,
        "MC_PITCH_P": 5.5,
        "MC_YAW_P": 1.7,
        "MC_ROLLRATE_P": 0.08,
        "MC_ROLLRATE_I": 0.05,
        "MC_ROLLRATE_D": 0.0,
        "MC_PITCHRATE_P": 0.09,
        "MC_PITCHRATE_I": 0.09,
        "MC_PITCHRATE_D": 0.0,
        "MC_YAWRATE_P": 0.09,
        "MC_YAWRATE_I": 0.03,
        "MC_RR_INT_LIM": 1.0,
        "MC_PR_INT_LIM": 1.0,
        "MC_YAW_TQ_CUTOFF": 0.0,
        "IMU_GYRO_CUTOFF": 0.0,
        "IMU_DGYRO_CUTOFF": 0.0,
        "IMU_ACCEL_CUTOFF": 0.0,
        "MPC_THR_HOVER": HOVER_THRUST,
        "MPC_XY_P": 0.0,
        "MPC_XY_VEL_P_ACC": CONTROLLER.lean_rad_per_m_s * STANDARD_GRAVITY_M_S2,
        "MPC_XY_VEL_I_ACC": 0.0,
        "MPC_Z_P": 0.0,
        "MPC_Z_VEL_P_ACC": CONTROLLER.climb_p * STANDARD_GRAVITY_M_S2 / HOVER_THRUST,
        "MPC_Z_VEL_I_ACC": CONTROLLER.climb_i * STANDARD_GRAVITY_M_S2 / HOVER_THRUST,
    }
)
"""Velocity is held, with the gains of the linear vehicle; the place is not."""


def aircraft() -> Aircraft:
    """What flies.

    Examples
    --------
    >>> flying = aircraft()
    >>> flying.autopilot.hover_commands(flying.vehicle).round(9).tolist()[-1]
    0.5
    """
    layout = library_layout("quad.x").scaled(ARM_M)
    mixer = px4_mixer(layout)
    slope_n = -MASS_KG * TRUTH["Z_thrust"] / layout.rotors
    # The published slope lifts the weight at half output only if some thrust is left at none.
    lifted_n = MASS_KG * STANDARD_GRAVITY_M_S2 / layout.rotors
    inertia = np.array([MASS_KG] * 3 + list(INERTIA_KG_M2))
    controls = inertia[:, None] * _derivatives(AXES)
    vehicle = Multirotor(
        name="s500",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(layout=layout, thrust=(lifted_n - slope_n * HOVER_THRUST, slope_n, 0.0)),
        aerodynamics=inertia[:, None] * _derivatives(_MOTIONS),
        effectiveness=controls @ np.linalg.inv(slope_n * mixer),
        source=SOURCE,
    )
    roll, pitch, yaw, thrust = (TRUTH[f"tau_{axis}"] - _HALF_TICK_S for axis in AXES)
    autopilot = px4_autopilot(PARAMETERS, guidance=hover_guidance(PARAMETERS), delay_s=(roll, pitch, yaw, thrust))
    return Aircraft(vehicle=vehicle, autopilot=autopilot, sensors=Sensors())


def _derivatives(of: tuple[str, ...] | str) -> FloatArray:
    """Published derivatives of the accelerations X Y Z and L M N, shape ``(6, len(of))``; zero where there is none."""
    return np.array([[TRUTH.get(f"{force}_{name}", 0.0) for name in of] for force in _FORCES])
