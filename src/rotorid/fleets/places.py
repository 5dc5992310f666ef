"""Where logs are: files, folders, patterns, archives, and the stores that fsspec reaches."""

from __future__ import annotations

import errno
import glob
import hashlib
import shutil
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, TypeGuard
from urllib.request import url2pathname

from rotorid.data.base import Immutable
from rotorid.errors import LogError, UsageError
from rotorid.fleets.table import MEMBER
from rotorid.io.folders import scratch_folder
from rotorid.io.formats import HEAD_BYTES
from rotorid.io.named import find_logs, holds_log
from rotorid.letters import visible

_MOST_NAME_BYTES = 200
"""File systems take 255, and programs add to it."""

_OF_PLACE = frozenset(
    {
        errno.EACCES, errno.EPERM, errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.ESTALE, errno.EMFILE,
        errno.ENFILE, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ENOTCONN, errno.ETIMEDOUT, errno.EHOSTUNREACH,
        errno.ENETDOWN, errno.ENETUNREACH, errno.ECONNREFUSED, errno.ECONNRESET,
    }
)  # fmt: skip

_MOST_MEMBERS = 1_000_000
_MOST_MEMBER_BYTES = 8 << 30


@dataclass(frozen=True, kw_only=True)
class Place(Immutable):
    """One log that was found.

    Parameters
    ----------
    address
        Path of a file, ``archive.zip!member``, or an address such as ``s3://bucket/log.ulg``.
    mark
        Size and time of change, or what a store gives instead; another one means that the log changed.
    """

    address: str
    mark: str

    @property
    def name(self) -> str:
        """Last part of the address."""
        return PurePosixPath(self.address.rpartition(MEMBER)[2].replace("\\", "/")).name

    @property
    def file_name(self) -> str:
        """Name of a copy: the end of a name that a file system would refuse, with what says its format.

        Examples
        --------
        >>> Place(address="a.zip!" + 300 * "x" + ".ulg.gz", mark="").file_name[-10:]
        'xxx.ulg.gz'
        """
        return self.name.encode("utf-8", "replace")[-_MOST_NAME_BYTES:].decode("utf-8", "ignore")

    @property
    def folder(self) -> str:
        """Name of the folder around it."""
        inside = self.address.rpartition(MEMBER)[2] if MEMBER in self.address else self.address
        around = PurePosixPath(inside.replace("\\", "/")).parent.name
        return around or PurePosixPath(self.address.partition(MEMBER)[0]).stem

    @property
    def remote(self) -> bool:
        """Whether fsspec is needed to reach it."""
        return is_remote(self.address)

    @property
    def is_file(self) -> bool:
        """Whether it is a file of this machine by itself; the name of a member may be longer than one of a file."""
        try:
            return not self.remote and Path(self.address).is_file()
        except OSError:
            return False


class UnreachableError(LogError):
    """A log cannot be had, whatever is in it: the place, the store or the network is at fault."""


def is_remote(address: str) -> bool:
    """Whether an address names a store.

    Examples
    --------
    >>> is_remote("s3://fleet/2025/a.ulg"), is_remote("logs/a.ulg")
    (True, False)
    """
    return "://" in address


@dataclass(frozen=True, kw_only=True)
class FoundPlaces(Immutable):
    """The logs behind what was named, and the names of other files in the same folders, archives and stores."""

    places: tuple[Place, ...]
    skipped: tuple[str, ...] = ()


def find_places(paths: Iterable[str | Path]) -> FoundPlaces:
    """The logs as :func:`places_of` finds them, and what is no log.

    Raises
    ------
    UsageError
        A path leads to nothing, or nothing was found at all.
    """
    found: dict[str, Place] = {}
    skipped: dict[str, None] = {}
    for path in paths:
        for item in _behind(str(path)):
            if isinstance(item, Place):
                found[item.address] = item
            else:
                skipped[item] = None
    if not found:
        raise UsageError("no flight log found", needed="a log, a folder of logs, a pattern or an address")
    return FoundPlaces(
        places=tuple(found[address] for address in sorted(found)),
        skipped=tuple(visible(Place(address=item, mark="").name) for item in sorted(skipped) if item not in found),
    )


def places_of(paths: Iterable[str | Path]) -> tuple[Place, ...]:
    """All logs behind files, folders, patterns, archives and addresses, each once, in the order of their names.

    Parameters
    ----------
    paths
        As the user gave them.

    Raises
    ------
    UsageError
        A path leads to nothing, or nothing was found at all.
    """
    return find_places(paths).places


def _behind(path: str) -> Iterator[Place | str]:
    """Logs, and the addresses of other files."""
    if is_remote(path):
        if not path.startswith("file://"):
            yield from _in_store(path)
            return
        path = url2pathname(path.removeprefix("file://"))
    files = [Path(path)]
    if not files[0].exists():
        files = [Path(item) for item in sorted(glob.glob(path, recursive=True))]  # noqa: PTH207 - of any depth, absolute or not
        if not files:
            raise UsageError(f"{path} does not exist", needed="a log, a folder of logs, a pattern or an address")
    found = find_logs(files, archives=True)
    for log in found.files:
        yield from _in_file(log)
    yield from map(str, found.skipped)
    yield from (f"{link} (a link out of the folder)" for link in found.linked)


