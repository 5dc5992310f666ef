"""Commands that are killed at random moments: whole results or none, nothing left behind after the next run."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.fleet_logs import WORK, write_logs
from tests.hostile.interrupted import COMMANDS, MOMENTS, faults, inputs, interrupted, made

from rotorid.io.tables.csv import write_csv

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of Unix")

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
VERBS = {
    "inspect": (["inspect", "LOG"], "inspect.json", {"report.html"}),
    "response": (["response", "LOG", "--inputs", "roll_command", "--outputs", "p"], "response.json", {"responses.npz"}),
    "identify": (["identify", "LOG", "--model", "rate.roll"], "result.json", {"responses.npz", "model.toml"}),
    "delay": (["delay", "LOG"], "delay.json", set[str]()),
    "simulate": (["simulate", "rig"], "simulation.json", set[str]()),
    "design": (
        ["design", "sweep", "doublet", "--vehicle", "px4_quad", "--axis", "roll", "--duration", "20"],
        "design.json",
        {"design.html"},
    ),
    "review": (["review", "LOG"], "review.json", {"review.html"}),
    "verify": (["verify", "RESULT", "LOG"], "verification.json", {"report.html"}),
    "export": (["export", "RESULT", "--to", "json"], "export.json", {"vehicle.json"}),
    "fleet": (
        ["fleet", "LOG", "--models", "rate.roll", "--workers", "1"],
        "fleet.json",
        {"fleet.html", "fleet.parquet", "failed.parquet"},
    ),
}
STAYS = {"notes.txt", "fleet.journal", "fleet.salt", "fleet.lock"}
"""What is no part of a set: a file of the user's, and what the next run of a fleet continues from."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    time_s = np.arange(0.0, 60.0, 0.01)
    command = 0.1 * np.sin(0.5 * time_s**2)
    rate = np.zeros(time_s.size)
    for k in range(1, time_s.size):
        rate[k] = rate[k - 1] + 0.01 * (100.0 * command[k - 1] - 3.0 * rate[k - 1])
    noise = 0.01 * np.random.default_rng(0).normal(size=time_s.size)
    path = tmp_path_factory.mktemp("log") / "flight.csv"
    write_csv(path, time_s, {"roll_command": command, "p": rate + noise})
    return path


def started(words: list[str], log: Path, out: Path) -> subprocess.Popen[bytes]:
    stands_for = {"LOG": str(log), "RESULT": str(log.parent / "result")}
    command = [sys.executable, "-m", "rotorid", *(stands_for.get(word, word) for word in words)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([*command, "--out", str(out), "--force"], **quiet)  # type: ignore[call-overload, no-any-return]


def check(out: Path, main: str, others: set[str]) -> None:
    """A whole set or none."""
    found = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    if main not in found:
        assert found <= STAYS
        return
    document = json.loads((out / main).read_text(encoding="utf-8"))
    assert others <= found
    if main == "design.json":
        assert {f"{one['folder']}/{name}" for one in document["plans"] for name in one["files"]} <= found
    assert len({(out / name).stat().st_mtime_ns for name in found - STAYS}) == 1


def killed(words: list[str], main: str, others: set[str], log: Path, folder: Path, rounds: int, seed: int) -> None:
    out = folder / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    begin_s = time.monotonic()
    assert started(words, log, out).wait() == 0
    usual_s = time.monotonic() - begin_s
    rng = random.Random(seed)
    for turn in range(rounds):
        run = started(words, log, out)
        time.sleep(rng.uniform(0.3, 1.0) * usual_s)
        run.send_signal(SIGNALS[turn % 3])
        run.wait()
        check(out, main, others)
        assert (out / "notes.txt").read_text() == "mine"
    assert started(words, log, out).wait() == 0
    check(out, main, others)
    assert [path.name for path in folder.iterdir()] == ["out"]
    assert not list(out.glob(".rotorid-*"))


def test_a_killed_run_leaves_a_whole_result(log: Path, tmp_path: Path) -> None:
    killed(*VERBS["delay"], log=log, folder=tmp_path, rounds=2, seed=0)


FORKS = pytest.mark.skipif(sys.platform != "linux", reason="each killed run is a copy of a process")


@FORKS
def test_a_command_that_is_killed_or_has_no_disk_leaves_a_whole_set_or_none(log: Path, tmp_path: Path) -> None:
    lines = interrupted(["delay", str(log)], tmp_path, killed=8, full=4, read_only=4)
    assert faults(lines) == []
    assert sum(line.get("ended") == -signal.SIGKILL for line in lines) >= 5
    assert not list((tmp_path / "temporary").iterdir())


@FORKS
@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_killed_and_without_a_disk_at_each_call(name: str, tmp_path: Path) -> None:
    words = made(COMMANDS[name], inputs(tmp_path / "inputs"))
    lines = interrupted(words, tmp_path / "run", killed=MOMENTS, full=MOMENTS, read_only=MOMENTS)
    assert faults(lines) == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a run is a copy of this process")
def test_a_fleet_killed_at_any_call_leaves_the_set_of_before_or_its_own(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    write_logs(tmp_path / "logs", 1)
    out = tmp_path / "out"
    whole_fleet(tmp_path / "logs", out, "before")
    ended = []
    for call in range(0, 60, 4):
        child = os.fork()
        if child == 0:
            # Nothing of the test may go on in here.
            try:
                signal.alarm(30)
                whole_fleet(tmp_path / "logs", out, f"after {call}", killed_at=call)
            finally:
                os._exit(0)
        _, status = os.waitpid(child, 0)
        ended.append(os.waitstatus_to_exitcode(status))
        pages = {(out / name).read_text().partition('"x": ')[2].strip('"}') for name in ("fleet.json", "fleet.html")}
        assert len(pages) == 1
        assert len({(out / name).stat().st_mtime_ns for name in SET}) == 1
    assert set(ended) <= {0, -signal.SIGKILL}
    assert ended.count(-signal.SIGKILL) >= 5
    whole_fleet(tmp_path / "logs", out, "last")
    assert {path.name for path in out.iterdir()} == {*SET, "fleet.journal", "fleet.salt", "fleet.lock"}
    assert {path.name for path in tmp_path.iterdir()} == {"logs", "out"}


SET = ("fleet.json", "fleet.html", "fleet.parquet", "failed.parquet")


def whole_fleet(logs: Path, out: Path, words: str, *, killed_at: int | None = None) -> None:
    """A fleet with a stand-in for its page; killed at one of the calls by which its files are written and exchanged."""
    from rotorid.fleets import Fleet, FleetSettings, Limits, Processes

    calls = iter(range(10**6))

    def kill(event: str, _: object) -> None:
        if event.startswith(("open", "os.", "ctypes.call", "shutil.")) and next(calls) == killed_at:
            os.kill(os.getpid(), signal.SIGKILL)

    run = Fleet([logs], FleetSettings(models=("rate.roll",)), out, engine=Processes(1, Limits(work=WORK)))
    list(run)
    if killed_at is not None:
        sys.addaudithook(kill)
    with run.writing() as place:
        for name in ("fleet.html", "fleet.json"):
            (place / name).write_text(json.dumps({"schema": "rotorid.fleet/1", "x": words}))
    run.close()


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
def test_runs_killed_at_random_moments(log: Path, tmp_path: Path, verb: str) -> None:
    if "RESULT" in VERBS[verb][0]:
        assert started(["identify", "LOG", "--model", "rate.roll"], log, log.parent / "result").wait() == 0
    killed(*VERBS[verb], log=log, folder=tmp_path, rounds=17, seed=len(verb))
