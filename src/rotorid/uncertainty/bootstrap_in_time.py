r"""Bootstrap of fits to time histories: new noise at the outputs, or other records, and a refit.

Over what noise does to it a model is nearly straight. A refit to noise therefore begins where Gauss and Newton's step
from the solution ends, :math:`\hat\theta - (J^T J)^{-1} J^T r_b`, whose matrix all runs share, and is mostly at rest
after one or two simulations.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt, Residuals
from rotorid.fit.nonlinear_problem import NonlinearProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.fit.time_data import TimeData
from rotorid.fit.time_problem import TimeProblem
from rotorid.typing import FloatArray, IntArray
from rotorid.uncertainty.bootstrap import NO_VALUE, gauss_newton, patience
from rotorid.uncertainty.output_noise import ColoredNoise, OutputNoise
from rotorid.uncertainty.resampling import RunProgress, resample, resample_records
from rotorid.uncertainty.spread_table import SpreadTable

OutputProblem: TypeAlias = TimeProblem | NonlinearProblem
"""A problem whose residuals are errors of outputs."""


def bootstrap_outputs(
    problem: OutputProblem,
    solution: Solution,
    *,
    runs: int,
    seed: int,
    noise: OutputNoise | None = None,
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """Spread of an output-error fit over noise like that which it left.

    New outputs are the predicted ones with noise drawn anew, colored as the residuals are. The weights of the outputs
    stay those of the problem. The inputs stay as they were flown: under feedback the noise would have moved them, which
    no draw here shows.

    Parameters
    ----------
    problem
        With the covariance of the output errors that the fit ended with.
    solution
        Its solution; of a vector with initial states only the parameters are in the table.
    runs
        How many.
    seed
        The same seed gives the same table on any number of workers.
    noise
        What is drawn; by default the autoregression of the residuals,
        :class:`rotorid.uncertainty.output_noise.ColoredNoise`. Where none fits, its ``BlockNoise``.
    executor, progress
        As in :func:`rotorid.uncertainty.resampling.resample`.

    Raises
    ------
    InsufficientDataError
        Parameters cannot be told apart, or fewer than two runs came to rest.
    """
    noise = noise or ColoredNoise.of(problem.parts(solution.theta))
    gain = gauss_newton(problem.residuals(solution.theta)[1])
    outputs = tuple(one.predicted for one in problem.predicted(solution.theta))
    refit = _OutputRefit(problem, solution.theta, outputs, noise, gain)
    names = problem.parameters.free
    return resample(
        refit,
        names=names,
        units=[problem.parameters[name].unit for name in names],
        estimate=solution.theta[: len(names)],
        runs=runs,
        seed=seed,
        executor=executor,
        progress=progress,
    )


def bootstrap_records(
    problem: TimeProblem,
    solution: Solution,
    *,
    runs: int,
    seed: int,
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """Spread of a fit over whole records drawn with replacement; it assumes nothing of the noise.

    Responses are estimated from all records at once, and cannot be drawn from afterwards. For these give
    :func:`rotorid.uncertainty.resampling.resample_records` a function that estimates and fits anew.

    Parameters
    ----------
    problem
        With five records or more, see :meth:`rotorid.fit.time_data.TimeData.pieces`.
    solution
        Its solution.
    runs, seed, executor, progress
        As in :func:`bootstrap_outputs`.

    Raises
    ------
    UsageError
        There are fewer than five records.
    InsufficientDataError
        Fewer than two runs came to rest.
    """
    names = problem.parameters.free
    return resample_records(
        _RecordRefit(problem, solution.theta),
        len(problem.records),
        names=names,
        units=[problem.parameters[name].unit for name in names],
        estimate=solution.theta,
        runs=runs,
        seed=seed,
        executor=executor,
        progress=progress,
    )


@dataclass(frozen=True, eq=False)
class _OutputRefit:
    """One run: ``predicted`` outputs ``(y, n)`` with drawn noise; ``gain`` goes from residuals to the first step."""

    problem: OutputProblem
    theta: FloatArray
    predicted: tuple[FloatArray, ...]
    noise: OutputNoise
    gain: FloatArray

    def __call__(self, rng: np.random.Generator) -> FloatArray:
        drawn = self.noise.draw(rng)
        color = np.linalg.inv(self.problem.whitening)
        records: tuple[TimeData, ...] = tuple(
            replace(record, outputs=predicted + color @ errors.T)
            for record, predicted, errors in zip(self.problem.records, self.predicted, drawn, strict=True)
        )
        problem = replace(self.problem, records=records)
        start = self.theta - self.gain @ np.concatenate([errors.ravel() for errors in drawn])
        solver = patience(self.gain.shape[1])
        return _settled(solver, problem.residuals, (start, self.theta), problem.box)[: len(problem.parameters.free)]


@dataclass(frozen=True, eq=False)
class _RecordRefit:
    """A fit to the records that were drawn."""

    problem: TimeProblem
    theta: FloatArray

    def __call__(self, drawn: IntArray) -> FloatArray:
        which, times = np.unique(drawn, return_counts=True)
        problem = replace(self.problem, records=tuple(self.problem.records[record] for record in which.tolist()))
        outputs = len(problem.structure.outputs)
        # A record that was drawn twice counts twice, and is simulated once.
        weight = np.sqrt(np.repeat(times, [outputs * record.samples for record in problem.records]))

        def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = problem.residuals(theta)
            return weight * residual, weight[:, None] * jacobian

        return _settled(patience(weight.size), residuals, (self.theta,), problem.box)


def _settled(
    solver: LevenbergMarquardt, residuals: Residuals, starts: Sequence[FloatArray], box: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Where a search ends that begins at the first start with a value."""
    for start in starts:
        solution = solver.minimize(residuals, start, *box)
        if np.isfinite(solution.cost):
            break
    else:
        raise InsufficientDataError(NO_VALUE)
    if solution.outcome is Outcome.OUT_OF_ITERATIONS:
        raise InsufficientDataError(solution.outcome.value)
    return solution.theta
