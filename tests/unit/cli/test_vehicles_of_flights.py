"""A result of ``physical.flight`` on the command line: what flies of it, and where it says that it extrapolates."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.flights import OF_OUTPUTS, flight

from rotorid.documents.result import save


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "fast"
    save(flight(), folder)
    return folder


@pytest.mark.parametrize(("speed", "beyond"), [("6", False), ("12", True)])
def test_simulate_says_when_a_flight_leaves_the_range(saved: Path, tmp_path: Path, speed: str, beyond: bool) -> None:
    ran = rotorid(
        *("simulate", saved, "--like", "x500", "--plan", "none", "--duration", "4", "--speed", speed),
        *("--out", tmp_path / "flown", "--json"),
    )
    assert ran.code in (0, 1), ran.err
    found = [finding for finding in json.loads(ran.out)["findings"] if finding["kind"] == "beyond_range"]
    assert bool(found) == beyond
    if beyond:
        assert found[0]["numbers"]["airspeed"] > 50.0
        assert "airspeed" in found[0]["message"]


def test_a_vehicle_file_keeps_the_air(saved: Path) -> None:
    ran = rotorid("vehicles", saved, "--like", "x500", "--toml")
    assert ran.code == 0, ran.err
    assert "[rotors.flow]" in ran.out
    assert f"induced_drag_n_s_m = {OF_OUTPUTS['k_d']}" in ran.out
    assert "accelerometer_place_m = [0.02, -0.01, 0.03]" in ran.out


def test_export_shows_drag_and_lift_at_speed(saved: Path, tmp_path: Path) -> None:
    ran = rotorid("export", saved, "--to", "mujoco", "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    rows = {row["name"]: row for row in json.loads(ran.out)["quantities"]}
    assert rows["drag at 10 m/s"]["held"] == rows["lift gained at 10 m/s"]["held"] == "exact"
