r"""Motors fitted to accelerations by the sum of absolute errors, the published cost of a genetic algorithm.

.. math::

    f = \frac{1}{C} \sum_c \frac{\sum_k |a_c(k) - \hat a_c(k)|}{\sum_k |a_c(k) - \bar a_c|}

over the accelerations c of roll, pitch and yaw, the specific force, and horizontal accelerations where velocity and
attitude are known (:mod:`rotorid.fitting.motors.translation`), up to 5 Hz. A model that knows nothing but the means has
a cost of one. The equations are those of :mod:`rotorid.fitting.motors.fit`, with the damping that the paper
leaves out and without delays, for which the lag of the motors stands; ``--fix L_p=0`` and its like give the paper's
own. Both sides pass the same low-pass, so that it moves no value.

Assumes noise on the accelerations that has nothing to do with the motors. What breaks it: a controller that feeds noise
or gusts of the same band back, which pulls gains toward its inverse. A prediction error does not have this weakness.

Absolute errors have corners. For a local search they are rounded off, :math:`|e| \to \sqrt{e^2 + \epsilon^2}`, first
over the size of the mean error and in the end over a hundredth of it.

Source: *System parameter identification of quadrotor drones with a real-coded genetic algorithm*. The covariance is
that of R. Koenker and G. Bassett, *Regression Quantiles*, Econometrica 46(1), 1978, with errors that are correlated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, SLOW_BAND_HZ, SLOW_HZ, excitations, slow_taps
from rotorid.fitting.motors.problem import FORCES, Filter, MotorProblem
from rotorid.fitting.motors.start import coarser, reach, started
from rotorid.fitting.motors.translation import translation_behind, with_translation
from rotorid.typing import BoolArray, FloatArray

_ROUNDED = (1.0, 0.1, 0.01)
"""Corners are rounded off over these parts of the mean error, one after the other."""

_SOLVER = LevenbergMarquardt(iterations=60, tolerance=1e-8)
_KEPT_HZ = 5.0 * SLOW_HZ
_NEAR = 0.5
"""Errors smaller than this part of the median count as being about zero."""


class Channel(NamedTuple):
    """One acceleration of one record.

    Parameters
    ----------
    place, name
        Of the record, and its axis.
    error
        Measured less modeled, up to 5 Hz, shape ``(n,)``.
    slopes
        Derivatives of the error, shape ``(p, n)``.
    weight
        Of an absolute error in the cost.
    """

    place: int
    name: str
    error: FloatArray
    slopes: FloatArray
    weight: float


@dataclass(frozen=True, kw_only=True, eq=False)
class AccelerationErrors(MotorProblem):
    """The sum of absolute errors of accelerations; parameters and records as of its parent.

    Examples
    --------
    A rotor that lifts twice its share of the weight is too strong, and the cost says by how much::

        problem.many_costs(np.array([[c_1, I_xx, I_yy, T_motor]]))
    """

    method: ClassVar[str] = "accelerations"

    @property
    def name(self) -> str:
        """Name of the fit for messages."""
        return "accelerations from motor outputs"

    def whitened_at(self, solution: Solution) -> Iterator[tuple[int, str, FloatArray, FloatArray]]:
        """:meth:`whitened` at the end of a search, which has left no errors but roots of them."""
        return self.whitened(solution.theta)

    def channels(self, theta: FloatArray) -> Iterator[Channel]:
        """Every acceleration of every record that counts."""
        for place, name, error, slopes in self.whitened(theta):
            every = self._every(place)
            yield Channel(place, name, error[::every], slopes[:, ::every], self._weight(place, name))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a wide box has odd corners
    def many_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of many vectors ``(b, p)``, shape ``(b,)``; infinite where the model has no value."""
        costs = np.array([self._cost(theta) for theta in thetas])
        return np.where(np.isfinite(costs), costs, np.inf)

    def _cost(self, theta: FloatArray) -> float:
        try:
            values = self.parameters.unpack(theta).values
        except ModelError:
            return np.inf
        total = 0.0
        for place, (record, filters) in enumerate(zip(self.records, self.filters, strict=True)):
            for axis in self.predictions(record, values, filters):
                error = self._slow(axis.measured - axis.predicted, filters[axis.name], axis.name)
                total += self._weight(place, axis.name) * float(np.abs(error[:: self._every(place)]).sum())
        return total

    @staticmethod
    def _slow(row: FloatArray, shape: Filter, name: str) -> FloatArray:
        """An error filtered by the low-pass, with a constant torque removed."""
        passed = np.convolve(row, shape.taps / shape.scale, mode="valid")
        return passed if name in FORCES else passed - passed.mean()

    def _weight(self, place: int, name: str) -> float:
        """Of an absolute error in the cost; a mean has as much as the samples that it is the mean of."""
        count = self.records[place].samples / self._every(place) if name == "weight" else 1.0
        return count * self.filters[place][name].scale / (len(self._sizes) * self._sizes[name])

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals whose squares add up to the cost, and derivatives of those with corners rounded ``(n, p)``."""
        rows, slopes = [], []
        for channel in self.channels(theta):
            rounded = _ROUNDED[-1] * _mean_size(channel.error)
            rows.append(np.sign(channel.error) * np.sqrt(channel.weight * np.abs(channel.error)))
            slopes.append(_steepness(channel, rounded) * channel.slopes)
        return np.concatenate(rows), np.concatenate(slopes, axis=1).T

    def polish(self, start: FloatArray) -> Solution:
        """Local search with ever sharper corners; its cost is that of :meth:`many_costs`, never above the start's."""
        theta = np.clip(start, *self.box)
        best: Solution | None = None
        evaluations, trace = 0, [float(self.many_costs(theta[None])[0])]
        for part in _ROUNDED:
            corners = [part * _mean_size(channel.error) for channel in self.channels(theta)]

            def rounded(at: FloatArray, corners: Sequence[float] = corners) -> tuple[FloatArray, FloatArray]:
                pairs = [_rounded(channel, size) for channel, size in zip(self.channels(at), corners, strict=True)]
                rows, slopes = zip(*pairs, strict=True)
                return np.concatenate(rows), np.concatenate(slopes, axis=1).T

            found = _SOLVER.minimize(rounded, theta, *self.box)
            evaluations += found.evaluations
            residual, jacobian = self.residuals(found.theta)
            cost = float(residual @ residual)
            if best is None or cost <= best.cost:
                best = replace(found, residual=residual, jacobian=jacobian, cost=cost)
                theta = found.theta
                trace.append(cost)
        if best is None:  # there is always a first one
            raise AssertionError
        return replace(best, evaluations=evaluations, trace=tuple(trace))

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """How much each acceleration moves about its mean, over all records where it counts."""
        sizes: dict[str, float] = {}
        for place, (record, equations) in enumerate(
            zip(self.records, self.equations(self.parameters.pack()), strict=True)
        ):
            for axis in equations:
                if axis.name in self.filters[place]:
                    measured = record.az[1:] if axis.name == "weight" else axis.measured
                    taps = Filter(slow_taps(record.sample_rate_hz), 1.0)
                    slow = taps(measured - measured.mean())[:: self._every(place)]
                    sizes[axis.name] = sizes.get(axis.name, 0.0) + float(np.sum(np.abs(slow)))
        if still := [name for name, size in sizes.items() if size == 0.0]:
            raise InsufficientDataError(
                f"{' and '.join(still)} did not move", needed="a flight in which all accelerations move"
            )
        return sizes

    def _every(self, place: int) -> int:
        return max(1, int(self.records[place].sample_rate_hz / _KEPT_HZ))

    def in_size(self, place: int, name: str, error: FloatArray) -> Filter:
        """The filter of an equation, so that it leaves errors of one; that of the weight knows the accelerometer."""
        shape = self.filters[place][name]
        if name == "weight":
            return Filter(shape.taps, _WEIGHT_M_S2)
        size = float(np.sqrt(np.mean(self._slow(error, Filter(shape.taps, 1.0), name) ** 2)))
        return Filter(shape.taps, size or 1.0)

    def covariance(self, theta: FloatArray, kept: BoolArray | None = None) -> FloatArray:
        r"""Random errors of the free parameters, shape ``(p, p)``, or of those of them that are kept.

        .. math:: \mathrm{Cov}\,\theta = H^{-1} V H^{-1}, \qquad H = \sum_c 2 w_c f_c(0) S_c S_c^T

        with the density of the errors at zero and V the covariance of the scores :math:`w\,\mathrm{sign}(e)\,S`, summed
        over pieces of a second and a half, within which errors are correlated.
        """
        kept = np.ones(len(self.parameters.free), dtype=np.bool_) if kept is None else kept
        parameters = int(kept.sum())
        H, V = np.zeros((parameters, parameters)), np.zeros((parameters, parameters))
        for channel in self.channels(theta):
            item = channel._replace(slopes=channel.slopes[kept])
            if item.error.size < 2:
                H += item.weight * item.slopes @ item.slopes.T
                V += item.weight**2 * item.slopes @ item.slopes.T
                continue
            near = max(_NEAR * float(np.median(np.abs(item.error))), np.finfo(np.float64).tiny)
            density = float(np.mean(np.abs(item.error) <= near)) / (2.0 * near)
            H += 2.0 * item.weight * density * item.slopes @ item.slopes.T
            scores = item.weight * np.sign(item.error) * item.slopes
            rate_hz = self.records[item.place].sample_rate_hz / self._every(item.place)
            length = max(1, round(_TOGETHER_S * rate_hz))
            pieces = np.add.reduceat(scores, np.arange(0, scores.shape[1], length), axis=1)
            V += pieces @ pieces.T
        size = np.sqrt(np.maximum(H.diagonal(), 1e-300))
        inverse = np.linalg.pinv(H / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
        return np.asarray(inverse @ V @ inverse)


_TOGETHER_S = 1.5
_START_REACH = 2.0
"""Inertia and thrust of a rotor lie within this factor of first sight, which is from regression and the weight: no
narrower than ranges that the spread of the published table is reached in (30 to 50 percent)."""

_WEIGHT_M_S2 = 0.05
"""The mean of an accelerometer is good to this, so that the corner of its error is no sharper."""


def _mean_size(error: FloatArray) -> float:
    return max(float(np.mean(np.abs(error))), 1e-12)


def _steepness(channel: Channel, corner: float) -> FloatArray:
    smooth = np.sqrt(channel.error**2 + corner**2)
    return np.asarray(0.5 * np.sqrt(channel.weight * (smooth + corner)) / smooth)


def _rounded(channel: Channel, corner: float) -> tuple[FloatArray, FloatArray]:
    """Residuals whose squares are absolute errors with rounded corners, and their derivatives."""
    smooth = np.sqrt(channel.error**2 + corner**2)
    row = np.sqrt(channel.weight) * channel.error / np.sqrt(smooth + corner)
    return row, _steepness(channel, corner) * channel.slopes


def acceleration_errors(problem: MotorProblem) -> AccelerationErrors:
    """The same motors, fitted by absolute errors of slow accelerations, with a box around them for a search.

    Parameters
    ----------
    problem
        Records, levers, parameters, axes. Filters in front of the sensors are put in front of all signals alike.

    Raises
    ------
    InsufficientDataError
        An acceleration stands still.
    """
    records = tuple(coarser(_alike(record)) for record in problem.records)
    found = with_translation(excitations(problem.records, problem.levers), problem.records)
    filters = []
    for record, excited in zip(records, found, strict=True):
        # The published cost is one of slow motion.
        slow = {axis for axis, excitation in excited.items() if excitation.band_hz == SLOW_BAND_HZ}
        counted = [axis for axis in problem.axes if axis in slow and excited[axis].correlation >= LEAST_CORRELATION]
        taps = slow_taps(record.sample_rate_hz)
        forces = [] if "az" in counted or "weight" not in problem.axes else ["weight"]
        filters.append({axis: Filter(taps if axis not in forces else np.ones(1), 1.0) for axis in (*forces, *counted)})
    posed = AccelerationErrors(
        records=records, levers=problem.levers, parameters=problem.parameters, axes=problem.axes, filters=tuple(filters)
    )
    start = posed.with_parameters(started(posed, found))
    # Errors in units of their own size, so that what judges them takes all axes alike; the cost does not change.
    sized = [
        {name: start.in_size(place, name, errors[name]) for name in shapes}
        for place, (errors, shapes) in enumerate(zip(start.errors(start.parameters.pack()), start.filters, strict=True))
    ]
    start = start.with_filters(sized)
    return start.within(reach(start, factor=_START_REACH))


def _alike(record: MotorRecord) -> MotorRecord:
    """Every signal behind all known filters: gyros behind that of the accelerometer, motors behind both."""

    def passed(rows: FloatArray, taps: FloatArray) -> FloatArray:
        if taps.size == 1:
            return rows
        first = rows[..., :1]
        moved = [np.convolve(row, taps)[: row.size] for row in np.atleast_2d(rows - first)]
        return np.asarray(np.reshape(moved, rows.shape) + taps.sum() * first)

    return replace(
        translation_behind(record, np.convolve(record.gyro_taps, record.accel_taps)),
        outputs=passed(passed(record.outputs, record.gyro_taps), record.accel_taps),
        rates=passed(record.rates, record.accel_taps),
        az=passed(record.az, record.gyro_taps),
        gyro_taps=np.ones(1),
        accel_taps=np.ones(1),
    )
