"""What to change so that the next log of the same vehicle can answer: only what its firmware has and is not set."""

from __future__ import annotations

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import FlightRecord
from rotorid.typing import Axis


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
    return autopilot_of(record).advice.logging(record, rate_hz, channels)


def sensor_advice(record: FlightRecord, rate_hz: float) -> str:
    """How the next log holds the sensors, fast enough for the vibration of rotors.

    Parameters
    ----------
    record
        A log that does not.
    rate_hz
        Rate at which it holds them; zero where it does not.
    """
    return autopilot_of(record).advice.sensors(record, rate_hz)


def raw_gyro_advice(record: FlightRecord) -> str:
    """How the next log holds the gyro before its filters."""
    return autopilot_of(record).advice.raw_gyro(record)


def motor_advice(record: FlightRecord) -> str:
    """How to log the motor outputs."""
    return autopilot_of(record).advice.motors(record)


def speed_advice(record: FlightRecord) -> str:
    """How the next log holds the speeds of the motors."""
    return autopilot_of(record).advice.speeds


def gains_advice(record: FlightRecord) -> str:
    """How the next log holds the gains of the rate controllers."""
    return autopilot_of(record).advice.gains


def gap_advice(record: FlightRecord) -> str:
    """How the next log has no gaps."""
    return autopilot_of(record).advice.gaps(record)


def wind_advice(record: FlightRecord) -> str:
    """How the estimator of this vehicle finds the wind; empty where it has no way."""
    return autopilot_of(record).advice.wind(record)


def flying_advice(record: FlightRecord, *axes: Axis) -> str:
    """How this vehicle flies an excitation of the axes that its log lacks."""
    return autopilot_of(record).advice.flying(record, axes)
