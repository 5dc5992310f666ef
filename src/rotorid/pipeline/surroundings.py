"""The quiet time around maneuvers, which belongs to their data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rotorid.data.channel import AXES
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.pipeline.building import is_logged
from rotorid.pipeline.flights import flights_by_thrust
from rotorid.pipeline.instruments import Flown
from rotorid.signal.airborne import Airborne
from rotorid.signal.clock import source_topic
from rotorid.signal.segment import find_excitations


def with_surroundings(flown: Sequence[Flown], margin_s: float, channels: Sequence[str] = ()) -> tuple[Flown, ...]:
    """Maneuvers with some of the time before and after them; those that then touch become one.

    A record that ends with its maneuver is seen by windows that all fade out there: the answer to the last of the
    excitation comes when the window is weaker than it was for the excitation, which biases the response by some degrees
    near the end of a sweep. With a window's length of what came after, every sample is seen by every part of a window.

    Other maneuvers are barriers, so that nothing that is kept unseen is looked at, and so are the ends of the topics in
    which the maneuver stands: beyond them a channel would come from another place, filtered otherwise. So are take-off
    and landing. Intervals that the user gave are obeyed as they are.

    Parameters
    ----------
    flown
        Records and maneuvers.
    margin_s
        How much to take along on either side, where the record has it.
    channels
        What will be read.
    """
    wider: list[Flown] = []
    for record in dict.fromkeys(record for record, _ in flown):
        own = sorted((m for r, m in flown if r is record), key=lambda m: m.start_s)
        barriers = [m for m in _all_excitations(record) if not any(_overlap(m, mine) for mine in own)]
        flights = flights_by_thrust(record)
        around = (_widened(record, m, margin_s, barriers, channels, _flight_around(flights, m)) for m in own)
        for maneuver in around:
            last = wider[-1] if wider else None
            if last is not None and last[0] is record and maneuver.start_s < last[1].stop_s:
                wider[-1] = (record, replace(last[1], stop_s=max(last[1].stop_s, maneuver.stop_s)))
            else:
                wider.append((record, maneuver))
    return tuple(wider)


def _all_excitations(record: FlightRecord) -> list[Maneuver]:
    return [maneuver for axis in AXES for maneuver in find_excitations(record, axis)]  # type: ignore[arg-type]


def _flight_around(flights: Airborne | None, maneuver: Maneuver) -> tuple[float, float]:
    """Start and stop of the flight in which a maneuver was flown, where thrust tells."""
    for start_s, stop_s in flights.intervals if flights else ():
        if start_s <= 0.5 * (maneuver.start_s + maneuver.stop_s) <= stop_s:
            return start_s, stop_s
    return -math.inf, math.inf


def _widened(
    record: FlightRecord,
    own: Maneuver,
    margin_s: float,
    barriers: Sequence[Maneuver],
    channels: Sequence[str],
    flight: tuple[float, float],
) -> Maneuver:
    if own.origin == "given":
        return own
    topics = [
        source_topic(record, name, own.start_s, own.stop_s)[0]
        for name in channels
        if is_logged(record, name, own.start_s, own.stop_s)
    ]
    flight_start_s, flight_stop_s = flight
    first = max((float(topic.time_s[0]) for topic in topics), default=record.start_s)
    last = min((float(topic.time_s[-1]) for topic in topics), default=record.stop_s)
    first, last = max(first, flight_start_s), min(last, flight_stop_s)
    earliest = max([first, *(other.stop_s for other in barriers if other.stop_s <= own.start_s)])
    latest = min([last, *(other.start_s for other in barriers if other.start_s >= own.stop_s)])
    return replace(
        own,
        start_s=min(own.start_s, max(own.start_s - margin_s, earliest)),
        stop_s=max(own.stop_s, min(own.stop_s + margin_s, latest)),
    )


def _overlap(a: Maneuver, b: Maneuver) -> bool:
    return a.start_s < b.stop_s and b.start_s < a.stop_s
