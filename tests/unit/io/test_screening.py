"""What cannot be is left out of every record and counted; what can be, shocks and mixer inputs beyond one, stays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data import Channel, FlightRecord, Source, Topic
from rotorid.data.ranges import RANGES, range_of
from rotorid.data.record import STANDARD_UNITS
from rotorid.errors import LogError
from rotorid.io.screening import screened
from rotorid.typing import FloatArray

RATE_HZ = 200.0
SAMPLES = 4000
TIME_S = 50.0 + np.arange(SAMPLES) / RATE_HZ


def flight(seed: int = 0, **changed: FloatArray) -> FlightRecord:
    """Twenty seconds of a noisy flight in one topic, some of its channels replaced."""
    rng = np.random.default_rng(seed)
    motion = np.sin(2.0 * np.pi * 0.7 * TIME_S) + 0.3 * np.sin(2.0 * np.pi * 5.0 * TIME_S)
    rows = {
        "p": motion + 0.02 * rng.standard_normal(SAMPLES),
        "az": -9.81 + 1.5 * rng.standard_normal(SAMPLES),
        "roll_command": 0.1 * np.sign(motion) + 0.01 * rng.standard_normal(SAMPLES),
        "motor_1": 0.4 + 0.05 * motion,
        **changed,
    }
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in rows)
    topic = Topic(name="LOG", time_s=TIME_S, channels=channels, values=np.stack(list(rows.values())))
    instruments = {"roll": ("roll_command", "p")}
    return FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,), instruments=instruments)


def spoiled(channel: str, **values: float) -> FlightRecord:
    """The flight with some samples of a channel replaced: ``at_100=1e30``."""
    sound = flight()[channel].values.copy()
    for place, value in values.items():
        sound[int(place.removeprefix("at_"))] = value
    return flight(**{channel: sound})


def kinds(record: FlightRecord) -> list[str]:
    return [finding.kind for finding in record.findings]


def test_a_clean_flight_passes_untouched() -> None:
    record = flight()
    assert screened(record) is record


@pytest.mark.parametrize(
    ("channel", "value"),
    [
        ("p", 1e30),
        ("p", -math.radians(4100.0)),
        ("p", math.inf),
        ("p", 60.0),
        ("p", -9.0),
        ("az", -981.0),
        ("roll_command", 1e9),
        ("roll_command", -9.0),
        ("motor_1", 73.0),
        ("motor_1", -0.4),
    ],
)
def test_one_value_that_cannot_be_is_left_out_and_counted(channel: str, value: float) -> None:
    record = screened(spoiled(channel, at_1234=value))
    (topic,) = record.topics
    kept = np.delete(np.arange(SAMPLES), 1234)
    np.testing.assert_array_equal(topic.time_s, TIME_S[kept])
    np.testing.assert_array_equal(topic.values, flight().topics[0].values[:, kept])
    (finding,) = record.findings
    if math.isfinite(value):
        assert (finding.kind, finding.where, finding.numbers["samples"]) == ("impossible_value", channel, 1.0)
        assert finding.numbers["first_s"] == TIME_S[1234]
    else:
        assert (finding.kind, finding.numbers["lost_samples"]) == ("gap", 1.0)


def test_an_ordinary_value_in_an_odd_place_stays() -> None:
    """Within the noise of its surroundings nothing tells a wrong sample from a right one."""
    record = spoiled("az", at_1234=-5.0)
    assert screened(record) is record


def test_a_mixer_input_beyond_one_stays() -> None:
    command = flight()["roll_command"].values.copy()
    command[1000:1100] = 5.5
    record = flight(roll_command=command)
    assert screened(record) is record


def smooth(**values: float) -> FloatArray:
    """A command of 0.1 at most, some samples replaced: ``at_100=0.6``."""
    noise = 1e-3 * np.random.default_rng(5).standard_normal(SAMPLES)
    command = 0.1 * np.sin(2.0 * np.pi * 0.7 * TIME_S) + noise
    for place, value in values.items():
        command[int(place.removeprefix("at_"))] = value
    return np.asarray(command)


@pytest.mark.parametrize(
    "channel", ["roll_command", "roll_stick", "p_setpoint", "roll_excitation", "motor_1", "p_raw", "motor_speed_1"]
)
def test_jumps_of_a_few_times_the_largest_command_are_left_out_together(channel: str) -> None:
    wrong = smooth(at_500=0.6, at_1234=-0.9, at_2000=0.3, at_3000=0.6)
    record = screened(flight(**{channel: wrong}))
    assert record[channel].values.tolist() == np.delete(wrong, [500, 1234, 2000, 3000]).tolist()
    (finding,) = record.findings
    assert (finding.kind, finding.where, finding.numbers["lone"]) == ("impossible_value", channel, 4.0)


def test_a_jump_within_what_a_command_does_otherwise_stays() -> None:
    record = flight(roll_command=smooth(at_1234=0.18))
    assert screened(record) is record


@pytest.mark.parametrize(("also", "lost"), [(1234, 0), (1240, 1)])
def test_a_jump_of_which_another_message_tells_stays(also: int, lost: int) -> None:
    """A stick that is let go for one sample: the set-point jumps, and the command with it."""
    record = flight(p_setpoint=smooth(at_1234=0.6))
    command = Topic(
        name="OUT",
        time_s=TIME_S + 1e-3,
        channels=(Channel(name="pitch_command", unit=STANDARD_UNITS["pitch_command"]),),
        values=smooth(**{f"at_{also}": 0.18})[None],
    )
    found = screened(FlightRecord(source=record.source, topics=(*record.topics, command)))
    assert found["p_setpoint"].values.size == SAMPLES - lost


@pytest.mark.parametrize("length", [3, 8, 40])
def test_a_shock_of_the_accelerometer_stays(length: int) -> None:
    """A hit rings for several samples, at 200 Hz too."""
    shocked = flight()["az"].values.copy()
    place = np.arange(length)
    shocked[2000 : 2000 + length] += 150.0 * np.exp(-2.0 * place / length) * np.cos(np.pi * place)
    record = flight(az=shocked)
    assert screened(record) is record


def test_a_turn_through_the_end_of_the_circle_stays() -> None:
    psi = np.pi + 0.01 * np.random.default_rng(1).standard_normal(SAMPLES)
    record = flight(psi=np.arctan2(np.sin(psi), np.cos(psi)))
    assert screened(record) is record


def test_two_wrong_set_points_of_different_size_are_left_out() -> None:
    heading = 1.6 + 0.001 * np.random.default_rng(2).standard_normal(SAMPLES)
    heading[[400, 1900]] = 161.0, 0.0
    record = screened(flight(psi_setpoint=heading))
    assert record["psi_setpoint"].values.size == SAMPLES - 2


def test_a_few_stamps_beyond_the_end_of_the_circle_stay() -> None:
    heading = 3.1 + 0.001 * np.random.default_rng(2).standard_normal(SAMPLES)
    heading[[400, 1900]] = -3.15
    record = flight(psi=heading, psi_setpoint=heading)
    assert screened(record) is record


def test_a_channel_that_is_mostly_impossible_is_refused() -> None:
    wrong = flight()["motor_1"].values.copy()
    wrong[:3000] = 1500.0
    record = screened(flight(motor_1=wrong))
    assert "motor_1" not in record
    assert record["p"].values.size == SAMPLES
    (finding,) = record.findings
    assert (finding.kind, finding.where) == ("impossible_value", "motor_1")
    assert "left out as a whole" in finding.message


def test_an_instrument_that_was_refused_is_no_instrument() -> None:
    record = screened(flight(roll_command=np.full(SAMPLES, np.nan)))
    assert record.instruments == {"roll": ("p",)}


def test_a_channel_with_many_bad_samples_stands_alone() -> None:
    wrong = flight()["motor_1"].values.copy()
    wrong[::10] = 73.0
    record = screened(flight(motor_1=wrong))
    assert record["p"].values.size == SAMPLES
    assert record["motor_1"].values.size == SAMPLES - SAMPLES // 10


def test_volts_and_microseconds_have_no_bound() -> None:
    topic = Topic(
        name="LOG", time_s=TIME_S, channels=(Channel(name="motor_1", unit="V"),), values=np.full((1, SAMPLES), 12.0)
    )
    record = FlightRecord(source=Source(name="a.mat", format="MAT", sha256=""), topics=(topic,))
    assert screened(record) is record


@pytest.mark.parametrize(
    ("stamps", "lost"),
    [
        ({1000: 0.0}, {1000}),
        ({1000: 3e12}, {1000}),
        ({1000: TIME_S[1000] - 6.0}, {1000}),
        ({1000: TIME_S[1000] + 6.0}, {1000}),
        ({1000: math.nan}, {1000}),
        ({0: 0.0}, {0}),
        ({1: 0.0}, {1}),
        ({SAMPLES - 2: 3e12}, {SAMPLES - 2}),
        ({0: 3e12}, {0}),
        ({SAMPLES - 1: 3e12}, {SAMPLES - 1}),
        ({SAMPLES - 1: 0.0}, {SAMPLES - 1}),
        ({100: 0.0, 2000: 9e9, 3000: 1.0}, {100, 2000, 3000}),
        ({100: 0.0, 101: 0.0, 102: 0.0}, {100, 101, 102}),
    ],
)
def test_a_stamp_that_cannot_be_is_left_out_and_counted(stamps: dict[int, float], lost: set[int]) -> None:
    record = flight()
    time_s = TIME_S.copy()
    for place, stamp in stamps.items():
        time_s[place] = stamp
    topic = record.topics[0]
    broken = Topic(name="LOG", time_s=time_s, channels=topic.channels, values=topic.values)
    found = screened(FlightRecord(source=record.source, topics=(broken,)))
    kept = np.delete(np.arange(SAMPLES), list(lost))
    np.testing.assert_array_equal(found.topics[0].time_s, TIME_S[kept])
    (finding,) = found.findings
    assert (finding.kind, finding.numbers["samples"]) == ("clock_disorder", float(len(lost)))


def test_a_clock_that_starts_anew_keeps_its_longer_part() -> None:
    record = flight()
    topic = record.topics[0]
    time_s = np.concatenate([TIME_S[:1000], TIME_S[: SAMPLES - 1000] - 1e-3])
    broken = Topic(name="LOG", time_s=time_s, channels=topic.channels, values=topic.values)
    found = screened(FlightRecord(source=record.source, topics=(broken,)))
    assert found.topics[0].time_s.size == SAMPLES - 1000


@pytest.mark.parametrize(("repeated", "severity"), [(slice(None), "warning"), (slice(7, 8), "info")])
def test_of_stamps_that_repeat_the_first_sample_stays(repeated: slice, severity: str) -> None:
    record = flight()
    topic = record.topics[0]
    kept = np.ones(SAMPLES, dtype=bool)
    kept[1::2][repeated] = False
    time_s = TIME_S.copy()
    time_s[~kept] = TIME_S[np.flatnonzero(~kept) - 1]
    doubled = Topic(name="LOG", time_s=time_s, channels=topic.channels, values=topic.values)
    found = screened(FlightRecord(source=record.source, topics=(doubled,)))
    assert found.topics[0].time_s.tolist() == TIME_S[kept].tolist()
    assert np.array_equal(found.topics[0].values, topic.values[:, kept])
    (finding,) = found.findings
    assert (finding.kind, finding.severity) == ("clock_disorder", severity)
    assert finding.numbers["samples"] == np.sum(~kept)


@pytest.mark.parametrize("far_s", [1e10, -1e10, 2.0**64, 1e300, np.inf, np.nan])
def test_stamps_that_no_clock_can_say_are_left_out(far_s: float) -> None:
    record = flight()
    topic = record.topics[0]
    time_s = TIME_S.copy()
    time_s[::3] = far_s
    broken = Topic(name="LOG", time_s=time_s, channels=topic.channels, values=topic.values)
    found = screened(FlightRecord(source=record.source, topics=(broken,)))
    assert found.topics[0].time_s.tolist() == np.delete(TIME_S, slice(None, None, 3)).tolist()
    assert kinds(found) == ["clock_disorder"]


def test_a_jump_of_the_clock_is_a_gap_and_both_parts_stay() -> None:
    record = flight()
    topic = record.topics[0]
    time_s = TIME_S + np.where(np.arange(SAMPLES) < SAMPLES // 2, 0.0, 2e5)
    jumped = Topic(name="LOG", time_s=time_s, channels=topic.channels, values=topic.values)
    found = screened(FlightRecord(source=record.source, topics=(jumped,)))
    assert found.topics[0].time_s.size == SAMPLES
    (finding,) = found.findings
    assert (finding.kind, finding.where) == ("gap", "log")
    assert finding.numbers["longest_s"] == pytest.approx(2e5, rel=1e-3)


def test_one_sample_far_from_the_log_is_no_part_of_it() -> None:
    """A topic that was never published carries the stamp zero."""
    lone = Topic(
        name="manual_control_setpoint", time_s=[0.0], channels=(Channel(name="roll_stick", unit="1"),), values=[[0.0]]
    )
    record = flight()
    found = screened(FlightRecord(source=record.source, topics=(*record.topics, lone)))
    assert found.start_s == TIME_S[0]
    assert kinds(found) == ["clock_disorder"]


def test_a_log_without_samples_holds_no_flight() -> None:
    with pytest.raises(LogError, match="contains no flight"):
        screened(FlightRecord(source=Source(name="a.BIN", format="", sha256=""), topics=()))


def test_every_standard_channel_has_a_range_around_zero() -> None:
    assert set(RANGES) <= set(STANDARD_UNITS)
    assert set(STANDARD_UNITS) - set(RANGES) == set()
    assert all(low <= 0.0 < high for low, high in RANGES.values())
    assert range_of(Channel(name="mine", unit="1")) is None


def test_every_reader_passes_the_screen(tmp_path: Path) -> None:
    lines = [f"{stamp:.4f},{0.01 * math.sin(stamp):.6f}" for stamp in TIME_S.tolist()]
    lines[77] = f"{TIME_S[77]:.4f},1e30"
    path = tmp_path / "flight.csv"
    path.write_text("\n".join(["time [s],q [rad/s]", *lines]))
    record = rotorid.read(path)
    assert record["q"].values.size == SAMPLES - 1
    assert kinds(record) == ["impossible_value"]


def moving(still: slice) -> rotorid.FlightRecord:
    """Ten seconds of a gyro at 100 Hz that hangs for a while."""
    values = np.random.default_rng(3).standard_normal(1000)
    values[still] = values[still][0]
    topic = Topic(
        name="gyro", time_s=np.arange(1000) / 100.0, channels=(Channel(name="p", unit="rad/s"),), values=values[None]
    )
    return screened(rotorid.FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,)))


def test_a_sensor_that_hangs_amid_motion_is_left_out() -> None:
    record = moving(slice(400, 500))
    assert len(record["p"]) == 901
    assert [finding.kind for finding in record.findings] == ["frozen_sensor"]
    assert record.findings[0].numbers["samples"] == 99


@pytest.mark.parametrize("rest", [slice(0, 200), slice(700, 1000), slice(400, 420)])
def test_rest_before_and_behind_motion_is_no_fault(rest: slice) -> None:
    assert moving(rest).findings == ()


def test_a_channel_that_changes_rarely_does_not_hang() -> None:
    values = np.repeat(np.arange(10.0), 100)
    topic = Topic(
        name="slow", time_s=np.arange(1000) / 100.0, channels=(Channel(name="p", unit="rad/s"),), values=values[None]
    )
    assert (
        screened(rotorid.FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))).findings
        == ()
    )
