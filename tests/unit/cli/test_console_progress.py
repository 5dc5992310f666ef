"""What a person sees of long work, and a pipe every 10 s."""

from __future__ import annotations

import io
import logging
import threading
from collections.abc import Iterator

import pytest
from rich.console import Console

from rotorid.cli import console
from rotorid.cli.console import progress

PIPELINE = logging.getLogger("rotorid.progress")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the clock shows, which the test turns."""
    now_s = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now_s[0])  # type: ignore[attr-defined]
    return now_s


@pytest.fixture
def shown(clock: list[float]) -> Iterator[list[str]]:
    """What has been shown of messages of the pipeline."""
    lines: list[str] = []
    handler = console._Status(lambda text, _: lines.append(text))
    PIPELINE.addHandler(handler)
    PIPELINE.setLevel(logging.INFO)
    yield lines
    PIPELINE.removeHandler(handler)
    PIPELINE.setLevel(logging.NOTSET)


def count(done: int, total: int) -> None:
    PIPELINE.info(f"runs: {done} of {total}", extra={"done": done, "total": total})


def test_counted_work_tells_the_time_that_is_left(shown: list[str], clock: list[float]) -> None:
    count(8, 200)
    clock[0] += 10.0
    count(28, 200)
    clock[0] += 86.0
    count(200, 200)
    # 20 runs in 10 s; 172 are left.
    assert shown == ["runs: 8 of 200", "runs: 28 of 200, about 86 s left", "runs: 200 of 200"]


def test_other_messages_between_do_not_count(shown: list[str], clock: list[float]) -> None:
    count(0, 4)
    clock[0] += 5.0
    PIPELINE.info("frequency responses")
    clock[0] += 5.0
    count(1, 4)
    assert shown == ["runs: 0 of 4", "frequency responses", "runs: 1 of 4, about 30 s left"]


def test_the_same_work_begun_again_counts_anew(shown: list[str], clock: list[float]) -> None:
    count(0, 2)
    clock[0] += 1000.0
    count(0, 2)
    clock[0] += 120.0
    count(1, 2)
    assert shown[-1] == "runs: 1 of 2, about 2.0 min left"


def test_counted_work_is_a_bar_on_a_terminal(clock: list[float]) -> None:
    written = io.StringIO()
    terminal = Console(file=written, force_terminal=True, width=80, color_system=None)
    for share, full in ((None, 0), (0.0, 0), (0.5, 12), (1.0, 24)):
        terminal.print(console._line("runs [1]", share))
        shown = written.getvalue()
        assert "runs [1]" in shown
        assert shown.count("━") == full
        written.seek(0)
        written.truncate()


@pytest.mark.parametrize("quiet", [True, False])
def test_a_pipe_sees_nothing_of_short_work(quiet: bool, capfd: pytest.CaptureFixture[str]) -> None:
    with progress(quiet=quiet) as report:
        report("fitting")
        count(1, 2)
    assert capfd.readouterr() == ("", "")
    assert not PIPELINE.handlers


def test_a_pipe_sees_how_far_long_work_is(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], clock: list[float]
) -> None:
    monkeypatch.setattr(console, "_PULSE_S", 0.01)
    seen = ""
    with progress(quiet=False):
        count(0, 4)
        clock[0] += 12.0
        count(1, 4)
        for _ in range(1000):
            threading.Event().wait(0.01)
            seen += capfd.readouterr().err
            if "(25 % done)\n" in seen:
                break
    assert "rotorid: 12 s: runs: 1 of 4, about 36 s left (25 % done)\n" in seen
    assert not PIPELINE.handlers


def test_quiet_sees_nothing_of_long_work(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(console, "_PULSE_S", 0.001)
    with progress(quiet=True):
        count(1, 4)
        threading.Event().wait(0.05)
    assert capfd.readouterr() == ("", "")


def test_a_pipe_sees_a_step_once_and_not_its_reasons(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], clock: list[float]
) -> None:
    monkeypatch.setattr(console, "_PULSE_S", 0.01)
    clock[0] = 0.0
    with progress(quiet=False) as report:
        report(f"yaw: the log contains no excitation {'of any kind ' * 20}")
        threading.Event().wait(0.3)
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].endswith(" …")
    assert len(lines[0]) < 110
