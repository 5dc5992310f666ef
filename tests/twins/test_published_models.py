"""Twins of every published model: flown in gusts, identified, and inside their own bounds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.twin_flights import TWINS, Result, identify

from rotorid.errors import InsufficientDataError, RotoridError
from rotorid.uncertainty.cramer_rao import Weights

FLIGHTS = 400
LEAST_COVERAGE, LARGEST_COVERAGE = 0.91, 0.985
MOST_LEFT_OUT = 0.10
WEIGHTS: tuple[Weights, ...] = ("cifer", "covariance")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name.startswith("hover") else ()) for name in TWINS]
)
def test_a_flight_gives_the_truth_back_within_its_bounds(name: str) -> None:
    """Three flights of every model: no parameter is off by more than five of its standard deviations."""
    for seed in range(3):
        result = identify(TWINS[name], seed)
        for weights in WEIGHTS:
            off = np.abs(result.error[weights]) / result.std[weights]
            assert off.max() < 5.0, (weights, dict(zip(result.names, off.round(1), strict=True)))


class Study(NamedTuple):
    """Flights of a twin: those that are judged, and how many are not, by why."""

    judged: list[Result]
    left_out: Counter[str]


def study(name: str, count: int, fly: Callable[[int], Result] | None = None) -> Study:
    """Flights that kept the same parameters as most; those that were refused or dropped others are counted."""
    fly = fly or (lambda seed: identify(TWINS[name], seed))
    results, left_out = [], Counter[str]()
    for seed in range(count):
        try:
            results.append(fly(seed))
        except RotoridError as error:
            left_out[f"refused: {error.came}"] += 1
    names = Counter(result.names for result in results)
    usual = names.most_common(1)[0][0] if names else ()
    for kept, times in names.items():
        if kept != usual:
            left_out[f"kept {', '.join(kept)}"] += times
    return Study([result for result in results if result.names == usual], left_out)


def coverage(results: list[Result], weights: Weights) -> dict[str, float]:
    """Share of the flights in which the interval of 95 % covers the truth, by parameter."""
    inside = [np.abs(result.error[weights]) <= 1.96 * result.std[weights] for result in results]
    return dict(zip(results[0].names, np.mean(inside, axis=0), strict=True))


def test_flights_that_are_left_out_are_counted() -> None:
    def fly(seed: int) -> Result:
        if seed == 3:
            raise InsufficientDataError("a flight that shows nothing", needed="one that does")
        names = ("L_p", "L_roll") if seed != 5 else ("L_roll",)
        one = np.ones(len(names))
        return Result(names=names, error={"cifer": 0.5 * one}, std={"cifer": one})

    found = study("axis.pitch", 8, fly)
    assert len(found.judged) == 6
    assert dict(found.left_out) == {"refused: a flight that shows nothing": 1, "kept L_roll": 1}
    assert coverage(found.judged, "cifer") == {"L_p": 1.0, "L_roll": 1.0}


class Miss(NamedTuple):
    """Why a twin misses the bar, and how far it may: least coverage, and least rms of error over stated deviation."""

    reason: str
    least_coverage: float = LEAST_COVERAGE
    least_rms: float = 0.8


def require_no_more(miss: Miss, results: list[Result], found: Mapping[str, float]) -> None:
    """Fail, and not as expected, where a twin misses by more than it may."""
    rms = np.sqrt(np.mean([(one.error["covariance"] / one.std["covariance"]) ** 2 for one in results], axis=0))
    if min(found.values()) < miss.least_coverage or rms.min() < miss.least_rms:
        pytest.fail(f"beyond what is known: coverage {found}, rms {rms.round(2)}")


MISSED = {
    "hover.longitudinal": Miss(
        "parameters that the lowest frequencies alone show scatter up to 1.6 times as much as stated",
        least_coverage=0.74,
    ),
    "hover.lateral": Miss(
        "several parameters cover 82 to 89 % only: errors do not factor as stated where every output has shares of "
        "the windows of its own",
        least_coverage=0.78,
    ),
    "rig.roll": Miss(
        "a sweep of two minutes passes each frequency once, in two or three windows, from which scatter is hardly "
        "told: errors are 1.5 to 1.9 times the random deviations; flown for eight minutes, 0.8 to 0.9 times",
        least_coverage=0.62,
    ),
}


def test_a_miss_beyond_its_bound_is_no_expected_one() -> None:
    def made(error: float) -> list[Result]:
        one = np.ones(1)
        return [Result(names=("L_p",), error={"covariance": error * one}, std={"covariance": one})] * 4

    miss = Miss("", least_coverage=0.8, least_rms=0.5)
    require_no_more(miss, made(0.6), {"L_p": 0.82})
    for error, share in ((0.6, 0.2), (0.1, 1.0)):
        with pytest.raises(pytest.fail.Exception, match="beyond what is known"):
            require_no_more(miss, made(error), {"L_p": share})


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.xfail(strict=True, raises=AssertionError, reason=MISSED[name].reason))
        if name in MISSED
        else name
        for name in TWINS
    ],
)
def test_intervals_of_95_percent_cover_the_truth(name: str) -> None:
    flights = study(name, FLIGHTS)
    found = coverage(flights.judged, "covariance")
    if name in MISSED:
        require_no_more(MISSED[name], flights.judged, found)
    assert flights.left_out.total() <= MOST_LEFT_OUT * FLIGHTS, flights.left_out
    assert min(found.values()) >= LEAST_COVERAGE, (found, flights.left_out)
    assert max(found.values()) <= LARGEST_COVERAGE, (found, flights.left_out)
