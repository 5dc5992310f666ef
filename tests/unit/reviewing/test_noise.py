"""Noise of flights whose rotors, frame, filters and terms are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter
from tests.unit.reviewing.test_motors import record

from rotorid.data.record import Channel, FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.noise import noise
from rotorid.reviewing.values import NoiseReview
from rotorid.typing import FloatArray

RATE_HZ = 1000.0
FRAME_HZ = 190.0
DELAY_SAMPLES = 3


def flown(*, speeds: bool, seconds: float = 26.0, seed: int = 1) -> FlightRecord:
    """Rotors at 60 + 160·throttle turns a second with two harmonics, a frame at 190 Hz, both in white noise.

    The gyro behind its filters is the one before, three milliseconds later; its set-point is known.
    """
    rng, count = np.random.default_rng(seed), round(seconds * RATE_HZ)
    time_s = np.arange(count) / RATE_HZ
    throttle = 0.45 + 0.25 * np.sin(2.0 * np.pi * time_s / 13.0)
    columns: dict[str, FloatArray] = {}
    lines = 0.3 * np.sin(2.0 * np.pi * FRAME_HZ * time_s)
    for number in range(1, 5):
        turns = 60.0 + 160.0 * throttle + 1.5 * number
        phase = 2.0 * np.pi * np.cumsum(turns) / RATE_HZ + number
        lines = lines + 0.2 * np.sin(phase) + 0.3 * np.sin(2.0 * phase)
        columns[f"motor_{number}"] = throttle
        if speeds:
            columns[f"motor_speed_{number}"] = 2.0 * np.pi * turns
    asked = lfilter([0.02], [1.0, -0.98], rng.normal(size=count))
    for rate in ("p", "q", "r"):
        raw = asked + lines + 0.1 * rng.normal(size=count)
        columns[f"{rate}_raw"] = raw
        columns[rate] = np.concatenate([np.zeros(DELAY_SAMPLES), raw[:-DELAY_SAMPLES]])
        columns[f"{rate}_setpoint"] = asked
    columns["roll_p_term"] = 0.02 * (columns["p_setpoint"] - columns["p"])
    columns["roll_d_term"] = -0.0001 * np.gradient(columns["p"], 1.0 / RATE_HZ)
    for name in ("ax", "ay", "az"):
        columns[name] = (-9.81 if name == "az" else 0.0) + 0.5 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 120.0 * time_s)
    return record(columns, RATE_HZ, "Betaflight blackbox", parameters={"acc_lpf_hz": 0.0})


@pytest.fixture(scope="module")
def with_speeds() -> FlightRecord:
    return flown(speeds=True)


@pytest.fixture(scope="module")
def found(with_speeds: FlightRecord) -> NoiseReview:
    return noise(with_speeds)[0]


def test_peaks_are_named_by_the_speed_of_the_rotors(found: NoiseReview) -> None:
    mine = [peak for peak in found.peaks if peak.channel == "p"]

    assert {peak.harmonic for peak in mine if peak.source == "rotor"} <= {1, 2}
    second = next(peak for peak in mine if peak.harmonic == 2)
    assert second.frequency_hz.lower > 2.0 * 80.0
    assert second.frequency_hz.upper < 2.0 * 190.0
    assert "twice the rotors' speed" in second.sentence


def test_peaks_are_named_by_their_movement_where_no_speed_is_known() -> None:
    found, _ = noise(flown(speeds=False))
    mine = {peak.source: peak for peak in reversed(found.peaks) if peak.channel == "p"}

    assert mine["frame"].frequency_hz.value == pytest.approx(FRAME_HZ, abs=2.0)
    assert mine["rotor"].harmonic is None


def test_maps_stand_against_the_throttle_before_and_behind_the_filters(found: NoiseReview) -> None:
    before, after = (next(m for m in found.maps if m.channel == "p" and m.stage == s) for s in ("before", "after"))

    assert before.against == "throttle"
    assert before.unit == "(deg/s)²/Hz"
    assert before.level[0] == pytest.approx(0.22, abs=0.021)
    np.testing.assert_allclose(after.average, before.average, rtol=0.3)
    # White noise of 0.1 rad/s in 500 Hz, where no line stands.
    quiet = before.average[(before.frequency_hz > 420.0) & (before.frequency_hz < 480.0)]
    assert np.median(quiet) == pytest.approx((0.1 * 180.0 / np.pi) ** 2 / 500.0, rel=0.1)


def test_the_delay_of_the_filters_is_measured(found: NoiseReview) -> None:
    delay = found.numbers["filter_delay_measured_s"]

    assert delay.lower <= DELAY_SAMPLES / RATE_HZ <= delay.upper
    assert delay.std < 1e-4


def in_turns(cutoff_hz: float, *, throttle_after: float = 0.0) -> FlightRecord:
    """Batches of a second of white noise, which grows with throttle, before a low-pass and behind it in turns."""
    rng, count = np.random.default_rng(3), round(40.0 * RATE_HZ)
    time_s = np.arange(count) / RATE_HZ
    turn = (time_s // 1.0).astype(int) % 2
    throttle = 0.4 + 0.1 * np.sin(2.0 * np.pi * time_s / 7.7) + throttle_after * turn
    b, a = butter(2, cutoff_hz, fs=RATE_HZ)
    columns = {f"motor_{number}": throttle for number in range(1, 5)}
    topics = []
    for stage, number in (("raw", 0), ("filtered", 1)):
        noises = np.stack([throttle * rng.normal(size=count) for _ in "pqr"])
        noises = noises if stage == "raw" else lfilter(b, a, noises)
        channels = tuple(Channel(name=f"{rate}_{stage}", unit="rad/s", source=f"ISBD.{rate}") for rate in "pqr")
        kept = turn == number
        topics.append(Topic(name=f"ISBD[{number}]", time_s=time_s[kept], channels=channels, values=noises[:, kept]))
    whole = record(columns | {"az": np.full(count, -9.81)}, RATE_HZ, "ArduPilot DataFlash")
    return replace(whole, topics=(*whole.topics, *topics))


@pytest.mark.parametrize("cutoff_hz", [40.0, 80.0, 160.0])
def test_batches_before_and_behind_the_filters_need_not_be_taken_together(cutoff_hz: float) -> None:
    """Of white noise a low-pass leaves the mean of its squared gain."""
    found, gaps = noise(in_turns(cutoff_hz))
    omega, response = freqz(*butter(2, cutoff_hz, fs=RATE_HZ), worN=4096, fs=RATE_HZ)
    band = (omega >= 30.0) & (omega <= 0.4 * RATE_HZ)
    truth = 1.0 / np.sqrt(np.mean(np.abs(response[band]) ** 2))

    attenuation = found.numbers["filter_attenuation"]
    assert attenuation.lower <= truth <= attenuation.upper
    assert attenuation.std < 0.1 * truth
    assert not [gap for gap in gaps if gap.what == "noise.filter_attenuation"]
    assert [gap for gap in gaps if gap.what == "noise.filter_delay_measured_s"]


def test_batches_at_different_throttles_show_no_attenuation() -> None:
    found, gaps = noise(in_turns(80.0, throttle_after=0.4))
    assert "filter_attenuation" not in found.numbers
    (gap,) = (gap for gap in gaps if gap.what == "noise.filter_attenuation")
    assert "at different throttles only" in gap.why


def test_filters_of_a_gyro_that_is_not_logged_have_no_name() -> None:
    whole = flown(speeds=False)
    (topic,) = whole.topics
    rows = [row for row, channel in enumerate(topic.channels) if channel.name != "p"]
    without = replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])
    _, untold = noise(replace(whole, topics=(without,), source=replace(whole.source, format="PX4 ULog")))
    (said,) = [one for one in untold if one.what == "noise.filter_delay_configured_s"]
    assert said.why == "The log does not name the filters of the gyro."


def test_noise_through_p_and_d_is_what_the_set_point_does_not_explain(found: NoiseReview) -> None:
    numbers = found.numbers
    lines = 0.3**2 / 2.0 + 4.0 * (0.2**2 + 0.3**2) / 2.0
    # Lines and white noise from 30 Hz up; what follows the set-point is below.
    expected = 0.02 * np.sqrt(lines + 0.1**2 * (500.0 - 30.0) / 500.0)

    assert numbers["roll_p_noise_share"].value == pytest.approx(expected, rel=0.05)
    assert numbers["roll_d_noise_share"].value > numbers["roll_p_noise_share"].value
    assert numbers["roll_p_noise_share_above_100hz"].value <= numbers["roll_p_noise_share"].value


def test_vibration_is_that_of_the_accelerometer_above_10_hz(found: NoiseReview) -> None:
    vibration = found.numbers["vibration_m_s2"]

    assert vibration.value == pytest.approx(np.sqrt(3.0) * 0.5, rel=0.02)


@pytest.mark.parametrize(("firmware", "written"), [("Betaflight 4.4.3", 1000.0), ("INAV 6.0.0", 10.0)])
def test_a_filtered_accelerometer_tells_no_vibration(with_speeds: FlightRecord, firmware: str, written: float) -> None:
    source = replace(with_speeds.source, firmware=firmware)
    numbers, untold = noise(replace(with_speeds, source=source, parameters={"acc_lpf_hz": written}))

    assert "vibration_m_s2" not in numbers.numbers
    assert any(one.what == "noise.vibration_m_s2" and "10 Hz" in one.why for one in untold)


def test_samples_at_the_end_of_the_range_are_clipped(with_speeds: FlightRecord) -> None:
    topic = with_speeds.topics[0]
    values = topic.values.copy()
    values[topic.row("p_raw"), 5000:5400] = np.radians(2000.0)
    found, _ = noise(replace(with_speeds, topics=(replace(topic, values=values),)))

    assert found.numbers["clipping_share"].value == pytest.approx(400.0 / topic.time_s.size, rel=0.01)
    assert [finding.kind for finding in found.findings] == ["sensor_clipping"]


def test_a_slow_log_names_no_peaks_and_says_why() -> None:
    rng = np.random.default_rng(2)
    columns = {name: rng.normal(size=1500) for name in ("p", "q", "r", "motor_1")}
    columns["motor_1"] = 0.4 + 0.0 * columns["motor_1"]
    found, untold = noise(record(columns, 50.0, "PX4 ULog"))

    assert not found.peaks
    assert set(found.numbers) == {"clipping_share"}
    why = {one.what: one for one in untold}
    assert "50 Hz" in why["noise.peaks"].why
    assert "SDLOG_PROFILE" in why["noise.peaks"].remedy
    assert {"noise.maps.before", "noise.vibration_m_s2", "noise.roll_p_noise_share"} <= set(why)


def test_a_vehicle_on_the_ground_has_no_noise(with_speeds: FlightRecord) -> None:
    grounded = replace(with_speeds, status=replace(with_speeds.status, in_air=()))
    with pytest.raises(InsufficientDataError):
        noise(grounded)
