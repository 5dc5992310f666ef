"""ArduPilot DataFlash logs: bytes to tables of messages.

A log is a chain of messages without checksum or framing: two magic bytes, a type, and as many bytes as the ``FMT``
message of that type declared. The magic also occurs inside messages, so that the chain must be followed; it is
followed for all messages at once, and step by step only where a false or damaged header interrupts it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import LogError
from rotorid.io.dataflash_formats import FMT, HEADER_BYTES, Format, Table, parse_format
from rotorid.io.dataflash_units import units_of
from rotorid.typing import AnyArray, BoolArray, IntArray

MAGIC = (0xA3, 0x95)
TYPES = 256
SNIFFED = bytes((*MAGIC, FMT.number, FMT.number, FMT.length)) + b"FMT"
ROUNDS = 4
"""How often the chain is followed anew when it turns out that a definition was no message of the chain."""

CACHED_BYTES = 1 << 19
SECTION_BYTES = 1 << 24
"""The chain is followed by sections, so that memory does not grow with the log."""

DECIDED_BYTES = 1 << 10
"""What follows this far behind a message has no say in whether it belongs to the chain: four of the longest ones."""

UNIT_NAMES = frozenset({"UNIT", "MULT", "FMTU"})

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
    """

    tables: Mapping[str, Table]
    gaps: tuple[tuple[int, int], ...]
    size: int
    undecodable: tuple[str, ...] = ()

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

    Nothing in the format tells a damaged value from a true one: there is no checksum. What is noticed is a chain that
    breaks. Then the reader goes on at the next header that another header or the end of the log follows, gives up a
    message that reaches beyond that place, and counts the bytes in between as skipped. Beside the log itself, memory is
    needed for the positions of the messages that are asked for, four bytes each, and for one section.

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
    for _ in range(ROUNDS):
        found, gaps = _chain(log, definitions, names)
        confirmed = _definitions(log, found[FMT.number])
        if confirmed == definitions:
            break
        definitions = confirmed
    if not any(number != FMT.number for number in definitions):
        raise LogError(
            f"no message definitions stand in these {log.size} bytes",
            needed="an ArduPilot DataFlash log (.BIN), which begins with FMT messages",
            remedy="download the log from the autopilot again, in binary form",
        )
    tables, undecodable = _tables(log, found, definitions, names)
    return DataFlashLog(tables=tables, gaps=gaps, size=log.size, undecodable=undecodable)


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
        end = min(begin + length, log.size)
        headers = _headers(log, begin, end)
        starts, gaps = _follow(begin, end, *_messages(log, end, headers, definitions))
        if end == log.size:
            yield starts, gaps
            return
        last = int(np.searchsorted(starts, end - DECIDED_BYTES)) - 1
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
    units = units_of(bare)
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
        yield Finding(
            kind="corrupt_log",
            severity="warning",
            where="log",
            message=f"{skipped} bytes in {len(inner)} places are not messages and were skipped, the first at byte "
            f"{inner[0][0]}; samples are missing there, and the format has no checksum to vouch for the others",
            numbers={"bytes": skipped, "places": len(inner), "first_byte": inner[0][0], "log_bytes": log.size},
        )
    for start, stop in log.gaps[-1:]:
        if stop == log.size:
            yield Finding(
                kind="corrupt_log",
                severity="info",
                where="log",
                message=f"the log ends with {stop - start} bytes from byte {start} on that are no complete message; "
                "they were skipped",
                numbers={"bytes": stop - start, "places": 1, "first_byte": start, "log_bytes": log.size},
            )
    if log.undecodable:
        yield Finding(
            kind="corrupt_log",
            severity="warning",
            where=", ".join(log.undecodable),
            message=f"the definitions of {', '.join(log.undecodable)} contradict themselves; these messages were not "
            "decoded",
            numbers={"messages": len(log.undecodable)},
        )
