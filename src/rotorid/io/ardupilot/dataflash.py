"""ArduPilot's DataFlash container: from the bytes of a log to a table of each kind of message, with units.

A log is a chain of messages without checksum or framing: two magic bytes, a type, and as many bytes as the ``FMT``
message of that type declared. The magic also occurs inside messages, so that the chain must be followed; it is
followed for all messages at once, and step by step only where a false or damaged header interrupts it.

A log defines itself. ``FMT`` holds the letters of a format, which give each column its type, and ``UNIT``, ``MULT`` and
``FMTU`` hold the units and multipliers of the columns.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.errors import LogError, UsageError
from rotorid.io.files import gather, gather_into, let_go, log_progress
from rotorid.typing import AnyArray, BoolArray, FloatArray, IntArray

HEADER_BYTES = 3


@dataclass(frozen=True, slots=True)
class Letter:
    """How one letter of a format string is stored: the NumPy type, and by what the stored integer is divided."""

    dtype: np.dtype[np.generic]
    divisor: float = 1.0

    @property
    def stored(self) -> np.dtype[np.generic]:
        """Type of one item in the log: arrays and texts as they stand, without an end at the first zero."""
        plain = self.dtype.kind != "S" and not self.dtype.shape
        return self.dtype if plain else np.dtype((np.void, self.dtype.itemsize))


def _letter(dtype: str | tuple[str, int], divisor: float = 1.0) -> Letter:
    return Letter(np.dtype(dtype), divisor)


LETTERS: Mapping[str, Letter] = MappingProxyType(
    {
        "a": _letter(("<i2", 32)),
        "b": _letter("i1"),
        "B": _letter("u1"),
        "h": _letter("<i2"),
        "H": _letter("<u2"),
        "i": _letter("<i4"),
        "I": _letter("<u4"),
        "q": _letter("<i8"),
        "Q": _letter("<u8"),
        "g": _letter("<f2"),
        "f": _letter("<f4"),
        "d": _letter("<f8"),
        "n": _letter("S4"),
        "N": _letter("S16"),
        "Z": _letter("S64"),
        "c": _letter("<i2", 100.0),
        "C": _letter("<u2", 100.0),
        "e": _letter("<i4", 100.0),
        "E": _letter("<u4", 100.0),
        "L": _letter("<i4", 1e7),
        "M": _letter("u1"),
    }
)
"""Every letter that a format may hold. Dividing by a power of ten is exact to the last bit, multiplying is not."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One definition of a message, as its ``FMT`` message gives it.

    Parameters
    ----------
    number
        Third byte of every message of this kind.
    length
        Bytes of a message, its three header bytes included.
    name
        Up to four characters: ``RATE``.
    letters
        One letter per column, see ``LETTERS``.
    columns
        Names of the columns, in the order of the letters.
    """

    number: int
    length: int
    name: str
    letters: str
    columns: tuple[str, ...]

    @cached_property
    def decodable(self) -> bool:
        """Whether the letters are known and fill the declared length."""
        if any(letter not in LETTERS for letter in self.letters):
            return False
        return HEADER_BYTES + sum(LETTERS[letter].dtype.itemsize for letter in self.letters) == self.length

    @cached_property
    def fields(self) -> Mapping[str, tuple[int, str]]:
        """Column to its offset in the message and its letter; of two columns with one name the later one counts."""
        fields: dict[str, tuple[int, str]] = {}
        offset = HEADER_BYTES
        for name, letter in zip(self.columns, self.letters, strict=False):
            fields[name] = (offset, letter)
            offset += LETTERS[letter].dtype.itemsize
        return MappingProxyType(fields)


FMT = Format(
    number=128,
    length=89,
    name="FMT",
    letters="BBnNZ",
    columns=("Type", "Length", "Name", "Format", "Columns"),
)
"""The one definition that a log need not make: that of the definitions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """All messages of one kind: a row for each message, a column for each field, read when asked for.

    Parameters
    ----------
    format
        Definition of the messages.
    units
        Column to the label of its unit, such as ``deg/s``, for the columns to which the log gives one. It holds for
        the values that ``column`` returns.
    data
        The whole log, ``uint8``.
    positions
        First byte of each message, shape ``(messages,)``, rising.
    """

    format: Format
    units: Mapping[str, str]
    data: AnyArray
    positions: IntArray

    def __len__(self) -> int:
        return int(self.positions.size)

    def __contains__(self, column: str) -> bool:
        return column in self.format.fields

    @property
    def name(self) -> str:
        return self.format.name

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(self.format.fields)

    def holds_numbers(self, *columns: str) -> bool:
        """Whether all these columns exist and are plain numbers; a damaged definition may say otherwise."""
        return all(column in self and self.format.fields[column][1] not in "anNZ" for column in columns)

    def holds_text(self, *columns: str) -> bool:
        """Whether all these columns exist and are text."""
        return all(column in self and self.format.fields[column][1] in "nNZ" for column in columns)

    @property
    def instance_column(self) -> str | None:
        """Column that numbers identical sensors, when the log declares one."""
        return next((column for column, unit in self.units.items() if unit == _INSTANCE_UNIT), None)

    def chosen(self, which: BoolArray | slice) -> Table:
        """The table of some of the messages: a mask of shape ``(messages,)``, or a slice."""
        return replace(self, positions=self.positions[which])

    def column(self, name: str) -> AnyArray:
        """Values of one column, see `read`."""
        return self.read(name)[name]

    def read(self, *names: str) -> dict[str, AnyArray]:
        """Values of some columns, or of all when none is named, each of shape ``(messages,)``.

        Integers and floats keep the width of the log; the scaled letters ``c C e E L`` become ``float64``; text becomes
        ``str``. Arrays (letter ``a``) have shape ``(messages, 32)``, and so has the raw content of a logged file
        (``FILE.Data``), which is no text: ``uint8``, shape ``(messages, 64)``.

        Raises
        ------
        UsageError
            There is no such column.
        """
        fields = self._fields(names or self.columns)
        places = [(offset, LETTERS[letter].stored) for offset, letter in fields.values()]
        stored = gather(self.data, self.positions, places)
        return {
            name: self._value(letter, values)
            for (name, (_, letter)), values in zip(fields.items(), stored, strict=True)
        }

    def numbers(self, *names: str) -> FloatArray:
        """Values of columns for which `holds_numbers` is true, shape ``(names, messages)``.

        Raises
        ------
        UsageError
            There is no such column.
        """
        fields = self._fields(names)
        values = np.empty((len(names), len(self)))
        kinds = {name: LETTERS[letter] for name, (_, letter) in fields.items()}
        # Widening a signaling NaN, which damage may produce, is no reason for a warning: it stays a NaN.
        with np.errstate(invalid="ignore"):
            places = [(fields[name][0], kinds[name].stored) for name in names]
            gather_into(list(values), self.data, self.positions, places)
        for row, name in zip(values, names, strict=True):
            if kinds[name].divisor != 1.0:
                row /= kinds[name].divisor
        return values

    def _fields(self, names: Iterable[str]) -> Mapping[str, tuple[int, str]]:
        unknown = next((name for name in names if name not in self.format.fields), None)
        if unknown is not None:
            raise UsageError(
                f"the message {self.name} has no column {unknown!r}",
                needed=f"one of {', '.join(self.columns)}",
                remedy="correct the name",
            )
        return {name: self.format.fields[name] for name in names}

    def _value(self, letter: str, stored: AnyArray) -> AnyArray:
        kind = LETTERS[letter]
        if kind.dtype.kind == "S":
            raw = stored.view(np.uint8).reshape(-1, kind.dtype.itemsize)
            return raw if self.name == "FILE" and letter == "Z" else _texts(raw)
        if kind.dtype.shape:
            return stored.view(kind.dtype.base).reshape(-1, *kind.dtype.shape)
        return stored if kind.divisor == 1.0 else np.true_divide(stored, kind.divisor, dtype=np.float64)

    @property
    def clock(self) -> tuple[str, float] | None:
        """Column with the stamps and its steps per second, or ``None`` when the messages carry none."""
        for name, per_second in (("TimeUS", 1e6), ("TimeMS", 1e3)):
            if name in self and self.format.fields[name][1] in "IQiq":
                return name, per_second
        return None

    @property
    def time_s(self) -> FloatArray | None:
        """Stamps in seconds on the log's own clock, or ``None`` when the messages carry none."""
        if self.clock is None:
            return None
        name, per_second = self.clock
        stamps: FloatArray = self.numbers(name)[0]
        stamps /= per_second
        return stamps


