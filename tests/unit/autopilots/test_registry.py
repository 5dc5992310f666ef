"""Which autopilot it is, and that each answers every question of every log."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

import pytest

from rotorid.autopilots.advice import (
    flying_advice,
    gains_advice,
    gap_advice,
    logging_advice,
    motor_advice,
    raw_gyro_advice,
    sensor_advice,
    speed_advice,
    wind_advice,
)
from rotorid.autopilots.registry import AUTOPILOTS, UNKNOWN, autopilot_of, by_gains, named, writer_of
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError
from rotorid.flights.hover import thrust_curve
from rotorid.flights.same_vehicle import frame_of
from rotorid.models.autopilots.layouts import layout_of, mixer_like
from rotorid.models.rotors import library_layout
from rotorid.signal.autopilot_filters import controller_filters, filter_findings
from rotorid.signal.motors import linearization_of
from rotorid.vehicles.catalog import VEHICLES

FORMATS = (
    ("PX4 ULog", "PX4 1.15.0"),
    ("PX4 ULog as CSV", ""),
    ("ArduPilot DataFlash", "ArduCopter V4.6.2"),
    ("ArduPilot DataFlash as text", ""),
    ("Betaflight blackbox", "Betaflight 4.5.1"),
    ("Betaflight blackbox", "INAV 7.1.0"),
    ("Crazyflie uSD", "Crazyflie"),
    ("MAVLink telemetry", "ArduCopter V4.6.2"),
    ("MAVLink telemetry", "PX4 1.15.0"),
    ("MAVLink telemetry", ""),
    ("CSV", ""),
)
SETTINGS = (
    *("IMU_GYRO_CUTOFF", "IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW", "IMU_GYRO_DNF_EN", "IMU_INTEG_RATE", "SDLOG_PROFILE"),
    *("THR_MDL_FAC", "CA_ROTOR_COUNT", "SYS_AUTOSTART", "EKF2_AID_MASK", "EKF2_BCOEF_X", "MC_ROLLRATE_P"),
    *("INS_GYRO_FILTER", "INS_GYRO_RATE", "INS_FAST_SAMPLE", "INS_HNTCH_ENABLE", "INS_HNTCH_OPTS", "INS_HNTCH_HMNCS"),
    *("INS_HNTCH_FREQ", "INS_HNTCH_BW", "INS_HNTCH_ATT", "INS_HNTCH_REF", "INS_LOG_BAT_MASK", "LOG_BITMASK"),
    *("LOG_BACKEND_TYPE", "FRAME_CLASS", "FRAME_TYPE", "FRAME", "MOT_THST_EXPO", "MOT_SPIN_MIN", "SID_AXIS"),
    *("looptime", "pid_process_denom", "gyro_lpf1_static_hz", "gyro_lpf1_type", "features", "thrust_linear"),
    *("gyro_notch_hz_0", "gyro_notch_cutoff_0", "acc_lpf_hz", "yaw_motors_reversed"),
)
SOURCES = (
    "vehicle_angular_velocity.xyz[0]",
    "sensor_combined.gyro_rad[0]",
    "RATE.R",
    "SIDD.Gx",
    "gyroADC[0]",
    "motor[0]",
)


def record(format: str, firmware: str = "", **parameters: float) -> FlightRecord:
    source = Source(name="log", format=format, sha256="", firmware=firmware)
    return FlightRecord(source=source, topics=(), parameters=parameters)


@pytest.mark.parametrize(
    ("format", "firmware", "flew", "wrote"),
    [
        ("PX4 ULog as CSV", "", "PX4", "PX4"),
        ("ArduPilot DataFlash", "", "ArduPilot", "ArduPilot"),
        ("Betaflight blackbox", "INAV 7.1.0", "Betaflight", "Betaflight"),
        ("Crazyflie uSD", "", "Crazyflie", "Crazyflie"),
        ("MAVLink telemetry", "PX4 1.15.0", "PX4", ""),
        ("MAVLink telemetry", "ArduCopter V4.5.7", "ArduPilot", ""),
        ("MAVLink telemetry", "", "", ""),
        ("ROS 2 bag", "", "", ""),
        ("CSV", "", "", ""),
    ],
)
def test_a_log_is_of_the_autopilot_that_flew(format: str, firmware: str, flew: str, wrote: str) -> None:
    log = record(format, firmware)
    assert (autopilot_of(log).name, writer_of(log).name) == (flew, wrote)


@pytest.mark.parametrize("autopilot", AUTOPILOTS, ids=lambda one: str(one.key))
def test_every_autopilot_is_found_by_its_names(autopilot: object) -> None:
    (own,) = (one for one in AUTOPILOTS if one is autopilot)
    assert {named(word).name for word in (own.name, own.key, f"{own.name} 1.2.3", *own.called)} == {own.name}
    assert not own.gain or by_gains({own.gain: 1.0}) is own
    assert own.vehicle in VEHICLES
    assert own.log.own


def test_nothing_is_known_of_an_unknown_one() -> None:
    assert named("simple") is UNKNOWN
    assert named("") is UNKNOWN
    assert by_gains({}) is UNKNOWN
    assert not UNKNOWN.log.own
    assert UNKNOWN.log.frame(record("CSV", FRAME_CLASS=1.0)) is None
    assert UNKNOWN.log_format == "csv"


def test_an_unknown_mixer_normalizes_all_axes_alike() -> None:
    layout = library_layout("hexa.x")
    assert (mixer_like(layout, "simple") == mixer_like(layout, "px4")).all()
    assert (mixer_like(layout, "simple") != mixer_like(layout, "ardupilot")).any()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 1e300])
@pytest.mark.parametrize(("format", "firmware"), FORMATS)
def test_no_damaged_parameter_ends_a_question(format: str, firmware: str, value: float) -> None:
    log = record(format, firmware, **dict.fromkeys(SETTINGS, value))
    asked: list[Callable[[FlightRecord], object]] = [
        *(raw_gyro_advice, motor_advice, speed_advice, gains_advice, gap_advice, wind_advice),
        *(linearization_of, frame_of, thrust_curve, controller_filters),
        lambda one: logging_advice(one, 5.0, ("p",)),
        lambda one: sensor_advice(one, 5.0),
        lambda one: flying_advice(one, "roll"),
        lambda one: one if autopilot_of(one).log.accelerometer_cutoff_hz(one) else None,
        *((lambda one, source=source: filter_findings(one, source)) for source in SOURCES),  # type: ignore[misc]
    ]
    for ask in asked:
        ask(log)
    with suppress(InsufficientDataError):
        layout_of(log)


@pytest.mark.parametrize(
    ("format", "source", "known", "damaged"),
    [
        ("PX4 ULog", SOURCES[0], {"IMU_GYRO_CUTOFF": 40.0}, "IMU_GYRO_CUTOFF"),
        ("ArduPilot DataFlash", "RATE.R", {"INS_GYRO_FILTER": 20.0}, "INS_GYRO_FILTER"),
        ("ArduPilot DataFlash", "RATE.R", {"INS_GYRO_FILTER": 20.0, "INS_HNTCH_ENABLE": 1.0}, "INS_HNTCH_OPTS"),
        ("Betaflight blackbox", "gyroADC[0]", {"looptime": 125.0, "gyro_lpf1_static_hz": 250.0}, "gyro_lpf1_type"),
        ("Betaflight blackbox", "gyroADC[0]", {"looptime": 125.0, "gyro_lpf1_static_hz": 0.0}, "features"),
    ],
)
def test_a_filter_without_a_number_is_doubtful_and_not_off(
    format: str, source: str, known: dict[str, float], damaged: str
) -> None:
    log = record(format, "Betaflight 4.5.1", **{**known, damaged: math.nan})
    assert "unknown_filter" in [finding.kind for finding in filter_findings(log, source)]


def test_an_unknown_sampling_rate_is_the_usual_one() -> None:
    parameters = {"INS_GYRO_FILTER": 20.0, "INS_FAST_SAMPLE": 1.0}
    usual = controller_filters(record("ArduPilot DataFlash", **parameters))
    assert controller_filters(record("ArduPilot DataFlash", **parameters, INS_GYRO_RATE=math.nan)) == usual


def test_the_registry_loads_no_arrays() -> None:
    code = "import sys, rotorid.autopilots.registry; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_files_of_parameters_have_words_on_how_they_are_loaded() -> None:
    assert "QGroundControl" in named("PX4").loading
    assert "Mission Planner" in named("ArduPilot").loading
    assert "CLI" in named("Betaflight").loading
    assert UNKNOWN.loading == "Load the file with your ground station."
