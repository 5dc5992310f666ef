"""Thrust curves: inverses, derivatives against a complex step, and what falls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.thrust_curve import ExpoCurve, PolynomialCurve, ThrustCurve, ardupilot_curve, px4_curve

CRAZYFLIE = PolynomialCurve(coefficients=(0.02272, -0.01194, 0.12837))
CURVES = [
    PolynomialCurve(coefficients=(0.0, 12.5)),
    PolynomialCurve(coefficients=(0.0, 0.0, 18.8)),
    PolynomialCurve(coefficients=(0.1, 0.4, 3.0, -0.5)),
    CRAZYFLIE,
    ExpoCurve(expo=0.65, largest=18.83, low=0.15, high=0.95),
    ExpoCurve(expo=-0.4, largest=2.0),
    ExpoCurve(expo=0.0),
]
COMMANDS = np.linspace(0.16, 0.94, 41).reshape(1, 41)
STEP = 1e-30


@pytest.mark.parametrize("curve", CURVES, ids=str)
def test_the_inverse_gives_the_command_back(curve: ThrustCurve) -> None:
    np.testing.assert_allclose(curve.inverse(curve.thrust(COMMANDS)), COMMANDS, atol=1e-12)


@pytest.mark.parametrize("curve", CURVES, ids=str)
def test_the_slope_is_the_complex_step(curve: ThrustCurve) -> None:
    np.testing.assert_allclose(curve.slope(COMMANDS), curve.thrust(COMMANDS + 1j * STEP).imag / STEP, rtol=1e-12)


@pytest.mark.parametrize("curve", CURVES, ids=str)
def test_the_gradients_are_the_derivatives(curve: ThrustCurve) -> None:
    """Polynomials in their coefficients exactly; the range of an expo curve by differences, whose error is h²."""
    gradients, h = curve.gradients(COMMANDS), 1e-5
    assert gradients.shape == (len(curve.names), *COMMANDS.shape)
    for index in range(len(curve.names)):
        step = h * np.eye(len(curve.names))[index]
        low, high = (curve.with_values(curve.values + sign * step).thrust(COMMANDS) for sign in (-1.0, 1.0))
        np.testing.assert_allclose(gradients[index], (high - low) / (2.0 * h), rtol=1e-8, atol=1e-8)


def test_a_curve_is_inverted_where_motors_work() -> None:
    """The Crazyflie's curve falls up to 0.0465; below its least thrust there is no command."""
    lowest = 0.01194 / (2.0 * 0.12837)
    assert not CRAZYFLIE.is_monotonic(0.0, 1.0)
    assert CRAZYFLIE.is_monotonic(lowest + 1e-3, 1.0)
    np.testing.assert_allclose(CRAZYFLIE.inverse([0.0, 1.0]), [lowest, 1.0], atol=1e-12)


def test_a_falling_curve_has_no_inverse() -> None:
    with pytest.raises(ModelError, match="falls up to the command 1"):
        PolynomialCurve(coefficients=(1.0, -1.0)).inverse(0.5)


def test_thrust_out_of_reach_takes_the_nearer_end() -> None:
    curve = ExpoCurve(expo=0.65, low=0.15, high=0.95)
    np.testing.assert_allclose(curve.inverse([-0.1, 1.3]), [0.15, 0.95], atol=1e-12)
    np.testing.assert_allclose(PolynomialCurve(coefficients=(0.0, 2.0)).inverse([-1.0, 3.0]), [0.0, 1.0], atol=1e-12)


def test_curves_are_what_parameters_state() -> None:
    stated = {"MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}
    assert ardupilot_curve(stated, largest=2.0) == ExpoCurve(expo=0.65, largest=2.0, low=0.15, high=0.95)
    assert ardupilot_curve({"MOT_THST_EXPO": 0.65}) is None
    assert px4_curve({"THR_MDL_FAC": 0.3}) == ExpoCurve(expo=0.3)
    assert px4_curve({}).slope(0.7) == 1.0


def test_an_expo_is_between_linear_and_quadratic() -> None:
    x = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(ExpoCurve(expo=0.0).thrust(x), x, atol=1e-15)
    np.testing.assert_allclose(ExpoCurve(expo=1.0).thrust(x), x**2, atol=1e-15)


@pytest.mark.parametrize("wrong", [{"expo": 1.2}, {"low": 1.0}, {"largest": np.nan}])
def test_wrong_curves_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ModelError):
        replace(ExpoCurve(expo=0.5), **wrong)
    with pytest.raises(ModelError):
        PolynomialCurve(coefficients=(1.0,))
