"""Numbers that follow from a fit of flight: units, errors that hold in hover, drag by airspeed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.identifying.flight_logs import DIAMETER_M, flown, layout_file

from rotorid.errors import InsufficientDataError
from rotorid.fits.flight.fit import fit_flight_data, mean_force_findings
from rotorid.fits.flight.fitted import (
    FittedFlight,
    bounds_of_covariance,
    drag_points,
    fit_percents,
    force_scores,
)
from rotorid.fits.flight.hover import flight_units
from rotorid.flights.flight_data import FlightMotion, flight_data
from rotorid.models.flight import FLIGHT_PARAMETERS, hover_thrust
from rotorid.models.parameter import is_parameter_unit
from rotorid.settings.motors import MotorSettings


@pytest.fixture(scope="module")
def choices(tmp_path_factory: pytest.TempPathFactory) -> MotorSettings:
    layout = layout_file(tmp_path_factory.mktemp("layout"))
    return MotorSettings(known={"m": flown().truth["m"]}, layout=str(layout), rotor_diameter_m=DIAMETER_M)


@pytest.fixture(scope="module")
def data(choices: MotorSettings) -> FlightMotion:
    return flight_data([flown().record], choices)


@pytest.fixture(scope="module")
def fitted(data: FlightMotion, choices: MotorSettings) -> FittedFlight:
    return fit_flight_data(data, choices)


@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("speeds", [True, False])
def test_units_are_units(scaled: bool, speeds: bool) -> None:
    units = flight_units(scaled=scaled, speeds=speeds)
    assert set(units) == set(FLIGHT_PARAMETERS)
    assert all(is_parameter_unit(unit) for unit in units.values())
    assert scaled or not any("kg" in unit or "N" in unit for unit in units.values())
    assert speeds or "rad^2" not in units["c_2"]


def test_hover_moves_along_the_covariance(fitted: FittedFlight) -> None:
    """Errors by the gradient are those of draws."""
    rng = np.random.default_rng(3)
    names, fit = fitted.bounds.names, fitted.fit
    draws = rng.multivariate_normal([fit.values[name] for name in names], 0.01 * fitted.bounds.covariance, size=2000)
    hovers = [hover_thrust({**fit.values, **dict(zip(names, draw, strict=True))}, fit.airframe) for draw in draws]
    for name, values in {
        "thrust_coefficient": [hover.coefficient for hover in hovers],
        "thrust_slope": [hover.slope_n for hover in hovers],
        "speed": [hover.speed for hover in hovers],
    }.items():
        # The standard error of 2000 draws is 1.6 %.
        assert 10.0 * float(np.std(values)) == pytest.approx(fitted.hover[name].std, rel=0.06)


def test_what_is_assumed_has_an_error(fitted: FittedFlight) -> None:
    """Inertia of yaw as that of a flat vehicle, and what inflow takes, which a calm flight does not show."""
    assert fitted.assumed == ("c_lambda", "I_zz")
    values, std = fitted.parameters.values, dict(zip(fitted.bounds.names, fitted.bounds.std, strict=True))
    for name in ("c_lambda", "I_zz"):
        assert abs(values[name] - flown().truth[name]) < 2.0 * std[name], name
    assert std["I_zz"] == pytest.approx(0.12 * values["I_zz"])
    assert std["kappa"] / values["kappa"] > std["I_zz"] / values["I_zz"]
    # Thrust in hover is measured all the same.
    thrust = fitted.hover["thrust_coefficient"]
    assert thrust.std / thrust.value < std["c_2"] / values["c_2"]


def test_drag_points_are_measured_and_modeled(fitted: FittedFlight) -> None:
    points = drag_points(fitted)
    assert len(points) >= 5
    fast = points[-1]
    assert fast.modeled_n == pytest.approx(fast.measured_n, rel=0.1)
    assert [point.airspeed_m_s for point in points] == sorted(point.airspeed_m_s for point in points)


def test_axes_that_hardly_move_do_not_count(fitted: FittedFlight) -> None:
    assert "az" in fitted.channels
    percents = fit_percents(fitted)
    assert set(percents) == set(fitted.channels)
    assert set(force_scores(fitted.predicted[0], fitted.channels)) == set(fitted.channels)
    assert percents["az"] > 70.0


def test_the_mean_force_is_that_of_the_accelerometer(fitted: FittedFlight) -> None:
    assert mean_force_findings(fitted) == []


@pytest.mark.parametrize(("share", "kind"), [(1.08, "implausible_physics"), (1.3, "impossible_physics")])
def test_a_mean_force_that_is_missed_is_said(share: float, kind: str, fitted: FittedFlight) -> None:
    values = {**fitted.fit.values, "c_2": fitted.fit.values["c_2"] * share}
    off = replace(fitted, fit=replace(fitted.fit, values=values))
    assert kind in {finding.kind for finding in mean_force_findings(off)}


def test_rotors_that_carry_nothing_are_refused(data: FlightMotion, choices: MotorSettings) -> None:
    record = data.records[0]
    upside_down = replace(record, force=np.abs(record.force), az=-record.az)
    (stretch,) = data.motors.stretches
    motors = data.motors._replace(stretches=(stretch._replace(record=upside_down),))
    with pytest.raises(InsufficientDataError):
        fit_flight_data(data._replace(motors=motors), choices)


def test_bounds_are_those_of_the_covariance() -> None:
    random = np.array([[4.0, 1.0], [1.0, 1.0]])
    bounds = bounds_of_covariance(("a", "b"), 2.0 * random, random)
    assert bounds.cramer_rao == pytest.approx([4.0, 2.0])
    # With the other known: the variance without what they share.
    assert bounds.insensitivity**2 == pytest.approx([3.0, 0.75])


def test_a_path_is_no_part_of_a_layout_name(data: FlightMotion) -> None:
    assert data.layout.name == Path("rotors.toml").name
