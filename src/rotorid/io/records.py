"""Records of what a program hands to a verb: flight records as they are, and files, which are read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.io.motor_speeds import checked_speeds
from rotorid.io.registry import read


def as_records(
    records: FlightRecord | str | Path | Iterable[FlightRecord | str | Path], *, optional: bool = False
) -> tuple[FlightRecord, ...]:
    """Flight records; a path is read, and a single one may come without a list around it.

    Parameters
    ----------
    records
        Records as :func:`rotorid.read` gives them, files that it reads, or both. Of records that were made otherwise,
        motor speeds are checked as of a log.
    optional
        Whether there may be none.

    Raises
    ------
    UsageError
        No log came, or what is none.
    LogError
        A file cannot be read.
    """
    several = _each(records)
    if not several and not optional:
        raise UsageError("no log was given", needed="at least one flight log")
    # Records that were made by hand have passed no reader.
    return _distinct_names(
        [checked_speeds(record) if isinstance(record, FlightRecord) else read(record) for record in several]
    )


def as_record(record: FlightRecord | str | Path) -> FlightRecord:
    """The one flight record of a verb that takes a single log.

    Parameters
    ----------
    record
        As one of :func:`as_records`.

    Raises
    ------
    UsageError
        Several came, or what is no log.
    LogError
        The file cannot be read.
    """
    found = as_records(record)
    if len(found) > 1:
        raise UsageError(f"{len(found)} logs were given", needed="one log")
    return found[0]


def _each(records: Any) -> list[Any]:
    """What came, one by one, all of it logs or files; a frame or a dictionary would give its names."""
    single = isinstance(records, str | bytes | os.PathLike | FlightRecord | Mapping) or hasattr(records, "columns")
    found = [records] if single or not isinstance(records, Iterable) else list(records)
    for one in found:
        if not isinstance(one, FlightRecord | str | os.PathLike):
            raise UsageError(
                f"{type(one).__name__} is no flight log",
                needed="a file or a FlightRecord",
                remedy="make one with FlightRecord.from_pandas" if hasattr(one, "columns") else "",
            )
    return found


def _distinct_names(records: Sequence[FlightRecord]) -> tuple[FlightRecord, ...]:
    """Records whose names differ: several cards hold a ``00000012.BIN``, and findings and fits go by names.

    One that is given twice keeps its name, under which it is refused.
    """
    names = [record.source.name for record in records]
    contents = {(record.source.name, record.source.sha256 or id(record)) for record in records}
    several = {name for name in names if sum(one == name for one, _ in contents) > 1}
    return tuple(
        replace(record, source=replace(record.source, name=f"{name} ({1 + names[:place].count(name)})"))
        if name in several
        else record
        for place, (name, record) in enumerate(zip(names, records, strict=True))
    )
