r"""The quadrotor of PX4's own simulator, SIH, as its parameters describe it.

Four rotors in an X with linear thrust, a body with linear drag and damping:

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

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.models.rotor_layout import RotorLayout
from rotorid.models.rotor_layout_library import library_layout
from rotorid.simulate.multirotor import Multirotor, Rotors
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.simulate.sensors import Sensors
from rotorid.vehicles.px4_cascade import PX4_PARAMETERS, px4_autopilot, rotor_parameters, stabilized

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