MAGIC = (0xA3, 0x95)
TYPES = 256
SNIFFED = bytes((*MAGIC, FMT.number, FMT.number, FMT.length)) + b"FMT"
_ROUNDS = 4
"""How often the chain is followed anew when it turns out that a definition was no message of the chain."""

CACHED_BYTES = 1 << 19
SECTION_BYTES = 1 << 24
"""The chain is followed by sections, so that memory does not grow with the log."""

_DECIDED_BYTES = 1 << 10
"""What follows this far behind a message has no say in whether it belongs to the chain: four of the longest ones."""

UNIT_NAMES = frozenset({"UNIT", "MULT", "FMTU"})
"""Messages that say the units of the others."""

Definitions = Mapping[int, tuple[tuple[int, Format], ...]]
"""Type to its definitions: position in the log, and what was defined there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DataFlashLog:
    """A decoded log.

    Parameters
    ----------
    tables
        Message name to its table. When a log defines a name twice with different layouts, the later tables are called
        ``NAME#2`` and so on.
    gaps
        Intervals of bytes ``(start, stop)`` that are no messages.
    size
        Bytes of the log.
    undecodable
        Names of messages whose definition contradicts itself.
    defined
        Name to columns of all messages that are defined, whether there is one or not.
    """

    tables: Mapping[str, Table]
    gaps: tuple[tuple[int, int], ...]
    size: int
    undecodable: tuple[str, ...] = ()
    defined: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def skipped_bytes(self) -> int:
        return sum(stop - start for start, stop in self.gaps)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was skipped, in bytes and places; empty for an intact log."""
        return tuple(_damage(self))


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file look like a DataFlash log.

    Examples
    --------
    >>> sniff(bytes([0xA3, 0x95, 0x80, 0x80, 0x59]) + b"FMT"), sniff(b"ULog")
    (True, False)
    """
    return head.startswith(SNIFFED[:HEADER_BYTES]) or SNIFFED in head


def decode(data: bytes | memoryview | AnyArray, names: Collection[str] | None = None) -> DataFlashLog:
    """Split a log into tables of messages.

    Without a checksum in the format, a damaged value looks like a true one. What is noticed is a chain that breaks.
    Then the reader goes on at the next header that another header or the end of the log follows, gives up a message
    that reaches beyond that place, and counts the bytes in between as skipped. Beside the log itself, memory is needed
    for the positions of the messages that are asked for, four bytes each, and for one section.

    Parameters
    ----------
    data
        The whole file, as bytes or as an array of ``uint8``, which may be mapped.
    names
        Messages that are wanted; all when not given. Damage is looked for in all of them.

    Raises
    ------
    LogError
        The data hold no definition of a message.
    """
    log: AnyArray = np.ascontiguousarray(np.frombuffer(data, dtype=np.uint8))
    definitions = _definitions(log, _definition_headers(log))
    for _ in range(_ROUNDS):
        found, gaps = _chain(log, definitions, names)
        confirmed = _definitions(log, found[FMT.number])
        if confirmed == definitions:
            break
        definitions = confirmed
    if not any(number != FMT.number for number in definitions):
        raise LogError(
            f"these {log.size} bytes contain no message definitions",
            needed="an ArduPilot DataFlash log (.BIN), which begins with FMT messages",
            remedy="download the log from the autopilot again, in binary form",
        )
    tables, undecodable = _tables(log, found, definitions, names)
    defined = {layout.name: layout.columns for layouts in definitions.values() for _, layout in layouts}
    return DataFlashLog(tables=tables, gaps=gaps, size=log.size, undecodable=undecodable, defined=defined)


def _chain(
    log: AnyArray, definitions: Definitions, names: Collection[str] | None
) -> tuple[Mapping[int, IntArray], tuple[tuple[int, int], ...]]:
    """Positions of the messages of each wanted type, rising, and the gaps between messages of any type."""
    wanted = np.zeros(TYPES, dtype=np.bool_)
    wanted[[number for number, layouts in definitions.items() if _is_wanted(layouts, names)]] = True
    pieces: dict[int, list[IntArray]] = {FMT.number: []}
    gaps: list[tuple[int, int]] = []
    # Positions of a log below 2 GB fit into 32 bits, which halves what all of them take.
    width = np.int32 if log.size < np.iinfo(np.int32).max else np.int64
    for starts, skipped in _sections(log, definitions):
        gaps += skipped
        types = log[starts + 2]
        if not wanted.all():
            chosen = wanted[types]
            starts, types = starts[chosen], types[chosen]
        order = np.argsort(types, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(types[order])) + 1):
            if group.size:
                pieces.setdefault(int(types[group[0]]), []).append(starts[group].astype(width))
    return {number: np.concatenate(parts or [np.empty(0, width)]) for number, parts in pieces.items()}, tuple(gaps)


def _is_wanted(layouts: Iterable[tuple[int, Format]], names: Collection[str] | None) -> bool:
    """Whether messages of a type are kept; those that cannot be decoded are, to say so."""
    return names is None or any(
        layout.name in names or layout.name in UNIT_NAMES or layout == FMT or not layout.decodable
        for _, layout in layouts
    )


def _sections(log: AnyArray, definitions: Definitions) -> Iterator[tuple[IntArray, list[tuple[int, int]]]]:
    """Messages of the chain and gaps, section by section; each ends in front of a message that is sure to belong."""
    begin, length = 0, SECTION_BYTES
    while begin < log.size:
        let_go(log)
        log_progress(begin, log.size)
        end = min(begin + length, log.size)
        headers = _headers(log, begin, end)
        starts, gaps = _follow(begin, end, *_messages(log, end, headers, definitions))
        if end == log.size:
            yield starts, gaps
            return
        last = int(np.searchsorted(starts, end - _DECIDED_BYTES)) - 1
        if last < 1:
            # Hardly a message: only a longer section can decide.
            length *= 2
            continue
        cut = int(starts[last])
        yield starts[:last], [gap for gap in gaps if gap[1] <= cut]
        begin, length = cut, SECTION_BYTES


def _headers(log: AnyArray, begin: int, end: int) -> IntArray:
    """Positions of the magic bytes in front of ``end``, true headers or not; by blocks that stay in the cache."""
    last = max(end - HEADER_BYTES + 1, begin)
    found = [np.empty(0, dtype=np.int64)]
    for start in range(begin, last, CACHED_BYTES):
        first = np.flatnonzero(log[start : min(start + CACHED_BYTES, last)] == MAGIC[0]) + start
        found.append(first[log[first + 1] == MAGIC[1]])
    return np.concatenate(found)


def _definition_headers(log: AnyArray) -> IntArray:
    """Positions of whatever looks like the header of a definition, in the whole log."""
    found = [np.empty(0, dtype=np.int64)]
    for begin in range(0, log.size, SECTION_BYTES):
        let_go(log)
        headers = _headers(log, begin, min(begin + SECTION_BYTES + HEADER_BYTES - 1, log.size))
        found.append(headers[log[headers + 2] == FMT.number])
    return np.concatenate(found)


def _definitions(log: AnyArray, positions: IntArray) -> Definitions:
    """What the ``FMT`` messages at these positions define; a repetition of the last definition says nothing new."""
    found: dict[int, list[tuple[int, Format]]] = {FMT.number: [(0, FMT)]}
    for position in positions.tolist():
        message = log[position : position + FMT.length].tobytes()
        layout = parse_format(message) if len(message) == FMT.length else None
        if layout is None or layout.number == FMT.number:
            continue
        known = found.setdefault(layout.number, [])
        if not known or known[-1][1] != layout:
            known.append((position, layout))
    return {number: tuple(layouts) for number, layouts in found.items()}


def _messages(log: AnyArray, end: int, headers: IntArray, definitions: Definitions) -> tuple[IntArray, IntArray]:
    """First byte, and first byte after it, of every header that could be a message: defined, and not cut off."""
    types = log[headers + 2]
    lengths = np.zeros(TYPES, dtype=np.int64)
    for number, layouts in definitions.items():
        lengths[number] = layouts[0][1].length
    length = lengths[types]
    for number, layouts in definitions.items():
        if len(layouts) > 1:
            here = np.flatnonzero(types == number)
            length[here] = np.array([layout.length for _, layout in layouts])[_epoch(layouts, headers[here])]
    stops = headers + length
    possible = (length > 0) & (stops <= end)
    return (headers, stops) if possible.all() else (headers[possible], stops[possible])


def _epoch(layouts: Iterable[tuple[int, Format]], positions: IntArray) -> IntArray:
    """Index of the definition that holds at each position: the last one before it, or the first one of all."""
    begins = np.array([position for position, _ in layouts])
    return np.maximum(np.searchsorted(begins, positions, side="right") - 1, 0)


def _follow(begin: int, end: int, starts: IntArray, stops: IntArray) -> tuple[IntArray, list[tuple[int, int]]]:
    """The messages that form the chain from ``begin`` to ``end``, and the gaps between them.

    Wherever a candidate ends at the next candidate, the chain needs no look. The other candidates (ends) are few: false
    headers inside a message, the messages that hold them, and damage.
    """
    if not starts.size:
        return starts, [(begin, end)]
    ends = np.append(np.flatnonzero(starts[1:] != stops[:-1]), starts.size - 1)
    after = np.searchsorted(starts, stops[ends])
    # The end of the log follows a message as well as another message does.
    joined = _begin(starts, after, end) == stops[ends]
    trusted = np.ones(starts.size, dtype=np.bool_)
    trusted[ends] = joined
    runs, gaps = _walk(begin, end, starts, stops, ends, np.where(joined, after, -1), trusted)
    steps = np.zeros(starts.size + 1, dtype=np.int8)
    if runs:
        firsts, lasts = np.array(runs).T
        steps[firsts] += 1
        steps[lasts] -= 1
    chained = np.cumsum(steps[:-1], dtype=np.int8).astype(np.bool_)
    return starts if chained.all() else starts[chained], gaps


def _resume(ends: IntArray, successors: IntArray) -> IntArray:
    """The next trusted candidate after each end: only ends where the chain breaks are not trusted."""
    broken = (np.diff(ends) == 1) & (successors[1:] < 0)
    lasts = np.append(np.flatnonzero(~broken), ends.size - 1)
    following: IntArray = ends[lasts[np.searchsorted(lasts, np.arange(ends.size))]] + 1
    return following


def _begin(starts: IntArray, index: IntArray, size: int) -> IntArray:
    """First byte of each candidate; the end of the log for the index after the last one."""
    return np.where(index < starts.size, starts[np.minimum(index, starts.size - 1)], size)


def _walk(
    begin: int, end: int, starts: IntArray, stops: IntArray, ends: IntArray, successors: IntArray, trusted: BoolArray
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Runs of candidates in the chain, and gaps of bytes between them.

    ``successors`` holds, for each of ``ends``, the candidate at which it ends, or -1 where the chain breaks.
    """
    resume = _resume(ends, successors)
    reach = _begin(starts, resume, end).tolist()
    end_at, begin_of_end, stop_of_end = ends.tolist(), starts[ends].tolist(), stops[ends].tolist()
    successor, resume_at = successors.tolist(), resume.tolist()

    runs: list[tuple[int, int]] = []
    gaps: list[tuple[int, int]] = []
    at = 0 if starts[0] == begin else int(np.argmax(trusted)) if trusted.any() else starts.size
    first = int(starts[at]) if at < starts.size else end
    if first > begin:
        gaps.append((begin, first))
    place = 0
    while at < starts.size:
        place = bisect_left(end_at, at, place)
        last, stop = end_at[place], stop_of_end[place]
        following = successor[place]
        if following < 0:
            following = resume_at[place]
            # A message that reaches over the header at which the chain goes on has lost or changed bytes itself.
            overrun = stop > reach[place]
            stop = begin_of_end[place] if overrun else stop
            last -= overrun
            if stop < reach[place]:
                gaps.append((stop, reach[place]))
        if last >= at:
            runs.append((at, last + 1))
        at = following
    return runs, gaps


