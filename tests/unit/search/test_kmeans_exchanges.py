"""What a K-means search says of its exchanges: every point has one owner, the nearest candidate, until none moves."""

from __future__ import annotations

import numpy as np
from tests.unit.search.problems import late, rate_problem

from rotorid.search.catalog import search


def test_every_point_belongs_to_the_candidate_with_the_nearest_response() -> None:
    problem = late()
    found = search("kmeans:3").run(problem, budget=300, seed=0)
    assert len(found.exchanges) >= 2
    for exchange in found.exchanges:
        costs = problem.point_costs(exchange.thetas)
        np.testing.assert_array_equal(exchange.owners, np.argmin(costs, axis=0))
        np.testing.assert_allclose(exchange.costs, costs.sum(axis=1))
    assert (np.diff([exchange.evaluations for exchange in found.exchanges]) > 0).all()


def test_the_exchanges_end_where_no_point_moves() -> None:
    found = search("kmeans:3").run(rate_problem(), budget=600, seed=0)
    before, last = found.exchanges[-2:]
    np.testing.assert_array_equal(before.owners, last.owners)


def test_other_searches_share_no_points() -> None:
    assert search("sobol").run(rate_problem(), budget=60, seed=0).exchanges == ()
