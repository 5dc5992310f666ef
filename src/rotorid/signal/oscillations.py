r"""Loops that swing by themselves: limit cycles at any rate of the log, and slow swings.

Gains that are too high for a vehicle make its loop swing until something limits it. What then shows in a log, and does
not in gusts, with moving sticks or after a chopped throttle, is *how much of its range the command uses*, on and on:

- **Limit cycle.** The command of an axis spreads by more than 0.1 of its range (root mean square above 2 Hz, 0.8 Hz in
  slow logs) in the usual second of powered flight, while a motor is at a limit in more than a quarter of all samples.
  Neither needs the log to be fast: samples that are picked too rarely fold a line to another frequency, and keep its
  size. In a slow log 0.35 of the range counts without limits too, since no stick does that all the time. Where the log
  is fast enough to show lines, one line has to hold a good part of the spread: pure noise is none.
- **Line without limits.** Where the motors do not reach their limits, or are not logged, the same spread counts where
  one line holds most of it that the set-point of the rate does not have.
- **Slow swing.** Too much integral swings below some 5 Hz and saturates nothing but the integral. Attitude less its
  set-point then spreads by more than 2 degrees even in the quietest fifth of the flight, at one steady frequency that
  the set-point does not have: with full sticks the difference is larger, and follows the set-point.

Means of several samples hide a limit cycle: at 50 Hz, the mean of 23 Hz is a fifth of it. What an autopilot writes are
samples; of a table nobody knows, so a table below 100 Hz that looks calm does not count as checked. A cycle at a whole
multiple of the rate of a slow log stands still in it, far from the flight's own median; if it stands at the median, a
motor at its limit leaves the axis unchecked.

The rule and its limits were chosen on simulated and real flights: see the accuracy page.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.autopilots.filters import combined_response
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable, cached_by_value
from rotorid.data.display import capital
from rotorid.data.record import FlightRecord, Intervals
from rotorid.signal.airborne import airborne
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.clock import rises
from rotorid.signal.limits import POWERED
from rotorid.signal.motors import motor_limits
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray, IntArray

Loop: TypeAlias = Literal["rate", "attitude"]
"""Where an oscillation shows: in the command of the rate loop, or in the attitude less its set-point."""

LARGEST_RMS = 0.10
"""Of a command in the usual window, as a share of its range: stable flights reach 0.25 with full sticks, and limits in
0.23 of the samples; limit cycles begin at 0.11."""

HUGE_RMS = 0.35
"""No stick moves a command so much all the time: slow logs need no motor at a limit from here on."""

LARGEST_LIMITED = 0.25
"""Share of powered samples with a motor at a limit, whatever the cause: stable flights reach 0.23, limit cycles begin
at 0.39."""

LARGEST_ERROR_RAD = np.radians(2.0)
"""Of the attitude against its set-point."""

_LIMITED_LINE, _FREE_LINE, _SLOW_LINE, _PURE_LINE = 0.3, 0.6, 0.3, 0.7
"""Share of the power in one line: of a command with a motor at its limit (0.92 and more in limit cycles, 0.39 where
much noise is on them), of one without limits (up to 0.56 in stable flights), of the attitude (0.32 and more in slow
swings, up to 0.22 in stable flights), and of an attitude that is nothing else."""

_DRIVEN = 0.25
"""Power of a set-point at the line over that of the answer, above which the set-point makes the line."""

_QUIETEST_PERCENT = 20.0
"""Of the parts of a flight: even the quiet ones of a slow swing move."""

_STEADY = 0.2
"""Middle half of the frequencies of a slow swing over their median, above which it is none."""

_FAST_HZ = 25.0
"""From this rate of the log on, windows last a second; below, 6.4 s."""

_WINDOWS = {True: (1.0, 2.0), False: (6.4, 0.8)}
"""Length, and the frequency above which the command counts, for fast and slow logs."""

_LINE_WINDOW_S, _SLOW_WINDOW_S = 2.0, 8.0
_SLOW_BAND_HZ = (0.3, 6.0)
_FEWEST_WINDOWS = 5
_FEWEST_SAMPLES = 6
_LEAST_COVER = 0.7
"""Share of the samples that a window should have, without which it is left out."""

_SURE_HZ = 100.0
"""Means over less than 10 ms leave three quarters and more of a line of 40 Hz."""

_OF_RATE = 2.5
"""Rate of a log over the frequency that it can show."""

_HIGHEST_HZ = 60.0
"""Hardly a loop of a multirotor swings faster: slower logs may show a folded line."""

_UNLIKE, _APART = 0.2, 0.05
"""Logarithm of the logged rate over angle to that of an image, above which it is not that one, and by how much the next
image has to be worse. Simulated flights have their own within 0.02."""

_LEAST_OF_STRONGEST = 0.5
"""Of the strongest axis, below which another one is only shaken by it."""

_LEAST_DURATION_S = 10.0
"""A part of a flight that swings counts from this length on, where the rest is calm."""

_MOST_WINDOWS = 40
"""In which lines are looked for, spread over the flight."""

_PERIODS = 8.0
"""Of an oscillation that a window has from which its frequency is read."""

_ALIKE = 1.1
"""Factor between the powers of images that are taken as equal."""

_EVEN_HZ = 200.0
"""Lines of faster logs are looked for on even stamps: their images lie beyond all loops."""

_CLEARER = 1.3
"""Power of a line on the stamps as they are, over that of its images, from which uneven stamps decide between them."""


@dataclass(frozen=True, kw_only=True)
class Oscillation(Immutable):
    """An axis that swings by itself.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    loop
        ``rate`` for a limit cycle, ``attitude`` for a slow swing.
    frequency_hz
        ``None`` where the log is too slow for it.
    rms
        Of the command about its mean, as a share of its range, in the usual window.
    at_limit_percent
        How much of the flight, or of its part that swings, a motor was at a limit; ``None`` where that is not known.
    limited
        Whether a motor was there in so many powered samples that the log shows limits on all axes.
    error_rms_rad
        Of the attitude against its set-point; ``None`` for a limit cycle.
    """

    axis: Axis
    loop: Loop
    frequency_hz: float | None
    rms: float
    at_limit_percent: float | None
    limited: bool = False
    error_rms_rad: float | None = None


@dataclass(frozen=True, kw_only=True)
class OscillationCheck(Immutable):
    """What a flight shows of its axes: each of them swings, does not, or could not be checked.

    Parameters
    ----------
    calm
        Axes that were checked and do not.
    unchecked
        Axis to the reason, one sentence.
    """

    found: tuple[Oscillation, ...] = ()
    calm: tuple[Axis, ...] = ()
    unchecked: Mapping[Axis, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(unchecked=self.unchecked)


@cached_by_value
def check_oscillations(record: FlightRecord) -> OscillationCheck:
    """Look for axes that swing by themselves.

    Parameters
    ----------
    record
        The log. It needs the commands of the axes; motor outputs, attitude and set-points make the answer sharper.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or nothing shows whether it did.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 40.0, 0.1)
    >>> swing = np.sin(2.0 * np.pi * 22.9 * time_s)
    >>> names = ("roll_command", "thrust_command", "motor_1", "motor_2")
    >>> motors = np.clip(0.5 + np.outer([1.0, -1.0], swing), 0.0, 1.0)
    >>> topic = Topic(name="loops", time_s=time_s, channels=tuple(Channel(name=name, unit="1") for name in names),
    ...               values=np.vstack([0.6 * swing, np.full(time_s.size, 0.5), motors]))
    >>> source = Source(name="log.bin", format="ArduPilot DataFlash", sha256="")
    >>> found = check_oscillations(FlightRecord(source=source, topics=(topic,)))
    >>> [(one.axis, round(one.rms, 2), one.frequency_hz) for one in found.found], found.unchecked["yaw"]
    ([('roll', 0.42, None)], 'The log has no yaw_command.')
    """
    if record.status.foreign:
        why = f"{record.status.named_in} is not a multirotor ({record.status.vehicle})."
        return OscillationCheck(unchecked=dict.fromkeys(RATE_OF, why))
    flights = airborne(record).intervals
    power = _power(record)
    looks = _looks(record, flights, power)
    return OscillationCheck(
        found=tuple(oscillation for oscillation in looks.values() if isinstance(oscillation, Oscillation)),
        calm=tuple(axis for axis, oscillation in looks.items() if oscillation is None),
        unchecked={axis: oscillation for axis, oscillation in looks.items() if isinstance(oscillation, str)},
    )


class _Power(NamedTuple):
    """Mean output of the motors or the thrust command in flight, and where motors are at a limit as far as known."""

    time_s: FloatArray
    mean: FloatArray
    at_limit: BoolArray | None

    def limited(self, start_s: float = -np.inf, stop_s: float = np.inf) -> tuple[float, float]:
        """Share of a part of the flight with a motor at a limit, and the same share of its powered samples.

        Not a number where limits are not known.
        """
        part = slice(*np.searchsorted(self.time_s, [start_s, stop_s]))
        powered = self.mean[part] >= POWERED
        if self.at_limit is None or not powered.any():
            return np.nan, np.nan
        return float(np.mean(self.at_limit[part])), float(np.mean(self.at_limit[part][powered]))

    def runs(self, starts_s: FloatArray, stops_s: FloatArray) -> BoolArray:
        """In which windows the motors carry the vehicle for half of them; believed where nothing is logged."""
        if not self.time_s.size:
            return np.ones(starts_s.size, dtype=np.bool_)
        powered, samples = _counted(self.time_s, self.mean >= POWERED, starts_s, stops_s)
        return (samples > 0) & (2 * powered >= samples)


def _power(record: FlightRecord) -> _Power:
    limits = motor_limits(record)
    flying = limits.counted
    if limits.time_s.size:
        at_limit = None if limits.unknown else limits.limited[flying]
        return _Power(limits.time_s[flying], limits.mean[flying], at_limit)
    if "thrust_command" in record:
        track = record["thrust_command"]
        kept = np.isfinite(track.values) & np.isfinite(track.time_s)
        return _Power(track.time_s[kept], np.abs(track.values[kept]), None)
    return _Power(np.zeros(0), np.zeros(0), None)


class _Samples(NamedTuple):
    """Samples of a channel in the air, stamps rising."""

    time_s: FloatArray
    values: FloatArray
    source: str

    @property
    def rate_hz(self) -> float:
        return float(1.0 / np.median(np.diff(self.time_s))) if self.time_s.size > 1 else 0.0

    def within(self, start_s: float, stop_s: float) -> _Samples:
        first, last = np.searchsorted(self.time_s, [start_s, stop_s])
        return _Samples(self.time_s[first : last + 1], self.values[first : last + 1], self.source)

    def at(self, time_s: FloatArray) -> FloatArray:
        return np.interp(time_s, self.time_s, self.values)


def _samples(record: FlightRecord, name: str, flights: Intervals) -> _Samples | None:
    """A channel from the topic that has most of it in the air; ``None`` where it is not logged there."""
    best: _Samples | None = None
    for topic, row in record.holding(name):
        values = topic.values[row]
        kept = np.isfinite(values) & np.isfinite(topic.time_s)
        kept &= np.any([(topic.time_s >= start) & (topic.time_s <= stop) for start, stop in flights], axis=0)
        time_s, values = topic.time_s[kept], values[kept]
        rising = rises(time_s)
        time_s, values = time_s[rising], values[rising]
        if time_s.size > _FEWEST_SAMPLES and (best is None or time_s.size > best.time_s.size):
            best = _Samples(time_s, values, topic.channels[row].source)
    return best


def _looks(record: FlightRecord, flights: Intervals, power: _Power) -> dict[Axis, Oscillation | str | None]:
    """Of each axis an oscillation, why it could not be checked, or ``None`` where it does not swing."""
    moves = {axis: _move(record, axis, flights, power) for axis in RATE_OF}
    looks: dict[Axis, Oscillation | str | None] = {
        axis: move if isinstance(move, str) else _swing(record, move, flights, power) for axis, move in moves.items()
    }
    known = [move for move in moves.values() if isinstance(move, _Move)]
    if not any(isinstance(look, Oscillation) for look in looks.values()):
        # A line at a whole multiple of the rate of a slow log stands still in it: far from the middle, if not at it.
        slow = (move for move in known if not move.fast and move.axis != "yaw")
        still = max(slow, key=lambda move: move.distance, default=None)
        if still is not None and still.distance > LARGEST_RMS and still.limited > LARGEST_LIMITED:
            looks[still.axis] = Oscillation(
                axis=still.axis,
                loop="rate",
                frequency_hz=None,
                rms=still.distance,
                at_limit_percent=100.0 * still.at_limit,
                limited=True,
            )
    strongest = max((look.rms for look in looks.values() if isinstance(look, Oscillation)), default=0.0)
    for move in known:
        look = looks[move.axis]
        weaker = (
            look.rms < _LEAST_OF_STRONGEST * strongest
            if isinstance(look, Oscillation)
            else move.size > 0.5 * LARGEST_RMS
        )
        if strongest > 0.0 and weaker:
            # Motors at their limits take from every axis.
            looks[move.axis] = f"{capital(move.axis)} moves with the axis that oscillates more."
        elif look is None:
            looks[move.axis] = _why_unchecked(record, move, flights, power)
    return looks


class _Move(NamedTuple):
    """How much the command of an axis moves: in which windows, in which of them it swings, and what limits it."""

    axis: Axis
    command: _Samples
    windows: list[slice]
    size: float
    distance: float
    at_limit: float
    limited: float

    @property
    def fast(self) -> bool:
        return self.command.rate_hz >= _FAST_HZ

    @property
    def span_s(self) -> tuple[float, float]:
        """From the first window to the end of the last one."""
        stamps = self.command.time_s
        return float(stamps[self.windows[0].start]), float(stamps[self.windows[-1].stop - 1])

    def part(self, flights: Intervals) -> Intervals:
        """Flights within the windows."""
        first_s, last_s = self.span_s
        return tuple(
            (max(start, first_s), min(stop, last_s)) for start, stop in flights if start < last_s and stop > first_s
        )

    def line(self) -> _Line | None:
        """The strongest line of the command."""
        return _line(self.command, self.command, self.windows, _band_hz(self.command))


def _move(record: FlightRecord, axis: Axis, flights: Intervals, power: _Power) -> _Move | str:
    """How the command of an axis moves in the air, or why that is not known."""
    name = f"{axis}_command"
    command = _samples(record, name, flights)
    if command is None:
        return f"The log has no {name}{' in the air' if name in record else ''}."
    length_s, above_hz = _WINDOWS[command.rate_hz >= _FAST_HZ]
    powered = _powered(command, length_s, power)
    injected = _injected(record, axis, *_ends(command, powered))
    windows = [window for window, tested in zip(powered, injected, strict=True) if not tested]
    if len(windows) < _FEWEST_WINDOWS:
        return (
            f"The log has less than {0.5 * (_FEWEST_WINDOWS + 1) * length_s:.0f} s of {name} in the air without tests."
        )
    sizes = _sizes(command, windows, above_hz)
    at_limit, limited = power.limited()
    run = _longest_run(command, windows, sizes, power)
    if float(np.median(sizes)) <= LARGEST_RMS and run:
        windows, sizes = [windows[place] for place in run], sizes[run]
        stamps = command.time_s
        at_limit, limited = power.limited(stamps[windows[0].start], stamps[windows[-1].stop - 1])
    middle = float(np.median(command.values))
    return _Move(
        axis,
        command,
        windows,
        float(np.median(sizes)),
        float(np.median([_rms(command.values[window] - middle) for window in windows])),
        at_limit,
        limited,
    )


def _longest_run(command: _Samples, windows: Sequence[slice], sizes: FloatArray, power: _Power) -> list[int]:
    """Places of windows that swing one after the other with a motor at its limit, if they last long enough."""
    best: list[int] = []
    run: list[int] = []
    for place, window in enumerate(windows):
        follows = not run or window.start <= windows[run[-1]].stop
        start_s, stop_s = command.time_s[window.start], command.time_s[window.stop - 1]
        swings = sizes[place] > LARGEST_RMS and power.limited(start_s, stop_s)[1] > LARGEST_LIMITED
        run = ([*run, place] if follows else [place]) if swings else []
        best = max(best, run, key=len)
    if not best:
        return []
    lasts_s = command.time_s[windows[best[-1]].stop - 1] - command.time_s[windows[best[0]].start]
    return best if lasts_s >= _LEAST_DURATION_S and len(best) >= _FEWEST_WINDOWS else []


def _swing(record: FlightRecord, move: _Move, flights: Intervals, power: _Power) -> Oscillation | None:
    """The oscillation of an axis by its command or by its attitude."""
    command, axis = move.command, move.axis
    part = move.part(flights)
    slow = _attitude_swing(record, axis, flights, power)
    found = Oscillation(
        axis=axis,
        loop="rate",
        frequency_hz=slow.frequency_hz if slow is not None and slow.share > _PURE_LINE else None,
        rms=move.size,
        at_limit_percent=None if np.isnan(move.at_limit) else 100.0 * move.at_limit,
        limited=move.limited > LARGEST_LIMITED,
        error_rms_rad=slow.rms if slow is not None else None,
    )
    if move.size > LARGEST_RMS:
        line = move.line() if move.fast else None
        limited = move.limited > LARGEST_LIMITED
        if line is not None and (
            (limited and line.share > _LIMITED_LINE)
            or (line.share > _FREE_LINE and _driven(record, axis, line, part, power) is False)
        ):
            swings = command.within(*move.span_s)
            return replace(found, frequency_hz=_frequency_hz(record, swings, line.frequency_hz, axis, part))
        if not move.fast and (limited or move.size > HUGE_RMS):
            return found
    if slow is None:
        return None
    return replace(found, loop="attitude", rms=move.distance, frequency_hz=slow.frequency_hz)


def _why_unchecked(record: FlightRecord, move: _Move, flights: Intervals, power: _Power) -> str | None:
    """Why a log in which an axis does not swing does not show that it is calm; ``None`` where it does."""
    name, rate_hz = f"{move.axis}_command", move.command.rate_hz
    log = autopilot_of(record).log
    if rate_hz < _SURE_HZ and not (log.own or log.telemetry):
        return (
            f"{name} has {rate_hz:.0f} samples a second in a file that no autopilot wrote; if they are means, they "
            "hide an oscillation."
        )
    if move.fast and move.size > LARGEST_RMS and move.limited > LARGEST_LIMITED:
        return f"{name} uses its whole range in no single line: noise reaches the motors. Lower D, or filter more."
    if move.fast and move.size > LARGEST_RMS and (line := move.line()) is not None:
        driven = _driven(record, move.axis, line, move.part(flights), power)
        # Without motors nobody knows of limits, which make a weaker line one.
        weaker = np.isnan(move.limited) and line.share > _LIMITED_LINE and not driven
        if weaker or (line.share > _FREE_LINE and driven is None):
            missing = "motor outputs" if driven is False else "rate and its set-point"
            return f"{name} swings in one line, and without the {missing} the log does not show what makes it."
    if not move.fast and move.size > LARGEST_RMS:
        return (
            f"{name} moves much (rms {move.size:.2f} of its range), and a log of {rate_hz:.0f} Hz does not show "
            "whether the stick or the loop does it."
        )
    if not move.fast and np.isnan(move.limited):
        # A cycle at a whole multiple of the rate stands still in the command, and shows in the motors alone.
        return (
            f"A log of {rate_hz:.0f} Hz without motor outputs, or with motor limits that are not known, does not show "
            f"whether {move.axis} oscillates."
        )
    if not move.fast and move.limited > LARGEST_LIMITED:
        return (
            f"A motor is at a limit for {100.0 * move.at_limit:.0f} % of the flight, and a log of {rate_hz:.0f} Hz "
            f"does not show whether {move.axis} oscillates."
        )
    return None


def _windows(samples: _Samples, length_s: float) -> Iterator[slice]:
    """Half overlapping windows that have most of their samples."""
    time_s = samples.time_s
    # Only where samples are: between flights a log may be silent for years.
    places = np.unique(np.floor((time_s - time_s[0]) / (0.5 * length_s)))
    starts = time_s[0] + 0.5 * length_s * places
    starts = starts[starts < time_s[-1] - length_s]
    firsts, lasts = np.searchsorted(time_s, starts), np.searchsorted(time_s, starts + length_s)
    fewest = max(_FEWEST_SAMPLES, _LEAST_COVER * length_s * samples.rate_hz)
    for first, last in zip(firsts, lasts, strict=True):
        if last - first >= fewest:
            yield slice(int(first), int(last))


def _ends(samples: _Samples, windows: Sequence[slice]) -> tuple[FloatArray, FloatArray]:
    """Stamps of the first and the last sample of each window."""
    firsts = np.array([window.start for window in windows], dtype=np.intp)
    lasts = np.array([window.stop for window in windows], dtype=np.intp) - 1
    return samples.time_s[firsts], samples.time_s[lasts]


def _counted(
    time_s: FloatArray, true: BoolArray, starts_s: FloatArray, stops_s: FloatArray
) -> tuple[IntArray, IntArray]:
    """How many samples of each window are true, and how many it has."""
    firsts, lasts = np.searchsorted(time_s, starts_s), np.searchsorted(time_s, stops_s)
    running = np.concatenate([[0], np.cumsum(true)])
    return running[lasts] - running[firsts], lasts - firsts


def _injected(record: FlightRecord, axis: Axis, starts_s: FloatArray, stops_s: FloatArray) -> BoolArray:
    """In which windows a test input moves the axis: its command is then that of the test."""
    injected = np.zeros(starts_s.size, dtype=np.bool_)
    for name in (f"{axis}_excitation", f"{axis}_setpoint_excitation"):
        for topic, row in record.holding(name):
            injected |= _counted(topic.time_s, np.abs(topic.values[row]) > 0.0, starts_s, stops_s)[0] > 0
    return injected


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


_AT_ONCE = 256
"""Windows whose spread is taken together: more of them would fill the memory."""


def _sizes(samples: _Samples, windows: Sequence[slice], above_hz: float) -> FloatArray:
    """Spread of each window above a frequency; all of its spread where even that is small, which costs a tenth."""
    sizes = _spreads(samples, windows)
    for place in np.flatnonzero(sizes > LARGEST_RMS).tolist():
        sizes[place] = _rms(_above(samples, windows[place], above_hz))
    return sizes


def _spreads(samples: _Samples, windows: Sequence[slice]) -> FloatArray:
    """Standard deviation of the samples of each window."""
    firsts = np.array([window.start for window in windows], dtype=np.intp)
    lengths = np.array([window.stop for window in windows], dtype=np.intp) - firsts
    spreads = np.zeros(firsts.size)
    for length in np.unique(lengths).tolist():
        alike = np.flatnonzero(lengths == length)
        every = np.lib.stride_tricks.sliding_window_view(samples.values, length)
        for part in np.split(alike, range(_AT_ONCE, alike.size, _AT_ONCE)):
            spreads[part] = np.std(every[firsts[part]], axis=1)
    return spreads


def _above(samples: _Samples, window: slice, above_hz: float) -> FloatArray:
    """Values of a window less its trend and the waves up to a frequency, on the stamps as they are."""
    time_s, values = samples.time_s[window], samples.values[window]
    length_s = float(time_s[-1] - time_s[0])
    phase = 2.0 * np.pi * (time_s - time_s[0]) / length_s
    count = min(int(above_hz * length_s + 0.5), values.size // 4)
    waves = [wave(number * phase) for number in range(1, count + 1) for wave in (np.cos, np.sin)]
    basis = np.stack([np.ones(time_s.size), phase, *waves], axis=1)
    weights, *_ = np.linalg.lstsq(basis, values, rcond=None)
    return np.asarray(values - basis @ weights)


def _band_hz(command: _Samples) -> tuple[float, float]:
    """Where lines of a command are looked for."""
    return _WINDOWS[True][1], max(_HIGHEST_HZ, 0.25 * command.rate_hz)


class _Line(NamedTuple):
    """The strongest line of a signal, medians over windows.

    ``share`` is its part of all power above the band's lower end, ``spread`` the middle half of its frequency over the
    median, ``driven`` the power of the set-point at it over its own.
    """

    frequency_hz: float
    share: float
    spread: float
    driven: float


def _line(
    samples: _Samples, setpoint: _Samples, windows: Sequence[slice], band_hz: tuple[float, float]
) -> _Line | None:
    """The strongest line of a signal in windows; ``None`` where there are too few of them.

    Lines are looked for on the stamps as they are, since uneven ones show a line at its own frequency alone: up to
    twice the rate of slow logs, where even ones show it at images too.
    """
    chosen = windows[:: max(len(windows) // _MOST_WINDOWS, 1)]
    found = [line for window in chosen if (line := _line_in(samples, setpoint, window, band_hz)) is not None]
    if len(found) < _FEWEST_WINDOWS - 1:
        return None
    frequency, share, driven = (float(value) for value in np.median(found, axis=0))
    low, high = np.percentile([line[0] for line in found], [25.0, 75.0])
    return _Line(frequency, share, float(high - low) / frequency, driven)


def _line_in(
    samples: _Samples, setpoint: _Samples, window: slice, band_hz: tuple[float, float]
) -> tuple[float, float, float] | None:
    """Frequency of the strongest line in a window, its share of the power, and the set-point's power over its own."""
    time_s, values = samples.time_s[window], _above(samples, window, band_hz[0])
    hz, power = _spectrum(time_s, values, samples.rate_hz, band_hz)
    if not hz.size or not power.any():
        return None
    frequency_hz = _peak(hz, power)
    lowest_hz = _lowest_image_hz(frequency_hz, samples.rate_hz)
    # Even stamps show images alike, of which the lowest stands for all.
    if lowest_hz >= band_hz[0] and _ALIKE * np.interp(lowest_hz, hz, power) > power.max():
        frequency_hz = lowest_hz
    asked = _above(_Samples(time_s, setpoint.at(time_s), ""), slice(None), band_hz[0])
    own, other = (_of_line(time_s, part, frequency_hz) for part in (values, asked))
    return (frequency_hz, own / float(np.mean(values**2)), other / own) if own > 0.0 else None


