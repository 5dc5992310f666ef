"""Compressed logs: ``.gz``, ``.xz``, ``.bz2`` and ``.zip`` are unpacked to a temporary file, within limits."""

from __future__ import annotations

import io
import lzma
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from rotorid.errors import LogError

if TYPE_CHECKING:
    from zipfile import ZipFile

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
    with tempfile.TemporaryDirectory(prefix="rotorid-") as folder:
        target = Path(folder) / path.stem
        try:
            with path.open("rb") as packed, _stream(packed, path.name, compression) as stream, target.open("wb") as out:
                _copy(stream, out, path, limits)
        except (EOFError, OSError, zlib.error, lzma.LZMAError) as error:
            raise _damaged(path.name, compression, str(error)) from error
        yield target


def _damaged(name: str, compression: str, reason: str) -> LogError:
    return LogError(
        f"{name} cannot be unpacked as {compression}: {reason}",
        needed="an undamaged archive of one flight log",
        remedy="copy it again from where it came, or unpack it yourself and give the log",
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
        shown = ", ".join(members[:3]) + (", ..." if len(members) > 3 else "")
        raise LogError(
            f"{name} is a zip of {len(members)} files" + (f" ({shown})" if members else ""),
            needed="a zip of exactly one flight log",
            remedy="unpack it and give the log itself",
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
