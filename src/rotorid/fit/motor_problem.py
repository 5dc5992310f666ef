r"""Fit the chain from motor outputs to accelerations, with errors that keep their color.

What is compared are increments, so that nothing is differentiated:

.. math::

    p_{k+1} - p_k = \frac{1}{I_{xx}} \int_{t_k}^{t_{k+1}} \sum_i (-y_i) F_i \, dt + L_p \int p \, dt + b_p + e_k

and likewise q and r; specific force is compared as it was sampled. The errors e are gusts and noise of the gyros,
neither of them white. Filters A that whiten them, :math:`A(z^{-1}) e = \epsilon`, act on the whole equation. The motors
depend on the past alone, so that :math:`\epsilon` is independent of them although a controller feeds the measured
motion back: the values are those of a prediction error method, without the bias of plain regression under feedback.

Where thrust was not moved, the weight alone is compared, the mean of the specific force: ``weight``.

Assumes motors and rates on one clock, torque bias constant over a record, small rates (no gyroscopic coupling), and
errors that an autoregression describes. What breaks it: motors logged slower than they act, saturated ones whose output
is not what turns, clocks that drift.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.motor_record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fit.motor_lag import Turning, turning
from rotorid.fit.time_problem import Part
from rotorid.models.motor_parameters import RATES
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray

FORCES = ("az", "weight")
"""Equations of specific force, whose mean is the weight."""

Row = NDArray[np.float64] | NDArray[np.complex128]

_STEP = 1e-30
_NO_LAG_S = 1e-6


class Filter(NamedTuple):
    """What makes errors of one axis white: taps of a causal filter, and the size of what it leaves."""

    taps: FloatArray
    scale: float

    def __call__(self, rows: FloatArray) -> FloatArray:
        """Filter the last axis; where the filter has not filled yet there is no value."""
        from scipy.signal import oaconvolve

        taps = self.taps.reshape((1,) * (rows.ndim - 1) + (-1,))
        return np.asarray(oaconvolve(rows, taps / self.scale, mode="valid", axes=-1))


class Axis(NamedTuple):
    """One equation over one record.

    Parameters
    ----------
    name
        ``az``, ``weight``, ``p``, ``q`` or ``r``.
    measured
        Samples of specific force, their mean, or increments of a rate, shape ``(n - 1,)`` or ``(1,)``.
    predicted
        The same from the motors, without the constant.
    slopes
        Derivatives of the prediction by all parameters of the set, shape ``(parameters, n - 1)``.
    """

    name: str
    measured: FloatArray
    predicted: FloatArray
    slopes: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorProblem(Immutable):
    """The chain from motor outputs to accelerations, fitted to records.

    Parameters
    ----------
    records
        What was flown.
    levers
        Roll, pitch and yaw moment of one newton of each rotor: :math:`-y_i`, :math:`x_i` in meters, and the direction
        :math:`s_i` of its torque; shape ``(3, motors)``.
    parameters
        Of :func:`rotorid.models.motor_parameters.motor_parameters`.
    axes
        Which equations count.
    filters
        For each record, axis to filter; an axis without one does not count there. By default all count, and their
        errors are taken as they are.

    Raises
    ------
    UsageError
        Records and levers have different numbers of motors.
    """

    records: tuple[MotorRecord, ...]
    levers: FloatArray
    parameters: ParameterSet
    axes: tuple[str, ...] = ("az", "weight", "p", "q", "r")
    filters: tuple[Mapping[str, Filter], ...] = ()

    def __post_init__(self) -> None:
        levers = read_only(self.levers, np.float64, ndim=2)
        for record in self.records:
            if levers.shape != (3, record.outputs.shape[0]):
                came = f"{record.name} has {record.outputs.shape[0]} motors"
                raise UsageError(came, needed=f"{levers.shape[1]}, as the layout of the rotors has")
        if not self.records:
            raise UsageError("no record came", needed="one at least")
        plain = dict.fromkeys(self.axes, Filter(np.ones(1), 1.0))
        filters = self.filters or tuple(plain for _ in self.records)
        self._set(records=tuple(self.records), levers=levers, axes=tuple(self.axes), filters=tuple(filters))

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the free parameters, each shape ``(p,)``."""
        free = [self.parameters[name] for name in self.parameters.free]
        return np.array([one.lower for one in free]), np.array([one.upper for one in free])

    def with_parameters(self, parameters: ParameterSet) -> MotorProblem:
        """The same problem with other free parameters or another start."""
        return replace(self, parameters=parameters)

    def with_filters(self, filters: Sequence[Mapping[str, Filter]]) -> MotorProblem:
        """The same problem with errors taken as of another color."""
        return replace(self, filters=tuple(filters))

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened errors of all equations, one after the other, and their Jacobian by the free parameters."""
        white = [(error, slopes) for _, _, error, slopes in self.whitened(theta)]
        rows, slopes = zip(*white, strict=True)
        return np.concatenate(rows), np.concatenate(slopes, axis=1).T

    def parts(self, theta: FloatArray) -> list[Part]:
        """For each equation its whitened errors ``(n, 1)``, their derivatives ``(n, 1, p)`` and unknown constants."""
        found = []
        for _, name, error, slopes in self.whitened(theta):
            unknown = np.full((error.size, 1, 0 if name in FORCES else 1), error.size**-0.5)
            found.append(Part(error[:, None], slopes.T[:, None], unknown))
        return found

    def whitened(self, theta: FloatArray) -> Iterator[tuple[int, str, FloatArray, FloatArray]]:
        """Of every equation that counts: place of its record, axis, whitened error, and slopes ``(p, n)``."""
        parameters = self.parameters.unpack(theta)
        values, directions = parameters.values, parameters.directions
        for place, (record, filters) in enumerate(zip(self.records, self.filters, strict=True)):
            for axis in self._axes(record, values, filters):
                yield place, axis.name, *_whitened(axis, directions, filters[axis.name])

    def equations(self, theta: FloatArray) -> list[list[Axis]]:
        """For every record its equations at some parameters."""
        values = self.parameters.unpack(theta).values
        return [self._axes(record, values, self.axes) for record in self.records]

    def errors(self, theta: FloatArray) -> list[dict[str, FloatArray]]:
        """For every record the errors of each axis as they are, a constant torque taken out."""
        return [
            {axis.name: _centered(axis.measured - axis.predicted, axis.name) for axis in record}
            for record in self.equations(theta)
        ]

    def _axes(self, record: MotorRecord, values: Mapping[str, float], wanted: Collection[str]) -> list[Axis]:
        step = 1.0 / record.sample_rate_hz
        rates = [axis for axis in RATES if axis in wanted]
        found = []
        if "az" in wanted or "weight" in wanted:
            force = _force_axis(record, values, _derived(record, values, "tau_accel", step), self.parameters.names)
            found += [force] if "az" in wanted else []
            found += [_mean(force)] if "weight" in wanted else []
        if rates:
            late = _derived(record, values, "tau_gyro", step)
            found += [self._rate_axis(record, values, late, axis, step) for axis in rates]
        return found

    def _rate_axis(self, record: MotorRecord, values: Mapping[str, float], late: _Late, axis: str, step: float) -> Axis:
        place = RATES.index(axis)
        rate = record.rates[place]
        damping, inertia = ("L_p", "M_q", "N_r")[place], ("I_xx", "I_yy", "kappa_per_I_zz")[place]
        gain = values[inertia] if axis == "r" else 1.0 / values[inertia]
        strength = 0.5 * (record.strength[1:] + record.strength[:-1])
        lever = self.levers[place]

        def torque(terms: Mapping[str, Row]) -> dict[str, Row]:
            return {name: _passed(strength * (lever @ term), record.gyro_taps) for name, term in terms.items()}

        # Damping acts on the mean of both ends. The later one is predicted, since its noise is that of the error.
        half = 0.5 * step * values[damping]
        moment = _combined(values, torque(late.integrals(values, step)))
        predicted = (gain * moment + 2.0 * half * rate[:-1]) / (1.0 - half)
        slopes = {name: gain / (1.0 - half) * term for name, term in torque(late.sums(values, step)).items()}
        slopes[inertia] = (moment if axis == "r" else -moment * gain**2) / (1.0 - half)
        slopes[damping] = step * (rate[:-1] + 0.5 * predicted) / (1.0 - half)
        return Axis(
            name=axis,
            measured=np.diff(rate),
            predicted=np.asarray(predicted),
            slopes=_rows(slopes, self.parameters.names, rate.size - 1),
        )


class _Late(NamedTuple):
    """Motors over a record, and the same a tiny imaginary step of a parameter further."""

    here: Turning
    moved: Mapping[str, Turning]

    def integrals(self, values: Mapping[str, float], step: float) -> dict[str, Row]:
        return _impulses(self.here, values, step)

    def sums(self, values: Mapping[str, float], step: float) -> dict[str, Row]:
        """Derivatives of the impulse of every rotor by coefficients, lag and delay, shape ``(motors, n - 1)``."""
        slopes = self.integrals(values, step)
        for name, moved in self.moved.items():
            slopes[name] = _combined(values, _impulses(moved, values, step)).imag / _STEP
        return slopes

    def levels(self, values: Mapping[str, float]) -> dict[str, Row]:
        return _thrusts(self.here, values)

    def level_slopes(self, values: Mapping[str, float]) -> dict[str, Row]:
        slopes = self.levels(values)
        for name, moved in self.moved.items():
            slopes[name] = _combined(values, _thrusts(moved, values)).imag / _STEP
        return slopes


def _impulses(motors: Turning, values: Mapping[str, float], step: float) -> dict[str, Row]:
    """What each coefficient of the curve is multiplied by in the impulse of a rotor over a sample."""
    terms: dict[str, Row] = {}
    if "c_0" in values:
        terms["c_0"] = np.full((motors.level.shape[0], motors.level.shape[1] - 1), step)
    if "c_1" in values:
        terms["c_1"] = motors.first
    if "c_2" in values:
        terms["c_2"] = motors.second
    return terms


def _thrusts(motors: Turning, values: Mapping[str, float]) -> dict[str, Row]:
    """The same in its thrust at a sample."""
    powers = {"c_0": 0, "c_1": 1, "c_2": 2}
    return {name: motors.level**power for name, power in powers.items() if name in values}


def _combined(values: Mapping[str, float], terms: Mapping[str, Row]) -> Row:
    """Thrust, from what each coefficient is multiplied by."""
    thrusts = [values[name] * term for name, term in terms.items()]
    total: Row = sum(thrusts[1:], thrusts[0])
    return total


def _derived(record: MotorRecord, values: Mapping[str, float], delay: str, step: float) -> _Late:
    """Motors with derivatives by lag and delay, where these are parameters at all."""
    lag = values.get("T_motor", _NO_LAG_S)
    late = {"T_motor": lag, delay: values.get(delay, 0.0)}

    def at(moved: str | None) -> Turning:
        shifted = {name: complex(value, _STEP) if name == moved else value for name, value in late.items()}
        return turning(record.outputs, lag_s=shifted["T_motor"], delay_s=shifted[delay], step_s=step)

    return _Late(at(None), {name: at(name) for name in late if name in values})


def _force_axis(record: MotorRecord, values: Mapping[str, float], late: _Late, names: Sequence[str]) -> Axis:
    inverse = 1.0 / values["m"]
    strength = record.strength[1:]

    def summed(terms: Mapping[str, Row]) -> dict[str, Row]:
        return {name: _passed(strength * term[:, 1:].sum(axis=0), record.accel_taps) for name, term in terms.items()}

    thrust = _combined(values, summed(late.levels(values)))
    slopes = {name: -inverse * term for name, term in summed(late.level_slopes(values)).items()}
    slopes["m"] = thrust * inverse**2
    predicted = -inverse * thrust
    if "Z_w" in values and record.w.size:
        slopes["Z_w"] = record.w[1:]
        predicted = predicted + values["Z_w"] * record.w[1:]
    return Axis("az", record.az[1:], np.asarray(predicted), _rows(slopes, names, strength.size))


def _passed(row: Row, taps: FloatArray) -> FloatArray:
    """A row behind a filter that has long settled on its first value."""
    real = np.asarray(row, dtype=np.float64)
    if taps.size == 1:
        return np.asarray(taps[0] * real)
    return np.asarray(np.convolve(real - real[0], taps)[: real.size] + taps.sum() * real[0])


def _mean(force: Axis) -> Axis:
    """What carries the weight on average."""
    mean = (row.mean(axis=-1, keepdims=True) for row in (force.measured, force.predicted, force.slopes))
    return Axis("weight", *mean)


def _rows(slopes: Mapping[str, Row], names: Sequence[str], size: int) -> FloatArray:
    rows = np.zeros((len(names), size))
    for place, name in enumerate(names):
        if name in slopes:
            rows[place] = slopes[name]
    return rows


def _centered(row: FloatArray, axis: str) -> FloatArray:
    """Without the constant torque that no model knows; specific force keeps its mean, which is the weight."""
    return row if axis in FORCES else row - row.mean(axis=-1, keepdims=True)


def _whitened(axis: Axis, directions: FloatArray, shape: Filter) -> tuple[FloatArray, FloatArray]:
    both = np.concatenate([(axis.measured - axis.predicted)[None], -directions.T @ axis.slopes])
    white = _centered(shape(both), axis.name)
    return white[0], white[1:]
