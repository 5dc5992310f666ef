"""What to change so that the next log of the same vehicle can answer: only what its firmware has and is not set."""

from __future__ import annotations

from rotorid.data.record import FlightRecord
from rotorid.io.ardupilot import advice as ardupilot
from rotorid.io.px4 import advice as px4
from rotorid.io.px4.versions import firmware_shown

_OTHER_LOGGING = "log it, or name its source with --map"
_STICKS = "sweep the {axis} stick, slow to fast, for a minute or more"
_OTHER_FLYING = "fly a {axis} sweep, slow to fast, for a minute or more, or name one with --segment"


def logging_advice(record: FlightRecord, rate_hz: float) -> str:
    """How the next log holds commands and rates, fast enough.

    Parameters
    ----------
    record
        A log that does not.
    rate_hz
        Rate of the slowest channel that is needed; zero where it is not logged.
    """
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.logging_advice(record.parameters, record.source.firmware, rate_hz)
        case "PX4":
            return px4.logging_advice(record.parameters, _px4_firmware(record))
        case _:
            return _OTHER_LOGGING


def sensor_advice(record: FlightRecord, rate_hz: float) -> str:
    """How the next log holds the sensors, fast enough for the vibration of rotors.

    Parameters
    ----------
    record
        A log that does not.
    rate_hz
        Rate at which it holds them; zero where it does not.
    """
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.sensor_advice(record.parameters, record.source.firmware, rate_hz)
        case "PX4":
            return px4.logging_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return "set blackbox_sample_rate to 1 kHz and more"
        case _:
            return ""


def raw_gyro_advice(record: FlightRecord) -> str:
    """How the next log holds the gyro before its filters."""
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.raw_gyro_advice(record.parameters, record.source.firmware)
        case "PX4":
            return px4.raw_gyro_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return "set debug_mode = GYRO_SCALED, or log gyroUnfilt from 4.4 on"
        case _:
            return ""


def motor_advice(record: FlightRecord) -> str:
    """How the next log holds what the motors were told."""
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.motor_advice(record.parameters)
        case "PX4":
            return px4.motor_advice(_px4_firmware(record))
        case "Betaflight":
            return "enable the motors in the blackbox (blackbox_disable_motors = OFF)"
        case _:
            return ""


def wind_advice(record: FlightRecord) -> str:
    """How the estimator of this vehicle finds the wind; empty where it has no way."""
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.wind_advice(record.parameters)
        case "PX4":
            return px4.wind_advice(record.parameters)
        case _:
            return ""


def flying_advice(record: FlightRecord) -> str:
    """How to fly an excitation, with places for ``axis`` and ``sid_axis``."""
    match _autopilot(record):
        case "ArduPilot":
            return ardupilot.flying_advice(record.source.firmware)
        case "PX4":
            return _STICKS
        case _:
            return _OTHER_FLYING


def _autopilot(record: FlightRecord) -> str:
    return record.source.format.partition(" ")[0]


def _px4_firmware(record: FlightRecord) -> str:
    """The firmware by its name, and by what the log holds: builds without tags call themselves 1.8.0."""
    sources = (channel.source.partition("[")[0] for topic in record.topics for channel in topic.channels)
    return firmware_shown(record.source.firmware, (*sources, *record.parameters))
