"""What physics allows: inertia of a rigid body, weight and thrust, signs of the coefficients of a rotor."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rotorid.data.findings import Finding
from rotorid.models.physical import hover_speed

_ROUNDING = 1e-9


def check_inertia(I_xx: float, I_yy: float, I_zz: float) -> list[Finding]:
    r"""Remarks on moments of inertia that no rigid body has.

    They are positive, and none exceeds the sum of the other two, :math:`I_{xx} + I_{yy} \ge I_{zz}`: equality is a flat
    plate. The axes are taken as principal ones.

    Parameters
    ----------
    I_xx, I_yy, I_zz
        kg m².

    Examples
    --------
    The inertia that RotorS gives its iris is that of no body:

    >>> check_inertia(0.03476, 0.04589, 0.0977)[0].message
    'I_zz = 0.0977 kg m^2 exceeds I_xx + I_yy = 0.08065 kg m^2, which no rigid body can have.'
    """
    inertia = {"I_xx": I_xx, "I_yy": I_yy, "I_zz": I_zz}
    wrong = [name for name, value in inertia.items() if not (value > 0.0 and math.isfinite(value))]
    if wrong:
        return [
            _impossible(name, f"{name} = {inertia[name]:.4g} kg m^2 is not positive.", {"kg_m2": inertia[name]})
            for name in wrong
        ]
    findings = []
    for name, value in inertia.items():
        first, second = (other for other in inertia if other != name)
        others = inertia[first] + inertia[second]
        if value > others * (1.0 + _ROUNDING):
            message = f"{name} = {value:.4g} kg m^2 exceeds {first} + {second} = {others:.4g} kg m^2, "
            findings.append(
                _impossible(
                    name,
                    message + "which no rigid body can have.",
                    {"kg_m2": value, "sum_of_others_kg_m2": others},
                )
            )
    return findings


def check_hover_speed(physics: Mapping[str, float], *, tolerance: float = 0.05) -> list[Finding]:
    """A remark where the thrust at the stated hover speed is not the weight.

    Parameters
    ----------
    physics
        At least ``m``, ``c_T``, ``rho``, ``D`` and ``n_h``.
    tolerance
        Relative difference of thrust and weight that passes without a remark.

    Examples
    --------
    >>> check_hover_speed({"m": 1.5, "c_T": 0.1, "rho": 1.225, "D": 0.25, "n_h": 70.0})[0].numbers["thrust_per_weight"]
    0.637...
    """
    carried = (physics["n_h"] / hover_speed(physics)) ** 2
    if abs(carried - 1.0) <= tolerance:
        return []
    message = (
        f"At n_h = {physics['n_h']:.4g} rev/s the rotors carry {100.0 * carried:.0f} % of the weight: "
        "m, c_T, rho, D and n_h do not belong to one vehicle in hover."
    )
    return [_impossible("n_h", message, {"thrust_per_weight": carried})]


# Friction opposes motion, and the thrust of a rotor falls with the air that meets it.
_SIGNS = {"c_T": 1.0, "dc_T_dJ": -1.0, "c_H": 1.0, "c_P": 1.0, "m": 1.0, "n_h": 1.0, "k_n": 1.0}


def check_signs(physics: Mapping[str, float]) -> list[Finding]:
    """Remarks on coefficients of a rotor, mass and speeds with a sign that they cannot have.

    Parameters
    ----------
    physics
        Any of ``c_T``, ``dc_T_dJ``, ``c_H``, ``c_P``, ``m``, ``n_h``, ``k_n``; a zero passes.

    Examples
    --------
    >>> check_signs({"c_H": -0.01, "c_T": 0.1})[0].message
    'c_H = -0.01 has the wrong sign: rotor forces alone do not explain it.'
    """
    return [
        _impossible(
            name,
            f"{name} = {physics[name]:.4g} has the wrong sign: rotor forces alone do not explain it.",
            {"value": physics[name]},
        )
        for name, sign in _SIGNS.items()
        if name in physics and sign * physics[name] < 0.0
    ]


def _impossible(where: str, message: str, numbers: Mapping[str, float]) -> Finding:
    return Finding(
        kind="impossible_physics",
        severity="warning",
        where=where,
        message=message,
        numbers=numbers,
    )
