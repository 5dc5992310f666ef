"""Advice that the firmware can follow: no bit that is set already, no message or parameter that it does not have."""

from __future__ import annotations

import pytest

from rotorid.data import FlightRecord, Source
from rotorid.io.advice import flying_advice, logging_advice


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
    ("parameters", "sentence"),
    [
        ({}, "set SDLOG_PROFILE = 25"),
        ({"SDLOG_PROFILE": 1.0}, "set SDLOG_PROFILE = 25 (bits 0"),
        ({"SDLOG_PROFILE": 3.0}, "set SDLOG_PROFILE = 27"),
        ({"SDLOG_PROFILE": 25.0}, "logger_topics.txt"),
        ({"SYS_AUTOSTART": 4001.0}, "This firmware has no SDLOG_PROFILE"),
    ],
)
def test_px4_is_told_what_is_missing(parameters: dict[str, float], sentence: str) -> None:
    assert sentence in logging_advice(record("PX4 ULog", "PX4 1.15.0", **parameters), 5.0)


def test_only_firmware_with_that_mode_is_told_to_fly_it() -> None:
    assert "SYSTEMID" in flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.6.2"))
    assert "SYSTEMID" not in flying_advice(record("ArduPilot DataFlash as text", "ArduCopter V3.6.9"))
    assert "stick" in flying_advice(record("PX4 ULog as CSV", ""))
    assert "--segment" in flying_advice(record("CSV", ""))
    assert "--map" in logging_advice(record("CSV", ""), 0.0)
