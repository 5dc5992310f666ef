r"""The lean of a vehicle against a steady wind, and accelerometers without the drag that it balances.

With the mean direction :math:`e` of the thrust over a maneuver, downward along the rotors and seen from the earth, the
drag of a steady wind over mass is

.. math:: D = g \, \frac{(e_N, e_E, 0)}{e_D}.

It is fixed to the earth, so what accelerometers see of it changes as the vehicle turns. Without it,
:math:`a^* = a - R^T D` (along the rotors only the share of it that acts there), and with angles about the direction of
gravity and drag together, the vehicle hovers level: see :mod:`rotorid.models.steady_wind` for the model that is left.
The mean is over the whole maneuver: smoothed over seconds, it would take away the low end of a sweep.

A lean that sensors or a load make turns with the vehicle, that against a wind does not: where maneuvers are flown at
several headings, the frame in which the mean directions agree says which it is.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.record import TimeHistory
from rotorid.flights.coverage import HOVER_M_S
from rotorid.flights.flights import Flight, SteadyDrag
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.models.steady_wind import HEAVE_SHARE, in_steady_wind, leans
from rotorid.models.structure import LinearStructure
from rotorid.signal.airborne import airborne_by_thrust, flight_around
from rotorid.signal.kinematics import ACCELERATIONS, VELOCITIES, to_body
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

LEANING = (*ACCELERATIONS, "phi", "theta")
"""Channels that count from the trim of a leaning vehicle."""

LEAST_LEAN_RAD = 0.05
"""A smaller lean may be that of the sensors or of the load, and leaves a twentieth of gravity along the body."""

_TILT, _TURN = ("roll", "pitch"), ("yaw",)
"""Axes that tilt the thrust, and the one that turns what the wind meets."""

_APART = 2.0
"""Ratio of the spread of directions in the two frames from which one of them is wrong."""

_LEAST_S = 10.0
"""Time over which attitude is averaged at least: a doublet leans by more than the wind makes it."""


def in_wind_of(
    structure: LinearStructure, flights: Sequence[Flight], *, heave_share: float | None = None
) -> tuple[LinearStructure, tuple[Flight, ...]]:
    """A model at the trim of some flights in hover, and the flights as they count from it.

    Parameters
    ----------
    structure
        A model in calm air, or at the trim of other flights. One of forward flight, or without gravity, stays.
    flights
        Maneuvers, in one wind.
    heave_share
        Share of the drag that acts along the rotors too; by default that of the structure.

    Returns
    -------
    LinearStructure
        In calm air, or where attitude is not logged, the one of calm air.
    tuple
        Flights that know the drag of the steady wind.
    """
    moving = any(structure.constants.get(name) for name in ("U0", "V0", "W0", "theta0", "phi0"))
    if moving or not leans(structure) or any(abs(mean_of(flights, name)) >= HOVER_M_S for name in VELOCITIES):
        return structure, tuple(flights)
    share = structure.constants.get(HEAVE_SHARE, 0.0) if heave_share is None else heave_share
    blown = with_steady_drag(flights, share)
    leaning = [flight for flight in blown if flight.steady_drag is not None]
    found = in_steady_wind(
        structure,
        *body_drag(_flown_on(leaning, _TILT)),
        turning=body_drag(_flown_on(leaning, _TURN)),
        lean_rad=_lean(_flown_on(leaning, _TILT)),
        heave_share=share,
    )
    return found, blown


def mean_of(flights: Sequence[Flight], channel: str) -> float:
    """Mean of a channel over all samples of some flights; zero where none holds it."""
    if channel in VELOCITIES:
        parts = [flight.body_velocity(channel) for flight in flights]
    else:
        parts = [samples.values for flight in flights for samples in islice(flight.samples(channel), 1)]
    together = np.concatenate(parts) if parts else np.zeros(0)
    return float(together.mean()) if together.size else 0.0


def with_steady_drag(flights: Sequence[Flight], heave_share: float = 0.0) -> tuple[Flight, ...]:
    """Flights that know the drag of the steady wind, each by its own attitude; unchanged where none of them leans.

    Parameters
    ----------
    flights
        Maneuvers in hover.
    heave_share
        Share of the drag that acts along the rotors too.
    """
    directions = [_thrust_direction(flight) for flight in flights]
    known = [direction for direction in directions if direction is not None]
    if not known or max(float(np.arccos(min(direction[2], 1.0))) for direction in known) < LEAST_LEAN_RAD:
        return tuple(flights)
    found = []
    for flight, direction in zip(flights, directions, strict=True):
        if direction is not None:
            north, east = (STANDARD_GRAVITY_M_S2 * direction[:2] / direction[2]).tolist()
            flight = replace(flight, steady_drag=SteadyDrag(north, east, heave_share))
        found.append(flight)
    return tuple(found)


def body_drag(flights: Sequence[Flight]) -> tuple[float, float]:
    """Steady drag over mass along the body, forward and right, mean over all samples of some flights, m/s²."""
    parts = [_in_body(flight) for flight in flights if flight.steady_drag is not None]
    if not parts:
        return 0.0, 0.0
    forward, right = np.hstack(parts)[:2].mean(axis=1).tolist()
    return forward, right


def _flown_on(flights: Sequence[Flight], axes: Collection[str]) -> Sequence[Flight]:
    """The flights on some axes; all where none is."""
    return [flight for flight in flights if flight.maneuver.axis in axes] or flights


def fixed_to_earth(flights: Sequence[Flight]) -> bool | None:
    """Whether the lean of some flights is that of a wind, and not of sensors or a load that turn with the vehicle.

    Parameters
    ----------
    flights
        Maneuvers in hover.

    Returns
    -------
    bool or None
        ``None`` where the mean direction of the thrust differs little, or as much over the earth as along the body.
    """
    apart = []
    for frame in (_thrust_direction, _gravity_direction):
        known = [direction for flight in flights if (direction := frame(flight)) is not None]
        if len(known) < 2:
            return None
        apart.append(float(np.linalg.norm(np.std(known, axis=0))))
    over_earth, along_body = apart
    if max(apart) < LEAST_LEAN_RAD or max(apart) < _APART * min(apart):
        return None
    return over_earth < along_body


def without_steady_drag(history: TimeHistory, drag: SteadyDrag) -> TimeHistory:
    """A history with accelerometers less the steady drag, and angles about the direction of the thrust.

    Parameters
    ----------
    history
        With ``phi theta``; without ``psi`` the heading counts as constant.
    drag
        Of the flight; of its part along the rotors the share that acts there.
    """
    steady = np.array([drag.north, drag.east, 0.0])
    forces = _turned(history, steady) * np.array([[1.0], [1.0], [drag.heave_share]])
    down = _turned(history, steady + np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2]))
    level = {
        **{name: history[name] - row for name, row in zip(ACCELERATIONS, forces, strict=True) if name in history.names},
        "theta": np.arcsin(np.clip(-down[0] / np.linalg.norm(down, axis=0), -1.0, 1.0)),
        "phi": np.arctan2(down[1], down[2]),
    }
    rows = [level.get(name, history[name]) for name in history.names]
    return replace(history, values=np.stack(rows), processing=(*history.processing, "drag of the steady wind removed"))


def _turned(history: TimeHistory, vector: FloatArray) -> FloatArray:
    """A constant vector over the earth, in body axes over time, shape ``(3, samples)``."""
    count = history.values.shape[1]
    if "psi" not in history.names:
        psi = replace(history.channels[0], name="psi", unit="rad", source="")
        history = replace(
            history, values=np.vstack([history.values, np.zeros(count)]), channels=(*history.channels, psi)
        )
    return to_body(history, np.repeat(vector[:, None], count, axis=1))


def _thrust_direction(flight: Flight) -> FloatArray | None:
    """Mean direction of the axis of the rotors over the earth, downward; ``None`` without attitude."""
    attitude = _attitude(flight)
    if attitude is None:
        return None
    direction = body_to_earth(attitude, _constant((0.0, 0.0, 1.0), attitude)).mean(axis=1)
    return np.asarray(direction / np.linalg.norm(direction)) if direction[2] > 0.0 else None


def _gravity_direction(flight: Flight) -> FloatArray | None:
    """Mean direction of gravity in body axes; ``None`` without attitude."""
    attitude = _attitude(flight)
    if attitude is None:
        return None
    down = earth_to_body(attitude, _constant((0.0, 0.0, 1.0), attitude)).mean(axis=1)
    return np.asarray(down / np.linalg.norm(down))


def _constant(vector: tuple[float, float, float], attitude: FloatArray) -> FloatArray:
    """A vector at every sample of an attitude, shape ``(3, n)``."""
    return np.repeat(np.array(vector)[:, None], attitude.shape[1], axis=1)


def _lean(flights: Sequence[Flight]) -> float:
    """Mean lean against the steady drag of some flights, radians."""
    drags = [math.hypot(*flight.steady_drag[:2]) for flight in flights if flight.steady_drag is not None]
    return math.atan(float(np.mean(drags)) / STANDARD_GRAVITY_M_S2) if drags else 0.0


def _in_body(flight: Flight) -> FloatArray:
    """Steady drag of a flight in its body axes, shape ``(3, samples)``."""
    attitude = _attitude(flight)
    assert attitude is not None
    assert flight.steady_drag is not None
    north, east, _ = flight.steady_drag
    return earth_to_body(attitude, _constant((north, east, 0.0), attitude))


def _attitude(flight: Flight) -> FloatArray | None:
    """Roll, pitch and heading around a maneuver in the air, shape ``(3, n)``; a heading that is not logged is zero."""
    rest_s = max(0.5 * (_LEAST_S - flight.maneuver.duration_s), 0.0)
    start_s, stop_s = flight.maneuver.start_s, flight.maneuver.stop_s
    if rest_s > 0.0:
        # On the ground a vehicle leans as the ground does.
        taken_off_s, landed_s = flight_around(airborne_by_thrust(flight.record), flight.maneuver)
        start_s = min(start_s, max(start_s - rest_s, taken_off_s))
        stop_s = max(stop_s, min(stop_s + rest_s, landed_s))
    flight = replace(flight, maneuver=replace(flight.maneuver, start_s=start_s, stop_s=stop_s))
    parts = {name: next(flight.samples(name), None) for name in ATTITUDE}
    phi, theta, psi = (parts[name] for name in ("phi", "theta", "psi"))
    if phi is None or theta is None or min(phi.time_s.size, theta.time_s.size) < 2:
        return None
    time_s = phi.time_s
    rows = [phi.values, np.interp(time_s, theta.time_s, theta.values)]
    # A heading that jumps by a turn does so between two samples.
    known = psi is not None and psi.time_s.size > 1
    rows.append(np.interp(time_s, psi.time_s, np.unwrap(psi.values)) if known and psi is not None else 0.0 * time_s)
    return np.stack(rows)
