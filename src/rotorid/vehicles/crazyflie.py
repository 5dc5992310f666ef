r"""The Crazyflie 2.x, from measurements of others and from the flight data of its users.

Thrust of each rotor after the lagged command :math:`x` between zero and one, in newtons, and its torque:

.. math:: T_i = 0.02272 - 0.01194 \, x_i + 0.12837 \, x_i^2, \qquad Q_i = 5.965\,\mathrm{mm}\; T_i

The curve and the lag of 72 ms come from flights with a logger at 1 kHz, inertia, torque and drag from bench and motion
capture (Förster, *System Identification of the Crazyflie 2.0 Nano Quadrocopter*, ETH Zürich, 2015). Drag is there in
proportion to velocity and to the sum of the speeds of the rotors, 1862 rad/s each in hover; here it is that of hover.
Rates and mixer are those of its firmware, whose gains count degrees and 16 bit: 65536 is a command of one.

What is ours: products of inertia are zero (Förster: up to 0.11 of the least moment), and velocity and height are held
with gains chosen here, for the firmware's need the place.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.models.rotors import library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft

SOURCE = (
    "Förster 2015, ETH Zürich (inertia, torque, drag); flight data at 1 kHz (thrust, lag); Bitcraze's firmware (gains)"
)

MASS_KG = 0.027
INERTIA_KG_M2 = (1.6571710e-5, 1.6655602e-5, 2.9261652e-5)
ARM_M = 0.028 * 2.0**0.5
"""Center to rotor; 28 mm to each side and ahead."""

THRUST_N = (0.02272, -0.01194, 0.12837)
LAG_S = 0.072
TORQUE_PER_THRUST_M = 0.005964552

DRAG_N_S2_M = (9.1785e-7, 9.1785e-7, 10.311e-7)
"""Over velocity and the sum of the speeds of the rotors."""

HOVER_RAD_S = 1862.0
"""Speed of each rotor, by Förster's curves of thrust and speed."""

_FULL = 65536.0
_PER_DEGREE = math.degrees(1.0) / _FULL


def aircraft() -> Aircraft:
    """What flies.

    Examples
    --------
    >>> float(aircraft().vehicle.hover_shares[0].round(4))
    0.6303
    """
    layout = library_layout("quad.x.crazyflie").scaled(ARM_M)
    drag = np.array(DRAG_N_S2_M) * layout.rotors * HOVER_RAD_S
    vehicle = Multirotor(
        name="crazyflie",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(layout=layout, thrust=THRUST_N, torque_per_thrust_m=TORQUE_PER_THRUST_M, lag_up_s=LAG_S),
        aerodynamics=np.diag([*-drag, 0.0, 0.0, 0.0]),
        source=SOURCE,
    )
    x, y = np.sign(layout.positions[:, 0]), np.sign(layout.positions[:, 1])
    autopilot = Autopilot(
        kind="simple",
        rate_hz=500.0,
        rates=RateLoop(
            proportional=(250.0 * _PER_DEGREE, 250.0 * _PER_DEGREE, 120.0 * _PER_DEGREE),
            integral=(500.0 * _PER_DEGREE, 500.0 * _PER_DEGREE, 16.7 * _PER_DEGREE),
            derivative=(2.5 * _PER_DEGREE, 2.5 * _PER_DEGREE, 0.0),
        ),
        angle_1_s=(6.0, 6.0, 6.0),
        guidance=Guidance(
            stick_climb_m_s=1.0,
            velocity_p_1_s=1.5,
            velocity_i_1_s2=0.3,
            climb_p=0.15,
            climb_i=0.1,
            height_p_1_s=1.0,
            hold_velocity=True,
            hold_height=True,
            tilt_compensation=True,
        ),
        gyro_cutoff_hz=80.0,
        accelerometer_cutoff_hz=30.0,
        mixer=np.column_stack([-0.5 * y, 0.5 * x, layout.spins, np.ones(layout.rotors)]),
    )
    return Aircraft(vehicle=vehicle, autopilot=autopilot, sensors=Sensors())
