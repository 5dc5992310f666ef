r"""Motor speeds against the outputs that drive them: what disagrees is left out before anything reads it.

A speed that an ESC or a tachometer reports enters thrust squared, so that a few lost samples make a thrust coefficient
wrong by percents. A rotor cannot do what these reports do: its speed follows the output with a lag of tens of
milliseconds. Left out are

- a channel that reads near zero throughout while its output runs as those of others do: no sensor, or none that works;
- samples near zero or below while the output runs: lost reports. A rotor that really stops does not come back within
  0.1 s; a longer stop stays where the vehicle turned or the output rose, since that is a motor that failed;
- a value that stands still for half a second while the output moves;
- samples of twice or half the speed of both their neighbors;
- a channel at about twice or half the speed of the others at the same output (another number of poles);
- channels whose differences from the mean follow the output of another motor, and not their own (in another order).

Speeds that are negative throughout carry the direction of rotation in their sign, which is taken off. Unknown is not
wrong: without outputs only what no rotor can do is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from weakref import WeakSet

import numpy as np

from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import MOTORS, FlightRecord, Topic
from rotorid.typing import BoolArray, FloatArray

_FEWEST = 50
_LOST, _TURNING = 0.1, 0.5
"""Shares of the usual speed below which a report is lost, and above which the rotor turns as usual."""

_STOP_S = 0.1
"""A rotor that stops does not turn as usual again within this time."""

_ROSE = 0.2
"""Rise of an output, of its whole range, by which a controller answers a motor that fails."""

_STILL_S, _STILL_SAMPLES, _STILL_RUNS = 0.5, 10, 5.0
_MOVED = 0.05
"""Change of an output, over its usual value, that a speed which stands still should have followed."""

_LEAST_CHANGING = 0.2
"""Share of the samples that change in a channel of which a constant stretch says anything."""

_RUNS = 0.2
"""Output at which a rotor turns, where no other motor shows it."""

_MOSTLY = 95.0
"""Percentile that stands for the highest of a channel."""

_DOUBLE, _NEAR_DOUBLE = 2.0, 0.12
_ALIKE = 0.2
"""Outputs that differ by less ask for the same speed."""

_POLES = (1.6, 2.5)
"""Ratio to the speeds of the other motors at the same output, or one over it, that no rotor explains."""

_OWN, _OTHER = 0.3, 0.7
"""Correlation with the own output below which, and with that of another motor above which, speeds are in another order.
"""

_LEAST_S, _GRID_HZ = 20.0, 20.0
_LAGS_S = (0.0, 0.05, 0.1)


_CHECKED: WeakSet[FlightRecord] = WeakSet()
"""Records that were checked: nothing of them is left out twice."""


@dataclass(frozen=True)
class _Speed:
    """A channel of speeds, with the output of its motor at its stamps where that is logged."""

    name: str
    topic: Topic
    row: int
    time_s: FloatArray
    values: FloatArray
    output: FloatArray | None

    @property
    def step_s(self) -> float:
        return 1.0 / self.topic.sample_rate_hz

    @property
    def usual(self) -> float:
        """Median of the samples that are not near zero."""
        turning = self.values[self.values > _LOST * float(np.percentile(self.values, _MOSTLY))]
        return float(np.median(turning)) if turning.size else 0.0


def checked_speeds(record: FlightRecord) -> FlightRecord:
    """The record without motor speeds that cannot be; each channel that lost some is named, with its share and time.

    A record that came out of here passes as it is.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source
    >>> speed = np.full(200, 800.0)
    >>> speed[50:53] = 0.0
    >>> topic = Topic(name="ESC", time_s=np.arange(200) / 100.0, values=speed[None],
    ...               channels=(Channel(name="motor_speed_1", unit="rad/s"),))
    >>> record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    >>> checked = checked_speeds(record)
    >>> checked["motor_speed_1"].values.size, [finding.kind for finding in checked.findings]
    (197, ['channels_disagree'])
    """
    if record in _CHECKED:
        return record
    checked = _checked(record)
    _CHECKED.add(checked)
    return checked


def _checked(record: FlightRecord) -> FlightRecord:
    findings: list[Finding] = []
    speeds: list[_Speed] = []
    turned: set[str] = set()
    for logged in _speeds(record):
        speed, remarks = _without_sign(logged)
        speeds.append(speed)
        findings += remarks
        turned |= {speed.name} if remarks else set()
    wrong = {speed.name: np.zeros(speed.values.size, dtype=np.bool_) for speed in speeds}

    def leave_out(found: Iterator[tuple[str, str, dict[str, float]]]) -> None:
        for name, message, numbers in found:
            wrong[name] = np.ones_like(wrong[name])
            findings.append(warn("channels_disagree", name, message, **numbers))

    leave_out(_without_sensor(speeds))
    for speed in speeds:
        bad = wrong[speed.name]
        for words, find in _OF_SAMPLES:
            if bad.all():
                break
            new = find(record, speed) & ~bad
            if new.any():
                bad |= new
                findings.append(_samples_finding(speed, new, words))
    # One after the other: what is left out is not compared again.
    leave_out(_of_other_poles(speeds, wrong))
    leave_out(_of_other_motors(speeds, wrong))
    changed = {speed.name: speed for speed in speeds if speed.name in turned or wrong[speed.name].any()}
    if not changed:
        return record
    topics = [part for topic in record.topics for part in _parts(topic, changed, wrong)]
    return replace(record, topics=tuple(topics), findings=(*record.findings, *findings))


def _speeds(record: FlightRecord) -> list[_Speed]:
    found = []
    for number in range(1, MOTORS + 1):
        source = next(record.holding(f"motor_speed_{number}"), None)
        if source is None:
            continue
        topic, row = source
        finite = np.isfinite(topic.values[row])
        time_s, values = topic.time_s[finite], topic.values[row][finite]
        if values.size < _FEWEST or topic.sample_rate_hz <= 0.0:
            continue
        output = None
        name = f"motor_{number}"
        for outputs, place in record.holding(name) if name in record.outputs else ():
            kept = np.isfinite(outputs.values[place])
            if np.count_nonzero(kept) > 1:
                late = np.searchsorted(outputs.time_s[kept], time_s, side="right") - 1
                output = outputs.values[place][kept][np.maximum(late, 0)]
                break
        found.append(_Speed(f"motor_speed_{number}", topic, row, time_s, values, output))
    return found


def _without_sign(speed: _Speed) -> tuple[_Speed, list[Finding]]:
    turning = speed.values[speed.values != 0.0]
    if not turning.size or np.mean(turning < 0.0) < 0.9 or (speed.output is not None and np.median(speed.output) < 0.0):
        return speed, []
    message = f"{speed.name} is negative: its sign is taken for the direction of rotation."
    return replace(speed, values=-speed.values), [remark("channels_disagree", speed.name, message)]


def _runs(mask: BoolArray) -> Iterator[tuple[int, int]]:
    """First sample, and the one behind the last, of each stretch that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _lost(record: FlightRecord, speed: _Speed) -> BoolArray:
    """Samples of lost reports: near zero or below while the motor runs."""
    found = np.zeros(speed.values.size, dtype=np.bool_)
    usual = speed.usual
    low = speed.values < _LOST * usual
    if usual <= 0.0 or not low.any():
        return found
    running = None
    if speed.output is not None:
        at_work = speed.output[speed.values > _TURNING * usual]
        running = speed.output > 0.5 * float(np.median(at_work)) if at_work.size else None
    for begin, end in _runs(low):
        if begin == 0 or end == low.size or (running is not None and not np.all(running[begin:end])):
            continue
        around_s = float(speed.time_s[end] - speed.time_s[begin - 1])
        sudden = min(speed.values[begin - 1], speed.values[end]) > _TURNING * usual
        short = around_s <= max(_STOP_S, 2.5 * speed.step_s)
        if sudden and (short or (running is not None and not _failed(record, speed, begin, end))):
            found[begin:end] = True
    return found


