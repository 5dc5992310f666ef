from __future__ import annotations

import importlib.util
import io
import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20.common import MAVLink
from tests.unit.report.plan_sample import by_hand, chirp, facts, multisine, step

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.report.plan_csv import table
from rotorid.report.plan_px4 import px4_files
from rotorid.typing import FloatArray

POSITION, ALTITUDE, OFFBOARD, RETURN = 3, 2, 6, 4
HEADING = 0.4
RATE_HZ = 100.0


def attitude_plan() -> FlightPlan:
    inputs = (
        *multisine(("roll", "pitch", "yaw")),
        chirp("thrust", amplitude=0.05, band_hz=(0.2, 2.0), duration_s=20.0),
    )
    return FlightPlan(name="Attitude", inputs=inputs)


def rate_plan() -> FlightPlan:
    return FlightPlan(name="Rates", inputs=multisine(("roll", "pitch", "yaw"), entry="rate_setpoint"))


def stick_plan() -> FlightPlan:
    return FlightPlan(name="Sticks", inputs=tuple(by_hand(axis) for axis in ("roll", "pitch", "yaw", "thrust")))


def loaded(plan: FlightPlan, folder: Path, **changes: Any) -> ModuleType:
    """The script as a module beside its table; nothing of it runs."""
    for name, text in px4_files(plan, facts("PX4", **changes)).items():
        (folder / name).write_text(text)
    specification = importlib.util.spec_from_file_location("px4_fly_plan", folder / "px4_fly_plan.py")
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


class Time:
    """A clock that stands until somebody sleeps."""

    def __init__(self) -> None:
        self.at_s = 1000.0

    def now(self) -> float:
        return self.at_s

    def sleep(self, seconds: float) -> None:
        # A computer sleeps a little longer than it was asked to.
        self.at_s += seconds + 1e-7


