"""Twins of every published model: flown in gusts, identified, and inside their own bounds."""

from __future__ import annotations

import numpy as np
import pytest
from tests.twins.twin_flights import TWINS, Result, identify

from rotorid.uncertainty.cramer_rao import Weights

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


MISSED = {
    "hover.longitudinal": "parameters that the lowest frequencies alone show scatter up to 1.6 times as much as stated",
    "hover.lateral": "several parameters cover 82 to 89 % only: errors do not factor as stated where every output "
    "has shares of the windows of its own",
    "axis.pitch": "intervals are up to a third too wide: residuals count as too large where weights know the errors",
    "rig.roll": "intervals are up to twice too wide: long windows see each frequency of a sweep once",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.xfail(strict=True, reason=MISSED[name])) if name in MISSED else name
        for name in TWINS
    ],
)
def test_intervals_of_95_percent_cover_the_truth(name: str) -> None:
    found = coverage(study(name, FLIGHTS), "covariance")
    assert min(found.values()) >= LEAST_COVERAGE, found
    assert max(found.values()) <= LARGEST_COVERAGE, found
