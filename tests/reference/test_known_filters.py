"""The same motion, logged through two chains of filters: with the filters taken off, both logs must agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.clock import resample
from rotorid.spectral.derived import corrected, ratio, selected
from rotorid.spectral.estimate import frequency_response

OMEGA = np.geomspace(1.0, 60.0, 60)
WINDOWS_S = (20.0, 13.0, 8.0, 5.0, 3.0)
AGREED_S = 0.1e-3
"""A thirtieth of the smallest difference between two chains here, and six times what was left of the largest."""


class Pair(NamedTuple):
    """One flight, one channel, two topics that hold it; the lag of one behind the other as logged."""

    log: str
    input: str
    output: str
    instrument: str
    swept_s: tuple[float, float]
    topics: tuple[str, str]
    band_rad_s: tuple[float, float]
    apart_s: float
    sensor_rate_hz: float | None


PAIRS = {
    # The simulator's sensors work at the 250 Hz of its physics.
    "PX4 gyro": Pair(
        "px4_sitl/roll.ulg",
        *("roll_command", "p", "roll_stick", (40.54, 122.54)),
        ("vehicle_angular_velocity", "sensor_combined"),
        (3.0, 48.0),
        3.1e-3,
        250.0,
    ),
    "PX4 accelerometer": Pair(
        "px4_sitl/thrust.ulg.xz",
        *("thrust_command", "az", "thrust_stick", (39.39, 111.39)),
        ("vehicle_acceleration", "sensor_combined"),
        (3.0, 35.0),
        5.2e-3,
        250.0,
    ),
    "ArduPilot gyro": Pair(
        "ardupilot_sitl/x_calm_roll.BIN",
        *("roll_command", "p", "roll_excitation", (94.85, 186.33)),
        ("RATE", "SIDD"),
        (3.0, 60.0),
        10.2e-3,
        None,
    ),
    "ArduPilot accelerometer": Pair(
        "ardupilot_sitl/x_calm_thrust.BIN.xz",
        *("thrust_command", "az", "thrust_excitation", (94.91, 186.40)),
        ("IMU", "SIDD"),
        (3.0, 40.0),
        10.5e-3,
        None,
    ),
}


def without(topic: Topic, name: str) -> Topic:
    rows = [row for row, channel in enumerate(topic.channels) if channel.name != name]
    return replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])


def seen_by(record: FlightRecord, pair: Pair, topic: str) -> tuple[FrequencyResponse, str]:
    """The response with the output out of one topic, and where exactly that is."""
    topics = tuple(t if t.name.startswith(topic) else without(t, pair.output) for t in record.topics)
    (history,) = resample(
        replace(record, topics=topics),
        channels=[pair.input, pair.output],
        auxiliary=[pair.instrument],
        start_s=pair.swept_s[0],
        stop_s=pair.swept_s[1],
        # Both topics on one clock, that of the command.
        sample_rate_hz=250.0 if pair.sensor_rate_hz else 200.0,
    ).histories
    response = frequency_response(
        [history],
        inputs=[pair.input],
        outputs=[pair.output],
        instruments=[pair.instrument],
        omega_rad_s=OMEGA,
        windows_s=WINDOWS_S,
    )
    return selected(response, band_rad_s=pair.band_rad_s), history.channels[1].source


def lag_s(response: FrequencyResponse) -> float:
    """Slope of the phase through zero, by least squares."""
    omega, phase = response.omega_rad_s, np.unwrap(np.angle(response.values[0, 0]))
    return float(-(omega @ phase) / (omega @ omega))


@pytest.fixture(params=PAIRS)
def logged(
    request: pytest.FixtureRequest, unpacked: Callable[[str], Path]
) -> tuple[Pair, FlightRecord, list[tuple[FrequencyResponse, str]]]:
    pair = PAIRS[request.param]
    record = rotorid.read(unpacked(pair.log))
    return pair, record, [seen_by(record, pair, topic) for topic in pair.topics]


def test_both_topics_agree_once_their_filters_are_taken_off(
    logged: tuple[Pair, FlightRecord, list[tuple[FrequencyResponse, str]]],
) -> None:
    pair, record, views = logged
    assert lag_s(ratio(views[0][0], views[1][0])) == pytest.approx(pair.apart_s, abs=0.4e-3)
    fixed = [
        corrected(response, {pair.output: known_filters(record, source, sensor_rate_hz=pair.sensor_rate_hz)})
        for response, source in views
    ]
    assert all(response.processing for response in fixed)
    left = ratio(*fixed)
    assert abs(lag_s(left)) < AGREED_S
    assert np.abs(left.values) == pytest.approx(np.ones_like(left.random_error), abs=0.03)


def test_log_says_which_filters_these_are(
    logged: tuple[Pair, FlightRecord, list[tuple[FrequencyResponse, str]]],
) -> None:
    _, record, views = logged
    for _, source in views:
        assert {finding.kind for finding in filter_findings(record, source)} == {"known_filter"}


def test_real_racer_s_gyro_has_passed_a_low_pass_and_a_notch(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "betaflight" / "smooth_tune.BBL")
    chain = known_filters(record, "gyroADC[0]")
    assert [known.name for known in chain] == ["PT1 low-pass at 90 Hz", "notch at 220 Hz"]
    assert {known.rate_hz for known in chain} == {8000.0}
    # The lag of the PT1, 1 / (2 π 90 Hz), and 0.6 ms of the notch, (f0² − f1²) / (2 π f0² f1) with f1 = 150 Hz.
    assert sum(known.delay_s for known in chain) == pytest.approx(1.768e-3 + 0.568e-3, abs=2e-5)


def test_old_log_does_not_say_how_its_gyro_was_integrated(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "px4" / "sample.ulg")
    assert known_filters(record, "sensor_combined.gyro_rad[0]") == ()
    (finding,) = filter_findings(record, "sensor_combined.gyro_rad[0]")
    assert finding.kind == "unknown_filter"


def test_a_model_without_known_filters_is_that_of_the_vehicle(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"), sandbox=False)
    behind = replace(record, topics=tuple(without(t, "p") if t.name.startswith("SIDD") else t for t in record.topics))
    vehicle = rotorid.identify(behind, "rate.roll", correct_filters=True)
    # Left in, a filter of 20 Hz passes for a lag of motors, which there are none.
    assert vehicle.parameters["T_motor"].status == "dropped"
    gain = vehicle.parameters["L_roll"]
    assert gain.value == pytest.approx(437.2, rel=0.01)
    assert gain.std < 5.0
    # 2.5 ms of the vehicle, less the 1.25 ms by which SIDD is a mean, which RATE is not.
    assert vehicle.delays["p/roll_command"].total_s == pytest.approx(1.3e-3, abs=1e-3)
    assert vehicle.delays["p/roll_command"].known_filters_s is None
    assert vehicle.provenance.sources["p"] == "RATE.R without its known filters"
    assert vehicle.provenance.settings["correct_filters"] is True


def test_filters_are_not_taken_off_a_fit_in_time(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"), sandbox=False)
    with pytest.raises(UsageError, match="correct_filters=True does not work in the time domain"):
        rotorid.identify(record, "rate.roll", method="output_error", correct_filters=True)
