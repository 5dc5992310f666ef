"""Gusts: their variance, their correlation, their seed."""

from __future__ import annotations

import math

import numpy as np

from rotorid.simulation.hover_flight import gauss_markov

RATE_HZ, TIME_S, SIGMA, SAMPLES = 100.0, 0.5, 0.7, 400_000


def test_variance_and_correlation() -> None:
    gust = gauss_markov(
        SAMPLES, intensity=SIGMA, correlation_s=TIME_S, sample_rate_hz=RATE_HZ, rng=np.random.default_rng(0)
    )
    # Autocorrelation exp(-|t|/T): a record of length L holds L / T independent squares, with twice the variance each.
    spread = math.sqrt(2.0 * TIME_S * RATE_HZ / SAMPLES)
    for lag in (0, 25, 50, 100):
        found = np.mean(gust[lag:] * gust[: SAMPLES - lag]) / SIGMA**2
        assert abs(found - math.exp(-lag / RATE_HZ / TIME_S)) < 4.0 * spread


def test_stationary_from_the_first_sample() -> None:
    rng = np.random.default_rng(1)
    first = [
        gauss_markov(1, intensity=SIGMA, correlation_s=TIME_S, sample_rate_hz=RATE_HZ, rng=rng)[0] for _ in range(2000)
    ]
    assert abs(np.var(first) / SIGMA**2 - 1.0) < 4.0 * math.sqrt(2.0 / 2000.0)


def test_same_seed_same_bits() -> None:
    one, two = (
        gauss_markov(99, intensity=1.0, correlation_s=1.0, sample_rate_hz=50.0, rng=np.random.default_rng(7))
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, two)
