"""Commands in processes of their own: limited in number, memory and time, told how far they are, ended at any moment.

A worker is the command line itself (``python -m rotorid.cli.lab_worker``), so that its numbers are those of the
terminal. It speaks in lines of JSON on standard error; its document is on standard output. What it does to itself, a
crash included, reaches the page as a sentence and nothing else.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Literal, TypeAlias

from rotorid.errors import UsageError
from rotorid.io.children import end_session

State: TypeAlias = Literal["waiting", "running", "done", "refused", "failed", "canceled"]

MOST_RUNNING, MOST_WAITING = 2, 20
MEMORY_BYTES = 4 << 30
WALL_S = 3600.0
_MOST_OUTPUT = 64 << 20
_MOST_LINE = 1 << 16


@dataclass(eq=False)
class Job:
    """A command that runs, or ran."""

    words: list[str]
    folder: Path
    state: State = "waiting"
    told: str = ""
    share: float | None = None
    sentence: str = ""
    output: Path = Path()
    process: subprocess.Popen[bytes] | None = None
    ended: threading.Event = field(default_factory=threading.Event)
    started_s: float = 0.0
    ended_s: float | None = None
    costs: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """How long it has run, or ran."""
        until = time.monotonic() if self.ended_s is None else self.ended_s
        return round(until - self.started_s, 1) if self.started_s else 0.0


class Workers:
    """All jobs of a session."""

    def __init__(self, *, memory_bytes: int = MEMORY_BYTES, most_running: int = MOST_RUNNING) -> None:
        self._memory_bytes = memory_bytes
        self._places = threading.Semaphore(most_running)
        self._jobs: list[Job] = []
        self._lock = threading.Lock()
        self._closed = False

    def start(self, words: Sequence[str], folder: Path, *, then: Callable[[Job], None] | None = None) -> Job:
        """Run a command in a folder of its own as soon as a place is free; ``then`` is called when it ended.

        Raises
        ------
        UsageError
            Too many wait already.
        """
        job = Job(list(words), folder, output=folder / "output.json")
        with self._lock:
            if self._closed or sum(not one.ended.is_set() for one in self._jobs) >= MOST_WAITING:
                raise UsageError(f"{MOST_WAITING} commands run or wait", needed="one of them to end")
            self._jobs = [one for one in self._jobs if not one.ended.is_set()] + [job]
        threading.Thread(target=self._run, args=(job, then), daemon=True).start()
        return job

    def cancel(self, job: Job) -> None:
        """End a command with everything that it started."""
        with self._lock:
            if job.ended.is_set():
                return
            job.state = "canceled"
            job.sentence = "It was canceled."
            if job.process is not None:
                end_session(job.process)

    def close(self) -> None:
        """End all commands, and take none any more."""
        with self._lock:
            self._closed = True
            jobs = list(self._jobs)
        for job in jobs:
            self.cancel(job)

    @staticmethod
    def _was_canceled(job: Job) -> bool:
        """Another thread may have said so."""
        return job.state == "canceled"

    def _run(self, job: Job, then: Callable[[Job], None] | None) -> None:
        try:
            with self._places:
                self._carry_out(job)
        except OSError as error:
            job.state, job.sentence = "failed", f"The worker could not run: {error.strerror}."
        finally:
            job.share, job.ended_s = None, time.monotonic()
            if then is not None:
                then(job)
            job.ended.set()

    def _carry_out(self, job: Job) -> None:
        job.folder.mkdir(parents=True, exist_ok=True)
        with job.output.open("wb") as output:
            with self._lock:
                if job.state == "canceled" or self._closed:
                    job.state = "canceled"
                    return
                job.state, job.started_s = "running", time.monotonic()
                job.process = subprocess.Popen(
                    [sys.executable, "-m", "rotorid.cli.lab_worker", str(self._memory_bytes), *job.words],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.PIPE,
                    cwd=job.folder,
                    start_new_session=True,
                    env={**os.environ, "ROTORID_LAB_PARENT": str(os.getpid())},
                )
            clock = threading.Timer(WALL_S, lambda: end_session(process))
            process = job.process
            clock.daemon = True
            clock.start()
            try:
                assert process.stderr is not None
                last = _listen(job, process.stderr)
                code = process.wait()
            finally:
                clock.cancel()
                if process.stderr is not None:
                    process.stderr.close()
                end_session(process)
        if self._was_canceled(job):
            return
        if code == 0:
            job.state = "done"
        elif code in (1, 2):
            job.state = "refused"
            job.sentence = last.removeprefix("rotorid: ") or "It was refused."
        else:
            job.state = "failed"
            why = f"signal {-code}" if code < 0 else f"code {code}"
            job.sentence = f"The worker ended with {why}; nothing else is lost, and it may be started again."
        if job.output.stat().st_size > _MOST_OUTPUT:
            job.state, job.sentence = "failed", "The answer is too large for the page."


def _listen(job: Job, stream: IO[bytes]) -> str:
    """Take down what a worker tells of its progress; the last line that is no progress."""
    last = ""
    while line := stream.readline(_MOST_LINE):
        text = line.decode("utf-8", "replace").strip()
        if text.startswith('{"progress"'):
            with contextlib.suppress(ValueError, TypeError, KeyError, ZeroDivisionError):
                told = json.loads(text)["progress"]
                if "cost" in told:
                    job.costs = [*job.costs[-999:], float(told["cost"])]
                    continue
                job.told = str(told["words"])[:300]
                job.share = float(told["done"]) / float(told["total"]) if told.get("total") else None
        elif text:
            last = text[:2000]
    return last
