"""One clock for channels that were logged on several, and the samples that were logged behind those that are there.

Some logs hold channels that someone joined by straight lines between slower samples; :func:`interpolated` finds the
samples that they were.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.advice import channel_advice
from rotorid.data.base import Immutable, cached_by_value, read_only
from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, TimeHistory, Topic, places, require_record
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, FloatArray

LONGEST_BRIDGED_GAP_S = 0.1
"""Longer holes split the data; shorter ones are interpolated, and both are reported."""

_DENSEST = 4.0
"""No uniform clock has more samples than so many times those that were logged."""
_GAP_STEPS = 2.5
_TURNING = ("phi", "theta", "psi", "psi_setpoint")
_COVERED_S = 0.25
_ENOUGH = 0.5
_SHORTEST_PART_S = 1.0
_SPARSE = 10
_SAME_STAMP_S = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditioned:
    """Channels on one clock.

    Parameters
    ----------
    histories
        One for each stretch without a long gap, in order of time.
    findings
        Gaps, disorder of stamps, rates that do not fit together.
    """

    histories: tuple[TimeHistory, ...]
    findings: tuple[Finding, ...]

    @property
    def longest(self) -> TimeHistory:
        """The longest stretch without a gap.

        Raises
        ------
        InsufficientDataError
            Gaps leave none.
        """
        if not self.histories:
            raise InsufficientDataError(
                "gaps leave nothing of what was asked for",
                needed="a stretch without a gap",
                remedy="log at a lower rate, or on a faster card",
            )
        return max(self.histories, key=lambda history: history.duration_s)


def resample(
    record: FlightRecord,
    *,
    channels: Sequence[str],
    start_s: float,
    stop_s: float,
    auxiliary: Sequence[str] = (),
    sample_rate_hz: float | None = None,
) -> Conditioned:
    """Bring channels of a record onto one uniform clock.

    The slowest of ``channels`` sets the rate, and the clock starts on one of its stamps, so that a log with one clock
    passes unchanged. Channels faster by half and more pass a zero-phase low-pass filter before they are thinned out; in
    between samples a cubic spline is used. ``auxiliary`` do not take part in setting the rate: an instrument may be
    slower than the channels it explains, since the same distortion stands in both spectra of a joint estimate.

    Parameters
    ----------
    record
        The log.
    channels, auxiliary
        Names of the vocabulary.
    start_s, stop_s
        Interval on the log's own clock.
    sample_rate_hz
        Rate to use instead of that of the slowest channel.

    Raises
    ------
    InsufficientDataError
        A channel is not in the log, or not in this interval.
    UsageError
        The rate is not positive, or the record is none.
    """
    require_record(record)
    if sample_rate_hz is not None and not sample_rate_hz > 0.0:
        raise UsageError(f"the sample rate {sample_rate_hz:g} Hz is not positive", needed="a positive number")
    sources = {name: source_topic(record, name, start_s, stop_s) for name in (*channels, *auxiliary)}
    findings: list[Finding] = []
    series = {}
    for name, (topic, row) in sources.items():
        time_s, values, remarks = _ordered(topic, row, name)
        series[name] = (time_s, values)
        findings += remarks
    for name, (time_s, _) in series.items():
        if time_s.size < 2 or time_s[-1] <= start_s or time_s[0] >= stop_s:
            raise _absent(record, name, start_s, stop_s)
    rates = _rates({name: series[name][0] for name in channels}, start_s, stop_s)
    base = min(rates, key=rates.__getitem__)
    if not rates[base] > 0.0:
        raise _absent(record, base, start_s, stop_s)
    rate = sample_rate_hz or rates[base]
    findings += _rate_findings(rates)
    findings += _bursts({name: series[name][0] for name in channels}, sources, start_s, stop_s)
    holes, remarks = _holes(series, start_s, stop_s)
    findings += remarks
    low = max([start_s, *(float(time_s[0]) for time_s, _ in series.values())])
    high = min([stop_s, *(float(time_s[-1]) for time_s, _ in series.values())])
    findings += _trimmed(sources, low, high, start_s, stop_s)
    histories = []
    for part_start, part_stop in _parts(low, high, holes):
        stamps = series[base][0]
        first = stamps[np.searchsorted(stamps, part_start)]
        # The last stamp itself belongs to the part, whatever the division rounds to: by less than a sample at any rate.
        count = int(np.floor((part_stop - first) * rate + min(_SAME_STAMP_S * rate, 0.5))) + 1
        if count / rate < min(_SHORTEST_PART_S, 0.5 * (stop_s - start_s)):
            continue
        clock = first + np.arange(count) / rate
        histories.append(
            TimeHistory(
                values=_sampled(series, clock, rate),
                channels=tuple(topic.channels[row] for topic, row in sources.values()),
                sample_rate_hz=rate,
                start_s=float(first),
                processing=(f"brought to one clock of {rate:.6g} Hz",),
            )
        )
    return Conditioned(histories=tuple(histories), findings=_merged(findings))


def even_step_s(time_s: FloatArray) -> float:
    """Step of a uniform clock for stamps that rise and may jitter.

    It is their median step, and never so short that the clock has more than four times as many samples: where stamps
    come in bursts, as messages do that were stamped on arrival, most steps are far shorter than the mean.

    Parameters
    ----------
    time_s
        Two or more, shape ``(samples,)``.

    Examples
    --------
    >>> even_step_s(np.array([0.0, 0.1, 0.2, 0.31])), even_step_s(np.array([0.0, 1e-6, 2e-6, 4.0]))
    (0.1, 0.25)
    """
    return max(float(np.median(np.diff(time_s))), float(time_s[-1] - time_s[0]) / (_DENSEST * time_s.size))


def missing_channel(record: FlightRecord, name: str, remedy: str = "") -> InsufficientDataError:
    """The error for a channel that a log does not hold.

    Parameters
    ----------
    record
        The log.
    name
        Of the channel.
    remedy
        What to do; advice on logging by default.
    """
    message = f"{record.source.name} has no {name}."
    return InsufficientDataError(
        f"{record.source.name} has no {name}",
        needed=f"the channel {name}; there are {', '.join(record.channel_names) or 'none'}",
        remedy=remedy or channel_advice(record, name),
        findings=[refusal("missing_channel", name, message)],
    )


def _absent(record: FlightRecord, name: str, start_s: float, stop_s: float) -> InsufficientDataError:
    interval = f"from {start_s:.6g} s to {stop_s:.6g} s"
    message = f"{record.source.name} has no {name} {interval}."
    return InsufficientDataError(
        message,
        needed="samples in this interval",
        remedy="choose a segment in which it was logged",
        findings=[refusal("missing_channel", name, message)],
    )


def source_topic(record: FlightRecord, name: str, start_s: float, stop_s: float) -> tuple[Topic, int]:
    """The best topic that covers at least half of the interval, or else the one that covers most.

    A topic that is good but ends early (ArduPilot's SIDD, beside the filtered RATE) is worth more than a worse one that
    goes on: the interval is cut to it, with a finding.
    """
    within = max(min(stop_s, record.stop_s) - max(start_s, record.start_s), 1e-9)
    covered: list[tuple[float, Topic, int]] = []
    for topic, row in record.holding(name):
        inside = topic.time_s[topic.within(start_s, stop_s)]
        if inside.size >= 2:
            covered.append((float(inside.max() - inside.min()) / within, topic, row))
    if not covered:
        known = name in record.channel_names
        raise _absent(record, name, start_s, stop_s) if known else missing_channel(record, name)
    enough = [item for item in covered if item[0] >= _ENOUGH] or [max(covered, key=lambda item: item[0])]
    return enough[0][1], enough[0][2]


def _trimmed(
    sources: Mapping[str, tuple[Topic, int]], low: float, high: float, start_s: float, stop_s: float
) -> list[Finding]:
    """What to say when the channels do not reach the ends of the interval."""
    missing = max(low - start_s, 0.0) + max(stop_s - high, 0.0)
    if missing <= _COVERED_S:
        return []
    return [
        warn(
            "segment_trimmed",
            f"{start_s:.1f} to {stop_s:.1f} s",
            f"{start_s:.2f} to {stop_s:.2f} s was shortened to {low:.2f} to {high:.2f} s, in which "
            f"{places(sources.values())} all have samples.",
            start_s=low,
            stop_s=high,
        )
    ]


def rises(time_s: FloatArray) -> BoolArray:
    """Which finite stamps are later than all before them; others repeat or step back.

    Examples
    --------
    >>> rises(np.array([0.0, 1.0, 1.0, 0.5, 2.0])).tolist()
    [True, True, False, False, True]
    """
    return np.asarray(time_s > np.concatenate([[-np.inf], np.maximum.accumulate(time_s)[:-1]]))


@cached_by_value
def _ordered(topic: Topic, row: int, name: str) -> tuple[FloatArray, FloatArray, list[Finding]]:
    """Samples with finite values and rising stamps, of an angle without its jumps; what was left out is counted.

    The whole channel is looked at once, however many of its maneuvers are brought to a clock.
    """
    time_s, values, findings = _rising(topic, row, name)
    return time_s, np.unwrap(values) if name in _TURNING else values, findings


def _rising(topic: Topic, row: int, name: str) -> tuple[FloatArray, FloatArray, list[Finding]]:
    time_s, values = topic.time_s, topic.values[row]
    finite = np.isfinite(values) & np.isfinite(time_s)
    if not finite.all():
        time_s, values = time_s[finite], values[finite]
    rising = rises(time_s)
    if rising.all():
        return time_s, values, []
    dropped = int(np.sum(~rising))
    finding = warn(
        "clock_disorder",
        name,
        f"{dropped} stamps of {topic.name} repeat or step back; their samples were left out.",
        samples=dropped,
    )
    return time_s[rising], values[rising], [finding]


def _steps(time_s: FloatArray, start_s: float, stop_s: float) -> FloatArray:
    first, last = np.searchsorted(time_s, start_s), np.searchsorted(time_s, stop_s, side="right")
    return np.asarray(np.diff(time_s[first:last]))


def _rate(time_s: FloatArray, start_s: float, stop_s: float) -> float:
    """Rate of the samples between gaps: the mean of the ordinary steps, finer than the median of jittery ones."""
    steps = _steps(time_s, start_s, stop_s)
    if steps.size == 0:
        return 0.0
    ordinary = steps[(steps < 1.5 * np.median(steps)) & (steps > 0.5 * np.median(steps))]
    rate = float(1.0 / ordinary.mean()) if ordinary.size else float(1.0 / np.median(steps))
    return min(rate, _DENSEST * _mean_rate(steps))


def _mean_rate(steps: FloatArray) -> float:
    """Samples by time between the gaps that split the data."""
    between = steps[steps <= _longest_bridged(steps)]
    return float(between.size / between.sum())


def _longest_bridged(steps: FloatArray) -> float:
    """Longest step that does not split the data."""
    return max(LONGEST_BRIDGED_GAP_S, _GAP_STEPS * float(np.median(steps)))


def _rates(stamps: Mapping[str, FloatArray], start_s: float, stop_s: float) -> dict[str, float]:
    """Rate of each channel; channels of one topic share their stamps, and these are looked at once."""
    of_stamps = {id(time_s): time_s for time_s in stamps.values()}
    known = {key: _rate(time_s, start_s, stop_s) for key, time_s in of_stamps.items()}
    return {name: known[id(time_s)] for name, time_s in stamps.items()}


def _bursts(
    stamps: Mapping[str, FloatArray], sources: Mapping[str, tuple[Topic, int]], start_s: float, stop_s: float
) -> list[Finding]:
    """What to say where most steps of a topic are far shorter than their mean, once for each topic."""
    of_topics = {sources[name][0].name: _steps(time_s, start_s, stop_s) for name, time_s in stamps.items()}
    return [
        warn(
            "clock_disorder",
            name,
            f"The stamps of {name} come in bursts: half of the steps are {1e3 * float(np.median(steps)):.3g} ms or "
            f"less, and their mean is {1e3 / _mean_rate(steps):.3g} ms. They say when the samples arrived, not when "
            "they were taken.",
            median_s=float(np.median(steps)),
            mean_s=1.0 / _mean_rate(steps),
        )
        for name, steps in of_topics.items()
        if steps.size and float(np.median(steps)) * _DENSEST * _mean_rate(steps) < 1.0
    ]


def _rate_findings(rates: Mapping[str, float]) -> list[Finding]:
    """Channels that were logged too slowly, those of one rate together.

    What answers a set-point of attitude, speed or place has the delay of a whole loop, which a slow log shows too.
    """
    slow_loop = any(name.endswith("_setpoint") for name in rates) and not any(
        name.endswith("_command") or name.startswith(("motor_", "p_", "q_", "r_")) for name in rates
    )
    fastest = max(rates.values())
    alike: dict[float, list[str]] = {}
    for name, rate in rates.items():
        alike.setdefault(float(f"{rate:.3g}"), []).append(name)
    slow, slower = [], []
    for rate, names in alike.items():
        where, were = ", ".join(names), f"{listed(names)} {'was' if len(names) == 1 else 'were'}"
        if rate < LOWEST_RATE_HZ and not slow_loop:
            message = (
                f"{were} logged at {rate:g} Hz; below {LOWEST_RATE_HZ:.0f} Hz neither motor lag nor delay of a small "
                "multirotor can be seen."
            )
            slow.append(warn("rate_too_low", where, message, rate_hz=rates[names[0]], needed_hz=LOWEST_RATE_HZ))
        elif rate < 0.6 * fastest:
            message = f"{were} logged at {rate:.0f} Hz, others at {fastest:.0f} Hz; raise the logging rate."
            slower.append(warn("rate_too_low", where, message, rate_hz=rates[names[0]], fastest_hz=fastest))
    return slow + slower


def _holes(
    series: dict[str, tuple[FloatArray, FloatArray]], start_s: float, stop_s: float
) -> tuple[list[tuple[float, float]], list[Finding]]:
    """Gaps too long to be bridged, and a remark for each set of channels with the same gaps."""
    holes: dict[tuple[float, float], None] = {}
    alike: dict[tuple[int, float, bool], list[str]] = {}
    for name, (time_s, _) in series.items():
        first, last = np.searchsorted(time_s, start_s), np.searchsorted(time_s, stop_s, side="right")
        inside = time_s[first:last]
        steps = np.diff(inside)
        if not steps.size:
            continue
        gaps = np.flatnonzero(steps > _GAP_STEPS * np.median(steps))
        longest_s = _longest_bridged(steps)
        # A gap across an end of the interval is no less long.
        for before, after in ((first - 1, first), (last - 1, last)):
            if before >= 0 and after < time_s.size and time_s[after] - time_s[before] > longest_s:
                holes[float(time_s[before]), float(time_s[after])] = None
        if gaps.size == 0:
            continue
        long = gaps[steps[gaps] > longest_s]
        holes |= {(float(inside[gap]), float(inside[gap + 1])): None for gap in long}
        alike.setdefault((gaps.size, float(steps.max()), bool(long.size)), []).append(name)
    findings = [
        (warn if split else remark)(
            "gap",
            ", ".join(names),
            _gaps_in_words(count, names, longest_s)
            + (
                "the data were split there."
                if split
                else f"{'it was' if count == 1 else 'they were'} short and interpolated."
            ),
            gaps=count,
            longest_s=longest_s,
        )
        for (count, longest_s, split), names in alike.items()
    ]
    return list(holes), findings


def _gaps_in_words(count: int, names: Sequence[str], longest_s: float) -> str:
    where = ", ".join(names)
    if count == 1:
        return f"1 gap of {longest_s:.3f} s in {where}; "
    return f"{count} gaps in {where}, the longest {longest_s:.3f} s; "


def _parts(low: float, high: float, holes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches between the holes of what all channels cover."""
    parts = []
    for begin, end in sorted(holes):
        parts.append((low, min(begin, high)))
        # A hole of one channel may lie inside one of another.
        low = max(low, end)
    parts.append((low, high))
    return [(a, b) for a, b in parts if b > a]


def _sampled(series: Mapping[str, tuple[FloatArray, FloatArray]], clock_s: FloatArray, rate_hz: float) -> FloatArray:
    """Channels on one clock, shape ``(channels, samples)``, those that share their stamps at once."""
    together: dict[int, list[int]] = {}
    for row, (time_s, _) in enumerate(series.values()):
        together.setdefault(id(time_s), []).append(row)
    channels = list(series.values())
    found = np.empty((len(channels), clock_s.size))
    for rows in together.values():
        time_s = channels[rows[0]][0]
        sampled = _sample(time_s, [channels[row][1] for row in rows], clock_s, rate_hz)
        for row in rows:
            found[row] = next(sampled)
    return found


def _sample(
    time_s: FloatArray, rows: Sequence[FloatArray], clock_s: FloatArray, rate_hz: float
) -> Iterator[FloatArray]:
    margin = 50.0 / rate_hz
    inside = slice(
        max(int(np.searchsorted(time_s, clock_s[0] - margin)) - 1, 0),
        int(np.searchsorted(time_s, clock_s[-1] + margin)) + 1,
    )
    time_s, rows = time_s[inside], [row[inside] for row in rows]
    factor = round(1.0 / (even_step_s(time_s) * rate_hz)) if time_s.size > 1 else 1
    # Samples that lie together in a corner of a long clock have no common rate with it.
    if factor < 2 or clock_s.size * factor > _SPARSE * time_s.size:
        return _spline(time_s, rows, clock_s)
    return _thinned(time_s, rows, clock_s, rate_hz, factor)


def _spline(time_s: FloatArray, rows: Sequence[FloatArray], clock_s: FloatArray) -> Iterator[FloatArray]:
    """One channel after the other, as far as they need no common equations: long logs fill the memory."""
    nearest = np.clip(np.searchsorted(time_s, clock_s - _SAME_STAMP_S), 0, time_s.size - 1)
    if np.abs(time_s[nearest] - clock_s).max() <= _SAME_STAMP_S:
        return (row[nearest] for row in rows)
    from scipy.interpolate import CubicSpline

    return iter(np.asarray(CubicSpline(time_s, np.stack(rows), axis=1)(clock_s)))


def _thinned(
    time_s: FloatArray, rows: Sequence[FloatArray], clock_s: FloatArray, rate_hz: float, factor: int
) -> Iterator[FloatArray]:
    """Sample ``factor`` times too fast, low-pass without phase, keep every ``factor``-th sample."""
    reach = 20 * factor
    # Blackman: a ripple of 0.02 % from zero to 0.65 of the new Nyquist frequency, where Hamming's would be 0.4 %.
    taps = np.sinc(0.8 / factor * np.arange(-reach, reach + 1)) * np.blackman(2 * reach + 1)
    taps /= taps.sum()
    fast = clock_s[0] + np.arange(-reach, clock_s.size * factor + reach) / (rate_hz * factor)
    fine = _spline(time_s, rows, np.clip(fast, time_s[0], time_s[-1]))
    return (np.convolve(channel, taps, mode="valid")[: clock_s.size * factor : factor] for channel in fine)


def _merged(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """One of each kind and place."""
    return tuple({(finding.kind, finding.where): finding for finding in findings}.values())


_STRAIGHT = 1e-6
_LEAST_KNOTS = 5
_MOST_KNOTS = 0.35
_LEVEL = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Interpolated(Immutable):
    """The samples between which channels were joined by straight lines.

    Parameters
    ----------
    time_s
        Of the samples, shape ``(n,)``; the ends of the record are among them.
    values
        Shape ``(channels, n)``.
    logged_rate_hz
        At which the joined channels came.
    """

    time_s: FloatArray
    values: FloatArray
    logged_rate_hz: float

    def __post_init__(self) -> None:
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1), values=read_only(self.values, np.float64, ndim=2))

    @property
    def sample_rate_hz(self) -> float:
        """Median rate of the true samples."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    def smooth(self, time_s: FloatArray) -> FloatArray:
        """Channels joined anew by a cubic spline, shape ``(channels, m)``.

        Holds for motion that the true samples follow; what was faster is lost, and the spline invents nothing for it.
        """
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.time_s, self.values, axis=1)(time_s), dtype=np.float64)

    def finding(self, where: str) -> Finding:
        """A remark that the channels are slower than they look."""
        return warn(
            "interpolated_channel",
            where,
            f"{where} comes at {self.logged_rate_hz:.0f} Hz, but was joined by straight lines between samples "
            f"at {self.sample_rate_hz:.1f} Hz: what is faster than {0.5 * self.sample_rate_hz:.1f} Hz is lost.",
            rate_hz=self.sample_rate_hz,
            logged_rate_hz=self.logged_rate_hz,
        )


def interpolated(time_s: FloatArray, values: FloatArray) -> Interpolated | None:
    """The true samples of channels that are straight lines in between; ``None`` where they are not.

    Parameters
    ----------
    time_s
        Stamps, rising, shape ``(n,)``.
    values
        Channels that were sampled and joined together, shape ``(channels, n)``. True samples need not fall on stamps:
        each is where the lines beside it meet, in the channel that bends most there.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> slow, fast = np.arange(0.0, 10.0, 0.1), np.arange(0.0, 9.9, 0.01)
    >>> found = interpolated(fast + 0.003, np.interp(fast + 0.003, slow, rng.standard_normal(slow.size))[None])
    >>> round(found.sample_rate_hz, 3)
    10.0
    """
    if time_s.size < 3 * _LEAST_KNOTS:
        return None
    slopes = np.diff(values, axis=1) / np.diff(time_s)
    span = np.ptp(values, axis=1, keepdims=True) / np.median(np.diff(time_s))
    bends = np.abs(np.diff(slopes, axis=1)) > _STRAIGHT * np.where(span > 0.0, span, np.inf)
    bent = np.flatnonzero(bends.any(axis=0)) + 1
    if bent.size < _LEAST_KNOTS or bent.size > 2 * _MOST_KNOTS * time_s.size:
        return None
    edges = np.concatenate([[0], bent, [time_s.size - 1]])
    lines = [(begin, end) for begin, end in itertools.pairwise(edges) if end - begin >= 2]
    if len(lines) < _LEAST_KNOTS or len(lines) > _MOST_KNOTS * time_s.size or _is_sampled_and_held(values, lines):
        return None
    knots = [_meeting(time_s, values, before, after) for before, after in itertools.pairwise(lines)]
    times = np.array([time_s[0], *(at for at, _ in knots), time_s[-1]])
    levels = np.column_stack([values[:, 0], *(level for _, level in knots), values[:, -1]])
    kept = np.concatenate([[True], np.diff(times) > 0.0])
    rate_hz = float(1.0 / np.median(np.diff(time_s)))
    return Interpolated(time_s=times[kept], values=levels[:, kept], logged_rate_hz=rate_hz)


def _is_sampled_and_held(values: FloatArray, lines: list[tuple[int, int]]) -> bool:
    """Whether most lines are level: samples that were held are no joined ones."""
    level = [np.array_equal(values[:, begin], values[:, end]) for begin, end in lines]
    return float(np.mean(level)) > _LEVEL


def _meeting(
    time_s: FloatArray, values: FloatArray, before: tuple[int, int], after: tuple[int, int]
) -> tuple[float, FloatArray]:
    """Where two lines meet, and the values of all channels there."""
    (start, end), (begin, stop) = before, after
    early = (values[:, end] - values[:, start]) / (time_s[end] - time_s[start])
    late = (values[:, stop] - values[:, begin]) / (time_s[stop] - time_s[begin])
    most = int(np.argmax(np.abs(late - early)))
    turn = float(late[most] - early[most])
    at = time_s[end]
    if turn != 0.0:
        reached = values[most, end] + late[most] * (time_s[begin] - time_s[end])
        at = time_s[end] + float((values[most, begin] - reached) / -turn)
    at = float(np.clip(at, time_s[end], time_s[begin]))
    return at, values[:, end] + early * (at - time_s[end])
