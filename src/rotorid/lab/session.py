"""A session: opened logs, steps, and a private folder that is removed at the end."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import secrets
import shutil
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.io.formats import ENDINGS, PACKED
from rotorid.lab.steps import MOST_STEPS, Project, Step, arguments, project_text
from rotorid.lab.tracks import Tracks, listed
from rotorid.lab.workers import Job, Workers

MOST_LOGS = 20
"""Logs that may be open at a time."""

ALL_UPLOAD_BYTES = 8 << 30
"""Largest size of all uploads that are kept."""

MOST_CHOICES, MOST_ENTRIES, MOST_DEPTH = 1000, 20_000, 6
_DRAWN = ("omega_rad_s", "values", "coherence", "random_error", "inputs", "outputs", "model", "fitted", "used")
_ENDINGS = re.compile(rf"({'|'.join(map(re.escape, sorted(ENDINGS)))})({'|'.join(map(re.escape, PACKED))})?$")
_NAME_BYTES = 200


@dataclass(eq=False)
class OpenLog:
    """A log of the session: its file, its tracks, and the job that reads it.

    ``name`` is what the page and a project file call it, ``words`` how a command line names it; ``note`` says where the
    name is not that of the file.
    """

    number: int
    name: str
    words: str
    path: Path
    folder: Path
    job: Job
    note: str = ""
    closed: bool = False
    _tracks: Tracks | None = None

    @property
    def tracks(self) -> Tracks | None:
        """Its channels, from the moment that they are read."""
        if self._tracks is None and not self.closed:
            with contextlib.suppress(OSError, ValueError, KeyError):
                self._tracks = Tracks(self.folder)
        return self._tracks

    @property
    def size_bytes(self) -> int | None:
        """Of its file, as long as there is one."""
        with contextlib.suppress(OSError):
            return self.path.stat().st_size
        return None


@dataclass(eq=False)
class Ran:
    """A step with its job, the folder of its results, and the command line that does the same."""

    number: int
    step: Step
    job: Job
    folder: Path
    shown: Sequence[str] = ()

    @property
    def may_stand(self) -> bool:
        """Whether it has a result, or still can have one."""
        return self.job.state in ("done", "running", "waiting")


class Session:
    """Logs, steps and workers behind one page.

    Parameters
    ----------
    root
        Folder from which logs may be chosen, if any; nothing outside it can be named.
    """

    def __init__(self, root: Path | None = None, *, workers: Workers | None = None) -> None:
        self._given_root = root
        self.root = None if root is None else root.resolve()
        self.place = Path(tempfile.mkdtemp(prefix="rotorid-lab-"))
        self.workers = workers or Workers()
        self.logs: list[OpenLog] = []
        self.steps: list[Ran] = []
        self.waiting: tuple[Step, ...] = ()
        self.followed = threading.Event()
        self.followed.set()
        self._places: list[int] = []
        self._uploads: dict[Path, int] = {}
        self._models: Job | None = None
        self._closed = False
        self._lock = threading.RLock()

    def close(self) -> None:
        """End all workers and remove the private folder."""
        self._closed = True
        self.workers.close()
        shutil.rmtree(self.place, ignore_errors=True)

    # Logs

    def choices(self) -> list[str]:
        """Logs below the folder given at start, by their paths in it; links that lead out of it are not among them.

        So many as a page can show, of a folder that is looked through in a moment; any other is dropped on the page.
        Names that are no text are left out.
        """
        found: list[str] = []
        left = MOST_ENTRIES
        folders = [] if self.root is None else [self.root]
        for _ in range(MOST_DEPTH):
            below: list[Path] = []
            for folder in folders:
                for entry in _entries(folder, left):
                    left -= 1
                    if entry.is_dir(follow_symlinks=False):
                        below.append(Path(entry.path))
                    elif self.root is not None:
                        name = Path(entry.path).relative_to(self.root).as_posix()
                        found += [name] if self._named(name) is not None else []
            folders = below
        return sorted(found)[:MOST_CHOICES]

    def _named(self, name: str) -> Path | None:
        """The file of a log of the folder given at start, with no link in its path; nothing where it is none."""
        path = Path(name)
        plain = path.as_posix() == name and not path.anchor and not any(part.startswith(".") for part in path.parts)
        if self.root is None or not plain or not _ENDINGS.search(name.lower()) or _text(name) != name:
            return None
        with contextlib.suppress(OSError, ValueError, RuntimeError):
            return self._inside(self.root / path)
        return None

    def _inside(self, path: Path) -> Path | None:
        real = path.resolve(strict=True)
        return real if self.root is not None and real.is_relative_to(self.root) and real.is_file() else None

    def choose(self, name: str) -> OpenLog:
        """Open a log of the folder given at start.

        Raises
        ------
        UsageError
            There is no such log inside it.
        """
        path = self._named(name)
        if path is None or self._given_root is None:
            raise UsageError("this is not a log of the folder", needed="one of those listed")
        return self.open(path, name, words=str(self._given_root / name))

    def open(self, path: Path, name: str, *, words: str | None = None) -> OpenLog:
        """Read a file in a worker; ``words`` is how a command line names it, if not by its name.

        Raises
        ------
        UsageError
            Too many logs are open.
        """
        return self._open("read", path, name, words)

    def demo(self) -> OpenLog:
        """Fly the demonstration and open its log, or the one that flies already."""
        with self._lock:
            flies = (log for log in self.logs if log.job.words[0] == "fly" and not log.job.ended.is_set())
            return next(flies, None) or self._open("fly", None, "flight.ulg", None)

    def _open(self, verb: str, path: Path | None, name: str, words: str | None) -> OpenLog:
        with self._lock:
            if sum(not log.closed for log in self.logs) >= MOST_LOGS:
                raise UsageError(f"{MOST_LOGS} logs are open already", remedy="close one first")
            number = len(self.logs) + 1
            folder = self.place / f"log-{number}"
            folder.mkdir(exist_ok=True)
            path = path or folder / name
            given, name = _text(name), self._free(_text(name), path)
            note = f"Another log is called {given}: this one is {name} here and in the project file."
            words = name if words is None else _text(words)
            job = self.workers.start([verb, str(path.absolute()), str(folder)], folder)
            log = OpenLog(number, name, words, path, folder, job, "" if name == given else note)
            self.logs.append(log)
        return log

    def _free(self, name: str, path: Path) -> str:
        """The name, with a number where another file of the session has it."""
        used = {number for ran in self.steps for number in (*ran.step.logs, *ran.step.verify)}
        taken = {log.name for log in self.logs if log.path != path and (not log.closed or log.number in used)}
        found = _ENDINGS.search(name.lower())
        cut = found.start() if found else len(name)
        numbered = (f"{name[:cut]}-{k}{name[cut:]}" for k in itertools.count(2))
        return next(candidate for candidate in itertools.chain([name], numbered) if candidate not in taken)

    def close_log(self, log: OpenLog) -> None:
        """Forget a log: what was read of it and, where it was uploaded, the file go away; results stay.

        Raises
        ------
        UsageError
            A command that may read it has not ended.
        """
        with self._lock:
            if any(not step.job.ended.is_set() for step in self.steps):
                raise UsageError("a command is running", remedy="wait or cancel it before you close a log")
            log.closed, log._tracks = True, None
        self.workers.cancel(log.job)
        log.job.ended.wait(5.0)
        shutil.rmtree(log.folder, ignore_errors=True)
        if log.path in self._uploads:
            self.drop_upload(log.path)

    # Uploads

    def upload_path(self, name: str) -> tuple[Path, str]:
        """Where an upload goes, in a folder of its own, and what it is called: the last part of the name that came."""
        called = re.sub(r"[\x00-\x1f\x7f\ud800-\udfff]", "", re.split(r"[/\\]", name)[-1]).strip(". ")
        called = called.encode()[-_NAME_BYTES:].decode(errors="ignore") or "log"
        path = self.place / f"upload-{secrets.token_hex(8)}" / re.sub(r'[<>:"|?*]', "_", called)
        path.parent.mkdir(mode=0o700)
        with self._lock:
            self._uploads[path] = 0
        return path, called

    def take_in(self, path: Path, count: int, *, announced: int = 0) -> None:
        """Count what comes of an upload; what is ``announced`` must have room too.

        Raises
        ------
        UsageError
            It would be more than a session keeps.
        """
        with self._lock:
            if sum(self._uploads.values()) + count + announced > ALL_UPLOAD_BYTES:
                raise UsageError(
                    f"uploads of a session are limited to {ALL_UPLOAD_BYTES >> 30} GiB", remedy="close a log first"
                )
            self._uploads[path] += count

    def drop_upload(self, path: Path) -> None:
        """Remove an upload with its folder."""
        shutil.rmtree(path.parent, ignore_errors=True)
        with self._lock:
            self._uploads.pop(path, None)

    def uploaded_bytes(self) -> int:
        """Of all uploads that are kept."""
        with self._lock:
            return sum(self._uploads.values())

    # Steps

    def models(self) -> Any:
        """What ``rotorid models`` lists; asked for again where that failed."""
        with self._lock:
            if self._models is None or (self._models.ended.is_set() and self._models.state != "done"):
                self._models = self.workers.start(["models", "--json"], self.place / "models")
            job = self._models
        job.ended.wait(30.0)
        if job.state == "done":
            with contextlib.suppress(OSError, ValueError):
                return json.loads(job.output.read_bytes())
        return {"models": []}

    def run(self, step: Step) -> Ran:
        """Start a step.

        Raises
        ------
        UsageError
            It names what does not exist, or too many were started.
        """
        with self._lock:
            self._require_room()
            number = len(self.steps) + 1
            files = ["" if log.closed else str(log.path.absolute()) for log in self.logs]
            real = arguments(step, files, [str(ran.folder) if ran.job.state == "done" else "" for ran in self.steps])
            folder = self.place / f"step-{number}"
            job = self.workers.start([*real, "--out", "out", "--json", "--quiet"], folder)
            ran = Ran(number, step, job, folder / "out", self.preview(step))
            self.steps.append(ran)
        return ran

    def _require_room(self) -> None:
        if len(self.steps) >= MOST_STEPS:
            raise UsageError(f"a session has at most {MOST_STEPS} steps", remedy="start a new session")

    def preview(self, step: Step) -> list[str]:
        """The command line of a step that is not started."""
        logs = ["" if log.closed else log.words for log in self.logs]
        results = [f"step-{ran.number}" if ran.job.state == "done" else "" for ran in self.steps]
        return ["rotorid", *arguments(step, logs, results), "--out", f"step-{len(self.steps) + 1}"]

    def follow(self) -> None:
        """Run the steps of the project that was opened, one after the other, whoever looks on."""
        with self._lock:
            if not self.waiting or not self.followed.is_set():
                return
            self.followed.clear()
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        try:
            while self.waiting and not self._closed and len(self.steps) < MOST_STEPS:
                with self._lock:
                    step = self._planned()[0]
                    try:
                        ran = self.run(step)
                    except UsageError as error:
                        number = len(self.steps) + 1
                        job = Job([], self.place / f"step-{number}")
                        job.end("refused", str(error))
                        ran = Ran(number, step, job, job.folder / "out", ["rotorid", step.verb])
                        self.steps.append(ran)
                    self._places.append(ran.number)
                    self.waiting = self.waiting[1:]
                ran.job.ended.wait()
        finally:
            self.followed.set()

    def _planned(self) -> list[Step]:
        """Steps of the project that were not begun, with the numbers that earlier ones have, or will have, here."""
        to_come = range(len(self.steps) + 1, len(self.steps) + len(self.waiting) + 1)
        places = dict(enumerate((*self._places, *to_come), start=1))
        return [
            step.model_copy(update={"results": tuple(places.get(number, 0) for number in step.results)})
            for step in self.waiting
        ]

    def project(self) -> str:
        """The session as a project file: successful and planned steps, their logs and the open ones."""
        with self._lock:
            planned = enumerate(self._planned(), start=len(self.steps) + 1)
            rows = [*((ran.number, ran.step) for ran in self.steps if ran.may_stand), *planned]
            new: dict[int, int] = {}
            kept: list[Step] = []
            for number, step in rows:
                if all(result in new for result in step.results):
                    new[number] = len(new) + 1
                    kept.append(step)
            used = {number for step in kept for number in (*step.logs, *step.verify)}
            logs = [log for log in self.logs if log.number in used or (log.job.state == "done" and not log.closed)]
        place = {log.number: k for k, log in enumerate(logs, start=1)}
        steps = [
            step.model_copy(
                update={
                    "results": tuple(new[number] for number in step.results),
                    "logs": tuple(place[number] for number in step.logs),
                    "verify": tuple(place[number] for number in step.verify),
                }
            )
            for step in kept
        ]
        return project_text(
            Project(schema="rotorid.project/1", logs=tuple(log.name for log in logs), steps=tuple(steps))
        )

    def files(self, ran: Ran) -> list[Path]:
        """Files of a step, in the order of their names."""
        if ran.job.state != "done" or not ran.folder.is_dir():
            return []
        return sorted(path for path in ran.folder.rglob("*") if path.is_file() and not path.is_symlink())

    def report(self, ran: Ran) -> Path:
        """The page that a step wrote; where it wrote several, the one about all.

        Raises
        ------
        UsageError
            It wrote none.
        """
        pages = [path for path in self.files(ran) if path.suffix == ".html"]
        if not pages:
            raise UsageError("this step wrote no report")
        return min(pages, key=lambda path: (len(path.parts), path.name != "report.html", path))


def _entries(folder: Path, most: int) -> list[os.DirEntry[str]]:
    """Visible entries of a folder, sorted by name; none of a folder that cannot be read."""
    found: list[os.DirEntry[str]] = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if len(found) >= most:
                break
            if not entry.name.startswith("."):
                found.append(entry)
    return sorted(found, key=lambda entry: entry.name)


def _text(name: str) -> str:
    """A name of a file as text, whatever bytes it has."""
    return re.sub(r"[\ud800-\udfff]", "\ufffd", name)


def document(ran: Ran) -> Any:
    """The document that a step printed; ``None`` where it printed none."""
    with contextlib.suppress(OSError, ValueError):
        return json.loads(ran.job.output.read_bytes())
    return None


def parts(folder: Path) -> dict[str, dict[str, list[Any]]]:
    """What :func:`curves` finds in each folder below that of a step, which is one for each of several models."""
    found = sorted(folder.glob("*/responses.npz"))
    return {path.parent.name: curves(path.parent) for path in found}


def curves(folder: Path) -> dict[str, list[Any]]:
    """Arrays of a ``responses.npz`` as numbers; those of complex numbers as real and imaginary part."""
    path = folder / "responses.npz"
    curves: dict[str, list[Any]] = {}
    if not path.is_file():
        return curves
    with np.load(path, allow_pickle=False) as arrays:
        for name in (name for name in _DRAWN if name in arrays.files):
            values = arrays[name]
            if values.dtype.kind == "c":
                curves[f"{name}.re"], curves[f"{name}.im"] = listed(values.real), listed(values.imag)
            elif values.dtype.kind in "fiub":
                curves[name] = listed(values)
            elif values.dtype.kind == "U":
                curves[name] = values.tolist()
    return curves
