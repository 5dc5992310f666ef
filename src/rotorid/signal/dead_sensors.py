"""Sensors that measure nothing: a gyro that never moves, an accelerometer without gravity.

A stub of a simulator, a wrong unit or a broken driver logs numbers like any other. A gyro of a real vehicle is noisy
even at rest. An accelerometer measures the specific force, whose mean over a second is near 9.8 m/s² on the ground and
in ordinary flight; no vehicle falls freely for most of a log.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Topic
from rotorid.units import STANDARD_GRAVITY_M_S2

CHECK_SENSORS = "check the sensor, its driver and its units"
"""What to do about a sensor that measures nothing."""

_FORCES = ("ax", "ay", "az")

_FEWEST, _SHORTEST_S = 16, 2.0
"""Samples and duration from which on a sensor that does not move is dead."""

_LEAST_G, _MOST_G = 0.5, 3.0
"""The mean specific force of a log, and of a flight, lies between these."""

_SECONDS = 200
"""So many of them are looked at."""


@cached_by_value
def dead_gyro(record: FlightRecord) -> str:
    """Why the gyro is dead, as a sentence; empty where it moves, or one of its axes was not logged."""
    topics = [topic for topic, _ in record.holding("p") if all(topic.row(name) is not None for name in RATES)]
    found = [_constant(topic, RATES) for topic in topics]
    if not found or not all(found):
        return ""
    return "The gyro never moves: p, q and r are constant throughout"


@cached_by_value
def dead_accelerometer(record: FlightRecord) -> str:
    """Why the accelerometer is dead, as a sentence; empty where it shows gravity, or an axis was not logged."""
    sizes = [
        size
        for topic, _ in record.holding("az")
        if all(topic.row(name) is not None for name in _FORCES) and (size := _usual_force(topic)) is not None
    ]
    if not sizes or any(shows_gravity(size) for size in sizes):
        return ""
    return f"The mean specific force is {sizes[0]:.2g} m/s², and gravity is {STANDARD_GRAVITY_M_S2:.1f} m/s²"


def shows_gravity(force_m_s2: float) -> bool:
    """Whether a mean specific force is one that a vehicle has on the ground or in the air.

    Examples
    --------
    >>> shows_gravity(11.0), shows_gravity(0.98), shows_gravity(-9.8)
    (True, False, False)
    """
    return _LEAST_G < force_m_s2 / STANDARD_GRAVITY_M_S2 < _MOST_G


def dead_sensor_findings(record: FlightRecord) -> tuple[Finding, ...]:
    """A warning for each sensor that measures nothing.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source
    >>> channels = tuple(Channel(name=name, unit="rad/s") for name in "pqr")
    >>> still = Topic(name="imu", time_s=np.arange(100) * 0.1, channels=channels, values=np.zeros((3, 100)))
    >>> record = FlightRecord(source=Source(name="a.bag", format="ROS bag", sha256=""), topics=(still,))
    >>> dead_sensor_findings(record)[0].message
    'The gyro never moves: p, q and r are constant throughout. What needs it was left out.'
    """
    found = (("gyro", dead_gyro(record)), ("accelerometer", dead_accelerometer(record)))
    return tuple(warn("dead_sensor", name, f"{why}. What needs it was left out.") for name, why in found if why)


def _constant(topic: Topic, names: Sequence[str]) -> bool:
    """Whether all of some channels keep one value, for long enough."""
    time_s = topic.time_s
    if time_s.size < _FEWEST or float(np.ptp(time_s)) < _SHORTEST_S:
        return False
    for row in _rows(topic, names):
        values = topic.values[row]
        first = values[np.argmax(np.isfinite(values))]
        if not np.isfinite(first) or np.any(values[np.isfinite(values)] != first):
            return False
    return True


def _usual_force(topic: Topic) -> float | None:
    """Median of the means of the specific force over seconds; ``None`` of what is too short."""
    rate_hz, rows = topic.sample_rate_hz, _rows(topic, _FORCES)
    size = max(round(rate_hz), _FEWEST)
    if topic.time_s.size < max(size, _SHORTEST_S * rate_hz):
        return None
    # Of a long log, some hundred seconds are enough, and a copy of all samples a good part of the memory.
    begins = np.linspace(0, topic.time_s.size - size, min(_SECONDS, topic.time_s.size // size)).astype(int)
    means = [[float(np.mean(topic.values[row, begin : begin + size])) for row in rows] for begin in begins]
    sizes = np.linalg.norm(means, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    return float(np.median(sizes)) if sizes.size else None


def _rows(topic: Topic, names: Sequence[str]) -> list[int]:
    return [row for name in names if (row := topic.row(name)) is not None]
