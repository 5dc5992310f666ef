r"""Fit the chain from motor outputs to accelerations, with errors that keep their color.

What is compared are increments, so that nothing is differentiated:

.. math::

    p_{k+1} - p_k = \frac{1}{I_{xx}} \int_{t_k}^{t_{k+1}} \sum_i (-y_i) F_i \, dt + L_p \int p \, dt + b_p + e_k

and likewise q and r; specific force is compared as it was sampled. The errors e are gusts and noise of the gyros,
neither of them white. Filters A that whiten them, :math:`A(z^{-1}) e = \epsilon`, act on the whole equation. The motors
depend on the past alone, so that :math:`\epsilon` is independent of them although a controller feeds the measured
motion back: the values are those of a prediction error method, without the bias of plain regression under feedback.
The fit takes turns between the parameters and the filters. An axis of a flight counts where the motors moved it enough;
where thrust was not moved, the mean of the specific force alone is compared, with the weight (the equation ``weight``).

Assumes motors and rates on one clock, torque bias constant over a record, small rates (no gyroscopic coupling), and
errors that an autoregression describes. What breaks it: motors logged slower than they act, saturated ones whose output
is not what turns, clocks that drift.

A motor takes its output :math:`u`, held from sample to sample and late by :math:`\tau`, with a first-order lag,

.. math:: T \dot x(t) = u(t - \tau) - x(t),

so that within a stretch of constant input :math:`x = u + (x_0 - u) e^{-t/T}`, and what thrust and torque need over a
sample, :math:`\int x \, dt` and :math:`\int x^2 \, dt`, has closed forms. Speeds that were measured go from sample to
sample in lines, and have closed forms too. Everything here is analytic in T and :math:`\tau`: complex numbers pass, for
exact derivatives by a complex step.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rotorid.data.axes import RATES
from rotorid.data.base import read_only
from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.problem import Fit, Part, Problem, Scale, StartBox
from rotorid.models.motors import SPIN_UP, YAW_DELAY
from rotorid.models.parameter import ParameterSet
from rotorid.typing import AnyArray, BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Lagged = NDArray[np.float64] | NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MotorSpeed:
    """Motors over a record.

    Parameters
    ----------
    level
        Lagged output at every sample, shape ``(motors, n)``.
    stretches
        Two for each sample, before and after the input changes: lagged output at their start, the input that stands,
        their length and the lag; or lines, of measured speeds.
    """

    level: Lagged
    stretches: tuple[_Stretch | _Line, _Stretch | _Line]

    @cached_property
    def first(self) -> Lagged:
        """Integral of the lagged output from each sample to the next, shape ``(motors, n - 1)``."""
        late, early = (one.whole for one in self.stretches)
        return (late + early)[:, :-1]

    @cached_property
    def second(self) -> Lagged:
        """Integral of its square, shape ``(motors, n - 1)``."""
        late, early = (one.squared for one in self.stretches)
        return (late + early)[:, :-1]


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A time in which the input stands."""

    start: Lagged
    held: FloatArray
    span_s: complex
    lag_s: complex

    @cached_property
    def once(self) -> Lagged:
        """Integral of what is left of the step to the input."""
        once: Lagged = self.lag_s * (1.0 - np.exp(-self.span_s / self.lag_s)) * (self.start - self.held)
        return once

    @property
    def whole(self) -> Lagged:
        """Integral of the lagged output."""
        whole: Lagged = self.held * self.span_s + self.once
        return whole

    @property
    def squared(self) -> Lagged:
        left = np.exp(-2.0 * self.span_s / self.lag_s)
        away = 0.5 * self.lag_s * (1.0 - left) * (self.start - self.held) ** 2
        squared: Lagged = self.held**2 * self.span_s + 2.0 * self.held * self.once + away
        return squared


@dataclass(frozen=True, eq=False)
class _Line:
    """A time in which a speed goes from one value to another."""

    start: Lagged
    stop: Lagged
    span_s: complex

    @property
    def whole(self) -> Lagged:
        """Integral of the speed."""
        whole: AnyArray = 0.5 * self.span_s * (self.start + self.stop)
        return whole

    @property
    def squared(self) -> Lagged:
        """Integral of its square."""
        squared: AnyArray = self.span_s * (self.start**2 + self.start * self.stop + self.stop**2) / 3.0
        return squared


