"""Likely plants by a measurement whose errors are shared between frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.loops.rate_loops import shown_quantities
from rotorid.proposing.plants import require_known
from rotorid.tuning.loops import loop_figures
from rotorid.tuning.plant import MeasuredRatio, uncertain_plant


def test_errors_that_neighbors_share_are_not_carried_far() -> None:
    """Windows make errors of neighbors alike to .99; what is left between them is no sure sign of a slope."""
    x = np.linspace(0.0, np.log(20.0), 60)
    alike = np.exp(-0.5 * ((x[:, None] - x) / 0.3) ** 2)
    root, rng = np.linalg.cholesky(alike + 1e-10 * np.eye(x.size)), np.random.default_rng(3)

    def noise() -> np.ndarray:
        return rng.standard_normal(x.size) + 1j * rng.standard_normal(x.size)

    error = 0.03 * (root @ noise()) + 0.002 * noise()
    measured = MeasuredRatio(
        omega_rad_s=np.exp(x), ratio=np.exp(error), covariance=(2.0 * 0.03**2 * alike).astype(complex)
    )
    plant = uncertain_plant(lambda omega: np.ones(np.shape(omega)), measured, band_rad_s=(1.0, 20.0))
    # The truth is one; without a share of their own the mean is off by .11 inside of the band and .17 beyond it.
    assert np.abs(np.log(plant.response(np.geomspace(1.0, 40.0, 100)))).max() < 0.05


def test_a_plant_is_followed_as_far_as_its_model_explains_it() -> None:
    plant = uncertain_plant(lambda omega: 20.0 / (1j * omega), None, band_rad_s=(1.0, 20.0), draws=10)
    assert plant.reach_rad_s == 6.0 * 20.0
    assert replace(plant, goes_on=False).reach_rad_s == 20.0


def test_gains_are_not_proposed_beyond_the_reach_of_a_plant() -> None:
    plant = uncertain_plant(lambda omega: 20.0 / (1j * omega), None, band_rad_s=(1.0, 20.0), draws=10)
    require_known("roll", plant, 119.0)
    with pytest.raises(InsufficientDataError, match=r"measured up to 19.1 Hz only") as refused:
        require_known("roll", plant, 121.0)
    assert refused.value.remedy == "fly a sweep of roll up to 29 Hz"


def test_a_flown_loop_has_no_number_beyond_the_reach_of_its_plant() -> None:
    plant = uncertain_plant(lambda omega: 200.0 / (1j * omega), None, band_rad_s=(1.0, 20.0), draws=10)
    omega = np.geomspace(0.5, 600.0, 170)
    known = {"phase_margin_deg", "crossover_rad_s"}
    near, far = (loop_figures(omega, gain * plant.drawn(omega) * np.exp(-1e-3j * omega)) for gain in (0.5, 1.0))
    assert known <= shown_quantities(near, plant).keys()
    assert known.isdisjoint(shown_quantities(far, plant))
