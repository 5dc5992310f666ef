"""From records of motors to physical parameters with bounds.

How well a flight tells the physics of motors: random errors, and what no repetition of the flight would show.

What an engineer remarks on the physics of motors.

Accelerations measured and modeled, as far as motors make them: up to a few hertz.

The identified vehicle as a linear model around hover, from motor outputs to rates and specific force.
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fitting.motors.accelerations import AccelerationErrors, acceleration_errors
from rotorid.fitting.motors.fit import (
    LEAST_CORRELATION,
    SLOW_HZ,
    Axis,
    Excitation,
    MotorFit,
    MotorProblem,
    excitations,
    excited_axes,
    fit_motors,
    likely_step,
    motor_speed,
    searched_motors,
)
from rotorid.fitting.motors.inertia import InertiaRegression, inertia_regressions, judge_both_ways
from rotorid.models.motors import (
    CURVE_TERMS,
    SPIN_UP,
    YAW_DELAY,
    Curve,
    check_figure_of_merit,
    check_motor_constants,
    motor_parameters,
    scale_of,
    yaw_range,
)
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.pipeline.fits.bootstrapping import Bootstrap, bootstrap
from rotorid.pipeline.fits.motor_errors import CURVE_SHARE, gusts_between, motor_model_error, with_model_errors
from rotorid.pipeline.fits.motor_loads import judge_loads, thrust_of_logs, voltage_exponent
from rotorid.pipeline.fits.remarks import judge_parameters
from rotorid.pipeline.fits.scatter import Alone, Disagreement, disagreements, widened
from rotorid.pipeline.fits.searching import Searched, searched
from rotorid.pipeline.preparation.motor_data import MotorData, MotorFlight
from rotorid.pipeline.results import SimulatedRecord
from rotorid.pipeline.settings import IdentifySettings, MotorChoices
from rotorid.pipeline.summary import Derived, LogThrust, VoltageExponent
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_apart
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import covariance_of_all
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores

_PROGRESS = logging.getLogger("rotorid.progress")


_FLAT = 1e-12


def motor_bounds(fit: MotorFit) -> tuple[Bounds, int]:
    """Bounds of the parameters that did not end on a bound, and the memory of the errors.

    Raises
    ------
    InsufficientDataError
        The data do not determine all of them.
    """
    if isinstance(fit.problem, AccelerationErrors):
        return _acceleration_bounds(fit, fit.problem)
    parts = fit.parts()
    slopes = np.concatenate([part.slopes[:, 0] for part in parts])
    fisher = slopes.T @ slopes
    length = np.sqrt(np.maximum(fisher.diagonal(), 1e-300))
    even = fisher / np.outer(length, length)
    weakest = np.linalg.eigh(even)
    if weakest.eigenvalues[0] <= _FLAT:
        mixed = [name for name, part in zip(fit.moving, weakest.eigenvectors[:, 0], strict=True) if abs(part) > 0.1]
        raise InsufficientDataError(
            f"the flights do not determine {' and '.join(mixed)} apart",
            needed="motion that tells them apart",
            remedy="choose a curve with fewer terms with --curve, or hold a parameter with --fix",
        )
    colored = colored_apart(parts)
    inverse = np.linalg.inv(even).diagonal() / length**2
    ratio = np.log(colored.corrected.diagonal() / colored.white.diagonal())
    bounds = Bounds(
        names=fit.moving,
        cramer_rao=2.0 * np.sqrt(inverse),
        insensitivity=1.0 / length,
        covariance=colored.corrected,
        random=colored.corrected,
        inflation=math.exp(0.5 * float(np.mean(ratio))),
    )
    return bounds, colored.ar_order


def _acceleration_bounds(fit: MotorFit, problem: AccelerationErrors) -> tuple[Bounds, int]:
    """The same at the end of a fit of absolute errors."""
    kept = problem.determined(fit.solution)
    covariance = problem.covariance(fit.solution.theta, kept)
    alone = 1.0 / np.sqrt(np.maximum(np.linalg.pinv(covariance, hermitian=True).diagonal(), 1e-300))
    spread = np.sqrt(covariance.diagonal())
    bounds = Bounds(
        names=fit.moving,
        cramer_rao=2.0 * spread,
        insensitivity=alone,
        covariance=covariance,
        random=covariance,
        inflation=1.0,
    )
    return bounds, 0


CHANNELS: Mapping[str, str] = {"p": "p_dot", "q": "q_dot", "r": "r_dot", "az": "az"}
"""Equation to the channel that it is about."""


class Motion(NamedTuple):
    """A stretch: what was measured and what the motors make of it.

    Parameters
    ----------
    flight
        The stretch.
    counted
        Channels whose axis was excited.
    rows
        Channel to measurement and model, slow, shape ``(n,)`` each at the samples :attr:`kept`; the mean of an angular
        acceleration is taken off.
    """

    flight: MotorFlight
    counted: tuple[str, ...]
    rows: Mapping[str, tuple[FloatArray, FloatArray]]

    @property
    def kept(self) -> slice:
        """The samples of the record that the rows are of: none near its ends, where a low-pass knows too little."""
        return slice(1 + _edge(self.flight.record.sample_rate_hz), -_edge(self.flight.record.sample_rate_hz))


def motions(
    problem: MotorProblem,
    theta: FloatArray,
    flights: Sequence[MotorFlight],
    found: Sequence[Mapping[str, Excitation]],
) -> tuple[Motion, ...]:
    """Every stretch with its axes of the problem, passed through a low-pass without phase."""
    moved = []
    for flight, record, seen in zip(flights, problem.equations(theta), found, strict=True):
        rate_hz = flight.record.sample_rate_hz
        axes = [axis for axis in record if axis.name in CHANNELS]
        moved.append(
            Motion(
                flight,
                tuple(CHANNELS[axis.name] for axis in axes if seen[axis.name].correlation >= LEAST_CORRELATION),
                {CHANNELS[axis.name]: _pair(axis, rate_hz) for axis in axes},
            )
        )
    return tuple(moved)


def _pair(axis: Axis, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    factor = 1.0 if axis.name == "az" else rate_hz
    measured, modeled = (_slow(factor * row, rate_hz) for row in (axis.measured, axis.predicted))
    if axis.name == "az":
        return measured, modeled
    return measured - measured.mean(), modeled - modeled.mean()


def _edge(rate_hz: float) -> int:
    return max(1, round(rate_hz / SLOW_HZ))


def _slow(row: FloatArray, rate_hz: float) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    inside = slice(_edge(rate_hz), -_edge(rate_hz))
    if rate_hz <= 2.5 * SLOW_HZ:
        return row[inside]
    return np.asarray(sosfiltfilt(butter(2, SLOW_HZ, fs=rate_hz, output="sos"), row)[inside], dtype=np.float64)


def unexplained_by_curve(problem: MotorProblem, theta: FloatArray, found: Sequence[Mapping[str, Excitation]]) -> float:
    """Share of the slow errors of specific force that a constant, the outputs and their squares would explain."""
    errors, columns = [], []
    for record, equations, seen in zip(problem.records, problem.equations(theta), found, strict=True):
        force = next((axis for axis in equations if axis.name == "az"), None)
        if force is None or seen["az"].correlation < LEAST_CORRELATION:
            continue
        lag = problem.parameters.unpack(theta).values.get("T_motor", seen["az"].lag_s)
        motors = motor_speed(record.outputs, lag_s=max(lag, 1e-4), delay_s=0.0, step_s=1.0 / record.sample_rate_hz)
        level = np.asarray(motors.level, dtype=np.float64)[:, 1:]
        sums = [_slow(row, record.sample_rate_hz) for row in (level.sum(axis=0), (level**2).sum(axis=0))]
        errors.append(_slow(force.measured - force.predicted, record.sample_rate_hz))
        columns.append(np.stack([np.ones(sums[0].size), *sums], axis=1))
    if not errors:
        return 0.0
    error, columns_together = np.concatenate(errors), np.concatenate(columns)
    coefficients = np.linalg.lstsq(columns_together, error, rcond=None)[0]
    size = float(error @ error)
    return 1.0 - float(np.sum((error - columns_together @ coefficients) ** 2)) / size if size > 0.0 else 0.0


def fit_percents(moved: Sequence[Motion], channels: Sequence[str]) -> dict[str, float]:
    """Channel to the share of its slow motion that is explained, of all stretches that excite it."""
    percents = {}
    for name in channels:
        pairs = [one.rows[name] for one in moved if name in one.counted]
        missed = sum(float(np.sum((a - b) ** 2)) for a, b in pairs)
        spread = sum(float(np.sum((a - a.mean()) ** 2)) for a, _ in pairs)
        if spread > 0.0:
            percents[name] = 100.0 * (1.0 - (missed / spread) ** 0.5)
    return percents


def scores(moved: Motion) -> dict[str, Scores]:
    """Scores of the excited channels of a stretch."""
    found = {}
    for name in moved.counted:
        measured, modeled = moved.rows[name]
        # Where an accelerometer has its zero is no matter of the motors.
        shift = float(np.mean(measured - modeled))
        modeled = modeled + shift
        found[name] = Scores(
            nrmse_fit_percent=nrmse_fit_percent(measured, modeled),
            tic=theil_inequality(measured - measured.mean(), modeled - measured.mean()),
            rms=rms(measured - modeled),
            bias=0.0,
            reference_shift=shift,
        )
    return found


def simulated_record(moved: Motion, channels: Sequence[str]) -> SimulatedRecord:
    """A stretch for the pictures of a report."""
    record = moved.flight.record
    outputs = record.outputs[:, moved.kept]
    maneuver: Maneuver = moved.flight.maneuver
    return SimulatedRecord(
        record=record.name,
        maneuver=maneuver,
        time_s=record.time_s[moved.kept],
        inputs=outputs - outputs.mean(axis=1, keepdims=True),
        measured=np.stack([moved.rows[name][0] for name in channels]),
        simulated=np.stack([moved.rows[name][1] for name in channels]),
    )


_GUSTY = 0.05
"""Share by which gusts under feedback may pull thrust, above which their color counts in the fit: ten times what a
calibrated accelerometer is off by. Below, what is slow and large tells the curve of thrust better as it is."""

_LEAST_EXPLAINED = 50.0
"""Percent of an axis that the motors must explain: less than that, and they leave more than they explain."""

_LEAST_OF_GUSTY = 100.0 * (1.0 - 0.5**0.5)
"""The same in power, for specific force among gusts."""

_LARGEST_STD = 1.0
"""Of an inertia or of the slope of thrust, as a share of the value: beyond, nothing is known of it."""

_LAST_MOVE = 0.5
"""Stated deviations by which values may still move in the last round of a fit that has come to its end."""

_STAMPS_S = 0.01
"""Errors of stamps, and of the rate at which a filter is taken to work, stay below."""

AXIS_WORDS = {"az": "thrust", "p": "roll", "q": "pitch", "r": "yaw"}


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedMotors(Immutable):
    """Physical parameters of a vehicle, as far as its flights tell them.

    Parameters
    ----------
    data
        What was fitted.
    fit
        How it ended.
    curve
        Thrust of a rotor by its output.
    curve_assumed
        Whether no stretch moved thrust, so that the curve is a guess.
    parameters
        The identified values; one that ended on a bound is held there.
    bounds
        Their uncertainty.
    memory
        Order of the autoregressions that describe the errors.
    both
        Each inertia by regressions both ways.
    hover_output
        Mean output of the motors.
    derived
        Thrust of a rotor and its slope at that output, at full output, and thrust over weight there.
    left_out
        Axes that were excited and of which nothing is stated, and why.
    disagreeing
        Parameters of which each log alone says something else.
    bootstrap
        Refits to noise drawn anew, where they were asked for. Their spread is that of random errors alone.
    search
        For a start, where one was asked for.
    """

    data: MotorData
    fit: MotorFit
    curve: Curve
    curve_assumed: bool
    parameters: ParameterSet
    bounds: Bounds
    memory: int
    both: tuple[InertiaRegression, ...]
    hover_output: float
    derived: Mapping[str, Derived]
    left_out: tuple[Finding, ...] = ()
    disagreeing: tuple[Disagreement, ...] = ()
    bootstrap: Bootstrap | None = None
    search: Searched | None = None

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that some stretch excites."""
        return tuple(axis for axis in self.fit.problem.axes if axis != "weight")

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of these axes."""
        return tuple(CHANNELS[axis] for axis in ("p", "q", "r", "az") if axis in self.axes)

    @property
    def listed(self) -> ParameterSet:
        """All parameters."""
        return self.parameters

    @cached_property
    def structure(self) -> LinearStructure:
        """The vehicle around hover, see :func:`hover_model`."""
        return hover_model(self)

    @cached_property
    def moved(self) -> tuple[Motion, ...]:
        """Every stretch as it was measured and as the motors explain it."""
        return motions(self.flown, self.fit.solution.theta, self.data.stretches, self.fit.excitations)

    @cached_property
    def flown(self) -> MotorProblem:
        """The problem on the records as flown, whatever clock the fit was on."""
        fitted = self.fit.problem
        return MotorProblem(
            records=self.data.records, levers=fitted.levers, parameters=fitted.parameters, axes=fitted.axes
        )

    @cached_property
    def logs(self) -> tuple[LogThrust, ...]:
        """Thrust over mass of each log, where there are several."""
        found = thrust_of_logs(self.flown, self.fit.solution.theta)
        return found if len(found) > 1 else ()

    @cached_property
    def voltage(self) -> VoltageExponent | None:
        """The power by which thrust follows the battery, where that can be told."""
        return voltage_exponent(self.flown, self.fit.solution.theta, self.data.reference_v)


def levers_of(data: MotorData) -> FloatArray:
    """Roll, pitch and yaw moment of a newton of each rotor, shape ``(3, motors)``."""
    arms, torque = data.layout.moment_arms, data.layout.torque_axes
    return np.stack([arms[0], arms[1], torque[2]])


def fit_motor_data(data: MotorData, choices: MotorChoices) -> FittedMotors:
    """Fit what was excited, and bound it.

    Axes of which the motors then explain less than they leave are left out: what was seen there was the controller, or
    motors that were logged too slowly. So are those whose inertia is not positive or no better known than nothing, and
    a motor lag that the data do not tell from zero, or from a delay. Then the rest is fitted again.

    Raises
    ------
    InsufficientDataError
        The motors explain the motion along no axis, the data do not determine all parameters, the fit does not come to
        an end, or ends where physics allows nothing to be.
    """
    levers = levers_of(data)
    found = excitations(data.records, levers)
    if "r" not in excited_axes(found) and (_may_spin_up(data, choices) or choices.known.get(SPIN_UP)):
        found = excitations(data.records, levers, spin_up=True)
    axes = excited_axes(found)
    if not axes:
        raise _nothing_excited(data, found)
    left_out: list[Finding] = []
    while True:
        fit, curve, search = _fitted(data, choices, levers, axes)
        fitted = replace(_bounded(data, choices, fit, curve), search=search)
        wrong = _useless(fitted)
        left_out += wrong.values()
        if not wrong:
            break
        axes = tuple(axis for axis in axes if axis not in wrong)
        if not axes:
            raise _nothing_explained(data, left_out)
    found_apart = disagreements(_each_alone(fitted, choices))
    fitted = replace(
        fitted,
        bounds=widened(fitted.bounds, {one.parameter: one.scatter for one in found_apart}),
        disagreeing=found_apart,
    )
    _require_end(fitted, choices)
    again = None
    if choices.bootstrap is not None:
        held = fit.problem.with_parameters(fitted.parameters)
        again = bootstrap(held, replace(fit.solution, theta=fitted.parameters.pack()), fitted.bounds, choices)
    return replace(fitted, bootstrap=again, left_out=tuple(left_out))


_COMPARED = ("I_xx", "I_yy", "kappa_per_I_zz", "L_p", "M_q", "N_r", "Z_w", "T_motor", "tau_gyro", "tau_accel")
"""Of one curve of thrust only the sum counts, which two flights at different outputs need not share."""


def _each_alone(fitted: FittedMotors, choices: MotorChoices) -> list[Alone]:
    """What each log says by itself, of those that share an axis with another one."""
    data, problem = fitted.data, fitted.fit.problem
    counted: dict[str, set[str]] = {}
    for record, filters in zip(problem.records, problem.filters, strict=True):
        counted.setdefault(record.name, set()).update(axis for axis in filters if axis != "weight")
    found = []
    for name, axes in counted.items():
        others = set().union(*(of for other, of in counted.items() if other != name))
        if not axes & others:
            continue
        part = data._replace(stretches=tuple(one for one in data.stretches if one.record.name == name))
        _PROGRESS.info(f"fitting {name} alone")
        with contextlib.suppress(InsufficientDataError):
            ordered = tuple(axis for axis in AXIS_WORDS if axis in axes)
            fit, curve, _ = _fitted(
                part, replace(choices, search=None, evaluations=None, runs=None), problem.levers, ordered
            )
            alone = _bounded(part, choices, fit, curve)
            if not _useless(alone):
                stds = dict(zip(alone.bounds.names, alone.bounds.std.tolist(), strict=True))
                stds = {key: stds[key] for key in _COMPARED if key in stds}
                found.append(Alone(record=name, values=alone.parameters.values, stds=stds))
    return found


def _bounded(data: MotorData, choices: MotorChoices, fit: MotorFit, curve: Curve) -> FittedMotors:
    """A fit with its bounds and what follows from it."""
    parameters = fit.parameters
    for name in set(parameters.free) - set(fit.moving):
        parameters = parameters.fix(name, parameters[name].value)
    random, memory = motor_bounds(fit)
    model = motor_model_error(fit, random.random)
    assumed = choices.curve == "auto" and "az" not in fit.problem.axes and not data.straightened
    assumed = assumed and data.kind != "speed"
    # The weight tells thrust at hover whatever the curve is; its slope is another matter.
    at_hover = with_model_errors(random, parameters, fit, data, curve_assumed=False, model=model)
    bounds = with_model_errors(random, parameters, fit, data, curve_assumed=assumed, model=model)
    hover = float(np.mean([record.outputs.mean() for record in data.records]))
    scaled = scale_of(choices.known, tuple(axis for axis in fit.problem.axes if axis != "weight")) is not None
    units = _units(parameters, scaled=scaled, arm_known=data.layout.arm_known)
    # Regressions both ways are of whitened errors.
    regressions = () if choices.method == "accelerations" else inertia_regressions(fit)
    both = (replace(one, unit=units.get(one.parameter, one.unit)) for one in regressions)
    return FittedMotors(
        data=data,
        fit=fit,
        curve=curve,
        parameters=ParameterSet([replace(one, unit=units[one.name]) for one in parameters]),
        bounds=bounds,
        memory=memory,
        curve_assumed=assumed,
        both=tuple(one for one in both if np.isfinite([*one.plain, *one.corrected, *one.deviations]).all()),
        hover_output=hover,
        derived=_derived(parameters, bounds, at_hover, hover, data, scaled=scaled),
    )


_PER_MASS = {"kg": "1", "N": "m/s^2", "N s/rad": "m/(s rad)", "N s^2/rad^2": "m/rad^2"}


def _units(parameters: ParameterSet, *, scaled: bool, arm_known: bool) -> dict[str, str]:
    """Units of what is identified: without a mass all is per kilogram, without an arm inertia is per meter of it."""
    units = {one.name: one.unit for one in parameters}
    if not scaled:
        units = {name: _PER_MASS.get(unit, unit) for name, unit in units.items()}
    moment = {(True, True): "kg m^2", (True, False): "kg m", (False, True): "m^2", (False, False): "m"}
    units |= {name: moment[scaled, arm_known] for name in ("I_xx", "I_yy") if name in units}
    if not scaled:
        # Torque over thrust does not depend on the mass, and inertia of yaw does.
        of_yaw = {"kappa_per_I_zz": "1/m", "I_zz": "m^2", "I_zz/kappa": "m"}
        units |= {name: unit for name, unit in of_yaw.items() if name in units or "/" in name}
    return units


def _useless(fitted: FittedMotors) -> dict[str, Finding]:
    """Axes of which nothing can be said, although motors and motion moved together, and why."""
    channels = {CHANNELS[axis]: axis for axis in fitted.axes}
    found: dict[str, Finding] = {}
    for name, percent in fit_percents(fitted.moved, list(channels)).items():
        # Gusts whose color is in the fit may hold as much power as thrust does.
        gusty = channels[name] == "az" and fitted.fit.white_force
        if not percent >= (_LEAST_OF_GUSTY if gusty else _LEAST_EXPLAINED):
            found[channels[name]] = warn(
                "poor_fit",
                name,
                f"The motors explain {percent:.0f} % of {name} up to 5 Hz, less than they leave: nothing is stated of "
                f"{AXIS_WORDS[channels[name]]}.",
                fit_percent=percent,
            )
    std = dict(zip(fitted.bounds.names, fitted.bounds.std.tolist(), strict=True))
    for axis, name in {"p": "I_xx", "q": "I_yy", "r": "kappa_per_I_zz"}.items():
        if axis in fitted.axes and axis not in found and name in std:
            value = fitted.parameters[name].value
            if not (math.isfinite(value) and std[name] <= _LARGEST_STD * abs(value)):
                found[axis] = warn(
                    "not_identifiable",
                    name,
                    f"{name} is {value:.3g} ± {std[name]:.2g} {fitted.parameters[name].unit}, no better than nothing: "
                    f"nothing is stated of {AXIS_WORDS[axis]}.",
                    value=value,
                    std=std[name],
                )
    return found


def _last_move(fitted: FittedMotors) -> float:
    """By how many stated deviations a value moved in the last round."""
    moved = dict(zip(fitted.fit.parameters.free, fitted.fit.moved.tolist(), strict=False))
    return max(
        (abs(moved.get(name, 0.0)) / std for name, std in zip(fitted.bounds.names, fitted.bounds.std, strict=True)),
        default=0.0,
    )


def _require_end(fitted: FittedMotors, choices: MotorChoices) -> None:
    """Refuse a fit that has not come to its end, or came to one that physics does not allow.

    Raises
    ------
    InsufficientDataError
        With a finding that says what is wrong.
    """
    fit, names = fitted.fit, ", ".join(dict.fromkeys(record.name for record in fitted.data.records))
    wrong: list[Finding] = []
    moved = _last_move(fitted)
    if not fit.settled and not moved <= _LAST_MOVE:
        message = (
            f"Values and color of the errors still moved by {moved:.1f} standard deviations after {fit.rounds} rounds."
        )
        wrong.append(refusal("not_converged", "physical.motors", message, moved=moved))
    numbers = [*fitted.parameters.values.values(), *fitted.bounds.covariance.ravel().tolist()]
    numbers += [number for one in fitted.derived.values() for number in (one.value, one.std)]
    if not np.isfinite(numbers).all():
        wrong.append(refusal("not_converged", "physical.motors", "Values or deviations of the fit are not finite."))
    else:
        slope = fitted.derived["thrust_slope"]
        if not slope.std <= _LARGEST_STD * slope.value:
            message = (
                f"The slope of thrust is {slope.value:.3g} ± {slope.std:.2g} {slope.unit}: the flights do not tell "
                "what a rotor lifts."
            )
            wrong.append(refusal("not_identifiable", "thrust", message, value=slope.value, std=slope.std))
        impossible = (one for one in _physics(fitted, choices) if one.kind == "impossible_physics")
        wrong += [replace(one, severity="error") for one in impossible if one.severity == "warning"]
    if wrong:
        raise InsufficientDataError(
            f"what was identified from {names} is no vehicle: {wrong[0].message}",
            needed="sweeps on each axis, motors logged at 40 Hz and more, and the layout of the vehicle that flew",
            remedy="look at the layout, at what was given with --fix, and at the findings",
            findings=[*wrong, *fitted.data.findings],
        )


def _fitted(
    data: MotorData,
    choices: MotorChoices,
    levers: FloatArray,
    axes: tuple[str, ...],
) -> tuple[MotorFit, Curve, Searched | None]:
    """The fit of some axes, with a motor lag where the data tell one, and the search that it went on from."""
    curve = _curve(choices, data, axes)
    if choices.method == "accelerations":
        return _by_accelerations(data, choices, levers, axes, curve)

    # Rotors so heavy that yaw follows what they gain of their speed, and hardly their torque.
    heavy = "r" in axes and "r" not in excited_axes(excitations(data.records, levers))
    others = tuple(axis for axis in axes if axis != "r")
    if heavy and others:
        # Such a yaw never takes along what is known without it.
        with contextlib.suppress(InsufficientDataError):
            return _by_increments(data, choices, levers, axes, curve, heavy=True)
        heavy, axes = False, others
    return _by_increments(data, choices, levers, axes, curve, heavy=heavy)


def _by_increments(
    data: MotorData, choices: MotorChoices, levers: FloatArray, axes: tuple[str, ...], curve: Curve, *, heavy: bool
) -> tuple[MotorFit, Curve, Searched | None]:
    """The fit of increments, with what yaw has besides torque where the data ask for it.

    Raises
    ------
    InsufficientDataError
        Yaw was to be explained by the spin-up of rotors, and is not, or the data do not tell the parameters apart.
    """

    def posed(parts: _Parts) -> MotorProblem:
        wanted = tuple(axis for axis in axes if axis != "r" or parts.yaw)
        parameters = motor_parameters(
            curve=curve,
            known=choices.known,
            axes=wanted,
            lag=parts.lag,
            spin_up=parts.spin_up,
            yaw_delay=parts.yaw_delay,
            heave_damping=all(record.w.size > 0 for record in data.records),
            earliest_s=-_STAMPS_S if any(record.gyro_taps.size > 1 for record in data.records) else 0.0,
        )
        return MotorProblem(records=data.records, levers=levers, parameters=parameters, axes=("weight", *wanted))

    parts = _Parts(lag=data.kind != "speed", spin_up=heavy and _may_spin_up(data, choices))
    search = _searched(posed(parts), choices)
    start = search.values(search.minima[0]) if search else None
    _PROGRESS.info("fitting motors, thrust and inertia")
    fit = fit_motors(posed(parts), start=start)
    # What motors that were logged too slowly do not explain is no gust.
    gusty = not data.slow and gusts_between(fit) > _GUSTY
    if gusty:
        _PROGRESS.info("gusts move the vehicle as thrust does: fitting with their color")
        fit = fit_motors(posed(parts), white_force=True, start=start)
    if _lag_unseen(fit):
        # Without a lag of the motors their spin-up is a delay.
        parts = replace(parts, lag=False, spin_up=False)
        fit = fit_motors(posed(parts), white_force=gusty, start=start)
    alone = None
    if heavy and set(axes) != {"r"}:
        # Yaw by spin-up is so well seen that its delay would be that of all: what is known without yaw has its say.
        alone = fit_motors(posed(replace(parts, spin_up=False, yaw=False)), white_force=gusty, start=start)
    for name in (YAW_DELAY, SPIN_UP):
        more = _with(parts, name, fit, data, choices)
        begin = None if more is None else _begin(fit, alone, posed(more), name)
        if more is not None and begin is not None:
            _PROGRESS.info(f"yaw asks for {name}: fitting with it")
            again = fit_motors(posed(more), white_force=gusty, start=begin)
            if _certain(again, name, data, choices, curve):
                fit, parts = again, more
    if heavy and SPIN_UP not in choices.known and not _certain(fit, SPIN_UP, data, choices, curve):
        if alone is None:
            raise _nothing_excited(data, excitations(data.records, levers))
        fit = alone
    return fit, curve, search


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """What the model has besides thrust, inertia and damping."""

    lag: bool
    yaw: bool = True
    spin_up: bool = False
    yaw_delay: bool = False


_CERTAIN = 3.0
"""Deviations from nothing of what yaw has beside torque: less is no spin-up, and no delay of its own."""


def _may_spin_up(data: MotorData, choices: MotorChoices) -> bool:
    """Whether rotors may turn the vehicle by speeding up: not in the published cost, nor without a lag of motors."""
    return choices.method != "accelerations" and data.kind != "speed" and SPIN_UP not in choices.known


def _with(parts: _Parts, name: str, fit: MotorFit, data: MotorData, choices: MotorChoices) -> _Parts | None:
    """The model with one more of what yaw may have; ``None`` where it cannot, or has it already."""
    if "r" not in fit.problem.axes or name in fit.parameters.names:
        return None
    if name == SPIN_UP:
        return replace(parts, spin_up=True) if parts.lag and _may_spin_up(data, choices) else None
    return replace(parts, yaw_delay=True) if {"p", "q"} & set(fit.problem.axes) else None


def _begin(fit: MotorFit, alone: MotorFit | None, more: MotorProblem, name: str) -> dict[str, float] | None:
    """Where a fit with one more parameter of yaw begins, where the data ask for it; ``None`` where they do not.

    Parameters
    ----------
    fit
        Without the parameter.
    alone
        The same without yaw, where yaw may have decided on the delay of all.
    more
        The problem with the parameter.
    name
        :data:`SPIN_UP` or :data:`YAW_DELAY`.
    """
    values = fit.parameters.values
    here = 0.0 if name == SPIN_UP else values["tau_gyro"]
    if name == YAW_DELAY and alone is not None and "tau_gyro" in alone.parameters.names:
        apart_s = abs(here - alone.parameters["tau_gyro"].value)
        told = apart_s > 0.5 / fit.problem.records[0].sample_rate_hz
        return {**values, **alone.parameters.values, name: here} if told else None
    known = {one: value for one, value in {**values, name: here}.items() if one in more.parameters.free}
    begun = fit.problem.with_parameters(more.parameters.with_values(known))
    step, std = likely_step(fit, begun, name)
    if not abs(step) > _CERTAIN * std or (name == SPIN_UP and step < 0.0):
        return None
    return {**values, name: here + step}


def _certain(fit: MotorFit, name: str, data: MotorData, choices: MotorChoices, curve: Curve) -> bool:
    """Whether what yaw has besides lies well beyond its deviation, model error and all."""
    bounds = _bounded(data, choices, fit, curve).bounds
    if name not in bounds.names:
        return False
    away, row = fit.parameters[name].value, np.array([float(one == name) for one in bounds.names])
    if name == YAW_DELAY and "tau_gyro" in bounds.names:
        away -= fit.parameters["tau_gyro"].value
        row -= [one == "tau_gyro" for one in bounds.names]
    return abs(away) >= _CERTAIN * math.sqrt(float(row @ bounds.covariance @ row))


def _by_accelerations(
    data: MotorData, choices: MotorChoices, levers: FloatArray, axes: tuple[str, ...], curve: Curve
) -> tuple[MotorFit, Curve, Searched | None]:
    """The fit of absolute errors of accelerations, see :mod:`rotorid.fitting.motors.accelerations`."""

    def posed(*, lag: bool) -> AccelerationErrors:
        parameters = motor_parameters(
            curve=curve,
            known=choices.known,
            axes=axes,
            lag=lag,
            heave_damping=all(record.w.size > 0 for record in data.records),
            delays=False,
        )
        problem = MotorProblem(records=data.records, levers=levers, parameters=parameters, axes=("weight", *axes))
        return acceleration_errors(problem)

    def fitted(problem: AccelerationErrors, start: Mapping[str, float]) -> MotorFit:
        parameters = problem.parameters
        parameters = parameters.with_values({name: start[name] for name in parameters.free if name in start})
        return MotorFit(
            problem=problem,
            solution=problem.polish(parameters.pack()),
            excitations=excitations(data.records, levers),
            rounds=0,
            settled=True,
        )

    problem = posed(lag=data.kind != "speed")
    search = _run_search(problem, choices)
    start = search.values(search.minima[0]) if search else {}
    _PROGRESS.info("fitting motors, thrust and inertia to accelerations")
    fit = fitted(problem, start)
    if "T_motor" in fit.parameters.free and _lag_unseen(fit):
        fit = fitted(posed(lag=False), start)
    return fit, curve, search


def _searched(problem: MotorProblem, choices: MotorChoices) -> Searched | None:
    """The search that was asked for, on slow motion."""
    return None if choices.search is None else _run_search(searched_motors(problem), choices)


def _run_search(problem: MotorProblem, choices: MotorChoices) -> Searched | None:
    if choices.search is None:
        return None
    settings = IdentifySettings(
        search=choices.search, evaluations=choices.evaluations, seed=choices.seed, runs=choices.runs
    )
    return searched(problem, settings)


def _lag_unseen(fit: MotorFit) -> bool:
    if "T_motor" not in fit.parameters.free:
        return False
    if "T_motor" not in fit.moving:
        return True
    place = fit.moving.index("T_motor")
    bounds, _ = motor_bounds(fit)
    lag_s = fit.parameters["T_motor"].value
    if lag_s <= bounds.std[place]:
        return True
    # A delay below zero that takes the lag away again is no delay: both stand for stamps that are off.
    late_s = fit.parameters["tau_gyro"].value if "tau_gyro" in fit.moving else 0.0
    return late_s < 0.0 and lag_s + late_s <= 0.5 / min(one.sample_rate_hz for one in fit.problem.records)


def _curve(choices: MotorChoices, data: MotorData, axes: tuple[str, ...]) -> Curve:
    if choices.curve != "auto":
        return choices.curve
    if data.straightened:
        return "linear"
    if data.kind == "speed":
        return "quadratic"
    return "polynomial" if "az" in axes else "linear" if data.kind == "thrust_demand" else "quadratic"


def _nothing_explained(data: MotorData, left_out: Sequence[Finding]) -> InsufficientDataError:
    names = ", ".join(dict.fromkeys(record.name for record in data.records))
    slow = [one for one in data.findings if one.kind == "rate_too_low"]
    message = f"The motors of {names} move with the vehicle, and explain less than half of its motion along every axis"
    return InsufficientDataError(
        message,
        needed="motor outputs logged faster than the motors answer, 40 Hz and more",
        remedy=slow[0].message if slow else "look at the layout of the rotors and at the stamps of the log",
        findings=[refusal("poor_fit", names, f"{message}."), *left_out, *data.findings],
    )


def _nothing_excited(data: MotorData, found: tuple[Mapping[str, Excitation], ...]) -> InsufficientDataError:
    best = {axis: max(one[axis].correlation for one in found) for axis in AXIS_WORDS}
    told = ", ".join(f"{AXIS_WORDS[axis]} {correlation:.2f}" for axis, correlation in best.items())
    names = ", ".join(dict.fromkeys(record.name for record in data.records))
    slow = [one for one in data.findings if one.kind == "rate_too_low"]
    message = (
        f"The motors of {names} explain its motion along no axis: correlation of torque and acceleration up to 5 Hz "
        f"is {told}, and {LEAST_CORRELATION:g} is needed"
    )
    return InsufficientDataError(
        message,
        needed="sweeps or doublets, and motor outputs logged faster than the motors answer",
        remedy=slow[0].message if slow else "fly excitations on each axis",
        findings=[
            refusal("no_excitation", names, f"{message}.", **best),
            *data.findings,
        ],
    )


def _derived(
    parameters: ParameterSet, bounds: Bounds, at_hover: Bounds, hover: float, data: MotorData, *, scaled: bool
) -> dict[str, Derived]:
    """Thrust at hover, its slope, and what the rotors give at full output."""

    def of_curve(terms: Mapping[str, float], unit: str, limits: Bounds = bounds) -> Derived:
        value = sum(parameters[name].value * factor for name, factor in terms.items() if name in parameters.names)
        return Derived(value=float(value), std=_std(limits, terms), unit=unit if scaled else _PER_MASS[unit])

    slope_unit = "N s/rad" if data.kind == "speed" else "N"
    found = {
        "thrust_hover": of_curve({"c_0": 1.0, "c_1": hover, "c_2": hover**2}, "N", at_hover),
        "thrust_slope": of_curve({"c_1": 1.0, "c_2": 2.0 * hover}, slope_unit),
    }
    if data.kind == "speed":
        return found
    found["thrust_full"] = of_curve({"c_0": 1.0, "c_1": 1.0, "c_2": 1.0}, "N")
    full, mass = found["thrust_full"].value, parameters["m"].value
    weight = mass * STANDARD_GRAVITY_M_S2 / data.layout.rotors
    gradient = {"c_0": 1.0 / weight, "c_1": 1.0 / weight, "c_2": 1.0 / weight, "m": -full / (weight * mass)}
    found["thrust_to_weight"] = Derived(value=full / weight, std=_std(bounds, gradient), unit="1")
    return found


def _std(bounds: Bounds, gradient: Mapping[str, float]) -> float:
    slopes = np.array([gradient.get(name, 0.0) for name in bounds.names])
    return float(np.sqrt(slopes @ bounds.covariance @ slopes))


_GOOD_PERCENT = 50.0
_OPPOSED = 0.6
_DOUBTFUL = 0.2


def judge_motors(
    identified: FittedMotors, choices: MotorChoices, fit_percent: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Remarks on what was excited, what stays undetermined, and what physics does not allow."""
    return (
        *identified.left_out,
        *(one.finding(identified.parameters[one.parameter].unit) for one in identified.disagreeing),
        *_unexcited(identified),
        *_turned_around(identified),
        *_assumed(identified),
        *judge_loads(identified.logs, identified.voltage),
        *_doubted(identified, choices),
        *_unused(identified, choices),
        *_scale(identified, choices),
        *_arm(identified),
        *_yaw(identified),
        *_beside_torque(identified),
        *_physics(identified, choices),
        *_merit(identified, choices),
        *judge_both_ways(identified.both),
        *_ended(identified),
        *_judged_parameters(identified),
        *_poor(fit_percent),
    )


