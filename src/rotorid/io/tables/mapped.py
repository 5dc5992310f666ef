"""Named arrays of a file without autopilot knowledge as a flight record, by a mapping.

Files that name their channels themselves, by the names of variables or by column headers with units, give a mapping of
their own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.findings import Finding, remark
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic, units_of
from rotorid.errors import LogError, UsageError
from rotorid.frames import earth_to_body, euler_from_quaternion
from rotorid.io.tables.exporters import foreign_remedy
from rotorid.io.tables.mapping import (
    BODY_VECTORS,
    ONLY_VARIABLE,
    ChannelMapping,
    Clock,
    MappedAttitude,
    MappedChannel,
    Segment,
    Series,
    nearest,
)
from rotorid.io.tables.steps import describe_steps, processed
from rotorid.typing import AnyArray, FloatArray
from rotorid.units import UNITS_AND_ALIASES, factor_to, parse_unit

_COMMON_CLOCK = "clock"
_FIRST = frozenset(channels[0] for channels in BODY_VECTORS.values())


def sources_of(mapping: ChannelMapping) -> tuple[str, ...]:
    """Every name that a mapping looks up in the file, each once."""
    found: list[Series | None] = []
    for run in mapping.each_experiment():
        clock = run.clock or Clock()
        found += [clock.time, clock.steps]
        found += [item for channel in run.channels for item in (channel.samples, channel.time)]
        found += [*run.attitude.parts, run.attitude.time] if run.attitude else []
    return tuple(dict.fromkeys(name for item in found if item is not None for name, _ in item.terms))


def assemble(
    arrays: Mapping[str, FloatArray], mapping: ChannelMapping, source: Source, findings: Iterable[Finding] = ()
) -> FlightRecord:
    """Build the record that a mapping describes.

    Channels with the same stamps share a topic. Several experiments follow each other in it.

    Parameters
    ----------
    arrays
        Variables of the file by name: vectors, or matrices of which the mapping picks a row or a column.
    mapping
        Where each channel stands in this file; of channels in other files see `rotorid.io.registry.read`.
    source
        Name, format and hash of the file.
    findings
        What the reader had to remark.

    Raises
    ------
    UsageError
        The mapping names a variable that the file does not hold, or a part of one that does not exist, or its
        experiments would overlap.
    LogError
        Stamps and samples differ in number, or are not all finite.
    """
    runs = [_topics(arrays, run, source.name) for run in mapping.each_experiment()]
    spacing_s = mapping.experiments.spacing_s if mapping.experiments else 0.0
    topics = tuple(_in_sequence(parts, spacing_s, source.name) for parts in zip(*runs, strict=True))
    # Segments count the samples of the first channel, and so does the length of an experiment.
    sizes = [run[0].time_s.size for run in runs]
    return FlightRecord(
        source=source,
        topics=topics,
        declared=tuple(
            maneuver
            for segment in mapping.segments
            for maneuver in _maneuvers(segment, topics[0].time_s, sizes, source.name)
        ),
        findings=tuple(findings),
    )


def joined(record: FlightRecord, others: Mapping[str, FlightRecord]) -> FlightRecord:
    """One record out of those of several files, whose channels then say which file they came from.

    Topics with the same stamps become one. The hash of the record covers all files.

    Parameters
    ----------
    record
        What the log holds.
    others
        What the other files hold, by the names that the mapping gave them.
    """
    if not others:
        return record
    topics = list(record.topics)
    for name, other in others.items():
        for topic in other.topics:
            channels = tuple(replace(channel, source=f"{name}:{channel.source}") for channel in topic.channels)
            _add(topics, replace(topic, channels=channels))
    total = hashlib.sha256(record.source.sha256.encode())
    for name, other in others.items():
        total.update(f"\0{name}\0{other.source.sha256}".encode())
    return replace(
        record,
        source=replace(record.source, sha256=total.hexdigest()),
        topics=tuple(topics),
        findings=(*record.findings, *(finding for other in others.values() for finding in other.findings)),
    )


def _add(topics: list[Topic], new: Topic) -> None:
    for place, topic in enumerate(topics):
        if topic.name == new.name and np.array_equal(topic.time_s, new.time_s):
            topics[place] = replace(
                topic, channels=(*topic.channels, *new.channels), values=np.concatenate([topic.values, new.values])
            )
            return
    topics.append(new)


def _topics(arrays: Mapping[str, FloatArray], mapping: ChannelMapping, file: str) -> tuple[Topic, ...]:
    """Topics of one experiment on its own clock."""
    groups: dict[Series | None, list[MappedChannel]] = {}
    for channel in mapping.channels:
        groups.setdefault(channel.time, []).append(channel)
    if mapping.attitude is not None:
        groups.setdefault(mapping.attitude.time, [])
    return tuple(_topic(time, channels, mapping, arrays, file) for time, channels in groups.items())


def _topic(
    time: Series | None,
    channels: list[MappedChannel],
    mapping: ChannelMapping,
    arrays: Mapping[str, FloatArray],
    file: str,
) -> Topic:
    meta = [
        Channel(name=channel.name, unit=channel.si, source=describe_steps(_named(channel.samples, arrays)))
        for channel in channels
    ]
    angles: list[FloatArray] = []
    if mapping.attitude is not None and mapping.attitude.time == time:
        of_angles = _named(mapping.attitude.parts[0], arrays).source
        meta += [Channel(name=name, unit="rad", source=of_angles) for name in ATTITUDE]
        angles = _angles(mapping.attitude, arrays, file)
    first = _samples(channels[0].samples, arrays, channels[0].si, file) if channels else angles[0]
    time_s = _stamps(time, mapping.clock, arrays, first.size, file)
    # Of a long log each copy of all samples is a good part of the memory: rows are made one by one.
    values = np.empty((len(meta), time_s.size))
    for place, channel in enumerate(meta):
        own = channels[place] if place < len(channels) else None
        row = angles[place - len(channels)] if own is None else _samples(own.samples, arrays, own.si, file)
        if row.size != time_s.size:
            raise LogError(
                f"{file}: {channel.source} has {row.size} samples and its clock {time_s.size} stamps",
                needed="as many of the one as of the other",
                remedy="name the right `time` in the mapping, or the right `row` or `column`",
            )
        values[place] = row if own is None else processed(own.samples, time_s, row, file)
    for place, own in enumerate(channels):
        # Vectors stand component by component: forward, right, down.
        if own.along_world and own.name in _FIRST:
            rows = slice(place, place + 3)
            values[rows] = earth_to_body(np.stack(angles), values[rows])
    name = _named(time, arrays).source if time else _COMMON_CLOCK
    return Topic(name=name, time_s=time_s, channels=tuple(meta), values=values, of_table=True)


def _angles(attitude: MappedAttitude, arrays: Mapping[str, FloatArray], file: str) -> list[FloatArray]:
    """Roll, pitch and yaw, within half a turn, of a quaternion in the frames of the file."""
    parts = [_samples(part, arrays, "1", file) for part in attitude.parts]
    if len({part.size for part in parts}) > 1:
        raise LogError(
            f"{file}: the parts of the quaternion have {', '.join(str(part.size) for part in parts)} samples",
            needed="as many of each",
            remedy="correct `sources` in [vectors.quaternion]",
        )
    quaternion = np.stack(parts)
    if not np.all(np.any(quaternion != 0.0, axis=0)):
        first = int(np.flatnonzero(np.all(quaternion == 0.0, axis=0))[0])
        raise LogError(
            f"{file}: sample {first + 1} of the quaternion is zero",
            needed="an attitude in every sample",
            remedy="leave the affected samples out before the file is read",
        )
    raw = euler_from_quaternion(quaternion)
    turned = [sign * angle + offset for angle, (sign, offset) in zip(raw, attitude.angles, strict=True)]
    return [np.arctan2(np.sin(angle), np.cos(angle)) for angle in turned]


def _in_sequence(parts: Sequence[Topic], spacing_s: float, file: str) -> Topic:
    """Experiments one after another; the first stays where it is."""
    if len(parts) == 1:
        return parts[0]
    clocks = [part.time_s + number * spacing_s for number, part in enumerate(parts)]
    for number, (before, after) in enumerate(pairwise(clocks), start=2):
        if before.size and after.size and not before.max() < after.min():
            raise UsageError(
                f"{file}: experiment {number} begins at {after.min():.6g} s, and the one before ends at "
                f"{before.max():.6g} s",
                needed="experiments that follow each other",
                remedy=f"write spacing_s = {np.ceil(spacing_s + before.max() - after.min() + 10.0):.0f} or more in "
                "[experiments]",
            )
    return replace(
        parts[0], time_s=np.concatenate(clocks), values=np.concatenate([part.values for part in parts], axis=1)
    )


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
    series = _named(series, arrays)
    vectors = [_vector(replace(series, source=name), arrays, file) for name, _ in series.terms]
    if len({vector.size for vector in vectors}) > 1:
        raise LogError(
            f"{file}: the parts of {series.source} have {', '.join(str(vector.size) for vector in vectors)} samples",
            needed="as many of each",
            remedy="correct `sum` in the mapping",
        )
    # A sum of one with the factor one would be a copy of a long log.
    vector = (
        vectors[0]
        if not series.parts
        else sum(
            (factor * part for (_, factor), part in zip(series.parts, vectors, strict=True)), np.zeros(vectors[0].size)
        )
    )
    if series.logged_range:
        low, high = float(vector.min(initial=np.inf)), float(vector.max(initial=-np.inf))
        if not low < high:
            raise LogError(
                f"{file}: {series.source} is {low:g} throughout",
                needed="numbers that differ, for a share between the smallest and the largest",
                remedy="write `range` = [LOW, HIGH] in the mapping",
            )
        return (vector - low) / (high - low)
    factor = series.scale * factor_to(si, series.unit)
    return (vector + series.offset) * factor if series.offset else vector * factor


def _vector(series: Series, arrays: Mapping[str, FloatArray], file: str) -> FloatArray:
    """One variable as it stands in the file."""
    if series.source not in arrays:
        close = nearest(series.source, arrays)
        raise UsageError(
            f"{file} contains no {series.source!r}",
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
    return vector


def _named(series: Series, arrays: Mapping[str, FloatArray]) -> Series:
    """A series of the only variable of a file by the name that the variable has there."""
    if series.source == ONLY_VARIABLE and len(arrays) == 1:
        return replace(series, source=next(iter(arrays)))
    return series


def _picked(series: Series, array: FloatArray, file: str) -> FloatArray:
    if series.row is None and series.column is None:
        if array.ndim > 1:
            raise UsageError(
                f"{file}: {series.source} is a matrix of {' by '.join(map(str, array.shape))}",
                needed="a vector",
                remedy="pick one with `row = 0` or `column = 0` in the mapping",
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


def _maneuvers(segment: Segment, time_s: FloatArray, sizes: Sequence[int], file: str) -> list[Maneuver]:
    """A segment on the clock of the record; one for each experiment when it names no interval."""
    if segment.start_s is not None and segment.stop_s is not None:
        spans = [(segment.start_s, segment.stop_s)]
    elif segment.start_sample is not None and segment.stop_sample is not None:
        if segment.stop_sample >= time_s.size:
            raise UsageError(
                f"{file}: a segment stops at sample {segment.stop_sample}",
                needed=f"at most {time_s.size - 1}",
                remedy="correct stop_sample in the mapping",
            )
        spans = [(float(time_s[segment.start_sample]), float(time_s[segment.stop_sample]))]
    else:
        stops = np.cumsum(sizes)
        spans = [(float(time_s[stop - size]), float(time_s[stop - 1])) for size, stop in zip(sizes, stops, strict=True)]
    backward = next((span for span in spans if not span[0] < span[1]), None)
    if backward is not None:
        raise LogError(
            f"{file}: a segment goes from {backward[0]:.6g} s to {backward[1]:.6g} s",
            needed="stamps that rise from its first sample to its last",
            remedy="correct the interval in [segments], or the clock",
        )
    return [
        Maneuver(
            axis=segment.axis,
            kind=segment.kind,
            start_s=start_s,
            stop_s=stop_s,
            # Whoever says what was flown declares it; a bare interval is still to be looked at.
            origin="given" if segment.kind == "other" else "declared",
            signal=segment.signal,
            band_rad_s=segment.band_rad_s,
        )
        for start_s, stop_s in spans
    ]


HEADER_RULE = "a header `time [s],NAME [UNIT],...` with names such as pitch_command, q, az"

_IDENTIFICATION_DATA = (("OutputData", "InputData"), ("y", "u"))
_INSTANTS = "SamplingInstants"


def by_variables(names: Collection[str], file: str) -> ChannelMapping:
    """The mapping that says the names mean themselves, in SI units, for variables next to the one called ``time``.

    Parameters
    ----------
    names
        Variables of the file; those inside of a struct carry its name and a dot in front.
    file
        What the messages call the file.

    Raises
    ------
    LogError
        There is not exactly one ``time``, or nothing next to it has a name of the vocabulary.

    Examples
    --------
    >>> [channel.name for channel in by_variables(["flight.time", "flight.q", "other"], "x.npz").channels]
    ['q']
    """
    clocks = [name for name in names if name.rpartition(".")[2] == "time"]
    prefix = clocks[0].removesuffix("time") if clocks else ""
    channels = tuple(
        MappedChannel(name=label, samples=Series(source=name))
        for name in names
        if name.startswith(prefix) and (label := name.removeprefix(prefix)) in STANDARD_UNITS
    )
    if len(clocks) != 1 or not channels:
        available = ", ".join(list(names)[:20]) or "no numbers at all"
        raise LogError(
            f"{file} contains {available}",
            needed="one variable `time` (s) and variables with names such as pitch_command, q, az",
            remedy=foreign_remedy(list(names)) or "name its variables with a mapping: --map FILE.toml",
        )
    return ChannelMapping(channels=channels, clock=Clock(time=Series(source=clocks[0])))


def of_columns(
    columns: Sequence[str], mapping: ChannelMapping | None, file: str
) -> tuple[ChannelMapping, tuple[Finding, ...]]:
    """The mapping of a table: the given one, if the table has its columns, else the one that the header spells out.

    Raises
    ------
    UsageError
        The mapping names a column that does not exist.
    LogError
        See :func:`by_header`.
    """
    if mapping is None:
        return by_header(columns, file)
    mapping = _with_full_names(mapping, columns)
    missing = [name for name in sources_of(mapping) if name not in columns]
    if missing:
        close = nearest(missing[0], columns)
        raise UsageError(
            f"{file} has no column {missing[0]!r}",
            needed=f"one of {', '.join(columns[:30])}",
            remedy=f"did you mean {close}?" if close else "correct `source` or `time` in the mapping",
        )
    return mapping, ()


def _with_full_names(mapping: ChannelMapping, columns: Sequence[str]) -> ChannelMapping:
    """A mapping that may leave out the units behind the names of the columns; they then are those of the columns.

    Raises
    ------
    UsageError
        The mapping gives a column another unit than its header does.
    """
    bare: dict[str, list[str]] = {}
    for column in columns:
        bare.setdefault(_name_and_unit(column)[0], []).append(column)

    def full(series: Series | None) -> Series | None:
        if series is None or series.source in columns or len(found := bare.get(series.source.lstrip("%"), [])) != 1:
            return series
        unit = _name_and_unit(found[0])[1]
        known = unit in UNITS_AND_ALIASES
        if known and series.unit and parse_unit(series.unit) != parse_unit(unit):
            raise UsageError(
                f"the mapping gives {series.source} the unit {series.unit!r}, and its column is {found[0]!r}",
                needed="the same unit",
                remedy=f'write unit = "{unit}", or source = "{found[0]}" if the header is wrong',
            )
        return replace(series, source=found[0], unit=series.unit or (unit if known else ""))

    def required(series: Series) -> Series:
        if not series.parts:
            return full(series) or series
        found = [required(replace(series, source=name, parts=())) for name, _ in series.parts]
        units = {item.unit for item in found}
        if len(units) > 1:
            raise UsageError(
                f"the mapping adds up {series.source}, in {', '.join(sorted(unit or 'no unit' for unit in units))}",
                needed="one unit",
                remedy="write the factors of `sum` in that unit, and `unit`",
            )
        parts = tuple((item.source, factor) for item, (_, factor) in zip(found, series.parts, strict=True))
        return replace(series, parts=parts, unit=units.pop())

    clock, attitude = mapping.clock, mapping.attitude
    if attitude is not None:
        w, x, y, z = (required(part) for part in attitude.parts)
        attitude = replace(attitude, parts=(w, x, y, z), time=full(attitude.time))
    return replace(
        mapping,
        channels=tuple(
            replace(channel, samples=required(channel.samples), time=full(channel.time)) for channel in mapping.channels
        ),
        attitude=attitude,
        clock=clock and replace(clock, time=full(clock.time), steps=full(clock.steps)),
    )


def by_header(header: Sequence[str], file: str) -> tuple[ChannelMapping, tuple[Finding, ...]]:
    """The mapping that the columns ``name [unit]`` of a table spell out, and what was left out.

    Parameters
    ----------
    header
        Names of the columns; the first one is ``time [s]``.
    file
        What the messages call the file.

    Raises
    ------
    LogError
        The first column is not the time, or no column has a name of the vocabulary.
    UsageError
        A unit is unknown or does not measure what the channel holds.

    Examples
    --------
    >>> mapping, findings = by_header(["time [s]", "q [deg/s]", "note"], "x.csv")
    >>> mapping.channels[0].samples.unit, findings[0].kind
    ('deg/s', 'unknown_column')
    """
    names = [_name_and_unit(cell) for cell in header]
    clock = _clock_column(names)
    # A table of a known program may call columns like channels and mean other axes.
    if clock is None or foreign_remedy(header):
        raise _no_header(header, file, named=clock is not None)
    channels: list[MappedChannel] = []
    findings: list[Finding] = []
    for place, (cell, (name, unit)) in enumerate(zip(header, names, strict=True)):
        if place == clock[0]:
            continue
        if name in STANDARD_UNITS:
            _check_unit(name, unit, cell, file)
            if twin := next((channel.samples.source for channel in channels if channel.name == name), None):
                raise LogError(
                    f"{file} has two columns for {name}, {twin!r} and {cell!r}",
                    needed="each channel once",
                    remedy="rename or delete one of them",
                )
            channels.append(MappedChannel(name=name, samples=Series(source=cell, unit=unit)))
        else:
            findings.append(_unknown(cell, name))
    if not channels:
        raise _no_header(header, file, named=True)
    place, unit = clock
    _check_unit("time", unit, header[place], file)
    return ChannelMapping(channels=tuple(channels), clock=Clock(time=Series(source=header[place], unit=unit))), tuple(
        findings
    )


def columns_that_name_themselves(header: Sequence[str]) -> list[str]:
    """The stamps and the channels among the columns ``name [unit]`` of a table.

    Examples
    --------
    >>> columns_that_name_themselves(["t", "q [deg/s]", "note"])
    ['t', 'q [deg/s]']
    """
    names = [_name_and_unit(cell) for cell in header]
    clock = _clock_column(names)
    return [
        cell
        for place, (cell, (name, _)) in enumerate(zip(header, names, strict=True))
        if name in STANDARD_UNITS or (clock is not None and place == clock[0])
    ]


_SECONDS = ("time", "t", "__time", "time_s", "elapsed_time", "elapsed time")
_SUFFIXES = ("s", "ms", "us", "ns")


def _clock_column(names: Sequence[tuple[str, str]]) -> tuple[int, str] | None:
    """Place and unit of the stamps: ``time`` in seconds, or a stamp whose unit is behind it or in its name."""
    for place, (name, unit) in enumerate(names):
        lower = name.lower()
        if lower in _SECONDS or (lower in ("timestamp", "stamp") and unit):
            return place, unit
        stem, _, suffix = lower.rpartition("_")
        if stem in ("time", "timestamp", "stamp", "t") and suffix in _SUFFIXES and not unit:
            return place, suffix
    return None


def sampling_instants(arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Clocks of structs that hold identification data, under the name that MATLAB gives to them.

    A struct with ``OutputData``, ``InputData`` and ``Ts`` (or ``y``, ``u`` and ``Ts``), as the fields of an ``iddata``
    object are called, has a sampling period and no stamps. They are ``Tstart + Ts k``; MATLAB starts at ``Ts`` where
    ``Tstart`` is not given, and so does this. A mapping asks for them by ``STRUCT.SamplingInstants``.

    Parameters
    ----------
    arrays
        Variables of the file by dotted names, seconds.

    Examples
    --------
    >>> data = {"z.OutputData": np.zeros(3), "z.InputData": np.zeros(3), "z.Ts": np.array(0.5)}
    >>> sampling_instants(data)["z.SamplingInstants"].tolist()
    [0.5, 1.0, 1.5]
    """
    instants: dict[str, AnyArray] = {}
    for name, period in arrays.items():
        prefix = name.removesuffix("Ts")
        if prefix == name or (prefix and not prefix.endswith(".")) or f"{prefix}{_INSTANTS}" in arrays:
            continue
        outputs = next((y for y, u in _IDENTIFICATION_DATA if {f"{prefix}{y}", f"{prefix}{u}"} <= arrays.keys()), None)
        if outputs is None or period.size != 1 or not 0.0 < float(period.ravel()[0]) < np.inf:
            continue
        step_s = float(period.ravel()[0])
        start = arrays.get(f"{prefix}Tstart", np.empty(0)).ravel()
        start_s = float(start[0]) if start.size == 1 and np.isfinite(start[0]) else step_s
        # Samples are rows; of data that were squeezed to one channel there is but one axis.
        count = arrays[f"{prefix}{outputs}"].shape[:1]
        instants[f"{prefix}{_INSTANTS}"] = start_s + step_s * np.arange(*(count or (1,)))
    return instants


