r"""Fit a structure to one-step predictions: the prediction-error method, unbiased on closed-loop data.

The predictor of :mod:`rotorid.simulation.predictor` follows the measured outputs with the gain of a Kalman filter,
which :mod:`rotorid.fitting.time.noise_model` computes from a noise model of few parameters. Whatever the feedback makes
of the past is known to it, so what it cannot predict depends on no input: estimates are consistent in closed loop, as
long as the noise model can take the shape of the noise. The vehicle may be unstable; its predictor is not.

The fit is maximum likelihood of what the predictor does not foresee. Its states are those of the model and of the gusts
on the samples of a record; products of unknowns, slopes and residuals are gathered piece by piece, which is all that
least squares needs of a long record.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from rotorid.data.base import read_only
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome, Solution, best_of
from rotorid.fitting.problem import Fit, Part
from rotorid.fitting.time.noise_model import (
    NoiseLevels,
    NoiseModel,
    Predictor,
    gain_slopes,
    noise_model,
    steady_predictor,
)
from rotorid.fitting.time.output_error import InitialCondition, NormalEquations, RecordsProblem, TimeData
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold
from rotorid.simulation.predictor import (
    Innovations,
    SampledModel,
    free_innovations,
    innovation_slopes,
    innovations,
    sampled_model,
)
from rotorid.simulation.sensitivity import Slopes
from rotorid.typing import ComplexArray, FloatArray

_SAME_DIRECTION = 1e-10
"""Of squares: unknowns that differ by less than a hundred thousandth of their effect are one."""


@dataclass(kw_only=True, eq=False)
class Gram:
    """A sum of products of unknowns, slopes and residual, which grows.

    Parameters
    ----------
    linear
        Of unknowns and residual with each other, shape ``(k + 1, k + 1)``.
    mixed
        Of these with slopes, shape ``(k + 1, p)``.
    slopes
        Of slopes with each other, shape ``(p, p)``.
    """

    linear: FloatArray
    mixed: FloatArray
    slopes: FloatArray

    @classmethod
    def empty(cls, unknowns: int, parameters: int) -> Gram:
        """No samples yet."""
        linear = np.zeros((unknowns + 1, unknowns + 1))
        return cls(linear=linear, mixed=np.zeros((unknowns + 1, parameters)), slopes=np.zeros((parameters, parameters)))

    def add(self, unknown: FloatArray, slopes: FloatArray, residual: FloatArray) -> None:
        """Add some samples: shapes ``(m, y, k)``, ``(m, y, p)`` and ``(m, y)``."""
        linear = np.concatenate([unknown, residual[:, :, None]], axis=2).reshape(-1, len(self.linear))
        columns = slopes.reshape(-1, len(self.slopes))
        self.linear += linear.T @ linear
        self.mixed += linear.T @ columns
        self.slopes += columns.T @ columns

    def reduced(self) -> FloatArray:
        """Products of slopes and residual in what the unknowns leave, shape ``(p + 1, p + 1)``."""
        inner = self.linear[:-1, :-1]
        cross = np.hstack([self.mixed[:-1], self.linear[:-1, -1:]])
        rest = np.block([[self.slopes, self.mixed[-1:].T], [self.mixed[-1:], self.linear[-1:, -1:]]])
        if inner.size == 0 or not (np.isfinite(rest).all() and np.isfinite(cross).all()):
            return rest
        size = np.sqrt(np.where(inner.diagonal() > 0.0, inner.diagonal(), 1.0))
        values, vectors = np.linalg.eigh(inner / np.outer(size, size))
        determined = values > _SAME_DIRECTION * values[-1]
        taken = (vectors[:, determined].T @ (cross / size[:, None])) / np.sqrt(values[determined])[:, None]
        return np.asarray(rest - taken.T @ taken)


class Followed(NamedTuple):
    """A model with its predictor at one sample rate.

    Parameters
    ----------
    model
        On the samples, with derivatives by the parameters of model and noise.
    dgain
        Derivatives of its gain, shape ``(p, x, y)``.
    """

    model: SampledModel
    steady: Predictor
    dgain: FloatArray


def follow(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, theta: FloatArray, *, sample_rate_hz: float, hold: Hold
) -> Followed:
    """Give a model its best predictor under some noise.

    Parameters
    ----------
    system, slopes
        The model and its derivatives along the model's own directions.
    noise, theta
        The noise model and its parameters.
    sample_rate_hz, hold
        As in :func:`rotorid.simulation.predictor.sampled_model`.

    Raises
    ------
    ModelError
        There is no stable predictor, or the model cannot be put on samples.
    """
    levels = noise.at(theta)
    whole, moves = _with_gusts(system, slopes, noise, levels)
    model = sampled_model(whole, moves, sample_rate_hz=sample_rate_hz, hold=hold)
    process, dprocess = _process(whole, moves, noise, levels, 1.0 / sample_rate_hz)
    steady = steady_predictor(model.step.transition, model.C, process, levels.sensors)
    dgain = gain_slopes(
        steady,
        model.step.transition,
        model.C,
        dtransition=model.tangent.transition,
        dmeasured=model.dC,
        dprocess=dprocess,
        dsensor=_after(levels.dsensors, len(dprocess)),
    )
    return Followed(model=model, steady=steady, dgain=dgain)


def _after(slopes: FloatArray, count: int) -> FloatArray:
    """Derivatives along the noise's directions, after those of the model, along which they are zero."""
    padded = np.zeros((count, *slopes.shape[1:]))
    padded[count - len(slopes) :] = slopes
    return padded


