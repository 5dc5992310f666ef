"""Advice that the firmware can follow: no bit that is set already, no message or parameter that it does not have."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rotorid.data import FlightRecord, Source
from rotorid.io.advice import (
    flying_advice,
    logging_advice,
    motor_advice,
    raw_gyro_advice,
    sensor_advice,
    wind_advice,
)


def record(format: str, firmware: str, **parameters: float) -> FlightRecord:
    source = Source(name="a", format=format, sha256="", firmware=firmware)
    return FlightRecord(source=source, topics=(), parameters=parameters)


@pytest.mark.parametrize(
    ("firmware", "parameters", "sentence"),
    [
        ("ArduCopter V4.6.2", {"LOG_BITMASK": 176126.0}, "fast attitude (bit 0) and fast IMU (bit 18) are logged"),
        ("ArduCopter V4.6.2", {"LOG_BITMASK": 176127.0}, "so that fast IMU (bit 18) is logged: 176127 becomes 438271"),
        ("ArduCopter V4.6.2", {"LOG_BITMASK": 438271.0}, "fast attitude and fast IMU already"),
        (
            "ArduCopter V4.6.2",
            {"LOG_BITMASK": 438271.0, "LOG_BACKEND_TYPE": 4.0, "LOG_BLK_RATEMAX": 5.0},
            "LOG_BLK_RATEMAX = 5 holds every message down to 5 Hz",
        ),
        ("ArduCopter V3.2.1", {"LOG_BITMASK": 43006.0}, "fly firmware 3.4 or newer"),
    ],
)
def test_ardupilot_is_told_what_is_missing(firmware: str, parameters: dict[str, float], sentence: str) -> None:
    assert sentence in logging_advice(record("ArduPilot DataFlash", firmware, **parameters), 5.0)


@pytest.mark.parametrize(
    ("firmware", "parameters", "sentence"),
    [
        ("PX4 1.15.0", {}, "set SDLOG_PROFILE = 25"),
        ("PX4 1.15.0", {"SDLOG_PROFILE": 1.0}, "set SDLOG_PROFILE = 25 (bits 0"),
        ("PX4 1.8.0", {"SDLOG_PROFILE": 3.0}, "set SDLOG_PROFILE = 27"),
        ("", {"SDLOG_PROFILE": 25.0}, "logger_topics.txt"),
        ("PX4 1.15.0", {"SYS_AUTOSTART": 4001.0}, "this firmware has no SDLOG_PROFILE"),
        ("PX4 1.6.5 (development)", {"SDLOG_PROFILE": 0.0}, "set SDLOG_PROFILE = 2 (system identification, it is 0)"),
        ("PX4 1.7.3", {"SDLOG_PROFILE": 2.0}, "SDLOG_PROFILE = 2 holds what helps already"),
    ],
)
def test_px4_is_told_what_is_missing(firmware: str, parameters: dict[str, float], sentence: str) -> None:
    assert sentence in logging_advice(record("PX4 ULog", firmware, **parameters), 5.0)


ADVICES: dict[str, Callable[[FlightRecord], str]] = {
    "raw gyro": raw_gyro_advice,
    "sensors": lambda flight: sensor_advice(flight, 5.0),
    "motors": motor_advice,
    "wind": wind_advice,
}
OLD_COPTER = ("ArduPilot DataFlash", "ArduCopter V3.2.1", {"LOG_BITMASK": 43006.0})
BATCHES = {"INS_LOG_BAT_MASK": 0.0, "INS_LOG_BAT_OPT": 0.0, "LOG_BITMASK": 438271.0}
LIMITED = {"INS_LOG_BAT_MASK": 1.0, "INS_LOG_BAT_OPT": 4.0, "LOG_BACKEND_TYPE": 4.0, "LOG_BLK_RATEMAX": 5.0}


@pytest.mark.parametrize(
    ("about", "vehicle", "sentence"),
    [
        ("raw gyro", OLD_COPTER, "ArduCopter V3.2.1 logs no gyro before its filters"),
        ("raw gyro", ("ArduPilot DataFlash", "ArduCopter V4.6.2", BATCHES), "set INS_LOG_BAT_MASK = 1 and INS_LOG_BAT"),
        ("raw gyro", ("ArduPilot DataFlash", "ArduCopter V4.6.2", LIMITED), "ask for it already"),
        ("raw gyro", ("PX4 ULog", "PX4 1.15.0", {"SDLOG_PROFILE": 1.0}), "set bit 8 of SDLOG_PROFILE"),
        ("raw gyro", ("PX4 ULog", "PX4 1.6.5", {"SDLOG_PROFILE": 1.0}), "fly firmware 1.12 or newer"),
        ("raw gyro", ("PX4 ULog", "PX4 1.15.0", {"SDLOG_PROFILE": 256.0}), "is set already"),
        ("raw gyro", ("Betaflight Blackbox", "Betaflight 4.5.1", {}), "GYRO_SCALED"),
        ("sensors", OLD_COPTER, "fly firmware 3.4 or newer"),
        ("sensors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", BATCHES), "set INS_LOG_BAT_MASK = 1, or LOG_BITMASK"),
        ("sensors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", LIMITED), "LOG_BLK_RATEMAX = 5 holds every message"),
        ("sensors", ("PX4 ULog", "PX4 1.6.5", {"SDLOG_PROFILE": 0.0}), "SDLOG_PROFILE = 2"),
        ("sensors", ("Betaflight Blackbox", "Betaflight 4.5.1", {}), "blackbox_sample_rate"),
        ("motors", OLD_COPTER, ""),
        ("motors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", {"SERVO1_FUNCTION": 0.0}), "log RCOU (bit 10 of LOG_"),
        ("motors", ("PX4 ULog", "PX4 1.11.0", {}), "actuator_outputs"),
        ("motors", ("PX4 ULog", "PX4 1.15.0", {}), "actuator_motors"),
        ("wind", OLD_COPTER, ""),
        ("wind", ("ArduPilot DataFlash", "ArduCopter V4.6.2", {"EK3_DRAG_BCOEF_X": 0.0}), "set EK3_DRAG_BCOEF_X"),
        ("wind", ("ArduPilot DataFlash", "ArduCopter V4.6.2", {"EK3_DRAG_BCOEF_X": 20.0}), ""),
        ("wind", ("PX4 ULog", "PX4 1.15.0", {"EKF2_DRAG_CTRL": 0.0}), "set EKF2_DRAG_CTRL = 1"),
        ("wind", ("PX4 ULog", "PX4 1.9.0", {"EKF2_AID_MASK": 1.0, "EKF2_BCOEF_X": 25.0}), "bit 5 of EKF2_AID_MASK"),
        ("wind", ("PX4 ULog", "PX4 1.6.5", {"EKF2_AID_MASK": 1.0}), ""),
    ],
)
def test_what_the_firmware_lacks_or_does_already_is_not_advised(
    about: str, vehicle: tuple[str, str, dict[str, float]], sentence: str
) -> None:
    format, firmware, parameters = vehicle
    told = ADVICES[about](record(format, firmware, **parameters))
    assert sentence in told if sentence else not told


def test_only_firmware_with_that_mode_is_told_to_fly_it() -> None:
    assert "SYSTEMID" in flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.6.2"))
    assert flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.7.0")).endswith("entered from Stabilize")
    assert "SYSTEMID" not in flying_advice(record("ArduPilot DataFlash as text", "ArduCopter V3.6.9"))
    assert "stick" in flying_advice(record("PX4 ULog as CSV", ""))
    assert "--segment" in flying_advice(record("CSV", ""))
    assert "--map" in logging_advice(record("CSV", ""), 0.0)
