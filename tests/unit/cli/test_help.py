"""Help leads on: examples that run, the options used most, and errors that say what to type."""

from __future__ import annotations

import functools
import re
import shlex
from importlib import import_module
from typing import Any

import pytest
from tests.unit.cli.commands import rotorid

from rotorid.cli.app import COMMANDS, Commands
from rotorid.cli.help import HELP
from rotorid.data import synonyms
from rotorid.exports.targets import TARGETS

CALLS = [(name, words) for name, helped in HELP.items() for words in helped.examples]


def options_of(name: str) -> set[str]:
    return {
        option
        for param in Commands()[name].params
        for option in (*param.opts, *param.secondary_opts)
        if option[:2] == "--"
    }


@pytest.mark.parametrize(("name", "words"), CALLS)
def test_every_example_is_a_call_that_the_command_takes(name: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = import_module(f"rotorid.cli.{name}")
    taken: list[dict[str, Any]] = []

    @functools.wraps(getattr(module, f"{name}_command"))
    def take(**given: Any) -> None:
        taken.append(given)

    monkeypatch.setattr(module, f"{name}_command", take)
    ran = rotorid(name, *shlex.split(words))
    assert (ran.code, ran.err) == (0, "")
    assert len(taken) == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_help_begins_with_three_examples_and_shows_at_most_ten_options(name: str) -> None:
    text = rotorid(name, "--help").out
    head, _, rest = text.partition("Examples:\n")
    examples = rest.splitlines()[:3]
    assert len(head.splitlines()) < 9
    assert [line.strip() for line in examples] == [f"rotorid {name} {words}".strip() for words in HELP[name].examples]
    used = HELP[name].options.split()
    assert len(used) <= 10
    assert set(used) <= options_of(name)
    assert used or len(options_of(name)) <= 16
    assert set(HELP[name].missing) <= options_of(name)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_all_lists_every_option(name: str) -> None:
    ran = rotorid(name, "--help-all")
    assert ran.code == 0
    assert set(re.findall(r"--[\w-]+", ran.out)) >= options_of(name)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_offers_all_options_only_where_it_leaves_some_out(name: str) -> None:
    text = rotorid(name, "--help").out
    shown = set(re.findall(r"^ +(?:-\w, )?(--[\w-]+)", text, flags=re.MULTILINE))
    every = set(re.findall(r"^ +(?:-\w, )?(--[\w-]+)", rotorid(name, "--help-all").out, flags=re.MULTILINE))
    assert ("--help-all" in shown) == bool(every - shown - {"--help-all"})


def test_the_usage_line_says_that_a_log_is_enough() -> None:
    assert rotorid("--help").out.startswith("Usage: rotorid LOG...")


def test_every_synonym_leads_to_what_there_is() -> None:
    assert set(synonyms.COMMANDS.values()) <= {*COMMANDS, "--version", "--help"}
    assert not set(synonyms.COMMANDS) & set(COMMANDS)
    assert {part for target in synonyms.TARGETS.values() for part in target.split(" or ")} <= set(TARGETS)
    assert not set(synonyms.TARGETS) & set(TARGETS)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("identify a.ulg", "missing --model; try --model all, or see rotorid identify --help"),
        ("identify", "missing LOG; see rotorid identify --help"),
        ("analyze a.ulg", "unknown command 'analyze'; did you mean review?"),
        ("bode a.ulg", "unknown command 'bode'; did you mean response?"),
        ("autotune a.ulg", "unknown command 'autotune'; did you mean tune?"),
        ("version", "unknown command 'version'; did you mean --version?"),
        ("indentify a.ulg", "unknown command 'indentify'; did you mean identify?"),
        ("logs/none.xyz", "'logs/none.xyz' is no file and no command; rotorid --help lists the commands."),
        ("identify a.ulg --modle all", "unknown option --modle; did you mean --model?"),
        ("identify a.ulg --zzzzz all", "unknown option --zzzzz; see rotorid identify --help-all."),
        ("identify a.ulg --model all --seed x", "--seed needs a whole number."),
        ("identify a.ulg --model", "--model needs a value; see rotorid identify --help."),
        ("doctor now", "unexpected argument now; see rotorid doctor --help."),
    ],
)
def test_an_error_says_what_to_type(words: str, said: str) -> None:
    ran = rotorid(*words.split())
    assert ran.code == 2
    assert ran.err.strip().removeprefix("rotorid: ").rstrip(".") == said.rstrip(".")
