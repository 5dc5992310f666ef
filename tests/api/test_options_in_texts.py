"""An option that a text of the library names is one of the reader's command, or comes with the command that has it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.sources import nodes

from rotorid.cli.app import Commands
from rotorid.settings.verbs import OPTION, VERBS, with_verbs

SOURCE = Path(__file__).resolve().parents[2] / "src" / "rotorid"
OF_EVERY_COMMAND = {"--force", "--json", "--quiet", "--out", "--verbose", "--help", "--version"}
OF_OTHER_PROGRAMS = {
    *("--force-reinstall", "--save-headers", "--msgtype", "--mjcf", "--add-param-file", "--upgrade"),
    *("--host-resolver-rules", "--print-to-pdf", "--user-data-dir", "--virtual-time-budget"),
}
BEGINNINGS = {"--correct", "--no"}
"""Of options whose end is filled in."""

OF_REVIEW_ALONE = {"--baseline", "--brief"}
"""Texts that only review shows."""

COMMANDS = Commands()


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """Option to the commands that have it."""
    found: dict[str, set[str]] = {}
    for name in COMMANDS:
        for parameter in COMMANDS[name].params:
            for option in (*parameter.opts, *parameter.secondary_opts):
                found.setdefault(option, set()).add(name)
    return found


def named_options() -> Iterator[tuple[str, str]]:
    """Each option in a text of the source, docstrings aside, with its place."""
    for path in SOURCE.rglob("*.py"):
        silent = {id(node.value) for node in nodes(path) if isinstance(node, ast.Expr)}
        for node in nodes(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
                for option in OPTION.findall(node.value):
                    if option != node.value.strip():
                        yield option, f"{path.relative_to(SOURCE)}:{node.lineno}"


def test_every_option_in_a_text_is_one_of_a_command_that_the_table_knows() -> None:
    unknown = [
        f"{place} {option}"
        for option, place in named_options()
        if option not in VERBS and option not in OF_EVERY_COMMAND | OF_OTHER_PROGRAMS | BEGINNINGS | OF_REVIEW_ALONE
    ]
    assert not unknown


def test_the_table_is_that_of_the_command_line(options: dict[str, set[str]]) -> None:
    assert {option: set(verbs) for option, verbs in VERBS.items()} == {option: options[option] for option in VERBS}


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_no_text_sends_a_reader_to_an_option_that_his_command_lacks(verb: str, options: dict[str, set[str]]) -> None:
    for option in VERBS:
        text = with_verbs(f"do it with {option}", verb)
        assert verb in options[option] or text.endswith(f"(rotorid {VERBS[option][0]})")
