"""Small logs that reports of users led to, and the right answer to each, once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.autopilots.advice import motor_advice
from rotorid.data import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.assembly import has_answers
from rotorid.reviewing.cards import cards
from rotorid.signal.airborne import airborne

Unpack = Callable[[str], Path]

SMOOTH = "betaflight/smooth_tune.BBL"


@pytest.fixture(scope="module")
def made(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the inputs that a script makes of the other logs."""
    script = shared_data / "field" / "make_inputs.py"
    if not script.is_file():
        pytest.skip(f"no {script}; set ROTORID_DATA to the folder of flights")
    folder = tmp_path_factory.mktemp("field")
    subprocess.run([sys.executable, str(script), str(folder)], check=True, capture_output=True)
    return folder


@lru_cache(maxsize=4)
def read(path: Path) -> FlightRecord:
    return rotorid.read(path, sandbox=False)


def test_slow_frames_that_build_on_the_one_before_read_as_ever(made: Path, shared_data: Path) -> None:
    """INAV 7 to 9 announce the last field of their slow frames as counted from the frame before."""
    found, plain = read(made / "f1_slow_predictor_previous.BBL"), read(shared_data / SMOOTH)
    assert found.channel_names == plain.channel_names
    assert all(np.array_equal(mine.values, its.values) for mine, its in zip(found.topics, plain.topics, strict=True))
    assert found.status == plain.status
    assert airborne(found).intervals == airborne(plain).intervals
    assert {finding.kind for finding in found.findings} == {finding.kind for finding in plain.findings}


def test_a_log_that_lost_its_first_frames_has_the_same_flight(made: Path, shared_data: Path) -> None:
    """What was lost is unknown, not disarmed."""
    found, plain = airborne(read(made / "f6_cut_header.BBL")), airborne(read(shared_data / SMOOTH))
    assert found.longest == pytest.approx(plain.longest, abs=0.1)
    assert found.longest[0] == pytest.approx(33.9, abs=0.1)


def test_one_motor_controller_of_four_does_not_end_a_review(made: Path) -> None:
    reviewed = rotorid.review(read(made / "f2_one_esc.BIN"), models=False)
    assert has_answers(reviewed)
    said = [finding.message for finding in reviewed.findings] + [gap.why for gap in reviewed.cannot_tell]
    assert any("1 motor of 4" in sentence for sentence in said)
    assert not any("--layout" in sentence for sentence in said)


def test_motors_that_never_ran_are_no_flight(made: Path) -> None:
    bench = read(made / "f3_disarmed_bench.BIN")
    with pytest.raises(InsufficientDataError, match="the motors never ran"):
        airborne(bench)
    assert rotorid.inspect(bench).flights == ()
    reviewed = rotorid.review(bench, models=False)
    assert reviewed.flight.flights == ()
    first, *others = cards(reviewed)
    assert {card.state for card in (first, *others)} == {"cannot"}
    assert "the motors never ran" in first.details


def test_a_crazyflie_with_pulses_speeds_and_a_quaternion_gives_its_thrust_coefficient(made: Path) -> None:
    record = read(made / "f4_crazyflie_pwm")
    motors = [f"{name}_{number}" for name in ("motor", "motor_speed") for number in range(1, 5)]
    assert {*motors, "phi", "theta", "psi"} <= set(record.channel_names)
    assert record["motor_1"].channel.source == "pwm.m1_pwm"
    assert record.findings == ()
    assert rotorid.inspect(record).supports["physical.motors"].possible
    found = rotorid.identify(record, model="physical.motors", fix={"m": 0.037})
    coefficient = found.parameters["c_2"]
    assert coefficient.value == pytest.approx(3.72e-8, rel=0.01)
    assert coefficient.lower < 3.72e-8 < coefficient.upper
    balance = rotorid.review(record, models=False).motors.numbers["thrust_coefficient_per_mass"]
    assert balance.lower < 3.72e-8 / 0.037 < balance.upper


def test_speeds_and_outputs_alone_give_the_lag_of_the_motors_and_no_other_command(made: Path) -> None:
    record = read(made / "f7_motors_only")
    inspected = rotorid.inspect(record)
    assert [name for name, support in inspected.supports.items() if support.possible] == ["motor.speed"]
    assert not any("rate." in command for command in inspected.next_commands)
    found = rotorid.identify(record, model="motor.speed")
    # 4 ms into 78 ms: 0.05 of the way in each sample.
    assert found.parameters["T_motor_up"].value == pytest.approx(0.078, rel=0.02)
    assert found.parameters["T_motor_down"].value == pytest.approx(0.078, rel=0.02)


def test_motors_alone_are_advised_the_variables_that_are_missing(made: Path) -> None:
    record = read(made / "f7_motors_only")
    assert {finding.where for finding in record.findings if finding.kind == "missing_channel"} == {"p", "az"}
    supports = rotorid.inspect(record).supports
    assert "gyro.x" in supports["rate.roll"].remedy
    assert "acc.x" in supports["rate.vertical"].remedy
    assert "--map" not in motor_advice(record)


def test_full_throttle_in_a_steady_climb_is_no_thrust_ratio(shared_data: Path) -> None:
    found = rotorid.review(read(shared_data / "field/maik_00000003.BIN"), models=False).flight
    assert found.thrust_to_weight is None or found.thrust_to_weight.value > 1.14 / 0.42


def test_one_frequency_is_refused_for_what_it_is(unpacked: Unpack) -> None:
    record = read(unpacked("field/b05_dwell.csv.xz"))
    with pytest.raises(InsufficientDataError, match="one frequency is one point of a response"):
        rotorid.identify(record, model="rate.roll")
    assert not rotorid.inspect(record).supports["rate.roll"].possible


def test_a_bag_of_a_swarm_reads_through_its_mapping(unpacked: Unpack, shared_data: Path) -> None:
    record = rotorid.read(unpacked("field/b12_crazyswarm.bag.xz"), mapping=shared_data / "field/b12.toml")
    assert record.topics


@pytest.mark.parametrize(
    ("log", "flight"),
    [
        # Height and thrust show the touch-down; the landed event comes 1.5 s later.
        ("ardupilot_sitl/x_calm_verify.BIN.xz", (54.9, 254.2)),
        ("real_stacks/ap_x_wind_ordinary_soft.BIN.xz", (45.3, 157.6)),
        ("px4_sitl/roll.ulg", (13.8, 136.9)),
        ("crazyflie/log10", (32.0, 69.1)),
    ],
)
def test_the_flight_of_a_known_log(unpacked: Unpack, log: str, flight: tuple[float, float]) -> None:
    (found,) = airborne(read(unpacked(log))).intervals
    assert found == pytest.approx(flight, abs=0.5)


@pytest.mark.parametrize("log", ["px4/sample.ulg", "px4/sample_logging_tagged_and_default_params.ulg"])
def test_what_was_never_armed_never_flew(unpacked: Unpack, log: str) -> None:
    with pytest.raises(InsufficientDataError, match="the vehicle was never armed"):
        airborne(read(unpacked(log)))
