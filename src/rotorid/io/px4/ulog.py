"""PX4's ULog container as arrays of the topics that are wanted.

A file defines formats, and topics that use them; nothing here spells a format out: sizes are added up, and a field is
looked for by its name. Definitions that contain themselves, describe messages that cannot exist, or are more than any
logger writes are refused.

ULog has no checksums, but every message states its size and type, and every data message names a subscription whose
format fixes the size. A parser that trusts these numbers loses its way after one flipped bit without noticing; the walk
notices, and finds the way again. Data messages, nine of ten, are found by the block and followed all at once; only
where their chain is interrupted does the walk go step by step.

The file is mapped, not read, and only the fields that are asked for are collected from it. Memory follows what is
returned, not the size of the file.

References
----------
PX4 developer guide, "ULog File Format", above all the sections "Format Message" and "Subscription Message".
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rotorid.errors import LogError
from rotorid.io.files import Place, file_bytes, gather, let_go, log_progress
from rotorid.io.parameters import changed_in
from rotorid.typing import AnyArray, IntArray

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
MESSAGE_HEADER_BYTES = 3

TYPES = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "bool": "i1",
    "char": "S1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
}
"""Types of the format and what they are in NumPy."""

_CLOCKS = ("timestamp", "timestamp_sample")
_DATA_STARTS = MESSAGE_HEADER_BYTES + 2
_INFORMATION = ("sys_name", "ver_sw_release")
"""What is read of the information that a log carries; it also holds serial numbers, which are nobody's business."""

_WAITING_BYTES = 96 << 20

_NUMBERS = {"float": struct.Struct("<f"), "int32_t": struct.Struct("<i"), "uint32_t": struct.Struct("<I")}


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples(Mapping[str, AnyArray]):
    """``topic/field`` to the samples as logged, shape ``(samples,)``, collected when they are asked for.

    All fields of a topic are collected with the first of them, unless they are many, and are forgotten when another
    topic is asked for: so the samples of a large log never all exist beside the record that is made of them.
    """

    data: AnyArray
    fields: Mapping[str, tuple[Stream, Place]]
    _waiting: dict[str, AnyArray] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str) -> AnyArray:
        if name in self._waiting:
            return self._waiting[name]
        self._waiting.clear()
        stream, place = self.fields[name]
        siblings = {other: at for other, (of, at) in self.fields.items() if of is stream}
        if sum(dtype.itemsize for _, dtype in siblings.values()) * stream.positions.size > _WAITING_BYTES:
            return gather(self.data, stream.positions, [place])[0]
        self._waiting.update(zip(siblings, gather(self.data, stream.positions, list(siblings.values())), strict=True))
        return self._waiting[name]

    def __contains__(self, name: object) -> bool:
        return name in self.fields

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        return len(self.fields)


@dataclass(frozen=True, kw_only=True, eq=False)
class ULog:
    """What a log holds of the wanted topics, and what it says about itself.

    Parameters
    ----------
    arrays
        The fields that exist, and the stamps ``topic/timestamp`` and ``topic/timestamp_sample``.
    parameters
        The autopilot's parameters at the end of the log.
    changed
        First and last value of gains and filters that changed in it.
    info
        Name and packed version of the firmware.
    dropouts
        Time and duration of the losses that the logger noticed, in seconds.
    damage
        First byte, first byte after, and reason of what cannot be read.
    size_bytes
        Length of the file.
    subscribed
        Names of all topics that the logger was to write.
    """

    arrays: Mapping[str, AnyArray]
    parameters: Mapping[str, float]
    changed: Mapping[str, tuple[float, float]]
    info: Mapping[str, str | int]
    dropouts: Sequence[tuple[float, float]]
    damage: Sequence[tuple[int, int, str]]
    size_bytes: int
    subscribed: tuple[str, ...] = ()


