r"""Forces of the rotors around hover, and the derivatives that follow from them.

Four rotors in a plus: front, right, rear, left, at the distance :math:`l` from the axis of the vehicle and the height
:math:`z` above the center of gravity. Rotor :math:`i` turns with :math:`n_i` revolutions per second and moves through
the air with the velocity :math:`V_i` of its hub, which is that of the vehicle plus rates times lever:

.. math::

    T_i &= c_T(J_i) \, \rho n_i^2 D^4, \qquad J_i = -w_i / (n_i D), \qquad c_T(J) = c_T + \frac{dc_T}{dJ} J

    F_i &= -c_H \, \rho n_i D^3 \, (u_i, v_i, 0)^T \sqrt{u_i^2 + v_i^2} / |V_i| - (0, 0, T_i)^T

    M_i &= r_i \times F_i + (-1)^i \left(0, 0, \frac{c_P}{2\pi} \rho n_i^2 D^5\right)^T

Assumed: no wind, a rigid vehicle in hover, no drag of the body, no inflow of one rotor into another. What breaks it:
ducts, coaxial or tilted rotors, ground effect, and speeds where :math:`c_T` is no straight line.

Source: Niermeyer, Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via
Closed-Loop Flight Testing*, eqs 1 to 6. The derivatives printed there (eqs 8 to 10) contain misprints: a power of D in
M_u, the inertia of N_r, the sign of Z_thrust and of a term of M_q. Those here follow from the forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Number = TypeVar("Number", float, complex)

PHYSICAL_UNITS: Mapping[str, str] = {
    "m": "kg",
    "I_xx": "kg m^2",
    "I_yy": "kg m^2",
    "I_zz": "kg m^2",
    "c_T": "1",
    "dc_T_dJ": "1",
    "c_H": "1",
    "c_P": "1",
    "D": "m",
    "l": "m",
    "z": "m",
    "rho": "kg/m^3",
    "k_n": "1/s",
    "n_h": "1/s",
}
"""Physical parameters and their units: mass, inertia, coefficients of a rotor, its diameter, the arm, the height of the
rotors above the center of gravity, density of the air, speed per command and speed in hover (revolutions a second)."""

MIXER: FloatArray = np.array(
    [[0.0, 1.0, -1.0, 1.0], [-1.0, 0.0, 1.0, 1.0], [0.0, -1.0, -1.0, 1.0], [1.0, 0.0, 1.0, 1.0]]
)
"""Commands of roll, pitch, yaw and thrust (columns) to speeds of the rotors, in units of ``k_n`` (eq 6, inverted)."""
MIXER.setflags(write=False)


def hover_speed(physics: Mapping[str, Number]) -> Number:
    r"""Rotor speed that carries the weight, revolutions per second.

    .. math:: n_h = \sqrt{m g / (4 c_T \rho D^4)}

    Parameters
    ----------
    physics
        At least ``m``, ``c_T``, ``rho`` and ``D``.

    Examples
    --------
    >>> round(hover_speed({"m": 1.5, "c_T": 0.1, "rho": 1.225, "D": 0.25}), 2)
    87.67
    """
    thrust = 4.0 * physics["c_T"] * physics["rho"] * physics["D"] ** 4
    speed: Number = (STANDARD_GRAVITY_M_S2 * physics["m"] / thrust) ** 0.5
    return speed


def hover_derivatives(physics: Mapping[str, Number]) -> dict[str, Number]:
    r"""Stability and control derivatives in hover from physical parameters: the forces of this module, linearized.

    With :math:`k = c_H \rho n_h D^3`, :math:`k_T = (dc_T/dJ) \rho n_h D^3` and :math:`s = 1 + |z|/\sqrt{z^2 + l^2}`,

    .. math::

        X_u &= Y_v = -4 k/m, & X_q &= -Y_p = 2 k z s/m, & M_u &= 4 k z/I_{yy}, & L_v &= -4 k z/I_{xx}

        M_q &= 2 (k_T l^2 - k z^2 s)/I_{yy}, & N_r &= -4 k l^2/I_{zz}, & Z_w &= 4 k_T/m

        M_{pitch} &= 4 k_n l c_T \rho n_h D^4/I_{yy}, & N_{yaw} &= 4 k_n c_P \rho n_h D^5/(\pi I_{zz}), &
        Z_{thrust} &= -8 k_n c_T \rho n_h D^4/m

    and for roll as for pitch with :math:`I_{xx}`. Where the rotors carry the weight, Z_thrust is
    :math:`-2 g k_n/n_h`. The side force has no gradient at rest, only a slope along each single motion; a motion of
    several at once adds up differently (:math:`s` does not apply), which the linear model cannot show.

    Parameters
    ----------
    physics
        Every name of :data:`PHYSICAL_UNITS`. Complex numbers pass, for derivatives by a complex step.

    Examples
    --------
    >>> typical = dict(m=1.5, I_xx=0.03, I_yy=0.03, I_zz=0.055, c_T=0.1, dc_T_dJ=-0.13, c_H=0.05, c_P=0.04)
    >>> geometry = dict(D=0.25, l=0.25, z=0.03, rho=1.225, k_n=100.0, n_h=87.67)
    >>> {name: round(value, 2) for name, value in hover_derivatives(typical | geometry).items()}["M_u"]
    0.34
    """
    m, I_xx, I_yy, I_zz = (physics[name] for name in ("m", "I_xx", "I_yy", "I_zz"))
    D, l, z, k_n = (physics[name] for name in ("D", "l", "z", "k_n"))  # noqa: E741
    flow = physics["rho"] * physics["n_h"] * D**3
    drag, inflow = physics["c_H"] * flow, physics["dc_T_dJ"] * flow
    thrust = k_n * physics["c_T"] * flow * D
    # (z**2)**0.5 is |z| and, unlike abs, differentiable by a complex step.
    tilt = 1.0 + (z**2 / (z**2 + l**2)) ** 0.5
    damping = 2.0 * (inflow * l**2 - drag * z**2 * tilt)
    return {
        "X_u": -4.0 * drag / m,
        "Y_v": -4.0 * drag / m,
        "X_q": 2.0 * drag * z * tilt / m,
        "Y_p": -2.0 * drag * z * tilt / m,
        "M_u": 4.0 * drag * z / I_yy,
        "L_v": -4.0 * drag * z / I_xx,
        "M_q": damping / I_yy,
        "L_p": damping / I_xx,
        "L_roll": 4.0 * l * thrust / I_xx,
        "M_pitch": 4.0 * l * thrust / I_yy,
        "N_r": -4.0 * drag * l**2 / I_zz,
        "N_yaw": 4.0 * k_n * physics["c_P"] * flow * D**2 / (math.pi * I_zz),
        "Z_w": 4.0 * inflow / m,
        "Z_thrust": -8.0 * thrust / m,
    }


def rotor_forces(
    physics: Mapping[str, float], velocity_m_s: FloatArray, rates_rad_s: FloatArray, speeds_rev_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Force and moment of all rotors on the vehicle, not linearized; the equations stand at the head of the module.

    Parameters
    ----------
    physics
        ``c_T``, ``dc_T_dJ``, ``c_H``, ``c_P``, ``D``, ``l``, ``z`` and ``rho``.
    velocity_m_s
        ``u v w`` of the center of gravity through the air, shape ``(3,)``.
    rates_rad_s
        ``p q r``, shape ``(3,)``.
    speeds_rev_s
        Of the front, right, rear and left rotor, all positive, shape ``(4,)``.

    Returns
    -------
    numpy.ndarray
        Force along the body axes in newtons, shape ``(3,)``.
    numpy.ndarray
        Moment around the center of gravity in newton meters, shape ``(3,)``.
    """
    rho, D, l, z = (physics[name] for name in ("rho", "D", "l", "z"))  # noqa: E741
    hubs = np.array([[l, 0.0, -z], [0.0, l, -z], [-l, 0.0, -z], [0.0, -l, -z]])
    n = np.asarray(speeds_rev_s)
    velocities = np.asarray(velocity_m_s) + np.cross(rates_rad_s, hubs)
    speed, sideways = np.linalg.norm(velocities, axis=1), np.hypot(velocities[:, 0], velocities[:, 1])
    inclination = np.divide(sideways, speed, out=np.zeros(4), where=speed > 0.0)
    advance = -velocities[:, 2] / (n * D)
    thrust = (physics["c_T"] + physics["dc_T_dJ"] * advance) * rho * n**2 * D**4
    forces = -(physics["c_H"] * rho * n * D**3 * inclination)[:, None] * velocities
    forces[:, 2] = -thrust
    shaft = np.array([-1.0, 1.0, -1.0, 1.0]) * physics["c_P"] / (2.0 * np.pi) * rho * n**2 * D**5
    moment = np.cross(hubs, forces).sum(axis=0)
    moment[2] += shaft.sum()
    return forces.sum(axis=0), moment
