"""The page of the five papers: every line has a run, every command exists, and all of them run."""

from __future__ import annotations

import json
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer
from typer.testing import CliRunner

from rotorid.cli.app import app
from rotorid.data import KINDS
from rotorid.models import model_names, nonlinear_model_names
from rotorid.search import search
from rotorid.vehicles.catalog import VEHICLES

PAGE = Path(__file__).resolve().parents[2] / "docs" / "papers.md"
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
NAMED = re.compile(r"- `([^`]+)`: (.*)")
DIFFERENT = "\nDifferent on purpose:\n"
GENERAL = re.compile(r"transfer:\d+/\d+|black_box:(?:\d+|auto)(?:\+delay)?")
FILES = (".csv", ".html", ".json", ".npz", ".pdf", ".tex", ".toml", ".ulg")


class Item(NamedTuple):
    """An item of a paper, and the run that gives it: a folder, a short command or Python."""

    paper: str
    run: str
    text: str

    @property
    def command(self) -> str:
        """The command of the run: in full, or that which writes the folder; else an expression of Python."""
        return self.run if self.run.startswith("rotorid ") else written().get(self.run, self.run)


@cache
def sections() -> list[tuple[str, str]]:
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return [(part.partition("\n")[0], part) for part in parts if part.startswith("Paper ")]


def items() -> list[Item]:
    """Items of all lists: of the folder at their beginning, or else of the command above."""
    found = []
    for title, part in sections():
        last = ""
        for line in part.partition(DIFFERENT)[0].splitlines():
            if line.startswith("$ rotorid "):
                last = folder_of(line)
            if line.startswith("- "):
                named = NAMED.match(line)
                found.append(Item(title, named[1], named[2]) if named else Item(title, last, line[2:]))
    return found


def steps(part: str) -> list[str]:
    """Commands and blocks of Python of a section, in their order."""
    found = []
    for language, text in BLOCK.findall(part):
        lines = [line.removeprefix("$ ") for line in text.splitlines() if line.startswith("$ rotorid ")]
        found += [text] if language == "python" else lines
    return found


def commands() -> list[str]:
    """Every command of the page once."""
    found = [step for _, part in sections() for step in steps(part)] + [item.run for item in items()]
    return [command for command in dict.fromkeys(found) if command.startswith("rotorid ")]


def folder_of(command: str) -> str:
    words = shlex.split(command)
    return words[words.index("--out") + 1] if "--out" in words else ""


@cache
def written() -> dict[str, str]:
    """Folders and the commands that write them."""
    return {folder_of(command): command for _, part in sections() for command in steps(part) if folder_of(command)}


def is_python(item: Item) -> bool:
    return "(" in item.run


def test_every_item_names_a_run_of_its_section() -> None:
    for title, part in sections():
        own = {folder_of(step) for step in steps(part) if step.startswith("rotorid ")} - {""}
        runs = [item.run for item in items() if item.paper == title and not is_python(item)]
        assert len(runs) > 20
        assert [run for run in runs if not run.startswith("rotorid ") and run not in own] == []


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
    values = [value] if isinstance(value, str) else list(value or ())
    return [name for one in values for name in str(one).split(",")]


def is_a_model(name: str) -> bool:
    known = {*model_names(), *nonlinear_model_names(), "physical.motors"}
    return name in known or name.startswith("response.") or GENERAL.fullmatch(name) is not None


def test_a_folder_is_written_by_one_command() -> None:
    folders = [folder_of(command) for command in commands() if folder_of(command)]
    assert sorted(folders) == sorted(set(folders))


def run(command: str) -> None:
    ran = CliRunner().invoke(app, shlex.split(command)[1:], catch_exceptions=False)
    assert ran.exit_code == 0, f"{command}: {ran.output}"


def has_field(document: Any, path: str) -> bool:
    """Whether a document has, somewhere, a field that is reached by these names."""
    if isinstance(document, list):
        return any(has_field(one, path) for one in document)
    if not isinstance(document, dict):
        return False
    first, _, rest = path.partition(".")
    if first in document and (not rest or document[first] is None or has_field(document[first], rest)):
        return True
    return any(has_field(value, path) for value in document.values())


def misses(item: Item) -> list[str]:
    """What an item names that its command has not left in the folder it wrote."""
    folder = Path(folder_of(item.command)) if item.command.startswith("rotorid ") else Path()
    if folder == Path():
        return []
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in folder.rglob("*.json")]
    missed = []
    for place in CODE.findall(item.text):
        if place.startswith(("rotorid", "--")) or place in KINDS:
            continue
        is_file = "/" in place or place.endswith(FILES)
        there = (folder / place).exists() if is_file else any(has_field(one, place) for one in documents)
        missed += [] if there else [f"{item.text}: {place}"]
    return missed


def of_paper(title: str) -> tuple[list[str], list[Item]]:
    """Steps of a section, short commands of its items, and these items."""
    own = [item for item in items() if item.paper == title]
    short = [item.run for item in own if item.run.startswith("rotorid ")]
    return list(dict.fromkeys([*steps(dict(sections())[title]), *short])), own


def is_quick(command: str) -> bool:
    slow = ("--figures", "design", "--bootstrap", "kmeans:5", "--composition")
    return command.startswith("rotorid ") and not any(word in command for word in slow)


@pytest.mark.slow
def test_quick_commands_run_and_write_what_their_lines_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    chosen, own = of_paper(sections()[0][0])
    for command in filter(is_quick, chosen):
        run(command)
    assert [missed for item in own if is_quick(item.command) for missed in misses(item)] == []


@pytest.mark.slow
@pytest.mark.parametrize("title", [title for title, _ in sections()], ids=lambda title: str(title).partition(":")[0])
def test_every_command_runs_and_writes_what_its_lines_name(
    title: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    chosen, own = of_paper(title)
    given: dict[str, Any] = {}
    for step in chosen:
        if step.startswith("rotorid "):
            run(step)
        else:
            exec(step, given)
    assert [missed for item in own for missed in misses(item)] == []
    for item in filter(is_python, own):
        assert eval(item.run, given) is not None, item.text


def test_every_paper_has_its_section() -> None:
    assert [title.partition(":")[0] for title, _ in sections()] == [f"Paper {number}" for number in range(1, 6)]
    assert all(DIFFERENT in part for _, part in sections())
