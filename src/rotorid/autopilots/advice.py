"""What to change so that the next log of the same vehicle can answer: only what its firmware has and is not set."""

from __future__ import annotations

from collections.abc import Iterable

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import FlightRecord, Unread
from rotorid.typing import Axis

LOOP_RATE_HZ = 100.0
"""A log as fast as this shows a rate loop beyond its crossover."""


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
    if words := unread_words(record.unread, channels):
        return words
    return autopilot_of(record).advice.logging(record, rate_hz, channels)


def unread_words(unread: Iterable[Unread], channels: Iterable[str]) -> str:
    """Clauses on what a log holds near to channels that it lacks; empty where it holds nothing of the kind.

    Examples
    --------
    >>> mean = Unread(name="escRPM", channels=("motor_speed_",), why="it is the mean of all motors", rate_hz=2.0)
    >>> unread_words([mean], ["motor_speed_1"])
    'escRPM is in the log (2 Hz), but rotorid does not read it: it is the mean of all motors'
    >>> unread_words([mean], ["motor_1"])
    ''
    """
    wanted = tuple(channels)
    near = (item for item in unread if any(map(item.near, wanted)))
    rates = ((item, f" ({item.rate_hz:.3g} Hz)" if item.rate_hz else "") for item in near)
    return "; ".join(
        f"{item.name} is in the log{rate}, but rotorid does not read it: {item.why}" for item, rate in rates
    )


def absence(record: FlightRecord, *channels: str) -> str:
    """How channels are missing: ``not logged``, or ``in the log, but not read`` where they could have come from there.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> source = Source(name="a.ulg", format="PX4 ULog", sha256="")
    >>> near = Unread(name="actuator_outputs", channels=("motor_",), why="its limits are not known")
    >>> record = FlightRecord(source=source, topics=(), unread=(near,))
    >>> absence(record, "motor_1"), absence(record, "p")
    ('in the log, but not read', 'not logged')
    """
    return "in the log, but not read" if unread_words(record.unread, channels) else "not logged"


def channel_advice(record: FlightRecord, name: str, otherwise: str = "log it, or name its source with --map") -> str:
    """What to do about a channel that a log lacks: where the user chooses what is logged, which field holds it."""
    known = unread_words(record.unread, (name,))
    chosen = autopilot_of(record).log.fields_chosen
    return known or (logging_advice(record, 0.0, (name,)) if chosen else "") or otherwise


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
    return unread_words(record.unread, ("p_raw",)) or autopilot_of(record).advice.raw_gyro(record)


def motor_advice(record: FlightRecord) -> str:
    """How to log the motor outputs."""
    return unread_words(record.unread, ("motor_1",)) or autopilot_of(record).advice.motors(record)


def slow_motor_advice(record: FlightRecord, rate_hz: float) -> str:
    """How the next log holds the motor outputs faster than at a rate."""
    return autopilot_of(record).advice.slow_motors(record, rate_hz) or logging_advice(record, rate_hz)


def speed_advice(record: FlightRecord) -> str:
    """How the next log holds the speeds of the motors."""
    return unread_words(record.unread, ("motor_speed_1",)) or autopilot_of(record).advice.speeds(record)


def gains_advice(record: FlightRecord) -> str:
    """How the next log holds the gains of the rate controllers."""
    return autopilot_of(record).advice.gains


def gap_advice(record: FlightRecord) -> str:
    """How the next log has no gaps."""
    return autopilot_of(record).advice.gaps(record)


def wind_advice(record: FlightRecord) -> str:
    """How the estimator of this vehicle finds the wind; empty where it has no way."""
    return autopilot_of(record).advice.wind(record)


def move_stick(axis: Axis) -> str:
    """How to move a stick so that an ordinary flight shows the loop of its axis.

    Examples
    --------
    >>> move_stick("yaw")
    'move the yaw stick for 30 s: turn quickly by 20° to one side, then to the other, once every second'
    """
    turn = "turn quickly by 20°" if axis == "yaw" else "tilt quickly 5 to 10°"
    return f"move the {axis} stick for 30 s: {turn} to one side, then to the other, once every second"


def loop_advice(record: FlightRecord, axis: Axis, rate_hz: float) -> str:
    """What shows the rate loop of an axis better: a faster log, or, where that is fast enough, a stick that moves more.

    Parameters
    ----------
    record
        A log that shows it too little.
    axis
        Of the loop.
    rate_hz
        Rate of the slowest of command, rate and set-point.
    """
    return logging_advice(record, rate_hz) if rate_hz < LOOP_RATE_HZ else move_stick(axis)


def flying_advice(record: FlightRecord, *axes: Axis) -> str:
    """How this vehicle flies an excitation of the axes that its log lacks."""
    return autopilot_of(record).advice.flying(record, axes)
