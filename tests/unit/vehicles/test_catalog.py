"""The vehicles by name: each hovers in wind, has a possible inertia, enough thrust, and a log that tells its rotors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.simulation.craft import outputs_for

from rotorid.errors import ModelError
from rotorid.io.registry import read, write_log
from rotorid.models.autopilots.layouts import layout_of
from rotorid.models.physical import check_inertia
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import VEHICLES, aircraft, aircraft_names

NAMES = aircraft_names()


def test_names_are_sorted_and_are_those_of_the_vehicles() -> None:
    assert list(VEHICLES) == sorted(VEHICLES)
    assert set(VEHICLES) - set(NAMES) == {"rig"}
    assert all(entry.summary and entry.source for entry in VEHICLES.values())


@pytest.mark.parametrize("name", NAMES)
def test_vehicle_has_the_name_and_the_source_of_its_entry(name: str) -> None:
    vehicle = aircraft(name).vehicle
    assert (vehicle.name, vehicle.source) == (name, VEHICLES[name].source)


def test_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(ModelError, match="there is no vehicle 'x50'") as caught:
        aircraft("x50")
    assert caught.value.remedy == "did you mean x500?"


def test_rig_is_known_and_does_not_fly() -> None:
    with pytest.raises(ModelError, match="pivot") as caught:
        aircraft("rig")
    assert "rotorid simulate rig" in caught.value.remedy


@pytest.mark.parametrize("name", NAMES)
def test_hovers_in_wind(name: str) -> None:
    flown = fly_multirotor(aircraft(name), duration_s=20.0, wind=Wind(north_m_s=3.0, turbulence_m_s=0.5), seed=1)
    assert flown.saturated == 0.0
    assert max(np.abs(flown.truth["phi"]).max(), np.abs(flown.truth["theta"]).max()) < 0.3
    assert np.abs(flown.truth["psi"]).max() < 0.1


@pytest.mark.parametrize("name", NAMES)
def test_inertia_is_that_of_a_body(name: str) -> None:
    inertia = aircraft(name).vehicle.inertia_kg_m2
    assert np.count_nonzero(inertia - np.diag(np.diag(inertia))) == 0
    assert check_inertia(*np.diag(inertia)) == []


@pytest.mark.parametrize("name", NAMES)
def test_thrust_lifts_the_weight_with_something_left(name: str) -> None:
    one = aircraft(name)
    largest = one.autopilot.linearization.outputs(np.array([one.autopilot.motor_range[1]]))[0]
    thrust = one.vehicle.rotors.layout.rotors * one.vehicle.rotors.thrust_at(float(largest))
    # A racing quadrotor lifts eight of its kind.
    most = 10.0 if name == "betaflight_quad" else 4.0
    assert 1.5 < thrust / (one.vehicle.mass_kg * STANDARD_GRAVITY_M_S2) < most


@pytest.mark.parametrize("name", NAMES)
def test_hover_commands_turn_nothing(name: str) -> None:
    one = aircraft(name)
    commands = one.autopilot.hover_commands(one.vehicle)
    np.testing.assert_allclose(commands[:3], 0.0, atol=1e-9)
    outputs = outputs_for(one.autopilot, one.vehicle, commands)
    np.testing.assert_allclose(outputs, one.vehicle.hover_shares, atol=1e-9)


def logged(one: Aircraft, folder: Path) -> Path:
    flown = fly_multirotor(one, duration_s=1.0, settle_s=0.5)
    format = {"ardupilot": "bin", "betaflight": "bbl"}.get(one.autopilot.kind, "ulg")
    path = folder / f"flight.{format}"
    write_log(path, flown, format=format)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("name", [name for name in NAMES if aircraft(name).autopilot.kind != "simple"])
def test_log_tells_the_rotors_and_the_parameters(name: str, tmp_path: Path) -> None:
    one = aircraft(name)
    record = read(logged(one, tmp_path))
    told, true = layout_of(record), one.vehicle.rotors.layout
    np.testing.assert_array_equal(told.spins, true.spins)
    np.testing.assert_allclose(
        told.positions[:, :2] / told.arm, true.positions[:, :2] / true.arm, atol=float(np.finfo(np.float32).eps)
    )
    for parameter, value in one.autopilot.parameters.items():
        assert record.parameters[parameter] == pytest.approx(value, rel=float(np.finfo(np.float32).eps))
