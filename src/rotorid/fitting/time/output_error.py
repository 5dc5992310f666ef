"""Output error: maximum likelihood of measured outputs about a simulation.

Residuals are those of a simulation over records, free of what no model can know: where a record began, offsets of its
sensors, constants in the equations. The noise is at the outputs; under feedback it moves the inputs, and the values are
biased. A fit begins at the start values of the structure when nothing else is known.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, product
from typing import ClassVar, Literal, NamedTuple, Self, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt, Minimum, Solution, best_of
from rotorid.fitting.problem import Fit, Part, Problem
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold
from rotorid.simulation.sensitivity import Motion, Slopes, Stepped, stepped
from rotorid.typing import BoolArray, FloatArray

_ROUNDING = 1e-9


def moving(rows: FloatArray) -> BoolArray:
    """Which rows ``(c, n)`` spread by more than the rounding of numbers of their size, shape ``(c,)``.

    Examples
    --------
    >>> moving(np.array([[0.1, 0.1, 0.1 + 1e-17], [0.1, 0.1, 0.2], [0.0, 0.0, 0.0]])).tolist()
    [False, True, False]
    """
    return np.asarray(np.ptp(rows, axis=1) > _ROUNDING * np.abs(rows).max(axis=1))


_CACHED_S = 2.0
"""Longer than any delay between a command and what it moves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeData(Immutable):
    """Inputs and measured outputs of one maneuver on one clock.

    Parameters
    ----------
    name
        Where they come from.
    inputs
        Shape ``(u, n)``, SI units, as differences from a trim.
    outputs
        Shape ``(y, n)``.
    sample_rate_hz
        Rate of both.
    before
        Inputs before the first sample, shape ``(u,)`` or ``(u, k)`` with the latest last; before them the first stood.
        By default what the first sample shows. Kept with shape ``(u, k)``.
    """

    name: str
    inputs: FloatArray
    outputs: FloatArray
    sample_rate_hz: float
    before: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        inputs, outputs = (read_only(values, np.float64, ndim=2) for values in (self.inputs, self.outputs))
        if inputs.shape[1] != outputs.shape[1]:
            raise UsageError(f"{inputs.shape[1]} input samples but {outputs.shape[1]} output samples")
        if not (np.isfinite(inputs).all() and np.isfinite(outputs).all()):
            raise UsageError(f"{self.name} contains samples that are not finite", needed="records without gaps")
        past = self.before if self.before.size else inputs[:, 0]
        before = read_only(past if past.ndim == 2 else past[:, None], np.float64, ndim=2)
        self._set(inputs=inputs, outputs=outputs, before=before)

    @classmethod
    def of(cls, history: TimeHistory, *, inputs: tuple[str, ...], outputs: tuple[str, ...], name: str) -> TimeData:
        """Channels of a history; inputs as differences from their mean, exactly zero if constant."""
        u = np.stack([history[channel] for channel in inputs])
        y = np.stack([history[channel] for channel in outputs])
        # The mean of a constant is rounded: without this what is left of it would count as motion.
        u = np.where(moving(u)[:, None], u - u.mean(axis=1, keepdims=True), 0.0)
        return cls(name=name, inputs=u, outputs=y, sample_rate_hz=history.sample_rate_hz)

    @property
    def samples(self) -> int:
        return int(self.inputs.shape[1])

    @property
    def duration_s(self) -> float:
        return self.samples / self.sample_rate_hz

    def until(self, sample: int) -> FloatArray:
        """Inputs before a sample, shape ``(u, k)``: as many as any delay still shows there."""
        past = np.hstack([self.before, self.inputs[:, :sample]])
        return past[:, -max(1, math.ceil(_CACHED_S * self.sample_rate_hz)) :]

    def pieces(self, length_s: float) -> tuple[TimeData, ...]:
        """The record in pieces of about one length, each with the inputs before it.

        Raises
        ------
        InsufficientDataError
            A piece would hold fewer than two samples.
        """
        count = max(1, round(self.duration_s / length_s))
        edges = np.linspace(0, self.samples, count + 1).round().astype(int)
        if np.diff(edges).min() < 2:
            raise InsufficientDataError(
                f"pieces of {length_s:g} s are too short", needed="pieces of at least two samples"
            )
        return tuple(
            replace(
                self,
                inputs=self.inputs[:, start:stop],
                outputs=self.outputs[:, start:stop],
                before=self.until(start),
            )
            for start, stop in pairwise(edges)
        )


