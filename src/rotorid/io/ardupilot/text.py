"""ArduPilot logs as text: Mission Planner's ``.log``, and what ``mavlogdump`` prints, plain or as JSON.

All three hold the messages of the binary log in their order. They are written back as the messages that they were, and
read by the one reader that knows them. Numbers of the scaled letters (``c C e E L``) stand in the text as values, so
that they become floating-point numbers; whole numbers stay whole, since their type shows the units of old firmware.
"""

from __future__ import annotations

import json
import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.ardupilot.dataflash import FMT, MAGIC, UNIT_NAMES, decode
from rotorid.io.ardupilot.firmware import introduces
from rotorid.io.ardupilot.log import WANTED, record_of

FORMAT = "ArduPilot DataFlash as text"

_PLAIN = re.compile(r"\s*(FMT)\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,")
_DUMPED = re.compile(r"[-\d]+ [:.\d]+: ([A-Z][A-Z0-9_]*) \{(.*)\}\s*$")
_JSON = re.compile(r'\s*\{\s*"meta"\s*:\s*\{[^{}]*"type"\s*:')
_KIND = re.compile(r'"type"\s*:\s*"(\w+)"')
_FIELD = re.compile(r"(?:^|, )(\w+) : ")

_BARE = re.compile(r"(ATT|IMU|RAW|CTUN|NTUN|GPS|MOT|RATE|RCOU|RCIN|CURR|MODE|PM) ?[,:] ?[-+.\d]")
"""A message without a definition of its columns, as before firmware of 2013."""

_WHOLE = frozenset("bBhHiIqQM")
_SCALED = frozenset("cCeEL")
_STORED: Mapping[str, tuple[str, str]] = {"n": ("n", "4s"), "N": ("N", "16s"), "Z": ("Z", "64s"), "a": ("Z", "64s")}
"""Letter in the text to the letter and the type in which it is written back; all others are numbers."""

_FEW_LINES = 20
_BANNER = 2000
"""Within so many characters a log says what wrote it."""
_LONGEST_MESSAGE, _MOST_TYPES = 255, 256

