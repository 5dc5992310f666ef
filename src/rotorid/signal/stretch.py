"""A part of a record as a record of its own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rotorid.data.record import FlightRecord, Intervals, Topic


def stretch(record: FlightRecord, start_s: float, stop_s: float) -> FlightRecord:
    """The part of a record between two times; its parameters and findings stay.

    Parameters
    ----------
    start_s, stop_s
        On the log's own clock; declared maneuvers that reach beyond are left out.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source
    >>> rates = Topic(name="RATE", time_s=[0.0, 0.1, 0.2], channels=(Channel(name="p", unit="rad/s"),),
    ...               values=[[1.0, 2.0, 3.0]])
    >>> record = FlightRecord(source=Source(name="a", format="", sha256=""), topics=(rates,))
    >>> stretch(record, 0.05, 0.25)["p"].values.tolist()
    [2.0, 3.0]
    """
    status = record.status
    return replace(
        record,
        topics=tuple(part for topic in record.topics if (part := _part(topic, start_s, stop_s)) is not None),
        declared=tuple(
            maneuver for maneuver in record.declared if maneuver.start_s >= start_s and maneuver.stop_s <= stop_s
        ),
        status=replace(
            status,
            armed=_inside(status.armed, start_s, stop_s),
            in_air=_inside(status.in_air, start_s, stop_s),
            unlogged=_clipped(status.unlogged, start_s, stop_s),
            direct_rates=_clipped(status.direct_rates, start_s, stop_s),
            planned=_clipped(status.planned, start_s, stop_s),
            modes=tuple(
                (name, max(a, start_s), min(b, stop_s)) for name, a, b in status.modes if a < stop_s and b > start_s
            ),
        ),
    )


def _part(topic: Topic, start_s: float, stop_s: float) -> Topic | None:
    low, high = np.searchsorted(topic.time_s, [start_s, stop_s])
    if low >= high:
        return None
    return replace(topic, time_s=topic.time_s[low:high], values=topic.values[:, low:high])


def _inside(intervals: Intervals | None, start_s: float, stop_s: float) -> Intervals | None:
    return None if intervals is None else _clipped(intervals, start_s, stop_s)


def _clipped(intervals: Iterable[tuple[float, float]], start_s: float, stop_s: float) -> Intervals:
    return tuple((max(a, start_s), min(b, stop_s)) for a, b in intervals if a < stop_s and b > start_s)
