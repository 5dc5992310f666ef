"""What the shell completes: commands, options, and the words that an option or an argument takes."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest
import typer

from rotorid.cli.app import app

SHELLS = ("bash", "zsh", "fish")


def asked(shell: str, words: str) -> dict[str, str]:
    """How a shell asks for what may follow a line that ends behind the last letter."""
    count = len(words.split()) - 1 if not words.endswith(" ") else len(words.split())
    line = {
        "bash": {"COMP_WORDS": words, "COMP_CWORD": str(count)},
        "zsh": {"_TYPER_COMPLETE_ARGS": words},
        "fish": {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
    }[shell]
    return {**line, "_ROTORID_COMPLETE": f"complete_{shell}"}


def told(shell: str, words: str) -> str:
    """What the installed program tells a shell."""
    program, environment = Path(sys.executable).with_name("rotorid"), {**os.environ, **asked(shell, words)}
    return subprocess.run([program], env=environment, capture_output=True, text=True, check=False, timeout=60).stdout


def completed(shell: str, words: str) -> str:
    """The same without a process for each line."""
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out):
        for name, value in asked(shell, words).items():
            patch.setenv(name, value)
        with pytest.raises(SystemExit):
            typer.main.get_command(app).main([], prog_name="rotorid")
    return out.getvalue()


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_completes_commands_options_and_values(shell: str) -> None:
    commands = told(shell, "rotorid id")
    assert "identify" in commands
    assert completed(shell, "rotorid id") == commands
    assert "--taper" in completed(shell, "rotorid identify --ta")
    assert "half_sine" in completed(shell, "rotorid identify --taper ")
    examples = completed(shell, "rotorid example ")
    assert all(name in examples for name in ("px4", "ardupilot", "betaflight", "rig", "bebop"))


@pytest.mark.parametrize(
    ("words", "expected"),
    [("identify --model rate.roll,rate.p", ["rate.roll,rate.pitch"]), ("identify --curve q", ["quadratic"]),
     ("simulate px4", ["px4_quad"]), ("simulate px4_quad --format b", ["bin", "bbl"]),
     ("export result --to px4", ["px4-sih"]), ("tune log --axes roll,p", ["roll,pitch", "roll,position"]),
     ("design multisine --vehicle bebo", ["bebop"]), ("design sweep --for ard", ["ardupilot"]),
     ("identify --cross-validate l", ["leave_one_out"]), ("review --figures s", ["svg"])],
)  # fmt: skip
def test_values_are_those_that_there_are(words: str, expected: list[str]) -> None:
    assert completed("bash", f"rotorid {words}").split() == expected
