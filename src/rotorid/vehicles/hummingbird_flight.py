r"""The AscTec Hummingbird of `rotorid.vehicles.hummingbird` as a vehicle that flies freely.

Rotors in a plus make the forces of `rotorid.models.physical`: thrust that falls with the air that meets the rotor,
:math:`dc_T/dJ`, a side force against the motion across it that shrinks with the inclination of the inflow, and torque.
The publication has derivatives and no physical parameters. Those here solve
:func:`~rotorid.models.physical.hover_derivatives` for the published ones, from a mass, an arm, a propeller and a yaw
inertia that are chosen:

.. math::

    k_n = \frac{3.603}{2\pi}\,\mathrm{s}^{-1}, \quad n_h = -\frac{2 g k_n}{Z_{thrust}}, \quad
    I_{yy} = -\frac{l m Z_{thrust}}{2 M_{pitch}}, \quad z = -\frac{M_u I_{yy}}{X_u m}, \quad
    J_r = \frac{N_{spin} I_{zz}}{8 \pi k_n}

and the coefficients of a rotor from X_u, Z_w, N_yaw and the weight. A command of one is 200 steps of the motor
controllers. The lag of the rotors is that of the yaw model; with it, what the publication gives as delay in pitch is
all used up, and in heave 28 ms are left.

What such a vehicle cannot do is answer with M_q, X_q and N_r of zero, as published: rotors at :math:`z` damp, M_q is
-2.3 1/s and N_r -0.5 1/s. Nor is :math:`z` of 0.19 m where the rotors are: flapping blades pitch the vehicle against
the motion as rotors far above the center of gravity would. Mass, arm, propeller, yaw inertia and gains are ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.models.physical import MIXER
from rotorid.models.rotor_layout import RotorLayout
from rotorid.simulate.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulate.multirotor import Multirotor, Rotors
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.simulate.sensors import Sensors
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.hummingbird import PITCH, VERTICAL, YAW

SOURCE = (
    "Niermeyer, Raffler and Holzapfel, Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via "
    "Closed-Loop Flight Testing, tables 2 to 4; mass, arm, propeller, yaw inertia and gains are ours"
)

STEPS = 200.0
"""Steps of the motor controllers in a command of one."""

RATE_HZ = 1000.0

_RAD_S_PER_STEP = 3.603
"""Steady speed of a rotor, table 3."""

_MASS_KG, _ARM_M, _DIAMETER_M, _I_ZZ, _RHO = 0.52, 0.17, 0.2032, 0.0061, 1.2


def _solved() -> Mapping[str, float]:
    m, l, D, rho = _MASS_KG, _ARM_M, _DIAMETER_M, _RHO  # noqa: E741
    k_n = _RAD_S_PER_STEP / (2.0 * math.pi)
    n_h = -2.0 * STANDARD_GRAVITY_M_S2 * k_n / VERTICAL["Z_thrust"]
    flow = rho * n_h * D**3
    I_yy = -l * m * VERTICAL["Z_thrust"] / (2.0 * PITCH["M_pitch"])
    return MappingProxyType(
        {
            "m": m,
            "I_xx": I_yy,
            "I_yy": I_yy,
            "I_zz": _I_ZZ,
            "c_T": m * STANDARD_GRAVITY_M_S2 / (4.0 * rho * n_h**2 * D**4),
            "dc_T_dJ": m * VERTICAL["Z_w"] / (4.0 * flow),
            "c_H": -m * PITCH["X_u"] / (4.0 * flow),
            "c_P": math.pi * _I_ZZ * YAW["N_yaw"] / (4.0 * k_n * flow * D**2),
            "D": D,
            "l": l,
            "z": -PITCH["M_u"] * I_yy / (PITCH["X_u"] * m),
            "rho": rho,
            "k_n": k_n,
            "n_h": n_h,
        }
    )


PHYSICS: Mapping[str, float] = _solved()
"""By the names of :data:`rotorid.models.physical.PHYSICAL_UNITS`; ``k_n`` is for one step."""

_HUBS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def aircraft() -> Aircraft:
    """What flies; motors are front, right, rear, left.

    Examples
    --------
    >>> one = aircraft()
    >>> one.vehicle.hover_shares.round(3).tolist(), round(PHYSICS["c_T"], 3), round(PHYSICS["z"], 3)
    ([0.58, 0.58, 0.58, 0.58], 0.141, 0.19)
    """
    P = PHYSICS
    n_full = STEPS * P["k_n"]
    flow = P["rho"] * n_full * P["D"] ** 3
    heights = np.full((4, 1), -P["z"])
    layout = RotorLayout(
        name="hummingbird",
        positions=np.hstack([P["l"] * _HUBS, heights]),
        spins=np.array([-1.0, 1.0, -1.0, 1.0]),
        arm_known=True,
        source=SOURCE,
    )
    rotors = Rotors(
        layout=layout,
        thrust=(0.0, 0.0, P["c_T"] * flow * n_full * P["D"]),
        torque_per_thrust_m=P["c_P"] * P["D"] / (2.0 * math.pi * P["c_T"]),
        lag_up_s=YAW["T_motor"],
        induced_drag_n_s_m=P["c_H"] * flow,
        inclined=True,
        inflow_n_s_m=-P["dc_T_dJ"] * flow,
        inertia_kg_m2=YAW["N_spin"] * P["I_zz"] / (8.0 * math.pi * P["k_n"]),
        full_speed_rad_s=2.0 * math.pi * n_full,
    )
    vehicle = Multirotor(
        name="hummingbird",
        mass_kg=P["m"],
        inertia_kg_m2=np.array([P["I_xx"], P["I_yy"], P["I_zz"]]),
        rotors=rotors,
        source=SOURCE,
    )
    return Aircraft(
        vehicle=vehicle,
        autopilot=_autopilot(),
        sensors=Sensors(accelerometer_place_m=(0.0, 0.0, -PITCH["z_imu"])),
    )


def _autopilot() -> Autopilot:
    """Gains are ours. Delays are the published ones, less the lag of the rotors where they hold it, and half a tick."""
    held_s, lag_s = 0.5 / RATE_HZ, YAW["T_motor"]
    tilting = max(0.0, PITCH["tau_pitch"] - lag_s - held_s)
    return Autopilot(
        kind="simple",
        rate_hz=RATE_HZ,
        rates=RateLoop(proportional=(0.035, 0.035, 0.04), integral=(0.05, 0.05, 0.02)),
        angle_1_s=(5.0, 5.0, 2.0),
        guidance=Guidance(
            stick_climb_m_s=1.0,
            velocity_p_1_s=1.5,
            velocity_i_1_s2=0.3,
            climb_p=0.06,
            climb_i=0.05,
            height_p_1_s=0.5,
            hold_velocity=True,
            hold_height=True,
            tilt_compensation=True,
        ),
        delay_s=(tilting, tilting, YAW["tau_yaw"] - held_s, VERTICAL["tau_thrust"] - lag_s - held_s),
        mixer=MIXER,
    )
