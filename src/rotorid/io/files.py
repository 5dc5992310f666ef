"""Files on disk, whatever is in them: written whole or not at all, hashed, unpacked within limits, mapped.

Compressed logs (``.gz``, ``.xz``, ``.bz2``, ``.zip``) are unpacked to a temporary file. Bytes of a large file are
collected from anywhere in it without a copy of the rest.

No record keeps where on Earth a log was made: channels are relative by their names (`north`, `east` and `down` count
from the origin of the autopilot's estimator), and :mod:`rotorid.io.parameters` says which parameters are kept.
"""

from __future__ import annotations

import hashlib
import io
import logging
import lzma
import mmap
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rotorid.errors import LogError, UsageError
from rotorid.io.folders import replacing, scratch_folder
from rotorid.typing import AnyArray, IntArray

if TYPE_CHECKING:
    from zipfile import ZipFile


def write_atomically(path: Path, data: bytes | str) -> None:
    """Write a file so that a reader sees the old content or the new one, never a part.

    The data go to a temporary folder beside it, and replace ``path`` in one step. Missing folders are made.

    Parameters
    ----------
    data
        Content; text is encoded as UTF-8.

    Raises
    ------
    UsageError
        The place cannot be written.
    """
    content = data.encode("utf-8") if isinstance(data, str) else data
    try:
        with replacing(path) as place:
            place.write_bytes(content)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written: {error.strerror or error}",
            needed="a folder with space that this user may write to",
            remedy="choose another place",
        ) from error


_SAMPLE_BYTES, _WORTH = 1 << 15, 0.85


def write_npz(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Write named arrays as an ``.npz`` without pickles, compressed where that makes them smaller, atomically.

    Parameters
    ----------
    arrays
        Name to array of numbers or of text; an array of Python objects is refused.

    Raises
    ------
    UsageError
        The place cannot be written.
    ValueError
        An array holds Python objects.
    """
    pickled = [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]
    if pickled:
        raise ValueError(f"arrays of Python objects cannot be stored: {', '.join(pickled)}")
    buffer = io.BytesIO()
    # Not numpy.savez: it takes names for its own keywords, and stamps the file with the hour, so that equal results
    # would differ.
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
            method = zipfile.ZIP_DEFLATED if _shrinks(member.getbuffer()) else zipfile.ZIP_STORED
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member.getbuffer(), method)
    write_atomically(path, buffer.getvalue())


def _shrinks(content: memoryview) -> bool:
    """Whether compression is worth its time, by the middle of a content: measured numbers are noise in most digits."""
    middle = max(content.nbytes - _SAMPLE_BYTES, 0) // 2
    sample = content[middle : middle + _SAMPLE_BYTES]
    return len(zlib.compress(sample, 1)) < _WORTH * sample.nbytes


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_MAGIC = {b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2", b"PK\x03\x04": "zip", b"PK\x05\x06": "zip"}
_CHUNK_BYTES = 1 << 20
_DECODER_BYTES = 256 << 20
"""Memory that an xz file may ask its decoder for: four times what the strongest preset needs, a tenth of the most."""


@dataclass(frozen=True, kw_only=True, slots=True)
class UnpackLimits:
    """How much a compressed log may grow.

    Parameters
    ----------
    size_bytes
        Largest unpacked size.
    ratio
        Largest ratio of unpacked to packed size; flight logs stay under 50.
    free_bytes
        The ratio is judged only above this size, since short files of zeros are harmless.
    """

    size_bytes: int = 4 << 30
    ratio: float = 300.0
    free_bytes: int = 64 << 20


def compression_of(head: bytes) -> str:
    """Name of the compression that a file starts with, or an empty string.

    Examples
    --------
    >>> compression_of(bytes([0x1F, 0x8B, 8, 0])), compression_of(b"ULog")
    ('gzip', '')
    """
    return next((name for magic, name in _MAGIC.items() if head.startswith(magic)), "")


@contextmanager
def unpacked(path: Path, compression: str, limits: UnpackLimits | None = None) -> Iterator[Path]:
    """Path of the unpacked log, which is gone when the context ends.

    Parameters
    ----------
    path
        A compressed file.
    compression
        What `compression_of` says about it.
    limits
        How much it may grow.

    Raises
    ------
    LogError
        The archive is damaged, encrypted, holds several files, or grows over the limits.
    """
    limits = limits or UnpackLimits()
    with scratch_folder() as folder:
        target = folder / path.stem
        try:
            with path.open("rb") as packed, _stream(packed, path.name, compression) as stream, target.open("wb") as out:
                _copy(stream, out, path, limits)
        except (EOFError, OSError, zlib.error, lzma.LZMAError) as error:
            raise _damaged(path.name, compression, str(error)) from error
        yield target


def beginning(path: Path, most_bytes: int) -> bytes:
    """The first bytes of a log, unpacked as far as that where it is compressed.

    Raises
    ------
    LogError
        The archive is damaged.
    OSError
        The file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(most_bytes)
        compression = compression_of(head)
        if not compression:
            return head
        file.seek(0)
        try:
            with _stream(file, path.name, compression) as stream:
                return stream.read(most_bytes)
        except (EOFError, OSError, zlib.error, lzma.LZMAError) as error:
            raise _damaged(path.name, compression, str(error)) from error


def _damaged(name: str, compression: str, reason: str) -> LogError:
    return LogError(
        f"{name} cannot be unpacked as {compression}: {reason}",
        needed="an undamaged archive of one flight log",
        remedy="copy it again, or unpack it and give the log",
    )


@contextmanager
def _stream(packed: IO[bytes], name: str, compression: str) -> Iterator[IO[bytes]]:
    if compression == "zip":
        with _only_member(packed, name) as member:
            yield member
        return
    import bz2
    import gzip

    openers: dict[str, Callable[[IO[bytes]], Any]] = {"gzip": gzip.open, "xz": _xz, "bzip2": bz2.open}
    with openers[compression](packed) as stream:
        yield stream


@contextmanager
def _xz(packed: IO[bytes]) -> Iterator[IO[bytes]]:
    with io.BufferedReader(_XzStream(packed)) as stream:
        yield stream


class _XzStream(io.RawIOBase):
    """An xz file as a stream; `lzma.open` would let the file decide how much memory its decoder takes."""

    def __init__(self, packed: IO[bytes]) -> None:
        self._packed = packed
        self._waiting = packed.read(_CHUNK_BYTES)
        self._decoder = self._new_decoder()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while True:
            if self._decoder.eof and not self._next_stream():
                return 0
            content = self._decoder.decompress(self._waiting, len(buffer))
            self._waiting = b""
            if content:
                buffer[: len(content)] = content
                return len(content)
            if self._decoder.needs_input:
                self._waiting = self._packed.read(_CHUNK_BYTES)
                if not self._waiting:
                    raise EOFError("the file ends inside its compressed data")

    def _next_stream(self) -> bool:
        """Begin with the stream behind the one that ended, if there is one; streams may be padded with zeros."""
        rest = self._decoder.unused_data or self._packed.read(_CHUNK_BYTES)
        while rest and not (rest := rest.lstrip(b"\0")):
            rest = self._packed.read(_CHUNK_BYTES)
        if rest:
            self._waiting, self._decoder = rest, self._new_decoder()
        return bool(rest)

    @staticmethod
    def _new_decoder() -> lzma.LZMADecompressor:
        return lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=_DECODER_BYTES)