def _tables(
    log: AnyArray, found: Mapping[int, IntArray], definitions: Definitions, names: Collection[str] | None
) -> tuple[Mapping[str, Table], tuple[str, ...]]:
    """One table for each wanted definition with messages, in the order of their names' first definition."""
    parts: list[tuple[int, Format, IntArray]] = []
    for number, layouts in definitions.items():
        positions = found.get(number, np.empty(0, dtype=np.int64))
        if len(layouts) == 1:
            parts.append((*layouts[0], positions))
            continue
        epoch = _epoch(layouts, positions)
        parts += [(place, layout, positions[epoch == index]) for index, (place, layout) in enumerate(layouts)]
    bare: dict[str, Table] = {}
    undecodable: dict[str, None] = {}
    named: Counter[str] = Counter()
    for _, layout, positions in sorted(parts, key=lambda part: part[0]):
        if not positions.size:
            continue
        if not layout.decodable:
            undecodable[layout.name] = None
            continue
        named[layout.name] += 1
        key = layout.name if named[layout.name] == 1 else f"{layout.name}#{named[layout.name]}"
        bare[key] = Table(format=layout, units={}, data=log, positions=positions)
    units = _units_of(bare)
    tables = {
        key: replace(table, units=units.get(table.format.number, {}))
        for key, table in bare.items()
        if names is None or table.name in names
    }
    return MappingProxyType(tables), tuple(undecodable)


