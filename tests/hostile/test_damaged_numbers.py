"""A number in a log that is none is unknown to every verb, and ends none of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.flying.designs import plan_with
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.io.registry import read, write_log
from rotorid.loops.responses import response
from rotorid.reviewing.assembly import review
from rotorid.reviewing.inspection import inspect
from rotorid.simulation.multirotor_flight import fly_multirotor


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    """A short sweep of roll."""
    path = tmp_path_factory.mktemp("sweep") / "sweep.BIN"
    plan = PlanSettings(
        shape="logarithmic_sweep", axes=("roll",), duration_s=20.0, band_rad_s=(0.6, 60.0), entry="command"
    )
    craft = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=plan).aircraft
    write_log(path, fly_multirotor(craft, plan_with(craft, plan, {"roll": 0.05}), seed=5), format="bin")
    return read(path)


def damaged(record: FlightRecord, name: str) -> FlightRecord:
    """The log without one sound sample of a channel."""
    topics = []
    for topic in record.topics:
        row, values = topic.row(name), np.array(topic.values)
        if row is not None:
            values[row] = np.nan
        topics.append(replace(topic, values=values))
    return replace(record, topics=tuple(topics))


@pytest.mark.parametrize("name", ["SCHED_LOOP_RATE", "MOT_THST_EXPO", "MOT_SPIN_MIN"])
def test_a_parameter_that_is_no_number(flight: FlightRecord, name: str) -> None:
    assert name in flight.parameters
    ends_no_verb(flight, name)


@pytest.mark.parametrize("name", ["INS_GYRO_RATE", "FRAME_CLASS", "LOG_BITMASK"])
def test_a_parameter_that_names_or_counts_and_is_no_number(flight: FlightRecord, name: str) -> None:
    # The rate counts where the sensor is read faster.
    ends_no_verb(replace(flight, parameters={**flight.parameters, "INS_FAST_SAMPLE": 1.0}), name)


def ends_no_verb(flight: FlightRecord, name: str) -> None:
    record = replace(flight, parameters={**flight.parameters, name: float("nan")})
    assert "rate.roll" in inspect(record).supports
    assert review(record, models=False).flight.flights


@pytest.mark.parametrize("name", ["roll_command", "thrust_command"])
def test_a_channel_without_a_sound_sample(flight: FlightRecord, name: str) -> None:
    record = damaged(flight, name)
    assert "rate.roll" in inspect(record).supports
    numbers = review(record, models=False).motors.numbers
    assert "saturated_high_share" in numbers
    assert not any(one.startswith("saturated_by_") for one in numbers)


def test_a_gain_that_is_no_number_leaves_the_whole_loop_and_says_why(flight: FlightRecord) -> None:
    record = replace(flight, parameters={**flight.parameters, "ATC_RAT_RLL_P": float("nan")})
    loop = response(record, inputs=["roll_command"], outputs=["p"]).loops["roll"]
    assert (loop.scope, loop.whole) == ("whole", None)
    assert loop.method == (
        "measured with roll_excitation, all loops closed; no rate loop: the log has no known gains for the roll "
        "controller"
    )