@contextmanager
def _only_member(packed: IO[bytes], name: str) -> Iterator[IO[bytes]]:
    import zipfile

    try:
        with zipfile.ZipFile(packed) as archive, archive.open(_member_name(archive, name)) as member:
            yield member
    # RuntimeError is zipfile's word for an encrypted member, NotImplementedError for a method that it does not know,
    # ValueError for names and offsets that are none. The answer to all of them is the same.
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError) as error:
        raise _damaged(name, "zip", str(error)) from error


def _member_name(archive: ZipFile, name: str) -> str:
    from zipfile import ZIP_LZMA

    members = [item for item in archive.namelist() if not item.endswith("/") and not item.startswith("__MACOSX/")]
    if len(members) != 1:
        printable = ("".join(filter(str.isprintable, member)) for member in members[:3])
        shown = ", ".join(printable) + (", ..." if len(members) > 3 else "")
        raise LogError(
            f"{name} is a zip of {len(members)} files" + (f" ({shown})" if members else ""),
            needed="a zip of exactly one flight log",
            remedy="unpack it and give the log itself, or the folder if they are the files of ulog2csv",
        )
    if archive.getinfo(members[0]).compress_type == ZIP_LZMA:
        raise _damaged(name, "zip", "its method lets the file decide how much memory is taken")
    return members[0]


def _copy(stream: IO[bytes], out: IO[bytes], path: Path, limits: UnpackLimits) -> None:
    packed_bytes = max(path.stat().st_size, 1)
    by_ratio = max(limits.free_bytes, int(limits.ratio * packed_bytes))
    allowed = min(limits.size_bytes, by_ratio)
    total = 0
    while chunk := stream.read(_CHUNK_BYTES):
        total += len(chunk)
        if total > allowed:
            raise LogError(
                f"{path.name} has {packed_bytes} bytes and unpacks to more than {allowed / 2**20:.0f} MiB",
                needed=f"at most {limits.size_bytes / 2**30:g} GiB and {limits.ratio:g} times the packed size",
                remedy="unpack it yourself if it is really a flight log, and give the log",
            )
        out.write(chunk)


