"""By how much an identification will inflate its bounds where the structure does not fit what will fly."""

from __future__ import annotations

import math

import numpy as np

from rotorid.fit.error_covariance import ResidualErrors
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Weights

_DRAWS = np.linspace(-4.0, 4.0, 81)
_SHARES = np.exp(-0.5 * _DRAWS**2) / np.sum(np.exp(-0.5 * _DRAWS**2))
"""A normal distribution in steps."""

_CHANCE = 2.0
"""An identification puts up with residuals that are larger by as many standard deviations of their sum of squares."""


def expected_inflation(problem: FrequencyProblem, solution: Solution, weights: Weights) -> float:
    r"""Factor on stated standard deviations, the mean of :math:`\sqrt{|r + e|^2 / E|e|^2}` over flights.

    The residuals r of a fit to the expected response are what the structure cannot follow; the errors e of the flown
    one, as far as the fit does not absorb them, come on top. It is inflated in those flights in which both together are
    more than chance explains, and what is given is the mean over all.

    Parameters
    ----------
    problem, solution
        What is fitted to the expected response, and its end.
    weights
        What the fit minimizes.
    """
    if weights == "cifer":
        errors, residual, jacobian = problem.errors, solution.residual, solution.jacobian
        squared = float(np.vdot(errors.covariance, errors.covariance))
    else:
        errors = problem.errors_about(solution.theta)
        residual, jacobian = (errors.whitened(values) for values in problem.residuals(solution.theta))
        squared = errors.whitened_trace
    missed, left = float(residual @ residual), _left(errors, jacobian, whitened=weights == "covariance")
    chance = math.sqrt(2.0 * squared) * _DRAWS
    factors = np.sqrt(np.maximum(left + missed + chance, left) / left)
    return float(_SHARES @ np.where(missed + chance > _CHANCE * math.sqrt(2.0 * squared), factors, 1.0))


def _left(errors: ResidualErrors, jacobian: FloatArray, *, whitened: bool) -> float:
    r"""Expected sum of squares of what a fit leaves of the errors, :math:`\mathrm{tr} C - \mathrm{tr} \, Q^T C Q`."""
    from scipy.linalg import solve_triangular

    basis, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    total = errors.whitened_trace if whitened else float(np.trace(errors.covariance))
    if whitened:
        basis = solve_triangular(errors.root, basis, lower=True, trans=1, check_finite=False)
    return total - float(np.einsum("nk,nm,mk->", basis, errors.covariance, basis, optimize=True))
