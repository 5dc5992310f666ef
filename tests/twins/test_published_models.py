"""Twins of every published model: flown in gusts, identified, and inside their own bounds."""

from __future__ import annotations

import numpy as np
import pytest
from tests.twins.twin_flights import TWINS, Result, identify

from rotorid.uncertainty.bounds import Weights

FLIGHTS = 400
LEAST_COVERAGE, LARGEST_COVERAGE = 0.91, 0.985
WEIGHTS: tuple[Weights, ...] = ("cifer", "covariance")


@pytest.mark.parametrize("name", TWINS)
def test_a_flight_gives_the_truth_back_within_its_bounds(name: str) -> None:
    """Three flights of every model: no parameter is off by more than five of its standard deviations."""
    for seed in range(3):
        result = identify(TWINS[name], seed)
        for weights in WEIGHTS:
            off = np.abs(result.error[weights]) / result.std[weights]
            assert off.max() < 5.0, (weights, dict(zip(result.names, off.round(1), strict=True)))


def study(name: str, count: int) -> list[Result]:
    """The flights in which the fit kept the same parameters as in most."""
    results = [identify(TWINS[name], seed) for seed in range(count)]
    names = [result.names for result in results]
    usual = max(set(names), key=names.count)
    return [result for result in results if result.names == usual]


def coverage(results: list[Result], weights: Weights) -> dict[str, float]:
    """Share of the flights in which the interval of 95 % covers the truth, by parameter."""
    inside = [np.abs(result.error[weights]) <= 1.96 * result.std[weights] for result in results]
    return dict(zip(results[0].names, np.mean(inside, axis=0), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in TWINS if not name.startswith("hover")])
def test_intervals_of_95_percent_cover_the_truth(name: str) -> None:
    found = coverage(study(name, FLIGHTS), "covariance")
    assert min(found.values()) >= LEAST_COVERAGE, found


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="in gusts that move the vehicle as much as the sweeps do, the parameters that only the lowest frequencies "
    "show (M_u, Z_u, L_v, X_q) scatter up to 1.6 times as much as stated: there instruments are weak, and the estimate "
    "is a ratio whose denominator holds the same gusts",
)
@pytest.mark.parametrize("name", [name for name in TWINS if name.startswith("hover")])
def test_intervals_of_hover_models_cover_the_truth(name: str) -> None:
    found = coverage(study(name, FLIGHTS), "covariance")
    assert min(found.values()) >= LEAST_COVERAGE, found
    assert max(found.values()) <= LARGEST_COVERAGE, found
