"""Which filters the parameters of a log say that a channel has passed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid.autopilots.filters import combined_response
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import UsageError
from rotorid.signal.autopilot_filters import filter_findings, known_filters

PX4_GYRO = "vehicle_angular_velocity.xyz[0]"


def record(
    log_format: str, parameters: Mapping[str, float], *, firmware: str = "", topics: tuple[Topic, ...] = ()
) -> FlightRecord:
    source = Source(name="log", format=log_format, sha256="", firmware=firmware)
    return FlightRecord(source=source, topics=topics, parameters=parameters)


def names(flight: FlightRecord, source: str) -> list[str]:
    return [known.name for known in known_filters(flight, source)]


def doubts(flight: FlightRecord, source: str) -> list[str]:
    return [finding.message for finding in filter_findings(flight, source) if finding.kind == "unknown_filter"]


PX4 = {"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0, "IMU_ACCEL_CUTOFF": 30.0}
ARDUPILOT = {"INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 10.0, "SCHED_LOOP_RATE": 400.0}
BETAFLIGHT = {
    "looptime": 125.0,
    "pid_process_denom": 2.0,
    "gyro_lpf1_static_hz": 250.0,
    "gyro_lpf1_type": 0.0,
    "gyro_lpf2_static_hz": 500.0,
    "gyro_lpf2_type": 2.0,
}


@pytest.mark.parametrize(
    ("log_format", "parameters", "source", "expected"),
    [
        ("PX4 ULog", PX4, PX4_GYRO, ["second-order low-pass at 40 Hz"]),
        ("PX4 ULog as CSV", PX4, PX4_GYRO, ["second-order low-pass at 40 Hz"]),
        ("PX4 ULog", {**PX4, "IMU_GYRO_CUTOFF": 0.0}, PX4_GYRO, []),
        (
            "PX4 ULog",
            {**PX4, "IMU_GYRO_NF0_FRQ": 80.0},
            PX4_GYRO,
            ["second-order low-pass at 40 Hz", "notch at 80 Hz"],
        ),
        ("PX4 ULog", PX4, "vehicle_acceleration.xyz[2]", ["second-order low-pass at 30 Hz"]),
        ("PX4 ULog", {"IMU_INTEG_RATE": 200.0}, "sensor_combined.gyro_rad[1]", ["integral over 5 ms"]),
        ("PX4 ULog", PX4, "vehicle_torque_setpoint.xyz[0]", []),
        ("ArduPilot DataFlash", ARDUPILOT, "RATE.R", ["second-order low-pass at 20 Hz"]),
        ("ArduPilot DataFlash", ARDUPILOT, "IMU.GyrZ", ["second-order low-pass at 20 Hz"]),
        ("ArduPilot DataFlash", ARDUPILOT, "IMU.AccZ", ["second-order low-pass at 10 Hz"]),
        ("ArduPilot DataFlash", ARDUPILOT, "SIDD.Gx", ["integral over 2.5 ms"]),
        ("ArduPilot DataFlash", ARDUPILOT, "SIDD.Az", ["mean of the samples of 2.5 ms"]),
        ("ArduPilot DataFlash", ARDUPILOT, "RATE.ROut", []),
        ("Betaflight blackbox", BETAFLIGHT, "gyroADC[2]", ["PT1 low-pass at 250 Hz", "PT2 low-pass at 500 Hz"]),
        ("Betaflight blackbox", BETAFLIGHT, "motor mix", []),
    ],
)
def test_filters_are_those_of_the_parameters(
    log_format: str, parameters: Mapping[str, float], source: str, expected: list[str]
) -> None:
    flight = record(log_format, parameters, firmware="Betaflight 4.4.2 (abc) F7")
    assert names(flight, source) == expected
    assert doubts(flight, source) == []


@pytest.mark.parametrize(
    ("log_format", "parameters", "source", "reason"),
    [
        ("PX4 ULog", {}, PX4_GYRO, "IMU_GYRO_CUTOFF"),
        ("PX4 ULog", {}, "sensor_combined.gyro_rad[0]", "IMU_INTEG_RATE"),
        ("PX4 ULog", {**PX4, "IMU_GYRO_DNF_EN": 1.0}, PX4_GYRO, "moves in flight"),
        ("PX4 ULog", {**PX4, "IMU_GYRO_CUTOFF": 9000.0}, PX4_GYRO, "makes no filter"),
        ("PX4 ULog", {**PX4, "IMU_GYRO_NF0_FRQ": math.inf}, PX4_GYRO, "makes no filter"),
        ("PX4 ULog", {"IMU_INTEG_RATE": 1e-300}, "sensor_combined.gyro_rad[0]", "makes no filter"),
        ("PX4 ULog", {**PX4, "CA_R2_SLEW": 0.1}, "actuator_motors.control[0]", "not linear"),
        ("PX4 ULog", PX4, "vehicle_attitude.q", "not known"),
        ("ArduPilot DataFlash", {}, "RATE.R", "INS_GYRO_FILTER"),
        ("ArduPilot DataFlash", {"SCHED_LOOP_RATE": 1e-30}, "SIDD.Gx", "makes no filter"),
        ("CSV", PX4, PX4_GYRO, "not known"),
        ("Betaflight blackbox", BETAFLIGHT, "accSmooth[0]", "not known"),
        ("Betaflight blackbox", {**BETAFLIGHT, "gyro_lpf1_dyn_hz_0": 200.0}, "gyroADC[0]", "moves in flight"),
        ("Betaflight blackbox", {**BETAFLIGHT, "features": float(1 << 29)}, "gyroADC[0]", "moves in flight"),
        ("Betaflight blackbox", {**BETAFLIGHT, "rpm_filter_harmonics": 3.0}, "gyroADC[0]", "moves in flight"),
        ("Betaflight blackbox", {**BETAFLIGHT, "gyro_lpf1_type": 7.0}, "gyroADC[0]", "not modeled"),
        ("Betaflight blackbox", {**BETAFLIGHT, "looptime": 0.0}, "gyroADC[0]", "looptime"),
    ],
)
def test_what_is_not_known_is_said(log_format: str, parameters: Mapping[str, float], source: str, reason: str) -> None:
    (said,) = doubts(record(log_format, parameters, firmware="Betaflight 4.4.2 (abc) F7"), source)
    assert reason in said


def test_rate_is_the_given_one_or_that_of_a_fast_sensor() -> None:
    flight = record("PX4 ULog", PX4)
    (fast,) = known_filters(flight, PX4_GYRO)
    (slow,) = known_filters(flight, PX4_GYRO, sensor_rate_hz=250.0)
    assert (fast.rate_hz, slow.rate_hz) == (8000.0, 250.0)
    # The bilinear transformation with prewarping shortens the delay of the continuous filter, by tan(x) over x.
    angle = math.pi * 40.0 / 250.0
    assert slow.delay_s == pytest.approx(math.sqrt(0.5) / (250.0 * math.tan(angle)), rel=1e-12)
    assert fast.delay_s == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi * 40.0), rel=1e-4)


@pytest.mark.parametrize(("fast", "doubling", "expected"), [(0.0, 3.0, 1000.0), (1.0, 3.0, 8000.0), (1.0, 0.0, 1000.0)])
def test_ardupilot_reads_the_sensor_as_fast_as_it_is_told(fast: float, doubling: float, expected: float) -> None:
    flight = record("ArduPilot DataFlash", {**ARDUPILOT, "INS_FAST_SAMPLE": fast, "INS_GYRO_RATE": doubling})
    (known,) = known_filters(flight, "RATE.P")
    assert known.rate_hz == expected


def test_finding_says_what_a_slower_sensor_would_make_of_it() -> None:
    channel = Channel(name="p", unit="rad/s", source=PX4_GYRO)
    topic = Topic(
        name="vehicle_angular_velocity",
        time_s=0.004 * np.arange(100),
        channels=(channel,),
        values=np.zeros((1, 100)),
    )
    flight = record("PX4 ULog", PX4, topics=(topic,))
    (finding,) = filter_findings(flight, PX4_GYRO)
    assert (finding.kind, finding.severity, finding.where) == ("known_filter", "info", PX4_GYRO)
    assert finding.numbers["delay_s"] == pytest.approx(5.63e-3, abs=1e-5)
    assert finding.numbers["delay_at_logged_rate_s"] == pytest.approx(5.14e-3, abs=1e-5)
    (certain,) = filter_findings(flight, PX4_GYRO, sensor_rate_hz=250.0)
    assert "delay_at_logged_rate_s" not in certain.numbers


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, math.nan, math.inf])
def test_impossible_sensor_rate_is_refused(rate_hz: float) -> None:
    with pytest.raises(UsageError, match="sensor rate"):
        known_filters(record("PX4 ULog", PX4), PX4_GYRO, sensor_rate_hz=rate_hz)


def test_px4_notch_is_as_wide_as_its_parameter() -> None:
    flight = record("PX4 ULog", {**PX4, "IMU_GYRO_CUTOFF": 0.0, "IMU_GYRO_NF0_FRQ": 100.0, "IMU_GYRO_NF0_BW": 30.0})
    (known,) = known_filters(flight, PX4_GYRO, sensor_rate_hz=1000.0)
    omega = 2.0 * np.pi * np.linspace(60.0, 160.0, 100_001)
    inside = omega[np.abs(known.response(omega)) < math.sqrt(0.5)]
    # The bilinear transformation keeps the width between the half-power points exactly; the grid is 1 mHz.
    assert (inside[-1] - inside[0]) / (2.0 * np.pi) == pytest.approx(30.0, abs=3e-3)


NOTCH = {"ENABLE": 1.0, "FREQ": 80.0, "BW": 40.0, "ATT": 40.0, "HMNCS": 3.0, "MODE": 0.0, "REF": 0.0, "OPTS": 0.0}


def ardupilot_notch(**changed: float) -> FlightRecord:
    settings = {f"INS_HNTCH_{name}": value for name, value in {**NOTCH, **changed}.items()}
    return record("ArduPilot DataFlash", {"INS_GYRO_FILTER": 0.0, **settings})


def test_ardupilot_notch_stands_on_every_harmonic_and_is_as_deep_as_its_parameter() -> None:
    chain = known_filters(ardupilot_notch(), "RATE.R")
    assert [known.name for known in chain] == ["notch at 80 Hz", "notch at 160 Hz"]
    centers = 2.0 * np.pi * np.array([80.0, 160.0])
    for known, center in zip(chain, centers, strict=True):
        assert abs(known.response(np.array([center]))[0]) == pytest.approx(0.01, rel=1e-9)
    assert combined_response(chain, centers[:1])[0] != 0.0


def test_ardupilot_notch_beyond_the_band_is_left_out_as_the_autopilot_does() -> None:
    assert names(ardupilot_notch(HMNCS=127.0), "RATE.R") == [f"notch at {80 * n} Hz" for n in range(1, 6)]


@pytest.mark.parametrize("reference", [0.0, 1.0])
def test_ardupilot_notch_moves_unless_its_reference_is_zero(reference: float) -> None:
    flight = ardupilot_notch(MODE=1.0, REF=reference)
    assert bool(names(flight, "RATE.R")) == (reference == 0.0)
    assert len(doubts(flight, "RATE.R")) == int(reference)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"OPTS": 1.0}, "composite"),
        ({"OPTS": 16.0}, "composite"),
        ({"BW": 200.0}, "make no notch"),
        ({"ATT": -1e30}, "make no notch"),
    ],
)
def test_ardupilot_notch_that_is_not_modeled_is_said(changed: dict[str, float], reason: str) -> None:
    flight = ardupilot_notch(**changed)
    assert names(flight, "RATE.R") == []
    assert reason in doubts(flight, "RATE.R")[0]


def test_first_harmonic_notch_followed_the_throttle_without_saying_a_mode() -> None:
    flight = ardupilot_notch(REF=0.3)
    parameters = {name: value for name, value in flight.parameters.items() if name != "INS_HNTCH_MODE"}
    (said,) = doubts(record("ArduPilot DataFlash", parameters), "RATE.R")
    assert "INS_HNTCH_REF = 0.3" in said


def test_single_notch_of_older_firmware_has_no_harmonics() -> None:
    settings = {f"INS_NOTCH_{name}": NOTCH[name] for name in ("ENABLE", "FREQ", "BW", "ATT")}
    flight = record("ArduPilot DataFlash", {"INS_GYRO_FILTER": 0.0, **settings})
    assert (names(flight, "RATE.R"), doubts(flight, "RATE.R")) == (["notch at 80 Hz"], [])


def test_ardupilot_notch_without_its_harmonics_is_not_known() -> None:
    flight = ardupilot_notch()
    parameters = {name: value for name, value in flight.parameters.items() if name != "INS_HNTCH_HMNCS"}
    (said,) = doubts(record("ArduPilot DataFlash", parameters), "RATE.R")
    assert "does not carry INS_HNTCH_HMNCS" in said


def test_ardupilot_notch_that_is_off_is_none() -> None:
    flight = ardupilot_notch(ENABLE=0.0, MODE=3.0, REF=1.0)
    assert (names(flight, "RATE.R"), doubts(flight, "RATE.R")) == ([], [])


@pytest.mark.parametrize(
    ("version", "rates_hz"), [("4.1.7", [8000.0, 8000.0]), ("4.2.0", [4000.0, 8000.0]), ("2025.12.0", [4000.0, 8000.0])]
)
def test_betaflight_filters_in_the_pid_loop_since_4_2(version: str, rates_hz: list[float]) -> None:
    settings = {**BETAFLIGHT, "gyro_lpf2_type": 1.0}
    flight = record("Betaflight blackbox", settings, firmware=f"Betaflight {version} (abc) F7")
    assert [known.rate_hz for known in known_filters(flight, "gyroADC[0]")] == rates_hz


def test_betaflight_takes_means_where_nothing_else_stands_before_the_loop() -> None:
    flight = record("Betaflight blackbox", {**BETAFLIGHT, "gyro_lpf2_static_hz": 0.0}, firmware="Betaflight 4.4.2")
    _, mean = known_filters(flight, "gyroADC[0]")
    assert mean.numerator == pytest.approx((0.5, 0.5))
    assert mean.rate_hz == 8000.0


def test_betaflight_types_meant_other_things_before_4_3() -> None:
    flight = record("Betaflight blackbox", BETAFLIGHT, firmware="Betaflight 4.2.9 (abc) F7")
    assert names(flight, "gyroADC[0]") == ["PT1 low-pass at 250 Hz"]
    assert "gyro_lpf2_type = 2" in doubts(flight, "gyroADC[0]")[0]


def test_betaflight_notch_reaches_from_its_cutoff() -> None:
    settings = {**BETAFLIGHT, "gyro_notch_hz_0": 200.0, "gyro_notch_cutoff_0": 150.0}
    flight = record("Betaflight blackbox", settings, firmware="Betaflight 4.4.2 (abc) F7")
    known = known_filters(flight, "gyroADC[0]")[-1]
    assert known.name == "notch at 200 Hz"
    # Half of the power is left at the cutoff of the continuous filter; warping moves it by some (f / rate)².
    assert abs(known.response(np.array([2.0 * np.pi * 150.0]))[0]) == pytest.approx(math.sqrt(0.5), abs=0.01)


def test_inav_is_not_taken_for_betaflight() -> None:
    flight = record("Betaflight blackbox", BETAFLIGHT, firmware="INAV 7.1.0")
    assert names(flight, "gyroADC[0]") == []
    assert "no version of Betaflight" in doubts(flight, "gyroADC[0]")[0]


SEEN = {
    "PX4 ULog": (
        (PX4_GYRO, "vehicle_acceleration.xyz[0]", "sensor_combined.gyro_rad[0]"),
        (*PX4, "IMU_INTEG_RATE", "IMU_GYRO_DNF_EN"),
    ),
    "ArduPilot DataFlash": (
        ("RATE.R", "SIDD.Gx", "SIDD.Ax"),
        (*ARDUPILOT, "INS_FAST_SAMPLE", "INS_GYRO_RATE", *(f"INS_HNTCH_{name}" for name in NOTCH)),
    ),
    "Betaflight blackbox": (
        ("gyroADC[0]",),
        (*BETAFLIGHT, "gyro_notch_hz_0", "gyro_notch_cutoff_0", "features"),
    ),
}


@pytest.mark.parametrize("log_format", SEEN)
@given(data=st.data())
def test_no_parameter_of_a_damaged_log_raises(log_format: str, data: st.DataObject) -> None:
    sources, parameters = SEEN[log_format]
    number = st.floats() | st.sampled_from([0.0, 1.0, 3.0, 40.0, 400.0])
    values = data.draw(st.dictionaries(st.sampled_from(parameters), number))
    flight = record(log_format, values, firmware="Betaflight 4.5.1")
    for source in sources:
        chain = known_filters(flight, source)
        assert all(math.isfinite(known.delay_s) for known in chain)
        assert {finding.kind for finding in filter_findings(flight, source)} <= {"known_filter", "unknown_filter"}
