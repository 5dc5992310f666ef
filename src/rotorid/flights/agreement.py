r"""Channels that must agree in the mean: specific force and gravity, copies of a gyro, velocity and position.

These hold in any flight, whatever flew it. From one instant to another the velocity over the earth changes by what
specific force and gravity make together, so that over a flight of the length :math:`T`

.. math:: -\overline{f_{down}} + \Delta w / T = g, \qquad
    f_{down} = -a_x \sin\theta + a_y \cos\theta \sin\phi + a_z \cos\theta \cos\phi

A position changes by the integral of its velocity, and two gyros on one vehicle turn alike. Noise and filters leave
means over seconds alone. What a log lacks is not compared; :mod:`rotorid.flights.consistency` compares motions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Intervals, Topic
from rotorid.signal.dead_sensors import dead_accelerometer
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_LEAST_S, _MARGIN_S = 20.0, 1.0
"""A flight that is shorter is not judged; so much of both ends may be take-off and touch-down."""

_LOAD_TOLERANCE = 0.1
"""Accelerometers of flight controllers are right within 3 %, and vibration shifts their mean by some percents."""

_UNKNOWN_CHANGE_M_S = 4.0
"""Climb rates at both ends of a flight differ by less, where they are not logged."""

_GRID_HZ, _SMOOTHED_S = 20.0, 0.2
_GYRO_SCALE, _GYRO_CORRELATION, _TURNING_RAD_S = 0.15, 0.8, 0.05
_WINDOW_S, _MOVED_M = 4.0, 1.0
_SAME: Mapping[str, tuple[float, float]] = MappingProxyType({"down": (3.0, 0.0)})
_SAME_HORIZONTAL = (1.5, 0.6)
"""Largest ratio of changes, and least correlation of their ranks. Heights come from a barometer, and estimators correct
them on the way: only another unit, axis or sign shows there."""

_FEWEST = 8


def channel_agreement(record: FlightRecord, flights: Intervals) -> tuple[Finding, ...]:
    """A warning for each pair of channels that contradict each other in flight.

    Parameters
    ----------
    flights
        In the air, on the log's own clock.
    """
    long = tuple((start_s, stop_s) for start_s, stop_s in flights if stop_s - start_s >= _LEAST_S)
    if not long:
        return ()
    return (*_load_factor(record, long), *_gyros(record, long), *_velocities(record, long))


def _load_factor(record: FlightRecord, flights: Intervals) -> Iterator[Finding]:
    """Mean specific force along the vertical against gravity, over the longest flight."""
    names = record.channel_names
    if not {"ax", "ay", "az", "phi", "theta"} <= set(names) or dead_accelerometer(record):
        return
    start_s, stop_s = max(flights, key=lambda flight: flight[1] - flight[0])
    clock = np.arange(start_s + _MARGIN_S, stop_s - _MARGIN_S, 1.0 / _GRID_HZ)
    force = [_means(record, name, clock) for name in ("ax", "ay", "az")]
    phi, theta = (_at(record, name, clock) for name in ("phi", "theta"))
    if phi is None or theta is None or any(row is None for row in force):
        return
    ax, ay, az = (row for row in force if row is not None)
    down = -np.sin(theta) * ax + np.cos(theta) * (np.sin(phi) * ay + np.cos(phi) * az)
    length_s = float(clock[-1] - clock[0])
    climb = _at(record, "velocity_down", clock)
    change = 0.0 if climb is None else float(climb[-1] - climb[0]) / length_s
    unsure = _UNKNOWN_CHANGE_M_S / length_s / STANDARD_GRAVITY_M_S2 if climb is None else 0.0
    factor = (change - float(np.mean(down))) / STANDARD_GRAVITY_M_S2
    if abs(factor - 1.0) > _LOAD_TOLERANCE + unsure:
        yield warn(
            "channels_disagree",
            "az",
            f"Specific force averages {factor:.2f} g along the vertical over {length_s:.0f} s of flight; gravity is "
            "1 g. The accelerometer has another scale, unit or mounting: check its calibration. Thrust computed from "
            "it is wrong by this factor.",
            load_factor=factor,
            start_s=float(clock[0]),
            stop_s=float(clock[-1]),
        )


def _gyros(record: FlightRecord, flights: Intervals) -> Iterator[Finding]:
    """Copies of a gyro against the first, below a few hertz, where all filters pass."""
    start_s, stop_s = max(flights, key=lambda flight: flight[1] - flight[0])
    clock = np.arange(start_s, stop_s, 1.0 / _GRID_HZ)
    for name in RATES:
        sources = [(topic, row) for topic, row in record.holding(name) if topic.sample_rate_hz >= _GRID_HZ]
        rows = [(topic.place(row), _mean_at(topic, row, clock, _SMOOTHED_S)) for topic, row in sources]
        known = [(place, row - row.mean()) for place, row in rows if row is not None]
        for place, other in known[1:]:
            chosen, first = known[0]
            if min(float(np.std(first)), float(np.std(other))) < _TURNING_RAD_S:
                continue
            correlation = float(np.corrcoef(first, other)[0, 1])
            scale = float(np.std(other) / np.std(first))
            if correlation < _GYRO_CORRELATION or abs(scale - 1.0) > _GYRO_SCALE:
                yield warn(
                    "channels_disagree",
                    name,
                    f"{name} of {place} is {scale:.2f} times that of {chosen} (correlation "
                    f"{correlation:.2f}): one of the two gyros is wrong. Results are those of {chosen}.",
                    scale=scale,
                    correlation=correlation,
                )


def _velocities(record: FlightRecord, flights: Intervals) -> Iterator[Finding]:
    """Changes of position over a few seconds against the integral of the velocity; a reset moves one of them alone."""
    for position, velocity in (("north", "velocity_north"), ("east", "velocity_east"), ("down", "velocity_down")):
        moved, flown = [], []
        for start_s, stop_s in flights:
            clock = np.arange(start_s, stop_s, 1.0 / _GRID_HZ)
            place, speed = _at(record, position, clock), _at(record, velocity, clock)
            if place is None or speed is None:
                break
            total = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / _GRID_HZ)])
            edges = range(0, clock.size, round(_WINDOW_S * _GRID_HZ))
            moved += [float(place[end] - place[begin]) for begin, end in pairwise(edges)]
            flown += [float(total[end] - total[begin]) for begin, end in pairwise(edges)]
        if len(moved) < _FEWEST or float(np.std(flown)) < _MOVED_M or float(np.std(moved)) < _MOVED_M:
            continue
        # The middle of all slopes passes by windows in which the estimate was reset.
        weights = np.abs(flown) > 0.5 * float(np.std(flown))
        scale = float(np.median(np.array(moved)[weights] / np.array(flown)[weights]))
        correlation = _rank_correlation(np.array(moved), np.array(flown))
        most, least = _SAME.get(position, _SAME_HORIZONTAL)
        if correlation < least or not 1.0 / most < scale < most:
            yield warn(
                "channels_disagree",
                velocity,
                f"{position} changes by {scale:.2f} times the integral of {velocity} (correlation {correlation:.2f}): "
                "one of the two has another unit, axis or sign.",
                scale=scale,
                correlation=correlation,
            )


def _rank_correlation(one: FloatArray, other: FloatArray) -> float:
    ranks = [np.argsort(np.argsort(values)).astype(np.float64) for values in (one, other)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def _at(record: FlightRecord, name: str, clock: FloatArray) -> FloatArray | None:
    """A channel by straight lines, from the first topic that covers the clock; angles go on over a turn."""
    for topic, row in record.holding(name):
        kept = np.isfinite(topic.values[row])
        time_s, values = topic.time_s[kept], topic.values[row][kept]
        if _covers(time_s, clock):
            values = np.unwrap(values) if name in ("phi", "theta") else values
            return np.asarray(np.interp(clock, time_s, values))
    return None


def _means(record: FlightRecord, name: str, clock: FloatArray) -> FloatArray | None:
    for topic, row in record.holding(name):
        if (values := _mean_at(topic, row, clock, 1.0 / _GRID_HZ)) is not None:
            return values
    return None


def _mean_at(topic: Topic, row: int, clock: FloatArray, width_s: float) -> FloatArray | None:
    """Means over a width about each instant: a difference of the integral of the straight lines."""
    kept = np.isfinite(topic.values[row])
    time_s, values = topic.time_s[kept], topic.values[row][kept]
    if not _covers(time_s, clock):
        return None
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])
    ends = [np.interp(clock + sign * 0.5 * width_s, time_s, total) for sign in (-1.0, 1.0)]
    width = [np.clip(clock + sign * 0.5 * width_s, time_s[0], time_s[-1]) for sign in (-1.0, 1.0)]
    return np.asarray((ends[1] - ends[0]) / np.maximum(width[1] - width[0], 1e-9))


def _covers(time_s: FloatArray, clock: FloatArray) -> bool:
    """Whether samples reach over a clock without long gaps."""
    if time_s.size < _FEWEST or clock.size < _FEWEST:
        return False
    inside = time_s[(time_s >= clock[0] - 1.0) & (time_s <= clock[-1] + 1.0)]
    if inside.size < _FEWEST or inside[0] > clock[0] + 1.0 or inside[-1] < clock[-1] - 1.0:
        return False
    return bool(np.diff(inside).max() < 1.0)