def _unexcited(identified: FittedMotors) -> Iterator[Finding]:
    excited = excited_axes(identified.fit.excitations)
    missing = [axis for axis in AXIS_WORDS if axis not in (*identified.axes, *excited)]
    if not missing:
        return
    best = {axis: max(one[axis].correlation for one in identified.fit.excitations) for axis in missing}
    words = " and ".join(f"{AXIS_WORDS[axis]} ({best[axis]:.2f})" for axis in missing)
    yield warn(
        "no_excitation",
        ", ".join(AXIS_WORDS[axis] for axis in missing),
        f"Nothing was identified of {words}: so far do motors and motion go together there, and "
        f"{LEAST_CORRELATION:g} is needed. Where a controller only answers "
        "gusts and noise, motors show the controller. Fly a sweep or doublets on these axes.",
        **{AXIS_WORDS[axis]: correlation for axis, correlation in best.items()},
    )


def _turned_around(identified: FittedMotors) -> Iterator[Finding]:
    """Axes along which the motors act against their levers."""
    for axis, word in AXIS_WORDS.items():
        lowest = min(one[axis].opposed for one in identified.fit.excitations)
        if axis not in identified.axes and lowest <= -_OPPOSED:
            yield warn(
                "rotor_layout",
                word,
                f"Motors and {word} motion go together with a correlation of {lowest:.2f}: the motors do not "
                f"stand, are not numbered, or do not turn as {identified.data.layout.name} has them. Name the "
                "layout with --layout.",
                correlation=lowest,
            )


