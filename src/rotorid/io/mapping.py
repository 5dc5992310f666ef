"""Mapping files: the user's own names for the channels of a foreign file, in TOML.

The language has a page of its own in the documentation, ``docs/mapping.md``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast, get_args

from rotorid.data.channel import AXES
from rotorid.data.maneuver import Kind
from rotorid.errors import UsageError
from rotorid.io.mapping_channels import FRAME_KEYS, Frames, read_channel, read_frames, read_series, read_vector
from rotorid.io.mapping_keys import band, choice, index, names, nearest, number, only_keys, table
from rotorid.io.mapping_values import (
    PLACEHOLDER,
    ChannelMapping,
    Clock,
    Experiments,
    MappedAttitude,
    MappedChannel,
    Segment,
    Series,
)
from rotorid.typing import Axis

__all__ = [
    "ChannelMapping",
    "Clock",
    "Experiments",
    "MappedAttitude",
    "MappedChannel",
    "Segment",
    "Series",
    "nearest",
    "parse_mapping",
    "read_mapping",
]

_LARGEST_BYTES = 20_000
_LARGEST_INTEGER = 2**63
"""TOML's own limit; Python would carry more, and fail to write them down."""

_KEYS = ("channels", "vectors", "clock", "experiments", "segments", *FRAME_KEYS)
_CLOCK_KEYS = ("time", "steps", "sample_rate_hz")
_CLOCK_SERIES_KEYS = ("source", "unit", "row", "column")
_SEGMENT_KEYS = ("start_s", "stop_s", "start_sample", "stop_sample", "axis", "kind", "signal", "band_rad_s")


def read_mapping(path: Path) -> ChannelMapping:
    """Read a mapping file.

    Raises
    ------
    UsageError
        The file is missing, is no TOML, or says something impossible; the message names the key.
    """
    try:
        content = path.read_bytes()
        if len(content) > _LARGEST_BYTES:
            raise UsageError(
                f"the mapping {path.name} holds {len(content)} bytes",
                needed=f"at most {_LARGEST_BYTES}",
                remedy="give the mapping to --map, and the log before it",
            )
        document = tomllib.loads(content.decode("utf-8"))
    except OSError as error:
        raise UsageError(
            f"the mapping {path} cannot be opened: {error.strerror or error}",
            needed="a TOML file with a table [channels.NAME] for each channel",
            remedy="check the path given to --map",
        ) from error
    # The parser follows nested brackets by recursion, and refuses numbers of thousands of digits with a plain error.
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise UsageError(
            f"the mapping {path.name} is no TOML: {error}",
            needed='text as in `[channels.q]` followed by `source = "gyro_y"`',
            remedy="correct the line",
        ) from error
    if _holds_huge_integer(document):
        raise UsageError(
            f"the mapping {path.name} holds a number of more than 64 bits",
            needed="numbers that a flight log may hold",
            remedy="correct it",
        )
    return parse_mapping(document, path.name)


def _holds_huge_integer(document: Mapping[str, Any]) -> bool:
    waiting: list[object] = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, Mapping):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, int) and not -_LARGEST_INTEGER <= value < _LARGEST_INTEGER:
            return True
    return False


def parse_mapping(document: Mapping[str, Any], where: str = "mapping") -> ChannelMapping:
    """Check a mapping that was read from TOML, and give it types.

    Parameters
    ----------
    document
        Tables ``channels`` and ``vectors``, of which one may be missing; optionally ``clock``, ``experiments`` and
        ``segments``, and the axes ``frame`` (FRD or FLU) and ``world`` (NED, ENU or NWU) that the file is written in.
    where
        What the messages call it.

    Raises
    ------
    UsageError
        A key is unknown or missing, a value has the wrong type, a name looks like a misspelling of one of the
        vocabulary, or a unit does not measure what the channel holds.

    Examples
    --------
    >>> document = {"clock": {"sample_rate_hz": 250.0}, "channels": {"q": {"source": "gyro", "unit": "deg/s"}}}
    >>> mapping = parse_mapping(document)
    >>> mapping.channels[0].samples.source
    'gyro'
    """
    only_keys(document, _KEYS, where)
    frames = read_frames(document, where)
    clock = _clock(document["clock"], f"{where}: [clock]") if "clock" in document else None
    channels, attitude = _channels(document, frames, where)
    mapping = ChannelMapping(
        channels=channels,
        attitude=attitude,
        clock=clock,
        experiments=_experiments(document, where),
        segments=_segments(document, {channel.name for channel in channels}, where),
    )
    _check_whole(mapping, where)
    return mapping


def _channels(
    document: Mapping[str, Any], frames: Frames, where: str
) -> tuple[tuple[MappedChannel, ...], MappedAttitude | None]:
    """All channels, those of vectors among them, and the quaternion."""
    tables = table(document.get("channels", {}), f"{where}: [channels]")
    channels = [read_channel(name, value, frames, f"{where}: [channels.{name}]") for name, value in tables.items()]
    attitude = None
    for name, value in table(document.get("vectors", {}), f"{where}: [vectors]").items():
        found, quaternion = read_vector(name, value, frames, f"{where}: [vectors.{name}]")
        channels += found
        attitude = quaternion or attitude
    if not channels and attitude is None:
        raise UsageError(f"{where} names no channel", needed="a table [channels.NAME]", remedy="add one per channel")
    held = [channel.name for channel in channels] + (["phi", "theta", "psi"] if attitude else [])
    twins = sorted({name for name in held if held.count(name) > 1})
    if twins:
        raise UsageError(
            f"{where} names {', '.join(twins)} twice",
            needed="each channel once",
            remedy="remove it from [channels] or from [vectors]",
        )
    return tuple(channels), attitude


