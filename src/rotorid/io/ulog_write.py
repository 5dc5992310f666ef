"""PX4's ULog container out of arrays: formats, parameters and information first, then all samples in order of time.

Messages of a topic are the rows of a structured array, so that a file is put together by a few copies of whole arrays.

References
----------
PX4 developer guide, "ULog File Format".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.errors import UsageError
from rotorid.io.store import write_atomically
from rotorid.io.ulog_definitions import TYPES, Definitions, Member
from rotorid.io.ulog_walk import MAGIC
from rotorid.typing import AnyArray, IntArray

_VERSION = 1
_NO_FLAGS = bytes(40)
_SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_SYNC_EVERY_US = 500_000
_LARGEST_PAYLOAD = 0xFFFF
_MOST_TOPICS = 1 << 16
_INT32 = 1 << 31
_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedTopic:
    """All messages of one topic.

    Parameters
    ----------
    name
        As the log names it: ``vehicle_torque_setpoint``.
    layout
        Types and names of the fields as ULog spells them, ``timestamp`` first: ``uint64_t timestamp;float[3] xyz``.
    samples
        One row for each message, of the type that `message_dtype` makes of the layout; stamps in microseconds.
    instance
        Which of several topics of one name.
    """

    name: str
    layout: str
    samples: AnyArray
    instance: int = 0

    def __post_init__(self) -> None:
        if self.samples.dtype != message_dtype(self.layout):
            raise ValueError(f"the samples of {self.name} have not the type of its layout")


def message_dtype(layout: str) -> np.dtype[np.void]:
    """Type of the rows of a topic, without gaps between its fields.

    Parameters
    ----------
    layout
        Fields of plain types, as in `LoggedTopic`; an array of ``char`` is one text.

    Raises
    ------
    ValueError
        A field has a type that ULog does not have, or the first one is no stamp.

    Examples
    --------
    >>> message_dtype("uint64_t timestamp;float[3] xyz;char[10] name").itemsize
    30
    """
    definitions = Definitions()
    definitions.learn(f"topic:{layout};".encode())
    members = definitions.formats.get("topic", ())
    unknown = [member.kind for member in members if member.kind not in TYPES]
    if (
        unknown
        or not members
        or (members[0].kind, members[0].count, members[0].name) != ("uint64_t", None, "timestamp")
    ):
        raise ValueError(f"a layout of plain types that starts with its stamp was needed, and {layout!r} came")
    return np.dtype([_field(member) for member in members])


def _field(member: Member) -> tuple[str, str] | tuple[str, str, tuple[int, ...]]:
    if member.kind == "char":
        return member.name, f"S{member.count or 1}"
    return member.name, TYPES[member.kind], () if member.count is None else (member.count,)


def write_ulog(
    path: Path,
    topics: Sequence[LoggedTopic],
    *,
    parameters: Mapping[str, float | int],
    information: Mapping[str, str | int],
) -> None:
    """Write a ULog file, whole or not at all; equal input makes equal bytes.

    Messages stand in order of their stamps, those of one instant in the order of the topics, with a synchronization
    message every half second. As in PX4, nothing pads a message at its end.

    Parameters
    ----------
    path
        File to write or replace.
    topics
        At least one, each with stamps that do not fall.
    parameters
        Name to value: ``int32_t`` for a Python integer, ``float`` for any other number.
    information
        Name to text or unsigned number, such as ``sys_name`` and ``ver_sw_release``.

    Raises
    ------
    UsageError
        There is no topic, two have the same name and instance, stamps fall, a message is longer than 64 KiB, a name is
        not plain text, a parameter cannot be held in 32 bits, or the place cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.ulog import extract
    >>> layout = "uint64_t timestamp;float voltage_v"
    >>> rows = np.array([(1_000_000, 16.5), (1_500_000, 16.25)], dtype=message_dtype(layout))
    >>> battery = LoggedTopic(name="battery_status", layout=layout, samples=rows)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder) / "flight.ulg"
    ...     write_ulog(log, [battery], parameters={"CA_ROTOR_COUNT": 4}, information={"sys_name": "PX4"})
    ...     found = extract(log, {"battery_status": ["voltage_v"]})
    ...     found.arrays["battery_status/voltage_v"].tolist(), dict(found.parameters)
    ([16.5, 16.25], {'CA_ROTOR_COUNT': 4.0})
    """
    _check(topics)
    first_us = min((int(topic.samples["timestamp"][0]) for topic in topics if topic.samples.size), default=0)
    head = [
        MAGIC + struct.pack("<BQ", _VERSION, first_us),
        _message("B", _NO_FLAGS),
        *(_message("I", _information(name, value)) for name, value in information.items()),
        *(_message("F", f"{name}:{layout};".encode()) for name, layout in _formats(topics).items()),
        *(_message("P", _parameter(name, value)) for name, value in parameters.items()),
        *(
            _message("A", struct.pack("<BH", topic.instance, number) + topic.name.encode())
            for number, topic in enumerate(topics)
        ),
    ]
    write_atomically(path, _merged(b"".join(head), list(_blocks(topics))))


def _check(topics: Sequence[LoggedTopic]) -> None:
    names = [(topic.name, topic.instance) for topic in topics]
    if not 0 < len(topics) <= _MOST_TOPICS or len(set(names)) < len(names):
        raise UsageError(
            f"{len(topics)} topics of {len(set(names))} names came", needed="topics, each of its own name and instance"
        )
    for topic in topics:
        stamps = topic.samples["timestamp"]
        if np.any(stamps[1:] < stamps[:-1]):
            raise UsageError(f"the stamps of {topic.name} fall", needed="samples in order of time")
        if topic.samples.dtype.itemsize + 2 > _LARGEST_PAYLOAD:
            raise UsageError(f"a message of {topic.name} is too long", needed=f"at most {_LARGEST_PAYLOAD} bytes")


def _formats(topics: Sequence[LoggedTopic]) -> dict[str, str]:
    formats: dict[str, str] = {}
    for topic in topics:
        if formats.setdefault(topic.name, topic.layout) != topic.layout:
            raise UsageError(f"two layouts came for {topic.name}", needed="one for all instances of a topic")
    return formats


def _message(letter: str, payload: bytes) -> bytes:
    if len(payload) > _LARGEST_PAYLOAD or not payload[:1]:
        raise UsageError(f"a message of {len(payload)} bytes came", needed=f"1 to {_LARGEST_PAYLOAD} bytes")
    return struct.pack("<HB", len(payload), ord(letter)) + payload


def _key(kind: str, name: str) -> bytes:
    text = f"{kind} {name}"
    if not (name.isascii() and name.isidentifier() and len(text) < 256):
        raise UsageError(f"the name {name[:40]!r} came", needed="letters, digits and underscores that ULog can hold")
    return bytes([len(text)]) + text.encode()


def _information(name: str, value: str | int) -> bytes:
    if isinstance(value, str):
        text = value.encode()
        return _key(f"char[{len(text)}]", name) + text
    if not 0 <= value < 2 * _INT32:
        raise UsageError(f"{name} = {value} came", needed="an unsigned number of 32 bits")
    return _key("uint32_t", name) + struct.pack("<I", value)


def _parameter(name: str, value: float | int) -> bytes:
    if isinstance(value, int) and -_INT32 <= value < _INT32:
        return _key("int32_t", name) + struct.pack("<i", value)
    if isinstance(value, int) or not abs(value) <= _LARGEST:
        raise UsageError(f"the parameter {name} = {value} came", needed="a number that 32 bits can hold")
    return _key("float", name) + struct.pack("<f", value)


def _blocks(topics: Sequence[LoggedTopic]) -> Iterator[tuple[AnyArray, AnyArray]]:
    """Stamps of each topic, and its whole messages as plain bytes; those that help a reader to find its way last."""
    for number, topic in enumerate(topics):
        fields = [("size", "<u2"), ("letter", "u1"), ("number", "<u2"), ("payload", topic.samples.dtype)]
        rows = np.empty(topic.samples.size, dtype=fields)
        rows["size"] = topic.samples.dtype.itemsize + 2
        rows["letter"] = ord("D")
        rows["number"] = number
        rows["payload"] = topic.samples
        yield topic.samples["timestamp"], rows.view(f"V{rows.dtype.itemsize}")
    ends = [topic.samples["timestamp"][[0, -1]] for topic in topics if topic.samples.size]
    if ends:
        stamps = np.arange(np.min(ends), np.max(ends), _SYNC_EVERY_US, dtype=np.uint64)
        yield stamps, np.full(stamps.size, np.void(_message("S", _SYNC)))


def _merged(head: bytes, blocks: Sequence[tuple[AnyArray, AnyArray]]) -> bytes:
    """The head of a file and all messages in order of their stamps."""
    starts, total = _starts([stamps for stamps, _ in blocks], [rows.dtype.itemsize for _, rows in blocks])
    merged = np.empty(len(head) + total, dtype=np.uint8)
    merged[: len(head)] = np.frombuffer(head, dtype=np.uint8)
    for (_, rows), places in zip(blocks, starts, strict=True):
        if rows.size:
            # Every byte starts an item of this overlapping view, so that one assignment places all rows of a topic.
            overlapping: AnyArray = np.ndarray(
                shape=(total - rows.dtype.itemsize + 1,),
                dtype=rows.dtype,
                buffer=merged.data,
                offset=len(head),
                strides=(1,),
            )
            overlapping[places] = rows
    return merged.tobytes()


def _starts(stamps: Sequence[AnyArray], widths: Sequence[int]) -> tuple[list[IntArray], int]:
    """First byte of each message, block by block, and the length of all."""
    counts = [one.size for one in stamps]
    order = np.argsort(np.concatenate(stamps), kind="stable")
    sizes = np.repeat(np.asarray(widths, dtype=np.int64), counts)
    stops = np.cumsum(sizes[order])
    starts = np.empty_like(stops)
    starts[order] = stops - sizes[order]
    return np.split(starts, np.cumsum(counts)[:-1]), int(stops[-1]) if stops.size else 0
