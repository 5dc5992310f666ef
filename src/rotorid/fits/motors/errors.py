r"""Systematic errors of motor physics, which no repetition of the flight would show.

Random errors of a long flight are small, and the structure is what a fit is wrong by: rotors that speed up faster than
they slow down, a drag that the rates do not know, a curve of thrust that is no parabola. Where that is so, one part of
a flight asks for other values than another: a sweep is slow at first and fast at last. With the slopes :math:`J_b` and
errors :math:`e_b` of the pieces b of all flights,

.. math:: \mathrm{Cov} = H^{-1} \Big( \tfrac{B}{B - 1} \sum_b g_b g_b^T \Big) H^{-1}, \qquad
          g_b = J_b^T e_b, \quad H = \sum_b J_b^T J_b

holds random errors of any color and what the pieces disagree about; where it is more than the random errors explain,
the rest is model error. Steps that the values would take say more: were only motion up to 5 Hz fitted, and were there
what the model leaves out: moments by the speed through the air, which follows the tilt; a part of thrust and torque
that comes late, as the air does that rotors set in motion; a second lag. All of it keeps the fit as it is, and holds
with motors that answer to disturbances: it knows the past of the motors alone, of which whitened errors do not depend.

What leaves no trace in residuals comes on top: the bias of an accelerometer, the scale of the sensors, clocks that are
known to 0.15 of a sample at both ends, a curve that was not flown, motors that were logged too slowly, gusts that the
controller answers to, and air that moves while its speed is taken to be that over ground.

The sum over pieces is that of clustered errors (Liang and Zeger, *Longitudinal Data Analysis Using Generalized Linear
Models*, Biometrika 73(1), 1986).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import cached_by_value
from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, SLOW_BAND_HZ, Excitation, slow_taps
from rotorid.fitting.motors.fit import MotorFit
from rotorid.fitting.motors.problem import INERTIA, Axis, Filter, MotorProblem
from rotorid.fitting.motors.translation import DRAG, translation
from rotorid.fitting.problem import Part
from rotorid.flights.motor_data import MotorData
from rotorid.models.motors import DELAYS, SPIN_UP
from rotorid.models.parameter import ParameterSet
from rotorid.signal.stamps import CLOCK_SAMPLES
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.sandwich import by_bands, by_pulls
from rotorid.units import STANDARD_GRAVITY_M_S2

ACCELEROMETER_BIAS_M_S2 = 0.05
"""Of a calibrated accelerometer."""

CURVE_SHARE = 0.3
"""Thrust that was not moved: its slope lies between that of a line and twice as much, that of a parabola."""

SENSOR_SHARE = 0.005
"""Scale of gyros, which no flight with the same sensors shows."""

THRUST_SHARE = 0.01
"""Error of the slope of thrust, which depends on the speed and size of rotor motion and on the air: where rotors feel
their inflow, or speed up faster than they slow down, the slope is one to two percent low.
"""

_GAINS = {"az": ("m", "c_0", "c_1", "c_2"), "p": ("I_xx",), "q": ("I_yy",), "r": ("kappa_per_I_zz",)}

PIECES = 10
"""Of all flights together: long enough to hold motion of their own, and enough to scatter."""

_DRAG_1_S = 0.3
"""Of a small multirotor, drag over mass: what it was asked for longer ago has no speed any more."""

LEFT_OUT_SHARE = 0.02
"""Share of the motors' effect on a rate that a one-lag rotor model may leave out. It is nearly collinear with lag and
damping, so more of it always lowers the error a little.
"""

_INFLOW_1_S, _SECOND_1_S = 10.0, 30.0
"""Where thrust may come late, and where a second lag would show: within what flying excites."""

_WIND_1_S = 2.0
"""Wind changes more slowly than this; noise of a velocity that was differentiated is faster."""

_LEAST_SHOWN = 1e-4
"""Share of a motion not followed by any parameter, below which it is invisible."""

_LEAST_PIECE_LENGTH = 100
"""Samples that a piece has at least."""


def motor_model_error(fit: MotorFit, random: FloatArray) -> FloatArray:
    """Covariance of what the structure leaves out, as pieces of the flights and slow motion disagree with the whole.

    Parameters
    ----------
    random
        Covariance of random errors of ``fit.moving``, shape ``(p, p)``.
    """
    count = len(fit.moving)
    normal, slow_normal, slow_score = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count)
    scores: dict[tuple[int, int], FloatArray] = {}
    blocks = list(_blocks(fit))
    longest = max(_LEAST_PIECE_LENGTH, sum({block.place: block.error.size for block in blocks}.values()) / PIECES)
    for block in blocks:
        normal += block.slopes @ block.slopes.T
        slow = block.slow
        slow_normal += slow[:-1] @ slow[:-1].T
        slow_score += slow[:-1] @ slow[-1]
        if block.axis == "weight":
            continue
        pieces = np.array_split(np.arange(block.error.size), max(1, round(block.error.size / longest)))
        for number, rows in enumerate(pieces):
            score = block.slopes[:, rows] @ block.error[rows]
            scores[block.place, number] = scores.get((block.place, number), np.zeros(count)) + score
    inverse = _inverse(normal)
    found = np.zeros((count, count))
    parts = fit.parts()
    if scores:
        found = _beyond(by_pulls(parts, np.stack(list(scores.values()))), random)
    found += _between_bands(parts, random + found)
    steps = [_slow_step(slow_normal, slow_score, inverse), *_left_out(blocks, inverse)]
    return found + sum((np.outer(step, step) for step in steps), start=np.zeros_like(found))


def _between_bands(parts: Sequence[Part], known: FloatArray) -> FloatArray:
    """What bands of half an octave disagree about beyond a covariance: pieces and bands see one misfit."""
    variance = by_bands(parts).diagonal()
    return np.diag(np.maximum(variance - known.diagonal(), 0.0))


def _slow_step(normal: FloatArray, score: FloatArray, inverse: FloatArray) -> FloatArray:
    """The step to the values of slow motion, minus the step expected by chance (Hausman's difference)."""
    of_slow = _inverse(normal)
    step: FloatArray = of_slow @ score
    length = np.sqrt(np.maximum(of_slow.diagonal(), 1e-300))
    apart = np.linalg.pinv((of_slow - inverse) / np.outer(length, length), rcond=1e-6, hermitian=True)
    chance = float((step / length) @ apart @ (step / length))
    return step * np.sqrt(max(0.0, 1.0 - step.size / chance)) if chance > 0.0 else step


def _left_out(blocks: Sequence[_Block], inverse: FloatArray) -> Iterator[FloatArray]:
    """How far the parameters would move with something more in the model of a rate, one thing after the other.

    Errors of the specific force are not white, and say too little of what is missing.
    """
    projected = sum((block.slopes @ block.error for block in blocks), start=np.zeros(len(inverse)))
    for axis in RATES:
        own = [block for block in blocks if block.axis == axis]
        made = sum(block.made for block in own)
        for rows in zip(*(block.more for block in own), strict=True):
            own_part = sum(
                (block.slopes @ row for block, row in zip(own, rows, strict=True)), start=np.zeros(len(inverse))
            )
            # What of it no parameter follows, and the errors say of that.
            size = sum(float(row @ row) for row in rows)
            left = size - float(own_part @ inverse @ own_part)
            score = sum(float(row @ block.error) for block, row in zip(own, rows, strict=True))
            if left > _LEAST_SHOWN * size:
                factor = (score - float(own_part @ inverse @ projected)) / left
                # Of white errors alone it would have a variance of one over what is left.
                likely = min(max(0.0, factor**2 - 1.0 / left), LEFT_OUT_SHARE**2 * made / size)
                yield inverse @ own_part * np.sqrt(likely)


def _beyond(found: FloatArray, random: FloatArray) -> FloatArray:
    """Of a covariance, what is more than another in any direction."""
    length = np.sqrt(np.maximum(random.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(random / np.outer(length, length))
    root = vectors * np.sqrt(np.maximum(values, 1e-9))
    back = np.linalg.pinv(root)
    more, ways = np.linalg.eigh(back @ (found / np.outer(length, length)) @ back.T - np.eye(len(length)))
    columns = length[:, None] * (root @ ways) * np.sqrt(np.maximum(more, 0.0))
    beyond: FloatArray = columns @ columns.T
    return beyond


def _inverse(normal: FloatArray) -> FloatArray:
    length = np.sqrt(np.maximum(normal.diagonal(), 1e-300))
    inverse: FloatArray = np.linalg.pinv(normal / np.outer(length, length), hermitian=True) / np.outer(length, length)
    return inverse


class _Block(NamedTuple):
    """One equation of one record, whitened.

    Parameters
    ----------
    place, axis, rate_hz
        Record and axis.
    slopes, error
        Of what is measured by what is moving, shape ``(p, n)``, and the errors ``(n,)``.
    made
        Sum of squares of what the motors contribute.
    more
        What might be in the equation beside the model, shape ``(k, n)``; of rates alone.
    gusty
        Whether slow errors are gusts, to which a controller answers.
    """

    place: int
    axis: str
    rate_hz: float
    slopes: FloatArray
    error: FloatArray
    made: float
    more: FloatArray
    gusty: bool

    @property
    def slow(self) -> FloatArray:
        """Slopes and errors of slow motion, shape ``(p + 1, m)``; the mean of a force is slow as it is."""
        rows = np.vstack([self.slopes, self.error[None]])
        return rows if self.axis == "weight" or self.gusty else slow_rows(rows, self.rate_hz)


def _blocks(fit: MotorFit) -> Iterator[_Block]:
    problem, theta = fit.problem, fit.solution.theta
    kept, values = problem.determined(fit.solution), problem.parameters.unpack(theta).values
    axes = [{axis.name: axis for axis in equations} for equations in problem.equations(theta, RATES)]
    for place, name, error, slopes in problem.whitened_at(fit.solution):
        record = problem.records[place]
        made, more = 0.0, np.zeros((0, error.size))
        if name in RATES:
            rows = problem.filters[place][name](np.stack(list(_more(axes[place][name], problem, values, record))))
            rows = rows - rows.mean(axis=1, keepdims=True)
            made, more = float(rows[0] @ rows[0]), rows[1:]
        # The problem has the errors of the motion; slopes are those of the motion too.
        # Of an axis that was fitted in octaves, slow motion is the air's.
        banded = name in RATES and fit.excitations[place][name].band_hz != SLOW_BAND_HZ
        gusty = banded or (name == "az" and fit.white_force)
        yield _Block(place, name, record.sample_rate_hz, -slopes[kept], error, made, more, gusty)


def _more(axis: Axis, problem: MotorProblem, values: Mapping[str, float], record: MotorRecord) -> Iterator[FloatArray]:
    """Contribution of the motors, and possible additions to it, each up to a factor, shape ``(n,)``."""
    made = _made_by_motors(axis, problem, values, record.w)
    made = made - made.mean()
    yield made
    yield _low_passed(made, _INFLOW_1_S, record.sample_rate_hz)
    late = _low_passed(made, _SECOND_1_S, record.sample_rate_hz)
    yield late - _low_passed(late, _SECOND_1_S, record.sample_rate_hz)
    if axis.name in ("p", "q"):
        rate = record.rates[RATES.index(axis.name), :-1]
        tilt = _low_passed(rate - rate.mean(), _DRAG_1_S, record.sample_rate_hz)
        yield _low_passed(tilt, _DRAG_1_S, record.sample_rate_hz)


def _low_passed(row: FloatArray, corner_1_s: float, rate_hz: float) -> FloatArray:
    """A row through a first-order low-pass, which knows the past alone."""
    from scipy.signal import lfilter

    kept = math.exp(-corner_1_s / rate_hz)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], row), dtype=np.float64)


