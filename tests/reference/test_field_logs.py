"""Small logs that reports of users led to, and what a careful reader says of each."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import rotorid
from rotorid.data import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.assembly import has_answers
from rotorid.reviewing.cards import cards
from rotorid.signal.airborne import airborne

Unpack = Callable[[str], Path]


@pytest.fixture(scope="module")
def made(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the inputs that a script makes of the other logs."""
    maker = shared_data / "field" / "make_inputs.py"
    if not maker.exists():
        pytest.skip("the logs of the field and their script are not here")
    folder = tmp_path_factory.mktemp("field")
    subprocess.run([sys.executable, str(maker), str(folder)], check=True, capture_output=True)
    return folder


@cache
def read(path: Path) -> FlightRecord:
    return rotorid.read(path, sandbox=False)


def test_slow_frames_that_build_on_the_one_before_read_as_ever(made: Path, shared_data: Path) -> None:
    found, plain = read(made / "f1_slow_predictor_previous.BBL"), read(shared_data / "betaflight/smooth_tune.BBL")
    assert airborne(found).intervals == airborne(plain).intervals
    assert found["p"].values.size == plain["p"].values.size
    assert "corrupt_log" not in {finding.kind for finding in found.findings}


def test_a_log_that_lost_its_first_frames_has_the_same_flight(made: Path, shared_data: Path) -> None:
    found, plain = read(made / "f6_cut_header.BBL"), read(shared_data / "betaflight/smooth_tune.BBL")
    assert airborne(found).longest == pytest.approx(airborne(plain).longest, abs=0.1)
    assert airborne(found).longest[0] == pytest.approx(33.9, abs=0.1)


def test_one_motor_controller_of_four_does_not_end_a_review(made: Path) -> None:
    record = read(made / "f2_one_esc.BIN")
    reviewed = rotorid.review(record, models=False)
    assert has_answers(reviewed)
    said = [finding.message for finding in reviewed.findings] + [gap.why for gap in reviewed.cannot_tell]
    assert any("1 motor of 4" in sentence for sentence in said)
    assert not any("--layout" in sentence for sentence in said)


def test_motors_that_never_ran_are_no_flight(made: Path) -> None:
    record = read(made / "f3_disarmed_bench.BIN")
    with pytest.raises(InsufficientDataError, match="the motors never ran"):
        airborne(record)
    reviewed = rotorid.review(record, models=False)
    assert reviewed.flight.flights == ()
    assert {card.state for card in cards(reviewed)} == {"cannot"}


def test_a_crazyflie_with_pulses_speeds_and_a_quaternion_gives_its_thrust_coefficient(made: Path) -> None:
    record = read(made / "f4_crazyflie_pwm")
    assert {"motor_1", "motor_4", "motor_speed_1", "phi", "theta", "psi"} <= set(record.channel_names)
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
