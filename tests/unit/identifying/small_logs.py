"""Logs of a few seconds, made up of the channels that a test needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.flights.flights import Flight
from rotorid.flights.selection import Selection
from rotorid.typing import Axis, FloatArray

DURATION_S = 10.0


def topic(name: str, rate_hz: float, channels: Mapping[str, FloatArray | float]) -> Topic:
    time_s = np.arange(0.0, DURATION_S, 1.0 / rate_hz)
    return Topic(
        name=name,
        time_s=time_s,
        channels=tuple(Channel(name=one, unit=STANDARD_UNITS.get(one, "1")) for one in channels),
        values=np.stack([np.broadcast_to(values, time_s.shape) for values in channels.values()]),
    )


def at_rest(name: str, rate_hz: float, *channels: str) -> Topic:
    return topic(name, rate_hz, dict.fromkeys(channels, 0.0))


def log(*topics: Topic, name: str = "flight.csv") -> FlightRecord:
    return FlightRecord(source=Source(name=name, format="CSV", sha256=name), topics=topics)


def sweeps(record: FlightRecord, axes: Sequence[Axis]) -> Selection:
    maneuvers = [Maneuver(axis=axis, kind="sweep", start_s=0.0, stop_s=DURATION_S, origin="found") for axis in axes]
    return Selection(fitted=tuple(Flight(record, maneuver) for maneuver in maneuvers), unseen=())
