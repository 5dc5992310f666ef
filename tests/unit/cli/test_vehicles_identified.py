"""Verbs on results of a vehicle 30 % off the library: each has its numbers, and names where others come from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.test_user_vehicles_twins import body_numbers
from tests.unit.flying.vehicle_twins import derivatives_of, hover_physics, twin_of

from rotorid.documents.result import save
from rotorid.documents.vehicle import named_vehicle, parse_vehicle
from rotorid.flying.settings import DesignSettings, SimulateSettings
from rotorid.flying.simulation import truth_of

LIKE = "px4_quad"
TRUTH = body_numbers(twin_of(LIKE))


@pytest.fixture(scope="module")
def physics(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("physics")
    save(hover_physics(twin_of(LIKE)), folder)
    return folder


@pytest.fixture(scope="module")
def ratios(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    places = tmp_path_factory.mktemp("longitudinal"), tmp_path_factory.mktemp("lateral")
    for place in places:
        save(derivatives_of(twin_of(LIKE), f"hover.{place.name.rstrip('0')}"), place)
    return places


def test_a_vehicle_file_has_the_numbers_of_the_result_with_their_sources(physics: Path) -> None:
    ran = rotorid("vehicles", "--from", physics, "--like", LIKE)
    assert ran.code == 0
    read = parse_vehicle(ran.out, where="mine.toml").aircraft
    assert body_numbers(read) == pytest.approx(TRUTH, rel=1e-6)
    assert "m = 1.3 kg, given: physical.hover of own.ulg" in ran.out
    head = ran.out.split("schema =")[0]
    assert [line for line in head.split("Taken from px4_quad:")[1].splitlines() if " = " in line] == []


def test_simulations_and_designs_have_the_vehicle_of_the_result(physics: Path) -> None:
    """What ``simulate`` and ``design`` fly is the twin, and so is the truth that is stated for its logs."""
    named = named_vehicle([str(physics)], like=LIKE)
    choices = DesignSettings(vehicle=named.entry, own=named.own, kinds=("logarithmic_sweep",))
    for craft in (SimulateSettings(vehicle=named.entry).aircraft, choices.craft):
        assert body_numbers(craft) == pytest.approx(TRUTH, rel=1e-6)
        truth = truth_of(craft)
        assert truth["M_pitch"].value == pytest.approx(355.08882, rel=1e-5)
        assert truth["T_motor"].value == pytest.approx(TRUTH["T_motor"])
    assert "physical.hover" in named.entry.summary


def test_an_export_takes_what_ratios_leave_open_from_a_similar_vehicle_and_says_so(
    ratios: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rotorid.exports.exporting._DRAWS", 4)
    out = tmp_path / "sih"
    ran = rotorid("export", *ratios, "--to", "px4-sih", "--like", LIKE, "--set", "m=1.3", "--out", out)
    assert ran.code == 0
    document = json.loads((out / "export.json").read_text())
    assert set(document["defaults"]) >= {"arm"}
    assert document["numbers"]["c_1"]["value"] == pytest.approx(TRUTH["slope"], rel=1e-5)
    assert document["given"]["m"]["value"] == 1.3
    assert "px4_quad" in document["numbers"]["I_xx"]["of"]
