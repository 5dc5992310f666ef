"""What to change so that the next log of the same vehicle can answer: only what its firmware has and is not set."""

from __future__ import annotations

from rotorid.data.display import listed
from rotorid.data.record import FlightRecord
from rotorid.io.ardupilot import advice as ardupilot
from rotorid.io.betaflight import advice as betaflight
from rotorid.io.px4 import advice as px4
from rotorid.io.px4.versions import firmware_shown
from rotorid.typing import Axis

_OTHER_LOGGING = "log it, or name its source with --map"
_TELEMETRY = "read the log on the autopilot's SD card: telemetry is a slow copy of it"


def logging_advice(record: FlightRecord, rate_hz: float, channels: tuple[str, ...] = ()) -> str:
    """How the next log holds commands and rates, fast enough.

    Parameters
    ----------
    record
        A log that does not.
    rate_hz
        Rate of the slowest channel that is needed; zero where it is not logged.
    channels
        Those that are not logged, as far as they are known.
    """
    firmware = record.source.firmware
    if is_telemetry(record):
        return _TELEMETRY
    match autopilot_of(record):
        case "ArduPilot":
            rates_hz = ardupilot.message_rates_hz(record.topics)
            return ardupilot.logging_advice(record.parameters, firmware, rate_hz, rates_hz)
        case "PX4":
            return px4.logging_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return betaflight.field_advice(firmware, channels)
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
    if is_telemetry(record):
        return _TELEMETRY
    match autopilot_of(record):
        case "ArduPilot":
            rates_hz = ardupilot.message_rates_hz(record.topics)
            return ardupilot.sensor_advice(record.parameters, record.source.firmware, rate_hz, rates_hz)
        case "PX4":
            return px4.logging_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return betaflight.rate_advice(record.source.firmware)
        case _:
            return ""


def raw_gyro_advice(record: FlightRecord) -> str:
    """How the next log holds the gyro before its filters."""
    match autopilot_of(record):
        case "ArduPilot":
            return ardupilot.raw_gyro_advice(record.parameters, record.source.firmware)
        case "PX4":
            return px4.raw_gyro_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return betaflight.raw_gyro_advice(record.source.firmware)
        case _:
            return ""


def motor_advice(record: FlightRecord) -> str:
    """How the next log holds what the motors were told."""
    match autopilot_of(record):
        case "ArduPilot":
            return ardupilot.motor_advice(record.parameters)
        case "PX4":
            return px4.motor_advice(record.parameters, _px4_firmware(record))
        case "Betaflight":
            return betaflight.field_advice(record.source.firmware, ("motor_1",))
        case _:
            return ""


def speed_advice(record: FlightRecord) -> str:
    """How the next log holds the speeds of the motors."""
    how = {"ArduPilot", "PX4", "Betaflight"} & {autopilot_of(record)}
    return f"log the motors' speeds{' (bidirectional DShot)' if how else ''} at 40 Hz and more"


def gains_advice(record: FlightRecord) -> str:
    """How the next log holds the gains of the rate controllers."""
    if is_telemetry(record):
        return _TELEMETRY
    match autopilot_of(record):
        case "ArduPilot" | "PX4":
            return "log the parameters"
        case "Betaflight":
            return "fly Betaflight 4.0 or newer, whose gains are known"
        case _:
            return "use a log of the autopilot, which holds its parameters"


def gap_advice(record: FlightRecord) -> str:
    """How the next log has no gaps."""
    match autopilot_of(record):
        case "ArduPilot":
            return "use a faster SD card, a larger LOG_FILE_BUFSIZE, or fewer messages (LOG_BITMASK)"
        case "PX4":
            return px4.gap_advice(record.parameters)
        case "Betaflight":
            return betaflight.gap_advice(record.source.firmware)
        case _:
            return "log less"


def wind_advice(record: FlightRecord) -> str:
    """How the estimator of this vehicle finds the wind; empty where it has no way."""
    match autopilot_of(record):
        case "ArduPilot":
            return ardupilot.wind_advice(record.parameters)
        case "PX4":
            return px4.wind_advice(record.parameters)
        case _:
            return ""


def flying_advice(record: FlightRecord, *axes: Axis) -> str:
    """How this vehicle flies an excitation of the axes that its log lacks."""
    match autopilot_of(record):
        case "ArduPilot":
            return ardupilot.flying_advice(record.parameters, record.source.firmware, *axes)
        case "PX4" | "Betaflight" | "Crazyflie":
            return f"sweep the {listed(axes)} stick, slow to fast, for a minute or more"
        case _:
            return f"fly a {listed(axes)} sweep, slow to fast, for a minute or more"


def is_telemetry(record: FlightRecord) -> bool:
    """Whether a log came over the radio, from an autopilot that keeps a faster one."""
    return record.source.format.startswith("MAVLink")


def autopilot_of(record: FlightRecord) -> str:
    """``ArduPilot``, ``PX4``, ``Betaflight``, ``Crazyflie``; of telemetry the one that sent it; else the format."""
    name = (record.source.firmware if is_telemetry(record) else record.source.format).partition(" ")[0]
    return "ArduPilot" if name == "ArduCopter" else name


def _px4_firmware(record: FlightRecord) -> str:
    """The firmware by its name, and by what the log holds: builds without tags call themselves 1.8.0."""
    sources = (channel.source.partition("[")[0] for topic in record.topics for channel in topic.channels)
    return firmware_shown(record.source.firmware, (*sources, *record.parameters))
