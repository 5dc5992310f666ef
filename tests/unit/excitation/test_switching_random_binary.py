"""Random binary signals: two levels, the arcsine law, and what the passes gain."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.excitation import band_of_rise_time, energy_share, random_binary, share_of_sign

HZ = 2.0 * math.pi
# The bands of the Bebop 2 for pitch, roll and vertical speed, then a wide one and an octave, in Hz.
BANDS = [(0.30, 1.35), (0.40, 0.85), (0.10, 1.12), (0.20, 8.0), (0.5, 1.0)]


def signal(band_hz: tuple[float, float], seed: int, **change: Any) -> np.ndarray:
    settings = {
        "amplitude": 1.0,
        "band_rad_s": (HZ * band_hz[0], HZ * band_hz[1]),
        "duration_s": 60.0,
        "sample_rate_hz": 20.0 * band_hz[1],
        "trim_s": 0.0,
    }
    return random_binary(**(settings | change), rng=np.random.default_rng(seed))


def share(values: np.ndarray, band_hz: tuple[float, float], rate_hz: float) -> float:
    return energy_share(values, (HZ * band_hz[0], HZ * band_hz[1]), sample_rate_hz=rate_hz)


@pytest.mark.parametrize("band_hz", BANDS)
def test_sign_of_noise_has_the_share_of_the_arcsine_law(band_hz: tuple[float, float]) -> None:
    rate_hz = 20.0 * band_hz[1]
    duration_s = 100.0 / band_hz[0]
    shares = [share(signal(band_hz, seed, passes=0, duration_s=duration_s), band_hz, rate_hz) for seed in range(24)]
    expected = share_of_sign((HZ * band_hz[0], HZ * band_hz[1]), sample_rate_hz=rate_hz)
    # Four standard errors of the mean, and what the ends of a record spread beyond both edges: half a line each.
    error = 4.0 * np.std(shares, ddof=1) / math.sqrt(len(shares)) + 1.0 / (duration_s * (band_hz[1] - band_hz[0]))
    assert np.mean(shares) == pytest.approx(expected, abs=error)
    assert error < 0.05


@pytest.mark.parametrize("band_hz", BANDS)
def test_passes_put_four_fifths_of_the_energy_inside(band_hz: tuple[float, float]) -> None:
    rate_hz = 20.0 * band_hz[1]
    shares = [share(signal(band_hz, seed, duration_s=100.0 / band_hz[0]), band_hz, rate_hz) for seed in range(8)]
    assert min(shares) > 0.77
    # No two-level signal of a band without its third harmonics has more than the fundamental of a square wave.
    if band_hz[1] <= 3.0 * band_hz[0]:
        assert max(shares) < 8.0 / math.pi**2 + 0.01
    else:
        assert min(shares) > 0.80


@given(seed=st.integers(0, 1000), low=st.floats(0.1, 0.5), ratio=st.floats(1.8, 20.0), samples=st.integers(800, 1200))
@settings(max_examples=40, deadline=None)
def test_no_pass_lowers_the_share(seed: int, low: float, ratio: float, samples: int) -> None:
    rate_hz = 20.0 * low * ratio
    shares = []
    for passes in range(6):
        values = signal((low, low * ratio), seed, sample_rate_hz=rate_hz, duration_s=samples / rate_hz, passes=passes)
        # Over the circle on which the passes work, not between rests.
        lines = np.abs(np.fft.rfft(values)) ** 2
        omega = np.fft.rfftfreq(values.size, 1.0 / rate_hz)
        # All energies are equal, so what is inside is the share.
        shares.append(lines[(omega * HZ >= HZ * low) & (omega * HZ <= HZ * (low * ratio))].sum())
    assert (np.diff(shares) >= -1e-9 * shares[0]).all()


def test_density_is_even_inside_the_band() -> None:
    band_hz, rate_hz = (0.2, 4.0), 80.0
    edges = np.geomspace(*band_hz, 5)
    densities = np.array(
        [
            [share(values, (low, high), rate_hz) / (high - low) for low, high in itertools.pairwise(edges)]
            for values in (signal(band_hz, seed, duration_s=300.0) for seed in range(12))
        ]
    ).mean(axis=0)
    # A part holds at least 12 * 300 s * 0.22 Hz = 800 lines, each with an error of one: 0.15 dB; three times that, and
    # the decibel that the docstring grants.
    assert np.ptp(10.0 * np.log10(densities)) < 1.0 + 2 * 0.45


@given(amplitude=st.floats(0.01, 5.0), seed=st.integers(0, 100), trim_s=st.floats(0.0, 3.0))
@settings(max_examples=20, deadline=None)
def test_two_levels_between_rests(amplitude: float, seed: int, trim_s: float) -> None:
    values = signal((0.3, 1.35), seed, amplitude=amplitude, trim_s=trim_s)
    trim = round(trim_s * 27.0)
    assert values.size == 60 * 27 + 2 * trim
    assert not values[:trim].any()
    assert not values[values.size - trim :].any()
    assert set(np.unique(values[trim : values.size - trim])) == {-amplitude, amplitude}
    np.testing.assert_array_equal(values, signal((0.3, 1.35), seed, amplitude=amplitude, trim_s=trim_s))


def test_band_of_the_rise_times_of_the_bebop() -> None:
    # Rise times, and bandwidths in Hz, as printed.
    for rise, printed in (
        ((0.260, 0.055), (1.35, 0.28)),
        ((0.410, 0.0424), (0.85, 0.08)),
        ((0.313, 0.025), (1.12, 0.09)),
    ):
        found = np.array(band_of_rise_time(*rise)) / HZ
        # Half a unit of the last digit; the second spread was cut off and not rounded: 0.088.
        np.testing.assert_allclose(found, printed, atol=0.01)


def test_uncertainty_of_the_band_is_first_order() -> None:
    rise_s, std_s = 0.3, 1e-6
    step = band_of_rise_time(rise_s - std_s)[0] - band_of_rise_time(rise_s)[0]
    assert band_of_rise_time(rise_s, std_s)[1] == pytest.approx(step, rel=1e-5)


@pytest.mark.parametrize(
    "change",
    [
        {"band_rad_s": (2.0, 1.0)},
        {"band_rad_s": (0.0, 1.0)},
        {"band_rad_s": (1.0, 400.0)},
        {"duration_s": 5.0},
        {"duration_s": 0.0},
    ],
)
def test_impossible_signals_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="rising band"):
        signal((0.3, 1.35), 0, **change)


@pytest.mark.parametrize("came", [(0.0, 0.1), (-1.0, 0.1), (0.3, -0.1)])
def test_impossible_rise_times_are_refused(came: tuple[float, float]) -> None:
    with pytest.raises(UsageError, match="rise time"):
        band_of_rise_time(*came)