_PROGRESS = logging.getLogger("rotorid.progress")


def log_progress(done: int, total: int) -> None:
    """Say how far a file has been read, in bytes; small ones are not reported."""
    if total > _LEAST_LOGGED_BYTES:
        _PROGRESS.info(f"reading, {100 * done // total} %", extra={"done": done, "total": total})


def let_go(data: AnyArray) -> None:
    """Give the memory back that looking at a mapped file has taken; what is looked at again is loaded again."""
    base: Any = data
    while isinstance(base, np.ndarray | memoryview):
        base = base.base if isinstance(base, np.ndarray) else base.obj
    if isinstance(base, mmap.mmap) and len(base) > _LET_GO_BYTES and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


_LEAST_LOGGED_BYTES = 32 << 20
_LET_GO_BYTES = 16 << 20
"""So much of a mapped file may be in memory at once."""
_CACHED_BYTES = 1 << 20

PART = 1 << 13
"""Places read at once: what stands around them fits into the cache, so that many values cost little more than one."""


def file_bytes(path: Path) -> AnyArray:
    """Content of a file, ``uint8``, mapped and read-only: only what is looked at is loaded, and may be evicted.

    The file must not be cut while the array is in use.

    Raises
    ------
    LogError
        The file cannot be read.
    """
    try:
        if path.stat().st_size == 0:
            return np.empty(0, dtype=np.uint8)
        # A plain view: indexing the subclass costs more than the indexing itself.
        return np.memmap(path, dtype=np.uint8, mode="r").view(np.ndarray)
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error


Place: TypeAlias = tuple[int, np.dtype[np.generic]]
"""Distance of a value behind a position in bytes, and its type as stored; it need not be aligned."""


def gather(data: AnyArray, positions: IntArray, places: Sequence[Place]) -> list[AnyArray]:
    """Values that stand at fixed distances behind each position, one array of shape ``(positions,)`` for each place.

    Parameters
    ----------
    data
        Bytes, ``uint8``.
    positions
        Every position must have room for all values behind it.
    places
        Distance and type of each value.

    Examples
    --------
    >>> data = np.frombuffer(b"-abc--def", dtype=np.uint8)
    >>> [values.tolist() for values in gather(data, np.array([0, 5]), [(1, np.dtype("S3")), (3, np.dtype("u1"))])]
    [[b'abc', b'def'], [99, 102]]
    """
    gathered: list[AnyArray] = [np.empty(positions.size, dtype=dtype) for _, dtype in places]
    gather_into(gathered, data, positions, places)
    return gathered


def _parts(positions: IntArray) -> Iterator[slice]:
    """Positions that are read at once: not too many, and not too far from each other."""
    begin = 0
    while begin < positions.size:
        end = min(begin + PART, positions.size)
        reach = int(positions[begin]) + _LET_GO_BYTES
        if int(positions[end - 1]) > reach:
            end = max(begin + int(np.searchsorted(positions[begin:end], reach)), begin + 1)
        yield slice(begin, end)
        begin = end


def gather_into(targets: Sequence[AnyArray], data: AnyArray, positions: IntArray, places: Sequence[Place]) -> None:
    """Do as `gather` does, but convert the values to the types of arrays that are there already and fill these."""
    if not positions.size or not places:
        return
    first = min(offset for offset, _ in places)
    width = max(offset + dtype.itemsize for offset, dtype in places) - first
    # Every byte starts an item of this overlapping view, so that one indexing collects the surroundings of many places.
    overlapping: AnyArray = np.ndarray(
        shape=(data.size - first - width + 1,),
        dtype=np.dtype((np.void, width)),
        buffer=data,
        offset=first,
        strides=(1,),
    )
    looked_at = int(positions[0])
    for part in _parts(positions):
        if int(positions[part.stop - 1]) - looked_at > _LET_GO_BYTES:
            let_go(data)
            looked_at = int(positions[part.start])
        rows = overlapping[positions[part]].view(np.uint8).reshape(-1, width)
        for values, (offset, dtype) in zip(targets, places, strict=True):
            values[part] = rows[:, offset - first : offset - first + dtype.itemsize].view(dtype)[:, 0]
    if int(positions[-1]) - looked_at > _CACHED_BYTES:
        let_go(data)