def _made_by_motors(axis: Axis, problem: MotorProblem, values: Mapping[str, float], w: FloatArray) -> FloatArray:
    """Of the prediction of an axis, what the motors contribute."""
    if axis.name in INERTIA:
        name = INERTIA[axis.name]
        sign = 1.0 if axis.name == "r" else -1.0
        names = problem.parameters.names
        made = sign * values[name] * axis.slopes[names.index(name)]
        gained = values[SPIN_UP] * axis.slopes[names.index(SPIN_UP)] if axis.name == "r" and SPIN_UP in names else 0.0
        return np.asarray(made + gained)
    damped = values["Z_w"] * w[1:] if axis.name == "az" and "Z_w" in values and w.size else 0.0
    return np.asarray(axis.predicted - damped)


def with_model_errors(
    bounds: Bounds,
    parameters: ParameterSet,
    fit: MotorFit,
    data: MotorData,
    *,
    curve_assumed: bool,
    model: FloatArray,
) -> Bounds:
    r"""Bounds that also hold what is wrong in the same way all through a flight.

    - What the structure leaves out, see :func:`motor_model_error`.
    - The accelerometer is off by up to :data:`ACCELEROMETER_BIAS_M_S2`, which thrust and inertia follow, gyros scale by
      up to :data:`SENSOR_SHARE`, and the slope of thrust is not the same in all air (:data:`THRUST_SHARE`).
    - Where within a sample a value belongs is known to 0.15 of it, of motors and of sensors: delays, and motor lag.
    - Where thrust was not moved, its slope is a guess (:data:`CURVE_SHARE`), and inertia follows it.
    - Motors that were logged too slowly did between their samples what the log does not show. Errors of the outputs
      pull gains toward zero by up to :math:`r^2`, errors of the motion push them away by as much: half the way from one
      regression to the other, :math:`(1/r^2 - 1)/2`, counts as one standard deviation; of lag and delays, half a step.
      So it does for a rate that was fitted in octaves: moments of the air, which the controller answers to, are a large
      part of its motion there, and no model of their color is sure enough to take them out.
    - A controller that answers to gusts moves thrust with the specific force that they cause, and errors of the force
      are not whitened: half the way between both regressions, likewise.
    - Damping is by the velocity through the air, and known is that over ground.
    - Drag is what tilt and acceleration leave: an attitude whose clock is off by 0.15 of a sample moves it.
    """
    covariance = bounds.covariance.copy()
    covariance += model
    shifted = _by_bias(fit)
    covariance += np.outer(shifted, shifted)
    for late in _by_late_attitude(fit):
        covariance += np.outer(late, late)
    values = parameters.values
    directions = [*_by_sensors(values), *_by_clocks(values, data)]
    if curve_assumed:
        directions.append(_of_slope(values, CURVE_SHARE))
    if data.slow:
        directions += list(_by_slow_motors(parameters, fit, data))
    else:
        directions += list(_by_regressions(values, fit, _in_octaves))
    directions += [*_by_gusts(values, fit), *_by_wind(values, fit)]
    for direction in directions:
        row = np.array([direction.get(name, 0.0) for name in bounds.names])
        covariance += np.outer(row, row)
    return replace(bounds, covariance=covariance)


