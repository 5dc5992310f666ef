"""``rotorid review``: one log, several, a folder, one that tells nothing, one that is none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.report.made_reviews import made_review

from rotorid.cli.console import MOST_LINES
from rotorid.cli.review import _print, _print_several
from rotorid.data.findings import refusal, remark, warn
from rotorid.io.tables.csv import write_csv

pytestmark = pytest.mark.usefixtures("computed_once")


@pytest.fixture(scope="module")
def reviewed(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("reviewed") / "out"
    ran = rotorid("review", flight, "--no-models", "--out", folder, "--json")
    assert ran.code == 0
    return folder, ran.out


def test_writes_page_numbers_and_curves(reviewed: tuple[Path, str]) -> None:
    folder, out = reviewed
    assert {path.name for path in folder.iterdir()} >= {"review.json", "review.npz", "review.html"}
    assert (folder / "review.json").read_text(encoding="utf-8") == out
    told = json.loads(out)
    assert told["schema"] == "rotorid.review/1"
    assert told["flights"]
    assert told["cannot_tell"]
    assert {card["state"] for card in told["cards"]} <= {"good", "look", "part", "cannot"}


def test_the_brief_is_one_line_of_json_about_the_same_flight(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("review", flight, "--no-models", "--out", tmp_path / "out", "--json", "--brief")
    assert ran.code == 0
    assert ran.out.count("\n") == 1
    assert len(ran.out.encode()) < 20_000
    brief, whole = json.loads(ran.out), json.loads((tmp_path / "out" / "review.json").read_text(encoding="utf-8"))
    assert brief["schema"] == "rotorid.brief/1"
    assert [answer["state"] for answer in brief["answers"]] == [card["state"] for card in whole["cards"]]
    assert brief["next_commands"] == whole["next_commands"]


def test_the_brief_is_json_only(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("review", flight, "--out", tmp_path / "out", "--brief")
    assert ran.code == 2
    assert ran.err == "rotorid: --brief shortens the JSON; add --json.\n"
    assert not (tmp_path / "out").exists()


def test_many_logs_fit_on_a_screen_with_what_to_look_at_first(capsys: pytest.CaptureFixture[str]) -> None:
    many = [replace(made_review(), name=f"{place}.ulg") for place in range(30)]
    _print_several(many)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= MOST_LINES
    assert "30 logs" in lines
    looks = [line for line in lines if line.startswith("  0.ulg: ") and "?" in line]
    assert bool(looks) == (lines[0] == "look here")


def test_a_log_alone_is_reviewed(flight: Path, tmp_path: Path) -> None:
    ran = rotorid(flight, "--no-models", "--out", tmp_path / "out")
    assert ran.code == 0
    assert "Do roll and pitch follow the stick?" in ran.out
    assert "could be measured: -v lists what to fly or log" in ran.out
    assert ran.out.count("\n") <= MOST_LINES
    assert f"page: {tmp_path / 'out' / 'review.html'}" in ran.out


def test_a_screen_shows_the_worst_warnings_and_counts_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    stamps = [warn("clock_disorder", f"flight {n}", f"{n}00 stamps step back.") for n in range(1, 4)]
    others = [warn(f"kind_{n}", "flight", f"Number {n}.") for n in range(9)]
    gone = refusal("corrupt_log", "flight", "318 places are damaged.")
    review = replace(made_review(), findings=(remark("trim", "p", "Nothing."), *stamps, *others, gone))
    _print(review, Path("flight.ulg"))
    shown = capsys.readouterr().out
    assert shown.count("\n") <= MOST_LINES
    warnings = shown.partition("error ")[2].splitlines()
    assert warnings[0] == "corrupt_log: 318 places are damaged."
    assert warnings[1] == "warning clock_disorder (worst of 3): 300 stamps step back."
    assert warnings[4] == "9 more warnings: -v shows all, or open review.html"
    assert "Nothing." not in shown
    _print(review, Path("flight.ulg"), verbose=True)
    everything = capsys.readouterr().out
    assert all(finding.message in everything for finding in review.findings)
    assert all(gap.why in everything for gap in review.cannot_tell)


def test_a_folder_is_its_logs_side_by_side(flight: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("a.csv", "b.csv"):
        (logs / name).write_bytes(flight.read_bytes())
    (logs / "notes.md").write_text("no log", encoding="utf-8")
    ran = rotorid("review", logs, "--no-models", "--out", tmp_path / "out", "--json")
    told = json.loads(ran.out)
    assert told["schema"] == "rotorid.reviews/1"
    assert [one["name"] for one in told["reviews"]] == ["a.csv", "b.csv"]
    assert "Side by side" in (tmp_path / "out" / "review.html").read_text(encoding="utf-8")


@pytest.fixture
def untidy(flight: Path, tmp_path: Path) -> Path:
    """A folder of a log among files that are none."""
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "flight.csv").write_bytes(flight.read_bytes())
    (logs / "LASTLOG.TXT").write_text("7\n", encoding="utf-8")
    (logs / "notes.txt").write_text("windy, two batteries\n", encoding="utf-8")
    (logs / "photo.jpg").write_bytes(b"\xff\xd8\xff\xe0")
    (logs / "weights.csv").write_text("part,grams\nframe,120\n", encoding="utf-8")
    return logs


@pytest.mark.parametrize("command", [("review", "--no-models"), ("inspect",)])
def test_what_is_no_log_in_a_folder_is_skipped_and_named_once(
    command: tuple[str, ...], untidy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = rotorid(*command, untidy)
    assert ran.code == 0
    (said,) = [line for line in ran.err.splitlines() if "skipped" in line]
    assert "skipped 4 files that are no logs: LASTLOG.TXT, notes.txt, photo.jpg, weights.csv" in said
    assert "flight.csv" in ran.out
    if "review" in command:
        assert [folder.name for folder in (tmp_path / "rotorid-out").iterdir()] == ["flight-review"]


def test_a_folder_of_one_log_is_inspected_as_that_log(untidy: Path, tmp_path: Path) -> None:
    ran = rotorid("inspect", untidy, "--out", tmp_path / "seen", "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["name"] == "flight.csv"
    assert json.loads(rotorid("inspect", untidy, "--json").out)["name"] == "flight.csv"
    assert (tmp_path / "seen" / "inspect.json").is_file()
    (untidy / "second.csv").write_bytes((untidy / "flight.csv").read_bytes())
    several = rotorid("inspect", untidy, "--out", tmp_path / "both")
    assert several.code == 2
    assert "a folder of several logs" in several.err


@pytest.mark.parametrize("command", ["review", "inspect"])
def test_a_file_named_by_itself_that_is_no_log_is_an_error(command: str, untidy: Path, tmp_path: Path) -> None:
    log, notes = untidy / "flight.csv", untidy / "notes.txt"
    assert rotorid(command, notes, log).code == 2
    log.unlink()
    ran = rotorid(command, untidy)
    assert ran.code == 2
    assert (
        "no flight log found, only 4 files that are no logs: LASTLOG.TXT, notes.txt, photo.jpg, weights.csv" in ran.err
    )


@pytest.mark.parametrize("output", [(), ("--json",)])
def test_inspect_goes_on_where_a_named_file_cannot_be_read_and_tells_by_its_code(
    output: tuple[str, ...], untidy: Path
) -> None:
    ran = rotorid("inspect", untidy / "notes.txt", untidy / "flight.csv", *output)
    assert ran.code == 2
    assert "notes.txt" in ran.err
    assert "flight.csv" in ran.out
    if output:
        (seen,) = json.loads(ran.out)["inspections"]
        assert seen["schema"] == "rotorid.inspect/1"


def test_inspect_of_files_that_are_all_none_is_one_error(untidy: Path) -> None:
    ran = rotorid("inspect", untidy / "notes.txt", untidy / "LASTLOG.TXT")
    assert (ran.code, ran.out) == (2, "")
    assert "none of 2 files can be read" in ran.err


def test_a_log_that_never_flew_tells_nothing_and_says_why(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 20.0, 0.01)
    write_csv(tmp_path / "bench.csv", time_s, {"p": np.zeros(time_s.size), "thrust_command": np.zeros(time_s.size)})
    ran = rotorid("review", tmp_path / "bench.csv", "--out", tmp_path / "out")
    assert ran.code == 1
    assert "not enough data for any answer" in ran.err
    assert "contains no flight" in (tmp_path / "out" / "review.html").read_text(encoding="utf-8")


def test_a_file_that_is_no_log_is_wrong_use(tmp_path: Path) -> None:
    (tmp_path / "letter.csv").write_text("dear pilot", encoding="utf-8")
    assert rotorid("review", tmp_path / "letter.csv", "--out", tmp_path / "out").code == 2
    assert rotorid(tmp_path / "missing.ulg").code == 2
    (tmp_path / "empty").mkdir()
    ran = rotorid("review", tmp_path / "empty")
    assert ran.code == 2
    assert "contains no flight log" in ran.err


def test_figures_are_files(flight: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures as files need matplotlib")
    ran = rotorid("review", flight, "--no-models", "--figures", "svg", "--out", tmp_path / "out", "--quiet")
    assert (ran.code, ran.out) == (0, "")
    figures = list((tmp_path / "out" / "figures").iterdir())
    assert figures
    assert all(path.read_text(encoding="utf-8").startswith("<?xml") for path in figures)
    assert rotorid("review", flight, "--figures", "bmp").code == 2


def test_inspect_takes_several_and_says_what_comes_next(flight: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_bytes(flight.read_bytes())
    ran = rotorid("inspect", flight, other, "--json")
    told = json.loads(ran.out)
    assert told["schema"] == "rotorid.inspections/1"
    assert [one["name"] for one in told["inspections"]] == [flight.name, "other.csv"]
    said = rotorid("inspect", flight).out
    assert f"rotorid review {flight}" in said
    assert f"rotorid identify {flight} --model rate.roll" in said
    assert rotorid("inspect", flight, other, "--plot", tmp_path / "a.html").code == 2
