"""Weights of the measured covariance: of the least variance, and the variance is the stated one."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from tests.unit.fitting.error_twin import EXACT, LEVEL, TRUTH, draws, measured, posed

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.least_squares import Outcome
from rotorid.fitting.problem import ResidualErrors
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, bounds
from rotorid.uncertainty.model_error import SMALLEST_MODEL_ERROR

RIPPLE = 1.0 + 0.3 * np.sin(4.0 * np.log(np.arange(1.0, 1.0 + EXACT.shape[-1])))
"""A model error of 30 %."""

FITS = 200
EVERY = 4


class Study(NamedTuple):
    """Errors of the estimates of both fits ``(fits, p)``, and of some their stated deviations and model errors."""

    cifer: FloatArray
    covariance: FloatArray
    cifer_std: FloatArray
    covariance_std: FloatArray
    model_errors: FloatArray


def study(data: FrequencyResponse, seed: int) -> Study:
    errors, limits = [], []
    for values in draws(data, FITS, seed):
        problem = posed(replace(data, values=values))
        plain = fit_frequency(problem, starts=[TRUTH])
        fine = refine(problem, plain)
        errors.append((plain.theta - TRUTH, fine.theta - TRUTH))
        if len(errors) % EVERY == 0:  # stated deviations are all but equal, and take as long as the fit
            limits.append((bounds(problem, plain), bounds(problem, fine, weights="covariance")))
    cifer, covariance = (np.array(column) for column in zip(*errors, strict=True))
    stds = (np.array([one.random_std for one in column]) for column in zip(*limits, strict=True))
    return Study(cifer, covariance, *stds, np.array([[largest_model_error(one) for one in pair] for pair in limits]))  # type: ignore[call-arg]


def largest_model_error(limits: Bounds) -> float:
    assert limits.model_error is not None
    return max(limits.model_error.sizes.values())


@pytest.fixture(scope="module")
def joined() -> Study:
    return study(measured(EXACT), seed=1)


# A standard deviation from n normal draws scatters by 1 / sqrt(2 n); four of those, for five parameters in four
# comparisons, and the second order of errors of 2 %, whose logarithms the residuals are.
TOLERANCE = 4.0 / np.sqrt(2.0 * FITS) + 0.02


@pytest.mark.slow
def test_estimates_scatter_as_stated(joined: Study) -> None:
    np.testing.assert_allclose(joined.covariance.std(axis=0) / joined.covariance_std.mean(axis=0), 1.0, atol=TOLERANCE)
    np.testing.assert_allclose(joined.cifer.std(axis=0) / joined.cifer_std.mean(axis=0), 1.0, atol=TOLERANCE)


@pytest.mark.slow
def test_estimates_are_not_biased(joined: Study) -> None:
    for errors in (joined.covariance, joined.cifer):
        # The mean of n draws scatters by 1 / sqrt(n).
        assert np.all(np.abs(errors.mean(axis=0)) <= 4.0 * errors.std(axis=0) / np.sqrt(FITS))


@pytest.mark.slow
def test_of_both_the_one_with_the_covariance_scatters_less(joined: Study) -> None:
    ratio = joined.covariance.std(axis=0) / joined.cifer.std(axis=0)
    assert np.all(ratio <= 1.0 + TOLERANCE)
    assert ratio.min() < 0.7
    # By Gauss and Markov not one stated deviation is larger, up to what the guard C0 costs.
    assert np.all(joined.covariance_std <= 1.05 * joined.cifer_std)


@pytest.mark.slow
def test_errors_as_stated_show_no_model_error(joined: Study) -> None:
    # Of four responses the largest; what random errors of 2 % and 16 points let pass for a smooth one now and then.
    assert np.median(joined.model_errors, axis=0).max() < 0.2 * LEVEL + SMALLEST_MODEL_ERROR


def test_without_correlations_points_are_independent_and_bounds_hold() -> None:
    apart = study(measured(EXACT, joined=False), seed=2)
    np.testing.assert_allclose(apart.covariance.std(axis=0) / apart.covariance_std.mean(axis=0), 1.0, atol=TOLERANCE)
    np.testing.assert_allclose(apart.cifer.std(axis=0) / apart.cifer_std.mean(axis=0), 1.0, atol=TOLERANCE)


def solved(values: np.ndarray | None = None) -> tuple[ResidualErrors, FloatArray, FloatArray, Bounds]:
    data = measured(EXACT)
    problem = posed(replace(data, values=draws(data, 1, 3)[0] if values is None else values))
    solution = refine(problem, fit_frequency(problem, starts=[TRUTH]))
    errors = problem.errors_about(solution.theta)
    residual, jacobian = (errors.whitened(part) for part in problem.residuals(solution.theta))
    return errors, jacobian, residual, bounds(problem, solution, weights="covariance")


def test_bounds_are_those_of_generalized_least_squares_written_out() -> None:
    errors, jacobian, _, limits = solved()
    inverse = errors.whitened(np.eye(errors.scale.size))
    white = inverse @ errors.covariance @ inverse.T
    gain = np.linalg.solve(jacobian.T @ jacobian, jacobian.T)
    dense = gain @ white @ gain.T
    scale = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(limits.random / np.outer(scale, scale), dense / np.outer(scale, scale), atol=1e-9)


def test_residuals_of_a_wrong_model_widen_what_is_stated() -> None:
    right, wrong = solved()[-1], solved(EXACT * RIPPLE)[-1]
    assert largest_model_error(wrong) > 5.0 * LEVEL
    assert np.all(wrong.std > 2.0 * right.std)
    # What would scatter from flight to flight stays what the data state.
    np.testing.assert_allclose(wrong.random_std, right.random_std, rtol=0.5)


def test_refining_goes_on_from_a_solution_and_stays_in_the_box() -> None:
    data = measured(EXACT)
    problem = posed(replace(data, values=draws(data, 1, 4)[0]))
    plain = fit_frequency(problem, starts=[TRUTH])
    solution = refine(problem, plain)
    assert solution.outcome is Outcome.CONVERGED
    errors = problem.errors_about(solution.theta)
    before, after = (errors.whitened(problem.residuals(one.theta)[0]) for one in (plain, solution))
    assert after @ after <= before @ before
    # Weights follow the model, and stand still after it does: one round more moves little of a standard deviation.
    std = bounds(problem, solution, weights="covariance").std
    assert np.abs((refine(problem, solution).theta - solution.theta) / std).max() < 0.05
    # A bound between the solution and where it wants to go holds it.
    parameters = problem.parameters
    held = parameters["t"]
    tight = type(parameters)(replace(p, upper=0.019, value=0.019) if p is held else p for p in parameters)
    boxed = problem.with_parameters(tight)
    at_bound = refine(boxed, fit_frequency(boxed))
    assert at_bound.theta[parameters.free.index("t")] == 0.019
    assert at_bound.at_bound[parameters.free.index("t")]


def test_exact_responses_give_the_truth() -> None:
    problem = posed(measured(EXACT))
    start = fit_frequency(problem, starts=[1.3 * TRUTH])
    np.testing.assert_allclose(refine(problem, start).theta, TRUTH, rtol=1e-7)