def _assumed(identified: FittedMotors) -> Iterator[Finding]:
    if not identified.curve_assumed:
        return
    yield warn(
        "assumed_curve",
        "thrust",
        f"Thrust was not moved, so that its curve is not seen: a {identified.curve} one is assumed, and inertia "
        f"follows its slope. The deviations of thrust and inertia hold {100.0 * CURVE_SHARE:.0f} % for that. Fly a "
        "sweep of the throttle, or say with --curve what is known of the motors.",
        share=CURVE_SHARE,
    )


def _doubted(identified: FittedMotors, choices: MotorChoices) -> Iterator[Finding]:
    """A curve that was named and leaves of the specific force what another curve would explain."""
    if choices.curve in ("auto", "polynomial") or "az" not in identified.axes:
        return
    share = unexplained_by_curve(identified.fit.problem, identified.fit.solution.theta, identified.fit.excitations)
    if share < _DOUBTFUL:
        return
    yield warn(
        "assumed_curve",
        "thrust",
        f"{100.0 * share:.0f} % of what the {identified.curve} curve of thrust leaves of the specific force "
        "follows the outputs in another way: the curve is another one, and inertia follows its slope. Leave "
        "--curve out, or give --curve polynomial.",
        share=share,
    )


def _unused(identified: FittedMotors, choices: MotorChoices) -> Iterator[Finding]:
    names = [name for name in choices.known if name not in identified.parameters.names]
    if names:
        yield warn(
            "unused_choice",
            ", ".join(names),
            f"{' and '.join(names)} {'was' if len(names) == 1 else 'were'} given and used nowhere: what the "
            "logs excite does not show it.",
        )


