"""Folders of results appear whole, take nothing that is not rotorid's, and leave nothing behind."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from tests.unit.io.folder_writer import LISTED, NAMES, write

from rotorid.errors import UsageError
from rotorid.io import folders
from rotorid.io.folders import ResultKind, Target, clear_leftovers, making, scratch_folder, target_folder

UNIX = pytest.mark.skipif(os.name != "posix", reason="locks and signals are those of Unix")


def contents(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def number_of(folder: Path) -> int | None:
    """The number that all files of the set bear; None for a folder without a set."""
    if not folder.exists():
        return None
    number = json.loads((folder / "set.json").read_text(encoding="utf-8"))["number"]
    for name in NAMES:
        assert (folder / name).read_text(encoding="utf-8") == f"{number}" * 2000, name
    return int(number)


def leftovers(place: Path) -> list[Path]:
    return [path for path in place.rglob("*") if "rotorid-" in path.name]


def test_a_set_appears_whole_and_replaces_its_like(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    write(out, 1)
    (out / "notes.txt").write_text("mine")
    before = (out / "notes.txt").stat().st_ino
    write(out, 2)
    assert number_of(out) == 2
    assert contents(out).keys() == {*NAMES, "set.json", "notes.txt"}
    assert (out / "notes.txt").stat().st_ino == before
    assert not leftovers(tmp_path)


def test_files_of_the_old_set_alone_go(tmp_path: Path) -> None:
    write(tmp_path / "out", 1)
    with making(Target(folder=tmp_path / "out", kind=LISTED)) as made:
        (made.place / "set.json").write_text('{"schema": "rotorid.set/1", "files": []}')
    assert contents(tmp_path / "out").keys() == {"set.json"}


def test_a_failure_leaves_the_old_set(tmp_path: Path) -> None:
    write(tmp_path / "out", 1)
    fails = ResultKind(mains=("set.json",), listed=lambda _: {})
    with pytest.raises(ZeroDivisionError), making(Target(folder=tmp_path / "out", kind=fails)) as made:
        (made.place / "set.json").write_text(str(1 / 0))
    assert number_of(tmp_path / "out") == 1
    assert not leftovers(tmp_path)


@pytest.mark.parametrize("foreign", ["set.json", "b.txt"])
def test_foreign_files_are_refused_before_any_work(tmp_path: Path, foreign: str) -> None:
    (tmp_path / foreign).write_text('{"schema": "mine"}')
    with pytest.raises(UsageError, match="--force"):
        target_folder(tmp_path, tmp_path, LISTED)
    assert contents(tmp_path) == {foreign: '{"schema": "mine"}'}
    write(tmp_path, 3, force=True)
    assert number_of(tmp_path) == 3


def test_a_file_of_a_name_that_was_not_foreseen_is_refused_at_the_end(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"a\.txt"):
        write(tmp_path, 1)
    assert contents(tmp_path) == {"a.txt": "mine"}


def test_a_file_that_changed_since_is_foreign(tmp_path: Path) -> None:
    out = write(tmp_path / "out", 1)
    (out / "pictures" / "c.svg").write_text("retouched")
    with pytest.raises(UsageError, match=r"c\.svg"):
        write(out, 2)
    assert contents(out)["pictures/c.svg"] == "retouched"


def test_a_picture_of_ones_own_among_ours_survives(tmp_path: Path) -> None:
    out = write(tmp_path / "out", 1)
    (out / "pictures" / "mine.svg").write_text("mine")
    os.utime(out / "pictures" / "mine.svg", (0, 0))
    write(out, 2)
    assert contents(out)["pictures/mine.svg"] == "mine"


def test_a_copy_of_a_result_is_a_result(tmp_path: Path) -> None:
    out = write(tmp_path / "out", 1)
    for path in [path for path in out.rglob("*") if path.is_file()]:
        os.utime(path)
    write(out, 2)
    assert number_of(out) == 2


def test_a_file_in_the_way_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(UsageError, match="is a file"):
        target_folder(tmp_path / "out", tmp_path, LISTED)
    with pytest.raises(UsageError, match="cannot be written"):
        target_folder(tmp_path / "out" / "deeper", tmp_path, LISTED)
    write(tmp_path / "out", 1, force=True)
    assert number_of(tmp_path / "out") == 1


def test_the_current_folder_stays_where_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.ulg").write_text("log")
    for number in (1, 2):
        write(Path(), number)
        assert number_of(Path()) == number
    assert contents(tmp_path).keys() == {*NAMES, "set.json", "flight.ulg"}
    assert not leftovers(tmp_path)


def test_a_link_still_leads_to_the_results(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    for number in (1, 2):
        write(tmp_path / "out", number)
    assert (tmp_path / "out").is_symlink()
    assert number_of(tmp_path / "disk") == 2


@pytest.mark.parametrize("missing", ["_swapped", "_keep_foreign"])
def test_systems_that_cannot_exchange_or_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    monkeypatch.setattr(folders, missing, lambda *_: False)
    for number in (1, 2):
        write(tmp_path / "out", number)
        (tmp_path / "out" / "notes.txt").write_text("mine")
        assert number_of(tmp_path / "out") == number
    assert contents(tmp_path / "out")["notes.txt"] == "mine"
    assert not leftovers(tmp_path)


def test_what_comes_while_folders_are_exchanged_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = write(tmp_path / "out", 1)
    (out / "notes.txt").write_text("mine")
    exchange = folders._exchange

    def late(claim: Path, folder: Path) -> None:
        (folder / "late.txt").write_text("just now")
        (folder / "notes.txt").unlink()
        (folder / "notes.txt").write_text("saved anew")
        exchange(claim, folder)

    monkeypatch.setattr(folders, "_exchange", late)
    write(out, 2)
    assert number_of(out) == 2
    kept = contents(out)
    assert (kept["late.txt"], kept["notes.txt"]) == ("just now", "saved anew")


def test_default_names_are_numbered(tmp_path: Path) -> None:
    names = [write(tmp_path / "flight-rate.roll", number, numbered=True).name for number in range(3)]
    assert names == ["flight-rate.roll", "flight-rate.roll-2", "flight-rate.roll-3"]
    assert [number_of(tmp_path / name) for name in names] == [0, 1, 2]


def test_runs_at_once_take_numbers_of_their_own(tmp_path: Path) -> None:
    made: list[Path] = []
    runs = [
        threading.Thread(target=lambda n=n: made.append(write(tmp_path / "out", n, numbered=True))) for n in range(8)
    ]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    assert len(set(made)) == 8
    assert {number_of(path) for path in made} == set(range(8))


def test_temporary_files_of_the_living_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path))  # type: ignore[attr-defined]
    with scratch_folder() as one, scratch_folder() as other:
        assert one != other
        assert one.is_dir()
    assert not list(tmp_path.iterdir())


@UNIX
def test_folders_of_others_are_no_leftovers(tmp_path: Path) -> None:
    (tmp_path / ".rotorid-making-mine").mkdir()
    (tmp_path / "rotorid-scratch-0123456789abcdef.txt").write_text("mine")
    (tmp_path / "rotorid-scratch-0123456789abcdef").mkdir()
    clear_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        ".rotorid-making-mine",
        "rotorid-scratch-0123456789abcdef.txt",
    }


def test_a_job_that_names_other_places_is_not_carried_out(tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("mine")
    claim = tmp_path / "out" / ".rotorid-making-0123456789abcdef"
    (claim / "new").mkdir(parents=True)
    job = {"target": "..", "inside": False, "in_place": True, "names": [], "own": ["victim"], "mains": []}
    (claim / "job.json").write_text(json.dumps(job))
    clear_leftovers(tmp_path / "out")
    assert (tmp_path / "victim").read_text() == "mine"


def writer(out: Path, step: int, here: Path) -> subprocess.Popen[str]:
    root = Path(__file__).resolve().parents[3]
    environment = dict(os.environ) | {"PYTHONPATH": str(root / "src")}
    started = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("folder_writer.py"), out, str(step)],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment, cwd=here,
    )  # fmt: skip
    assert started.stdout is not None
    started.stdout.readline()
    return started


def killed(tmp_path: Path, rounds: int, *, inside: bool) -> None:
    """Two runs write into one folder, and are killed at random moments."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    here = out if inside else tmp_path
    rng = random.Random(3)
    for turn in range(rounds):
        both = [writer(out, step, here) for step in (0, 1)]
        time.sleep(rng.uniform(0.0, 0.03))
        for one in both:
            one.send_signal((signal.SIGKILL, signal.SIGTERM, signal.SIGINT)[turn % 3])
        for one in both:
            one.wait()
            one.stdout.close()  # type: ignore[union-attr]
        if not inside and (out / "set.json").exists():
            number_of(out)
        assert (out / "notes.txt").read_text() == "mine"
        write(out, 2 * turn)
        assert number_of(out) == 2 * turn
        assert contents(out).keys() == {*NAMES, "set.json", "notes.txt"}
        assert not leftovers(tmp_path)


@UNIX
@pytest.mark.parametrize("inside", [False, True])
def test_runs_killed_at_random_moments_leave_whole_sets(tmp_path: Path, *, inside: bool) -> None:
    killed(tmp_path, 5, inside=inside)


@UNIX
@pytest.mark.slow
@pytest.mark.parametrize("inside", [False, True])
def test_many_runs_killed_at_random_moments_leave_whole_sets(tmp_path: Path, *, inside: bool) -> None:
    killed(tmp_path, 100, inside=inside)


@UNIX
def test_a_run_is_no_stranger_to_another_that_puts_its_set_down(tmp_path: Path) -> None:
    """Two runs of one command into one folder: what one finds while the other moves its files in is nobody else's."""
    out = tmp_path / "out"
    write(out, 1)
    main = (out / "set.json").read_text()
    stamp = (out / "set.json").stat()
    found: list[Target] = []

    def ask() -> None:
        found.append(target_folder(out, out, LISTED))

    other = threading.Thread(target=ask)
    with folders._one_at_a_time(tmp_path):
        (out / "set.json").unlink()
        other.start()
        time.sleep(0.05)
        (out / "set.json").write_text(main)
        os.utime(out / "set.json", ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    other.join()
    assert found
