"""Programs of this package in processes of their own, started without their imports where the system allows it.

Imports take seconds, and most work for a page takes a tenth of one. On Linux a :class:`Program` keeps one process that
has imported it and does nothing else; each start is a copy of that process. Elsewhere, and where a copy cannot be made,
each start is a new process.

A copy is as separate as a new process: it has a session, streams, a folder and an environment of its own, no other
open file and no memory that another copy sees. The process that is copied has one thread and gets nothing but starts.
It ends its copies when it is asked to, and when the process that asked for them is gone.

A program is a module with a function ``begin``, which is given the words of its command line, and which it calls when
it is run with ``python -m``. Its function ``prepare``, if it has one, imports what ``begin`` would import.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from rotorid.io.children import end_session
from rotorid.io.confinement import end_with

_LENGTH_BYTES = 4
_MOST_ANSWER = 64


class Running(Protocol):
    """A process that was started."""

    @property
    def pid(self) -> int:
        """Its number, which is that of its session."""
        ...

    def wait(self, timeout_s: float | None = None) -> int:
        """Exit code, negative for a signal, as soon as it has ended.

        Raises
        ------
        TimeoutError
            It has not ended after ``timeout_s``.
        """
        ...

    def end(self) -> None:
        """Kill it with everything that it started; one that has ended stays as it is."""
        ...


class Program:
    """A module that is started as a process as often as asked.

    Parameters
    ----------
    module
        Its name.
    environment
        Variables that differ from those of this process, from its imports on.
    copied
        Whether starts are copies of one process, where the system can make them.
    """

    def __init__(self, module: str, *, environment: Mapping[str, str] | None = None, copied: bool = True) -> None:
        self._module = module
        self._environment = dict(environment or {})
        self._copied = copied and can_copy()
        self._original: _Original | None = None
        self._lock = threading.Lock()

    def start(
        self,
        words: Sequence[str],
        *,
        stdout: int,
        stderr: int,
        stdin: int | None = None,
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> Running:
        """Start it.

        Parameters
        ----------
        words
            Its command line, behind the name.
        stdout, stderr, stdin
            Open files; without the last it reads nothing. They stay open here.
        folder
            Where it works; by default where this process does.
        environment
            Its variables; by default those of this process, and those of the program.

        Raises
        ------
        OSError
            The system starts no process.
        """
        variables = {"PYTHONPATH": _module_places(), **(environment or os.environ), **self._environment}
        job = {"words": list(words), "folder": str(folder or Path.cwd()), "environment": variables}
        with open(os.devnull, "rb") as nothing:  # noqa: PTH123
            streams = (nothing.fileno() if stdin is None else stdin, stdout, stderr)
            return (self._copy(job, streams) if self._copied else None) or _NewProcess(self._module, job, streams)

    def _copy(self, job: Mapping[str, Any], streams: Sequence[int]) -> Running | None:
        """A copy; none where the process that is copied could not be prepared, or was killed."""
        control, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
        with contextlib.suppress(OSError), theirs, self._lock:
            if self._original is None or self._original.ended:
                self._original = _Original(self._module, self._environment)
            self._original.ask(job, [theirs.fileno(), *streams])
        # The first start waits here for the imports.
        if number := _heard(control):
            return _Copy(int(number), control)
        control.close()
        return None

    def close(self) -> None:
        """End the process that is copied, and all copies."""
        with self._lock:
            original, self._original = self._original, None
        if original is not None:
            original.close()


@cache
def can_copy() -> bool:
    """Whether this system makes copies of processes that can be relied on; on macOS its own libraries forbid them."""
    if sys.platform != "linux":
        return False
    try:
        os.close(os.pidfd_open(os.getpid()))
    except (OSError, AttributeError):
        return False
    return True


def _module_places() -> str:
    """Where this process imports from, which is never the current folder: that may hold anything."""
    return os.pathsep.join(os.path.abspath(entry) for entry in sys.path if entry)  # noqa: PTH100


class _NewProcess:
    """A start that imports anew."""

    def __init__(self, module: str, job: Mapping[str, Any], streams: Sequence[int]) -> None:
        stdin, stdout, stderr = streams
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", module, *job["words"]],
            stdin=stdin,
            stdout=stdout,
            stderr=stderr,
            cwd=job["folder"],
            env=job["environment"],
            start_new_session=True,
        )

    @property
    def pid(self) -> int:
        return self._process.pid

    def wait(self, timeout_s: float | None = None) -> int:
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise TimeoutError from None

    def end(self) -> None:
        end_session(self._process)


class _Copy:
    """A start that is a copy; the process that was copied says how it ended."""

    def __init__(self, number: int, control: socket.socket) -> None:
        self._number, self._control = number, control
        self._code: int | None = None
        self._lock = threading.Lock()

    @property
    def pid(self) -> int:
        return self._number

    def wait(self, timeout_s: float | None = None) -> int:
        with self._lock:
            if self._code is None:
                self._control.settimeout(timeout_s)
                # Without a word the other side was killed, and its copies end with it.
                try:
                    self._code = int(_heard(self._control) or -int(signal.SIGKILL))
                except BlockingIOError:
                    raise TimeoutError from None
                self._control.close()
            return self._code

    def end(self) -> None:
        with contextlib.suppress(OSError):
            self._control.shutdown(socket.SHUT_WR)


class _Original:
    """The process that is copied, seen from the one that asks; it ends when nobody can ask any more."""

    def __init__(self, module: str, environment: Mapping[str, str]) -> None:
        self._asks, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "rotorid.io.copies", module, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": _module_places(), **environment},
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self.close = weakref.finalize(self, _end, self._process, self._asks)

    @property
    def ended(self) -> bool:
        """Whether it is gone."""
        return self._process.poll() is not None

    def ask(self, job: Mapping[str, Any], files: Sequence[int]) -> None:
        """Ask for a copy: into the first of the files go its number and then its exit code, the others are its own."""
        message = json.dumps(job).encode()
        socket.send_fds(self._asks, [len(message).to_bytes(_LENGTH_BYTES, "big")], files)
        self._asks.sendall(message)


def _end(process: subprocess.Popen[bytes], asks: socket.socket) -> None:
    # Its copies end with it.
    end_session(process)
    process.wait()
    asks.close()


def _heard(control: socket.socket) -> bytes:
    """The next word about a copy; empty when none comes any more."""
    try:
        return control.recv(_MOST_ANSWER)
    except ConnectionResetError:
        return b""


# In the process that is copied


@dataclass(frozen=True, eq=False)
class _Known:
    """A copy: its number, a descriptor that shows its end, and the socket of whoever asked for it."""

    pid: int
    ends: int
    control: socket.socket

    def kill(self) -> None:
        """End it, also before it has a session."""
        for end in (os.kill, os.killpg):
            with contextlib.suppress(ProcessLookupError):
                end(self.pid, signal.SIGKILL)

    def bury(self) -> None:
        """Say how it ended, after everything else in its session has; until then its number is not used again."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        _, status = os.waitpid(self.pid, 0)
        with contextlib.suppress(OSError):
            self.control.send(str(os.waitstatus_to_exitcode(status)).encode())