def _damage(log: DataFlashLog) -> Iterator[Finding]:
    inner = [gap for gap in log.gaps if gap[1] < log.size]
    if inner:
        skipped = sum(stop - start for start, stop in inner)
        yield warn(
            "corrupt_log",
            "log",
            f"{skipped} bytes in {len(inner)} places are not messages and were skipped, the first at byte "
            f"{inner[0][0]}; samples are missing there, and the format has no checksum: other values may be wrong too",
            bytes=skipped,
            places=len(inner),
            first_byte=inner[0][0],
            log_bytes=log.size,
        )
    for start, stop in log.gaps[-1:]:
        if stop == log.size:
            yield remark(
                "corrupt_log",
                "log",
                f"the last {stop - start} bytes of the log, from byte {start} on, are no complete message and were "
                "skipped",
                bytes=stop - start,
                places=1,
                first_byte=start,
                log_bytes=log.size,
            )
    if log.undecodable:
        yield warn(
            "corrupt_log",
            ", ".join(log.undecodable),
            f"the definitions of {', '.join(log.undecodable)} are contradictory; these messages were not decoded",
            messages=len(log.undecodable),
        )


def parse_format(message: bytes) -> Format | None:
    """Read one ``FMT`` message of 89 bytes, header included; ``None`` when it cannot be one.

    Examples
    --------
    >>> texts = b"RATE" + b"Qf".ljust(16, bytes(1)) + b"TimeUS,R".ljust(64, bytes(1))
    >>> parse_format(bytes([0xA3, 0x95, 128, 75, 15]) + texts).columns
    ('TimeUS', 'R')
    """
    number, length = message[3], message[4]
    name, letters, columns = (text_of(part) for part in (message[5:9], message[9:25], message[25:89]))
    if length < HEADER_BYTES or not name or not (name.isascii() and name.isprintable()):
        return None
    return Format(
        number=number,
        length=length,
        name=name,
        letters=letters,
        columns=tuple(columns.split(",")) if columns else (),
    )


