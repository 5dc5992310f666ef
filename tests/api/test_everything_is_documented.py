"""Every option and every public name says what it is; what a name takes and gives stands in its docstring."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from typing import Any

import pytest
from tests.api.test_faces import PACKAGES
from typer.main import get_command

from rotorid.cli.app import COMMANDS, app

MANUAL = (Path(__file__).parents[2] / "docs" / "rotorid.1").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_says_what_it_does(name: str) -> None:
    group: Any = get_command(app)
    command = group.commands[name]
    assert (command.help or "").strip().endswith((".", ")"))
    for option in command.params:
        assert (getattr(option, "help", None) or "").strip(), (name, option.name)
        for written in option.opts:
            if written.startswith("--"):
                assert written.replace("-", r"\-") in MANUAL or written in MANUAL, (name, written)


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
