"""The spline is SciPy's, to the last bit."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rotorid.signal.spline import cubic_spline


@pytest.mark.parametrize("derivative", [0, 1])
@pytest.mark.parametrize("shape", [(2,), (3,), (4,), (300,), (3, 50), (2, 3, 20)])
def test_is_that_of_scipy(shape: tuple[int, ...], derivative: Literal[0, 1]) -> None:
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(1e-4, 1.0, shape[-1]))
    values = rng.standard_normal(shape)
    at_s = np.concatenate([time_s, rng.uniform(time_s[0] - 0.5, time_s[-1] + 0.5, 200)])
    expected = CubicSpline(time_s, values, axis=-1)(at_s, derivative)
    np.testing.assert_array_equal(cubic_spline(time_s, values, at_s, derivative=derivative), expected)
