"""Value objects: frozen, arrays private and read-only, and still so after pickling and copying."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Mapping
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest

from rotorid.data.findings import Finding
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.models.state_space import StateSpace
from rotorid.units import UNITS

ROLL = Channel(name="roll_command", unit="1", source="SIDD.Tar")
RATE = Channel(name="p", unit="rad/s")


def topic() -> Topic:
    return Topic(name="SIDD", time_s=np.arange(5.0), channels=(ROLL, RATE), values=np.arange(10.0).reshape(2, 5))


def history() -> TimeHistory:
    return TimeHistory(values=np.ones((2, 5)), channels=(ROLL, RATE), sample_rate_hz=10.0, start_s=3.0)


def finding() -> Finding:
    return Finding(kind="gap", severity="info", where="p", message="A gap.", numbers={"gaps": 1})


def record() -> FlightRecord:
    return FlightRecord(
        source=Source(name="a.BIN", format="dataflash", sha256="0" * 64),
        topics=(topic(),),
        parameters={"ATC_RAT_RLL_P": 0.1},
        instruments={"roll": ("roll_excitation",)},
        findings=(finding(),),
    )


def response() -> FrequencyResponse:
    return FrequencyResponse(
        omega_rad_s=np.array([1.0, 2.0, 3.0]),
        values=np.ones((1, 1, 3)),
        coherence=np.ones((1, 1, 3)),
        random_error=np.zeros((1, 1, 3)),
        covariance=np.zeros((1, 1, 3, 3)),
        inputs=("roll_command",),
        outputs=("p",),
        estimate="direct",
    )


def state_space() -> StateSpace:
    one = np.ones((1, 1))
    zero = np.zeros(1)
    return StateSpace(M=one, F=-one, G=one, H0=one, H1=0.0 * one, input_delays_s=zero, output_delays_s=zero)


def solution() -> Solution:
    return Solution(
        theta=np.ones(2),
        cost=1.0,
        outcome=Outcome.CONVERGED,
        residual=np.ones(4),
        jacobian=np.ones((4, 2)),
        evaluations=3,
        trace=(2.0, 1.0),
        at_bound=(False, False),
    )


MAKERS: tuple[Callable[[], Any], ...] = (topic, history, finding, record, response, state_space, solution)
WITH_ARRAYS = (topic, history, response, state_space, solution)


def arrays_of(value: Any) -> dict[str, np.ndarray]:
    return {f.name: getattr(value, f.name) for f in fields(value) if isinstance(getattr(value, f.name), np.ndarray)}


@pytest.mark.parametrize("make", MAKERS)
def test_fields_cannot_be_set(make: Callable[[], Any]) -> None:
    value = make()
    for field in fields(value):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field.name, None)


@pytest.mark.parametrize("make", WITH_ARRAYS)
@pytest.mark.parametrize(
    "through", [lambda v: v, copy.copy, copy.deepcopy, lambda v: pickle.loads(pickle.dumps(v)), replace]
)
def test_arrays_are_read_only_and_survive(make: Callable[[], Any], through: Callable[[Any], Any]) -> None:
    value = make()
    again = through(value)
    assert arrays_of(again)
    for name, array in arrays_of(again).items():
        assert array.dtype == arrays_of(value)[name].dtype
        np.testing.assert_array_equal(array, arrays_of(value)[name])
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_a_copied_record_is_frozen_all_the_way_down() -> None:
    again = pickle.loads(pickle.dumps(record()))
    assert again.source == record().source
    assert again.parameters == record().parameters
    assert again.findings == record().findings
    assert not again.topics[0].values.flags.writeable
    for mapping in (again.parameters, again.instruments, again.findings[0].numbers):
        with pytest.raises(TypeError):
            mapping["x"] = 1.0


def test_arrays_are_copied_in() -> None:
    values, time_s = np.zeros((1, 4)), np.arange(4.0)
    made = Topic(name="t", time_s=time_s, channels=(ROLL,), values=values)
    values[:], time_s[:] = 7.0, 7.0
    np.testing.assert_array_equal(made.values, np.zeros((1, 4)))
    np.testing.assert_array_equal(made.time_s, np.arange(4.0))
    assert values.flags.writeable


def test_mappings_are_copied_in() -> None:
    parameters = {"A": 1.0}
    made = replace(record(), parameters=parameters)
    parameters["A"] = 2.0
    assert made.parameters["A"] == 1.0


@pytest.mark.parametrize(
    "make", [*MAKERS, lambda: ROLL, lambda: Maneuver(axis="roll", kind="sweep", start_s=0, stop_s=1)]
)
def test_a_misspelt_keyword_and_a_position_are_refused(make: Callable[[], Any]) -> None:
    value = make()
    state = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
    with pytest.raises(TypeError, match="misspelt"):
        type(value)(**state, misspelt=1)
    with pytest.raises(TypeError, match="positional"):
        type(value)(*state.values())


@pytest.mark.parametrize(
    ("make", "change", "message"),
    [
        (history, {"values": np.zeros(5)}, r"2 dimensions is required, not shape \(5,\)"),
        (history, {"values": np.zeros((3, 5))}, "2 channels are named but there are 3 rows"),
        (history, {"sample_rate_hz": 0.0}, "must be positive, not 0.0 Hz"),
        (history, {"sample_rate_hz": float("nan")}, "must be positive"),
        (topic, {"values": np.zeros((5, 2))}, r"values of shape \(5, 2\)"),
        (topic, {"time_s": np.arange(4.0)}, "2 channels and 4 time stamps"),
        (topic, {"time_s": np.zeros((1, 5))}, "1 dimension"),
        (response, {"values": np.ones((1, 3))}, "3 dimensions"),
        (response, {"coherence": np.ones((1, 1, 2))}, "coherence must have shape"),
        (response, {"random_error": np.ones((1, 2, 3))}, "random_error must have shape"),
        (response, {"covariance": np.ones((1, 1, 3, 2))}, "covariance must have shape"),
        (response, {"outputs": ("p", "q")}, "shape"),
    ],
)
def test_wrong_shapes_are_refused(make: Callable[[], Any], change: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(make(), **change)


@pytest.mark.parametrize(("start_s", "stop_s"), [(1.0, 1.0), (2.0, 1.0), (0.0, float("nan"))])
def test_a_maneuver_takes_time(start_s: float, stop_s: float) -> None:
    with pytest.raises(ValueError, match="stop after it starts"):
        Maneuver(axis="roll", kind="sweep", start_s=start_s, stop_s=stop_s)


def test_numbers_of_findings_are_floats() -> None:
    numbers: dict[str, Any] = {"samples": np.int64(3), "flag": True, "share": np.float32(0.5)}
    made = Finding(kind="gap", severity="info", where="p", message="m", numbers=numbers)
    assert dict(made.numbers) == {"samples": 3.0, "flag": 1.0, "share": 0.5}
    assert {type(value) for value in made.numbers.values()} == {float}


def test_a_history_counts_time_on_the_clock_of_the_log() -> None:
    made = history()
    np.testing.assert_array_equal(made.time_s, 3.0 + np.arange(5) / 10.0)
    assert made.duration_s == 0.5
    assert made.names == ("roll_command", "p")
    with pytest.raises(KeyError, match="no channel 'q'; there are roll_command, p"):
        made["q"]


def test_the_rate_of_a_topic_ignores_disorder() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 0.2, 0.3, 0.15, 0.4, 9.0])
    made = Topic(name="t", time_s=stamps, channels=(RATE,), values=np.zeros((1, 8)))
    assert made.sample_rate_hz == pytest.approx(10.0)
    assert Topic(name="t", time_s=stamps[:1], channels=(RATE,), values=np.zeros((1, 1))).sample_rate_hz == 0.0


def test_a_record_prefers_its_earlier_topics() -> None:
    second = Topic(name="RATE", time_s=np.array([-1.0, 9.0]), channels=(RATE,), values=np.zeros((1, 2)))
    made = replace(record(), topics=(topic(), second))
    assert made.channel_names == ("roll_command", "p")
    assert [(held.name, row) for held, row in made.holding("p")] == [("SIDD", 1), ("RATE", 0)]
    assert (made.start_s, made.stop_s) == (-1.0, 9.0)


def test_the_vocabulary_is_in_si() -> None:
    for name, unit in STANDARD_UNITS.items():
        assert UNITS[unit].factor == 1.0, name
    with pytest.raises(TypeError):
        STANDARD_UNITS["p"] = "deg/s"  # type: ignore[index]