def require_records(
    records: Sequence[TimeData],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    unknowns: Sequence[str],
    known: Sequence[str],
) -> None:
    """Refuse records that have other rows than a model has channels, and unknowns that there are not.

    Parameters
    ----------
    records
        What will be fitted.
    unknowns, known
        What is to be estimated beside the parameters, and what can be.

    Raises
    ------
    UsageError
        There is no record, one has other rows, or an unknown is none.
    """
    if not records:
        raise UsageError("no records were given", needed="at least one")
    for record in records:
        if (len(record.inputs), len(record.outputs)) != (len(inputs), len(outputs)):
            raise UsageError(
                f"{record.name} has {len(record.inputs)} inputs and {len(record.outputs)} outputs",
                needed=f"the inputs {', '.join(inputs)} and the outputs {', '.join(outputs)}",
            )
    for unknown in unknowns:
        if unknown not in known:
            raise UsageError(f"unknown initial condition {unknown!r}", needed=f"one of {', '.join(known)}")


InitialCondition: TypeAlias = Literal["initial_state", "output_shift", "state_bias"]
"""Unknowns of a record besides parameters: its initial state, offsets of sensors, constants in the state equations."""

_SAME_DIRECTION = 1e-9


class Fitted(NamedTuple):
    """One record with its prediction, shapes ``(y, n)``; what was unknown has been estimated."""

    record: TimeData
    predicted: FloatArray


