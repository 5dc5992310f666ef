"""CSV logs: the package's own, with ``name [unit]`` in the header, and any other through a mapping."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.files import log_progress, write_atomically
from rotorid.io.tables.dialect import decoded, dialect_of, plain_table
from rotorid.io.tables.exporters import foreign_remedy
from rotorid.io.tables.mapped import HEADER_RULE, assemble, of_columns, sources_of
from rotorid.io.tables.mapping import ChannelMapping, nearest
from rotorid.io.tables.scattered import long_layout, read_long, read_sparse, with_stamps
from rotorid.typing import FloatArray

FORMAT = "CSV"

_MOST_COLUMNS = 5000
_SEPARATORS = ",;\t"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a table in text: a line of names with separators, no binary bytes."""
    text = decoded(head)
    binary = "\0" in text or "\ufffd" in text.lstrip().partition("\n")[0]
    return not binary and dialect_of(head) is not None


def read(path: Path, source: Source, mapping: ChannelMapping | None = None) -> FlightRecord:
    """Read a CSV log.

    A long table, with one row for each value (``time,name,value``), is read like a wide one whose columns have stamps
    of their own. So is a wide one in which a column is empty in many rows, as of topics of different rates.

    Parameters
    ----------
    path
        Text with one header line; how else it may be written, :mod:`rotorid.io.tables.dialect` says.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Which column is which channel. Without one the header must say it: ``time [s]`` first, then ``name [unit]`` with
        the names of the vocabulary. A column with another name is left out, with a finding.

    Raises
    ------
    LogError
        The header is no header, or a cell is missing or no finite number; the message names line and column.
    UsageError
        The mapping names a column that does not exist, or the unit of a column is unknown.
    """
    with plain_table(path) as text:
        header, separator, first_line = _header(text, source.name)
        layout = long_layout(header)
        if layout is not None and (mapping is None or not {*sources_of(mapping)} <= {*header}):
            values, stamps = read_long(text, source.name, separator, first_line, layout)
            mapping, findings = of_columns([layout.clock, *values], mapping, source.name)
            return _scattered(values, stamps, mapping, source, findings)
        mapping, findings = of_columns(header, mapping, source.name)
        wanted = sorted({header.index(name) for name in sources_of(mapping)})
        try:
            table = _table(text, source.name, header, wanted, separator, first_line)
        except LogError:
            sparse = read_sparse(text, header, wanted, separator, first_line, mapping)
            if sparse is None:
                raise
            return _scattered(*sparse, mapping, source, findings)
        arrays = {header[column]: table[:, place] for place, column in enumerate(wanted)}
        return assemble(arrays, mapping, source, findings)


def _scattered(
    values: dict[str, FloatArray],
    stamps: dict[str, FloatArray],
    mapping: ChannelMapping,
    source: Source,
    findings: tuple[Finding, ...],
) -> FlightRecord:
    """The record of columns with stamps of their own."""
    mapping, clocks = with_stamps(mapping, stamps)
    return assemble({**values, **clocks}, mapping, source, findings)


def write_csv(
    path: Path, time_s: FloatArray, columns: Mapping[str, FloatArray], units: Mapping[str, str] | None = None
) -> None:
    """Write a CSV log that `read` reads back, with seven significant digits, atomically.

    Parameters
    ----------
    path
        File to write or replace.
    time_s
        Stamps in s, shape ``(samples,)``; written with ten digits.
    columns
        Name of a channel of the vocabulary to its samples in SI units, each of shape ``(samples,)``.
    units
        Name to unit of the samples, where that is another one that the channel may have (motors in ``V``).

    Raises
    ------
    UsageError
        A name is not of the vocabulary, or the place cannot be written.
    ValueError
        A channel has not as many samples as there are stamps.
    """
    for name, samples in columns.items():
        if name not in STANDARD_UNITS:
            raise UsageError(
                f"{name!r} is not a channel name", needed="a known channel name", remedy=nearest(name, STANDARD_UNITS)
            )
        if np.shape(samples) != np.shape(time_s):
            raise ValueError(f"{name}: {np.shape(time_s)} time stamps for {np.shape(samples)} samples")
    written = {**STANDARD_UNITS, **(units or {})}
    header = ",".join(["time [s]", *(f"{name} [{written[name]}]" for name in columns)])
    row = ",".join(["%.10g", *["%.7g"] * len(columns)])
    values = zip(
        np.asarray(time_s).tolist(), *(np.asarray(samples).tolist() for samples in columns.values()), strict=True
    )
    write_atomically(path, "\n".join([header, *(row % cells for cells in values), ""]))


