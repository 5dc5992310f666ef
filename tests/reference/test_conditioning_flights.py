"""Conditioning on flights with known answers: consistent sensors, known filters, injected skews."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import rotorid
from rotorid.data.record import FlightRecord, Maneuver, TimeHistory
from rotorid.signal.airborne import airborne
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import kinematic_consistency
from rotorid.signal.quality import battery_sag, quality_findings
from rotorid.signal.skew import TimeSkew, time_skew

EULER = ("phi", "theta", "psi", "p", "q", "r")
SWEPT_S = (40.54, 122.54)
SKEW_S = 3.7e-3


@pytest.fixture(scope="module")
def px4(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("px4_sitl/roll.ulg"))


@pytest.fixture(scope="module")
def ardupilot(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"))


def on_one_clock(record: FlightRecord, channels: tuple[str, ...], start_s: float, stop_s: float) -> TimeHistory:
    return resample(record, channels=channels, start_s=start_s, stop_s=stop_s).histories[0]


def without(record: FlightRecord, topic: str) -> FlightRecord:
    return replace(record, topics=tuple(other for other in record.topics if other.name != topic))


def late(record: FlightRecord, topic: str, seconds: float) -> FlightRecord:
    """The record with the stamps of one topic moved."""
    topics = (replace(t, time_s=t.time_s + seconds) if t.name == topic else t for t in record.topics)
    return replace(record, topics=tuple(topics))


def test_px4_gyro_and_attitude_agree_but_for_the_filter(px4: FlightRecord) -> None:
    filtered, raw = (
        {check.channel: check for check in kinematic_consistency(on_one_clock(record, EULER, *SWEPT_S)).checks}
        for record in (px4, without(px4, "vehicle_angular_velocity"))
    )
    assert set(filtered) == set(raw) == {"p", "q", "r"}
    for name in ("p", "q", "r"):
        assert abs(filtered[name].scale - 1.0) <= 3.0 * filtered[name].scale_std + 0.005
        assert abs(raw[name].scale - 1.0) <= 3.0 * raw[name].scale_std + 0.005
    # The 40 Hz filter of the gyro delays by 3.1 ms.
    assert filtered["p"].lag_s - raw["p"].lag_s == pytest.approx(3.1e-3, abs=0.3e-3)


def motor_to_gyro(record: FlightRecord) -> TimeSkew:
    return time_skew(
        on_one_clock(record, ("roll_command", "p"), *SWEPT_S),
        reference="roll_command",
        delayed="p",
        band_rad_s=(3.0, 60.0),
        relation="integral",
        known_lag_s=0.048,
    )


@pytest.mark.parametrize("seconds", [SKEW_S, -SKEW_S])
def test_px4_skew_between_command_and_gyro_is_found(px4: FlightRecord, seconds: float) -> None:
    before, after = motor_to_gyro(px4), motor_to_gyro(late(px4, "vehicle_angular_velocity", seconds))
    assert after.seconds - before.seconds == pytest.approx(seconds, abs=0.3e-3)


def with_raw_gyro(record: FlightRecord) -> FlightRecord:
    """The record with the unfiltered roll rate under a name of its own."""
    topics = (
        replace(t, channels=tuple(replace(c, name="p_raw") if c.name == "p" else c for c in t.channels))
        if t.name == "sensor_combined"
        else t
        for t in record.topics
    )
    return replace(record, topics=tuple(topics))


@pytest.mark.parametrize("seconds", [0.0, SKEW_S])
def test_px4_skew_between_two_gyros_is_found_in_one_record(px4: FlightRecord, seconds: float) -> None:
    history = on_one_clock(late(with_raw_gyro(px4), "vehicle_angular_velocity", seconds), ("p_raw", "p"), *SWEPT_S)
    skew = time_skew(history, reference="p_raw", delayed="p", band_rad_s=(3.0, 60.0))
    assert skew.relation == "same"
    # The 40 Hz filter of one of them delays by 3.1 ms.
    assert skew.seconds == pytest.approx(3.1e-3 + seconds, abs=0.3e-3)


def test_ardupilot_gyro_and_attitude_agree(ardupilot: FlightRecord) -> None:
    result = kinematic_consistency(on_one_clock(ardupilot, EULER, 94.85, 186.33))
    (roll,) = (check for check in result.checks if check.channel == "p")
    assert roll.scale == pytest.approx(1.0, abs=0.01)
    assert abs(roll.lag_s) <= 1.0 / 200.0
    assert {finding.kind for finding in result.findings if finding.where == "p"} == {"kinematic_consistency"}


def test_ardupilot_delay_from_mixer_to_gyro(ardupilot: FlightRecord) -> None:
    # No motor lag here; 2.4 to 2.5 ms of delay, and a damping of 2 1/s that leads at the slow end.
    skew = time_skew(
        on_one_clock(ardupilot, ("roll_command", "p"), 94.85, 186.33),
        reference="roll_command",
        delayed="p",
        band_rad_s=(20.0, 120.0),
    )
    assert skew.relation == "integral"
    assert skew.seconds == pytest.approx(2.4e-3, abs=0.8e-3)


@pytest.mark.parametrize(("log", "start_s", "stop_s"), [("prbs", 50.0, 76.0), ("sweep", 132.9, 158.0)])
def test_rig_pitch_and_its_rate_agree(shared_data: Path, log: str, start_s: float, stop_s: float) -> None:
    record = rotorid.read(shared_data / f"antx/{log}.mat", mapping=shared_data / "antx/map.toml")
    result = kinematic_consistency(on_one_clock(record, ("theta", "q"), start_s, stop_s))
    (check,) = result.checks
    assert check.scale == pytest.approx(1.0, abs=0.01)
    assert abs(check.lag_s) <= 0.3e-3
    assert [finding.kind for finding in result.findings] == ["kinematic_consistency"]


def test_flights_contain_their_maneuvers(px4: FlightRecord, ardupilot: FlightRecord) -> None:
    for record, swept in ((px4, SWEPT_S), (ardupilot, (94.85, 264.90))):
        start_s, stop_s = airborne(record).longest
        assert record.start_s < start_s < swept[0]
        assert swept[1] < stop_s <= record.stop_s


def test_a_simulated_sweep_is_clean(px4: FlightRecord) -> None:
    history = on_one_clock(px4, ("roll_command", "p", "motor_1", "motor_2", "motor_3", "motor_4"), *SWEPT_S)
    assert quality_findings(history, axis="roll") == ()
    sag = battery_sag(px4, Maneuver(axis="roll", kind="sweep", start_s=SWEPT_S[0], stop_s=SWEPT_S[1]))
    assert sag is not None
    assert sag.severity == "info"
