r"""A quadrotor of 1 kg for forward flight: the X of PX4's simulator in air that its rotors and its body feel.

Each rotor drags across its disc and loses thrust to the inflow, the body drags with the square of the speed, and the
rotors sit above the center of gravity, so that every derivative changes with the speed:

.. math::

    F_i = -h_d x_i (u_i, v_i, 0)^T + k_w x_i w_i a_i, \qquad F_{body} = -(k_x |u| u, k_y |v| v, k_z |w| w)^T

Its exact linear model at any airspeed is :func:`rotorid.simulation.linearize`; it flies level up to some 13 m/s. The
frame, the motors and the controllers are those of :mod:`rotorid.vehicles.px4`. What the air does is ours: the size that
flight tests of vehicles of this weight find, 0.25 1/s of drag and 0.6 1/s of damping in heave around hover.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.simulation.multirotor import Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.vehicles import px4

SOURCE = "frame, motors and controllers of px4_quad; drag, inflow and height of the rotors are ours"

INDUCED_DRAG_N_S_M = 0.12
INFLOW_N_S_M = 0.3
QUADRATIC_DRAG_N_S2_M2 = (0.010, 0.012, 0.015)
ROTOR_HEIGHT_M = 0.04
DAMPING_N_M_S = 0.01


def aircraft() -> Aircraft:
    """What flies.

    Examples
    --------
    >>> from rotorid.simulation import hover_derivatives_of
    >>> craft = aircraft()
    >>> [round(hover_derivatives_of(craft.vehicle, craft.autopilot, airspeed_m_s=speed)["X_u"], 2) for speed in (0, 8)]
    [-0.24, -0.42]
    """
    base = px4.aircraft()
    vehicle = replace(
        base.vehicle,
        name="forward_quad",
        rotors=replace(base.vehicle.rotors, induced_drag_n_s_m=INDUCED_DRAG_N_S_M, inflow_n_s_m=INFLOW_N_S_M),
        aerodynamics=-np.diag([0.0, 0.0, 0.0, *[DAMPING_N_M_S] * 3]),
        quadratic_drag_n_s2_m2=QUADRATIC_DRAG_N_S2_M2,
        center_of_gravity_m=(0.0, 0.0, ROTOR_HEIGHT_M),
        source=SOURCE,
    )
    return replace(base, vehicle=vehicle, sensors=Sensors())
