"""Multisines: orthogonal, low in their peaks, zero at both ends; phases and gradients."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.excitation import Multisine, energy_share, halved, harmonics_in, interleaved, multisine, power_law
from rotorid.excitation.multisines import _log_norm, flat_phases, over_period, schroeder_phases

HZ = 2.0 * math.pi


def on_axes(layout: Any, axes: int, *, band_hz: tuple[float, float], period_s: float, exponent: float = 0.0) -> Any:
    combs = layout(axes, band_rad_s=(HZ * band_hz[0], HZ * band_hz[1]), period_s=period_s)
    return [multisine(k, amplitude=1.0, period_s=period_s, powers=power_law(k, exponent)) for k in combs]


# The bar of three axes at once, and beyond: period, band in Hz, axes.
CASES = [
    (20.0, (0.1, 2.0), 3),
    (20.0, (0.2, 2.0), 3),
    (20.0, (0.2, 8.0), 3),
    (10.0, (0.2, 8.0), 3),
    (10.0, (0.2, 2.0), 3),
    (20.0, (0.1, 2.0), 4),
    (20.0, (0.2, 8.0), 4),
]


@pytest.mark.parametrize(("period_s", "band_hz", "axes"), CASES)
def test_peak_factor_of_several_axes_at_once(period_s: float, band_hz: tuple[float, float], axes: int) -> None:
    signals = on_axes(halved, axes, band_hz=band_hz, period_s=period_s)
    assert max(one.relative_peak_factor for one in signals) <= 1.1


@pytest.mark.parametrize(
    ("period_s", "band_hz"), [(20.0, (0.2, 8.0)), pytest.param(10.0, (0.2, 8.0), marks=pytest.mark.slow)]
)
def test_peak_factor_of_equal_spacings(period_s: float, band_hz: tuple[float, float]) -> None:
    signals = on_axes(interleaved, 3, band_hz=band_hz, period_s=period_s)
    assert max(one.relative_peak_factor for one in signals) <= 1.1


@pytest.mark.parametrize("exponent", [-1.0, 1.0])
def test_peak_factor_of_unequal_powers(exponent: float) -> None:
    signals = on_axes(halved, 3, band_hz=(0.2, 8.0), period_s=20.0, exponent=exponent)
    assert max(one.relative_peak_factor for one in signals) <= 1.1
    for one in signals:
        ratio = (one.amplitudes / one.amplitudes[-1]) ** 2
        np.testing.assert_allclose(ratio, power_law(one.harmonics, exponent), rtol=1e-12)


@pytest.mark.parametrize(
    ("layout", "axes"),
    [
        *((halved, axes) for axes in (2, 3, 4)),
        *((interleaved, axes) for axes in (2, 3)),
        pytest.param(interleaved, 4, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("rate_hz", [20.0, 50.0, 400.0])
def test_axes_are_orthogonal_over_every_period(layout: Any, axes: int, rate_hz: float) -> None:
    signals = np.stack([one.sampled(rate_hz, periods=2) for one in on_axes(layout, axes, **SMALL)])
    for window in (slice(0, None), slice(round(10.0 * rate_hz)), slice(round(3.3 * rate_hz), round(13.3 * rate_hz))):
        products = signals[:, window] @ signals[:, window].T
        energies = np.sqrt(np.diag(products))
        np.testing.assert_allclose(products / np.outer(energies, energies), np.eye(axes), atol=1e-12)


SMALL: dict[str, Any] = {"band_hz": (0.2, 2.0), "period_s": 10.0}


def test_axes_stay_orthogonal_however_a_vehicle_delays_them() -> None:
    roll, pitch = on_axes(halved, 2, **SMALL)
    time_s = np.arange(0.0, 10.0, 0.01)
    for delay_s in (0.013, 0.5, 3.1):
        product = roll.at(time_s) @ pitch.at(time_s - delay_s)
        assert abs(product) < 1e-12 * (roll.at(time_s) @ roll.at(time_s))


@settings(max_examples=15, deadline=None)
@given(
    first=st.integers(2, 6),
    step=st.integers(1, 4),
    count=st.integers(1, 12),
    amplitude=st.floats(0.01, 3.0),
    sign=st.sampled_from([-1.0, 1.0]),
    period_s=st.floats(1.0, 60.0),
    seed=st.integers(0, 5),
)
def test_every_multisine_keeps_amplitude_and_ends(
    first: int, step: int, count: int, amplitude: float, sign: float, period_s: float, seed: int
) -> None:
    harmonics = first + step * np.arange(count)
    signal = multisine(harmonics, amplitude=sign * amplitude, period_s=period_s, seed=seed)
    rate_hz = 4096.0 / period_s
    values = signal.sampled(rate_hz)
    assert np.abs(values).max() <= amplitude
    # 4096 samples for at most 50 cycles: the peak is missed by 1 - cos(pi 50 / 4096) and by the bound's own 0.03 %.
    assert np.abs(values).max() >= amplitude * (1.0 - 1.1e-3)
    # The root is found to a rounding of the turn, which the slope of at most 2 pi 50 per turn makes larger.
    assert abs(values[0]) < 1e-12 * amplitude
    assert values[-1] == 0.0
    assert sign * values[1] > 0.0
    assert signal.rms == pytest.approx(math.sqrt(np.mean(values[:-1] ** 2)), rel=1e-12)


def test_energy_stays_inside_the_band() -> None:
    band_hz = (0.2, 8.0)
    for signal in on_axes(halved, 3, band_hz=band_hz, period_s=20.0):
        values = signal.sampled(200.0)[:-1]
        lines = np.abs(np.fft.rfft(values)) ** 2
        outside = np.delete(lines, signal.harmonics).sum()
        assert outside < 1e-24 * lines.sum()
        # Flown once between rests, the edges of its lines spread, but little.
        assert energy_share(values, (HZ * band_hz[0], HZ * band_hz[1]), sample_rate_hz=200.0) > 0.98


def test_periods_repeat_exactly_and_rates_need_not_divide_the_period() -> None:
    (signal,) = on_axes(halved, 1, **SMALL)
    values = signal.sampled(50.0, periods=3)
    assert values.size == 1501
    np.testing.assert_array_equal(values[:500], values[1000:1500])
    odd = signal.sampled(33.37, periods=2)
    assert odd.size == math.ceil(20.0 * 33.37) + 1
    np.testing.assert_allclose(odd[:-1], signal.at(np.arange(odd.size - 1) / 33.37), atol=1e-12)


def test_same_seed_same_signal() -> None:
    harmonics = np.arange(3, 30, 2)
    one, two = (multisine(harmonics, amplitude=1.0, period_s=10.0, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.phases_rad, two.phases_rad)
    again = pickle.loads(pickle.dumps(one))
    np.testing.assert_array_equal(again.at(np.arange(5.0)), one.at(np.arange(5.0)))
    assert not again.phases_rad.flags.writeable


def test_gradient_of_the_norm_is_the_complex_step_of_its_definition() -> None:
    rng = np.random.default_rng(2)
    harmonics, amplitudes = np.array([2, 5, 7]), np.array([1.0, 0.5, 2.0])
    phases, samples, exponent = rng.uniform(0.0, 6.0, 3), 64, 8
    turns = np.outer(np.arange(samples) / samples, harmonics)

    def definition(shifted: np.ndarray) -> complex:
        values = np.cos(2.0 * math.pi * turns + shifted) @ amplitudes
        return complex(np.log(np.mean(values**exponent)) / exponent)

    value, gradient = _log_norm(phases, harmonics, amplitudes, exponent, samples)
    assert value == pytest.approx(definition(phases).real, abs=1e-12)
    steps = [definition(phases + 1e-30j * row).imag / 1e-30 for row in np.eye(3)]
    np.testing.assert_allclose(gradient, steps, atol=1e-12)


@pytest.mark.parametrize("harmonics", [np.arange(2, 40), np.arange(2, 40, 3), np.arange(3, 300, 2)])
def test_flat_phases_beat_those_of_schroeder(harmonics: np.ndarray) -> None:
    amplitudes = np.ones(harmonics.size)
    peaks = [
        np.abs(over_period(harmonics, amplitudes, phases, samples=64 * int(harmonics[-1]))).max()
        for phases in (flat_phases(harmonics, amplitudes), schroeder_phases(amplitudes**2))
    ]
    assert peaks[0] < 0.9 * peaks[1]


@given(
    axes=st.integers(1, 4), lowest=st.floats(0.05, 1.0), highest=st.floats(3.0, 20.0), period_s=st.floats(10.0, 60.0)
)
@settings(max_examples=50, deadline=None)
@pytest.mark.parametrize("layout", [halved, interleaved])
def test_axes_share_every_harmonic_of_the_band_once(
    layout: Any, axes: int, lowest: float, highest: float, period_s: float
) -> None:
    band = (HZ * lowest, HZ * highest)
    combs = layout(axes, band_rad_s=band, period_s=period_s)
    together = np.sort(np.concatenate(combs))
    np.testing.assert_array_equal(together, harmonics_in(band, period_s=period_s))
    assert together[0] >= 2
    assert (together / period_s >= lowest * (1.0 - 1e-8)).all()
    assert (together / period_s <= highest * (1.0 + 1e-8)).all()
    assert all(np.unique(np.diff(comb)).size <= 1 for comb in combs)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: multisine(np.array([1, 2]), amplitude=1.0, period_s=1.0), "from 2 up"),
        (lambda: multisine(np.array([], dtype=int), amplitude=1.0, period_s=1.0), "invalid harmonics none"),
        (lambda: multisine(np.array([2, 3]), amplitude=1.0, period_s=1.0, powers=np.array([1.0, 0.0])), "positive"),
        (lambda: multisine(np.array([2, 3]), amplitude=0.0, period_s=1.0), "other than zero"),
        (lambda: multisine(np.array([3, 2]), amplitude=1.0, period_s=1.0), "rising"),
        (lambda: halved(4, band_rad_s=(HZ * 0.2, HZ * 0.3), period_s=10.0), "lengthen"),
        (lambda: interleaved(0, band_rad_s=(HZ * 0.2, HZ * 0.3), period_s=10.0), "a harmonic for each axis"),
        (
            lambda: Multisine(harmonics=[2], amplitudes=[1.0], phases_rad=[0.0], period_s=1.0).sampled(4.0),
            "sample rate",
        ),
        (
            lambda: Multisine(harmonics=[2], amplitudes=[1.0, 2.0], phases_rad=[0.0], period_s=1.0),
            "one of each per harmonic",
        ),
    ],
)
def test_impossible_multisines_are_refused(call: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        call()
