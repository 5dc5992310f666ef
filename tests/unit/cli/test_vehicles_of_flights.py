"""A result of ``physical.flight`` on the command line: what flies of it, and where it says that it extrapolates."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.flights import OF_OUTPUTS, flight

from rotorid.documents.result import save
from rotorid.proposing.thrust import linearization
from rotorid.results.summary import ControllerSettings
from rotorid.vehicles.catalog import aircraft


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


def test_tune_names_what_gains_need_beyond_it(saved: Path, tmp_path: Path) -> None:
    ran = rotorid("tune", saved, "--out", tmp_path / "gains", "--json")
    assert ran.code == 1
    reasons = [finding["message"] for finding in json.loads(ran.out)["findings"] if finding["kind"] == "not_tuned"]
    assert len(reasons) == 3
    assert all("delay from command to rate" in reason and "log of that flight" in reason for reason in reasons)


def test_its_thrust_curve_is_that_of_tune() -> None:
    bent = linearization([flight({**OF_OUTPUTS, "c_1": 3.0})], None, autopilot="PX4")
    assert bent is not None
    # A square has twice the share of its bend in the slope: PX4 straightens c_2 / (c_1 + c_2) at the share of hover.
    assert 0.5 < bent.best.value < 1.0
    square = linearization([flight()], None, autopilot="PX4")
    assert square is not None
    assert [finding.message for finding in square.findings if "do not show the bend" in finding.message]


@pytest.mark.slow
def test_a_sweep_for_tune_is_planned_for_the_vehicle_that_it_makes(tmp_path: Path) -> None:
    gains = dict(aircraft("x500").autopilot.parameters)
    controller = ControllerSettings(autopilot="px4", firmware="PX4", loop_rate_hz=250.0, gains=gains, filters={})
    save(replace(flight(), controller=controller), tmp_path / "result")
    ran = rotorid(
        *("design", "sweep", "--vehicle", tmp_path / "result", "--like", "x500", "--axis", "roll", "--duration", "20"),
        *("--for-tune", tmp_path / "result", "--out", tmp_path / "plan", "--json"),
    )
    assert ran.code in (0, 1), ran.err
    plan = json.loads((tmp_path / "plan" / "plan.json").read_text(encoding="utf-8"))
    assert plan["inputs"]
