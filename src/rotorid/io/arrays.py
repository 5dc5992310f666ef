"""Arrays and pandas frames of a program as a flight record: the same names, units and mappings as those of tables."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.registry import checked_record
from rotorid.io.tables.mapped import assemble, of_columns
from rotorid.io.tables.mapping import ChannelMapping, parse_mapping, read_mapping
from rotorid.io.tables.scattered import Scattered, with_stamps
from rotorid.letters import visible
from rotorid.typing import FloatArray

FORMAT = "arrays"

CLOCK = "time_s"
"""What a mapping may call the stamps."""

MappingLike: TypeAlias = ChannelMapping | Mapping[str, Any] | str | os.PathLike[str] | None


def record_from_arrays(
    time_s: ArrayLike,
    channels: Mapping[str, ArrayLike | tuple[ArrayLike, ArrayLike]],
    *,
    mapping: MappingLike = None,
    name: str = FORMAT,
) -> FlightRecord:
    """A flight record of arrays, see :meth:`rotorid.data.record.FlightRecord.from_arrays`.

    Examples
    --------
    >>> record = record_from_arrays([0.0, 0.1, 0.2], {"p [deg/s]": [0.0, 90.0, 180.0], "roll_command": [0.0, 0.1, 0.2]})
    >>> record.channel_names, record["p"].values.round(3).tolist()
    (('p', 'roll_command'), [0.0, 1.571, 3.142])
    """
    clock = _numbers(time_s, name, CLOCK)
    if clock.ndim != 1:
        raise LogError(f"{name}: {CLOCK} has {clock.ndim} dimensions", needed="one stamp for each sample")
    if not isinstance(channels, Mapping):
        raise LogError(f"{name}: the channels are of type {type(channels).__name__}", needed="a dictionary of names")
    found: Scattered = {}, {}
    for key, given in channels.items():
        own, samples = cast("tuple[ArrayLike, ArrayLike]", given) if _has_stamps(given) else (clock, given)
        _add(found, str(key), _numbers(own, name, f"the stamps of {key}"), _numbers(samples, name, str(key)), name)
    return _record(found, mapping, name)


def record_from_pandas(frames: Any, *, mapping: MappingLike = None, name: str = FORMAT) -> FlightRecord:
    """A flight record of frames, see :meth:`rotorid.data.record.FlightRecord.from_pandas`."""
    found: Scattered = {}, {}
    for topic, frame in frames.items() if isinstance(frames, Mapping) else [(name, frames)]:
        if not hasattr(frame, "columns") or not hasattr(frame, "index"):
            raise UsageError(
                f"{topic} is of type {type(frame).__name__}", needed="a pandas DataFrame, or a mapping of several"
            )
        units = frame.attrs.get("units", {})
        _require_stamps(frame.index, topic, list(map(str, frame.columns)))
        clock = _numbers(frame.index, name, f"the index of {topic}")
        for column in frame.columns:
            key = f"{column} [{units[column]}]" if units.get(column) else str(column)
            if key in found[0]:
                raise LogError(
                    f"{name} has two columns {key!r}", needed="each once", remedy="rename or drop one of them"
                )
            _add(found, key, clock, _numbers(frame[column], name, key), name)
    return _record(found, mapping, name)


def _require_stamps(index: Any, topic: str, columns: list[str]) -> None:
    """Refuse an index that counts rows: pandas gives one to every frame that was given none."""
    if type(index).__name__ != "RangeIndex":
        return
    time = next((column for column in columns if column.lower().startswith(("time", "t [", "stamp"))), "time [s]")
    raise LogError(
        f"the index of {topic} counts rows",
        needed="stamps in seconds as the index",
        remedy=f"use frame.set_index({time!r})",
    )


def _has_stamps(given: Any) -> bool:
    """Whether samples came with stamps of their own: a tuple of two vectors."""
    return isinstance(given, tuple) and len(given) == 2 and all(np.ndim(part) == 1 for part in given)


def _numbers(values: Any, name: str, what: str) -> FloatArray:
    """Real numbers; what an array masks is no number."""
    kind = getattr(getattr(values, "dtype", None), "name", "") or type(values).__name__
    try:
        given = values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
        # NumPy makes numbers of dates in whatever unit they are kept, and of complex numbers their real part.
        if given.dtype.kind in "mMc":
            kind = given.dtype.name
            raise TypeError(kind)
        return np.asarray(np.ma.filled(given.astype(np.float64), np.nan))
    except (TypeError, ValueError) as error:
        remedy = "give seconds since the start" if "time" in kind or what.startswith(CLOCK) else "leave it out"
        raise LogError(f"{name}: {what} is of type {kind}", needed="numbers", remedy=remedy) from error


def _add(found: Scattered, key: str, clock: FloatArray, samples: FloatArray, name: str) -> None:
    """One variable without the rows in which it was not sampled, which are not a number."""
    values, stamps = found
    if samples.shape[:1] != clock.shape:
        count = samples.shape[0] if samples.ndim else 1
        raise LogError(
            f"{name}: {key} has {count} samples and {clock.size} stamps",
            needed="as many of each",
            remedy=f"give a channel with stamps of its own as {key!r}: (time_s, samples)",
        )
    there = ~np.isnan(samples) if samples.ndim == 1 else np.full(clock.size, fill_value=True)
    if not there.any():
        raise LogError(f"{name}: {key} has no samples", needed="numbers", remedy="leave it out")
    values[key], stamps[key] = samples[there], clock[there]


def _record(found: Scattered, mapping: MappingLike, name: str) -> FlightRecord:
    values, stamps = found
    named_by = visible(Path(mapping).name) if isinstance(mapping, str | os.PathLike) else ""
    given = _mapping(mapping)
    chosen, findings = of_columns([CLOCK, *values], given, name)
    if chosen.experiments is not None or any(chosen.files):
        raise UsageError(
            "a mapping of arrays names experiments or files", needed="arrays of one flight", remedy="leave them out"
        )
    chosen, clocks = with_stamps(chosen, stamps)
    source = Source(name=visible(name), format=FORMAT, sha256=_hash(values, stamps))
    return checked_record(assemble({**values, **clocks}, chosen, source, findings), given, named_by)


def _mapping(given: MappingLike) -> ChannelMapping | None:
    """A mapping as a file, as tables, or ready; tables need no clock, for the stamps are given."""
    if given is None or isinstance(given, ChannelMapping):
        return given
    if isinstance(given, Mapping):
        return parse_mapping({"clock": {"time": {"source": CLOCK}}, **given})
    return read_mapping(Path(given))


def _hash(values: Mapping[str, FloatArray], stamps: Mapping[str, FloatArray]) -> str:
    """A hash of all that was given, by which a result knows its data again."""
    total = hashlib.sha256()
    for key, samples in values.items():
        total.update(key.encode(errors="backslashreplace"))
        for array in (stamps[key], samples):
            total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()
