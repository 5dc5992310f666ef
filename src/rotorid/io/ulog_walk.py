"""A walk over the messages of a ULog file: where it is intact, where it breaks and why, and where the data stand.

ULog has no checksums, but every message states its size and type, and every data message names a subscription whose
format fixes the size. A parser that trusts these numbers loses its way after one flipped bit without noticing; the walk
notices, and finds the way again. Data messages, nine of ten, are found by the block and followed all at once; only
where their chain is interrupted does the walk go step by step.

References
----------
PX4 developer guide, "ULog File Format".
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.io.ulog_definitions import MOST, Definitions, Subscription, impossible
from rotorid.typing import AnyArray, IntArray

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
MESSAGE_HEADER_BYTES = 3

_SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_HEADER = struct.Struct("<HBH")
_DATA = ord("D")
# Type letter to the smallest and largest payload that it can have.
_PAYLOADS: Mapping[int, tuple[int, int]] = {
    ord(letter): sizes
    for letter, sizes in {
        "B": (40, 40 + 64),
        "F": (3, 0xFFFF),
        "I": (3, 0xFFFF),
        "M": (4, 0xFFFF),
        "P": (3, 300),
        "Q": (4, 300),
        "A": (4, 300),
        "R": (2, 2),
        "S": (8, 8),
        "O": (2, 2),
        "L": (9, 0xFFFF),
        "C": (11, 0xFFFF),
    }.items()
}
_KEPT = b"IPO"
_MOST_KEPT = 1 << 20
_LEVELS = tuple(bytes([digit]) for digit in b"01234567")
_TEXT_STARTS = {ord("L"): 9, ord("C"): 11}
_CHAIN = 3
_FIRST_BLOCK, _LARGEST_BLOCK = 1 << 14, 1 << 22


@dataclass(frozen=True, kw_only=True, slots=True)
class Damage:
    """Bytes ``start`` to ``stop`` that cannot be read, and why."""

    start: int
    stop: int
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Stream:
    """Messages of one subscription: the first byte of each, shape ``(messages,)``, rising."""

    subscription: Subscription
    positions: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """Result of `walk`: what of the file is intact, and what stands where.

    Parameters
    ----------
    intact
        Byte ranges of whole messages, in order; the file header belongs to the first.
    damage
        The ranges between them.
    streams
        Data of the topics that were asked for, first instances only, in the order in which they were subscribed.
    statements
        First byte of each message that states an information, a parameter or a dropout, in order.
    definitions
        Formats as they were at the end of the file.
    """

    intact: tuple[tuple[int, int], ...]
    damage: tuple[Damage, ...]
    streams: tuple[Stream, ...]
    statements: tuple[int, ...]
    definitions: Definitions


def walk(data: bytes | AnyArray, topics: Collection[str] = ()) -> Walk:
    """Walk all messages of a ULog file.

    A break is a letter that names no message type, a size that its type or format cannot have, a size beyond the end of
    the file, or data of a subscription that does not exist. After a break the walk goes on where three valid messages
    follow each other. A change inside a payload is not seen: the format has no checksum. Beside the file itself, memory
    is needed for the positions of the data that were asked for, and for a block of four megabytes.

    Parameters
    ----------
    data
        The whole file, as bytes or as an array of ``uint8``.
    topics
        Names of the topics whose data are wanted.

    Raises
    ------
    LogError
        The definitions are nested without end, describe messages that cannot exist, or are more than a logger writes.
    """
    walker = _Walker(data=np.frombuffer(data, dtype=np.uint8), topics=topics)
    intact: list[tuple[int, int]] = []
    damage: list[Damage] = []
    start, position = 0, HEADER_BYTES
    for stop in _section_stops(walker.view):
        while True:
            position, reason = walker.advance(position, stop)
            intact.append((start, position))
            if not reason:
                break
            start = walker.resume(position, stop)
            damage.append(Damage(start=position, stop=start, reason=reason))
            if len(damage) > MOST:
                raise impossible(f"they are broken in more than {MOST} places")
            position = start
        start = position = stop
    walker.collect()
    return Walk(
        intact=tuple(span for span in intact if span[0] < span[1]),
        damage=tuple(damage),
        streams=tuple(_Part.joined(part) for part in walker.parts),
        statements=tuple(walker.statements),
        definitions=walker.definitions,
    )


def _section_stops(view: memoryview) -> list[int]:
    """Ends of the sections: data that were appended after a crash start anew, the message before may be cut."""
    flags = HEADER_BYTES + MESSAGE_HEADER_BYTES
    whole = [len(view)]
    if len(view) < flags + 40:
        return whole
    size, letter, _ = _HEADER.unpack_from(view, HEADER_BYTES)
    if letter != ord("B") or size < 40 or not view[flags + 8] & 1:
        return whole
    offsets = [offset for offset in struct.unpack_from("<3Q", view, flags + 16) if offset]
    if sorted(set(offsets)) != offsets or any(not flags + 40 <= offset < len(view) for offset in offsets):
        return whole
    return offsets + whole


@dataclass(kw_only=True, slots=True)
class _Part:
    """A stream while it is being collected."""

    subscription: Subscription
    pieces: list[IntArray] = field(default_factory=list)

    def joined(self) -> Stream:
        positions = np.concatenate(self.pieces) if self.pieces else np.empty(0, dtype=np.int64)
        self.pieces.clear()
        return Stream(subscription=self.subscription, positions=positions)


@dataclass(kw_only=True, slots=True)
class _Block:
    """All places from ``begin`` to ``end`` where data messages could start, and the ends of their unbroken runs."""

    begin: int
    end: int
    starts: IntArray
    places: list[int]
    run_ends: list[int]
    run_stops: list[int]
    runs: list[tuple[int, int]] = field(default_factory=list)


class _Walker:
    """State of a walk: what the messages so far defined, the block at hand, and what was found."""

    def __init__(self, *, data: AnyArray, topics: Collection[str]) -> None:
        self.data = data
        self.view = memoryview(data)  # type: ignore[arg-type]  # every array is a buffer, which its stub says from 3.12 on
        self.topics = topics
        self.definitions = Definitions()
        self.subscriptions = 0
        self.parts: list[_Part] = []
        self.statements: list[int] = []
        # By number of the subscription: payloads that its messages can have, and the place of its part, or -1.
        self.least = np.ones(1 << 16, dtype=np.int32)
        self.most = np.zeros(1 << 16, dtype=np.int32)
        self.part_of = np.full(1 << 16, -1, dtype=np.int32)
        self.position_type = np.int32 if data.size < np.iinfo(np.int32).max else np.int64
        self.block_bytes = _FIRST_BLOCK
        self.block = _Block(begin=0, end=0, starts=np.empty(0, np.int64), places=[], run_ends=[], run_stops=[])

    def advance(self, position: int, stop: int) -> tuple[int, str]:
        """Walk whole messages from ``position``; where the walk ended, and why if not at ``stop``."""
        unpack, view = _HEADER.unpack_from, self.view
        while position + _HEADER.size <= stop:
            size, letter, identity = unpack(view, position)
            if letter == _DATA:
                after = self._hop(position, stop)
                if after == position:
                    if not self.least[identity] <= size <= self.most[identity]:
                        return position, "a data message has a size or a number that no topic of the log has"
                    return position, "the file ends inside a message"
                position = after
                continue
            if reason := _refuse(view, position, size, letter):
                return position, reason
            after = position + MESSAGE_HEADER_BYTES + size
            if after > stop:
                return position, "the file ends inside a message"
            self._learn(letter, position, after)
            position = after
        return position, "" if position == stop else "the file ends inside a message"

    def resume(self, position: int, stop: int) -> int:
        """Next place after ``position`` where data messages follow each other; ``stop`` when there is none."""
        at = position + 1
        while at + _HEADER.size <= stop:
            block = self._block_at(at, stop)
            for index in range(bisect_left(block.places, at), len(block.places)):
                if self._is_chain(block.places[index], stop):
                    return block.places[index]
            at = block.end
        return stop

    def collect(self) -> None:
        """Sort the data messages of the block at hand into the parts that were asked for."""
        block = self.block
        if not block.runs:
            return
        starts = np.concatenate([block.starts[first:after] for first, after in block.runs])
        block.runs.clear()
        owners = self.part_of[_u16(self.data, starts + MESSAGE_HEADER_BYTES)]
        wanted = np.flatnonzero(owners >= 0)
        order = wanted[np.argsort(owners[wanted], kind="stable")]
        borders = np.flatnonzero(np.diff(owners[order])) + 1
        for group in np.split(order, borders):
            if group.size:
                self.parts[owners[group[0]]].pieces.append(starts[group].astype(self.position_type))

    def _hop(self, position: int, stop: int) -> int:
        """End of the unbroken run of data messages that starts here; ``position`` itself when none does."""
        block = self._block_at(position, stop)
        first = bisect_left(block.places, position)
        if first == len(block.places) or block.places[first] != position:
            return position
        run = bisect_left(block.run_ends, first)
        last, after = block.run_ends[run], block.run_stops[run]
        if after > stop:
            last, after = last - 1, block.places[last]
        if last >= first:
            block.runs.append((first, last + 1))
        return after

    def _block_at(self, position: int, stop: int) -> _Block:
        """The block that holds a position: the one at hand, or the next one."""
        if self.block.begin <= position < self.block.end:
            return self.block
        self.collect()
        begin, end = position, min(position + self.block_bytes, stop - _HEADER.size + 1)
        self.block_bytes = min(2 * self.block_bytes, _LARGEST_BLOCK)
        # The type letter is the third byte of a header.
        starts = np.flatnonzero(self.data[begin + 2 : end + 2] == _DATA) + begin
        size, identity = _u16(self.data, starts), _u16(self.data, starts + MESSAGE_HEADER_BYTES)
        possible = (self.least[identity] <= size) & (size <= self.most[identity])
        starts = starts[possible]
        stops = starts + MESSAGE_HEADER_BYTES + size[possible]
        ends = np.append(np.flatnonzero(starts[1:] != stops[:-1]), starts.size - 1) if starts.size else starts
        self.block = _Block(
            begin=begin,
            end=end,
            starts=starts,
            places=starts.tolist(),
            run_ends=ends.tolist(),
            run_stops=stops[ends].tolist(),
        )
        return self.block

    def _is_chain(self, position: int, stop: int) -> bool:
        for _ in range(_CHAIN):
            if position + _HEADER.size > stop:
                return position == stop
            size, letter, identity = _HEADER.unpack_from(self.view, position)
            if letter == _DATA:
                if not self.least[identity] <= size <= self.most[identity]:
                    return False
            elif _refuse(self.view, position, size, letter):
                return False
            position += MESSAGE_HEADER_BYTES + size
        return position <= stop

    def _learn(self, letter: int, position: int, after: int) -> None:
        payload = slice(position + MESSAGE_HEADER_BYTES, after)
        if letter == ord("F"):
            self.definitions.learn(bytes(self.view[payload]))
        elif letter == ord("A"):
            self._subscribe(*self.definitions.subscribe(bytes(self.view[payload])))
        elif letter in _KEPT:
            self.statements.append(position)
            if len(self.statements) > _MOST_KEPT:
                raise impossible(f"there are more than {_MOST_KEPT} parameters and dropouts")

    def _subscribe(self, identity: int, subscription: Subscription) -> None:
        self.subscriptions += 1
        if self.subscriptions > MOST:
            raise impossible(f"there are more than {MOST} topics")
        # What could be a message changes from here on, so that the block at hand ends here.
        self.collect()
        self.block.end = self.block.begin
        self.block_bytes = _FIRST_BLOCK
        self.least[identity], self.most[identity] = subscription.least_bytes, subscription.most_bytes
        self.part_of[identity] = -1
        if subscription.topic in self.topics and subscription.instance == 0:
            self.part_of[identity] = len(self.parts)
            self.parts.append(_Part(subscription=subscription))


def _u16(data: AnyArray, positions: IntArray) -> AnyArray:
    low, high = (data[positions + place].astype(np.uint16) for place in (0, 1))
    number: AnyArray = low | high << 8
    return number


def _refuse(view: memoryview, position: int, size: int, letter: int) -> str:
    """Why these bytes are no header of a message other than data; empty when they are one."""
    low, high = _PAYLOADS.get(letter, (1, 0))
    if high == 0:
        return "a byte that names no message type stands where a message should start"
    if not low <= size <= high:
        return f"a message of type {chr(letter)} has an impossible size of {size} bytes"
    start = position + MESSAGE_HEADER_BYTES
    payload = bytes(view[start : start + size])
    if letter == ord("S") and payload != _SYNC[: len(payload)]:
        return "a synchronization message is damaged"
    if letter == ord("B") and position != HEADER_BYTES:
        return "the flags of the file stand in its middle"
    if letter in b"LC" and (payload[:1] not in _LEVELS or 0 in payload[_TEXT_STARTS[letter] :]):
        return "a text message holds no text"
    if letter in b"FA" and not payload[0 if letter == ord("F") else 3 :].isascii():
        return "the definition of a topic holds no text"
    if letter in b"IP" and not payload[1 : 1 + payload[0]].isascii():
        return "a parameter or an information has no readable name"
    return ""