def _of_slope(values: Mapping[str, float], share: float) -> dict[str, float]:
    """Effect of an error of the thrust slope on the other parameters."""
    signs = {"c_0": 1.0, "c_1": 1.0, "c_2": 1.0, "I_xx": 1.0, "I_yy": 1.0, "kappa_per_I_zz": -1.0}
    return {name: share * sign * values[name] for name, sign in signs.items() if name in values}


def _by_sensors(values: Mapping[str, float]) -> Iterator[Mapping[str, float]]:
    """Scales of the gyros, and the slope of thrust, which inertia follows; the scale of the accelerometer is in it."""
    for name in INERTIA.values():
        if name in values:
            of_yaw = {SPIN_UP: SENSOR_SHARE * values.get(SPIN_UP, 0.0)} if name == INERTIA["r"] else {}
            yield {name: SENSOR_SHARE * values[name], **of_yaw}
    yield _of_slope(values, THRUST_SHARE)


def _by_clocks(values: Mapping[str, float], data: MotorData) -> Iterator[Mapping[str, float]]:
    """A shift of either end of a delay; lag and delay are separated by less than a sample."""
    late_s = CLOCK_SAMPLES / min(record.sample_rate_hz for record in data.records)
    yield dict.fromkeys(DELAYS, late_s)
    yield from ({name: late_s} for name in ("T_motor", *DELAYS))
    # No sensor leads: what a delay lacks to zero is an error of stamps or filters, which lag and delay share.
    for name in DELAYS:
        if values.get(name, 0.0) < 0.0:
            yield {name: values[name], "T_motor": -values[name]}


