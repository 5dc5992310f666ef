"""ROS 1 bags of version 2.0: a row of records with headers of named fields."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from pathlib import Path

from rotorid.io.bag_container import ROS1_MAGIC, Connection, Cursor, Damage, Item, Message, decompressed, message_type

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7


def walk(path: Path) -> Iterator[Item]:
    """Messages of a bag. After a break nothing tells where the next record starts, and the walk ends."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        # Views into a map must be gone before it closes: the records are copied out one by one.
        yield from _walk(data)


def _walk(data: mmap.mmap) -> Iterator[Item]:
    connections: dict[int, Connection] = {}
    position, announced, found = len(ROS1_MAGIC), -1, 0
    while position < len(data):
        try:
            header, body, position_after = _record(data, position)
            operation = header["op"][0]
            if operation == _BAG:
                announced = Cursor(header["conn_count"]).number("I") + Cursor(header["chunk_count"]).number("I")
                if Cursor(header["index_pos"]).number("Q") == 0:
                    yield Damage(position=position, reason="the recording was not closed")
            elif operation == _CHUNK:
                n_bytes = Cursor(header["size"]).number("I")
                yield from _chunk(decompressed(body, header["compression"].decode(), n_bytes), connections, position)
            elif operation in (_CONNECTION, _CHUNK_INFO):
                found += 1
            if operation == _CONNECTION:
                _connect(header, body, connections)
        except (ValueError, KeyError, IndexError) as error:
            yield from _last_chunk(data, position, connections)
            yield Damage(position=position, reason=f"a record is cut or makes no sense ({error})")
            return
        position = position_after
    if found < announced:
        yield Damage(position=len(data), reason=f"{announced - found} of {announced} records of the index are missing")


def _record(data: mmap.mmap | memoryview, position: int) -> tuple[dict[str, bytes], bytes, int]:
    """Header, content and end of the record that starts here."""
    lengths = []
    parts: list[bytes] = []
    for _ in range(2):
        count = Cursor(data[position : position + 4]).number("I")
        if count > len(data) - position - 4:
            raise ValueError(f"a part of {count} bytes is announced where {len(data) - position - 4} are left")
        parts.append(bytes(data[position + 4 : position + 4 + count]))
        lengths.append(count)
        position += 4 + count
    return _fields(parts[0]), parts[1], position


def _fields(header: bytes) -> dict[str, bytes]:
    cursor, fields = Cursor(header), {}
    while cursor.left:
        name, _, value = bytes(cursor.take(cursor.number("I"))).partition(b"=")
        fields[name.decode("ascii", errors="replace")] = value
    return fields


def _last_chunk(data: mmap.mmap, position: int, connections: dict[int, Connection]) -> Iterator[Item]:
    """Whole messages of an uncompressed chunk that the end of the file cuts."""
    try:
        count = Cursor(data[position : position + 4]).number("I")
        header = _fields(data[position + 4 : position + 4 + count])
        if header["op"] == bytes([_CHUNK]) and header["compression"] == b"none":
            start = position + 8 + count
            stop = start + Cursor(data[start - 4 : start]).number("I")
            if stop > len(data):
                items = list(_chunk(bytes(data[start:]), connections, position))
                yield from (item for item in items if isinstance(item, Message))
    except (ValueError, KeyError):
        return


def _chunk(content: bytes, connections: dict[int, Connection], place: int) -> Iterator[Item]:
    view, position = memoryview(content), 0
    while position < len(view):
        try:
            header, body, position = _record(view, position)
            if header["op"][0] == _CONNECTION:
                _connect(header, body, connections)
            elif header["op"][0] == _MESSAGE:
                stamp = Cursor(header["time"])
                received_ns = stamp.number("I") * 10**9 + stamp.number("I")
                connection = connections[Cursor(header["conn"]).number("I")]
                yield Message(connection=connection, received_ns=received_ns, data=body)
        except (ValueError, KeyError, IndexError) as error:
            yield Damage(position=place, reason=f"a chunk holds a record that makes no sense ({error})")
            return


def _connect(header: dict[str, bytes], body: bytes, connections: dict[int, Connection]) -> None:
    about = _fields(body)
    connections[Cursor(header["conn"]).number("I")] = Connection(
        topic=header["topic"].decode("utf-8"),
        kind=message_type(about["type"].decode("utf-8")),
        encoding="ros1",
        language="msg",
        definition=about["message_definition"].decode("utf-8"),
    )
