"""Motors, battery and thrust of simulated flights whose faults are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.cards import cards
from rotorid.reviewing.flight import flight, logger_topics, logging, vehicle
from rotorid.reviewing.motors import imbalance_pattern, motors
from rotorid.signal.motors import logged_speeds, motor_history
from rotorid.simulation.multirotor import Multirotor
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.typing import FloatArray
from rotorid.vehicles import aircraft

AHEAD_M = 0.03


def record(columns: dict[str, FloatArray], rate_hz: float, written: str = "twin", **more: object) -> FlightRecord:
    count = next(iter(columns.values())).size
    time_s = np.arange(count) / rate_hz
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=f"twin.{name}") for name in columns)
    topic = Topic(name="twin", time_s=time_s, channels=channels, values=np.stack(list(columns.values())))
    status = Status(in_air=((0.0, float(time_s[-1])),), flagged_in="twin", modes=(("acro", 0.0, float(time_s[-1])),))
    source = Source(name="twin.log", format=written, sha256="")
    return FlightRecord(source=source, topics=(topic,), status=status, **more)  # type: ignore[arg-type]


def heavier_ahead(body: Multirotor) -> Multirotor:
    return replace(body, center_of_gravity_m=(AHEAD_M, 0.0, 0.0))


def weak_motor(body: Multirotor) -> Multirotor:
    wrench = body.wrench.copy()
    wrench[:, 2] *= 0.75
    return replace(body, effectiveness=wrench)


def twisted_arm(body: Multirotor) -> Multirotor:
    wrench = body.wrench.copy()
    wrench[5] += 0.003
    return replace(body, effectiveness=wrench)


def sound(body: Multirotor) -> Multirotor:
    return body


@pytest.mark.parametrize(
    ("fault", "pattern"),
    [(sound, ""), (heavier_ahead, "one side"), (weak_motor, "one motor"), (twisted_arm, "diagonal")],
)
def test_a_fault_shows_in_the_outputs_of_hover(
    fault: Callable[[Multirotor], Multirotor], pattern: str, tmp_path: Path
) -> None:
    craft = aircraft("x500")
    flown = fly_multirotor(replace(craft, vehicle=fault(craft.vehicle)), None, duration_s=15.0, seed=3)
    rotorid.write_log(tmp_path / "log.ulg", flown, format="ulg")
    log = rotorid.read(tmp_path / "log.ulg", sandbox=False)

    found, _ = motors(log)

    assert found.pattern == pattern
    # Healthy vehicles differ as much, so that one flight warns of nothing.
    assert not [finding for finding in found.findings if finding.severity != "info"]
    if fault is heavier_ahead:
        ahead = found.numbers["center_of_gravity_forward"]
        arm_m = float(np.hypot(*craft.vehicle.rotors.layout.positions[0, :2]))
        assert ahead.lower <= AHEAD_M / arm_m <= ahead.upper
        assert ahead.upper - ahead.lower < 0.1
    if fault is sound:
        body = craft.vehicle
        summary, _ = flight(log)
        most = sum(body.rotors.thrust) * body.rotors.layout.rotors / (body.mass_kg * 9.80665)
        assert summary.thrust_to_weight is not None
        assert summary.thrust_to_weight.lower <= most <= summary.thrust_to_weight.upper
        assert found.numbers["imbalance"].lower == 0.0


def test_one_flight_names_no_cause_however_uneven_it_is() -> None:
    columns = hovering(30.0, 100.0)
    for number in (1, 3):
        columns[f"motor_{number}"] *= 0.4
    log = record(columns, 100.0)

    (finding,) = motors(log)[0].findings
    card = next(card for card in cards(rotorid.review(log, models=False)) if card.key == "motors")

    assert finding.kind == "motor_imbalance"
    assert card.state == "look"
    for words in (finding.message, card.details):
        assert "ould be " in words
        assert "rotorid review LOG --baseline FOLDER" in words
    for number in (1, 3):
        columns[f"motor_{number}"] *= 2.0
    usual = record(columns, 100.0)
    card = next(card for card in cards(rotorid.review(usual, models=False)) if card.key == "motors")
    assert not motors(usual)[0].findings
    assert card.state != "look"


def test_two_faults_at_once_are_not_named() -> None:
    corners = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])
    spins = np.array([1.0, 1.0, -1.0, -1.0])

    assert imbalance_pattern(0.1 * corners[:, 0] + 0.1 * spins, corners, spins) == ""


def hovering(seconds: float, rate_hz: float, seed: int = 1) -> dict[str, FloatArray]:
    """Motors, rates and attitude of a quiet hover."""
    rng, count = np.random.default_rng(seed), round(seconds * rate_hz)
    columns = {f"motor_{number}": 0.4 + 0.01 * rng.normal(size=count) for number in range(1, 5)}
    columns |= {name: 0.02 * rng.normal(size=count) for name in ("p", "q", "r", "phi", "theta")}
    return columns | {"az": np.full(count, -9.81)}


def test_a_motor_that_loses_its_step_is_an_event() -> None:
    columns = hovering(20.0, 200.0)
    rows = {f"motor_speed_{number}": 800.0 + 900.0 * (columns[f"motor_{number}"] - 0.4) for number in range(1, 5)}
    for start in (1000, 3000):
        columns["motor_2"][start + 4 : start + 24] = 0.9
        rows["motor_speed_2"][start + 4 : start + 24] *= 0.4
    # A command that the motor follows is none.
    columns["motor_3"][2000:2040] = 0.8
    rows["motor_speed_3"][2000:2040] = 1100.0

    found, untold = motors(record(columns | rows, 200.0))

    assert found.events == pytest.approx((5.0, 15.0), abs=0.06)
    assert "motor_out_of_step" in {finding.kind for finding in found.findings}
    assert not [one for one in untold if one.what == "motors.events"]


def test_a_motor_that_lags_behind_quick_commands_loses_no_step() -> None:
    """Speeds follow the outputs with a lag of 70 ms and 30 ms late, as a nano quadrotor logs them."""
    columns, rng = hovering(60.0, 100.0), np.random.default_rng(4)
    for number in range(1, 5):
        asked = np.repeat(rng.uniform(0.1, 0.9, size=600), 10)
        speed, now = np.empty(asked.size), 0.5
        for place, value in enumerate(asked):
            now += (value - now) * 0.01 / 0.07
            speed[place] = 2000.0 * now
        columns[f"motor_{number}"] = asked
        columns[f"motor_speed_{number}"] = np.r_[np.full(3, 1000.0), speed[:-3]]

    assert motors(record(columns, 100.0))[0].events == ()


def test_speeds_that_are_logged_too_slowly_tell_no_event() -> None:
    columns = hovering(30.0, 10.0)
    columns |= {f"motor_speed_{number}": np.full(300, 800.0) for number in range(1, 5)}

    _, untold = motors(record(columns, 10.0))

    assert next(one.why for one in untold if one.what == "motors.events").startswith("Motor speeds are logged at 10 Hz")


def test_limits_are_told_by_motor_and_axis() -> None:
    columns = hovering(20.0, 100.0)
    columns |= {f"{axis}_command": np.zeros(2000) for axis in ("roll", "pitch", "yaw")}
    columns["thrust_command"] = np.full(2000, 0.4)
    columns["motor_1"][:200] = 1.0
    columns["roll_command"][:200] = 0.6

    numbers = motors(record(columns, 100.0))[0].numbers

    assert numbers["saturated_high_share"].value == pytest.approx(0.1, abs=0.001)
    assert numbers["motor_1_high_share"].value == pytest.approx(0.1, abs=0.001)
    assert numbers["saturated_by_roll_share"].value == pytest.approx(0.1, abs=0.001)
    # A file without a range shows an end by a pile of ten samples: thirty of 2000 may hide, three where it is known.
    assert numbers["motor_2_high_share"].upper == pytest.approx(30 / 2000)
    known = motors(record(columns, 100.0, "Betaflight blackbox"))[0].numbers
    assert known["motor_2_high_share"].upper == pytest.approx(3 / 2000)


def test_full_thrust_that_was_too_short_is_not_told_to_be_missing() -> None:
    columns = hovering(20.0, 100.0)
    for number in range(1, 5):
        columns[f"motor_{number}"][1000:1005] = 0.99
    columns["motor_1"][:200] = 1.0

    _, untold = flight(record(columns, 100.0))

    (why,) = (one.why for one in untold if one.what == "flight.thrust_to_weight")
    assert why.startswith("Throttle was above 90 % for only 0.0")
    for number in range(1, 5):
        columns[f"motor_{number}"][1000:1005] = 0.4
    _, untold = flight(record(columns, 100.0))
    (why,) = (one.why for one in untold if one.what == "flight.thrust_to_weight")
    assert why.startswith("Throttle never exceeded 5")


def test_a_thrust_curve_in_the_log_is_not_said_to_be_missing() -> None:
    shaken = np.tile([0.1, 0.9], 1000)
    columns = {"p": shaken, "thrust_command": shaken, **{f"motor_{number}": shaken for number in range(1, 5)}}
    curve = {"MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}
    log = record(columns, 100.0, "ArduPilot DataFlash", parameters=curve)
    (missing,) = (one for one in flight(log)[1] if one.what == "flight.thrust_to_weight")
    assert missing.why == "The log contains no acceleration, and too little quiet hover for its thrust curve."
    assert missing.remedy.startswith("hover for 20 s")


@pytest.mark.parametrize(("climbing", "ratio"), [(True, None), (False, 3.0)])
def test_full_throttle_in_a_climb_is_no_thrust_ratio(climbing: bool, ratio: float | None) -> None:
    """A fast climb at full throttle carries one weight, as hover does at 40 %."""
    columns = hovering(20.0, 100.0)
    for number in range(1, 5):
        columns[f"motor_{number}"][500:800] = 0.96
    columns["az"][500:800] *= 1.0 if climbing else 3.0

    found, untold = flight(record(columns, 100.0))

    assert (found.thrust_to_weight is None) == climbing
    if found.thrust_to_weight is not None:
        assert found.thrust_to_weight.value == pytest.approx(ratio, rel=0.01)
    else:
        (why,) = (one.why for one in untold if one.what == "flight.thrust_to_weight")
        assert "40 % throttle carries the weight too, so full thrust is more than 2.5 times" in why


@pytest.mark.parametrize("seed", range(4))
def test_resistance_comes_from_volts_against_amperes(seed: int) -> None:
    rng, columns = np.random.default_rng(seed), hovering(60.0, 50.0)
    pulls = np.repeat(rng.uniform(5.0, 40.0, size=60), 50)
    columns["battery_current"] = pulls + rng.normal(scale=0.5, size=3000)
    slow = 16.0 - 0.02 * np.arange(3000) / 50.0
    columns["battery_voltage"] = slow - 0.03 * pulls + rng.normal(scale=0.03, size=3000)

    battery = flight(record(columns, 50.0))[0].battery

    assert battery["resistance_ohm"].lower <= 0.03 <= battery["resistance_ohm"].upper
    assert battery["resistance_ohm"].std < 0.1 * 0.03
    assert battery["sag_v"].value == pytest.approx(0.03 * pulls.mean(), rel=0.1)


def test_without_current_there_is_no_resistance() -> None:
    columns = hovering(30.0, 50.0) | {"battery_voltage": np.linspace(16.0, 15.0, 1500)}

    summary, untold = flight(record(columns, 50.0))

    assert summary.battery["start_v"].value == pytest.approx(16.0, abs=0.1)
    assert "flight.battery.resistance_ohm" in {one.what for one in untold}
    assert summary.modes == pytest.approx({"acro": 1.0})


def test_px4_is_told_which_topics_to_log_at_which_interval() -> None:
    slow = record(hovering(30.0, 50.0), 50.0, "PX4 ULog", parameters={"SDLOG_PROFILE": 1.0})

    review, untold = logging(slow)

    assert review.rates_hz["p"] == pytest.approx(50.0)
    assert "vehicle_angular_velocity 4" in review.topics.splitlines()
    assert "vehicle_torque_setpoint 4" in review.topics.splitlines()
    assert "SDLOG_PROFILE = 25" in review.change[0]
    assert untold[0].what == "logging.rates"
    assert "actuator_motors 0" in logger_topics(slow, wanted=["motor_1"])


def test_firmware_that_cannot_log_commands_is_not_told_to_log_them() -> None:
    old = record({"p": np.full(2000, 0.1)}, 100.0, "ArduPilot DataFlash")
    log = replace(old, source=replace(old.source, firmware="ArduCopter V3.2.1"))
    (delay,) = (missing for missing in motors(log)[1] if missing.what == "motors.output_delay_s")
    assert delay.remedy.startswith("fly firmware 3.4 or newer")


def test_a_gap_in_flight_is_told_with_its_remedy() -> None:
    columns = hovering(30.0, 250.0)
    whole = record(columns, 250.0, "Betaflight blackbox")
    topic = whole.topics[0]
    kept = (topic.time_s < 10.0) | (topic.time_s > 10.5)
    holed = replace(whole, topics=(replace(topic, time_s=topic.time_s[kept], values=topic.values[:, kept]),))

    review, _ = logging(holed)

    assert review.longest_gap_s == pytest.approx(0.504, abs=0.01)
    assert any("504 ms" in sentence or "50" in sentence for sentence in review.change)


def test_motor_speeds_are_asked_of_firmware_that_logs_them() -> None:
    old = record(hovering(30.0, 250.0), 250.0, "Betaflight blackbox")
    review, _ = logging(replace(old, source=replace(old.source, firmware="Betaflight 4.3.1")))
    (speeds,) = (sentence for sentence in review.change if "motors' speeds" in sentence)
    assert speeds.startswith("Fly Betaflight 4.5 or newer")


def test_an_unknown_vehicle_says_so() -> None:
    found, untold = vehicle(record(hovering(30.0, 50.0), 50.0))

    assert found.motors == 4
    assert found.kind == ""
    assert {"vehicle.kind", "vehicle.frame"} <= {one.what for one in untold}


def test_a_log_without_a_flight_is_not_told_to_lack_what_it_holds() -> None:
    columns = {name: np.full(2000, 0.1) for name in ("p", "motor_1", "motor_2", "battery_voltage", "thrust_command")}
    bench = record(columns, 100.0)
    seen = rotorid.review(replace(bench, status=Status(in_air=(), flagged_in="twin")))
    first, *others = cards(seen)
    assert {card.sentence for card in others} == {"This log contains no flight."}
    assert (first.headline, first.state) == ("This log contains no flight.", "cannot")
    assert first.details.endswith("as twin shows: the autopilot never left the landed state.")
    assert first.remedy == "fly, and log from take-off to landing"


def test_a_flight_without_its_motors_is_told_whether_they_are_in_the_log() -> None:
    columns = {name: np.full(2000, 0.1) for name in ("p", "motor_1", "motor_2", "thrust_command", "battery_voltage")}
    late = record(columns, 100.0)
    motors_of = replace(late.topics[0], time_s=late.topics[0].time_s + 100.0)
    airborne = replace(
        late,
        topics=(
            motors_of,
            replace(late.topics[0], channels=late.topics[0].channels[:1], values=late.topics[0].values[:1]),
        ),
    )
    logged = {card.key: card.headline for card in cards(rotorid.review(airborne, models=False))}
    assert logged["motors"] == "Motor outputs are not logged in the air."
    assert logged["power"] == "Neither battery nor throttle could be read."
    lacking = {
        card.key: card.headline
        for card in cards(rotorid.review(replace(airborne, topics=airborne.topics[1:]), models=False))
    }
    assert lacking["motors"] == "Motor outputs are not logged."
    assert lacking["power"] == "Neither battery nor throttle is logged."


def test_a_plane_gets_no_advice_for_multirotors() -> None:
    columns = {name: 0.3 + 0.1 * np.sin(np.arange(2000)) for name in ("p", "motor_1", "motor_2", "thrust_command")}
    flown = record(columns, 100.0)
    seen = rotorid.review(replace(flown, status=replace(flown.status, vehicle="plane", named_in="MAV_TYPE 1")))
    assert (seen.models, seen.next_commands) == ({}, ())
    (said,) = (untold for untold in seen.cannot_tell if untold.what == "models")
    assert "MAV_TYPE 1" in said.why
    assert not said.remedy


def test_the_speed_of_one_motor_is_not_a_vehicle_of_one_rotor() -> None:
    clock = np.arange(0.0, 10.0, 0.01)
    outputs = Topic(
        name="RCOU",
        time_s=clock,
        channels=tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5)),
        values=np.full((4, clock.size), 0.4) + 0.01 * np.sin(clock),
    )
    speeds = (Channel(name="motor_speed_1", unit="rad/s"),)
    speed = Topic(
        name="ESC",
        time_s=clock,
        channels=speeds,
        values=outputs.values[:1] * 1e3,
    )
    record = FlightRecord(source=Source(name="a.BIN", format="ArduPilot DataFlash", sha256=""), topics=(outputs, speed))
    assert motor_history(record).kind == "output"
    with pytest.raises(InsufficientDataError, match=r"The speed of 1 motor of 4 is logged; this needs"):
        logged_speeds(record)


@pytest.mark.parametrize("still", [(), (2,), (2, 3)])
def test_outputs_that_never_move_are_not_balanced(still: tuple[int, ...]) -> None:
    columns = hovering(30.0, 100.0)
    columns |= {f"motor_{number}": np.full_like(columns["motor_1"], 0.4) for number in still}
    found, missing = motors(record(columns, 100.0))
    assert ("imbalance" in found.numbers) is not bool(still)
    whys = [gap.why for gap in missing if gap.what == "motors.imbalance"]
    words = {0: [], 1: ["The output of motor 2 never moves in flight."]}
    assert whys == words.get(len(still), ["The outputs of motors 2 and 3 never move in flight."])


def test_one_motor_is_not_balanced_against_itself() -> None:
    missing_ones = ("motor_2", "motor_3", "motor_4")
    columns = {name: row for name, row in hovering(30.0, 100.0).items() if name not in missing_ones}
    found, missing = motors(record(columns, 100.0))
    assert not {"imbalance", "headroom"} & found.numbers.keys()
    assert any(gap.why == "The output of only one motor is logged." for gap in missing)
