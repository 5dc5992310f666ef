"""Maneuvers cut out of their logs, on one clock.

:func:`cut` brings all maneuvers to the rate of the slowest, reconstructs channels that are not logged from those that
are, and applies time shifts last. :func:`with_surroundings` takes quiet time along: without a window's length of what
came after it, the end of a sweep biases a frequency response. :func:`time_records` cuts records for a fit in time,
where samples stay as they were logged wherever that is possible, because interpolation removes the steps of a held
command.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import AXES, STANDARD_UNITS, Channel, FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError, unknown_name
from rotorid.fitting.time.output_error import TimeData
from rotorid.flights.flights import Flight, overlap
from rotorid.flights.instruments import is_injection, while_flying
from rotorid.flights.steady_wind import LEANING, without_steady_drag
from rotorid.models.families import family_of
from rotorid.models.structure import LinearStructure, connected
from rotorid.results.segment import Segment
from rotorid.settings.identifying import IdentifySettings
from rotorid.signal.airborne import airborne_by_thrust, flight_around
from rotorid.signal.clock import Conditioned, missing_channel, resample, source_topic
from rotorid.signal.excitations import find_excitations
from rotorid.signal.kinematics import ingredients, reconstruct
from rotorid.signal.skew import shift
from rotorid.signal.stamps import clock_samples
from rotorid.simulation.linear import Hold
from rotorid.typing import FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")


_MARK = "reconstructed from "


def require_known_names(names: Sequence[str], records: Sequence[FlightRecord]) -> None:
    """Refuse a channel that is neither a standard name nor in a log.

    Raises
    ------
    UsageError
        Its remedy is the nearest name.
    """
    known = sorted({*STANDARD_UNITS, *(name for record in records for name in record.channel_names)})
    for name in names:
        if name not in known:
            raise unknown_name("channel", name, known, see="rotorid inspect")


def require_channels(record: FlightRecord, channels: Sequence[str]) -> None:
    """Refuse a log from which a channel can be neither read nor computed.

    Raises
    ------
    InsufficientDataError
        Its ``missing_channel`` names what would be needed.
    """
    logged = record.channel_names
    for name in channels:
        made_of = ingredients(name, logged)
        lacking = [part for part in made_of if part not in logged]
        if name in logged or (made_of and not lacking):
            continue
        remedy = ""
        if made_of:
            remedy = (
                f"log it, name its source with --map, or log {', '.join(lacking)} too: it can be computed from "
                f"{', '.join(made_of)}"
            )
        raise missing_channel(record, name, remedy=remedy)


def holds(record: FlightRecord, name: str) -> bool:
    """Whether a log contains a channel, or all channels to compute it from."""
    logged = record.channel_names
    made_of = ingredients(name, logged)
    return name in logged or (bool(made_of) and all(part in logged for part in made_of))


def with_ingredients(record: FlightRecord, channels: Sequence[str]) -> tuple[str, ...]:
    """Channels to read from a log: those logged, and those from which the others are computed."""
    logged = record.channel_names
    parts = [(name,) if name in logged else ingredients(name, logged) for name in channels]
    return tuple(dict.fromkeys(name for part in parts for name in part))


def is_logged(record: FlightRecord, name: str, start_s: float, stop_s: float) -> bool:
    """Whether a channel has samples in an interval, two and more."""
    return any(topic.time_s[topic.within(start_s, stop_s)].size > 1 for topic, _ in record.holding(name))


def with_zeros(history: TimeHistory, names: Sequence[str]) -> TimeHistory:
    """A history with further channels that are not logged, set to zero."""
    if not names:
        return history
    count = history.values.shape[1]
    silent = tuple(Channel(name=n, unit=STANDARD_UNITS.get(n, "1"), source="not logged") for n in names)
    return replace(
        history,
        values=np.vstack([history.values, np.zeros((len(names), count))]),
        channels=(*history.channels, *silent),
        processing=(*history.processing, f"{', '.join(names)} set to zero, not logged"),
    )


def built(history: TimeHistory, wanted: Sequence[str]) -> TimeHistory:
    """A history with the channels that are wanted, in their order; what is not there is reconstructed.

    Parameters
    ----------
    history
        With the ingredients, see :func:`with_ingredients`.
    wanted
        Channel names.
    """
    made = history if set(wanted) <= set(history.names) else reconstruct(history)
    if made.names == tuple(wanted):
        return made
    rows = [made.names.index(name) for name in wanted]
    return replace(made, values=made.values[rows], channels=tuple(made.channels[row] for row in rows))


def reconstructed_findings(histories: Sequence[TimeHistory]) -> tuple[Finding, ...]:
    """A remark for each channel that was not logged but made."""
    made = {c.name: c.source.removeprefix(_MARK) for h in histories for c in h.channels if c.source.startswith(_MARK)}
    return tuple(
        remark("reconstructed", name, f"{name} is not logged; it was computed from {origin}.")
        for name, origin in made.items()
    )


def shifted(history: TimeHistory, shifts: Mapping[str, float]) -> TimeHistory:
    """A history with those of its channels moved for which a shift is given, each against all others.

    Raises
    ------
    UsageError
        A shift is longer than the history.
    """
    for name, seconds in shifts.items():
        if name not in history.names:
            continue
        try:
            history = shift(history, name, seconds)
        except InsufficientDataError as error:
            raise UsageError(
                f"a shift of {name} by {seconds:g} s is too long for a maneuver of {history.duration_s:.3g} s",
                needed="a shift much shorter than every maneuver",
                remedy="see the skews that rotorid inspect finds",
            ) from error
    return history


def require_known(shifts: Mapping[str, float], used: Sequence[str]) -> None:
    """Refuse a shift of a channel that takes no part.

    Raises
    ------
    UsageError
        It says which channels there are.
    """
    for name in shifts:
        if name not in used:
            raise UsageError(f"a shift of {name} has no effect here", needed=f"one of {', '.join(used)}")


_SAME_RATE = 1.02


def cut(
    flights: Sequence[Flight],
    *,
    channels: Sequence[str],
    followers: Sequence[str] = (),
    shifts: Mapping[str, float] | None = None,
    rest_s: float = 0.0,
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Maneuvers as time histories on one clock, all at the rate of the slowest.

    What lies before take-off and after landing is cut off, channels that are not logged are reconstructed where their
    ingredients are, and shifts that were asked for are applied last.

    Parameters
    ----------
    channels, followers
        See :func:`rotorid.signal.clock.resample`; of ``channels`` those too that
        :func:`rotorid.signal.kinematics.reconstruct` makes.
    shifts
        Channel to seconds by which it is delayed, see :func:`rotorid.signal.skew.shift`. Channels that are not cut out
        here are passed over.
    rest_s
        Seconds of rest to take along on either side.

    Raises
    ------
    InsufficientDataError
        A channel is missing.
    UsageError
        A shift is longer than a maneuver.
    """
    for flight in flights:
        require_channels(flight.record, channels)
    flights, landed = while_flying(flights)

    def conditioned(item: Flight, sample_rate_hz: float | None) -> Conditioned:
        record, maneuver = item.record, item.maneuver
        _PROGRESS.info(f"{record.source.name}: {maneuver.axis} {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s")
        start_s, stop_s = maneuver.start_s - rest_s, maneuver.stop_s + rest_s
        silent = [
            name
            for name in followers
            if not is_logged(record, name, start_s, stop_s) and (is_injection(name) or name not in record.channel_names)
        ]
        found = resample(
            record,
            channels=with_ingredients(record, channels),
            auxiliary=[name for name in (*followers, *_attitude_of_trim(item, channels)) if name not in silent],
            start_s=start_s,
            stop_s=stop_s,
            sample_rate_hz=sample_rate_hz,
        )
        return replace(found, histories=tuple(with_zeros(history, silent) for history in found.histories))

    first = [conditioned(item, None) for item in flights]
    rates = [history.sample_rate_hz for part in first for history in part.histories]
    if not rates:
        raise _nothing_left(flights)
    slowest = min(rates)
    parts = first
    if any(rate != slowest for rate in rates):
        at_once = [all(history.sample_rate_hz == slowest for history in part.histories) for part in first]
        parts = [
            part if same else conditioned(item, slowest)
            for item, part, same in zip(flights, first, at_once, strict=True)
        ]
    wanted = tuple(dict.fromkeys((*channels, *followers)))
    segments = tuple(
        Segment(
            record=flight.record.source.name,
            maneuver=flight.maneuver,
            history=shifted(_from_trim(history, flight, wanted), shifts or {}),
        )
        for flight, part in zip(flights, parts, strict=True)
        for history in part.histories
    )
    remarks = (*landed, *(f for part in parts for f in part.findings), *_rates(rates, slowest))
    return segments, (
        *remarks,
        *reconstructed_findings(histories(segments)),
        *other_sources(segments, segments, channels),
    )


