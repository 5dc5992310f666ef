"""The page of the five papers: every line is proved by value, every command exists, and all of them run.

``ROTORID_PAPERS`` names a folder that keeps the runs of the slow tests (:mod:`tests.docs.papers_page`).
"""

from __future__ import annotations

import os
import re
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import typer
from tests.docs.papers_checks import WIDE, Line
from tests.docs.papers_page import DIFFERENT, Runs, commands, folder_of, items, sections, steps, written
from tests.docs.papers_values import PAPERS, VALUES, usual_share, values

from rotorid.cli.app import app
from rotorid.models import model_names, nonlinear_model_names
from rotorid.search import search
from rotorid.vehicles.catalog import VEHICLES

GENERAL = re.compile(r"transfer:\d+/\d+|black_box:(?:\d+|auto)(?:\+delay)?")
CHEAP = ("rotorid models", "rotorid vehicles s500", "rotorid vehicles hummingbird")
LINES = [line for lines in PAPERS.values() for line in lines]


def test_every_item_names_a_run_of_its_section() -> None:
    for title, part in sections():
        own = {folder_of(step) for step in steps(part) if step.startswith("rotorid ")} - {""}
        runs = [item.run for item in items() if item.paper == title and not item.is_python]
        assert len(runs) > 20
        assert [run for run in runs if not run.startswith("rotorid ") and run not in own] == []


def test_every_line_of_the_page_has_one_check_and_every_check_a_line() -> None:
    held = {
        (line.run, line.item): [one for one in items() if one.run == line.run and one.text.startswith(line.item)]
        for line in LINES
    }
    assert [key for key, found in held.items() if len(found) != 1] == []
    proved = Counter(found[0] for found in held.values())
    assert [item.text for item in items() if proved[item] != 1] == []
    assert len(held) == len(LINES)


def test_a_line_is_no_count_of_nothing() -> None:
    # A number is compared with a truth, with print or with a bound of a rule.
    for number in (one for line in LINES for one in line.numbers):
        assert any(one is not None for one in (number.truth, number.paper, number.most, number.least)), number.what


def is_cheap(line: Line) -> bool:
    return line.run.startswith(CHEAP) and "--from" not in line.run


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return Runs(tmp_path_factory.mktemp("papers"))


@pytest.mark.parametrize("line", [line for line in LINES if is_cheap(line)], ids=lambda line: line.run)
def test_a_cheap_line_holds(line: Line, quick: Runs) -> None:
    line.prove(quick)


@pytest.mark.parametrize("command", commands())
def test_a_command_has_the_options_and_names_it_is_given(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    verb, *words = shlex.split(command)[1:]
    parsed = typer.main.get_command(app).commands[verb]  # type: ignore[attr-defined]
    given = parsed.make_context(verb, words).params
    for name in _listed(given.get("model")):
        assert is_a_model(name), name
    for name in _listed(given.get("search")):
        search(name)
    for name in _listed(given.get("vehicle")):
        assert name in VEHICLES or "/" in name or name in written(), name


def _listed(value: Any) -> list[str]:
    texts = [value] if isinstance(value, str) else list(value or ())
    return [name for one in texts for name in str(one).split(",")]


def is_a_model(name: str) -> bool:
    known = {*model_names(), *nonlinear_model_names(), "physical.motors"}
    return name in known or name.startswith("response.") or GENERAL.fullmatch(name) is not None


def test_a_folder_is_written_by_one_command() -> None:
    folders = [folder_of(command) for command in commands() if folder_of(command)]
    assert sorted(folders) == sorted(set(folders))


def test_every_paper_has_its_section() -> None:
    assert [title.partition(":")[0] for title, _ in sections()] == list(PAPERS)
    assert all(DIFFERENT in part for _, part in sections())


def test_the_table_has_the_numbers_of_every_line_that_is_not_pending() -> None:
    shown = VALUES.read_text(encoding="utf-8")
    wanted = {line.run for line in LINES if line.numbers and not line.pending and "(" not in line.run}
    assert [run for run in wanted if run not in shown] == []


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    kept = os.environ.get("ROTORID_PAPERS")
    return Runs(Path(kept) if kept else tmp_path_factory.mktemp("papers"))


def proved(line: Line) -> Any:
    marks = [pytest.mark.xfail(strict=True, raises=AssertionError, reason=line.pending)] if line.pending else []
    return pytest.param(line, marks=[pytest.mark.slow, *marks], id=f"{line.run}: {line.item}".replace("::", ":"))


@pytest.mark.parametrize("line", [proved(line) for line in LINES])
def test_a_line_gives_what_it_says(line: Line, runs: Runs) -> None:
    runs.before(line.run)
    line.prove(runs)


@pytest.mark.slow
def test_the_table_is_that_of_the_runs(runs: Runs) -> None:
    assert VALUES.read_text(encoding="utf-8") == values(runs)


@pytest.mark.slow
def test_nine_of_ten_numbers_are_within_their_usual_interval(runs: Runs) -> None:
    # Each by itself may be as far as WIDE deviations off.
    assert WIDE > 2.0
    assert usual_share(runs) >= 0.9
