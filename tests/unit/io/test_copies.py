"""Programs in processes of their own: copies and new processes behave alike, and none outlives whoever asked for it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep

import pytest

from rotorid.io.copies import Program, Running, can_copy

PROGRAM = """
import json, os, subprocess, sys, tempfile, time

with open(os.environ["IMPORTS"], "a") as file:
    file.write("once\\n")
counted = []


def prepare():
    if os.environ.get("CANNOT") == "prepare":
        raise RuntimeError
    if os.environ.get("CANNOT") == "fork":
        def fork():
            raise BlockingIOError
        os.fork = fork


def begin(words):
    counted.append(words)
    verb, *rest = words
    if verb == "look":
        files = []
        for number in range(64):
            try:
                os.fstat(number)
                files.append(number)
            except OSError:
                pass
        seen = {
            "words": rest, "argv": sys.argv[1:], "count": len(counted), "folder": os.getcwd(), "files": files,
            "stdin": sys.stdin.read(), "own": os.getsid(0) == os.getpid() == os.getpgrp(),
            "given": os.environ.get("GIVEN"), "program": os.environ["OF_PROGRAM"], "temporary": tempfile.gettempdir(),
        }
        print(json.dumps(seen))
        print("aside", file=sys.stderr)
    if verb == "fail":
        raise ValueError("of no use")
    if verb == "exit":
        sys.exit(int(rest[0]))
    if verb == "rest":
        child = subprocess.Popen(["sleep", "600"])
        print(child.pid, flush=True)
        time.sleep(600)


if __name__ == "__main__":
    begin(sys.argv[1:])
"""

needs_copies = pytest.mark.skipif(not can_copy(), reason="this system makes no copies of processes")


class Place:
    """A folder with the program, and what its runs wrote."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.out, self.errors, self.imports = (folder / name for name in ("out", "errors", "imports"))
        (folder / "some_program.py").write_text(PROGRAM, encoding="utf-8")

    def program(self, *, copied: bool = True, **more: str) -> Program:
        """The program, with some variables more."""
        variables = {"IMPORTS": str(self.imports), "OF_PROGRAM": "yes"}
        return Program("some_program", environment=variables | more, copied=copied)

    def start(self, program: Program, *words: str, **given: object) -> Running:
        """A run that writes into files."""
        with self.out.open("wb") as out, self.errors.open("wb") as errors:
            return program.start(words, stdout=out.fileno(), stderr=errors.fileno(), **given)  # type: ignore[arg-type]

    def code(self, program: Program, *words: str) -> int:
        """Exit code of a run."""
        return self.start(program, *words).wait(60.0)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.syspath_prepend(tmp_path)
    return Place(tmp_path)


@pytest.fixture(params=[pytest.param(True, marks=needs_copies, id="copies"), pytest.param(False, id="new processes")])
def program(request: pytest.FixtureRequest, place: Place) -> Iterator[Program]:
    made = place.program(copied=request.param)
    yield made
    made.close()


def _goes_on(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # One that nobody has waited for yet has ended all the same.
    return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0] != "Z"


def _until_gone(*pids: int) -> bool:
    last = monotonic() + 20.0
    while any(map(_goes_on, pids)) and monotonic() < last:
        sleep(0.01)
    return not any(map(_goes_on, pids))


def _pid_of_child(place: Place) -> int:
    last = monotonic() + 60.0
    while not place.out.read_text(encoding="ascii").endswith("\n"):
        assert monotonic() < last
        sleep(0.01)
    return int(place.out.read_text(encoding="ascii"))


def test_each_run_has_what_it_was_given_and_nothing_of_another(program: Program, place: Place) -> None:
    for name in ("first", "second"):
        folder = place.folder / name
        folder.mkdir()
        given = {**os.environ, "GIVEN": name, "TMPDIR": str(folder)}
        run = place.start(program, "look", name, "ä\udcff", folder=folder, environment=given)
        assert run.wait(60.0) == 0
        # Its end is known for as long as anybody asks.
        assert run.wait(0.0) == 0
        run.end()
        seen = json.loads(place.out.read_text(encoding="utf-8"))
        assert seen == {
            "words": [name, "ä\udcff"],
            "argv": ["look", name, "ä\udcff"],
            "count": 1,
            "folder": str(folder),
            "files": [0, 1, 2],
            "stdin": "",
            "own": True,
            "given": name,
            "program": "yes",
            "temporary": str(folder),
        }
        assert place.errors.read_text(encoding="utf-8") == "aside\n"