def measured_speed(speeds: FloatArray, *, delay_s: complex, step_s: float) -> MotorSpeed:
    """Measured speeds, joined by lines and delayed, at the samples, and their integrals between them, exactly.

    Parameters
    ----------
    speeds
        At the samples, shape ``(motors, n)``; before the first and after the last they stand.
    delay_s
        Delay; a complex one for a complex step.
    step_s
        Time between samples.

    Examples
    --------
    >>> rising = measured_speed(np.array([[0.0, 1.0, 2.0, 3.0]]), delay_s=0.025, step_s=0.1)
    >>> rising.level.round(4).tolist(), rising.first.round(4).tolist()
    ([[0.0, 0.75, 1.75, 2.75]], [[0.0281, 0.125, 0.225]])
    """
    samples = speeds.shape[1]
    whole = int(np.floor(delay_s.real / step_s))
    rest = delay_s - whole * step_s
    ago = [speeds[:, np.clip(np.arange(samples + 1) - whole - one, 0, samples - 1)] for one in (0, 1)]
    level = ago[0] + (ago[1] - ago[0]) * (rest / step_s)
    here, following = level[:, :-1], level[:, 1:]
    # The late clock passes a sample `rest` after each of the early one.
    passed = ago[0][:, :-1]
    return MotorSpeed(here, (_Line(here, passed, rest), _Line(passed, following, step_s - rest)))