def _with_gusts(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, levels: NoiseLevels
) -> tuple[StateSpace, Slopes]:
    order, gusts = len(system.F), len(levels.gusts)
    count = len(slopes.F) + len(levels.dsensors)
    here = order + np.arange(gusts)
    F = _zero_padded(system.F, gusts, gusts)
    F[list(noise.disturbed)[:gusts], here] = 1.0
    F[here, here] = -1.0 / levels.correlation_s
    M = _zero_padded(system.M, gusts, gusts)
    M[here, here] = 1.0
    dF = _longer(_zero_padded(slopes.F, gusts, gusts), count)
    dF[len(slopes.F) :, here, here] = (levels.dcorrelation_s / levels.correlation_s**2)[:, None]
    # A constant wind is one more input to each disturbed equation.
    G = _zero_padded(system.G, gusts, len(noise.disturbed))
    G[list(noise.disturbed), system.G.shape[1] + np.arange(len(noise.disturbed))] = 1.0
    whole = StateSpace(
        M=M,
        F=F,
        G=G,
        H0=_zero_padded(system.H0, 0, gusts),
        H1=_zero_padded(system.H1, 0, gusts),
        input_delays_s=np.append(system.input_delays_s, np.zeros(len(noise.disturbed))),
        output_delays_s=system.output_delays_s,
    )
    still = np.zeros((len(slopes.F), len(noise.disturbed)))
    moves = Slopes(
        M=_longer(_zero_padded(slopes.M, gusts, gusts), count),
        F=dF,
        G=_longer(_zero_padded(slopes.G, gusts, len(noise.disturbed)), count),
        H0=_longer(_zero_padded(slopes.H0, 0, gusts), count),
        H1=_longer(_zero_padded(slopes.H1, 0, gusts), count),
        input_delays_s=_longer(np.hstack([slopes.input_delays_s, still]), count),
        output_delays_s=_longer(slopes.output_delays_s, count),
    )
    return whole, moves


def _zero_padded(matrix: FloatArray, rows: int, columns: int) -> FloatArray:
    """A matrix, or many of them, with rows and columns of zeros after its own."""
    padded = np.zeros((*matrix.shape[:-2], matrix.shape[-2] + rows, matrix.shape[-1] + columns))
    padded[..., : matrix.shape[-2], : matrix.shape[-1]] = matrix
    return padded


def _longer(slopes: FloatArray, count: int) -> FloatArray:
    """Derivatives along the model's directions, before those of the noise, along which they are zero."""
    padded = np.zeros((count, *slopes.shape[1:]))
    padded[: len(slopes)] = slopes
    return padded


def _process(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, levels: NoiseLevels, step_s: float
) -> tuple[FloatArray, FloatArray]:
    r"""Process noise of the state in one step, with its derivatives.

    The gusts are stationary, so a step brings what it decays by, :math:`(1 - e^{-2h/T}) \Sigma`. What a gust or a jolt
    has done within the step in which it arose is left out, an error of the order of the step.
    """
    order, gusts = len(system.F), len(levels.gusts)
    own = order - gusts
    process, dprocess = np.zeros((order, order)), np.zeros((len(slopes.F), order, order))
    after = len(slopes.F) - len(levels.dsensors)
    kept = np.exp(-2.0 * step_s / levels.correlation_s)
    dkept = kept * 2.0 * step_s / levels.correlation_s**2 * levels.dcorrelation_s
    process[own:, own:] = (1.0 - kept) * levels.gusts
    dprocess[after:, own:, own:] = (1.0 - kept) * levels.dgusts - dkept[:, None, None] * levels.gusts
    inverse = np.linalg.inv(system.M)
    reach = inverse[:, list(noise.disturbed)]
    dreach = -(inverse @ slopes.M @ reach)
    process += step_s * (reach * levels.jolts) @ reach.T
    half = step_s * (dreach * levels.jolts) @ reach.T
    dprocess += half + half.swapaxes(1, 2)
    dprocess[after:] += step_s * (reach * levels.djolts[:, None, :]) @ reach.T
    return process, dprocess


