"""One clock for channels that were logged on several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.channel import LOWEST_RATE_HZ
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.typing import FloatArray

LONGEST_BRIDGED_GAP_S = 0.1
"""Longer holes split the data; shorter ones are interpolated, and both are reported."""

_GAP_STEPS = 2.5
_TURNING = ("phi", "theta", "psi", "psi_setpoint")
_COVERED_S = 0.25
_ENOUGH = 0.5
_SHORTEST_PART_S = 1.0
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


def one_clock(
    record: FlightRecord,
    *,
    channels: Sequence[str],
    start_s: float,
    stop_s: float,
    followers: Sequence[str] = (),
    sample_rate_hz: float | None = None,
) -> Conditioned:
    """Bring channels of a record onto one uniform clock.

    The slowest of ``channels`` sets the rate, and the clock starts on one of its stamps, so that a log with one clock
    passes unchanged. Channels faster by half and more pass a zero-phase low-pass filter before they are thinned out; in
    between samples a cubic spline is used. ``followers`` do not take part in setting the rate: an instrument may be
    slower than the channels it explains, since the same distortion stands in both spectra of a joint estimate.

    Parameters
    ----------
    record
        The log.
    channels, followers
        Names of the vocabulary.
    start_s, stop_s
        Interval on the log's own clock.
    sample_rate_hz
        Rate to use instead of that of the slowest channel.

    Raises
    ------
    InsufficientDataError
        A channel is not in the log, or not in this interval.
    """
    sources = {name: source_topic(record, name, start_s, stop_s) for name in (*channels, *followers)}
    findings: list[Finding] = []
    series = {}
    for name, (topic, row) in sources.items():
        time_s, values, remarks = _ordered(topic, row, name)
        series[name] = (time_s, np.unwrap(values) if name in _TURNING else values)
        findings += remarks
    for name, (time_s, _) in series.items():
        if time_s.size < 2 or time_s[-1] <= start_s or time_s[0] >= stop_s:
            raise _absent(record, name, start_s, stop_s)
    base = min(channels, key=lambda name: _rate(series[name][0], start_s, stop_s))
    if not _rate(series[base][0], start_s, stop_s) > 0.0:
        raise _absent(record, base, start_s, stop_s)
    rate = sample_rate_hz or _rate(series[base][0], start_s, stop_s)
    findings += _rate_findings(channels, series, start_s, stop_s)
    holes, remarks = _holes(series, start_s, stop_s)
    findings += remarks
    low = max([start_s, *(float(time_s[0]) for time_s, _ in series.values())])
    high = min([stop_s, *(float(time_s[-1]) for time_s, _ in series.values())])
    findings += _trimmed(sources, low, high, start_s, stop_s)
    histories = []
    for part_start, part_stop in _parts(low, high, holes):
        stamps = series[base][0]
        first = stamps[np.searchsorted(stamps, part_start)]
        # The last stamp itself belongs to the part, whatever the division rounds to.
        count = int(np.floor((part_stop - first) * rate + _SAME_STAMP_S * rate)) + 1
        if count / rate < min(_SHORTEST_PART_S, 0.5 * (stop_s - start_s)):
            continue
        clock = first + np.arange(count) / rate
        rows = [_sample(*series[name], clock, rate) for name in sources]
        histories.append(
            TimeHistory(
                values=np.stack(rows),
                channels=tuple(topic.channels[row] for topic, row in sources.values()),
                sample_rate_hz=rate,
                start_s=float(first),
                processing=(f"brought to one clock of {rate:.6g} Hz",),
            )
        )
    return Conditioned(histories=tuple(histories), findings=_merged(findings))


def missing_channel(record: FlightRecord, name: str, remedy: str = "") -> InsufficientDataError:
    """The error for a channel that a log does not hold."""
    message = f"{record.source.name} holds no {name}."
    return InsufficientDataError(
        f"{record.source.name} holds no {name}",
        needed=f"the channel {name}; there are {', '.join(record.channel_names) or 'none'}",
        remedy=remedy or "log it, or name its source with --map",
        findings=[Finding(kind="missing_channel", severity="error", where=name, message=message)],
    )


def _absent(record: FlightRecord, name: str, start_s: float, stop_s: float) -> InsufficientDataError:
    interval = f"from {start_s:.6g} s to {stop_s:.6g} s"
    message = f"{record.source.name} holds no {name} {interval}."
    return InsufficientDataError(
        message,
        needed="samples of it in this interval",
        remedy="choose a segment in which it was logged",
        findings=[Finding(kind="missing_channel", severity="error", where=name, message=message)],
    )


def source_topic(record: FlightRecord, name: str, start_s: float, stop_s: float) -> tuple[Topic, int]:
    """The best topic that covers at least half of the interval, or else the one that covers most.

    A topic that is good but ends early (ArduPilot's SIDD, beside the filtered RATE) is worth more than a worse one that
    goes on: the interval is cut to it, and the caller is told.
    """
    within = max(min(stop_s, record.stop_s) - max(start_s, record.start_s), 1e-9)
    covered: list[tuple[float, Topic, int]] = []
    for topic, row in record.holding(name):
        inside = topic.time_s[(topic.time_s >= start_s) & (topic.time_s <= stop_s)]
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
    places = ", ".join(dict.fromkeys(topic.name for topic, _ in sources.values()))
    return [
        Finding(
            kind="segment_trimmed",
            severity="warning",
            where=f"{start_s:.1f} to {stop_s:.1f} s",
            message=f"Of {start_s:.2f} to {stop_s:.2f} s, {places} together hold {low:.2f} to {high:.2f} s.",
            numbers={"start_s": low, "stop_s": high},
        )
    ]


def _ordered(topic: Topic, row: int, name: str) -> tuple[FloatArray, FloatArray, list[Finding]]:
    """Samples with finite values and rising stamps; what was left out is counted."""
    time_s, values = topic.time_s, topic.values[row]
    finite = np.isfinite(values) & np.isfinite(time_s)
    time_s, values = time_s[finite], values[finite]
    latest = np.maximum.accumulate(time_s)
    rising = np.concatenate([[True], time_s[1:] > latest[:-1]])
    if rising.all():
        return time_s, values, []
    dropped = int(np.sum(~rising))
    finding = Finding(
        kind="clock_disorder",
        severity="warning",
        where=name,
        message=f"{dropped} stamps of {topic.name} repeat or step back; their samples were left out.",
        numbers={"samples": dropped},
    )
    return time_s[rising], values[rising], [finding]


def _steps(time_s: FloatArray, start_s: float, stop_s: float) -> FloatArray:
    inside = (time_s >= start_s) & (time_s <= stop_s)
    return np.asarray(np.diff(time_s[inside]))


def _rate(time_s: FloatArray, start_s: float, stop_s: float) -> float:
    """Rate of the samples between gaps: the mean of the ordinary steps, finer than the median of jittery ones."""
    steps = _steps(time_s, start_s, stop_s)
    if steps.size == 0:
        return 0.0
    ordinary = steps[(steps < 1.5 * np.median(steps)) & (steps > 0.5 * np.median(steps))]
    return float(1.0 / ordinary.mean()) if ordinary.size else float(1.0 / np.median(steps))


def _rate_findings(
    channels: Sequence[str], series: dict[str, tuple[FloatArray, FloatArray]], start_s: float, stop_s: float
) -> list[Finding]:
    rates = {name: _rate(series[name][0], start_s, stop_s) for name in channels}
    fastest = max(rates.values())
    slow = [
        Finding(
            kind="rate_too_low",
            severity="warning",
            where=name,
            message=(
                f"{name} was logged at {rate:.3g} Hz; below {LOWEST_RATE_HZ:.0f} Hz neither motor lag nor delay of a "
                "small multirotor can be seen."
            ),
            numbers={"rate_hz": rate, "needed_hz": LOWEST_RATE_HZ},
        )
        for name, rate in rates.items()
        if rate < LOWEST_RATE_HZ
    ]
    return slow + [
        Finding(
            kind="rate_too_low",
            severity="warning",
            where=name,
            message=f"{name} was logged at {rate:.0f} Hz beside {fastest:.0f} Hz; raise its logging rate.",
            numbers={"rate_hz": rate, "fastest_hz": fastest},
        )
        for name, rate in rates.items()
        if LOWEST_RATE_HZ <= rate < 0.6 * fastest
    ]


def _holes(
    series: dict[str, tuple[FloatArray, FloatArray]], start_s: float, stop_s: float
) -> tuple[list[tuple[float, float]], list[Finding]]:
    """Gaps too long to be bridged, and a remark for each set of channels with the same gaps."""
    holes: dict[tuple[float, float], None] = {}
    alike: dict[tuple[int, float, bool], list[str]] = {}
    for name, (time_s, _) in series.items():
        inside = time_s[(time_s >= start_s) & (time_s <= stop_s)]
        steps = np.diff(inside)
        limit = _GAP_STEPS * np.median(steps) if steps.size else np.inf
        gaps = np.flatnonzero(steps > limit)
        if gaps.size == 0:
            continue
        long = gaps[steps[gaps] > max(LONGEST_BRIDGED_GAP_S, limit)]
        holes |= {(float(inside[gap]), float(inside[gap + 1])): None for gap in long}
        alike.setdefault((gaps.size, float(steps.max()), bool(long.size)), []).append(name)
    findings = [
        Finding(
            kind="gap",
            severity="warning" if split else "info",
            where=", ".join(names),
            message=f"{count} gaps in {', '.join(names)}, the longest {longest_s:.3f} s; "
            + ("the data were split there." if split else "they were short and interpolated."),
            numbers={"gaps": count, "longest_s": longest_s},
        )
        for (count, longest_s, split), names in alike.items()
    ]
    return list(holes), findings


def _parts(low: float, high: float, holes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches between the holes of what all channels cover."""
    parts = []
    for begin, end in sorted(holes):
        parts.append((low, min(begin, high)))
        # A hole of one channel may lie inside one of another.
        low = max(low, end)
    parts.append((low, high))
    return [(a, b) for a, b in parts if b > a]


def _sample(time_s: FloatArray, values: FloatArray, clock_s: FloatArray, rate_hz: float) -> FloatArray:
    margin = 50.0 / rate_hz
    inside = slice(
        max(int(np.searchsorted(time_s, clock_s[0] - margin)) - 1, 0),
        int(np.searchsorted(time_s, clock_s[-1] + margin)) + 1,
    )
    time_s, values = time_s[inside], values[inside]
    own = 1.0 / float(np.median(np.diff(time_s)))
    factor = round(own / rate_hz)
    if factor < 2:
        return _spline(time_s, values, clock_s)
    return _thinned(time_s, values, clock_s, rate_hz, factor)


def _spline(time_s: FloatArray, values: FloatArray, clock_s: FloatArray) -> FloatArray:
    nearest = np.clip(np.searchsorted(time_s, clock_s - _SAME_STAMP_S), 0, time_s.size - 1)
    if np.abs(time_s[nearest] - clock_s).max() <= _SAME_STAMP_S:
        return values[nearest]
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time_s, values)(clock_s))


def _thinned(time_s: FloatArray, values: FloatArray, clock_s: FloatArray, rate_hz: float, factor: int) -> FloatArray:
    """Sample ``factor`` times too fast, low-pass without phase, keep every ``factor``-th sample."""
    reach = 20 * factor
    # Blackman: a ripple of 0.02 % from zero to 0.65 of the new Nyquist frequency, where Hamming's would be 0.4 %.
    taps = np.sinc(0.8 / factor * np.arange(-reach, reach + 1)) * np.blackman(2 * reach + 1)
    taps /= taps.sum()
    fast = clock_s[0] + np.arange(-reach, clock_s.size * factor + reach) / (rate_hz * factor)
    fine = _spline(time_s, values, np.clip(fast, time_s[0], time_s[-1]))
    return np.asarray(np.convolve(fine, taps, mode="valid")[: clock_s.size * factor : factor])


def _merged(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """One of each kind and place."""
    return tuple({(finding.kind, finding.where): finding for finding in findings}.values())
