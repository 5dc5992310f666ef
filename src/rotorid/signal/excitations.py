r"""Find excitations in signals: where an axis was moved on purpose, how, and over which band.

A test input stands out by its variance, and by its shape: two levels, a frequency that rises, or repetition. A signal
of period :math:`T`, as a multisine is, is its own copy one period later,

.. math:: r(\tau) = \frac{\int x(t) \, x(t + \tau) \, dt}{\sqrt{\int x^2(t) \, dt \int x^2(t + \tau) \, dt}}, \qquad
    r(T) = 1

over the time in which both are there. A command that contains feedback repeats only in part, a test input exactly.

Evidence has a rank. What the log declares goes before what shapes suggest (:func:`rich_excitations`): a pilot who flies
doublets, corrects a drift and lands makes shapes too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import cached_by_value
from rotorid.data.record import (
    AXES,
    MOTORS,
    STANDARD_UNITS,
    FlightRecord,
    Intervals,
    Kind,
    Maneuver,
    Maneuvers,
    require_record,
    units_of,
)
from rotorid.data.trust import LEAST_WIDTH, RICH_KINDS
from rotorid.errors import unknown_name
from rotorid.signal.airborne import airborne_by_thrust
from rotorid.signal.bench import driven_motors, is_bench
from rotorid.signal.clock import even_step_s
from rotorid.typing import Axis, BoolArray, FloatArray

OUTER_SETPOINTS: dict[str, tuple[str, ...]] = {
    "roll": ("east_setpoint", "velocity_east_setpoint", "v_setpoint", "phi_setpoint"),
    "pitch": ("north_setpoint", "velocity_north_setpoint", "u_setpoint", "theta_setpoint"),
    "yaw": ("psi_setpoint", "r_setpoint"),
    "thrust": ("down_setpoint", "velocity_down_setpoint", "w_setpoint"),
}
"""Set-points of each axis from the outermost loop inward. Only the outermost that moves is free of feedback."""

RATE_SETPOINTS: dict[str, str] = {"roll": "p_setpoint", "pitch": "q_setpoint", "yaw": "r_setpoint"}

ATTITUDE_SETPOINTS: dict[str, str] = {"roll": "phi_setpoint", "pitch": "theta_setpoint"}
"""Set-points that a program sends where it flies attitudes."""

_SENT_MODES = ("guided", "guided without GPS", "offboard")
"""Modes in which a program may send set-points of the attitude."""

_OUTER_MODES = (
    *("position", "position slow", "hold", "takeoff", "land", "precision land", "descend", "mission", "return"),
    *("auto", "loiter", "circle", "position hold", "brake", "smart return", "flow hold", "follow", "zigzag"),
)
"""Modes in which loops of position and velocity move the set-points of the attitude."""

_TUNING_MODES = ("autotune",)
"""Modes in which the autopilot excites itself."""

LEAST_MOTION = {"1": 0.02, "rad": 0.02, "rad/s": 0.05, "m/s": 0.1, "m": 0.02}
"""Excitations smaller than this are taken for noise or for pilot corrections."""

_LEAST_DRIVE = {"V": 0.05, "us": 10.0, "rad/s": 5.0}
"""The same of what drives a motor on a bench: about a hundredth of what a motor needs to carry its vehicle."""


def least_motion(record: FlightRecord, name: str) -> float:
    """Motion of a channel, in its own unit, that is taken for noise or for corrections of a pilot."""
    unit = record.unit_of(name)
    drives = unit in units_of(name)[1:]
    return _LEAST_DRIVE[unit] if drives else LEAST_MOTION.get(STANDARD_UNITS.get(name, "1"), 0.02)


_ACTIVE_SHARE = 0.1
"""Share of the largest motion above which a signal is active."""

_TAIL_SHARE = 0.005
"""Share above which an active stretch goes on."""

_LEAST_OF_SWEEP = 0.25
"""Size of a short maneuver over that of a sweep of the same signal from which it is no correction of the pilot."""

_LONGEST_REST_S = 1.6
"""Rests as long belong to the excitation."""

_SHORTEST_S = 0.3
"""What is shorter is no excitation."""

_HYSTERESIS = 0.3
"""Share of the level that a signal must pass to count as on the other side, against noise."""

_TWO_LEVEL_SHARE = 0.7
"""Share of the level from which samples count as at it, and share of the samples that must be."""

_MOST_TRANSITIONS = 0.5
"""Share of the samples that may be on the way between two levels."""

_LEAST_VARIATION = 0.2
"""Spread of half periods over their mean from which they are irregular, as those of a sine are not."""

_AT_LEVEL_SHARE = 0.9
"""Share of the samples, without those on their way, that two levels must hold."""

_MOST_BEYOND = 0.02
"""Share of the samples of a signal of two levels that may lie beyond them by half: single peaks are doublets."""

_LEAST_OF_EACH = 0.2
"""Share of the samples at either level that lie at the rarer one."""

_LEAST_AT_LEVEL = 0.25
"""Share of the samples at each of two levels."""

_SHORTEST_RICH_S = 6.0
"""Sweeps, random binary signals and multisines are longer."""

_FEWEST_HALVES = 7
"""Half periods that a sweep, a random binary signal or a multisine has at least."""

_SHORTEST_PERIOD_S = 4.0
"""Shorter periods are those of a sine and of steps, and make no multisine."""

_MOSTLY = 0.95
"""Share of a flight that was flown so from which all of it counts."""

_MOSTLY_FLOWN = 0.5
"""Share of a maneuver that must be in the air."""

_FLIP_S = (0.5, 2.0)
"""Times within which half a turn is a flip, the quick one and the slow one."""

_MOST_OVER = 0.1
"""Share of a long maneuver that flips may take; a crash at its end is less."""

_TRIM_S, _TRIM_STEP_S = 3.0, 0.5
"""Time before and after over which a trim is the median, and how often it is looked at."""

_FAR_ABOVE = 4.0
"""Two octaves, between what a stick shows and what a program flew inside of it, or between half periods."""

_STEADY, _STEADY_OF_FEW, _MANY_HALVES = 0.75, 0.93, 20
"""Rank correlation of half periods with their order from which they grow or shrink steadily: few of a busy pilot's
reach the first by chance, in one of 30 flights of two minutes."""

_LEAST_RATIO = 1.8
"""Ratio of the half periods at both ends of a sweep."""

_DRIFT_S = 2.0
"""What is slower is drift where a sweep is looked for on it."""

_FEWEST_IN_DRIFT = 30
"""Half periods of such a sweep: fewer may look as if they shrank by chance."""

_AROUND = 4
"""Half periods before and after one that say how long it should be."""

_MADE_BY_PROGRAMS = ("sweep", "multisine")
"""Kinds that no outer loop makes of what it is asked for."""

_SHORT_KINDS = ("doublet", "multistep", "other")


def excitation_signals(
    record: FlightRecord, axis: Axis, *, within: tuple[float, float] | None = None
) -> tuple[str, ...]:
    """Channels of a record in which an excitation of ``axis`` would show, best first.

    What the reader knows to be free of feedback comes first, set-points of rates that are the stick before the stick,
    then set-points from the outermost loop inward, then the command itself.

    Parameters
    ----------
    record
        The log.
    axis
        The axis to look at.
    within
        Start and stop of the interval in question; all of the flight where it is not given.
    """
    added = (f"{axis}_excitation", f"{axis}_setpoint_excitation")
    free = record.instruments.get(axis, ()) or (*added, f"{axis}_stick", *OUTER_SETPOINTS[axis])
    injected = [name for name in free if name.endswith("_excitation")]
    others = [name for name in free if name not in injected]
    if sets_rates_directly(record, within):
        free = (*injected, RATE_SETPOINTS.get(axis, ""), *others)
    elif within is not None and _share(within, record.status.planned) > _MOSTLY:
        free = (*injected, ATTITUDE_SETPOINTS.get(axis, ""), *others)
    names = (*free, f"{axis}_command")
    return tuple(name for name in dict.fromkeys(names) if name in record.channel_names)


def sets_rates_directly(record: FlightRecord, within: tuple[float, float] | None = None) -> bool:
    """Whether the set-points of the body rates are the sticks in an interval, or wherever the vehicle was armed.

    Examples
    --------
    >>> from rotorid.data.record import Source, Status
    >>> source = Source(name="flight.bbl", format="Betaflight blackbox", sha256="")
    >>> acro = Status(armed=((3.0, 90.0),), direct_rates=((0.0, 95.0),))
    >>> sets_rates_directly(FlightRecord(source=source, topics=(), status=acro))
    True
    >>> sets_rates_directly(FlightRecord(source=source, topics=(), status=acro), (80.0, 200.0))
    False
    """
    status = record.status
    asked = (within,) if within else (status.in_air or status.armed or ())
    return bool(asked) and all(_share(interval, status.direct_rates) > _MOSTLY for interval in asked)


def _share(interval: tuple[float, float], intervals: Intervals) -> float:
    """Share of an interval that others cover, which do not overlap each other."""
    start_s, stop_s = interval
    covered_s = sum(max(min(b, stop_s) - max(a, start_s), 0.0) for a, b in intervals)
    return covered_s / (stop_s - start_s)


def _sent_attitudes(record: FlightRecord) -> Intervals:
    """When a program sent set-points of the attitude: by the log's own word, or else the modes in which it may have."""
    status = record.status
    return status.planned or tuple((start_s, stop_s) for mode, start_s, stop_s in status.modes if mode in _SENT_MODES)


