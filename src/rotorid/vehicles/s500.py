r"""The S500 quadrotor in hover, as published: the vehicle that ships with rotorid.

A kit-built quadrotor of 0.5 m and 1.4 kg with PX4, identified from piloted frequency sweeps (*System Identification of
an S500 Quadrotor UAV*, eqs 2 and 3, tables 4 and 7). In hover, with everything as a difference from trim:

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
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.channel import AXES
from rotorid.models.state_space import StateSpace
from rotorid.simulate.controller import HoverController
from rotorid.simulate.vehicle import OUTPUTS, HoverVehicle
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

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
    """Both motions and the heading as one vehicle, with an autopilot that holds the hover.

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
