"""The filters that both sides pass, and when vibration asks for one."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.verification.sampled import VIBRATION_LOW_PASS_RAD_S, chosen_low_pass, low_pass, vibration
from rotorid.verification.scores import scaled_guidelines

RATE_HZ = 400.0
TIME_S = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
BAND = (1.0, 50.0)


def flight(shaking: float) -> np.ndarray:
    return (np.sin(6.0 * TIME_S) + shaking * np.sin(400.0 * TIME_S))[None]


@pytest.mark.parametrize("shaking", [0.1, 0.5])
def test_vibration_is_power_above_the_band(shaking: float) -> None:
    assert vibration(flight(shaking), BAND, RATE_HZ)[0] == pytest.approx(shaking**2, rel=1e-2)


@pytest.mark.parametrize(("shaking", "cutoff"), [(0.0, None), (0.2, None), (0.5, VIBRATION_LOW_PASS_RAD_S)])
def test_a_low_pass_is_chosen_where_more_than_a_tenth_of_the_power_is_above(
    shaking: float, cutoff: float | None
) -> None:
    assert chosen_low_pass("auto", flight(shaking), BAND, RATE_HZ) == cutoff


def test_a_choice_is_obeyed() -> None:
    assert chosen_low_pass(None, flight(1.0), BAND, RATE_HZ) is None
    assert chosen_low_pass(30.0, flight(0.0), BAND, RATE_HZ) == 30.0


def test_the_low_pass_is_of_first_order_and_begins_settled() -> None:
    cutoff = 40.0
    smooth = low_pass(cutoff, RATE_HZ)
    np.testing.assert_allclose(smooth(np.full((1, 50), 3.0)), 3.0, rtol=1e-12)
    tone = smooth(np.sin(cutoff * TIME_S)[None])[0, round(RATE_HZ) :]
    # -3 dB at its cutoff; the bilinear transform is warped to meet it there.
    assert np.abs(tone).max() == pytest.approx(np.sqrt(0.5), rel=2e-3)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.pi * RATE_HZ])
def test_an_impossible_cutoff_is_refused(cutoff: float) -> None:
    with pytest.raises(UsageError, match="Nyquist"):
        low_pass(cutoff, RATE_HZ)


def test_both_readings_of_the_guideline_are_given() -> None:
    root, printed = scaled_guidelines(16.0)
    assert root == pytest.approx((4.0, 8.0))
    assert printed == pytest.approx((16.0, 32.0))
