"""Fit a structure to time histories: the residual of a simulation, free of what no model can know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.fit.time_data import TimeData, require_records
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulate.hold import Hold
from rotorid.simulate.sensitivity import Motion, Slopes, Stepped, stepped
from rotorid.typing import FloatArray

Unknown: TypeAlias = Literal["initial_state", "output_shift", "state_bias"]
"""What no model can know of a record: where it began, offsets of its sensors, constants in the state equations."""

_SAME_DIRECTION = 1e-9


class Fitted(NamedTuple):
    """One record with its prediction, shapes ``(y, n)``; what was unknown has been estimated."""

    record: TimeData
    predicted: FloatArray


class Part(NamedTuple):
    """One record at some parameters, whitened.

    Parameters
    ----------
    residual
        Beside all unknowns, shape ``(n, y)``.
    slopes
        Its derivatives, shape ``(n, y, p)``.
    unknown
        Orthonormal basis of what the unknowns can explain, shape ``(n, y, k)``.
    """

    residual: FloatArray
    slopes: FloatArray
    unknown: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeProblem(Immutable):
    r"""Fit a linear structure to measured outputs, with the error at the output.

    .. math:: y(t_k) = \hat y(t_k; \theta) + c + \Phi_k x_0 + \Psi_k b + e_k, \qquad e_k \sim (0, R)

    Initial states :math:`x_0`, output shifts :math:`c` and constants :math:`b` in the state equations enter linearly:
    at every :math:`\theta` they are solved for exactly, and residual and Jacobian are what is left beside them
    (variable projection). They cost nothing in the search and their share in the uncertainty is counted.

    Parameters
    ----------
    structure
        Its inputs and outputs name the rows of the records.
    parameters
        Which parameters are free, and from where to start.
    records
        What was measured.
    hold
        What the inputs do between their samples: ``zero`` for a command as it was sent, ``first`` for a signal that was
        resampled or is smooth.
    unknowns
        What is estimated beside the parameters, for each record.
    noise
        Covariance :math:`R` of the output errors, shape ``(y, y)``; at first the variances of the outputs.

    Raises
    ------
    UsageError
        A record has other rows than the structure, or there is none.
    """

    structure: LinearStructure
    parameters: ParameterSet
    records: tuple[TimeData, ...]
    hold: Hold = "zero"
    unknowns: tuple[Unknown, ...] = ("initial_state", "output_shift")
    noise: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        require_records(
            self.records,
            inputs=self.structure.inputs,
            outputs=self.structure.outputs,
            unknowns=self.unknowns,
            known=get_args(Unknown),
        )
        noise = self.noise if self.noise.size else self._variances()
        self._set(records=tuple(self.records), noise=read_only(noise, np.float64, ndim=2))

    def _variances(self) -> FloatArray:
        whole = np.hstack([record.outputs - record.outputs.mean(axis=1, keepdims=True) for record in self.records])
        size = np.mean(whole**2, axis=1)
        return np.diag(np.where(size > 0.0, size, 1.0))

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the free parameters, each shape ``(p,)``."""
        free = [self.parameters[name] for name in self.parameters.free]
        return np.array([one.lower for one in free]), np.array([one.upper for one in free])

    @cached_property
    def whitening(self) -> FloatArray:
        r"""A square root of :math:`R^{-1}`, shape ``(y, y)``."""
        root = np.linalg.cholesky(self.noise)
        return np.asarray(np.linalg.inv(root), dtype=np.float64)

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(record.samples for record in self.records)

    @property
    def most_unknowns(self) -> int:
        """The most numbers that are estimated beside the parameters, over all records."""
        states, outputs = len(self.structure.states), len(self.structure.outputs)
        size = {"initial_state": states, "state_bias": states, "output_shift": outputs}
        return len(self.records) * sum(size[unknown] for unknown in self.unknowns)

    def shortened(self, samples: int) -> TimeProblem:
        """The same problem on the first part of every record, so that all together hold about so many samples."""
        share = samples / self.samples
        if share >= 1.0:
            return self
        least = 2 + self.most_unknowns // len(self.records)
        ends = [min(one.samples, max(least, round(share * one.samples))) for one in self.records]
        return replace(
            self,
            records=tuple(
                replace(one, inputs=one.inputs[:, :end], outputs=one.outputs[:, :end])
                for one, end in zip(self.records, ends, strict=True)
            ),
        )

    def with_parameters(self, parameters: ParameterSet) -> TimeProblem:
        """The same problem with other free parameters or another start."""
        return replace(self, parameters=parameters)

    def with_noise(self, noise: FloatArray) -> TimeProblem:
        """The same problem with another covariance of the output errors."""
        return replace(self, noise=noise)

    @np.errstate(over="ignore", invalid="ignore")  # a step too far diverges, and is turned back
    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened residual beside all unknowns, shape ``(samples * y,)``, and its Jacobian ``(samples * y, p)``.

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
                raise ModelError("the model diverges over a record", remedy="fit pieces of it, or predict ahead")
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
