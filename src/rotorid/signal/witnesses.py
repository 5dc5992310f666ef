"""What each part of a log says of whether its vehicle was in the air: yes, no, or nothing, at each time.

A witness says nothing where it was not logged, where it is constant without meaning, or where its sensor is dead.
:mod:`rotorid.signal.airborne` weighs what the witnesses say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.record import MOTORS, FlightRecord, Intervals, Topic
from rotorid.signal.clock import even_step_s
from rotorid.signal.dead_sensors import dead_accelerometer, dead_gyro
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FLYING_SHARE = 0.5
"""A vehicle flies while its thrust exceeds this share of its usual thrust."""

Answer: TypeAlias = Literal["yes", "no", "nothing"]
Name: TypeAlias = Literal[
    "arming", "landed flag", "mode", "throttle", "motor outputs", "motor speeds", "current", "height", "motion"
]

MOTION = "the activity of"
"""How the source of a witness of motion begins."""

_MOSTLY = 0.95
"""Share of a stretch of which a witness speaks alike, to speak for the stretch."""

_AIRBORNE_MODES = ("system identification", "flip")
"""Modes that the firmware enters in the air alone."""

_LONGEST_DIP_S = 1.0
_LONGEST_REST_S = 5.0
"""While the motors run on, a descent may be as long, and as quiet; and so may a dive without motors."""

_WINDOW_S = 0.5
"""Window over which the motion of sensors is taken."""

_LIVELIER = 15.0
"""Sweeps in light gusts spread up to eleven times as much as the calm between them; rest on the ground, far less."""

_QUIET_PERCENT, _FLYING_PERCENT = 2.0, 75.0
"""Percentiles that stand for rest and for usual flight."""

_FORCES = ("ax", "ay", "az")

_HIGH_PERCENT = 99.0
"""Percentile that stands for the highest thrust, without single peaks."""

MOVING_RAD_S = 0.1
"""Body rates, rms of half a second and without vibration, that a vehicle on the ground does not have."""

MOVING_M_S2 = 0.5
"""The same for the size of the specific force against that of gravity, biases of sensors included."""

_VIBRATION_S = 0.1
"""Mean that takes vibration out of rates and forces."""

_RUNNING_SHARE = 0.1
"""Motors run while they exceed this share of their usual output."""

_MOST_BELOW_ZERO = 0.05
"""Share of the usual thrust by which a thrust may lie below zero; one that lies lower counts from hover."""

_LEAST_BELOW_ZERO = 1e-3
"""A thrust that never rises, and goes below zero by more, counts from hover."""

_ACTIVE_S, _ACTIVE_SHARE = 1.0, 2e-3
"""A controller in flight moves its output, within such a time, by more than this share of the highest."""

_MOSTLY_ACTIVE = 0.5

_MOST_OF_HIGH = 0.35
"""Share of the usual level of its upper half below which nothing is the usual level: of what flies, some sprint."""

_CARRIED = 0.9
"""Share of the thrust of a take-off, or of a landing, at which the vehicle leaves the ground or has reached it."""

_LONGEST_RAMP_S = 3.0
"""Within this time the throttle passes from half of its usual level to what carries the vehicle, and back."""

_LEAST_ALIKE = 1e-6
"""A signal that spreads by less over a whole log is constant."""

_SHORTEST_STILL_S = 2.0
_STILL_M, _STILL_M_S = 0.1, 0.25
"""Spread of the height and vertical speed, over two seconds, of a vehicle that stands or hovers well."""
_LEAST_CLIMB_M, _LIFTED_M = 2.0, 0.5
"""A log shows the ground by its height when the vehicle climbed so far, and the air when it is so high above it."""
_CERTAIN_CLIMB_M = 1.0
"""Change of height across a take-off that no drift of a barometer makes within seconds."""
_LONGEST_TAKING_BACK_S, _FEWEST_HEIGHTS = 1.5, 6
"""For so long the thrust of a vehicle on the ground still carries it; and samples of the height that show it."""
_RESOLVED_M = 0.02
"""Least height above the ground that a log resolves."""
_SLOWEST_HEIGHT_HZ = 0.5


@dataclass(frozen=True, kw_only=True, slots=True)
class _Level:
    """How a signal that rises with thrust shows flight.

    ``least``: nothing flies on less; ``flying``, ``carrying``: shares of its usual level of a vehicle that flies, and
    that motors which idle on the ground do not reach. ``idle``: what it means that it never rose.
    """

    name: Name
    least: float
    flying: float
    carrying: float
    idle: str


_THROTTLE = _Level(name="throttle", least=0.1, flying=FLYING_SHARE, carrying=0.25, idle="the throttle never rose")
_OUTPUTS = _Level(name="motor outputs", least=0.17, flying=FLYING_SHARE, carrying=0.25, idle="the motors never ran")
# Thrust goes with the square of the speed.
_SPEEDS = _Level(name="motor speeds", least=20.0, flying=0.7, carrying=0.5, idle="the motors never turned")
_CURRENT = _Level(name="current", least=0.5, flying=0.5, carrying=0.25, idle="the battery gave no current")

LEVELS: tuple[Name, ...] = ("throttle", "motor outputs", "motor speeds", "current")
"""Witnesses of thrust."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Witness:
    """What one part of a log says.

    Parameters
    ----------
    name
        Which part.
    source
        Where it is in the log, as a sentence names it: ``vehicle_land_detected``, ``thrust_command``.
    yes, no
        When it shows the vehicle in the air, and when on the ground; at other times it says nothing.
    reason
        What its "no" means, as the end of a sentence.

    Examples
    --------
    >>> throttle = Witness(name="throttle", source="thrust_command", yes=((10.0, 50.0),), no=((0.0, 10.0),))
    >>> throttle.answer(20.0, 30.0), throttle.answer(0.0, 5.0), throttle.answer(60.0, 70.0)
    ('yes', 'no', 'nothing')
    """

    name: Name
    source: str = ""
    yes: Intervals = ()
    no: Intervals = ()
    reason: str = ""

    @property
    def speaks(self) -> bool:
        """Whether it says anything at any time."""
        return bool(self.yes or self.no)

    def answer(self, start_s: float, stop_s: float, *, share: float = 0.5) -> Answer:
        """What it says of a stretch: what it says of more than a share of it."""
        length = max(stop_s - start_s, 1e-9)
        if seconds_within(self.yes, start_s, stop_s) > share * length:
            return "yes"
        return "no" if seconds_within(self.no, start_s, stop_s) > share * length else "nothing"

    def denies(self, start_s: float, stop_s: float) -> bool:
        """Whether it says "no" all along a stretch."""
        return self.answer(start_s, stop_s, share=_MOSTLY) == "no"


