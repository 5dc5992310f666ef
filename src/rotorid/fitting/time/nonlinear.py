"""Output error of a nonlinear structure: maximum likelihood, with the noise estimated by turns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.errors import ModelError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.problem import Fit, Part, StartBox, search_box
from rotorid.fitting.time.output_error import Fitted, OutputErrorProblem, TimeData
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.simulation.nonlinear import NonlinearSensitivities, Scheme, nonlinear_sensitivities, simulate_nonlinear
from rotorid.typing import BoolArray, FloatArray

NonlinearUnknown: TypeAlias = Literal["initial_state", "output_shift"]
"""Unknowns of a record besides parameters: its initial state, and offsets of its sensors."""

_SAME_DIRECTION = 1e-9
_ABOUT_START = 0.1
_LEAST_START = 1e-3


class Estimate(NamedTuple):
    """Contents of a vector of a problem.

    Parameters
    ----------
    parameters
        Of the model.
    starts
        Initial states of each record, shape ``(r, x)``.
    shifts
        Output shifts of each record, shape ``(r, y)``.
    """

    parameters: ParameterSet
    starts: FloatArray
    shifts: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearProblem(OutputErrorProblem):
    r"""Fit a nonlinear structure to measured outputs.

    .. math:: y(t_k) = \hat y(t_k; \theta, x_0) + c + e_k, \qquad e_k \sim (0, R)

    Initial states do not enter linearly, so they are searched for together with the parameters: a vector of the problem
    is the free parameters, then for each record its unknown initial states and its shifts. Noise is assumed at the
    outputs only; under feedback, wind and other process noise bias the fit and are taken for the model's error.

    Parameters
    ----------
    parameters, region, structure, records, noise
        As in :class:`rotorid.fitting.time.output_error.OutputErrorProblem`; there may be more parameters than the
        structure has.
    unknowns
        What is estimated beside the parameters, for each record. Without ``initial_state`` only those initial states
        are unknown of which the first sample says nothing; the others are taken as measured, noise and all. The shift
        of an output that only counts from its own start, such as a position, cannot be separated from that start.
    scheme
        How the model is integrated.

    Raises
    ------
    UsageError
        A record has other rows than the structure, or there is none; or a parameter of the structure is missing.
    """

    initial_conditions: ClassVar[tuple[str, ...]] = get_args(NonlinearUnknown)
    method: ClassVar[str] = "nonlinear"

    structure: NonlinearStructure
    unknowns: tuple[NonlinearUnknown, ...] = ("initial_state",)
    scheme: Scheme = field(default_factory=Scheme)

    def __post_init__(self) -> None:
        if missing := [name for name in self.structure.parameters.names if name not in self.parameters.names]:
            raise UsageError(f"the parameters lack {', '.join(missing)} of {self.structure.name}")
        super().__post_init__()

    @cached_property
    def _measured(self) -> FloatArray:
        """Initial states from the first samples, shape ``(r, x)``."""
        return np.stack([self.structure.measured_start(r.outputs[:, 0], r.inputs[:, 0]) for r in self.records])

    @cached_property
    def _unknown_states(self) -> BoolArray:
        """Which initial states are searched for, shape ``(x,)``."""
        silent = np.asarray(np.isnan(self._measured).any(axis=0))
        return np.full_like(silent, True) if "initial_state" in self.unknowns else silent

    @property
    def _nuisances(self) -> int:
        """How many nuisances each record has."""
        shifts = len(self.structure.outputs) if "output_shift" in self.unknowns else 0
        return int(self._unknown_states.sum()) + shifts

    @property
    def most_unknowns(self) -> int:
        """Number of unknowns other than parameters, over all records."""
        return self._nuisances * len(self.records)

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of a vector, each shape ``(p + nuisances,)``."""
        none = np.full(self.most_unknowns, np.inf)
        lower, upper = self.parameters.box
        return np.concatenate([lower, -none]), np.concatenate([upper, none])

    @property
    def search_box(self) -> StartBox:
        """Where a global search looks: initial states and shifts close to what was measured."""
        if self.region is not None:
            return self.region
        about = self.start[len(self.parameters.free) :]
        reach = _ABOUT_START * np.maximum(np.abs(about), _LEAST_START)
        return search_box(self.parameters).extended(about - reach, about + reach)

    @cached_property
    def start(self) -> FloatArray:
        """Start of a search: measured initial states, zero if not measured; shifts zero."""
        guesses = np.nan_to_num(self._measured)[:, self._unknown_states]
        shifts = np.zeros((len(self.records), self._nuisances - guesses.shape[1]))
        return np.concatenate([self.parameters.pack(), np.hstack([guesses, shifts]).ravel()])

    def unpack(self, theta: FloatArray) -> Estimate:
        """Contents of a vector.

        Raises
        ------
        ModelError
            A parameter lies outside its bounds.
        """
        count = len(self.parameters.free)
        table = theta[count:].reshape(len(self.records), self._nuisances)
        starts = np.nan_to_num(self._measured)
        states = int(self._unknown_states.sum())
        starts[:, self._unknown_states] = table[:, :states]
        shifts = np.zeros((len(self.records), len(self.structure.outputs)))
        if "output_shift" in self.unknowns:
            shifts[:] = table[:, states:]
        return Estimate(self.parameters.unpack(theta[:count]), starts, shifts)

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened errors, measured minus predicted, shape ``(samples * y,)``, and their Jacobian.

        Both are not a number where the model has no value, so that a search turns back.
        """
        size, count = self.samples * len(self.structure.outputs), len(self.parameters.free)
        residual, jacobian = np.full(size, np.nan), np.zeros((size, theta.size))
        try:
            simulated = list(self._simulated(theta))
        except ModelError:
            return residual, np.full_like(jacobian, np.nan)
        first = 0
        for place, (error, slopes) in enumerate(simulated):
            rows = slice(first, first := first + error.size)
            columns = slice(count + place * self._nuisances, count + (place + 1) * self._nuisances)
            residual[rows] = (error @ self.whitening.T).ravel()
            white = -np.einsum("ab,nbk->nak", self.whitening, slopes).reshape(error.size, -1)
            jacobian[rows, :count], jacobian[rows, columns] = white[:, :count], white[:, count:]
        return residual, jacobian

    def parts(self, theta: FloatArray) -> list[Part]:
        """For each record its whitened residual, and what its parameters and unknowns can explain, to first order.

        At the end of a fit this is what :func:`rotorid.uncertainty.colored.colored_covariance` takes: slopes beside all
        unknowns of the record, and a basis of these.

        Raises
        ------
        ModelError
            The model has no value over a record.
        """
        residual, jacobian = self.residuals(theta)
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            raise ModelError("the model diverges over a record", remedy="fit in pieces")
        count, outputs, first, found = len(self.parameters.free), len(self.structure.outputs), 0, []
        for place, record in enumerate(self.records):
            rows = slice(first, first := first + record.samples * outputs)
            basis = _basis(jacobian[rows, count + place * self._nuisances : count + (place + 1) * self._nuisances])
            slopes = jacobian[rows, :count]
            shape = (record.samples, outputs)
            found.append(
                Part(
                    residual=residual[rows].reshape(shape),
                    slopes=(slopes - basis @ (basis.T @ slopes)).reshape(*shape, -1),
                    unknown=basis.reshape(*shape, -1),
                    sample_rate_hz=record.sample_rate_hz,
                )
            )
        return found

    def errors(self, theta: FloatArray) -> FloatArray:
        """Errors of all records one after the other, in units of the outputs, shape ``(samples, y)``."""
        return np.hstack([fitted.record.outputs - fitted.predicted for fitted in self.predicted(theta)]).T

    def predicted(self, theta: FloatArray) -> tuple[Fitted, ...]:
        """Every record with what the model predicts, shifts included."""
        estimate = self.unpack(theta)
        found = []
        for record, start, shift in zip(self.records, estimate.starts, estimate.shifts, strict=True):
            y = simulate_nonlinear(
                self.structure,
                estimate.parameters.values,
                record.inputs,
                sample_rate_hz=record.sample_rate_hz,
                x0=start,
                before=record.before,
                scheme=self.scheme,
            )
            found.append(Fitted(record, y + shift[:, None]))
        return tuple(found)

    def _simulated(self, theta: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """For each record its errors ``(n, y)``, and the slopes of its outputs ``(n, y, k)``."""
        estimate = self.unpack(theta)
        outputs = len(self.structure.outputs)
        for record, start, shift in zip(self.records, estimate.starts, estimate.shifts, strict=True):
            nonlinear_sensitivities = self._sensitivities(estimate.parameters, record, start)
            slopes = [nonlinear_sensitivities.slopes]
            if "output_shift" in self.unknowns:
                slopes.append(np.broadcast_to(np.eye(outputs), (record.samples, outputs, outputs)))
            yield record.outputs.T - nonlinear_sensitivities.outputs - shift, np.concatenate(slopes, axis=2)

    def _sensitivities(self, parameters: ParameterSet, record: TimeData, start: FloatArray) -> NonlinearSensitivities:
        """A record with derivatives by the free parameters and by the unknown initial states."""
        order = len(self.structure.states)
        moves = np.eye(order)[:, self._unknown_states]
        rows = [parameters.names.index(name) for name in self.structure.parameters.names]
        directions = parameters.directions[rows]
        return nonlinear_sensitivities(
            self.structure,
            parameters.values,
            record.inputs,
            sample_rate_hz=record.sample_rate_hz,
            x0=start,
            before=record.before,
            directions=np.hstack([directions, np.zeros((len(directions), moves.shape[1]))]),
            start_directions=np.hstack([np.zeros((order, directions.shape[1])), moves]),
            scheme=self.scheme,
        )


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what the columns span, shape ``(n, k)``."""
    from scipy.linalg import orth

    size = np.linalg.norm(columns, axis=0)
    chosen = columns[:, size > 0.0] / size[size > 0.0]
    return np.asarray(orth(chosen, rcond=_SAME_DIRECTION) if chosen.size else chosen, dtype=np.float64)


