"""A flight: an interval of a log in which something was flown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.findings import refusal
from rotorid.data.record import Channel, FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne
from rotorid.signal.kinematics import EARTH_VELOCITIES, VELOCITIES, to_body
from rotorid.typing import Axis, FloatArray


class Samples(NamedTuple):
    """Finite samples of a channel, in one place of its log.

    Parameters
    ----------
    time_s, values
        Shape ``(n,)``.
    """

    time_s: FloatArray
    values: FloatArray
    unit: str


class SteadyDrag(NamedTuple):
    """Drag of a steady wind over mass, fixed to the earth (:mod:`rotorid.flights.steady_wind`).

    Parameters
    ----------
    north, east
        In m/s².
    heave_share
        Share of it that acts along the rotors too: one for drag of one size along all axes, zero for rotors that drag
        in their plane alone.
    """

    north: float
    east: float
    heave_share: float = 0.0


@dataclass(frozen=True)
class Flight:
    """A maneuver and its log.

    Parameters
    ----------
    record
        The log.
    maneuver
        What was flown, and when.
    steady_drag
        Drag of a steady wind, where the vehicle leaned against it and its model knows of that.
    """

    record: FlightRecord
    maneuver: Maneuver
    steady_drag: SteadyDrag | None = None

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
        """Finite samples of a channel within the maneuver, for each place in the log."""
        for topic, row in self.record.holding(name):
            inside = topic.within(self.maneuver.start_s, self.maneuver.stop_s)
            time_s, values = topic.time_s[inside], topic.values[row][inside]
            known = np.isfinite(values)
            yield Samples(time_s[known], values[known], topic.channels[row].unit)

    def body_velocity(self, name: str) -> FloatArray:
        """Samples of ``u``, ``v`` or ``w`` within the maneuver: those of the log, or velocities over the earth turned.

        Parameters
        ----------
        name
            Of the velocity.

        Returns
        -------
        FloatArray
            Shape ``(n,)``; empty where the log holds neither.
        """
        for found in self.samples(name):
            return found.values
        parts = [next(self.samples(name), None) for name in (*EARTH_VELOCITIES, *ATTITUDE)]
        known = [part for part in parts if part is not None and part.time_s.size > 1]
        if len(known) < len(parts):
            return np.zeros(0)
        time_s = known[0].time_s
        rows = [np.interp(time_s, samples.time_s, samples.values) for samples in known[:3]]
        # An angle that jumps by a turn does so between two samples.
        rows += [np.interp(time_s, samples.time_s, np.unwrap(samples.values)) for samples in known[3:]]
        history = TimeHistory(
            values=np.stack(rows),
            channels=tuple(Channel(name=name, unit="") for name in (*EARTH_VELOCITIES, *ATTITUDE)),
            sample_rate_hz=(time_s.size - 1) / float(time_s[-1] - time_s[0]),
            start_s=float(time_s[0]),
        )
        return np.asarray(to_body(history, history.values[:3])[VELOCITIES.index(name)])


def overlap(maneuver: Maneuver, other: Maneuver) -> bool:
    """Whether two intervals of one log have a part in common."""
    return maneuver.start_s < other.stop_s and other.start_s < maneuver.stop_s


def longest_flight(record: FlightRecord, *, or_whole: bool = True, guessed: bool = True) -> tuple[float, float]:
    """Start and stop of the longest stretch in the air.

    Parameters
    ----------
    or_whole
        Whether the whole log stands in where it shows neither take-off nor landing, as in records that were cut for
        identification.
    guessed
        Whether the activity of sensors decides, which mistakes calm flight for the ground.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show it and may not be taken whole, or it has one sample.
    """
    try:
        found = airborne(record)
    except InsufficientDataError as error:
        if not or_whole or never_flew(error):
            raise
        require_duration(record)
        return record.start_s, record.stop_s
    return found.longest if guessed or found.by_thrust else (record.start_s, record.stop_s)


def require_duration(record: FlightRecord) -> None:
    """Refuse a log with samples of one moment only."""
    if record.start_s < record.stop_s:
        return
    name = record.source.name
    message = f"{name} contains samples of one moment only"
    raise InsufficientDataError(
        message,
        needed="a flight of some seconds",
        remedy="give another log, or check how it was written",
        findings=[refusal("record_too_short", name, f"{message}.")],
    )


def never_flew(error: InsufficientDataError) -> bool:
    """Whether a log was refused because its vehicle never flew."""
    return any(finding.kind == "never_airborne" for finding in error.findings)
