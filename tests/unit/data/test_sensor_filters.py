"""Filters that the user gives: how they are read, what cannot be, and that they are taken out by value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

import rotorid
from rotorid.data.axes import RATES
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.data.sensor_filters import SensorFilter, parse_filters, with_sensor_filters
from rotorid.errors import UsageError
from rotorid.flights import motor_data
from rotorid.settings.parsing import parse_sensor_filters, write_sensor_filters
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.clock import resample
from rotorid.typing import FloatArray

RATE_HZ = 250.0


def record_of(channels: Mapping[str, FloatArray]) -> FlightRecord:
    rows = np.stack(list(channels.values()))
    topic = Topic(
        name="table",
        time_s=np.arange(rows.shape[1]) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=rows,
    )
    return FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(topic,))


def sweep_record(gyro: SensorFilter | None = None, *, duration_s: float = 40.0) -> FlightRecord:
    """A roll sweep of an open loop, its rate behind a filter that ran at the rate of the log."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    command = 0.1 * np.asarray(chirp(time_s, 0.3, duration_s, 12.0, method="logarithmic"))
    pole = np.exp(-3.0 / RATE_HZ)
    p = lfilter([0.0, 100.0 / 3.0 * (1.0 - pole)], [1.0, -pole], command)
    p = p + 1e-3 * np.random.default_rng(1).standard_normal(time_s.size)
    record = record_of({"roll_command": command, "roll_excitation": command, "p": p})
    if gyro is None:
        return record
    told = with_sensor_filters((record,), {"p": (gyro,)})[0]
    (known,) = known_filters(told, "p")
    filtered = lfilter(known.numerator, known.denominator, p)
    return record_of({"roll_command": command, "roll_excitation": command, "p": filtered})


