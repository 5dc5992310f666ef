r"""A model of hover at further speeds, by the physics of a flight in place of further sweeps.

A model that was identified at the speed :math:`V_a`, and a result of ``physical.flight`` of the same vehicle, give the
model at another speed,

.. math::

    \theta(V) = \theta(V_a) + \varphi(V) - \varphi(V_a), \qquad
    \delta(V) = \delta(V_a) \, \frac{T'(V)}{T'(V_a)}

with the derivatives of motion :math:`\varphi` that follow from thrust, inflow and drag
(:mod:`rotorid.models.flight_derivatives`), and control derivatives in proportion to the slope of thrust by rotor
speed; that of yaw, where torque goes with the square, in proportion to rotor speed. What the physics leaves out, such
as drag of the body, stays what it was at :math:`V_a`. Errors add up: those of the model, and those of the difference.

Trim attitude and speeds are those of level flight in still air. Commands at trim are those at :math:`V_a` and what the
control derivatives need for the change of the rotors. Speeds end where the flights of the result did.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.errors import ModelError, UsageError
from rotorid.models.flight import Airframe, inflow_thrust, rotor_air, rotor_thrusts
from rotorid.models.flight_derivatives import FlightDerivatives, FlightTrim, flight_derivatives, flight_trim
from rotorid.results.model import IdentifiedModel, bounds_of, parameter_estimates
from rotorid.results.summary import airframe_of
from rotorid.typing import FloatArray

SPACING_M_S = 2.0
"""Largest distance of the speeds: between them derivatives are as good as straight."""

_STILL = frozenset({"T_motor", "J_r", "x_imu", "y_imu", "z_imu"})
"""Numbers of a flight that no derivative of motion depends on."""
_BY_SLOPE = ("Z_thrust", "M_pitch", "L_roll")
_BY_SPEED = ("N_yaw",)
_STEP = 1e-4


def at_further_speeds(anchor: IdentifiedModel, flight: IdentifiedModel) -> list[IdentifiedModel]:
    """A model of hover at the speeds that a result of ``physical.flight`` covers beyond its own.

    Parameters
    ----------
    anchor
        ``hover.longitudinal`` or ``hover.lateral``, in hover or at one speed.
    flight
        A result of ``physical.flight`` of the same vehicle.

    Returns
    -------
    list of IdentifiedModel
        One for each further speed, rising, without the anchor. Their errors are no random ones: all come from the same
        two results.

    Raises
    ------
    UsageError
        The flights of the result are no faster than the model, or it says too little of the vehicle.
    """
    values, airframe = _physics(flight)
    assert flight.flight is not None
    constants = anchor.structure.constants
    own_m_s = math.hypot(constants.get("U0", 0.0), constants.get("W0", 0.0))
    speeds = _speeds(values, airframe, own_m_s, flight.flight.limits.edge_m_s[1])
    if not speeds:
        raise UsageError(
            f"physical.flight has flown at up to {flight.flight.limits.edge_m_s[1]:.1f} m/s, and {anchor.name} is of "
            f"{own_m_s:.1f} m/s",
            needed=f"a flight that is {SPACING_M_S:g} m/s faster",
        )
    known = [name for name in flight.bounds.names if name in values and name not in _STILL]
    spread = bounds_of(flight.bounds, known).covariance
    found = flight_derivatives(values, airframe, (own_m_s, *speeds), free=known, covariance=spread)
    return [_moved(anchor, found, place, values, airframe) for place in range(1, len(found.trims))]


def _physics(flight: IdentifiedModel) -> tuple[dict[str, float], Airframe]:
    values = {name: one.value for name, one in flight.parameters.items() if one.status != "dropped"}
    if flight.flight is None or flight.motors is None:
        raise UsageError(f"{flight.name} contains no air", needed="a result of physical.flight")
    return values, airframe_of(flight.motors, flight.flight, values.get("m", 1.0))


def _speeds(values: Mapping[str, float], airframe: Airframe, own_m_s: float, fastest_m_s: float) -> list[float]:
    """Evenly spaced beyond the model's own, up to the fastest that was flown and at which the rotors carry it."""
    count = math.ceil((fastest_m_s - own_m_s) / SPACING_M_S)
    if fastest_m_s - own_m_s < 0.5 * SPACING_M_S:
        return []
    speeds = []
    for speed in np.linspace(own_m_s, fastest_m_s, count + 1)[1:].tolist():
        try:
            flight_trim(values, airframe, speed)
        except ModelError:
            break
        speeds.append(speed)
    return speeds


