"""Errors of joint estimates where feedback rules the input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid.spectral.errors import weak_instrument_factor

POSITIVE = st.floats(1e-6, 1e6)


@given(variance=POSITIVE, noise=POSITIVE, residual=st.complex_numbers(max_magnitude=1e3, allow_nan=False))
def test_an_instrument_that_explains_the_input_costs_only_what_feedback_adds(
    variance: float, noise: float, residual: complex
) -> None:
    scale = variance / noise
    center = scale * abs(residual)
    expected = (center + np.sqrt(center**2 + variance)) / np.sqrt(variance)
    factor = weak_instrument_factor(np.array(variance), np.array(noise), np.array(0.0), np.array(residual))
    assert float(factor) == pytest.approx(np.clip(expected, 1.0, 1e3), rel=1e-9)


@given(strength=st.floats(0.03, 0.99), residual=st.floats(0.0, 3.0), angle=st.floats(0.0, 6.2))
def test_the_farthest_point_lies_on_the_boundary_of_what_explains_the_data(
    strength: float, residual: float, angle: float
) -> None:
    variance, noise = 0.3, 2.0
    scale = variance / noise
    cross = residual * np.exp(1j * angle)
    factor = float(
        weak_instrument_factor(np.array(variance), np.array(noise), np.array((1.0 - strength) / scale), np.array(cross))
    )
    delta = -factor * np.sqrt(variance) * np.exp(1j * angle)
    explained = scale * (noise - 2.0 * (np.conj(delta) * cross).real + abs(delta) ** 2 * (1.0 - strength) / scale)
    assert abs(delta) ** 2 == pytest.approx(explained, rel=1e-9)


def test_an_unbounded_disk_says_that_nothing_is_known() -> None:
    factor = weak_instrument_factor(np.array([1.0]), np.array([1.0]), np.array([1.5]), np.array([0j]))
    assert factor.tolist() == [1e3]
