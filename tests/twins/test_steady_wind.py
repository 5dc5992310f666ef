"""A hover model of a flight that leaned against a steady wind: no false coupling, and calm air is predicted."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.twins.coverage_flights import flown_truth

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.flying.designs import plan_with, sweep_of
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.io.registry import write_log
from rotorid.results.model import IdentifiedModel
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.simulation.wind import Wind

VEHICLE = "px4_quad"
SIZES = {"pitch": 0.25, "thrust": 0.12}
WIND = Wind(north_m_s=2.0)


def flown(path: Path, wind: Wind, seed: int) -> FlightRecord:
    craft = SimulateSettings(vehicle=VEHICLE).aircraft
    choices = PlanSettings(shape=sweep_of(craft), entry="stick", duration_s=20.0, axes=("pitch", "thrust"))
    plan = plan_with(craft, choices, SIZES, name="sweeps")
    write_log(path, fly_multirotor(craft, plan, wind=wind, seed=seed), format="ulg")
    return rotorid.read(path)


@pytest.fixture(scope="module")
def windy(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    return flown(tmp_path_factory.mktemp("wind") / "wind.ulg", WIND, 11)


@pytest.fixture(scope="module")
def model(windy: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    calm = flown(tmp_path_factory.mktemp("calm") / "calm.ulg", Wind(), 12)
    return rotorid.identify(windy, "hover.longitudinal", verify=calm)


def test_the_lean_is_the_trim(model: IdentifiedModel) -> None:
    constants = model.structure.constants
    assert (constants["D_x"], constants["D_share"]) == (pytest.approx(1.8, abs=0.3), 1.0)
    assert "trim" in {finding.kind for finding in model.findings}


def test_no_coupling_is_made_of_the_wind(model: IdentifiedModel, windy: FlightRecord) -> None:
    truth = flown_truth(VEHICLE, windy)
    zeros = {name: p for name, p in model.parameters.items() if p.std and truth.get(name) == 0.0}
    misses = {name: (p.value, p.std) for name, p in zeros.items() if abs(p.value) > 2.6 * p.std}
    assert zeros
    assert not misses
    assert model.fit.cost is not None
    assert model.fit.cost.average < 10.0
    # With gravity's term alone heave by pitch is wrong by the lean.
    assert abs(model["M_pitch"].value / truth["M_pitch"] - 1.0) < 0.02


def test_a_model_of_wind_predicts_calm_air(model: IdentifiedModel) -> None:
    assert model.verification.frequency
    assert max(model.verification.frequency.values()) < 100.0