def _by_bias(fit: MotorFit) -> FloatArray:
    """How far a bias of the accelerometer moves the parameters, shape ``(p,)``."""

    def biased(_: int, axis: str, passed: Filter, size: int) -> FloatArray | None:
        if axis != "az":
            return None
        return np.full(size, ACCELEROMETER_BIAS_M_S2 * passed.taps.sum() / passed.scale)

    return _pulled(fit, biased)


def _by_late_attitude(fit: MotorFit) -> Iterator[FloatArray]:
    """How far an attitude on another clock than the velocity moves the parameters, axis by axis, shape ``(p,)``."""
    for level in DRAG:
        if level not in fit.problem.axes:
            continue

        def late(place: int, axis: str, passed: Filter, _: int, level: str = level) -> FloatArray | None:
            if axis != level:
                return None
            record = fit.problem.records[place]
            lean = -STANDARD_GRAVITY_M_S2 * translation(record).lean[list(DRAG).index(level)]
            row = passed(CLOCK_SAMPLES * np.diff(lean))
            return np.asarray(row - row.mean())

        yield _pulled(fit, late)


def _pulled(fit: MotorFit, by: Callable[[int, str, Filter, int], FloatArray | None]) -> FloatArray:
    """How far errors of the equations move the parameters, shape ``(p,)``.

    Parameters
    ----------
    by
        Whitened error of an equation by place, axis, filter and samples; ``None`` where there is none.
    """
    kept = np.array([name in fit.moving for name in fit.parameters.free])
    normal = np.zeros((kept.size, kept.size))
    pulled = np.zeros(kept.size)
    for place, axis, error, slopes in fit.problem.whitened_at(fit.solution):
        normal += slopes @ slopes.T
        if (row := by(place, axis, fit.problem.filters[place][axis], error.size)) is not None:
            pulled += slopes @ row
    moved: FloatArray = np.linalg.pinv(normal[np.ix_(kept, kept)], hermitian=True) @ pulled[kept]
    return moved


