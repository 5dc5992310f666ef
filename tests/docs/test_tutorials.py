"""The tutorials: every block prints what the page shows, every command and every link on it exists."""

from __future__ import annotations

import doctest
import io
import re
from pathlib import Path

import pytest
import typer

from rotorid.cli.app import app

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
PAGES = sorted(FOLDER.glob("*.md"))
TUTORIALS = [page for page in PAGES if page.name != "README.md"]
PYTHON_PAGE = FOLDER.parent / "python.md"
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
LARGEST_PICTURE_BYTES = 150_000
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")


LONG = frozenset(
    {"paper-1-rig", "paper-2-s500", "paper-4-hummingbird", "paper-5-bebop", "plan-fly-identify", "my-drone"}
)
"""Ten seconds to half a minute each; the site executes all."""


def name_of(page: Path) -> str:
    return page.stem


def python_of(text: str) -> str:
    """A page of which only the Python blocks are left, each on its own lines."""
    kept = [""] * len(text.splitlines())
    for block in FENCED.finditer(text):
        if block[1] == "python":
            first = text.count("\n", 0, block.start(2))
            for number, line in enumerate(block[2].splitlines(), start=first):
                kept[number] = line
    return "\n".join(kept) + "\n"


def commands_of(text: str) -> list[str]:
    blocks = [block[2] for block in FENCED.finditer(text) if block[1] == "console"]
    lines = [line for block in blocks for line in block.splitlines()]
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ rotorid ")]


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow) if page.stem in LONG else page for page in (*TUTORIALS, PYTHON_PAGE)],
    ids=name_of,
)
def test_every_block_prints_what_the_page_shows(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    example = doctest.DocTestParser().get_doctest(python_of(text), {}, page.name, str(page), 0)
    assert len(example.examples) > 10
    said = io.StringIO()
    result = doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=said.write)
    assert result.failed == 0, said.getvalue()


@pytest.mark.parametrize("page", TUTORIALS, ids=name_of)
def test_every_command_has_the_options_it_is_given(page: Path) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    lines = commands_of(page.read_text(encoding="utf-8"))
    assert lines
    for line in lines:
        words = line.split()
        known = {option for parameter in commands[words[1]].params for option in parameter.opts}
        asked = {word for word in words if word.startswith("--")}
        assert asked <= known, f"{line}: {', '.join(sorted(asked - known))}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).is_file(), f"{page.name} links to {target}"


def test_the_index_lists_every_tutorial() -> None:
    linked = LINK.findall((FOLDER / "README.md").read_text(encoding="utf-8"))
    assert {page.name for page in TUTORIALS} <= set(linked)


def test_pictures_are_small_and_shown() -> None:
    shown = {(page.parent / target).resolve() for page in PAGES for target in LINK.findall(page.read_text("utf-8"))}
    pictures = list((FOLDER / "images").glob("*"))
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size <= LARGEST_PICTURE_BYTES
        assert picture.resolve() in shown
