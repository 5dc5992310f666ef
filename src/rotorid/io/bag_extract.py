"""What the sandbox's child does with a bag: decode the wanted messages and turn their fields into arrays."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import LogError
from rotorid.io import bag_database, bag_mcap, bag_ros1
from rotorid.io.bag_container import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    Connection,
    Damage,
    Item,
    decompressed,
)
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray

RECEIVED = "@received"
"""Path that stands for the time of reception, s."""

STAMP = "header.stamp"

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LARGEST_MESSAGE_BYTES = 64 << 20
_STEP = re.compile(r"(\w+)((?:\[\d+\])*)")
_LANGUAGE_STORES = {"ros1": "ROS1_NOETIC", "cdr": "ROS2_HUMBLE"}

_WALKS: Mapping[bytes, Callable[[Path], Iterator[Item]]] = {
    ROS1_MAGIC: bag_ros1.walk,
    SQLITE_MAGIC: bag_database.walk,
    MCAP_MAGIC: bag_mcap.walk,
}


@dataclass(kw_only=True)
class _Column:
    """What was gathered of one topic while the bag was read once."""

    kind: str
    decode: Callable[[bytes], Any] | None = None
    paths: tuple[str, ...] = ()
    count: int = 0
    failed: int = 0
    unreadable: str = ""
    frames: tuple[str, str] = ("", "")
    fields: tuple[str, ...] = ()
    received_ns: list[int] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=dict)


def extract(path: Path, options: Mapping[str, Any]) -> Extract:
    """Fields of the wanted topics as arrays.

    Parameters
    ----------
    path
        A ROS 1 ``.bag``, a ROS 2 ``.db3`` or an ``.mcap``.
    options
        ``by_kind``: type of message to the paths of its fields, as in ``angular_velocity.x`` or ``control[3]``;
        ``by_topic``: the same by topic, which goes first. The path ``@received`` is the time of reception.

    Returns
    -------
    Extract
        Arrays ``topic.path``, shape ``(messages,)`` or ``(messages, elements)``; a time becomes seconds. Facts:
        ``topics``, each with ``kind``, ``count``, ``failed``, ``unreadable``, ``frames`` and ``fields``; ``damage`` as
        ``[position, reason]``; ``size_bytes``.

    Raises
    ------
    LogError
        The packages that read bags are not installed, or the file is no bag.
    """
    columns: dict[str, _Column] = {}
    damage: list[tuple[int, str]] = []
    for item in _items(path):
        if isinstance(item, Damage):
            damage.append((item.position, item.reason))
            continue
        topic = item.connection.topic
        if topic not in columns:
            columns[topic] = _column(item.connection, options)
        _add(columns[topic], item.received_ns, item.data)
    arrays = {f"{topic}.{name}": array for topic, column in columns.items() for name, array in _arrays(column)}
    return Extract(
        arrays=arrays,
        facts={
            "topics": {topic: _facts(column) for topic, column in columns.items()},
            "damage": damage,
            "size_bytes": path.stat().st_size,
        },
    )


def _items(path: Path) -> Iterator[Item]:
    with path.open("rb") as file:
        head = file.read(16)
    walk = next((walk for magic, walk in _WALKS.items() if head.startswith(magic)), None)
    if walk is None:
        raise LogError(
            "a file came that starts like no bag",
            needed="a ROS 1 .bag of version 2.0, a ROS 2 .db3 or an .mcap",
            remedy="give the file inside of the bag's folder",
        )
    return walk(path)


def _facts(column: _Column) -> dict[str, Any]:
    names = ("kind", "count", "failed", "unreadable", "frames", "fields")
    return {name: getattr(column, name) for name in names}


def _column(connection: Connection, options: Mapping[str, Any]) -> _Column:
    paths = options["by_topic"].get(connection.topic, options["by_kind"].get(connection.kind, ()))
    column = _Column(kind=connection.kind, paths=tuple(paths))
    if paths:
        try:
            column.decode = _decoder(connection)
        except _refusals() as error:
            column.unreadable = f"{type(error).__name__}: {str(error)[:200]}"
    return column


def _decoder(connection: Connection) -> Callable[[bytes], Any]:
    """The function that turns bytes into a message, made from the definition in the bag or from a standard one."""
    # Code is made from the definition, which is why all this runs in the sandbox.
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if connection.encoding not in _LANGUAGE_STORES:
        raise ValueError(f"messages encoded as {connection.encoding!r} are not read")
    if connection.definition:
        store = get_typestore(Stores.EMPTY)
        if connection.language == "idl":
            store.register(get_types_from_idl(_idl(connection.definition)))
        else:
            store.register(get_types_from_msg(connection.definition, connection.kind))
    else:
        store = get_typestore(Stores[_LANGUAGE_STORES[connection.encoding]])
    if connection.kind not in store.fielddefs:
        raise ValueError("the bag does not define this type of message")
    decode = store.deserialize_ros1 if connection.encoding == "ros1" else store.deserialize_cdr
    return lambda data: decode(data, connection.kind)


def _idl(definition: str) -> str:
    """The definitions without the ruled headings that rosbag2 puts between them."""
    return re.sub(r"^={80}\nIDL: .*\n", "", definition, flags=re.MULTILINE)


def _refusals() -> tuple[type[Exception], ...]:
    """What a parser of definitions and a decoder of messages raise when they meet nonsense."""
    try:
        from rosbags.serde import SerdeError
        from rosbags.typesys import TypesysError
    except ImportError as error:
        raise LogError(
            "a ROS bag came and the package that reads its messages is not installed",
            needed="rosbags",
            remedy='install it: pip install "rotorid[ros]"',
        ) from error
    return (
        SerdeError,
        TypesysError,
        struct.error,
        ValueError,
        LookupError,
        AssertionError,
        AttributeError,
        TypeError,
        SyntaxError,
        RecursionError,
    )


def _add(column: _Column, received_ns: int, data: bytes) -> None:
    column.count += 1
    if column.decode is None:
        return
    try:
        if data.startswith(_ZSTD_MAGIC):
            data = _unpacked(data)
        message = column.decode(data)
    except _refusals():
        column.failed += 1
        return
    if not column.values:
        _begin(column, message)
    for path, gathered in column.values.items():
        gathered.append(value_at(message, path))
    column.received_ns.append(received_ns)


def _unpacked(data: bytes) -> bytes:
    """A message that rosbag2 compressed by itself; the size stands in its own header."""
    import zstandard

    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError as error:
        raise ValueError(f"a message cannot be decompressed ({error})") from error
    if not 0 <= size <= _LARGEST_MESSAGE_BYTES:
        raise ValueError(f"a message of {size} bytes is announced")
    return decompressed(data, "zstd", size)


def _begin(column: _Column, message: Any) -> None:
    """Look at the first message for what it holds: the fields, and the frames of its header."""
    column.fields = tuple(getattr(message, "__dataclass_fields__", ()))
    header = getattr(message, "header", None)
    column.frames = (str(getattr(header, "frame_id", ""))[:100], str(getattr(message, "child_frame_id", ""))[:100])
    held = (path for path in dict.fromkeys((STAMP, *column.paths)) if value_at(message, path) is not None)
    column.values = {path: [] for path in held} or {"": []}


def value_at(message: Any, path: str) -> Any:
    """Number, array or time (in seconds) at a path of fields and indices; ``None`` when there is none."""
    value = message
    for step in path.split("."):
        matched = _STEP.fullmatch(step)
        value = getattr(value, matched[1], None) if matched else None
        for index in re.findall(r"\d+", matched[2]) if matched else ():
            place = int(index)
            value = value[place] if isinstance(value, list | np.ndarray) and place < len(value) else None
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        return float(value.sec) + 1e-9 * float(value.nanosec)
    if isinstance(value, bool | int | float | np.number | np.ndarray):
        return value
    return None


def _arrays(column: _Column) -> Iterator[tuple[str, AnyArray]]:
    if not column.received_ns:
        return
    yield RECEIVED, np.array(column.received_ns, dtype=np.float64) * 1e-9
    for path, values in column.values.items():
        array = _stacked(values)
        if array is not None:
            yield path, array


def _stacked(values: Sequence[Any]) -> AnyArray | None:
    """Values of all messages in one array; ``None`` when they are no numbers, or differ in their number."""
    shapes = {np.shape(value) for value in values}
    if len(shapes) != 1 or any(value is None for value in values):
        return None
    array = np.array(values)
    return array.astype(np.float64) if array.dtype.kind in "biuf" and array.ndim <= 2 else None
