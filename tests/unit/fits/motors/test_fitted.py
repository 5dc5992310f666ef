"""What physical.motors refuses or leaves out, and how it says what is a ratio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.identifying.motor_logs import ARM_M, flight, repeated, written

from rotorid.errors import InsufficientDataError
from rotorid.fits.motors import fit, remarks
from rotorid.fits.motors.errors import motor_model_error
from rotorid.fits.motors.fit import fit_motor_data
from rotorid.fits.motors.fitted import FittedMotors
from rotorid.flights.motor_data import motor_data
from rotorid.identifying.identification import identify_motors
from rotorid.io.registry import read
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles.motor_flight import TRUTH, flights

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("motors") / "flight.csv")


@pytest.fixture(scope="module")
def fitted(log: Path) -> FittedMotors:
    return fit_motor_data(motor_data([read(log)], CHOICES), CHOICES)


def test_an_axis_that_leaves_more_than_it_explains_is_left_out(tmp_path: Path) -> None:
    """Motors at 10 Hz: 70 % of yaw is explained, of the others nothing."""
    model = identify_motors([read(repeated(tmp_path / "held.csv", every=20))], CHOICES)
    assert all(percent >= 50.0 for percent in (model.fit.fit_percent or {}).values())
    assert {"I_xx", "I_yy"}.isdisjoint(model.parameters)
    assert "poor_fit" in {finding.kind for finding in model.findings}


def test_an_inertia_no_better_known_than_nothing_is_left_out(fitted: FittedMotors) -> None:
    wide = fitted.bounds.covariance.copy()
    place = fitted.bounds.names.index("I_yy")
    wide[place, place] = (1.5 * fitted.parameters["I_yy"].value) ** 2
    found = fit._useless(replace(fitted, bounds=replace(fitted.bounds, covariance=wide)))
    assert list(found) == ["q"]
    assert found["q"].kind == "not_identifiable"


def test_a_fit_that_still_moves_is_refused(fitted: FittedMotors) -> None:
    free, std = fitted.fit.parameters.free, dict(zip(fitted.bounds.names, fitted.bounds.std, strict=True))
    far = np.array([3.0 * std[name] if name == "I_xx" else 0.0 for name in free])
    moving = replace(fitted, fit=replace(fitted.fit, settled=False, moved=far))
    with pytest.raises(InsufficientDataError, match=r"still changed by 3\.0 standard") as refused:
        fit._require_end(moving, CHOICES)
    assert refused.value.findings[0].kind == "not_converged"


def test_a_fit_that_moves_by_less_than_it_states_is_told(fitted: FittedMotors) -> None:
    free, std = fitted.fit.parameters.free, dict(zip(fitted.bounds.names, fitted.bounds.std, strict=True))
    near = np.array([0.2 * std[name] if name == "I_xx" else 0.0 for name in free])
    moving = replace(fitted, fit=replace(fitted.fit, settled=False, moved=near))
    fit._require_end(moving, CHOICES)
    assert "not_converged" in {one.kind for one in remarks.judge_motors(moving, CHOICES, {})}


def test_what_physics_does_not_allow_is_refused(fitted: FittedMotors) -> None:
    falling = {"c_0": 6.0, "c_1": -4.0, "c_2": 0.0}
    certain = replace(fitted.bounds, covariance=1e-9 * fitted.bounds.covariance)
    impossible = replace(fitted, parameters=fitted.parameters.with_values(falling), bounds=certain)
    with pytest.raises(InsufficientDataError, match="are not physical") as refused:
        fit._require_end(impossible, CHOICES)
    assert "impossible_physics" in {finding.kind for finding in refused.value.findings}


@pytest.mark.parametrize("flown", ["turn", "quick roll and pitch", "climb"])
def test_a_flight_that_carries_more_than_its_weight_is_identified(tmp_path: Path, flown: str) -> None:
    swing = np.abs(np.sin(2.0 * np.pi * 0.7 * np.arange(2400) / 200.0))
    load = {"turn": np.full(2400, 1.16), "quick roll and pitch": 1.0 + 0.6 * swing, "climb": np.ones(2400)}[flown]
    climb_m_s = 4.0 if flown == "climb" else 0.0
    (record,) = flights(1, seed=3, duration_s=12.0, load_factor=load, climb_m_s=climb_m_s)
    data = motor_data([read(written(record, tmp_path / "flight.csv"))], CHOICES)
    found = fit_motor_data(data, CHOICES)
    fit._require_end(found, CHOICES)
    assert found.load_factor == pytest.approx(float(load.mean()), abs=0.02)
    for name in ("I_xx", "I_yy", "T_motor"):
        std = found.bounds.std[found.bounds.names.index(name)]
        assert abs(found.parameters[name].value - TRUTH[name]) < 3.0 * std


def test_a_deviation_that_is_no_number_is_refused(fitted: FittedMotors) -> None:
    broken = replace(fitted.bounds, covariance=np.full_like(fitted.bounds.covariance, np.nan))
    with pytest.raises(InsufficientDataError, match="not finite"):
        fit._require_end(replace(fitted, bounds=broken), CHOICES)


@pytest.mark.parametrize(
    ("known", "arm_m", "units"),
    [
        ({"m": 1.2}, 0.2, {"I_xx": "kg m^2", "kappa_per_I_zz": "1/(kg m)", "c_1": "N", "m": "kg"}),
        ({"m": 1.2}, None, {"I_xx": "kg m", "kappa_per_I_zz": "1/(kg m)", "c_1": "N", "m": "kg"}),
        ({}, 0.2, {"I_xx": "m^2", "kappa_per_I_zz": "1/m", "c_1": "m/s^2", "m": "1"}),
        ({}, None, {"I_xx": "m", "kappa_per_I_zz": "1/m", "c_1": "m/s^2", "m": "1"}),
    ],
)
def test_a_ratio_is_told_as_one(log: Path, known: dict[str, float], arm_m: float | None, units: dict[str, str]) -> None:
    model = identify_motors([read(log)], replace(CHOICES, known=known, arm_m=arm_m))
    assert {name: model[name].unit for name in units} == units
    assert model.motors is not None
    assert model.motors.derived["thrust_hover"].unit == units["c_1"]
    assert {one.unit for one in model.motors.both_ways if one.axis == "p"} == {units["I_xx"]}


def test_intervals_hold_more_than_random_errors(fitted: FittedMotors) -> None:
    assert np.all(fitted.bounds.std >= fitted.bounds.random_std)
    model = motor_model_error(fitted.fit, fitted.bounds.random)
    assert np.linalg.eigvalsh(model / np.outer(fitted.bounds.std, fitted.bounds.std)).min() > -1e-9
