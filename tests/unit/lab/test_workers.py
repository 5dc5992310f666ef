"""Commands in processes of their own: canceled at any moment, ended with the session, limited, and told in words."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from rotorid.lab import workers as lab_workers
from rotorid.lab.workers import Job, Workers


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Commands run until this is set."""
    hold = threading.Event()
    monkeypatch.setattr(Workers, "_carry_out", lambda _self, _job: hold.wait(20.0))
    return hold


def _running(job: Job) -> Job:
    while job.process is None and not job.ended.is_set():
        threading.Event().wait(0.01)
    return job


def test_a_command_that_waits_is_canceled_at_once(held: threading.Event, tmp_path: Path) -> None:
    workers = Workers(most_running=1)
    first = workers.start(["a"], tmp_path / "first")
    while first.state == "waiting":
        threading.Event().wait(0.01)
    second = workers.start(["b"], tmp_path / "second")
    workers.cancel(second)
    assert second.ended.is_set()
    assert (second.state, second.sentence, second.seconds) == ("canceled", "It was canceled.", 0.0)
    third = workers.start(["c"], tmp_path / "third")
    assert not first.ended.is_set()
    held.set()
    assert first.ended.wait(10.0)
    # The place goes to the next one.
    assert third.ended.wait(10.0)
    assert not (tmp_path / "second").exists()


def test_nothing_comes_back_after_the_end(tmp_path: Path) -> None:
    before = set(threading.enumerate())
    place = tmp_path / "private"
    place.mkdir()
    workers = Workers(most_running=1)
    first = _running(workers.start(["fly", str(place / "flight.ulg"), str(place)], place / "first"))
    waiting = [workers.start(["models"], place / f"waiting-{k}") for k in range(3)]
    workers.close()
    assert all(job.ended.is_set() for job in (first, *waiting))
    assert {job.state for job in (first, *waiting)} == {"canceled"}
    shutil.rmtree(place)
    for thread in set(threading.enumerate()) - before:
        thread.join(10.0)
    assert not place.exists()


def test_a_folder_that_is_gone_stays_so(tmp_path: Path) -> None:
    job = Workers().start(["models"], tmp_path / "gone" / "step-1")
    assert job.ended.wait(10.0)
    assert job.state == "failed"
    assert job.sentence == "The worker could not run: No such file or directory."
    assert not (tmp_path / "gone").exists()


def test_folders_of_commands_are_for_their_user_alone(tmp_path: Path) -> None:
    job = Workers().start(["read", str(tmp_path / "none.ulg"), str(tmp_path)], tmp_path / "job")
    assert job.ended.wait(60.0)
    assert job.state == "refused"
    assert "none.ulg" in job.sentence
    assert (tmp_path / "job").stat().st_mode & 0o077 == 0


def test_the_time_of_a_command_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab_workers, "WALL_S", 0.3)
    job = Workers().start(["fly", str(tmp_path / "flight.ulg"), str(tmp_path)], tmp_path / "job")
    assert job.ended.wait(60.0)
    assert job.state == "failed"
    assert job.sentence == "It was ended after 0.005 minutes, the most that a command has."


@pytest.mark.parametrize(("most", "state"), [(10, "failed"), (1 << 26, "done")])
def test_a_long_answer_is_none_for_a_page(
    most: int, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lab_workers, "_MOST_OUTPUT", most)
    job = Workers().start(["models", "--json"], tmp_path / "job")
    assert job.ended.wait(60.0)
    assert job.state == state
    assert (job.sentence == "The answer is too large.") == (state == "failed")


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [("MemoryError()", "it needed more memory than the 4 GiB that a command has"),
     ("OSError(28, 'No space left on device')", "OSError: [Errno 28] No space left on device")],
)  # fmt: skip
def test_what_stops_a_reader_is_said(
    wrong: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the worker's last line, not as the last line of a traceback."""
    worker = f"failing_by_{wrong.partition('(')[0].lower()}"
    (tmp_path / f"{worker}.py").write_text(
        "import sys\nfrom rotorid.cli import lab_worker\nimport rotorid.lab.tracks as tracks\n"
        f"def fail(*_):\n    raise {wrong}\ntracks.write_tracks = fail\nbegin = lab_worker.begin\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(lab_workers, "_PROGRAM", worker)
    workers = Workers()
    job = workers.start(["read", "a", "b"], tmp_path / "job")
    assert job.ended.wait(60.0)
    workers.close()
    assert (job.state, job.sentence) == ("failed", sentence)


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="the end of a process that is no child is seen on Linux")
def test_a_worker_ends_with_the_server_that_started_it(tmp_path: Path) -> None:
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom rotorid.lab.workers import Workers\n"
        f"place = Path({str(tmp_path)!r})\n"
        "job = Workers().start(['fly', str(place / 'flight.ulg'), str(place)], place / 'job')\n"
        "while not job.doing: time.sleep(0.01)\n"
        "print(job.process.pid, flush=True)\nsys.stdin.read()\n"
    )
    server = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    worker = os.pidfd_open(int(server.stdout.readline()))
    try:
        server.kill()
        server.communicate(timeout=10)
        assert select.select([worker], [], [], 5.0)[0], "the worker goes on"
    finally:
        os.close(worker)
