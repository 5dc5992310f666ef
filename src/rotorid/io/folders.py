"""Folders of results: made whole beside their place, exchanged in one step, and cleared up after runs that were killed.

A run makes its files in a folder of its own, `.rotorid-making-…`, and gives it the name of the target when all of them
are complete. Where the target holds a result already, the two are exchanged by the file system in one step (Linux,
macOS), so that whoever looks sees the old set or the new one. Files that are not rotorid's live on: they are linked
into the new folder before the exchange.

Some folders cannot change places: the current one, a mount point, one whose parent may not be written, one with foreign
folders inside. There the files are moved one by one, the result file last, and what a killed run left to move is moved
by the next.

Every folder that is being made is locked by the run that makes it. A lock that can be taken belongs to nobody: the
folder is a leftover, and goes.

All files of a set bear one stamp, a whole second. A file with a later one was changed after it was written, and is
foreign from then on.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import hashlib
import itertools
import json
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rotorid.errors import UsageError
from rotorid.io.documents import MOST_JSON_BYTES, parse_json, read_text

_MAKING = ".rotorid-making-"
_SCRATCH = "rotorid-scratch-"
_LEFTOVER = re.compile(r"(\.rotorid-making-|rotorid-scratch-)[0-9a-f]{16}")
_NEW, _OLD, _JOB = "new", "old", "job.json"

_FOREIGN_AT_MOST = 1000
"""A folder with more foreign files than this stays where it is."""
_RESULT_BYTES = MOST_JSON_BYTES
_SECOND_NS = 10**9
_COPIED_NS = 2 * _SECOND_NS
"""Stamps of a copied set are not whole seconds, and lie this close together."""
_OLD_AGE_S = 86400.0
_PATIENCE_S = 10.0

_active: set[Path] = set()
"""Folders that this process is making."""


def read_json(path: Path) -> Any:
    """The JSON in a file."""
    return parse_json(read_text(path, needed="a result", most_bytes=_RESULT_BYTES))


@dataclass(frozen=True, kw_only=True)
class ResultKind:
    """How the results of a command are known again.

    Parameters
    ----------
    mains
        Names of the JSON file that makes a folder a result, of which one must be there.
    schema
        How its ``schema`` begins.
    files
        Patterns of the files beside it that are the command's own.
    listed
        Files that the JSON names, each with its SHA-256 or nothing.
    reader
        Reads a main file; whatever is wrong with it is an OSError, a ValueError or a RecursionError.
    """

    mains: tuple[str, ...]
    schema: str = "rotorid."
    files: tuple[str, ...] = ()
    listed: Callable[[Mapping[str, Any]], Mapping[str, str | None]] = field(default=lambda _: {})
    reader: Callable[[Path], Mapping[str, Any]] = field(default=read_json)


@dataclass(frozen=True, kw_only=True)
class Target:
    """Where the results of a run go.

    Parameters
    ----------
    folder
        The folder; of a default name, before it is numbered.
    kind
        What the command writes.
    numbered
        The name is a default: where it is taken, a number follows it.
    force
        Overwrite what is not rotorid's.
    asked
        How a person named the place, for messages.
    """

    folder: Path
    kind: ResultKind
    numbered: bool = False
    force: bool = False
    asked: str = ""


@dataclass
class AtomicFolder:
    """A folder that is being made, and what becomes of it.

    Parameters
    ----------
    place
        Where files are written until all are complete.
    folder
        Where they are afterwards.
    """

    place: Path
    folder: Path


def target_folder(out: Path | None, default: Path, kind: ResultKind, *, force: bool = False) -> Target:
    """Where results will go, checked before any work is done; leftovers of killed runs there are removed.

    Parameters
    ----------
    out
        The folder that the user named. It may be new, empty or a result of the same command, which is replaced; other
        files in it stay, unless they are in the way, which is refused.
    default
        The folder otherwise; numbered where the name is taken.
    kind
        What the command writes.
    force
        Overwrite also what is not rotorid's.

    Raises
    ------
    UsageError
        Foreign files are in the way, or the place cannot be written.
    """
    target = Target(
        folder=default if out is None else out, kind=kind, numbered=out is None, force=force, asked=str(out or default)
    )
    folder = _resolved(target.folder)
    clear_leftovers(folder.parent)
    if target.numbered:
        folder = _numbered(folder)
    elif folder.is_dir():
        clear_leftovers(folder)
    _require_writable(folder, target)
    if not force and not target.numbered and (taken := _in_the_way(folder, kind, ())):
        # What looks foreign may be half of the set that another run is putting there.
        with _one_at_a_time(folder if _stays(folder) else folder.parent):
            taken = _in_the_way(folder, kind, ())
        _refuse_foreign(folder, target, taken)
    return target


@contextmanager
def making(target: Target) -> Iterator[AtomicFolder]:
    """A folder to write results into; when the context ends well it takes the place of the target, and never in part.

    Inside of a folder that is being made already, the files go there directly.

    Raises
    ------
    UsageError
        Foreign files are in the way, or the place cannot be written.
    """
    folder = _resolved(target.folder)
    if is_being_made(folder):
        with _as_unwritable(target.asked or str(folder)):
            folder.mkdir(parents=True, exist_ok=True)
        yield AtomicFolder(folder, folder)
        return
    with _as_unwritable(target.asked or str(folder)):
        inside = folder.is_dir() and not target.numbered and _stays(folder)
        parent = folder if inside else folder.parent
        parent.mkdir(parents=True, exist_ok=True)
        claim = _Claim(parent, _MAKING)
    place = claim.path / _NEW
    try:
        with _as_unwritable(target.asked or str(folder)):
            place.mkdir()
        _active.add(place)
        made = AtomicFolder(place, target.folder)
        yield made
        with _as_unwritable(target.asked or str(folder)):
            final = _publish(claim.path, folder, target)
        made.folder = target.folder.with_name(final.name) if target.numbered else target.folder
    finally:
        _active.discard(place)
        try:
            _recover(claim.path)
        except OSError:
            # What cannot be finished now is finished by the next run.
            claim.leave()
        else:
            claim.release()


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A temporary folder that is gone when the context ends; those of killed runs go too."""
    home = Path(tempfile.gettempdir())
    clear_leftovers(home)
    claim = _Claim(home, _SCRATCH, mode=0o700)
    try:
        yield claim.path
    finally:
        claim.release()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write a file to, which then replaces ``path`` in one step.

    Inside of a folder that is being made it is ``path`` itself, since the folder appears as a whole.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if is_being_made(path.parent):
        yield path
        return
    clear_leftovers(path.parent)
    claim = _Claim(path.parent, _MAKING)
    try:
        temporary = claim.path / "file"
        yield temporary
        temporary.replace(path)
    finally:
        claim.release()


