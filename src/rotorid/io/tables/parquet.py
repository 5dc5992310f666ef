"""Parquet tables: columns ``name [unit]`` as in CSV, or any other through a mapping. Needs the extra ``parquet``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import sandbox as sandboxed
from rotorid.io.files import UnpackLimits
from rotorid.io.sandbox import Extract
from rotorid.io.tables.mapped import assemble, columns_that_name_themselves, of_columns, sources_of
from rotorid.io.tables.mapping import ChannelMapping
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

FORMAT = "Parquet"

_MAGIC = b"PAR1"
_SAMPLE_BYTES = 8
_MOST_METADATA = 200
_LONGEST_THRIFT = (1 << 31) - 1


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a Parquet table."""
    return head.startswith(_MAGIC)


def read(path: Path, source: Source, mapping: ChannelMapping | None = None, *, sandbox: bool = True) -> FlightRecord:
    """Read a Parquet table.

    Only the columns that are needed are read, and only after the sizes that the file declares were found possible.

    Parameters
    ----------
    path
        One table; its columns are numbers.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Which column is which channel. Without one the columns must say it: ``time [s]`` first, then ``name [unit]``
        with the names of the vocabulary. A column with another name is left out, with a finding.
    sandbox
        Parse in a child process with limits: one changed bit can abort the whole process inside the parser.

    Raises
    ------
    LogError
        pyarrow is not installed, the file is damaged or would take more memory than a log may, or a needed column holds
        no numbers or has holes.
    UsageError
        The mapping names a column that does not exist, or the unit of a column is unknown.
    """
    options = {"names": list(sources_of(mapping)) if mapping else []}
    found = sandboxed.extract("parquet", path, options, name=source.name) if sandbox else extract(path, options)
    columns: list[str] = found.facts["columns"]
    mapping, findings = of_columns(columns, mapping, source.name)
    return assemble(found.arrays, mapping, source, findings)


def extract(path: Path, options: Mapping[str, Any]) -> Extract:
    """Columns of a Parquet table as double precision. Runs in the sandbox's child.

    Parameters
    ----------
    options
        ``names``: the columns to bring back, of which those that exist are read; when none is given, all whose name,
        without its unit, is of the vocabulary. ``metadata``: a key, whose text is all that is brought back.

    Returns
    -------
    Extract
        Arrays by column name, shape ``(rows,)``, and the fact ``columns``: the names of all; or ``metadata`` alone.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(
            f"{path.name} is a Parquet table, and pyarrow is not installed",
            needed="the extra [parquet]",
            remedy="run `pip install 'rotorid[parquet]'`, or save the table as CSV",
        ) from error
    size_bytes = path.stat().st_size
    # Names and statistics are part of the file: none can be longer than it is.
    longest = min(size_bytes, _LONGEST_THRIFT)
    try:
        with parquet.ParquetFile(path, thrift_string_size_limit=longest, thrift_container_size_limit=longest) as table:
            if "metadata" in options:
                said = (table.metadata.metadata or {}).get(options["metadata"].encode(), b"")
                return Extract(arrays={}, facts={"metadata": said[:_MOST_METADATA].decode(errors="replace")})
            names = [table.schema.column(index).path for index in range(len(table.schema))]
            wanted = _wanted(options["names"], names, path.name)
            _check_size(table, [names.index(name) for name in wanted], size_bytes, path.name)
            columns = table.read(columns=wanted, use_threads=False)
            arrays = {name: _numbers(columns.column(name), name, path.name) for name in wanted}
    # ArrowException covers its own findings, OSError and ValueError what it takes over from the system and the format.
    except (pyarrow.ArrowException, OSError, ValueError, KeyError) as error:
        raise LogError(
            f"{path.name} cannot be read as a Parquet table: {' '.join(str(error).split())[:200]}",
            needed="an undamaged file",
            remedy="write it again, or save the table as CSV",
        ) from error
    return Extract(arrays=arrays, facts={"columns": names})


def _wanted(asked: Sequence[str], names: Sequence[str], file: str) -> list[str]:
    twins = [name for name, count in Counter(names).items() if count > 1]
    if twins:
        raise LogError(f"{file} has two columns {twins[0]!r}", needed="each name once", remedy="rename one of them")
    return [name for name in asked if name in names] if asked else columns_that_name_themselves(names)


def _check_size(table: ParquetFile, wanted: Sequence[int], size_bytes: int, file: str) -> None:
    """Refuse tables whose row groups declare more than a file of this size can mean."""
    limits = UnpackLimits()
    allowed = min(limits.size_bytes, max(limits.free_bytes, int(limits.ratio * size_bytes)))
    groups = [table.metadata.row_group(index) for index in range(table.metadata.num_row_groups)]
    unpacked = sum(max(group.column(column).total_uncompressed_size, 0) for group in groups for column in wanted)
    # A run of equal values takes a few bytes in the file and all of its rows in memory.
    in_memory = _SAMPLE_BYTES * len(wanted) * max(table.metadata.num_rows, *(group.num_rows for group in groups), 0)
    if max(unpacked, in_memory) > allowed:
        raise LogError(
            f"{file} has {size_bytes} bytes and declares columns of {max(unpacked, in_memory) / 2**20:.0f} MiB",
            needed=f"at most {allowed / 2**20:.0f} MiB",
            remedy="write the columns that are needed, without compression, if it is really a flight log",
        )


def _numbers(column: Any, name: str, file: str) -> FloatArray:
    values = column.to_numpy()
    if values.dtype.kind not in "biuf" or column.null_count:
        what = f"{column.null_count} holes" if column.null_count else f"values of type {column.type}, not numbers"
        raise LogError(
            f"{file}: the column {name!r} contains {what}",
            needed="a number in each row; stamps in seconds",
            remedy="convert or fill the column before it is written",
        )
    return np.asarray(values, dtype=np.float64)
