"""What a session holds: logs that were opened, steps that were chosen, the private folder that goes away."""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import shutil
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.lab.steps import MOST_STEPS, Project, Step, arguments, project_text
from rotorid.lab.tracks import Tracks
from rotorid.lab.workers import Job, Workers

MOST_LOGS = 20
_DRAWN = ("omega_rad_s", "values", "coherence", "random_error", "inputs", "outputs", "model", "fitted")
UPLOAD_BYTES = 2 << 30
ALL_UPLOAD_BYTES = 8 << 30
_ENDINGS = re.compile(
    r"\.(ulg|bin|log|bbl|bfl|tlog|csv|mat|npz|parquet|bag|mcap|db3|px4log|txt|usd)(\.(gz|xz|bz2|zip))?$"
)


@dataclass(eq=False)
class OpenLog:
    """A log of the session: its file, what is shown of it, and the job that reads it."""

    name: str
    path: Path
    words: str
    folder: Path
    job: Job | None = None
    closed: bool = False
    _tracks: Tracks | None = None

    @property
    def tracks(self) -> Tracks | None:
        """Its channels, from the moment that they are read."""
        if self._tracks is None and not self.closed:
            with contextlib.suppress(OSError, ValueError, KeyError):
                self._tracks = Tracks(self.folder)
        return self._tracks


@dataclass(eq=False)
class Ran:
    """A step with its job and the folder of its results."""

    step: Step
    job: Job
    folder: Path
    shown: list[str] = field(default_factory=list)


