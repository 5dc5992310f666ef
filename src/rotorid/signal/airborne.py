"""When a vehicle was in the air, weighed from all that its log shows.

The landed flag of an autopilot decides where it was logged; else the thrust (throttle, outputs and speeds of the
motors, current), then the height, then the motion of gyro and accelerometer. What the first of them does not show, the
next one does: flags that were first logged late are unknown before, and not "on the ground". Two witnesses overrule all
others: a vehicle that was not armed, or whose motors never ran, did not fly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import cached_by_value
from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import FlightRecord, Intervals, Maneuver, silences
from rotorid.errors import InsufficientDataError
from rotorid.signal.bench import bench_words, is_bench
from rotorid.signal.control import Control, before_loss, control
from rotorid.signal.dead_sensors import dead_sensor_findings
from rotorid.signal.witnesses import (
    LEVELS,
    Name,
    Witness,
    climbed,
    descended,
    height_logged,
    moves,
    seconds_within,
    settled_s,
    without,
    witnesses_of,
)
from rotorid.typing import BoolArray, FloatArray

_SHORTEST_FLIGHT_S = 2.0
_SHORTEST_EARLY_S = 5.0
"""Who raises the throttle and tips over is said to fly for seconds."""

_TO_LIFT_S, _LATEST_S = 1.0, 10.0
"""In a shorter wait a vehicle has hardly risen; a flag that comes later than the other is not that of this take-off."""

_EARLIEST_S = 1.5
"""An early flag that goes farther ahead of the thrust is not the take-off."""

_LONGEST_WAIT_S, _TAKING_BACK_S = 5.0, 0.3
"""Most rest on the ground after which a landing detector says so; and until the throttle is back at touch-down."""

_LONGEST_SILENCE_S = 60.0
"""A flight does not go on through a longer pause of the whole log; so no flight is longer than its samples allow."""

_TOUCHING_S = 0.05
"""Stretches of two witnesses that are so close are one flight."""

_DECIDING: tuple[Name, ...] = ("landed flag", *LEVELS, "height", "motion")
"""Who decides, the surest first."""

_NOTHING_LOGGED = "thrust_command, motor_1 ..., ax ay az, or p q r"


@dataclass(frozen=True, kw_only=True)
class Airborne:
    """Stretches of a record in the air.

    Parameters
    ----------
    intervals
        Start and stop of each flight in seconds on the log's own clock, in order of time.
    seen_in
        What showed it: flags of the log, a thrust command, the motors, the height, or the activity of accelerometer and
        gyro.
    by_thrust
        Whether flags, thrust, motors or height showed it. The activity of sensors only guesses: who rests in the air
        looks landed.
    by_flags
        Whether the autopilot itself says so.
    findings
        What is to be said of control, then ``airborne`` with start and stop of the longest flight.
    control
        Loss of control, at which its flight ends here; hard landing; end of the log in the air. ``None`` without any.
    witnesses
        What each part of the log says, the surest first.
    """

    intervals: tuple[tuple[float, float], ...]
    seen_in: str
    findings: tuple[Finding, ...]
    by_thrust: bool = True
    by_flags: bool = False
    witnesses: tuple[Witness, ...] = ()
    control: Control | None = None

    @property
    def longest(self) -> tuple[float, float]:
        """Start and stop of the longest flight."""
        return max(self.intervals, key=lambda interval: interval[1] - interval[0])


@cached_by_value
def airborne(record: FlightRecord, *, margin_s: float = 0.0) -> Airborne:
    """Find the flights in a record.

    The landed flag decides, where it was logged. An autopilot that says "not landed" as soon as the throttle rises is
    believed from 5 s on, where another witness says so too: the vehicle turned by more than 0.1 rad/s or its specific
    force was 0.5 m/s² off gravity for 2 s, it climbed, or its thrust carried it and its height does not contradict.

    Elsewhere thrust decides: more than half of its usual value (a speed of 70 %), or body rates above 0.1 rad/s while
    the motors run, as in a dive at zero throttle. The flight begins where the thrust reaches what carries the vehicle.
    Without thrust, the height does; without height, the activity of accelerometer and gyro (spread within half a second
    more than the geometric mean of that at rest and that in flight, where these differ by fifteen and more). Dips of up
    to 1 s belong to a flight; flights under 2 s and what was not armed are left out. A thrust that goes below zero
    counts from hover, and shows nothing.

    A record that begins in the air begins its flight with its first sample. A vehicle without flags and thrust that is
    carried about by hand misleads it.

    Parameters
    ----------
    margin_s
        Cut from both ends of each flight without flags that begins or ends within the record, where the ground still
        acts.

    Raises
    ------
    InsufficientDataError
        Nothing in the log shows whether it flew, or the vehicle never flew.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 60.0, 0.02)
    >>> thrust = np.where((time_s >= 10.0) & (time_s < 50.0), 0.4, 0.0)
    >>> command = Channel(name="thrust_command", unit="1")
    >>> topic = Topic(name="mixer", time_s=time_s, channels=(command,), values=thrust[None])
    >>> record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(topic,))
    >>> found = airborne(record)
    >>> [round(float(end), 2) for end in found.longest], found.seen_in
    ([10.0, 49.98], 'thrust_command')
    >>> next(one.answer(0.0, 10.0) for one in found.witnesses if one.name == "throttle")
    'no'
    """
    if is_bench(record):
        raise _of_a_bench(record)
    witnesses = witnesses_of(record)
    deciding = [one for name in _DECIDING for one in witnesses if one.name == name and one.speaks]
    if not deciding:
        raise _unknown(record)
    first, *others = deciding
    by_flags = first.name == "landed flag"
    early = by_flags and record.status.early
    flights, seen_in = _decided(record, first, others)
    if early:
        flights = _overruled(flights, first, others)
        flights = tuple(_from_take_off(flight, others) for flight in flights if _confirmed(record, flight, witnesses))
    if by_flags:
        flights = tuple(_with_late_take_off(record, flight, others) for flight in flights)
        flights = tuple(_to_touch_down(record, flight, others) for flight in flights)
    flights = tuple((start_s, settled_s(record, stop_s)) for start_s, stop_s in flights)
    arming = next(one for one in witnesses if one.name == "arming")
    flights = without(flights, arming.no)
    if not by_flags and margin_s:
        flights = _without_ends(record, flights, margin_s)
    shortest_s = _SHORTEST_EARLY_S if early else _SHORTEST_FLIGHT_S
    flights = tuple(
        (start_s, stop_s)
        for start_s, stop_s in _logged(record, flights)
        if stop_s - start_s >= shortest_s and not _at_rest(record, (start_s, stop_s), witnesses)
    )
    if not flights:
        raise _too_short(record, witnesses, shortest_s) or _never(record, first, witnesses, shortest_s)
    lost = control(record, flights)
    said = () if lost is None else lost.findings
    flights = tuple(
        (start_s, stop_s) for start_s, stop_s in before_loss(flights, lost) if stop_s - start_s >= shortest_s
    )
    if not flights:
        raise _lost_at_once(record, seen_in, shortest_s, said)
    found = Airborne(
        intervals=flights,
        seen_in=seen_in,
        findings=(),
        by_thrust=first.name != "motion",
        by_flags=by_flags,
        witnesses=witnesses,
        control=lost,
    )
    return replace(found, findings=(*said, _finding(found, record)))


def _decided(record: FlightRecord, first: Witness, others: list[Witness]) -> tuple[Intervals, str]:
    """What the first witness shows, with what flags and thrust show where it says nothing; and who showed it."""
    left = without(((record.start_s, record.stop_s),), (*first.yes, *first.no))
    stretches, sources = list(first.yes), [first.source]
    for other in others:
        if other.name not in LEVELS or first.name not in ("landed flag", *LEVELS):
            continue
        more = tuple((max(a, c), min(b, d)) for a, b in left for c, d in other.yes if max(a, c) < min(b, d))
        if any(stop_s - start_s > _TOUCHING_S for start_s, stop_s in more):
            stretches += more
            sources.append(other.source)
        left = without(left, (*other.yes, *other.no))
    return _joined(stretches), " and ".join(sources)


def _joined(stretches: list[tuple[float, float]]) -> Intervals:
    """Stretches in order of time, those that touch as one."""
    joined: list[tuple[float, float]] = []
    for start_s, stop_s in sorted(stretches):
        if joined and start_s - joined[-1][1] <= _TOUCHING_S:
            joined[-1] = joined[-1][0], max(joined[-1][1], stop_s)
        else:
            joined.append((start_s, stop_s))
    return tuple(joined)


def _overruled(flights: Intervals, flag: Witness, others: list[Witness]) -> Intervals:
    """Flights of which the events were lost: thrust and height show them, and the flag denies them."""
    height = next((one for one in others if one.name == "height"), None)
    level = next((one for one in others if one.name in LEVELS), None)
    if height is None or level is None:
        return flights
    lost = [flight for flight in level.yes if flag.denies(*flight) and height.answer(*flight) == "yes"]
    return _joined([*flights, *lost])


def _confirmed(record: FlightRecord, flight: tuple[float, float], witnesses: tuple[Witness, ...]) -> bool:
    """Whether another witness shows a flight that begins, as its flag says, when the throttle rises."""
    moved, rose = moves(record, *flight, least_s=_SHORTEST_FLIGHT_S), climbed(record, *flight)
    if "yes" in (moved, rose) or _seconded(flight, witnesses, ("mode", "height")):
        return True
    carried = _seconded(flight, witnesses, LEVELS)
    # Who hovers calmly neither moves nor climbs; who stands with a raised throttle neither.
    return (carried and rose != "no") or (moved == rose == "nothing" and not _speaks(flight, witnesses, LEVELS))


def _seconded(flight: tuple[float, float], witnesses: tuple[Witness, ...], names: tuple[Name, ...]) -> bool:
    return any(seconds_within(one.yes, *flight) >= _SHORTEST_FLIGHT_S for one in witnesses if one.name in names)


def _speaks(flight: tuple[float, float], witnesses: tuple[Witness, ...], names: tuple[Name, ...]) -> bool:
    return any(one.answer(*flight) != "nothing" for one in witnesses if one.name in names)


def _from_take_off(flight: tuple[float, float], others: list[Witness]) -> tuple[float, float]:
    """A flight from where its thrust carries it, when its flag went far ahead."""
    start_s, stop_s = flight
    for one in others:
        begins = [start for start, stop in one.yes if start < stop_s and stop > start_s]
        if one.name in LEVELS and begins:
            return (min(begins), stop_s) if min(begins) - start_s > _EARLIEST_S else flight
    return flight


def _with_late_take_off(
    record: FlightRecord, flight: tuple[float, float], others: list[Witness]
) -> tuple[float, float]:
    """A flight from where its thrust carries it, when its flag came after that: a message was lost.

    Longer than a second the wait was in the air only where the height changes; without a height, up to 5 s are.
    """
    start_s, stop_s = flight
    for one in others:
        begins = [begin for begin, stop in one.yes if begin < start_s < stop]
        if one.name in LEVELS and begins:
            waited_s = start_s - begins[0]
            if waited_s <= _TO_LIFT_S or not height_logged(record, begins[0], start_s):
                in_air = waited_s <= _LONGEST_WAIT_S
            else:
                in_air = waited_s < _LATEST_S and descended(record, begins[0], start_s)
            return (begins[0], stop_s) if in_air else flight
    return flight


def _to_touch_down(record: FlightRecord, flight: tuple[float, float], others: list[Witness]) -> tuple[float, float]:
    """A flight to its touch-down: a landing detector waits for up to a second of rest on the ground.

    The last thrust that carries the vehicle is there, unless it goes on to sink.
    """
    start_s, stop_s = flight
    if record.stop_s - stop_s <= _TOUCHING_S:
        return flight
    for one in others:
        ends = [stop for begin, stop in one.yes if begin < stop_s and stop > start_s]
        if one.name not in LEVELS or not ends:
            continue
        waited_s = stop_s - max(ends)
        if not 0.0 < waited_s < _LONGEST_WAIT_S or descended(record, max(ends) + _TAKING_BACK_S, stop_s):
            return flight
        return start_s, max(ends)
    return flight


def _at_rest(record: FlightRecord, flight: tuple[float, float], witnesses: tuple[Witness, ...]) -> bool:
    """Whether all that shows thrust denies a flight, and the height does not show it."""
    levels = [one for one in witnesses if one.name in LEVELS and one.answer(*flight) != "nothing"]
    if not levels or not all(one.denies(*flight) for one in levels):
        return False
    return climbed(record, *flight) != "yes" and not _seconded(flight, witnesses, ("height",))


def _without_ends(record: FlightRecord, flights: Intervals, margin_s: float) -> Intervals:
    """Flights without their ends, but for those where the record ends."""
    cut = (
        (
            start_s + (margin_s if start_s - record.start_s > _TOUCHING_S else 0.0),
            stop_s - (margin_s if record.stop_s - stop_s > _TOUCHING_S else 0.0),
        )
        for start_s, stop_s in flights
    )
    return tuple((start_s, stop_s) for start_s, stop_s in cut if start_s < stop_s)


def not_flown(record: FlightRecord) -> tuple[Finding, ...]:
    """Why a log shows no flight, as warnings, or that it does not show when it flew; empty where it shows a flight."""
    try:
        airborne(record)
    except InsufficientDataError as error:
        if is_bench(record):
            return tuple(error.findings)
        never = tuple(warn(finding.kind, finding.where, finding.message) for finding in error.findings)
        unknown = f"The log does not show when the vehicle flew: {error.came.rstrip('.')}."
        return never or (remark("airborne", "log", unknown),)
    return ()


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


def flight_around(in_air: Airborne | None, maneuver: Maneuver) -> tuple[float, float]:
    """Start and stop of the flight in which a maneuver was flown; without bounds where none is known."""
    for start_s, stop_s in in_air.intervals if in_air else ():
        if start_s <= 0.5 * (maneuver.start_s + maneuver.stop_s) <= stop_s:
            return start_s, stop_s
    return -math.inf, math.inf


def control_of(record: FlightRecord) -> Control | None:
    """Loss of control, hard landing or end in the air of a record; ``None`` without any, and where nothing flew."""
    try:
        return airborne(record).control
    except InsufficientDataError:
        return None


def evidence_words(seen_in: str) -> str:
    """The evidence of a flight, as the end of a sentence.

    Examples
    --------
    >>> evidence_words("vehicle_land_detected and vehicle_status")
    'as vehicle_land_detected and vehicle_status show'
    """
    return f"as {seen_in} {'show' if ' and ' in seen_in else 'shows'}"


def _of_a_bench(record: FlightRecord) -> InsufficientDataError:
    """A vehicle that is held does not fly, whatever its motors do."""
    came = f"{record.source.name} is a log of a bench ({bench_words(record)})"
    return InsufficientDataError(
        came,
        needed=f"a log of a flight, with {_NOTHING_LOGGED}",
        remedy="use rotorid identify with --model rig.roll, or with a model of your own",
        findings=[remark("bench_log", record.source.name, f"{came}: motors and motion, nothing that flies.")],
    )


def _unknown(record: FlightRecord) -> InsufficientDataError:
    """Nothing shows whether the vehicle flew."""
    dead = dead_sensor_findings(record)
    refused = [finding.where for finding in record.findings if finding.kind == "impossible_value"]
    motors = [name for name in refused if name.startswith("motor_") and name not in record.channel_names]
    if motors and not dead:
        return InsufficientDataError(
            f"{listed(motors)} of {record.source.name} {'is' if len(motors) == 1 else 'are'} no share of full output",
            needed="its unit" if len(motors) == 1 else "their units",
            remedy=f"write it in the header, such as {motors[0]} [V], [us], [%] or [rpm], or as `unit` in a mapping",
        )
    if not dead:
        return InsufficientDataError(
            f"{record.source.name} has neither thrust nor accelerometer nor gyro",
            needed=_NOTHING_LOGGED,
            remedy="log one of them, or name its source with --map",
        )
    why = " ".join(finding.message.partition(". ")[0] + "." for finding in dead)
    message = f"{record.source.name} shows no flight. {why}"
    return InsufficientDataError(
        message.removesuffix("."),
        needed="sensors that measure, or thrust",
        remedy="check the sensors and their units, and log thrust_command or the motors",
        findings=[refusal("never_airborne", record.source.name, message), *dead],
    )


def _too_short(record: FlightRecord, witnesses: tuple[Witness, ...], shortest_s: float) -> InsufficientDataError | None:
    """A record shorter than a flight, of which nothing denies that it is a part of one; ``None`` for others."""
    length_s = record.stop_s - record.start_s
    if length_s >= shortest_s or any(one.no for one in witnesses):
        return None
    return InsufficientDataError(
        f"{record.source.name} lasts only {length_s:.1f} s",
        needed=f"{shortest_s:g} s to show a flight",
        remedy="use a longer log, or fit one part with rotorid identify --segment AXIS:START:STOP",
    )


def _never(
    record: FlightRecord, first: Witness, witnesses: tuple[Witness, ...], shortest_s: float
) -> InsufficientDataError:
    """Why there is no flight: who denies it."""
    witness = first
    if record.status.armed == ():
        witness = next(one for one in witnesses if one.name == "arming")
    elif first.yes and max(stop_s - start_s for start_s, stop_s in first.yes) >= shortest_s:
        witness = next((one for one in witnesses if one.name in LEVELS and one.no and not one.yes), first)
    why = _why_not(witness, shortest_s)
    message = f"{record.source.name} has no flight of {shortest_s:g} s and more, {evidence_words(witness.source)}{why}."
    return InsufficientDataError(
        message,
        needed="a vehicle in the air",
        remedy="choose another log, or fit one part with rotorid identify --segment AXIS:START:STOP",
        findings=[refusal("never_airborne", witness.source, message), *dead_sensor_findings(record)],
    )


def _lost_at_once(
    record: FlightRecord, seen_in: str, shortest_s: float, said: tuple[Finding, ...]
) -> InsufficientDataError:
    """The vehicle left the ground, and control was lost before there was a flight."""
    message = f"{record.source.name} has no flight of {shortest_s:g} s and more before control was lost."
    return InsufficientDataError(
        message,
        needed="a vehicle in the air and in control",
        remedy="choose another log",
        findings=[refusal("never_airborne", seen_in, message), *said],
    )


def _why_not(witness: Witness, shortest_s: float) -> str:
    if not witness.yes:
        return f": {witness.reason}" if witness.reason else ""
    longest_s = max(stop_s - start_s for start_s, stop_s in witness.yes)
    if longest_s < shortest_s:
        return f": the longest stretch lasts {longest_s:.1f} s"
    if witness.name == "landed flag":
        return ", and nothing else confirms it: neither motion nor height nor throttle shows a flight"
    return ""


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
