"""The inverse of a controller is known from its shape, with and without the gains."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.fitting.inverse_controller import Verdict, inverse_controller
from rotorid.models.controller import RateController
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(1.0, 80.0, 90)
YAW = RateController(proportional_s=0.2, integral=0.1, angle_1_s=2.8)
ROLL = RateController(proportional_s=0.15, integral=0.2, derivative_s2=0.003, angle_1_s=4.0, derivative_cutoff_hz=20.0)
FILTERED = RateController(proportional_s=0.3, integral=0.02, angle_1_s=4.5, error_cutoff_hz=2.5)


def vehicle(omega_rad_s: FloatArray) -> ComplexArray:
    s = 1j * omega_rad_s
    return np.asarray(13.3 * np.exp(-0.005 * s) / ((s + 0.8) * (0.05 * s + 1.0)))


def verdict(values: ComplexArray, *controllers: RateController, omega: FloatArray = OMEGA) -> Verdict:
    return inverse_controller(omega, values, np.full(omega.size, 0.95), controllers=controllers)


@pytest.mark.parametrize("controller", [YAW, ROLL, FILTERED])
@pytest.mark.parametrize("delay_s", [-0.012, 0.0, 0.012])
def test_with_the_gains_the_inverse_costs_nothing_at_any_small_delay(
    controller: RateController, delay_s: float
) -> None:
    trap = -np.exp(-1j * OMEGA * delay_s) / controller.response(OMEGA)
    result = verdict(trap, controller)
    assert result.inverse.all()
    # The grid of delays is 0.5 ms wide: at most half of that is left, at 80 rad/s a phase of 1.1 degrees.
    assert max(band.known_cost for band in result.bands) < 20.0 * 0.01745 * 1.15**2


@pytest.mark.parametrize("controller", [YAW, ROLL, FILTERED])
def test_without_the_gains_it_is_found_too(controller: RateController) -> None:
    result = verdict(-1.0 / controller.response(OMEGA))
    assert result.inverse.mean() > 0.8
    assert all(band.known_cost == np.inf for band in result.bands)


def test_a_controller_of_the_fitted_shape_is_fitted_exactly() -> None:
    s = 1j * OMEGA
    trap = -(1.0 + 0.05 * s) * np.exp(-0.004 * s) / (0.2 + 0.5 / s + 0.006 * s)
    assert max(band.fitted_cost for band in verdict(trap).bands) < 1e-3


@pytest.mark.parametrize("controllers", [(), (YAW,), (ROLL, FILTERED)])
def test_a_vehicle_is_not(controllers: tuple[RateController, ...]) -> None:
    result = verdict(vehicle(OMEGA), *controllers)
    assert not result.inverse.any()
    assert min(band.cost for band in result.bands) > 200.0


def test_the_wrong_sign_is_not() -> None:
    assert not verdict(1.0 / YAW.response(OMEGA), YAW).inverse.any()


@pytest.mark.parametrize("known", [True, False])
def test_a_vehicle_below_and_a_controller_above_are_told_apart(known: bool) -> None:
    trap = -1.0 / YAW.response(OMEGA)
    result = verdict(np.where(OMEGA < 5.0, vehicle(OMEGA), trap), *([YAW] if known else []))
    assert not result.inverse[OMEGA < 4.5].any()
    assert result.inverse[OMEGA >= 5.0].all()


def test_of_several_controllers_one_is_enough() -> None:
    trap = -1.0 / YAW.rate_loop.response(OMEGA)
    low = OMEGA < 4.0
    assert not verdict(trap[low], ROLL, omega=OMEGA[low]).bands[0].known_cost < 50.0
    assert verdict(trap[low], ROLL, YAW.rate_loop, omega=OMEGA[low]).bands[0].known_cost < 1.0


@pytest.mark.parametrize(("highest", "known", "fitted"), [(1.9, False, False), (3.0, True, False), (5.0, True, True)])
def test_narrow_bands_are_judged_by_known_gains_or_not_at_all(highest: float, known: bool, fitted: bool) -> None:
    omega = np.geomspace(10.0, 10.0 * highest, 20)
    (band,) = verdict(-1.0 / YAW.response(omega), YAW, omega=omega).bands
    assert (np.isfinite(band.known_cost), np.isfinite(band.fitted_cost)) == (known, fitted)
    assert band.inverse is known


@pytest.mark.parametrize("count", [0, 1, 5])
def test_a_handful_of_points_gives_no_verdict(count: int) -> None:
    omega = np.linspace(10.0, 60.0, count)
    result = verdict(-1.0 / YAW.response(omega), YAW, omega=omega)
    assert result.bands == ()
    assert result.inverse.shape == (count,)
