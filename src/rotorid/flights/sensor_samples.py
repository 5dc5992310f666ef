"""Samples of the sensors of a flight in the air, and what their noise is compared with: throttle and motor speeds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import FlightRecord, Intervals
from rotorid.signal.airborne import within
from rotorid.signal.dead_sensors import dead_accelerometer, dead_gyro
from rotorid.typing import FloatArray

LEAST_RATE_HZ = 200.0
"""In slower channels the rotors' lines alias."""

LINES_ABOVE_HZ = 30.0
"""Below it is the motion of the vehicle."""

OF_RATE = 0.4
"""Share of the rate of a log above which no line is listed: faster vibration aliases."""

Stage = Literal["before", "after"]


class Sensor(NamedTuple):
    """Samples of a channel in the air."""

    channel: str
    stage: Stage
    topic: str
    source: str
    time_s: FloatArray
    values: FloatArray

    @property
    def rate_hz(self) -> float:
        return float(1.0 / np.median(np.diff(self.time_s))) if self.time_s.size > 1 else 0.0


def sensors_of(record: FlightRecord, flights: Intervals) -> Iterator[Sensor]:
    """Gyro and accelerometer before and after the filters, each at the highest logged rate."""
    unfiltered = autopilot_of(record).log.unfiltered_topic
    rates = () if dead_gyro(record) else ("p", "q", "r")
    forces = () if dead_accelerometer(record) else ("ax", "ay", "az")
    for channel in (*rates, *forces):
        before = samples_of(record, (f"{channel}_raw",), channel, "before", flights)
        after = samples_of(record, (f"{channel}_filtered", channel), channel, "after", flights)
        if before is None and unfiltered:
            before = samples_of(record, (channel,), channel, "before", flights, topic=unfiltered)
        if after is not None and before is not None and after.topic == before.topic == unfiltered:
            after = None
        yield from (sensor for sensor in (before, after) if sensor is not None)


def samples_of(
    record: FlightRecord,
    names: Sequence[str],
    channel: str,
    stage: Stage,
    flights: Intervals,
    topic: str = "",
) -> Sensor | None:
    """Samples in the air of the first channel that has a hundred; their stamps rise. ``None`` where none has."""
    for name in names:
        for found, row in record.holding(name):
            if topic and found.name != topic:
                continue
            kept = within(found.time_s, flights) & np.isfinite(found.values[row])
            time_s, values = found.time_s[kept], found.values[row][kept]
            rising = np.concatenate([[True], np.diff(time_s) > 0.0]) if time_s.size else np.zeros(0, dtype=np.bool_)
            if np.count_nonzero(rising) > 100:
                source = found.channels[row].source
                return Sensor(channel, stage, found.name, source, time_s[rising], values[rising])
    return None


@dataclass(frozen=True)
class Level:
    """The vertical axis of a map: mean motor output, thrust command or throttle stick."""

    name: str
    time_s: FloatArray
    values: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        return np.interp(time_s, self.time_s, self.values, left=np.nan, right=np.nan)


def level_of(record: FlightRecord) -> Level | None:
    """Mean of the motors, else the throttle, over which noise is mapped; ``None`` where neither is logged."""
    motors = list(record.outputs)
    for names in (motors, ["thrust_command"], ["thrust_stick"]):
        if not names or names[0] not in record:
            continue
        topic, _ = next(iter(record.holding(names[0])))
        rows = [topic.row(name) for name in names]
        values = topic.values[[place for place in rows if place is not None]].mean(axis=0)
        kept = np.isfinite(values) & np.isfinite(topic.time_s)
        if np.count_nonzero(kept) > 2:
            return Level("throttle", topic.time_s[kept], values[kept])
    return None


def rotor_speeds_hz(record: FlightRecord, time_s: FloatArray) -> FloatArray | None:
    """Turns per second of all rotors at the middles of windows, shape ``(rotors, n)``; ``None`` where none is logged.

    Parameters
    ----------
    time_s
        Middles, shape ``(n,)``; what lies outside of the speeds' own stamps becomes NaN.
    """
    names = [name for name in record.channel_names if name.startswith("motor_speed_")]
    rows = []
    for name in names:
        track = record[name]
        kept = np.isfinite(track.values) & np.isfinite(track.time_s)
        if np.count_nonzero(kept) > 2 and float(np.ptp(track.values[kept])) > 0.0:
            values = np.interp(time_s, track.time_s[kept], track.values[kept], left=np.nan, right=np.nan)
            rows.append(values / (2.0 * math.pi))
    return np.stack(rows) if rows else None
