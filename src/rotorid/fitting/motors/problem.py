r"""The chain from motor outputs to accelerations, with errors that keep their color, as residuals.

What is compared are increments, so that nothing is differentiated:

.. math::

    p_{k+1} - p_k = \frac{1}{I_{xx}} \int_{t_k}^{t_{k+1}} \sum_i (-y_i) F_i \, dt + L_p \int p \, dt + b_p + e_k

and likewise q and r; specific force is compared as it was sampled. The errors e are gusts and noise of the gyros,
neither of them white. Filters A that whiten them, :math:`A(z^{-1}) e = \epsilon`, act on the whole equation. The motors
depend on the past alone, so that :math:`\epsilon` is independent of them although a controller feeds the measured
motion back: the values are those of a prediction error method, without the bias of plain regression under feedback.
An axis of a flight counts where the motors moved it enough (:mod:`rotorid.fitting.motors.excitation`); where thrust was
not moved, the mean of the specific force alone is compared with thrust (the equation ``weight``). Horizontal
accelerations, equations ``x`` and ``y``, are those of :mod:`rotorid.fitting.motors.translation`.

Assumes motors and rates on one clock, torque bias constant over a record, small rates (no gyroscopic coupling), and
errors that an autoregression describes. What breaks it: motors logged slower than they act, saturated ones whose output
is not what turns, clocks that drift.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, NamedTuple, Self

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import read_only
from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.motors.excitation import Excitation, excitations, filtered
from rotorid.fitting.motors.speed import MotorSpeed, measured_speed, motor_speed
from rotorid.fitting.motors.translation import DRAG, Translation, between, shows_translation, translation
from rotorid.fitting.problem import Part, Problem
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.motors import SPIN_UP, YAW_DELAY
from rotorid.typing import BoolArray, FloatArray

INERTIA: Mapping[str, str] = MappingProxyType({"p": "I_xx", "q": "I_yy", "r": "kappa_per_I_zz"})
"""Body rate to the parameter by which rotors turn the vehicle about its axis."""

DAMPING: Mapping[str, str] = MappingProxyType({"p": "L_p", "q": "M_q", "r": "N_r"})
"""Body rate to its damping."""

FORCES = ("az", "weight")
"""Equations of specific force, whose mean is the weight."""

_EQUATIONS = (*FORCES, *RATES, *DRAG)
"""In the order in which a record has them."""

_NO_LAG_S = 1e-6
_SHORT = 0.1


class Filter(NamedTuple):
    """Whitening filter of the errors of one axis: taps of a causal filter, and the size of its output."""

    taps: FloatArray
    scale: float

    def __call__(self, rows: FloatArray) -> FloatArray:
        """Filter the last axis; where the filter has not filled yet there is no value."""
        return filtered(rows, self.taps / self.scale)


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
class MotorProblem(Problem):
    """The chain from motor outputs to accelerations, fitted to records.

    Parameters
    ----------
    records
        What was flown.
    levers
        Roll, pitch and yaw moment of one newton of each rotor: :math:`-y_i`, :math:`x_i` in meters, and the direction
        :math:`s_i` of its torque; shape ``(3, motors)``.
    parameters, region
        As in :class:`rotorid.fitting.problem.Problem`; those of :func:`rotorid.models.motors.motor_parameters`.
    axes
        Which equations count.
    filters
        For each record, axis to filter; an axis without one does not count there. By default all count, and their
        errors are taken as they are.
    left
        Of every equation what counts as its whitened error at the truth, for data drawn anew; by default nothing.
    in_air
        Of :func:`rotorid.fitting.motors.excitation.excitations`.

    Raises
    ------
    UsageError
        Records and levers have different numbers of motors.
    """

    method: ClassVar[str] = "motors"
    alike: ClassVar[bool] = False

    records: tuple[MotorRecord, ...]
    levers: FloatArray
    axes: tuple[str, ...] = ("az", "weight", "p", "q", "r")
    filters: tuple[Mapping[str, Filter], ...] = ()
    left: tuple[FloatArray, ...] = ()
    in_air: bool = False

    def __post_init__(self) -> None:
        levers = read_only(self.levers, np.float64, ndim=2)
        for record in self.records:
            if levers.shape != (3, record.outputs.shape[0]):
                came = f"{record.name} has {record.outputs.shape[0]} motors"
                raise UsageError(came, needed=f"{levers.shape[1]}, as in the rotor layout")
        if not self.records:
            raise UsageError("no records were given", needed="at least one")
        plain = dict.fromkeys(self.axes, Filter(np.ones(1), 1.0))
        filters = self.filters or tuple(plain for _ in self.records)
        self._set(records=tuple(self.records), levers=levers, axes=tuple(self.axes), filters=tuple(filters))

    @property
    def name(self) -> str:
        """Name of the fit for messages."""
        return "motors"

    @cached_property
    def excitations(self) -> tuple[dict[str, Excitation], ...]:
        """For every record, how far the motors explain the slow motion of each axis."""
        names = self.parameters.names
        spin_up = SPIN_UP in names and (SPIN_UP in self.parameters.free or self.parameters[SPIN_UP].value != 0.0)
        return excitations(self.records, self.levers, spin_up=spin_up, in_air=self.in_air)

    def with_filters(self, filters: Sequence[Mapping[str, Filter]]) -> Self:
        """The same problem with errors taken as of another color."""
        return replace(self, filters=tuple(filters))

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened errors of all equations, one after the other, and their Jacobian by the free parameters."""
        white = [(error, slopes) for _, _, error, slopes in self.whitened(theta)]
        rows, slopes = zip(*white, strict=True)
        return np.concatenate(rows), np.concatenate(slopes, axis=1).T

    def parts(self, theta: FloatArray) -> list[Part]:
        """For each equation its whitened errors ``(n, 1)``, their derivatives ``(n, 1, p)`` and unknown constants."""
        return self._parts(self.whitened(theta))

    def parts_at(self, solution: Solution) -> list[Part]:
        """:meth:`parts` at the end of a search, from what it has left."""
        return self._parts(self.whitened_at(solution))

    @staticmethod
    def _parts(whitened: Iterable[tuple[int, str, FloatArray, FloatArray]]) -> list[Part]:
        found = []
        for _, name, error, slopes in whitened:
            unknown = np.full((error.size, 1, 0 if name in FORCES else 1), error.size**-0.5)
            found.append(Part(error[:, None], slopes.T[:, None], unknown))
        return found

    def whitened_at(self, solution: Solution) -> Iterator[tuple[int, str, FloatArray, FloatArray]]:
        """:meth:`whitened` at the end of a search, from what it has left."""
        start = 0
        for place, (record, filters) in enumerate(zip(self.records, self.filters, strict=True)):
            for axis in (name for name in _EQUATIONS if name in filters):
                stop = start + (1 if axis == "weight" else record.samples - filters[axis].taps.size)
                yield place, axis, solution.residual[start:stop], solution.jacobian[start:stop].T
                start = stop

    def determined(self, solution: Solution) -> BoolArray:
        """Which free parameters have an uncertainty, shape ``(p,)``: those that did not end on a bound.

        A lag far shorter than the samples is not separated from a delay, and has none.
        """
        fastest_hz = max(record.sample_rate_hz for record in self.records)
        values = zip(self.parameters.free, solution.theta, strict=True)
        short = [name == "T_motor" and value * fastest_hz < _SHORT for name, value in values]
        return ~(np.array(solution.at_bound, dtype=np.bool_) | np.array(short, dtype=np.bool_))

    def noiseless(self, theta: FloatArray) -> Self:
        """The same problem without what it has left at ``theta``.

        Motors and measured rates on the right-hand side stay as flown. Under feedback the motors would have answered to
        other errors; as they depend on the past alone, the scatter of the values is the same to first order.
        """
        plain = replace(self, left=())
        return replace(self, left=tuple(error for _, _, error, _ in plain.whitened(theta)))

    def disturbed(self, errors: Sequence[FloatArray]) -> Self:
        """The same problem with other errors of every equation, ``(n, 1)`` each, whitened as it whitens them."""
        left = tuple(known - error[:, 0] for known, error in zip(self.left, errors, strict=True))
        return replace(self, left=left)

    def whitened(self, theta: FloatArray) -> Iterator[tuple[int, str, FloatArray, FloatArray]]:
        """Of every equation that counts: place of its record, axis, whitened error, and slopes ``(p, n)``."""
        parameters = self.parameters.unpack(theta)
        values, directions = parameters.values, parameters.directions
        left = iter(self.left)
        for place, (record, filters) in enumerate(zip(self.records, self.filters, strict=True)):
            for axis in self.predictions(record, values, filters, moved=True):
                error, slopes = _whitened_axis(axis, directions, filters[axis.name])
                if self.left:
                    error = _centered(error - next(left), axis.name)
                yield place, axis.name, error, slopes

    def equations(
        self, theta: FloatArray, wanted: Collection[str] | None = None, *, moved: bool = False
    ) -> list[list[Axis]]:
        """For every record its equations at some parameters, of all axes or those wanted: see :meth:`predictions`."""
        values = self.parameters.unpack(theta).values
        axes = self.axes if wanted is None else [axis for axis in self.axes if axis in wanted]
        return [self.predictions(record, values, axes, moved=moved) for record in self.records]

    def errors(self, theta: FloatArray) -> list[dict[str, FloatArray]]:
        """For every record the errors of each axis as they are, a constant torque taken out."""
        return [
            {axis.name: _centered(axis.measured - axis.predicted, axis.name) for axis in record}
            for record in self.equations(theta)
        ]

    def predictions(
        self, record: MotorRecord, values: Mapping[str, float], wanted: Collection[str], *, moved: bool = False
    ) -> list[Axis]:
        """Equations of one record at some values; slopes by lag and delay, which take most of the time, if asked for.

        Parameters
        ----------
        record
            One of the records.
        values
            All parameters by name.
        wanted
            Which equations.
        moved
            Whether derivatives by lag and delay are worked out; they are zero otherwise.
        """
        step = 1.0 / record.sample_rate_hz
        rates = [axis for axis in RATES if axis in wanted]
        found = []
        if "az" in wanted or "weight" in wanted:
            late = _derived(record, values, "tau_accel", step, moved=moved)
            force = _force_axis(record, values, late, self.parameters.names)
            found += [force] if "az" in wanted else []
            found += [_mean(force)] if "weight" in wanted else []
        if rates:
            names = {axis: YAW_DELAY if axis == "r" and YAW_DELAY in values else "tau_gyro" for axis in rates}
            delayed = {
                name: _derived(record, values, name, step, moved=moved, integrals=True) for name in set(names.values())
            }
            found += [self._rate_axis(record, values, delayed[names[axis]], axis, step) for axis in rates]
        level = [axis for axis in DRAG if axis in wanted]
        if level and shows_translation(record):
            late = _derived(record, values, "tau_accel", step, moved=moved)
            shown = translation(record)
            found += [_level_axis(record, values, late, shown, axis, self.parameters.names) for axis in level]
        return found

    def _rate_axis(
        self, record: MotorRecord, values: Mapping[str, float], late: _DelayedMotors, axis: str, step: float
    ) -> Axis:
        place = RATES.index(axis)
        rate = record.rates[place]
        damping, inertia = ("L_p", "M_q", "N_r")[place], ("I_xx", "I_yy", "kappa_per_I_zz")[place]
        gain = values[inertia] if axis == "r" else 1.0 / values[inertia]
        strength = 0.5 * (record.strength[1:] + record.strength[:-1])
        lever = self.levers[place]

        def torque(terms: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {name: _passed(strength * (lever @ term), record.gyro_taps) for name, term in terms.items()}

        # Damping acts on the mean of both ends. The later one is predicted, since its noise is that of the error.
        half = 0.5 * step * values[damping]
        moments = torque(late.impulses(values, step))
        moment = _by_the_curve(values, moments)
        driven = gain * moment
        slopes = {name: gain * term for name, term in moments.items()}
        slopes[inertia] = moment if axis == "r" else -moment * gain**2
        if axis == "r" and SPIN_UP in values:
            gained = {name: _passed(lever @ term, record.gyro_taps) for name, term in late.gained(record).items()}
            driven = driven + values[SPIN_UP] * gained[SPIN_UP]
            for name, term in gained.items():
                slopes[name] = term if name == SPIN_UP else slopes[name] + values[SPIN_UP] * term
        predicted = (driven + 2.0 * half * rate[:-1]) / (1.0 - half)
        slopes = {name: term / (1.0 - half) for name, term in slopes.items()}
        slopes[damping] = step * (rate[:-1] + 0.5 * predicted) / (1.0 - half)
        return Axis(
            name=axis,
            measured=np.diff(rate),
            predicted=np.asarray(predicted),
            slopes=_rows(slopes, self.parameters.names, rate.size - 1),
        )


class _DelayedMotors(NamedTuple):
    """Motors over a record, and their derivatives by the names of lag and delay."""

    here: MotorSpeed
    moved: Mapping[str, MotorSpeed]

    def impulses(self, values: Mapping[str, float], step: float) -> dict[str, FloatArray]:
        """Derivatives of the impulse of every rotor by coefficients, lag and delay, shape ``(motors, n - 1)``."""
        here = self.here
        terms = {"c_0": np.full(here.first.shape, step), "c_1": here.first, "c_2": here.second}
        slopes = {name: term for name, term in terms.items() if name in values}
        for name, moved in self.moved.items():
            slopes[name] = values.get("c_1", 0.0) * moved.first + values.get("c_2", 0.0) * moved.second
        return slopes

    def thrusts(self, values: Mapping[str, float]) -> dict[str, FloatArray]:
        """The same of the thrust of every rotor at a sample, ``(motors, n)``."""
        level = self.here.level
        slopes = {name: level**power for power, name in enumerate(CURVE_TERMS) if name in values}
        slope = values.get("c_1", 0.0) + 2.0 * values.get("c_2", 0.0) * level
        return slopes | {name: slope * moved.level for name, moved in self.moved.items()}

    def gained(self, record: MotorRecord) -> dict[str, FloatArray]:
        """Speed gained by each rotor over a sample, with derivatives by lag and delay, ``(motors, n - 1)``."""
        gains = {SPIN_UP: _gained(self.here, record)}
        return gains | {name: _gained(moved, record) for name, moved in self.moved.items()}


def _gained(motors: MotorSpeed, record: MotorRecord) -> FloatArray:
    """Speed gained by each rotor over a sample; thrust goes with the square of the voltage, speed with it."""
    gained: FloatArray = np.diff(motors.level * np.sqrt(record.strength), axis=1)
    return gained


def _by_the_curve(values: Mapping[str, float], terms: Mapping[str, FloatArray]) -> FloatArray:
    """Thrust, from what each coefficient of its curve is multiplied by."""
    thrusts = [values[name] * terms[name] for name in CURVE_TERMS if name in terms]
    total: FloatArray = sum(thrusts[1:], thrusts[0])
    return total


def _derived(
    record: MotorRecord, values: Mapping[str, float], delay: str, step: float, *, moved: bool, integrals: bool = False
) -> _DelayedMotors:
    """Motors with derivatives by lag and delay, where these are parameters at all and the derivatives are wanted.

    Forces are compared at the samples, rates by the integrals between them.
    """
    delay_s = values.get(delay, 0.0)
    if record.between == "lines" and "T_motor" not in values:
        here = measured_speed(record.outputs, delay_s=delay_s, step_s=step, moved=moved)
    else:
        lag_s = values.get("T_motor", _NO_LAG_S)
        here = motor_speed(record.outputs, lag_s=lag_s, delay_s=delay_s, step_s=step, moved=moved, integrals=integrals)
    names = {"lag": "T_motor", "delay": delay}
    return _DelayedMotors(here, {names[by]: slope for by, slope in here.moved.items() if names[by] in values})


def _force_axis(record: MotorRecord, values: Mapping[str, float], late: _DelayedMotors, names: Sequence[str]) -> Axis:
    inverse = 1.0 / values["m"]
    strength = record.strength[1:]

    def summed(terms: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {name: _passed(strength * term[:, 1:].sum(axis=0), record.accel_taps) for name, term in terms.items()}

    thrusts = summed(late.thrusts(values))
    thrust = _by_the_curve(values, thrusts)
    slopes = {name: -inverse * term for name, term in thrusts.items()}
    slopes["m"] = thrust * inverse**2
    predicted = -inverse * thrust
    if "Z_w" in values and record.w.size:
        slopes["Z_w"] = record.w[1:]
        predicted = predicted + values["Z_w"] * record.w[1:]
    return Axis("az", record.az[1:], np.asarray(predicted), _rows(slopes, names, strength.size))


def _level_axis(
    record: MotorRecord,
    values: Mapping[str, float],
    late: _DelayedMotors,
    shown: Translation,
    axis: str,
    names: Sequence[str],
) -> Axis:
    """Horizontal acceleration along a level axis, in m/s²; no sensor filters what velocity and attitude show."""
    row = list(DRAG).index(axis)
    inverse, lean = 1.0 / values["m"], shown.lean[row]
    thrusts = {name: record.strength * term.sum(axis=0) for name, term in late.thrusts(values).items()}
    thrust = _by_the_curve(values, thrusts)
    slopes = {name: between(-inverse * lean * term) for name, term in thrusts.items()}
    slopes["m"] = between(inverse**2 * lean * thrust)
    predicted = between(-inverse * lean * thrust)
    if "Z_w" in values:
        slopes["Z_w"] = between(lean * record.velocity[2])
        predicted = predicted + values["Z_w"] * slopes["Z_w"]
    for name, rows in shown.drag.items():
        if name in values:
            slopes[name] = rows[row]
            predicted = predicted + values[name] * rows[row]
    return Axis(axis, shown.measured[row], np.asarray(predicted), _rows(slopes, names, predicted.size))


def _passed(row: FloatArray, taps: FloatArray) -> FloatArray:
    """A row behind a filter that has long settled on its first value."""
    if taps.size == 1:
        return np.asarray(taps[0] * row)
    return np.asarray(np.convolve(row - row[0], taps)[: row.size] + taps.sum() * row[0])


def _mean(force: Axis) -> Axis:
    """Mean thrust that makes the mean specific force: the weight, times the load factor that was flown."""
    mean = (row.mean(axis=-1, keepdims=True) for row in (force.measured, force.predicted, force.slopes))
    return Axis("weight", *mean)


def _rows(slopes: Mapping[str, FloatArray], names: Sequence[str], size: int) -> FloatArray:
    rows = np.zeros((len(names), size))
    for place, name in enumerate(names):
        if name in slopes:
            rows[place] = slopes[name]
    return rows


def _centered(row: FloatArray, axis: str) -> FloatArray:
    """Without the constant torque that no model knows; specific force keeps its mean, which is the weight."""
    return row if axis in FORCES else row - row.mean(axis=-1, keepdims=True)


def _whitened_axis(axis: Axis, directions: FloatArray, shape: Filter) -> tuple[FloatArray, FloatArray]:
    rows = directions.T @ axis.slopes
    # Inertia and damping of the other axes have no part in this one.
    own = np.any(rows, axis=1)
    white = _centered(shape(np.concatenate([(axis.measured - axis.predicted)[None], -rows[own]])), axis.name)
    slopes = np.zeros((own.size, white.shape[1]))
    slopes[own] = white[1:]
    return white[0], slopes
