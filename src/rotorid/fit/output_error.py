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
_SCOUTED = 20_000
"""Samples on which several starts are tried, so that a long log does not take as many times as long."""

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
        :func:`rotorid.fit.time_start.own_starts`. Several are tried on the first part of long records.
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
    numbers = len(problem.parameters.free) + problem.most_unknowns
    if count <= numbers:
        raise InsufficientDataError(
            f"{count} samples came to determine {numbers} numbers, those of where the records begin included",
            needed=f"more than {numbers}",
            remedy="give longer records or pieces",
        )
    solution = _searched(problem, starts or own_starts(problem), solver)
    others, evaluations = solution.others, solution.evaluations
    for _ in range(_ROUNDS):
        noise = _covariance(problem, solution.theta, correlated=correlated)
        moved = np.abs(noise - problem.noise).max() / np.abs(noise).max()
        problem = problem.with_noise(noise)
        solution = solver.minimize(problem.residuals, solution.theta, *problem.box)
        evaluations += solution.evaluations
        if moved < _AT_REST:
            break
    return OutputErrorFit(
        problem=problem,
        solution=replace(solution, others=others, evaluations=evaluations),
        log_likelihood=log_likelihood(problem),
    )


def _searched(problem: TimeProblem, starts: Sequence[FloatArray], solver: LevenbergMarquardt) -> Solution:
    """The best of the searches from all starts: of several on a part of long records, then on the whole."""
    brief = problem.shortened(_SCOUTED) if len(starts) > 1 else problem
    best = best_of(
        [solver.minimize(brief.residuals, start, *problem.box) for start in starts], name=problem.structure.name
    )
    if brief is problem:
        return best
    places = [best.theta, *(one.theta for one in best.others)]
    whole = [Minimum(float(np.sum(problem.residuals(theta)[0] ** 2)), theta) for theta in places]
    ranked = sorted((one for one in whole if np.isfinite(one.cost)), key=lambda one: one.cost) or whole[:1]
    solution = solver.minimize(problem.residuals, ranked[0].theta, *problem.box)
    return replace(best_of([solution], name=problem.structure.name), others=tuple(ranked[1:]))


def _covariance(problem: TimeProblem, theta: FloatArray, *, correlated: bool) -> FloatArray:
    """Covariance of the residuals, in the units of the outputs, shape ``(y, y)``."""
    errors = [one.record.outputs - one.predicted for one in problem.predicted(theta)]
    whole = np.hstack(errors)
    covariance = whole @ whole.T / whole.shape[1]
    size = np.hstack([record.outputs for record in problem.records]).var(axis=1)
    least = _LEAST_NOISE * np.where(size > 0.0, size, 1.0)
    return np.diag(covariance.diagonal() + least) if not correlated else covariance + np.diag(least)


def log_likelihood(problem: TimeProblem) -> float:
    r"""Of output errors, were they white and Gaussian.

    .. math:: \ln L = -\tfrac12 N \left( n_y (1 + \ln 2\pi) + \ln\det R \right)

    Parameters
    ----------
    problem
        Its noise is the covariance that the errors show.

    Examples
    --------
    >>> from rotorid.fit.time_data import TimeData
    >>> from rotorid.models.response import response_model
    >>> structure = response_model("response.first_order", [("r_setpoint", "r")])
    >>> record = TimeData(name="r", inputs=np.zeros((1, 100)), outputs=np.ones((1, 100)), sample_rate_hz=50.0)
    >>> problem = TimeProblem(structure=structure, parameters=structure.parameters, records=(record,))
    >>> round(log_likelihood(problem.with_noise(np.array([[0.01]]))), 1)
    88.4
    """
    outputs = len(problem.structure.outputs)
    determinant = float(np.linalg.slogdet(problem.noise)[1])
    return -0.5 * problem.samples * float(outputs * (1.0 + np.log(2.0 * np.pi)) + determinant)
