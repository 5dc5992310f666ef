"""MCAP files: a row of records, most of them inside of chunks."""

from __future__ import annotations

import mmap
import zlib
from collections.abc import Iterator
from pathlib import Path

from rotorid.io.bag_container import MCAP_MAGIC, Connection, Cursor, Damage, Item, Message, decompressed, message_type

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_RECORD_HEAD_BYTES = 9
_LANGUAGES = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl"}


class _Vocabulary:
    """Schemas and channels as they were introduced so far."""

    def __init__(self) -> None:
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.channels: dict[int, Connection] = {}


def walk(path: Path) -> Iterator[Item]:
    """Messages of a file, up to where it ends or breaks."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield from _walk(data)


def _walk(data: mmap.mmap) -> Iterator[Item]:
    known = _Vocabulary()
    position = len(MCAP_MAGIC)
    while position < len(data):
        head = data[position : position + _RECORD_HEAD_BYTES]
        count = int.from_bytes(head[1:], "little")
        start = position + _RECORD_HEAD_BYTES
        cut = len(head) < _RECORD_HEAD_BYTES or count > len(data) - start
        if cut and head[0] != _CHUNK:
            yield Damage(position=position, reason="the file ends inside of a record")
            return
        operation = head[0]
        if operation == _FOOTER:
            if data[start + count :] != MCAP_MAGIC:
                yield Damage(position=start + count, reason="the end of the file is not where its footer stands")
            return
        if operation == _CHUNK:
            yield from _chunk(data[start : start + count], known, position)
        elif operation in (_SCHEMA, _CHANNEL, _MESSAGE):
            yield from _record(operation, data[start : start + count], known, position)
        if cut:
            return
        position = start + count
    yield Damage(position=len(data), reason="the file ends without a footer")


def _chunk(record: bytes, known: _Vocabulary, place: int) -> Iterator[Item]:
    cursor = Cursor(record)
    try:
        cursor.take(16)
        n_bytes, crc, compression = cursor.number("Q"), cursor.number("I"), cursor.text()
        stored = cursor.number("Q")
        cut = stored > cursor.left
        content = bytes(cursor.take(min(stored, cursor.left)))
        if not cut or compression:
            content = decompressed(content, compression, n_bytes)
    except ValueError as error:
        yield Damage(position=place, reason=str(error))
        return
    if cut:
        yield Damage(position=place, reason="the file ends inside of a chunk")
    elif crc and zlib.crc32(content) != crc:
        yield Damage(position=place, reason="a chunk has a wrong checksum")
        return
    inside = Cursor(content)
    while inside.left:
        try:
            operation, count = inside.number("B"), inside.number("Q")
            part = inside.take(count)
        except ValueError as error:
            if not cut:
                yield Damage(position=place, reason=f"a chunk holds a record that makes no sense ({error})")
            return
        yield from _record(operation, bytes(part), known, place)


def _record(operation: int, record: bytes, known: _Vocabulary, place: int) -> Iterator[Item]:
    cursor = Cursor(record)
    try:
        if operation == _SCHEMA:
            number, name, encoding = cursor.number("H"), cursor.text(), cursor.text()
            # Definitions in other languages may be binary; they are not looked at.
            language = _LANGUAGES.get(encoding, "")
            known.schemas[number] = name, language, cursor.text() if language else ""
        elif operation == _CHANNEL:
            number, schema = cursor.number("H"), cursor.number("H")
            topic, encoding = cursor.text(), cursor.text()
            name, language, definition = known.schemas.get(schema, ("", "", ""))
            known.channels[number] = Connection(
                topic=topic, kind=message_type(name), encoding=encoding, language=language, definition=definition
            )
        elif operation == _MESSAGE:
            number = cursor.number("H")
            cursor.take(4)
            received_ns = cursor.number("Q")
            cursor.take(8)
            data = bytes(cursor.take(cursor.left))
            yield Message(connection=known.channels[number], received_ns=received_ns, data=data)
    except (ValueError, KeyError) as error:
        yield Damage(position=place, reason=f"a record makes no sense ({error})")
