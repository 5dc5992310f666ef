"""Lean against a steady wind: its drag from the attitude, and accelerometers without it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.unit.identifying.small_logs import DURATION_S, log, sweeps, topic

from rotorid.flights.flights import Flight
from rotorid.flights.segments import cut
from rotorid.flights.steady_wind import body_drag, fixed_to_earth, in_wind_of, with_steady_drag
from rotorid.models.library import library_model
from rotorid.signal.airborne import airborne_by_thrust
from rotorid.typing import Axis
from rotorid.units import STANDARD_GRAVITY_M_S2 as G

RATE_HZ = 50.0
TIME_S = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
SWAY = np.sin(2.0 * np.pi * TIME_S)
"""Whole periods: a mean of zero."""
LEAN = 0.15
DRAG = G * math.tan(LEAN)


def leaning(*, axis: Axis = "pitch", **channels: object) -> tuple[Flight, ...]:
    given = {"pitch_command": 0.1 * SWAY, "theta": LEAN, "phi": 0.0, "psi": 0.3 * SWAY, "u": 0.0, "v": 0.0, "w": 0.0}
    return sweeps(log(topic("log", RATE_HZ, {**given, **channels})), [axis]).fitted  # type: ignore[arg-type]


def at_heading(psi: float, axis: Axis = "pitch") -> tuple[Flight, ...]:
    """Leaning against the same wind at some heading."""
    seen = Rotation.from_euler("Z", psi).inv().apply([DRAG, 0.0, G]) / math.hypot(DRAG, G)
    # Thrust along gravity and drag together, seen from the body.
    phi = math.asin(-seen[1])
    return leaning(axis=axis, psi=psi, phi=phi, theta=math.atan2(seen[0], seen[2]))


def test_the_drag_is_that_of_the_lean_fixed_to_the_earth() -> None:
    (flight,) = with_steady_drag(leaning(psi=np.pi / 2.0))
    assert flight.steady_drag is not None
    assert (flight.steady_drag.north, flight.steady_drag.east) == pytest.approx((0.0, DRAG), abs=1e-9)
    assert body_drag([flight]) == pytest.approx((G * math.sin(LEAN), 0.0), abs=1e-9)


def test_a_short_maneuver_leans_as_it_does_in_the_air() -> None:
    """A doublet just after take-off, from ground that slopes the other way."""
    flying = (TIME_S >= 3.0) & (TIME_S < 9.0)
    channels = {"thrust_command": np.where(flying, 0.5, 0.0), "theta": np.where(flying, LEAN, -LEAN)}
    (flight,) = leaning(psi=0.0, **channels)
    short = replace(flight, maneuver=replace(flight.maneuver, start_s=4.0, stop_s=6.0))
    assert airborne_by_thrust(short.record) is not None
    (found,) = with_steady_drag([short])
    assert found.steady_drag is not None
    assert found.steady_drag.north == pytest.approx(DRAG, rel=0.05)


def test_what_turns_with_the_vehicle_leaves_the_accelerometers() -> None:
    heading = 0.3 * SWAY
    # Drag to the north, seen by a vehicle that turns to and fro, and nothing else.
    seen = {"ax": DRAG * np.cos(LEAN) * np.cos(heading), "ay": -DRAG * np.sin(heading)}
    flights = with_steady_drag(leaning(**seen))
    # A mean heading that is turned to and fro makes a mean direction a little shorter.
    segments, _ = cut(flights, channels=("pitch_command", "ax", "ay", "theta"))
    history = segments[0].history
    assert history.names == ("pitch_command", "ax", "ay", "theta")
    assert np.ptp(history["ay"]) < 0.05 * np.ptp(seen["ay"])
    assert np.abs(history["theta"]).max() < 0.01
    (plain,), _ = cut(leaning(**seen), channels=("pitch_command", "ax", "ay", "theta"))
    assert np.ptp(plain.history["ay"]) == pytest.approx(np.ptp(seen["ay"]), rel=1e-6)


def test_a_model_comes_to_the_wind_of_its_flights_and_back() -> None:
    calm = library_model("hover.longitudinal")
    windy, flights = in_wind_of(calm, leaning(), heave_share=1.0)
    assert windy.constants["D_x"] == pytest.approx(G * math.sin(LEAN), rel=0.05)
    assert windy.constants["D_share"] == 1.0
    assert all(flight.steady_drag is not None and flight.steady_drag.heave_share == 1.0 for flight in flights)
    back, level = in_wind_of(windy, leaning(theta=0.0))
    assert (back.constants["D_x"], back.constants["g"]) == (0.0, pytest.approx(G, rel=1e-12))
    assert all(flight.steady_drag is None for flight in level)


@pytest.mark.parametrize("channels", [{"theta": 0.04}, {"u": 2.0}], ids=["level", "flying"])
def test_calm_hover_and_flight_stay_as_they_are(channels: dict[str, float]) -> None:
    calm, flights = library_model("hover.longitudinal"), leaning(**channels)
    structure, same = in_wind_of(calm, flights)
    assert structure is calm
    assert same == tuple(flights)


def test_headings_tell_a_wind_from_sensors_askew() -> None:
    assert fixed_to_earth([*leaning(), *leaning()]) is None
    assert fixed_to_earth([*at_heading(0.0), *at_heading(1.0)]) is True
    assert fixed_to_earth([*leaning(psi=0.0), *leaning(psi=1.0)]) is False
    assert fixed_to_earth(leaning()) is None


def test_each_angle_meets_the_drag_of_the_maneuvers_that_move_it() -> None:
    structure, _ = in_wind_of(library_model("hover.full"), [*at_heading(0.0), *at_heading(1.2, axis="yaw")])
    constants = structure.constants
    across = G * math.sin(LEAN)
    assert (constants["D_x"], constants["D_y"]) == pytest.approx((across, 0.0), abs=0.02)
    assert (constants["D_x_yaw"], constants["D_y_yaw"]) == pytest.approx(
        (across * math.cos(1.2), -across * math.sin(1.2)), abs=0.02
    )
    # The mean of both drags would be shorter than either.
    assert constants["lean_0"] == pytest.approx(LEAN, rel=0.01)
    assert constants["g"] == pytest.approx(G / math.cos(LEAN), rel=1e-3)