def main(module: str, asked: int) -> None:
    """Import a program, make copies of this process until nobody asks any more, and in a copy begin the program."""
    program = import_module(module)
    if hasattr(program, "prepare"):
        program.prepare()
    # What is here stays: a search for garbage in a copy would only copy it.
    gc.collect()
    gc.freeze()
    words = _wait_to_begin(socket.socket(fileno=asked))
    if words is not None:
        sys.argv = [module, *words]
        program.begin(words)


def _wait_to_begin(asks: socket.socket) -> list[str] | None:
    """Make copies; words of its command line in a copy, nothing here at the end."""
    known: dict[int, _Known] = {}
    with selectors.DefaultSelector() as selector:
        selector.register(asks, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                copy: _Known | None = key.data
                if copy is None:
                    asked = _asked(asks)
                    if asked is None:
                        for other in known.values():
                            other.kill()
                        return None
                    job, control, streams = asked
                    number = _fork()
                    if number == 0:
                        selector.close()
                        for file in (asks, control, *(other.control for other in known.values())):
                            file.close()
                        _become(job, streams)
                        words: list[str] = job["words"]
                        return words
                    for stream in streams:
                        os.close(stream)
                    if number is None:
                        control.close()
                        continue
                    known[number] = made = _Known(number, os.pidfd_open(number), control)
                    selector.register(made.ends, selectors.EVENT_READ, made)
                    selector.register(control, selectors.EVENT_READ, made)
                    with contextlib.suppress(OSError):
                        control.send(str(number).encode())
                elif copy.pid in known and key.fd == copy.ends:
                    del known[copy.pid]
                    selector.unregister(copy.ends)
                    with contextlib.suppress(KeyError):
                        selector.unregister(copy.control)
                    copy.bury()
                    os.close(copy.ends)
                    copy.control.close()
                elif copy.pid in known:
                    selector.unregister(copy.control)
                    copy.kill()


def _asked(asks: socket.socket) -> tuple[dict[str, Any], socket.socket, list[int]] | None:
    """What the next copy shall be, the socket for what becomes of it, and its streams; nothing at the end."""
    length, files, *_ = socket.recv_fds(asks, _LENGTH_BYTES, _LENGTH_BYTES)
    left, parts = int.from_bytes(length, "big"), [b""]
    while left > 0 and (part := asks.recv(left)):
        parts.append(part)
        left -= len(part)
    if not length or left:
        return None
    control, *streams = files
    return json.loads(b"".join(parts)) | {"parent": os.getpid()}, socket.socket(fileno=control), streams


def _fork() -> int | None:
    """Number of a copy of this process, 0 in it; nothing where the system makes none now."""
    try:
        return os.fork()
    except OSError:
        return None


def _become(job: Mapping[str, Any], streams: Sequence[int]) -> None:
    """Make this copy what a new process would be: its own session, streams, folder and variables, and nothing else."""
    os.setsid()
    end_with(job["parent"])
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    for file in os.listdir("/proc/self/fd"):  # noqa: PTH208
        if int(file) >= len(streams):
            with contextlib.suppress(OSError):
                os.close(int(file))
    os.environ.clear()
    os.environ.update(job["environment"])
    os.chdir(job["folder"])
    tempfile.tempdir = None


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