def motor_speed(outputs: FloatArray, *, lag_s: complex, delay_s: complex, step_s: float) -> MotorSpeed:
    """Lagged and delayed outputs at the samples, and their integrals between them, exactly.

    Parameters
    ----------
    outputs
        Held from each sample to the next, shape ``(motors, n)``; before the first they stood as there.
    lag_s, delay_s
        Time constant, positive, and delay; complex ones for a complex step. A delay below zero, of stamps that do not
        belong together, needs outputs after the last one, which are taken to stand.
    step_s
        Time between samples.

    Examples
    --------
    >>> step = np.array([[0.0, 1.0, 1.0, 1.0]])
    >>> motor_speed(step, lag_s=0.1, delay_s=0.05, step_s=0.1).level.round(4).tolist()
    [[0.0, 0.0, 0.3935, 0.7769]]
    """
    from scipy.signal import lfilter

    whole = int(np.floor(delay_s.real / step_s))
    rest = delay_s - whole * step_s
    decay = np.exp(-step_s / lag_s)
    first = outputs[:, :1]
    # Before the record begins all motors turn as at its first sample.
    samples = outputs.shape[1]
    held = outputs[:, np.clip(np.arange(samples + 1) - (whole + 1), 0, samples - 1)]
    reached = first + lfilter(np.array([0.0, 1.0 - decay]), np.array([1.0, -decay]), held - first, axis=1)
    # A sample of the late clock lies `rest` before one of the early clock.
    before, after = held[:, :-1], held[:, 1:]
    level = before + (reached[:, :-1] - before) * np.exp(-(step_s - rest) / lag_s)
    return MotorSpeed(
        level, (_Stretch(level, before, rest, lag_s), _Stretch(reached[:, 1:], after, step_s - rest, lag_s))
    )


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

    @property
    def name(self) -> str:
        """What is fitted, for messages."""
        return "motors"

    @cached_property
    def excitations(self) -> tuple[dict[str, Excitation], ...]:
        """For every record, how far the motors explain the slow motion of each axis."""
        names = self.parameters.names
        spin_up = SPIN_UP in names and (SPIN_UP in self.parameters.free or self.parameters[SPIN_UP].value != 0.0)
        return excitations(self.records, self.levers, spin_up=spin_up)

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
        found = []
        for _, name, error, slopes in self.whitened(theta):
            unknown = np.full((error.size, 1, 0 if name in FORCES else 1), error.size**-0.5)
            found.append(Part(error[:, None], slopes.T[:, None], unknown))
        return found

    def determined(self, solution: Solution) -> BoolArray:
        """Which free parameters have an uncertainty, shape ``(p,)``: those that did not end on a bound.

        A lag far shorter than the samples is not told from a delay, and has none.
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

    def equations(self, theta: FloatArray) -> list[list[Axis]]:
        """For every record its equations at some parameters."""
        values = self.parameters.unpack(theta).values
        return [self.predictions(record, values, self.axes, moved=True) for record in self.records]

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
            delayed = {name: _derived(record, values, name, step, moved=moved) for name in set(names.values())}
            found += [self._rate_axis(record, values, delayed[names[axis]], axis, step) for axis in rates]
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
        driven = gain * moment
        slopes = {name: gain * term for name, term in torque(late.sums(values, step)).items()}
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


class _Late(NamedTuple):
    """Motors over a record, and the same a tiny imaginary step of a parameter further."""

    here: MotorSpeed
    moved: Mapping[str, MotorSpeed]

    def integrals(self, values: Mapping[str, float], step: float) -> dict[str, Row]:
        return _impulses(self.here, values, step)

    def sums(self, values: Mapping[str, float], step: float) -> dict[str, Row]:
        """Derivatives of the impulse of every rotor by coefficients, lag and delay, shape ``(motors, n - 1)``."""
        slopes = self.integrals(values, step)
        for name, moved in self.moved.items():
            slopes[name] = _combined(values, _impulses(moved, values, step)).imag / _STEP
        return slopes

    def gained(self, record: MotorRecord) -> dict[str, Row]:
        """What each rotor gains of its speed over a sample, and derivatives by lag and delay, ``(motors, n - 1)``."""
        gains: dict[str, Row] = {SPIN_UP: _gained(self.here, record)}
        return gains | {name: _gained(moved, record).imag / _STEP for name, moved in self.moved.items()}

    def levels(self, values: Mapping[str, float]) -> dict[str, Row]:
        return _thrusts(self.here, values)

    def level_slopes(self, values: Mapping[str, float]) -> dict[str, Row]:
        slopes = self.levels(values)
        for name, moved in self.moved.items():
            slopes[name] = _combined(values, _thrusts(moved, values)).imag / _STEP
        return slopes


def _impulses(motors: MotorSpeed, values: Mapping[str, float], step: float) -> dict[str, Row]:
    """What each coefficient of the curve is multiplied by in the impulse of a rotor over a sample."""
    terms: dict[str, Row] = {}
    if "c_0" in values:
        terms["c_0"] = np.full((motors.level.shape[0], motors.level.shape[1] - 1), step)
    if "c_1" in values:
        terms["c_1"] = motors.first
    if "c_2" in values:
        terms["c_2"] = motors.second
    return terms


def _gained(motors: MotorSpeed, record: MotorRecord) -> Row:
    """What each rotor gains of its speed over a sample; thrust goes with the square of the voltage, speed with it."""
    gained: Row = np.diff(motors.level * np.sqrt(record.strength), axis=1)
    return gained


def _thrusts(motors: MotorSpeed, values: Mapping[str, float]) -> dict[str, Row]:
    """The same in its thrust at a sample."""
    powers = {"c_0": 0, "c_1": 1, "c_2": 2}
    return {name: motors.level**power for name, power in powers.items() if name in values}


def _combined(values: Mapping[str, float], terms: Mapping[str, Row]) -> Row:
    """Thrust, from what each coefficient is multiplied by."""
    thrusts = [values[name] * term for name, term in terms.items()]
    total: Row = sum(thrusts[1:], thrusts[0])
    return total


def _derived(record: MotorRecord, values: Mapping[str, float], delay: str, step: float, *, moved: bool) -> _Late:
    """Motors with derivatives by lag and delay, where these are parameters at all and the derivatives are wanted."""
    lag = values.get("T_motor", _NO_LAG_S)
    late = {"T_motor": lag, delay: values.get(delay, 0.0)}

    def at(name: str | None) -> MotorSpeed:
        shifted = {one: complex(value, _STEP) if one == name else value for one, value in late.items()}
        if record.between == "lines" and "T_motor" not in values:
            return measured_speed(record.outputs, delay_s=shifted[delay], step_s=step)
        return motor_speed(record.outputs, lag_s=shifted["T_motor"], delay_s=shifted[delay], step_s=step)

    return _Late(at(None), {name: at(name) for name in late if name in values and moved})


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


def _whitened_axis(axis: Axis, directions: FloatArray, shape: Filter) -> tuple[FloatArray, FloatArray]:
    both = np.concatenate([(axis.measured - axis.predicted)[None], -directions.T @ axis.slopes])
    white = _centered(shape(both), axis.name)
    return white[0], white[1:]


SLOW_HZ = 5.0
"""Motion up to here is what flying does; above it noise of the sensors prevails."""

LEAST_CORRELATION = 0.8
"""Of torque and acceleration, or thrust and specific force. Where a controller alone answers to gusts and noise, motors
and motion go together less than this, and what they show is the controller."""

_LAGS_S = (0.002, 0.01, 0.02, 0.04, 0.07, 0.12)
_AXES = ("az", "p", "q", "r")


class Excitation(NamedTuple):
    """How far the motors explain the slow motion of one axis.

    Parameters
    ----------
    correlation
        Of what the motors do with the motion, at the best of several lags.
    lag_s
        That lag; an estimate of motor lag and delay together.
    opposed
        The correlation of the opposite sign, at its best lag, zero or less: far below zero the motors are not where, or
        do not turn as, the levers say.
    """

    correlation: float
    lag_s: float
    opposed: float = 0.0


def excitations(
    records: Sequence[MotorRecord], levers: FloatArray, *, spin_up: bool = False
) -> tuple[dict[str, Excitation], ...]:
    """For every record, axis to its excitation.

    Parameters
    ----------
    records
        What was flown.
    levers
        As for :class:`rotorid.fitting.motors.fit.MotorProblem`.
    spin_up
        Whether rotors turn the vehicle by what they gain of their speed too. A controller does not look like that: it
        slows down what turns.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> outputs = 0.5 + 0.05 * rng.standard_normal((4, 4000)).cumsum(axis=1) / 30.0
    >>> levers = np.array([[-0.2, 0.2, 0.2, -0.2], [0.2, -0.2, 0.2, -0.2], [1.0, 1.0, -1.0, -1.0]])
    >>> roll = np.cumsum(levers[0] @ outputs) / 100.0
    >>> record = MotorRecord(name="roll", sample_rate_hz=100.0, outputs=outputs,
    ...                      rates=np.stack([roll, 0.0 * roll, 0.0 * roll]), az=-9.81 + 0.0 * roll)
    >>> {axis: round(one.correlation, 1) for axis, one in excitations([record], levers)[0].items()}
    {'az': 0.0, 'p': 1.0, 'q': 0.0, 'r': 0.0}
    """
    return tuple(_of(record, levers, spin_up=spin_up) for record in records)


def _of(record: MotorRecord, levers: FloatArray, *, spin_up: bool) -> dict[str, Excitation]:
    mixing = np.vstack([-np.ones(levers.shape[1]), levers])
    moved = [_slow_part(row, record.sample_rate_hz) for row in (record.az[1:], *np.diff(record.rates, axis=1))]
    best = {axis: Excitation(0.0, _LAGS_S[0]) for axis in _AXES}
    for lag_s in _LAGS_S:
        motors = motor_speed(record.outputs, lag_s=lag_s, delay_s=0.0, step_s=1.0 / record.sample_rate_hz).level[:, 1:]
        for axis, mix, motion in zip(_AXES, mixing, moved, strict=True):
            made = mix @ np.asarray(motors, dtype=np.float64)
            rows = [made, np.diff(made, prepend=made[:1])] if spin_up and axis == "r" else [made]
            slow = np.stack([_slow_part(row, record.sample_rate_hz) for row in rows])
            correlation = _correlation(_positive_part(slow, motion), motion)
            opposed = min(best[axis].opposed, correlation)
            if correlation > best[axis].correlation:
                best[axis] = Excitation(correlation, lag_s, opposed)
            else:
                best[axis] = best[axis]._replace(opposed=opposed)
    return best


def slow_taps(sample_rate_hz: float) -> FloatArray:
    """Taps of a causal low-pass of :data:`SLOW_HZ`, as long as it rings."""
    from scipy.signal import butter, lfilter

    if sample_rate_hz <= 2.5 * SLOW_HZ:
        return np.ones(1)
    b, a = butter(2, SLOW_HZ, fs=sample_rate_hz)
    impulse = np.zeros(max(8, round(sample_rate_hz / SLOW_HZ)))
    impulse[0] = 1.0
    return np.asarray(lfilter(b, a, impulse), dtype=np.float64)


def _slow_part(row: FloatArray, sample_rate_hz: float) -> FloatArray:
    from scipy.signal import oaconvolve

    found: FloatArray = np.asarray(oaconvolve(row - row.mean(), slow_taps(sample_rate_hz), mode="valid"))
    centered: FloatArray = found - found.mean()
    return centered


def _positive_part(rows: FloatArray, motion: FloatArray) -> FloatArray:
    """A row, or of several what most resembles a motion with factors from zero up."""
    from scipy.optimize import nnls

    if len(rows) == 1:
        return np.asarray(rows[0])
    factors, _ = nnls(rows.T, motion)
    return np.asarray(factors @ rows if np.any(factors) else rows[0])


def _correlation(one: FloatArray, other: FloatArray) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0


_RIDGE = 1e-9


def whitening_taps(error: FloatArray, order: int) -> FloatArray:
    r"""Taps of :math:`A(z^{-1}) = 1 - a_1 z^{-1} - \dots`, with which an error becomes (nearly) white.

    The autoregression follows from the sample autocorrelation by the equations of Yule and Walker, so that its inverse
    is stable.

    Parameters
    ----------
    error
        Shape ``(n,)``, with n well above the order.
    order
        Number of past samples.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> noise = rng.standard_normal(20000)
    >>> colored = noise[1:] + 0.5 * noise[:-1]
    >>> white = np.convolve(colored, whitening_taps(colored, 10), mode="valid")
    >>> bool(abs(np.mean(white[1:] * white[:-1]) / np.mean(white**2)) < 0.02)
    True
    """
    from scipy.linalg import solve_toeplitz

    size = int(2 ** np.ceil(np.log2(2 * error.size)))
    power = np.abs(np.fft.rfft(error, size)) ** 2
    correlation = np.fft.irfft(power, size)[: order + 1] / error.size
    correlation[0] *= 1.0 + _RIDGE
    coefficients = solve_toeplitz(correlation[:order], correlation[1:])
    return np.concatenate([[1.0], -coefficients])


WEIGHING = Filter(np.ones(1), 0.05)
"""The mean of an accelerometer as a scale of the weight: good to its bias, 0.05 m/s² where it was calibrated."""

_MEMORY_S = 0.12
_LEAST_ORDER, _MOST_ORDER = 6, 60
_SOLVER = LevenbergMarquardt(iterations=80, tolerance=1e-8)
LEAST_SAMPLES = 10 * _LEAST_ORDER
"""Fewer in a record do not tell motors from noise."""

_AT_REST = 0.05
_SHORT = 0.1
_INERTIA = {"p": "I_xx", "q": "I_yy", "r": "kappa_per_I_zz"}


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorFit(Fit):
    """End of a fit of the motor chain.

    Parameters
    ----------
    problem
        What was fitted, with the filters that whiten its errors.
    solution
        End of the last search.
    excitations
        For every record, how far the motors explain the slow motion of each axis; those that count have a filter in the
        problem.
    rounds
        How often the color of the errors was estimated.
    settled
        Whether the values came to rest.
    moved
        By how much each free parameter moved in the last round, shape ``(p,)``; nothing where there was none.
    white_force
        Whether errors of the specific force were whitened.
    """

    problem: MotorProblem
    excitations: tuple[Mapping[str, Excitation], ...]
    rounds: int
    settled: bool
    moved: FloatArray = field(default_factory=lambda: np.zeros(0))
    white_force: bool = False

    @property
    def moving(self) -> tuple[str, ...]:
        """Free parameters that have an uncertainty, see :meth:`MotorProblem.determined`."""
        kept = self.problem.determined(self.solution)
        return tuple(name for name, known in zip(self.problem.parameters.free, kept, strict=True) if known)

    def parts(self) -> list[Part]:
        """Whitened errors of each equation, with derivatives by what is :attr:`moving`."""
        kept = self.problem.determined(self.solution)
        return [part._replace(slopes=part.slopes[..., kept]) for part in self.problem.parts(self.solution.theta)]


def likely_step(fit: MotorFit, more: MotorProblem, name: str) -> tuple[float, float]:
    """Where one parameter more would go from its value, to first order, and the deviation of white errors.

    Parameters
    ----------
    fit
        Without the parameter.
    more
        The same problem with it, at the end of the fit, and with its filters.
    name
        Of the parameter.
    """
    residual, jacobian = more.residuals(more.parameters.pack())
    free = more.parameters.free
    kept = [place for place, one in enumerate(free) if one == name or one in fit.moving]
    slopes = jacobian[:, kept]
    length = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    inverse = np.linalg.pinv(slopes.T @ slopes / np.outer(length, length), hermitian=True) / np.outer(length, length)
    place = kept.index(free.index(name))
    return float(-inverse[place] @ (slopes.T @ residual)), float(np.sqrt(inverse[place, place]))


def excited_axes(found: Sequence[Mapping[str, Excitation]]) -> tuple[str, ...]:
    """Axes that some record excites, in the order ``az p q r``."""
    return tuple(
        axis for axis in ("az", "p", "q", "r") if any(record[axis].correlation >= LEAST_CORRELATION for record in found)
    )


def fit_motors(
    problem: MotorProblem,
    *,
    solver: LevenbergMarquardt = _SOLVER,
    rounds: int = 15,
    white_force: bool = False,
    start: Mapping[str, float] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MotorFit:
    r"""Fit the motor chain by a prediction error method.

    An axis of a record counts where the motors explain its slow motion (:mod:`rotorid.fitting.motors.fit`). The first
    fit is to slow motion. From then on the errors of each rate are whitened by the autoregression that they show, and
    the values fitted again, until both rest. Errors of the specific force are left as they are: no controller answers
    to them from sample to sample, and the curve of thrust is known from what is slow and large, which whitening against
    vibration would discount. Their color counts in the uncertainty. Gusts are another matter: a controller that answers
    to them moves thrust with the force that they cause, which pulls the slope of thrust down; ``white_force`` takes
    their color out as that of the rates.

    Parameters
    ----------
    problem
        Records, levers, parameters; its axes are those that some record must excite.
    solver
        Local search.
    rounds
        How often to whiten at most.
    white_force
        Whether errors of the specific force are whitened too.
    start
        Values to start from, such as those of a search; by default what thrust, lag and inertia are at first sight.
    progress
        Told after each round.

    Raises
    ------
    InsufficientDataError
        A record is too short, or no record excites one of the axes.
    """
    shortest = min(record.samples for record in problem.records)
    if shortest < LEAST_SAMPLES:
        raise InsufficientDataError(f"a record of {shortest} samples came", needed=f"{LEAST_SAMPLES} or more")
    found = problem.excitations
    if missing := set(problem.axes) - {"weight", *excited_axes(found)}:
        raise InsufficientDataError(
            f"the motors explain the motion along {', '.join(sorted(missing))} in no record",
            needed=f"a correlation of {LEAST_CORRELATION:g} up to 5 Hz",
            remedy="fly sweeps or doublets on these axes, or leave them out",
        )
    parameters = started(problem, found)
    if start is not None:
        parameters = parameters.with_values({name: start[name] for name in parameters.free if name in start})
    problem = _slow_problem(problem.with_parameters(parameters), found)
    solution = solver.minimize(problem.residuals, problem.parameters.pack(), *problem.box)
    settled, count, last = False, 0, np.zeros(0)
    for count in range(1, rounds + 1):
        problem = _with_whitening(problem, solution.theta, white_force=white_force)
        following = solver.minimize(problem.residuals, solution.theta, *problem.box)
        if count == 1:
            following = at_the_best_sample(problem, following, solver)
        moved = float(np.max(_deviations(following, solution.theta), initial=0.0))
        last = following.theta - solution.theta
        solution, settled = following, moved <= _AT_REST
        progress(f"motors, round {count}: values moved by {moved:.2g} standard deviations")
        if settled:
            break
    return MotorFit(
        problem=problem,
        solution=solution,
        excitations=found,
        rounds=count,
        settled=settled,
        moved=last,
        white_force=white_force,
    )


_CORNER, _WORTH, _MOST_SAMPLES = 0.25, 0.95, 4
_GLANCE = LevenbergMarquardt(iterations=4, tolerance=1e-3)


def at_the_best_sample(problem: MotorProblem, solution: Solution, solver: LevenbergMarquardt) -> Solution:
    """The minimum near a delay of another whole number of samples, where that explains clearly more.

    Outputs are held from sample to sample. At such a delay their steps meet a sample of the rates, and the cost has a
    corner, which a search that follows slopes does not pass.

    Parameters
    ----------
    problem
        With the filters of the solution.
    solution
        Where the search ended.
    solver
        Goes on from a neighbor that explains a twentieth more after four steps with the delay held.
    """
    for name in ("tau_gyro", YAW_DELAY):
        if name in problem.parameters.free:
            solution = _at_the_best_sample_of(name, problem, solution, solver)
    return solution


def _at_the_best_sample_of(
    name: str, problem: MotorProblem, solution: Solution, solver: LevenbergMarquardt
) -> Solution:
    place, step_s = problem.parameters.free.index(name), 1.0 / problem.records[0].sample_rate_hz
    lower, upper = problem.box
    for _ in range(_MOST_SAMPLES):
        here = solution.theta[place] / step_s
        for samples in (np.ceil(here - _CORNER) - 1.0, np.floor(here + _CORNER) + 1.0):
            start = solution.theta.copy()
            start[place] = samples * step_s
            if not lower[place] <= start[place] <= upper[place]:
                continue
            held = problem.with_parameters(problem.parameters.fix(name, float(start[place])))
            glance = _GLANCE.minimize(held.residuals, np.delete(start, place), *held.box)
            if glance.cost < _WORTH * solution.cost:
                start[np.arange(start.size) != place] = glance.theta
                solution = solver.minimize(problem.residuals, start, *problem.box)
                break
        else:
            break
    return solution


_SEARCHED_HZ = 50.0
_FAR = 5.0
_REACH: Mapping[str, tuple[float, float]] = {
    "T_motor": (0.003, 0.3),
    "tau_gyro": (0.0, 0.06),
    YAW_DELAY: (0.0, 0.06),
    "tau_accel": (0.0, 0.06),
    "L_p": (-6.0, 1.0),
    "M_q": (-6.0, 1.0),
    "N_r": (-6.0, 1.0),
    "Z_w": (-3.0, 0.5),
}


def searched_motors(problem: MotorProblem) -> MotorProblem:
    """The problem of slow motion on a coarser clock, with a box around it, for a search to find a start in.

    Outputs are averaged over the coarser samples, of which there are some 50 in a second; filters in front of the
    sensors are left to the delays.

    Parameters
    ----------
    problem
        As for :func:`fit_motors`.
    """
    coarse = replace(problem, records=tuple(coarser(record) for record in problem.records), filters=(), region=None)
    found = coarse.excitations
    slow = _slow_problem(coarse.with_parameters(started(coarse, found)), found)
    return slow.within(reach(slow))


def coarser(record: MotorRecord) -> MotorRecord:
    """A record of some 50 samples in a second: outputs averaged over them, filters in front of the sensors left out."""
    every = max(1, int(record.sample_rate_hz / _SEARCHED_HZ))
    count = record.samples // every

    def mean(rows: FloatArray) -> FloatArray:
        return np.asarray(rows[..., : count * every].reshape(*rows.shape[:-1], count, every).mean(axis=-1))

    return replace(
        record,
        sample_rate_hz=record.sample_rate_hz / every,
        outputs=mean(record.outputs),
        rates=record.rates[:, : count * every : every],
        az=record.az[: count * every : every],
        w=record.w[: count * every : every],
        strength=mean(record.strength),
        gyro_taps=np.ones(1),
        accel_taps=np.ones(1),
    )


def reach(problem: MotorProblem, *, factor: float = _FAR) -> StartBox:
    """Where a vehicle may lie: thrust that carries it, inertia within a factor, lags, damping.

    Parameters
    ----------
    problem
        With first values.
    factor
        How far from these inertia and the only coefficient of thrust may lie.
    """
    parameters = problem.parameters
    weight = parameters["m"].value * STANDARD_GRAVITY_M_S2
    sides: list[tuple[float, float]] = []
    several = sum(name in parameters.free for name in ("c_0", "c_1", "c_2"))
    for name in parameters.free:
        value = parameters[name].value
        low, high = min(value / factor, value * factor), max(value / factor, value * factor)
        if name in ("c_0", "c_1", "c_2") and not (factor < _FAR and several == 1):
            size = weight / max(_summed(problem, int(name[-1])), 1e-9)
            low, high = -size, 2.0 * size
        low, high = _REACH.get(name, (low, high))
        sides.append((max(low, parameters[name].lower), min(high, parameters[name].upper)))
    scales: list[Scale] = ["logarithmic" if low * high > 0.0 else "linear" for low, high in sides]
    lower, upper = np.array(sides).T
    return StartBox(lower=lower, upper=upper, scales=tuple(scales))


def _deviations(solution: Solution, before: FloatArray) -> FloatArray:
    """How far the values moved, in standard deviations; those on a bound do not move."""
    slopes = np.where(np.array(solution.at_bound), 0.0, solution.jacobian)
    variances = np.diag(np.linalg.pinv(slopes.T @ slopes, hermitian=True))
    moved = np.abs(solution.theta - before)
    return np.where(variances > 0.0, moved / np.sqrt(np.where(variances > 0.0, variances, 1.0)), 0.0)


def _counted(record: Mapping[str, Excitation], axes: Sequence[str]) -> list[str]:
    """Equations of a record that count; the weight where nothing better is known of the thrust."""
    excited = [axis for axis in axes if axis in record and record[axis].correlation >= LEAST_CORRELATION]
    return excited if "az" in excited or "weight" not in axes else ["weight", *excited]


def _slow_problem(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> MotorProblem:
    """The problem of slow motion: each axis that counts in units of the errors of a first guess."""
    filters = []
    for record, errors, seen in zip(problem.records, problem.errors(problem.parameters.pack()), found, strict=True):
        taps = slow_taps(record.sample_rate_hz)
        counted = _counted(seen, problem.axes)
        filters.append({axis: WEIGHING if axis == "weight" else _fitting(taps, errors[axis]) for axis in counted})
    return problem.with_filters(filters)


def _fitting(taps: FloatArray, error: FloatArray) -> Filter:
    size = float(np.sqrt(np.mean(Filter(taps, 1.0)(error) ** 2)))
    return Filter(taps, size or 1.0)


def _with_whitening(problem: MotorProblem, theta: FloatArray, *, white_force: bool) -> MotorProblem:
    filters = []
    for record, errors, counted in zip(problem.records, problem.errors(theta), problem.filters, strict=True):
        order = int(np.clip(round(_MEMORY_S * record.sample_rate_hz), _LEAST_ORDER, _MOST_ORDER))
        order = min(order, record.samples // 10)
        order_of = {axis: 0 if axis == "az" and not white_force else order for axis in counted}
        filters.append({axis: _whitening(axis, errors[axis], order_of[axis]) for axis in counted})
    return problem.with_filters(filters)


def _whitening(axis: str, error: FloatArray, order: int) -> Filter:
    if axis == "weight":
        return WEIGHING
    return _fitting(whitening_taps(error, order) if order else np.ones(1), error)


def started(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> ParameterSet:
    """Thrust that carries the weight, lag of the best correlation, inertia from torque and slow acceleration."""
    parameters = problem.parameters
    free = set(parameters.free)
    lags = [one.lag_s for record in found for one in record.values() if one.correlation >= LEAST_CORRELATION]
    if "T_motor" in free and lags:
        parameters = parameters.with_values({"T_motor": float(np.median(lags))})
    parameters = parameters.with_values(_carrying(problem, parameters))
    units = {name: 1.0 for axis, name in _INERTIA.items() if axis in problem.axes and name in free}
    return parameters.with_values(_inertia(problem.with_parameters(parameters.with_values(units)), found, units))


def _carrying(problem: MotorProblem, parameters: ParameterSet) -> dict[str, float]:
    """The leading coefficient of thrust, or the mass, with which the rotors carry the weight on average."""
    curve: list[str] = [name for name in ("c_0", "c_1", "c_2") if name in parameters.names]
    sums = {name: _summed(problem, int(name[-1])) for name in curve}
    carried = sum(parameters[name].value * sums[name] for name in curve if name not in parameters.free)
    if not (open_ := [name for name in curve if name in parameters.free]):
        return {"m": carried / STANDARD_GRAVITY_M_S2} if "m" in parameters.free else {}
    weight = parameters["m"].value * STANDARD_GRAVITY_M_S2
    return dict.fromkeys(open_, 0.0) | {open_[-1]: (weight - carried) / sums[open_[-1]]}


def _summed(problem: MotorProblem, power: int) -> float:
    """Sum over the rotors of a power of their outputs, on average over the records."""
    means = [float(np.mean((record.outputs**power).sum(axis=0) * record.strength)) for record in problem.records]
    return float(np.mean(means))


def _inertia(
    probe: MotorProblem, found: Sequence[Mapping[str, Excitation]], units: Mapping[str, float]
) -> dict[str, float]:
    """Inertia from the regression of slow acceleration on the torque of a unit inertia."""
    products = {axis: np.zeros(2) for axis in probe.axes}
    yaw: list[tuple[FloatArray, FloatArray]] = []
    for record, equations, seen in zip(probe.records, probe.equations(probe.parameters.pack()), found, strict=True):
        shape = Filter(slow_taps(record.sample_rate_hz), 1.0)
        for axis in equations:
            if axis.name in _counted(seen, probe.axes):
                motion, torque = (shape(row - row.mean()) for row in (axis.measured, axis.predicted))
                products[axis.name] += [float(motion @ torque), float(torque @ torque)]
                if axis.name == "r" and SPIN_UP in probe.parameters.free:
                    gained = shape(axis.slopes[probe.parameters.names.index(SPIN_UP)])
                    yaw.append((np.stack([torque, gained - gained.mean()]), motion))
    gains = {axis: top / bottom for axis, (top, bottom) in products.items() if top > 0.0}
    values = {
        name: gains.get(axis, 1.0) if axis == "r" else 1.0 / gains.get(axis, 1.0) for axis, name in _INERTIA.items()
    }
    if yaw:
        values |= _of_yaw(np.concatenate([rows for rows, _ in yaw], axis=1), np.concatenate([row for _, row in yaw]))
    return {name: value for name, value in values.items() if name in (*units, SPIN_UP)}


def _of_yaw(rows: FloatArray, motion: FloatArray) -> dict[str, float]:
    """Torque and spin-up, from zero up; where slow motion shows but one of them, the other gets a little."""
    from scipy.optimize import nnls

    factors, _ = nnls(rows.T, motion)
    most = float(np.max(factors * np.linalg.norm(rows, axis=1)))
    least = 0.01 * most / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    torque, gained = np.maximum(factors, least).tolist()
    return {"kappa_per_I_zz": torque, SPIN_UP: gained} if most > 0.0 else {}
