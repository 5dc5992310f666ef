"""A walk over the message headers of a ULog file: where it is intact, where it breaks, and why.

ULog has no checksums, but every message states its size and type, and every data message names a subscription whose
format fixes the size. A parser that trusts these numbers loses its way after one flipped bit without noticing; the walk
notices, and finds the way again.

Reference: PX4 developer guide, "ULog File Format".
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from rotorid.errors import LogError

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16

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
_SIZES = {"int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4}
_SIZES |= {"float": 4, "int64_t": 8, "uint64_t": 8, "double": 8}
_LEVELS = tuple(bytes([digit]) for digit in b"01234567")
_TEXT_STARTS = {ord("L"): 9, ord("C"): 11}
_CHAIN = 3
_LARGEST_MESSAGE = 0xFFFF


@dataclass(frozen=True, kw_only=True, slots=True)
class Damage:
    """Bytes ``start`` to ``stop`` that cannot be read, and why."""

    start: int
    stop: int
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Walk:
    """Result of `walk`: what of the file is intact.

    Parameters
    ----------
    intact
        Byte ranges of whole messages, in order; the file header belongs to the first.
    damage
        The ranges between them.
    appended
        The file says that data were appended to it after a crash.
    """

    intact: tuple[tuple[int, int], ...]
    damage: tuple[Damage, ...]
    appended: bool


@dataclass(slots=True)
class _Definitions:
    """What the messages so far defined: grows during the walk."""

    formats: dict[str, list[tuple[str, int, str]]] = field(default_factory=dict)
    payloads: dict[int, tuple[int, int]] = field(default_factory=dict)


def walk(data: bytes) -> Walk:
    """Walk all message headers of a ULog file.

    A break is a letter that names no message type, a size that its type or format cannot have, a size beyond the end of
    the file, or data of a subscription that does not exist. After a break the walk goes on where three valid messages
    follow each other. A change inside a payload is not seen: the format has no checksum.

    Parameters
    ----------
    data
        The whole file.

    Raises
    ------
    LogError
        The definitions are nested without end or describe messages that cannot exist.
    """
    definitions = _Definitions()
    stops, appended = _section_stops(data)
    intact: list[tuple[int, int]] = []
    damage: list[Damage] = []
    start = 0
    position = HEADER_BYTES
    for stop in stops:
        while True:
            position, reason = _advance(data, position, stop, definitions)
            intact.append((start, position))
            if not reason:
                break
            start = _resume(data, position, stop, definitions)
            damage.append(Damage(start=position, stop=start, reason=reason))
            position = start
        start = position = stop
    return Walk(intact=tuple(span for span in intact if span[0] < span[1]), damage=tuple(damage), appended=appended)


def without_damage(data: bytes, found: Walk) -> bytes:
    """The file made of its intact messages alone; the file itself when nothing is damaged."""
    if not found.damage:
        return data
    whole = bytearray(b"".join(data[start:stop] for start, stop in found.intact))
    if found.appended:
        # The offsets of appended data no longer hold, and the parts are joined already.
        flags = HEADER_BYTES + 3
        whole[flags + 8] &= 0xFE
        whole[flags + 16 : flags + 40] = bytes(24)
    return bytes(whole)


def _section_stops(data: bytes) -> tuple[list[int], bool]:
    """Ends of the sections: data that were appended after a crash start anew, the message before may be cut."""
    size, letter, _ = _HEADER.unpack_from(data.ljust(HEADER_BYTES + 5, b"\0"), HEADER_BYTES)
    flags = data[HEADER_BYTES + 3 : HEADER_BYTES + 3 + 40]
    if letter != ord("B") or size < 40 or len(flags) < 40 or not flags[8] & 1:
        return [len(data)], False
    offsets = [offset for offset in struct.unpack_from("<3Q", flags, 16) if offset]
    if sorted(set(offsets)) != offsets or any(not HEADER_BYTES + 43 <= offset < len(data) for offset in offsets):
        return [len(data)], True
    return [*offsets, len(data)], True


def _advance(data: bytes, position: int, stop: int, definitions: _Definitions) -> tuple[int, str]:
    """Walk whole messages from ``position``; where the walk ended, and why if not at ``stop``."""
    unpack = _HEADER.unpack_from
    payloads = definitions.payloads
    while position + 5 <= stop:
        size, letter, identity = unpack(data, position)
        after = position + 3 + size
        if letter == _DATA:
            # The hot path: nine of ten messages.
            low, high = payloads.get(identity, (1, 0))
            if not low <= size <= high:
                return position, "a data message has a size or a number that no topic of the log has"
        elif reason := _refuse(data, position, size, letter):
            return position, reason
        if after > stop:
            return position, "the file ends inside a message"
        if letter == ord("F"):
            _learn_format(data[position + 3 : after], definitions)
        elif letter == ord("A"):
            _learn_topic(data[position + 3 : after], definitions)
        position = after
    return position, "" if position == stop else "the file ends inside a message"


def _refuse(data: bytes, position: int, size: int, letter: int) -> str:
    """Why these bytes are no header of a message other than data; empty when they are one."""
    low, high = _PAYLOADS.get(letter, (1, 0))
    if high == 0:
        return "a byte that names no message type stands where a message should start"
    if not low <= size <= high:
        return f"a message of type {chr(letter)} has an impossible size of {size} bytes"
    payload = data[position + 3 : position + 3 + size]
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


def _resume(data: bytes, position: int, stop: int, definitions: _Definitions) -> int:
    """Next place after ``position`` where data messages follow each other; ``stop`` when there is none."""
    # The type letter is the third byte of a header.
    at = data.find(b"D", position + 3, stop)
    while at != -1:
        if _is_chain(data, at - 2, stop, definitions):
            return at - 2
        at = data.find(b"D", at + 1, stop)
    return stop


def _is_chain(data: bytes, position: int, stop: int, definitions: _Definitions) -> bool:
    for _ in range(_CHAIN):
        if position + 5 > stop:
            return position == stop
        size, letter, identity = _HEADER.unpack_from(data, position)
        low, high = definitions.payloads.get(identity, (1, 0)) if letter == _DATA else (0, size)
        if not low <= size <= high or (letter != _DATA and _refuse(data, position, size, letter)):
            return False
        position += 3 + size
    return position <= stop


def _learn_format(payload: bytes, definitions: _Definitions) -> None:
    name, _, rest = payload.decode("utf-8", errors="replace").partition(":")
    fields: list[tuple[str, int, str]] = []
    for item in filter(None, rest.split(";")):
        kind, _, label = item.partition(" ")
        kind, bracket, count = kind.partition("[")
        digits = count.rstrip("]")
        if bracket and not digits.isdecimal():
            return  # The topic stays without a format, which its subscription will say.
        fields.append((kind, int(digits[:9]) if bracket else 1, label))
    definitions.formats[name] = fields


def _learn_topic(payload: bytes, definitions: _Definitions) -> None:
    identity = int.from_bytes(payload[1:3], "little")
    name = payload[3:].decode("utf-8", errors="replace")
    size, _ = _measure(name, definitions.formats, ())
    fields = definitions.formats.get(name, [])
    padding = 0
    for kind, count, label in reversed(fields):
        if not label.startswith("_padding"):
            break
        padding += count * _SIZES.get(kind, 0)
    # Two bytes name the subscription; loggers may leave the padding at the end out.
    definitions.payloads[identity] = (2 + size - padding, 2 + size)


def _measure(name: str, formats: Mapping[str, list[tuple[str, int, str]]], outer: tuple[str, ...]) -> tuple[int, int]:
    """Bytes and fields of a format with everything nested in it, counted without spelling the fields out."""
    if name in outer or len(outer) > 8:
        raise _impossible(f"the definition of {name[:40]!r} contains itself or is nested too deeply")
    size = count = 0
    for kind, repeat, _ in formats.get(name, []):
        inner, parts = (_SIZES[kind], 1) if kind in _SIZES else _measure(kind, formats, (*outer, name))
        size += repeat * inner
        count += repeat * max(parts, 1)
        if max(size, count) > _LARGEST_MESSAGE:
            raise _impossible(f"the definition of {name[:40]!r} is larger than any message can be")
    return size, count


def _impossible(what: str) -> LogError:
    return LogError(
        f"the log's definitions cannot be true: {what}",
        needed="a ULog file as PX4 writes it",
        remedy="copy it again from the vehicle",
    )
