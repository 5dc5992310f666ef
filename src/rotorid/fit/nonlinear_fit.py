"""Maximum likelihood for a nonlinear model: output error with the noise re-estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.nonlinear_problem import Estimate, NonlinearProblem
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray

_RELATIVE_FLOOR = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearFit(Immutable):
    """A fitted nonlinear model.

    Parameters
    ----------
    problem
        What was fitted, with the noise as it was estimated.
    solution
        End of the last search.
    estimate
        Parameters, initial states and shifts.
    rounds
        How often the noise was estimated.
    settled
        Whether the noise came to rest.
    """

    problem: NonlinearProblem
    solution: Solution
    estimate: Estimate
    rounds: int
    settled: bool

    @property
    def noise(self) -> FloatArray:
        """Covariance of the output errors, shape ``(y, y)``."""
        return self.problem.noise

    @property
    def covariance(self) -> FloatArray:
        r"""Cramér–Rao bound :math:`(J^T J)^{-1}` of the free parameters, nuisances counted, shape ``(p, p)``.

        It assumes white errors. Flight data have coloured ones, which make the true spread several times larger.
        """
        count = len(self.problem.parameters.free)
        inverse: FloatArray = np.linalg.pinv(self.solution.jacobian.T @ self.solution.jacobian).astype(np.float64)
        return inverse[:count, :count]


def fit_nonlinear(
    problem: NonlinearProblem,
    *,
    solver: LevenbergMarquardt | None = None,
    start: FloatArray | None = None,
    rounds: int = 20,
    tolerance: float = 1e-4,
) -> NonlinearFit:
    r"""Fit parameters, and the noise by turns, until both rest.

    .. math:: R = \frac{1}{N} \sum_k e_k e_k^T

    Each round minimizes :math:`\sum e_k^T R^{-1} e_k` and estimates R from what is left; the likelihood rises with
    every round. Outputs with small errors thus count more. A variance is kept above 1e-12 of that of its output, so
    that a fit without errors still has one.

    Parameters
    ----------
    problem
        What to fit to what.
    solver
        The local search.
    start
        Vector to begin with; that of the problem by default.
    rounds
        How often R is estimated at most.
    tolerance
        Relative change of R that counts as rest.

    Raises
    ------
    UsageError
        No round was allowed.

    Examples
    --------
    Quadratic drag from a speed that runs out, with an unknown start:

    >>> from rotorid.fit.time_data import TimeData
    >>> from rotorid.models.nonlinear_catalog import nonlinear_model
    >>> drag = nonlinear_model("drag.quadratic").select(["u_heading"])
    >>> time_s = np.arange(50) / 20.0
    >>> slowing = TimeData(name="slowing", inputs=np.zeros((2, 50)), outputs=2.0 / (1.0 + 0.6 * time_s)[None],
    ...                    sample_rate_hz=20.0)
    >>> fit = fit_nonlinear(NonlinearProblem(structure=drag, parameters=drag.parameters, records=(slowing,)))
    >>> round(fit.estimate.parameters["k_Dx"].value, 4)
    0.3
    """
    if rounds < 1:
        raise UsageError(f"{rounds} rounds came", needed="one or more")
    search = solver or LevenbergMarquardt()
    theta = problem.start if start is None else start
    floor = _RELATIVE_FLOOR * np.diag(problem.with_noise(np.zeros((0, 0))).noise)
    for number in range(1, rounds + 1):
        solution = search.minimize(problem.residuals, theta, *problem.box)
        theta = solution.theta
        if not np.isfinite(solution.cost):
            return NonlinearFit(
                problem=problem, solution=solution, estimate=problem.unpack(theta), rounds=number, settled=False
            )
        errors = problem.errors(theta)
        noise = errors.T @ errors / len(errors) + np.diag(floor)
        scale = np.sqrt(np.diag(noise))
        settled = bool(np.abs((noise - problem.noise) / np.outer(scale, scale)).max() <= tolerance)
        if settled:
            break
        problem = problem.with_noise(noise)
    return NonlinearFit(
        problem=problem, solution=solution, estimate=problem.unpack(theta), rounds=number, settled=settled
    )