def witnesses_of(record: FlightRecord) -> tuple[Witness, ...]:
    """All that a log says of whether its vehicle flew, the surest first; each part is listed, whether it speaks or not.

    Arming only says no. The landed flag says both, where it was logged. Thrust (throttle, outputs and speeds of the
    motors, current) says no where it never reaches what carries a vehicle, or falls below a quarter of its usual level
    for long. Height says yes above the ground that the log shows. Motion of gyro and accelerometer says yes where it
    is far livelier than at rest, or never rests.
    """
    span = (record.start_s, record.stop_s)
    levels = tuple(_level(record, kind) for kind in (_THROTTLE, _OUTPUTS, _SPEEDS, _CURRENT))
    return (
        _arming(record, span),
        _landed(record, span),
        _mode(record),
        *_without_dead_throttle(record, levels),
        _height(record),
        _motion(record),
    )


def seconds_within(intervals: Intervals, start_s: float, stop_s: float) -> float:
    """How long some intervals last within a stretch."""
    return sum(max(min(stop, stop_s) - max(start, start_s), 0.0) for start, stop in intervals)


def without(intervals: Intervals, taken: Intervals) -> Intervals:
    """Intervals less what others take of them.

    Examples
    --------
    >>> without(((0.0, 10.0),), ((2.0, 3.0), (9.0, 20.0)))
    ((0.0, 2.0), (3.0, 9.0))
    """
    for low, high in taken:
        parts = [part for a, b in intervals for part in ((a, min(b, low)), (max(a, high), b))]
        intervals = tuple((a, b) for a, b in parts if a < b)
    return intervals


