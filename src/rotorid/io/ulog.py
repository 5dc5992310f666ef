"""PX4's ULog container as arrays of the topics that are wanted.

The file is mapped, not read: `rotorid.io.ulog_walk` finds the messages, and only the fields that are asked for are
collected from them. Memory follows what is returned, not the size of the file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.errors import LogError
from rotorid.io.gather import Place, file_bytes, gather
from rotorid.io.ulog_walk import HEADER_BYTES, MAGIC, MESSAGE_HEADER_BYTES, Stream, Walk, walk
from rotorid.typing import AnyArray

_CLOCKS = ("timestamp", "timestamp_sample")
_DATA_STARTS = MESSAGE_HEADER_BYTES + 2
_INFORMATION = ("sys_name", "ver_sw_release")
"""What is read of the information that a log carries; it also holds serial numbers, which are nobody's business."""

_NUMBERS = {"float": struct.Struct("<f"), "int32_t": struct.Struct("<i"), "uint32_t": struct.Struct("<I")}


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples(Mapping[str, AnyArray]):
    """``topic/field`` to the samples as logged, shape ``(samples,)``, collected anew whenever they are asked for.

    So the samples of a large log never all exist beside the record that is made of them.
    """

    data: AnyArray
    fields: Mapping[str, tuple[Stream, Place]]

    def __getitem__(self, name: str) -> AnyArray:
        stream, place = self.fields[name]
        (values,) = gather(self.data, stream.positions, [place])
        return values

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
    info
        Name and packed version of the firmware.
    dropouts
        Time and duration of the losses that the logger noticed, in seconds.
    damage
        First byte, first byte after, and reason of what cannot be read.
    size_bytes
        Length of the file.
    """

    arrays: Mapping[str, AnyArray]
    parameters: Mapping[str, float]
    info: Mapping[str, str | int]
    dropouts: Sequence[tuple[float, float]]
    damage: Sequence[tuple[int, int, str]]
    size_bytes: int


def extract(path: Path, topics: Mapping[str, Sequence[str]]) -> ULog:
    """Collect the wanted fields of a ULog file.

    Parameters
    ----------
    path
        A ULog file.
    topics
        Name of a topic to the names of its fields, such as ``xyz[0]``. Only the first instance of a topic is read.

    Raises
    ------
    LogError
        The file cannot be read, is cut inside its header, is of a kind that is not understood, or its definitions
        cannot be true.
    """
    data = file_bytes(path)
    if data.size <= HEADER_BYTES or data[: len(MAGIC)].tobytes() != MAGIC:
        raise LogError(
            f"a ULog file of {data.size} bytes came, which ends inside its header",
            needed="a whole log",
            remedy="copy it again from the vehicle",
        )
    _refuse_unknown_kind(data)
    found = walk(data, topics)
    streams: dict[str, Stream] = {}
    for stream in found.streams:
        if stream.positions.size:
            streams.setdefault(stream.subscription.topic, stream)
    fields: dict[str, tuple[Stream, Place]] = {}
    damage = [(item.start, item.stop, item.reason) for item in found.damage]
    for topic, stream in streams.items():
        places = _places(found, stream, (*_CLOCKS, *topics[topic]))
        if "timestamp" in places:
            fields |= {f"{topic}/{name}": (stream, place) for name, place in places.items()}
        else:
            damage.append((HEADER_BYTES, HEADER_BYTES, f"the definition of {topic} names no time stamps"))
    arrays = Samples(data=data, fields=fields)
    parameters, info = _statements(data, found)
    return ULog(
        arrays=arrays,
        parameters=parameters,
        info=info,
        dropouts=list(_dropouts(data, found, streams, arrays)),
        damage=damage,
        size_bytes=data.size,
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


def _statements(data: AnyArray, found: Walk) -> tuple[dict[str, float], dict[str, str | int]]:
    """Parameters, of one that changed in flight the last value, and information of the firmware."""
    parameters: dict[str, float] = {}
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
                parameters[name] = float(number)
            else:
                info[name] = number
    return parameters, info


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
