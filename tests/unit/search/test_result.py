"""Distinct minima of many local searches, and which of many vectors are worth one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.search.problems import Valleys

from rotorid.errors import InsufficientDataError
from rotorid.fitting.least_squares import Outcome
from rotorid.search.result import basins, worth_polishing

PLACES = Valleys.places


def test_shares_count_where_searches_ended() -> None:
    counts = (5, 1, 3, 1)
    starts = np.repeat(PLACES, counts, axis=0) * 1.05
    found = [Valleys().polish(start) for start in starts]
    best, minima = basins(found, name="valleys")
    assert np.all(np.sign(best.theta) == [1.0, 1.0])
    shares = {tuple(np.sign(one.theta)): one.share for one in minima}
    assert shares == {tuple(place): pytest.approx(count / 10) for place, count in zip(PLACES, counts, strict=True)}


def test_searches_without_rest_are_in_no_basin_unless_they_are_the_best() -> None:
    first, other = (Valleys().polish(place * 1.05) for place in PLACES[:2])
    lost = replace(other, theta=other.theta + 1.0, outcome=Outcome.OUT_OF_ITERATIONS)
    assert [one.share for one in basins([first, lost], name="valleys")[1]] == [1.0]
    lower = replace(lost, cost=0.5 * first.cost)
    best, minima = basins([first, lower], name="valleys")
    assert best.cost == lower.cost
    assert [one.share for one in minima] == [0.5, 0.5]


def test_no_finite_end_is_said() -> None:
    nowhere = replace(Valleys().polish(PLACES[0]), cost=np.inf)
    with pytest.raises(InsufficientDataError, match="valleys"):
        basins([nowhere], name="valleys")


def test_the_feet_of_all_valleys_are_worth_polishing() -> None:
    shares = np.random.default_rng(0).random((600, 2))
    problem = Valleys()
    costs = problem.many_costs(problem.search_box.at(shares))
    chosen = worth_polishing(shares, costs, count=4)
    assert chosen[0] == np.argmin(costs)
    assert np.all(np.diff(costs[chosen]) > 0.0)
    feet = problem.search_box.at(shares[chosen])
    assert {tuple(np.sign(foot)) for foot in feet} == {tuple(place) for place in PLACES}


def test_nothing_without_a_value_is_chosen() -> None:
    shares = np.linspace(0.0, 1.0, 5)[:, None]
    costs = np.array([np.inf, 3.0, np.inf, 1.0, np.inf])
    assert worth_polishing(shares, costs, count=8).tolist() == [3, 1]
    assert worth_polishing(shares, np.full(5, np.inf), count=8).size == 0