def is_being_made(folder: Path) -> bool:
    """Whether a folder belongs to a set that this process is making."""
    return any(folder == place or place in folder.parents for place in _active)


def clear_leftovers(parent: Path) -> None:
    """Remove what killed runs left in a folder; a move that they had begun is finished."""
    try:
        found = [Path(entry.path) for entry in os.scandir(parent) if _LEFTOVER.fullmatch(entry.name)]
    except OSError:
        return
    for path in found:
        with contextlib.suppress(OSError):
            lock = _abandoned(path)
            if lock is None:
                continue
            try:
                _recover(path)
                shutil.rmtree(path, ignore_errors=True)
            finally:
                _unlock(lock)


# What is rotorid's, and what is in the way


def own_files(folder: Path, kind: ResultKind) -> set[str]:
    """Files of a result by their paths inside its folder; none where the folder holds no result of this kind."""
    document, stamp_ns = _main(folder, kind)
    if document is None:
        return set()
    try:
        listed = {name: digest for name, digest in kind.listed(document).items() if _is_inside(name)}
    except (KeyError, TypeError, AttributeError, ValueError):
        listed = {}
    found = {path.relative_to(folder).as_posix() for pattern in kind.files for path in folder.glob(pattern)}
    own = set()
    for name in {*kind.mains, *found, *listed}:
        path = folder / name
        if path.is_symlink() or not path.is_file():
            continue
        digest = listed.get(name)
        if _of_one_set(path.stat().st_mtime_ns, stamp_ns) if digest is None else _has_hash(path, digest):
            own.add(name)
    return own


def _of_one_set(file_ns: int, main_ns: int) -> bool:
    # A set is stamped with a whole second; only the stamps of a copy are none, and lie close together.
    return abs(file_ns - main_ns) <= (0 if main_ns % _SECOND_NS == 0 else _COPIED_NS)