_RELATIVE_FLOOR = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearFit(Fit):
    """A fitted nonlinear model.

    Parameters
    ----------
    problem
        What was fitted, with the noise as it was estimated.
    solution
        End of the last search.
    estimate
        Parameters, initial states and shifts.
    rounds
        How often the noise was estimated.
    settled
        Whether the noise came to rest.
    """

    problem: NonlinearProblem
    estimate: Estimate
    rounds: int
    settled: bool

    @property
    def noise(self) -> FloatArray:
        """Covariance of the output errors, shape ``(y, y)``."""
        return self.problem.noise

    @property
    def covariance(self) -> FloatArray:
        r"""Cramér–Rao bound :math:`(J^T J)^{-1}` of the free parameters, nuisances counted, shape ``(p, p)``.

        It assumes white errors. Flight data have coloured ones, which make the true spread several times larger.
        """
        count = len(self.problem.parameters.free)
        inverse: FloatArray = np.linalg.pinv(self.solution.jacobian.T @ self.solution.jacobian).astype(np.float64)
        return inverse[:count, :count]


def fit_nonlinear(
    problem: NonlinearProblem,
    *,
    solver: LevenbergMarquardt | None = None,
    start: FloatArray | None = None,
    rounds: int = 20,
    tolerance: float = 1e-4,
) -> NonlinearFit:
    r"""Fit parameters and noise alternately, until both converge.

    .. math:: R = \frac{1}{N} \sum_k e_k e_k^T

    Each round minimizes :math:`\sum e_k^T R^{-1} e_k` and estimates R from what is left; the likelihood rises with
    every round. Outputs with small errors thus count more. A variance is kept above 1e-12 of that of its output, so
    that a fit without errors still has one.

    Parameters
    ----------
    problem
        What to fit to what.
    solver
        The local search.
    start
        Vector to begin with; that of the problem by default.
    rounds
        How often R is estimated at most.
    tolerance
        Relative change of R that counts as rest.

    Raises
    ------
    UsageError
        No round was allowed.

    Examples
    --------
    Quadratic drag from a speed that runs out, with an unknown start:

    >>> from rotorid.fitting.time.output_error import TimeData
    >>> from rotorid.models.library import nonlinear_model
    >>> drag = nonlinear_model("drag.quadratic").select(["velocity_forward"])
    >>> time_s = np.arange(50) / 20.0
    >>> slowing = TimeData(name="slowing", inputs=np.zeros((4, 50)), outputs=2.0 / (1.0 + 0.6 * time_s)[None],
    ...                    sample_rate_hz=20.0)
    >>> fit = fit_nonlinear(NonlinearProblem(structure=drag, parameters=drag.parameters, records=(slowing,)))
    >>> round(fit.estimate.parameters["k_Dx"].value, 4)
    0.3
    """
    if rounds < 1:
        raise UsageError(f"{rounds} rounds are too few", needed="one or more")
    search = solver or LevenbergMarquardt()
    theta = problem.start if start is None else start
    floor = _RELATIVE_FLOOR * np.diag(problem.with_noise(np.zeros((0, 0))).noise)
    for number in range(1, rounds + 1):
        solution = search.minimize(problem.residuals, theta, *problem.box)
        theta = solution.theta
        if not np.isfinite(solution.cost):
            return NonlinearFit(
                problem=problem, solution=solution, estimate=problem.unpack(theta), rounds=number, settled=False
            )
        errors = problem.errors(theta)
        noise = errors.T @ errors / len(errors) + np.diag(floor)
        scale = np.sqrt(np.diag(noise))
        settled = bool(np.abs((noise - problem.noise) / np.outer(scale, scale)).max() <= tolerance)
        if settled:
            break
        problem = problem.with_noise(noise)
    return NonlinearFit(
        problem=problem, solution=solution, estimate=problem.unpack(theta), rounds=number, settled=settled
    )