def _scale(identified: FittedMotors, choices: MotorChoices) -> Iterator[Finding]:
    if scale_of(choices.known, identified.axes) is not None:
        return
    yield warn(
        "not_identifiable",
        "m",
        "Accelerations tell ratios of mass, thrust and inertia alone: thrust and inertia are those of a vehicle of "
        "1 kg, to be multiplied with its mass. Weigh it and give --fix m=KILOGRAMS, or a thrust from a bench.",
    )


def _arm(identified: FittedMotors) -> Iterator[Finding]:
    if identified.data.layout.arm_known or not {"p", "q"} & set(identified.axes):
        return
    yield warn(
        "not_identifiable",
        "I_xx, I_yy",
        "The log does not tell the size of the vehicle: I_xx and I_yy are those of an arm of 1 m, to be multiplied "
        "with its length. Measure from the center to the farthest rotor and give --arm METERS.",
    )


def _yaw(identified: FittedMotors) -> Iterator[Finding]:
    parameters = identified.parameters
    if "kappa_per_I_zz" not in parameters.names or "I_zz" in parameters.names:
        return
    ratio = parameters["kappa_per_I_zz"].value
    known = "Give --fix kappa=METERS from a bench, or --fix I_zz=VALUE."
    numbers = {"kappa_per_I_zz": ratio}
    bound = ""
    if {"I_xx", "I_yy"} <= set(parameters.names) and identified.data.layout.arm_known:
        inertia, torque = yaw_range(parameters.values)
        bound = (
            f"No body has an I_zz beyond I_xx + I_yy = {inertia.high:.4g} kg m^2, so that kappa is {torque.high:.4g} m "
            "at most; a flat vehicle comes close to both. "
        )
        numbers |= {"I_zz_at_most": inertia.high, "kappa_at_most": torque.high}
    yield remark(
        "not_identifiable",
        "kappa, I_zz",
        f"Yaw tells kappa over I_zz alone, {ratio:.4g} 1/(kg m). {bound}{known}",
        **numbers,
    )