def _failed(record: FlightRecord, speed: _Speed, begin: int, end: int) -> bool:
    """Whether the vehicle turned, or the output rose, as when a motor really stops; unknown counts as yes."""
    assert speed.output is not None
    ordinary = float(np.percentile(speed.output, 95))
    if float(speed.output[begin:end].max()) > ordinary + _ROSE * max(1.0 - ordinary, 0.0):
        return True
    start_s, stop_s = float(speed.time_s[begin - 1]), float(speed.time_s[end])
    checked = False
    for name in ("p", "q"):
        source = next(record.holding(name), None)
        if source is None:
            continue
        topic, row = source
        inside = (topic.time_s >= start_s) & (topic.time_s <= stop_s)
        if np.count_nonzero(inside) < 3:
            continue
        checked = True
        others = topic.values[row][~inside]
        if float(np.abs(topic.values[row][inside]).max()) > float(np.percentile(np.abs(others), 99)):
            return True
    return not checked


def _still(_: FlightRecord, speed: _Speed) -> BoolArray:
    """Samples that repeat for long while the output moves."""
    found = np.zeros(speed.values.size, dtype=np.bool_)
    if speed.output is None or speed.usual <= 0.0:
        return found
    same = np.diff(speed.values) == 0.0
    if np.mean(~same) < _LEAST_CHANGING:
        return found
    longest = max(_STILL_S / speed.step_s, _STILL_SAMPLES)
    # Of a channel that is logged faster than it is measured, each value is repeated.
    usual_run = float(np.median(np.diff(np.flatnonzero(~same)))) if np.count_nonzero(~same) > 1 else 1.0
    working = speed.output[speed.values > _TURNING * speed.usual]
    level = float(np.median(working)) if working.size else 0.0
    for begin, end in _runs(same):
        asked = speed.output[begin : end + 1]
        if (
            end - begin >= max(longest, _STILL_RUNS * usual_run)
            and speed.values[begin] > _TURNING * speed.usual
            and float(np.std(asked)) > _MOVED * level > 0.0
        ):
            found[begin + 1 : end + 1] = True
    return found