def _attitude_of_trim(flight: Flight, channels: Sequence[str]) -> tuple[str, ...]:
    """Angles by which channels of a leaning vehicle are counted from its trim, as far as they are not read anyway."""
    if flight.steady_drag is None or not set(channels) & set(LEANING):
        return ()
    read = with_ingredients(flight.record, channels)
    return tuple(name for name in ATTITUDE if name in flight.record.channel_names and name not in read)


def _from_trim(history: TimeHistory, flight: Flight, wanted: Sequence[str]) -> TimeHistory:
    """The channels that are wanted, those of a leaning vehicle without the drag of the steady wind."""
    if flight.steady_drag is None or not set(wanted) & set(LEANING):
        return built(history, wanted)
    turning = [name for name in ATTITUDE if name in history.names and name not in wanted]
    return built(without_steady_drag(built(history, (*wanted, *turning)), flight.steady_drag), wanted)


def _rates(rates: Sequence[float], slowest: float) -> tuple[Finding, ...]:
    """The warning on records of different rates."""
    fastest = max(rates)
    if fastest <= _SAME_RATE * slowest:
        return ()
    return (
        warn(
            "rate_too_low",
            "records",
            f"Records at {slowest:.4g} to {fastest:.4g} Hz were resampled to {slowest:.4g} Hz.",
            rate_hz=slowest,
            fastest_hz=fastest,
        ),
    )


