"""How a table in text is written: what other programs write becomes what the reader of tables expects.

The reader wants UTF-8, one header, numbers with a decimal point. Spreadsheets and loggers also write UTF-16, decimal
commas, remarks, a line ``sep=;``, a line of units below the header, columns between spaces, and times of day. Such a
file is written again line by line, so that messages still name the right line; a plain one is left as it is.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from rotorid.io.folders import scratch_folder
from rotorid.units import UNITS_AND_ALIASES

_HEAD_BYTES = 1 << 16
_UTF_16 = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_SEPARATORS = ",;\t"
_SPACES = " "
_REMARKS = ("#", "//")
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?\s*$', re.IGNORECASE)
_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?")
_TIME = re.compile(
    r"(?:(\d{4})[-/](\d\d?)[-/](\d\d?)[T ])?(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?)\s*(?:Z|UTC|[-+]\d\d:?\d\d)?"
)
_FEWEST_ROWS = 2


@dataclass(frozen=True, kw_only=True, slots=True)
class Dialect:
    """How a table in text is written.

    Parameters
    ----------
    encoding, separator
        Of the text; a separator of one space stands for any number of them.
    header
        Place of the line of the names, from zero; what is before it is no part of the table.
    mark
        Sign in front of the first name, as of a remark.
    units
        Whether the line below the header holds the units.
    decimal_comma
        Whether numbers have a decimal comma.
    extra
        Whether each row has one empty cell more than the header, behind a last separator.
    times
        Columns that hold dates or times of day.
    """

    encoding: str = "utf-8-sig"
    separator: str = ","
    header: int = 0
    mark: str = ""
    units: bool = False
    decimal_comma: bool = False
    extra: bool = False
    times: tuple[int, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether the reader of tables can read such a file as it is."""
        usual = replace(self, header=0, separator=",") == Dialect()
        return usual and self.separator in _SEPARATORS and self.header == 0


def decoded(head: bytes) -> str:
    """The beginning of a text in its encoding; a character that was cut at its end is left out."""
    encoding = _encoding(head)
    return head.decode(encoding, errors="replace").rstrip("\ufffd").removeprefix("\ufeff")


def _encoding(head: bytes) -> str:
    if head[:2] in _UTF_16:
        return "utf-16"
    if len(head) > 3 and head[1:4:2] == b"\0\0" and head[0] and head[2]:
        return "utf-16-le"
    return "utf-8-sig"


def dialect_of(head: bytes, *, whole: bool = False) -> Dialect | None:
    r"""How a table that begins like this is written; ``None`` where it is no table.

    Parameters
    ----------
    head
        First bytes of the file.
    whole
        Whether these are all.

    Examples
    --------
    >>> dialect_of(b"time [s];q [deg/s]\n0,005;1,5\n0,010;2\n").decimal_comma
    True
    >>> dialect_of(b"Dear pilot\nhello\n") is None
    True
    """
    text = decoded(head)
    lines = text.splitlines()
    if not whole and len(lines) > 1 and not text.endswith(("\n", "\r")):
        lines.pop()
    lines = [line if line.strip() else "" for line in lines]
    start, separator = next((place for place, line in enumerate(lines) if line), None), ""
    if start is None:
        return None
    if found := _SEPARATOR_LINE.match(lines[start]):
        separator = found[1]
        start += 1
    first = next((place for place in range(start, len(lines)) if lines[place] and not _remark(lines[place])), None)
    if first is None:
        return None
    remarks = [place for place in range(start, first) if lines[place]]
    rows = [line for line in lines[first:] if line and not _remark(line)]
    separator = separator or _separator(rows)
    if not separator:
        return None
    dialect = Dialect(encoding=_encoding(head), separator=separator, header=first)
    if remarks and _is_numeric(_split(rows[0], separator)):
        # The names are in the last remark, as numpy.savetxt writes them.
        last = lines[remarks[-1]]
        dialect = replace(dialect, header=remarks[-1], mark=_remark(last))
        rows.insert(0, last.lstrip().removeprefix(dialect.mark))
    elif rows[0].startswith("%") and not rows[0][1:2].isspace():
        dialect = replace(dialect, mark="%")
        rows[0] = rows[0][1:]
    names, body = _split(rows[0], separator), [_split(row, separator) for row in rows[1:]]
    if (remarks or separator == _SPACES) and (
        len(body) < _FEWEST_ROWS or not all(_is_numeric(cells) for cells in body[1:20])
    ):
        return None
    if body and _is_unit_row(body[0]):
        dialect = replace(dialect, units=True)
        body = body[1:]
    first_rows = body[:200]
    extra = bool(body) and all(len(cells) == len(names) + 1 and not cells[-1].strip() for cells in first_rows)
    return replace(
        dialect,
        decimal_comma=_decimal_comma(first_rows, names),
        extra=extra,
        times=tuple(column for column in range(len(names)) if _holds_times(first_rows, column)),
    )


def _remark(line: str) -> str:
    return next((mark for mark in _REMARKS if line.lstrip().startswith(mark)), "")


