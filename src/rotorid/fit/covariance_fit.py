r"""Fit with weights made of the measured covariance of all errors: generalized least squares.

CIFER's cost counts every response alike and every point by itself. But errors go together: of the rate and of the
angle each holds the same gust, and what they say about each other is known far better than either alone. With the
covariance :math:`C` of all residuals :math:`r`

.. math:: \min_\theta \; r^T (C + C_0)^{-1} r

lets what is common to several outputs cancel. Of the linear unbiased estimates it has the least variance (Aitken 1935).
The covariance is taken about the fitted model and not about the estimate: an estimate has adapted to its disturbance,
and weights that know of it would pull the fit along. :math:`C_0` keeps it from believing too much: one percent of error
of the model at every point, and a tenth of each point's own variance that nothing else shares. On simulated closed-loop
flights of a quadrotor in turbulence standard deviations fall to a half and down to a tenth of those of CIFER's weights.
"""

from __future__ import annotations

from rotorid.fit.error_covariance import ResidualErrors
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray

_ROUNDS = 2
"""Errors are taken about the model of the round before; after two they stand still."""


def refine(problem: FrequencyProblem, solution: Solution, *, solver: LevenbergMarquardt | None = None) -> Solution:
    """Continue a fit from its solution in CIFER's cost to the one of least variance.

    Parameters
    ----------
    problem
        What was fitted. The errors of its data must be those it states; feedback and a wrong structure are not in them.
    solution
        Where to start.
    solver
        Local solver.

    Returns
    -------
    Solution
        Its residuals are normalized: of a structure that fits their squares sum to about their number or less.
    """
    solver = solver or LevenbergMarquardt()
    for _ in range(_ROUNDS):
        errors = problem.errors_about(solution.theta)

        def normalized(theta: FloatArray, errors: ResidualErrors = errors) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = problem.residuals(theta)
            return errors.whitened(residual), errors.whitened(jacobian)

        solution = solver.minimize(normalized, solution.theta, *problem.box)
    return solution
