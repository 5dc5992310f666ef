r"""How exactly a log says when a value was taken: jitter of stamps, and clocks that inputs and outputs share.

The stamp of a message says when it was written. Where within a sample its value belongs, and how long a command was
held, the log does not say: 0.15 of a sample, the standard deviation of what lies anywhere within half of one. More is
known only where a firmware writes inputs and outputs in one turn of its loop, as ArduPilot and Betaflight do: their
stamps are alike and even, and what is left is their jitter, and what differs within a turn
(:data:`SAME_TURN_SAMPLES`).

A table proves nothing by even stamps: whoever brought several messages to one clock made them even. Nor do PX4's, whose
modules stamp and filter each channel on their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.signal.clock import source_topic
from rotorid.signal.kinematics import ingredients
from rotorid.typing import FloatArray

CLOCK_SAMPLES = 0.15
"""Standard deviation of a delay within a sample, of each input and each output, where hold and stamps are not known."""

SAME_TURN_SAMPLES = 0.03
"""The same of channels written in one turn of a loop."""

_FEWEST = 20
_ALIKE = 1e-3
"""Of a step, by which stamps may differ and be alike."""

_MOSTLY = 0.99


def stamp_jitter_s(time_s: FloatArray) -> float:
    r"""Standard deviation of stamps about an even clock, seconds.

    Steps between stamps are multiples of their median, for messages get lost; what is left of them is the difference of
    two stamps: :math:`\sigma = \mathrm{rms}(\Delta t_k - n_k \Delta t) / \sqrt{2}`.

    Parameters
    ----------
    time_s
        Stamps, shape ``(n,)``; those that repeat or step back do not count.

    Returns
    -------
    float
        Infinite for fewer than twenty steps.

    Examples
    --------
    >>> even = 0.004 * np.arange(500)
    >>> late = np.random.default_rng(1).exponential(0.0002, 500)
    >>> round(stamp_jitter_s(even), 9), round(stamp_jitter_s(np.delete(even, [7, 100, 101])), 9)
    (0.0, 0.0)
    >>> round(1e3 * stamp_jitter_s(even + late), 1)
    0.2
    """
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    if steps.size < _FEWEST:
        return math.inf
    step = float(np.median(steps))
    left = steps - step * np.round(steps / step)
    return float(np.sqrt(np.mean(left**2) / 2.0))


def clock_error_s(
    record: FlightRecord, channels: Sequence[str], intervals: Iterable[tuple[float, float]]
) -> float | None:
    """Standard deviation of the time to which values of each of some channels belong, where stamps show it, seconds.

    Parameters
    ----------
    record
        The log.
    channels
        Inputs and outputs together.
    intervals
        Start and stop of each maneuver; the largest error counts.

    Returns
    -------
    float
        ``None`` where stamps do not show it: :data:`CLOCK_SAMPLES` of a sample is its usual size.

    Examples
    --------
    One message of a firmware, and a table:

    >>> from dataclasses import replace
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> rows = (Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s"))
    >>> message = Topic(name="RATE", time_s=0.0025 * np.arange(400), channels=rows, values=np.zeros((2, 400)))
    >>> log = FlightRecord(source=Source(name="a.BIN", format="ArduPilot DataFlash", sha256=""), topics=(message,))
    >>> round(1e6 * clock_error_s(log, ("roll_command", "p"), [(0.0, 1.0)]))
    75
    >>> table = replace(log, source=Source(name="a.csv", format="CSV", sha256=""))
    >>> clock_error_s(table, ("roll_command", "p"), [(0.0, 1.0)]) is None
    True
    """
    return largest_clock_s(_error_s(record, channels, start_s, stop_s) for start_s, stop_s in intervals)


def largest_clock_s(shown: Iterable[float | None]) -> float | None:
    """The largest of what several flights show of their clocks; ``None`` where one of them, or none, shows it.

    Examples
    --------
    >>> largest_clock_s([75e-6, 80e-6]), largest_clock_s([75e-6, None]), largest_clock_s([])
    (8e-05, None, None)
    """
    found = list(shown)
    known = [error for error in found if error is not None]
    return max(known) if known and len(known) == len(found) else None


def clock_samples(
    logs: Iterable[tuple[FlightRecord, tuple[float, float]]], channels: Sequence[str], *, sample_rate_hz: float
) -> dict[str, float]:
    """Standard deviation of the clock of each channel, in samples of the records that are cut from some logs.

    A value belongs somewhere in a sample of its own message, which may be many times as fast as the slowest one, whose
    clock the records have. Of several logs the largest counts.

    Parameters
    ----------
    logs
        Each with the start and stop of its maneuver.
    channels
        Inputs and outputs together; those that are no log's own count by what they are computed from.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> def topic(name, unit, step_s):
    ...     channels = (Channel(name=name, unit=unit),)
    ...     return Topic(name=name, time_s=step_s * np.arange(100), channels=channels, values=np.zeros((1, 100)))
    >>> topics = (topic("phi", "rad", 0.004), topic("velocity_north", "m/s", 0.04))
    >>> log = FlightRecord(source=Source(name="a.ulg", format="PX4 ULog", sha256=""), topics=topics)
    >>> found = clock_samples([(log, (0.0, 0.3))], ("phi", "velocity_north"), sample_rate_hz=25.0)
    >>> {name: round(samples, 3) for name, samples in found.items()}
    {'phi': 0.015, 'velocity_north': 0.15}
    """
    found = dict.fromkeys(channels, 0.0)
    for record, interval in logs:
        logged = record.channel_names
        parts = {name: (name,) if name in logged else ingredients(name, logged) for name in channels}
        present = [name for name, made_of in parts.items() if made_of and set(made_of) <= set(logged)]
        shown_s = clock_error_s(record, present, [interval])
        for name in present:
            usual = CLOCK_SAMPLES * min(_slowest_step_s(record, parts[name], interval) * sample_rate_hz, 1.0)
            own = usual if shown_s is None else min(shown_s * sample_rate_hz, usual)
            found[name] = max(found[name], own)
    return found


def _slowest_step_s(record: FlightRecord, channels: Iterable[str], interval: tuple[float, float]) -> float:
    """Step between the messages of the slowest of some channels, seconds; infinite where one is not logged."""
    try:
        topics = [source_topic(record, name, *interval)[0] for name in channels]
    except InsufficientDataError:
        return math.inf
    return max((_step_s(topic.time_s) for topic in topics), default=math.inf)


def _error_s(record: FlightRecord, channels: Sequence[str], start_s: float, stop_s: float) -> float | None:
    # What is worked out from other channels has no stamps of its own.
    logged = bool(channels) and all(name in record.channel_names for name in channels)
    if not autopilot_of(record).log.in_one_turn or not logged:
        return None
    try:
        topics = {id(topic): topic for topic, _ in (source_topic(record, name, start_s, stop_s) for name in channels)}
    except InsufficientDataError:
        return None
    stamps = [topic.time_s[topic.within(start_s, stop_s)] for topic in topics.values()]
    # The slowest channel sets the clock to which all are brought.
    step_s = max((_step_s(time_s) for time_s in stamps), default=0.0)
    if not _alike(stamps, step_s):
        return None
    share = math.hypot(SAME_TURN_SAMPLES, max(stamp_jitter_s(time_s) for time_s in stamps) / step_s)
    return share * step_s if share < CLOCK_SAMPLES else None


def _step_s(time_s: FloatArray) -> float:
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 0.0


def _alike(stamps: Sequence[FloatArray], step_s: float) -> bool:
    """Whether the stamps of the slowest topic are those of all others too."""
    slowest = min(stamps, key=len)
    if slowest.size < _FEWEST:
        return False
    for time_s in stamps:
        rising = np.sort(time_s)
        after = np.clip(np.searchsorted(rising, slowest), 1, rising.size - 1)
        apart = np.minimum(np.abs(rising[after] - slowest), np.abs(rising[after - 1] - slowest))
        if np.mean(apart <= _ALIKE * step_s) < _MOSTLY:
            return False
    return True
