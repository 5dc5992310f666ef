"""Maneuvers as records of a time-domain fit: samples as they were logged wherever that is possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.time_data import TimeData
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.building import require_channels, with_ingredients
from rotorid.pipeline.cutting import cut, other_sources
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.resolve import black_box_order
from rotorid.pipeline.settings import IdentifySettings
from rotorid.signal.clock import source_topic
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray

_EVEN = 0.5
"""Stamps that stray from a uniform clock by less than this share of a step name samples of that clock."""

_SAME_STAMP = 1e-6
_SAME_RATE = 1.002
_LOOP_RATES = ("SCHED_LOOP_RATE", "IMU_GYRO_RATEMAX")
_FASTER = 1.2
_SENT = ("_setpoint", "_excitation", "_stick")


class TimeRecords(NamedTuple):
    """What a time-domain fit is made to.

    Parameters
    ----------
    segments
        Maneuvers with their histories.
    data
        The same as inputs and outputs of the structure.
    hold
        What the inputs do between their samples.
    findings
        Remarks on the way.
    """

    segments: tuple[Segment, ...]
    data: tuple[TimeData, ...]
    hold: Hold
    findings: tuple[Finding, ...]


def time_records(
    structure: LinearStructure,
    flown: Sequence[Flown],
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
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
    flown
        Records and maneuvers.
    settings
        Whose hold and shifts count.
    progress
        Told what is being done.
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
    for record, _ in flown:
        require_channels(record, channels)
    even = [(evenly_stamped(record, maneuver, channels), maneuver) for record, maneuver in flown]
    parts = [_cut([item], channels, settings, progress) for item in even]
    if black_box_order(structure) is not None and not _of_one_rate([one for part in parts for one in part.segments]):
        parts = [_cut(even, channels, settings, progress)]
    segments = tuple(segment for part in parts for segment in part.segments)
    data = _data(structure, segments)
    _require_motion(structure, data, every_input=every_input)
    findings = (*(f for part in parts for f in part.findings), *other_sources(segments, segments, channels))
    holds = [held for part in parts for held in part.held(structure.inputs)]
    hold = _hold(holds, segments) if settings.hold == "auto" else settings.hold
    return TimeRecords(segments, data, hold, findings)


class _Cut(NamedTuple):
    """Maneuvers of one rate, with the records that they were cut out of."""

    flown: Sequence[Flown]
    segments: tuple[Segment, ...]
    findings: tuple[Finding, ...]

    def held(self, inputs: Sequence[str]) -> list[bool]:
        """Whether all inputs of a segment are commands that stand in the log sample by sample, as they were sent.

        A set-point is held until the next one comes. What goes to the mixer a controller computes in a loop that runs
        faster than most logs: only a log that says otherwise shows every value of it.
        """
        records = {record.source.name: record for record, _ in self.flown}
        return [
            all(
                (name.endswith(_SENT) or _every_loop(records[one.record], one))
                and _as_logged(records[one.record], one, name)
                for name in inputs
            )
            for one in self.segments
        ]


def _cut(
    flown: Sequence[Flown], channels: Sequence[str], settings: IdentifySettings, progress: Callable[[str], None]
) -> _Cut:
    return _Cut(flown, *cut(flown, channels=channels, shifts=settings.shifts, progress=progress))


def _of_one_rate(segments: Sequence[Segment]) -> bool:
    rates = [one.history.sample_rate_hz for one in segments]
    return max(rates) <= _SAME_RATE * min(rates)


def _data(structure: LinearStructure, segments: Sequence[Segment]) -> tuple[TimeData, ...]:
    """Segments as inputs and outputs, each at its own rate."""
    data = tuple(
        TimeData.of(one.history, inputs=structure.inputs, outputs=structure.outputs, name=one.record)
        for one in segments
    )
    if not _of_one_rate(segments):
        return data
    # Of one rate but for their clocks: every sample is one of input and output, so that nothing drifts apart.
    rate_hz = float(np.mean([one.sample_rate_hz for one in data]))
    return tuple(replace(one, sample_rate_hz=rate_hz) for one in data)


def _require_motion(structure: LinearStructure, data: Sequence[TimeData], *, every_input: bool) -> None:
    """Raise where an input, or all of them, stand still in every record: then nothing can be learned of it."""
    moves = [any(one.inputs[row].any() for one in data) for row in range(len(structure.inputs))]
    still = [name for name, moved in zip(structure.inputs, moves, strict=True) if not moved]
    if not still or (not every_input and any(moves)):
        return
    names = ", ".join(dict.fromkeys(one.name for one in data))
    came = f"{' and '.join(still)} {'does' if len(still) == 1 else 'do'} not move in {names}"
    raise InsufficientDataError(
        came,
        needed="inputs that move",
        remedy="fly an excitation, or choose another part of the log with --segment",
        findings=[
            Finding(kind="no_excitation", severity="error", where=name, message=f"{name} does not move in {names}.")
            for name in still
        ],
    )


def _hold(held: Sequence[bool], segments: Sequence[Segment]) -> Hold:
    """One hold for all records: a record under the wrong one is early or late by half a step."""
    if all(held) or not any(held):
        return "zero" if all(held) else "first"

    def named(wanted: bool) -> str:
        return ", ".join(
            dict.fromkeys(
                f"{one.record} at {one.history.start_s:.1f} s"
                for one, zero in zip(segments, held, strict=True)
                if zero is wanted
            )
        )

    raise UsageError(
        f"inputs stand in {named(True)} sample by sample, as they were sent, and in {named(False)} between samples",
        needed="records of one kind",
        remedy="identify on each kind alone, or say with --hold zero or --hold first what holds for all",
    )


def evenly_stamped(record: FlightRecord, maneuver: Maneuver, channels: Sequence[str]) -> FlightRecord:
    """A record whose samples within a maneuver lie on a uniform clock, if one topic holds all channels nearly so.

    Parameters
    ----------
    record, maneuver
        What was flown.
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
    inside = (topic.time_s >= start_s) & (topic.time_s <= stop_s)
    even = _even(topic.time_s[inside])
    if even is None:
        return record
    time_s = topic.time_s.copy()
    time_s[inside] = even
    stamped = Topic(name=topic.name, time_s=time_s, channels=topic.channels, values=topic.values)
    return replace(record, topics=tuple(stamped if one is topic else one for one in record.topics))


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
    logged = np.count_nonzero((topic.time_s >= first_s - _SAME_STAMP) & (topic.time_s <= last_s + _SAME_STAMP))
    return int(logged) == history.time_s.size


def _every_loop(record: FlightRecord, segment: Segment) -> bool:
    """Whether the log says that its controller ran no faster than it was logged."""
    rates = [record.parameters[name] for name in _LOOP_RATES if name in record.parameters]
    return bool(rates) and max(rates) < _FASTER * segment.history.sample_rate_hz