Cells: TypeAlias = Sequence[object]


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is an ArduPilot log in text.

    Examples
    --------
    >>> sniff(b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"), sniff(b"time [s],q [rad/s]")
    (True, False)
    """
    lines = head.decode("utf-8", errors="replace").removeprefix("\ufeff").splitlines()
    if any(_PLAIN.match(line) for line in lines):
        return True
    first = next((line for line in lines if line.strip()), "")
    bare = [bool(_BARE.match(line.lstrip())) for line in lines[:_FEW_LINES] if line.strip()]
    return bool(_JSON.match(first) or _DUMPED.match(first)) or sum(bare) > len(bare) / 2


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Parameters
    ----------
    path
        Text as Mission Planner or ``mavlogdump`` wrote it from a ``.BIN``.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read, or none of its messages is one of ArduPilot's logs.
    """
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    written = _Binary()
    lines = text.splitlines()
    for name, cells, columns in _messages(lines):
        written.add(name, cells, columns)
    bare = Counter(found[1] for line in lines if (found := _BARE.match(line.lstrip())))
    if bare and not written.defined:
        counts = ", ".join(f"{count} {message}" for message, count in bare.most_common())
        raise LogError(
            f"{source.name} contains {counts} of ArduPilot, without definitions of their columns (FMT) and stamps",
            needed="lines as Mission Planner or mavlogdump.py write them from a .BIN, FMT among them",
            remedy="give the .BIN that the text was made from, or fly again with a newer firmware",
        )
    if not written.messages:
        raise LogError(
            f"{source.name} contains no message of an ArduPilot log that can be read",
            needed="lines as Mission Planner or mavlogdump.py write them from a .BIN",
            remedy="give the .BIN or .tlog that the text was made from",
        )
    log = decode(b"".join(written.messages), WANTED)
    # Logs of the years before MSG have the firmware in the lines before their first message.
    banner = next((line.strip() for line in text[:_BANNER].splitlines() if "," not in line and introduces(line)), "")
    source = replace(source, firmware=banner or source.firmware)
    return record_of(log.tables, source, (*log.findings, *_damage(written.damaged)), log.defined)


def _damage(lines: int) -> Iterator[Finding]:
    if lines:
        yield warn("corrupt_log", "log", f"{lines} lines are no complete messages and were left out.", lines=lines)


def _messages(lines: Sequence[str]) -> Iterator[tuple[str, Cells, Sequence[str]]]:
    """Name, cells, and the names of the columns where the line gives them; a name without cells for a broken line."""
    for line in lines:
        if line.startswith("{"):
            kind = _KIND.search(line)
            # Most messages are not wanted, and need no parsing.
            if kind is None or kind[1] in WANTED or kind[1] in UNIT_NAMES or kind[1] == FMT.name:
                yield _of_json(line)
        elif (dumped := _DUMPED.match(line)) is not None:
            names = _FIELD.findall(dumped[2])
            yield dumped[1], _FIELD.split(dumped[2])[2::2], names
        else:
            name, comma, rest = line.partition(",")
            if comma and name.strip().isalnum():
                yield name.strip(), (rest,), ()


def _of_json(line: str) -> tuple[str, Cells, Sequence[str]]:
    try:
        message = json.loads(line)
        name, data = message["meta"]["type"], message["data"]
        return str(name), tuple(data.values()), tuple(data)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return "", (), ()


@dataclass(frozen=True, kw_only=True, slots=True)
class _Layout:
    """How the messages of a kind are written back."""

    number: int
    letters: str
    columns: tuple[str, ...]
    whole: tuple[bool | None, ...]
    packed: struct.Struct


class _Binary:
    """Messages of text, as a binary log holds them."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.damaged = 0
        self._layouts: dict[str, _Layout] = {}

    @property
    def defined(self) -> bool:
        """Whether the columns of any message are known."""
        return bool(self._layouts)

    def add(self, name: str, cells: Cells, columns: Sequence[str]) -> None:
        """One message; of the definitions each becomes one of its own."""
        if name == FMT.name:
            self._define(_split(cells, len(FMT.columns)))
        elif name in WANTED or name in UNIT_NAMES:
            layout = self._layouts.get(name) or self._guess(name, cells, columns)
            parts = () if layout is None else _split(cells, len(layout.columns))
            parts = self._without_factors(parts) if name == "FMTU" else parts
            row = None if layout is None else _packed(layout, parts)
            self.damaged += row is None
            self.messages += [] if row is None else [row]
        elif not name:
            self.damaged += 1

    def _define(self, cells: Cells) -> None:
        try:
            number, _, name, letters, columns = (str(cell).strip() for cell in cells)
            self._lay_out(int(float(number)), name, letters, columns.split(","))
        except (ValueError, OverflowError):
            self.damaged += 1

    def _without_factors(self, cells: Cells) -> Cells:
        """Declared multipliers without those of scaled letters, whose values stand in the text already."""
        number, factors = str(cells[1]) if len(cells) == 4 else "", str(cells[-1]) if cells else ""
        layout = next((known for known in self._layouts.values() if str(known.number) == number), None)
        if layout is None:
            return cells
        kept = ["0" if letter in _SCALED else factor for letter, factor in zip(layout.letters, factors, strict=False)]
        return [*cells[:-1], "".join(kept)]

    def _guess(self, name: str, cells: Cells, columns: Sequence[str]) -> _Layout | None:
        """A layout for a kind of message whose definition was not printed, from its first message."""
        if not columns or len(columns) != len(cells):
            return None
        letters = "".join(_letter(column, cell) for column, cell in zip(columns, cells, strict=True))
        used = {layout.number for layout in self._layouts.values()} | {FMT.number}
        self._lay_out(next(number for number in range(_MOST_TYPES) if number not in used), name, letters, columns)
        return self._layouts.get(name)

    def _lay_out(self, number: int, name: str, letters: str, columns: Sequence[str]) -> None:
        if name == FMT.name or name in self._layouts or len(letters) != len(columns) or not 0 <= number < _MOST_TYPES:
            return
        kinds = [_STORED.get(letter, ("q", "q") if letter in _WHOLE else ("d", "d")) for letter in letters]
        packed = struct.Struct("<BBB" + "".join(kind for _, kind in kinds))
        spelled = ",".join(column.strip() for column in columns)
        if packed.size > _LONGEST_MESSAGE or len(letters) > 16 or len(spelled) > 64 or len(name) > 4:
            return
        whole = tuple({"q": True, "d": False}.get(letter) for letter, _ in kinds)
        self._layouts[name] = _Layout(
            number=number, letters=letters, columns=tuple(spelled.split(",")), whole=whole, packed=packed
        )
        texts = (name, "".join(letter for letter, _ in kinds), spelled)
        content = struct.pack(
            "<BB4s16s64s", number, packed.size, *(text.encode("latin-1", "replace") for text in texts)
        )
        self.messages.append(bytes((*MAGIC, FMT.number)) + content)


def _letter(column: str, cell: object) -> str:
    if column in ("TimeUS", "TimeMS"):
        return "Q"
    try:
        float(str(cell))
    except ValueError:
        return "Z"
    return "f"


def _split(cells: Cells, count: int) -> Cells:
    """The cells of a line that has not been split; a comma in the last text is part of it."""
    if len(cells) == 1 and isinstance(cells[0], str) and count > 1:
        return [cell.strip() for cell in cells[0].split(",", count - 1)]
    return cells


def _packed(layout: _Layout, cells: Cells) -> bytes | None:
    """A message in binary, or ``None`` where a cell is missing or no number."""
    if len(cells) != len(layout.columns):
        return None
    try:
        values = [
            str(cell).encode("utf-8") if whole is None else _whole(cell) if whole else float(str(cell))
            for cell, whole in zip(cells, layout.whole, strict=True)
        ]
        return layout.packed.pack(*MAGIC, layout.number, *values)
    except (ValueError, OverflowError, struct.error):
        return None


def _whole(cell: object) -> int:
    text = str(cell)
    return int(text) if text.lstrip("-").isdecimal() else int(float(text))