_REWEIGHTED, _AT_REST = 30, 1e-9


class _Run(NamedTuple):
    """One record with its predictor: innovations from zero state, and their change by the unknowns ``(n, y, k)``."""

    record: TimeData
    followed: Followed
    values: FloatArray
    unknown: FloatArray


class _Estimated(NamedTuple):
    """All records from zero state, with the covariance of the innovations and the best unknowns ``(k,)`` of each."""

    runs: list[_Run]
    covariance: FloatArray
    unknown: list[FloatArray]


class Settled(NamedTuple):
    r"""All records with what was unknown of each estimated.

    Parameters
    ----------
    followed
        The predictor of each record.
    runs
        What it makes of it.
    inputs
        Inputs with the constants after them.
    covariance
        :math:`\hat R`, shape ``(y, y)``.
    whitening
        A square root of its inverse, shape ``(y, y)``.
    unknown
        How the unknowns move the whitened innovations, shape ``(n, y, k)``.
    """

    followed: list[Followed]
    runs: list[Innovations]
    inputs: list[tuple[FloatArray, FloatArray]]
    covariance: FloatArray
    whitening: FloatArray
    unknown: list[FloatArray]

    def slopes(self, record: int) -> Iterator[FloatArray]:
        """Derivatives of the whitened innovations of one record, piece by piece."""
        u, before = self.inputs[record]
        followed = self.followed[record]
        return innovation_slopes(
            followed.model,
            followed.steady.gain,
            followed.dgain,
            self.runs[record],
            u,
            before=before,
            whitening=self.whitening,
        )

    def gram(self, record: int) -> Gram:
        """Products of whitened unknowns, slopes and innovations of one record."""
        W, values, unknown = self.whitening, self.runs[record].values, self.unknown[record]
        gram = Gram.empty(unknown.shape[2], len(self.followed[record].dgain))
        first = 0
        for slopes in self.slopes(record):
            here = slice(first, first + len(slopes))
            gram.add(unknown[here], slopes, values[here] @ W.T)
            first = here.stop
        return gram


