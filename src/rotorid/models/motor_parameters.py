r"""Parameters of the chain from motor outputs to accelerations, and which of them a flight can tell.

.. math::

    T_{motor} \dot x_i &= u_i(t - \tau) - x_i, \qquad F_i = c_0 + c_1 x_i + c_2 x_i^2

    a_z &= -\tfrac{1}{m} \sum F_i + Z_w w

    \dot p &= \tfrac{1}{I_{xx}} \sum (-y_i) F_i + L_p p, \qquad
    \dot q = \tfrac{1}{I_{yy}} \sum x_i F_i + M_q q, \qquad
    \dot r = \tfrac{\kappa}{I_{zz}} \sum s_i F_i + N_r r

with rotor i at :math:`(x_i, y_i)` and the direction :math:`s_i` of its torque. Accelerations alone know ratios: thrust
by mass, mass by inertia, :math:`\kappa` by :math:`I_{zz}`. One known mass, thrust or inertia sets the scale of all; one
of :math:`\kappa` and :math:`I_{zz}` gives the other.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias, get_args

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet

Curve: TypeAlias = Literal["linear", "quadratic", "affine", "polynomial"]
"""Thrust of a rotor: ``c_1 x``, ``c_2 x^2``, ``c_0 + c_1 x``, or all three."""

CURVE_TERMS: Mapping[Curve, tuple[str, ...]] = {
    "linear": ("c_1",),
    "quadratic": ("c_2",),
    "affine": ("c_0", "c_1"),
    "polynomial": ("c_0", "c_1", "c_2"),
}
"""Coefficients of each curve."""

SCALES = ("m", "c_1", "c_2", "c_0", "I_xx", "I_yy")
"""Any one of these, known and in the model, sets the scale of the others. I_zz does not: yaw has kappa of its own."""

_POSITIVE = ("m", "I_xx", "I_yy", "I_zz", "kappa", "T_motor")

_UNITS: Mapping[str, str] = {
    "m": "kg",
    "c_0": "N",
    "c_1": "N",
    "c_2": "N",
    "I_xx": "kg m^2",
    "I_yy": "kg m^2",
    "kappa_per_I_zz": "1/(kg m)",
    "T_motor": "s",
    "tau_gyro": "s",
    "tau_accel": "s",
    "L_p": "1/s",
    "M_q": "1/s",
    "N_r": "1/s",
    "Z_w": "1/s",
}
_STARTS: Mapping[str, float] = {
    "m": 1.0,
    "c_1": 5.0,
    "I_xx": 0.01,
    "I_yy": 0.01,
    "kappa_per_I_zz": 1.0,
    "T_motor": 0.03,
    "tau_gyro": 0.005,
    "tau_accel": 0.005,
}
_BOUNDS: Mapping[str, tuple[float, float]] = {
    "m": (1e-4, 1e4),
    "I_xx": (1e-9, 1e5),
    "I_yy": (1e-9, 1e5),
    "T_motor": (1e-4, 1.0),
    "tau_gyro": (0.0, 0.2),
    "tau_accel": (0.0, 0.2),
}
_OF_AXIS: Mapping[str, tuple[str, ...]] = {
    "az": ("tau_accel", "Z_w"),
    "p": ("I_xx", "L_p"),
    "q": ("I_yy", "M_q"),
    "r": ("kappa_per_I_zz", "N_r"),
}
RATES = ("p", "q", "r")


def motor_parameters(
    *,
    curve: Curve = "polynomial",
    known: Mapping[str, float] | None = None,
    axes: Sequence[str] = ("az", "p", "q", "r"),
    lag: bool = True,
    heave_damping: bool = True,
    earliest_s: float = 0.0,
) -> ParameterSet:
    """Parameters of the motor chain, with what is known held.

    Parameters
    ----------
    curve
        Thrust of a rotor by its lagged output.
    known
        Values that were measured otherwise: mass, inertia, a coefficient of thrust from a bench, ``kappa``, a lag.
        Where none of :data:`SCALES` is among them, mass is held at one kilogram: thrust and inertia are per kilogram.
    axes
        Those of ``az p q r`` that were excited.
    lag
        Whether the motors lag behind their outputs; not so for measured speeds.
    heave_damping
        Whether the velocity along z was logged, for ``Z_w``.

    earliest_s
        Least delay; below zero where a delay is what is left of a known one, whose stamps may be off.

    Raises
    ------
    ModelError
        A name is not known, or both of ``kappa`` and ``I_zz`` are given.

    Examples
    --------
    >>> motor_parameters(curve="linear", known={"m": 1.5, "kappa": 0.06})["I_zz"].status
    'tied'
    """
    held = dict(known or {})
    _require(held, curve)
    if scale_of(held, axes) is None:
        held["m"] = 1.0
    names = ["m", *CURVE_TERMS[curve]]
    names += [name for axis in ("p", "q", "r", "az") if axis in axes for name in _OF_AXIS[axis]]
    # Without a lag a delay to samples of the force moves whole samples or nothing.
    names = [*names, "T_motor"] if lag else [name for name in names if name != "tau_accel"]
    names += ["tau_gyro"] if set(axes) & set(RATES) else []
    if not heave_damping:
        names = [name for name in names if name != "Z_w"]
    parameters = [_parameter(name, held.get(name), earliest_s) for name in names]
    return ParameterSet((*parameters, *_yaw(held, "r" in axes)))


def scale_of(known: Mapping[str, float], axes: Sequence[str]) -> str | None:
    """What is known that sets the scale of mass, thrust and inertia; ``None`` where nothing does.

    Examples
    --------
    >>> scale_of({"I_xx": 0.02}, ["q"]) is None
    True
    """
    of_axis = {"I_xx": "p", "I_yy": "q"}
    usable = (name for name in SCALES if known.get(name, 0.0) != 0.0)
    return next((name for name in usable if of_axis.get(name, "any") in (*axes, "any")), None)


def _parameter(name: str, value: float | None, earliest_s: float) -> Parameter:
    lower, upper = _BOUNDS.get(name, (-1e9, 1e9))
    lower = earliest_s if name in ("tau_gyro", "tau_accel") else lower
    return Parameter(
        name=name,
        value=_STARTS.get(name, 0.0) if value is None else value,
        unit=_UNITS[name],
        lower=lower,
        upper=upper,
        status="free" if value is None else "fixed",
    )


def _yaw(held: Mapping[str, float], seen: bool) -> tuple[Parameter, ...]:
    """Torque by thrust and inertia of yaw, of which one gives the other."""
    if not seen:
        return ()
    if "kappa" in held:
        tie = Expression.parse("kappa/kappa_per_I_zz")
        known = Parameter(name="kappa", value=held["kappa"], unit="m", status="fixed")
        return known, Parameter(name="I_zz", unit="kg m^2", tied=tie)
    if "I_zz" in held:
        known = Parameter(name="I_zz", value=held["I_zz"], unit="kg m^2", status="fixed")
        return known, Parameter(name="kappa", unit="m", tied=Expression.parse("kappa_per_I_zz*I_zz"))
    return ()


def _require(held: Mapping[str, float], curve: Curve) -> None:
    if curve not in get_args(Curve):
        raise ModelError(f"there is no curve {curve!r}", needed=f"one of {', '.join(get_args(Curve))}")
    allowed = {*_UNITS, "kappa", "I_zz"}
    for name, value in held.items():
        if name not in allowed:
            near = difflib.get_close_matches(name, allowed, n=1)
            raise ModelError(
                f"there is no parameter {name}",
                needed=f"one of {', '.join(sorted(allowed))}",
                remedy=f"did you mean {near[0]}?" if near else "",
            )
        if name in _POSITIVE and not value > 0.0:
            raise ModelError(f"{name} = {value:g} came as known", needed="a positive number")
        if name.startswith("c_") and name not in CURVE_TERMS[curve]:
            raise ModelError(f"{name} came, which a {curve} curve does not have", remedy="choose another curve")
    if any(name in held for name in CURVE_TERMS[curve]) and not _lifts(held, curve):
        raise ModelError(
            "the thrust that came as known does not lift anything",
            needed="coefficients that add up to a positive thrust",
        )
    if {"kappa", "I_zz"} <= set(held):
        raise ModelError("both kappa and I_zz came as known", needed="one of them, which gives the other")


def _lifts(held: Mapping[str, float], curve: Curve) -> bool:
    """Whether known coefficients leave a rotor that lifts at full output, as far as all of them are known."""
    terms = CURVE_TERMS[curve]
    return not set(terms) <= set(held) or sum(held[name] for name in terms) > 0.0
