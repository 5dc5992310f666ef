r"""Whether a vehicle stayed in control, and when it was lost: by all that a log shows, at 10 Hz too.

Witnesses look at cells of 50 ms. Each says yes (out of control), no, or nothing where its channels are not logged:

- *rates missed*: the mean error of roll or pitch rate over 0.3 s exceeds 2 rad/s (yaw: 4) and half of the set-point
  while a motor is at a limit; without motor outputs, twice that
- *attitude missed*: the thrust axis is more than 45° off its set-point
- *tumbling*: tilt above 75° in a mode that holds attitudes; or, without set-points, 8 rad/s of roll and pitch
- *falling*: the vehicle sinks faster than 3 m/s at 1.3 times its usual thrust
- *unpowered*: the specific force is below 0.35 g while the motors are asked for half of their usual thrust or more, or
  for 0.6 s below 0.6 g at four fifths of it; the current is below a fifth of its usual while the motors should run, or
  the voltage below 60 %

Motors that are asked for little thrust, as in a dive at zero throttle or after they were stopped, cannot follow, and
what they miss is no loss.

A maneuver ends in controlled flight, a loss does not. What the witnesses see is a loss where the vehicle does not fly
on for 1.5 s: without complaint, level within 60°, at half to 1.8 times its usual thrust, and with no motor that stays
at full output: a quadrotor that lost a motor may level itself, and falls spinning. A witness that complains for a tenth
of the first half of a flight says nothing: its channel is not what the autopilot follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Intervals
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

LossCause: TypeAlias = Literal["set-point missed", "tumbling", "falling at full thrust", "power lost"]

_LEAST_USUAL = 1e-6
"""Mean output below which no motor turned."""
_CELL_S = 0.05
_HOLD_S = 0.26
"""A sample counts for so long: logs of 10 Hz have no holes then, and single lost samples make none."""

_MEAN_S = 0.3
_AXES = ("roll", "pitch", "yaw")
_RATE_MISSED_RAD_S, _SHARE_MISSED, _YAW_WEAKER = 2.0, 0.5, 2.0
_ATTITUDE_MISSED_RAD = np.radians(45.0)
_TUMBLING_RAD, _TUMBLING_RAD_S = np.radians(75.0), 8.0
_LEVEL_RAD = np.radians(60.0)
_OFF_RAD, _LEANS_RAD = np.radians(20.0), np.radians(10.0)
_STILL_RAD_S = 0.02
_EDGE = 0.05
"""Distance from the highest or lowest output of a flight, over their distance, that counts as at it."""
_SINK_M_S, _HIGH_SHARE = 3.0, 1.3
_FREE_FALL_M_S2, _LIGHT_M_S2 = 0.35 * STANDARD_GRAVITY_M_S2, 0.6 * STANDARD_GRAVITY_M_S2
_ASKED_SHARE, _NEARLY_USUAL, _ABLE_SHARE = 0.5, 0.8, 0.4
_CURRENT_SHARE, _VOLTAGE_SHARE = 0.2, 0.6
_LEAST_CURRENT_A = 2.0
"""A usual current that is lower is that of a sensor that does not work."""

_SHORTEST_S, _SHORTEST_FALL_S, _SHORTEST_LOSS_S = 0.35, 0.6, 0.6
_GAP_S = 0.5
_RECOVERED_S = 1.5
_STOPPED_S, _EARLIER_S = 0.15, 3.0
_CONTROLLED_SHARE = (0.5, 1.8)
_LATER_S = 4.0
"""So long after a flight its end is looked at: flags may end it at the loss, and the fall comes later."""

_COMPLAINS = 0.1
_OTHER_FLIGHT_S = 10.0
"""A flight that begins so long after a loss is one of its own."""

_HARD_M_S2, _HARD_SINK_M_S = 5.0 * STANDARD_GRAVITY_M_S2, 1.5
"""Specific force of a touchdown, and the sink before it, that make a hard landing."""

_ROLLING = ("acro", "flip", "throw", "turtle", "autotune", "manual")
"""Flight modes in which the tilt is the pilot's, or a program's, own."""


@dataclass(frozen=True, kw_only=True)
class Control(Immutable):
    """A loss of control, or an end of the log in the air.

    Parameters
    ----------
    lost_at_s
        When control was lost, on the log's own clock; ``None`` where it was kept.
    cause
        What showed it first.
    words
        What happened in the first seconds, as the end of a sentence.
    ends_in_air
        Whether the log, which began on the ground, ends before a touchdown.
    stop_s
        Last stamp of the log.
    impact_m_s2
        Largest specific force after the loss, or at the touchdown of a hard landing; zero where there is neither.
    impact_at_s
        When.
    numbers
        The numbers of ``words``.
    """

    lost_at_s: float | None = None
    cause: LossCause | None = None
    words: str = ""
    ends_in_air: bool = False
    stop_s: float = 0.0
    impact_m_s2: float = 0.0
    impact_at_s: float = 0.0
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(numbers=self.numbers)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """``control_lost``, ``ends_in_air``, ``hard_landing``, as far as they are true."""
        found = []
        if self.lost_at_s is not None:
            message = (
                f"Control was lost at {self.lost_at_s:.1f} s: {self.words}. What follows is left out of all averages."
            )
            found.append(warn("control_lost", "flight", message, lost_at_s=self.lost_at_s, **self.numbers))
        if self.ends_in_air:
            message = f"The log ends in the air at {self.stop_s:.1f} s: the landing is not logged."
            found.append(remark("ends_in_air", "flight", message, stop_s=self.stop_s))
        if self.impact_m_s2 and self.lost_at_s is None:
            size_g = self.impact_m_s2 / STANDARD_GRAVITY_M_S2
            message = (
                f"Hard landing at {self.impact_at_s:.1f} s: {size_g:.0f} g at touchdown. Check arms, motor mounts and "
                "the mount of the flight controller."
            )
            found.append(warn("hard_landing", "ax, ay, az", message, impact_m_s2=self.impact_m_s2))
        return tuple(found)


def control(record: FlightRecord, intervals: Intervals) -> Control | None:
    """The first loss of control in the flights of a record, a hard landing, or an end in the air.

    Parameters
    ----------
    intervals
        Start and stop of each flight in seconds on the log's own clock, in order of time.

    Returns
    -------
    Control or None
        ``None`` where control was kept as far as the log shows, and the vehicle landed softly or the log does not say.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 20.0, 0.1)
    >>> falls = time_s > 15.0
    >>> rows = {"p": 12.0 * falls, "p_setpoint": -1.0 * falls, "thrust_command": 0.4 + 0.0 * time_s,
    ...         "motor_1": np.where(falls, 1.0, 0.4), "motor_2": np.where(falls, 0.1, 0.4)}
    >>> channels = tuple(Channel(name=name, unit="1") for name in rows)
    >>> topic = Topic(name="RATE", time_s=time_s, channels=channels, values=np.stack([*rows.values()]))
    >>> record = FlightRecord(source=Source(name="crash.bin", format="dataflash", sha256=""), topics=(topic,))
    >>> lost = control(record, ((0.0, 20.0),))
    >>> round(lost.lost_at_s, 1), lost.cause, lost.words
    (15.1, 'set-point missed', 'motor 1 at its limit, roll rate 13 rad/s off its set-point')
    """
    found = None
    for number, (start_s, stop_s) in enumerate(intervals):
        later = intervals[number + 1][0] if number + 1 < len(intervals) else record.stop_s
        seen = _Cells.of(record, start_s, stop_s, min(stop_s + _LATER_S, later, record.stop_s))
        found = seen.loss() if seen is not None else None
        if found is not None:
            break
    if found is not None:
        return found
    return _kept(record, intervals)


_SHOWN_BY = (("p",), ("q",), ("phi", "phi_setpoint"), ("theta", "theta_setpoint"), ("ax", "ay", "az"))
"""Channels of which any group shows a loss of control of some kind."""


def shows_control(record: FlightRecord) -> bool:
    """Whether a log holds what a loss of control would show in; without it, nothing is known of control."""
    return any(set(names) <= set(record.channel_names) for names in _SHOWN_BY)


def before_loss(intervals: Intervals, lost: Control | None) -> Intervals:
    """Flights without what follows a loss; later flights of their own stay."""
    if lost is None or lost.lost_at_s is None:
        return intervals
    at_s = lost.lost_at_s
    cut = ((start_s, min(stop_s, at_s) if start_s < at_s else stop_s) for start_s, stop_s in intervals)
    return tuple((a, b) for a, b in cut if a < at_s or a > at_s + _OTHER_FLIGHT_S)


def _kept(record: FlightRecord, intervals: Intervals) -> Control | None:
    """How a log ends whose vehicle stayed in control."""
    if not intervals:
        return None
    start_s, stop_s = intervals[-1]
    # A part cut from the middle of a flight ends in the air without anything to say of it.
    begins_on_ground = intervals[0][0] > record.start_s + 1.0
    powered = False
    if begins_on_ground and stop_s > record.stop_s - 0.5 and _is_up(record, start_s, stop_s):
        last = _Cells.of(record, start_s, stop_s, record.stop_s)
        powered = last is not None and (last.powered_at_end or last.sinks_at_end)
    impact_m_s2, impact_at_s = _touchdown(record, intervals)
    if not powered and not impact_m_s2:
        return None
    return Control(ends_in_air=powered, stop_s=record.stop_s, impact_m_s2=impact_m_s2, impact_at_s=impact_at_s)


def _largest_in(record: FlightRecord, name: str, start_s: float, stop_s: float) -> float:
    """Largest value of a channel in an interval; not a number where it has none."""
    if name not in record:
        return np.nan
    track = record[name]
    inside = (track.time_s >= start_s) & (track.time_s <= stop_s) & np.isfinite(track.values)
    return float(track.values[inside].max()) if inside.any() else np.nan


def _is_up(record: FlightRecord, start_s: float, stop_s: float) -> bool:
    """Whether the height at the end of a flight, or else a landed flag, says that the vehicle is up."""
    if "down" in record:
        track = record["down"]
        known = np.isfinite(track.values) & (track.time_s >= start_s - 1.0) & (track.time_s <= stop_s + 0.5)
        if known.any():
            rise = track.values[known][0] - track.values[known][-1]
            # Off a hill or a roof, a vehicle flies below the place where it took off.
            return bool(abs(rise) > 1.0)
    return any(abs(stop - record.stop_s) < 0.5 for _, stop in record.status.in_air or ())


def _touchdown(record: FlightRecord, intervals: Intervals) -> tuple[float, float]:
    """Largest specific force about the end of a flight and when; zero where it is below that of a hard landing."""
    size, time_s = _specific_force(record)
    worst = (0.0, 0.0)
    for start_s, stop_s in intervals:
        if stop_s > record.stop_s - 0.2:
            continue
        about = (time_s > stop_s - 1.5) & (time_s < stop_s + 1.5)
        flown = (time_s > start_s + 1.0) & (time_s < stop_s - 1.5)
        if not about.any() or not flown.any():
            continue
        peak = int(np.argmax(np.where(about, size, 0.0)))
        usual = float(np.percentile(size[flown], 99.9))
        sink = _largest_in(record, "velocity_down", time_s[peak] - 1.5, time_s[peak])
        # A stiff frame rings at a soft touchdown too: where the sink is not logged, only a much larger one counts.
        least = _HARD_M_S2 if sink > _HARD_SINK_M_S else np.inf if np.isfinite(sink) else 2.0 * _HARD_M_S2
        if size[peak] > max(least, 1.5 * usual, worst[0]):
            worst = (float(size[peak]), float(time_s[peak]))
    return worst


def _specific_force(record: FlightRecord) -> tuple[FloatArray, FloatArray]:
    """Size of the specific force and its stamps; empty where not all three axes are in one topic."""
    for topic, _ in record.holding("az"):
        rows = [topic.row(name) for name in ("ax", "ay", "az")]
        if all(row is not None for row in rows):
            values = topic.values[[row for row in rows if row is not None]]
            kept = np.isfinite(values).all(axis=0) & np.isfinite(topic.time_s)
            return np.sqrt((values[:, kept] ** 2).sum(axis=0)), topic.time_s[kept]
    return np.zeros(0), np.zeros(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Channels of one flight as means over cells of 50 ms; not a number where nothing is logged."""

    record: FlightRecord
    time_s: FloatArray
    flying: BoolArray
    """Cells of the flight itself; those after it are only looked at."""
    rates: FloatArray
    """p, q, r, and their set-points, shape ``(6, cells)``."""
    attitude: FloatArray
    """phi, theta, and their set-points, shape ``(4, cells)``."""
    motors: FloatArray
    """Shape ``(motors, cells)``."""
    thrust: FloatArray
    """Over its usual value in this flight."""
    force: FloatArray
    """Size of the mean specific force."""
    sink: FloatArray
    current: FloatArray
    voltage: FloatArray

    @classmethod
    def of(cls, record: FlightRecord, start_s: float, stop_s: float, until_s: float) -> _Cells | None:
        """Cells from take-off to some seconds after the end of a flight; ``None`` for less than ten."""
        count = int((until_s - start_s) / _CELL_S)
        if count < 10:
            return None
        time_s = np.asarray(start_s + _CELL_S * (np.arange(count) + 0.5), dtype=np.float64)
        flying = time_s < stop_s

        def cells(*names: str) -> FloatArray:
            return np.stack([_cell_means(record, name, time_s) for name in names])

        motors = cells(*(record.outputs or ("motor_1",)))
        thrust = motors.mean(axis=0)
        if not np.isfinite(thrust).any():
            thrust = cells("thrust_command")[0]
        usual = float(np.nanmedian(thrust[flying])) if np.isfinite(thrust[flying]).any() else np.nan
        return cls(
            record=record,
            time_s=time_s,
            flying=flying,
            rates=cells("p", "q", "r", "p_setpoint", "q_setpoint", "r_setpoint"),
            attitude=cells("phi", "theta", "phi_setpoint", "theta_setpoint"),
            motors=motors,
            thrust=thrust / usual if usual > _LEAST_USUAL else np.full(count, np.nan),
            force=np.sqrt((cells("ax", "ay", "az") ** 2).sum(axis=0)),
            sink=cells("velocity_down")[0],
            current=cells("battery_current")[0],
            voltage=cells("battery_voltage")[0],
        )

    @property
    def powered_at_end(self) -> bool:
        """Whether the motors still carry the vehicle in the last cells."""
        last = self.thrust[-6:]
        last = last[np.isfinite(last)]
        return bool(last.size and last.min() > _ASKED_SHARE)

    @property
    def sinks_at_end(self) -> bool:
        """Whether the vehicle falls in the last cells."""
        last = self.sink[-6:]
        last = last[np.isfinite(last)]
        return bool(last.size and last.min() > _HARD_SINK_M_S)

    def loss(self) -> Control | None:
        """The loss of control from which this flight did not recover."""
        witnesses = {cause: seen for cause, seen in self._witnesses().items() if self._is_trusted(seen)}
        bad = np.logical_or.reduce([*witnesses.values(), np.zeros(self.time_s.size, dtype=np.bool_)])
        controlled = self._runs(self._controlled(bad), 0.0, _RECOVERED_S)
        after = max((stop for _, stop in controlled), default=0)
        spells = [(a, b) for a, b in self._runs(bad, _GAP_S, _SHORTEST_S) if b > after]
        # Motors that are stopped in the air end a flight: the fall that follows is no loss of control.
        spells = [(a, b) for a, b in spells if self.flying[min(a + round(_STOPPED_S / _CELL_S), self.flying.size - 1)]]
        fell = np.zeros_like(bad)
        for cause in ("falling at full thrust", "power lost"):
            fell |= witnesses.get(cause, fell)
        spells = [(a, b) for a, b in spells if fell[a:b].any() or not self._stays_level(a, b)]
        lasts_s = _CELL_S * sum(stop - first for first, stop in spells)
        if not spells or (lasts_s < _SHORTEST_LOSS_S and spells[-1][1] < self.time_s.size - round(_HOLD_S / _CELL_S)):
            return None
        return self._describe(spells[0][0], spells[-1][1], witnesses)

    def _stays_level(self, first: int, stop: int) -> bool:
        """Whether the vehicle keeps its attitude while rates miss theirs: a loop that swings, or a yaw too weak.

        Where attitude or set-point is not logged through most of it, nothing acquits.
        """
        tilt = _tilt(self.attitude[0], self.attitude[1])[first:stop]
        off = _angle_between(self.attitude)[first:stop]
        known = np.isfinite(tilt) & np.isfinite(off)
        return bool(np.mean(known) > 0.5 and tilt[known].max() < _LEVEL_RAD and off[known].max() < _OFF_RAD)

    def _begin(self, first: int) -> int:
        """The first cell of a loss: where the motor that is then at full output got there, up to three seconds ago."""
        for begin, stop in self._runs(self._stuck(), _CELL_S, 0.0):
            if begin < first < stop:
                return max(begin, first - round(_EARLIER_S / _CELL_S))
        return first

    def _is_trusted(self, seen: BoolArray) -> bool:
        size = int(self.flying.sum())
        return size < 10.0 / _CELL_S or float(np.mean(seen[: size // 2])) < _COMPLAINS

    def _controlled(self, bad: BoolArray) -> BoolArray:
        """Cells of quiet flight: no complaint, level, with about the usual thrust."""
        low, high = _CONTROLLED_SHARE
        tilt = _tilt(self.attitude[0], self.attitude[1])
        # Without a thrust, flight is what moves; with one, a vehicle at rest has none.
        carries = ~((self.thrust < low) | (self.thrust > high))
        calm = ~bad & ~(tilt > _LEVEL_RAD) & carries
        return np.asarray(calm & ~self._stuck() & ~self._lies(tilt) & self.flying)

    def _lies(self, tilt: FloatArray) -> BoolArray:
        """Cells in a second without any turn, tilted or off the set-point: a wreck whose motors may still run."""
        still = np.hypot(self.rates[0], self.rates[1]) < _STILL_RAD_S
        leans = (tilt > _LEANS_RAD) | (_angle_between(self.attitude) > _LEANS_RAD)
        return self._lasting(still & leans, 1.0)

    def _stuck(self) -> BoolArray:
        """Cells in a second through which a motor is at full output and another is not."""
        if not np.isfinite(self.motors).any() or len(self.motors) < 2:
            return np.zeros(self.time_s.size, dtype=np.bool_)
        high, low = float(np.nanmax(self.motors)), float(np.nanmin(self.motors))
        full = self.motors > high - _EDGE * (high - low)
        stays = np.stack([self._lasting(row, 1.0) for row in full & ~full.all(axis=0)])
        return np.asarray(stays.any(axis=0))

    def _witnesses(self) -> Mapping[LossCause, BoolArray]:
        """What each witness sees; nothing where its channels are not numbers."""
        rates, wanted = np.split(np.stack([_running_mean(row) for row in self.rates]), 2)
        error = np.abs(rates - wanted)
        blind = np.isnan(self.motors[0])
        most = np.maximum(_RATE_MISSED_RAD_S, _SHARE_MISSED * np.abs(wanted)) * np.where(blind, 2.0, 1.0)
        most[2] *= _YAW_WEAKER
        missed = (error > most).any(axis=0) & (self._limited() | blind)
        missed |= _angle_between(self.attitude) > _ATTITUDE_MISSED_RAD
        missed &= ~(self.thrust < _ABLE_SHARE)
        spinning = np.isnan(error[:2]).all(axis=0) & (np.hypot(rates[0], rates[1]) > _TUMBLING_RAD_S)
        tumbling = spinning | ((_tilt(self.attitude[0], self.attitude[1]) > _TUMBLING_RAD) & self._holds_attitude())
        falling = (self.sink > _SINK_M_S) & (self.thrust > _HIGH_SHARE)
        return {
            "set-point missed": missed,
            "tumbling": tumbling,
            "falling at full thrust": self._lasting(falling, _SHORTEST_FALL_S),
            "power lost": self._unpowered(),
        }

    def _unpowered(self) -> BoolArray:
        """Free fall, or a battery that gives nothing, while the motors should run."""
        asked = self.thrust > _ASKED_SHARE
        unknown = np.isnan(self.thrust)
        light = self.force < _FREE_FALL_M_S2
        falls = self._lasting(light & asked, _SHORTEST_S) | self._lasting(light & unknown, _SHORTEST_FALL_S)
        usual_a, usual_v = (
            float(np.nanmedian(row[self.flying])) if np.isfinite(row[self.flying]).any() else np.nan
            for row in (self.current, self.voltage)
        )
        cut = (self.current < _CURRENT_SHARE * usual_a) & (usual_a > _LEAST_CURRENT_A) & asked
        # A slow log holds a current long after the throttle has risen again.
        slow_s = 1.5 / max(self.record.rate_hz("battery_current"), 1e-3)
        sagged = self.voltage < _VOLTAGE_SHARE * usual_v
        return falls | self._lasting(cut, max(_SHORTEST_S, slow_s)) | self._lasting(sagged, 2.0 * _CELL_S)

    def _limited(self) -> BoolArray:
        """Cells with a motor near the highest or lowest output of this flight, while others are not."""
        outputs = self.motors
        if not np.isfinite(outputs).any():
            return np.zeros(self.time_s.size, dtype=np.bool_)
        high, low = float(np.nanmax(outputs)), float(np.nanmin(outputs))
        edge = _EDGE * (high - low)
        at_end = np.asarray(((outputs > high - edge) | (outputs < low + edge)).any(axis=0), dtype=np.float64)
        # Within a third of a second of it, for outputs and rates are logged at their own instants.
        return np.asarray(_running_mean(at_end) > 0.25)

    def _holds_attitude(self) -> BoolArray:
        """Cells in a mode that is known to hold attitudes; none where modes are not logged."""
        holds = np.zeros(self.time_s.size, dtype=np.bool_)
        for mode, start_s, stop_s in self.record.status.modes:
            if not any(word in mode for word in _ROLLING):
                holds |= (self.time_s >= start_s) & (self.time_s <= stop_s)
        return holds

    def _runs(self, on: BoolArray, gap_s: float, shortest_s: float) -> list[tuple[int, int]]:
        """First cell and the one after the last of each run, gaps bridged, short ones left out."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8))).reshape(-1, 2)
        runs: list[tuple[int, int]] = []
        for first, stop in edges.tolist():
            if runs and (first - runs[-1][1]) * _CELL_S <= gap_s:
                runs[-1] = (runs[-1][0], stop)
            else:
                runs.append((first, stop))
        return [(first, stop) for first, stop in runs if (stop - first) * _CELL_S >= shortest_s]

    def _lasting(self, on: BoolArray, shortest_s: float) -> BoolArray:
        kept = np.zeros(on.size, dtype=np.bool_)
        for first, stop in self._runs(on, 0.0, shortest_s):
            kept[first:stop] = True
        return kept

    def _describe(self, first: int, last: int, witnesses: Mapping[LossCause, BoolArray]) -> Control:
        """The loss in words, by what the first two seconds show."""
        begin = slice(first, min(first + round(2.0 / _CELL_S), last, self.time_s.size))
        onset = {cause: int(np.argmax(seen[begin])) for cause, seen in witnesses.items() if seen[begin].any()}
        cause = min(onset, key=lambda name: onset[name])
        parts: list[str] = []
        numbers: dict[str, float] = {}
        for words in (self._motor_words(begin, numbers), self._motion_words(begin, numbers)):
            parts += words
        sink = self.sink[first:last]
        if np.isfinite(sink).any() and np.nanmax(sink) > _SINK_M_S:
            parts.append(f"sinking at up to {np.nanmax(sink):.0f} m/s")
            numbers["sink_m_s"] = float(np.nanmax(sink))
        if "power lost" in onset:
            parts += self._power_words(begin, numbers)
        stop_s = float(self.record.stop_s)
        size, stamps = _specific_force(self.record)
        later = (stamps > self.time_s[first]) & (stamps < self.time_s[min(last, self.time_s.size - 1)] + 2.0)
        impact = int(np.argmax(np.where(later, size, 0.0))) if later.any() else -1
        strikes = impact >= 0 and size[impact] > _HARD_M_S2
        if strikes:
            parts.append(f"impact of {size[impact] / STANDARD_GRAVITY_M_S2:.0f} g at {stamps[impact]:.1f} s")
        return Control(
            lost_at_s=float(self.time_s[self._begin(first)]) - 0.5 * _CELL_S,
            cause=cause,
            words=", ".join(parts) or cause,
            ends_in_air=not strikes and stop_s - float(self.time_s[-1]) < 0.5 and not self._rests_at_end(),
            stop_s=stop_s,
            impact_m_s2=float(size[impact]) if strikes else 0.0,
            impact_at_s=float(stamps[impact]) if strikes else 0.0,
            numbers=numbers,
        )

    def _motor_words(self, begin: slice, numbers: dict[str, float]) -> list[str]:
        if not np.isfinite(self.motors[:, begin]).any():
            return []
        high, low = float(np.nanmax(self.motors)), float(np.nanmin(self.motors))
        share = np.mean(self.motors[:, begin] > high - _EDGE * (high - low), axis=1)
        if high > low and share.max() > 0.3 and share.min() < 0.3:
            numbers["motor"] = float(share.argmax()) + 1.0
            return [f"motor {share.argmax() + 1} at its limit"]
        return ["all motors at their limit"] if high > low and share.min() > 0.5 else []

    def _motion_words(self, begin: slice, numbers: dict[str, float]) -> list[str]:
        """The largest tilt; where it is small, how far the attitude is off its set-point, or else the rates."""
        angles = _largest(self.attitude[:2, begin])
        place = int(angles.argmax())
        if angles[place] > _LEVEL_RAD:
            numbers[f"{_AXES[place]}_deg"] = float(np.degrees(angles[place]))
            return [f"{_AXES[place]} {np.degrees(angles[place]):.0f}°"]
        angles = _largest(self.attitude[:2, begin] - self.attitude[2:, begin])
        place = int(angles.argmax())
        if angles[place] > _OFF_RAD:
            numbers["off_deg"] = float(np.degrees(angles[place]))
            return [f"{_AXES[place]} {np.degrees(angles[place]):.0f}° off its set-point"]
        rates = _largest(self.rates[:3, begin] - self.rates[3:, begin])
        place = int(rates.argmax())
        if rates[place] > _RATE_MISSED_RAD_S:
            numbers["off_rad_s"] = float(rates[place])
            return [f"{_AXES[place]} rate {rates[place]:.0f} rad/s off its set-point"]
        return []

    def _power_words(self, begin: slice, numbers: dict[str, float]) -> list[str]:
        words = []
        current, voltage, force = self.current[begin], self.voltage[begin], self.force[begin]
        if np.isfinite(current).any() and np.nanmin(current) < _CURRENT_SHARE * np.nanmedian(self.current[self.flying]):
            words.append(f"current {np.nanmin(current):.1f} A")
            numbers["current_a"] = float(np.nanmin(current))
        if np.isfinite(voltage).any() and np.nanmin(voltage) < _VOLTAGE_SHARE * np.nanmedian(self.voltage[self.flying]):
            words.append(f"battery {np.nanmin(voltage):.1f} V")
            numbers["voltage_v"] = float(np.nanmin(voltage))
        if np.isfinite(force).any() and np.nanmin(force) < _FREE_FALL_M_S2:
            words.append("free fall")
        return words

    def _rests_at_end(self) -> bool:
        """Whether the vehicle lies still when the log ends."""
        turn = np.hypot(self.rates[0, -6:], self.rates[1, -6:])
        weighs = ~(self.force[-6:] < 0.9 * STANDARD_GRAVITY_M_S2)
        return bool(np.isfinite(turn).any() and np.nanmax(turn) < 0.1 and weighs.all())


def _largest(rows: FloatArray) -> FloatArray:
    """Largest size in each row; zero where nothing is known."""
    return np.asarray(np.nan_to_num(np.abs(rows)).max(axis=1))


def _cell_means(record: FlightRecord, name: str, time_s: FloatArray) -> FloatArray:
    """Means of a channel over the cells, of the best topic that has samples there; a sample is held for 0.26 s."""
    values = np.full(time_s.size, np.nan)
    begin_s = time_s[0] - 0.5 * _CELL_S
    for topic, row in record.holding(name):
        place = np.floor((topic.time_s - begin_s) / _CELL_S)
        samples = topic.values[row]
        inside = (place >= 0.0) & (place < time_s.size) & np.isfinite(samples)
        cells = place[inside].astype(np.intp)
        count = np.bincount(cells, minlength=time_s.size)
        total = np.bincount(cells, weights=samples[inside], minlength=time_s.size)
        means = np.divide(total, count, out=np.full(time_s.size, np.nan), where=count > 0)
        # A log that is slower on purpose holds its samples as long as they are apart.
        slow_s = min(max(_HOLD_S, 1.5 / topic.sample_rate_hz if topic.sample_rate_hz > 0.0 else 0.0), 1.0)
        filled = _held(means, round(slow_s / _CELL_S))
        values = np.where(np.isnan(values), filled, values)
    return values


def _held(values: FloatArray, most: int) -> FloatArray:
    """Values held over at most so many cells without a number."""
    known = np.where(np.isfinite(values), np.arange(values.size), -1)
    last = np.maximum.accumulate(known)
    age = np.arange(values.size) - last
    return np.where((last >= 0) & (age <= most), values[np.maximum(last, 0)], np.nan)


def _running_mean(values: FloatArray) -> FloatArray:
    """Mean over 0.3 s, of what is known there."""
    from scipy.ndimage import uniform_filter1d

    size = round(_MEAN_S / _CELL_S)
    known = np.isfinite(values)
    share = uniform_filter1d(known.astype(np.float64), size, mode="nearest")
    mean = uniform_filter1d(np.where(known, values, 0.0), size, mode="nearest")
    return np.where(known & (share > 0.0), mean / np.maximum(share, 1e-9), np.nan)


def _tilt(phi: FloatArray, theta: FloatArray) -> FloatArray:
    """Angle between the thrust axis and the vertical, rad."""
    return np.asarray(np.arccos(np.clip(np.cos(phi) * np.cos(theta), -1.0, 1.0)))


def _angle_between(attitude: FloatArray) -> FloatArray:
    """Angle between the thrust axis and its set-point, heading left out, rad."""
    phi, theta, phi_wanted, theta_wanted = attitude
    product = (
        np.cos(phi) * np.sin(theta) * np.cos(phi_wanted) * np.sin(theta_wanted)
        + np.sin(phi) * np.sin(phi_wanted)
        + np.cos(phi) * np.cos(theta) * np.cos(phi_wanted) * np.cos(theta_wanted)
    )
    return np.asarray(np.arccos(np.clip(product, -1.0, 1.0)))