def _main(folder: Path, kind: ResultKind) -> tuple[Mapping[str, Any] | None, int]:
    """The JSON that makes a folder a result, and its stamp."""
    for name in kind.mains:
        path = folder / name
        try:
            facts = path.lstat()
            if not stat.S_ISREG(facts.st_mode) or facts.st_size > _RESULT_BYTES:
                continue
            document = kind.reader(path)
        except (OSError, ValueError, RecursionError, UsageError):
            continue
        if isinstance(document, dict) and str(document.get("schema", "")).startswith(kind.schema):
            return document, facts.st_mtime_ns
    return None, 0


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Everything below a folder that is no folder, and folders that are empty, by their paths inside it."""
    for place, folders, files in os.walk(folder):
        here = Path(place)
        for name in folders[:]:
            if (here / name).is_symlink():
                folders.remove(name)
                files.append(name)
            elif _LEFTOVER.fullmatch(name):
                folders.remove(name)
        if not folders and not files and here != folder:
            yield here.relative_to(folder).as_posix(), here
        for name in files:
            yield (here / name).relative_to(folder).as_posix(), here / name


def _has_hash(path: Path, digest: str) -> bool:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() == digest


def _in_the_way(folder: Path, kind: ResultKind, new: Sequence[str]) -> list[str]:
    """Foreign files and folders where files of the command belong, of which the names are known or foreseen."""
    if not folder.is_dir():
        return [folder.name] if os.path.lexists(folder) else []
    own = own_files(folder, kind)
    taken = set()
    for name in new or (*kind.mains, *(pattern for pattern in kind.files if "*" not in pattern)):
        places = [Path(name), *Path(name).parents[:-1]]
        if name not in own and os.path.lexists(folder / name):
            taken.add(name)
        # A file where a folder belongs.
        taken |= {
            path.as_posix() for path in places[1:] if os.path.lexists(folder / path) and not (folder / path).is_dir()
        }
    return sorted(taken)


def _refuse_foreign(folder: Path, target: Target, taken: Sequence[str]) -> None:
    if not taken:
        return
    shown = ", ".join(taken[:3]) + (f" and {len(taken) - 3} more" if len(taken) > 3 else "")
    if not folder.is_dir():
        raise UsageError(
            f"{target.asked} is a file", needed="a folder for the results", remedy="choose another, or give --force"
        )
    raise UsageError(
        f"{target.asked} contains {shown}, which this command did not write or which changed since",
        needed="a new folder, or one with a result of the same command",
        remedy="choose another with --out, or overwrite with --force",
    )


def _require_writable(folder: Path, target: Target) -> None:
    place = folder
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    if place != folder and not place.is_dir():
        raise _unwritable(target.asked, f"{place.name} is a file")
    usable = place if place.is_dir() else place.parent
    # The root of Unix may write everywhere but where nobody may; the rest is seen when the files are written.
    if not os.access(usable, os.W_OK | os.X_OK):
        raise _unwritable(target.asked, "Permission denied")


def _unwritable(asked: str, why: str) -> UsageError:
    return UsageError(f"{asked} cannot be written: {why}", needed="a folder to write to", remedy="choose it with --out")


@contextmanager
def _as_unwritable(asked: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise _unwritable(asked, error.strerror or str(error)) from error


# The exchange


def _resolved(folder: Path) -> Path:
    """The folder itself, also behind links and from the current folder."""
    return Path(os.path.realpath(folder))


def _numbered(folder: Path) -> Path:
    names = itertools.chain([folder], (folder.with_name(f"{folder.name}-{n}") for n in itertools.count(2)))
    return next(name for name in names if not os.path.lexists(name))


def _stays(folder: Path) -> bool:
    """Whether a folder cannot change places with another."""
    here = Path(os.path.realpath(Path.cwd()))
    return (
        folder == here
        or folder in here.parents
        or os.path.ismount(folder)
        or not os.access(folder.parent, os.W_OK | os.X_OK)
    )


def _publish(claim: Path, folder: Path, target: Target) -> Path:
    """Give the new folder the name of the target."""
    new = claim / _NEW
    names = sorted(name for name, _ in _files(new))
    _stamp(new, names)
    if target.numbered:
        return _take_number(new, folder)
    with _one_at_a_time(claim.parent):
        if not os.path.lexists(folder):
            new.rename(folder)
            return folder
        taken = _in_the_way(folder, target.kind, names)
        if not target.force:
            _refuse_foreign(folder, target, taken)
        _replace(claim, folder, target.kind, names, taken)
    return folder


def _stamp(new: Path, names: Sequence[str]) -> None:
    now_ns = time.time_ns() // _SECOND_NS * _SECOND_NS
    for name in names:
        os.utime(new / name, ns=(now_ns, now_ns))


def _take_number(new: Path, folder: Path) -> Path:
    """The first name that is free; another run may take one at the same time, which the file system reports."""
    while True:
        name = _numbered(folder)
        try:
            new.rename(name)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR) and not os.path.lexists(name):
                raise
            continue
        return name


def _replace(claim: Path, folder: Path, kind: ResultKind, names: Sequence[str], taken: Sequence[str]) -> None:
    """Put the new files in the place of the old ones; foreign files stay."""
    new = claim / _NEW
    if not folder.is_dir():
        _exchange(claim, folder)
        return
    own = own_files(folder, kind) | set(taken)
    inside = claim.parent == folder
    in_place = inside or not _keep_foreign(folder, new, own | set(names))
    job = {
        "target": folder.name,
        "inside": inside,
        "in_place": in_place,
        "names": list(names),
        "own": sorted(own),
        "mains": list(kind.mains),
    }
    _write_job(claim, job)
    if in_place:
        _move_in(claim, folder, job)
        return
    new.chmod(stat.S_IMODE(folder.stat().st_mode))
    _exchange(claim, folder)
    _rescue(claim, folder, job)


def _keep_foreign(folder: Path, new: Path, own: set[str]) -> bool:
    """Link foreign files into the new folder; whether all could be."""
    foreign = list(itertools.islice(((n, p) for n, p in _files(folder) if not _belongs(n, own)), _FOREIGN_AT_MOST + 1))
    if len(foreign) > _FOREIGN_AT_MOST:
        return False
    linked = []
    try:
        for name, path in foreign:
            if path.is_dir() and not path.is_symlink():
                (new / name).mkdir(parents=True, exist_ok=True)
                continue
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            os.link(path, new / name, follow_symlinks=False)
            linked.append(new / name)
    except (OSError, NotImplementedError):
        # Moving one by one begins with the new files alone.
        for path in linked:
            path.unlink()
        return False
    return True


def _belongs(name: str, files: set[str]) -> bool:
    """Whether a path is one of these, or lies in one of these."""
    return name in files or any(parent.as_posix() in files for parent in Path(name).parents)


def _write_job(claim: Path, job: Mapping[str, Any]) -> None:
    part = claim / "job.part"
    part.write_text(json.dumps(job), encoding="utf-8")
    part.replace(claim / _JOB)


def _exchange(claim: Path, folder: Path) -> None:
    """Let the new folder and the old one change places, in one step where the system can."""
    new, old = claim / _NEW, claim / _OLD
    if _swapped(new, folder):
        new.rename(old)
        return
    folder.rename(old)
    try:
        new.rename(folder)
    except OSError:
        old.rename(folder)
        raise


def _swapped(path: Path, other: Path) -> bool:
    """Exchange two names in one step; False where system or file system cannot."""
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            return bool(libc.renamex_np(os.fsencode(path), os.fsencode(other), 2) == 0)
        if sys.platform.startswith("linux"):
            here = -100  # AT_FDCWD
            return bool(libc.renameat2(here, os.fsencode(path), here, os.fsencode(other), 2) == 0)
    except (AttributeError, OSError, TypeError):
        pass
    return False


def _rescue(claim: Path, folder: Path, job: Mapping[str, Any]) -> None:
    """Bring what is foreign from the old folder into the new one: what came or changed while they were exchanged."""
    old = claim / _OLD
    if not old.is_dir():
        return
    gone = {*job["names"], *job["own"]}
    for name, path in list(_files(old)):
        if _belongs(name, gone) or (path.is_dir() and not path.is_symlink()):
            continue
        place = folder / name
        if not os.path.lexists(place) or not os.path.samestat(path.lstat(), place.lstat()):
            place.parent.mkdir(parents=True, exist_ok=True)
            path.replace(place)


def _move_in(claim: Path, folder: Path, job: Mapping[str, Any]) -> None:
    """Move the new files in, one by one; without its main file, which comes last, a folder is no result."""
    new = claim / _NEW
    mains = [name for name in job["names"] if name in job["mains"]]
    rest = [name for name in job["names"] if name not in mains]
    waiting = {name for name, _ in _files(new)}
    # Main files first: from here on there is no result, until the last move.
    for name in sorted(job["own"], key=lambda name: name not in job["mains"]):
        if name in job["names"] and name not in waiting:
            continue  # moved in already, by the run that was killed
        _remove(folder / name)
        with contextlib.suppress(OSError):
            if "/" in name:
                (folder / name).parent.rmdir()
    for name in (*rest, *mains):
        if name in waiting:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).replace(folder / name)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _recover(claim: Path) -> None:
    """Finish or undo what a killed run had begun; its folder then holds nothing that anybody misses."""
    try:
        job = parse_json(read_text(claim / _JOB, needed="an exchange that was begun", most_bytes=_RESULT_BYTES))
        names = [job["target"], *job["names"], *job["own"], *job["mains"]]
    except (UsageError, ValueError, KeyError, TypeError):
        return
    if not all(isinstance(name, str) and _is_inside(name) for name in names) or "/" in job["target"]:
        return
    folder = claim.parent if job.get("inside") else claim.parent / job["target"]
    new, old = claim / _NEW, claim / _OLD
    if job.get("in_place"):
        if folder.is_dir():
            _move_in(claim, folder, job)
        return
    if old.is_dir() and not os.path.lexists(folder):
        old.rename(folder)
        return
    if new.is_dir() and not old.exists():
        # Killed before the exchange or right after it: in both cases what is foreign in there is kept.
        new.rename(old)
    if folder.is_dir():
        _rescue(claim, folder, job)


def _is_inside(name: str) -> bool:
    path = Path(name)
    return bool(name) and not path.is_absolute() and ".." not in path.parts


# Locks


class _Claim:
    """A folder that this process alone uses, as long as its lock is held; released it is gone."""

    def __init__(self, parent: Path, prefix: str, mode: int = 0o777) -> None:
        while True:
            path = parent / f"{prefix}{secrets.token_hex(8)}"
            path.mkdir(mode=mode)
            # Somebody who clears up may have taken it for a leftover before it was locked.
            lock = _lock(path)
            if lock is not None and path.is_dir():
                break
        self.path, self._lock = path, lock

    def leave(self) -> None:
        """Give it up as it is."""
        _unlock(self._lock)

    def release(self) -> None:
        """Remove the folder with all that is left in it."""
        shutil.rmtree(self.path, ignore_errors=True)
        _unlock(self._lock)


_NO_LOCKS = -1


def _lock(path: Path) -> int | None:
    """A lock of a folder, which ends with the process; None where another has it."""
    try:
        import fcntl
    except ImportError:  # Windows: leftovers are known by their age.
        return _NO_LOCKS
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return None
    except OSError:
        return _NO_LOCKS
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError:  # A file system without locks.
        os.close(descriptor)
        return _NO_LOCKS
    return descriptor


def _unlock(lock: int) -> None:
    if lock != _NO_LOCKS:
        os.close(lock)


def _abandoned(path: Path) -> int | None:
    """The lock of a folder whose run is gone; None where it may still be at work, or is somebody else's."""
    facts = path.lstat()
    if not stat.S_ISDIR(facts.st_mode) or (hasattr(os, "getuid") and facts.st_uid != os.getuid()):
        return None
    lock = _lock(path)
    if lock == _NO_LOCKS and time.time() - facts.st_mtime < _OLD_AGE_S:
        return None
    return lock


@contextmanager
def _one_at_a_time(parent: Path) -> Iterator[None]:
    """One run after the other puts its results into a folder; who waits too long goes on, for an exchange is whole."""
    until_s = time.monotonic() + _PATIENCE_S
    while (lock := _lock(parent)) is None and time.monotonic() < until_s:
        time.sleep(0.005)
    try:
        yield
    finally:
        if lock is not None:
            _unlock(lock)