def _beside_torque(identified: FittedMotors) -> Iterator[Finding]:
    """What yaw shows besides torque: rotors that speed up, and a delay that is not that of roll and pitch."""
    parameters = identified.parameters
    if SPIN_UP in parameters.free:
        value = parameters[SPIN_UP].value
        lead_s = value / (parameters["kappa_per_I_zz"].value * identified.derived["thrust_slope"].value)
        yield remark(
            "spin_up",
            SPIN_UP,
            f"Rotors that speed up turn the vehicle too, by {value:.3g} rad/s for one that goes from rest to full "
            f"output: beyond {1.0 / lead_s:.2g} rad/s that makes more of yaw than the torque of the rotors.",
            rad_s=value,
            lead_s=lead_s,
        )
    if YAW_DELAY in parameters.free and "tau_gyro" in parameters.names:
        own_s, other_s = parameters[YAW_DELAY].value, parameters["tau_gyro"].value
        yield remark(
            "delay_of_yaw",
            YAW_DELAY,
            f"Yaw is late by {1e3 * own_s:.3g} ms, roll and pitch by {1e3 * other_s:.3g} ms: gyros of one sensor are "
            "late alike, so that something turns the vehicle that the model does not have, or its sensors are several.",
            yaw_s=own_s,
            roll_pitch_s=other_s,
        )