def _nothing_left(flights: Sequence[Flight]) -> InsufficientDataError:
    names = ", ".join(dict.fromkeys(flight.record.source.name for flight in flights))
    return InsufficientDataError(
        f"the maneuvers of {names} have no second without a gap",
        needed="maneuvers logged without gaps",
        remedy="use a faster card or log fewer topics",
        findings=[refusal("gap", names, f"The maneuvers of {names} have no second without a gap.")],
    )


def other_sources(
    reference: Sequence[Segment], segments: Sequence[Segment], channels: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that come from another place in the log than in the first segment of ``reference``.

    Autopilots log one quantity in several places, filtered and not; a filter shifts a model by its delay.
    """
    findings = {}
    for segment in segments:
        for name in channels:
            here, there = source_of(segment, name), source_of(reference[0], name)
            if here != there:
                findings[segment.record, name] = warn(
                    "other_source",
                    f"{segment.record}: {name}",
                    f"{name} comes from {there} in one place and from {here} in another. If the autopilot "
                    "filters only one of them, they differ by the delay of that filter.",
                )
    return tuple(findings.values())


def source_of(segment: Segment, name: str) -> str:
    """Source of a channel of a segment in its log."""
    return segment.history.channels[segment.history.names.index(name)].source


def histories(segments: Sequence[Segment]) -> tuple[TimeHistory, ...]:
    """The data of several segments."""
    return tuple(segment.history for segment in segments)


def with_surroundings(flights: Sequence[Flight], margin_s: float, channels: Sequence[str] = ()) -> tuple[Flight, ...]:
    """Maneuvers with some of the time before and after them; those that then touch become one.

    A record that ends with its maneuver is seen by windows that all fade out there: the answer to the last of the
    excitation comes when the window is weaker than it was for the excitation, which biases the response by some degrees
    near the end of a sweep. With a window's length of what came after, every sample is seen by every part of a window.

    Other maneuvers are barriers, so that nothing that is kept unseen is looked at, and so are the ends of the topics in
    which the maneuver stands: beyond them a channel would come from another place, filtered otherwise. So are take-off
    and landing. Intervals that the user gave are obeyed as they are.

    Parameters
    ----------
    margin_s
        How much to take along on either side, where the record has it.
    channels
        What will be read.
    """
    wider: list[Flight] = []
    for record in dict.fromkeys(flight.record for flight in flights):
        own = sorted((flight for flight in flights if flight.record is record), key=lambda f: f.maneuver.start_s)
        barriers = [m for m in _all_excitations(record) if not any(overlap(m, mine.maneuver) for mine in own)]
        in_air = airborne_by_thrust(record)
        for flight in own:
            around = flight_around(in_air, flight.maneuver)
            maneuver = _widened(record, flight.maneuver, margin_s, barriers, channels, around)
            last = wider[-1] if wider else None
            if last is not None and last.record is record and maneuver.start_s < last.maneuver.stop_s:
                stop_s = max(last.maneuver.stop_s, maneuver.stop_s)
                wider[-1] = replace(last, maneuver=replace(last.maneuver, stop_s=stop_s))
            else:
                wider.append(replace(flight, maneuver=maneuver))
    return tuple(wider)


def _all_excitations(record: FlightRecord) -> list[Maneuver]:
    return [maneuver for axis in AXES for maneuver in find_excitations(record, axis)]  # type: ignore[arg-type]


def _widened(
    record: FlightRecord,
    own: Maneuver,
    margin_s: float,
    barriers: Sequence[Maneuver],
    channels: Sequence[str],
    flight: tuple[float, float],
) -> Maneuver:
    if own.origin == "given":
        return own
    topics = [
        source_topic(record, name, own.start_s, own.stop_s)[0]
        for name in channels
        if is_logged(record, name, own.start_s, own.stop_s)
    ]
    flight_start_s, flight_stop_s = flight
    first = max((float(topic.time_s[0]) for topic in topics), default=record.start_s)
    last = min((float(topic.time_s[-1]) for topic in topics), default=record.stop_s)
    first, last = max(first, flight_start_s), min(last, flight_stop_s)
    earliest = max([first, *(other.stop_s for other in barriers if other.stop_s <= own.start_s)])
    latest = min([last, *(other.start_s for other in barriers if other.start_s >= own.stop_s)])
    return replace(
        own,
        start_s=min(own.start_s, max(own.start_s - margin_s, earliest)),
        stop_s=max(own.stop_s, min(own.stop_s + margin_s, latest)),
    )


_EVEN = 0.5
"""Stamps that stray from a uniform clock by less than this share of a step name samples of that clock."""

_SAME_STAMP = 1e-6
"""Seconds within which two stamps are one."""

_EXACT_RATE = 1.002
"""Ratio of rates up to which they count as one."""

_LOOP_RATES = ("SCHED_LOOP_RATE", "IMU_GYRO_RATEMAX")
"""Parameters for the loop rate of a controller."""

_FASTER = 1.2
"""A controller that ran so many times as fast as the log moved its command between the samples."""

_SENT = ("_setpoint", "_excitation", "_stick")


class TimeRecords(NamedTuple):
    """Data for a fit in the time domain.

    Parameters
    ----------
    segments
        Maneuvers with their histories.
    data
        The same as inputs and outputs of the structure.
    hold
        What the inputs do between their samples.
    clocks
        Channel to the standard deviation of its clock, in samples (:func:`rotorid.signal.stamps.clock_samples`).
    """

    segments: tuple[Segment, ...]
    data: tuple[TimeData, ...]
    hold: Hold
    findings: tuple[Finding, ...]
    clocks: Mapping[str, float] = MappingProxyType({})


def time_records(
    structure: LinearStructure,
    flights: Sequence[Flight],
    settings: IdentifySettings,
    *,
    every_input: bool = True,
) -> TimeRecords:
    """Cut maneuvers out of their logs, without interpolation where all channels share one nearly even clock.

    A command that was held from one stamp to the next loses its steps when it is interpolated between jittery stamps,
    or thinned out to a slower log: every record keeps its own rate, but for a black box, whose starts need one rate.

    Parameters
    ----------
    structure
        Whose channels are cut out.
    settings
        Whose hold and shifts count.
    every_input
        Whether each input must move in some record, as a fit needs it. To score a model one of them will do.

    Raises
    ------
    InsufficientDataError
        A channel is missing, gaps leave nothing, or an input does not move.
    UsageError
        Some records hold their commands and others do not, so that no hold is right for all.
    """
    channels = (*structure.inputs, *structure.outputs)
    for flight in flights:
        require_channels(flight.record, channels)
    even = [replace(flight, record=evenly_stamped(flight.record, flight.maneuver, channels)) for flight in flights]
    parts = [_cut([item], channels, settings) for item in even]
    if family_of(structure).opaque and not _of_one_rate([segment for part in parts for segment in part.segments]):
        parts = [_cut(even, channels, settings)]
    segments = tuple(segment for part in parts for segment in part.segments)
    data = _data(structure, segments)
    _require_motion(structure, data, every_input=every_input)
    findings = (*(f for part in parts for f in part.findings), *other_sources(segments, segments, channels))
    holds = [sampled for part in parts for sampled in part.sampled_commands(structure.inputs)]
    hold = _hold(holds, segments) if settings.hold == "auto" else settings.hold
    return TimeRecords(segments, data, hold, findings, _clocks(flights, channels, data))


def absolute_records(
    flights: Sequence[Flight],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    settings: IdentifySettings,
) -> TimeRecords:
    """The same for a model that counts from no trim: inputs and outputs as they are, each record at its own rate.

    Parameters
    ----------
    flights, settings
        As for :func:`time_records`.
    inputs, outputs
        Channels of the model. An input that no log holds counts as zero, with a finding.

    Raises
    ------
    InsufficientDataError
        An output is missing, or gaps leave nothing.
    UsageError
        No hold is right for all records.
    """
    logged = [name for name in inputs if any(holds(flight.record, name) for flight in flights)]
    absent = [name for name in inputs if name not in logged]
    channels = (*logged, *outputs)
    for flight in flights:
        require_channels(flight.record, channels)
    even = [replace(flight, record=evenly_stamped(flight.record, flight.maneuver, channels)) for flight in flights]
    parts = [_Cut([item], *cut([item], channels=channels, shifts=settings.shifts)) for item in even]
    segments = tuple(
        replace(segment, history=with_zeros(segment.history, absent)) for part in parts for segment in part.segments
    )
    data = tuple(
        TimeData(
            name=segment.record,
            inputs=np.stack([segment.history[name] for name in inputs]),
            outputs=np.stack([segment.history[name] for name in outputs]),
            sample_rate_hz=segment.history.sample_rate_hz,
        )
        for segment in segments
    )
    lacking = [
        remark("missing_channel", name, f"No log contains {name}; it was assumed to be zero.") for name in absent
    ]
    findings = (*(f for part in parts for f in part.findings), *other_sources(segments, segments, channels), *lacking)
    sent = [sampled for part in parts for sampled in part.sampled_commands(logged)]
    hold = _hold(sent, segments) if settings.hold == "auto" else settings.hold
    return TimeRecords(segments, data, hold, findings, _clocks(flights, channels, data))


def _clocks(flights: Sequence[Flight], channels: Sequence[str], data: Sequence[TimeData]) -> Mapping[str, float]:
    logs = [(flight.record, (flight.maneuver.start_s, flight.maneuver.stop_s)) for flight in flights]
    return clock_samples(logs, channels, sample_rate_hz=max(record.sample_rate_hz for record in data))


class _Cut(NamedTuple):
    """Maneuvers of one rate, with the records that they were cut out of."""

    flights: Sequence[Flight]
    segments: tuple[Segment, ...]
    findings: tuple[Finding, ...]

    def sampled_commands(self, inputs: Sequence[str]) -> list[bool]:
        """Whether all inputs of a segment are commands logged sample by sample, as sent.

        A set-point is held until the next one comes. What goes to the mixer a controller computes in a loop that runs
        faster than most logs: only a log that says otherwise shows every value of it.
        """
        records = {flight.record.source.name: flight.record for flight in self.flights}
        return [
            all(
                (name.endswith(_SENT) or _every_loop(records[segment.record], segment))
                and _as_logged(records[segment.record], segment, name)
                for name in inputs
            )
            for segment in self.segments
        ]


def _cut(flights: Sequence[Flight], channels: Sequence[str], settings: IdentifySettings) -> _Cut:
    return _Cut(flights, *cut(flights, channels=channels, shifts=settings.shifts))


def _of_one_rate(segments: Sequence[Segment]) -> bool:
    rates = [segment.history.sample_rate_hz for segment in segments]
    return max(rates) <= _EXACT_RATE * min(rates)


def _data(structure: LinearStructure, segments: Sequence[Segment]) -> tuple[TimeData, ...]:
    """Segments as inputs and outputs, each at its own rate."""
    data = tuple(
        TimeData.of(segment.history, inputs=structure.inputs, outputs=structure.outputs, name=segment.record)
        for segment in segments
    )
    if not _of_one_rate(segments):
        return data
    # Of one rate but for their clocks: every sample is one of input and output, so that nothing drifts apart.
    rate_hz = float(np.mean([record.sample_rate_hz for record in data]))
    return tuple(replace(record, sample_rate_hz=rate_hz) for record in data)


def _require_motion(structure: LinearStructure, data: Sequence[TimeData], *, every_input: bool) -> None:
    """Refuse records in which an input, or all of them, never move: the data would show nothing."""
    moves = [any(record.inputs[row].any() for record in data) for row in range(len(structure.inputs))]
    still = [name for name, moved in zip(structure.inputs, moves, strict=True) if not moved]
    if not still or (not every_input and any(moves)):
        return
    names = ", ".join(dict.fromkeys(record.name for record in data))
    came = f"{' and '.join(still)} {'does' if len(still) == 1 else 'do'} not move in {names}"
    remedy = "fly an excitation, or choose another part of the log with --segment"
    if pairs := _moving_pairs(structure, moves):
        inputs, outputs = (",".join(side) for side in zip(*pairs, strict=True))
        remedy = (
            f"identify only what moves with --inputs {inputs} --outputs {outputs}, or choose another part with "
            "--segment"
        )
    raise InsufficientDataError(
        came,
        needed="inputs that move",
        remedy=remedy,
        findings=[refusal("no_excitation", name, f"{name} does not move in {names}.") for name in still],
    )


def _moving_pairs(structure: LinearStructure, moves: Sequence[bool]) -> list[tuple[str, str]]:
    """Set-points that move, each with what answers it alone; none where responses are coupled or not to set-points."""
    pairs = []
    for name, moved in zip(structure.inputs, moves, strict=True):
        answers = connected(structure.select(inputs=[name])).outputs
        if not name.endswith("_setpoint") or len(answers) != 1:
            return []
        if moved:
            pairs.append((name, answers[0]))
    return pairs


def _hold(sampled: Sequence[bool], segments: Sequence[Segment]) -> Hold:
    """One hold for all records: a record under the wrong one is early or late by half a step."""
    if all(sampled) or not any(sampled):
        return "zero" if all(sampled) else "first"

    def named(wanted: bool) -> str:
        return ", ".join(
            dict.fromkeys(
                f"{segment.record} at {segment.history.start_s:.1f} s"
                for segment, zero in zip(segments, sampled, strict=True)
                if zero is wanted
            )
        )

    raise UsageError(
        f"inputs are piecewise constant in {named(True)} but continuous in {named(False)}",
        needed="records of one kind",
        remedy="identify each kind separately, or set --hold zero or --hold first for all",
    )


def evenly_stamped(record: FlightRecord, maneuver: Maneuver, channels: Sequence[str]) -> FlightRecord:
    """A record whose samples within a maneuver lie on a uniform clock, if one topic has all channels nearly so.

    Parameters
    ----------
    channels
        What will be read.

    Returns
    -------
    FlightRecord
        The same one where the channels come from several topics, or the stamps stray by half a step or more.
    """
    start_s, stop_s = maneuver.start_s, maneuver.stop_s
    topics = {
        id(topic): topic
        for name in with_ingredients(record, channels)
        for topic, _ in [source_topic(record, name, start_s, stop_s)]
    }
    if len(topics) != 1:
        return record
    topic = next(iter(topics.values()))
    inside = topic.within(start_s, stop_s)
    even = _even(topic.time_s[inside])
    if even is None:
        return record
    time_s = topic.time_s.copy()
    time_s[inside] = even
    stamped = replace(topic, time_s=time_s)
    return replace(record, topics=tuple(stamped if item is topic else item for item in record.topics))


def _even(time_s: FloatArray) -> FloatArray | None:
    """Uniform stamps in place of nearly uniform ones."""
    if time_s.size < 3 or np.diff(time_s).min() <= 0.0:
        return None
    # The ends stay, so that no sample leaves the maneuver.
    even = np.linspace(time_s[0], time_s[-1], time_s.size)
    step = (time_s[-1] - time_s[0]) / (time_s.size - 1)
    return np.asarray(even) if np.abs(time_s - even).max() < _EVEN * step else None


def _as_logged(record: FlightRecord, segment: Segment, name: str) -> bool:
    history = segment.history
    first_s, last_s = float(history.time_s[0]), float(history.time_s[-1])
    topic, _ = source_topic(record, name, first_s, last_s)
    nearest = np.clip(np.searchsorted(topic.time_s, history.time_s - _SAME_STAMP), 0, topic.time_s.size - 1)
    if np.abs(topic.time_s[nearest] - history.time_s).max() > _SAME_STAMP:
        return False
    # A command logged faster than the outputs moved between the samples of the fit.
    logged = topic.time_s[topic.within(first_s - _SAME_STAMP, last_s + _SAME_STAMP)]
    return logged.size == history.time_s.size


def _every_loop(record: FlightRecord, segment: Segment) -> bool:
    """Whether the controller ran no faster than it was logged."""
    rates = [record.parameters[name] for name in _LOOP_RATES if name in record.parameters]
    return bool(rates) and max(rates) < _FASTER * segment.history.sample_rate_hz
