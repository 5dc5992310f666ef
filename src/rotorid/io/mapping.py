"""Mapping files: the user's own names for the channels of a CSV or MAT file, in TOML."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

from rotorid.data.channel import AXES, STANDARD_UNITS
from rotorid.data.maneuver import Kind
from rotorid.errors import UsageError
from rotorid.typing import Axis
from rotorid.units import parse_unit

_CHANNEL_KEYS = ("source", "time", "unit", "scale", "row", "column", "time_unit")
_CLOCK_KEYS = ("time", "steps", "sample_rate_hz")
_SERIES_KEYS = ("source", "unit", "row", "column")
_SEGMENT_KEYS = ("start_s", "stop_s", "start_sample", "stop_sample", "axis", "kind")


@dataclass(frozen=True, kw_only=True, slots=True)
class Series:
    """One row of numbers in a foreign file.

    Parameters
    ----------
    source
        Variable, struct field by dots, or column name.
    unit
        Unit of the numbers as they stand in the file; empty means SI.
    scale
        Sign and factor, applied before the unit is converted.
    row, column
        Which one of a matrix, counted from zero; at most one of them.
    """

    source: str
    unit: str = ""
    scale: float = 1.0
    row: int | None = None
    column: int | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Clock:
    """Stamps for the channels that have none of their own: exactly one of the three.

    Parameters
    ----------
    time
        The stamps themselves.
    steps
        Differences of the stamps: from each sample to the next. The first stamp is zero.
    sample_rate_hz
        A uniform clock that starts at zero.
    """

    time: Series | None = None
    steps: Series | None = None
    sample_rate_hz: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class MappedChannel:
    """A channel of the vocabulary, where its samples stand, and its own stamps if it has some."""

    name: str
    samples: Series
    time: Series | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Segment:
    """A part of the record to use, by time on the log's own clock or by sample of the first channel; one of the two."""

    axis: Axis
    kind: Kind = "other"
    start_s: float | None = None
    stop_s: float | None = None
    start_sample: int | None = None
    stop_sample: int | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ChannelMapping:
    """What a mapping file says.

    Parameters
    ----------
    channels
        At least one.
    clock
        Clock of the channels without their own.
    segments
        Parts of the record that were excited.
    """

    channels: tuple[MappedChannel, ...]
    clock: Clock | None = None
    segments: tuple[Segment, ...] = ()


