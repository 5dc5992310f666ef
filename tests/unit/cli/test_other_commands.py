"""``inspect``, ``demo``, ``--version`` and ``--help``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid

from rotorid import __version__
from rotorid.documents.inspection import inspect_document
from rotorid.io.registry import read
from rotorid.pipeline.inspection import inspect


def test_version() -> None:
    assert rotorid("--version") == (0, f"rotorid {__version__}\n", "")


@pytest.mark.parametrize("command", ["identify", "inspect", "demo"])
def test_help_names_every_command(command: str) -> None:
    assert command in rotorid("--help").out
    helped = rotorid(command, "--help")
    assert helped.code == 0
    assert "--json" in helped.out


def test_identify_takes_the_options_of_the_contract() -> None:
    text = rotorid("identify", "--help").out
    options = ("model", "band", "windows", "coherence", "estimate", "instrument", "fix", "segment", "verify", "map")
    for option in (*options, "seed", "out", "json", "quiet"):
        assert f"--{option}" in text


def test_inspect_json_is_the_document_of_the_api(flight: Path) -> None:
    ran = rotorid("inspect", flight, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert json.loads(ran.out) == json.loads(inspect_document(inspect(read(flight))).model_dump_json(by_alias=True))


def test_inspect_shows_channels_excitations_and_what_they_support(flight: Path) -> None:
    ran = rotorid("inspect", flight)
    assert (ran.code, ran.err) == (0, "")
    assert "roll_excitation" in ran.out
    assert sum(line.split()[:2] == ["roll", "sweep"] for line in ran.out.splitlines()) == 2
    roll, pitch = (next(line for line in ran.out.splitlines() if f"rate.{axis}" in line) for axis in ("roll", "pitch"))
    assert "yes" in roll
    assert "no" in pitch
    assert "fly a pitch sweep" in pitch


def test_inspect_says_whether_sensors_and_clocks_agree(flight: Path) -> None:
    out = rotorid("inspect", flight).out
    lines = out[out.index("do sensors and clocks agree") : out.index("what it can support")].splitlines()[1:]
    assert "of what attitude gives" in lines[0] or "of what a small phi gives" in lines[0]
    assert "consistent" in lines[0]
    assert any("after roll_command: vehicle, motors, filters and stamps together" in line for line in lines)
    # What these lines say is not said again among the findings.
    assert "kinematic_consistency" not in out


def test_inspect_writes_nothing(flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert rotorid("inspect", flight, "--quiet") == (0, "", "")
    assert list(tmp_path.iterdir()) == []


def test_demo_writes_a_log_that_reads_a_result_for_each_axis_and_one_report(tmp_path: Path) -> None:
    ran = rotorid("demo", "--out", tmp_path, "--json")
    assert (ran.code, ran.err) == (0, "")
    models = [document["model"] for document in json.loads(ran.out)]
    assert models == ["rate.roll", "rate.pitch", "rate.yaw", "rate.vertical"]
    assert {path.name for path in tmp_path.iterdir()} >= {"flight.ulg", "report.html", *models}
    assert read(tmp_path / "flight.ulg").source.format == "PX4 ULog"
