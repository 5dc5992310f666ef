r"""A model of hover at further speeds, by the physics of a flight in place of further sweeps.

A model that was identified at the speed :math:`V_a`, and a result of ``physical.flight`` of the same vehicle, give the
model at another speed,

.. math::

    \theta(V) = \theta(V_a) + \varphi(V) - \varphi(V_a), \qquad
    \delta(V) = \delta(V_a) + \left( \frac{\partial \dot x}{\partial \Omega}(V)
        - \frac{\partial \dot x}{\partial \Omega}(V_a) \right) \frac{d \Omega}{d u}

with the derivatives of motion :math:`\varphi` that follow from thrust, inflow and drag
(:mod:`rotorid.models.flight_derivatives`). A command changes the rotors by their levers, by their spin or all alike, as
much as the control derivative at :math:`V_a` says, and its other derivatives follow from rotors that turn unlike at
speed. What the physics leaves out, such as drag of the body, stays what it was at :math:`V_a`.

Both results have the derivatives at :math:`V_a`, those of damping aside. Where they agree within three deviations, both
count by their covariances (the estimate of least variance), there and, with how they err together, at every other
speed. Where they do not, the model keeps its own.

Trim attitude and speeds are those of level flight in still air. Commands at trim are those at :math:`V_a` and what the
control derivatives need for the change of the rotors. Speeds end where the flights of the result did.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_error
from rotorid.errors import ModelError, UsageError
from rotorid.flying.vehicle_air import implied_derivatives
from rotorid.models.flight import Airframe, flight_loads
from rotorid.models.flight_derivatives import (
    FORCES,
    MOMENTS,
    FlightDerivatives,
    FlightTrim,
    flight_trim,
)
from rotorid.results.model import IdentifiedModel, bounds_of, parameter_estimates
from rotorid.results.summary import airframe_of
from rotorid.typing import FloatArray, IntArray

SPACING_M_S = 2.0
"""Largest distance of the speeds: between them derivatives are as good as straight."""

_OWN_DERIVATIVES = {"roll": "L_roll", "pitch": "M_pitch", "yaw": "N_yaw", "thrust": "Z_thrust"}
"""Command to the derivative by which the change of the rotors that it asks for is known."""
_STEP = 1e-4


_BY_SPEED = frozenset(f"{row}_{speed}" for row in "XYZLMN" for speed in "uvw")
_ACROSS = frozenset(f"{row}_{rate}" for row in "XYZLMN" for rate in "pqr") - {"L_p", "M_q", "N_r"}
"""Derivatives by rates without the damping of an axis, to which the body and the wake add what no flight shows."""
_CONTRADICTED_STDS = 3.0


class OverSpeed(NamedTuple):
    """A model of hover at its own and at further speeds, and what there is to say."""

    models: tuple[IdentifiedModel, ...]
    findings: tuple[Finding, ...]


def over_speed(anchor: IdentifiedModel, flight: IdentifiedModel) -> OverSpeed:
    """A model of hover with the speed derivatives of a flight, at its own speed and at those that the flight covers.

    Parameters
    ----------
    anchor
        ``hover.longitudinal`` or ``hover.lateral``, in hover or at one speed.
    flight
        A result of ``physical.flight`` of the same vehicle.

    Returns
    -------
    OverSpeed
        Models by rising speed, the anchor first. Errors of the further ones are no random ones: all come from the same
        two results.

    Raises
    ------
    UsageError
        The flights of the result are no faster than the model, or it is no result of ``physical.flight``.
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
    found = implied_derivatives(flight, (own_m_s, *speeds))
    # Without flapping or height of the rotors, moments by speed lack the largest part.
    turned = not values.keys().isdisjoint(("m_f", "z_cg"))
    shown = _ACROSS | {name for name in _BY_SPEED if turned or name[0] in FORCES}
    shared, findings = _shared(anchor, found, [name for name in anchor.structure.parameters.free if name in shown])
    places = range(len(found.trims))
    return OverSpeed(tuple(_moved(anchor, found, place, shared, values, airframe) for place in places), findings)


