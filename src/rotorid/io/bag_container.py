"""Messages out of ROS 1 bags, ROS 2 databases and MCAP files, read from front to back up to where they are whole.

Indices at the end of a file are not used, so that a bag that was never closed, or was cut, gives what it holds. Runs in
the sandbox's child.

References
----------
"Bags/Format/2.0", wiki.ros.org; "MCAP format specification", mcap.dev.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

from rotorid.errors import LogError

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
