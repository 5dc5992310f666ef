"""The Lua script that flies attitudes in GUIDED mode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from tests.unit.report.lua_autopilot import Autopilot
from tests.unit.report.plan_sample import facts, multisine, step

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.ardupilot import ardupilot_files
from rotorid.simulation.multirotor_flight import HOLD_1_S, HOLD_1_S2, HOLD_PLACE_1_S
from rotorid.units import STANDARD_GRAVITY_M_S2

LOITER, STABILIZE, GUIDED = 5, 0, 4


def attitude_plan() -> FlightPlan:
    return FlightPlan(
        name="Many at once",
        inputs=(*multisine(("roll", "pitch", "yaw")), step("roll", start_s=25.0, entry="attitude_setpoint")),
    )


def attitude_script(**files: str) -> Autopilot:
    made = ardupilot_files(attitude_plan(), facts())
    table = files.get("table", made["many-at-once-attitude.csv"])
    autopilot = Autopilot(made["many-at-once-attitude.lua"], {"/APM/scripts/many-at-once-attitude.csv": table})
    autopilot.state.mode = GUIDED
    autopilot.run(3.0)
    autopilot.state.switch = 2
    return autopilot


def test_the_script_asks_for_the_attitudes_of_the_plan() -> None:
    autopilot = attitude_script()
    autopilot.run(60.0)
    plan = attitude_plan()
    targets = np.array(autopilot.targets())
    time_s = (targets[:, 0] - targets[0, 0]) / 1000.0
    assert targets.shape[0] >= 50.0 * plan.duration_s - 2
    for column, axis in enumerate(("roll", "pitch", "yaw"), start=1):
        wanted = sum(one.at(time_s) for one in plan.inputs if one.axis == axis)
        flown = targets[:, column] - (math.degrees(0.5) if axis == "yaw" else 0.0)
        # Three decimals of a degree are written.
        assert flown == pytest.approx(np.degrees(wanted), abs=0.00051)
    assert not targets[:, 4].any()
    assert autopilot.texts()[-1] == "rotorid: plan complete"
    assert autopilot.state.mode == LOITER


@pytest.mark.parametrize(
    ("change", "reason", "mode"),
    [
        ({"mode": STABILIZE}, "the pilot took over", STABILIZE),
        ({"switch": 1}, "switched off", LOITER),
        ({"position": (0.0, 13.0, -20.0)}, "out of the room", LOITER),
        ({"position": (0.0, 0.0, -15.0)}, "height", LOITER),
        ({"velocity": (math.nan, 0.0, 0.0)}, "no velocity", LOITER),
        ({"velocity": None}, "no velocity", LOITER),
    ],
)
def test_the_attitudes_end_at_once(change: dict[str, Any], reason: str, mode: int) -> None:
    autopilot = attitude_script()
    autopilot.run(10.0)
    for name, value in change.items():
        autopilot.state[name] = autopilot.lua.table(*value) if isinstance(value, tuple) else value
    before = len(autopilot.targets())
    autopilot.run(30.0)
    assert len(autopilot.targets()) == before > 0
    assert autopilot.texts()[-1] == f"rotorid: {reason}"
    assert autopilot.state.mode == mode


def turned(vector: tuple[float, float], angle: float) -> tuple[float, float]:
    """From the frame of a heading to north and east."""
    x, y = vector
    return math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y


def resting(heading: float, *, seconds: float = 40.0) -> Autopilot:
    """In GUIDED, with a table of nothing but level flight; not yet switched on."""
    made = ardupilot_files(attitude_plan(), facts())
    script = made["many-at-once-attitude.lua"]
    rows = int(50 * seconds)
    # Fewer rows than the plan has would be a damaged table.
    assert rows >= made["many-at-once-attitude.csv"].count("\n")
    autopilot = Autopilot(script, {"/APM/scripts/many-at-once-attitude.csv": "0,0,0\n" * rows})
    autopilot.state.mode, autopilot.state.yaw = GUIDED, heading
    return autopilot


def lean_of(autopilot: Autopilot) -> tuple[float, float]:
    """Acceleration to north and east of the last attitude that was asked for."""
    _, roll, pitch, *_ = autopilot.targets()[-1]
    lean = (-math.tan(math.radians(pitch)), math.tan(math.radians(roll)))
    north, east = turned(lean, autopilot.state.yaw)
    return STANDARD_GRAVITY_M_S2 * north, STANDARD_GRAVITY_M_S2 * east


@pytest.mark.parametrize("heading", [0.0, 0.5, 1.7, math.pi, -2.3])
def test_a_drift_and_a_distance_ask_for_a_lean_against_them(heading: float) -> None:
    autopilot = resting(heading)
    autopilot.run(3.0)
    autopilot.state.velocity = autopilot.lua.table(0.3, -0.4, 0.0)
    autopilot.state.switch = 2
    autopilot.run(0.03)
    assert lean_of(autopilot) == pytest.approx((-0.3 * HOLD_1_S, 0.4 * HOLD_1_S), rel=0.01)
    before = len(autopilot.targets())
    autopilot.state.velocity = autopilot.lua.table(0.0, 0.0, 0.0)
    autopilot.state.position = autopilot.lua.table(-2.0, 1.0, -20.0)
    autopilot.run(0.03)
    assert len(autopilot.targets()) > before
    place = HOLD_1_S * HOLD_PLACE_1_S
    assert lean_of(autopilot) == pytest.approx((2.0 * place, -1.0 * place), rel=0.02)
    autopilot.state.velocity = autopilot.lua.table(0.0, -30.0, 0.0)
    autopilot.run(0.03)
    size = math.hypot(*lean_of(autopilot))
    assert size == pytest.approx(STANDARD_GRAVITY_M_S2 * math.tan(math.radians(10.0)))


def test_it_begins_with_the_lean_against_the_wind() -> None:
    autopilot = resting(0.5)
    autopilot.state.roll, autopilot.state.pitch = math.radians(2.0), math.radians(-3.0)
    autopilot.run(5.0)
    autopilot.state.switch = 2
    autopilot.run(0.03)
    assert autopilot.targets()[-1][1:3] == pytest.approx((2.0, -3.0), abs=1e-9)


@pytest.mark.parametrize("heading", [0.5, pytest.param(-2.3, marks=pytest.mark.slow)])
def test_a_vehicle_that_drifts_is_brought_back(heading: float) -> None:
    """The equation of the loop, solved: a push of 1 m/s on a point that leans at once."""
    autopilot = resting(heading)
    autopilot.run(1.0)
    autopilot.state.switch = 2
    speed, place = np.array([0.6, -0.8]), np.zeros(2)
    step_s, trace = 0.02, []
    for _ in range(1100):
        autopilot.state.velocity = autopilot.lua.table(*speed, 0.0)
        autopilot.state.position = autopilot.lua.table(*place, -20.0)
        autopilot.run(step_s)
        speed = speed + step_s * np.array(lean_of(autopilot) if autopilot.targets() else (0.0, 0.0))
        place = place + step_s * speed
        trace.append(place @ [0.6, -0.8])
    time_s = step_s * np.arange(1, 1101)
    roots = np.roots([1.0, HOLD_1_S, HOLD_1_S * HOLD_PLACE_1_S + HOLD_1_S2, HOLD_PLACE_1_S * HOLD_1_S2])
    weights = np.linalg.solve(np.vander(roots, 3, increasing=True).T, [0.0, 1.0, -HOLD_1_S])
    solved = (np.exp(np.outer(time_s, roots)) @ weights).real
    # A call of the script comes a step late, and the point moves in steps: together as if it had 6 % more speed.
    assert trace == pytest.approx(solved, abs=0.06 * solved.max())


def test_the_hold_has_the_gains_of_the_flights_that_were_simulated() -> None:
    script = ardupilot_files(attitude_plan(), facts())["many-at-once-attitude.lua"]
    assert f"PLACE_GAIN = {HOLD_1_S:g}, {HOLD_1_S2:g}, {HOLD_PLACE_1_S:g}\n" in script


@pytest.mark.parametrize("row", ["0,0,60", "a,0,0", "0,0", "0,0,0,0", "nan,0,0"])
def test_a_damaged_table_ends_the_attitudes(row: str) -> None:
    autopilot = attitude_script(table="0,0,0\n" * 100 + row + "\n" + "0,0,0\n" * 2000)
    autopilot.run(30.0)
    assert len(autopilot.targets()) == 100
    assert autopilot.texts()[-1] == "rotorid: the table is damaged"
    assert autopilot.state.mode == LOITER