def extract(path: Path, topics: Mapping[str, Sequence[str]]) -> ULog:
    """Collect the wanted fields of a ULog file.

    Parameters
    ----------
    path
        A ULog file.
    topics
        Name of a topic to the names of its fields, such as ``xyz[0]``. Of several instances the first is read; another
        one is asked for with its number, ``battery_status:1``.

    Raises
    ------
    LogError
        The file cannot be read, is cut inside its header, is of a kind that is not understood, or its definitions
        cannot be true.
    """
    data = file_bytes(path)
    if data.size <= HEADER_BYTES or data[: len(MAGIC)].tobytes() != MAGIC:
        raise LogError(
            f"this ULog file of {data.size} bytes ends inside its header",
            needed="a whole log",
            remedy="copy it again from the vehicle",
        )
    _refuse_unknown_kind(data)
    found = walk(data, topics)
    streams: dict[str, Stream] = {}
    for stream in found.streams:
        if stream.positions.size:
            streams.setdefault(stream.subscription.called, stream)
    fields: dict[str, tuple[Stream, Place]] = {}
    damage = [(item.start, item.stop, item.reason) for item in found.damage]
    for topic, stream in streams.items():
        places = _places(found, stream, (*_CLOCKS, *topics[topic]))
        if "timestamp" in places:
            fields |= {f"{topic}/{name}": (stream, place) for name, place in places.items()}
        else:
            damage.append((HEADER_BYTES, HEADER_BYTES, f"the definition of {topic} names no time stamps"))
    arrays = Samples(data=data, fields=fields)
    parameters, changed, info = _statements(data, found)
    return ULog(
        arrays=arrays,
        parameters=parameters,
        changed=changed,
        info=info,
        dropouts=list(_dropouts(data, found, streams, arrays)),
        damage=damage,
        size_bytes=data.size,
        subscribed=found.subscribed,
    )


def _refuse_unknown_kind(data: AnyArray) -> None:
    """Refuse a file that says of itself that an older reader would misread it."""
    head = data[HEADER_BYTES : HEADER_BYTES + 19].tobytes()
    if len(head) == 19 and head[2] == ord("B") and (head[11] & ~1 or any(head[12:])):
        raise LogError(
            f"the ULog file is of a kind that is not understood: its incompatible flags are {head[11:].hex()}",
            needed="a log of PX4 1.3 to 1.17",
            remedy="look for a newer version of rotorid",
        )


def _places(found: Walk, stream: Stream, names: Sequence[str]) -> dict[str, Place]:
    """Where in its messages the fields stand that a topic has and that are numbers."""
    places: dict[str, Place] = {}
    for name in names:
        place = found.definitions.locate(stream.subscription.topic, name)
        if place is None:
            continue
        offset, dtype = place
        if dtype.kind == "S":
            # A letter is read as its code.
            dtype = np.dtype(np.uint8)
        # A format that was defined anew, with other sizes, after its topic had begun.
        beyond = 2 + offset + dtype.itemsize > stream.subscription.least_bytes
        if not (beyond or (name in _CLOCKS and dtype != np.uint64)):
            places[name] = (_DATA_STARTS + offset, dtype)
    return places


def _statements(
    data: AnyArray, found: Walk
) -> tuple[dict[str, float], dict[str, tuple[float, float]], dict[str, str | int]]:
    """Parameters, of one that changed in flight the last value; which changed; and information of the firmware."""
    stated: list[tuple[str, float]] = []
    info: dict[str, str | int] = {}
    for position in found.statements:
        letter, payload = _message(data, position)
        if letter == "O":
            continue
        length = payload[0]
        kind, _, name = payload[1 : 1 + length].decode("ascii").partition(" ")
        value = payload[1 + length :]
        if letter == "I" and name in _INFORMATION and kind.startswith("char["):
            info[name] = value.decode("utf-8", errors="replace").rstrip("\0")
        elif kind in _NUMBERS and len(value) == _NUMBERS[kind].size and (letter == "P" or name in _INFORMATION):
            (number,) = _NUMBERS[kind].unpack(value)
            if letter == "P":
                stated.append((name, float(number)))
            else:
                info[name] = number
    return dict(stated), changed_in(stated), info


