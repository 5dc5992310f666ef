"""Phases start where an engineer would write them, whatever noise does at the ends of the band."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rotorid.plot.curves import near_deg, reference_deg, unwrapped_deg
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(0.3, 100.0, 120)
NOISY = 20
ERROR = 0.15

PLANTS: dict[str, tuple[Callable[[ComplexArray], ComplexArray], float]] = {
    "rate plant": (lambda s: 8.0 / s, -90.0),
    "rate plant with delay": (lambda s: 8.0 * np.exp(-0.03 * s) / s, -90.0),
    "rate plant with a long delay": (lambda s: 8.0 * np.exp(-0.1 * s) / s, -90.0),
    "damped rate plant": (lambda s: 437.0 * np.exp(-0.0024 * s) / ((s + 4.2) * (0.028 * s + 1.0)), 0.0),
    "unstable first order": (lambda s: 5.0 / (s - 2.0), -180.0),
    "two integrators": (lambda s: 8.0 / s**2, -180.0),
    "three integrators and a lag": (lambda s: 8.0 / s**3 / (0.05 * s + 1.0), -270.0),
    "three integrators, reversed": (lambda s: -8.0 / s**3, -90.0),
    "gain": (lambda s: 5.0 + 0.0 * s, 0.0),
    "reversed gain with delay": (lambda s: -5.0 * np.exp(-0.02 * s), -180.0),
    "differentiator": (lambda s: 3.0 * s / (0.02 * s + 1.0), 90.0),
}


def noisy_ends(values: ComplexArray, seed: int) -> ComplexArray:
    """A response with a relative error in the middle, and nothing but noise in the first and last points."""
    rng = np.random.default_rng(seed)
    count = values.size
    seen = values * (1.0 + ERROR * (rng.standard_normal(count) + 1j * rng.standard_normal(count)) / np.sqrt(2.0))
    for end in (slice(0, NOISY), slice(count - NOISY, count)):
        turn = np.exp(2j * np.pi * rng.random(NOISY))
        seen[end] = np.abs(values[end]) * np.exp(rng.standard_normal(NOISY)) * turn
    return np.asarray(seen)


@pytest.mark.parametrize("name", PLANTS)
def test_a_noiseless_response_starts_where_its_slope_says(name: str) -> None:
    plant, start_deg = PLANTS[name]
    # Lag and delay at the first frequency: below 10° for each of these plants.
    assert unwrapped_deg(OMEGA, plant(1j * OMEGA))[0] == pytest.approx(start_deg, abs=10.0)


@pytest.mark.parametrize("name", PLANTS)
def test_noise_at_the_ends_moves_neither_branch_nor_middle(name: str) -> None:
    values = PLANTS[name][0](1j * OMEGA)
    truth = unwrapped_deg(OMEGA, values)
    middle = slice(NOISY + 5, OMEGA.size - NOISY - 5)
    for seed in range(40):
        seen = noisy_ends(values, seed)
        shown = near_deg(seen, reference_deg(OMEGA, seen, np.ones(OMEGA.size, dtype=bool)))
        # Five standard deviations of the phase; a wrong branch would be off by 360°.
        assert np.abs(shown - truth)[middle].max() < 5.0 * np.degrees(ERROR)


def test_points_that_are_not_trusted_decide_nothing() -> None:
    values = PLANTS["rate plant"][0](1j * OMEGA)
    wrong = values.copy()
    wrong[:60] *= np.exp(2.5j)
    lean = reference_deg(OMEGA, wrong, np.arange(OMEGA.size) >= 60)
    np.testing.assert_allclose(lean, -90.0, atol=1e-6)


def test_nothing_trusted_leans_on_zero() -> None:
    lean = reference_deg(OMEGA, np.ones(OMEGA.size, dtype=complex), np.zeros(OMEGA.size, dtype=bool))
    assert not lean.any()


def test_gaps_and_zeros_stay_gaps() -> None:
    values = 1.0 / (1j * OMEGA)
    values[3], values[7] = np.nan, 0.0
    assert np.flatnonzero(np.isnan(unwrapped_deg(OMEGA, values))).tolist() == [3, 7]
    np.testing.assert_allclose(reference_deg(OMEGA, values, np.ones(OMEGA.size, dtype=bool)), -90.0, atol=1e-6)
