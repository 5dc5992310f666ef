"""Prediction error: maximum likelihood of what a predictor that follows the vehicle does not foresee."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.innovations import InnovationsProblem
from rotorid.fit.innovations_solution import PredictionErrorFit, answer
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.minima import best_of
from rotorid.fit.solution import Outcome, Solution
from rotorid.typing import FloatArray

_SIZES, _TIMES_S = (0.03, 0.3, 3.0, 30.0), (0.1, 1.0)
"""Gusts that are tried: how large against their natural size, and how long they last."""

_ITERATIONS, _TOLERANCE = 60, 1e-8
_NO_MORE_TO_GAIN = 1e-2
"""Of twice the logarithm of the likelihood: what moves a parameter by a tenth of its deviation."""


def fit_prediction_error(
    problem: InnovationsProblem,
    *,
    starts: Sequence[FloatArray] = (),
    solver: LevenbergMarquardt | None = None,
) -> PredictionErrorFit:
    r"""Fit by maximum likelihood of the innovations.

    Gusts have many minima, jolts one. So jolts alone are fitted first, and gusts added in the size and with the
    correlation time that fit best. Sensitivities of predictor and gain are exact, the covariance of the innovations is
    free, and the minimum of its determinant is found as one least-squares problem.

    The estimates are consistent in closed loop where gusts and jolts on the disturbed equations and white noise of each
    sensor can take the shape of the noise. What breaks that shows in ``whiteness``: other colors of noise, inputs
    sampled more slowly than the controller answers, a wrong structure.

    Parameters
    ----------
    problem
        Structure, records, noise model.
    starts
        Start values of the parameters of model and noise, see :meth:`InnovationsProblem.theta`; by default the
        parameters as they are with noise of its natural size, which is tried beside any other.
    solver
        Local solver.

    Raises
    ------
    InsufficientDataError
        There are fewer samples than parameters, or there is no predictor at any start.
    """
    solver = solver or LevenbergMarquardt(iterations=_ITERATIONS, tolerance=_TOLERANCE)
    count = problem.samples * len(problem.structure.outputs)
    first = [np.asarray(start, dtype=np.float64) for start in starts] or [problem.start]
    if count <= 2 * first[0].size:
        raise InsufficientDataError(f"{count} samples came", needed=f"more than {2 * first[0].size}")
    found = [_search(problem, start, solver) for start in first]
    solution = _rested(best_of(found, name=problem.structure.name), count)
    return answer(problem, solution)


def _rested(solution: Solution, count: int) -> Solution:
    """A noise without effect has no smallest size: a search for it that gains nothing more has converged."""
    if solution.outcome is Outcome.CONVERGED:
        return solution
    inside = ~np.array(solution.at_bound)
    jacobian = solution.jacobian[:, inside]
    taken = np.linalg.lstsq(jacobian, solution.residual, rcond=1e-7)[0]
    promised = float(np.sum((jacobian @ taken) ** 2)) * count / solution.cost
    return replace(solution, outcome=Outcome.CONVERGED) if promised <= _NO_MORE_TO_GAIN else solution


def _search(problem: InnovationsProblem, start: FloatArray, solver: LevenbergMarquardt) -> Solution:
    """The minimum from one start: with jolts alone, then with the gusts that promise most."""
    noise = problem.noise_model
    if not (noise.gusts and noise.jolts):
        return solver.minimize(problem.residuals, start, *problem.box)
    count = len(problem.parameters.free)
    model, gusts, jolts = np.split(start, [count, count + noise.of_gusts])
    plain = problem.without_gusts()
    # Far from the model a wrong noise leads astray; its natural size is known from the data, and always tried too.
    tried = [jolts] if np.array_equal(jolts, plain.noise_model.start) else [jolts, plain.noise_model.start]
    firsts = [solver.minimize(plain.residuals, np.concatenate([model, one]), *plain.box) for one in tried]
    first = min(firsts, key=lambda one: one.cost)
    if not np.isfinite(first.cost):
        return solver.minimize(problem.residuals, start, *problem.box)
    model, jolts = np.split(first.theta, [count])
    gusty = [noise.theta(gusts=size, correlation_s=T)[: noise.of_gusts] for size in _SIZES for T in _TIMES_S]
    candidates = [np.concatenate([model, one, jolts]) for one in (gusts, *gusty)]
    best = min(candidates, key=problem.cost)
    return solver.minimize(problem.residuals, best, *problem.box)
