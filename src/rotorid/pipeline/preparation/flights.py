"""A flight: an interval of a log in which something was flown."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rotorid.data.record import FlightRecord, Maneuver
from rotorid.typing import Axis, FloatArray


class Samples(NamedTuple):
    """Finite samples of a channel, in one place of its log.

    Parameters
    ----------
    time_s, values
        Shape ``(n,)``.
    unit
        Of the values.
    """

    time_s: FloatArray
    values: FloatArray
    unit: str


class Flight(NamedTuple):
    """A maneuver and the log that holds it.

    Parameters
    ----------
    record
        The log.
    maneuver
        What was flown, and when.
    """

    record: FlightRecord
    maneuver: Maneuver

    @property
    def axis(self) -> Axis:
        """Axis of the maneuver."""
        return self.maneuver.axis

    @property
    def inside(self) -> bool:
        """Whether any part of the maneuver lies within the record."""
        return self.maneuver.start_s < self.record.stop_s and self.maneuver.stop_s > self.record.start_s

    def overlaps(self, other: Flight) -> bool:
        """Whether any part of another flight is the same data, also when the log was read again."""
        same = self.record is other.record or self.record.source.sha256 == other.record.source.sha256
        return same and overlap(self.maneuver, other.maneuver)

    def samples(self, name: str) -> Iterator[Samples]:
        """Finite samples of a channel within the maneuver, for each place of the log that holds it."""
        for topic, row in self.record.holding(name):
            values = topic.values[row]
            kept = (topic.time_s >= self.maneuver.start_s) & (topic.time_s <= self.maneuver.stop_s)
            kept &= np.isfinite(values)
            yield Samples(topic.time_s[kept], values[kept], topic.channels[row].unit)


def overlap(one: Maneuver, other: Maneuver) -> bool:
    """Whether two intervals of one log have a part in common."""
    return one.start_s < other.stop_s and other.start_s < one.stop_s
