"""How bounds will be inflated, against draws of the errors that a flight will have."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.unit.planning.plans import LOG_HZ, STRUCTURE, TRUTH, roll_loop, sweeps

from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.problem import ResidualErrors
from rotorid.planning.expected import (
    ExpectedFit,
    FitSettings,
    as_planned,
    expected_fit,
    expected_response,
    usable,
)
from rotorid.planning.prediction import _bounds, expected_inflation, scattering_errors
from rotorid.spectral.windows import grid_rad_s

CHOICES = FitSettings(band_rad_s=(2.0, 40.0))


def fitted(wrong: float = 0.0, *, noise: float = 0.05) -> tuple[ExpectedFit, ResidualErrors]:
    """A fit to an expected response, of a structure whose damping is held at what it is not."""
    loop, planned = roll_loop(noise), as_planned(sweeps({"roll": 0.1}, 40.0), ["roll"], LOG_HZ)
    band = (2.0, 40.0)
    windows = planned.windows(band)
    response = expected_response(
        loop,
        planned,
        inputs=STRUCTURE.inputs,
        outputs=("p",),
        omega_rad_s=grid_rad_s(band, windows),
        windows_s=windows.lengths_s,
    )
    parameters = STRUCTURE.parameters.with_values(TRUTH)
    if wrong:
        parameters = parameters.fix("L_p", TRUTH["L_p"] + wrong)
    used = usable(response, planned, ["roll"], band, CHOICES)
    posed = FrequencyProblem(structure=STRUCTURE, parameters=parameters, data=response, used=used)
    ended = expected_fit(posed, CHOICES)
    return ended, scattering_errors(ended.problem, loop, planned)


@pytest.mark.parametrize("wrong", [0.0, 0.15, 0.2, 0.3, 1.0])
def test_the_mean_over_drawn_flights(wrong: float) -> None:
    ended, scattering = fitted(wrong)
    problem, solution, weights, _ = ended
    assert weights == "cifer"
    predicted = expected_inflation(problem, solution, weights, scattering)
    rng, flights = np.random.default_rng(0), 4000
    basis, _ = np.linalg.qr(solution.jacobian)
    stated = problem.errors.covariance
    expected = float(np.trace(stated - basis @ (basis.T @ stated)))
    limit = expected + 2.0 * math.sqrt(2.0 * float(np.vdot(stated, stated)))
    drawn = rng.multivariate_normal(np.zeros(len(stated)), scattering.covariance, size=flights, method="eigh")
    residuals = solution.residual + drawn - (drawn @ basis) @ basis.T
    found = np.einsum("fn,fn->f", residuals, residuals)
    factors = np.where(found > limit, np.sqrt(found / expected), 1.0)
    # Sums of squares are a little skew, which the normal distribution that is taken for them is not.
    assert predicted == pytest.approx(factors.mean(), rel=0.03)
    assert (predicted > 1.1) == (wrong > 0.15)


def test_leakage_alone_inflates_nothing() -> None:
    """Without noise all that is left is leakage, which is stated as an error: nothing is to be added for it."""
    ended, scattering = fitted(noise=1e-6)
    assert float(np.trace(scattering.covariance)) < 1e-6 * float(np.trace(ended.problem.errors.covariance))
    assert expected_inflation(ended.problem, ended.solution, ended.weights, scattering) == 1.0


def test_weights_of_the_covariance_see_the_same() -> None:
    ended, scattering = fitted()
    assert expected_inflation(ended.problem, ended.solution, "covariance", scattering) == pytest.approx(1.0, abs=0.05)
    wrong, about = fitted(4.0)
    assert expected_inflation(wrong.problem, wrong.solution, "covariance", about) > 1.5


def test_variances_grow_with_the_square_of_the_inflation() -> None:
    ended, scattering = fitted(1.0)
    limits = _bounds(ended, scattering)
    assert limits.inflation > 1.5
    np.testing.assert_allclose(limits.std, np.sqrt(np.diag(limits.random)) * limits.inflation, rtol=1e-12)
