"""Every problem of the package as what a search minimizes: one cost, point by point, with its own local search."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from tests.unit.fitting.test_nonlinear_problem import problem as sled
from tests.unit.search.objectives import oscillator_problem, rate_problem

from rotorid.fitting.time.nonlinear import NonlinearProblem
from rotorid.search.catalog import search
from rotorid.search.objectives import SearchableProblem, objective_of
from rotorid.typing import FloatArray

PROBLEMS: dict[str, SearchableProblem] = {
    "frequency": rate_problem(),
    "linear in time": oscillator_problem(),
    "nonlinear": sled("initial_state", "output_shift", noise=0.05),
    "nonlinear, as measured": sled(noise=0.05),
}
EACH = pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)


def begin(problem: SearchableProblem) -> FloatArray:
    return problem.start if isinstance(problem, NonlinearProblem) else problem.parameters.pack()


@EACH
def test_the_cost_is_that_of_the_fit_and_the_sum_over_the_points(problem: SearchableProblem) -> None:
    objective = objective_of(problem)
    thetas = begin(problem) * np.array([1.0, 1.02, 0.97])[:, None]
    squares = [float(np.sum(problem.residuals(theta)[0] ** 2)) for theta in thetas]
    # Two ways of integrating the same equations agree to rounding.
    np.testing.assert_allclose(objective.costs(thetas), squares, rtol=1e-8)
    np.testing.assert_allclose(objective.point_costs(thetas).sum(axis=1), squares, rtol=1e-8)
    assert objective.name == problem.structure.name


@EACH
def test_polishing_leads_down_to_the_cost_that_it_tells(problem: SearchableProblem) -> None:
    objective = objective_of(problem)
    start = begin(problem) * 1.05
    solution = objective.polish(start)
    assert solution.cost < objective.costs(start[None])[0]
    assert solution.cost == pytest.approx(float(objective.costs(solution.theta[None])[0]), rel=1e-8)
    assert solution.trace[0] == pytest.approx(float(objective.costs(start[None])[0]), rel=1e-8)


@EACH
def test_polishing_points_looks_at_these_only(problem: SearchableProblem) -> None:
    objective = objective_of(problem)
    start = begin(problem) * 1.05
    each = objective.point_costs(start[None])[0]
    points = np.where(np.arange(each.size) < each.size // 2, 2.0, 0.0)
    solution = objective.polish_points(start, points)
    assert solution.trace[0] == pytest.approx(float(points @ each), rel=1e-8)
    after = objective.point_costs(solution.theta[None])[0]
    assert solution.cost == pytest.approx(float(points @ after), rel=1e-8)
    assert solution.cost < solution.trace[0]
    assert solution.evaluations <= 11


@EACH
def test_objectives_pickle(problem: SearchableProblem) -> None:
    objective = objective_of(problem)
    again = pickle.loads(pickle.dumps(objective))
    thetas = begin(problem)[None]
    np.testing.assert_array_equal(again.costs(thetas), objective.costs(thetas))


@EACH
def test_the_box_has_a_side_for_every_number(problem: SearchableProblem) -> None:
    box = objective_of(problem).box
    assert box.lower.size == begin(problem).size
    assert np.all((box.lower <= begin(problem)) & (begin(problem) <= box.upper))


def test_what_diverges_or_lies_outside_its_bounds_has_an_infinite_cost() -> None:
    unstable = np.array([[-1e5, -500.0, 45.0], [30.0, 4.0, 45.0]])
    costs = objective_of(oscillator_problem()).costs(unstable)
    assert costs[0] == np.inf
    assert np.isfinite(costs[1])
    problem = sled()
    outside = np.stack([problem.start, problem.start])
    outside[0, 0] = -1.0
    costs = objective_of(problem).costs(outside)
    assert costs[0] == np.inf
    assert np.isfinite(costs[1])


def test_a_pole_at_a_point_has_an_infinite_cost() -> None:
    problem = rate_problem()
    theta = problem.parameters.pack()
    at_zero = np.where(np.array(problem.parameters.free) == "T_motor", np.nan, theta)
    assert objective_of(problem).costs(np.stack([at_zero, theta]))[0] == np.inf


def test_a_search_brings_back_the_truth_of_a_nonlinear_model() -> None:
    problem = sled("initial_state")
    far = problem.parameters.with_values({"k": 1.0, "c": 0.4, "tau": 0.08})
    result = search("sobol:4").run(objective_of(problem.with_parameters(far)), budget=100, seed=0)
    assert result.best.theta[:3] == pytest.approx([0.4, 0.2, 0.033], rel=1e-6)
