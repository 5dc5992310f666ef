"""How exactly a log says when a value was taken."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.signal.stamps import SAME_TURN_SAMPLES, clock_error_s, stamp_jitter_s

STEP_S = 0.0025
EVEN = STEP_S * np.arange(800)
WHOLE = [(0.0, 2.0)]


def topic(name: str, channel: str, time_s: np.ndarray) -> Topic:
    unit = "1" if channel.endswith("command") else "rad/s"
    return Topic(
        name=name, time_s=time_s, channels=(Channel(name=channel, unit=unit),), values=np.zeros((1, time_s.size))
    )


def log(command: np.ndarray, rate: np.ndarray, form: str = "ArduPilot DataFlash") -> FlightRecord:
    topics = (topic("RATE", "roll_command", command), topic("SIDD", "p", rate))
    return FlightRecord(source=Source(name="log", format=form, sha256=""), topics=topics)


@pytest.mark.parametrize("jitter_s", [0.0, 2e-5, 1e-4, 4e-4])
def test_jitter_comes_back(jitter_s: float) -> None:
    rng = np.random.default_rng(3)
    stamps = np.delete(EVEN + jitter_s * rng.standard_normal(EVEN.size), rng.choice(EVEN.size, 20, replace=False))
    assert stamp_jitter_s(stamps) == pytest.approx(jitter_s, rel=0.1, abs=1e-12)


def test_few_stamps_show_no_jitter() -> None:
    assert stamp_jitter_s(EVEN[:10]) == math.inf


def test_stamps_of_one_turn_are_exact() -> None:
    found = clock_error_s(log(EVEN, EVEN), ("roll_command", "p"), WHOLE)
    assert found == pytest.approx(SAME_TURN_SAMPLES * STEP_S)


def test_jitter_counts() -> None:
    late = EVEN + 0.05 * STEP_S * np.random.default_rng(1).standard_normal(EVEN.size)
    found = clock_error_s(log(late, late), ("roll_command", "p"), WHOLE)
    assert found == pytest.approx(STEP_S * math.hypot(SAME_TURN_SAMPLES, 0.05), rel=0.1)


@pytest.mark.parametrize(
    "record",
    [
        pytest.param(log(EVEN, EVEN, "CSV"), id="a table"),
        pytest.param(log(EVEN, EVEN, "PX4 ULog"), id="modules that stamp on their own"),
        pytest.param(log(EVEN, EVEN + 0.3 * STEP_S), id="two clocks"),
        pytest.param(log(EVEN[:10], EVEN[:10]), id="few stamps"),
    ],
)
def test_a_clock_that_cannot_be_checked_has_its_prior(record: FlightRecord) -> None:
    assert clock_error_s(record, ("roll_command", "p"), WHOLE) is None


def test_the_slowest_channel_sets_the_step() -> None:
    found = clock_error_s(log(EVEN, EVEN[::4]), ("roll_command", "p"), WHOLE)
    assert found == pytest.approx(SAME_TURN_SAMPLES * 4.0 * STEP_S)


def test_what_is_not_logged_has_no_stamps() -> None:
    found = clock_error_s(log(EVEN, EVEN), ("roll_command", "p", "u_dot"), WHOLE)
    assert found is None


def test_the_largest_error_counts() -> None:
    slow = log(EVEN, np.concatenate([EVEN[:400], EVEN[400::2]]))
    found = clock_error_s(slow, ("roll_command", "p"), [(0.0, 0.99), (1.01, 2.0)])
    assert found == pytest.approx(SAME_TURN_SAMPLES * 2.0 * STEP_S)