def _in_file(log: Path) -> Iterator[Place | str]:
    """A file, or the logs in it where it is an archive of several."""
    facts = log.stat()
    mark = f"{facts.st_size}-{facts.st_mtime_ns}"
    if log.suffix.lower() == ".zip" and (members := _members(log)):
        for name, crc, wanted in members:
            address = f"{log}{MEMBER}{name}"
            yield Place(address=address, mark=f"{mark}-{crc:08x}") if wanted else address
        return
    yield Place(address=str(log), mark=mark)


def _members(archive: Path) -> list[tuple[str, int, bool]]:
    """Name and checksum of the files in an archive, and whether they are logs.

    None where it has only one file, which the readers unpack themselves.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            inside = [member for member in opened.infolist() if not member.is_dir() and not _hidden(member.filename)]
            if len(inside) > _MOST_MEMBERS:
                raise UsageError(f"{archive} contains {len(inside)} files", needed=f"at most {_MOST_MEMBERS}")
            if len(inside) < 2:
                return []
            found = [
                (member.filename, member.CRC, holds_log(Path(member.filename), partial(_member_head, opened, member)))
                for member in inside
            ]
    # What zipfile says of damage, of names and offsets that are none, of methods that it does not know. Its one place
    # then goes to the reader, which reports it.
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return []
    return found if any(wanted for _, _, wanted in found) else []


def _hidden(name: str) -> bool:
    return any(part.startswith(".") or part == "__MACOSX" for part in PurePosixPath(name).parts)


def _member_head(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    try:
        with archive.open(member) as packed:
            return packed.read(HEAD_BYTES)
    # RuntimeError: it is encrypted.
    except (OSError, zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError, EOFError, zlib.error):
        return b""


def _in_store(address: str) -> Iterator[Place | str]:
    system, path = _store(address)
    try:
        matched = system.glob(path) if glob.has_magic(path) else [path]
        files: dict[str, Any] = {}
        for item in matched:
            files |= system.find(item, detail=True)
    except (OSError, ValueError) as error:
        raise UsageError(f"{address} cannot be listed: {error}") from error
    for name, facts in sorted(files.items()):
        if not holds_log(Path(name), partial(_stored_head, system, name)):
            yield str(system.unstrip_protocol(name))
        else:
            fields = [str(facts.get(key, "")) for key in ("size", "ETag", "etag", "md5Hash", "mtime", "LastModified")]
            yield Place(
                address=str(system.unstrip_protocol(name)),
                mark=hashlib.sha256("|".join(fields).encode()).hexdigest()[:24],
            )


def _stored_head(system: Any, name: str) -> bytes:
    try:
        return bytes(system.cat_file(name, start=0, end=HEAD_BYTES))
    except (OSError, ValueError):
        return b""


def _store(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError as error:
        raise UsageError(f"{address} needs fsspec", remedy="pip install 'rotorid[cluster]'") from error
    try:
        system, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError, OSError) as error:
        raise UsageError(
            f"{address} cannot be reached: {error}", needed="an address that fsspec knows, such as s3://BUCKET/FOLDER"
        ) from error
    return system, path


def is_of_place(error: BaseException | None) -> TypeGuard[OSError]:
    """Whether an error is that of a place, a disk or a network, and not of what is stored there."""
    return isinstance(error, OSError) and error.errno in _OF_PLACE


@contextmanager
def fetched(place: Place) -> Iterator[Path]:
    """A file to read a log from: itself, or a copy that is gone when the context ends.

    Raises
    ------
    UnreachableError
        It cannot be had.
    LogError
        The archive around it is damaged.
    """
    if place.remote:
        with scratch_folder() as folder:
            copy = folder / place.file_name
            system, path = _store(place.address)
            try:
                system.get_file(path, str(copy))
            except (OSError, ValueError) as error:
                raise UnreachableError(f"{place.name} cannot be fetched: {error}") from error
            yield copy
        return
    archive, _, member = place.address.rpartition(MEMBER)
    if not archive or place.is_file:
        yield Path(place.address)
        return
    with scratch_folder() as folder:
        copy = folder / place.file_name
        try:
            with zipfile.ZipFile(archive) as opened:
                if opened.getinfo(member).file_size > _MOST_MEMBER_BYTES:
                    raise LogError(
                        f"{place.name} unpacks to more than {_MOST_MEMBER_BYTES >> 30} GiB", needed="a flight log"
                    )
                with opened.open(member) as packed, copy.open("wb") as file:
                    shutil.copyfileobj(packed, file)
        # KeyError: the member is gone. RuntimeError: it is encrypted. NotImplementedError: a method unknown to zipfile.
        except (OSError, KeyError, ValueError, zipfile.BadZipFile, RuntimeError, NotImplementedError) as error:
            if is_of_place(error):
                raise UnreachableError(f"{place.name} cannot be unpacked: {error.strerror}") from error
            raise LogError(f"{place.name} cannot be unpacked: {error}", needed="an undamaged archive") from error
        yield copy
