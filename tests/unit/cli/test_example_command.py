"""Examples: small logs, and the commands that they are made for."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid

from rotorid import identify, read, tune
from rotorid.flying.examples import EXAMPLES
from rotorid.vehicles.betaflight import LAG_S, betaflight_autopilot

README = Path(__file__).resolve().parents[3] / "README.md"


def test_they_are_listed() -> None:
    ran = rotorid("example")
    assert ran.code == 0
    assert all(name in ran.out for name in EXAMPLES)


def test_an_unknown_one_lists_what_there_is() -> None:
    ran = rotorid("example", "cessna")
    assert ran.code == 2
    assert all(name in ran.err for name in EXAMPLES)


@pytest.mark.parametrize("option", ["--json", "--out=x"])
def test_options_want_an_example(option: str) -> None:
    assert rotorid("example", option).code == 2


@pytest.mark.parametrize(
    "name",
    [name if name == "rig" else pytest.param(name, marks=pytest.mark.slow) for name in EXAMPLES if name != "px4"],
)
def test_what_is_said_to_try_works(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written = rotorid("example", name)
    assert written.code == 0
    commands = [line.split() for line in written.out.splitlines() if line.startswith("  rotorid ")]
    assert len(commands) == len(EXAMPLES[name].next)
    for words in commands:
        ran = rotorid(*words[1:])
        assert ran.code == 0, f"{words}: {ran.err}"


@pytest.mark.slow
def test_the_racing_quadrotor_is_seen_beyond_its_crossover(tmp_path: Path) -> None:
    """The log of Betaflight tells the plant where the proposed loop needs it, and its proposal shows itself."""
    log = tmp_path / "flight.bbl"
    assert rotorid("example", "betaflight", "--quiet", "--out", tmp_path).code == 0
    record = read(log)
    assert record.parameters["acc_lpf_hz"] == 100.0 * betaflight_autopilot().accelerometer_cutoff_hz
    model = identify(record, "rate.roll")
    # What flies, by its own numbers: the lag of the rotors, and the loop with its filter of 120 Hz.
    assert abs(model["T_motor"].value - LAG_S) < 4.0 * (model["T_motor"].std or 0.0)
    proposal = tune([model], [record])
    assert "band_below_crossover" not in {finding.kind for finding in proposal.findings}
    page = proposal._repr_html_()
    assert "p_roll" in page
    assert "<script" not in page


def _first_page() -> list[list[str]]:
    """Every command of the README's blocks for a shell, in order."""
    blocks = re.findall(r"```sh\n(rotorid .*?)```", README.read_text("utf-8"), re.DOTALL)
    commands = [shlex.split(line) for block in blocks for line in block.splitlines()]
    assert [words[1] for words in commands] == ["example", "review", "identify", "tune", "export"]
    return commands


def _require_made(folder: Path) -> None:
    """The model holds what flew, and gains and a simulator are there."""
    from rotorid.documents.result import load

    model = load(folder / "example-px4" / "model" / "rate.roll")
    assert abs(model["L_roll"].value - 113.1) < 3.0 * (model["L_roll"].std or 0.0)
    assert (folder / "example-px4" / "gains" / "proposed.params").is_file()
    assert list((folder / "example-px4" / "sih").iterdir())


@pytest.mark.usefixtures("computed_once")
def test_the_first_page_can_be_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words in _first_page():
        ran = rotorid(*words[1:])
        assert ran.code == 0, f"{words}: {ran.err}"
    _require_made(tmp_path)


@pytest.mark.slow
def test_a_new_user_has_gains_after_at_most_eight_commands(tmp_path: Path) -> None:
    """From a machine without anything, by the commands of the first page: the time is printed, and not judged."""
    checkout = README.parent
    (extras,) = re.findall(r"`pip install '\.(\[[\w,]+\])'`", README.read_text("utf-8"))
    venv, program = tmp_path / "venv", tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    # As a person does it: nothing of this environment is seen, and packages come from the index that pip knows.
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "ROTORID"))}
    environment["ROTORID_SETTINGS"] = ""
    start = time.monotonic()
    installing = [
        [sys.executable, "-m", "venv", str(venv)],
        [str(program / "pip"), "install", "--quiet", f"{checkout}{extras}"],
    ]
    for words in installing:
        ran = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=900)
        if ran.returncode and re.search("No matching distribution|connection|resolve|network", ran.stderr, re.I):
            pytest.skip(f"no package index can be reached: {ran.stderr.strip().splitlines()[-1][:200]}")
        assert ran.returncode == 0, ran.stderr
    installed_s = time.monotonic() - start
    commands = _first_page()
    assert len(installing) + len(commands) <= 8
    for words in commands:
        ran = subprocess.run(
            [str(program / words[0]), *words[1:]],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=900,
        )
        assert ran.returncode == 0, f"{words}: {ran.stderr}"
    whole_s = time.monotonic() - start
    print(f"installation {installed_s:.0f} s, {len(commands)} commands {whole_s - installed_s:.0f} s: {whole_s:.0f} s")
    _require_made(tmp_path)