def _judged_parameters(identified: FittedMotors) -> Iterator[Finding]:
    """Guidelines of single parameters; coefficients of one curve trade against each other, and their sum counts."""
    for finding in judge_parameters(identified.parameters, identified.bounds):
        if not (identified.curve == "polynomial" and finding.where in CURVE_TERMS["polynomial"]):
            yield finding


def _physics(identified: FittedMotors, choices: MotorChoices) -> list[Finding]:
    data, values = identified.data, identified.parameters.values
    if scale_of(choices.known, identified.axes) is None:
        # All others are per kilogram.
        values = {name: value for name, value in values.items() if name not in ("I_zz", "kappa")}
    spread = covariance_of_all(identified.parameters, identified.bounds)
    names = identified.parameters.names
    pairs = {(one, two): float(spread[i, j]) for i, one in enumerate(names) for j, two in enumerate(names)}
    return check_motor_constants(
        values,
        records=data.records,
        levers=levers_of(data) if data.layout.arm_known else None,
        covariance=pairs,
        full_output=None if data.kind == "speed" else 1.0,
    )


def _merit(identified: FittedMotors, choices: MotorChoices) -> list[Finding]:
    """The figure of merit of the rotors, where their speed was measured and their size is known."""
    data = identified.data
    weighed = scale_of(choices.known, identified.axes) is not None
    if data.kind != "speed" or choices.rotor_diameter_m is None or not weighed:
        return []
    return check_figure_of_merit(
        identified.parameters.values,
        speed_rad_s=identified.hover_output,
        rotor_diameter_m=choices.rotor_diameter_m,
        rotors=data.layout.rotors,
    )


