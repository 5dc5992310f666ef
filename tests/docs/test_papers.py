"""The checklist of the five papers: every line has a command, every command exists, and they run."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from rotorid.cli.app import app
from rotorid.data import KINDS
from rotorid.models import model_names, nonlinear_model_names
from rotorid.search import search
from rotorid.vehicles.catalog import VEHICLES

PAGE = Path(__file__).resolve().parents[2] / "docs" / "papers.md"
MISSING = "**not yet**"
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
GENERAL = re.compile(r"transfer:\d+/\d+|black_box:(?:\d+|auto)(?:\+delay)?")
FILES = (".csv", ".html", ".json", ".npz", ".pdf", ".tex", ".toml", ".ulg")
NUMBERS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True)
class Row:
    """A line of a table: what a paper has, how it is done here, and where the result stands."""

    paper: str
    what: str
    how: str
    where: str

    @property
    def command(self) -> str:
        return self.how.strip("`") if self.how.startswith("`") else ""


def sections() -> list[tuple[str, str]]:
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return [(part.partition("\n")[0], part) for part in parts if part.startswith("Paper ")]


def rows() -> list[Row]:
    found = []
    for title, part in sections():
        for line in part.splitlines():
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            if line.startswith("| ") and len(cells) == 3 and cells[1] != "command":
                found.append(Row(title, *cells))
    return found


def flights(part: str) -> list[str]:
    """Commands that fly what a section is tried on."""
    return [line.removeprefix("$ ") for line in part.splitlines() if line.startswith("$ rotorid ")]


def commands() -> list[str]:
    """Every command of the page once, in an order in which they can run."""
    found = []
    for title, part in sections():
        found += flights(part) + [row.command for row in rows() if row.paper == title]
    return [command for command in dict.fromkeys(found) if command.startswith("rotorid ")]


def python_lines() -> list[Row]:
    return [row for row in rows() if row.command and not row.command.startswith("rotorid ")]


def test_no_line_is_without_a_command_but_those_that_are_counted() -> None:
    missing = [row.what for row in rows() if not row.command]
    assert [row.how for row in rows() if not row.command] == [MISSING] * len(missing)
    said = re.findall(r"(\d+) lines, (\w+) of them without a command", PAGE.read_text(encoding="utf-8"))
    assert said == [(str(len(rows())), NUMBERS[len(missing)] if len(missing) < len(NUMBERS) else str(len(missing)))]


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
        assert name in VEHICLES or "/" in name or name in outs(), name


def _listed(value: Any) -> list[str]:
    values = [value] if isinstance(value, str) else list(value or ())
    return [name for one in values for name in str(one).split(",")]


def is_a_model(name: str) -> bool:
    known = {*model_names(), *nonlinear_model_names(), "physical.motors"}
    return name in known or name.startswith("response.") or GENERAL.fullmatch(name) is not None


def outs() -> set[str]:
    """Folders that commands of the page write."""
    return {words[words.index("--out") + 1] for words in map(shlex.split, commands()) if "--out" in words}


def test_a_folder_is_written_by_one_command() -> None:
    written = [words[words.index("--out") + 1] for words in map(shlex.split, commands()) if "--out" in words]
    assert sorted(written) == sorted(set(written))


def run(command: str) -> None:
    ran = CliRunner().invoke(app, shlex.split(command)[1:], catch_exceptions=False)
    assert ran.exit_code == 0, f"{command}: {ran.output}"


def holds(document: Any, path: str) -> bool:
    """Whether a document has, somewhere, a field that is reached by these names."""
    if isinstance(document, list):
        return any(holds(one, path) for one in document)
    if not isinstance(document, dict):
        return False
    first, _, rest = path.partition(".")
    if first in document and (not rest or document[first] is None or holds(document[first], rest)):
        return True
    return any(holds(value, path) for value in document.values())


def misses(row: Row) -> list[str]:
    """What a line names that its command has not left in the folder it wrote."""
    words = shlex.split(row.command)
    if "--out" not in words:
        return []
    folder = Path(words[words.index("--out") + 1])
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in folder.rglob("*.json")]
    missed = []
    for place in CODE.findall(row.where):
        if place.startswith(("rotorid", "--")) or place in KINDS:
            continue
        is_file = "/" in place or place.endswith(FILES)
        there = (folder / place).exists() if is_file else any(holds(one, place) for one in documents)
        missed += [] if there else [f"{row.what}: {place}"]
    return missed


def of_paper(title: str) -> tuple[list[str], list[Row]]:
    """Commands of a section in their order, each once, and its lines that have one."""
    lines = [row for row in rows() if row.paper == title and row.command.startswith("rotorid ")]
    part = dict(sections())[title]
    return list(dict.fromkeys([*flights(part), *(row.command for row in lines)])), lines


def is_quick(command: str) -> bool:
    return not any(word in command for word in ("--figures", "design", "--bootstrap", "kmeans:5", "--composition"))


@pytest.mark.slow
def test_quick_commands_run_and_write_what_their_lines_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    chosen, lines = of_paper(sections()[0][0])
    for command in filter(is_quick, chosen):
        run(command)
    assert [missed for row in lines if is_quick(row.command) for missed in misses(row)] == []


@pytest.mark.slow
@pytest.mark.parametrize("title", [title for title, _ in sections()], ids=lambda title: str(title).partition(":")[0])
def test_every_command_runs_and_writes_what_its_lines_name(
    title: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    part, (chosen, lines) = dict(sections())[title], of_paper(title)
    flown = flights(part)
    for command in flown:
        run(command)
    given: dict[str, Any] = {}
    # Blocks take what was flown, and may write what later lines take.
    for block in PYTHON.findall(part):
        exec(block, given)
    for command in chosen:
        if command not in flown:
            run(command)
    assert [missed for row in lines for missed in misses(row)] == []
    for row in python_lines():
        if row.paper == title:
            assert eval(row.command, given) is not None, row.what


def test_every_table_has_its_lines() -> None:
    assert [title.partition(":")[0] for title, _ in sections()] == [f"Paper {number}" for number in range(1, 6)]
    for title, part in sections():
        assert len([row for row in rows() if row.paper == title]) > 25
        assert "Different on purpose:" in part
