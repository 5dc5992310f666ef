r"""Bootstrap: the spread of refits to simulated data, and findings if it contradicts the stated errors.

A new flight of the identified vehicle would show :math:`\log T_b = \log \hat T + e_b`. With logarithmic residuals the
refit to it is the same problem beside an offset,

.. math:: r_b(\theta) = r(\theta) - r(\hat\theta) - S e_b

so that no response is estimated again, and all runs take their steps together. Records in time are what the model
predicts with new noise, or other records of the same flights.

Over what noise does to it a model is nearly straight. A refit therefore begins where Gauss and Newton's step from the
solution ends, :math:`\hat\theta - (J^T J)^{-1} J^T r_b`, whose matrix all runs share, and is mostly at rest after one
or two evaluations.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_interval
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import Minima, minimize_many
from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome, Residuals, Solution
from rotorid.fitting.problem import Problem
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.typing import FloatArray, IntArray
from rotorid.uncertainty.colored import ColoredNoise, OutputNoise
from rotorid.uncertainty.cramer_rao import Weights, bounds
from rotorid.uncertainty.resampling import (
    LeftOut,
    RunProgress,
    SpreadTable,
    resample,
    resample_records,
    resample_together,
)

NO_VALUE = "The model has no finite value at the start of the run."

_NEAR = 1e-4
"""A refit has converged if the cost falls by no more than this part of a mean squared residual: 0.01 standard
deviations.
"""

_JITTER = 1e-10
_FLAT = 1e-8


def bootstrap(
    problem: Problem,
    solution: Solution,
    *,
    runs: int,
    seed: int,
    weights: Weights = "cifer",
    noise: OutputNoise | None = None,
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """Spread of a fit over simulated errors of its data.

    Errors that the data state, as responses do, are drawn as :func:`rotorid.uncertainty.cramer_rao.bounds` believes
    them, with the smooth errors of the structure and the clocks that it finds. What they leave out, the bias by
    feedback above all, is left out here too; records drawn anew show that (:func:`bootstrap_records`,
    :func:`rotorid.uncertainty.resampling.resample_records`).

    Where the data state none, new data are what the model predicts with errors like those that the fit has left,
    colored as they are. The weights stay those of the problem. Inputs stay as they were flown: under feedback the noise
    would have moved them, which no draw here shows.

    Against the stated bounds no straight line is put in the place of the model, bounds of parameters hold, a run may
    end in another minimum, and intervals may lie unevenly about the value.

    Parameters
    ----------
    problem
        What was fitted; in time with the covariance of the output errors that the fit ended with.
    solution
        Its solution; all runs start there. Of a vector with initial states only the parameters are in the table.
    runs
        How many; two hundred give a standard deviation, a thousand the ends of an interval.
    seed
        The same seed gives the same table on any number of workers.
    weights
        Those with which the solution was found, as in :func:`rotorid.uncertainty.cramer_rao.bounds`. Weights of the
        covariance stay those about the solution.
    noise
        What is drawn where the data state no errors; by default the autoregression of the residuals,
        :class:`rotorid.uncertainty.colored.ColoredNoise`.
    executor, progress
        As in :func:`rotorid.uncertainty.resampling.resample`.

    Raises
    ------
    InsufficientDataError
        Parameters cannot be separated, or fewer than two runs came to rest.
    UsageError
        The problem has no data that could be drawn anew: an innovation of a prediction-error fit under feedback moves
        all later inputs, so that flights of its own would be needed.
    """
    if problem.stated_errors(solution.theta, weights=weights) is not None:
        return resample_together(
            _StatedRefit.of(problem, solution, weights),
            **_table(problem, solution),
            runs=runs,
            seed=seed,
            executor=executor,
            progress=progress,
        )
    clean = problem.noiseless(solution.theta)
    if noise is None:
        parts = problem.parts(solution.theta)
        noise = ColoredNoise.of(parts) if problem.alike else ColoredNoise.by_part(parts)
    gain = gauss_newton(problem.residuals(solution.theta)[1])
    return resample(
        _Refit(clean, solution.theta, noise, gain),
        **_table(problem, solution),
        runs=runs,
        seed=seed,
        executor=executor,
        progress=progress,
    )


class _Table(TypedDict):
    names: tuple[str, ...]
    units: list[str]
    estimate: FloatArray


def _table(problem: Problem, solution: Solution) -> _Table:
    names = problem.parameters.free
    return {
        "names": names,
        "units": [problem.parameters[name].unit for name in names],
        "estimate": solution.theta[: len(names)],
    }


@dataclass(frozen=True, eq=False)
class _StatedRefit:
    """Some runs in one sweep.

    ``root`` makes errors of white noise, ``offset`` is the residual of the solution, shapes ``(2 n, k)`` and
    ``(2 n,)``, and ``gain`` goes from residuals to Gauss and Newton's step, shape ``(p, 2 n)``. With a ``whitening``
    all of them, and what is minimized, are in units of the errors.
    """

    problem: Problem
    theta: FloatArray
    offset: FloatArray
    root: FloatArray
    gain: FloatArray
    whitening: FloatArray | None

    @classmethod
    def of(cls, problem: Problem, solution: Solution, weights: Weights) -> _StatedRefit:
        found = bounds(problem, solution, weights=weights).model_error
        errors = problem.stated_errors(solution.theta, weights=weights)
        assert errors is not None
        (offset, jacobian), root = problem.residuals(solution.theta), _root(errors.covariance)
        if found is not None:
            root = np.concatenate([root, found.root], axis=1)
        if weights == "cifer":
            return cls(problem, solution.theta, offset, root, gauss_newton(jacobian), None)
        W = errors.whitened(np.eye(offset.size))
        return cls(problem, solution.theta, W @ offset, W @ root, gauss_newton(W @ jacobian), W)

    def __call__(self, generators: Sequence[np.random.Generator]) -> list[FloatArray | LeftOut]:
        drawn = np.stack([rng.standard_normal(self.root.shape[1]) for rng in generators]) @ self.root.T
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
        With five records or more, see :meth:`rotorid.fitting.time.output_error.TimeData.pieces`.
    solution
        Its solution.
    runs, seed, executor, progress
        As in :func:`bootstrap`.

    Raises
    ------
    UsageError
        There are fewer than five records.
    InsufficientDataError
        Fewer than two runs came to rest.
    """
    return resample_records(
        _RecordRefit(problem, solution.theta),
        len(problem.records),
        **_table(problem, solution),
        runs=runs,
        seed=seed,
        executor=executor,
        progress=progress,
    )


