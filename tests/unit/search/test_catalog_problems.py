"""Every problem of the package as what a search minimizes: one cost, point by point, with its own local search."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from tests.unit.fitting.time.test_nonlinear import problem as sled
from tests.unit.search.problems import oscillator_problem, rate_problem

from rotorid.fitting.problem import Problem
from rotorid.search.catalog import search

PROBLEMS: dict[str, Problem] = {
    "frequency": rate_problem(),
    "linear in time": oscillator_problem(),
    "nonlinear": sled("initial_state", "output_shift", noise=0.05),
    "nonlinear, as measured": sled(noise=0.05),
}
EACH = pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)


@EACH
def test_the_cost_is_that_of_the_fit_and_the_sum_over_the_points(problem: Problem) -> None:
    thetas = problem.start * np.array([1.0, 1.02, 0.97])[:, None]
    squares = [float(np.sum(problem.residuals(theta)[0] ** 2)) for theta in thetas]
    # Two ways of integrating the same equations agree to rounding.
    np.testing.assert_allclose(problem.many_costs(thetas), squares, rtol=1e-8)
    np.testing.assert_allclose(problem.point_costs(thetas).sum(axis=1), squares, rtol=1e-8)
    assert problem.name


@EACH
def test_polishing_leads_down_to_the_cost_that_it_tells(problem: Problem) -> None:
    start = problem.start * 1.05
    solution = problem.polish(start)
    assert solution.cost < problem.many_costs(start[None])[0]
    assert solution.cost == pytest.approx(float(problem.many_costs(solution.theta[None])[0]), rel=1e-8)
    assert solution.trace[0] == pytest.approx(float(problem.many_costs(start[None])[0]), rel=1e-8)


@EACH
def test_polishing_points_looks_at_these_only(problem: Problem) -> None:
    start = problem.start * 1.05
    each = problem.point_costs(start[None])[0]
    points = np.where(np.arange(each.size) < each.size // 2, 2.0, 0.0)
    solution = problem.polish_points(start, points)
    assert solution.trace[0] == pytest.approx(float(points @ each), rel=1e-8)
    after = problem.point_costs(solution.theta[None])[0]
    assert solution.cost == pytest.approx(float(points @ after), rel=1e-8)
    assert solution.cost < solution.trace[0]
    assert solution.evaluations <= 11


@EACH
def test_problems_pickle(problem: Problem) -> None:
    again = pickle.loads(pickle.dumps(problem))
    thetas = problem.start[None]
    np.testing.assert_array_equal(again.many_costs(thetas), problem.many_costs(thetas))


@EACH
def test_the_box_has_a_side_for_every_number(problem: Problem) -> None:
    box = problem.search_box
    assert box.lower.size == problem.start.size
    assert np.all((box.lower <= problem.start) & (problem.start <= box.upper))


def test_what_diverges_or_lies_outside_its_bounds_has_an_infinite_cost() -> None:
    unstable = np.array([[-1e5, -500.0, 45.0], [30.0, 4.0, 45.0]])
    costs = oscillator_problem().many_costs(unstable)
    assert costs[0] == np.inf
    assert np.isfinite(costs[1])
    problem = sled()
    outside = np.stack([problem.start, problem.start])
    outside[0, 0] = -1.0
    costs = problem.many_costs(outside)
    assert costs[0] == np.inf
    assert np.isfinite(costs[1])


def test_a_pole_at_a_point_has_an_infinite_cost() -> None:
    problem = rate_problem()
    theta = problem.parameters.pack()
    at_zero = np.where(np.array(problem.parameters.free) == "T_motor", np.nan, theta)
    assert problem.many_costs(np.stack([at_zero, theta]))[0] == np.inf


def test_a_search_brings_back_the_truth_of_a_nonlinear_model() -> None:
    problem = sled("initial_state")
    far = problem.parameters.with_values({"k": 1.0, "c": 0.4, "tau": 0.08})
    result = search("sobol:4").run(problem.with_parameters(far), budget=100, seed=0)
    assert result.best.theta[:3] == pytest.approx([0.4, 0.2, 0.033], rel=1e-6)