def _check_whole(mapping: ChannelMapping, where: str) -> None:
    """What only all of a mapping together can get wrong."""
    timed = [(f"[channels.{channel.name}]", channel.time) for channel in mapping.channels]
    timed += [("[vectors.quaternion]", mapping.attitude.time)] if mapping.attitude else []
    for name, time in timed:
        if mapping.clock is None and time is None:
            raise UsageError(
                f"{where}: {name} has no stamps",
                needed="a key `time` in it, or a table [clock] for all",
                remedy="add one of them; `sample_rate_hz = 250.0` in [clock] is enough for a uniform rate",
            )
    if "" not in mapping.files:
        raise UsageError(
            f"{where}: every channel stands in another file than the log",
            needed="at least one channel without `file`",
            remedy=f"give {mapping.files[0]} as the log and remove `file` from its channels",
        )
    sources = [channel.samples.source for channel in mapping.channels]
    sources += [part.source for part in mapping.attitude.parts] if mapping.attitude else []
    if any(PLACEHOLDER in source for source in sources) != (mapping.experiments is not None):
        raise UsageError(
            f"{where} has {'[experiments]' if mapping.experiments else f'a source with {PLACEHOLDER}'} alone",
            needed=f"a table [experiments] and {PLACEHOLDER} in the sources of its channels",
            remedy='write names = ["1", "2"] in [experiments], and source = "data{experiment}"',
        )


def _clock(value: object, where: str) -> Clock:
    values = table(value, where)
    only_keys(values, _CLOCK_KEYS, where)
    if len(values) != 1:
        raise UsageError(
            f"{where} has {len(values)} keys", needed=f"exactly one of {', '.join(_CLOCK_KEYS)}", remedy="keep one"
        )
    rate = number(values, "sample_rate_hz", where)
    if rate is not None:
        if rate <= 0.0:
            raise UsageError(
                f"{where} has `sample_rate_hz` = {rate:g}", needed="a rate above zero", remedy="correct it"
            )
        return Clock(sample_rate_hz=rate)
    key = next(iter(values))
    series = table(values[key], f"{where} {key}")
    only_keys(series, _CLOCK_SERIES_KEYS, f"{where} {key}")
    found = read_series(series, f"{where} {key}", si="s")
    return Clock(time=found) if key == "time" else Clock(steps=found)


def _experiments(document: Mapping[str, Any], where: str) -> Experiments | None:
    if "experiments" not in document:
        return None
    where = f"{where}: [experiments]"
    values = table(document["experiments"], where)
    only_keys(values, ("names", "spacing_s"), where)
    spacing_s = number(values, "spacing_s", where) or 0.0
    if spacing_s < 0.0:
        raise UsageError(f"{where} has `spacing_s` = {spacing_s:g}", needed="zero or more", remedy="correct it")
    return Experiments(names=names(values, "names", None, where), spacing_s=spacing_s)


def _segments(document: Mapping[str, Any], held: set[str], where: str) -> tuple[Segment, ...]:
    where = f"{where}: [segments]"
    values = table(document.get("segments", {}), where)
    only_keys(values, ("use",), where)
    items = values.get("use", [])
    if not isinstance(items, list):
        raise UsageError(f"{where} `use` is {items!r}", needed="a list of tables", remedy="add brackets")
    return tuple(_segment(item, held, f"{where} use, number {place}") for place, item in enumerate(items, start=1))


def _segment(value: object, held: set[str], where: str) -> Segment:
    values = table(value, where)
    only_keys(values, _SEGMENT_KEYS, where)
    excited = {axis for axis in AXES if f"{axis}_command" in held or f"{axis}_excitation" in held}
    axis = values.get("axis", next(iter(excited)) if len(excited) == 1 else None)
    if axis not in AXES:
        raise UsageError(
            f"{where} has `axis` = {axis!r}" if axis else f"{where} does not say which axis it excites",
            needed=f"one of {', '.join(AXES)}",
            remedy='write axis = "pitch"',
        )
    kind = cast("Kind", choice(values, "kind", get_args(Kind), "other", where))
    by_time = (number(values, "start_s", where), number(values, "stop_s", where))
    by_sample = (index(values, "start_sample", where), index(values, "stop_sample", where))
    whole = Segment(
        axis=cast("Axis", axis),
        kind=kind,
        signal=_signal(values, str(axis), held, where),
        band_rad_s=band(values, "band_rad_s", where),
    )
    if (*by_time, *by_sample) == (None,) * 4:
        return whole
    start, stop = by_time if None not in by_time else by_sample
    if (by_time != (None, None)) == (by_sample != (None, None)) or start is None or stop is None or not start < stop:
        raise UsageError(
            f"{where} is no interval",
            needed="start_s and stop_s, or start_sample and stop_sample, the start before the stop; or none of them",
            remedy="give one of the two pairs, or neither for the whole record",
        )
    return replace(whole, start_s=by_time[0], stop_s=by_time[1], start_sample=by_sample[0], stop_sample=by_sample[1])


def _signal(values: Mapping[str, Any], axis: str, held: set[str], where: str) -> str:
    """The channel in which a segment shows: the one that is named, else the injected signal or the command."""
    if "signal" in values:
        return choice(values, "signal", sorted(held), "", where)
    return next((name for kind in ("excitation", "command") if (name := f"{axis}_{kind}") in held), "")