def _doubled(_: FlightRecord, speed: _Speed) -> BoolArray:
    """Samples at twice or half the speed of those around them, for no longer than a rotor takes to change it."""
    found = np.zeros(speed.values.size, dtype=np.bool_)
    usual = speed.usual
    if usual <= 0.0:
        return found
    steps = np.diff(speed.values)
    jumps = np.flatnonzero(np.abs(steps) > 0.4 * usual)
    # Reports that jump all the time are how this sensor is.
    if speed.step_s > 0.5 * _STOP_S or not jumps.size or jumps.size > 0.1 * steps.size:
        return found
    for first, last in zip(jumps[:-1].tolist(), jumps[1:].tolist(), strict=True):
        begin, end = first + 1, last + 1
        before, after = speed.values[first], speed.values[end]
        if steps[first] * steps[last] > 0.0 or speed.time_s[end] - speed.time_s[first] > _STOP_S + speed.step_s:
            continue
        level = 0.5 * (before + after)
        if min(before, after) < _TURNING * usual * 0.5 or abs(after - before) > _ALIKE * level:
            continue
        ratio = float(np.median(speed.values[begin:end])) / level
        if min(abs(ratio - _DOUBLE), abs(1.0 / max(ratio, 1e-9) - _DOUBLE)) < _NEAR_DOUBLE * _DOUBLE:
            found[begin:end] = True
    return found


_OF_SAMPLES: tuple[tuple[str, Callable[[FlightRecord, _Speed], BoolArray]], ...] = (
    ("reads no more than a tenth of its usual speed while the motor runs", _lost),
    ("stands still while its output moves", _still),
    ("jumps to twice or half its speed and back", _doubled),
)
"""What samples do that no rotor does, and which ones."""


def _without_sensor(speeds: list[_Speed]) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Channels near zero throughout, of motors that run as those do whose speeds are known; zeros, where none is."""
    turning = {speed.name: _level(speed) for speed in speeds if speed.output is not None and speed.usual > 0.0}
    for speed in speeds:
        if speed.output is None:
            continue
        others = [level for name, level in turning.items() if name != speed.name]
        usual, output = np.median(others, axis=0) if others else (0.0, _RUNS / _TURNING)
        highest = float(np.percentile(np.abs(speed.values), _MOSTLY))
        if highest <= _LOST * usual and float(np.percentile(speed.output, _MOSTLY)) > _TURNING * output > 0.0:
            message = (
                f"{speed.name} reads at most {highest:.3g} rad/s while its motor runs, so it was left out. Check the "
                "telemetry of its ESC."
            )
            yield speed.name, message, {"highest_rad_s": highest}


def _of_other_poles(
    speeds: list[_Speed], wrong: Mapping[str, BoolArray]
) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Channels at about twice or half the speed of all others, where the outputs are alike."""
    left = [speed for speed in speeds if not wrong[speed.name].all()]
    known = [speed for speed in left if speed.output is not None and speed.usual > 0.0]
    if len(known) < 3:
        return
    levels = {speed.name: _level(speed, wrong[speed.name]) for speed in known}
    for speed in known:
        own_speed, own_output = levels[speed.name]
        others = [levels[other.name] for other in known if other is not speed]
        usual, output = (float(np.median(values)) for values in zip(*others, strict=True))
        if usual <= 0.0 or output <= 0.0 or abs(own_output / output - 1.0) > _ALIKE:
            continue
        ratio = own_speed / usual
        if _POLES[0] < max(ratio, 1.0 / max(ratio, 1e-9)) < _POLES[1]:
            message = (
                f"{speed.name} is {ratio:.2f} times the speed of the other motors at the same output, so it was left "
                "out. Check the number of poles that its ESC is set to."
            )
            yield speed.name, message, {"ratio": ratio}