def _by_slow_motors(parameters: ParameterSet, fit: MotorFit, data: MotorData) -> Iterator[Mapping[str, float]]:
    step_s = 1.0 / min(history.sample_rate_hz for history in data.histories)
    yield from ({name: 0.5 * step_s} for name in ("T_motor", *DELAYS))
    yield from _by_regressions(parameters.values, fit, lambda _: True)


def _in_octaves(excitation: Excitation) -> bool:
    """Whether an axis was fitted above moments of the air that hide the motors below."""
    return excitation.band_hz != SLOW_BAND_HZ


def _by_regressions(
    values: Mapping[str, float], fit: MotorFit, counts: Callable[[Excitation], bool]
) -> Iterator[Mapping[str, float]]:
    """Half the way between the regressions of motion on motors and of motors on motion, axis by axis."""
    for axis, names in _GAINS.items():
        correlations = [
            excitations[axis].correlation
            for excitations in fit.excitations
            if excitations[axis].correlation >= LEAST_CORRELATION and counts(excitations[axis])
        ]
        if correlations:
            share = 0.5 * (1.0 / float(np.mean(correlations)) ** 2 - 1.0)
            yield {name: share * values[name] for name in names if name in values}


def _by_gusts(values: Mapping[str, float], fit: MotorFit) -> Iterator[Mapping[str, float]]:
    """Half the way between the regressions of force on thrust and of thrust on force, and that of damping."""
    force = _force_of(fit)
    if force is None:
        return
    if not force.whitened:
        yield _of_slope(values, force.between)
    if values.get("Z_w") and force.damped > 0.0:
        # The residuals are gusts; they pull the damping toward zero.
        yield {"Z_w": 0.5 * min(force.left / force.damped, 2.0) * abs(values["Z_w"])}


