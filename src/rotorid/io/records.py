"""Records of what a program hands to a verb: flight records as they are, and files, which are read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rotorid.data.record import FlightRecord
from rotorid.io.motor_speeds import checked_speeds
from rotorid.io.registry import read


def as_records(
    records: FlightRecord | str | Path | Iterable[FlightRecord | str | Path],
) -> tuple[FlightRecord, ...]:
    """Flight records; a path is read, and a single one may come without a list around it.

    Parameters
    ----------
    records
        Records as :func:`rotorid.read` gives them, files that it reads, or both. Of records that were made otherwise,
        motor speeds are checked as of a log.

    Raises
    ------
    LogError
        A file cannot be read.
    """
    several = (records,) if isinstance(records, str | Path | FlightRecord) else records
    # Records that were made by hand have passed no reader.
    return _distinct_names(
        [checked_speeds(record) if isinstance(record, FlightRecord) else read(record) for record in several]
    )


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
