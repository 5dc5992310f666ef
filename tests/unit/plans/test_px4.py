from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.report.plan_sample import by_hand, chirp, facts, step
from tests.unit.report.px4_link import (
    ALTITUDE,
    HEADING,
    POSITION,
    RATE_HZ,
    RETURN,
    attitude_plan,
    euler,
    flown,
    heave_plan,
    loaded,
    stick_plan,
)

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.plans.csv import table
from rotorid.plans.px4 import px4_files
from rotorid.typing import FloatArray


def planned(plan: FlightPlan, axis: str, time_s: FloatArray) -> FloatArray:
    """What the table says, between its rows too; what the table should say is tested where it is made."""
    rows_s, columns = table(plan)
    return next(
        np.interp(time_s, rows_s, values, left=0.0, right=0.0)
        for name, values in columns.items()
        if name.startswith(axis)
    )


def clock_of_plan(times_s: FloatArray, values: FloatArray, plan: FlightPlan, axis: str) -> float:
    """When the plan began: two seconds after Offboard was seen, which the link tells to 10 ms."""
    trials = np.arange(3.9, 4.3, 0.001)
    return float(min(trials, key=lambda zero: float(np.abs(values - planned(plan, axis, times_s - zero)).max())))


@pytest.mark.parametrize("plan", [attitude_plan(), heave_plan(), stick_plan()], ids=lambda plan: plan.name)
def test_the_script_compiles_and_says_what_it_flies(plan: FlightPlan, tmp_path: Path, capsys: Any) -> None:
    files = px4_files(plan, facts("PX4"))
    compile(files["px4_fly_plan.py"], "px4_fly_plan.py", "exec")
    assert loaded(plan, tmp_path).main(["--dry-run"]) == 0
    said = capsys.readouterr().out
    assert plan.name in said
    assert all(axis in said for axis in plan.axes)


def test_attitudes_and_thrust_arrive_as_planned(tmp_path: Path) -> None:
    plan = attitude_plan()
    reason, link, _ = flown(plan, tmp_path)
    assert reason == "plan complete"
    times_s, values = link.of("set_attitude_target_send")
    assert {one[3] for one in values} == {0b111}
    angles = np.array([euler(one[4]) for one in values])
    zero = clock_of_plan(times_s, angles[:, 0], plan, "roll")
    # The table has seven digits, and the clock of the plan is known to a millisecond.
    for column, axis in enumerate(("roll", "pitch", "yaw")):
        wanted = planned(plan, axis, times_s - zero)
        slope = np.abs(np.diff(wanted)).max() * RATE_HZ
        assert np.abs(angles[:, column] - (HEADING if axis == "yaw" else 0.0) - wanted).max() <= 0.001 * slope + 1e-6
    thrust = np.array([one[8] for one in values])
    wanted = planned(plan, "thrust", times_s - zero)
    assert np.abs(thrust - 0.5 - wanted).max() <= 0.001 * np.abs(np.diff(wanted)).max() * RATE_HZ + 1e-6
    flying = times_s[(times_s > zero) & (times_s < zero + plan.duration_s)]
    assert np.diff(flying) == pytest.approx(1.0 / RATE_HZ, abs=1e-4)


def test_sticks_have_the_signs_and_ranges_of_manual_control(tmp_path: Path) -> None:
    plan = stick_plan()
    reason, link, _ = flown(plan, tmp_path, pilot=False, words=("--simulation",))
    assert reason == "plan complete"
    times_s, values = link.of("manual_control_send")
    x, y, z, r = (np.array([one[index] for one in values], dtype=float) for index in (1, 2, 3, 4))
    trials = np.arange(1.9, 2.2, 0.001)
    zero = min(trials, key=lambda one: float(np.abs(y / 1000.0 - planned(plan, "roll", times_s - one)).max()))
    for sent, axis, scale, middle in (
        (x, "pitch", 1000, 0),
        (y, "roll", 1000, 0),
        (r, "yaw", 1000, 0),
        (z, "thrust", 500, 500),
    ):
        wanted = planned(plan, axis, times_s - zero)
        slope = np.abs(np.diff(wanted)).max() * RATE_HZ
        # Sticks are whole numbers.
        assert np.abs((sent - middle) / scale - wanted).max() <= 0.001 * slope + 0.501 / scale


