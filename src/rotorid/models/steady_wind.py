r"""A model of hover in a steady wind, against which the vehicle leans.

In trim, thrust, weight and drag add up to nothing, so thrust points against weight and steady drag together: seen along
the rotors the vehicle hovers level, under a gravity of :math:`g / \cos(\text{lean})`. Let :math:`D` be the steady drag
in body axes at trim, over mass; it balances gravity across the rotors,

.. math:: D_x = g \sin\theta_0, \qquad D_y = -g \cos\theta_0 \sin\phi_0,

and :math:`u_0 = D_x / X_u, \; v_0 = D_y / Y_v` the velocity through the air. The wind does not turn with the body, so
that small angles about the trim change what the body meets:

.. math::

    u_{air} = u + v_0 \psi, \qquad v_{air} = v - u_0 \psi, \qquad w_{air} = w + u_0 \theta - v_0 \phi

With accelerometers less the drag of the steady wind, :math:`a - R^T R_0 D` (:mod:`rotorid.flights.steady_wind`), the
outputs across the rotors and the equations of :math:`u, v` are those of calm air with the larger gravity. What is left
acts on the heave,

.. math:: w' = \dots + Z_w w_{air} - D_x \theta + D_y \phi, \qquad a_z = w' + (1 - s) (D_x \theta - D_y \phi),

which is nothing for drag of one size along all axes and whole for rotors that drag in their plane alone, and on
moments, by the derivatives of speed: :math:`M_w w_{air}`, :math:`L_v v_{air}`. A share :math:`s` of the drag, none or
all, is taken off :math:`a_z` too: to first order both are right, and the one nearer to :math:`Z_w / X_u` keeps the
motion of other axes out of it.

Maneuvers are flown at several headings and in gusts, so the drag that an angle meets is that of the maneuvers that move
it: heave has its own :math:`D`, the heading another, and gravity the lean of the maneuvers that tilt.

Left out: second-order terms of the lean; gusts; drag that does not grow in proportion to speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.structure import LinearStructure, Rows

STEADY_DRAG = ("D_x", "D_y")
"""Constants of a model in wind: steady drag over mass along the body, m/s²; zero in calm air."""

TURNING_DRAG = ("D_x_yaw", "D_y_yaw")
"""The same where the heading moves."""

LEAN = "lean_0"
"""Constant of a model in wind: angle between the thrust and the vertical at its trim, radians."""

HEAVE_SHARE = "D_share"
"""Constant of a model in wind: share of the steady drag that the accelerometer of heave leaves out."""

HEAVE_SHARES = (0.0, 1.0)
"""Its values: for rotors that drag in their plane alone, and for drag of one size along all axes."""

_LEAST_DAMPING_1_S = 0.02
"""Damping of speed below which the lean does not show the wind: a vehicle that drags has ten times as much."""

_ZERO = Expression()


def leans(structure: LinearStructure) -> bool:
    """Whether a model has the gravity that a lean changes: along the body, by an angle.

    Examples
    --------
    >>> from rotorid.models.library import library_model, rate_model
    >>> leans(library_model("hover.lateral")), leans(library_model("axis.pitch")), leans(rate_model("rate.roll"))
    (True, True, False)
    """
    return "g" in structure.constants and any(
        {speed, angle} <= set(structure.states) and "g" in _entry(structure, speed, angle).names
        for speed, angle in (("u", "theta"), ("v", "phi"))
    )


def in_steady_wind(
    structure: LinearStructure,
    drag_x: float,
    drag_y: float,
    *,
    turning: tuple[float, float] | None = None,
    lean_rad: float | None = None,
    heave_share: float = 0.0,
) -> LinearStructure:
    """A model about a hover in which the vehicle leans against a steady wind.

    Parameters
    ----------
    structure
        A model of hover that :func:`leans`, in calm air or in another wind.
    drag_x, drag_y
        Drag of the steady wind over mass, along the body axes at trim, m/s².
    turning
        The same where the heading moves, by default no other.
    lean_rad
        Lean that it takes, by default that against ``drag_x, drag_y``.
    heave_share
        Share of it that is taken off the accelerometer along the rotors.

    Returns
    -------
    LinearStructure
        With the constants ``D_x D_y D_x_yaw D_y_yaw D_share lean_0`` and ``g`` along the thrust.

    Examples
    --------
    >>> from rotorid.models.library import library_model
    >>> windy = in_steady_wind(library_model("hover.longitudinal"), 1.0, 0.0)
    >>> round(windy.constants["g"], 3), windy.constants["D_x"]
    (9.858, 1.0)
    >>> in_steady_wind(windy, 0.0, 0.0).constants["g"]
    9.80665
    """
    if STEADY_DRAG[0] not in structure.constants:
        if not drag_x and not drag_y:
            return structure
        structure = _blown(structure)
    g = structure.constants["g"] * math.cos(lean_of(structure.constants))
    across = math.hypot(drag_x, drag_y)
    if across >= g:
        raise ModelError(f"a steady drag of {across:.3g} m/s² across the rotors", needed=f"less than g = {g:.3g} m/s²")
    lean_rad = math.asin(across / g) if lean_rad is None else lean_rad
    drags = zip((*STEADY_DRAG, *TURNING_DRAG), (drag_x, drag_y, *(turning or (drag_x, drag_y))), strict=True)
    return structure.with_constants(
        {"g": g / math.cos(lean_rad), **dict(drags), HEAVE_SHARE: heave_share, LEAN: lean_rad}
    )


def lean_of(constants: Mapping[str, float]) -> float:
    """Angle between the thrust of a model and the vertical at its trim, radians.

    Examples
    --------
    >>> lean_of({"g": 9.80665})
    0.0
    """
    return constants.get(LEAN, 0.0)


def _blown(structure: LinearStructure) -> LinearStructure:
    """The structure with what a steady wind adds to its equations, in calm air as yet."""
    calm = dict.fromkeys((*STEADY_DRAG, *TURNING_DRAG, HEAVE_SHARE, LEAN), 0.0)
    structure = replace(structure, constants={**structure.constants, **calm})
    F: dict[str, int] = {name: _row(structure, name) for name in ("u", "v", "w") if name in structure.states}
    damping: dict[str, Expression] = {name: structure.F[row][structure.states.index(name)] for name, row in F.items()}
    along, aside = damping.get("u", damping.get("v", _ZERO)), damping.get("v", damping.get("u", _ZERO))
    u_0, v_0, u_turning, v_turning = (
        Expression.symbol(name) * _inverse(by)
        for name, by in zip((*STEADY_DRAG, *TURNING_DRAG), (along, aside, along, aside), strict=True)
    )
    if "r" in structure.states and "psi" not in structure.states and _turned_by_speed(structure, F):
        structure = _with_heading(structure)
    changes: dict[tuple[int, str], Expression] = {}
    met = (("u", "psi", v_turning), ("v", "psi", -u_turning), ("w", "theta", u_0), ("w", "phi", -v_0))
    for speed, angle, airspeed in met:
        if not {speed, angle} <= set(structure.states):
            continue
        for row, entries in enumerate(structure.F):
            # What a speed does to its own force is in the trim; heave has it, as gravity is not along its drag.
            if speed == "w" or row != F[speed]:
                by_speed = entries[structure.states.index(speed)]
                changes[row, angle] = changes.get((row, angle), _ZERO) + by_speed * airspeed
    tilted = (("theta", -Expression.symbol("D_x")), ("phi", Expression.symbol("D_y")))
    level = [(angle, drag) for angle, drag in tilted if angle in structure.states]
    if "w" in F:
        for angle, drag in level:
            changes[F["w"], angle] = changes.get((F["w"], angle), _ZERO) + drag
    H0 = structure.H0
    if "w" in F and "az" in structure.outputs:
        az, left = structure.outputs.index("az"), Expression.constant(1.0) - Expression.symbol(HEAVE_SHARE)
        H0 = _changed(H0, structure.states, {(az, angle): -drag * left for angle, drag in level})
    return replace(structure, F=_changed(structure.F, structure.states, changes), H0=H0)


def _inverse(damping: Expression) -> Expression:
    """One over the damping of a speed, and nothing where there is none."""
    return damping / (damping * damping + _LEAST_DAMPING_1_S**2)


def _turned_by_speed(structure: LinearStructure, F: Mapping[str, int]) -> bool:
    """Whether a speed does more than drag."""
    return any(
        not entries[structure.states.index(speed)].is_zero
        for speed in ("u", "v")
        if speed in F
        for row, entries in enumerate(structure.F)
        if row != F[speed]
    )


def _with_heading(structure: LinearStructure) -> LinearStructure:
    """The structure with the heading about its trim as one more state."""
    rate = [Expression.constant(float(name == "r")) for name in (*structure.states, "psi")]
    own = [Expression.constant(float(name == "psi")) for name in (*structure.states, "psi")]
    return replace(
        structure,
        states=(*structure.states, "psi"),
        M=(*((*row, _ZERO) for row in structure.M), tuple(own)),
        F=(*((*row, _ZERO) for row in structure.F), tuple(rate)),
        G=(*structure.G, (_ZERO,) * len(structure.inputs)),
        H0=tuple((*row, _ZERO) for row in structure.H0),
        H1=tuple((*row, _ZERO) for row in structure.H1),
    )


def _changed(matrix: Rows, states: Sequence[str], changes: Mapping[tuple[int, str], Expression]) -> Rows:
    rows = [list(row) for row in matrix]
    for (row, angle), added in changes.items():
        column = states.index(angle)
        rows[row][column] = rows[row][column] + added
    return tuple(map(tuple, rows))


def _row(structure: LinearStructure, state: str) -> int:
    """The equation of a state: the one with its derivative."""
    column = structure.states.index(state)
    return next(row for row, entries in enumerate(structure.M) if not entries[column].is_zero)


def _entry(structure: LinearStructure, state: str, by: str) -> Expression:
    return structure.F[_row(structure, state)][structure.states.index(by)]
