r"""Bootstrap of fits to frequency responses: errors drawn anew, and all runs fitted at once.

A new flight of the identified vehicle would show :math:`\log T_b = \log \hat T + e_b`. With logarithmic residuals the
refit to it is the same problem beside an offset,

.. math:: r_b(\theta) = r(\theta) - r(\hat\theta) - S e_b

so that no response is estimated again, and all runs take their steps together.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.many import Minima, minimize_many
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.typing import FloatArray, IntArray
from rotorid.uncertainty.bounds import Weights, bounds
from rotorid.uncertainty.resampling import LeftOut, RunProgress, resample_together
from rotorid.uncertainty.spread_table import SpreadTable

NO_VALUE = "The model has no value where the run begins."

_NEAR = 1e-4
"""A refit rests where the cost falls by no more than this part of a mean squared residual: 0.01 standard deviations."""

_JITTER = 1e-10
_FLAT = 1e-8


def bootstrap_responses(
    problem: FrequencyProblem,
    solution: Solution,
    *,
    runs: int,
    seed: int,
    weights: Weights = "cifer",
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """Spread of a fit over the errors that its responses state.

    It believes the same errors as :func:`rotorid.uncertainty.bounds.bounds`, inflated as there where the structure does
    not fit, and differs in what it does with them: no straight line is put in the place of the model, bounds of
    parameters hold, a run may end in another minimum, and intervals may lie unevenly about the value. What those errors
    leave out, the bias by feedback above all, it leaves out too; records drawn anew show that
    (:func:`rotorid.uncertainty.resampling.resample_records`).

    Parameters
    ----------
    problem
        What was fitted.
    solution
        Its solution; all runs start there.
    runs
        How many; two hundred give a standard deviation, a thousand the ends of an interval.
    seed
        The same seed gives the same table on any number of workers.
    weights
        Those with which the solution was found, as in :func:`rotorid.uncertainty.bounds.bounds`. Weights of the
        covariance stay those about the solution.
    executor, progress
        As in :func:`rotorid.uncertainty.resampling.resample`.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the cost, or fewer than two runs came to rest.
    """
    parameters = problem.parameters
    return resample_together(
        _ResponseRefit.of(problem, solution, weights),
        names=parameters.free,
        units=[parameters[name].unit for name in parameters.free],
        estimate=solution.theta,
        runs=runs,
        seed=seed,
        executor=executor,
        progress=progress,
    )


@dataclass(frozen=True, eq=False)
class _ResponseRefit:
    """Some runs in one sweep.

    ``root`` makes errors of white noise, ``offset`` is the residual of the solution, shapes ``(2 n, 2 n)`` and
    ``(2 n,)``, and ``gain`` goes from residuals to Gauss and Newton's step, shape ``(p, 2 n)``. With a ``whitening``
    all of them, and what is minimized, are in units of the errors.
    """

    problem: FrequencyProblem
    theta: FloatArray
    offset: FloatArray
    root: FloatArray
    gain: FloatArray
    whitening: FloatArray | None

    @classmethod
    def of(cls, problem: FrequencyProblem, solution: Solution, weights: Weights) -> _ResponseRefit:
        inflation = bounds(problem, solution, weights=weights).inflation
        errors = problem.errors if weights == "cifer" else problem.errors_about(solution.theta)
        (offset, jacobian), root = problem.residuals(solution.theta), inflation * _root(errors.covariance)
        if weights == "cifer":
            return cls(problem, solution.theta, offset, root, gauss_newton(jacobian), None)
        W = errors.whitened(np.eye(offset.size))
        return cls(problem, solution.theta, W @ offset, W @ root, gauss_newton(W @ jacobian), W)

    def __call__(self, generators: Sequence[np.random.Generator]) -> list[FloatArray | LeftOut]:
        drawn = np.stack([rng.standard_normal(self.offset.size) for rng in generators]) @ self.root.T
        every = np.arange(len(drawn))
        found = self._minima(drawn, self.theta + drawn @ self.gain.T, every)
        lost = ~(found.settled & (found.cost <= np.sum(drawn**2, axis=1)))
        if lost.any():
            # The straight line led them astray: the slow way, from the solution.
            again = self._minima(drawn, np.broadcast_to(self.theta, (int(lost.sum()), self.theta.size)), every[lost])
            for whole, part in zip(found, again, strict=True):
                whole[lost] = part
        return [
            theta if settled else LeftOut(Outcome.OUT_OF_ITERATIONS.value if np.isfinite(cost) else NO_VALUE)
            for cost, theta, settled in zip(found.cost, found.theta, found.settled.tolist(), strict=True)
        ]

    def _minima(self, drawn: FloatArray, starts: FloatArray, runs: IntArray) -> Minima:
        offsets = self.offset + drawn

        def residuals(thetas: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
            residual, slopes = self.problem.many_residuals(thetas)
            if self.whitening is not None:
                residual, slopes = residual @ self.whitening.T, slopes @ self.whitening.T
            return residual - offsets[runs[which]], slopes

        size = self.offset.size
        return minimize_many(residuals, starts, *self.problem.box, size=size, solver=patience(size))


def patience(residuals: int) -> LevenbergMarquardt:
    """A solver that stops well within the scatter of fits to so many residuals."""
    return LevenbergMarquardt(iterations=100, tolerance=_NEAR / residuals)


def gauss_newton(jacobian: FloatArray) -> FloatArray:
    r"""From errors of the data, shape ``(n,)``, to what they make of the parameters: :math:`(J^T J)^{-1} J^T`.

    Of directions in which the cost is flat, which bounds report, it makes nothing.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return np.asarray(np.linalg.pinv(jacobian / size, rcond=_FLAT) / size[:, None])


def _root(covariance: FloatArray) -> FloatArray:
    """A root of a covariance that may be singular: of outputs one may be the integral of another."""
    try:
        return np.asarray(np.linalg.cholesky(covariance + _JITTER * np.diag(covariance.diagonal())))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
