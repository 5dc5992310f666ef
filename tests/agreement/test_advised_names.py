"""What advice tells a user to log is what a reader reads: every variable, topic, message and field that it can name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
from tests.unit.io.blackbox_log import END, header, intra, record_of

from rotorid.autopilots.advice import (
    channel_advice,
    logging_advice,
    motor_advice,
    raw_gyro_advice,
    sensor_advice,
    speed_advice,
    wind_advice,
)
from rotorid.autopilots.ardupilot import advice as ardupilot
from rotorid.autopilots.registry import AUTOPILOTS
from rotorid.data.record import STANDARD_UNITS, FlightRecord, Source
from rotorid.io import crazyflie
from rotorid.io.ardupilot.log import WANTED
from rotorid.io.px4.log import wanted_fields
from rotorid.reviewing.flight import logger_topics

FORMATS = {"PX4": "PX4 ULog", "ArduPilot": "ArduPilot DataFlash", "Betaflight": "Betaflight blackbox"}
FIRMWARES = {
    "PX4": ("PX4 1.6.5", "PX4 1.9.0", "PX4 1.12.3", "PX4 1.15.0", ""),
    "ArduPilot": ("ArduCopter V3.2.1", "ArduCopter V3.6.9", "ArduCopter V4.6.2", ""),
    "Betaflight": ("Betaflight 3.5.7", "Betaflight 4.2.0", "Betaflight 4.5.1", "INAV 7.1.0"),
    "Crazyflie": ("Crazyflie",),
}
PARAMETERS = {
    "PX4": ({}, {"SDLOG_PROFILE": 0.0}, {"SDLOG_PROFILE": 511.0}, {"MC_ROLL_P": 6.5}),
    "ArduPilot": ({}, {"LOG_BITMASK": 0.0, "SERVO1_FUNCTION": 0.0}, {"LOG_BITMASK": 4294967295.0}),
    "Betaflight": ({},),
    "Crazyflie": ({},),
}
NO_TOPICS = {
    # Files and words of PX4's logger that look like topics.
    "logger_topics",
}


def advised(name: str) -> Iterator[str]:
    """All that the advice for an autopilot says, over its firmwares, settings and every channel."""
    for firmware, parameters in product(FIRMWARES[name], PARAMETERS[name]):
        source = Source(name="log", format=FORMATS.get(name, name), sha256="", firmware=firmware)
        record = FlightRecord(source=source, topics=(), parameters=parameters)
        for advice in (motor_advice, speed_advice, raw_gyro_advice, wind_advice):
            yield advice(record)
        yield from (sensor_advice(record, rate_hz) for rate_hz in (0.0, 10.0))
        yield from (logging_advice(record, rate_hz) for rate_hz in (0.0, 10.0))
        for channel in STANDARD_UNITS:
            yield logging_advice(record, 0.0, (channel,))
            yield channel_advice(record, channel)


def names_in(name: str, pattern: str) -> set[str]:
    return {word for text in set(advised(name)) for word in re.findall(pattern, text)}


def test_every_autopilot_is_asked() -> None:
    assert {autopilot.name for autopilot in AUTOPILOTS} == set(FIRMWARES) == set(PARAMETERS)


def test_variables_of_a_crazyflie() -> None:
    named = names_in("Crazyflie", r"\b[a-zA-Z]+\.[a-zA-Z]\w*") - {"config.txt"}
    assert {"gyro.x", "pwm.m1_pwm", "controller.cmd_roll", "stateEstimate.pitch", "rpm.m4"} <= named
    assert named <= crazyflie.MEANINGS.keys()


@pytest.mark.parametrize("channel", sorted({meaning.channel for meaning in crazyflie.MEANINGS.values()}))
def test_the_variable_that_is_advised_for_a_channel_is_that_channel(channel: str) -> None:
    record = FlightRecord(source=Source(name="log00", format=crazyflie.FORMAT, sha256=""), topics=())
    named = re.findall(r"\b[a-zA-Z]+\.[a-zA-Z]\w*", logging_advice(record, 0.0, (channel,)).replace("config.txt", ""))
    assert not named or channel in {crazyflie.MEANINGS[variable].channel for variable in named}


def test_topics_of_px4() -> None:
    named = names_in("PX4", r"\b[a-z]+(?:_[a-z0-9]+)+\b") - NO_TOPICS
    assert {"actuator_motors", "actuator_outputs"} <= named
    assert named <= wanted_fields().keys()


@pytest.mark.parametrize("firmware", FIRMWARES["PX4"])
def test_topics_of_a_list_for_px4s_logger(firmware: str) -> None:
    """What ``review`` writes as ``logger_topics.txt``: one line for each topic, and none that the firmware lacks."""
    source = Source(name="log", format=FORMATS["PX4"], sha256="", firmware=firmware)
    text = logger_topics(FlightRecord(source=source, topics=()), wanted=tuple(STANDARD_UNITS))
    named = [line.partition(" ")[0] for line in text.splitlines()]
    assert len(named) == len(set(named))
    assert set(named) - {"parameter_update"} <= wanted_fields().keys()
    old = firmware in ("PX4 1.6.5", "PX4 1.9.0")
    assert ("actuator_outputs" in named, "actuator_controls_0" in named) == (firmware in FIRMWARES["PX4"][:3], old)
    assert ("hover_thrust_estimate" in named, "vehicle_angular_velocity" in named) == (not old, not old)


def test_messages_of_ardupilot() -> None:
    named = names_in("ArduPilot", r"\b[A-Z]{3,4}\d?\b(?!_)") - {"EKF3", "IMU"}
    assert "RCOU" in named
    assert named <= WANTED
    assert ardupilot._MESSAGE_BITS.keys() <= WANTED


def test_fields_of_betaflight(tmp_path: Path) -> None:
    """Every field of the blackbox that advice turns on holds fields of its frames, and each of them is a channel."""
    frames = {
        "pids": ("axisP[0]", "axisI[0]", "axisD[0]", "axisF[0]"),
        "rc": ("rcCommand[0]", "rcCommand[3]"),
        "setpoint": ("setpoint[0]",),
        "gyro": ("gyroADC[0]",),
        "gyrounfilt": ("gyroUnfilt[0]",),
        "acc": ("accSmooth[0]",),
        "motors": ("motor[0]",),
    }
    named = names_in("Betaflight", r"blackbox_disable_(\w+)")
    assert {"motors", "gyro", "acc", "setpoint"} <= named <= frames.keys()
    fields = [field for name in named for field in frames[name]]
    lines = (
        "H Firmware type:Cleanflight\nH Firmware revision:Betaflight 4.5.1\nH gyro_scale:0x3f800000\nH acc_1G:2048\n"
    )
    start = header(fields, inter_encoding=[0] * len(fields), inter_predictor=[0] * len(fields), lines=lines)
    record = record_of(start + intra(0, 5000, *range(len(fields))) + END, tmp_path)
    sources = {
        source for topic in record.topics for channel in topic.channels for source in channel.source.split(" + ")
    }
    assert set(fields) <= sources
