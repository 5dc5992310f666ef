"""Sums of errors by their gain are those of the samples."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.search.acceleration import absolute_sum, squared_sum
from rotorid.typing import FloatArray

RNG = np.random.default_rng(0)
MADE, CARRIED = RNG.standard_normal((2, 500)) + np.array([[9.8], [0.1]])
# Samples at which nothing is carried have an error whatever the gain is.
CARRIED[::7] = 0.0
GAINS = np.concatenate([np.linspace(-30.0, 30.0, 41), MADE[1:4] / CARRIED[1:4], [0.0, 1e6]])


@pytest.mark.parametrize("weights", [None, RNG.random(500)], ids=["alike", "weighted"])
@pytest.mark.parametrize(("total", "power"), [(absolute_sum, 1), (squared_sum, 2)])
def test_sums_are_those_of_the_samples(total: type, power: int, weights: FloatArray | None) -> None:
    errors = np.abs(MADE - GAINS[:, None] * CARRIED) ** power
    found = total(MADE, CARRIED, weights)
    np.testing.assert_allclose(found(GAINS), errors @ (np.ones(500) if weights is None else weights), rtol=1e-12)
    around = found.best * np.array([1.0, 0.999, 1.001])
    assert np.argmin(found(around)) == 0


def test_a_sum_without_errors_is_zero() -> None:
    """Distances are counted from the best gain, so that rounding is as small as the errors are."""
    assert absolute_sum(3.0 * CARRIED, CARRIED)(np.array([3.0]))[0] <= 1e-12
    assert squared_sum(3.0 * CARRIED, CARRIED)(np.array([3.0]))[0] <= 1e-12


@pytest.mark.parametrize("total", [absolute_sum, squared_sum])
def test_a_gain_that_is_no_number_has_no_sum(total: type) -> None:
    assert not np.isfinite(total(MADE, CARRIED)(np.array([np.nan, np.inf, -np.inf]))).any()


@pytest.mark.parametrize("total", [absolute_sum, squared_sum])
def test_where_nothing_is_carried_no_gain_is_best(total: type) -> None:
    assert np.isnan(total(MADE, np.zeros(500)).best)
