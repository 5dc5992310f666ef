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


def expected_inflation(
    problem: FrequencyProblem, solution: Solution, weights: Weights, scattering: ResidualErrors
) -> float:
    r"""Factor on stated standard deviations, the mean of :math:`\sqrt{|r + e|^2 / E|e_0|^2}` over flights.

    The residuals r of a fit to the expected response are what the structure cannot follow and what windows leave of
    leakage, both the same in every flight of a plan. What gusts and noise add, e, scatters about them,

    .. math:: E|r + e|^2 = |r|^2 + \mathrm{tr} \, C, \qquad
        \mathrm{Var} |r + e|^2 = 2 \, \mathrm{tr} \, C^2 + 4 \, r^T C r

    with its covariance C as far as the fit does not absorb it. An identification compares with the errors :math:`e_0`
    that it states: leakage counts among them, and more than chance on top of them is inflated.

    Parameters
    ----------
    problem, solution
        What is fitted to the expected response, and its end.
    weights
        What the fit minimizes.
    scattering
        Errors of gusts and noise alone.
    """
    if weights == "cifer":
        stated, scattered = problem.errors.covariance, scattering.covariance
        residual, jacobian = solution.residual, solution.jacobian
        squared = float(np.vdot(stated, stated))
    else:
        errors = problem.errors_about(solution.theta)
        residual, jacobian = (errors.whitened(values) for values in problem.residuals(solution.theta))
        stated, scattered = (_whitened(errors, one.covariance) for one in (errors, scattering))
        squared = float(np.trace(stated))
    basis, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    expected, left = float(np.trace(_left(stated, basis))), _left(scattered, basis)
    spread = math.sqrt(2.0 * float(np.vdot(left, left)) + 4.0 * float(residual @ left @ residual))
    found = float(residual @ residual) + float(np.trace(left)) + spread * _DRAWS
    factors = np.sqrt(np.maximum(found, expected) / expected)
    return float(_SHARES @ np.where(found > expected + _CHANCE * math.sqrt(2.0 * squared), factors, 1.0))


def _whitened(errors: ResidualErrors, covariance: FloatArray) -> FloatArray:
    return errors.whitened(errors.whitened(covariance).T)


def _left(covariance: FloatArray, basis: FloatArray) -> FloatArray:
    r"""What a fit leaves of errors, :math:`(1 - Q Q^T) \, C \, (1 - Q Q^T)`."""
    half = covariance - basis @ (basis.T @ covariance)
    return np.asarray(half - (half @ basis) @ basis.T)
