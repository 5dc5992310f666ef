"""Sticks of an ordinary flight."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.excitation.sticks import RADIO_HZ, STEPS_OF_STICK, everyday_stick


def stick(rate_hz: float = 250.0, level: float = 0.5, seed: int = 0) -> np.ndarray:
    return everyday_stick(level=level, duration_s=120.0, sample_rate_hz=rate_hz, rng=np.random.default_rng(seed))


def test_a_radio_sends_it_in_stairs_at_50_hz() -> None:
    values = stick()
    turns = np.flatnonzero(np.diff(values)) + 1
    # 250 Hz: every fifth tick may bring a new value, no other one.
    assert set((turns % 5).tolist()) == {0}
    assert turns.size > 0.3 * 120.0 * RADIO_HZ
    assert np.allclose(values * STEPS_OF_STICK, np.round(values * STEPS_OF_STICK))


def test_it_moves_most_below_three_hertz_and_still_reaches_faster() -> None:
    values = stick(seed=1)
    power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
    frequency_hz = np.fft.rfftfreq(values.size, 1.0 / 250.0)
    share = power[frequency_hz < 3.0].sum() / power.sum()
    assert 0.85 < share < 0.99
    assert np.abs(values).max() <= 0.5
    assert 0.05 < values.std() < 0.3


def test_same_seed_same_stick_and_another_is_another() -> None:
    assert np.array_equal(stick(), stick())
    assert not np.array_equal(stick(), stick(seed=1))


@pytest.mark.parametrize(("level", "duration_s"), [(0.0, 10.0), (1.5, 10.0), (0.5, 0.0), (float("nan"), 10.0)])
def test_what_no_stick_does_is_refused(level: float, duration_s: float) -> None:
    with pytest.raises(UsageError):
        everyday_stick(level=level, duration_s=duration_s, sample_rate_hz=250.0, rng=np.random.default_rng(0))
