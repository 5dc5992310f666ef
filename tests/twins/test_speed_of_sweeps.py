"""What the size of a sweep does to derivatives by speed: open ends of two vehicles, with their bounds.

The Hummingbird, swept to 0.35 rad, has a moment by speed 10 % too small in models of one axis: see
:mod:`rotorid.flights.tilt_errors` for the parts that were measured. The ArduPilot vehicle has quadratic drag; of one
sweep the damping of heave is the slope at the speeds flown, a quarter above that of the linearization in hover.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.twins.coverage_flights import fly, read_flight

import rotorid
from rotorid.flying.settings import SimulateSettings
from rotorid.flying.simulation import truth_of
from rotorid.results.summary import ParameterEstimate

pytestmark = pytest.mark.slow


def found(folder: Path, vehicle: str, model: str, name: str) -> tuple[ParameterEstimate, float, float]:
    """Estimate, what is true of the flight, and what is true of hover."""
    flight = read_flight(fly(folder, vehicle, "calm", 101), vehicle)
    hover = truth_of(SimulateSettings(vehicle=vehicle).aircraft)[name].value
    return rotorid.identify(flight.record, model)[name], flight.truth[name], hover


@pytest.fixture(scope="module")
def leaning(tmp_path_factory: pytest.TempPathFactory) -> tuple[ParameterEstimate, float, float]:
    return found(tmp_path_factory.mktemp("leaning"), "hummingbird", "axis.pitch", "M_u")


@pytest.fixture(scope="module")
def dragging(tmp_path_factory: pytest.TempPathFactory) -> tuple[ParameterEstimate, float, float]:
    return found(tmp_path_factory.mktemp("dragging"), "ardupilot_quad", "hover.longitudinal", "Z_w")


@pytest.mark.xfail(
    strict=True, raises=AssertionError, reason="10 % low: 3 % by the air, 2 % by axes, the rest by the speed mode"
)
def test_leaning_leaves_the_speed_derivative(leaning: tuple[ParameterEstimate, float, float]) -> None:
    estimate, truth, _ = leaning
    assert abs(estimate.value / truth - 1.0) < 0.05


def test_leaning_costs_the_speed_derivative_no_more(leaning: tuple[ParameterEstimate, float, float]) -> None:
    estimate, truth, _ = leaning
    assert estimate.std is not None
    assert abs(estimate.value / truth - 1.0) < 0.15
    assert abs(estimate.value - truth) < 3.5 * estimate.std


@pytest.mark.xfail(
    strict=True, raises=AssertionError, reason="-0.31 in sweeps of heave, -0.24 in hover: one sweep shows one slope"
)
def test_quadratic_drag_leaves_the_damping_of_hover(dragging: tuple[ParameterEstimate, float, float]) -> None:
    estimate, _, hover = dragging
    assert estimate.std is not None
    assert abs(estimate.value - hover) < 1.96 * estimate.std


def test_quadratic_drag_is_the_slope_as_flown(dragging: tuple[ParameterEstimate, float, float]) -> None:
    estimate, truth, hover = dragging
    assert estimate.std is not None
    assert abs(estimate.value - truth) < 2.6 * estimate.std
    assert abs(estimate.value / hover - 1.0) < 0.35
