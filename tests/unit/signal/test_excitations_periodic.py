"""Multisines are told from other motion by their period, and their band by their lines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.excitation.plan import together
from rotorid.signal.excitations import classify, lines_of, period_of
from rotorid.typing import FloatArray

RATE_HZ = 100.0


def three(period_s: float, periods: int) -> list[FloatArray]:
    inputs = together(
        {"roll": 0.2, "pitch": 0.2, "yaw": 0.2},
        start_s=0.0,
        band_rad_s=(2.0, 30.0),
        period_s=period_s,
        sample_rate_hz=RATE_HZ,
        periods=periods,
    )
    return [one.values for one in inputs]


@pytest.mark.parametrize("periods", [2, 3])
def test_each_axis_of_a_multisine_is_one_with_its_own_band(periods: int) -> None:
    for values in three(15.0, periods):
        time_s = np.arange(values.size) / RATE_HZ
        kind, band = classify(time_s, values)
        assert kind == "multisine"
        assert band is not None
        line = 2.0 * np.pi / 15.0
        # Axes share the lines, so that the first of one is at most eight lines from the lower edge.
        assert 2.0 - line <= band[0] <= 2.0 + 8.0 * line
        assert 30.0 - 8.0 * line <= band[1] <= 30.0 + line


def test_an_axis_with_even_lines_alone_repeats_in_half_the_time() -> None:
    second = three(16.0, 2)[1]
    period = period_of(np.arange(second.size) / RATE_HZ, second, shortest_s=4.0)
    assert period == pytest.approx(8.0, abs=2.0 / RATE_HZ)


@settings(deadline=None)
@given(st.integers(0, 40))
def test_noise_does_not_repeat(seed: int) -> None:
    from scipy.signal import butter, lfilter

    b, a = butter(2, 0.1)
    values = lfilter(b, a, np.random.default_rng(seed).standard_normal(4000))
    assert period_of(np.arange(4000) / RATE_HZ, np.asarray(values), shortest_s=4.0) is None


def test_a_sine_has_a_period_and_no_lines() -> None:
    time_s = np.arange(0.0, 40.0, 0.02)
    values = np.sin(2.0 * np.pi * 0.2 * time_s)
    period = period_of(time_s, values, shortest_s=4.0)
    assert period == pytest.approx(5.0)
    assert lines_of(time_s, values, 5.0) is None
    assert classify(time_s, values)[0] == "other"


def test_noise_of_a_fifth_hides_no_period() -> None:
    values = three(15.0, 2)[0]
    noisy = values + 0.2 * values.std() * np.random.default_rng(0).standard_normal(values.size)
    assert period_of(np.arange(values.size) / RATE_HZ, noisy, shortest_s=4.0) == pytest.approx(15.0, abs=0.02)