def test_what_is_written_reads_back_as_the_same() -> None:
    texts = ["az=lp:60.0,delay:0.002", "q=notch:80.0:2.0@1000.0", "p=lp1:30.0"]
    given = parse_sensor_filters(texts)
    assert write_sensor_filters(given) == texts
    assert given["q"] == (SensorFilter(kind="notch", frequency_hz=80.0, quality=2.0, rate_hz=1000.0),)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["az"], "cannot be read; expected CHANNEL=KIND:HZ"),
        (["az=lp"], "cannot be read; expected KIND:HZ"),
        (["az=foo:60"], "unknown filter kind 'foo'"),
        (["az=lp:-60"], "impossible; expected numbers above zero"),
        (["az=lp:nan"], "cannot be read"),
        (["az=notch:80"], "cannot be read"),
        (["az=lp:60@100"], "60 Hz is not below half of the rate of the filter, 100 Hz"),
        (["az=lp:60", "az=lp:50"], "--filter gives az twice"),
    ],
)
def test_what_cannot_be_read_is_named(texts: list[str], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        parse_sensor_filters(texts)


def test_channels_and_frequencies_that_the_log_does_not_have_are_refused() -> None:
    record = record_of({"p": np.zeros(100)})
    with pytest.raises(UsageError, match=r"unknown channel of --filter 'pp'; did you mean p\?"):
        with_sensor_filters((record,), parse_sensor_filters(["pp=lp:60"]))
    with pytest.raises(UsageError, match="150 Hz is not below half of the 250 Hz at which p is logged"):
        with_sensor_filters((record,), parse_sensor_filters(["p=lp:150"]))
    (known,) = with_sensor_filters((record,), parse_sensor_filters(["p=lp:150@1000"]))
    with pytest.raises(UsageError, match="which the mapping gives too"):
        with_sensor_filters((known,), parse_sensor_filters(["p=lp:60"]))


@pytest.mark.parametrize(
    ("text", "delay_s"),
    # √2 / ω of the second order, 1 / ω of the first, √(2^(1/n) − 1) n / ω of n equal ones, 1 / (Q ω) of a notch.
    [
        ("lp:60", np.sqrt(2.0) / (2.0 * np.pi * 60.0)),
        ("lp1:60", 1.0 / (2.0 * np.pi * 60.0)),
        ("pt3:60", 3.0 * np.sqrt(2.0 ** (1.0 / 3.0) - 1.0) / (2.0 * np.pi * 60.0)),
        ("notch:80:2", 1.0 / (2.0 * 2.0 * np.pi * 80.0)),
        ("delay:4ms", 4e-3),
    ],
)
def test_delay_of_a_given_filter_is_that_of_the_analog_one(text: str, delay_s: float) -> None:
    (record,) = with_sensor_filters((record_of({"p": np.zeros(100)}),), {"p": parse_filters(text, of="p")})
    (known,) = known_filters(record, "p")
    # At 8 kHz the digital filter is as good as the analog one: half a sample at most.
    assert known.delay_s == pytest.approx(delay_s, abs=0.5 / 8000.0)
    low = np.array([0.5])
    assert -np.angle(known.response(low))[0] / low[0] == pytest.approx(known.delay_s, rel=1e-3)
    assert [finding.kind for finding in filter_findings(record, "p")] == ["known_filter"]


def test_a_response_returns_to_that_without_the_filter() -> None:
    gyro = SensorFilter(kind="lp", frequency_hz=30.0, rate_hz=RATE_HZ)
    wanted = {"inputs": "roll_command", "outputs": "p"}
    truth = rotorid.response(sweep_record(), **wanted).response
    behind = sweep_record(gyro)
    asked = rotorid.response(behind, **wanted, correct_filters=True)
    given = rotorid.response(behind, **wanted, filters={"p": (gyro,)})
    assert asked.filters_removed == {}
    assert any("Nothing was removed from p" in finding.message for finding in asked.findings)
    removed = given.filters_removed["p"]
    assert removed.filters == ("second-order low-pass at 30 Hz",)
    used = given.used[0, 0]
    assert np.abs(given.response.values[0, 0] / truth.values[0, 0] - 1.0)[used].max() < 0.01
    slope = np.unwrap(np.angle(truth.values[0, 0] / asked.response.values[0, 0]))[used] / truth.omega_rad_s[used]
    assert slope[: slope.size // 4].mean() == pytest.approx(removed.delay_s, rel=0.05)


def test_a_model_without_its_given_filter_has_the_delay_of_the_vehicle() -> None:
    gyro = SensorFilter(kind="lp", frequency_hz=30.0, rate_hz=RATE_HZ)
    behind = sweep_record(gyro)
    plain = rotorid.identify(behind, "rate.roll")
    given = rotorid.identify(behind, "rate.roll", filters={"p": (gyro,)})
    delay_s = given.data.filters_removed["p"].delay_s
    both = [model.delays["p/roll_command"].total_s for model in (plain, given)]
    # One sample of the recursion, and half a sample of a command that is held.
    assert both[1] == pytest.approx(0.5 / RATE_HZ, abs=1e-3)
    assert both[0] - both[1] == pytest.approx(delay_s, rel=0.1)
    assert given["L_roll"].value == pytest.approx(100.0, abs=3.0 * (given["L_roll"].std or 0.0))
    assert given.provenance.settings["filters"] == [f"p=lp:30.0@{RATE_HZ!r}"]


def test_a_mapping_gives_the_filter_of_a_channel(tmp_path: Path) -> None:
    record = sweep_record()
    topic = record.topics[0]
    table = np.vstack([topic.time_s, topic.values]).T
    log = tmp_path / "flight.csv"
    np.savetxt(log, table[:2000], delimiter=",", header="t,cmd,exc,gyro", comments="")
    mapping = tmp_path / "map.toml"
    head = '[clock]\ntime = {source = "t"}\n[channels.roll_command]\nsource = "cmd"\n'
    mapping.write_text(f'{head}[channels.p]\nsource = "gyro"\nfilter = "lp:60,delay:2ms"\n')
    read = rotorid.read(log, mapping=mapping)
    assert [known.name for known in known_filters(read, "gyro")] == ["second-order low-pass at 60 Hz", "delay of 2 ms"]
    assert known_filters(read, "cmd") == ()
    for text, words in (("lp:200", "not below half of the 250 Hz"), ("xx:60", "unknown filter kind 'xx'")):
        mapping.write_text(f'{head}[channels.p]\nsource = "gyro"\nfilter = "{text}"\n')
        with pytest.raises(UsageError, match=words):
            rotorid.read(log, mapping=mapping)


def test_fits_in_time_refuse_a_filter() -> None:
    with pytest.raises(UsageError, match="filters does not work in the time domain"):
        rotorid.identify(sweep_record(), "rate.roll", method="output_error", filters=parse_sensor_filters(["p=lp:60"]))


@pytest.mark.parametrize("method", ["frequency", pytest.param("equation_error", marks=pytest.mark.slow)])
def test_a_model_that_contains_the_filter_of_a_mapping_says_so(method: Literal["frequency", "equation_error"]) -> None:
    (mapped,) = with_sensor_filters(
        (sweep_record(duration_s=20.0),), parse_sensor_filters(["p=lp:60"]), option="the mapping"
    )
    result = rotorid.identify(mapped, "rate.roll", method=method)
    (found,) = (finding for finding in result.findings if finding.kind == "known_filter")
    assert "It was not removed from p; --correct-filters removes it from responses" in found.message


def test_physical_models_need_one_filter_for_all_rates() -> None:
    noise = 1e-3 * np.random.default_rng(2).standard_normal((4, 100))
    record = record_of(dict(zip(("p", "q", "r", "az"), noise, strict=True)))
    (given,) = with_sensor_filters((record,), parse_sensor_filters(["p=lp:60"]))
    part = resample(given, channels=("p", "q", "r", "az"), start_s=0.0, stop_s=0.3).histories[0]
    with pytest.raises(UsageError, match="p and q have different given filters"):
        motor_data._taps(given, part, RATES)


def test_a_filter_that_the_log_has_in_its_parameters_is_refused() -> None:
    record = record_of({"p": np.zeros(100)})
    topic = record.topics[0]
    channel = replace(topic.channels[0], source="vehicle_angular_velocity.xyz[0]")
    logged = replace(
        record,
        source=replace(record.source, format="PX4 ULog"),
        topics=(replace(topic, channels=(channel,)),),
        parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0},
    )
    (told,) = with_sensor_filters((logged,), parse_sensor_filters(["p=lp:40"]))
    with pytest.raises(UsageError, match="by the parameters of the log already"):
        known_filters(told, channel.source)
