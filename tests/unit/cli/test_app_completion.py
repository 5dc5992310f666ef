"""What the shell completes: commands, options, and the words that an option or an argument takes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SHELLS = ("bash", "zsh", "fish")


def completed(shell: str, words: str) -> str:
    """What a shell is told for a line that ends behind the last letter."""
    count = len(words.split()) - 1 if not words.endswith(" ") else len(words.split())
    asked = {
        "bash": {"COMP_WORDS": words, "COMP_CWORD": str(count)},
        "zsh": {"_TYPER_COMPLETE_ARGS": words},
        "fish": {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
    }[shell]
    environment = {**os.environ, **asked, "_ROTORID_COMPLETE": f"complete_{shell}"}
    program = Path(sys.executable).with_name("rotorid")
    return subprocess.run([program], env=environment, capture_output=True, text=True, check=False, timeout=60).stdout


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_completes_commands_options_and_values(shell: str) -> None:
    assert "identify" in completed(shell, "rotorid id")
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
