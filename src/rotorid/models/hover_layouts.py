r"""The model ``physical.hover`` for rotors of any layout: its derivatives as sums over the vehicle's own rotors.

Rotor :math:`i` stands at :math:`l (\xi_i, \eta_i)`, a share of the arm :math:`l` forward and right, in one plane at the
height :math:`z` above the center of gravity, and turns with :math:`s_i = \pm 1` (plus is counterclockwise, from above).
A command of one adds :math:`k_n b_{i}` to its speed, with the column :math:`b` of the autopilot's mixer. With
:math:`k = c_H \rho n_h D^3` and :math:`k_T = (dc_T/dJ) \rho n_h D^3`,

.. math::

    X_u &= Y_v = -N k/m, & Z_w &= N k_T n_m/(n_h m), & M_u &= N k z/I_{yy}, & L_v &= -N k z/I_{xx}

    X_q &= N k z/m, &
    M_q &= (k_T l^2 \textstyle\sum \xi_i^2 - N k z^2)/I_{yy}

    Y_p &= -N k z/m, &
    L_p &= (k_T l^2 \textstyle\sum \eta_i^2 - N k z^2)/I_{xx}

    M_{pitch} &= 2 k_n c_T \rho n_h D^4 l \textstyle\sum \xi_i b_i/I_{yy}, &
    L_{roll} &= -2 k_n c_T \rho n_h D^4 l \textstyle\sum \eta_i b_i/I_{xx}

    N_{yaw} &= k_n c_P \rho n_h D^5 \textstyle\sum s_i b_i/(\pi I_{zz}), &
    N_{spin} &= 2 \pi k_n J_r \textstyle\sum s_i b_i/I_{zz}

    N_r &= -k l^2 \textstyle\sum (\xi_i^2 + \eta_i^2)/I_{zz}, &
    Z_{thrust} &= -2 k_n c_T \rho n_m D^4 \textstyle\sum b_i/m, \qquad n_h = \sqrt{m g/(N c_T \rho D^4)}

In a sweep of thrust the mean square of the speeds carries the weight. The slope of a square is that at the mean,
whatever the size: :math:`Z_{thrust}` and :math:`Z_w` belong to :math:`n_m = \sqrt{n_h^2 - (k_n \sigma)^2}`, with the
deviation :math:`\sigma` of the command behind the lag of the motors (the constant ``thrust_spread``).

These are the derivatives of :func:`rotorid.models.hover_derivatives`, which has four rotors in a plus, and the reaction
of rotors with the inertia :math:`J_r` to their spin-up. One differs: the inflow of a rotor is as inclined as in flight
across, not as in a turn on the spot, for :math:`u = g q/\omega^2` outweighs the :math:`q l` of a hub below
:math:`\omega = \sqrt{g/l}`, the band of damping. Assumed, beside what is assumed there: all rotors are alike, carry the
same in hover, push straight up, and none stands in the wake of another.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.library import library_model
from rotorid.models.rotors import UP, RotorLayout, ardupilot_mixer
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray

HOVER = "physical.hover"
"""Name of the model."""

GEOMETRY = ("m", "D", "l", "rho", "k_n")
"""What the user must know besides the model."""

_STRAIGHT = 1e-3
"""A rotor whose axis is off by more is tilted."""

_FLAT = 1e-3
"""Height or distance, in arms, below which it is none."""

_LEAST_DISTANCE = 0.05
"""Rotors nearer to each other, in arms and seen from above, are above one another."""


def plain_mixer(layout: RotorLayout) -> FloatArray:
    """What a command adds to the speed of each rotor, in units of ``k_n``, where no autopilot says it: ``(rotors, 4)``.

    Roll and pitch go with the distance from their axis and yaw with the spin, one at the largest; thrust is one.

    Parameters
    ----------
    layout
        Places and spins of the rotors.

    Examples
    --------
    >>> from rotorid.models import library_layout
    >>> plain_mixer(library_layout("quad.plus")).round(9).tolist()[0]
    [-1.0, 0.0, 1.0, 1.0]
    """
    return np.asarray(ardupilot_mixer(layout) * np.array([2.0, 2.0, 2.0, 1.0]))


def physical_hover(layout: RotorLayout, mixer: FloatArray | None = None) -> LinearStructure:
    """The model ``physical.hover`` of a vehicle with these rotors; the equations stand at the head of the module.

    Parameters
    ----------
    layout
        Its rotors; of their positions the pattern counts, the arm is the parameter ``l``.
    mixer
        Columns roll, pitch, yaw, thrust, shape ``(rotors, 4)``: what a command of one adds to the output of each motor;
        by default :func:`plain_mixer`.

    Raises
    ------
    ModelError
        Rotors are tilted, stand at different heights or above one another, or cannot make a moment of each axis.

    Examples
    --------
    >>> from rotorid.models import library_layout
    >>> x = physical_hover(library_layout("quad.x")).parameters
    >>> plus = physical_hover(library_layout("quad.plus")).parameters
    >>> round(x.values["M_pitch"] / plus.values["M_pitch"], 4), x.values["N_r"] == plus.values["N_r"]
    (1.4142, True)
    """
    _require_plain(layout)
    arm = layout.arm
    xi, eta = layout.positions[:, 0] / arm, layout.positions[:, 1] / arm
    by = plain_mixer(layout) if mixer is None else np.asarray(mixer, dtype=np.float64)
    if by.shape != (layout.rotors, 4):
        raise ModelError(f"got a mixer of shape {by.shape}", needed=f"shape {(layout.rotors, 4)}")
    count = layout.rotors
    drag, inflow, thrust = "c_H*rho*n_h*D**3", "dc_T_dJ*rho*n_h*D**3", "k_n*c_T*rho*n_h*D**4"
    turning = _number(np.sum(layout.spins * by[:, 2]))
    ties = {
        "n_h": f"sqrt(m*g/({count}*c_T*rho*D**4))",
        "X_u": f"-{count}*{drag}/m",
        "X_q": f"{count}*{drag}*z/m",
        "Y_p": f"-{count}*{drag}*z/m",
        "M_u": f"{count}*{drag}*z/I_yy",
        "L_v": f"-{count}*{drag}*z/I_xx",
        "M_q": f"({_number(np.sum(xi**2))}*{inflow}*l**2 - {count}*{drag}*z**2)/I_yy",
        "L_p": f"({_number(np.sum(eta**2))}*{inflow}*l**2 - {count}*{drag}*z**2)/I_xx",
        "M_pitch": f"{_number(2.0 * np.sum(xi * by[:, 1]))}*l*{thrust}/I_yy",
        "L_roll": f"{_number(-2.0 * np.sum(eta * by[:, 0]))}*l*{thrust}/I_xx",
        "N_r": f"-{_number(np.sum(xi**2 + eta**2))}*{drag}*l**2/I_zz",
        "N_yaw": f"{turning}*k_n*c_P*rho*n_h*D**5/(pi*I_zz)",
        "N_spin": f"{turning}*2*pi*k_n*J_r/I_zz",
        "Z_w": f"{count}*dc_T_dJ*rho*n_m*D**3/m",
        "Z_thrust": f"-{_number(2.0 * np.sum(by[:, 3]))}*k_n*c_T*rho*n_m*D**4/m",
    }
    structure = library_model(HOVER)
    parameters = structure.parameters
    for name, expression in ties.items():
        parameters = parameters.tie(name, expression)
    return replace(structure, parameters=parameters)


def _number(value: float) -> str:
    """A factor of a tie, without the rounding of sines in its last digits."""
    return f"{float(f'{value:.12g}')!r}"


def _require_plain(layout: RotorLayout) -> None:
    assert layout.axes is not None
    tilted = _numbers(np.flatnonzero(np.abs(layout.axes - np.array(UP)).max(axis=1) > _STRAIGHT))
    places = layout.positions / layout.arm
    heights = _numbers(np.flatnonzero(np.abs(places[:, 2] - places[:, 2].mean()) > _FLAT))
    between = np.hypot(*(places[:, None, :2] - places[None, :, :2]).transpose(2, 0, 1))
    above = _numbers(np.flatnonzero((between + np.eye(layout.rotors) < _LEAST_DISTANCE).any(axis=1)))
    for rotors, what in ((tilted, "tilted"), (above, "above one another"), (heights, "at different heights")):
        if rotors:
            raise ModelError(
                f"rotors {rotors} of the layout {layout.name} are {what}",
                needed=f"rotors of {HOVER} that push straight up, side by side in one plane",
                remedy="take hover.full, or physical.motors",
            )
    if layout.uncontrollable:
        raise ModelError(
            f"the rotors of the layout {layout.name} make no {' and no '.join(layout.uncontrollable)} of their own",
            needed="rotors that turn the vehicle about each axis",
        )


def _numbers(rows: Iterable[int]) -> str:
    return ", ".join(str(row + 1) for row in rows)
