"""ROS 2 bags in an SQLite database: tables ``topics`` and ``messages``, and since 2023 ``message_definitions``."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

from rotorid.errors import LogError
from rotorid.io.bag_container import Connection, Damage, Item, Message, message_type

_PAGE_BYTES = tuple(1 << power for power in range(9, 17))
_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl"}


def walk(path: Path) -> Iterator[Item]:
    """Messages of a database in the order in which they were stored.

    A database that was cut is read as far as its pages go; SQLite keeps no checksums, so that a changed byte inside of
    a message shows only when the message no longer decodes.

    Raises
    ------
    LogError
        The database holds no tables ``topics`` and ``messages``.
    """
    page_bytes, announced = _announced(path)
    size = path.stat().st_size
    if size < page_bytes or page_bytes not in _PAGE_BYTES:
        yield Damage(position=0, reason="the database has no whole page")
        return
    base = _opened(path, page_bytes, cut=size < announced)
    try:
        # Opens a database that is shorter than its header says; nothing is written in this mode.
        base.execute("PRAGMA writable_schema=ON")
        if size < announced:
            yield Damage(position=size, reason=f"the database ends after {size} of {announced} bytes")
        connections = _connections(base)
        for topic_id, received_ns, data in base.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED"):
            if topic_id not in connections or not isinstance(received_ns, int) or not isinstance(data, bytes):
                yield Damage(position=0, reason="a row of the messages makes no sense")
                continue
            yield Message(connection=connections[topic_id], received_ns=received_ns, data=data)
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        if "no such table" in str(error):
            raise LogError(
                "an SQLite database came that is no ROS 2 bag",
                needed="tables `topics` and `messages`",
                remedy="give the .db3 file of the bag's folder",
            ) from error
        yield Damage(position=0, reason=f"the database is damaged ({error})")
    finally:
        base.close()


def _announced(path: Path) -> tuple[int, int]:
    """Bytes of a page, and of the whole database, as its header says; pages of 64 KiB are written as 1."""
    with path.open("rb") as file:
        head = file.read(32)
    written = int.from_bytes(head[16:18], "big")
    page_bytes = 65_536 if written == 1 else written
    return page_bytes, int.from_bytes(head[28:32], "big") * page_bytes


def _opened(path: Path, page_bytes: int, *, cut: bool) -> sqlite3.Connection:
    if cut:
        # SQLite fills a cut page up with zeros, which would look like samples: it gets the whole pages alone.
        data = path.read_bytes()
        base = sqlite3.connect(":memory:")
        base.deserialize(data[: len(data) // page_bytes * page_bytes])
        return base
    # A bag may lie on a read-only medium, and must not be changed: no journal is replayed, none is written.
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)


def _connections(base: sqlite3.Connection) -> dict[int, Connection]:
    definitions: dict[str, tuple[str, str]] = {}
    names = [row[1] for row in base.execute("PRAGMA table_info(message_definitions)")]
    if "encoded_message_definition" in names:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        definitions = {str(kind): (_LANGUAGES.get(str(how), ""), str(text)) for kind, how, text in base.execute(query)}
    found: dict[int, Connection] = {}
    for number, topic, kind, encoding in base.execute("SELECT id, name, type, serialization_format FROM topics"):
        language, definition = definitions.get(str(kind), ("", ""))
        found[number] = Connection(
            topic=str(topic),
            kind=message_type(str(kind)),
            encoding=str(encoding),
            language=language if definition else "",
            definition=definition,
        )
    return found
