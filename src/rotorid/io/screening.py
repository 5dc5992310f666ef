r"""Values and stamps that cannot be, and what is nobody's concern: what every record passes as it leaves the readers.

No log format of autopilots has a checksum over its samples, so that a flipped bit or a frame of another file arrives as
a value like any other. Six tests find impossible values, each linear in the number of samples (the first but for the
sorting of stamps that are in disorder):

- Stamps must rise, and lie inside of the log. Of stamps in disorder the longest rising sequence stays, of equal ones
  the first; what lies far from everything else that was logged is left out, and so is what no clock can say.
- Stamps must rise as those of a clock do. Autopilots count microseconds, and a double keeps 53 bits: stamps closer than
  1 µs are one instant. Where the mean step is below 1 µs, or below 256 units in the last place of the stamps, there is
  no clock, and only the first sample stays. So the rates of a record that passed are finite, and a uniform clock over
  it has a number of samples in proportion to those that were logged.
- A value must be possible: :mod:`rotorid.data.ranges`.
- A measured value cannot jump and be back one sample later. With the steps :math:`d_i = x_i - x_{i-1}`, a sample stands
  out by :math:`e_i = \min(|d_i|, |d_{i+1}|)` where the two have opposite signs. It is left out where :math:`e_i` is
  above ten times the largest ordinary step of the whole channel, above eight times the roughness of its own
  surroundings, and its neighbors agree. This is Hampel's test with steps in place of levels, since a flight moves. A
  shock of an accelerometer is rough for several samples and stays.
- A measured value that otherwise changes from sample to sample cannot stand still for half a second between motions:
  its sensor or its estimator hung. What it shows before the first motion and after the last one may be rest.
- A command may jump; but a sample that jumps as no measured value can, twice as far from the median as the rest of the
  channel, is none, unless another message shows a jump at that time. Nor is a single sample ten times as far as all
  others, wherever it stands, or a single negative output of a motor that otherwise turns forward.

Nothing is repaired: a sample is left out and counted in a finding. A channel that is mostly impossible is left out as a
whole, since what remains of it is no better. Of the parameters those stay that :mod:`rotorid.io.parameters` lists.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.display import counted
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.ranges import MEASURED, TURNING, range_of
from rotorid.data.record import MOTORS, STANDARD_UNITS, Channel, FlightRecord, Topic, silences
from rotorid.errors import LogError
from rotorid.io.parameters import kept_parameters
from rotorid.typing import BoolArray, FloatArray, IntArray

_OUTSIDE_S = 10.0
"""Farther from the log than this a stamp is no stamp: autopilots log values that are a few seconds old as the first."""
_LARGEST_STAMP_S = 2.0**53 / 1e6
"""Farther from zero than these 285 years a double does not resolve a microsecond."""
_LEAST_STEP_S = 1e-6
_LEAST_STEP_ULPS = 256.0
"""Steps whose mean is below the larger of the two, seconds and units in the last place, are no steps of a clock."""
_MOST_ISOLATED = 3
_LONE_S, _LONE_STEPS = 1.0, 100.0
"""So many samples behind a pause so long, in seconds and in steps, say nothing about when the log begins or ends."""

_MOSTLY = 0.5
_FEW = 0.01
"""Up to this share of a topic all of its channels lose the sample; above, those that are sound stay whole."""

_SLOWEST_HZ = 15.0
"""In slower logs a motion may well be over within one sample."""
_FEWEST = 64
_STEPS, _ROUGHNESS, _AGREEMENT = 10.0, 8.0, 0.25
_SURROUNDINGS = 16
_ORDINARY, _LEAST_RANK = 1e-3, 12
"""The ordinary step is the largest but for this share of all, or for this many."""
_SAMPLED = 20_000
_STILL_S, _FEWEST_STILL, _LIVELY = 0.5, 25, 0.9
"""So long, and so many samples, are equal in a channel of which outside of such stretches this share changes."""
_GIANT, _MOST_GIANTS = 10.0, 5
_FAR, _SAME_TIME = 2.0, 1.5
"""A command may jump for one sample, but not so many times as far as it goes otherwise. Jumps within so many samples
of each other are at the same time."""
_SENSED = ("_raw", "_filtered")
"""Ends of the names of what sensors see, before and behind filters; steps of theirs may be rest, jumps are none."""
_OUTPUTS = frozenset(f"motor_{number}" for number in range(1, MOTORS + 1))
_BACKWARD = 0.05
"""A motor that stands may be logged a little below its idle."""


def screened(record: FlightRecord) -> FlightRecord:
    """The record without values and stamps that cannot be; what was left out is counted in its findings.

    Parameters
    ----------
    record
        As a reader made it.

    Raises
    ------
    LogError
        Nothing was logged.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> rate = Channel(name="p", unit="rad/s")
    >>> topic = Topic(name="IMU", time_s=[0.0, 0.1, 0.2], channels=(rate,), values=[[0.1, 1e30, 0.3]])
    >>> record = screened(FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,)))
    >>> record["p"].values.tolist(), [finding.kind for finding in record.findings]
    ([0.1, 0.3], ['impossible_value'])
    """
    kept, stamp_findings = _in_time(record.topics)
    topics: list[Topic] = []
    findings = list(stamp_findings)
    for topic in kept:
        parts, remarks = _possible(topic, kept)
        topics += parts
        findings += remarks
    if not any(topic.time_s.size and topic.channels for topic in topics):
        raise LogError(
            f"{record.source.name} contains no flight: no samples of any known channel",
            needed="a log that was written while the vehicle was on",
            remedy="check that the logger was on in flight, or copy the log again from the vehicle",
        )
    kept_values = kept_parameters(record.parameters)
    if len(kept_values) < len(record.parameters):
        record = replace(record, parameters=kept_values)
    unchanged = len(topics) == len(record.topics) and all(
        new is old for new, old in zip(topics, record.topics, strict=True)
    )
    if unchanged:
        return replace(record, findings=(*record.findings, *findings)) if findings else record
    logged = {channel.name for topic in topics for channel in topic.channels}
    instruments = {
        axis: present
        for axis, names in record.instruments.items()
        if (present := tuple(n for n in names if n in logged))
    }
    return replace(record, topics=tuple(topics), instruments=instruments, findings=(*record.findings, *findings))


def without_isolated(values: FloatArray) -> FloatArray:
    """Each sample replaced by the median of itself and its two neighbors, so that a single wrong one has no say.

    Parameters
    ----------
    values
        Shape ``(samples,)``; the first and the last one stay as they are.

    Examples
    --------
    >>> without_isolated(np.array([0.0, 0.1, 1e9, 0.3, 0.4])).tolist()
    [0.0, 0.1, 0.3, 0.4, 0.4]
    """
    if values.size < 3:
        return values
    before, here, after = values[:-2], values[1:-1], values[2:]
    low, high = np.fmin(before, here), np.fmax(before, here)
    return np.concatenate([values[:1], np.fmax(low, np.fmin(high, after)), values[-1:]])


def _in_time(topics: Sequence[Topic]) -> tuple[list[Topic], list[Finding]]:
    """Topics with stamps that rise and lie inside of the log."""
    kept = [_rising(topic.time_s) for topic in topics]
    spans = [span for topic, mask in zip(topics, kept, strict=True) if (span := _span(topic.time_s[mask])) is not None]
    if spans:
        low, high = min(span[0] for span in spans) - _OUTSIDE_S, max(span[1] for span in spans) + _OUTSIDE_S
        kept = [mask & (topic.time_s >= low) & (topic.time_s <= high) for topic, mask in zip(topics, kept, strict=True)]
    found: list[Topic] = []
    findings: list[Finding] = []
    for topic, mask in zip(topics, kept, strict=True):
        once = _once(topic.time_s, mask)
        findings += _disorder(topic.name, topic.time_s, mask, once)
        if once.all():
            found.append(topic)
        elif once.any():
            found.append(_chosen(topic, once))
    return found, [*findings, *_pauses(found)]


def _pauses(topics: Sequence[Topic]) -> list[Finding]:
    """What to say where nothing at all was logged for long: the clock jumped, or the logger stood still."""
    silent = silences(topics, _OUTSIDE_S)
    if not silent:
        return []
    start_s, stop_s = max(silent, key=lambda pause: pause[1] - pause[0])
    return [
        warn(
            "gap",
            "log",
            f"Nothing was logged for {stop_s - start_s:.1f} s after {start_s:.1f} s"
            + (f", and {len(silent) - 1} times more for over {_OUTSIDE_S:g} s" if len(silent) > 1 else "")
            + "; the parts before and after are analyzed separately.",
            gaps=len(silent),
            longest_s=stop_s - start_s,
        )
    ]


def _once(time_s: FloatArray, mask: BoolArray) -> BoolArray:
    """Of the chosen stamps, which rise, the first of each instant; the first of all where they are no clock."""
    chosen = np.flatnonzero(mask)
    steps = np.diff(time_s[chosen])
    # Microseconds in a double are off by half a unit in the last place at either end of a step.
    least_s = _LEAST_STEP_S - 2.0 * _last_place(time_s[chosen])
    again = (steps <= 0.0) | (steps < least_s) if _is_clock(time_s[chosen]) else np.ones(steps.size, dtype=np.bool_)
    if not again.any():
        return mask
    once = mask.copy()
    once[chosen[1:][again]] = False
    return once


def _is_clock(stamps: FloatArray) -> bool:
    """Whether stamps that rise do so, in the mean, by steps that a clock can count; equal ones are one stamp."""
    steps = int(np.count_nonzero(np.diff(stamps)))
    least_s = max(_LEAST_STEP_S, _LEAST_STEP_ULPS * _last_place(stamps))
    return steps == 0 or float(stamps[-1] - stamps[0]) + 2.0 * _last_place(stamps) >= least_s * steps


def _last_place(stamps: FloatArray) -> float:
    """Unit in the last place of stamps that rise."""
    return float(np.spacing(max(abs(stamps[0]), abs(stamps[-1])))) if stamps.size else 0.0


def _disorder(name: str, time_s: FloatArray, mask: BoolArray, once: BoolArray) -> Iterator[Finding]:
    """What to say of stamps that were left out: a few that repeat limit the trust in nothing."""
    samples, stamps = mask.size, time_s[mask]
    lost, again = int(np.sum(~mask)), int(np.sum(mask & ~once))
    if lost:
        yield warn(
            "clock_disorder",
            name,
            f"{lost} of {samples} stamps of {name} step back or lie outside of the log; their samples were left out.",
            samples=lost,
        )
    if again and not _is_clock(stamps):
        mean_s = float(stamps[-1] - stamps[0]) / (stamps.size - 1)
        yield warn(
            "clock_disorder",
            name,
            f"The steps of {name} are {mean_s:.3g} s on average, shorter than any clock counts; only the first of "
            f"{stamps.size} samples was kept. Check the unit of time.",
            samples=again,
            mean_s=mean_s,
        )
    elif again:
        close = bool(np.any(np.diff(stamps)[~once[mask][1:]]))
        yield (warn if again > _FEW * samples else remark)(
            "clock_disorder",
            name,
            f"{again} of {samples} stamps of {name} repeat the one before"
            + (" or follow it within 1 µs" if close else "")
            + "; the first sample of each was kept.",
            samples=again,
        )


def _chosen(topic: Topic, mask: BoolArray, rows: Sequence[int] | None = None) -> Topic:
    """The topic of some samples, and of some of its channels."""
    rows = range(len(topic.channels)) if rows is None else rows
    return replace(
        topic,
        time_s=topic.time_s[mask],
        channels=tuple(topic.channels[row] for row in rows),
        values=topic.values[np.ix_(np.array(rows), np.flatnonzero(mask))],
    )


def _rising(time_s: FloatArray) -> BoolArray:
    """The longest sequence of stamps that are numbers and never step back."""
    # A stamp that is no number is not small either.
    kept: BoolArray = np.abs(time_s) < _LARGEST_STAMP_S
    for lone in (_ahead, _behind):
        stamps = time_s[kept]
        if stamps.size < 2 or bool(np.all(stamps[1:] >= stamps[:-1])):
            return kept
        kept[np.flatnonzero(kept)[lone(stamps)]] = False
    stamps = time_s[kept]
    if stamps.size > 1 and not bool(np.all(stamps[1:] >= stamps[:-1])):
        chosen = np.zeros(stamps.size, dtype=np.bool_)
        chosen[_longest_rising(stamps)] = True
        kept[np.flatnonzero(kept)[~chosen]] = False
    return kept


def _ahead(stamps: FloatArray) -> BoolArray:
    """Single stamps that run ahead of the two that follow, which themselves go on behind what came before."""
    before, after = np.append(-np.inf, stamps[:-1]), np.append(stamps[1:], np.inf)
    # Ahead of the next one alone, it may as well be that one that is wrong.
    return (stamps > after) & (after >= before) & (stamps > np.append(stamps[2:], [-np.inf, -np.inf]))


def _behind(stamps: FloatArray) -> BoolArray:
    """Single stamps that step back, while the next one goes on behind what came before."""
    before, after = np.append(-np.inf, stamps[:-1]), np.append(stamps[1:], np.inf)
    return (stamps < before) & (after >= before)


def _longest_rising(stamps: FloatArray) -> IntArray:
    """Indices of the longest sequence that does not fall: the smallest last stamp of each length, by bisection."""
    tails: list[float] = []
    ends: list[int] = []
    previous = np.full(stamps.size, -1, dtype=np.int64)
    for index, stamp in enumerate(stamps.tolist()):
        length = bisect_right(tails, stamp)
        previous[index] = ends[length - 1] if length else -1
        tails[length : length + 1] = [stamp]
        ends[length : length + 1] = [index]
    chain = [ends[-1]]
    while previous[chain[-1]] >= 0:
        chain.append(int(previous[chain[-1]]))
    return np.array(chain[::-1])


def _span(stamps: FloatArray) -> tuple[float, float] | None:
    """First and last stamp of a topic, but for a few that a long pause parts from all others."""
    if stamps.size <= 2 * _MOST_ISOLATED:
        return None
    steps = np.diff(stamps)
    pause = max(_LONE_S, _LONE_STEPS * float(np.median(steps)))
    ends = range(_MOST_ISOLATED)
    first = max((place + 1 for place in ends if steps[place] > pause), default=0)
    last = stamps.size - 1 - max((place + 1 for place in ends if steps[-1 - place] > pause), default=0)
    return float(stamps[first]), float(stamps[last])


@dataclass(frozen=True, kw_only=True, slots=True)
class _Faults:
    """What of a channel cannot be: masks over its samples."""

    channel: Channel
    no_number: BoolArray
    outside: BoolArray
    isolated: BoolArray
    still: BoolArray

    @property
    def bad(self) -> BoolArray:
        return self.no_number | self.outside | self.isolated | self.still

    @property
    def refused(self) -> bool:
        """Whether what remains of the channel is no better than what cannot be."""
        numbers = int(np.sum(~self.no_number))
        return not numbers or int(np.sum(self.outside)) > _MOSTLY * numbers


def _possible(topic: Topic, topics: Sequence[Topic]) -> tuple[list[Topic], list[Finding]]:
    """The topic, one of some, without impossible samples; channels that lose many of their own stand alone."""
    if not topic.time_s.size:
        return [topic], []
    faulty = [fault for row in range(len(topic.channels)) if (fault := _faults(topic, row, topics)) is not None]
    if not faulty:
        return [topic], []
    findings = [*(finding for fault in faulty for finding in _fault_findings(topic, fault)), *_empty(topic, faulty)]
    bad = {fault.channel.name: fault.bad for fault in faulty if not fault.refused}
    refused = {fault.channel.name for fault in faulty if fault.refused}
    rows = [row for row, channel in enumerate(topic.channels) if channel.name not in refused]
    if not rows:
        return [], findings
    some = np.logical_or.reduce(list(bad.values())) if bad else np.zeros(topic.time_s.size, dtype=np.bool_)
    if np.sum(some) <= max(_FEW * some.size, 1.0):
        return [_chosen(topic, ~some, rows)], findings
    groups: dict[bytes, list[int]] = {}
    none = np.zeros(some.size, dtype=np.bool_)
    for row in rows:
        groups.setdefault(bad.get(topic.channels[row].name, none).tobytes(), []).append(row)
    return [_chosen(topic, ~bad.get(topic.channels[alike[0]].name, none), alike) for alike in groups.values()], findings


def _faults(topic: Topic, row: int, topics: Sequence[Topic]) -> _Faults | None:
    """What of a channel cannot be, or ``None`` where nothing is wrong."""
    channel, values, rate_hz = topic.channels[row], topic.values[row], topic.sample_rate_hz
    low, high = range_of(channel) or (-np.inf, np.inf)
    # A comparison with a NaN is false; one pass shows that all is well.
    least, most = float(values.min()), float(values.max())
    plausible = low <= least and most <= high and np.isfinite(least) and np.isfinite(most)
    no_number = np.zeros(values.size, dtype=np.bool_) if plausible else ~np.isfinite(values)
    with np.errstate(invalid="ignore"):
        outside = no_number if plausible else ((values < low) | (values > high)) & ~no_number
    isolated, still = np.zeros((2, values.size), dtype=np.bool_)
    if rate_hz >= _SLOWEST_HZ:
        inside = slice(None) if plausible else np.flatnonzero(~(no_number | outside))
        known, time_s = values[inside], topic.time_s[inside]
        candidates = _isolated_samples(known, channel)
        if not _is_sensed(channel.name):
            elsewhere = [other for other in topics if other is not topic]
            confirmed = [
                place for place in _far(known, channel.name).tolist() if not _is_confirmed(time_s[place], elsewhere)
            ]
            candidates = np.union1d(candidates, confirmed).astype(np.int64)
        for mask, found in ((isolated, candidates), (still, _still(known, channel.name, rate_hz))):
            mask[np.arange(values.size)[inside][found]] = True
    if plausible and not isolated.any() and not still.any():
        return None
    return _Faults(channel=channel, no_number=no_number, outside=outside, isolated=isolated, still=still)


def _still(values: FloatArray, name: str, rate_hz: float) -> IntArray:
    """Indices of samples that repeat the one before for longer than a sensor in motion does."""
    none = np.empty(0, dtype=np.int64)
    if name not in MEASURED or values.size < _FEWEST:
        return none
    changes = np.flatnonzero(values[1:] != values[:-1])
    repeats = values.size - 1 - changes.size
    fewest = max(_FEWEST_STILL, int(_STILL_S * rate_hz))
    if repeats < fewest or not changes.size:
        return none
    # Between two changes; what lies before the first or behind the last may be rest.
    lengths = np.diff(changes)
    long = np.flatnonzero(lengths > fewest)
    span = int(changes[-1] - changes[0])
    lively = span - int(lengths[long].sum())
    if not long.size or lively < _MOSTLY * span or changes.size - long.size < _LIVELY * lively:
        return none
    return np.concatenate([np.arange(changes[place] + 2, changes[place + 1] + 1) for place in long])


def _isolated_samples(values: FloatArray, channel: Channel) -> IntArray:
    """Indices of single samples that cannot belong to the motion around them."""
    name = channel.name
    none = np.empty(0, dtype=np.int64)
    if values.size < _FEWEST:
        return none
    steps, out = _outstanding(values, name)
    # A giant stands out by half of its distance, and at most two of them span the whole range.
    found = _giants(values, out, name) if float(out.max()) > 0.25 * float(np.ptp(values)) else none
    if name in _OUTPUTS and channel.unit == STANDARD_UNITS[name]:
        found = np.union1d(found, _reversed(values, out))
    if _is_sensed(name):
        found = np.union1d(found, _jumps(steps, out))
    return found.astype(np.int64)


def _is_sensed(name: str) -> bool:
    return name in MEASURED or name.endswith(_SENSED) or name.startswith("motor_speed_")


def _jumps(steps: FloatArray, out: FloatArray) -> IntArray:
    """Indices of samples that jump out of a course that is smooth around them, and are back one sample later."""
    none = np.empty(0, dtype=np.int64)
    limit = _STEPS * _ordinary(np.abs(steps))
    places = np.flatnonzero(out > limit) if limit > 0.0 else none
    # Many of them are how this sensor is, or what the vehicle went through.
    if places.size > _FEW * (steps.size + 1):
        return none
    return np.array([place + 1 for place in places.tolist() if _is_isolated(steps, out, place)], dtype=np.int64)


def _far(values: FloatArray, name: str) -> IntArray:
    """Indices of jumps that lie far beyond all other samples."""
    if values.size < _FEWEST:
        return np.empty(0, dtype=np.int64)
    places = _jumps(*_outstanding(values, name))
    distance = np.abs(values - np.median(values))
    return places[distance[places] > _FAR * float(np.delete(distance, places).max())] if places.size else places


def _is_confirmed(time_s: float, topics: Sequence[Topic]) -> bool:
    """Whether other messages show a jump at this time: then a controller made it, and no damage of one message."""
    for topic in topics:
        if topic.time_s.size < _FEWEST or topic.sample_rate_hz < _SLOWEST_HZ:
            continue
        near = np.abs(topic.time_s - time_s) * topic.sample_rate_hz < _SAME_TIME
        for channel, values in zip(topic.channels, topic.values, strict=True):
            if near.any() and not _is_sensed(channel.name) and near[_jumps(*_outstanding(values, channel.name))].any():
                return True
    return False


def _outstanding(values: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """The steps of a channel, and how far each inner sample stands out from both of its neighbors."""
    steps = np.diff(values)
    if name in TURNING:
        steps = _less_a_turn(steps)
    sizes = np.abs(steps)
    out = np.minimum(sizes[:-1], sizes[1:])
    out *= (steps[:-1] > 0.0) != (steps[1:] > 0.0)
    return steps, out


def _reversed(values: FloatArray, out: FloatArray) -> IntArray:
    """Indices of a few single outputs below zero, of a motor that otherwise never turns backward."""
    below = np.flatnonzero(values[1:-1] < -_BACKWARD) + 1
    few = below[:0] if below.size > _MOST_GIANTS else below
    return few[out[few - 1] > 0.5 * np.abs(values[few])]


def _ordinary(sizes: FloatArray) -> float:
    """The largest ordinary step, of a sample of the steps."""
    some = sizes[:: sizes.size // _SAMPLED + 1]
    rank = max(_LEAST_RANK, int(_ORDINARY * some.size))
    return float(np.partition(some, some.size - 1 - rank)[some.size - 1 - rank])


def _is_isolated(steps: FloatArray, out: FloatArray, place: int) -> bool:
    """Whether the neighbors of a sample agree with each other, and its surroundings are smooth.

    ``place`` counts the inner samples: the steps to and from the sample are those of ``place`` and ``place + 1``.
    """
    if abs(steps[place] + steps[place + 1]) > _AGREEMENT * out[place]:
        return False
    around = np.abs(np.diff(steps[max(place - _SURROUNDINGS, 0) : place]))
    behind = np.abs(np.diff(steps[place + 2 : place + 2 + _SURROUNDINGS]))
    rough = 0.5 * max(float(around.max(initial=0.0)), float(behind.max(initial=0.0)))
    return bool(out[place] > _ROUGHNESS * rough)


def _less_a_turn(angles: FloatArray) -> FloatArray:
    """Differences of angles without the turn at the end of the circle; more than one turn is no such step."""
    return angles - 2.0 * np.pi * np.clip(np.round(angles / (2.0 * np.pi)), -1.0, 1.0)


def _giants(values: FloatArray, out: FloatArray, name: str) -> IntArray:
    """Indices of a few single samples that lie ten times as far from the median as all others."""
    offset = values - np.median(values)
    distance = np.abs(_less_a_turn(offset) if name in TURNING else offset)
    largest = np.argpartition(distance, values.size - _MOST_GIANTS - 1)[-_MOST_GIANTS - 1 :]
    largest = largest[np.argsort(-distance[largest])]
    sizes = distance[largest]
    gaps = np.flatnonzero((sizes[:-1] > _GIANT * sizes[1:]) & (sizes[1:] > 0.0))
    if not gaps.size:
        return np.empty(0, dtype=np.int64)
    giants = largest[: int(gaps[-1]) + 1]
    inner = giants[(giants > 0) & (giants < values.size - 1)]
    return np.sort(inner[out[inner - 1] > 0.5 * distance[inner]])


def _fault_findings(topic: Topic, fault: _Faults) -> Iterator[Finding]:
    name = fault.channel.name
    where = f"{name} in {topic.name}"
    unit = "" if fault.channel.unit == "1" else f" {fault.channel.unit}"
    impossible, isolated, still = (int(np.sum(mask)) for mask in (fault.outside, fault.isolated, fault.still))
    if fault.refused:
        low, high = range_of(fault.channel) or (-np.inf, np.inf)
        reason = (
            f"{impossible} of {fault.bad.size} samples are outside of {low:.4g} to {high:.4g}{unit}"
            if impossible
            else "no sample is a number"
        )
        # A motor in volts or µs is one without its unit.
        benches = impossible and name in _OUTPUTS and fault.channel.unit == "1"
        remedy = f"Write its unit, such as {name} [V] or [us]" if benches else "Check its unit and its source"
        yield warn(
            "impossible_value",
            name,
            f"{where} ({fault.channel.source}) was left out as a whole: {reason}. {remedy}.",
            samples=fault.bad.size,
            impossible=impossible,
        )
        return
    if impossible or isolated:
        first = int(np.flatnonzero(fault.outside | fault.isolated)[0])
        parts = [
            counted(count, what)
            for count, what in ((impossible, "impossible sample"), (isolated, "isolated spike"))
            if count
        ]
        yield warn(
            "impossible_value",
            name,
            f"{where}: left out {' and '.join(parts)} of {fault.bad.size} samples; the first value is "
            f"{topic.values[topic.row(name) or 0, first]:.4g}{unit} at {topic.time_s[first]:.3f} s.",
            samples=impossible + isolated,
            impossible=impossible,
            lone=isolated,
            first_s=float(topic.time_s[first]),
        )
    if still:
        first = int(np.flatnonzero(fault.still)[0])
        yield warn(
            "frozen_sensor",
            name,
            f"{where} is frozen for {still} of {fault.bad.size} samples while the vehicle moved, first at "
            f"{topic.time_s[first]:.3f} s; they were left out.",
            samples=still,
            first_s=float(topic.time_s[first]),
        )


def _empty(topic: Topic, faulty: Sequence[_Faults]) -> Iterator[Finding]:
    """Samples that are no numbers, channels that lack the same ones together."""
    alike: dict[bytes, list[_Faults]] = {}
    for fault in faulty:
        if fault.no_number.any() and not fault.refused:
            alike.setdefault(fault.no_number.tobytes(), []).append(fault)
    for faults in alike.values():
        names, lost = ", ".join(fault.channel.name for fault in faults), int(np.sum(faults[0].no_number))
        yield remark(
            "gap",
            names,
            f"{lost} of {faults[0].bad.size} samples of {names} in {topic.name} are no numbers and were left out.",
            lost_samples=lost,
        )
