"""Dryden's wind: spectra, variances, correlation, seeds."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.signal import welch

from rotorid.errors import UsageError
from rotorid.simulation.wind import Wind, blown, transverse
from rotorid.typing import FloatArray

RATE_HZ, SAMPLES = 50.0, 400_000
GUSTY = Wind(north_m_s=6.0, turbulence_m_s=0.9, height_m=8.0)


def gusts(wind: Wind, seed: int = 0) -> FloatArray:
    return blown(wind, SAMPLES, sample_rate_hz=RATE_HZ, rng=np.random.default_rng(seed))


def dryden(frequency_hz: FloatArray, sigma: float, time_s: float, *, along: bool) -> FloatArray:
    """MIL-F-8785C as a one-sided density per Hz."""
    square = (2.0 * np.pi * frequency_hz * time_s) ** 2
    shape = 2.0 / (1.0 + square) if along else (1.0 + 3.0 * square) / (1.0 + square) ** 2
    return np.asarray(2.0 * sigma**2 * time_s * shape)


@pytest.mark.parametrize(("axis", "share"), [(0, 1.0), (1, 1.0), (2, 0.6)])
def test_spectra_are_drydens(axis: int, share: float) -> None:
    across_m, vertical_m = GUSTY.lengths_m
    time_s = (vertical_m if axis == 2 else across_m) / GUSTY.speed_m_s
    segment = 16_384
    frequency, density = welch(gusts(GUSTY)[:, axis], RATE_HZ, window="hann", nperseg=segment, detrend="constant")
    # Above the resolution of the segments, and where a sampled process is not folded yet.
    bands = np.geomspace(0.02, 2.0, 9)
    for low, high in itertools.pairwise(bands):
        inside = (frequency >= low) & (frequency < high)
        wanted = dryden(frequency[inside], share * GUSTY.turbulence_m_s, time_s, along=axis == 0).mean()
        # Hann windows at half overlap: 1.9 of 2 segments count; neighbors in frequency share 1.5 bins.
        averages = 0.95 * (2 * SAMPLES / segment - 1) * max(1.0, inside.sum() / 1.5)
        assert density[inside].mean() == pytest.approx(wanted, rel=4.0 / math.sqrt(averages) + 0.02)


def test_variances() -> None:
    blowing = gusts(GUSTY)
    across_m, vertical_m = GUSTY.lengths_m
    wanted = np.array([0.9, 0.9, 0.6 * 0.9]) ** 2
    times_s = np.array([across_m, across_m, vertical_m]) / GUSTY.speed_m_s
    # The integral of the squared correlation is about T: so many independent squares, of twice the variance each.
    spread = np.sqrt(2.0 * times_s * RATE_HZ / SAMPLES)
    assert np.all(np.abs(blowing.var(axis=0) / wanted - 1.0) < 4.0 * spread)
    mean_spread = np.sqrt(2.0 * wanted * times_s * RATE_HZ / SAMPLES)
    assert np.all(np.abs(blowing.mean(axis=0) - (6.0, 0.0, 0.0)) < 4.0 * mean_spread)


def test_correlation_of_the_transverse_gust() -> None:
    time_s, sigma = 0.5, 0.7
    gust = transverse(
        SAMPLES, intensity=sigma, correlation_s=time_s, sample_rate_hz=RATE_HZ, rng=np.random.default_rng(1)
    )
    spread = math.sqrt(2.0 * time_s * RATE_HZ / SAMPLES)
    for lag in (0, 5, 15, 25, 60):
        t = lag / RATE_HZ / time_s
        found = np.mean(gust[lag:] * gust[: SAMPLES - lag]) / sigma**2
        assert abs(found - (1.0 - 0.5 * t) * math.exp(-t)) < 4.0 * spread


def test_transverse_gusts_are_stationary_from_the_first_sample() -> None:
    rng = np.random.default_rng(2)
    first = [transverse(1, intensity=1.0, correlation_s=5.0, sample_rate_hz=100.0, rng=rng)[0] for _ in range(4000)]
    assert abs(np.var(first) - 1.0) < 4.0 * math.sqrt(2.0 / 4000.0)


def test_turbulence_turns_with_the_wind() -> None:
    north, east = (
        blown(wind, 500, sample_rate_hz=RATE_HZ, rng=np.random.default_rng(5))
        for wind in (Wind(north_m_s=6.0, turbulence_m_s=0.9), Wind(east_m_s=6.0, turbulence_m_s=0.9))
    )
    np.testing.assert_allclose(east, np.column_stack([-north[:, 1], north[:, 0], north[:, 2]]), atol=1e-12)


def test_same_seed_same_bits() -> None:
    one, two, other = (blown(GUSTY, 99, sample_rate_hz=RATE_HZ, rng=np.random.default_rng(seed)) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one, two)
    assert np.all(one != other)


def test_lengths_at_low_altitude() -> None:
    # MIL-F-8785C at 100 ft: L_u = 100 / (0.177 + 0.0823)^1.2 ft.
    across_m, vertical_m = Wind(height_m=30.48).lengths_m
    assert across_m == pytest.approx(30.48 / 0.2593**1.2, abs=0.05)
    assert vertical_m == 30.48
    with pytest.raises(UsageError, match="height"):
        Wind(height_m=0.0)
