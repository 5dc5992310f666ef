"""What a ULog file defines: formats, the topics that use them, and where in a message a field stands.

Nothing here spells a format out: sizes are added up, and a field is looked for by its name. Definitions that contain
themselves, describe messages that cannot exist, or are more than any logger writes are refused.

References
----------
PX4 developer guide, "ULog File Format", sections "Format Message" and "Subscription Message".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from rotorid.errors import LogError

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
        f"the log's definitions cannot be true: {what}",
        needed="a ULog file as PX4 writes it",
        remedy="copy it again from the vehicle",
    )
