"""Sweeps: the law, the phase, the fades, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.excitation.sweep import C1, C2, logarithmic_sweep, pilot_sweep

RATE_HZ = 1000.0
BAND = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
# Well inside its motion a sweep without fades is a sine of its phase, so the phase can be read back.
PLAIN: dict[str, Any] = {"amplitude": 1.0, "band_rad_s": BAND, "duration_s": 50.0, "sample_rate_hz": RATE_HZ}


def zero_crossings_s(values: np.ndarray) -> np.ndarray:
    before = np.flatnonzero(np.diff(np.signbit(values)))
    return (before + values[before] / (values[before] - values[before + 1])) / RATE_HZ


def test_the_law_ends_where_the_printed_constant_puts_it() -> None:
    # C2 is 1/(e^4 - 1) rounded to four digits, so the end is off by at most half a unit of the last.
    assert abs(C2 * math.expm1(C1) - 1.0) <= 0.5e-4 * math.expm1(C1)


def test_pilot_sweep_passes_zero_where_the_integral_of_the_law_says() -> None:
    times = zero_crossings_s(pilot_sweep(**PLAIN, trim_s=0.0, fade_s=0.0))
    grid = np.linspace(0.0, 50.0, 500_001)
    omega = BAND[0] + C2 * np.expm1(C1 * grid / 50.0) * (BAND[1] - BAND[0])
    phase = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * np.diff(grid))])
    cycles = np.interp(times, grid, phase) / math.pi
    # Linear interpolation of a sine between samples: (omega h)^2 / 8 of a step, as phase over pi.
    bound = (BAND[1] / RATE_HZ) ** 3 / 8.0 / math.pi + 1e-6
    assert np.abs(cycles - np.arange(1, cycles.size + 1)).max() < bound


def test_slow_cycles_come_first_and_take_their_time_from_the_sweep() -> None:
    values = pilot_sweep(**PLAIN, slow_cycles=2.0, trim_s=0.0, fade_s=0.0)
    slow_s = 2.0 * 2.0 * math.pi / BAND[0]
    time_s = np.arange(values.size) / RATE_HZ
    slow = time_s < slow_s
    np.testing.assert_allclose(values[slow], np.sin(BAND[0] * time_s[slow]), atol=1e-12)
    assert values.size == 50.0 * RATE_HZ


def test_trim_and_fades_begin_and_end_at_rest() -> None:
    values = pilot_sweep(**PLAIN, trim_s=3.0, fade_s=1.0)
    assert values.size == 56.0 * RATE_HZ
    assert not values[:3000].any()
    assert not values[-3000:].any()
    # The last moving sample is one step before the end of a fade that closes with sin^2.
    assert abs(values[-3001]) <= (0.5 * math.pi / RATE_HZ) ** 2


def test_noise_has_its_size_and_stays_below_the_band() -> None:
    rng = np.random.default_rng(3)
    noise = pilot_sweep(**PLAIN, trim_s=0.0, fade_s=0.0, noise_fraction=0.1, rng=rng)
    noise = noise - pilot_sweep(**PLAIN, trim_s=0.0, fade_s=0.0)
    # A first-order process of corner w has w T / 2 independent values in T, and its variance a spread of sqrt(2/n).
    spread = math.sqrt(2.0 / (0.5 * BAND[1] * 50.0))
    assert noise.var() == pytest.approx(0.01, rel=4.0 * spread)


def test_noise_needs_a_generator_and_repeats_with_its_seed() -> None:
    with pytest.raises(UsageError, match="rng"):
        pilot_sweep(**PLAIN, noise_fraction=0.1)
    one, two = (pilot_sweep(**PLAIN, noise_fraction=0.1, rng=np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


@settings(max_examples=30, deadline=None)
@given(amplitude=st.floats(0.01, 2.0), low=st.floats(0.1, 5.0), ratio=st.floats(1.5, 50.0), fade=st.floats(0.0, 5.0))
def test_no_sweep_exceeds_its_amplitude(amplitude: float, low: float, ratio: float, fade: float) -> None:
    band = (low, low * ratio)
    common: dict[str, Any] = {"amplitude": amplitude, "band_rad_s": band, "duration_s": 20.0, "sample_rate_hz": 200.0}
    for values in (
        pilot_sweep(**common, fade_s=fade),
        logarithmic_sweep(**common, fade_in_s=fade, fade_out_s=fade),
    ):
        assert values.size == 26 * 200
        assert np.abs(values).max() <= amplitude


def test_logarithmic_sweep_gives_every_octave_the_same_time() -> None:
    values = logarithmic_sweep(**PLAIN, trim_s=0.0, fade_in_s=0.0, fade_out_s=0.0)
    times = zero_crossings_s(values)
    middles, omega = 0.5 * (times[1:] + times[:-1]), math.pi / np.diff(times)
    rise = math.log(BAND[1] / BAND[0])
    late = middles > 10.0
    # The mean over half a period is the value at its middle but for a relative (rise * half period / T)^2 / 24.
    longest = rise * np.diff(times)[late].max() / 50.0
    np.testing.assert_allclose(
        np.log(omega[late] / BAND[0]), rise * middles[late] / 50.0, atol=longest**2 / 24.0 + 1e-4
    )


def test_logarithmic_sweep_holds_its_lowest_frequency_first() -> None:
    values = logarithmic_sweep(**PLAIN, constant_s=10.0, trim_s=0.0, fade_in_s=0.0, fade_out_s=0.0)
    time_s = np.arange(10_000) / RATE_HZ
    np.testing.assert_allclose(values[:10_000], np.sin(BAND[0] * (time_s - 10.0)), atol=1e-12)
    assert abs(values[10_000]) < 1e-12


@pytest.mark.parametrize(
    "change",
    [
        {"band_rad_s": (5.0, 1.0)},
        {"band_rad_s": (0.0, 1.0)},
        {"band_rad_s": (1.0, 4000.0)},
        {"duration_s": 1.0, "fade_s": 1.0},
        {"duration_s": 15.0, "slow_cycles": 2.0},
    ],
)
def test_impossible_pilot_sweeps_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        pilot_sweep(**(PLAIN | change))


@pytest.mark.parametrize("change", [{"constant_s": 50.0}, {"fade_in_s": 30.0, "fade_out_s": 30.0}])
def test_impossible_chirps_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        logarithmic_sweep(**(PLAIN | change))


def test_the_constants_are_those_of_the_book() -> None:
    assert (C1, C2) == (4.0, 0.0187)