def still_declarations(record: FlightRecord) -> tuple[Maneuver, ...]:
    """Excitations that the log declares, and whose signal stands still all the while: there was none."""
    return tuple(maneuver for maneuver in record.declared if _stands_still(record, maneuver))


def _stands_still(record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether the signal of a maneuver has samples within it, and all of them are one value."""
    still = False
    for topic, row in record.holding(maneuver.signal):
        values = topic.values[row][topic.within(maneuver.start_s, maneuver.stop_s)]
        values = values[np.isfinite(values)]
        if values.size and float(np.ptp(values)) > 0.0:
            return False
        still = still or values.size > 0
    return still


def find_excitations(record: FlightRecord, axis: Axis) -> Maneuvers:
    """Excitations of one axis: those that the log declares, and those that its signals show beside them.

    The first signal of :func:`excitation_signals` that shows any is taken, and of those inside of it the sweeps and
    multisines that go on far beyond what it shows. An interval is active while the signal leaves its resting value by
    more than a tenth of its largest motion; rests of up to 1.6 s belong to it. Sweeps have half periods that shrink or
    grow steadily, also on a drift that is slower than 2 s, random binary signals two levels without a trend and more
    than an octave of half periods, multisines a period that they repeat, doublets and multisteps few switches. Beside
    what a log declares, pushes that are large and come before its first run or after its last one are doublets and
    multisteps, about the trim of the stick. Where nothing of an axis was excited and single motors were, as on a rig,
    their test inputs count to the axis that turns most.

    Sticks that move on the ground excite nothing, and who turns over flies a figure: neither is an excitation, nor is
    what the log declares in a signal that stands still.

    Parameters
    ----------
    record
        The log.
    axis
        The axis to look at.

    Returns
    -------
    Maneuvers
        In order of time; empty where nothing was excited.

    Raises
    ------
    UsageError
        There is no such axis, or the record is none.
    """
    require_record(record)
    if axis not in AXES:
        raise unknown_name("axis", str(axis), AXES)
    return _excitations(record, axis)


@cached_by_value
def _excitations(record: FlightRecord, axis: Axis) -> Maneuvers:
    found = _from_outside(record, axis) or _by_single_motors(record, axis)
    if found:
        return Maneuvers(found)
    # The short answers to gusts that a command shows while everything outside of the loop is seen to rest are none.
    watched = _free_signals(record, axis) != (f"{axis}_command",)
    moved = _purposeful(record, axis, [f"{axis}_command"])
    shown = [m for m in moved if not (watched and m.kind in _SHORT_KINDS)]
    if not shown:
        return Maneuvers()
    # A controller answers an excitation of one axis on the others too: that is no excitation of theirs.
    elsewhere = [m for other in AXES if other != axis for m in _from_outside(record, other)]  # type: ignore[arg-type]
    return Maneuvers(m for m in shown if not any(_mostly_inside(m, e) for e in elsewhere))


def rich_excitations(record: FlightRecord, axis: Axis) -> Maneuvers:
    """Excitations of one axis that a response is measured from: of the highest rank that the log has any of.

    Sweeps, random binary signals and multisines, and intervals that a mapping names. Where the log declares any of
    them, by the messages of its autopilot, by a plan that a program flew or by a mapping, what signals show beyond
    them is left to judge the model (:func:`verifying_excitations`): it was flown for something else.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> sweep = Maneuver(axis="roll", kind="sweep", start_s=5.0, stop_s=60.0, origin="declared")
    >>> source = Source(name="flight.BIN", format="dataflash", sha256="")
    >>> rich_excitations(FlightRecord(source=source, topics=(), declared=(sweep,)), "roll") == (sweep,)
    True
    """
    rich = [m for m in find_excitations(record, axis) if m.kind in RICH_KINDS or m.origin == "given"]
    return Maneuvers([m for m in rich if m.origin != "found"] or rich)


def verifying_excitations(record: FlightRecord, axis: Axis) -> Maneuvers:
    """Excitations of one axis that no response is measured from: doublets, multisteps, and what ranks lower."""
    fitted = rich_excitations(record, axis)
    return Maneuvers(m for m in find_excitations(record, axis) if m not in fitted)


@cached_by_value
def candidate_excitations(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """Stretches that move an axis enough to try, and that :func:`find_excitations` does not take by itself.

    Looked at are the injected signal and the outermost other signal that is logged: set-points inside it contain its
    feedback. The command is judged only where the log holds nothing else. A candidate lasts 6 s or more, changes side
    eight times or more, and not as fast as its samples follow each other, which is noise. Unlike there, a signal that
    never rests between two levels is measured from their middle, so that a random binary signal which fills its whole
    log is reported as one.

    Whether a candidate was meant as an excitation, only who flew it knows: a pilot who is merely busy makes them too.

    Parameters
    ----------
    record
        The log.
    axis
        The axis to look at.

    Returns
    -------
    tuple of Maneuver
        In order of time; none overlaps an excitation that was found on this axis.
    """
    known = find_excitations(record, axis)
    for name in _free_signals(record, axis):
        for topic, row in record.holding(name):
            values = topic.values[row]
            least = least_motion(record, name)
            moving = _in_signal(topic.time_s, values, axis, name, least=least, rest=_middle_of_levels(values))
            if moving:
                rich = [m for m in moving if _is_rich(m, topic.time_s, values) and not _any_shared(m, known)]
                rich = list(_level_flight(record, rich))
                if all(m.kind != "other" for m in rich):
                    return tuple(rich)
                # Two clean levels are no controller's answer to another axis; anything else beside one may be.
                others = [other for other in AXES if other != axis]
                elsewhere = [m for other in others for m in find_excitations(record, other)]  # type: ignore[arg-type]
                return tuple(m for m in rich if m.kind != "other" or not _any_shared(m, elsewhere))
    return ()


def _free_signals(record: FlightRecord, axis: Axis) -> tuple[str, ...]:
    """The injected signal and the outermost other one; the command where the log holds neither."""
    names = excitation_signals(record, axis)
    injected = tuple(name for name in names if name in (f"{axis}_excitation", f"{axis}_setpoint_excitation"))
    others = [name for name in names if name not in (*injected, f"{axis}_command")]
    return (*injected, *others[:1]) or names


def _any_shared(maneuver: Maneuver, others: Sequence[Maneuver]) -> bool:
    return any(_mostly_inside(maneuver, other) or _mostly_inside(other, maneuver) for other in others)


def _is_rich(maneuver: Maneuver, time_s: FloatArray, values: FloatArray) -> bool:
    """Whether a stretch is long, changes side often, and more slowly than noise does from sample to sample."""
    if maneuver.duration_s < _SHORTEST_RICH_S:
        return False
    inside = (time_s >= maneuver.start_s) & (time_s <= maneuver.stop_s) & np.isfinite(values)
    part_time, part = time_s[inside], values[inside]
    motion = part - _middle_of_levels(part)
    halves = np.diff(_switch_times(part_time, motion, _HYSTERESIS * float(np.percentile(np.abs(motion), 95.0))))
    return halves.size >= _FEWEST_HALVES and float(np.median(halves)) > 3.0 * float(np.median(np.diff(part_time)))


def _middle_of_levels(values: FloatArray) -> float:
    """Resting value: the middle of two levels between which a signal always switches, else the median.

    The median of such a signal is one of its levels, so that half of it would look like rest.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    low, high = np.percentile(finite, [2.0, 98.0])
    near = 0.5 * (1.0 - _TWO_LEVEL_SHARE) * (high - low)
    shares = float(np.mean(finite <= low + near)), float(np.mean(finite >= high - near))
    both = high > low and min(shares) >= _LEAST_AT_LEVEL and sum(shares) >= _AT_LEVEL_SHARE
    return float(low + high) / 2.0 if both else float(np.median(finite))


def _from_outside(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """Excitations of an axis that the log declares or that signals without feedback show."""
    declared = tuple(m for m in record.declared if m.axis == axis and not _stands_still(record, m))
    declared += tuple(m for m in _sent_by_program(record, axis) if not _any_shared(m, declared))
    # What the log declares shows in the injected signal too; other maneuvers show elsewhere.
    known = {f"{axis}_command", f"{axis}_excitation"} if declared else {f"{axis}_command"}
    names = [name for name in excitation_signals(record, axis) if name not in known]
    found = _purposeful(record, axis, names)
    if any(maneuver.kind in RICH_KINDS for maneuver in record.declared if maneuver.axis == axis):
        rich = [m for m in found if m.kind in RICH_KINDS]
        found = (*rich, *(m for m in _short_on_trim(record, axis, names) if not _any_shared(m, rich)))
    others = tuple(m for m in found if not _any_shared(m, declared))
    return tuple(sorted((*declared, *others), key=lambda maneuver: maneuver.start_s))


def _sent_by_program(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """Excitations that a program sent as set-points of the attitude, as they flew: the autopilot may smooth them.

    Where the log says when a plan was flown, each counts as declared. Without that word only the shapes that no outer
    loop makes are taken for a program's.
    """
    name, planned = ATTITUDE_SETPOINTS.get(axis, ""), bool(record.status.planned)
    if name in record.instruments.get(axis, (name,) if not planned else ()):
        # A set-point that is free of feedback throughout is looked at as a whole.
        return ()
    found: list[Maneuver] = []
    for start_s, stop_s in _sent_attitudes(record):
        for topic, row in record.holding(name):
            inside = topic.within(start_s, stop_s)
            time_s, values = topic.time_s[inside], topic.values[row][inside]
            known = np.isfinite(values)
            time_s, values = time_s[known], values[known]
            moved = _in_signal(time_s, values, axis, name, least=least_motion(record, name))
            if planned:
                moved = [replace(_smoothed(m, time_s, values), origin="declared") for m in moved]
            kinds = (*RICH_KINDS, "doublet", "multistep") if planned else _MADE_BY_PROGRAMS
            shown = _level_flight(record, [m for m in moved if m.kind in kinds])
            if shown:
                found += shown
                break
    return tuple(found)


def _smoothed(maneuver: Maneuver, time_s: FloatArray, values: FloatArray) -> Maneuver:
    """What a program is known to have sent, as a multisine where it repeats as well as smoothing leaves it.

    The autopilot limits rates and accelerations of what it is asked for, and a loop that keeps the place adds its own:
    two periods of a multisine are alike in part only. Of a plan that was flown that is enough.
    """
    if maneuver.kind != "other":
        return maneuver
    inside = (time_s >= maneuver.start_s) & (time_s <= maneuver.stop_s)
    part_time, part = time_s[inside], values[inside]
    period_s = period_of(part_time, part, shortest_s=_SHORTEST_PERIOD_S, alike=_ALIKE_IN_PLAN)
    band = None if period_s is None else lines_in_noise(part_time, part, period_s)
    if band is None or band[1] <= LEAST_WIDTH * band[0]:
        return maneuver
    return replace(maneuver, kind="multisine", band_rad_s=band)


def motor_excitations(record: FlightRecord) -> tuple[str, ...]:
    """Test inputs of single motors that a record holds, ``motor_3_excitation``, in the order of the motors.

    Examples
    --------
    >>> from rotorid.vehicles import rig
    >>> motor_excitations(rig.fly(("motor_3", "motor_4"), np.random.default_rng(0)))[2:]
    ('motor_3_excitation', 'motor_4_excitation')
    """
    names = (f"motor_{number}_excitation" for number in range(1, MOTORS + 1))
    return tuple(name for name in names if name in record.channel_names)


def _by_single_motors(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """Excitations in which single motors were moved, as on a rig; each counts to the axis that turns most meanwhile.

    Of a bench without test inputs of their own, what drives the motors shows its sweeps, with feedback on top. While
    one motor is swept, feedback moves the others too, but what turns follows slowly: the sweep that reaches the highest
    frequency counts.
    """
    inputs = motor_excitations(record)
    moved = [
        maneuver
        for name in inputs or (driven_motors(record) if is_bench(record) else ())
        for maneuver in _purposeful(record, axis, [name])
        if _turns_most(record, maneuver) == axis
    ]
    if not inputs:
        moved.sort(key=lambda maneuver: -(maneuver.band_rad_s or (0.0, 0.0))[1])
    found: list[Maneuver] = []
    for maneuver in moved:
        found += [] if _any_shared(maneuver, found) else [maneuver]
    return tuple(sorted(found, key=lambda maneuver: maneuver.start_s))


def _turns_most(record: FlightRecord, maneuver: Maneuver) -> Axis | None:
    """The axis with the largest spread of the rates, or of the angles where no rate is logged."""
    for channels in (RATE_OF, ANGLE_OF):
        spreads: dict[Axis, float] = {}
        for axis, name in channels.items():
            for topic, row in record.holding(name):
                values = topic.values[row][topic.within(maneuver.start_s, maneuver.stop_s)]
                values = values[np.isfinite(values)]
                if values.size:
                    spreads[axis] = float(np.std(values))
                    break
        if spreads and max(spreads.values()) > 0.0:
            return max(spreads, key=lambda axis: spreads[axis])
    return None


def _purposeful(record: FlightRecord, axis: Axis, names: Sequence[str]) -> tuple[Maneuver, ...]:
    """Excitations in the first signal, in its best topic, that shows any of a known kind.

    A program may have flown its sweep through a set-point inside of it, and a pilot doublets before or after, or
    corrections meanwhile: a shape that no outer loop makes counts there too, where it goes on to far higher frequencies
    than all that the first signal shows at that time.
    """
    outer: tuple[Maneuver, ...] = ()
    for name in names:
        for topic, row in record.holding(name):
            found = _in_signal(topic.time_s, topic.values[row], axis, name, least=least_motion(record, name))
            kinds = _MADE_BY_PROGRAMS if outer else (*RICH_KINDS, "doublet", "multistep")
            moved = [m for m in found if m.kind in kinds and not _by_autopilot(record, m)]
            moved = [m for m in moved if not _answers_another_axis(record, m)]
            purposeful = tuple(m for m in _level_flight(record, moved) if _goes_beyond(m, outer))
            if purposeful:
                kept = (m for m in outer if not _any_shared(m, purposeful))
                outer = tuple(sorted((*kept, *purposeful), key=lambda maneuver: maneuver.start_s))
                break
    return outer


def _answers_another_axis(record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether a set-point moves while a test input is added to another axis: loops that answer it seem to sweep too."""
    if not maneuver.signal.endswith("_setpoint") or sets_rates_directly(record, (maneuver.start_s, maneuver.stop_s)):
        return False
    for axis in (axis for axis in AXES if axis != maneuver.axis):
        added = [f"{axis}_excitation", f"{axis}_setpoint_excitation"]
        inputs = (*(m for m in record.declared if m.axis == axis), *_purposeful(record, axis, added))  # type: ignore[arg-type]
        if _any_shared(maneuver, inputs):
            return True
    return False


def _goes_beyond(maneuver: Maneuver, others: Sequence[Maneuver]) -> bool:
    """Whether a maneuver ends far above what others excite at its time; a stick excites all that follows it."""
    tops = [other.band_rad_s[1] if other.band_rad_s else 0.0 for other in others if _any_shared(maneuver, [other])]
    return not tops or (maneuver.band_rad_s is not None and maneuver.band_rad_s[1] > _FAR_ABOVE * max(tops))


def _short_on_trim(record: FlightRecord, axis: Axis, names: Sequence[str]) -> tuple[Maneuver, ...]:
    """Doublets and multisteps in the first signal that shows any, about what a pilot holds against the wind meanwhile.

    The trim is the median over 3 s before and after, so that what is looked for is shorter than that. Beside what a log
    declares, such maneuvers only verify: what is half as large as the largest of them and more, before the first run
    that is declared and after the last one. Smaller pushes, and those during a run, are corrections.
    """
    begin_s, end_s = min(m.start_s for m in record.declared), max(m.stop_s for m in record.declared)
    for name in names:
        for topic, row in record.holding(name):
            finite = np.isfinite(topic.values[row])
            time_s, values = topic.time_s[finite], topic.values[row][finite]
            if time_s.size < 2:
                continue
            # Only where samples are: between flights a log may be silent for years.
            places = np.unique(np.floor((time_s - time_s[0]) / _TRIM_STEP_S))
            grid = time_s[0] + _TRIM_STEP_S * np.union1d(places, places + 1.0)
            edges = np.searchsorted(time_s, [grid - _TRIM_S, grid + _TRIM_S])
            trim = [np.median(values[low : max(high, low + 1)]) for low, high in edges.T]
            motion = values - np.interp(time_s, grid, trim)
            motion[(time_s > begin_s) & (time_s < end_s)] = 0.0
            least = 0.5 * float(np.abs(motion).max())
            moved = _in_signal(time_s, motion, axis, name, least=least_motion(record, name), rest=0.0)
            short = [
                m
                for m in moved
                if m.kind in ("doublet", "multistep")
                and not _by_autopilot(record, m)
                and float(np.abs(motion[(time_s >= m.start_s) & (time_s <= m.stop_s)]).max()) >= least
            ]
            if found := _level_flight(record, short):
                return found
    return ()


def _by_autopilot(record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether loops of the autopilot made a motion, as its mode says.

    Loops of position and velocity move the set-points of the attitude, and the autopilot that tunes itself twitches the
    command under gains that change from one twitch to the next.
    """
    if maneuver.kind in _SHORT_KINDS and maneuver.signal in ATTITUDE_SETPOINTS.values():
        modes: tuple[str, ...] = _OUTER_MODES
    elif maneuver.signal.endswith("_command"):
        modes = _TUNING_MODES
    else:
        return False
    own = tuple((start_s, stop_s) for mode, start_s, stop_s in record.status.modes if mode in modes)
    return _share((maneuver.start_s, maneuver.stop_s), own) > _MOSTLY_FLOWN


def _level_flight(record: FlightRecord, maneuvers: Sequence[Maneuver]) -> tuple[Maneuver, ...]:
    """The maneuvers that were flown, and without turning over; of short ones what was flown.

    Of long ones the rest is cut where they are used, with a remark; of short ones it may be all that moved much.
    """
    level = tuple(maneuver for maneuver in maneuvers if not _turns_over(record, maneuver))
    found = airborne_by_thrust(record) if level else None
    flights = found.intervals if found is not None else None
    if flights is None:
        return level
    flown = [m for m in level if _share((m.start_s, m.stop_s), flights) > _MOSTLY_FLOWN]
    return tuple(_clipped(m, flights) if m.kind in _SHORT_KINDS else m for m in flown)


def _clipped(maneuver: Maneuver, flights: Intervals) -> Maneuver:
    """The longest part of a maneuver within a flight."""
    parts = [(max(start_s, maneuver.start_s), min(stop_s, maneuver.stop_s)) for start_s, stop_s in flights]
    start_s, stop_s = max(parts, key=lambda part: part[1] - part[0])
    return replace(maneuver, start_s=start_s, stop_s=stop_s)


def _turns_over(record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether roll or pitch turns by half a turn within two seconds: a flip, about which no hover model holds.

    A long stretch may end with a crash: of sweeps and the like flips have to take a tenth.
    """
    most = 0.0 if maneuver.kind in ("doublet", "multistep") else _MOST_OVER
    for name in ("p", "q"):
        for topic, row in record.holding(name):
            inside = topic.within(maneuver.start_s, maneuver.stop_s)
            time_s, rate = topic.time_s[inside], topic.values[row][inside]
            known = np.isfinite(rate)
            time_s, rate = time_s[known], rate[known]
            if time_s.size < 2:
                continue
            angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s))])
            turned = [np.abs(np.interp(time_s + lag_s, time_s, angle) - angle) > np.pi for lag_s in _FLIP_S]
            if float(np.mean(np.logical_or.reduce(turned))) > most:
                return True
            break
    return False


def _mostly_inside(maneuver: Maneuver, other: Maneuver) -> bool:
    shared = min(maneuver.stop_s, other.stop_s) - max(maneuver.start_s, other.start_s)
    return shared > 0.5 * maneuver.duration_s


def _in_signal(
    time_s: FloatArray, values: FloatArray, axis: Axis, name: str, *, least: float, rest: float | None = None
) -> list[Maneuver]:
    """Every active stretch of a signal as it is classified; the resting value is its median unless it is given."""
    finite = np.isfinite(values)
    time_s, values = time_s[finite], values[finite]
    if time_s.size < 10:
        return []
    motion = values - (np.median(values) if rest is None else rest)
    largest = float(np.percentile(np.abs(motion), 99.8))
    if largest < least:
        return []
    maneuvers = []
    cores = _active_intervals(time_s, np.abs(motion) > _ACTIVE_SHARE * largest)
    moving = np.abs(motion) > _TAIL_SHARE * largest
    # Where a signal never rests between two maneuvers, each gets half of what lies between.
    edges = [0, *((a[1] + b[0]) // 2 for a, b in pairwise(cores)), time_s.size - 1]
    # A maneuver does not go on behind a pause of the log, during which nobody knows what the vehicle did.
    pauses = np.concatenate([[-1], np.flatnonzero(np.diff(time_s) > _LONGEST_REST_S), [time_s.size - 1]])
    for core, low, high in zip(cores, edges, edges[1:], strict=False):
        begin, end = pauses[np.searchsorted(pauses, [core[0], core[1]]) - [1, 0]]
        first, last = _with_tails(core, moving, max(low, int(begin) + 1), min(high, int(end)))
        part_time, part = time_s[first : last + 1], motion[first : last + 1]
        if part_time[-1] - part_time[0] < _SHORTEST_S:
            continue
        kind, band = classify(part_time, part)
        start_s, stop_s = float(part_time[0]), float(part_time[-1])
        drifting = _sweep_in_drift(part_time, part) if kind in ("other", "sweep") else None
        if drifting is not None and kind == "other":
            kind, (start_s, stop_s, band) = "sweep", drifting
        elif drifting is not None and band is not None:
            # What drifts hides half periods where the sweep is fast.
            band = band[0], max(band[1], drifting[2][1])
        found = Maneuver(axis=axis, kind=kind, start_s=start_s, stop_s=stop_s, band_rad_s=band, signal=name)
        maneuvers.append((found, float(np.abs(part).max())))
    swept = max((size for found, size in maneuvers if found.kind in RICH_KINDS), default=0.0)
    # Next to a sweep a hand that keeps the place makes shapes too.
    return [found for found, size in maneuvers if found.kind in RICH_KINDS or size >= _LEAST_OF_SWEEP * swept]


def _sweep_in_drift(time_s: FloatArray, motion: FloatArray) -> tuple[float, float, tuple[float, float]] | None:
    """Start, stop and band of a sweep on which something slow is laid, such as what keeps a place in wind; or ``None``.

    Without the mean over 2 s around each sample the half periods of a sweep shrink or grow steadily again, and those of
    a pilot and of gusts do not. What the sweep does below half a hertz or so is left out with the drift.
    """
    step_s = even_step_s(time_s)
    width = max(round(_DRIFT_S / step_s), 1)
    grid = np.arange(time_s[0], time_s[-1], step_s)
    if grid.size <= 2 * width:
        return None
    values = np.interp(grid, time_s, motion)
    summed = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(grid.size)
    low, high = np.maximum(index - width // 2, 0), np.minimum(index + width // 2 + 1, grid.size)
    fast = values - (summed[high] - summed[low]) / (high - low)
    switches = _switch_times(grid, fast, _HYSTERESIS * float(np.percentile(np.abs(fast), 95.0)))
    first, last = _longest_run(np.diff(switches))
    halves = np.diff(switches[first : last + 1])
    if halves.size < _FEWEST_IN_DRIFT or not _has_trend(halves, ratio=LEAST_WIDTH**2):
        return None
    run = switches[first : last + 1]
    return float(run[0]), float(run[-1]), (float(np.pi / halves.max()), _fastest_rad_s(run))


def _longest_run(halves: FloatArray) -> tuple[int, int]:
    """First and last switch of the longest row of half periods of which none is much longer than those around it."""
    if halves.size < 2 * _AROUND + 1:
        return 0, 0
    padded = np.pad(halves, _AROUND, mode="reflect")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1), axis=1)
    breaks = np.concatenate([[-1], np.flatnonzero(halves > _FAR_ABOVE * usual), [halves.size]])
    longest = int(np.argmax(np.diff(breaks)))
    return int(breaks[longest]) + 1, int(breaks[longest + 1])


def _active_intervals(time_s: FloatArray, active: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each active stretch, short rests included."""
    index = np.flatnonzero(active)
    if index.size == 0:
        return []
    breaks = np.flatnonzero(np.diff(time_s[index]) > _LONGEST_REST_S)
    starts = index[np.concatenate([[0], breaks + 1])]
    stops = index[np.concatenate([breaks, [index.size - 1]])]
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


def _with_tails(core: tuple[int, int], moving: BoolArray, low: int, high: int) -> tuple[int, int]:
    """The interval with its fades: outward until the signal rests, between ``low`` and ``high``."""
    first, last = core
    rest_before, rest_after = np.flatnonzero(~moving[low:first]), np.flatnonzero(~moving[last : high + 1])
    return (
        low + int(rest_before[-1]) if rest_before.size else low,
        last + int(rest_after[0]) if rest_after.size else high,
    )


def classify(time_s: FloatArray, motion: FloatArray) -> tuple[Kind, tuple[float, float] | None]:
    """What kind of excitation a signal is, and its band in rad/s.

    Parameters
    ----------
    time_s, motion
        One active interval, its resting value removed, shapes ``(samples,)``.

    Examples
    --------
    >>> t = np.arange(0.0, 60.0, 0.01)
    >>> kind, band = classify(t, np.sin(0.5 * t + 0.15 * t**2))
    >>> kind, [round(w, 1) for w in band]
    ('sweep', [1.8, 18.5])
    """
    level = float(np.percentile(np.abs(motion), 95.0))
    switches = _switch_times(time_s, motion, _HYSTERESIS * level)
    duration = float(time_s[-1] - time_s[0])
    if len(switches) < 2:
        single = len(switches) == 1 and duration < 8.0
        return ("doublet", None) if single else ("other", None)
    halves = np.diff(switches)
    band = (float(np.pi / halves.max()), _fastest_rad_s(switches))
    many = len(halves) >= _FEWEST_HALVES
    if many and duration > _SHORTEST_RICH_S:
        if _has_trend(halves):
            return ("sweep" if band[1] > LEAST_WIDTH * band[0] else "other"), band
        # One octave of half periods is a pilot who weaves: gain, damping and delay look alike over it.
        if halves.max() > LEAST_WIDTH * halves.min() and _has_two_levels(time_s, motion, switches, level):
            return "random_binary", band
        return _repeated(time_s, motion) or ("other", band)
    return ("other", band) if many or duration >= 15.0 else ("multistep", None)


def single_frequency(time_s: FloatArray, motion: FloatArray) -> float | None:
    """Frequency in rad/s of a signal that is one sine, as of a dwell; ``None`` for any other.

    Its half periods are alike, and a sine of that frequency, whose amplitude and phase may drift, explains 90 % of its
    variance.

    Parameters
    ----------
    time_s, motion
        One active interval, shapes ``(samples,)``.

    Examples
    --------
    >>> t = np.arange(0.0, 30.0, 0.01)
    >>> round(single_frequency(t, np.sin(12.6 * t)), 2), single_frequency(t, np.sin(t + 0.2 * t**2))
    (12.6, None)
    """
    motion = motion - _middle_of_levels(motion)
    level = float(np.percentile(np.abs(motion), 95.0))
    switches = _switch_times(time_s, motion, _HYSTERESIS * level)
    halves = np.diff(switches)
    if halves.size < _FEWEST_HALVES or float(np.std(halves)) > _LEAST_VARIATION * float(np.mean(halves)):
        return None
    omega_rad_s = float(np.pi * halves.size / (switches[-1] - switches[0]))
    inside = (time_s >= switches[0]) & (time_s <= switches[-1])
    time_s, motion = time_s[inside], motion[inside]
    if time_s.size < _SAMPLES_OF_A_HALF * halves.size:
        return None
    missed = total = 0.0
    turns = omega_rad_s * (time_s - time_s[0]) / (2.0 * np.pi)
    for part in np.array_split(np.arange(time_s.size), max(1, int(turns[-1] / _PERIODS_AT_ONCE))):
        phase = 2.0 * np.pi * turns[part]
        basis = np.stack([np.cos(phase), np.sin(phase), np.ones(phase.size)], axis=1)
        rest = motion[part] - basis @ np.linalg.lstsq(basis, motion[part], rcond=None)[0]
        missed += float(rest @ rest)
        total += float(np.sum(np.square(motion[part] - motion[part].mean())))
    return omega_rad_s if missed < _NOT_OF_SINE * total else None


_PERIODS_AT_ONCE = 8.0
_SAMPLES_OF_A_HALF = 3
_NOT_OF_SINE = 0.1


def _repeated(time_s: FloatArray, motion: FloatArray) -> tuple[Kind, tuple[float, float]] | None:
    """A multisine with its band: a signal of several lines that repeats."""
    period_s = period_of(time_s, motion, shortest_s=_SHORTEST_PERIOD_S)
    band = None if period_s is None else lines_of(time_s, motion, period_s)
    return None if band is None or band[1] <= LEAST_WIDTH * band[0] else ("multisine", band)


def _fastest_rad_s(switches: FloatArray) -> float:
    """Highest frequency of a row of switches: a straight line through its fastest stretch, at the faster end.

    From whole periods, which an offset of the signal does not change. Noise makes single ones too short, and a mean of
    several misses where a sweep really ended.
    """
    if switches.size < 3:
        return float(np.pi / np.diff(switches).min())
    rates, middles = 2.0 * np.pi / (switches[2:] - switches[:-2]), switches[1:-1]
    count = max(5, rates.size // 5)
    if rates.size < count:
        return float(rates.max())
    ends = (slice(-count, None), switches[-1]), (slice(0, count), switches[0])
    part, end_s = max(ends, key=lambda end: float(np.median(rates[end[0]])))
    slope, level = np.polyfit(middles[part] - end_s, rates[part], 1)
    # A slope that points the other way is noise of a row of equal periods.
    return float(level if slope * (middles[part].mean() - end_s) < 0.0 else np.median(rates[part]))


def _switch_times(time_s: FloatArray, motion: FloatArray, threshold: float) -> FloatArray:
    """Times at which the signal changes side, with hysteresis against noise."""
    side = np.where(motion > threshold, 1, np.where(motion < -threshold, -1, 0))
    decided = np.flatnonzero(side)
    changes = decided[1:][np.diff(side[decided]) != 0]
    return np.asarray(time_s[changes])


def _has_two_levels(time_s: FloatArray, motion: FloatArray, switches: FloatArray, level: float) -> bool:
    """Whether a signal stays at two levels, the samples on its way between them not counted.

    At 20 Hz those are many: the sample at which the side changes and the one before it. Of a sine that is sampled as
    coarsely, too, nothing but the crests remains without them; but its half periods are all of one length.
    """
    moving = np.abs(motion) > _TWO_LEVEL_SHARE * level
    # A stick that landed rests at a single level, and doublets on a trim go far beyond it.
    above = float(np.mean(motion[moving] > 0.0))
    if min(above, 1.0 - above) < _LEAST_OF_EACH or float(np.mean(np.abs(motion) > 1.5 * level)) > _MOST_BEYOND:
        return False
    if float(np.mean(moving)) > _TWO_LEVEL_SHARE:
        return True
    index = np.searchsorted(time_s, switches)
    between = np.zeros(motion.size, dtype=np.bool_)
    between[index] = between[np.maximum(index - 1, 0)] = True
    halves = np.diff(switches)
    irregular = float(np.std(halves)) > _LEAST_VARIATION * float(np.mean(halves))
    few = float(np.mean(between)) <= _MOST_TRANSITIONS
    return irregular and few and float(np.mean(moving[~between])) >= _AT_LEVEL_SHARE


def _has_trend(halves: FloatArray, *, ratio: float = _LEAST_RATIO) -> bool:
    """Whether half periods shrink or grow steadily: rank correlation with their order, and a ratio of about two."""
    order = np.argsort(np.argsort(halves, kind="stable"), kind="stable")
    correlation = float(np.corrcoef(order, np.arange(halves.size))[0, 1])
    third = max(halves.size // 4, 2)
    growth = float(np.median(halves[:third]) / np.median(halves[-third:]))
    steady = _STEADY if halves.size >= _MANY_HALVES else _STEADY_OF_FEW
    return abs(correlation) > steady and max(growth, 1.0 / growth) > ratio


_ALIKE = 0.95
"""Correlation with itself from which a signal repeats."""

_ALIKE_IN_PLAN = 0.5
"""The same of a signal that a program is known to have sent, and that the autopilot smoothed."""

_UNLIKE = 0.5
"""Correlation below which a signal has left itself, before it can come back."""

_LEAST_PERIODS = 1.9
"""Periods that a record must hold to show that it repeats: nearly two."""

_LEAST_LINE = 0.02
"""Share of the largest line from which a line of a multisine counts."""

_FEWEST_LINES = 3
"""Lines that a multisine has at least."""


def period_of(time_s: FloatArray, motion: FloatArray, *, shortest_s: float, alike: float = _ALIKE) -> float | None:
    """Period of a signal that repeats at least once; ``None`` for one that does not.

    Parameters
    ----------
    time_s, motion
        One active interval, shapes ``(samples,)``; the stamps may jitter.
    shortest_s
        Shorter periods are those of a sine and of steps.
    alike
        Correlation with itself from which it repeats.

    Examples
    --------
    >>> t = np.arange(0.0, 40.0, 0.02)
    >>> wave = np.sin(0.7 * np.pi * t) + np.sin(1.1 * np.pi * t + 1.0) + np.sin(1.9 * np.pi * t + 2.0)
    >>> period_of(t, wave, shortest_s=5.0)
    20.0
    """
    step_s = even_step_s(time_s)
    grid = np.arange(time_s[0], time_s[-1], step_s)
    values = np.interp(grid, time_s, motion)
    values = values - values.mean()
    shift = _normalized(values)
    first, last = int(shortest_s / step_s), int(grid.size / _LEAST_PERIODS)
    dips = np.flatnonzero(shift[:last] < _UNLIKE)
    begin = max(first, int(dips[0]) if dips.size else last)
    repeats = np.flatnonzero(shift[begin:last] > alike)
    if not repeats.size:
        return None
    # The first stretch that is alike, at its best place.
    stop = begin + int(repeats[0])
    while stop + 1 < last and shift[stop + 1] > alike:
        stop += 1
    best = begin + int(repeats[0]) + int(np.argmax(shift[begin + int(repeats[0]) : stop + 1]))
    return round(best * step_s, 9)


def lines_of(time_s: FloatArray, motion: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Lowest and highest line of a signal of known period, rad/s; ``None`` for fewer than three lines."""
    step_s = even_step_s(time_s)
    samples = round(period_s / step_s)
    periods = int((time_s[-1] - time_s[0]) / period_s)
    grid = time_s[0] + np.arange(samples * max(periods, 1)) * step_s
    whole = np.interp(grid, time_s, motion).reshape(-1, samples).mean(axis=0)
    size = np.abs(np.fft.rfft(whole - whole.mean()))
    lines = np.flatnonzero(size > _LEAST_LINE * size.max())
    if lines.size < _FEWEST_LINES:
        return None
    line_rad_s = 2.0 * np.pi / period_s
    return float(lines[0] * line_rad_s), float(lines[-1] * line_rad_s)


_LINE_OVER_NOISE = 9.0
"""Power of a line over that between lines around it from which it counts; noise alone is as large once in 8000."""

_LOW_LINE_OVER_NOISE = 3.0
"""The same at the lower end."""

_NEIGHBORS = 8
"""Lines around one whose gaps say how large the noise is there."""


def lines_in_noise(time_s: FloatArray, motion: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Lowest and highest line of a signal that repeats but for noise, rad/s; ``None`` for fewer than three lines.

    Of :math:`n` whole periods every :math:`n`-th frequency holds a line, and those between them noise alone.

    Parameters
    ----------
    time_s, motion
        One active interval of about two periods or more, shapes ``(samples,)``.
    """
    step_s = even_step_s(time_s)
    samples, periods = round(period_s / step_s), max(round((time_s[-1] - time_s[0]) / period_s - 0.4), 1)
    if periods < 2:
        return None
    grid = time_s[0] + np.arange(samples * periods) * step_s
    values = np.interp(grid, time_s, motion)
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    count = power.size // periods
    lines = power[: count * periods].reshape(count, periods)
    between = lines[:, 1:].mean(axis=1)
    kernel = np.ones(min(_NEIGHBORS, count))
    noise = np.convolve(between, kernel, "same") / np.convolve(np.ones(count), kernel, "same")
    over = lines[1:, 0] / np.maximum(noise[1:], np.finfo(np.float64).tiny)
    over_noise = np.flatnonzero(over > _LINE_OVER_NOISE) + 1
    if over_noise.size < _FEWEST_LINES:
        return None
    # Drift is largest where the lines begin, and few lines lie there that noise could add.
    lowest = int(np.flatnonzero(over > _LOW_LINE_OVER_NOISE)[0]) + 1
    line_rad_s = 2.0 * np.pi / period_s
    return float(lowest * line_rad_s), float(over_noise[-1] * line_rad_s)


def _normalized(values: FloatArray) -> FloatArray:
    """Correlation of a signal with itself by the shift in samples, over the samples that both have."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = values.size
    length = int(next_fast_len(2 * size, real=True))
    product = irfft(np.abs(rfft(values, length)) ** 2, length)[:size]
    energy = np.concatenate([[0.0], np.cumsum(values**2)])
    kept = np.arange(size)
    early, late = energy[size - kept], energy[size] - energy[kept]
    scale = np.sqrt(early * late)
    return np.asarray(np.divide(product, scale, out=np.zeros(size), where=scale > 1e-12 * energy[size]))
