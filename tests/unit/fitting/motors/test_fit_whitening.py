"""Whitening filters against processes whose autoregression is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rotorid.fitting.motors.fit import whitening_taps

SAMPLES = 40_000


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(SAMPLES)


def test_taps_are_those_of_the_autoregression() -> None:
    poles = np.array([1.0, -1.5, 0.7])
    taps = whitening_taps(lfilter([1.0], poles, noise(0)), 6)
    # Standard deviation of a coefficient is about n^-1/2; five of them, and as much again for the correlation between.
    np.testing.assert_allclose(taps, [*poles, 0.0, 0.0, 0.0, 0.0], atol=10.0 / np.sqrt(SAMPLES))


def test_what_is_left_is_white_and_as_large_as_the_innovations() -> None:
    colored = lfilter([1.0, -0.9], [1.0, -1.5, 0.7], noise(1))
    left = np.convolve(colored, whitening_taps(colored, 40), mode="valid")
    correlations = [np.mean(left[lag:] * left[:-lag]) / np.mean(left**2) for lag in range(1, 30)]
    assert np.max(np.abs(correlations)) < 5.0 / np.sqrt(SAMPLES)
    assert np.mean(left**2) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / SAMPLES))


def test_the_inverse_is_stable_even_for_differences_of_white_noise() -> None:
    taps = whitening_taps(np.diff(noise(2)), 30)
    assert np.max(np.abs(np.roots(taps))) < 1.0


def test_size_does_not_matter() -> None:
    colored = lfilter([1.0], [1.0, -0.8], noise(3))
    np.testing.assert_allclose(whitening_taps(1e6 * colored, 5), whitening_taps(colored, 5), atol=1e-12)
