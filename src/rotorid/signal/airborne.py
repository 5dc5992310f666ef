"""When a vehicle was in the air: as the flags of its log say, or else as thrust and sensors show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import MOTORS, FlightRecord, Intervals, Topic, silences
from rotorid.errors import InsufficientDataError
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FLYING_SHARE = 0.5
"""A vehicle flies while its thrust exceeds this share of its usual thrust."""

_LONGEST_DIP_S = 1.0
_LONGEST_REST_S = 5.0
"""While the motors run on, a descent may be as long, and as quiet; and so may a dive without motors."""

_SHORTEST_FLIGHT_S = 2.0
_SHORTEST_EARLY_S = 5.0
"""Who raises the throttle and tips over is said to fly for seconds."""

_WINDOW_S = 0.5
"""Window over which the motion of sensors is taken."""

_LIVELIER = 15.0
"""Sweeps in light gusts spread up to eleven times as much as the calm between them; rest on the ground, far less."""

_QUIET_PERCENT, _FLYING_PERCENT = 2.0, 75.0
"""Percentiles that stand for rest and for usual flight."""

_LONGEST_SILENCE_S = 60.0
"""A flight does not go on through a longer pause of the whole log; so no flight is longer than its samples allow."""

_FORCES = ("ax", "ay", "az")
_SENSORS = (*_FORCES, *RATES)

_HIGH_PERCENT = 99.0
"""Percentile that stands for the highest thrust, without single peaks."""

_MOVING_RAD_S = 0.1
"""Body rates, rms of half a second and without vibration, that a vehicle on the ground does not have."""

_MOVING_M_S2 = 0.5
"""The same for the size of the specific force against that of gravity, biases of sensors included."""

_VIBRATION_S = 0.1
"""Mean that takes vibration out of rates and forces."""

_RUNNING_SHARE = 0.1
"""Motors run while they exceed this share of their usual output."""

_CARRYING_SHARE = 0.25
"""Share of the usual thrust that motors which idle on the ground do not reach."""

_MOST_BELOW_ZERO = 0.05
"""Share of the usual thrust by which a thrust may lie below zero; one that lies lower counts from hover."""


@dataclass(frozen=True, kw_only=True)
class Airborne:
    """Stretches of a record in the air.

    Parameters
    ----------
    intervals
        Start and stop of each flight in seconds on the log's own clock, in order of time.
    seen_in
        What showed it: flags of the log, a thrust command, the motors, or the activity of accelerometer and gyro.
    by_thrust
        Whether flags, thrust or motors showed it. The activity of sensors only guesses: who rests in the air looks
        landed.
    by_flags
        Whether the autopilot itself says so.
    findings
        ``airborne`` with start and stop of the longest flight.
    """

    intervals: tuple[tuple[float, float], ...]
    seen_in: str
    findings: tuple[Finding, ...]
    by_thrust: bool = True
    by_flags: bool = False

    @property
    def longest(self) -> tuple[float, float]:
        """Start and stop of the longest flight."""
        return max(self.intervals, key=lambda interval: interval[1] - interval[0])


@cached_by_value
def airborne(record: FlightRecord, *, margin_s: float = 1.0) -> Airborne:
    """Find the flights in a record.

    Where the log has landed flags, they say it, and nothing is cut from their flights. An autopilot that says "not
    landed" as soon as the throttle rises is believed from 5 s on, where the vehicle then moved for 2 s and more: by
    body rates above 0.1 rad/s, or a specific force that is 0.5 m/s² off gravity.

    Elsewhere the first of these that the record holds: the thrust command, the mean of the motor outputs (more than
    half of its usual value while it runs, or body rates above 0.1 rad/s while the motors run, as in a dive at zero
    throttle), the activity of accelerometer and gyro (spread within half a second more than the geometric mean of that
    at rest and that in flight, where these differ by fifteen and more). Dips of up to 1 s belong to a flight; flights
    under 2 s and what was not armed are left out. A thrust that goes below zero counts from hover, and shows nothing.

    A vehicle without flags that lifts off below half of its usual thrust without turning, or is carried about by hand,
    misleads it. A record that begins in the air begins its flight with its first sample.

    Parameters
    ----------
    margin_s
        Cut from both ends of each flight without flags that begins or ends within the record, where the ground still
        acts.

    Raises
    ------
    InsufficientDataError
        There is neither thrust nor motor, accelerometer or gyro, or the vehicle never flew.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> from rotorid.data.record import Source
    >>> time_s = np.arange(0.0, 60.0, 0.02)
    >>> thrust = np.where((time_s >= 10.0) & (time_s < 50.0), 0.4, 0.0)
    >>> command = Channel(name="thrust_command", unit="1")
    >>> topic = Topic(name="mixer", time_s=time_s, channels=(command,), values=thrust[None])
    >>> record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(topic,))
    >>> start_s, stop_s = airborne(record).longest
    >>> round(start_s, 2), round(stop_s, 2)
    (11.0, 48.98)
    """
    status = record.status
    if status.in_air is not None or status.armed == ():
        shortest_s = _SHORTEST_EARLY_S if status.early else _SHORTEST_FLIGHT_S
        flights = [interval for interval in status.in_air or () if interval[1] - interval[0] >= shortest_s]
        intervals = tuple(interval for interval in flights if not status.early or _moves(record, interval))
        return _found(record, intervals, status.flagged_in or "the log", by_flags=True)
    time_s, flying, carrying, seen_in = _flying(record)
    if status.armed is not None:
        flying = flying & within(time_s, status.armed)
    by_thrust = carrying is not None
    return _found(record, _intervals(time_s, flying, carrying, margin_s), seen_in, by_thrust=by_thrust)


def airborne_by_thrust(record: FlightRecord) -> Airborne | None:
    """Flights from lift-off to touch-down, as flags, thrust or motors show them; ``None`` where none of these does.

    The activity of sensors is no reason to throw data away. Where flags say that the vehicle was armed or in the air
    at times and it never flew, as in a bench test, there are no intervals; a rig without flags has thrust and no
    flight, and its maneuvers count as they are.
    """
    try:
        found = airborne(record, margin_s=0.0)
    except InsufficientDataError:
        status = record.status
        flagged = status.in_air is not None or status.armed is not None
        return Airborne(intervals=(), seen_in=status.flagged_in, findings=(), by_flags=True) if flagged else None
    return found if found.by_thrust else None


def evidence_words(seen_in: str) -> str:
    """The evidence of a flight, as the end of a sentence.

    Examples
    --------
    >>> evidence_words("vehicle_land_detected and vehicle_status")
    'as vehicle_land_detected and vehicle_status show'
    """
    return f"as {seen_in} {'show' if ' and ' in seen_in else 'shows'}"


def _found(
    record: FlightRecord, intervals: Intervals, seen_in: str, *, by_thrust: bool = True, by_flags: bool = False
) -> Airborne:
    intervals = _logged(record, intervals)
    if not intervals:
        shortest_s = _SHORTEST_EARLY_S if by_flags and record.status.early else _SHORTEST_FLIGHT_S
        message = f"{record.source.name} has no flight of {shortest_s:g} s and more, {evidence_words(seen_in)}."
        raise InsufficientDataError(
            message,
            needed="a vehicle in the air",
            remedy="choose another log, or fit one part with rotorid identify --segment AXIS:START:STOP",
            findings=[refusal("never_airborne", seen_in, message)],
        )
    found = Airborne(intervals=intervals, seen_in=seen_in, findings=(), by_thrust=by_thrust, by_flags=by_flags)
    return replace(found, findings=(_finding(found, record),))


def _logged(record: FlightRecord, intervals: Intervals) -> Intervals:
    """Parts of flights between long silences of the log: what the vehicle did in one is not known."""
    for silent_from_s, silent_to_s in silences(record.topics, _LONGEST_SILENCE_S):
        parts = [
            part
            for start_s, stop_s in intervals
            for part in ((start_s, min(stop_s, silent_from_s)), (max(start_s, silent_to_s), stop_s))
        ]
        intervals = tuple((start_s, stop_s) for start_s, stop_s in parts if stop_s - start_s >= _SHORTEST_FLIGHT_S)
    return intervals


def _moves(record: FlightRecord, interval: tuple[float, float]) -> bool:
    """Whether the vehicle turns or accelerates for as long as a flight lasts at least; believed without sensors."""
    looked_at = False
    for names, most in ((RATES, _MOVING_RAD_S), (_FORCES, _MOVING_M_S2)):
        sensors = _together(record, names)
        if sensors is None:
            continue
        time_s, values, _ = sensors
        if names == _FORCES:
            values = np.sqrt((values**2).sum(axis=0, keepdims=True)) - STANDARD_GRAVITY_M_S2
        inside = (time_s >= interval[0]) & (time_s <= interval[1])
        # A damaged or thin channel is no evidence against a flag.
        if np.count_nonzero(inside) * float(np.median(np.diff(time_s))) < 0.5 * (interval[1] - interval[0]):
            continue
        looked_at = True
        if float(np.mean(_speed(time_s, values)[inside] > most)) * (interval[1] - interval[0]) >= _SHORTEST_FLIGHT_S:
            return True
    return not looked_at


def within(time_s: FloatArray, intervals: Intervals) -> BoolArray:
    """Which stamps lie in one of the intervals."""
    inside = np.zeros(time_s.size, dtype=np.bool_)
    for start_s, stop_s in intervals:
        inside |= (time_s >= start_s) & (time_s <= stop_s)
    return inside


def in_air(record: FlightRecord, name: str, flights: Intervals) -> tuple[FloatArray, FloatArray]:
    """Stamps and values of the finite samples of a channel in the air; empty where it is not logged."""
    if name not in record:
        return np.zeros(0), np.zeros(0)
    track = record[name]
    kept = within(track.time_s, flights) & np.isfinite(track.values)
    return track.time_s[kept], track.values[kept]


def _speed(time_s: FloatArray, rates: FloatArray) -> FloatArray:
    """Rms over half a second of body rates, or of what else moves, without vibration, shape ``(samples,)``."""
    step_s = float(np.median(np.diff(time_s)))
    square = np.zeros(time_s.size)
    # One axis after the other: of a long log, all of them at once would take a good part of the memory.
    for axis in rates:
        calm = _moving_mean(axis[np.newaxis], max(int(_VIBRATION_S / step_s), 1))
        calm *= calm
        mean = _moving_mean(calm, max(int(_WINDOW_S / step_s), 1), output=calm)[0]
        square += np.maximum(mean, 0.0, out=mean)
        del calm, mean
    return np.sqrt(square)


def _flying(record: FlightRecord) -> tuple[FloatArray, BoolArray, BoolArray | None, str]:
    """Stamps, where the vehicle flies, where its motors carry a part of it as far as they are known, and the signal."""
    for time_s, thrust, name in _thrusts(record):
        usual = _usual(thrust)
        if usual > 0.0 and float(np.percentile(thrust, _QUIET_PERCENT)) > -_MOST_BELOW_ZERO * usual:
            flying = (thrust > FLYING_SHARE * usual) | _diving(record, time_s, thrust > _RUNNING_SHARE * usual)
            return time_s, flying, thrust > _CARRYING_SHARE * usual, name
    sensors = _together(record, _SENSORS)
    if sensors is None:
        raise InsufficientDataError(
            f"{record.source.name} has neither thrust nor accelerometer nor gyro",
            needed="thrust_command, motor_1 ..., ax ay az, or p q r",
            remedy="log one of them, or name its source with --map",
        )
    time_s, values, name = sensors
    return time_s, _lively(time_s, values), None, f"the activity of {name}"


def _diving(record: FlightRecord, time_s: FloatArray, running: BoolArray) -> BoolArray:
    """Where the vehicle turns while its motors run, whatever their thrust: in acro it flies without."""
    rates = _together(record, RATES)
    if rates is None or not running.any():
        return np.zeros(time_s.size, dtype=np.bool_)
    rate_time_s, values, _ = rates
    moving = np.interp(time_s, rate_time_s, _speed(rate_time_s, values), left=0.0, right=0.0) > _MOVING_RAD_S
    before = np.maximum.accumulate(np.where(running, time_s, -np.inf))
    after = np.minimum.accumulate(np.where(running, time_s, np.inf)[::-1])[::-1]
    return np.asarray(moving & (after - before <= _LONGEST_REST_S))


def _thrusts(record: FlightRecord) -> Iterator[tuple[FloatArray, FloatArray, str]]:
    """Signals that rise with thrust, best first."""
    command = _together(record, ("thrust_command",))
    if command:
        yield command[0], command[1][0], command[2]
    motors = _together(record, tuple(f"motor_{number}" for number in range(1, MOTORS + 1)))
    if motors:
        yield motors[0], motors[1].mean(axis=0), "the mean of the motors"


def _together(record: FlightRecord, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray, str] | None:
    """Those of the channels that stand in one topic, the one that lasts longest, where all are finite."""
    topics = dict.fromkeys(topic for name in names for topic, _ in record.holding(name))
    durations = [(float(np.ptp(topic.time_s)), topic) for topic in topics if topic.time_s.size >= 2]
    if not durations:
        return None
    topic = max(durations, key=lambda item: item[0])[1]
    rows = {name: topic.row(name) for name in names}
    present = {name: row for name, row in rows.items() if row is not None}
    return _finite_samples(topic, list(present.values()), ", ".join(present))


def _finite_samples(topic: Topic, rows: list[int], names: str) -> tuple[FloatArray, FloatArray, str] | None:
    """Samples that are finite at stamps that rise."""
    values = topic.values[rows]
    kept = np.isfinite(values).all(axis=0) & np.isfinite(topic.time_s)
    # Of a long log, a copy of all samples is a good part of the memory.
    time_s, values = (topic.time_s, values) if kept.all() else (topic.time_s[kept], values[:, kept])
    if not np.all(time_s[1:] >= time_s[:-1]):
        order = np.argsort(time_s, kind="stable")
        time_s, values = time_s[order], values[:, order]
    return (time_s, values, names) if time_s.size >= 2 else None


def _usual(thrust: FloatArray) -> float:
    """Thrust in flight: the median of all above half of its highest values, so that waiting does not count."""
    high = float(np.percentile(thrust, _HIGH_PERCENT))
    running = thrust[thrust > 0.5 * high]
    return float(np.median(running)) if high > 0.0 and running.size else 0.0


def _lively(time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Where sensors move as in flight; everywhere, when they never rest."""
    window = max(int(_WINDOW_S / float(np.median(np.diff(time_s)))), 2)
    activity = np.zeros(values.shape[1])
    # One sensor after the other: of a long log, all of them at once are a good part of the memory.
    for row in values:
        square = _moving_mean(row[None] ** 2, window)
        mean = _moving_mean(row[None], window)
        spread = np.sqrt(np.maximum(square - mean**2, 0.0))[0]
        # Sensors of both kinds count alike, each in units of its own spread over the record.
        scale = float(np.percentile(spread, _FLYING_PERCENT))
        activity += spread / (scale if scale > 0.0 else 1.0)
    activity /= len(values)
    quiet, usual = (float(level) for level in np.percentile(activity, [_QUIET_PERCENT, _FLYING_PERCENT]))
    if usual <= 0.0:
        return np.zeros(time_s.size, dtype=np.bool_)
    if usual < _LIVELIER * quiet:
        return np.ones(time_s.size, dtype=np.bool_)
    return np.asarray(activity > np.sqrt(max(quiet, usual / _LIVELIER**2) * usual))


