"""One verb fits any problem, by the method that belongs to it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.fitting.time.test_nonlinear import problem as sled
from tests.unit.search.problems import Valleys, oscillator_problem, rate_problem

from rotorid.errors import UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.methods import fit
from rotorid.fitting.time.nonlinear import fit_nonlinear
from rotorid.fitting.time.output_error import fit_output_error
from rotorid.uncertainty.cramer_rao import bounds


def test_responses_are_fitted_as_responses() -> None:
    problem = rate_problem()
    ended = fit(problem)
    np.testing.assert_array_equal(ended.solution.theta, fit_frequency(problem).theta)
    assert ended.problem is problem
    assert ended.parameters.values["L_roll"] == pytest.approx(60.0, rel=0.1)


def test_records_are_fitted_by_output_error_and_bounded_at_their_noise() -> None:
    problem = oscillator_problem()
    ended, alone = fit(problem), fit_output_error(problem)
    np.testing.assert_array_equal(ended.solution.theta, alone.solution.theta)
    stated = bounds(ended.problem, ended.solution)
    truth = np.array([30.0, 4.0, 45.0])
    assert np.all(np.abs(ended.solution.theta - truth) <= 4.0 * stated.std)


def test_a_nonlinear_model_takes_one_start() -> None:
    problem = sled("initial_state", noise=0.05)
    ended = fit(problem, starts=[problem.start])
    np.testing.assert_array_equal(ended.solution.theta, fit_nonlinear(problem).solution.theta)
    assert ended.parameters.free == problem.parameters.free
    with pytest.raises(UsageError, match="2 start values for a nonlinear model"):
        fit(problem, starts=[problem.start, problem.start])


@pytest.mark.parametrize("solver", [None, LevenbergMarquardt(iterations=50)])
def test_any_other_problem_is_minimized_from_its_starts(solver: LevenbergMarquardt | None) -> None:
    ended = fit(Valleys(), starts=[np.array([-1.5, 1.0]), np.array([1.5, 1.0])], solver=solver)
    assert np.all(ended.solution.theta > 0.0)
    assert len(ended.others) == 1
