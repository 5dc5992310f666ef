"""Vehicles whose numbers are known, joined as results are."""

from __future__ import annotations

import numpy as np

from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import RotorLayout, library_layout

SIH = {
    "m": 1.0,
    "I_xx": 0.025,
    "I_yy": 0.025,
    "I_zz": 0.03,
    "c_1": 5.0,
    "kappa": 0.02,
    "arm": 0.2 * 2**0.5,
    "T_motor": 0.048,
    "X_u": -1.0,
    "Y_v": -1.0,
    "Z_w": -1.0,
    "L_p": -1.0,
    "M_q": -1.0,
    "N_r": -1.0 / 1.2,
}
"""PX4's own simulated quadrotor: 5 N, 0.1 N m, levers of 0.2 m, and a lag that steps of 4 ms make 48 ms of 50."""

SECOND = {
    "m": 2.1,
    "I_xx": 0.019,
    "I_yy": 0.022,
    "I_zz": 0.036,
    "c_0": -0.25,
    "c_1": 6.0,
    "c_2": 9.0,
    "kappa": 0.017,
    "arm": 0.28,
    "X_u": -0.22,
    "spin_min": 0.15,
    "spin_max": 0.95,
    "disc_area": 0.2,
}
"""A vehicle of no autopilot, whose numbers in the forms of ArduPilot and Gazebo are known to five digits."""


def sih() -> JoinedVehicle:
    """PX4's own."""
    return joined_vehicle([], given=SIH, layout=library_layout("quad.x"))


def second(**numbers: float) -> JoinedVehicle:
    """The one of no autopilot."""
    return joined_vehicle([], given=SECOND | numbers, layout=library_layout("quad.x"))


def asymmetric(**numbers: float) -> JoinedVehicle:
    """Longer than wide, rotors in another order, above the center of gravity, products of inertia, mixed motion."""
    positions = np.array([[-0.2, 0.15, -0.03], [0.22, 0.16, -0.03], [-0.2, -0.15, -0.03], [0.22, -0.16, -0.03]])
    layout = RotorLayout(name="asymmetric", positions=positions, spins=[-1, 1, 1, -1], arm_known=True)
    own = {
        "m": 1.7,
        "I_xx": 0.018,
        "I_yy": 0.024,
        "I_zz": 0.035,
        "I_xy": 0.0012,
        "I_xz": -0.0017,
        "I_yz": 0.0009,
        "c_0": 0.1,
        "c_1": 2.0,
        "c_2": 10.0,
        "kappa": 0.018,
        "T_motor": 0.03,
        "delay": 0.006,
        "X_u": -0.3,
        "Y_v": -0.4,
        "Z_w": -0.5,
        "M_u": 0.8,
        "L_v": -0.7,
        "L_p": -2.0,
        "M_q": -1.5,
        "N_r": -0.6,
    }
    return joined_vehicle([], given=own | numbers, layout=layout)
