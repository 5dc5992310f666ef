"""Filters: the promised gain, no phase, the same on all channels."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.filters import band_pass, high_pass, low_pass
from rotorid.typing import FloatArray

RATE_HZ = 1000.0
TIME_S = np.arange(0.0, 40.0, 1.0 / RATE_HZ)


def history(*rows: FloatArray) -> TimeHistory:
    return TimeHistory(
        values=np.stack(rows),
        channels=tuple(Channel(name=f"c{index}", unit="1") for index in range(len(rows))),
        sample_rate_hz=RATE_HZ,
        start_s=5.0,
        processing=("read",),
    )


def gain(values: FloatArray, omega_rad_s: float) -> complex:
    """Least squares on a tone, away from the ends; the real part is in phase with the sine that came in."""
    inner = slice(10000, -10000)
    basis = np.stack([np.sin(omega_rad_s * TIME_S), np.cos(omega_rad_s * TIME_S)])[:, inner]
    sine, cosine = np.linalg.lstsq(basis.T, values[inner], rcond=None)[0]
    return complex(sine, cosine)


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("omega_rad_s", [4.0, 10.0, 25.0])
def test_low_and_high_pass_have_the_gain_of_their_docstring(order: int, omega_rad_s: float) -> None:
    tone = history(np.sin(omega_rad_s * TIME_S))
    ratio = (omega_rad_s / 10.0) ** (2 * order)
    # The bilinear transform warps frequencies by (ω h)²/12 = 5e-5, and the gain by 2 n times that.
    low = gain(low_pass(tone, cutoff_rad_s=10.0, order=order)["c0"], omega_rad_s)
    assert low == pytest.approx(1.0 / (1.0 + ratio), abs=5e-4)
    high = gain(high_pass(tone, cutoff_rad_s=10.0, order=order)["c0"], omega_rad_s)
    assert high == pytest.approx(ratio / (1.0 + ratio), abs=5e-4)


def test_half_is_left_at_both_ends_of_a_band() -> None:
    for omega_rad_s, expected in ((5.0, 0.5), (20.0, 0.5), (10.0, 1.0)):
        filtered = band_pass(history(np.sin(omega_rad_s * TIME_S)), band_rad_s=(5.0, 20.0))
        assert gain(filtered["c0"], omega_rad_s) == pytest.approx(expected, abs=2e-3)


def test_all_channels_pass_one_filter() -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal(TIME_S.size)
    filtered = low_pass(history(a, 3.0 * a + 1.0), cutoff_rad_s=50.0)
    np.testing.assert_allclose(filtered["c1"], 3.0 * filtered["c0"] + 1.0, atol=1e-9)
    assert filtered.start_s == 5.0
    assert filtered.processing[0] == "read"
    assert "low-pass at 50 rad/s" in filtered.processing[1]


def test_edge_effects_end_where_it_is_said() -> None:
    """A step at the very end of the record is felt by 1 % of itself, and no more, beyond the noted time."""
    values = np.zeros(TIME_S.size)
    plain = low_pass(history(values), cutoff_rad_s=10.0)["c0"]
    values[-1] = 1.0
    touched = low_pass(history(values), cutoff_rad_s=10.0)
    settling_s = -np.log(0.01) / (10.0 * np.sin(np.pi / 8.0))
    assert f"within {settling_s:.2f} s" in touched.processing[-1]
    assert np.abs(touched["c0"] - plain)[TIME_S[-1] - settling_s > TIME_S].max() <= 0.01


def test_means_survive_a_low_pass_and_not_a_high_pass() -> None:
    constant = history(np.full(TIME_S.size, 4.0))
    np.testing.assert_allclose(low_pass(constant, cutoff_rad_s=3.0)["c0"], 4.0, rtol=1e-9)
    np.testing.assert_allclose(high_pass(constant, cutoff_rad_s=3.0)["c0"], 0.0, atol=1e-9)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.pi * RATE_HZ, 1e9, float("nan")])
def test_bad_cutoffs_are_refused(cutoff: float) -> None:
    with pytest.raises(UsageError, match="cutoff"):
        low_pass(history(TIME_S), cutoff_rad_s=cutoff)
    with pytest.raises(UsageError):
        band_pass(history(TIME_S), band_rad_s=(cutoff, 10.0))


def test_other_bad_calls_are_refused() -> None:
    with pytest.raises(UsageError, match="empty"):
        band_pass(history(TIME_S), band_rad_s=(10.0, 10.0))
    with pytest.raises(UsageError, match="order"):
        low_pass(history(TIME_S), cutoff_rad_s=10.0, order=0)
    with pytest.raises(InsufficientDataError, match="settle"):
        high_pass(history(TIME_S[:100]), cutoff_rad_s=0.1)
    with pytest.raises(InsufficientDataError, match="finite"):
        low_pass(history(np.where(TIME_S > 39.0, np.nan, 0.0)), cutoff_rad_s=10.0)