def _spectrum(
    time_s: FloatArray, values: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Frequencies of a band, four times as fine as the window gives, and the power at them."""
    length_s = float(time_s[-1] - time_s[0])
    if rate_hz >= _EVEN_HZ:
        step_s = length_s / (values.size - 1)
        clock_s = time_s[0] + step_s * np.arange(values.size)
        fine = 4 * values.size
        hz = np.asarray(np.fft.rfftfreq(fine, step_s), dtype=np.float64)
        spectrum = np.fft.rfft(np.hanning(values.size) * np.interp(clock_s, time_s, values), fine)
        inside = (hz >= band_hz[0]) & (hz <= band_hz[1])
        return hz[inside], np.asarray(np.abs(spectrum[inside]) ** 2)
    hz = np.arange(band_hz[0], band_hz[1], 0.25 / length_s, dtype=np.float64)
    return hz, np.asarray(np.abs(_transform(time_s, values, hz)) ** 2)


def _transform(time_s: FloatArray, values: FloatArray, hz: FloatArray) -> ComplexArray:
    """Amplitudes of waves on stamps as they are, under a Hann taper, shape of ``hz``."""
    share = (time_s - time_s[0]) / (time_s[-1] - time_s[0])
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * share)
    waves = np.exp(-2j * np.pi * np.outer(hz, time_s - time_s[0]))
    return np.asarray(waves @ (taper * values) / taper.sum())


def _peak(hz: FloatArray, power: FloatArray) -> float:
    """Where a spectrum is highest, by a parabola through the three highest points of its logarithm."""
    top = int(np.argmax(power))
    if 0 < top < hz.size - 1 and power[top - 1 : top + 2].min() > 0.0:
        left, middle, right = np.log(power[top - 1 : top + 2])
        bend = left - 2.0 * middle + right
        if bend < 0.0:
            return float(hz[top] + 0.5 * (left - right) / bend * (hz[1] - hz[0]))
    return float(hz[top])


def _of_line(time_s: FloatArray, values: FloatArray, frequency_hz: float) -> float:
    """Mean square of what a wave explains whose size and phase drift evenly within the window."""
    phase = 2.0 * np.pi * frequency_hz * (time_s - time_s[0])
    drift = np.linspace(-1.0, 1.0, time_s.size)
    waves = np.stack([np.cos(phase), np.sin(phase), drift * np.cos(phase), drift * np.sin(phase)], axis=1)
    weights, *_ = np.linalg.lstsq(waves, values, rcond=None)
    return float(np.mean((waves @ weights) ** 2))


def _driven(record: FlightRecord, axis: Axis, line: _Line, flights: Intervals, power: _Power) -> bool | None:
    """Whether the set-point of the rate makes the line of the command; ``None`` where that is not known."""
    rate, setpoint = (_samples(record, name, flights) for name in (RATE_OF[axis], f"{RATE_OF[axis]}_setpoint"))
    if rate is None or setpoint is None:
        return None
    windows = _powered(rate, _LINE_WINDOW_S, power)
    own = _line(rate, setpoint, windows, (0.5 * line.frequency_hz, 2.0 * line.frequency_hz))
    return None if own is None else own.driven > _DRIVEN


def _powered(samples: _Samples, length_s: float, power: _Power) -> list[slice]:
    """Windows in which the motors carry the vehicle."""
    windows = list(_windows(samples, length_s))
    runs = power.runs(*_ends(samples, windows))
    return [window for window, carried in zip(windows, runs, strict=True) if carried]


class _Slow(NamedTuple):
    """A slow swing of the attitude about its set-point."""

    frequency_hz: float | None
    rms: float
    share: float


def _attitude_swing(record: FlightRecord, axis: Axis, flights: Intervals, power: _Power) -> _Slow | None:
    """A slow swing of roll or pitch; ``None`` where there is none, or the log does not have both angles."""
    angle, setpoint = (_samples(record, f"{ANGLE_OF[axis]}{end}", flights) for end in ("", "_setpoint"))
    if axis == "yaw" or angle is None or setpoint is None:
        return None
    error = _Samples(angle.time_s, angle.values - setpoint.at(angle.time_s), angle.source)
    # What rings after a kick comes to rest in between.
    parts = _spreads(error, _powered(error, _LINE_WINDOW_S, power))
    if parts.size < _FEWEST_WINDOWS or float(np.percentile(parts, _QUIETEST_PERCENT)) < LARGEST_ERROR_RAD:
        return None
    windows = _powered(error, _SLOW_WINDOW_S, power)
    line = _line(error, setpoint, windows, (_SLOW_BAND_HZ[0], min(_SLOW_BAND_HZ[1], 0.45 * angle.rate_hz)))
    if line is None or line.share < _SLOW_LINE or line.driven > _DRIVEN or line.spread > _STEADY:
        return None
    frequency_hz = _frequency_hz(record, angle, line.frequency_hz, axis, flights)
    return _Slow(frequency_hz, float(np.median(parts)), line.share)


def _frequency_hz(
    record: FlightRecord, samples: _Samples, frequency_hz: float, axis: Axis, flights: Intervals
) -> float | None:
    r"""The frequency of a line, of all those that a log of this rate shows alike; ``None`` where it cannot be known.

    Uneven stamps show the right one strongest. Even ones do not, but an attitude swings by its rate over its frequency,
    whatever is folded: :math:`|p| = 2 \pi f |\phi|`, but for the filter of the rate.
    """
    rate_hz = samples.rate_hz
    images = _images_hz(frequency_hz, rate_hz)
    if len(images) == 1:
        return _refined(samples, frequency_hz)
    strengths = np.array([_strength(samples, image, 0.5 * images[0]) for image in images])
    likely = [
        image for image, strength in zip(images, strengths, strict=True) if strength * _CLEARER >= strengths.max()
    ]
    found = likely[0] if len(likely) == 1 else _by_kinematics(record, axis, likely, flights)
    return _refined(samples, found) if found is not None and rate_hz > _OF_RATE * found else None


def _refined(samples: _Samples, frequency_hz: float) -> float:
    """The frequency of a line from longer windows, median over them."""
    band = (0.8 * frequency_hz, 1.25 * frequency_hz)
    length_s = max(_LINE_WINDOW_S, _PERIODS / frequency_hz)
    windows = list(_windows(samples, length_s))
    found = []
    for window in windows[:: max(len(windows) // _MOST_WINDOWS, 1)]:
        hz, power = _spectrum(samples.time_s[window], _above(samples, window, 0.0), samples.rate_hz, band)
        found.append(_peak(hz, power))
    return float(np.median(found)) if found else frequency_hz


def _lowest_image_hz(frequency_hz: float, rate_hz: float) -> float:
    """Where samples at a rate show a frequency between zero and half of the rate."""
    return abs(frequency_hz - rate_hz * round(frequency_hz / rate_hz))


def _images_hz(frequency_hz: float, rate_hz: float) -> list[float]:
    """All frequencies that loops may have and even samples at a rate show as this one, the lowest first."""
    lowest = _lowest_image_hz(frequency_hz, rate_hz)
    images = [lowest]
    for fold in range(1, int(_HIGHEST_HZ / rate_hz) + 2):
        images += [fold * rate_hz - lowest, fold * rate_hz + lowest]
    return [image for image in images if image <= max(_HIGHEST_HZ, lowest)]


def _strength(samples: _Samples, frequency_hz: float, slow_hz: float) -> float:
    """Mean square of a wave on the stamps as they are, its most within 0.3 Hz around, less what is slower."""
    near = np.linspace(frequency_hz - 0.3, frequency_hz + 0.3, 13)
    windows = list(_windows(samples, _LINE_WINDOW_S if samples.rate_hz >= _FAST_HZ else _SLOW_WINDOW_S))
    powers = [
        np.max(np.abs(_transform(samples.time_s[window], _above(samples, window, slow_hz), near)) ** 2)
        for window in windows[:: max(len(windows) // _MOST_WINDOWS, 1)]
    ]
    return float(np.mean(powers)) if powers else 0.0


def _by_kinematics(record: FlightRecord, axis: Axis, images_hz: Sequence[float], flights: Intervals) -> float | None:
    """The image whose rate over angle is that of the log; ``None`` where they are not logged, or fit none of them."""
    rate, angle = (_samples(record, name, flights) for name in (RATE_OF[axis], ANGLE_OF[axis]))
    if rate is None or angle is None or axis == "yaw":
        return None
    filters = known_filters(record, rate.source)
    misses = []
    for image in images_hz:
        turned, tilted = (_strength(samples, image, 0.5 * min(images_hz)) for samples in (rate, angle))
        omega = np.array([2.0 * np.pi * image])
        passed = float(np.abs(combined_response(filters, omega))[0]) if filters else 1.0
        expected = omega[0] * max(passed, 1e-3)
        misses.append(abs(np.log(np.sqrt(turned / tilted) / expected)) if tilted > 0.0 < turned else np.inf)
    best, second, *_ = sorted(misses)
    return images_hz[misses.index(best)] if best < _UNLIKE and second > best + _APART else None
