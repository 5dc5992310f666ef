"""When each file of a plan is used, and the one way to stop in all of them."""

from __future__ import annotations

import pytest
from tests.unit.report.plan_sample import facts, four_chirps
from tests.unit.report.test_flight_card import at_once

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.ardupilot import AFTER
from rotorid.plans.facts import how_to_stop
from rotorid.plans.files import file_use, plan_files
from rotorid.report.flight_card import flight_card_html


@pytest.mark.parametrize("plan", [four_chirps(), at_once()], ids=["chirps", "attitudes"])
def test_the_file_for_afterwards_is_never_loaded_before_the_flight(plan: FlightPlan) -> None:
    files = plan_files(plan, facts("ArduPilot"))
    use = file_use(list(files))
    assert AFTER not in use.before
    assert f"After the flight, load {AFTER}" in use.after
    named = [name for name in files if name != AFTER]
    assert all(name in use.before for name in named)
    (script,) = (name for name in files if name.endswith(".lua"))
    assert "to APM/scripts" in use.before.partition(f"copy {script}")[2]
    assert script not in use.before.partition("load ")[2].partition(",")[0]


def test_what_is_changed_before_a_flight_is_changed_back_afterwards() -> None:
    px4 = file_use(list(plan_files(at_once(), facts("PX4"))))
    assert "load it and reboot. To fly, run px4_fly_plan.py" in px4.before
    assert "px4.params back to your own values" in px4.after
    betaflight = file_use(["betaflight-cli.txt"])
    assert betaflight.before.index("diff all") < betaflight.before.index("paste betaflight-cli.txt")
    assert "paste your saved settings" in betaflight.after
    assert not file_use(["plan.csv", "plan.json"]).before


@pytest.mark.parametrize(
    ("plan", "autopilot", "way"),
    [
        (four_chirps(), "ArduPilot", "To stop: switch to Loiter, throttle near the middle."),
        (at_once(), "ArduPilot", "To stop: switch to Loiter."),
        (at_once(), "PX4", "To stop: switch to Position."),
    ],
)
def test_the_card_and_every_file_name_one_way_to_stop(plan: FlightPlan, autopilot: str, way: str) -> None:
    assert way == f"To stop: {how_to_stop(plan, autopilot)}."
    assert way in flight_card_html(plan, facts(autopilot))
    files = plan_files(plan, facts(autopilot))
    about = [text for name, text in files.items() if ("To stop" in text or name.endswith((".lua", ".py")))]
    assert about
    assert all(way in text and "switch back to" not in text for text in about)
