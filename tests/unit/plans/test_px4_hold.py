"""How the script for PX4 holds place and height: against the equation of its loops, and on a point that drifts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.report.px4_link import HEADING, Drifting, Time, attitude_plan, flown, heave_plan, loaded, turned

from rotorid.data.flight_plan import FlightPlan
from rotorid.simulation.autopilot import Guidance
from rotorid.simulation.multirotor_flight import HOLD_1_S, HOLD_1_S2, HOLD_PLACE_1_S, piloted
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft as library_aircraft


def drifted(folder: Path, plan: FlightPlan | None = None, **changes: Any) -> tuple[str, FloatArray]:
    """Reason of the end, and a row for each step: time, distance from the start to north, east and down."""
    module = loaded(plan or heave_plan(), folder, room_m=30.0, climb_m=5.0, tilt_rad=math.radians(25.0))
    clock = Time()
    link = Drifting(clock, **changes)
    limits = module.arguments(["--hover-thrust", "0.5"])
    reason = module.Flight(link, module.Plan(limits.plan), limits, clock, say=lambda text: None).run()
    return reason, np.array(link.trace)


HEADINGS = [0.0, 0.4, 1.7, math.pi, -2.3, -0.5 * math.pi]


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("north_east", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_a_drift_and_a_distance_ask_for_a_lean_against_them(
    heading: float, north_east: tuple[float, float], tmp_path: Path
) -> None:
    """At the first look: the integral has not begun, and the lean is that of the equation, in every heading."""
    module = loaded(attitude_plan(), tmp_path)
    for says, gain in (("velocity", HOLD_1_S), ("position", HOLD_1_S * HOLD_PLACE_1_S)):
        hold = module.Hold()
        vehicle = SimpleNamespace(attitude=(0.0, 0.0, heading), position=(0.0,) * 3, velocity=(0.0,) * 3)
        setattr(vehicle, says, (*north_east, 0.0))
        hold.follow(vehicle, 0.5, 10.0)
        roll, pitch = hold.lean
        pushed = turned((-math.tan(pitch), math.tan(roll)), heading)
        assert STANDARD_GRAVITY_M_S2 * np.array(pushed) == pytest.approx(-gain * np.array(north_east), abs=1e-9)


def test_the_lean_of_the_hold_has_a_limit(tmp_path: Path) -> None:
    module = loaded(attitude_plan(), tmp_path)
    hold = module.Hold()
    vehicle = SimpleNamespace(attitude=(0.0, 0.0, HEADING), position=(0.0,) * 3, velocity=(30.0, -40.0, 0.0))
    for second in range(20):
        hold.follow(vehicle, 0.5, float(second))
        roll, pitch = hold.lean
        assert math.hypot(math.tan(roll), math.tan(pitch)) == pytest.approx(math.tan(math.radians(10.0)))
    assert hold.wind == [0.0, 0.0]  # nothing to take back
    vehicle.velocity = (math.nan, 0.0, 0.0)
    hold.follow(vehicle, 0.5, 21.0)
    assert hold.lean == (roll, pitch)


@pytest.mark.parametrize("heading", HEADINGS)
def test_a_vehicle_that_drifts_is_brought_back(heading: float, tmp_path: Path) -> None:
    """The equation of the loop, solved: a push of 1 m/s, an attitude that follows at once, no drag."""
    reason, trace = drifted(tmp_path, heading=heading, velocity=(0.6, -0.8, 0.0), lag_s=0.01, drag_1_s=0.0)
    assert reason == "plan complete"
    time_s, along = trace[:, 0] - trace[0, 0], trace[:, 1] * 0.6 - trace[:, 2] * 0.8
    across = trace[:, 1] * 0.8 + trace[:, 2] * 0.6
    # s^3 + speed s^2 + (speed place + integral) s + place integral = 0, from a speed of 1.
    roots = np.roots([1.0, HOLD_1_S, HOLD_1_S * HOLD_PLACE_1_S + HOLD_1_S2, HOLD_PLACE_1_S * HOLD_1_S2])
    weights = np.linalg.solve(np.vander(roots, 3, increasing=True).T, [0.0, 1.0, -HOLD_1_S])
    solved = (np.exp(np.outer(time_s, roots)) @ weights).real
    # Lag and messages come 40 ms late at most, as if the speed had been 4 % larger; steps of 10 ms are 1 %.
    assert along == pytest.approx(solved, abs=0.05 * solved.max())
    assert np.abs(across).max() < 0.01
    assert np.abs(trace[time_s > 35.0, 1:3]).max() < 0.02


def test_it_begins_with_the_lean_against_the_wind(tmp_path: Path) -> None:
    for heading in HEADINGS[1:3]:
        _, trace = drifted(tmp_path, heading=heading, wind=(3.0, -2.0))
        assert np.abs(trace[:, 1:3]).max() < 0.1
    # Without it the integral has to find the wind, and does.
    reason, trace = drifted(tmp_path, wind=(3.0, -2.0), trimmed=False)
    assert reason == "plan complete"
    assert 0.5 < np.hypot(trace[:, 1], trace[:, 2]).max() < 4.0
    assert np.hypot(*trace[-1, 1:3]) < 0.05


def test_a_wrong_thrust_of_hover_is_found(tmp_path: Path) -> None:
    reason, trace = drifted(tmp_path, hover=0.53)
    assert reason == "plan complete"
    rest = trace[trace[:, 0] < 45.0]
    assert 0.2 < np.abs(rest[:, 3]).max() < 2.0
    assert abs(rest[-1, 3]) < 0.02


def test_gusts_do_not_carry_it_out_of_the_room(tmp_path: Path) -> None:
    plan = attitude_plan()
    reason, trace = drifted(tmp_path, plan, gusts_m_s=0.3)
    assert reason == "plan complete"
    held = np.hypot(trace[:, 1], trace[:, 2]).max()
    flown_again = loaded(plan, tmp_path)
    flown_again.SPEED_GAIN = flown_again.INTEGRAL_GAIN = flown_again.PLACE_GAIN = 0.0  # type: ignore[attr-defined]
    clock = Time()
    link = Drifting(clock, gusts_m_s=0.3)
    limits = flown_again.arguments(["--hover-thrust", "0.5", "--room-m", "500"])
    flown_again.Flight(link, flown_again.Plan(limits.plan), limits, clock, say=lambda text: None).run()
    free = np.hypot(*np.array(link.trace)[:, 1:3].T).max()
    assert held < 0.5 * free


def test_the_gains_are_those_of_the_flights_that_were_simulated(tmp_path: Path) -> None:
    module = loaded(attitude_plan(), tmp_path)
    bare = library_aircraft("x500")
    guidance = piloted(replace(bare, autopilot=replace(bare.autopilot, guidance=Guidance()))).autopilot.guidance
    assert guidance.velocity_p_1_s == module.SPEED_GAIN
    assert guidance.velocity_i_1_s2 == module.INTEGRAL_GAIN
    assert module.PLACE_GAIN == guidance.position_p_1_s == guidance.height_p_1_s
    assert guidance.climb_i / guidance.climb_p == pytest.approx(module.CLIMB_INTEGRAL_GAIN / module.SPEED_GAIN)
    hover = float(bare.autopilot.hover_commands(bare.vehicle)[3])
    assert guidance.climb_p == pytest.approx(hover / module.GRAVITY * module.SPEED_GAIN)


def test_height_is_held_by_a_slow_and_narrow_loop(tmp_path: Path) -> None:
    """One meter too low and half a meter a second down, against the equation of the loop."""
    _, link, module = flown(heave_plan(), tmp_path, (6.0, {"position": (1.0, 2.0, -19.0), "velocity": (0.0, 0.0, 0.5)}))
    times_s, values = link.of("set_attitude_target_send")
    chosen = (times_s > 6.1) & (times_s < 8.0)
    off = 0.5 + HOLD_PLACE_1_S * 1.0
    # The change comes with the next message, 20 ms later at most.
    integral = HOLD_PLACE_1_S * off * (times_s[chosen] - 6.0)
    thrust = np.array([one[8] for one in values])[chosen]
    hover_s2_m = 0.5 / STANDARD_GRAVITY_M_S2
    assert np.abs(thrust - 0.5 - hover_s2_m * HOLD_1_S * (off + integral)).max() <= hover_s2_m * 0.3 * off * 0.03
    _, link, module = flown(heave_plan(), tmp_path, (6.0, {"velocity": (0.0, 0.0, 50.0)}))
    thrust = np.array(
        [one[8] for time_s, name, one in link.sent if name.startswith("set_att") and 1006.1 < time_s < 1040.0]
    )
    assert thrust.max() == pytest.approx(0.5 + module.THRUST_REACH)
