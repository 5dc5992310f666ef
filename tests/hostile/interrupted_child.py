"""The child of `test_killed_runs`: one command, killed or without a disk at each call that touches the results.

The command runs once as a person would run it, and once more up to its first call that touches the folder of the
results. From there on copies of the process go on, one after the other: the first counts the calls, each of the others
is killed at one of them, or finds the disk full or read-only from there on; every second one finds no set of an earlier
run. What they leave is looked at between them. At last the command itself goes on to its end.

A line of JSON for each copy: the fault, the call, how it ended, and what is wrong.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from unittest.mock import patch

import numpy as np

from rotorid.cli.app import main as command
from rotorid.io.folders import clear_leftovers

Fault = Literal["killed", "full", "read-only"]
LONGEST_S = 300
"""A copy that has not ended by then is a fault."""
STAYS = frozenset({"notes.txt", "fleet.journal", "fleet.salt", "fleet.lock"})
"""What is no part of a set: a file of the user's, and what the next run of a fleet continues from."""
LEFTOVER = ".rotorid-making-"
_TOUCHING = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.utime", "os.chmod")
_FREEING = ("os.remove", "os.rmdir")
_NUMBERS = {"full": errno.ENOSPC, "read-only": errno.EROFS}


@dataclass
class Copy:
    """What a copy of the process does: the fault at a call, or nothing but counting."""

    at: int | None
    fault: Fault
    report: int
    count: int = 0

    def touch(self, event: str) -> None:
        """One call: count it, or let the fault come."""
        self.count += 1
        if self.at is None or self.count <= self.at:
            return
        if self.fault == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        # A full disk stays full; what frees room goes on.
        if self.fault != "full" or event not in _FREEING:
            number = _NUMBERS[self.fault]
            raise OSError(number, os.strerror(number))


@dataclass
class Run:
    """The second run of the command.

    Parameters
    ----------
    work
        The folder around that of the results.
    plan
        Faults, and at how many calls each comes.
    """

    work: Path
    plan: Sequence[tuple[Fault, int]]
    names: frozenset[str] = frozenset()
    waiting: bool = False
    copy: Copy | None = None
    lines: list[dict[str, object]] = field(default_factory=list)

    def hook(self, event: str, arguments: tuple[object, ...]) -> None:
        """What Python tells of each call."""
        if (self.waiting or self.copy) and self._touches(event, arguments):
            if self.waiting:
                self.waiting = False
                self._let_copies_go()
            if self.copy:
                self.copy.touch(event)

    def _touches(self, event: str, arguments: tuple[object, ...]) -> bool:
        places = [one for one in arguments if isinstance(one, str) and one.startswith(os.fspath(self.work))]
        if event == "open":
            flags = arguments[2]
            return bool(places) and isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        # By its name the system exchanges two folders.
        return (bool(places) and event in _TOUCHING) or (event == "ctypes.dlsym" and not self.waiting)

    def _let_copies_go(self) -> None:
        """Returns in each copy, and in the first process when all have ended."""
        earlier = self.work.parent / "earlier"
        shutil.copytree(self.work / "out", earlier, copy_function=shutil.copy2)
        counted = self._forked(None, "killed")
        if self.copy:
            return
        self.lines.append({"fault": "none", "calls": counted})
        for fault, moments in self.plan:
            for number, at in enumerate(np.unique(np.linspace(0, counted - 1, moments).astype(int)).tolist()):
                shutil.rmtree(self.work / "out", ignore_errors=True)
                if number % 2 == 0:
                    shutil.copytree(earlier, self.work / "out", copy_function=shutil.copy2)
                ended = self._forked(at, fault)
                if self.copy:
                    return
                self._judge(fault, at, ended, first=number % 2 == 1)
        shutil.rmtree(self.work / "out", ignore_errors=True)
        shutil.copytree(earlier, self.work / "out", copy_function=shutil.copy2)

    def _forked(self, at: int | None, fault: Fault) -> int:
        """The exit code of a copy, or the number of its calls; zero in the copy itself."""
        reading, writing = os.pipe()
        number = os.fork()
        if number == 0:
            signal.alarm(LONGEST_S)
            said = os.open(self.work.parent / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(said, 1)
            os.dup2(said, 2)
            self.copy = Copy(at=at, fault=fault, report=writing)
            return 0
        os.close(writing)
        with os.fdopen(reading) as pipe:
            text = pipe.read()
        _, status = os.waitpid(number, 0)
        return int(text) if at is None else os.waitstatus_to_exitcode(status)

    def _judge(self, fault: Fault, at: int, ended: int, *, first: bool) -> None:
        said = (self.work.parent / "said.txt").read_text(encoding="utf-8", errors="replace")
        wrong = self.wrong(first=first)
        if "Traceback" in said or (fault == "killed" and ended not in (-signal.SIGKILL, 0)):
            wrong.append(f"ended with {ended}: {said[-300:]!r}")
        if fault != "killed" and ended not in (0, 1, 2):
            wrong.append(f"a {fault} disk ended it with {ended}: {said[-300:]!r}")
        self.lines.append({"fault": fault, "at": at, "ended": ended, "wrong": wrong})

    def wrong(self, *, first: bool) -> list[str]:
        """What is wrong with the folder of the results: neither a whole set, nor none where there was none before."""
        out = self.work / "out"
        found = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()} - STAYS
        # What a fleet keeps for its next run is written beside the set; that run removes the rest of it.
        found = {name for name in found if not name.startswith(LEFTOVER)}
        wrong = []
        if found != self.names and (found or not first):
            wrong.append(f"{sorted(self.names ^ found)[:5]} are too many or too few")
        if len({(out / name).stat().st_mtime_ns for name in found}) > 1:
            wrong.append("files of two sets")
        if not first and (out / "notes.txt").read_text(encoding="utf-8") != "mine":
            wrong.append("the user's file is gone or changed")
        strange = [path.name for path in self.work.iterdir() if path != out and not path.name.startswith(LEFTOVER)]
        return [*wrong, *(f"{name} was left behind" for name in strange)]


def spoken(words: Sequence[str]) -> int:
    """A command by its entry point: its exit code."""
    with patch.object(sys, "argv", ["rotorid", *words]):
        try:
            command()
        except SystemExit as ended:
            return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    return 0


def main(work: Path, plan: Sequence[tuple[Fault, int]], words: Sequence[str]) -> None:
    """Run a command as described, and print what became of each copy."""
    out = work / "out"
    out.mkdir(parents=True)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    words = [*words, "--out", str(out), "--quiet"]
    code = spoken(words)
    names = frozenset(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()) - STAYS
    run = Run(work, plan, names)
    sys.addaudithook(run.hook)
    run.waiting = True
    again = spoken(words)
    run.waiting = False
    if copy := run.copy:
        run.copy = None
        if copy.at is None:
            os.write(copy.report, str(copy.count).encode())
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(again)
    wrong = run.wrong(first=False)
    # What the next run begins with.
    clear_leftovers(work)
    left = [path for path in work.iterdir() if path != out] + list(out.glob(f"{LEFTOVER}*"))
    wrong += [f"{path.name} was left behind" for path in left]
    wrong += [] if code == again else [f"the code was {code}, and then {again}"]
    lines = [*run.lines, {"fault": "next run", "ended": again, "files": len(names), "wrong": wrong}]
    print(*map(json.dumps, lines), sep="\n")


if __name__ == "__main__":
    killed, full, read_only = map(int, sys.argv[2:5])
    main(Path(sys.argv[1]), [("killed", killed), ("full", full), ("read-only", read_only)], sys.argv[5:])
