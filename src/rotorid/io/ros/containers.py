"""Messages out of ROS 1 bags, ROS 2 databases and MCAP files, read from front to back up to where they are whole.

Indices at the end of a file are not used, so that a bag that was never closed, or was cut, gives what it holds. Each of
the three containers is a walk that yields connections and messages; the wanted messages are decoded and their fields
become arrays. Runs in the sandbox's child.

References
----------
"Bags/Format/2.0", wiki.ros.org; "MCAP format specification", mcap.dev; rosbag2's SQLite storage: tables ``topics`` and
``messages``, and since 2023 ``message_definitions``.
"""

from __future__ import annotations

import mmap
import re
import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from rotorid.errors import LogError
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray

ROS1_MAGIC = b"#ROSBAG V2.0\n"
SQLITE_MAGIC = b"SQLite format 3\0"
MCAP_MAGIC = b"\x89MCAP0\r\n"

LARGEST_CHUNK_BYTES = 256 << 20
"""Writers make chunks of about one MiB; a small file can announce a chunk that fills all of the memory."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Connection:
    """A topic of a bag, its message type as ``package/msg/Name``, and the definition of that type if there is one.

    ``encoding`` is ``ros1`` or ``cdr``, ``language`` that of the definition: ``msg``, ``idl`` or empty.
    """

    topic: str
    kind: str
    encoding: str
    language: str = ""
    definition: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Message:
    """One message as it was stored, with the time of its reception in nanoseconds."""

    connection: Connection
    received_ns: int
    data: bytes


@dataclass(frozen=True, kw_only=True, slots=True)
class Damage:
    """A place of the file that makes no sense, and why."""

    position: int
    reason: str


Item: TypeAlias = Message | Damage

RECEIVED = "@received"
"""Path that stands for the time of reception, s."""

STAMP = "header.stamp"

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LARGEST_MESSAGE_BYTES = 64 << 20
_STEP = re.compile(r"(\w++)((?:\[\d{1,9}\])*+)")
_PLACE = re.compile(r"\d++")
_LANGUAGE_STORES = {"ros1": "ROS1_NOETIC", "cdr": "ROS2_HUMBLE"}


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
            "the file does not start like a bag",
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
            "the package that reads ROS bags is not installed",
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
    present = (path for path in dict.fromkeys((STAMP, *column.paths)) if value_at(message, path) is not None)
    column.values = {path: [] for path in present} or {"": []}


def value_at(message: Any, path: str) -> Any:
    """Number, array or time (in seconds) at a path of fields and indices; ``None`` when there is none."""
    value = message
    for step in path.split("."):
        matched = _STEP.fullmatch(step)
        value = getattr(value, matched[1], None) if matched else None
        for index in _PLACE.findall(matched[2]) if matched else ():
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


_PAGE_BYTES = tuple(1 << power for power in range(9, 17))
_DATABASE_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl"}


def _walk_database(path: Path) -> Iterator[Item]:
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
                "this SQLite database is not a ROS 2 bag",
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
        definitions = {
            str(kind): (_DATABASE_LANGUAGES.get(str(how), ""), str(text)) for kind, how, text in base.execute(query)
        }
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


_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_RECORD_HEAD_BYTES = 9
_MCAP_LANGUAGES = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl"}


class _Vocabulary:
    """Schemas and channels as they were introduced so far."""

    def __init__(self) -> None:
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.channels: dict[int, Connection] = {}


def _walk_mcap(path: Path) -> Iterator[Item]:
    """Messages of a file, up to where it ends or breaks."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield from _mcap_items(data)


def _mcap_items(data: mmap.mmap) -> Iterator[Item]:
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
            yield from _mcap_chunk(data[start : start + count], known, position)
        elif operation in (_SCHEMA, _CHANNEL, _MESSAGE):
            yield from _mcap_record(operation, data[start : start + count], known, position)
        if cut:
            return
        position = start + count
    yield Damage(position=len(data), reason="the file ends without a footer")


def _mcap_chunk(record: bytes, known: _Vocabulary, place: int) -> Iterator[Item]:
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
                yield Damage(position=place, reason=f"a chunk contains an invalid record ({error})")
            return
        yield from _mcap_record(operation, bytes(part), known, place)


def _mcap_record(operation: int, record: bytes, known: _Vocabulary, place: int) -> Iterator[Item]:
    cursor = Cursor(record)
    try:
        if operation == _SCHEMA:
            number, name, encoding = cursor.number("H"), cursor.text(), cursor.text()
            # Definitions in other languages may be binary; they are not looked at.
            language = _MCAP_LANGUAGES.get(encoding, "")
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


_ROS1_MESSAGE, _BAG, _INDEX, _ROS1_CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7


