"""Named arrays of a file without autopilot knowledge become a flight record, by a mapping."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import LogError, UsageError
from rotorid.io.mapping import ChannelMapping, Clock, MappedChannel, Segment, Series, nearest
from rotorid.typing import FloatArray
from rotorid.units import parse_unit

_COMMON_CLOCK = "clock"


def sources_of(mapping: ChannelMapping) -> tuple[str, ...]:
    """Every name that a mapping looks up in the file, each once."""
    clock = mapping.clock or Clock()
    series = [clock.time, clock.steps]
    series += [item for channel in mapping.channels for item in (channel.samples, channel.time)]
    return tuple(dict.fromkeys(item.source for item in series if item is not None))


def assemble(
    arrays: Mapping[str, FloatArray], mapping: ChannelMapping, source: Source, findings: Iterable[Finding] = ()
) -> FlightRecord:
    """Build the record that a mapping describes.

    Channels with the same stamps share a topic.

    Parameters
    ----------
    arrays
        Variables of the file by name: vectors, or matrices of which the mapping picks a row or a column.
    mapping
        Where each channel stands.
    source
        Name, format and hash of the file.
    findings
        What the reader had to remark.

    Raises
    ------
    UsageError
        The mapping names a variable that the file does not hold, or a part of one that does not exist.
    LogError
        Stamps and samples differ in number, or are not all finite.
    """
    groups: dict[Series | None, list[MappedChannel]] = {}
    for channel in mapping.channels:
        groups.setdefault(channel.time, []).append(channel)
    topics = tuple(_topic(time, channels, mapping.clock, arrays, source.name) for time, channels in groups.items())
    return FlightRecord(
        source=source,
        topics=topics,
        declared=tuple(_maneuver(segment, topics[0].time_s, source.name) for segment in mapping.segments),
        findings=tuple(findings),
    )


def _topic(
    time: Series | None,
    channels: list[MappedChannel],
    clock: Clock | None,
    arrays: Mapping[str, FloatArray],
    file: str,
) -> Topic:
    rows = [_samples(channel.samples, arrays, STANDARD_UNITS[channel.name], file) for channel in channels]
    time_s = _stamps(time, clock, arrays, rows[0].size, file)
    for channel, row in zip(channels, rows, strict=True):
        if row.size != time_s.size:
            raise LogError(
                f"{file}: {channel.samples.source} has {row.size} samples and its clock {time_s.size} stamps",
                needed="as many of the one as of the other",
                remedy="name the right `time` in the mapping, or the right `row` or `column`",
            )
    meta = tuple(
        Channel(name=channel.name, unit=STANDARD_UNITS[channel.name], source=channel.samples.source)
        for channel in channels
    )
    return Topic(name=time.source if time else _COMMON_CLOCK, time_s=time_s, channels=meta, values=np.stack(rows))


def _stamps(
    own: Series | None, clock: Clock | None, arrays: Mapping[str, FloatArray], n_samples: int, file: str
) -> FloatArray:
    if own is not None:
        return _samples(own, arrays, "s", file)
    assert clock is not None  # parse_mapping sees to it that every channel has a clock
    if clock.time is not None:
        return _samples(clock.time, arrays, "s", file)
    if clock.steps is not None:
        steps = _samples(clock.steps, arrays, "s", file)
        # The step after the last sample leads nowhere; n - 1 steps are as good as n.
        return np.concatenate([[0.0], np.cumsum(steps[: n_samples - 1])])
    assert clock.sample_rate_hz is not None
    return np.arange(n_samples) / clock.sample_rate_hz


def _samples(series: Series, arrays: Mapping[str, FloatArray], si: str, file: str) -> FloatArray:
    if series.source not in arrays:
        close = nearest(series.source, arrays)
        raise UsageError(
            f"{file} holds no {series.source!r}",
            needed="one of " + ", ".join(list(arrays)[:30]) if arrays else "a numeric variable",
            remedy=f"did you mean {close}?" if close else "correct `source` or `time` in the mapping",
        )
    vector = _picked(series, arrays[series.source], file)
    if not np.isfinite(vector).all():
        first = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise LogError(
            f"{file}: sample {first + 1} of {series.source} is {vector[first]}, not a finite number",
            needed="samples without gaps",
            remedy="leave the affected samples out, or fill them in before the file is read",
        )
    factor = series.scale * parse_unit(series.unit or si).factor
    return vector * factor


def _picked(series: Series, array: FloatArray, file: str) -> FloatArray:
    if series.row is None and series.column is None:
        if array.ndim > 1:
            raise UsageError(
                f"{file}: {series.source} is a matrix of {' by '.join(map(str, array.shape))}",
                needed="a vector",
                remedy="pick one of it by `row = 0` or `column = 0` in the mapping",
            )
        return np.atleast_1d(array)
    axis, index = (0, series.row) if series.row is not None else (1, series.column)
    assert index is not None
    count = array.shape[axis] if array.ndim == 2 else 0
    if index >= count:
        raise UsageError(
            f"{file}: {series.source} of shape {array.shape} has no {('row', 'column')[axis]} {index}",
            needed=f"a number from 0 to {count - 1}" if count else "a matrix",
            remedy="count from zero" if count else "remove `row` or `column` from the mapping",
        )
    picked: FloatArray = np.take(array, index, axis=axis)
    return picked


def _maneuver(segment: Segment, time_s: FloatArray, file: str) -> Maneuver:
    start_s, stop_s = segment.start_s, segment.stop_s
    if segment.start_sample is not None and segment.stop_sample is not None:
        if segment.stop_sample >= time_s.size:
            raise UsageError(
                f"{file}: a segment stops at sample {segment.stop_sample}",
                needed=f"at most {time_s.size - 1}",
                remedy="correct stop_sample in the mapping",
            )
        start_s, stop_s = float(time_s[segment.start_sample]), float(time_s[segment.stop_sample])
    assert start_s is not None
    assert stop_s is not None
    return Maneuver(axis=segment.axis, kind=segment.kind, start_s=start_s, stop_s=stop_s, origin="given")