@dataclass(frozen=True, eq=False)
class _Refit:
    """One run: data as the model has them, with drawn errors; ``gain`` goes from these to a first step."""

    clean: Problem
    theta: FloatArray
    noise: OutputNoise
    gain: FloatArray

    def __call__(self, rng: np.random.Generator) -> FloatArray:
        drawn = self.noise.draw(rng)
        problem = self.clean.disturbed(drawn)
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


_CHANCE = 3.0
_WORTH_SAYING = 1.25
"""A standard deviation that is a quarter off changes no decision."""

_MOVED = 0.5
_MANY = 0.05


def judge_spread(table: SpreadTable, std: FloatArray) -> tuple[Finding, ...]:
    """Where the spread of many runs contradicts stated standard deviations by more than chance.

    Stated errors take the model as straight over its errors, and everything as normal. A parameter that runs against a
    bound, a cost with several minima or a strong curvature shows here.

    Parameters
    ----------
    table
        Of a bootstrap.
    std
        Stated standard deviations of its parameters, shape ``(p,)``, such as those of
        :class:`rotorid.uncertainty.cramer_rao.Bounds`.

    Returns
    -------
    tuple of Finding
        ``bootstrap_disagrees`` for a parameter whose spread is a quarter off or whose mean has moved by half a standard
        deviation, three standard errors of the runs at least; ``bootstrap_incomplete`` where more than a twentieth of
        the runs had no answer. Standard errors are those of the larger of the two standard deviations: few runs that
        happen to lie close together are not as certain as they look.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((500, 1))
    >>> table = SpreadTable(names=("L_p",), estimate=np.zeros(1), draws=draws, seed=0)
    >>> judge_spread(table, np.ones(1)), [one.kind for one in judge_spread(table, 0.5 * np.ones(1))]
    ((), ['bootstrap_disagrees'])
    """
    if std.shape != table.estimate.shape:
        raise UsageError(f"{std.size} standard deviations", needed=f"{len(table.names)}, one for each parameter")
    larger, smaller = np.maximum(table.std, std), np.minimum(table.std, std)
    runs = len(table.draws)
    chance = np.maximum(table.std_error, larger / np.sqrt(2.0 * (runs - 1)))
    other = (larger - smaller > _CHANCE * chance) & (larger > _WORTH_SAYING * smaller)
    moved = (np.abs(table.bias) > _CHANCE * larger / np.sqrt(runs)) & (np.abs(table.bias) > _MOVED * table.std)
    return (*_incomplete(table), *(_disagrees(table, std, row) for row in np.flatnonzero(other | moved).tolist()))


def _incomplete(table: SpreadTable) -> tuple[Finding, ...]:
    out = sum(table.left_out.values())
    if out <= _MANY * table.runs:
        return ()
    reasons = " ".join(f"{count} times: {reason}" for reason, count in table.left_out.items())
    message = f"{out} of {table.runs} bootstrap runs failed, so the spread is too small. {reasons}"
    return (warn("bootstrap_incomplete", "bootstrap", message, runs=table.runs, left_out=out),)


def _disagrees(table: SpreadTable, std: FloatArray, place: int) -> Finding:
    row = table.rows()[place]
    moved = row.mean - row.estimate
    _, ends = with_interval(row.mean, row.low, row.high)
    # A narrower spread may be that of a bound or of too few runs: it is no reason to claim more.
    wider = row.std > std[place]
    advice = f"Use the interval {ends} instead." if wider else f"95 % of the runs lie from {ends}."
    return warn(
        "bootstrap_disagrees",
        row.name,
        f"Over {len(table.draws)} runs {row.name} has a mean of {row.mean:.4g} and a standard deviation of "
        f"{row.std:.3g}; its value is {row.estimate:.4g} and its stated standard deviation {std[place]:.3g}. "
        f"{advice}",
        std=row.std,
        stated_std=float(std[place]),
        bias=moved,
        percentile_2_5=row.low,
        percentile_97_5=row.high,
    )