def _arming(record: FlightRecord, span: tuple[float, float]) -> Witness:
    status = record.status
    if status.armed is None:
        return Witness(name="arming")
    never = "the vehicle was never armed" if not status.armed else "it was armed at other times"
    return Witness(
        name="arming",
        source=status.flagged_in or "arming",
        no=without((span,), (*status.armed, *status.unlogged)),
        reason=never,
    )


def _landed(record: FlightRecord, span: tuple[float, float]) -> Witness:
    status = record.status
    if status.in_air is None:
        return Witness(name="landed flag")
    return Witness(
        name="landed flag",
        source=status.flagged_in or "the log",
        yes=status.in_air,
        no=without((span,), (*status.in_air, *status.unlogged)),
        reason="the vehicle was never armed" if status.armed == () else "the autopilot never left the landed state",
    )


def _mode(record: FlightRecord) -> Witness:
    flown = tuple((start, stop) for mode, start, stop in record.status.modes if mode in _AIRBORNE_MODES)
    return Witness(name="mode", source="the flight mode", yes=flown)


def _level(record: FlightRecord, kind: _Level) -> Witness:
    """A signal that rises with thrust as a witness."""
    nothing = Witness(name=kind.name)
    sampled = _samples(record, kind)
    if sampled is None:
        return nothing
    time_s, rows, source = sampled
    level = rows[0] if len(rows) == 1 else rows.mean(axis=0)
    high = float(np.percentile(level, _HIGH_PERCENT))
    active = _active(time_s, rows, high)
    # Outputs, speeds and current vary at idle too, and less between hover and full throttle.
    usual = _usual(level, active & (level > kind.least) & (kind.name == "throttle"))
    logged = _covered(record, time_s)
    # Idle is constant. A controller that flies on so little moves its outputs.
    if high < kind.least and (high < 0.5 * kind.least or float(np.mean(active)) < _MOSTLY_ACTIVE):
        never = kind.name in ("throttle", "motor outputs") and _counts_from_zero(record, level, source)
        return Witness(name=kind.name, source=source, no=(logged,), reason=kind.idle) if never else nothing
    if not any(float(np.ptp(row)) > _LEAST_ALIKE * high for row in rows):
        # A throttle that is held carries a vehicle that moves; without motion it may be any channel.
        held = kind.name == "throttle" and high >= kind.least and bool(_motion(record).yes)
        return Witness(name=kind.name, source=source, yes=(logged,)) if held else nothing
    if usual <= 0.0:
        return nothing
    low = float(np.percentile(level, _QUIET_PERCENT))
    if low < -_MOST_BELOW_ZERO * usual or (kind.name in ("motor speeds", "current") and low > kind.carrying * usual):
        # It counts from hover, or shows one level throughout that may be any.
        return nothing
    flying = level > kind.flying * usual
    if kind.name != "current":
        flying |= _diving(record, time_s, level > _RUNNING_SHARE * usual)
    yes = _stretches(time_s, level, flying, level > kind.carrying * usual, usual)
    return Witness(
        name=kind.name,
        source=source,
        yes=yes,
        no=without((logged,), yes),
        reason="it did not carry the vehicle",
    )


def _samples(record: FlightRecord, kind: _Level) -> tuple[FloatArray, FloatArray, str] | None:
    numbered = range(1, MOTORS + 1)
    if kind.name == "throttle":
        return _together(record, ("thrust_command",)) or _stick(record)
    if kind.name == "motor outputs":
        found = _together(record, record.outputs)
        return None if found is None else (found[0], found[1], "the mean of the motors")
    if kind.name == "current":
        return _together(record, ("battery_current",))
    found = _together(record, tuple(f"motor_speed_{number}" for number in numbered))
    return None if found is None else (found[0], np.abs(found[1]), "the mean speed of the motors")


