"""Which autopilot: of a log, by a name, by parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from rotorid.autopilots.ardupilot.autopilot import ARDUPILOT
from rotorid.autopilots.autopilot import Autopilot
from rotorid.autopilots.betaflight.autopilot import BETAFLIGHT
from rotorid.autopilots.crazyflie import CRAZYFLIE
from rotorid.autopilots.px4.autopilot import PX4

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord

AUTOPILOTS: tuple[Autopilot, ...] = (PX4, ARDUPILOT, BETAFLIGHT, CRAZYFLIE)

# Who sends telemetry under no name and with ArduPilot's parameters bends thrust as ArduPilot does.
UNKNOWN = Autopilot(name="", key="", telemetry=ARDUPILOT.telemetry)
"""Answers "not known" to everything."""

_TELEMETRY = "MAVLink"
_USE_THE_CARD = "read the log on the autopilot's SD card: telemetry is only a slow copy"


def autopilot_of(record: FlightRecord) -> Autopilot:
    """The autopilot that flew a log: by the format of its own logs, of telemetry the one that sent it.

    Of telemetry, ``log`` is what the autopilot sends.

    Parameters
    ----------
    record
        The log.

    Examples
    --------
    >>> from rotorid.data.record import FlightRecord, Source
    >>> def of(format, firmware):
    ...     return FlightRecord(source=Source(name="log", format=format, sha256="", firmware=firmware), topics=())
    >>> autopilot_of(of("PX4 ULog", "")).name, autopilot_of(of("MAVLink telemetry", "ArduCopter V4.5.7")).name
    ('PX4', 'ArduPilot')
    >>> autopilot_of(of("CSV", "")).name
    ''
    """
    source = record.source
    if source.format.partition(" ")[0] != _TELEMETRY:
        return next((autopilot for autopilot in AUTOPILOTS if source.format.startswith(autopilot.name)), UNKNOWN)
    sender = named(source.firmware)
    return replace(
        sender,
        log=sender.telemetry,
        advice=replace(
            sender.advice,
            logging=lambda _record, _rate_hz, _channels: _USE_THE_CARD,
            sensors=lambda _record, _rate_hz: _USE_THE_CARD,
            gains=_USE_THE_CARD,
        ),
    )


def writer_of(record: FlightRecord) -> Autopilot:
    """The autopilot that wrote a log itself; unknown of telemetry and of tables.

    Examples
    --------
    >>> from rotorid.data.record import FlightRecord, Source
    >>> source = Source(name="log", format="MAVLink telemetry", sha256="", firmware="PX4 1.15.0")
    >>> writer_of(FlightRecord(source=source, topics=())).name
    ''
    """
    found = autopilot_of(record)
    return found if found.log.own else UNKNOWN


def named(text: str) -> Autopilot:
    """The autopilot that is called like this, by its name, its key or the first word of its firmware's name.

    Parameters
    ----------
    text
        In upper or lower case.

    Examples
    --------
    >>> named("PX4 1.15.2").key, named("px4").name, named("ArduCopter V4.6.2").name, named("simple").name
    ('px4', 'PX4', 'ArduPilot', '')
    """
    first = text.partition(" ")[0]
    return next(
        (autopilot for autopilot in AUTOPILOTS if first in (autopilot.name, autopilot.key, *autopilot.called)), UNKNOWN
    )


def by_file(name: str) -> Autopilot:
    """The autopilot whose own logs have names like this; unknown of tables and of telemetry.

    Examples
    --------
    >>> by_file("roll.ulg").name, by_file("00000012.BIN").name, by_file("rig.csv").name
    ('PX4', 'ArduPilot', '')
    """
    suffix = name.rpartition(".")[2].lower()
    return next((each for each in AUTOPILOTS if each.log_format == suffix != UNKNOWN.log_format), UNKNOWN)


def by_gains(parameters: Mapping[str, float]) -> Autopilot:
    """The autopilot whose gains are among some parameters.

    Examples
    --------
    >>> by_gains({"MC_ROLLRATE_P": 0.15}).name, by_gains({}).name
    ('PX4', '')
    """
    return next((autopilot for autopilot in AUTOPILOTS if autopilot.gain and autopilot.gain in parameters), UNKNOWN)
