r"""Fit a structure to one-step predictions: the prediction-error method, unbiased on closed-loop data.

The predictor of :mod:`rotorid.simulate.predictor` follows the measured outputs with the gain of a Kalman filter, which
:mod:`rotorid.fit.riccati` computes from a noise model of few parameters. Whatever the feedback makes of the past is
known to it, so what it cannot predict depends on no input: estimates are consistent in closed loop, as long as the
noise model can take the shape of the noise. The vehicle may be unstable; its predictor is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, get_args

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.fit.innovations_gram import Gram
from rotorid.fit.innovations_system import Followed, follow
from rotorid.fit.noise_model import NoiseModel, noise_model
from rotorid.fit.time_data import TimeData, require_records
from rotorid.fit.time_problem import Part, Unknown
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulate.hold import Hold
from rotorid.simulate.predictor import Innovations, free_innovations, innovation_slopes, innovations
from rotorid.simulate.sensitivity import Slopes
from rotorid.typing import FloatArray

_REWEIGHTED, _AT_REST = 30, 1e-9


class _Run(NamedTuple):
    """One record with its predictor: innovations from rest, and how the unknowns ``(n, y, k)`` move them."""

    record: TimeData
    followed: Followed
    values: FloatArray
    unknown: FloatArray


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
    unknown
        How the unknowns move the innovations, shape ``(n, y, k)``.
    covariance
        :math:`\hat R`, shape ``(y, y)``.
    """

    followed: list[Followed]
    runs: list[Innovations]
    inputs: list[tuple[FloatArray, FloatArray]]
    unknown: list[FloatArray]
    covariance: FloatArray

    @property
    def whitening(self) -> FloatArray:
        """A square root of the inverse of the covariance."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def slopes(self, record: int) -> Iterator[FloatArray]:
        """Derivatives of the whitened innovations of one record, piece by piece."""
        u, before = self.inputs[record]
        one = self.followed[record]
        return innovation_slopes(
            one.model, one.steady.gain, one.dgain, self.runs[record], u, before=before, whitening=self.whitening
        )

    def gram(self, record: int) -> Gram:
        """Products of whitened unknowns, slopes and innovations of one record."""
        W, values, unknown = self.whitening, self.runs[record].values, self.unknown[record]
        gram = Gram.empty(unknown.shape[2], len(self.followed[record].dgain))
        first = 0
        for slopes in self.slopes(record):
            here = slice(first, first + len(slopes))
            gram.add(np.matmul(W, unknown[here]), slopes, values[here] @ W.T)
            first = here.stop
        return gram


@dataclass(frozen=True, kw_only=True, eq=False)
class InnovationsProblem(Immutable):
    r"""Fit a linear structure and a noise model to the innovations of their predictor.

    .. math:: \min_\theta \; N \log\det \hat R(\theta), \qquad \hat R = \frac1N \sum_k e_k e_k^T

    which is maximum likelihood for Gaussian noise whose covariance is free. Initial states, constants in the disturbed
    equations and output shifts enter linearly and are solved for at every :math:`\theta`, for each record.

    Parameters
    ----------
    structure
        Its inputs and outputs name the rows of the records. No output may be late.
    parameters
        Which parameters are free, and from where to start.
    records
        What was measured, at full rate: a predictor needs every sample that the controller answered.
    noise
        The noise model; by default gusts and jolts on every equation with a parameter.
    hold
        What the inputs do between their samples: ``first`` for samples of a smooth command, ``zero`` for a command as
        it was held. A wrong one moves the delays by half a sample.
    unknowns
        What is estimated beside the parameters, for each record.

    Raises
    ------
    UsageError
        A record has other rows than the structure, there is none, or a model delays an output.
    """

    structure: LinearStructure
    parameters: ParameterSet
    records: tuple[TimeData, ...]
    noise: NoiseModel | None = None
    hold: Hold = "first"
    unknowns: tuple[Unknown, ...] = ("initial_state", "output_shift", "state_bias")

    def __post_init__(self) -> None:
        require_records(
            self.records,
            inputs=self.structure.inputs,
            outputs=self.structure.outputs,
            unknowns=self.unknowns,
            known=get_args(Unknown),
        )
        noise = self.noise or noise_model(self.structure, self.parameters, self.records)
        self._set(records=tuple(self.records), noise=noise, unknowns=tuple(self.unknowns))

    @property
    def noise_model(self) -> NoiseModel:
        """The noise model."""
        assert self.noise is not None
        return self.noise

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the free parameters and of those of the noise, each shape ``(p,)``."""
        free = [self.parameters[name] for name in self.parameters.free]
        lower, upper = self.noise_model.box
        return np.array([*(one.lower for one in free), *lower]), np.array([*(one.upper for one in free), *upper])

    @property
    def start(self) -> FloatArray:
        """The parameters as they are, and noise of its natural size, shape ``(p,)``."""
        return self.theta()

    def theta(self, noise: FloatArray | None = None) -> FloatArray:
        """The parameters as they are with those of a noise, shape ``(p,)``."""
        return np.concatenate([self.parameters.pack(), self.noise_model.start if noise is None else noise])

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(record.samples for record in self.records)

    def with_parameters(self, parameters: ParameterSet) -> InnovationsProblem:
        """The same problem with other free parameters or another start."""
        return replace(self, parameters=parameters)

    def without_gusts(self) -> InnovationsProblem:
        """The same problem with jolts only."""
        return replace(self, noise=replace(self.noise_model, gusts=False))

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
            settled = self.settled(theta)
        except ModelError:
            return np.full(theta.size + 1, np.nan), np.full((theta.size + 1, theta.size), np.nan)
        grams = [settled.gram(record).beside() for record in range(len(self.records))]
        total = sum(grams, start=np.zeros((theta.size + 1, theta.size + 1)))
        root = self._size(settled.covariance) * _root(total)
        return root[:, -1], root[:, :-1]

    def cost(self, theta: FloatArray) -> float:
        """The sum of squares alone; infinite where there is no predictor."""
        try:
            size = self._size(self.settled(theta).covariance)
        except ModelError:
            return float(np.inf)
        return self.samples * len(self.structure.outputs) * size**2

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
        runs = self._from_rest(theta)
        covariance, unknown = self._estimate(runs)
        inputs, again = [], []
        for one, beta in zip(runs, unknown, strict=True):
            start, constants, shifts = self._told_apart(beta, len(one.followed.steady.gain))
            u = _with_constants(one.record.inputs, constants)
            before = np.append(np.asarray(one.record.before), constants)
            y = one.record.outputs - shifts[:, None]
            model, gain = one.followed.model, one.followed.steady.gain
            again.append(innovations(model, gain, u, y, before=before, start=start))
            inputs.append((u, before))
        return Settled([one.followed for one in runs], again, inputs, [one.unknown for one in runs], covariance)

    def _from_rest(self, theta: FloatArray) -> list[_Run]:
        model, noise = self.split(theta)
        parameters = self.parameters.unpack(model)
        system, slopes = self.structure.matrices_and_jacobian(parameters.values, parameters.directions)
        known: dict[float, Followed] = {}
        found = []
        for record in self.records:
            rate = record.sample_rate_hz
            if rate not in known:
                known[rate] = follow(
                    system, Slopes(*slopes), self.noise_model, noise, sample_rate_hz=rate, hold=self.hold
                )
            one = known[rate]
            still = np.zeros(len(self.noise_model.disturbed))
            run = innovations(
                one.model,
                one.steady.gain,
                _with_constants(record.inputs, still),
                record.outputs,
                before=np.append(np.asarray(record.before), still),
                start=np.zeros(len(one.steady.gain)),
            )
            free = free_innovations(one.model, one.steady.gain, record.samples, constants=still.size)
            found.append(_Run(record, one, run.values, free[:, :, self._columns(len(one.steady.gain))]))
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

    def _told_apart(self, beta: FloatArray, order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Start, constants and shifts; zero where they are not unknown."""
        disturbed, outputs = len(self.noise_model.disturbed), len(self.structure.outputs)
        whole = np.zeros(order + disturbed + outputs)
        whole[self._columns(order)] = beta
        return whole[:order], whole[order : order + disturbed], whole[order + disturbed :]

    def _estimate(self, runs: list[_Run]) -> tuple[FloatArray, list[FloatArray]]:
        r"""Covariance :math:`\hat R` of the innovations beside all unknowns, and the unknowns of each record."""
        R = np.diag(self.noise_model.sensors**2)
        for _ in range(_REWEIGHTED):
            W, before = np.linalg.inv(np.linalg.cholesky(R)), R
            unknown = [_unknowns(one, W) for one in runs]
            left = [one.values + one.unknown @ beta for one, beta in zip(runs, unknown, strict=True)]
            R = sum((e.T @ e for e in left), start=np.zeros_like(W)) / self.samples
            if not np.isfinite(R).all() or np.linalg.eigvalsh(R).min() <= 0.0:
                raise ModelError("the innovations are no numbers or have no covariance", remedy="give another start")
            if np.abs(W @ (R - before) @ W.T).max() <= _AT_REST:
                break
        return R, unknown

    def parts(self, theta: FloatArray) -> list[Part]:
        """Each record with whitened innovations beside all unknowns and their slopes, in full."""
        settled = self.settled(theta)
        W, found = settled.whitening, []
        for record, (run, unknown) in enumerate(zip(settled.runs, settled.unknown, strict=True)):
            slopes = np.concatenate(list(settled.slopes(record)))
            basis = _basis(np.matmul(W, unknown))
            residual = run.values @ W.T
            found.append(Part(_without(residual[..., None], basis)[..., 0], _without(slopes, basis), basis))
        return found


def _with_constants(u: FloatArray, constants: FloatArray) -> FloatArray:
    return np.vstack([u, np.repeat(constants[:, None], u.shape[1], axis=1)])


def _unknowns(one: _Run, whitening: FloatArray) -> FloatArray:
    """What fits the innovations best, shape ``(k,)``."""
    count = one.unknown.shape[2]
    columns = np.matmul(whitening, one.unknown).reshape(-1, count)
    normal, right = columns.T @ columns, columns.T @ (one.values @ whitening.T).ravel()
    size = np.sqrt(np.where(normal.diagonal() > 0.0, normal.diagonal(), 1.0))
    if not (np.isfinite(normal).all() and np.isfinite(right).all()):
        raise ModelError("the innovations are no numbers", remedy="give another start")
    return np.asarray(-np.linalg.lstsq(normal / np.outer(size, size), right / size, rcond=1e-10)[0] / size)


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what the unknowns can explain, shape ``(n, y, k)``."""
    flat = columns.reshape(-1, columns.shape[2])
    size = np.linalg.norm(flat, axis=0)
    left, values, _ = np.linalg.svd(flat[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    seen = values > 1e-5 * values.max(initial=0.0)
    return np.asarray(left[:, seen].reshape(*columns.shape[:2], -1), dtype=np.float64)


def _without(columns: FloatArray, basis: FloatArray) -> FloatArray:
    flat, span = columns.reshape(-1, columns.shape[2]), basis.reshape(-1, basis.shape[2])
    return np.asarray((flat - span @ (span.T @ flat)).reshape(columns.shape))


def _root(gram: FloatArray) -> FloatArray:
    """A square matrix whose columns have the products of ``gram``."""
    size = np.sqrt(np.where(gram.diagonal() > 0.0, gram.diagonal(), 1.0))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size)