def _counts_from_zero(record: FlightRecord, level: FloatArray, source: str) -> bool:
    """Whether a signal that never rises means that nothing ran.

    A stick may rest while the autopilot flies, and a command that counts from hover goes below zero. Of a table without
    a firmware, a command of zero throughout may be one that counts from hover, and was not moved.
    """
    if source == "thrust_stick" or float(np.percentile(level, 0.1)) < -_LEAST_BELOW_ZERO:
        return False
    return bool(record.source.firmware or record.parameters or source != "thrust_command" or np.ptp(level) > 0.0)


def _stick(record: FlightRecord) -> tuple[FloatArray, FloatArray, str] | None:
    """The throttle stick, where neither a throttle nor motors are logged and it goes down to its lowest."""
    names = record.channel_names
    if "motor_1" in names or "thrust_stick" not in names:
        return None
    found = _together(record, ("thrust_stick",))
    return found if found is not None and 0.0 <= float(np.percentile(found[1], _QUIET_PERCENT)) < 0.05 else None


def _without_dead_throttle(record: FlightRecord, levels: Sequence[Witness]) -> tuple[Witness, ...]:
    """The witnesses of thrust, of which a throttle that is zero throughout says nothing where the motors run.

    In airmode the motors of a vehicle that is moved by hand run at a throttle of zero: where the stick is zero too,
    it is no dead channel.
    """
    throttle, outputs, *others = levels
    found = _together(record, ("thrust_command",))
    dead = found is not None and not throttle.yes and float(np.ptp(found[1])) == 0.0
    if not dead or not (outputs.yes or any(other.yes for other in others)):
        return tuple(levels)
    stick = _together(record, ("thrust_stick",))
    stick_at_rest = stick is not None and float(np.percentile(stick[1], _HIGH_PERCENT)) < _THROTTLE.least
    return tuple(levels) if stick_at_rest else (Witness(name="throttle"), outputs, *others)


def _covered(record: FlightRecord, time_s: FloatArray) -> tuple[float, float]:
    """What of a record a signal covers, to the ends of the record where it begins and ends with it."""
    start, stop = float(time_s[0]), float(time_s[-1])
    step_s = max(2.0 * even_step_s(time_s), _LONGEST_DIP_S)
    start = record.start_s if start - record.start_s <= step_s else start
    return start, record.stop_s if record.stop_s - stop <= step_s else stop


