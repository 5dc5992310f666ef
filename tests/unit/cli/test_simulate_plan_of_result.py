"""``simulate RESULT --plan``: logs with noise that other commands read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.exports.models import ROLL, model

import rotorid as library
from rotorid.documents.base import to_json
from rotorid.documents.design import plan_document
from rotorid.documents.result import save
from rotorid.excitation.plan import planned, sequence


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result, and a plan that moves it."""
    folder = tmp_path_factory.mktemp("own")
    save(model(ROLL, responses=False), folder / "result")
    step = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=0.6, sample_rate_hz=250.0)
    (folder / "plan.json").write_text(to_json(plan_document(sequence("one", [step], trim_s=3.0))), encoding="utf-8")
    return folder


def test_each_run_is_a_log(place: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ran = rotorid(
        "simulate", place / "result", "--plan", place / "plan.json", "--runs", "2", "--seed", "4", "--out", out
    )
    assert ran.code == 0, ran.err
    assert {path.name for path in out.iterdir()} >= {"flight_1.csv", "flight_2.csv", "flown.json", "report.html"}
    document = json.loads((out / "flown.json").read_text())
    assert [(log["file"], log["seed"], log["run"]) for log in document["logs"]] == [
        ("flight_1.csv", 4, 0),
        ("flight_2.csv", 4, 1),
    ]
    assert document["logs"][0]["assumed"] == ["p"]
    assert "assumed_noise" in {finding["kind"] for finding in document["findings"]}
    record = library.read(out / "flight_1.csv")
    assert {"roll_command", "roll_excitation", "p"} <= set(record.channel_names)
    assert np.ptp(record["roll_excitation"].values) == pytest.approx(0.2)


def test_what_needs_a_vehicle_is_refused(place: Path, tmp_path: Path) -> None:
    ran = rotorid(
        *("simulate", place / "result", "--plan", place / "plan.json", "--turbulence", "1", "--out", tmp_path / "no")
    )
    assert ran.code == 2
    assert "--turbulence cannot be used with rate.roll, which flies by itself" in ran.err
    assert "--like NAME" in ran.err
