"""A normal run of any command fits on a screen of 40 lines, 100 columns wide; ``-v`` prints at least as much."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeAlias

import pytest
from tests.unit.cli.commands import ROLL, Ran, rotorid

from rotorid.cli.app import COMMANDS
from rotorid.cli.console import MOST_LINES

pytestmark = pytest.mark.usefixtures("computed_once")

WIDTH = 100

Words: TypeAlias = tuple[str, ...]
Call: TypeAlias = Callable[..., Ran]

CALLS: Mapping[str, Words] = {
    "review": ("LOG", "--no-models"),
    "inspect": ("LOG",),
    "response": ("LOG",),
    "identify": ("LOG", *ROLL),
    "verify": ("RESULT", "LOG"),
    "compare": ("RESULT", "OTHER", "--log", "LOG"),
    "delay": ("LOG",),
    "design": ("doublet", "--vehicle", "x500", "--axis", "roll"),
    "simulate": ("x500", "--plan", "none", "--duration", "4"),
    "export": ("RESULT", "--to", "json"),
    "fleet": ("LOG", "--models", "rate.roll", "--workers", "1"),
    "models": (),
    "vehicles": (),
    "example": (),
    "doctor": ("--no-self-test",),
}
SEVERAL = ("LOG", "--model", "rate.roll,rate.pitch,hover.lateral,rate.yaw", "--band", "12:50")
ELSEWHERE = {
    "demo": "prints a table of parameters, which folds as all do, and three lines",
    "stitch": "needs results at several speeds; tests/unit/cli/test_stitch_command.py",
    "tune": "needs gains; tests/unit/cli/test_tune_command.py",
    "track": "needs a long flight by stick; tests/unit/cli/test_track_command.py",
    "bench": "needs a data set; tests/unit/cli/test_bench_command.py",
    "lab": "prints an address",
    "mcp": "speaks a protocol; tests/unit/mcp",
    "run": "prints what its steps print",
}


def rows(text: str) -> int:
    """Lines that text takes on a screen."""
    return sum(max(1, -(-len(line.rstrip()) // WIDTH)) for line in text.splitlines())


@pytest.fixture
def call(flight: Path, results: tuple[Path, Ran], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs a command below a folder of its own, as on a terminal or in a pipe."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    shutil.copytree(results[0], tmp_path / "other")
    places = {"LOG": str(flight), "RESULT": str(results[0]), "OTHER": "other"}

    def run(name: str, words: Words, *more: str, terminal: bool) -> Ran:
        if terminal:
            monkeypatch.setenv("TTY_COMPATIBLE", "1")
            monkeypatch.setenv("NO_COLOR", "1")
            monkeypatch.setenv("TERM", "dumb")
        else:
            monkeypatch.delenv("TTY_COMPATIBLE", raising=False)
        return rotorid(name, *(places.get(word, word) for word in words), *more)

    return run


def test_every_command_is_counted() -> None:
    assert {*CALLS, *ELSEWHERE} == {*COMMANDS}


# A process of its own for each log takes long to start.
SLOW = ("fleet",)
TERMINAL = [
    pytest.param(name, words, marks=pytest.mark.slow if name in SLOW else ())
    for name, words in (*CALLS.items(), ("identify", SEVERAL))
]


@pytest.mark.parametrize(("name", "words"), TERMINAL)
def test_a_normal_run_fits_on_a_screen(name: str, words: Words, call: Call) -> None:
    normal, verbose = (call(name, words, *more, terminal=True) for more in ((), ("-v",)))
    assert (normal.code, verbose.code) == (0, 0), normal.err
    assert normal.out
    assert rows(normal.out) <= MOST_LINES, normal.out
    assert rows(verbose.out) >= rows(normal.out)
    assert "-v shows" not in verbose.out


@pytest.mark.parametrize("name", ["inspect", "response", "verify", "export", "models", "vehicles", "doctor"])
def test_a_normal_run_is_as_short_in_a_pipe(name: str, call: Call) -> None:
    ran = call(name, CALLS[name], terminal=False)
    assert ran.code == 0
    assert 0 < rows(ran.out) <= MOST_LINES, ran.out