class Link:
    """A PX4 that hovers. A pilot switches to Offboard after two seconds; ``change`` happens at its time."""

    target_system, target_component = 1, 1

    def __init__(self, clock: Time, change: tuple[float, dict[str, Any]] | None = None, *, pilot: bool = True) -> None:
        self.clock, self.change, self.pilot = clock, change, pilot
        self.began_s = clock.now()
        self.says: dict[str, Any] = {"mode": POSITION, "armed": True, "attitude": (0.0, 0.0, HEADING)}
        self.says |= {"rates": (0.0, 0.0, 0.0), "position": (1.0, 2.0, -20.0), "velocity": (0.0, 0.0, 0.0)}
        self.says |= {"battery": 80, "silent": False}
        self.waiting: deque[Any] = deque()
        self.sent: list[tuple[float, str, tuple[Any, ...]]] = []
        self.last_s = -math.inf
        self.mav = self
        self.packer = MAVLink(io.BytesIO())

    def __getattr__(self, name: str) -> Any:
        if not name.endswith("_send"):
            raise AttributeError(name)

        def note(*values: Any) -> None:
            # A message that MAVLink cannot pack was never sent.
            getattr(self.packer, name)(*values)
            self.sent.append((self.clock.now(), name, values))
            if name == "command_long_send" and values[2] == 176:
                self.says["mode"] = values[5]

        return note

    def recv_match(self, *, blocking: bool) -> Any:
        assert not blocking
        since = self.clock.now() - self.began_s
        if self.change and since >= self.change[0]:
            self.says |= self.change[1]
            self.change = None
        if self.pilot and since >= 2.0:
            self.says["mode"], self.pilot = OFFBOARD, False
        if self.clock.now() - self.last_s >= 0.02:
            self.last_s = self.clock.now()
            self.waiting.extend(self.messages())
        return self.waiting.popleft() if self.waiting else None

    def messages(self) -> list[SimpleNamespace]:
        says = self.says
        roll, pitch, yaw = says["attitude"]
        p, q, r = says["rates"]
        x, y, z = says["position"]
        vx, vy, vz = says["velocity"]
        beat = {"custom_mode": says["mode"] << 16, "base_mode": 1 | 128 * says["armed"], "get_srcComponent": lambda: 1}
        found: list[tuple[str, dict[str, Any]]] = [("HEARTBEAT", beat)]
        # Somebody else on the link, in another mode: not the autopilot.
        found.append(("HEARTBEAT", beat | {"custom_mode": RETURN << 16, "get_srcComponent": lambda: 190}))
        if not says["silent"]:
            found.append(
                ("ATTITUDE", {"roll": roll, "pitch": pitch, "yaw": yaw, "rollspeed": p, "pitchspeed": q, "yawspeed": r})
            )
            found.append(("LOCAL_POSITION_NED", {"x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}))
            found.append(("SYS_STATUS", {"battery_remaining": says["battery"]}))
        return [SimpleNamespace(get_type=lambda kind=kind: kind, **values) for kind, values in found]

    def of(self, name: str) -> tuple[FloatArray, list[tuple[Any, ...]]]:
        chosen = [(time_s - self.began_s, values) for time_s, kind, values in self.sent if kind == name]
        return np.array([time_s for time_s, _ in chosen]), [values for _, values in chosen]


def flown(
    plan: FlightPlan,
    folder: Path,
    change: tuple[float, dict[str, Any]] | None = None,
    *,
    pilot: bool = True,
    words: Sequence[str] = ("--hover-thrust", "0.5"),
) -> tuple[str, Link, ModuleType]:
    module = loaded(plan, folder)
    clock = Time()
    link = Link(clock, change, pilot=pilot)
    limits = module.arguments(list(words))
    reason = module.Flight(link, module.Plan(limits.plan), limits, clock, say=lambda text: None).run()
    return reason, link, module


def euler(q: Sequence[float]) -> tuple[float, float, float]:
    w, x, y, z = q
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(2.0 * (w * y - z * x)),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


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


@pytest.mark.parametrize("plan", [attitude_plan(), rate_plan(), stick_plan()], ids=lambda plan: plan.name)
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


def test_rates_arrive_as_planned_on_top_of_what_holds_level(tmp_path: Path) -> None:
    plan = rate_plan()
    reason, link, module = flown(plan, tmp_path)
    assert reason == "plan complete"
    times_s, values = link.of("set_attitude_target_send")
    assert {one[3] for one in values} == {0b10000000}
    rates = np.array([one[5:8] for one in values])
    zero = clock_of_plan(times_s, rates[:, 0], plan, "roll")
    for column, axis in enumerate(("roll", "pitch", "yaw")):
        wanted = planned(plan, axis, times_s - zero)
        assert np.abs(rates[:, column] - wanted).max() <= 0.001 * np.abs(np.diff(wanted)).max() * RATE_HZ + 1e-6
    tilted, link, _ = flown(plan, tmp_path, (3.0, {"attitude": (0.1, -0.05, HEADING + 0.2)}))
    assert tilted == "plan complete"
    before = [one[5:8] for time_s, name, one in link.sent if name.startswith("set_att") and 3.2 < time_s - 1000.0 < 3.9]
    assert np.array(before) == pytest.approx(
        np.tile(module.LEVEL_GAIN * np.array([-0.1, 0.05, -0.2]), (len(before), 1))
    )


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
        ({"battery": 29}, "battery"),
        ({"silent": True}, "link is silent"),
    ],
)
def test_a_limit_ends_it_level_and_asks_for_position_mode(says: dict[str, Any], reason: str, tmp_path: Path) -> None:
    said, link, _ = flown(attitude_plan(), tmp_path, (10.0, says))
    assert said == reason
    times_s, values = link.of("set_attitude_target_send")
    late = 0.6 if reason == "link is silent" else 0.05
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


def test_height_is_held_by_a_slow_and_narrow_loop(tmp_path: Path) -> None:
    _, link, module = flown(rate_plan(), tmp_path, (6.0, {"position": (1.0, 2.0, -19.0), "velocity": (0.0, 0.0, 0.5)}))
    thrust = [one[8] for time_s, name, one in link.sent if name.startswith("set_att") and 1006.1 < time_s < 1007.0]
    assert thrust == pytest.approx([0.5 + module.HEIGHT_GAIN + 0.5 * module.CLIMB_GAIN] * len(thrust))
    _, link, module = flown(rate_plan(), tmp_path, (6.0, {"velocity": (0.0, 0.0, 50.0)}))
    thrust = [one[8] for time_s, name, one in link.sent if name.startswith("set_att") and time_s > 1006.1]
    assert max(thrust) == pytest.approx(0.5 + module.THRUST_REACH)


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
        ((chirp("roll"),), "MAVLink reaches nothing else"),
        ((chirp("thrust", entry="rate_setpoint"),), "MAVLink reaches nothing else"),
        ((step("roll", entry="rate_setpoint"), step("pitch", entry="attitude_setpoint")), "one kind"),
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