def _shared(
    anchor: IdentifiedModel, found: FlightDerivatives, names: list[str]
) -> tuple[list[str], tuple[Finding, ...]]:
    """Derivatives that both results have, without those of which they contradict each other."""
    shared, findings = [], []
    for name in names:
        if name not in found.names:
            continue
        here = anchor.structure.parameters[name].value
        (there,), spread = found.at(0, [name])
        own_std = float(np.sqrt(bounds_of(anchor.bounds, [name]).covariance[0, 0]))
        std = float(np.sqrt(spread[0, 0]))
        if not abs(here - there) > _CONTRADICTED_STDS * math.hypot(own_std, std):
            shared.append(name)
            continue
        findings.append(
            warn(
                "derivatives_differ",
                name,
                f"{anchor.name} has {name} = {with_error(here, own_std)}, and physical.flight "
                f"{with_error(float(there), std)}. {anchor.name} keeps its own. If the accelerometer is "
                "away from the center of gravity, identify again with --constant z_imu=VALUE.",
                value=here,
                std=own_std,
                of_flight=float(there),
                std_of_flight=std,
            )
        )
    return shared, tuple(findings)


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
    shared: list[str],
    values: Mapping[str, float],
    airframe: Airframe,
) -> IdentifiedModel:
    """The anchor at one of the speeds, its own the first."""
    structure, parameters = anchor.structure, anchor.structure.parameters
    first, trim = found.trims[0], found.trims[place]
    slopes = [_rotor_slopes(values, airframe, one) for one in (first, trim)]
    control = _control(slopes, airframe) if place > 0 else {}
    moved = [name for name in parameters.names if name in found.names and parameters[name].status != "fixed"] * (
        place > 0
    )
    for name in (*moved, *(name for own in control.values() for name in own if name in parameters.names)):
        # Zero in hover, as M_w and M_thrust are, it need not be at speed.
        if parameters[name].status == "dropped":
            parameters = parameters.free_again(name).with_values({name: 0.0})
    free = parameters.free
    rows = {name: row for row, name in enumerate(free)}
    kept = [rows[name] for name in anchor.bounds.names if name in rows]
    grown = np.eye(len(free))
    for by, changes in control.items():
        for name in rows.keys() & changes.keys() if by in rows else ():
            grown[rows[name], rows[by]] += changes[name]
    own, random = (np.zeros((len(free), len(free))) for _ in range(2))
    bounds = bounds_of(anchor.bounds, [free[row] for row in kept])
    own[np.ix_(kept, kept)], random[np.ix_(kept, kept)] = bounds.covariance, bounds.random
    theta = grown @ np.array([parameters[name].value for name in free])
    total = grown @ own @ grown.T
    late, early = _part(found, place, moved), _part(found, 0, moved)
    shift = [rows[name] for name in moved]
    theta[shift] += found.values.ravel()[late] - found.values.ravel()[early]
    both = found.covariance
    cross = both[np.ix_(late, early)]
    total[np.ix_(shift, shift)] += both[np.ix_(late, late)] + both[np.ix_(early, early)] - cross - cross.T
    # What both results say of derivatives here has to be the same, as far as their errors allow.
    at, of = [rows[name] for name in shared], _part(found, 0, shared)
    apart = np.array([parameters[name].value for name in shared]) - found.values.ravel()[of]
    together = grown @ own[:, at]
    together[shift] -= both[np.ix_(late, of)] - both[np.ix_(early, of)]
    spread = own[np.ix_(at, at)] + both[np.ix_(of, of)]
    size = np.sqrt(np.where(spread.diagonal() > 0.0, spread.diagonal(), 1.0))
    gain = np.linalg.lstsq(spread / np.outer(size, size), (together / size).T, rcond=None)[0].T / size
    theta, total = theta - gain @ apart, total - gain @ together.T
    # What is known exactly is left with less than nothing by rounding.
    np.fill_diagonal(total, np.maximum(total.diagonal(), 0.0))
    left = np.eye(len(free))
    left[:, at] -= gain
    random = left @ random @ left.T if place == 0 else np.zeros_like(total)
    within = [(parameters[name].lower, parameters[name].upper) for name in free]
    parameters = parameters.with_values(
        {name: min(max(float(value), low), high) for name, value, (low, high) in zip(free, theta, within, strict=True)}
    )
    wide = np.sqrt(total.diagonal())
    bounds = replace(
        bounds,
        names=free,
        cramer_rao=wide,
        insensitivity=wide,
        covariance=total,
        random=random,
        model_error=None,
        assumed=None,
        implied={},
    )
    if place > 0:
        u, _, w = trim.velocity_m_s.tolist()
        level = {"U0": u, "W0": w, "theta0": trim.theta_rad}
        structure = structure.with_constants({name: one for name, one in level.items() if name in structure.constants})
    structure = replace(structure, parameters=parameters.with_constants(structure.constants))
    commands = _commands(anchor, slopes[0], (first, trim))
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