def read_mapping(path: Path) -> ChannelMapping:
    """Read a mapping file.

    Raises
    ------
    UsageError
        The file is missing, is no TOML, or says something impossible; the message names the key.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(
            f"the mapping {path} cannot be opened: {error.strerror or error}",
            needed="a TOML file with a table [channels.NAME] for each channel",
            remedy="check the path given to --map",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(
            f"the mapping {path.name} is no TOML: {error}",
            needed='text as in `[channels.q]` followed by `source = "gyro_y"`',
            remedy="correct the line",
        ) from error
    return parse_mapping(document, path.name)


def parse_mapping(document: Mapping[str, Any], where: str = "mapping") -> ChannelMapping:
    """Check a mapping that was read from TOML, and give it types.

    Parameters
    ----------
    document
        Tables ``channels``, and optionally ``clock`` and ``segments``.
    where
        What the messages call it.

    Raises
    ------
    UsageError
        A key is unknown or missing, a value has the wrong type, a channel is not of the vocabulary, or a unit does not
        measure what the channel holds.

    Examples
    --------
    >>> document = {"clock": {"sample_rate_hz": 250.0}, "channels": {"q": {"source": "gyro", "unit": "deg/s"}}}
    >>> mapping = parse_mapping(document)
    >>> mapping.channels[0].samples.source
    'gyro'
    """
    _only_keys(document, ("clock", "channels", "segments"), where)
    tables = _table(document.get("channels", {}), f"{where}: [channels]")
    if not tables:
        raise UsageError(f"{where} names no channel", needed="a table [channels.NAME]", remedy="add one per channel")
    clock = _clock(document["clock"], f"{where}: [clock]") if "clock" in document else None
    channels = tuple(_channel(name, table, f"{where}: [channels.{name}]") for name, table in tables.items())
    for channel in channels:
        if clock is None and channel.time is None:
            raise UsageError(
                f"{where}: [channels.{channel.name}] has no stamps",
                needed="a key `time` in it, or a table [clock] for all",
                remedy="add one of them; `sample_rate_hz = 250.0` in [clock] is enough for a uniform rate",
            )
    return ChannelMapping(channels=channels, clock=clock, segments=_segments(document, channels, where))


def nearest(name: str, known: Iterable[str]) -> str:
    """The known names that look most like ``name``, as words for a message; empty when none does.

    Examples
    --------
    >>> nearest("pich_command", ["pitch_command", "yaw_command", "battery_voltage"])
    'pitch_command, yaw_command'
    """
    return ", ".join(difflib.get_close_matches(name, list(known), n=3, cutoff=0.6))


def _only_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise UsageError(
                f"{where} has a key `{key}`",
                needed=f"one of {', '.join(known)}",
                remedy=f"did you mean {close}?" if (close := nearest(key, known)) else "remove it",
            )


def _table(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise UsageError(f"{where} is {value!r}", needed="a table", remedy="write it as in the documentation of --map")
    return value


def _text(table: Mapping[str, Any], key: str, where: str) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        came = f"has no `{key}`" if value is None else f"has `{key}` = {value!r}"
        raise UsageError(f"{where} {came}", needed="a name in quotes", remedy=f'write {key} = "NAME"')
    return value


def _number(table: Mapping[str, Any], key: str, where: str) -> float | None:
    value = table.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a finite number", remedy="write it without quotes")
    return float(value)


def _index(table: Mapping[str, Any], key: str, where: str) -> int | None:
    value = table.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a whole number from 0", remedy="count from zero")
    return value


def _series(table: Mapping[str, Any], where: str, *, si: str) -> Series:
    row, column = _index(table, "row", where), _index(table, "column", where)
    if row is not None and column is not None:
        raise UsageError(f"{where} has `row` and `column`", needed="one of them", remedy="remove the other")
    unit = _text(table, "unit", where) if "unit" in table else ""
    _measures(unit, si, f"{where} `unit`")
    scale = _number(table, "scale", where)
    return Series(
        source=_text(table, "source", where), unit=unit, scale=1.0 if scale is None else scale, row=row, column=column
    )


def _measures(unit: str, si: str, where: str) -> None:
    if not unit:
        return
    try:
        found = parse_unit(unit).si
    except UsageError as error:
        raise UsageError(f"{where}: {error.came}", needed=error.needed, remedy=error.remedy) from error
    if found != si:
        raise UsageError(
            f"{where} is {unit!r}", needed=f"a unit of {si}", remedy="correct the unit or the channel name"
        )


def _channel(name: str, value: object, where: str) -> MappedChannel:
    if name not in STANDARD_UNITS:
        close = nearest(name, STANDARD_UNITS)
        raise UsageError(
            f"{where} is no channel of the vocabulary",
            needed="a name such as roll_command, p, phi, ax",
            remedy=f"did you mean {close}?" if close else "see the list of channel names in the documentation",
        )
    table = _table(value, where)
    _only_keys(table, _CHANNEL_KEYS, where)
    time = None
    if "time" in table:
        time_unit = _text(table, "time_unit", where) if "time_unit" in table else ""
        _measures(time_unit, "s", f"{where} `time_unit`")
        time = Series(source=_text(table, "time", where), unit=time_unit)
    return MappedChannel(name=name, samples=_series(table, where, si=STANDARD_UNITS[name]), time=time)


def _clock(value: object, where: str) -> Clock:
    table = _table(value, where)
    _only_keys(table, _CLOCK_KEYS, where)
    if len(table) != 1:
        raise UsageError(
            f"{where} has {len(table)} keys", needed=f"exactly one of {', '.join(_CLOCK_KEYS)}", remedy="keep one"
        )
    rate = _number(table, "sample_rate_hz", where)
    if rate is not None:
        if rate <= 0.0:
            raise UsageError(
                f"{where} has `sample_rate_hz` = {rate:g}", needed="a rate above zero", remedy="correct it"
            )
        return Clock(sample_rate_hz=rate)
    key = next(iter(table))
    series = _table(table[key], f"{where} {key}")
    _only_keys(series, _SERIES_KEYS, f"{where} {key}")
    found = _series(series, f"{where} {key}", si="s")
    return Clock(time=found) if key == "time" else Clock(steps=found)


def _segments(document: Mapping[str, Any], channels: Iterable[MappedChannel], where: str) -> tuple[Segment, ...]:
    table = _table(document.get("segments", {}), f"{where}: [segments]")
    _only_keys(table, ("use",), f"{where}: [segments]")
    items = table.get("use", [])
    if not isinstance(items, list):
        raise UsageError(f"{where}: [segments] `use` is {items!r}", needed="a list of tables", remedy="add brackets")
    names = [channel.name for channel in channels]
    excited = {axis for axis in AXES if f"{axis}_command" in names or f"{axis}_excitation" in names}
    return tuple(
        _segment(item, excited, f"{where}: [segments] use, number {number}")
        for number, item in enumerate(items, start=1)
    )


def _segment(value: object, excited: set[str], where: str) -> Segment:
    table = _table(value, where)
    _only_keys(table, _SEGMENT_KEYS, where)
    axis = table.get("axis", next(iter(excited)) if len(excited) == 1 else None)
    if axis not in AXES:
        raise UsageError(
            f"{where} has `axis` = {axis!r}" if axis else f"{where} does not say which axis it excites",
            needed=f"one of {', '.join(AXES)}",
            remedy='write axis = "pitch"',
        )
    kind = table.get("kind", "other")
    if kind not in get_args(Kind):
        raise UsageError(
            f"{where} has `kind` = {kind!r}", needed=f"one of {', '.join(get_args(Kind))}", remedy="correct it"
        )
    by_time = (_number(table, "start_s", where), _number(table, "stop_s", where))
    by_sample = (_index(table, "start_sample", where), _index(table, "stop_sample", where))
    start, stop = by_time if None not in by_time else by_sample
    if (None in by_time) == (None in by_sample) or start is None or stop is None or not start < stop:
        raise UsageError(
            f"{where} is no interval",
            needed="start_s and stop_s, or start_sample and stop_sample, the start before the stop",
            remedy="give one of the two pairs",
        )
    return Segment(
        axis=cast("Axis", axis),
        kind=cast("Kind", kind),
        start_s=by_time[0],
        stop_s=by_time[1],
        start_sample=by_sample[0],
        stop_sample=by_sample[1],
    )
