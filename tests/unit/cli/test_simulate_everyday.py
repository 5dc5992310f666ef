"""``simulate --plan everyday``: ordinary flying by stick, as a log that a review reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid

from rotorid import read
from rotorid.flights.whole_flights import flown

EVERYDAY = ("--plan", "everyday", "--duration", "20")


@pytest.mark.parametrize(("vehicle", "name"), [("px4_quad", "flight.ulg"), ("ardupilot_quad", "flight.BIN")])
def test_sticks_move_and_nothing_is_a_maneuver(vehicle: str, name: str, tmp_path: Path) -> None:
    ran = rotorid("simulate", vehicle, *EVERYDAY, "--stick", "0.3", "--wind", "3", "--out", tmp_path)
    assert ran.code == 0, ran.err
    assert json.loads((tmp_path / "simulation.json").read_text())["maneuvers"] == []
    record = read(tmp_path / name)
    assert not record.declared
    assert 0.05 < float(np.std(record["roll_stick"].values)) < 0.3
    assert flown(record).instrument("roll") == ("stick", "roll_stick")


def test_its_plan_flies_again(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert rotorid("simulate", "x500", *EVERYDAY, "--format", "csv", "--out", first).code == 0
    again = ("--plan", first / "plan.json", "--format", "csv", "--out", second)
    assert rotorid("simulate", "x500", *again).code == 0
    assert (first / "flight.csv").read_bytes() == (second / "flight.csv").read_bytes()


def test_more_than_full_stick_is_refused(tmp_path: Path) -> None:
    ran = rotorid("simulate", "x500", *EVERYDAY, "--stick", "2", "--out", tmp_path)
    assert ran.code == 2
    assert "--stick 2" in ran.err