def _name_and_unit(cell: str) -> tuple[str, str]:
    """A name, and the unit in brackets or, where it is one, in parentheses behind it."""
    bare = cell.strip()
    if "[" not in bare and bare.endswith(")"):
        name, parenthesis, unit = bare[:-1].rpartition("(")
        known = parenthesis and unit.strip() in UNITS_AND_ALIASES
        return (name.strip(), unit.strip()) if known else (bare, "")
    name, _, rest = cell.partition("[")
    return name.strip(), rest.rstrip().removesuffix("]").strip()


def _no_header(header: Sequence[str], file: str, *, named: bool = False) -> LogError:
    """The error of a table whose header names no channels: whose table it is, where that shows, and what to type."""
    first = repr(header[0]) if header else "missing"
    came = (
        f"{file} has the columns {', '.join(header[:20])}"
        if named
        else (f"{file} is a table whose first column is {first}")
    )
    remedy = "correct the header, or name the columns with a mapping: --map FILE.toml"
    if header and _name_and_unit(header[0])[0].lower() in ("timestamp", "stamp"):
        remedy = f"write the unit behind the stamps, as in {header[0]} [us], or {remedy.partition(', or ')[2]}"
    if first == repr("timestamp"):
        remedy += "; a topic of a PX4 log that ulog2csv wrote is read with the others: give their folder"
    return LogError(came, needed=HEADER_RULE, remedy=foreign_remedy(header) or remedy)


def _check_unit(name: str, unit: str, cell: str, file: str) -> None:
    needed = units_of(name) or ("s",)
    try:
        found = parse_unit(unit).si if unit else needed[0]
    except UsageError as error:
        raise UsageError(f"{file}, column {cell!r}: {error.came}", needed=error.needed, remedy=error.remedy) from error
    if found not in {parse_unit(one).si for one in needed}:
        raise UsageError(
            f"{file}, column {cell!r} has the unit {unit!r}",
            needed=f"a unit of {' or '.join(needed)}",
            remedy="correct the header",
        )


def _unknown(cell: str, name: str) -> Finding:
    close = nearest(name, STANDARD_UNITS)
    return remark(
        "unknown_column",
        cell or "(no name)",
        f"The column {cell!r} has no name of the vocabulary and was left out."
        + (f" Did you mean {close}?" if close else ""),
    )
