"""Advice that the firmware can follow: no bit that is already set, no message or parameter that it does not have."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rotorid.autopilots.advice import (
    flying_advice,
    logging_advice,
    motor_advice,
    raw_gyro_advice,
    sensor_advice,
    slow_motor_advice,
    speed_advice,
    wind_advice,
)
from rotorid.autopilots.ardupilot.advice import decimation_findings, missing_rate, slow_topics
from rotorid.autopilots.ardupilot.firmware import named
from rotorid.data import Channel, FlightRecord, Source, Topic


def record(format: str, firmware: str, **parameters: float) -> FlightRecord:
    source = Source(name="a", format=format, sha256="", firmware=firmware)
    return FlightRecord(source=source, topics=(), parameters=parameters)


@pytest.mark.parametrize(
    ("firmware", "parameters", "sentence"),
    [
        (
            "ArduCopter V4.6.2",
            {"LOG_BITMASK": 176126.0},
            "438271 (it is 176126; bits 0 fast attitude, 18",
        ),
        (
            "ArduCopter V4.6.2",
            {"LOG_BITMASK": 176127.0},
            "438271 (it is 176127; bit 18 fast IMU is",
        ),
        ("ArduCopter V4.6.2", {"LOG_BITMASK": 438271.0}, "fast attitude and fast IMU already"),
        (
            "ArduCopter V4.6.2",
            {"LOG_BITMASK": 438271.0, "LOG_BACKEND_TYPE": 4.0, "LOG_BLK_RATEMAX": 5.0},
            "LOG_BLK_RATEMAX = 5 limits every message to 5 Hz",
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
        ("PX4 1.7.3", {"SDLOG_PROFILE": 2.0}, "SDLOG_PROFILE = 2 already logs what helps"),
    ],
)
def test_px4_is_told_what_is_missing(firmware: str, parameters: dict[str, float], sentence: str) -> None:
    assert sentence in logging_advice(record("PX4 ULog", firmware, **parameters), 5.0)


ADVICES: dict[str, Callable[[FlightRecord], str]] = {
    "raw gyro": raw_gyro_advice,
    "sensors": lambda flight: sensor_advice(flight, 5.0),
    "motors": motor_advice,
    "speeds": speed_advice,
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
        ("raw gyro", ("PX4 ULog", "PX4 1.15.0", {"SDLOG_PROFILE": 256.0}), "is already set"),
        ("raw gyro", ("PX4 ULog", "PX4", {"SYS_AUTOSTART": 4001.0}), "this firmware logs no gyro before its filters"),
        ("raw gyro", ("Betaflight blackbox", "Betaflight 4.3.1", {}), "GYRO_SCALED"),
        ("raw gyro", ("Betaflight blackbox", "Betaflight 4.5.1", {}), "blackbox_disable_gyrounfilt"),
        ("raw gyro", ("Betaflight blackbox", "INAV 7.1.0", {}), ""),
        ("raw gyro", ("Betaflight blackbox", "Betaflight 3.2.0", {}), "set debug_mode = GYRO"),
        ("raw gyro", ("Betaflight blackbox", "Betaflight 3.0.1", {}), "fly Betaflight 4.0 or newer"),
        ("speeds", OLD_COPTER, "fly firmware 4.0 or newer"),
        ("speeds", ("ArduPilot DataFlash", "ArduCopter V4.6.2", {}), "bidirectional DShot"),
        ("speeds", ("Betaflight blackbox", "Betaflight 4.3.1", {}), "fly Betaflight 4.5 or newer"),
        ("speeds", ("Betaflight blackbox", "Betaflight 4.5.1", {}), "bidirectional DShot"),
        ("sensors", OLD_COPTER, "fly firmware 3.4 or newer"),
        ("sensors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", BATCHES), "set INS_LOG_BAT_MASK = 1"),
        ("sensors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", LIMITED), "LOG_BLK_RATEMAX = 5 limits every message"),
        ("sensors", ("PX4 ULog", "PX4 1.6.5", {"SDLOG_PROFILE": 0.0}), "SDLOG_PROFILE = 2"),
        ("sensors", ("Betaflight blackbox", "Betaflight 4.5.1", {}), "blackbox_sample_rate"),
        ("sensors", ("Betaflight blackbox", "Betaflight 4.2.0", {}), "blackbox_p_ratio"),
        ("sensors", ("Betaflight blackbox", "Betaflight 3.1.5", {}), "in the Configurator"),
        ("motors", OLD_COPTER, ""),
        ("motors", ("ArduPilot DataFlash", "ArduCopter V4.6.2", {"SERVO1_FUNCTION": 0.0}), "log RCOU (bit 10 of LOG_"),
        (
            "motors",
            ("ArduPilot DataFlash", "ArduCopter V4.6.2", {"LOG_BITMASK": 1024.0, "SERVO1_FUNCTION": 33.0}),
            "",
        ),
        ("motors", ("PX4 ULog", "PX4 1.11.0", {}), "actuator_outputs"),
        ("motors", ("PX4 ULog", "PX4", {"SYS_AUTOSTART": 4001.0}), "actuator_outputs"),
        ("motors", ("Betaflight blackbox", "Betaflight 4.4.0", {}), "blackbox_disable_motors = OFF"),
        ("motors", ("Betaflight blackbox", "Betaflight 4.1.0", {}), ""),
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


def test_motors_beside_fast_rates_are_not_advised_to_be_logged_by_the_same_bit() -> None:
    log = record("ArduPilot DataFlash", "ArduCopter V4.6.2", LOG_BITMASK=438271.0)
    rate = Topic(name="RATE", time_s=np.arange(0.0, 1.0, 0.0025), channels=(), values=np.zeros((0, 400)))
    assert slow_motor_advice(replace(log, topics=(rate,)), 10.0).startswith("ArduPilot writes RCOU ten times a second")
    assert "LOG_BITMASK" in slow_motor_advice(log, 10.0)


def test_only_firmware_with_that_mode_is_told_to_fly_it() -> None:
    assert "SYSTEMID" in flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.6.2"), "roll")
    assert flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.7.0"), "roll").endswith("entered from Stabilize")
    assert "SYSTEMID" not in flying_advice(record("ArduPilot DataFlash as text", "ArduCopter V3.6.9"), "roll")
    small = record("ArduPilot DataFlash", "ArduCopter V4.6.2", LOG_BITMASK=176126.0)
    assert "SYSTEMID" not in flying_advice(small, "roll")  # of a board without room for the mode
    assert "SYSTEMID" in flying_advice(record("MAVLink telemetry", "ArduPilot", SID_AXIS=0.0), "roll")
    assert "stick" in flying_advice(record("PX4 ULog as CSV", ""), "roll")
    assert "roll sweep" in flying_advice(record("CSV", ""), "roll")
    assert "SID_AXIS 12" in flying_advice(record("ArduPilot DataFlash", "ArduCopter V4.6.2"), "yaw")
    assert "--map" in logging_advice(record("CSV", ""), 0.0)


@pytest.mark.parametrize(
    ("firmware", "channel", "sentence"),
    [
        ("Betaflight 4.4.0", "p_setpoint", "set blackbox_disable_setpoint = OFF"),
        ("Betaflight 3.1.5 (4646f9d) OMNIBUSF4", "p_setpoint", "fly Betaflight 4.0 or newer"),
        ("Betaflight 4.2.0", "ax", "set blackbox_record_acc = ON"),
        ("Betaflight 4.3.0", "ax", "set blackbox_disable_acc = OFF"),
        ("Betaflight 4.5.0", "phi_setpoint", ""),
        ("INAV 7.1.0", "p_setpoint", ""),
    ],
)
def test_a_blackbox_gets_settings_of_its_version(firmware: str, channel: str, sentence: str) -> None:
    told = logging_advice(record("Betaflight blackbox", firmware), 0.0, (channel,))
    assert sentence in told if sentence else not told


def test_telemetry_is_never_logged_faster_but_read_from_the_card() -> None:
    assert "SD card" in logging_advice(record("MAVLink telemetry", "ArduPilot", LOG_BITMASK=1.0), 5.0)


def test_a_log_has_one_value_of_its_mask() -> None:
    """Messages that are missing or slow, sweeps that are logged every second loop, sensors: all ask for one value."""
    time_s = np.arange(20) / 10.0
    topics = tuple(
        Topic(name=name, time_s=time_s, values=np.zeros((1, 20)), channels=(Channel(name=channel, unit="rad/s"),))
        for name, channel in (("RATE", "p_setpoint"), ("IMU", "p"))
    )
    parameters = {"LOG_BITMASK": 176124.0, "SCHED_LOOP_RATE": 400.0, "INS_LOG_BAT_MASK": 1.0}
    source = Source(name="a", format="ArduPilot DataFlash", sha256="", firmware="ArduCopter V4.6.2")
    slow = FlightRecord(source=source, topics=topics, parameters=parameters)
    firmware = named(source.firmware)
    told = [
        logging_advice(slow, 10.0),
        sensor_advice(slow, 10.0),
        missing_rate(firmware, parameters).message,
        *(finding.message for finding in slow_topics(topics, parameters, firmware)),
        *(finding.message for finding in decimation_findings(topics, [300.0], parameters)),
    ]
    assert len(told) == 6
    assert {value for words in told for value in re.findall(r"LOG_BITMASK = (\d+)", words)} == {"438271"}


def test_what_a_storage_loses_already_is_not_asked_of_it() -> None:
    """RATE of a set bit at 24 Hz: the card is too slow, and more bits make it slower."""
    time_s = np.arange(48) / 24.0
    rate = Topic(
        name="RATE", time_s=time_s, values=np.zeros((1, 48)), channels=(Channel(name="p_setpoint", unit="rad/s"),)
    )
    source = Source(name="a", format="ArduPilot DataFlash", sha256="", firmware="APM:Copter V3.4-rc2")
    slow = FlightRecord(source=source, topics=(rate,), parameters={"LOG_BITMASK": 32767.0})
    assert "storage is too slow" in logging_advice(slow, 24.0)
    assert "set LOG_BITMASK" not in logging_advice(slow, 24.0)
