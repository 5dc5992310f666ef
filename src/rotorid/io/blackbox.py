"""Reader of Betaflight and INAV blackbox logs: flights as a record in the vocabulary of the package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rotorid.data.channel import AXES
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import LogError
from rotorid.io.blackbox_channels import main_topic
from rotorid.io.blackbox_chirp import chirp_maneuvers, chirp_rows
from rotorid.io.blackbox_decode import Flight, flights
from rotorid.io.blackbox_findings import findings_of
from rotorid.io.blackbox_header import MAGIC, parameters_of

FORMAT = "Betaflight blackbox"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a blackbox log.

    Examples
    --------
    >>> sniff(b"H Product:Blackbox flight data recorder by Nicholas Sherlock"), sniff(b"ULog")
    (True, False)
    """
    return head.lstrip(b"\xff\x00\r\n").startswith(MAGIC)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Every flight becomes a topic ``flight N`` on the flight controller's own clock, the longest first. Body rates are
    the gyro as the controllers saw it, behind its filters: a model fitted to them carries the filters' delay. The
    commands are the mix of the four motors of a quadrotor; for other vehicles the sums of the controllers. Where on
    Earth the flight was does not enter the record.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read, or none of its flights can.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    flown, unread = _sorted(data)
    if not flown:
        raise unread[0][1] if unread else _empty(source.name)
    longest = flown[0]
    topics = tuple(main_topic(flight, chirp_rows(flight)) for flight in flown)
    if not topics[0].channels:
        raise _empty(source.name)
    return FlightRecord(
        source=replace(source, firmware=longest.header.values.get("Firmware revision", "")),
        topics=topics,
        parameters=parameters_of(longest.header),
        declared=tuple(maneuver for flight in flown for maneuver in chirp_maneuvers(flight)),
        instruments=_instruments(topics),
        findings=findings_of(flown, unread, topics),
    )


def _sorted(data: bytes) -> tuple[list[Flight], list[tuple[int, LogError]]]:
    """The flights that hold frames, longest first, and the others with the reason."""
    flown: list[Flight] = []
    unread: list[tuple[int, LogError]] = []
    for number, outcome in flights(data):
        if isinstance(outcome, LogError):
            unread.append((number, outcome))
        elif outcome.time_s.size:
            flown.append(outcome)
        else:
            unread.append((number, _empty(f"flight {number}")))
    return sorted(flown, key=lambda flight: -flight.duration_s), unread


def _instruments(topics: tuple[Topic, ...]) -> dict[str, tuple[str, ...]]:
    """Signals without feedback: the injected sweep where there is one, then the stick."""
    held = {channel.name for topic in topics for channel in topic.channels}
    present = {axis: tuple(name for name in (f"{axis}_excitation", f"{axis}_stick") if name in held) for axis in AXES}
    return {axis: names for axis, names in present.items() if names}


def _empty(name: str) -> LogError:
    return LogError(
        f"{name} holds no frame that can be read",
        needed="a blackbox log with a complete header and at least one I frame",
        remedy="download the log from the flight controller again",
    )
