"""Consistency: errors planted into a flight of the built-in vehicle are found, each within its bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.cli.commands import fly_roll_sweeps, rotorid

from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.documents.result import result_document
from rotorid.flights.consistency import Consistency, check_consistency, known_words, stretches
from rotorid.identifying.identification import identify
from rotorid.io.registry import read
from rotorid.reviewing.inspection import inspect
from rotorid.settings.identifying import IdentifySettings
from rotorid.signal.excitations import find_excitations
from rotorid.typing import FloatArray

SKEW_S = 3.7e-3
LATE_GYRO_S = 12e-3
BAND = (12.0, 50.0)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    log = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(log)
    return read(log)


def split(record: FlightRecord, name: str, *, seconds: float = 0.0, factor: float = 1.0) -> FlightRecord:
    """The record with one channel in a topic of its own, its stamps late and its values scaled."""
    (clock,) = record.topics
    row = clock.row(name)
    assert row is not None
    others = [index for index in range(len(clock.channels)) if index != row]
    rest = replace(clock, channels=tuple(clock.channels[i] for i in others), values=clock.values[others])
    own = one_channel("late", clock.time_s + seconds, clock.channels[row], factor * clock.values[row])
    return replace(record, topics=(own, rest))


def one_channel(topic: str, time_s: FloatArray, channel: Channel, values: FloatArray) -> Topic:
    return Topic(name=topic, time_s=time_s, channels=(channel,), values=values[None])


def with_second_gyro(record: FlightRecord, seconds: float) -> FlightRecord:
    """The record with a copy of the roll rate on late stamps."""
    (clock,) = record.topics
    row = clock.row("p")
    assert row is not None
    return replace(
        record, topics=(clock, one_channel("other", clock.time_s + seconds, clock.channels[row], clock.values[row]))
    )


def checked(record: FlightRecord) -> Consistency:
    return check_consistency(record, stretches(record, find_excitations(record, "roll")))


def vehicle_s(record: FlightRecord) -> float:
    (skew,) = (s for s in checked(record).skews if s.nature == "vehicle" and s.reference == "roll_command")
    return skew.skew.seconds


def test_a_true_flight_is_not_warned_about(record: FlightRecord) -> None:
    result = checked(record)
    assert [check.channel for _, check in result.checks] == ["p", "ay"]
    assert {finding.severity for finding in result.findings} == {"info"}
    (vehicle,) = (f for f in result.findings if f.kind == "clock_skew")
    assert "one record cannot separate" in vehicle.message


@pytest.mark.parametrize("seconds", [SKEW_S, -SKEW_S])
def test_a_skew_between_command_and_gyro_is_found_as_a_change(record: FlightRecord, seconds: float) -> None:
    change = vehicle_s(split(record, "p", seconds=seconds)) - vehicle_s(record)
    assert change == pytest.approx(seconds, abs=0.3e-3)


def test_a_scale_of_a_gyro_is_found(record: FlightRecord) -> None:
    result = checked(split(record, "p", factor=1.1))
    check = next(check for _, check in result.checks if check.channel == "p")
    assert check.scale == pytest.approx(1.1, abs=4.0 * check.scale_std)
    assert check.scale_std < 0.005
    assert [f.where for f in result.findings if f.severity == "warning"] == ["p"]


def test_a_wrong_sign_of_a_gyro_is_found(record: FlightRecord) -> None:
    check = next(c for _, c in checked(split(record, "p", factor=-1.0)).checks if c.channel == "p")
    assert (check.verdict, check.relation) == ("inconsistent", "opposite")


@pytest.mark.parametrize("seconds", [LATE_GYRO_S, -LATE_GYRO_S])
def test_a_skew_of_stamps_alone_is_warned_about_with_its_remedy(record: FlightRecord, seconds: float) -> None:
    result = checked(with_second_gyro(record, seconds))
    (skew,) = (s for s in result.skews if s.nature == "same_channel")
    assert skew.skew.seconds == pytest.approx(seconds, abs=0.3e-3)
    assert skew.remedy == f"--shift p:{seconds:.4f}"
    (finding,) = (f for f in result.findings if f.severity == "warning")
    assert (finding.kind, skew.remedy in finding.message) == ("clock_skew", True)


def test_a_skew_below_a_sample_is_a_remark(record: FlightRecord) -> None:
    (skew,) = (s for s in checked(with_second_gyro(record, SKEW_S)).skews if s.nature == "same_channel")
    assert skew.skew.seconds == pytest.approx(SKEW_S, abs=0.3e-3)
    assert skew.remedy == ""


def test_a_filter_that_the_log_names_explains_a_skew(record: FlightRecord) -> None:
    """The same stamps, once from a source that is known to be filtered, once from one that is not."""
    late = with_second_gyro(record, LATE_GYRO_S)
    (clock, other) = late.topics
    other = replace(other, channels=(replace(other.channels[0], source="RATE.R"),))
    source = Source(name="a.BIN", format="ArduPilot DataFlash", sha256="a")
    named = replace(late, source=source, topics=(clock, other), parameters={"INS_GYRO_FILTER": 20.0})
    (skew,) = (s for s in checked(named).skews if s.nature == "same_channel")
    # A second-order low-pass at 20 Hz: sqrt(2)/(2 pi 20) s, less half a sample of its rate.
    assert skew.known_s[1] == pytest.approx(np.sqrt(2.0) / (40.0 * np.pi), abs=1e-3)
    assert not skew.suspicious


@pytest.mark.parametrize(
    ("known_s", "seconds", "said"),
    [
        ((0.0, 0.0), 3e-3, "no filter is known"),
        ((3.1e-3, 3.7e-3), 3.2e-3, "known filters explain 3.1 to 3.7 ms"),
        ((-3.7e-3, -3.1e-3), -3.2e-3, "known filters explain 3.1 to 3.7 ms"),
        ((-3.7e-3, -3.1e-3), 3.2e-3, "known filters would shift it by 3.1 to 3.7 ms in the opposite direction"),
        ((-1e-3, 2e-3), 3.2e-3, "known filters explain -1.0 to 2.0 ms"),
    ],
)
def test_what_filters_explain_is_said_in_the_direction_of_the_delay(
    known_s: tuple[float, float], seconds: float, said: str
) -> None:
    assert known_words(*known_s, seconds) == said


def test_the_longest_maneuver_of_an_axis_or_else_the_flight_is_looked_at(record: FlightRecord) -> None:
    short, long = (Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=stop) for stop in (25.0, 60.0))
    assert [(s.axes, s.stop_s) for s in stretches(record, [short, long])] == [(("roll",), 60.0)]
    doublet = Maneuver(axis="roll", kind="doublet", start_s=0.0, stop_s=2.0)
    (whole,) = stretches(record, [doublet])
    assert (whole.axes, whole.start_s) == (("roll", "pitch", "yaw", "thrust"), record.start_s)


def test_inspect_shows_flights_kinematics_and_skews(record: FlightRecord) -> None:
    document = inspect(with_second_gyro(record, LATE_GYRO_S))
    assert [row.channel for row in document.kinematics] == ["p", "ay"]
    assert {row.nature for row in document.skews} == {"same_channel", "vehicle"}
    assert [row.remedy for row in document.skews if row.remedy] == ["--shift p:0.0120"]
    assert document.flights[0].start_s == pytest.approx(record.start_s)


def test_a_log_that_allows_no_check_is_inspected_all_the_same() -> None:
    time_s = np.arange(0.0, 30.0, 0.01)
    lone = one_channel("a", time_s, Channel(name="phi", unit="rad"), np.sin(time_s))
    document = inspect(FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(lone,)))
    assert (document.flights, document.kinematics, document.skews) == ((), (), ())
    assert "does not show when the vehicle flew" in next(f.message for f in document.findings if f.kind == "airborne")


def test_identify_takes_a_skew_out_that_it_is_told(record: FlightRecord) -> None:
    late = split(record, "p", seconds=SKEW_S)
    results = [
        result_document(identify([log], "rate.roll", settings=IdentifySettings(band_rad_s=BAND, shifts=shifts)))
        for log, shifts in ((record, {}), (late, {}), (late, {"p": -SKEW_S}))
    ]
    plain, skewed, mended = (r.parameters["tau_roll"].value + r.parameters["T_motor"].value for r in results)
    assert skewed - plain == pytest.approx(SKEW_S, abs=0.5e-3)
    assert mended == pytest.approx(plain, abs=0.2e-3)
    assert results[2].provenance.settings["shifts"] == [f"p:{-SKEW_S!r}"]
    assert "clock_skew" in {finding.kind for finding in results[2].findings}


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        ("q:0.01", "a shift of q has no effect here"),
        ("p:nan", "CHANNEL:SECONDS"),
        ("p:500", "too long for a maneuver"),
    ],
)
def test_shifts_that_cannot_be_applied_end_with_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, shift: str, says: str
) -> None:
    log = tmp_path_factory.mktemp("shift") / "sweeps.csv"
    fly_roll_sweeps(log)
    ran = rotorid("identify", log, "--model", "rate.roll", "--shift", shift, "--out", log.parent / "out")
    assert ran.code == 2
    assert says in ran.err.replace("\n", " ")
