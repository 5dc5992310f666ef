"""Sensors and clocks of flights with known answers: no false warning, known filters explained, planted skews found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import rotorid
from rotorid.data.record import AXES, FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.consistency import ChannelSkew, Consistency, check_consistency, stretches
from rotorid.flights.flights import Flight
from rotorid.flights.segments import cut
from rotorid.signal.airborne import Airborne, airborne
from rotorid.signal.excitations import find_excitations

HEALTHY = (
    *(f"ardupilot_sitl/x_{name}.BIN.xz" for name in ("calm_thrust", "calm_verify", "wind_rollpitch", "wind_yawthrust")),
    *("ardupilot_sitl/x_calm_roll.BIN", "ardupilot/beast_0036.BIN", "betaflight/smooth_tune.BBL", "crazyflie/log10"),
    *(f"px4_sitl/{name}" for name in ("roll.ulg", "pitch.ulg.xz", "yaw.ulg.xz", "thrust.ulg.xz", "verify.ulg.xz")),
    *("px4/zmr250", "px4/s250_2017.ulg", "px4/sample.ulg", "px4/sample_log_small.ulg", "px4/sample_old_1MB.ulg"),
    "px4/sample_logging_tagged_and_default_params.ulg",
    *(f"s500/{axis}_{kind}.csv" for axis in AXES if axis != "thrust" for kind in ("sweeps", "doublets")),
)
SWEPT = Maneuver(axis="roll", kind="sweep", start_s=40.54, stop_s=122.54)
LATE_S = 15e-3


def consistency(record: FlightRecord) -> Consistency:
    flight: Airborne | None
    try:
        flight = airborne(record)
    except InsufficientDataError:
        flight = None
    found = [maneuver for axis in AXES for maneuver in find_excitations(record, axis)]  # type: ignore[arg-type]
    return check_consistency(record, stretches(record, found, flight))


@pytest.fixture(scope="module")
def px4(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("px4_sitl/roll.ulg"), sandbox=False)


@pytest.mark.parametrize("name", HEALTHY)
def test_a_healthy_flight_is_not_warned_about(name: str, unpacked: Callable[[str], Path]) -> None:
    result = consistency(rotorid.read(unpacked(name), sandbox=False))
    assert [finding.message for finding in result.findings if finding.severity != "info"] == []


def same(record: FlightRecord, topic: str) -> ChannelSkew:
    """The roll rate of a topic against the best one."""
    skews = check_consistency(record, stretches(record, [SWEPT])).skews
    (skew,) = (s for s in skews if s.nature == "same_channel" and s.channel == "p" and s.delayed == topic)
    return skew


def test_the_filter_of_a_px4_gyro_is_explained(px4: FlightRecord) -> None:
    skew = same(px4, "sensor_combined")
    assert skew.skew.seconds == pytest.approx(-3.1e-3, abs=0.2e-3)
    assert not skew.suspicious


def test_the_filter_of_an_ardupilot_gyro_is_explained(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"), sandbox=False)
    swept = Maneuver(axis="roll", kind="sweep", start_s=94.85, stop_s=186.33)
    skews = check_consistency(record, stretches(record, [swept])).skews
    late = [s for s in skews if s.channel == "p" and s.delayed in ("RATE", "IMU")]
    assert [s.skew.seconds for s in late] == pytest.approx([10.3e-3, 10.3e-3], abs=0.5e-3)
    assert not any(s.suspicious for s in late)


@pytest.mark.parametrize("seconds", [LATE_S, -LATE_S])
def test_late_stamps_beyond_the_filter_are_found(px4: FlightRecord, seconds: float) -> None:
    topics = (replace(t, time_s=t.time_s + seconds) if t.name == "sensor_combined" else t for t in px4.topics)
    skew = same(replace(px4, topics=tuple(topics)), "sensor_combined")
    assert skew.suspicious
    # Whether the filter works at the rate of the log or at 8 kHz is not known: half a millisecond either way.
    assert skew.unexplained_s == pytest.approx(seconds, abs=0.6e-3)


def test_body_velocities_of_a_flight_are_reconstructed(px4: FlightRecord) -> None:
    (segment,), findings = cut([Flight(px4, SWEPT)], channels=("u", "v", "phi"))
    assert segment.history.names == ("u", "v", "phi")
    assert {finding.where for finding in findings if finding.kind == "reconstructed"} == {"u", "v"}


def test_a_segment_that_reaches_beyond_the_flight_is_cut(px4: FlightRecord) -> None:
    given = Maneuver(axis="roll", kind="other", start_s=5.0, stop_s=122.54, origin="given")
    (segment,), findings = cut([Flight(px4, given)], channels=("roll_command", "p"))
    assert 13.0 < segment.maneuver.start_s < 16.0
    assert [f.severity for f in findings if f.kind == "airborne"] == ["warning"]


SCALE, BIAS_RAD_S, TURN_RAD = 0.02, 0.05, np.radians(2.0)


def with_sensor_errors(record: FlightRecord) -> FlightRecord:
    """A log whose gyros show 2 % too much, 0.05 rad/s beside, and are turned by 2 degrees about z."""
    cosine, sine = np.cos(TURN_RAD), np.sin(TURN_RAD)
    matrix = (1.0 + SCALE) * np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    topics = []
    for topic in record.topics:
        names = [channel.name for channel in topic.channels]
        values = topic.values.copy()
        if {"p", "q", "r"} <= set(names):
            rows = [names.index(name) for name in "pqr"]
            values[rows] = matrix @ values[rows] + BIAS_RAD_S
        topics.append(replace(topic, values=values))
    return replace(record, topics=tuple(topics))


def test_planted_sensor_errors_come_back_and_derivatives_with_them(px4: FlightRecord) -> None:
    clean = rotorid.identify(px4, "rate.roll")
    corrected = rotorid.identify(with_sensor_errors(px4), "rate.roll", correct_sensors=True)
    found = {finding.where: finding.numbers for finding in corrected.findings if finding.kind == "sensor_corrected"}
    truth = {"scale of p": SCALE, "bias of p": BIAS_RAD_S, "p in q": -np.sin(TURN_RAD), "q in p": np.sin(TURN_RAD)}
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 2.0 * found[name]["std"], name
    gain, was = corrected.parameters["L_roll"], clean.parameters["L_roll"]
    # Two percent would be 2.3 of these.
    assert gain.value == pytest.approx(was.value, abs=0.3)
    assert gain.std is not None
    assert was.std is not None
    assert gain.std >= 0.99 * was.std
    assert corrected.provenance.settings["correct_sensors"] is True


PLACE_M = (0.015, -0.015, 0.015)


def displaced(record: FlightRecord) -> FlightRecord:
    """A log whose accelerometer sits 15 mm before, left of and below the place where it flew."""
    gyros = next(topic for topic in record.topics if {"p", "q", "r"} <= {channel.name for channel in topic.channels})
    names = [channel.name for channel in gyros.channels]
    once = np.concatenate([[True], np.diff(gyros.time_s) > 0.0])
    stamps = gyros.time_s[once]
    rates = [CubicSpline(stamps, gyros.values[names.index(name)][once]) for name in "pqr"]
    topics = []
    for topic in record.topics:
        rows = {channel.name: row for row, channel in enumerate(topic.channels)}
        values = topic.values.copy()
        if {"ax", "ay", "az"} <= set(rows):
            inside = np.clip(topic.time_s, stamps[0], stamps[-1])
            turning = np.stack([rate(inside) for rate in rates], axis=1)
            faster = np.stack([rate(inside, 1) for rate in rates], axis=1)
            moved = np.cross(faster, PLACE_M) + np.cross(turning, np.cross(turning, PLACE_M))
            for column, name in enumerate(("ax", "ay", "az")):
                values[rows[name]] += moved[:, column]
        topics.append(replace(topic, values=values))
    return replace(record, topics=tuple(topics))


@pytest.mark.slow
def test_a_planted_place_comes_back_and_derivatives_know_its_error(px4: FlightRecord) -> None:
    """Scale, bias, misalignment and place at once; what is left of them stands in the errors of the derivatives."""
    clean = rotorid.identify(px4, "axis.roll", correct_sensors=True)
    found = rotorid.identify(displaced(with_sensor_errors(px4)), "axis.roll", correct_sensors=True)
    for axis, value in zip("yz", PLACE_M[1:], strict=True):
        name = f"{axis} of accelerometer"
        was, now = (
            next(one.numbers for one in model.findings if (one.kind, one.where) == ("sensor_corrected", name))
            for model in (clean, found)
        )
        # Both are of one flight, and err alike but for what the planted errors do.
        assert abs(now["value"] - was["value"] - value) < 2.0 * now["std"], name
    shapes = found.data.response.sensor_shapes
    assert shapes is not None
    level = np.sqrt(np.sum(np.abs(shapes) ** 2, axis=0))
    assert level[found.data.response.outputs.index("ay")].max() > 0.005
    for name in ("L_roll", "L_p", "L_v", "Y_v", "Y_p", "tau_roll", "T_motor"):
        one, other = found.parameters[name], clean.parameters[name]
        assert one.std is not None
        assert abs(one.value - other.value) < one.std, name


def test_sensors_are_not_corrected_for_a_fit_in_time(px4: FlightRecord) -> None:
    with pytest.raises(UsageError, match="correct_sensors=True does not work in the time domain"):
        rotorid.identify(px4, "rate.roll", method="output_error", correct_sensors=True)
