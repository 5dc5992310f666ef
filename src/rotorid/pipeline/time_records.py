"""Maneuvers as records of a time-domain fit: samples as they were logged wherever that is possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Topic
from rotorid.fit.time_data import TimeData
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.building import require_channels, with_ingredients
from rotorid.pipeline.cutting import cut, other_sources
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown
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
) -> TimeRecords:
    """Cut maneuvers out of their logs, without interpolation where all channels share one nearly even clock.

    A command that was held from one stamp to the next loses its steps when it is interpolated between jittery stamps.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or gaps leave nothing.
    """
    channels = (*structure.inputs, *structure.outputs)
    for record, _ in flown:
        require_channels(record, channels)
    even = [(evenly_stamped(record, maneuver, channels), maneuver) for record, maneuver in flown]
    segments, findings = _cut(even, channels, settings, progress)
    # Records of one rate but for their clocks: every sample is one of input and output, so that nothing drifts apart.
    rate_hz = float(np.mean([one.history.sample_rate_hz for one in segments]))
    data = tuple(
        replace(
            TimeData.of(one.history, inputs=structure.inputs, outputs=structure.outputs, name=one.record),
            sample_rate_hz=rate_hz,
        )
        for one in segments
    )
    hold: Hold = (
        ("zero" if _held(even, segments, structure.inputs) else "first") if settings.hold == "auto" else settings.hold
    )
    return TimeRecords(segments, data, hold, findings)


def _cut(
    flown: Sequence[Flown], channels: Sequence[str], settings: IdentifySettings, progress: Callable[[str], None]
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Each record at its own rate where they hardly differ, else all at the rate of the slowest."""
    parts = [cut([item], channels=channels, shifts=settings.shifts, progress=progress) for item in flown]
    segments = tuple(segment for part, _ in parts for segment in part)
    rates = [segment.history.sample_rate_hz for segment in segments]
    if max(rates) > _SAME_RATE * min(rates):
        return cut(flown, channels=channels, shifts=settings.shifts, progress=progress)
    findings = tuple(finding for _, part in parts for finding in part)
    return segments, (*findings, *other_sources(segments, segments, channels))


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


def _held(flown: Sequence[Flown], segments: Sequence[Segment], inputs: Sequence[str]) -> bool:
    """Whether all inputs are commands that stand in the log sample by sample, as they were sent.

    A set-point is held until the next one comes. What goes to the mixer a controller computes in a loop that runs
    faster than most logs: only a log that says otherwise shows every value of it.
    """
    records = {record.source.name: record for record, _ in flown}
    return all(
        (name.endswith(_SENT) or _every_loop(records[one.record], one)) and _as_logged(records[one.record], one, name)
        for one in segments
        for name in inputs
    )


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