def _level(speed: _Speed, wrong: BoolArray | None = None) -> tuple[float, float]:
    """Median speed and output while the motor turns as usual."""
    assert speed.output is not None
    kept = (True if wrong is None else ~wrong) & (speed.values > _TURNING * speed.usual)
    return float(np.median(speed.values[kept])), float(np.median(speed.output[kept]))


def _of_other_motors(
    speeds: list[_Speed], wrong: Mapping[str, BoolArray]
) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Channels whose differences from the mean follow the output of another motor."""
    known = [speed for speed in speeds if speed.output is not None and not wrong[speed.name].all()]
    if len(known) < 3 or len(known) < len(speeds):
        return
    start_s = max(float(speed.time_s[0]) for speed in known)
    stop_s = min(float(speed.time_s[-1]) for speed in known)
    rate_hz = min(_GRID_HZ, *(speed.topic.sample_rate_hz for speed in known))
    if stop_s - start_s < _LEAST_S or rate_hz <= 0.0:
        return
    clock = np.arange(start_s, stop_s, 1.0 / rate_hz)
    turned = np.stack([np.interp(clock, s.time_s[~wrong[s.name]], s.values[~wrong[s.name]]) for s in known])
    asked = np.stack([np.interp(clock, s.time_s, s.output) for s in known if s.output is not None])
    at_work = np.all(turned > _TURNING * np.array([[speed.usual] for speed in known]), axis=0)
    if np.count_nonzero(at_work) < _LEAST_S * rate_hz:
        return
    best = max(
        (_correlation(turned, _lagged(asked, lag_s * rate_hz), at_work) for lag_s in _LAGS_S),
        key=lambda table: float(table.max(axis=1).sum()),
    )
    for place, speed in enumerate(known):
        other = int(np.argmax(best[place]))
        if other == place or best[place, place] > _OWN or best[place, other] < _OTHER:
            continue
        names = [known[other].name.replace("_speed", ""), speed.name.replace("_speed", "")]
        message = (
            f"{speed.name} follows the output of {names[0]} (correlation {best[place, other]:.2f}), not that of "
            f"{names[1]} ({best[place, place]:.2f}), so it was left out. Check the order of {listed(sorted(names))}."
        )
        yield speed.name, message, {"correlation": float(best[place, other]), "own": float(best[place, place])}


def _lagged(values: FloatArray, samples: float) -> FloatArray:
    """Values behind a first-order lag of some samples."""
    from scipy.signal import lfilter

    keep = float(np.exp(-1.0 / samples)) if samples > 0.0 else 0.0
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, axis=1))


def _correlation(turned: FloatArray, asked: FloatArray, kept: BoolArray) -> FloatArray:
    """Of the differences from the mean motor, speeds by rows and outputs by columns; zero for one that never moves."""

    def normalized(values: FloatArray) -> FloatArray:
        chosen = values[:, kept] - values[:, kept].mean(axis=0)
        chosen = chosen - chosen.mean(axis=1, keepdims=True)
        size = np.linalg.norm(chosen, axis=1, keepdims=True)
        return np.asarray(np.divide(chosen, size, out=np.zeros_like(chosen), where=size > 0.0))

    return np.asarray(normalized(turned) @ normalized(asked).T)


def _samples_finding(speed: _Speed, bad: BoolArray, words: str) -> Finding:
    first = int(np.flatnonzero(bad)[0])
    share = float(np.mean(bad))
    return warn(
        "channels_disagree",
        speed.name,
        f"{speed.name} {words} in {100.0 * share:.2g} % of its samples, first at {speed.time_s[first]:.3f} s; "
        "they were left out.",
        share=share,
        samples=int(np.count_nonzero(bad)),
        first_s=float(speed.time_s[first]),
    )


def _parts(topic: Topic, changed: Mapping[str, _Speed], wrong: Mapping[str, BoolArray]) -> Iterator[Topic]:
    """A topic with its changed channels as topics of their own: all others keep their samples."""
    own = {row: speed for speed in changed.values() if speed.topic is topic for row in (speed.row,)}
    rest = [row for row in range(len(topic.channels)) if row not in own]
    if not own:
        yield topic
        return
    if rest:
        yield replace(topic, channels=tuple(topic.channels[row] for row in rest), values=topic.values[rest])
    for row, speed in own.items():
        kept = ~wrong[speed.name]
        if np.count_nonzero(kept) > 1:
            yield replace(
                topic, time_s=speed.time_s[kept], channels=(topic.channels[row],), values=speed.values[kept][None]
            )
