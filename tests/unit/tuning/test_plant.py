"""Likely plants by a measurement whose errors are shared between frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.loops.rate_loops import shown_quantities
from rotorid.proposing.plants import require_known
from rotorid.tuning.loops import loop_figures
from rotorid.tuning.plant import MeasuredRatio, UncertainPlant, uncertain_plant
from rotorid.typing import ComplexArray, FloatArray


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
    assert refused.value.remedy == (
        "fly a sweep of roll up to 29 Hz, or without a sweep fly 30 s in acro at a steady throttle with roll flicks of "
        "0.25 s and 200°/s to each side"
    )


def test_a_flown_loop_has_no_number_beyond_the_reach_of_its_plant() -> None:
    plant = uncertain_plant(lambda omega: 200.0 / (1j * omega), None, band_rad_s=(1.0, 20.0), draws=10)
    omega = np.geomspace(0.5, 600.0, 170)
    known = {"phase_margin_deg", "crossover_rad_s"}
    near, far = (loop_figures(omega, gain * plant.drawn(omega) * np.exp(-1e-3j * omega)) for gain in (0.5, 1.0))
    assert known <= shown_quantities(near, plant).keys()
    assert known.isdisjoint(shown_quantities(far, plant))


def flat(omega: FloatArray) -> ComplexArray:
    return np.ones(np.shape(omega), dtype=np.complex128)


def gain_std(plant: UncertainPlant, omega_rad_s: float) -> float:
    at = np.array([omega_rad_s])
    return float(np.std(np.log(np.abs(plant.drawn(at) / plant.response(at)))))


@pytest.mark.parametrize(("omega", "std"), [(5.0, 0.02), (20.0 * np.e, 0.151), (20.0 * np.e**2, 0.301), (0.5, 0.106)])
def test_doubt_grows_with_the_distance_from_the_band(omega: float, std: float) -> None:
    """2 % inside, and 15 % more for each factor of e outside."""
    plant = uncertain_plant(flat, None, band_rad_s=(1.0, 20.0), draws=2000)
    assert gain_std(plant, omega) == pytest.approx(std, rel=0.08)


def measured(ratio: ComplexArray, omega: FloatArray, std: float) -> MeasuredRatio:
    """A response whose points err by themselves."""
    return MeasuredRatio(omega_rad_s=omega, ratio=ratio, covariance=2.0 * std**2 * np.eye(omega.size, dtype=complex))


def test_noise_of_a_measurement_is_averaged_and_leaves_doubt() -> None:
    """Points that err by 20 % each show a flat plant to some percent, and no more wiggles than are there."""
    omega, rng = np.geomspace(1.0, 20.0, 40), np.random.default_rng(2)
    ratio = np.exp(0.2 * (rng.standard_normal(40) + 1j * rng.standard_normal(40)))
    plant = uncertain_plant(flat, measured(ratio, omega, 0.2), band_rad_s=(1.0, 20.0))
    inside = omega[5:-5]
    assert np.abs(np.log(plant.response(inside))).max() < 0.2
    assert min(gain_std(plant, at) for at in inside) > 0.04


def test_a_model_that_is_off_by_half_gives_way_to_its_measurement() -> None:
    omega = np.geomspace(1.0, 20.0, 40)
    plant = uncertain_plant(flat, measured(1.5 * flat(omega), omega, 0.05), band_rad_s=(1.0, 20.0))
    assert abs(plant.response(np.array([5.0]))[0]) == pytest.approx(1.5, abs=0.03)


def test_stability_counts_from_half_an_octave_above_the_lower_end() -> None:
    assert uncertain_plant(flat, None, band_rad_s=(2.0, 20.0), draws=2).known_from_rad_s == 3.0