def _moving_mean(values: FloatArray, window: int, *, output: FloatArray | None = None) -> FloatArray:
    """Mean over a window of samples, put into ``output`` where it is given, which may be ``values`` itself."""
    from scipy.ndimage import uniform_filter1d

    # Stamps in bursts, most of them a microsecond apart, ask for a window longer than the log.
    return np.asarray(uniform_filter1d(values, min(window, values.shape[1]), axis=1, mode="nearest", output=output))


def _intervals(
    time_s: FloatArray, flying: BoolArray, carrying: BoolArray | None, margin_s: float
) -> tuple[tuple[float, float], ...]:
    """Stretches of flight, dips bridged, margins cut where the flight does not reach an end of the record."""
    index = np.flatnonzero(flying)
    if index.size == 0:
        return ()
    longest_s = np.full(index.size - 1, _LONGEST_DIP_S)
    if carrying is not None:
        dropped = np.diff(np.cumsum(~(carrying | flying))[index])
        longest_s[dropped == 0] = _LONGEST_REST_S
    breaks = np.flatnonzero((np.diff(time_s[index]) > longest_s) & (np.diff(index) > 1))
    starts = index[np.concatenate([[0], breaks + 1])]
    stops = index[np.concatenate([breaks, [index.size - 1]])]
    cut = [
        (
            float(time_s[start]) + (margin_s if start > 0 else 0.0),
            float(time_s[stop]) - (margin_s if stop < time_s.size - 1 else 0.0),
        )
        for start, stop in zip(starts, stops, strict=True)
    ]
    return tuple((start, stop) for start, stop in cut if stop - start >= _SHORTEST_FLIGHT_S)


def _finding(found: Airborne, record: FlightRecord) -> Finding:
    start_s, stop_s = found.longest
    whole = start_s <= record.start_s and stop_s >= record.stop_s
    more = f"; {len(found.intervals)} flights in all" if len(found.intervals) > 1 else ""
    return remark(
        "airborne",
        found.seen_in,
        f"In the air from {start_s:.1f} to {stop_s:.1f} s, {evidence_words(found.seen_in)}"
        f"{', which is the whole record' if whole else ''}{more}.",
        start_s=start_s,
        stop_s=stop_s,
        flights=len(found.intervals),
    )