def _separator(rows: Sequence[str]) -> str:
    best = max(_SEPARATORS, key=rows[0].count)
    if best in rows[0]:
        return best
    widths = {len(row.split()) for row in rows[1:20]}
    return _SPACES if len(rows) > _FEWEST_ROWS and widths == {len(rows[0].split())} and widths != {1} else ""


def _split(line: str, separator: str) -> list[str]:
    if separator == _SPACES:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return [line]


def _is_numeric(cells: Sequence[str]) -> bool:
    """Whether a row holds numbers; texts may be among them."""
    return any(_number(cell) for cell in cells)


def _number(cell: str) -> bool:
    try:
        float(cell.strip().replace(",", "."))
    except ValueError:
        return bool(_TIME.fullmatch(cell.strip()))
    return True


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether a row holds units, or nothing, and at least two known ones."""
    bare = [cell.strip().strip("[]()") for cell in cells]
    return not _is_numeric(bare) and sum(bool(_unit(cell)) for cell in bare if cell) >= 2


def _unit(text: str) -> str:
    return text if text in UNITS_AND_ALIASES else ""


def _decimal_comma(rows: Sequence[Sequence[str]], names: Sequence[str]) -> bool:
    cells = [cell.strip() for row in rows if len(row) >= len(names) for cell in row]
    with_comma = sum(bool(_COMMA.fullmatch(cell)) for cell in cells)
    return with_comma > 0 and not any(_POINT.fullmatch(cell) for cell in cells)


def _holds_times(rows: Sequence[Sequence[str]], column: int) -> bool:
    cells = [row[column].strip() for row in rows if len(row) > column]
    return bool(cells) and all(_TIME.fullmatch(cell) for cell in cells)


@contextmanager
def plain_table(path: Path) -> Iterator[Path]:
    """A file that the reader of tables can read: the file itself, or a copy that is gone when the context ends."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    dialect = dialect_of(head, whole=len(head) < _HEAD_BYTES)
    if dialect is None or dialect.plain or (dialect.header and not _needs_copy(dialect, head)):
        yield path
        return
    with scratch_folder() as folder:
        copy = folder / "table.csv"
        try:
            with path.open(encoding=dialect.encoding, newline=None) as old, copy.open("w", encoding="utf-8") as new:
                new.writelines(_lines(old, dialect))
        except UnicodeDecodeError:
            # The reader says what is wrong with the file itself.
            yield path
            return
        yield copy


def _needs_copy(dialect: Dialect, head: bytes) -> bool:
    """Whether there is more before the header than empty lines, which the reader skips itself."""
    before = decoded(head).splitlines()[: dialect.header]
    return any(line.strip() for line in before) or not replace(dialect, header=0).plain


def _lines(old: Iterator[str], dialect: Dialect) -> Iterator[str]:
    names: list[str] | None = None
    clocks = {column: _clock() for column in dialect.times}
    for number, line in enumerate(old):
        if number < dialect.header or not line.strip() or (number > dialect.header and _remark(line)):
            yield "\n"
            continue
        if names is None:
            text = line.lstrip("\ufeff").lstrip().removeprefix(dialect.mark)
            names = [cell.strip() for cell in _split(text, dialect.separator)]
            waiting = dialect.units
            if waiting:
                continue
            yield _joined(_named(names, dialect, ()))
            continue
        cells = [cell.strip() for cell in _split(line.rstrip("\n"), dialect.separator)]
        if waiting:
            waiting = False
            yield _joined(_named(names, dialect, cells)) + "\n"
            continue
        if dialect.extra and len(cells) == len(names) + 1:
            cells.pop()
        for column, clock in clocks.items():
            if column < len(cells):
                cells[column] = clock(cells[column])
        if dialect.decimal_comma:
            cells = [cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell for cell in cells]
        yield _joined(cells)


def _named(names: Sequence[str], dialect: Dialect, units: Sequence[str]) -> list[str]:
    """The header, with the units of the line below it and of what became seconds."""
    full = []
    for column, name in enumerate(names):
        unit = units[column].strip().strip("[]()") if column < len(units) else ""
        bare = "[" not in name and "(" not in name
        if column in dialect.times:
            unit = "s"
        full.append(f"{name} [{unit}]" if bare and _unit(unit) else name)
    return full


def _joined(cells: Sequence[str]) -> str:
    quoted = ('"' + cell.replace('"', '""') + '"' if any(sign in cell for sign in ',"') else cell for cell in cells)
    return ",".join(quoted) + "\n"


def _clock() -> Callable[[str], str]:
    """Dates and times of day as seconds since the midnight before the first one."""
    day: list[datetime] = []

    def seconds(cell: str) -> str:
        found = _TIME.fullmatch(cell)
        if found is None:
            return cell
        year, month, date, hours, minutes, rest = found.groups()
        days = 0
        if year:
            try:
                here = datetime(int(year), int(month), int(date))
            except ValueError:
                return cell
            day.append(here) if not day else None
            days = (here - day[0]).days
        total = (days * 24 + int(hours)) * 3600 + int(minutes) * 60 + float(rest.replace(",", "."))
        return f"{total:.9f}"

    return seconds
