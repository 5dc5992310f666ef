"""Tapers and the rules for window lengths."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.windows import HALF_SINE, HANN, WINDOWS, Taper, plan_windows


@pytest.mark.parametrize("count", [1, 2, 7, 500])
def test_tapers_are_the_classic_ones(count: int) -> None:
    phase = np.pi * (np.arange(count) + 0.5) / count
    assert np.allclose(HALF_SINE.samples(count), np.sin(phase), atol=1e-14)
    assert np.allclose(HANN.samples(count), np.sin(phase) ** 2, atol=1e-14)


@pytest.mark.parametrize(("taper", "mean_square"), [(HALF_SINE, 0.5), (HANN, 0.375)], ids=["half_sine", "hann"])
def test_mean_square_is_that_of_the_samples(taper: Taper, mean_square: float) -> None:
    # Sums of sinusoids over whole periods are exact for any count above their order.
    for count in (5, 64, 1001):
        assert np.mean(taper.samples(count) ** 2) == pytest.approx(mean_square, abs=1e-14)
    assert taper.mean_square == mean_square


def test_a_root_mean_square_would_shift_hann_densities_by_two_decibels() -> None:
    # 0.612 is printed here and there as Hann's constant: it is the root of 0.375, and densities would be 2.1 dB low.
    root = np.sqrt(HANN.mean_square)
    assert root == pytest.approx(0.612, abs=5e-4)
    assert 10.0 * np.log10(HANN.mean_square / root) == pytest.approx(-2.13, abs=5e-3)


def test_long_records_follow_every_rule() -> None:
    band = (0.6, 60.0)
    plan = plan_windows(120.0, 240.0, band)
    assert len(plan.lengths_s) == WINDOWS
    assert plan.lengths_s[0] == pytest.approx(min(120.0 / 2.0, 240.0 / 5.0))
    assert plan.lengths_s[-1] == pytest.approx(20.0 * 2.0 * np.pi / band[1])
    ratios = np.divide(plan.lengths_s[1:], plan.lengths_s[:-1])
    assert np.allclose(ratios, ratios[0])
    assert plan.findings == ()
    assert plan.lowest_rad_s == pytest.approx(2.0 * 2.0 * np.pi / plan.lengths_s[0])


def test_on_a_short_record_the_longest_window_yields_and_a_finding_says_so() -> None:
    period_s = 2.0 * np.pi / 0.5
    plan = plan_windows(45.0, 45.0, (0.5, 60.0))
    assert plan.lengths_s[0] == pytest.approx(period_s)
    (finding,) = plan.findings
    assert (finding.kind, finding.severity) == ("record_too_short", "warning")
    assert finding.numbers["longest_window_s"] == pytest.approx(period_s)


def test_the_longest_window_never_exceeds_half_of_the_record() -> None:
    plan = plan_windows(20.0, 20.0, (0.3, 60.0))
    assert plan.lengths_s[0] == pytest.approx(10.0)
    assert plan.findings


def test_nearly_equal_lengths_become_one() -> None:
    # One hundred seconds and a top of 6.6 rad/s: longest 20 s, shortest 19 s.
    plan = plan_windows(100.0, 100.0, (0.7, 6.6))
    assert plan.lengths_s == pytest.approx((20.0,))


def test_a_record_shorter_than_two_windows_is_refused() -> None:
    band, two_windows_s = (1.0, 100.0), 2.0 * 2.0 * 2.0 * np.pi / 100.0
    assert plan_windows(1.01 * two_windows_s, 10.0, band).findings
    with pytest.raises(InsufficientDataError, match="two windows") as caught:
        plan_windows(0.99 * two_windows_s, 10.0, band)
    (finding,) = caught.value.findings
    assert (finding.kind, finding.severity) == ("record_too_short", "error")
    assert finding.numbers["window_s"] == pytest.approx(two_windows_s / 2.0)


@pytest.mark.parametrize("band", [(0.0, 10.0), (10.0, 10.0), (10.0, 1.0)])
def test_an_empty_band_is_refused(band: tuple[float, float]) -> None:
    with pytest.raises(UsageError, match="band"):
        plan_windows(100.0, 100.0, band)
