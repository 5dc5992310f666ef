"""The matrix exponential and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

from rotorid.simulation.sensitivity import exponential_tangent


@pytest.mark.parametrize("size", [1e-8, 0.1, 1.0, 20.0])
def test_values_and_derivatives_are_those_of_scipy(size: float) -> None:
    rng = np.random.default_rng(0)
    matrix, moves = size * rng.standard_normal((5, 5)), rng.standard_normal((3, 5, 5))
    value, slope = exponential_tangent(matrix, moves)
    # Squaring doubles the rounding error each time; the norm says how often.
    rounding = 1e-14 * max(1.0, np.linalg.norm(matrix, 1)) ** 2
    assert np.allclose(value, expm(matrix), rtol=0.0, atol=rounding * np.abs(expm(matrix)).max())
    for move, derived in zip(moves, slope, strict=True):
        exact = expm_frechet(matrix, move, compute_expm=False)
        assert np.allclose(derived, exact, rtol=0.0, atol=rounding * np.abs(exact).max())


def test_a_stiff_decay_is_zero_and_not_noise() -> None:
    value, slope = exponential_tangent(np.diag([-1e5, -1.0]), np.eye(2)[None])
    assert value[0, 0] == 0.0
    # Scaling to a norm below one loses as many digits as the norm has.
    assert value[1, 1] == pytest.approx(np.exp(-1.0), rel=1e5 * np.finfo(np.float64).eps)
    assert slope[0, 0, 0] == 0.0


def test_the_zero_matrix_moves_with_the_direction() -> None:
    value, slope = exponential_tangent(np.zeros((2, 2)), np.ones((1, 2, 2)))
    assert np.array_equal(value, np.eye(2))
    assert np.array_equal(slope[0], np.ones((2, 2)))


def test_what_is_no_number_stays_none() -> None:
    value, slope = exponential_tangent(np.array([[np.inf]]), np.zeros((1, 1, 1)))
    assert np.isnan(value).all()
    assert np.isnan(slope).all()
