"""How often commands reach a vehicle, how evenly, and whether it answers later where they come faster.

A vehicle whose loop takes commands more slowly than they are sent lets them wait: the answer to a command is then late
by all those before it. Logs of one vehicle at different rates show that as a delay which grows with the rate. The rate
is that of the stamps of the commands, which a table has only if it was written in the loop that sends them.

Source: *System identification for an autonomous drone*, appendix D, figure 12.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import TWO_SIDED_95, milliseconds, significant
from rotorid.fitting.delay.estimate import DelayEstimate
from rotorid.flights.flights import Flight
from rotorid.signal.clock import source_topic

_OTHER_RATE = 1.2
"""Rates that differ by less than this factor are one."""


@dataclass(frozen=True, kw_only=True)
class CommandRate(Immutable):
    """Commands of one channel in one log, and how late one output answers.

    Parameters
    ----------
    record, input, output
        Log and channels.
    rate_hz
        By the median interval of the stamps.
    jitter_s
        Standard deviation of the intervals without the longest percent, which are gaps.
    longest_s
        Longest interval.
    hold_s
        Median time for which a value stays; ``None`` where it never changes.
    delay_s, std_s
        Of the output; ``None`` where the log alone shows none.
    """

    record: str
    input: str
    output: str
    rate_hz: float
    jitter_s: float
    longest_s: float
    hold_s: float | None
    delay_s: float | None
    std_s: float | None


def command_rates(
    flown: Sequence[Flight], input: str, output: str, delays: Mapping[str, DelayEstimate | None]
) -> tuple[CommandRate, ...]:
    """Rate of the commands and the delay of every log.

    Parameters
    ----------
    flown
        Maneuvers that were used.
    input, output
        Channels of the pair.
    delays
        By log, in the order of the logs.
    """
    logs: dict[int, list[Flight]] = {}
    for flight in flown:
        logs.setdefault(id(flight.record), []).append(flight)
    return tuple(
        _rate(own, name, input, output, delay) for own, (name, delay) in zip(logs.values(), delays.items(), strict=True)
    )


def _rate(own: Sequence[Flight], name: str, input: str, output: str, delay: DelayEstimate | None) -> CommandRate:
    intervals, holds = [], []
    for flight in own:
        start_s, stop_s = flight.maneuver.start_s, flight.maneuver.stop_s
        topic, row = source_topic(flight.record, input, start_s, stop_s)
        inside = (topic.time_s >= start_s) & (topic.time_s <= stop_s) & np.isfinite(topic.values[row])
        time_s, values = topic.time_s[inside], topic.values[row, inside]
        intervals.append(np.diff(time_s))
        holds.append(np.diff(time_s[1:][np.diff(values) != 0.0]))
    steps, held = np.concatenate(intervals), np.concatenate(holds)
    usual = steps[steps <= np.quantile(steps, 0.99)]
    return CommandRate(
        record=name,
        input=input,
        output=output,
        rate_hz=1.0 / float(np.median(steps)),
        jitter_s=float(np.std(usual)),
        longest_s=float(np.max(steps)),
        hold_s=float(np.median(held)) if held.size else None,
        delay_s=None if delay is None else delay.delay_s,
        std_s=None if delay is None else delay.std_s,
    )


def buffered(rates: Sequence[CommandRate]) -> Iterator[Finding]:
    """A warning where commands that come faster are answered later.

    Compared with the mean of all logs at no higher rate than the last one that agrees with the slowest. A log at a
    higher rate still that is answered earlier refutes it: something else was late.

    Parameters
    ----------
    rates
        Of one pair of channels.
    """
    known = [rate for rate in sorted(rates, key=lambda one: one.rate_hz) if rate.delay_s is not None and rate.std_s]
    usual: list[CommandRate] = []
    late: list[CommandRate] = []
    for rate in known:
        if usual and rate.rate_hz > _OTHER_RATE * usual[-1].rate_hz and _later(rate, usual):
            late.append(rate)
        elif not late:
            usual.append(rate)
        elif _later(late[-1], [rate]):
            return
    if not late:
        return
    mean_s, std_s = _mean(usual)
    further = [(one.delay_s or 0.0) - mean_s for one in late]
    stds = [math.hypot(one.std_s or 0.0, std_s) for one in late]
    words = listed([f"{milliseconds(by_s, by_std_s)} ms" for by_s, by_std_s in zip(further, stds, strict=True)])
    fast = listed([f"{significant(one.rate_hz, digits=2)} Hz" for one in late])
    limit = significant(usual[-1].rate_hz, digits=2)
    yield warn(
        "buffered_commands",
        late[0].input,
        f"{late[0].output} answers {words} later at {fast} than at {limit} Hz and less: commands wait in the vehicle. "
        f"Send {late[0].input} at {limit} Hz.",
        rate_hz=usual[-1].rate_hz,
        later_s=max(further),
    )


def _later(rate: CommandRate, usual: Sequence[CommandRate]) -> bool:
    mean_s, std_s = _mean(usual)
    return (rate.delay_s or 0.0) - mean_s > TWO_SIDED_95 * math.hypot(rate.std_s or 0.0, std_s)


def _mean(rates: Sequence[CommandRate]) -> tuple[float, float]:
    """Weighted mean of delays, and its standard deviation."""
    weights = np.array([1.0 / (rate.std_s or math.inf) ** 2 for rate in rates])
    delays = np.array([rate.delay_s or 0.0 for rate in rates])
    return float(weights @ delays / weights.sum()), float(weights.sum() ** -0.5)
