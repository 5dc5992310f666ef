"""What to change so that the next log of the same vehicle can answer: only what its firmware has and is not set."""

from __future__ import annotations

from rotorid.data.record import FlightRecord

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
    if record.source.format.startswith("ArduPilot"):
        from rotorid.io.ardupilot import advice

        return advice.logging_advice(record.parameters, record.source.firmware, rate_hz)
    if record.source.format.startswith("PX4"):
        from rotorid.io.px4 import log

        sentence = log.logging_advice(record.parameters)
        return sentence[0].lower() + sentence[1:].rstrip(".") if sentence.startswith("Set ") else sentence.rstrip(".")
    return _OTHER_LOGGING


def flying_advice(record: FlightRecord) -> str:
    """How to fly an excitation, with places for ``axis`` and ``sid_axis``."""
    if record.source.format.startswith("ArduPilot"):
        from rotorid.io.ardupilot import advice

        return advice.flying_advice(record.source.firmware)
    return _STICKS if record.source.format.startswith("PX4") else _OTHER_FLYING