def _by_wind(values: Mapping[str, float], fit: MotorFit) -> Iterator[Mapping[str, float]]:
    """That of drag: what tilt and drag leave slowly is wind that changes, and pulls drag toward zero."""
    for level, name in DRAG.items():
        if level not in fit.problem.axes:
            continue
        left = damped = 0.0
        for record, filters, equations in zip(
            fit.problem.records, fit.problem.filters, fit.problem.equations(fit.solution.theta, [level]), strict=True
        ):
            for axis in equations:
                if level in filters:
                    own = values[name] * axis.slopes[fit.problem.parameters.names.index(name)]
                    both = np.stack([axis.measured - axis.predicted, own])
                    rows = np.stack([_low_passed(row, _WIND_1_S, record.sample_rate_hz) for row in both])
                    of_left, of_drag = np.sum((rows - rows.mean(axis=1, keepdims=True)) ** 2, axis=1).tolist()
                    left, damped = left + of_left, damped + of_drag
        if damped > 0.0:
            yield {name: 0.5 * min(left / damped, 2.0) * abs(values[name])}


def gusts_between(fit: MotorFit) -> float:
    r"""How far gusts under feedback may pull thrust, as a share: :math:`(1/r^2 - 1)/2` of slow specific force."""
    force = _force_of(fit)
    return 0.0 if force is None else force.between


class _Force(NamedTuple):
    """Mean squares of slow specific force: made by the motors, by damping, and left."""

    made: float
    damped: float
    left: float
    whitened: bool

    @property
    def between(self) -> float:
        """Half the way from one regression to the other, as a share of the gain."""
        return 0.5 * self.left / self.made


@cached_by_value
def _force_of(fit: MotorFit) -> _Force | None:
    """Specific force of a fit; ``None`` where the motors made none of it."""
    sums, whitened = np.zeros(3), False
    problem = fit.problem
    values = problem.parameters.unpack(fit.solution.theta).values
    for record, filters, equations in zip(
        problem.records, problem.filters, problem.equations(fit.solution.theta, ["az"]), strict=True
    ):
        for axis in equations:
            if axis.name in filters:
                by_motors = _made_by_motors(axis, problem, values, record.w)
                rows = np.stack([by_motors, axis.predicted - by_motors, axis.measured - axis.predicted])
                passed = slow_rows(rows, record.sample_rate_hz)
                sums += np.sum((passed - passed.mean(axis=1, keepdims=True)) ** 2, axis=1)
                whitened = whitened or filters["az"].taps.size > 1
    made, damped, left = sums.tolist()
    return _Force(made, damped, left, whitened) if made > 0.0 else None


def slow_rows(rows: FloatArray, rate_hz: float) -> FloatArray:
    """Rows limited to frequencies of flight, up to a few hertz."""
    passed: FloatArray = Filter(slow_taps(rate_hz), 1.0)(rows)
    return passed