class Session:
    """Logs, steps and workers behind one page.

    Parameters
    ----------
    root
        Folder from which logs may be chosen, if any; nothing outside it can be named.
    """

    def __init__(self, root: Path | None = None, *, workers: Workers | None = None) -> None:
        self.root = None if root is None else root.resolve()
        self.place = Path(tempfile.mkdtemp(prefix="rotorid-lab-"))
        self.workers = workers or Workers()
        self.logs: list[OpenLog] = []
        self.steps: list[Ran] = []
        self.waiting: tuple[Step, ...] = ()
        self._models: Job | None = None
        self._lock = threading.Lock()

    def close(self) -> None:
        """End all workers and remove the private folder."""
        self.workers.close()
        shutil.rmtree(self.place, ignore_errors=True)

    def choices(self) -> list[str]:
        """Logs below the folder given at start, by their paths in it; links that lead out of it are not among them."""
        if self.root is None:
            return []
        found = []
        for folder, folders, files in os.walk(self.root):
            folders[:] = sorted(one for one in folders if not one.startswith("."))
            for name in sorted(files):
                path = Path(folder) / name
                if not name.startswith(".") and _ENDINGS.search(name.lower()) and self._inside(path):
                    found.append(path.relative_to(self.root).as_posix())
                if len(found) >= 1000:
                    return found
        return found

    def _inside(self, path: Path) -> bool:
        with contextlib.suppress(OSError, ValueError, RuntimeError):
            return self.root is not None and path.resolve(strict=True).is_relative_to(self.root) and path.is_file()
        return False

    def choose(self, name: str) -> OpenLog:
        """Open a log of the folder given at start.

        Raises
        ------
        UsageError
            There is no such log inside it.
        """
        if self.root is None or name not in self.choices():
            raise UsageError("a path that is no log of this folder came", needed="one of those that are listed")
        return self.open(self.root / name, name)

    def open(self, path: Path, words: str) -> OpenLog:
        """Read a file in a worker; ``words`` is how a command line would name it.

        Raises
        ------
        UsageError
            Too many logs are open.
        """
        with self._lock:
            if sum(not one.closed for one in self.logs) >= MOST_LOGS:
                raise UsageError(f"{MOST_LOGS} logs are open", needed="one of them to be closed")
            log = OpenLog(path.name, path, words, self.place / f"log-{len(self.logs) + 1}")
            log.folder.mkdir()
            self.logs.append(log)

        try:
            log.job = self.workers.start(["read", str(path.resolve()), str(log.folder)], log.folder)
        except UsageError:
            # Logs keep their numbers: what could not be opened is one that is closed.
            log.closed = True
            raise
        return log

    def close_log(self, log: OpenLog) -> None:
        """Forget a log: what was read of it and, where it was uploaded, the file go away; results stay.

        Raises
        ------
        UsageError
            A command that may read it has not ended.
        """
        if any(not one.job.ended.is_set() for one in self.steps):
            raise UsageError("a command runs", needed="it to end before a log is closed")
        if log.job is not None:
            self.workers.cancel(log.job)
            log.job.ended.wait(5.0)
        log.closed, log._tracks = True, None
        shutil.rmtree(log.folder, ignore_errors=True)
        if log.path.is_relative_to(self.place):
            shutil.rmtree(log.path.parent, ignore_errors=True)

    def uploaded_bytes(self) -> int:
        """Of all uploads that are kept."""
        return sum(one.stat().st_size for one in self.place.glob("upload-*/*"))

    def upload_path(self, name: str) -> Path:
        """Where an upload of this name goes: the last part of the name alone, in a folder of its own."""
        last = re.sub(r"[^\w.+-]", "_", re.split(r"[/\\]", name)[-1], flags=re.ASCII).lstrip(".")[-120:] or "log"
        folder = self.place / f"upload-{secrets.token_hex(8)}"
        folder.mkdir(mode=0o700)
        return folder / last

    def demo(self) -> Job:
        """Fly the demonstration, and open its log."""
        folder = self.place / f"demo-{secrets.token_hex(4)}"

        def then(job: Job) -> None:
            flight = folder / "out" / "flight.ulg"
            if job.state == "done" and flight.is_file():
                self.open(flight, "flight.ulg")

        return self.workers.start(["demo", "--keep-log", "--out", "out", "--quiet"], folder, then=then)

    def models(self) -> Any:
        """What ``rotorid models`` lists."""
        with self._lock:
            if self._models is None:
                self._models = self.workers.start(["models", "--json"], self.place / "models")
        self._models.ended.wait(30.0)
        with contextlib.suppress(OSError, ValueError):
            return json.loads(self._models.output.read_bytes())
        return {"models": []}

    def run(self, step: Step) -> Ran:
        """Start a step.

        Raises
        ------
        UsageError
            It names what does not exist, or too many were started.
        """
        with self._lock:
            if len(self.steps) >= MOST_STEPS:
                raise UsageError(f"{MOST_STEPS} steps were made", needed="a new session")
            number = len(self.steps) + 1
            folder = self.place / f"step-{number}"
            files = ["" if one.closed else str(one.path.resolve()) for one in self.logs]
            real = arguments(step, files, self._results(shown=False))
            shown = arguments(step, [one.words for one in self.logs], self._results(shown=True))
            out = "out"
            job = self.workers.start([*real, "--out", out, "--json", "--quiet"], folder)
            ran = Ran(step, job, folder / out, ["rotorid", *shown, "--out", f"step-{number}"])
            self.steps.append(ran)
        return ran

    def preview(self, step: Step) -> list[str]:
        """The command line of a step that is not started."""
        shown = arguments(step, [one.words for one in self.logs], self._results(shown=True))
        return ["rotorid", *shown, "--out", f"step-{len(self.steps) + 1}"]

    def _results(self, *, shown: bool) -> list[str]:
        """Folders of steps that stand; empty where one does not."""
        return [
            (f"step-{number}" if shown else str(ran.folder)) if ran.job.state == "done" else ""
            for number, ran in enumerate(self.steps, start=1)
        ]

    def project(self) -> str:
        """The session as a project file: all logs, and the steps that stand."""
        kept = [number for number, ran in enumerate(self.steps, start=1) if ran.job.state == "done"]
        new = {old: place for place, old in enumerate(kept, start=1)}
        steps = [
            one.model_copy(update={"results": tuple(new[number] for number in one.results)})
            for one in (self.steps[number - 1].step for number in kept)
        ]
        return project_text(
            Project(schema="rotorid.project/1", logs=tuple(one.words for one in self.logs), steps=tuple(steps))
        )

    def files(self, ran: Ran) -> list[Path]:
        """Files of a step, in the order of their names."""
        if ran.job.state != "done" or not ran.folder.is_dir():
            return []
        return sorted(one for one in ran.folder.rglob("*") if one.is_file() and not one.is_symlink())

    def report(self, ran: Ran) -> Path:
        """The page that a step wrote.

        Raises
        ------
        UsageError
            It wrote none.
        """
        found = next((one for one in self.files(ran) if one.suffix == ".html"), None)
        if found is None:
            raise UsageError("this step wrote no page", needed="a review, an identification, a tuning or the like")
        return found


def document(ran: Ran) -> Any:
    """What a step printed, as the command line prints it; nothing where it printed nothing."""
    with contextlib.suppress(OSError, ValueError):
        return json.loads(ran.job.output.read_bytes())
    return None


def curves(ran: Ran) -> dict[str, list[Any]]:
    """Arrays of a step's ``responses.npz`` as numbers; those of complex numbers as real and imaginary part."""
    path = ran.folder / "responses.npz"
    told: dict[str, list[Any]] = {}
    if not path.is_file():
        return told
    with np.load(path, allow_pickle=False) as arrays:
        for name in (one for one in _DRAWN if one in arrays.files):
            values = arrays[name]
            if values.dtype.kind == "c":
                told[f"{name}.re"], told[f"{name}.im"] = listed(values.real), listed(values.imag)
            elif values.dtype.kind in "fiub":
                told[name] = listed(values)
            elif values.dtype.kind == "U":
                told[name] = values.tolist()
    return told


def listed(values: Any) -> Any:
    """Numbers that fit into JSON: what is not finite is nothing."""
    array = np.asarray(values, dtype=float)
    plain = array.astype(object)
    plain[~np.isfinite(array)] = None
    return plain.tolist()
