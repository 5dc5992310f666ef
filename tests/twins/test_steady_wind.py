"""A hover model of a flight that leaned against a steady wind: no false coupling, and calm air is predicted."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.twins.coverage_flights import flown_truth

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.flying.designs import plan_with, sweep_of
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.identifying import methods
from rotorid.io.registry import write_log
from rotorid.results.model import IdentifiedModel
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis

VEHICLE = "px4_quad"
SIZES = {"pitch": 0.25, "thrust": 0.12, "roll": 0.25, "yaw": 0.12}
WIND = Wind(north_m_s=2.0)


def flown(path: Path, wind: Wind, seed: int, axes: tuple[Axis, ...] = ("pitch", "thrust")) -> FlightRecord:
    craft = SimulateSettings(vehicle=VEHICLE).aircraft
    choices = PlanSettings(shape=sweep_of(craft), entry="stick", duration_s=20.0, axes=axes)
    plan = plan_with(craft, choices, {axis: SIZES[axis] for axis in axes}, name="sweeps")
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


def off(model: IdentifiedModel, record: FlightRecord) -> dict[str, float]:
    """Error over the stated deviation of each parameter that has one."""
    truth = flown_truth(VEHICLE, record)
    return {name: abs(p.value - truth[name]) / p.std for name, p in model.parameters.items() if p.std and name in truth}


def test_no_coupling_is_made_of_the_wind(model: IdentifiedModel, windy: FlightRecord) -> None:
    truth, errors = flown_truth(VEHICLE, windy), off(model, windy)
    assert any(truth[name] == 0.0 for name in errors)
    assert not {name: error for name, error in errors.items() if error > 2.6 and name != "Z_w"}
    assert model.fit.cost is not None
    assert model.fit.cost.average < 10.0
    # With gravity's term alone heave by pitch is wrong by the lean.
    assert abs(model["M_pitch"].value / truth["M_pitch"] - 1.0) < 0.02


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="-1.39 of -1, 2.9 deviations that are random: sweeps of 20 s of thrust find -0.94 to -1.39 in wind and in "
    "calm air alike, so it is not the lean",
)
def test_the_damping_of_heave_holds(model: IdentifiedModel, windy: FlightRecord) -> None:
    assert off(model, windy)["Z_w"] < 2.6


def test_the_damping_of_heave_is_off_by_no_more(model: IdentifiedModel, windy: FlightRecord) -> None:
    assert off(model, windy)["Z_w"] < 3.5


ASIDE = Wind(east_m_s=-3.0)


@pytest.fixture(scope="module")
def aside(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    return flown(tmp_path_factory.mktemp("aside") / "aside.ulg", ASIDE, 3, axes=("roll", "yaw"))


@pytest.mark.slow
def test_a_wind_from_the_side_makes_no_coupling(aside: FlightRecord) -> None:
    model = rotorid.identify(aside, "hover.lateral")
    errors = off(model, aside)
    assert {"L_v", "Y_roll", "Y_p"} <= errors.keys()
    assert max(errors.values()) < 2.6
    assert model.fit.cost is not None
    assert model.fit.cost.average < 5.0


@pytest.mark.slow
def test_without_its_trim_a_wind_from_the_side_fits_badly(aside: FlightRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(methods, "best_trim", lambda trims, _: trims[0])
    model = rotorid.identify(aside, "hover.lateral")
    assert model.fit.cost is not None
    assert model.fit.cost.average > 10.0
    assert "ay/roll_command" in {finding.where for finding in model.findings if finding.kind == "structure_error"}


def test_a_model_of_wind_predicts_calm_air(model: IdentifiedModel) -> None:
    assert model.verification.frequency
    assert max(model.verification.frequency.values()) < 100.0
