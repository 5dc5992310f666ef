"""Output error: maximum likelihood of measured outputs about a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.minima import best_of
from rotorid.fit.solution import Minimum, Solution
from rotorid.fit.time_problem import TimeProblem
from rotorid.fit.time_start import own_starts
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray

_ROUNDS = 12
_AT_REST = 1e-4
_LEAST_NOISE = 1e-10
"""Of the variance of an output: a model that fits a noise-free record exactly leaves rounding, and no covariance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorFit(Immutable):
    r"""End of an output-error fit.

    Parameters
    ----------
    problem
        With the covariance :math:`R` that the residuals show.
    solution
        At that covariance: residual and Jacobian are whitened.
    log_likelihood
        Of the residuals, were they white and Gaussian.
    """

    problem: TimeProblem
    solution: Solution
    log_likelihood: float

    @property
    def parameters(self) -> ParameterSet:
        """The identified values."""
        return self.problem.parameters.unpack(self.solution.theta)

    @property
    def noise(self) -> FloatArray:
        """Covariance of the output errors, shape ``(y, y)``."""
        return self.problem.noise

    @property
    def others(self) -> tuple[Minimum, ...]:
        """Other minima that the search met, best first."""
        return self.solution.others


def fit_output_error(
    problem: TimeProblem,
    *,
    starts: Sequence[FloatArray] = (),
    solver: LevenbergMarquardt | None = None,
    correlated: bool = True,
) -> OutputErrorFit:
    r"""Fit by maximum likelihood of the output errors.

    .. math:: \min_\theta \; \tfrac12 N \log\det R(\theta), \qquad R = \frac1N \sum_k e_k e_k^T

    as a sequence of least-squares problems: with :math:`R` given, the weighted sum of squares is minimized with exact
    sensitivities; then :math:`R` is formed anew from the residuals, until it rests. The first round weighs outputs by
    their size, so that a bad start does not decide which of them counts.

    The values are unbiased where the noise is independent of the inputs. Under feedback the noise of one sample moves
    the inputs of the next ones; then :func:`rotorid.fit.innovations.fit_prediction_error` is the fit to use.

    Parameters
    ----------
    problem
        Structure, records, what is unknown.
    starts
        Start values of the free parameters; by default the best of those that the problem and its parameters give, see
        :func:`rotorid.fit.time_start.own_starts`.
    solver
        Local solver.
    correlated
        Whether errors of different outputs may go together; otherwise only their variances are estimated.

    Raises
    ------
    InsufficientDataError
        There are fewer samples than parameters, or the model has no bounded response at any start.
    """
    solver = solver or LevenbergMarquardt(iterations=100, tolerance=1e-9)
    count = problem.samples * len(problem.structure.outputs)
    if count <= len(problem.parameters.free):
        raise InsufficientDataError(f"{count} samples came", needed=f"more than {len(problem.parameters.free)}")
    found = [solver.minimize(problem.residuals, start, *problem.box) for start in starts or own_starts(problem)]
    solution = best_of(found, name=problem.structure.name)
    others = solution.others
    for _ in range(_ROUNDS):
        noise = _covariance(problem, solution.theta, correlated=correlated)
        moved = np.abs(noise - problem.noise).max() / np.abs(noise).max()
        problem = problem.with_noise(noise)
        solution = solver.minimize(problem.residuals, solution.theta, *problem.box)
        if moved < _AT_REST:
            break
    return OutputErrorFit(
        problem=problem, solution=replace(solution, others=others), log_likelihood=_log_likelihood(problem)
    )


def _covariance(problem: TimeProblem, theta: FloatArray, *, correlated: bool) -> FloatArray:
    """Covariance of the residuals, in the units of the outputs, shape ``(y, y)``."""
    errors = [one.record.outputs - one.predicted for one in problem.predicted(theta)]
    whole = np.hstack(errors)
    covariance = whole @ whole.T / whole.shape[1]
    size = np.hstack([record.outputs for record in problem.records]).var(axis=1)
    least = _LEAST_NOISE * np.where(size > 0.0, size, 1.0)
    return np.diag(covariance.diagonal() + least) if not correlated else covariance + np.diag(least)


def _log_likelihood(problem: TimeProblem) -> float:
    outputs = len(problem.structure.outputs)
    determinant = float(np.linalg.slogdet(problem.noise)[1])
    return -0.5 * problem.samples * float(outputs * (1.0 + np.log(2.0 * np.pi)) + determinant)