def _moved(
    anchor: IdentifiedModel,
    found: FlightDerivatives,
    place: int,
    values: Mapping[str, float],
    airframe: Airframe,
) -> IdentifiedModel:
    """The anchor at one of the speeds."""
    structure, parameters = anchor.structure, anchor.structure.parameters
    first, trim = found.trims[0], found.trims[place]
    slopes = [_thrust_slope(values, airframe, one) for one in (first, trim)]
    ratio = {name: float(slopes[1].mean() / slopes[0].mean()) for name in _BY_SLOPE}
    ratio |= {name: float(trim.rotors.mean() / first.rotors.mean()) for name in _BY_SPEED}
    moved = [name for name in parameters.names if name in found.names and parameters[name].status != "fixed"]
    (here, _), (before, _) = found.at(place, moved), found.at(0, moved)
    change = dict(zip(moved, (here - before).tolist(), strict=True))
    for name in moved:
        # Zero in hover, as M_w is, it need not be at speed.
        if parameters[name].status == "dropped":
            parameters = parameters.free_again(name).with_values({name: 0.0})
    new = {
        name: min(max(parameters[name].value * ratio.get(name, 1.0) + change.get(name, 0.0), one.lower), one.upper)
        for name in parameters.free
        for one in (parameters[name],)
    }
    parameters = parameters.with_values(new)
    bounds = anchor.bounds
    rows = {name: k for k, name in enumerate(parameters.free)}
    total = np.zeros((len(rows), len(rows)))
    kept = [name for name in bounds.names if name in rows]
    scale = np.array([ratio.get(name, 1.0) for name in kept])
    among = np.ix_([rows[name] for name in kept], [rows[name] for name in kept])
    total[among] += bounds_of(bounds, kept).covariance * np.outer(scale, scale)
    own = np.ix_([rows[name] for name in moved], [rows[name] for name in moved])
    total[own] += _of_difference(found, place, moved)
    wide = np.sqrt(total.diagonal())
    bounds = replace(
        bounds,
        names=parameters.free,
        cramer_rao=wide,
        insensitivity=wide,
        covariance=total,
        random=np.zeros_like(total),
        model_error=None,
        assumed=None,
        implied={},
    )
    u, _, w = trim.velocity_m_s.tolist()
    level = {"U0": u, "W0": w, "theta0": trim.theta_rad}
    structure = replace(
        structure.with_constants({name: value for name, value in level.items() if name in structure.constants}),
        parameters=parameters,
    )
    commands = _commands(anchor, airframe, (first, trim), slopes, values)
    covered = {
        name: replace(one, mean=one.mean + commands.get(name, 0.0)) if one.mean is not None else one
        for name, one in anchor.covered.items()
    }
    return replace(
        anchor,
        structure=structure,
        bounds=bounds,
        parameters=parameter_estimates(structure.parameters, bounds),
        covered=covered,
    )


def _of_difference(found: FlightDerivatives, place: int, names: list[str]) -> FloatArray:
    """Covariance of derivatives at one speed less those of the first, shape ``(k, k)``."""
    rows = np.array([found.names.index(name) for name in names], dtype=np.int64)
    late = place * len(found.names) + rows
    both = found.covariance
    cross = both[np.ix_(late, rows)]
    return np.asarray(both[np.ix_(late, late)] + both[np.ix_(rows, rows)] - cross - cross.T)


def _thrust_slope(values: Mapping[str, float], airframe: Airframe, trim: FlightTrim) -> FloatArray:
    """Change of the thrust of each rotor with its speed, shape ``(rotors,)``."""
    step = _STEP * trim.rotors[:, None]

    def thrusts(speeds: FloatArray) -> FloatArray:
        air = rotor_air(airframe, trim.velocity_m_s[:, None], np.zeros((3, 1)), inflow_thrust(values, airframe, speeds))
        return rotor_thrusts(values, airframe, speeds, air)

    ends = [thrusts(trim.rotors[:, None] + sign * step) for sign in (1.0, -1.0)]
    return np.asarray((ends[0] - ends[1])[:, 0] / (2.0 * step[:, 0]))


def _commands(
    anchor: IdentifiedModel,
    airframe: Airframe,
    trims: tuple[FlightTrim, FlightTrim],
    slopes: list[FloatArray],
    values: Mapping[str, float],
) -> dict[str, float]:
    """Change of the mean commands that the rotors of the two trims need."""
    derivatives = anchor.structure.parameters.values
    x, y = airframe.positions[:, 0], airframe.positions[:, 1]
    thrust = slopes[0] * (trims[1].rotors - trims[0].rotors)
    needed = {
        "thrust_command": ("Z_thrust", -float(thrust.sum()) / airframe.mass_kg),
        "pitch_command": ("M_pitch", float(x @ thrust) / values.get("I_yy", math.inf)),
        "roll_command": ("L_roll", -float(y @ thrust) / values.get("I_xx", math.inf)),
    }
    return {name: change / derivatives[by] for name, (by, change) in needed.items() if derivatives.get(by, 0.0) != 0.0}
