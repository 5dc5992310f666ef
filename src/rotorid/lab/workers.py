"""Commands in processes of their own: limited in number, memory and time, with progress, ended at any moment.

A worker is the command line itself (:mod:`rotorid.cli.lab_worker`), so that its numbers are those of the terminal. It
is a copy of a process that has its imports behind it, where the system can make copies; not where it is kept to some
places, as that process is not, and must not load compiled code that such a worker left. It speaks in lines of JSON on
standard error; its document is on standard output. What it does to itself, a crash included, reaches the page as a
sentence and nothing else.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final, Literal, TypeAlias

from rotorid.compiling import kept_apart
from rotorid.errors import UsageError
from rotorid.io.copies import Program, Running

State: TypeAlias = Literal["waiting", "running", "done", "refused", "failed", "canceled"]

MOST_RUNNING, MOST_WAITING = 2, 20
"""Commands that run at once, and that wait."""

MEMORY_BYTES = 4 << 30
"""Memory that a command may have."""

WALL_S = 3600.0
"""Time after which a command is ended."""

EXIT_WITH_REASON: Final = 3
"""Exit code of a worker that failed and gave the reason in its last line."""

_MOST_OUTPUT = 64 << 20
"""Largest standard output of a command."""

_MOST_LINE = 1 << 16
_PROGRAM = "rotorid.cli.lab_worker"
_TEMPORARY = ("TMPDIR", "TEMP", "TMP", "MPLCONFIGDIR")
_END_S = 10.0


@dataclass(eq=False)
class Job:
    """A command that runs, or ran."""

    words: list[str]
    folder: Path
    state: State = "waiting"
    doing: str = ""
    share: float | None = None
    sentence: str = ""
    process: Running | None = None
    code: int | None = None
    ended: threading.Event = field(default_factory=threading.Event)
    started_s: float = 0.0
    ended_s: float | None = None
    costs: list[float] = field(default_factory=list)

    @property
    def output(self) -> Path:
        """The file of its standard output."""
        return self.folder / "output.json"

    @property
    def seconds(self) -> float:
        """How long it has run, or ran."""
        until = time.monotonic() if self.ended_s is None else self.ended_s
        return round(until - self.started_s, 1) if self.started_s else 0.0

    def end(self, state: State, sentence: str = "") -> None:
        """Set how it ended; the first reason counts."""
        if not self.ended.is_set():
            if self.state != "canceled":
                self.state, self.sentence = state, sentence
            self.share, self.ended_s = None, time.monotonic()
            self.ended.set()


@dataclass(frozen=True, kw_only=True)
class Places:
    """All that commands may read and change, beside what Python is made of and the folder that they work in."""

    readable: tuple[Path, ...]
    writable: tuple[Path, ...]


class Workers:
    """All jobs of a session.

    Parameters
    ----------
    memory_bytes, most_running
        Memory of a command, and how many run at once.
    places
        What commands may read and change, where the system can keep them to it; everything without it.
    """

    def __init__(
        self, *, memory_bytes: int = MEMORY_BYTES, most_running: int = MOST_RUNNING, places: Places | None = None
    ) -> None:
        self._memory_bytes = memory_bytes
        self._places = places
        self._program = Program(_PROGRAM, copied=places is None)
        self._free = most_running
        self._jobs: list[Job] = []
        self._changed = threading.Condition()
        self._closed = False

    def start(self, words: Sequence[str], folder: Path) -> Job:
        """Run a command in a folder as soon as a place is free.

        Raises
        ------
        UsageError
            Too many wait already.
        """
        job = Job(list(words), folder)
        with self._changed:
            self._jobs = [job for job in self._jobs if not job.ended.is_set()]
            if self._closed or len(self._jobs) >= MOST_WAITING:
                raise UsageError(
                    f"{MOST_WAITING} commands are running or waiting", remedy="wait until one ends, or cancel one"
                )
            self._jobs.append(job)
        threading.Thread(target=self._run, args=(job,), daemon=True).start()
        return job

    def cancel(self, job: Job) -> None:
        """End a command with everything that it started; one that waits has ended with that."""
        with self._changed:
            if job.ended.is_set():
                return
            job.state, job.sentence = "canceled", "It was canceled."
            if job.process is not None:
                job.process.end()
            elif job.started_s == 0.0:
                job.end("canceled")
            self._changed.notify_all()

    def close(self) -> None:
        """End all commands, wait until they have, and take none any more."""
        with self._changed:
            self._closed = True
            jobs = list(self._jobs)
        for job in jobs:
            self.cancel(job)
        last = time.monotonic() + _END_S
        for job in jobs:
            job.ended.wait(max(last - time.monotonic(), 0.0))
        self._program.close()

    def _run(self, job: Job) -> None:
        """Wait for a place, then carry out a command that nobody canceled meanwhile."""
        with self._changed:
            self._changed.wait_for(lambda: self._free > 0 or job.ended.is_set())
            if job.ended.is_set():
                return
            self._free -= 1
            job.state, job.started_s = "running", time.monotonic()
        try:
            self._carry_out(job)
        except (OSError, ValueError) as error:
            job.end("failed", f"The worker could not run: {getattr(error, 'strerror', None) or error}.")
        finally:
            with self._changed:
                self._free += 1
                job.end("failed", "The worker could not run.")
                self._changed.notify_all()

    def _carry_out(self, job: Job) -> None:
        with self._changed:
            if job.state == "canceled":
                return
            # The private folder may be gone, and does not come back for a command.
            job.folder.mkdir(mode=0o700, exist_ok=True)
        said, says = os.pipe()
        with open(said, "rb") as stream:  # noqa: PTH123
            try:
                process = self._started(job, says)
            finally:
                os.close(says)
            self._follow(job, process, stream)

    def _started(self, job: Job, stderr: int) -> Running:
        limits = {"memory_bytes": self._memory_bytes, **self._allowed(job.folder)}
        with job.output.open("wb") as output:
            return self._program.start(
                [json.dumps(limits), *job.words],
                stdout=output.fileno(),
                stderr=stderr,
                folder=job.folder,
                environment=None if self._places is None else _environment(job.folder),
            )

    def _follow(self, job: Job, process: Running, stream: IO[bytes]) -> None:
        """Hand on what a command says until it ends, or has to."""
        with self._changed:
            job.process = process
            if job.state == "canceled":
                process.end()
        late = threading.Event()

        def end_late() -> None:
            late.set()
            process.end()

        clock = threading.Timer(WALL_S, end_late)
        clock.daemon = True
        clock.start()
        try:
            last = _listen(job, stream)
            job.code = process.wait()
        finally:
            clock.cancel()
            process.end()
        if late.is_set():
            job.end("failed", f"It was ended after {WALL_S / 60.0:g} minutes, the most that a command has.")
        elif job.output.stat().st_size > _MOST_OUTPUT:
            job.end("failed", "The answer is too large.")
        else:
            job.end(*_how(job.code, last.removeprefix("rotorid: ")))

    def _allowed(self, folder: Path) -> dict[str, list[str]]:
        if self._places is None:
            return {}
        writable = [str(place) for place in (*self._places.writable, folder, _compiled(folder))]
        return {"readable": [str(place) for place in self._places.readable], "writable": writable}


def _environment(folder: Path) -> dict[str, str]:
    """What a command that is kept to some places finds its own with."""
    return {**os.environ, **dict.fromkeys(_TEMPORARY, str(folder)), "NUMBA_CACHE_DIR": str(_compiled(folder))}


def _compiled(folder: Path) -> Path:
    """The folder of compiled code of such commands, made where that can be."""
    place = kept_apart(folder)
    with contextlib.suppress(OSError):
        place.mkdir(parents=True, exist_ok=True)
    return place


def _how(code: int, last: str) -> tuple[State, str]:
    """How a worker ended, by its code and the last line that it wrote."""
    if code == 0:
        return "done", ""
    if code in (1, 2):
        return "refused", last or "It was refused."
    if code == EXIT_WITH_REASON and last:
        return "failed", last
    why = f"signal {-code}" if code < 0 else f"code {code}"
    return "failed", f"The worker ended with {why}; nothing else is lost, and it may be started again."


def _listen(job: Job, stream: IO[bytes]) -> str:
    """Read the progress of a worker; returns the last line that is no progress."""
    last = ""
    while line := stream.readline(_MOST_LINE):
        text = line.decode("utf-8", "replace").strip()
        if text.startswith('{"progress"'):
            with contextlib.suppress(ValueError, TypeError, KeyError, ZeroDivisionError):
                progress = json.loads(text)["progress"]
                if "cost" in progress:
                    job.costs = [*job.costs[-999:], float(progress["cost"])]
                    continue
                job.doing = str(progress["words"])[:300]
                job.share = float(progress["done"]) / float(progress["total"]) if progress.get("total") else None
        elif text:
            last = text[:2000]
    return last
