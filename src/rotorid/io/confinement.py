"""What a child takes from itself before it looks at a foreign file: the means of its system, each where there is one.

Linux has them all: no new rights (``prctl``), an end with its parent, Landlock (files and network), a filter of system
calls (``seccomp``), and limits of memory, processor time and file sizes. macOS has the limits but that of memory,
Windows none: there the time limit of the parent and the small environment remain. Whatever a system lacks is left out,
and :func:`confine` says what is active.

References
----------
Linux kernel documentation, "Landlock: unprivileged access control" and "Seccomp BPF".
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import signal
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

KEPT_VARIABLES = (
    *("PATH", "LANG", "LC_ALL", "LC_CTYPE", "TZ", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH"),
    *("SYSTEMROOT", "SYSTEMDRIVE", "WINDIR", "PROCESSOR_ARCHITECTURE", "NUMBER_OF_PROCESSORS"),
)
"""All that a child gets of the environment; it finds its modules by ``PYTHONPATH``, which its parent sets."""

_SYSTEM = (
    *("/usr/lib", "/usr/lib64", "/usr/local/lib", "/lib", "/lib64", "/nix/store", "/etc/ld.so.cache", "/etc/localtime"),
    *("/usr/share/zoneinfo", "/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system", "/dev/urandom"),
    "/dev/null",
)


def environment(folder: Path, places: Iterable[str]) -> dict[str, str]:
    """The environment of a child that works in a folder and imports from some places: no secrets of the user."""
    kept = {name: os.environ[name] for name in KEPT_VARIABLES if name in os.environ}
    return kept | {
        "PYTHONPATH": os.pathsep.join(places),
        "PYTHONDONTWRITEBYTECODE": "1",
        **dict.fromkeys(("HOME", "USERPROFILE", "TMPDIR", "TEMP", "TMP"), str(folder)),
        # Each thread of a linear-algebra library reserves memory that would count against the limit.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }


def allowed(wanted: Mapping[str, int]) -> dict[str, int]:
    """Limits of resources, none above what already holds for this process; names are those of ``resource``."""
    try:
        import resource
    except ImportError:
        return dict(wanted)
    found = {}
    for name, value in wanted.items():
        limits = [limit for limit in resource.getrlimit(getattr(resource, name)) if limit != resource.RLIM_INFINITY]
        found[name] = min([value, *limits])
    return found


def confine(*, readable: Sequence[Path], writable: Path, limits: Mapping[str, int], parent: int) -> dict[str, bool]:
    """Take from this process what a parser does not need; it cannot be had back.

    Parameters
    ----------
    readable, writable
        The files that it may read, beside what Python is made of, and the folder that it may write.
    limits
        Limits of resources, by their names in ``resource``.
    parent
        The process without which this one ends.

    Returns
    -------
    dict
        Each protection, and whether it is active.
    """
    active = {"limits": _limit(limits)}
    libc = _libc()
    if libc is None:
        return active | dict.fromkeys(("parent", "no_new_privileges", "files", "network", "processes"), False)
    active["parent"] = end_with(parent)
    active["no_new_privileges"] = libc.prctl(_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
    active["files"] = _landlock(libc, readable, [writable])
    active["processes"] = active["network"] = _filter_calls(libc)
    return active


def end_with(parent: int) -> bool:
    """Let the system kill this process when its parent ends; whether it will.

    Parameters
    ----------
    parent
        Its number; where this process has another parent, that one has gone in the meantime, and this process ends.
    """
    libc = _libc()
    active = libc is not None and libc.prctl(_PDEATHSIG, signal.SIGKILL, 0, 0, 0) == 0
    if os.getppid() != parent:
        os._exit(1)
    return active


def confine_files(*, readable: Sequence[Path], writable: Sequence[Path]) -> bool:
    """Let this process, and all that it starts, read and write some places only, and gain no rights.

    Parameters
    ----------
    readable, writable
        Files and folders that it may read, beside what Python is made of, and folders that it may change.

    Returns
    -------
    bool
        Whether this is active: on Linux from 5.19, whose Landlock lets a folder of results take its place.
    """
    libc = _libc()
    if libc is None or not can_confine_files():
        return False
    # A child that it starts, such as a foreign parser, has its unused streams there.
    return libc.prctl(_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 and _landlock(libc, readable, [*writable, Path(os.devnull)])


def can_confine_files() -> bool:
    """Whether :func:`confine_files` can do what it says on this system; asking changes nothing."""
    libc = _libc()
    return libc is not None and int(libc.syscall(_CREATE, None, ctypes.c_size_t(0), ctypes.c_uint32(1))) >= _MOVES_SINCE


def _limit(limits: Mapping[str, int]) -> bool:
    try:
        import resource
    except ImportError:  # Windows has no such limits; the parent's clock remains.
        return False
    for name, value in {**allowed(limits), "RLIMIT_CORE": 0}.items():
        # macOS refuses an address-space limit below what is mapped already.
        if name == "RLIMIT_AS" and sys.platform == "darwin":
            continue
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(getattr(resource, name), (value, value))
    return True


_PDEATHSIG, _SECCOMP, _NO_NEW_PRIVS = 1, 22, 38


def _libc() -> ctypes.CDLL | None:
    if not sys.platform.startswith("linux"):
        return None
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl.argtypes = [ctypes.c_int, *[ctypes.c_ulong] * 4]
        libc.syscall.restype = ctypes.c_long
    except (OSError, AttributeError):
        return None
    return libc


# Landlock

_CREATE, _ADD, _RESTRICT = 444, 445, 446
_EXECUTE, _WRITE, _READ, _LIST = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REMOVE_FOLDER, _REMOVE_FILE, _MAKE_FOLDER, _MAKE_FILE, _TRUNCATE = 1 << 4, 1 << 5, 1 << 7, 1 << 8, 1 << 14
_MOVE = 1 << 13
_MOVES_SINCE = 2
"""Version of Landlock from which a file may be allowed to move to another folder."""

_OF_FILES = _EXECUTE | _WRITE | _READ | _TRUNCATE
_LOOK = _EXECUTE | _READ | _LIST
_WORK = _READ | _LIST | _WRITE | _REMOVE_FOLDER | _REMOVE_FILE | _MAKE_FOLDER | _MAKE_FILE | _TRUNCATE | _MOVE


def _landlock(libc: ctypes.CDLL, readable: Sequence[Path], writable: Sequence[Path]) -> bool:
    """Let this process see its own files only."""
    version = int(libc.syscall(_CREATE, None, ctypes.c_size_t(0), ctypes.c_uint32(1)))
    if version < 1:
        return False
    handled = (1 << (13 if version < 2 else 14 if version < 3 else 15 if version < 5 else 16)) - 1
    # Files; then, of later kernels, TCP; then signals and abstract sockets to others.
    words = [handled, *([3] if version >= 4 else []), *([3] if version >= 6 else [])]
    rules = (ctypes.c_uint64 * len(words))(*words)
    ruleset = int(libc.syscall(_CREATE, rules, ctypes.c_size_t(8 * len(words)), ctypes.c_uint32(0)))
    if ruleset < 0:
        return False
    modules = [Path(place) for place in (*sys.path, sys.prefix, sys.base_prefix, sys.exec_prefix) if place]
    libraries = [Path(place) for place in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if place]
    places = dict.fromkeys([*map(Path, _SYSTEM), *modules, *libraries, *readable], _LOOK)
    places |= dict.fromkeys(writable, _WORK)
    try:
        for place, rights in places.items():
            try:
                opened = os.open(place, os.O_PATH | os.O_CLOEXEC)
            except OSError:
                continue
            rights &= handled if place.is_dir() else handled & _OF_FILES
            rule = ctypes.create_string_buffer(struct.pack("<Qi", rights, opened))
            libc.syscall(_ADD, ctypes.c_int(ruleset), ctypes.c_int(1), rule, ctypes.c_uint32(0))
            os.close(opened)
        return bool(libc.syscall(_RESTRICT, ctypes.c_int(ruleset), ctypes.c_uint32(0)) == 0)
    finally:
        os.close(ruleset)


# System calls

_REFUSED: Mapping[str, tuple[int, int, tuple[int, ...]]] = {
    # Machine: its number in the kernel's audit, its clone, and what is refused: socket, connect, bind, fork, vfork,
    # execve, execveat, ptrace, process_vm_readv and _writev, kill, io_uring_setup, unshare, setns, mount, bpf, keyctl.
    "x86_64": (0xC000003E, 56, (41, 42, 49, 57, 58, 59, 322, 101, 310, 311, 62, 425, 272, 308, 165, 321, 250)),
    "aarch64": (0xC00000B7, 220, (198, 203, 200, 221, 281, 117, 270, 271, 129, 425, 97, 268, 40, 280, 219)),
}
_CLONE3, _THREAD = 435, 0x00010000
_LOAD, _EQUAL, _AT_LEAST, _HAS, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _NOT_PERMITTED, _NO_SUCH_CALL = 0x7FFF0000, 0x00050001, 0x00050026


def _filter_calls(libc: ctypes.CDLL) -> bool:
    """No network, no other programs, no other processes but threads."""
    machine = _REFUSED.get(platform.machine())
    if machine is None:
        return False
    audit, clone, refused = machine
    steps = [(_LOAD, 0, 0, 4), (_EQUAL, 1, 0, audit), (_RETURN, 0, 0, _NOT_PERMITTED), (_LOAD, 0, 0, 0)]
    # Other ways into the kernel, such as x32.
    steps += [(_AT_LEAST, 0, 1, 0x40000000), (_RETURN, 0, 0, _NOT_PERMITTED)]
    for number in refused:
        steps += [(_EQUAL, 0, 1, number), (_RETURN, 0, 0, _NOT_PERMITTED)]
    # The C library falls back to the older call, whose flags can be looked at.
    steps += [(_EQUAL, 0, 1, _CLONE3), (_RETURN, 0, 0, _NO_SUCH_CALL)]
    steps += [(_EQUAL, 0, 3, clone), (_LOAD, 0, 0, 16), (_HAS, 1, 0, _THREAD), (_RETURN, 0, 0, _NOT_PERMITTED)]
    steps += [(_RETURN, 0, 0, _ALLOW)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("<HBBI", *step) for step in steps))
    program = ctypes.create_string_buffer(struct.pack("@HP", len(steps), ctypes.addressof(code)))
    return bool(libc.prctl(_SECCOMP, 2, ctypes.addressof(program), 0, 0) == 0)