def _part(found: FlightDerivatives, place: int, names: list[str]) -> IntArray:
    """Where derivatives of one speed stand among all."""
    rows = [place * len(found.names) + found.names.index(name) for name in names]
    return np.array(rows, dtype=np.int64)


def _rotor_slopes(values: Mapping[str, float], airframe: Airframe, trim: FlightTrim) -> dict[str, FloatArray]:
    """Accelerations by the speed of each rotor, where the inertia is known, shape ``(rotors,)`` each."""
    count, step = airframe.rotors, _STEP * float(trim.rotors.mean())
    speeds = trim.rotors[:, None] + step * np.hstack([np.eye(count), -np.eye(count)])
    velocity = np.repeat(trim.velocity_m_s[:, None], 2 * count, axis=1)
    loads = flight_loads(values, airframe, speeds=speeds, velocity=velocity, rates=np.zeros_like(velocity))
    rows = dict(zip(FORCES, loads.force / airframe.mass_kg, strict=True))
    rows |= {
        name: loads.moment[place] / values[inertia]
        for place, (name, inertia) in enumerate(MOMENTS.items())
        if values.get(inertia, 0.0) > 0.0
    }
    return {name: (row[:count] - row[count:]) / (2.0 * step) for name, row in rows.items()}


def _control(slopes: Sequence[Mapping[str, FloatArray]], airframe: Airframe) -> dict[str, dict[str, float]]:
    """Change of the control derivatives between two trims over the first own one of each command, by its name.

    Roll and pitch change the rotors by their levers, yaw by their spin, thrust all alike.
    """
    x, y, _ = airframe.positions.T
    patterns = {"roll": -y, "pitch": x, "yaw": airframe.spins, "thrust": np.ones(airframe.rotors)}
    found = {}
    for command, pattern in patterns.items():
        by = _OWN_DERIVATIVES[command]
        main = float(slopes[0][by[0]] @ pattern) if by[0] in slopes[0] else 0.0
        if main != 0.0:
            changes = {name: float((slopes[1][name] - slopes[0][name]) @ pattern) / main for name in slopes[0]}
            found[by] = {f"{name}_{command}": change for name, change in changes.items()}
    return found


def _commands(
    anchor: IdentifiedModel, slopes: Mapping[str, FloatArray], trims: tuple[FlightTrim, FlightTrim]
) -> dict[str, float]:
    """Change of the mean commands that the rotors of the two trims need."""
    derivatives, turned = anchor.structure.parameters.values, trims[1].rotors - trims[0].rotors
    return {
        f"{command}_command": float(slopes[by[0]] @ turned) / derivatives[by]
        for command, by in _OWN_DERIVATIVES.items()
        if derivatives.get(by, 0.0) != 0.0 and by[0] in slopes
    }