def _dropouts(
    data: AnyArray, found: Walk, streams: Mapping[str, Stream], arrays: Mapping[str, AnyArray]
) -> Iterator[tuple[float, float]]:
    """Losses that the logger noticed; a dropout has no stamp but that of the data before it."""
    lost = [position for position in found.statements if data[position + 2] == ord("O")]
    if not lost:
        return
    last_us = np.zeros(len(lost), dtype=np.uint64)
    for topic, stream in streams.items():
        if f"{topic}/timestamp" in arrays:
            stamps = np.append(arrays[f"{topic}/timestamp"], np.uint64(0))
            # Without data before the loss the index is -1, which is the appended zero.
            last_us = np.maximum(last_us, stamps[np.searchsorted(stream.positions, lost) - 1])
    for position, stamp_us in zip(lost, last_us.tolist(), strict=True):
        _, payload = _message(data, position)
        yield stamp_us * 1e-6, int.from_bytes(payload, "little") * 1e-3


def _message(data: AnyArray, position: int) -> tuple[str, bytes]:
    """Letter and payload of a message."""
    size = int(data[position]) | int(data[position + 1]) << 8
    start = position + MESSAGE_HEADER_BYTES
    return chr(data[position + 2]), data[start : start + size].tobytes()


SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
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
# What stands among the definitions and has a text that shows it: chance finds three of them in a row in no file.
_DEFINING = np.frombuffer(b"FIMPQA", dtype=np.uint8)
_MOST_KEPT = 1 << 20
_LEVELS = tuple(bytes([digit]) for digit in b"01234567")
_PRINTABLE = re.compile(rb"[ -~]*")
_TEXT_STARTS = {ord("L"): 9, ord("C"): 11}
_CHAIN = 3
_FIRST_BLOCK, _LARGEST_BLOCK = 1 << 14, 1 << 22
_PROGRESS_BLOCK = 1 << 25


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
    subscribed
        Names of all topics that the logger was to write, each once.
    """

    intact: tuple[tuple[int, int], ...]
    damage: tuple[Damage, ...]
    streams: tuple[Stream, ...]
    statements: tuple[int, ...]
    definitions: Definitions
    subscribed: tuple[str, ...] = ()


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
            if reason:
                position = walker.swallowing(position, stop)
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
        subscribed=tuple(dict.fromkeys(subscription.topic for subscription in walker.known.values())),
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
        self.has_data = False
        self.last = HEADER_BYTES
        self.known: dict[int, Subscription] = {}
        self.parts: list[_Part] = []
        self.statements: list[int] = []
        # By number of the subscription: payloads that its messages can have, and the place of its part, or -1.
        self.least = np.ones(1 << 16, dtype=np.int32)
        self.most = np.zeros(1 << 16, dtype=np.int32)
        self.part_of = np.full(1 << 16, -1, dtype=np.int32)
        self.position_type = np.int32 if data.size < np.iinfo(np.int32).max else np.int64
        self.block_bytes = _FIRST_BLOCK
        self.reported = 0
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
            self.last, position = position, after
        return position, "" if position == stop else "the file ends inside a message"

    def resume(self, position: int, stop: int) -> int:
        """Next place after ``position`` where messages follow each other; ``stop`` when there is none.

        A message of an unknown type, as newer firmware may write, ends where its size says if others follow there.
        Otherwise data messages, whose numbers and sizes are known, show where to go on. Among the definitions, before
        the first data, the definitions themselves do: a break there loses a message, not all topics behind it.
        """
        if position + _HEADER.size <= stop:
            size, letter, _ = _HEADER.unpack_from(self.view, position)
            after = position + MESSAGE_HEADER_BYTES + int(size)
            if letter != _DATA and letter not in _PAYLOADS and after < stop and self._is_chain(after, stop):
                return after
        at = position + 1
        while at + _HEADER.size <= stop:
            block = self._block_at(at, stop)
            data = next(
                (place for place in block.places[bisect_left(block.places, at) :] if self._is_chain(place, stop)), None
            )
            if not self.has_data:
                statement = self._next_statement(at, block.end if data is None else data, stop)
                data = data if statement is None else statement
            if data is not None:
                return data
            at = block.end
        return stop

    def swallowing(self, position: int, stop: int) -> int:
        """Start of the message before a break, if others are inside it: its size is what broke; else the break.

        Only among the definitions, where a size that grew would hide the topics behind it.
        """
        if self.has_data or self.last >= position or self._next_statement(self.last + 1, position, stop) is None:
            return position
        return self.last

    def _next_statement(self, at: int, end: int, stop: int) -> int | None:
        """First place from ``at`` to ``end`` where messages other than data follow each other."""
        letters = self.data[at + 2 : end + 2]
        for place in (np.flatnonzero(np.isin(letters, _DEFINING)) + at).tolist():
            if self._is_chain(place, stop):
                return int(place)
        return None

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
            self.has_data = True
            block.runs.append((first, last + 1))
        return after

    def _block_at(self, position: int, stop: int) -> _Block:
        """The block that holds a position: the one at hand, or the next one."""
        if self.block.begin <= position < self.block.end:
            return self.block
        self.collect()
        begin, end = position, min(position + self.block_bytes, stop - _HEADER.size + 1)
        self.block_bytes = min(2 * self.block_bytes, _LARGEST_BLOCK)
        if begin >= self.reported + _PROGRESS_BLOCK:
            self.reported = begin
            let_go(self.data)
            log_progress(begin, self.data.size)
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
        if self.known.get(identity) == subscription:
            return
        self.known[identity] = subscription
        # What could be a message changes from here on, so that the block at hand ends here.
        self.collect()
        self.block.end = self.block.begin
        self.block_bytes = _FIRST_BLOCK
        self.least[identity], self.most[identity] = subscription.least_bytes, subscription.most_bytes
        self.part_of[identity] = -1
        if subscription.called in self.topics:
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
    if letter == ord("S") and payload != SYNC[: len(payload)]:
        return "a synchronization message is damaged"
    if letter == ord("B") and position != HEADER_BYTES:
        return "the flags are in the middle of the file"
    if letter in b"LC" and (payload[:1] not in _LEVELS or 0 in payload[_TEXT_STARTS[letter] :]):
        return "a text message contains no text"
    if letter in b"FA" and not _PRINTABLE.fullmatch(payload, 0 if letter == ord("F") else 3):
        return "the definition of a topic contains no text"
    if letter in b"IP" and not _PRINTABLE.fullmatch(payload, 1, 1 + payload[0]):
        return "a parameter or an information has no readable name"
    return ""


MOST = 1 << 16
"""Of anything that a log counts in its definitions: topics, parameters, places of damage."""

_MOST_TEXT = 1 << 22
_MOST_MEASURED = 1 << 20
_LARGEST_MESSAGE = 0xFFFF
_DEEPEST = 8
_STEP = re.compile(r"(\w+)\[(\d{1,5})\]")
_SIZES = {name: np.dtype(code).itemsize for name, code in TYPES.items()}


@dataclass(frozen=True, kw_only=True, slots=True)
class Member:
    """One field of a format: ``kind`` is a type or another format, ``count`` is ``None`` for what is no array."""

    kind: str
    count: int | None
    name: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Subscription:
    """One topic of a log: its name, which of several like it, and the payloads that its messages can have.

    A payload begins with two bytes for the number of the subscription; loggers may leave the padding at the end out.
    """

    topic: str
    instance: int
    least_bytes: int
    most_bytes: int

    @property
    def called(self) -> str:
        """Its name among topics that are asked for: with the number of its instance, but for the first."""
        return f"{self.topic}:{self.instance}" if self.instance else self.topic


@dataclass(slots=True)
class Definitions:
    """What the messages of a file defined so far; grows as they are learned."""

    formats: dict[str, tuple[Member, ...]] = field(default_factory=dict)
    text_bytes: int = 0
    measured: int = 0

    def learn(self, payload: bytes) -> None:
        """Learn the payload of a format message."""
        self.text_bytes += len(payload)
        if self.text_bytes > _MOST_TEXT:
            raise impossible(f"they are longer than {_MOST_TEXT >> 20} MiB")
        name, _, rest = payload.decode("utf-8", errors="replace").partition(":")
        members: list[Member] = []
        for item in filter(None, rest.split(";")):
            kind, _, label = item.partition(" ")
            kind, bracket, count = kind.partition("[")
            digits = count.rstrip("]")
            if bracket and not digits.isdecimal():
                return  # The topic stays without a format, which its subscription will say.
            members.append(Member(kind=kind, count=int(digits[:9]) if bracket else None, name=label))
        self.formats[name] = tuple(members)

    def subscribe(self, payload: bytes) -> tuple[int, Subscription]:
        """Number and content of a subscription message."""
        topic = payload[3:].decode("utf-8", errors="replace")
        size, _ = self._measure(topic, ())
        padding = 0
        for member in reversed(self.formats.get(topic, ())):
            if not member.name.startswith("_padding"):
                break
            padding += _times(member) * _SIZES.get(member.kind, 0)
        subscription = Subscription(
            topic=topic, instance=payload[0], least_bytes=2 + size - padding, most_bytes=2 + size
        )
        return int.from_bytes(payload[1:3], "little"), subscription

    def locate(self, topic: str, name: str) -> tuple[int, np.dtype[np.generic]] | None:
        """Offset and type of a field such as ``xyz[2]`` in the data of a topic; ``None`` when it has no such field."""
        kind, offset = topic, 0
        for text in name.split("."):
            label, index = _label_and_index(text)
            for member in self.formats.get(kind, ()):
                if member.name == (text if member.count is None else label):
                    break
                offset += _times(member) * self._item_bytes(member.kind)
            else:
                return None
            if member.count is not None:
                if index is None or index >= member.count:
                    return None
                offset += index * self._item_bytes(member.kind)
            kind = member.kind
        return (offset, np.dtype(TYPES[kind])) if kind in TYPES else None

    def _item_bytes(self, kind: str) -> int:
        return _SIZES[kind] if kind in _SIZES else self._measure(kind, ())[0]

    def _measure(self, name: str, outer: tuple[str, ...]) -> tuple[int, int]:
        """Bytes and fields of a format with everything nested in it, counted without spelling the fields out."""
        if name in outer or len(outer) > _DEEPEST:
            raise impossible(f"that of {name[:40]!r} contains itself or is nested too deeply")
        size = count = 0
        for member in self.formats.get(name, ()):
            self.measured += 1
            if self.measured > _MOST_MEASURED:
                raise impossible("together they are longer than those of any logger")
            known = member.kind in _SIZES
            inner, parts = (_SIZES[member.kind], 1) if known else self._measure(member.kind, (*outer, name))
            size += _times(member) * inner
            count += _times(member) * max(parts, 1)
            if max(size, count) > _LARGEST_MESSAGE:
                raise impossible(f"that of {name[:40]!r} is larger than any message can be")
        return size, count


def _label_and_index(text: str) -> tuple[str, int | None]:
    """``xyz[2]`` as the name of an array and the place in it."""
    step = _STEP.fullmatch(text)
    return (text, None) if step is None else (step[1], int(step[2]))


def _times(member: Member) -> int:
    return 1 if member.count is None else member.count


def impossible(what: str) -> LogError:
    """The refusal of a file whose definitions no logger writes."""
    return LogError(
        f"the log's definitions are invalid: {what}",
        needed="a ULog file as PX4 writes it",
        remedy="copy it again from the vehicle",
    )