class NormalEquations(NamedTuple):
    """What a step of Gauss and Newton solves: the slopes' products with each other, and with the residuals.

    Parameters
    ----------
    fisher
        Shape ``(p, p)``.
    pull
        Shape ``(p,)``.
    """

    fisher: FloatArray
    pull: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordsProblem(Problem):
    """A structure and its records, each with unknowns besides the parameters.

    Parameters
    ----------
    parameters, region
        As in :class:`rotorid.fitting.problem.Problem`.
    structure
        Its inputs and outputs name the rows of the records.
    unknowns
        What is estimated beside the parameters, for each record.

    Raises
    ------
    UsageError
        There is no record, one has other rows than the structure, or an unknown is none.
    """

    initial_conditions: ClassVar[tuple[str, ...]] = get_args(InitialCondition)
    """Possible unknowns."""

    structure: LinearStructure | NonlinearStructure
    records: tuple[TimeData, ...]
    unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift")

    def __post_init__(self) -> None:
        require_records(
            self.records,
            inputs=self.structure.inputs,
            outputs=self.structure.outputs,
            unknowns=self.unknowns,
            known=self.initial_conditions,
        )
        self._set(records=tuple(self.records), unknowns=tuple(self.unknowns))

    @property
    def name(self) -> str:
        """Name of the structure."""
        return self.structure.name

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(record.samples for record in self.records)

    @property
    def most_unknowns(self) -> int:
        """Largest number of unknowns besides the parameters, over all records."""
        states, outputs = len(self.structure.states), len(self.structure.outputs)
        size = {"initial_state": states, "state_bias": states, "output_shift": outputs}
        return len(self.records) * sum(size[unknown] for unknown in self.unknowns)

    def normal_equations(self, theta: FloatArray) -> NormalEquations:
        """Products of slopes and residuals of all records, unknowns solved for."""
        parts = self.parts(theta)
        slopes = [part.slopes.reshape(-1, part.slopes.shape[2]) for part in parts]
        return NormalEquations(
            fisher=np.sum([columns.T @ columns for columns in slopes], axis=0),
            pull=np.sum(
                [columns.T @ part.residual.ravel() for columns, part in zip(slopes, parts, strict=True)], axis=0
            ),
        )

    def shortened(self, samples: int) -> Self:
        """The same problem on the first part of every record, so that all together hold about so many samples."""
        share = samples / self.samples
        if share >= 1.0:
            return self
        least = 2 + self.most_unknowns // len(self.records)
        ends = [min(record.samples, max(least, round(share * record.samples))) for record in self.records]
        return replace(
            self,
            records=tuple(
                replace(record, inputs=record.inputs[:, :end], outputs=record.outputs[:, :end])
                for record, end in zip(self.records, ends, strict=True)
            ),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorProblem(RecordsProblem):
    r"""Fit of records with all errors at the outputs: residuals are those of a simulation.

    A point is one sample with all outputs, one record after the other. Costs need no derivatives and are simulated
    without; a simulation that diverges, and parameters outside their bounds, have an infinite cost.

    Parameters
    ----------
    parameters, region, structure, records, unknowns
        As in :class:`RecordsProblem`.
    noise
        Covariance :math:`R` of the output errors, shape ``(y, y)``; at first the variances of the outputs.
    """

    method: ClassVar[str] = "output_error"

    noise: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        super().__post_init__()
        outputs = len(self.structure.outputs)
        noise = read_only(self.noise if self.noise.size else self._variances(), np.float64, ndim=2)
        if noise.shape != (outputs, outputs):
            raise UsageError(f"the noise has shape {noise.shape}", needed=f"shape ({outputs}, {outputs})")
        self._set(noise=noise)

    def _variances(self) -> FloatArray:
        whole = np.hstack([record.outputs - record.outputs.mean(axis=1, keepdims=True) for record in self.records])
        size = np.mean(whole**2, axis=1)
        return np.diag(np.where(size > 0.0, size, 1.0))

    @cached_property
    def whitening(self) -> FloatArray:
        r"""A square root of :math:`R^{-1}`, shape ``(y, y)``."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.noise)), dtype=np.float64)

    def with_noise(self, noise: FloatArray) -> Self:
        """The same problem with another covariance of the output errors."""
        return replace(self, noise=noise)

    @abstractmethod
    def predicted(self, theta: FloatArray) -> tuple[Fitted, ...]:
        """Every record with what the model predicts, unknowns estimated."""

    def _squares(self, theta: FloatArray) -> FloatArray:
        try:
            fitted = self.predicted(theta)
        except ModelError:
            return np.full(self.samples, np.inf)
        errors = [self.whitening @ (record.outputs - predicted) for record, predicted in fitted]
        return np.concatenate([np.sum(error**2, axis=0) for error in errors])

    def point_weights(self, points: FloatArray) -> FloatArray:
        """Weights of samples ``(n,)`` as those of all their outputs, ``(n * y,)``."""
        return np.repeat(points, len(self.structure.outputs))

    def noiseless(self, theta: FloatArray) -> Self:
        """The same problem with outputs that are the predicted ones."""
        records = tuple(replace(record, outputs=predicted) for record, predicted in self.predicted(theta))
        return replace(self, records=records)

    def disturbed(self, errors: Sequence[FloatArray]) -> Self:
        """The same problem with whitened errors ``(n, y)`` of every record added to its outputs."""
        color = np.linalg.inv(self.whitening)
        records = tuple(
            replace(record, outputs=record.outputs + color @ error.T)
            for record, error in zip(self.records, errors, strict=True)
        )
        return replace(self, records=records)


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeProblem(OutputErrorProblem):
    r"""Fit a linear structure to measured outputs, with the error at the output.

    .. math:: y(t_k) = \hat y(t_k; \theta) + c + \Phi_k x_0 + \Psi_k b + e_k, \qquad e_k \sim (0, R)

    Initial states :math:`x_0`, output shifts :math:`c` and constants :math:`b` in the state equations enter linearly:
    at every :math:`\theta` they are solved for exactly, and residual and Jacobian are what is left beside them
    (variable projection). They cost nothing in the search and their share in the uncertainty is counted.

    Parameters
    ----------
    parameters, region, structure, records, unknowns, noise
        As in :class:`OutputErrorProblem`.
    hold
        What the inputs do between their samples: ``zero`` for a command as it was sent, ``first`` for a signal that was
        resampled or is smooth.

    Raises
    ------
    UsageError
        A record has other rows than the structure, or there is none.
    """

    structure: LinearStructure
    hold: Hold = "zero"

    @np.errstate(over="ignore", invalid="ignore")  # a step too far diverges, and is turned back
    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened residual, unknowns solved for, shape ``(samples * y,)``, and Jacobian ``(samples * y, p)``.

        Both are not a number where the model has no bounded response, so that a search turns back.
        """
        try:
            parts = self.parts(theta)
        except ModelError:
            size = self.samples * len(self.structure.outputs)
            return np.full(size, np.nan), np.full((size, len(theta)), np.nan)
        residual = _stacked([part.residual.ravel() for part in parts])
        return residual, _stacked([part.slopes.reshape(part.residual.size, len(theta)) for part in parts])

    def parts(self, theta: FloatArray) -> list[Part]:
        """The same for each record, with what its unknowns can explain."""
        return [self._part(record, moved) for record, moved in self._motions(theta)]

    def predicted(self, theta: FloatArray) -> tuple[Fitted, ...]:
        """Every record with what the model predicts, unknowns estimated."""
        found = []
        for record, moved in self._motions(theta):
            unknown = self._unknown(moved)
            _, coefficients = self._explained(record, moved, unknown)
            found.append(Fitted(record, (moved.outputs + unknown @ coefficients).T))
        return tuple(found)

    def _motions(self, theta: FloatArray) -> Iterator[tuple[TimeData, Motion]]:
        parameters = self.parameters.unpack(theta)
        system, slopes = self.structure.matrices_and_jacobian(parameters.values, parameters.directions)
        starts, biases = "initial_state" in self.unknowns, "state_bias" in self.unknowns
        shared: dict[float, Stepped] = {}
        for record in self.records:
            rate_hz = record.sample_rate_hz
            if rate_hz not in shared:
                shared[rate_hz] = stepped(system, Slopes(*slopes), sample_rate_hz=rate_hz, hold=self.hold)
            moved = shared[rate_hz].motion(record.inputs, record.before, starts=starts, biases=biases)
            if not (np.isfinite(moved.outputs).all() and np.isfinite(moved.free).all()):
                raise ModelError("the model diverges over a record", remedy="fit in pieces, or predict ahead")
            yield record, moved

    def _unknown(self, moved: Motion) -> FloatArray:
        """Responses to everything unknown, shape ``(n, y, k)``."""
        if "output_shift" not in self.unknowns:
            return moved.free
        samples, outputs = moved.outputs.shape
        return np.concatenate([moved.free, np.broadcast_to(np.eye(outputs), (samples, outputs, outputs))], axis=2)

    def _explained(self, record: TimeData, moved: Motion, unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Orthonormal basis of what the unknowns can explain, whitened, and their best values."""
        target = (record.outputs.T - moved.outputs) @ self.whitening.T
        columns = _mixed(self.whitening, unknown)
        return _projection(columns.reshape(target.size, -1), target.ravel())

    def _part(self, record: TimeData, moved: Motion) -> Part:
        unknown = self._unknown(moved)
        basis, coefficients = self._explained(record, moved, unknown)
        shape = moved.outputs.shape
        error = record.outputs.T - moved.outputs - unknown @ coefficients
        # Minus: the residual falls as the prediction rises.
        slopes = moved.slopes(coefficients[: moved.free.shape[2]], -self.whitening)
        slopes = slopes.reshape(error.size, len(self.parameters.free))
        if basis.shape[1]:
            slopes -= basis @ (basis.T @ slopes)
        return Part(
            residual=error @ self.whitening.T,
            slopes=slopes.reshape(*shape, slopes.shape[1]),
            unknown=basis.reshape(*shape, basis.shape[1]),
            sample_rate_hz=record.sample_rate_hz,
        )


def _stacked(blocks: list[FloatArray]) -> FloatArray:
    """Blocks one below the other; a single one is not copied."""
    return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)


def _mixed(whitening: FloatArray, columns: FloatArray) -> FloatArray:
    """A triangular matrix over the outputs of columns ``(n, y, k)``."""
    mixed = whitening.diagonal()[:, None] * columns
    for row, column in np.argwhere(np.tril(whitening, -1)):
        mixed[:, row] += whitening[row, column] * columns[:, column]
    return np.asarray(mixed, dtype=np.float64)


def _projection(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis of what columns ``(n, k)`` span, and the coefficients that bring them closest to a target.

    Of columns that look alike only the first in order of size count, the others have coefficients of zero.
    """
    from scipy.linalg import qr, solve_triangular

    size = np.linalg.norm(columns, axis=0)
    moving = np.flatnonzero(size > 0.0)
    coefficients = np.zeros(len(size))
    if moving.size == 0:
        return columns[:, moving], coefficients
    Q, R, pivots = qr(columns[:, moving] / size[moving], mode="economic", pivoting=True)
    kept = int(np.sum(np.abs(np.diag(R)) > _SAME_DIRECTION * abs(R[0, 0])))
    chosen = moving[pivots[:kept]]
    coefficients[chosen] = solve_triangular(R[:kept, :kept], Q[:, :kept].T @ target) / size[chosen]
    return np.asarray(Q[:, :kept], dtype=np.float64), coefficients


_MOST_TRIED = 81
_KEPT = 3
_RANKED = 20_000
"""Samples by which starts are ranked; more would not rank them otherwise."""


def own_starts(problem: TimeProblem) -> list[FloatArray]:
    """Start values of the structure, the most promising first.

    Parameters that have the same start values take them together: axes side by side are alike. A gain enters linearly,
    so that its best value at every start is known.

    Parameters
    ----------
    problem
        Its parameters hold the values of all that have no others.
    """
    problem = problem.shortened(_RANKED)
    tried = [(cost, theta) for theta in _grid(problem) if np.isfinite(cost := _with_gain(problem, theta))]
    ranked = sorted(tried, key=lambda item: item[0])
    return [theta for _, theta in ranked[:_KEPT]]


def _grid(problem: TimeProblem) -> Iterator[FloatArray]:
    parameters = problem.parameters
    free = parameters.free
    groups: dict[tuple[float, ...], list[int]] = {}
    yield parameters.pack()
    for row, name in enumerate(free):
        if parameters[name].starts:
            groups.setdefault(parameters[name].starts, []).append(row)
    if not groups:
        return
    low, high = problem.box
    for number, values in enumerate(product(*groups)):
        if number == _MOST_TRIED:
            return
        theta = parameters.pack()
        for rows, value in zip(groups.values(), values, strict=True):
            theta[rows] = value
        yield np.clip(theta, low, high)


def _with_gain(problem: TimeProblem, theta: FloatArray) -> float:
    """Cost at a start, whose gain is set to its best value in place."""
    residual, slopes = problem.residuals(theta)
    gain = problem.structure.gain
    if gain not in problem.parameters.free or not np.isfinite(residual).all():
        return float(residual @ residual)
    row = problem.parameters.free.index(gain)
    column = slopes[:, row]
    size = float(column @ column)
    if size == 0.0:
        return float(residual @ residual)
    low, high = problem.box
    moved = np.clip(theta[row] - float(column @ residual) / size, low[row], high[row])
    residual = residual + column * (moved - theta[row])
    theta[row] = moved
    return float(residual @ residual)


_ROUNDS = 12
_SCOUTED = 20_000
"""Samples on which several starts are tried, so that a long log does not take as many times as long."""

_AT_REST = 1e-4
_LEAST_NOISE = 1e-10
"""Of the variance of an output: a model that fits a noise-free record exactly leaves rounding, and no covariance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorFit(Fit):
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
    log_likelihood: float

    @property
    def noise(self) -> FloatArray:
        """Covariance of the output errors, shape ``(y, y)``."""
        return self.problem.noise


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
    the inputs of the next ones; then :func:`rotorid.fitting.time.prediction_error.fit_prediction_error` is the fit to
    use.

    Parameters
    ----------
    problem
        Structure, records, what is unknown.
    starts
        Start values of the free parameters; by default the best of those that the problem and its parameters give, see
        :func:`rotorid.fitting.time.output_error.own_starts`. Several are tried on the first part of long records.
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
            f"{count} samples are too few for {numbers} unknowns, initial states included",
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
    places = [best.theta, *(minimum.theta for minimum in best.others)]
    whole = [Minimum(float(np.sum(problem.residuals(theta)[0] ** 2)), theta) for theta in places]
    ranked = (
        sorted((minimum for minimum in whole if np.isfinite(minimum.cost)), key=lambda minimum: minimum.cost)
        or whole[:1]
    )
    solution = solver.minimize(problem.residuals, ranked[0].theta, *problem.box)
    return replace(best_of([solution], name=problem.structure.name), others=tuple(ranked[1:]))


def _covariance(problem: TimeProblem, theta: FloatArray, *, correlated: bool) -> FloatArray:
    """Covariance of the residuals, in the units of the outputs, shape ``(y, y)``."""
    errors = [fitted.record.outputs - fitted.predicted for fitted in problem.predicted(theta)]
    whole = np.hstack(errors)
    covariance = whole @ whole.T / whole.shape[1]
    size = np.hstack([record.outputs for record in problem.records]).var(axis=1)
    least = _LEAST_NOISE * np.where(size > 0.0, size, 1.0)
    return np.diag(covariance.diagonal() + least) if not correlated else covariance + np.diag(least)


def log_likelihood(problem: OutputErrorProblem) -> float:
    r"""Of output errors, were they white and Gaussian.

    .. math:: \ln L = -\tfrac12 N \left( n_y (1 + \ln 2\pi) + \ln\det R \right)

    Parameters
    ----------
    problem
        Its noise is the covariance that the errors show.

    Examples
    --------
    >>> from rotorid.fitting.time.output_error import TimeData
    >>> from rotorid.models.library import response_model
    >>> structure = response_model("response.first_order", [("r_setpoint", "r")])
    >>> record = TimeData(name="r", inputs=np.zeros((1, 100)), outputs=np.ones((1, 100)), sample_rate_hz=50.0)
    >>> problem = TimeProblem(structure=structure, parameters=structure.parameters, records=(record,))
    >>> round(log_likelihood(problem.with_noise(np.array([[0.01]]))), 1)
    88.4
    """
    outputs = len(problem.structure.outputs)
    determinant = float(np.linalg.slogdet(problem.noise)[1])
    return -0.5 * problem.samples * float(outputs * (1.0 + np.log(2.0 * np.pi)) + determinant)