def test_nothing_moves_before_the_pilot_is_in_offboard(tmp_path: Path) -> None:
    _, link, _ = flown(attitude_plan(), tmp_path)
    times_s, values = link.of("set_attitude_target_send")
    early = [euler(one[4]) for time_s, one in zip(times_s, values, strict=True) if time_s < 3.9]
    assert len(early) > 300
    assert np.array(early) == pytest.approx(np.tile([0.0, 0.0, HEADING], (len(early), 1)))
    reason, link, _ = flown(attitude_plan(), tmp_path, pilot=False)
    assert reason == "the pilot did not switch to Offboard"
    assert not [one for _, name, one in link.sent if name == "command_long_send" and one[2] == 176]


@pytest.mark.parametrize("mode", [POSITION, ALTITUDE, RETURN])
def test_a_change_of_the_mode_ends_it_at_once(mode: int, tmp_path: Path) -> None:
    reason, link, _ = flown(attitude_plan(), tmp_path, (8.0, {"mode": mode}))
    assert reason == "mode changed"
    after = [name for time_s, name, _ in link.sent if time_s > 1008.05]
    assert not after


@pytest.mark.parametrize(
    ("says", "reason"),
    [
        ({"position": (9.0, 11.0, -20.0)}, "out of the room"),
        ({"position": (1.0, 2.0, -24.5)}, "height"),
        ({"attitude": (math.radians(26.0), 0.0, HEADING)}, "tilt"),
        ({"attitude": (0.0, math.radians(-26.0), HEADING)}, "tilt"),
        ({"rates": (0.0, 0.0, math.radians(131.0))}, "rate"),
        ({"position": (1.0, math.nan, -20.0)}, "out of the room"),
        ({"rates": (math.nan, 0.0, 0.0)}, "rate"),
        ({"velocity": (math.nan, 0.0, 0.0)}, "no velocity"),
        ({"battery": 29}, "battery"),
        ({"silent": True}, "link lost"),
    ],
)
def test_a_limit_ends_it_level_and_asks_for_position_mode(says: dict[str, Any], reason: str, tmp_path: Path) -> None:
    said, link, _ = flown(attitude_plan(), tmp_path, (10.0, says))
    assert said == reason
    times_s, values = link.of("set_attitude_target_send")
    late = 0.6 if reason == "link lost" else 0.05
    after = [euler(one[4]) for time_s, one in zip(times_s, values, strict=True) if time_s > 10.0 + late]
    assert all(angles == pytest.approx((0.0, 0.0, HEADING), abs=1e-12) for angles in after)
    assert len(after) < 5
    modes = [one[4:6] for _, name, one in link.sent if name == "command_long_send" and one[2] == 176]
    assert modes == [(1, POSITION)]


def test_disarming_ends_it_without_another_word(tmp_path: Path) -> None:
    reason, link, _ = flown(attitude_plan(), tmp_path, (10.0, {"armed": False}))
    assert reason == "disarmed"
    assert not [name for time_s, name, _ in link.sent if time_s > 1010.05]


@pytest.mark.parametrize("says", [{"armed": False}, {"mode": RETURN}, {"position": (0.0, 0.0, -1.0)}])
def test_it_does_not_begin_on_the_ground_or_in_another_mode(says: dict[str, Any], tmp_path: Path) -> None:
    reason, link, _ = flown(attitude_plan(), tmp_path, (0.0, says), pilot=False)
    assert reason == "no vehicle in the air"
    assert not link.of("set_attitude_target_send")[1]


def test_it_never_arms(tmp_path: Path) -> None:
    arm, set_mode, set_interval = 400, 176, 511
    for plan, words in ((attitude_plan(), ("--hover-thrust", "0.5")), (stick_plan(), ("--simulation",))):
        _, link, _ = flown(plan, tmp_path, pilot=plan.name == "Attitude", words=words)
        commands = {one[2] for _, name, one in link.sent if name == "command_long_send"}
        assert commands <= {set_mode, set_interval}
        assert arm not in commands


