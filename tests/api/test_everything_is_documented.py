"""Every option, every public name and every public method says what it is, in a line of its own."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

import pytest
from tests.api.test_faces import PACKAGES
from typer.main import get_command

from rotorid.cli.app import COMMANDS, app

SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.MULTILINE | re.DOTALL)
ELSEWHERE = re.compile(r"[Pp]arameters (?:and errors )?are those of :func:")

MANUAL = (Path(__file__).parents[2] / "docs" / "rotorid.1").read_text(encoding="utf-8")
SECTIONS = {part.split("\n", 1)[0]: part for part in MANUAL.split("\n.SS ")[1:]}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_says_what_it_does(name: str) -> None:
    group: Any = get_command(app)
    command = group.commands[name]
    written = {word for line in re.findall(r"^\.B (.*)$", SECTIONS[name], re.MULTILINE) for word in line.split(", ")}
    assert (command.help or "").strip().endswith((".", ")"))
    for option in command.params:
        assert (getattr(option, "help", None) or "").strip(), (name, option.name)
        for word in option.opts:
            if word.startswith("--"):
                assert any(one.split(" ")[0] == word.replace("-", r"\-") for one in written), (name, word)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_says_what_it_is(package: str) -> None:
    module = importlib.import_module(package)
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.ismodule(value) or not (inspect.isclass(value) or inspect.isfunction(value)):
            continue
        text = inspect.getdoc(value) or ""
        assert text.strip(), (package, name)
        assert "\n" not in text.strip().splitlines()[0]
        assert not text.startswith(f"{name}("), f"{package}.{name} has only what its fields are"
        if inspect.isclass(value):
            for called, method in vars(value).items():
                of_class = isinstance(method, classmethod | staticmethod)
                function = method.__func__ if of_class else method
                # A property is named after what it gives.
                if not called.startswith("_") and inspect.isfunction(function):
                    assert inspect.getdoc(function), (package, name, called)


def described(text: str) -> set[str]:
    """Names in the section of parameters of a docstring."""
    section = SECTION.search(text)
    heads = [line for line in section[1].splitlines() if line and not line[0].isspace()] if section else []
    return {name.strip().lstrip("*") for line in heads for name in line.split(",")}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_parameter_of_a_public_function_is_described(package: str) -> None:
    module = importlib.import_module(package)
    for name in module.__all__:
        function = getattr(module, name)
        if not inspect.isfunction(function):
            continue
        text = inspect.getdoc(function) or ""
        # Keywords of a verb are fields of its settings, whose class describes them.
        missing = set(inspect.signature(inspect.unwrap(function)).parameters) - described(text)
        assert not missing or ELSEWHERE.search(text), (package, name, sorted(missing))