def _walk_ros1(path: Path) -> Iterator[Item]:
    """Messages of a bag. After a break nothing shows where the next record starts, and the walk ends."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        # Views into a map must be gone before it closes: the records are copied out one by one.
        yield from _ros1_items(data)


def _ros1_items(data: mmap.mmap) -> Iterator[Item]:
    connections: dict[int, Connection] = {}
    position, announced, found = len(ROS1_MAGIC), -1, 0
    while position < len(data):
        try:
            header, body, position_after = _ros1_record(data, position)
            operation = header["op"][0]
            if operation == _BAG:
                announced = Cursor(header["conn_count"]).number("I") + Cursor(header["chunk_count"]).number("I")
                if Cursor(header["index_pos"]).number("Q") == 0:
                    yield Damage(position=position, reason="the recording was not closed")
            elif operation == _ROS1_CHUNK:
                n_bytes = Cursor(header["size"]).number("I")
                yield from _ros1_chunk(
                    decompressed(body, header["compression"].decode(), n_bytes), connections, position
                )
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


def _ros1_record(data: mmap.mmap | memoryview, position: int) -> tuple[dict[str, bytes], bytes, int]:
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
        if header["op"] == bytes([_ROS1_CHUNK]) and header["compression"] == b"none":
            start = position + 8 + count
            stop = start + Cursor(data[start - 4 : start]).number("I")
            if stop > len(data):
                items = list(_ros1_chunk(bytes(data[start:]), connections, position))
                yield from (item for item in items if isinstance(item, Message))
    except (ValueError, KeyError):
        return


def _ros1_chunk(content: bytes, connections: dict[int, Connection], place: int) -> Iterator[Item]:
    view, position = memoryview(content), 0
    while position < len(view):
        try:
            header, body, position = _ros1_record(view, position)
            if header["op"][0] == _CONNECTION:
                _connect(header, body, connections)
            elif header["op"][0] == _ROS1_MESSAGE:
                stamp = Cursor(header["time"])
                received_ns = stamp.number("I") * 10**9 + stamp.number("I")
                connection = connections[Cursor(header["conn"]).number("I")]
                yield Message(connection=connection, received_ns=received_ns, data=body)
        except (ValueError, KeyError, IndexError) as error:
            yield Damage(position=place, reason=f"a chunk contains an invalid record ({error})")
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


def message_type(name: str) -> str:
    """``package/msg/Name`` for the two ways to write a type.

    Examples
    --------
    >>> message_type("sensor_msgs/Imu"), message_type("sensor_msgs/msg/Imu")
    ('sensor_msgs/msg/Imu', 'sensor_msgs/msg/Imu')
    """
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest.removeprefix('msg/')}"


def decompressed(data: bytes, compression: str, n_bytes: int) -> bytes:
    """A chunk of ``n_bytes`` as it was before its compression: ``bz2``, ``lz4``, ``zstd``, or none.

    Raises
    ------
    ValueError
        The chunk is damaged, larger than announced, or larger than any that is written.
    LogError
        The compression is not known here.
    """
    if compression in ("", "none"):
        return data
    if n_bytes > LARGEST_CHUNK_BYTES:
        raise ValueError(f"a chunk announces {n_bytes} bytes, more than {LARGEST_CHUNK_BYTES}")
    try:
        content = _decompressed(data, compression, n_bytes)
    except (OSError, RuntimeError, EOFError) as error:
        raise ValueError(f"a chunk cannot be decompressed ({error})") from error
    if len(content) != n_bytes:
        raise ValueError(f"a chunk of {n_bytes} bytes was announced and does not hold them")
    return content


def _decompressed(data: bytes, compression: str, n_bytes: int) -> bytes:
    # One byte more than announced shows that there is more, without unpacking it.
    if compression == "bz2":
        import bz2

        return bz2.BZ2Decompressor().decompress(data, n_bytes + 1)
    try:
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return bytes(LZ4FrameDecompressor().decompress(data, n_bytes + 1))
        if compression == "zstd":
            import zstandard

            try:
                return bytes(zstandard.ZstdDecompressor().stream_reader(data).read(n_bytes + 1))
            except zstandard.ZstdError as error:
                raise ValueError(f"a chunk cannot be decompressed ({error})") from error
    except ImportError as error:
        raise LogError(
            f"the bag is compressed by {compression}",
            needed="the packages that read bags",
            remedy='install them: pip install "rotorid[ros]"',
        ) from error
    raise LogError(
        f"the bag is compressed by {compression[:20]!r}",
        needed="lz4, zstd or bz2",
        remedy="write it again uncompressed",
    )


class Cursor:
    """A position in bytes that reads little-endian numbers and counted parts; beyond the end it is a ``ValueError``."""

    def __init__(self, data: bytes | memoryview, position: int = 0) -> None:
        self.data = memoryview(data)
        self.position = position

    @property
    def left(self) -> int:
        """Bytes between the position and the end."""
        return len(self.data) - self.position

    def take(self, count: int) -> memoryview:
        """The next ``count`` bytes."""
        if count > self.left:
            raise ValueError(f"a part of {count} bytes is announced where {self.left} are left")
        part = self.data[self.position : self.position + count]
        self.position += count
        return part

    def number(self, code: str) -> int:
        """The next number, by its letter in ``struct``."""
        (value,) = struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))
        return int(value)

    def text(self, code: str = "I") -> str:
        """Text behind its length; bytes that are no UTF-8 are a ``ValueError``."""
        return bytes(self.take(self.number(code))).decode("utf-8")


_WALKS: Mapping[bytes, Callable[[Path], Iterator[Item]]] = {
    ROS1_MAGIC: _walk_ros1,
    SQLITE_MAGIC: _walk_database,
    MCAP_MAGIC: _walk_mcap,
}
