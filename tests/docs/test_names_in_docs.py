"""What the pages name is there: modules, functions, files; and their examples take public faces only."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import typer
from tests.sources import syntax

from rotorid.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md"])
DOTTED = re.compile(r"(?<![/\w.-])rotorid(?!\.toml\b)((?:\.[A-Za-z_]\w*+)++)(?!/\d|-\d)")
SHORT = re.compile(r"`(?!rotorid\.|model\.|response\.)(?:[a-z_]\w*\.){2,}([A-Za-z_]\w*)(?:\([^`]*\))?`")
"""A name of three parts and more that does not begin with the package, nor with a value such as ``model``."""

PATH = re.compile(r"(?:src/rotorid|tests|benchmarks|docs)/[\w./-]+\w")
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")
"""A link to a file or to a heading of one."""

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ALONE = {"rotorid.errors", "rotorid.frames", "rotorid.typing", "rotorid.units"}
"""Modules that are their own face."""

STANDING_FOR = {
    *(
        # A stub, which only editors and type checkers read.
        "rotorid.settings.option_types",
        "rotorid.progress",
        "rotorid.help_all",
        "rotorid.cli.NAME",
        "rotorid.result",
        "rotorid.flown",
        "rotorid.tune_check",
    ),
    "rotorid.io.logger_x",
}
"""A logger, a setting, any command, how some schemas begin, a format that is added."""

GENERATED = ("commands/", "api/", "schemas.md")
"""Links to pages that only the site has."""

EXAMPLES = re.compile(r"docs/(?:my|your)|[/_](?:NAME|PACKAGE|MODULE|PAGE)\b")
"""Paths that stand for any."""


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@cache
def defined() -> frozenset[str]:
    """Functions and classes of all modules; every worker collects this file, and one of them needs to know."""
    return frozenset(
        node.name
        for path in (ROOT / "src").rglob("*.py")
        for node in syntax(path).body
        if isinstance(node, (ast.FunctionDef, ast.ClassDef))
    )


def exists(dotted: str) -> bool:
    """Whether the longest importable beginning of a name has the rest as attributes."""
    parts = dotted.split(".")
    for known in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:known]))
        except ModuleNotFoundError:
            continue
        for part in parts[known:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def is_face(module: str, name: str) -> bool:
    """Whether a page may take ``name`` from ``module``: it is on the face of a package, or a module like a vehicle."""
    if module in ALONE:
        return True
    found = importlib.import_module(module)
    return hasattr(found, "__path__") and name in getattr(found, "__all__", ())


def imports(source: str) -> Iterator[tuple[str, str]]:
    """``(module, name)`` of every import of the package; the name is empty for ``import rotorid``."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] == "rotorid":
            yield from ((str(node.module), name.name) for name in node.names)
        if isinstance(node, ast.Import):
            yield from ((name.name, "") for name in node.names if name.name.partition(".")[0] == "rotorid")


def code_of(block: str) -> str:
    """The statements of a block, whether it is written as a session or as a script."""
    examples = doctest.DocTestParser().get_examples(block)
    return "".join(example.source for example in examples) if examples else block


@pytest.mark.filterwarnings("ignore:rotorid:DeprecationWarning")  # the list of changes names what will be removed
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_dotted_name_exists(page: Path) -> None:
    named = {f"rotorid{match[1]}" for match in DOTTED.finditer(page.read_text("utf-8"))}
    assert not sorted(name for name in named - STANDING_FOR if not exists(name))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_of_the_package_are_written_in_full(page: Path) -> None:
    """A path without ``rotorid`` in front goes stale unseen when modules move."""
    assert not [match[0] for match in SHORT.finditer(page.read_text("utf-8")) if match[1] in defined()]


def test_every_dotted_name_in_the_source_exists() -> None:
    named = {
        f"rotorid{match[1]}"
        for path in (ROOT / "src").rglob("*.py")
        for match in DOTTED.finditer(path.read_text("utf-8"))
    }
    assert not sorted(name for name in named - STANDING_FOR if not exists(name))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_path_exists(page: Path) -> None:
    named = {match[0] for match in PATH.finditer(page.read_text("utf-8"))}
    there = (ROOT, page.parent)
    assert not sorted(
        path for path in named if not EXAMPLES.search(path) and not any((root / path).exists() for root in there)
    )


def headings(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub and the site make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    # The site puts pages of these folders into the folder of its first page.
    folders = [ROOT / "docs", ROOT / "docs/site/pages"] if name_of(page) == "docs/site/index.md" else [page.parent]
    missing = []
    for target, anchor in LINK.findall(text):
        file = next((folder / target for folder in folders if (folder / target).exists()), None) if target else page
        if file is None or (anchor and anchor not in headings(file)):
            missing.append(f"{target}#{anchor}" if anchor else target)
    assert not [link for link in missing if not link.startswith(GENERATED)]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_has_the_options_it_is_given(page: Path) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    blocks = re.findall(r"^ *```(?:console|sh)?\n(.*?)^ *```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    for line in (line.strip().removeprefix("$ ") for block in blocks for line in block.splitlines()):
        words = line.partition("#")[0].split()
        if words[:1] == ["rotorid"] and words[1:] and words[1] in commands:
            taken = commands[words[1]].params
            known = {option for one in taken for option in (*one.opts, *one.secondary_opts)}
            asked = {word for word in words if word.startswith("--")}
            assert asked <= known, f"{line}: {', '.join(sorted(asked - known))}"


@pytest.mark.parametrize("page", [page for page in PAGES if BLOCK.search(page.read_text("utf-8"))], ids=name_of)
def test_every_block_imports_faces_only(page: Path) -> None:
    blocks = [code_of(block[1]) for block in BLOCK.finditer(page.read_text("utf-8"))]
    deep = [(module, name) for block in blocks for module, name in imports(block) if not is_face(module, name)]
    assert not [taken for taken in deep if taken != ("rotorid", "")]