def text_of(raw: bytes) -> str:
    """Text up to the first zero byte; UTF-8, or Latin-1 where the field is not UTF-8."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.partition("\0")[0]


def _texts(raw: AnyArray) -> AnyArray:
    """Text of each row of bytes, shape ``(messages, width)`` to ``(messages,)``."""
    width = raw.shape[1]
    if raw.size and raw.max() > 0x7F:
        return np.array([text_of(row.tobytes()) for row in raw], dtype=f"<U{width}")
    before_zero = np.logical_and.accumulate(raw != 0, axis=1)
    ascii_bytes = np.where(before_zero, raw, 0).astype(np.uint8)
    # ASCII is the first page of Unicode: widening the bytes is the whole conversion.
    return ascii_bytes.astype("<u4").view(f"<U{width}")[:, 0]


_INSTANCE_UNIT = "instance"
"""Unit label of the column that numbers identical sensors."""

PREFIXES: Mapping[float, str] = {0.0: "", 1.0: "", 1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "µ", 1e-9: "n"}


def _units_of(tables: Mapping[str, Table]) -> Mapping[int, Mapping[str, str]]:
    """Type of message to the unit of each of its columns, for the values as ``Table.column`` returns them.

    A multiplier becomes a prefix of the unit (``cm/s``), or a number in front of it (``100 m``) when no prefix fits.
    The letters that carry a factor themselves are already scaled, so that their multiplier is left out.
    """
    if not {"FMTU", "UNIT"} <= tables.keys():
        return {}
    labels = _lookup(tables["UNIT"], "Label")
    multipliers = _lookup(tables["MULT"], "Mult") if "MULT" in tables else {}
    formats = {table.format.number: table.format for table in tables.values()}
    declared = tables["FMTU"]
    if not (declared.holds_numbers("FmtType") and declared.holds_text("UnitIds", "MultIds")):
        return {}
    rows = zip(*(declared.column(name).tolist() for name in ("FmtType", "UnitIds", "MultIds")), strict=True)
    return {
        number: _columns(formats[number], unit_ids, mult_ids, labels, multipliers)
        for number, unit_ids, mult_ids in rows
        if number in formats
    }


def _lookup(table: Table, column: str) -> Mapping[str, object]:
    if column not in table or not table.holds_numbers("Id") or table.column("Id").dtype.kind not in "iu":
        return {}
    return {
        chr(key & 0xFF): value
        for key, value in zip(table.column("Id").tolist(), table.column(column).tolist(), strict=True)
    }


def _columns(
    layout: Format, unit_ids: str, mult_ids: str, labels: Mapping[str, object], multipliers: Mapping[str, object]
) -> Mapping[str, str]:
    units = {}
    for index, (column, letter) in enumerate(zip(layout.columns, layout.letters, strict=False)):
        label = str(labels.get(unit_ids[index : index + 1], ""))
        multiplier = multipliers.get(mult_ids[index : index + 1])
        if label and LETTERS[letter].divisor == 1.0 and isinstance(multiplier, float):
            # The log stores single-precision numbers in a double: seven digits are what was meant.
            rounded = float(f"{multiplier:.7g}")
            label = PREFIXES[rounded] + label if rounded in PREFIXES else f"{rounded:.4g} {label}"
        if label:
            units[column] = label
    return units