def _active(time_s: FloatArray, rows: FloatArray, high: float) -> BoolArray:
    """Where a controller moves one of its outputs."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    size = min(max(int(_ACTIVE_S / even_step_s(time_s)), 3), time_s.size)
    found = np.zeros(time_s.size, dtype=np.bool_)
    for row in rows:
        spread = maximum_filter1d(row, size, mode="nearest") - minimum_filter1d(row, size, mode="nearest")
        found |= spread > _ACTIVE_SHARE * high
    return found


def _usual(thrust: FloatArray, flown: BoolArray) -> float:
    """Thrust in flight.

    The median of all above half of its highest values, so that waiting does not count. Where a climb or sprints are
    above it, the median of what is ``flown``, which a controller moves: thrust at idle is constant.
    """
    high = float(np.percentile(thrust, _HIGH_PERCENT))
    running = thrust[thrust > 0.5 * high]
    if high <= 0.0 or not running.size:
        return 0.0
    upper = float(np.median(running))
    active = thrust[flown]
    if active.size < 0.5 * running.size:
        return upper
    return min(upper, max(float(np.median(active)), _MOST_OF_HIGH * upper))


def _diving(record: FlightRecord, time_s: FloatArray, running: BoolArray) -> BoolArray:
    """Where the vehicle turns while its motors run, whatever their thrust: in acro it flies without."""
    rates = _together(record, RATES)
    if rates is None or not running.any():
        return np.zeros(time_s.size, dtype=np.bool_)
    rate_time_s, values, _ = rates
    moving = np.interp(time_s, rate_time_s, speed(rate_time_s, values), left=0.0, right=0.0) > MOVING_RAD_S
    before = np.maximum.accumulate(np.where(running, time_s, -np.inf))
    after = np.minimum.accumulate(np.where(running, time_s, np.inf)[::-1])[::-1]
    return np.asarray(moving & (after - before <= _LONGEST_REST_S))


def _stretches(
    time_s: FloatArray, level: FloatArray, flying: BoolArray, carrying: BoolArray, usual: float
) -> Intervals:
    """Flights from take-off to landing: dips bridged, and ramps of the throttle on the ground left out."""
    return tuple(
        (
            float(time_s[_taken_off(time_s, level, start, stop, usual)]) if start > 0 else float(time_s[0]),
            float(time_s[_touched_down(time_s, level, start, stop, usual)])
            if stop < time_s.size - 1
            else float(time_s[-1]),
        )
        for start, stop in _runs(time_s, flying, carrying)
    )


def _runs(time_s: FloatArray, flying: BoolArray, carrying: BoolArray | None) -> list[tuple[int, int]]:
    """First and last sample of each stretch, with dips bridged."""
    index = np.flatnonzero(flying)
    if index.size == 0:
        return []
    longest_s = np.full(index.size - 1, _LONGEST_DIP_S)
    if carrying is not None:
        dropped = np.diff(np.cumsum(~(carrying | flying))[index])
        longest_s[dropped == 0] = _LONGEST_REST_S
    breaks = np.flatnonzero((np.diff(time_s[index]) > longest_s) & (np.diff(index) > 1))
    starts = index[np.concatenate([[0], breaks + 1])]
    stops = index[np.concatenate([breaks, [index.size - 1]])]
    return [(int(start), int(stop)) for start, stop in zip(starts, stops, strict=True)]


def _taken_off(time_s: FloatArray, level: FloatArray, start: int, stop: int, usual: float) -> int:
    """The first sample that carries the vehicle: it stands while the throttle rises."""
    end = min(int(np.searchsorted(time_s, time_s[start] + _LONGEST_RAMP_S, side="right")), stop + 1)
    ramp = level[start:end]
    reached = np.flatnonzero(ramp >= _CARRIED * min(usual, float(np.median(ramp))))
    return start + int(reached[0]) if reached.size else start


def _touched_down(time_s: FloatArray, level: FloatArray, start: int, stop: int, usual: float) -> int:
    """The last sample that carries the vehicle: behind it the throttle is taken back on the ground."""
    begin = max(int(np.searchsorted(time_s, time_s[stop] - _LONGEST_RAMP_S)), start)
    ramp = level[begin : stop + 1]
    reached = np.flatnonzero(ramp >= _CARRIED * min(usual, float(np.median(ramp))))
    return begin + int(reached[-1]) if reached.size else stop


def _height(record: FlightRecord) -> Witness:
    """Height above the ground that the log shows at its beginning or end."""
    nothing = Witness(name="height")
    found = _together(record, ("down",))
    if found is None or record.rate_hz("down") < _SLOWEST_HEIGHT_HZ:
        return nothing
    time_s, height = found[0], -found[1][0]
    if np.ptp(time_s) < 2.0 * _SHORTEST_STILL_S:
        return nothing
    low, high = (float(value) for value in np.percentile(height, [1.0, 99.0]))
    if high - low < _LEAST_CLIMB_M:
        return nothing
    still = _still(time_s, height)
    grounds = [part for part in _at_ends(time_s, still) if height[part].mean() < low + 0.25 * (high - low)]
    if not grounds:
        return nothing
    level = np.interp(
        time_s,
        [float(time_s[part].mean()) for part in grounds],
        [float(np.median(height[part])) for part in grounds],
    )
    up = height > level + _LIFTED_M
    yes = tuple((float(time_s[a]), float(time_s[b])) for a, b in _runs(time_s, up, None) if b > a)
    no = tuple((float(time_s[part][0]), float(time_s[part][-1])) for part in grounds)
    return Witness(name="height", source="the height", yes=yes, no=without(no, yes), reason="it stayed on the ground")


def _still(time_s: FloatArray, height: FloatArray) -> BoolArray:
    """Where the height is constant for two seconds."""
    size = max(int(_SHORTEST_STILL_S / even_step_s(time_s)), 2)
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    size = min(size, height.size)
    spread = maximum_filter1d(height, size, mode="nearest") - minimum_filter1d(height, size, mode="nearest")
    return np.asarray(spread < _STILL_M)


def _at_ends(time_s: FloatArray, still: BoolArray) -> Iterator[slice]:
    """The stretches at rest with which a record begins and ends, where they last."""
    for backward in (False, True):
        flags = still[::-1] if backward else still
        count = int(np.argmin(flags)) if not flags.all() else flags.size
        part = slice(still.size - count, still.size) if backward else slice(0, count)
        if count >= 2 and float(np.ptp(time_s[part])) >= _SHORTEST_STILL_S:
            yield part


def climbed(record: FlightRecord, start_s: float, stop_s: float) -> Answer:
    """Whether the height changed as in flight across the beginning or the end of a stretch.

    It says nothing where neither a take-off nor a landing was logged: a vehicle that hovers does not climb.
    """
    found = _together(record, ("down",))
    if found is None:
        return "nothing"
    time_s, height = found[0], -found[1][0]
    inside = height[(time_s >= start_s) & (time_s <= stop_s)]
    outside = [
        height[(time_s >= low) & (time_s <= high)] for low, high in ((start_s - 3.0, start_s), (stop_s, stop_s + 3.0))
    ]
    outside = [part for part in outside if part.size >= 3]
    if inside.size < 3 or not outside:
        return "nothing"
    if any(float(np.percentile(inside, 75.0) - np.median(part)) > _CERTAIN_CLIMB_M for part in outside):
        return "yes"
    ground = np.concatenate(outside)
    return "no" if float(np.ptp(np.concatenate([inside, ground]))) < 2.0 * _STILL_M else "nothing"


def settled_s(record: FlightRecord, stop_s: float) -> float:
    """When a vehicle stays on the ground, by its height; the end of its thrust where the height does not show it.

    It may bounce after it has reached the ground, and its thrust still carries it for a moment when it stays there:
    the middle of the two is taken. It needs three seconds on the ground at a constant height, logged at 4 Hz and more.
    """
    found = _together(record, ("down",))
    if found is None:
        return stop_s
    time_s, height = found[0], -found[1][0]
    after = (time_s > stop_s + 0.5) & (time_s <= stop_s + 3.5)
    before = (time_s >= stop_s - _LONGEST_TAKING_BACK_S) & (time_s <= stop_s)
    enough = min(np.count_nonzero(after), np.count_nonzero(before)) >= _FEWEST_HEIGHTS
    if not enough or float(np.ptp(height[after])) > _STILL_M:
        return stop_s
    least_m = max(1.5 * float(np.ptp(height[after])), _RESOLVED_M)
    above = np.flatnonzero(before & (np.abs(height - float(np.median(height[after]))) > least_m))
    return 0.5 * (float(time_s[above[-1]]) + stop_s) if above.size else stop_s


def descended(record: FlightRecord, start_s: float, stop_s: float) -> bool:
    """Whether the height changes within a stretch as it does not on the ground."""
    inside = _heights(record, start_s, stop_s)
    return inside.size >= 2 and float(np.ptp(inside)) > _LIFTED_M


def height_logged(record: FlightRecord, start_s: float, stop_s: float) -> bool:
    """Whether the log has a height within a stretch."""
    return _heights(record, start_s, stop_s).size >= 2


def _heights(record: FlightRecord, start_s: float, stop_s: float) -> FloatArray:
    found = _together(record, ("down",))
    return np.zeros(0) if found is None else found[1][0][(found[0] >= start_s) & (found[0] <= stop_s)]


def moves(record: FlightRecord, start_s: float, stop_s: float, *, least_s: float) -> Answer:
    """Whether the vehicle turns or accelerates for so long within a stretch; dead sensors say nothing."""
    looked_at = False
    dead = {**dict.fromkeys(RATES, dead_gyro(record)), **dict.fromkeys(_FORCES, dead_accelerometer(record))}
    for names, most in ((RATES, MOVING_RAD_S), (_FORCES, MOVING_M_S2)):
        sensors = None if dead[names[0]] else _together(record, names)
        if sensors is None:
            continue
        time_s, values, _ = sensors
        if names == _FORCES:
            values = np.sqrt((values**2).sum(axis=0, keepdims=True)) - STANDARD_GRAVITY_M_S2
        inside = (time_s >= start_s) & (time_s <= stop_s)
        # A damaged or thin channel is no evidence.
        if np.count_nonzero(inside) * even_step_s(time_s) < 0.5 * (stop_s - start_s):
            continue
        looked_at = True
        if float(np.mean(speed(time_s, values)[inside] > most)) * (stop_s - start_s) >= least_s:
            return "yes"
    return "no" if looked_at else "nothing"


def _motion(record: FlightRecord) -> Witness:
    """How much gyro and accelerometer move, or the attitude where neither is logged."""
    names = (*(() if dead_accelerometer(record) else _FORCES), *(() if dead_gyro(record) else RATES))
    sensors = _together(record, names)
    if sensors is None and not any(name in record for name in (*_FORCES, *RATES)):
        sensors = _turning(record)
    if sensors is None:
        return Witness(name="motion")
    time_s, values, source = sensors
    lively = _lively(time_s, values)
    yes = tuple((float(time_s[start]), float(time_s[stop])) for start, stop in _runs(time_s, lively, None))
    logged = _covered(record, time_s)
    return Witness(
        name="motion",
        source=f"{MOTION} {source}",
        yes=yes,
        no=without((logged,), yes),
        reason="nothing moved",
    )


def _turning(record: FlightRecord) -> tuple[FloatArray, FloatArray, str] | None:
    """How fast roll and pitch change."""
    found = _together(record, ("phi", "theta"))
    if found is None or len(found[1]) < 2 or found[0].size < 4 or not np.all(np.diff(found[0]) > 0.0):
        return None
    time_s, angles, source = found
    return time_s, np.gradient(np.unwrap(angles, axis=1), time_s, axis=1), source


def speed(time_s: FloatArray, rates: FloatArray) -> FloatArray:
    """Rms over half a second of body rates, or of what else moves, without vibration, shape ``(samples,)``."""
    step_s = even_step_s(time_s)
    square = np.zeros(time_s.size)
    # One axis after the other: of a long log, all of them at once would take a good part of the memory.
    for axis in rates:
        calm = _moving_mean(axis[np.newaxis], max(int(_VIBRATION_S / step_s), 1))
        calm *= calm
        mean = _moving_mean(calm, max(int(_WINDOW_S / step_s), 1), output=calm)[0]
        square += np.maximum(mean, 0.0, out=mean)
        del calm, mean
    return np.sqrt(square)


def _together(record: FlightRecord, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray, str] | None:
    """Those of the channels that are in one topic, the one that lasts longest, where all are finite."""
    topics = dict.fromkeys(topic for name in names for topic, _ in record.holding(name))
    durations = [(float(np.ptp(topic.time_s)), topic) for topic in topics if topic.time_s.size >= 2]
    if not durations:
        return None
    topic = max(durations, key=lambda item: item[0])[1]
    rows = {name: topic.row(name) for name in names}
    present = {name: row for name, row in rows.items() if row is not None}
    return _finite_samples(topic, list(present.values()), ", ".join(present))


def _finite_samples(topic: Topic, rows: list[int], names: str) -> tuple[FloatArray, FloatArray, str] | None:
    """Samples that are finite, in order of their stamps; ``None`` of stamps that never rise."""
    values = topic.values[rows]
    kept = np.isfinite(values).all(axis=0) & np.isfinite(topic.time_s)
    # Of a long log, a copy of all samples is a good part of the memory.
    time_s, values = (topic.time_s, values) if kept.all() else (topic.time_s[kept], values[:, kept])
    if not np.all(time_s[1:] >= time_s[:-1]):
        order = np.argsort(time_s, kind="stable")
        time_s, values = time_s[order], values[:, order]
    return (time_s, values, names) if time_s.size >= 2 and time_s[-1] > time_s[0] else None


def _lively(time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Where sensors move as in flight; everywhere, when they never rest."""
    window = max(int(_WINDOW_S / even_step_s(time_s)), 2)
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
