"""The band that a proposal needs follows the gains that would be proposed, not those that flew."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.controller import RateController
from rotorid.tuning.bands import LOWEST_RAD_S, crossover_rad_s, needed_band
from rotorid.tuning.loops import ControllerParts, frequency_grid
from rotorid.tuning.plant import certain_plant
from rotorid.tuning.proposal import propose
from rotorid.typing import ComplexArray, FloatArray


def plant(omega: FloatArray) -> ComplexArray:
    """A quadrotor without lag of its motors, with a delay and a filter of its gyroscope."""
    return np.asarray(437.0 / (1j * omega + 2.0) * np.exp(-0.0025j * omega) / (1.0 + 1j * omega / 126.0) ** 2)


def flown(size: float) -> RateController:
    """Stock gains of ArduPilot, times a factor."""
    return RateController(
        proportional_s=0.135 * size,
        integral=0.135 * size,
        derivative_s2=0.0036 * size,
        angle_1_s=4.5,
        derivative_cutoff_hz=20.0,
        step_s=1.0 / 400.0,
    )


def parts_of(controller: RateController) -> ControllerParts:
    omega = frequency_grid(controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    return ControllerParts(controller=controller, omega_rad_s=omega, filters=ones, logged=ones)


def test_a_known_plant_is_one_draw_of_itself() -> None:
    omega = np.geomspace(0.01, 5000.0, 50)
    known = certain_plant(plant)
    assert known.draws == 1
    assert np.array_equal(known.drawn(omega)[0], plant(omega))
    assert np.array_equal(known.response(omega), plant(omega))


@pytest.mark.parametrize("size", [0.5, 1.0, 1.6])
def test_the_band_reaches_three_times_as_far_as_the_proposed_loops_cross_over(size: float) -> None:
    controller = flown(size)
    parts = parts_of(controller)
    low, high = needed_band("roll", plant, controller, parts)
    found = propose("roll", certain_plant(plant), controller, parts=parts)
    assert found.changed
    assert low == LOWEST_RAD_S
    assert high <= 3.0 * crossover_rad_s(found.proposed) * (1.0 + 1e-9)
    assert 80.0 < high < 200.0


def test_gains_that_cross_over_beyond_all_motion_ask_for_no_such_band() -> None:
    controller = flown(1.6)
    parts = parts_of(controller)
    found = propose("roll", certain_plant(plant), controller, parts=parts)
    assert 3.0 * crossover_rad_s(found.flown) > 350.0
    assert needed_band("roll", plant, controller, parts)[1] < 200.0


def test_modes_of_the_speed_below_the_sweep_do_not_change_the_band() -> None:
    def drifting(omega: FloatArray) -> ComplexArray:
        s, speed, moment = 1j * omega, 0.3, 3.0
        return np.asarray(plant(omega) * (s + 2.0) * s * (s + speed) / ((s + 2.0) * s * (s + speed) + 9.81 * moment))

    controller = flown(0.25)
    parts = parts_of(controller)
    alone, moving = (needed_band("roll", one, controller, parts)[1] for one in (plant, drifting))
    assert moving == pytest.approx(alone, rel=0.15)
