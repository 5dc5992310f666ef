"""Filters that run forward and backward are SciPy's, to the last bit."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from rotorid.signal.airborne import _moving_mean
from rotorid.signal.zero_phase import forward_backward, section


@pytest.mark.parametrize("shape", ["lowpass", "highpass"])
@pytest.mark.parametrize("cutoff", [1e-4, 3e-3, 0.07, 0.5, 0.9])
def test_sections_are_those_of_scipy(cutoff: float, shape: Literal["lowpass", "highpass"]) -> None:
    np.testing.assert_array_equal(section(cutoff, shape), butter(2, cutoff, btype=shape, output="sos")[0])


@pytest.mark.parametrize("padding", [0, 20, 399])
@pytest.mark.parametrize("shape", [(400,), (3, 400), (2, 2, 400)])
def test_runs_are_those_of_scipy(shape: tuple[int, ...], padding: int) -> None:
    values = np.random.default_rng(2).standard_normal(shape)
    sections = np.stack([section(0.3, "lowpass"), section(0.01, "highpass")])
    expected = sosfiltfilt(sections, values, axis=-1, padlen=padding)
    np.testing.assert_array_equal(forward_backward(sections, values, padding), expected)


@pytest.mark.parametrize("window", [2, 7, 50, 300])
def test_moving_means_are_those_of_scipy(window: int) -> None:
    values = np.random.default_rng(3).standard_normal((3, 200))
    np.testing.assert_array_equal(
        _moving_mean(values, window), uniform_filter1d(values, window, axis=1, mode="nearest")
    )
