r"""The S500 of `rotorid.vehicles.s500` as a vehicle that flies freely: the published derivatives on a rigid body.

In hover every derivative is the published one: those of stability are forces and moments in proportion to the motion
through the air, mass and inertia times the printed number, and those of control are what each rotor does,

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
from behind or from the side does no harm.
For the same reason, gains of pitch and roll are above those of the linear vehicle of `rotorid.vehicles.s500`, whose
gusts are 0.08 m/s; the distance of their loops from the critical point is 0.5 instead of 0.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import AXES
from rotorid.models.rotor_layout_library import library_layout
from rotorid.models.rotor_mixer import px4_mixer
from rotorid.simulate.multirotor import Multirotor, Rotors
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.simulate.sensors import Sensors
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.px4_cascade import PX4_PARAMETERS, RATE_HZ, held, px4_autopilot, rotor_parameters
from rotorid.vehicles.s500 import CONTROLLER, HOVER_THRUST, TRUTH

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
    >>> one = aircraft()
    >>> one.autopilot.hover_commands(one.vehicle).round(9).tolist()[-1]
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
    autopilot = px4_autopilot(PARAMETERS, guidance=held(PARAMETERS), delay_s=(roll, pitch, yaw, thrust))
    return Aircraft(vehicle=vehicle, autopilot=autopilot, sensors=Sensors())


def _derivatives(of: tuple[str, ...] | str) -> FloatArray:
    """Published derivatives of the accelerations X Y Z and L M N, shape ``(6, len(of))``; zero where there is none."""
    return np.array([[TRUTH.get(f"{force}_{name}", 0.0) for name in of] for force in _FORCES])
