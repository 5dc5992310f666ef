r"""The AscTec Hummingbird: published models of pitch, yaw and heave, and a vehicle that flies like them.

**Published.** A quadrotor in a plus, flown outdoors with pilot's sweeps below 2 Hz and injected ones above (Niermeyer,
Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via Closed-Loop Flight
Testing*, tables 2 to 4). Commands are those of its motor controllers, 1 to 200, as differences of rotor speeds (eq 6).

Pitch was published with the scaled state :math:`q_T = 100 z q`, because the tool of its authors had no parameters in
output matrices. In SI units, with :math:`1/(100 z)` = 0.7416 (so the accelerometer sits 13.5 mm above the center of
gravity), the printed 8.207 becomes M_u = 6.086 rad/(s m) and the printed 2.977 M_pitch = 2.208 rad/s². Its delays are
those of each response: the gyroscope's is ``tau_pitch``, and ``tau_ax`` what the accelerometer has beyond that. Roll
and pitch of this vehicle are alike.

Yaw was published with the motor speed in rad/s, fed by the constant :math:`k_{\omega\delta}` that is not printed. The
model ``axis.yaw`` holds the same system with the speed as a fraction of its steady answer:

.. math::

    T_{motor} = -1/M_{mot,\omega}, \qquad N_{yaw} = -N_\omega (k_{\omega\delta} + M_{mot,yaw}/M_{mot,\omega}), \qquad
    N_{spin} = -N_\omega k_{\omega\delta} T_{motor}

The steady speed is 3.603 rad/s a step; :math:`k_{\omega\delta}` must be larger, for a motor controller without
integral part never quite reaches what it is asked for. Here it is 3.94, which is ours.

**Flying.** Rotors in a plus make the forces of `rotorid.models.physical`: thrust that falls with the air that meets the
rotor, :math:`dc_T/dJ`, a side force against the motion across it that shrinks with the inclination of the inflow, and
torque. The publication has derivatives and no physical parameters. Those here solve
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

from rotorid.models.library import library_model
from rotorid.models.physical import MIXER
from rotorid.models.rotors import RotorLayout
from rotorid.models.state_space import StateSpace
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.units import STANDARD_GRAVITY_M_S2

_PER_SCALED_RATE = 0.7416
"""1/(100 z) of table 2, 1/m over 100."""

PITCH: Mapping[str, float] = MappingProxyType(
    {
        "M_pitch": 2.977 * _PER_SCALED_RATE,
        "M_q": 0.0,
        "M_u": 8.207 * _PER_SCALED_RATE,
        "X_q": 0.0,
        "X_u": -0.2090,
        "z_imu": 0.01 / _PER_SCALED_RATE,
        "tau_pitch": 0.02423,
        "tau_ax": 0.05791 - 0.02423,
        "T_motor": 0.0,
    }
)
"""Table 2 in SI units; a zero was dropped there, and motor lag is part of the delays."""

_MOTOR_POLE = -42.21
_MOTOR_GAIN = 152.1
_N_OMEGA = -0.5541
_SPEED_PER_COMMAND = 3.94

YAW: Mapping[str, float] = MappingProxyType(
    {
        "N_yaw": -_N_OMEGA * (_SPEED_PER_COMMAND + _MOTOR_GAIN / _MOTOR_POLE),
        "N_spin": _N_OMEGA * _SPEED_PER_COMMAND / _MOTOR_POLE,
        "N_r": 0.0,
        "tau_yaw": 0.01313,
        "T_motor": -1.0 / _MOTOR_POLE,
    }
)
"""Table 3 in the parameters of ``axis.yaw``; N_r was dropped there."""

VERTICAL: Mapping[str, float] = MappingProxyType(
    {"Z_thrust": -0.1692, "Z_w": -0.5934, "tau_thrust": 0.05202, "tau_az": 0.0, "T_motor": 0.0}
)
"""Table 4."""

TRUTH: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"axis.pitch": PITCH, "axis.yaw": YAW, "axis.vertical": VERTICAL}
)
"""Parameters of each model of the library that describes this vehicle."""


def pitch() -> StateSpace:
    """Pitch: outputs ``q u theta ax`` after the pitch command, unstable without an autopilot.

    Examples
    --------
    >>> pitch().poles().round(2)
    array([ 1.88-3.38j, 1.88+3.38j, -3.98+0.j ])
    """
    return _system("axis.pitch")


def yaw() -> StateSpace:
    """Yaw: output ``r`` after the yaw command, with the speed of the motors as a state.

    Examples
    --------
    >>> yaw().poles().round(2)
    array([ 0. +0.j, -42.21+0.j])
    """
    return _system("axis.yaw")


def vertical() -> StateSpace:
    """Heave: outputs ``w az`` after the thrust command.

    Examples
    --------
    >>> vertical().poles().round(4)
    array([-0.5934+0.j])
    """
    return _system("axis.vertical")


def _system(name: str) -> StateSpace:
    model = library_model(name)
    parameters = model.parameters.with_values(TRUTH[name])
    if not TRUTH[name]["T_motor"]:
        parameters = parameters.drop("T_motor")
    return model.condensed(parameters).matrices(parameters.values)


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
    >>> flying = aircraft()
    >>> flying.vehicle.hover_shares.round(3).tolist(), round(PHYSICS["c_T"], 3), round(PHYSICS["z"], 3)
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
    hold_s, lag_s = 0.5 / RATE_HZ, YAW["T_motor"]
    tilting = max(0.0, PITCH["tau_pitch"] - lag_s - hold_s)
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
        delay_s=(tilting, tilting, YAW["tau_yaw"] - hold_s, VERTICAL["tau_thrust"] - lag_s - hold_s),
        mixer=MIXER,
    )