_TABLE_RATE_HZ = 500.0


def table_rate_hz(loop_rate_hz: float) -> float:
    """Rate at which a table holds a loop: the next part of its own that is 500 Hz or less.

    Examples
    --------
    >>> table_rate_hz(400.0), table_rate_hz(1000.0)
    (400.0, 500.0)
    """
    return loop_rate_hz / _stride(loop_rate_hz)


def _stride(loop_rate_hz: float) -> int:
    return max(1, int(np.ceil(loop_rate_hz / _TABLE_RATE_HZ - 1e-9)))


def write_flight(path: Path, flight: SimulatedFlight, *, start_s: float) -> None:
    """Write a simulated flight; its stamps begin where those of the flight do, later by ``start_s``."""
    stride = _stride(flight.sample_rate_hz)
    columns = {name: row[::stride] for name, row in flight.columns.items()}
    write_csv(path, start_s + flight.time_s[::stride], columns)


def _header(path: Path, file: str) -> tuple[list[str], str, int]:
    """Column names, separator, and the number of the line after the header."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            for number, line in enumerate(stream, start=1):
                if line.strip():
                    separator = max(_SEPARATORS, key=line.count)
                    cells = [cell.strip() for cell in _cells(line, separator, file)]
                    _require_few(cells, file)
                    _require_names(cells, file)
                    _refuse_twins(cells, file)
                    return cells, separator, number + 1
    except UnicodeDecodeError as error:
        raise _no_text(file) from error
    raise LogError(f"{file} is empty", needed=HEADER_RULE, remedy="check how it was written")


def _require_names(cells: Sequence[str], file: str) -> None:
    """Refuse a first line of numbers alone."""
    named = [cell for cell in cells if cell]
    try:
        numbers = [float(cell) for cell in named]
    except ValueError:
        return
    if numbers:
        raise LogError(
            f"{file} has no header: its first line is {', '.join(named[:5])}{', ...' * (len(named) > 5)}",
            needed=HEADER_RULE,
            remedy="write the names of the columns in the first line, then name the channels with --map FILE.toml",
        )


def _refuse_twins(cells: Sequence[str], file: str) -> None:
    earlier: set[str] = set()
    for cell in cells:
        if cell and cell in earlier:
            remedy = foreign_remedy(cells) or "rename one of them"
            raise LogError(f"{file} has two columns {cell!r}", needed="each name once", remedy=remedy)
        earlier.add(cell)


def _require_few(cells: Sequence[str], file: str) -> None:
    if len(cells) > _MOST_COLUMNS:
        raise LogError(
            f"{file} has {len(cells)} columns", needed=f"at most {_MOST_COLUMNS}", remedy="export the needed ones only"
        )


def _cells(line: str, separator: str, file: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator))
    except csv.Error as error:
        raise LogError(
            f"{file} contains a line that is not a table row ({error})",
            needed="a table of numbers",
            remedy="check how it was written",
        ) from error


def _no_text(file: str) -> LogError:
    return LogError(f"{file} is not UTF-8 text", needed="a CSV in UTF-8", remedy="save it again in that encoding")


def _table(
    path: Path, file: str, header: Sequence[str], wanted: Sequence[int], separator: str, first_line: int
) -> FloatArray:
    """Columns ``wanted`` as numbers, shape ``(samples, columns)``; every row must be as long as the header."""
    if path.stat().st_size > _LARGE_BYTES:
        large = _large_table(path, file, header, wanted, separator, first_line)
        if large is not None:
            return large
    try:
        # Given a name, NumPy unpacks by its ending, whatever the file holds.
        with path.open(encoding="utf-8-sig") as text, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table is refused below
            table = np.loadtxt(
                text,
                delimiter=separator,
                skiprows=first_line - 1,
                usecols=wanted,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
    except UnicodeDecodeError as error:
        raise _no_text(file) from error
    except ValueError as error:
        raise _first_fault(path, file, header, wanted, separator, first_line) or LogError(
            f"{file} cannot be read: {error}",
            needed="a rectangular table of numbers",
            remedy="check how it was written",
        ) from error
    if not table.size:
        raise LogError(
            f"{file} contains no flight: a header and no samples", needed="samples", remedy="check how it was written"
        )
    suspicious = not np.isfinite(table).all() or not _is_rectangular(path, separator, len(table) + 1, len(header))
    if suspicious and (fault := _first_fault(path, file, header, wanted, separator, first_line)):
        raise fault
    return table


def _large_table(
    path: Path, file: str, header: Sequence[str], wanted: Sequence[int], separator: str, first_line: int
) -> FloatArray | None:
    """The same of a large file, piece by piece; None where a cell is written as only the slow way can read it."""
    from rotorid.io.tables.csv_kernels import parse

    used = np.zeros(len(header), dtype=np.bool_)
    used[list(wanted)] = True
    size = path.stat().st_size
    table = np.empty((len(wanted), _count(path, b"\n") + 1))
    rows, line = 0, first_line
    with path.open("rb") as stream:
        for _ in range(first_line - 1):
            stream.readline()
        while text := stream.read(_PIECE_BYTES):
            log_progress(stream.tell(), size)
            text += stream.readline()
            text += b"" if text.endswith(b"\n") else b"\n"
            lines = text.count(b"\n")
            slow = np.empty((lines * len(wanted), 4), dtype=np.int64)
            whole, read, waiting = parse(np.frombuffer(text, dtype=np.uint8), ord(separator), used, table, rows, slow)
            rows += read
            try:
                for column, row, begin, end in slow[:waiting].tolist():
                    table[column, row] = _number(text[begin:end])
            except ValueError:
                whole = False
            if not whole:
                piece = io.StringIO(text.decode("utf-8", errors="replace"))
                if fault := _fault(_numbered(piece, line, separator, file), file, header, wanted):
                    raise fault
                return None
            line += lines
    return table[:, :rows].T if rows else None


_LARGE_BYTES = 16 << 20
_PIECE_BYTES = 4 << 20


def _number(cell: bytes) -> float:
    """A finite number as it is usually written.

    Raises
    ------
    ValueError
        It is none.
    """
    plain = cell.strip()
    value = float("nan") if plain.strip(b"0123456789+-.eE") else float(plain)
    if not np.isfinite(value):
        raise ValueError
    return value


def _count(path: Path, sign: bytes) -> int:
    """How often a byte stands in a file."""
    with path.open("rb") as stream:
        return sum(piece.count(sign) for piece in iter(lambda: stream.read(_PIECE_BYTES), b""))


def _is_rectangular(path: Path, separator: str, n_lines: int, n_columns: int) -> bool:
    """Whether a table can have rows of one length: a quick count, since NumPy ignores cells beyond the wanted ones."""
    return _count(path, separator.encode()) == n_lines * (n_columns - 1)


def _first_fault(
    path: Path, file: str, header: Sequence[str], wanted: Sequence[int], separator: str, first_line: int
) -> LogError | None:
    """Look for the cell that spoils a table, line by line: slow, and only done when there is one."""
    with path.open(encoding="utf-8-sig", errors="replace", newline=None) as lines:
        for _ in range(first_line - 1):
            lines.readline()
        return _fault(_numbered(lines, first_line, separator, path.name), file, header, wanted)


def _fault(
    rows: Iterable[tuple[int, list[str]]], file: str, header: Sequence[str], wanted: Sequence[int]
) -> LogError | None:
    """What is wrong with the first row that is."""
    for number, cells in rows:
        if len(cells) != len(header):
            return LogError(
                f"{file}, line {number} has {len(cells)} cells and the header {len(header)}",
                needed="one cell for each column",
                remedy="complete or delete the line; the last one is often cut when a recording stops",
            )
        for column in wanted:
            try:
                finite = bool(np.isfinite(float(cells[column])))
            except ValueError:
                finite = False
            if not finite:
                return LogError(
                    f"{file}, line {number}, column {header[column]!r} is {cells[column].strip()!r}",
                    needed="a finite number with a decimal point",
                    remedy="correct or delete the line",
                )
    return None


def _numbered(lines: Iterable[str], first: int, separator: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Cells of each line that is not blank, with the number of the line."""
    for number, line in enumerate(lines, start=first):
        if line.strip():
            yield number, _cells(line, separator, file)