@pytest.mark.parametrize("name", ["100%", "50 %(prog)s (%) %d", "%(nobody)s %(prog)s", "{0} {name!r}"])
def test_no_name_breaks_the_help(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = FlightPlan(name=name, inputs=(step("thrust"),))
    module = loaded(plan, tmp_path, vehicle=name)
    with pytest.raises(SystemExit) as ended:
        module.arguments(["--help"])
    assert ended.value.code == 0
    assert "--hover-thrust" in capsys.readouterr().out


@pytest.mark.parametrize(("height_m", "climb_m"), [(20.0, 2.6), (290.139706, 145.069853), (4.0, 2.0), (1.0, 0.1)])
def test_it_begins_above_the_height_that_it_may_lose(height_m: float, climb_m: float, tmp_path: Path) -> None:
    module = loaded(attitude_plan(), tmp_path, height_m=height_m, climb_m=climb_m)
    limits = module.arguments([])
    assert 0.0 < limits.climb_m < limits.least_height_m <= height_m
    script = (tmp_path / "px4_fly_plan.py").read_text()
    assert not re.search(r"default=\d+\.\d{2,}", script)
    with pytest.raises(SystemExit):
        module.arguments(["--climb-m", str(limits.least_height_m)])


def test_words_are_needed_before_anything_is_connected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = loaded(attitude_plan(), tmp_path)
    assert module.main([]) == 2  # no hover thrust
    monkeypatch.setattr("builtins.input", lambda question: "yes")
    assert module.main(["--hover-thrust", "0.5"]) == 1
    assert loaded(stick_plan(), tmp_path).main([]) == 2  # no --simulation


def test_a_table_with_larger_values_is_not_flown(tmp_path: Path) -> None:
    module = loaded(attitude_plan(), tmp_path)
    file = tmp_path / "plan.csv"
    rows = file.read_text().splitlines()
    cells = rows[300].split(",")
    rows[300] = ",".join([cells[0], "0.9", *cells[2:]])
    file.write_text("\n".join(rows))
    with pytest.raises(SystemExit, match="exceeds"):
        module.Plan(str(file))


def test_limits_are_those_of_the_facts(tmp_path: Path) -> None:
    limits = loaded(attitude_plan(), tmp_path, room_m=3.0, tilt_rad=math.radians(9.0)).arguments(
        ["--hover-thrust", "0.5"]
    )
    assert (limits.room_m, limits.tilt_deg, limits.climb_m, limits.rate_deg_s) == (5.0, 15.0, 4.0, 130.0)


def test_parameters_are_as_qgroundcontrol_loads_them() -> None:
    text = px4_files(attitude_plan(), facts("PX4"))["px4.params"]
    rows = [line.split("\t") for line in text.splitlines() if line and not line.startswith("#")]
    assert all(row[:2] == ["1", "1"] and len(row[2]) <= 16 for row in rows)
    values = {row[2]: (float(row[3]), int(row[4])) for row in rows}
    assert values["SDLOG_PROFILE"] == (25.0, 6)
    assert values["COM_OF_LOSS_T"] == (0.5, 9)
    assert values["COM_RC_OVERRIDE"] == (3.0, 6)


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ((chirp("roll"),), "MAVLink cannot send"),
        ((chirp("thrust", entry="rate_setpoint"),), "MAVLink cannot send"),
        ((step("roll", entry="stick"), step("pitch", entry="attitude_setpoint")), "one kind"),
        ((step("roll", entry="rate_setpoint"),), "lets the vehicle drift"),
        ((step("yaw", entry="rate_setpoint"),), "lets the vehicle drift"),
        ((by_hand("roll"), step("thrust")), "one kind"),
        ((chirp("roll", entry="attitude_setpoint"),), "ten for a period"),
    ],
)
def test_what_it_cannot_carry_is_refused(inputs: tuple[PlannedInput, ...], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        px4_files(FlightPlan(name="no", inputs=inputs), facts("PX4"))


def test_thrust_alone_flies_level() -> None:
    files = px4_files(FlightPlan(name="heave", inputs=(step("thrust"),)), facts("PX4"))
    assert 'KIND = "attitude_setpoint"' in files["px4_fly_plan.py"]


def test_no_name_can_act_in_the_script(tmp_path: Path) -> None:
    plan = FlightPlan(name='x"""\nraise SystemExit(9)\n"""{1/0}', inputs=(step("thrust"),))
    module = loaded(plan, tmp_path, vehicle='q"); raise SystemExit(8) #\n{0}')
    assert module.main(["--dry-run"]) == 0
