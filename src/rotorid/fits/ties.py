r"""Ties of a fit of responses: relations between parameters, tested where the data can, else part of the errors.

What the data can test is tested by :mod:`rotorid.uncertainty.ties`. The side force of rotors in ``physical.hover`` they
cannot: drag of the body slows a vehicle as rotors do, but does not damp its yaw. With the share s of rotors in the drag
coefficients of the model, which counts all of it to rotors, are too large,

.. math:: c_H = s \hat c_H, \qquad I_{zz} = s \hat I_{zz}, \qquad c_P = s \hat c_P, \qquad J_r = s \hat J_r, \qquad
          z = \hat z / s

and no response depends on s. What is known of it is a rigid body's :math:`I_{zz} \le I_{xx} + I_{yy}`, which a flat
vehicle comes near to. Where I_zz is known, yaw shows s, and the tie is tested.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import TWO_SIDED_95, minus, with_error
from rotorid.models.families import family_of
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.ties import TieTest, sources

_FLATTEST, _TALLEST = 1.0, 0.5
"""Inertia of yaw over the sum of the two others: that of a flat plate, and the least of a multirotor."""

_BY_DRAG = ("c_H", "I_zz", "c_P", "J_r")
_INVERSE = "z"
_DRAWS = 101


def judge_ties(parameters: ParameterSet, limits: Bounds, tests: Sequence[TieTest]) -> Iterator[Finding]:
    """Findings on ties that the data contradict.

    Parameters
    ----------
    parameters, limits
        Of the fit, its bounds with all that ties may be wrong by.
    tests
        Of its ties.
    """
    for test in tests:
        if test.contradicted:
            unit = parameters[test.name].unit
            of = [name for name in limits.names if name in sources(parameters, test.name)]
            yield warn(
                "tie_contradicted",
                test.name,
                f"The data give {test.name} = {minus(f'{test.measured:.3g}')} {unit}, its relation to "
                f"{', '.join(of)} gives {minus(f'{test.value:.3g}')} {unit}: {test.distance:.1f} standard deviations "
                f"apart. Another force acts, such as drag of the body; the errors of these parameters include it. "
                f"To drop the relation, use --free {test.name}.",
                measured=test.measured,
                by_tie=test.value,
                deviations=test.distance,
            )
    yield from _too_heavy_in_yaw(parameters, limits)


def with_rotor_share(parameters: ParameterSet, limits: Bounds, name: str) -> Bounds:
    """Bounds of ``physical.hover`` that contain what the body may do of the drag that is counted to its rotors.

    Parameters
    ----------
    parameters, limits
        Of the fit.
    name
        Of its model; another one stays as it is.
    """
    known = {"c_H", "N_r"} <= set(parameters.names) and "I_zz" in limits.names
    if not known or not family_of(name).drags_by_rotors:
        return limits
    values = parameters.values
    ratio = (values["I_xx"] + values["I_yy"]) / values["I_zz"]
    low, high = min(1.0, _TALLEST * ratio), min(1.0, _FLATTEST * ratio)
    share = np.linspace(low, high, _DRAWS)
    change = dict.fromkeys(_BY_DRAG, -float(np.sqrt(np.mean((1.0 - share) ** 2))))
    change[_INVERSE] = float(np.sqrt(np.mean((1.0 / share - 1.0) ** 2)))
    moved = np.array([change.get(parameter, 0.0) * values[parameter] for parameter in limits.names])
    return replace(limits, covariance=limits.covariance + np.outer(moved, moved), assumed=moved[:, None])


def _too_heavy_in_yaw(parameters: ParameterSet, limits: Bounds) -> Iterator[Finding]:
    """A yaw inertia that no rigid body has, by the damping of yaw."""
    if "I_zz" not in limits.names or parameters.names.count("N_r") == 0 or parameters["N_r"].tied is None:
        return
    values = parameters.values
    most = values["I_xx"] + values["I_yy"]
    excess = values["I_zz"] - most
    signs = np.array([{"I_zz": 1.0, "I_xx": -1.0, "I_yy": -1.0}.get(name, 0.0) for name in limits.names])
    std = float(np.sqrt(signs @ limits.random @ signs))
    if excess <= TWO_SIDED_95 * std or excess <= _ROUNDING * most:
        return
    own = limits.stds["I_zz"]
    yield warn(
        "impossible_physics",
        "I_zz",
        f"I_zz = {with_error(values['I_zz'], own)} kg m^2 exceeds I_xx + I_yy = {most:.3g} kg m^2, which no rigid body "
        "can have: side forces of the rotors do not explain the damping of yaw, so the body has drag, and c_H, c_P and "
        "J_r are too large as well. Swing the vehicle and give --fix I_zz=VALUE.",
        kg_m2=values["I_zz"],
        sum_of_others_kg_m2=most,
    )


_ROUNDING = 0.02
"""Excess over the sum of the other two that errors of levers and masses make."""