def _ended(identified: FittedMotors) -> Iterator[Finding]:
    fit = identified.fit
    for name in fit.parameters.free:
        if name not in fit.moving:
            value = fit.parameters[name].value
            yield (remark if value == 0.0 else warn)(
                "parameter_at_bound",
                name,
                f"{name} went to its bound, {value:g} {fit.parameters[name].unit}, and is held there.",
                value=value,
            )
    if identified.data.kind != "speed" and "T_motor" not in identified.parameters.names:
        both = "; tau_gyro stands for both" if "tau_gyro" in identified.parameters.names else ""
        yield remark("lag_plus_delay", "T_motor", f"The data do not tell a motor lag from none, or from a delay{both}.")
    if not fit.settled:
        moved = _last_move(identified)
        yield warn(
            "not_converged",
            "physical.motors",
            f"Values and color of the errors still moved after {fit.rounds} rounds, by {moved:.2g} stated deviations.",
            moved=moved,
        )


def _poor(fit_percent: Mapping[str, float]) -> Iterator[Finding]:
    for name, percent in fit_percent.items():
        if percent < _GOOD_PERCENT:
            yield warn(
                "poor_fit", name, f"The motors explain {percent:.0f} % of {name} up to 5 Hz.", fit_percent=percent
            )


_ROWS = {"p": ("p", "roll"), "q": ("q", "pitch"), "r": ("r", "yaw")}
_DAMPING = {"p": "L_p", "q": "M_q", "r": "N_r"}
_INERTIA = {"p": "1/I_xx", "q": "1/I_yy", "r": "kappa_per_I_zz"}