@dataclass(frozen=True, kw_only=True, eq=False)
class InnovationsProblem(RecordsProblem):
    r"""Fit a linear structure and a noise model to the innovations of their predictor.

    .. math:: \min_\theta \; N \log\det \hat R(\theta), \qquad \hat R = \frac1N \sum_k e_k e_k^T

    which is maximum likelihood for Gaussian noise whose covariance is free. Initial states, constants in the disturbed
    equations and output shifts enter linearly and are solved for at every :math:`\theta`, for each record.

    Parameters
    ----------
    parameters, region, unknowns
        As in :class:`rotorid.fitting.time.output_error.RecordsProblem`.
    structure
        Its inputs and outputs name the rows of the records. No output may be late.
    records
        What was measured, at full rate: a predictor needs every sample that the controller answered.
    noise
        The noise model; by default gusts and jolts on every equation with a parameter.
    hold
        What the inputs do between their samples: ``first`` for samples of a smooth command, ``zero`` for a command as
        it was held. A wrong one moves the delays by half a sample.

    Raises
    ------
    UsageError
        A record has other rows than the structure, there is none, or a model delays an output.
    """

    method: ClassVar[str] = "prediction_error"

    structure: LinearStructure
    noise: NoiseModel | None = None
    hold: Hold = "first"
    unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift", "state_bias")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(noise=self.noise or noise_model(self.structure, self.parameters, self.records))

    @property
    def noise_model(self) -> NoiseModel:
        """The noise model."""
        assert self.noise is not None
        return self.noise

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the free parameters and of those of the noise, each shape ``(p,)``."""
        (low, high), (lower, upper) = self.parameters.box, self.noise_model.box
        return np.array([*low, *lower]), np.array([*high, *upper])

    @property
    def start(self) -> FloatArray:
        """The parameters as they are, and noise of its natural size, shape ``(p,)``."""
        return self.theta()

    def theta(self, noise: FloatArray | None = None) -> FloatArray:
        """The parameters as they are with those of a noise, shape ``(p,)``."""
        return np.concatenate([self.parameters.pack(), self.noise_model.start if noise is None else noise])

    def without_gusts(self) -> InnovationsProblem:
        """The same problem with jolts only."""
        return replace(self, noise=replace(self.noise_model, gusts=False))

    def with_known_noise(self, theta: FloatArray) -> InnovationsProblem:
        """The same problem with the noise of some solution, where only the parameters of the model are unknown."""
        return replace(self, noise=replace(self.noise_model, known=self.split(theta)[1]))

    def split(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The parameters of the model and those of the noise."""
        count = len(self.parameters.free)
        return theta[:count], theta[count:]

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        r"""Residual of ``p + 1`` elements and its Jacobian: those of all innovations, condensed.

        Their products are those of the innovations :math:`s^{1/2} \hat R^{-1/2} e` with
        :math:`s = (\det \hat R / \det R_0)^{1/y}`. So the sum of squares is :math:`N y s`, which falls with the
        likelihood's :math:`N \log\det \hat R`, and the gradient is that of it: a least-squares solver minimizes the
        determinant without rounds of weights.

        Both are not a number where there is no predictor, so that a search turns back.
        """
        try:
            estimated = self._estimated(theta)
        except ModelError:
            return np.full(theta.size + 1, np.nan), np.full((theta.size + 1, theta.size), np.nan)
        return self._condensed(estimated)

    @np.errstate(over="ignore", invalid="ignore")
    def _condensed(self, estimated: _Estimated) -> tuple[FloatArray, FloatArray]:
        settled = self._again(estimated)
        grams = [settled.gram(record).reduced() for record in range(len(self.records))]
        root = self._size(settled.covariance) * _root(np.sum(grams, axis=0))
        return root[:, -1], root[:, :-1]

    def normal_equations(self, theta: FloatArray) -> NormalEquations:
        """Products of whitened slopes and innovations of all records, unknowns solved for."""
        settled = self.settled(theta)
        products = np.sum([settled.gram(record).reduced() for record in range(len(self.records))], axis=0)
        return NormalEquations(fisher=products[:-1, :-1], pull=products[:-1, -1])

    def cost(self, theta: FloatArray) -> float:
        """The sum of squares alone; infinite where there is no predictor."""
        try:
            return self._sum_of_squares(self._estimated(theta))
        except ModelError:
            return float(np.inf)

    def _sum_of_squares(self, estimated: _Estimated) -> float:
        return self.samples * len(self.structure.outputs) * self._size(estimated.covariance) ** 2

    def minimized(self, solver: LevenbergMarquardt, start: FloatArray) -> Solution:
        """The minimum that a solver finds from some start, shape ``(p,)``.

        Steps that fail are not worth the slopes; those that do not share what their cost has cost.
        """
        latest: tuple[FloatArray, _Estimated | None] = (np.zeros(0), None)

        def cost_alone(theta: FloatArray) -> float:
            nonlocal latest
            latest = (theta, None)
            try:
                estimated = self._estimated(theta)
            except ModelError:
                return float(np.inf)
            latest = (theta, estimated)
            return self._sum_of_squares(estimated)

        def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            known, estimated = latest
            return self._condensed(estimated) if estimated and known is theta else self.residuals(theta)

        return solver.minimize(residuals, start, *self.box, cost_alone=cost_alone)

    def _size(self, covariance: FloatArray) -> float:
        """How large the innovations are, against the natural noise of the sensors."""
        reference = 2.0 * np.sum(np.log(self.noise_model.sensors))
        return float(np.exp(0.5 * (np.linalg.slogdet(covariance)[1] - reference) / len(covariance)))

    @np.errstate(over="ignore", invalid="ignore")
    def settled(self, theta: FloatArray) -> Settled:
        """The predictor over every record, with the unknowns that fit it best.

        Raises
        ------
        ModelError
            There is no stable predictor.
        """
        return self._again(self._estimated(theta))

    @np.errstate(over="ignore", invalid="ignore")
    def _estimated(self, theta: FloatArray) -> _Estimated:
        runs = self._from_rest(theta)
        return _Estimated(runs, *self._estimate(runs))

    def _again(self, estimated: _Estimated) -> Settled:
        """The predictor over every record once more, with the unknowns in place."""
        runs, covariance, unknown = estimated
        inputs, again = [], []
        for run, beta in zip(runs, unknown, strict=True):
            start, constants, shifts = self._split_unknowns(beta, len(run.followed.steady.gain))
            u = _with_constants(run.record.inputs, constants)
            before = _with_constants(run.record.before, constants)
            y = run.record.outputs - shifts[:, None]
            model, gain = run.followed.model, run.followed.steady.gain
            again.append(innovations(model, gain, u, y, before=before, start=start))
            inputs.append((u, before))
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        longest = {id(run.followed): run.unknown for run in sorted(runs, key=lambda run: len(run.unknown))}
        whitened = {kind: np.matmul(whitening, unknown) for kind, unknown in longest.items()}
        moves = [whitened[id(run.followed)][: len(run.unknown)] for run in runs]
        return Settled([run.followed for run in runs], again, inputs, covariance, whitening, moves)

    def _from_rest(self, theta: FloatArray) -> list[_Run]:
        model, noise = self.split(theta)
        parameters = self.parameters.unpack(model)
        system, slopes = self.structure.matrices_and_jacobian(parameters.values, parameters.directions)
        still = np.zeros(len(self.noise_model.disturbed))
        known: dict[float, tuple[Followed, FloatArray]] = {}
        found = []
        for record in self.records:
            rate = record.sample_rate_hz
            if rate not in known:
                followed = follow(system, Slopes(*slopes), self.noise_model, noise, sample_rate_hz=rate, hold=self.hold)
                # What is unknown moves all records of a rate alike; a short one shows the beginning of it.
                longest = max(other.samples for other in self.records if other.sample_rate_hz == rate)
                free = free_innovations(followed.model, followed.steady.gain, longest, constants=still.size)
                known[rate] = followed, np.ascontiguousarray(free[:, :, self._columns(len(followed.steady.gain))])
            followed, unknown = known[rate]
            run = innovations(
                followed.model,
                followed.steady.gain,
                _with_constants(record.inputs, still),
                record.outputs,
                before=_with_constants(record.before, still),
                start=np.zeros(len(followed.steady.gain)),
            )
            found.append(_Run(record, followed, run.values, unknown[: record.samples]))
        return found

    def _columns(self, order: int) -> list[int]:
        """Which of the free motions are unknown: starts, constants in the disturbed equations, shifts."""
        disturbed, outputs = len(self.noise_model.disturbed), len(self.structure.outputs)
        # Gusts begin at their mean: a start of their own would be known no better.
        columns = list(range(len(self.structure.states))) if "initial_state" in self.unknowns else []
        if "state_bias" in self.unknowns:
            columns += range(order, order + disturbed)
        if "output_shift" in self.unknowns:
            columns += range(order + disturbed, order + disturbed + outputs)
        return columns

    def _split_unknowns(self, beta: FloatArray, order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Start, constants and shifts; zero where they are not unknown."""
        disturbed, outputs = len(self.noise_model.disturbed), len(self.structure.outputs)
        whole = np.zeros(order + disturbed + outputs)
        whole[self._columns(order)] = beta
        return whole[:order], whole[order : order + disturbed], whole[order + disturbed :]

    def _estimate(self, runs: list[_Run]) -> tuple[FloatArray, list[FloatArray]]:
        r"""Covariance :math:`\hat R` of the innovations, all unknowns solved for, and the unknowns of each record."""
        R = np.diag(self.noise_model.sensors**2)
        inner = _inner_products(runs)
        # Products of what a first estimate leaves, so that large offsets do not cancel in them.
        first = [_unknowns(own, _cross(run, run.values), R) for run, own in zip(runs, inner, strict=True)]
        left = [run.values + run.unknown @ beta for run, beta in zip(runs, first, strict=True)]
        cross = [_cross(run, e) for run, e in zip(runs, left, strict=True)]
        squares = [e.T @ e for e in left]
        moved = [np.zeros_like(beta) for beta in first]
        for weighted in range(_REWEIGHTED):
            if weighted:
                moved = [_unknowns(own, coupling, R) for own, coupling in zip(inner, cross, strict=True)]
            before = R
            rest = (_left(*products) for products in zip(squares, cross, inner, moved, strict=True))
            R = sum(rest, start=np.zeros_like(R)) / self.samples
            if not np.isfinite(R).all() or np.linalg.eigvalsh(R).min() <= 0.0:
                raise ModelError("the innovations are not finite or have no covariance", remedy="use another start")
            W = np.linalg.inv(np.linalg.cholesky(before))
            if np.abs(W @ (R - before) @ W.T).max() <= _AT_REST:
                break
        return R, [beta + more for beta, more in zip(first, moved, strict=True)]

    def parts(self, theta: FloatArray) -> list[Part]:
        """Each record with whitened innovations and their slopes, all unknowns solved for, in full."""
        settled = self.settled(theta)
        W, found = settled.whitening, []
        for place, (record, run, unknown) in enumerate(zip(self.records, settled.runs, settled.unknown, strict=True)):
            slopes = np.concatenate(list(settled.slopes(place)))
            basis = _basis(unknown)
            residual = _without((run.values @ W.T)[..., None], basis)[..., 0]
            found.append(Part(residual, _without(slopes, basis), basis, record.sample_rate_hz))
        return found


def _with_constants(u: FloatArray, constants: FloatArray) -> FloatArray:
    return np.vstack([u, np.repeat(constants[:, None], u.shape[1], axis=1)])


def _inner_products(runs: Sequence[_Run]) -> list[FloatArray]:
    """Sums over each record of products of what moves its innovations, shape ``(k, y, k, y)``.

    Records of one rate begin alike, so that each sample of the longest is counted once.
    """
    found: dict[tuple[int, int], FloatArray] = {}
    kinds = {id(run.followed): run for run in sorted(runs, key=lambda run: len(run.values))}
    for kind, longest in kinds.items():
        _, outputs, count = longest.unknown.shape
        total, begin = np.zeros((count * outputs, count * outputs)), 0
        for end in sorted({len(run.values) for run in runs if id(run.followed) == kind}):
            columns = longest.unknown[begin:end].reshape(end - begin, -1)
            total, begin = total + columns.T @ columns, end
            found[kind, end] = total.reshape(outputs, count, outputs, count).transpose(1, 0, 3, 2)
    return [found[id(run.followed), len(run.values)] for run in runs]


def _cross(run: _Run, values: FloatArray) -> FloatArray:
    """Sum over a record of products of what moves its innovations with values ``(n, y)``, shape ``(k, y, y)``."""
    samples, outputs, count = run.unknown.shape
    return np.asarray((run.unknown.reshape(samples, -1).T @ values).reshape(outputs, count, outputs).swapaxes(0, 1))


def _unknowns(inner: FloatArray, cross: FloatArray, covariance: FloatArray) -> FloatArray:
    """Unknowns that fit innovations of a covariance best, shape ``(k,)``."""
    if not (np.isfinite(inner).all() and np.isfinite(cross).all()):
        raise ModelError("the innovations are not finite", remedy="use another start")
    weights = np.linalg.inv(covariance)
    normal, right = np.einsum("iajb,ab->ij", inner, weights), np.einsum("iab,ab->i", cross, weights)
    size = np.sqrt(np.where(normal.diagonal() > 0.0, normal.diagonal(), 1.0))
    return np.asarray(-np.linalg.lstsq(normal / np.outer(size, size), right / size, rcond=1e-10)[0] / size)


def _left(squares: FloatArray, cross: FloatArray, inner: FloatArray, moved: FloatArray) -> FloatArray:
    """Sum of products of innovations ``(y, y)`` when the unknowns move."""
    mixed = np.tensordot(moved, cross, 1)
    twice = np.tensordot(np.tensordot(moved, inner, 1), moved, axes=(1, 0))
    return np.asarray(squares + mixed + mixed.T + twice)


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what the unknowns can explain, shape ``(n, y, k)``."""
    flat = columns.reshape(-1, columns.shape[2])
    size = np.linalg.norm(flat, axis=0)
    left, values, _ = np.linalg.svd(flat[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    determined = values > 1e-5 * values.max(initial=0.0)
    return np.asarray(left[:, determined].reshape(*columns.shape[:2], -1), dtype=np.float64)


def _without(columns: FloatArray, basis: FloatArray) -> FloatArray:
    flat, span = columns.reshape(-1, columns.shape[2]), basis.reshape(-1, basis.shape[2])
    return np.asarray((flat - span @ (span.T @ flat)).reshape(columns.shape))


def _root(gram: FloatArray) -> FloatArray:
    """A square matrix whose columns have the products of ``gram``."""
    size = np.sqrt(np.where(gram.diagonal() > 0.0, gram.diagonal(), 1.0))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size)


_WHITE_S = 0.5
_FLAT = 1e-9


class Whiteness(NamedTuple):
    """Correlation left in the innovations of one output: white innovations have none.

    Parameters
    ----------
    largest
        Largest magnitude of the autocorrelation over half a second.
    outside
        Share of those lags beyond the limits of 5 % chance; about 0.05 of white innovations.
    lags
        How many lags there are.
    """

    largest: float
    outside: float
    lags: int


class NoiseFound(NamedTuple):
    """The noise that was identified, in SI units.

    Parameters
    ----------
    gust_correlation_s
        Correlation time, ``None`` without gusts.
    gusts
        Standard deviation of the gust in each disturbed equation.
    jolts
        Root of the two-sided spectral density of the jolts in each.
    sensors
        Standard deviation of each sensor. One that the predictor does not listen to only has a least value.
    """

    gust_correlation_s: float | None
    gusts: Mapping[str, float]
    jolts: Mapping[str, float]
    sensors: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionErrorFit(Fit):
    r"""End of a prediction-error fit.

    Parameters
    ----------
    problem
        What was fitted.
    solution
        Parameters of the model, then those of the noise. Residual and Jacobian are condensed, see
        :meth:`rotorid.fitting.time.prediction_error.InnovationsProblem.residuals`.
    gain
        K, states of the model and of the gusts against outputs, shape ``(x, y)``; of the first record's rate.
    noise_covariance
        :math:`\hat R` of the innovations, shape ``(y, y)``.
    predictor_poles
        Of the predictor, inside the unit circle, shape ``(x,)``; of the first record's rate.
    information
        Fisher's information of the parameters of model and noise at the identified noise, shape ``(p, p)``.
    whiteness
        Output name to what is left in its innovations.
    log_likelihood
        Of the innovations, were they Gaussian.
    noise
        What disturbs the vehicle and its sensors.
    """

    problem: InnovationsProblem
    gain: FloatArray
    noise_covariance: FloatArray
    predictor_poles: ComplexArray
    information: FloatArray
    whiteness: Mapping[str, Whiteness]
    log_likelihood: float
    noise: NoiseFound

    def __post_init__(self) -> None:
        self._set(
            gain=read_only(self.gain, np.float64, ndim=2),
            noise_covariance=read_only(self.noise_covariance, np.float64, ndim=2),
            predictor_poles=read_only(self.predictor_poles, np.complex128, ndim=1),
            information=read_only(self.information, np.float64, ndim=2),
            whiteness=self.whiteness,
        )

    @cached_property
    def covariance(self) -> FloatArray:
        r"""Fisher's covariance of the free parameters of the model, the noise estimated with them, ``(p, p)``.

        It holds for white innovations. What color is left is in :attr:`whiteness`, and corrected for by
        :func:`rotorid.uncertainty.colored.colored_covariance` of :meth:`InnovationsProblem.parts`.
        """
        count = len(self.problem.parameters.free)
        lower, upper = self.problem.box
        # A noise on its bound has no effect any more, and none on what is known of the model.
        inside = (self.solution.theta > lower) & (self.solution.theta < upper)
        kept = inside | (np.arange(inside.size) < count)
        information = self.information[np.ix_(kept, kept)]
        size = np.sqrt(np.where(information.diagonal() > 0.0, information.diagonal(), 1.0))
        inverse = np.linalg.pinv(information / np.outer(size, size), rcond=_FLAT, hermitian=True)
        return np.asarray((inverse / np.outer(size, size))[:count, :count])

    @property
    def std(self) -> Mapping[str, float]:
        """One standard deviation of each free parameter, in its unit."""
        return dict(zip(self.problem.parameters.free, np.sqrt(self.covariance.diagonal()).tolist(), strict=True))


def answer(problem: InnovationsProblem, solution: Solution) -> PredictionErrorFit:
    """A solution with all that follows from it."""
    settled = problem.settled(solution.theta)
    steady, covariance = settled.followed[0].steady, settled.covariance
    # The condensed Jacobian carries the size of the innovations; at their own covariance it is one.
    count = problem.samples * len(problem.structure.outputs)
    information = solution.jacobian.T @ solution.jacobian * (count / solution.cost)
    return PredictionErrorFit(
        problem=problem,
        solution=solution,
        gain=steady.gain,
        noise_covariance=covariance,
        predictor_poles=np.linalg.eigvals(steady.closed).astype(np.complex128),
        information=information,
        whiteness=_whiteness(problem, settled),
        log_likelihood=-0.5 * problem.samples * _entropy(covariance),
        noise=_noise(problem, solution.theta, settled),
    )


def _entropy(covariance: FloatArray) -> float:
    return float(np.linalg.slogdet(covariance)[1]) + len(covariance) * (1.0 + math.log(2.0 * math.pi))


def _whiteness(problem: InnovationsProblem, settled: Settled) -> dict[str, Whiteness]:
    lags = max(1, round(_WHITE_S * min(record.sample_rate_hz for record in problem.records)))
    found = {}
    for row, name in enumerate(problem.structure.outputs):
        parts = [run.values[:, row] for run in settled.runs]
        power = sum(float(part @ part) for part in parts)
        products = [sum(float(part[lag:] @ part[:-lag]) for part in parts) / power for lag in range(1, lags + 1)]
        limit = TWO_SIDED_95 / math.sqrt(problem.samples)
        magnitude = np.abs(products)
        found[name] = Whiteness(float(magnitude.max()), float(np.mean(magnitude > limit)), lags)
    return found


def _noise(problem: InnovationsProblem, theta: FloatArray, settled: Settled) -> NoiseFound:
    model = problem.noise_model
    levels = model.at(problem.split(theta)[1])
    # The predictor knows ratios only; the innovations give the size of all noise.
    size = math.sqrt(
        np.trace(np.linalg.solve(settled.followed[0].steady.innovation, settled.covariance)) / len(settled.covariance)
    )
    states = [problem.structure.states[row] for row in model.disturbed]
    gusts = (np.sqrt(levels.gusts.diagonal()) * size).tolist()
    return NoiseFound(
        gust_correlation_s=levels.correlation_s if model.gusts else None,
        gusts=dict(zip(states, gusts, strict=True)) if model.gusts else {},
        jolts=dict(zip(states, (np.sqrt(levels.jolts) * size).tolist(), strict=True)) if model.jolts else {},
        sensors=dict(zip(problem.structure.outputs, (np.sqrt(levels.sensors) * size).tolist(), strict=True)),
    )


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
        raise InsufficientDataError(f"{count} samples are too few", needed=f"more than {2 * first[0].size}")
    found = [_search(problem, start, solver) for start in first]
    solution = _converged(best_of(found, name=problem.structure.name), count)
    return answer(problem, solution)


def fit_with_noise(
    problem: InnovationsProblem, theta: FloatArray, *, solver: LevenbergMarquardt | None = None
) -> PredictionErrorFit:
    """Fit the model with the noise of an earlier solution, as for one flight of several.

    One flight shows its noise badly: its likelihood has many minima in the noise, which move the parameters of the
    model by as much as their deviation. In the covariance the noise counts as estimated.

    Parameters
    ----------
    problem
        Structure, records, noise model.
    theta
        Parameters to start at and the noise to keep, shape ``(p,)``.
    solver
        Local solver.

    Raises
    ------
    InsufficientDataError
        There are fewer samples than parameters, or there is no predictor.
    """
    model, noise = problem.split(theta)
    found = fit_prediction_error(problem.with_known_noise(theta), starts=[model], solver=solver).solution
    whole = np.concatenate([found.theta, noise])
    residual, jacobian = problem.residuals(whole)
    lower, upper = problem.box
    on_bound = tuple(((whole <= lower) | (whole >= upper)).tolist())
    return answer(problem, replace(found, theta=whole, residual=residual, jacobian=jacobian, at_bound=on_bound))


def _converged(solution: Solution, count: int) -> Solution:
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
    if noise.known is not None or not (noise.gusts and noise.jolts):
        return problem.minimized(solver, start)
    count = len(problem.parameters.free)
    model, gusts, jolts = np.split(start, [count, count + noise.of_gusts])
    plain = problem.without_gusts()
    # Far from the model a wrong noise leads astray; its natural size is known from the data, and always tried too.
    tried = [jolts] if np.array_equal(jolts, plain.noise_model.start) else [jolts, plain.noise_model.start]
    firsts = [plain.minimized(solver, np.concatenate([model, theta])) for theta in tried]
    first = min(firsts, key=lambda solution: solution.cost)
    if not np.isfinite(first.cost):
        return problem.minimized(solver, start)
    model, jolts = np.split(first.theta, [count])
    gusty = [noise.theta(gusts=size, correlation_s=T)[: noise.of_gusts] for size in _SIZES for T in _TIMES_S]
    candidates = [np.concatenate([model, one, jolts]) for one in (gusts, *gusty)]
    best = min(candidates, key=problem.cost)
    return problem.minimized(solver, best)