def test_what_is_written_to_it_is_read(program: Program, place: Place) -> None:
    said, says = os.pipe()
    run = place.start(program, "look", stdin=said)
    os.close(said)
    os.write(says, b"some words")
    os.close(says)
    assert run.wait(60.0) == 0
    assert json.loads(place.out.read_text(encoding="utf-8"))["stdin"] == "some words"


def test_how_it_ended_is_known(program: Program, place: Place) -> None:
    assert place.code(program, "exit", "0") == 0
    assert place.code(program, "exit", "7") == 7
    assert place.code(program, "fail") == 1
    assert place.errors.read_text(encoding="utf-8").endswith("ValueError: of no use\n")
    run = place.start(program, "rest")
    child = _pid_of_child(place)
    with pytest.raises(TimeoutError):
        run.wait(0.0)
    with pytest.raises(TimeoutError):
        run.wait(0.01)
    os.kill(run.pid, signal.SIGTERM)
    assert run.wait(60.0) == -signal.SIGTERM
    run.end()
    assert _until_gone(run.pid, child)


def test_it_ends_with_all_that_it_started(program: Program, place: Place) -> None:
    run = place.start(program, "rest")
    child = _pid_of_child(place)
    run.end()
    assert run.wait(60.0) == -signal.SIGKILL
    assert _until_gone(run.pid, child)


@needs_copies
def test_imports_are_done_once(place: Place) -> None:
    program = place.program()
    runs = [place.start(program, "exit", str(k)) for k in range(5)]
    assert [run.wait(60.0) for run in runs] == [0, 1, 2, 3, 4]
    assert place.imports.read_text(encoding="ascii") == "once\n"
    program.close()
    assert place.code(program, "exit", "0") == 0
    assert place.imports.read_text(encoding="ascii") == "once\nonce\n"
    program.close()


@needs_copies
def test_a_program_that_is_closed_leaves_no_copy(place: Place) -> None:
    program = place.program()
    run = place.start(program, "rest")
    _pid_of_child(place)
    program.close()
    assert run.wait(60.0) == -signal.SIGKILL
    assert _until_gone(run.pid)


@needs_copies
def test_the_copied_process_may_be_killed(place: Place) -> None:
    """Its copies end with it, and the next start has another."""
    program = place.program()
    run = place.start(program, "rest")
    _pid_of_child(place)
    original = int(Path(f"/proc/{run.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[1])
    os.kill(original, signal.SIGKILL)
    assert run.wait(60.0) == -signal.SIGKILL
    assert _until_gone(run.pid)
    assert place.code(program, "exit", "5") == 5
    assert place.code(program, "exit", "6") == 6
    program.close()


@needs_copies
@pytest.mark.parametrize("what", ["prepare", "fork"])
def test_what_cannot_be_copied_is_started_anew(what: str, place: Place) -> None:
    program = place.program(CANNOT=what)
    assert [place.code(program, "exit", str(k)) for k in (4, 5)] == [4, 5]
    program.close()


@needs_copies
def test_copies_end_with_whoever_asked_for_them(place: Place) -> None:
    script = (
        "import sys\nfrom rotorid.io.copies import Program\nprogram = Program('some_program')\n"
        "run = program.start(['rest'], stdout=1, stderr=2)\nprint(run.pid, flush=True)\nsys.stdin.read()\n"
    )
    variables = {**os.environ, "PYTHONPATH": str(place.folder), "IMPORTS": str(place.imports), "OF_PROGRAM": "yes"}
    asker = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=variables
    )
    assert asker.stdout is not None
    pids = [int(asker.stdout.readline()) for _ in range(2)]
    asker.kill()
    asker.communicate(timeout=20)
    assert _until_gone(*pids)