def hover_model(identified: FittedMotors) -> LinearStructure:
    r"""Small motions about hover, with the identified values.

    .. math:: \delta F_i = (c_1 + 2 c_2 x_0) \, \delta x_i

    at the mean output :math:`x_0` of the flights. The delay to the gyros stands for that to the accelerometer too.
    """
    parameters = identified.parameters
    axes = [axis for axis in ("p", "q", "r") if axis in identified.axes]
    motors = range(1, identified.data.layout.rotors + 1)
    lag = "T_motor" in parameters.names
    thrusts = {i: f"x_{i}" if lag else f"motor_{i}" for i in motors}
    equations = [f"T_motor*x_{i}' = -x_{i} + motor_{i}" for i in motors] if lag else []
    for axis, levers in zip(("p", "q", "r"), levers_of(identified.data), strict=True):
        if axis in axes:
            moment = _sum({thrusts[i]: lever for i, lever in zip(motors, levers.tolist(), strict=True)})
            gained = "".join(
                f" - ({lever!r})*{SPIN_UP}*{thrusts[i]}'"
                for i, lever in zip(motors, levers.tolist(), strict=True)
                if axis == "r" and SPIN_UP in parameters.names and lag
            )
            equations.append(f"{axis}'{gained} = {_DAMPING[axis]}*{axis} + {axis}_thrust*({moment})")
    force = f"az_thrust*({_sum(dict.fromkeys(thrusts.values(), -1.0))})"
    heave = "Z_w" in parameters.names
    equations.append(f"w' = {'Z_w*w + ' if heave else ''}{force}")
    states = [*([f"x_{i}" for i in motors] if lag else []), *axes, "w"]
    lines = [
        'schema = "rotorid.model/1"',
        'name = "physical.motors"',
        'source = "motor outputs to rates and specific force, linear around hover"',
        f"inputs = [{', '.join(_quoted(f'motor_{i}') for i in motors)}]",
        f"states = [{', '.join(map(_quoted, states))}]",
        "equations = [",
        *(f"    {_quoted(one)}," for one in equations),
        "]",
        f"outputs = [{', '.join(map(_quoted, (*axes, 'az = w' + chr(39))))}]",
        "[delays]",
        *_delays(identified),
        "[constants]",
        f"x_0 = {identified.hover_output!r}",
        *_parameter_tables(identified, axes),
    ]
    return from_toml("\n".join(lines), where="the hover model")


def _quoted(text: str) -> str:
    return f'"{text}"'


def _sum(terms: dict[str, float]) -> str:
    return " + ".join(f"({factor!r})*{name}" for name, factor in terms.items() if factor != 0.0)


def _delays(identified: FittedMotors) -> list[str]:
    """One delay is that of the motors; where yaw has its own, delays are those of what is measured."""
    if YAW_DELAY in identified.parameters.names:
        outputs = {axis: "tau_gyro" for axis in (*identified.axes, "az") if axis != "r"} | {"r": YAW_DELAY}
        return [f'{output} = "{name}"' for output, name in outputs.items()]
    motors = range(1, identified.data.layout.rotors + 1)
    return [f'motor_{i} = "{name}"' for name in _delayed(identified) for i in motors]


def _delayed(identified: FittedMotors) -> tuple[str, ...]:
    """The delay that stands for all: to the gyros, or where no rate was excited to the accelerometer."""
    names = [one for one in ("tau_gyro", "tau_accel") if one in identified.parameters.names]
    return tuple(names[:1])


def _parameter_tables(identified: FittedMotors, axes: Sequence[str]) -> list[str]:
    slope = " + ".join(
        term for name, term in (("c_1", "c_1"), ("c_2", "2*c_2*x_0")) if name in identified.parameters.names
    )
    used = {"m", "c_1", "c_2", "Z_w", "T_motor", *_delayed(identified)}
    used |= {SPIN_UP, YAW_DELAY} if "r" in axes and "T_motor" in identified.parameters.names else set()
    used |= {name for axis in axes for name in (_DAMPING[axis], _INERTIA[axis].removeprefix("1/"))}
    lines: list[str] = []
    for one in identified.parameters:
        if one.name not in used:
            continue
        held = ['status = "fixed"'] if one.status != "free" else []
        lines += [f"[parameters.{one.name}]", f"value = {one.value!r}", f'unit = "{one.unit}"', *held]
    tied = {f"{axis}_thrust": (f"({slope})*{_INERTIA[axis]}".replace("*1/", "/"), "1/(kg m^2)") for axis in axes}
    tied["az_thrust"] = (f"({slope})/m", "m/s^2")
    for name, (expression, _) in tied.items():
        unit = "m/s^2" if name == "az_thrust" else "rad/(m s^2)" if name != "r_thrust" else "rad/s^2"
        lines += [f"[parameters.{name}]", f'tied = "{expression}"', f'unit = "{unit}"']
    return lines
