"""Physics of motors: from records of motors to inertia, thrust, lag and torque with bounds.

:func:`fit_motor_data` fits the axes that the motors moved, leaves out those of which nothing can be said, and bounds
the rest. Bounds hold random errors and what no repetition of the flight would show
(:mod:`rotorid.fits.motors.errors`).
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.quantity import with_error
from rotorid.errors import InsufficientDataError
from rotorid.fits.bootstrapping import bootstrap
from rotorid.fits.motors.derived import derived_numbers, units_of
from rotorid.fits.motors.errors import gusts_between, motor_model_error, with_model_errors
from rotorid.fits.motors.fitted import FittedMotors, levers_of
from rotorid.fits.motors.motion import CHANNELS, fit_percents
from rotorid.fits.motors.weight import WEIGHT_ALONE, balance_finding, weighed, with_balance
from rotorid.fits.scatter import LogEstimate, disagreements, with_scatter
from rotorid.fits.searching import Searched, searched
from rotorid.fitting.motors.accelerations import AccelerationErrors, acceleration_errors
from rotorid.fitting.motors.excitation import (
    LEAST_CORRELATION,
    Excitation,
    excitations,
    excited_axes,
)
from rotorid.fitting.motors.fit import MotorFit, fit_motors, likely_step
from rotorid.fitting.motors.inertia import inertia_regressions
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.start import searched_motors
from rotorid.fitting.motors.translation import DRAG, translated_axes, with_translation
from rotorid.flights.motor_data import MotorData
from rotorid.models.motors import (
    SPIN_UP,
    YAW_DELAY,
    Curve,
    check_motor_constants,
    mean_force,
    motor_parameters,
    scale_of,
)
from rotorid.models.parameter import ParameterSet
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_by_part
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import covariance_of_all
from rotorid.units import STANDARD_GRAVITY_M_S2

_PROGRESS = logging.getLogger("rotorid.progress")

_FLAT = 1e-12


@cached_by_value
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
            f"the flights do not separate {' and '.join(mixed)}",
            needed="motion that separates them",
            remedy="choose a curve with fewer terms with --curve, or set a parameter with --fix",
        )
    colored = colored_by_part(parts)
    inverse = np.linalg.inv(even).diagonal() / length**2
    ratio = np.log(colored.corrected.diagonal() / colored.white.diagonal())
    bounds = Bounds(
        names=fit.moving,
        cramer_rao=2.0 * np.sqrt(inverse),
        insensitivity=1.0 / length,
        covariance=colored.corrected,
        random=colored.corrected,
        colored=math.exp(0.5 * float(np.mean(ratio))),
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
        colored=1.0,
    )
    return bounds, 0


_GUSTY = 0.05
"""Share by which gusts under feedback may pull thrust, above which their color counts in the fit: ten times what a
calibrated accelerometer is off by. Below, what is slow and large shows the curve of thrust better as it is."""

_LEAST_EXPLAINED = 50.0
"""Percent of an axis that the motors must explain: less than that, and they leave more than they explain."""

_LEAST_OF_GUSTY = 100.0 * (1.0 - 0.5**0.5)
"""The same in power, for specific force among gusts."""

_LARGEST_STD = 1.0
"""Largest useful error of an inertia or of the slope of thrust, as a share of the value."""

_LARGEST_DRAG_STD_1_S = 0.3
"""Largest useful error of a drag over mass: that of a small multirotor is about as large."""

_LAST_MOVE = 0.5
"""Stated deviations by which values may still move in the last round of a fit that has come to its end."""

_STAMPS_S = 0.01
"""Errors of stamps, and of the rate at which a filter is taken to work, stay below."""


def fit_motor_data(data: MotorData, choices: MotorSettings) -> FittedMotors:
    """Fit what was excited, and bound it.

    Axes of which the motors then explain less than they leave are left out: what was seen there was the controller, or
    motors that were logged too slowly. So are those whose inertia is not positive or no better known than nothing, and
    a motor lag that the data do not separate from zero, or from a delay. Then the rest is fitted again. Where no
    axis was excited, measured speeds still give the thrust coefficient: by the weight balance of steady flight.

    Raises
    ------
    InsufficientDataError
        The motors explain the motion along no axis, the data do not determine all parameters, the fit does not come to
        an end, or ends where physics allows nothing to be.
    """
    levers = levers_of(data)
    found = excitations(data.records, levers)
    if "r" not in excited_axes(found) and (_may_spin_up(choices) or choices.known.get(SPIN_UP)):
        found = excitations(data.records, levers, spin_up=True)
    axes = excited_axes(found)
    if not axes:
        if (by_weight := _by_weight(data, choices, levers)) is not None:
            return by_weight
        raise _nothing_excited(data, found)
    if choices.method == "accelerations":
        axes += translated_axes(with_translation(found, data.records))
    left_out: list[Finding] = []
    while True:
        fit, curve, search = _fitted(data, choices, levers, axes)
        fitted = replace(_bounded(data, choices, fit, curve), search=search)
        wrong = _useless(fitted)
        left_out += wrong.values()
        if not wrong:
            break
        axes = tuple(axis for axis in axes if axis not in wrong)
        if not set(axes) - set(DRAG):
            if (by_weight := _by_weight(data, choices, levers)) is not None:
                return replace(by_weight, left_out=(*by_weight.left_out, *left_out))
            raise _nothing_explained(data, left_out)
    disagreeing = disagreements(_fit_each_log(fitted, choices))
    fitted = replace(
        fitted,
        bounds=with_scatter(fitted.bounds, disagreeing),
        disagreeing=disagreeing,
    )
    _require_end(fitted, choices)
    again = None
    if choices.bootstrap is not None:
        fixed = fit.problem.with_parameters(fitted.parameters)
        again = bootstrap(fixed, replace(fit.solution, theta=fitted.parameters.pack()), fitted.bounds, choices)
    return replace(fitted, bootstrap=again, left_out=tuple(left_out))


def _by_weight(data: MotorData, choices: MotorSettings, levers: FloatArray) -> FittedMotors | None:
    """The thrust coefficient alone, from the weight balance; ``None`` where it is given, or there is no balance."""
    mass_kg = choices.known.get("m", 1.0)
    unweighed = scale_of(choices.known, ()) not in (None, "m") or _curve(choices, data, ()) != "quadratic"
    if unweighed or choices.method == "accelerations" or (balance := weighed(data, mass_kg)) is None:
        return None
    parameters = motor_parameters(
        curve="quadratic", known=choices.known, axes=(), lag=False, heave_damping=False, delays=False
    )
    problem = MotorProblem(records=data.records, levers=levers, parameters=parameters, axes=WEIGHT_ALONE)
    fit, bounds = with_balance(fit_motors(problem), balance)
    found = _Bounded(parameters=fit.parameters, bounds=bounds, at_hover=bounds)
    return replace(_described(data, choices, fit, "quadratic", found), left_out=(balance_finding(balance),))


_DAMPING = ("L_p", "M_q", "N_r", "Z_w", *DRAG.values())
_COMPARED = ("I_xx", "I_yy", "kappa_per_I_zz", *_DAMPING, "T_motor", "tau_gyro", "tau_accel")
"""Of one curve of thrust only the sum counts, which two flights at different outputs need not share."""


def _fit_each_log(fitted: FittedMotors, choices: MotorSettings) -> list[LogEstimate]:
    """The fit of each log alone, for logs that share an axis with another one."""
    data, problem = fitted.data, fitted.fit.problem
    counted: dict[str, set[str]] = {}
    for record, filters in zip(problem.records, problem.filters, strict=True):
        counted.setdefault(record.name, set()).update(axis for axis in filters if axis != "weight")
    found = []
    for name, axes in counted.items():
        others = set().union(*(of for other, of in counted.items() if other != name))
        if not axes & others:
            continue
        part = data._replace(stretches=tuple(flight for flight in data.stretches if flight.record.name == name))
        _PROGRESS.info(f"fitting {name} alone")
        with contextlib.suppress(InsufficientDataError):
            ordered = tuple(axis for axis in (*AXIS_WORDS, *DRAG) if axis in axes)
            fit, curve, _ = _fitted(
                part, replace(choices, search=None, evaluations=None, runs=None), problem.levers, ordered
            )
            bounded = _bounded(part, choices, fit, curve)
            if not _useless(bounded):
                stds = dict(zip(bounded.bounds.names, bounded.bounds.std.tolist(), strict=True))
                stds = {key: stds[key] for key in _COMPARED if key in stds}
                found.append(LogEstimate(record=name, values=bounded.parameters.values, stds=stds))
    return found


def _bounded(data: MotorData, choices: MotorSettings, fit: MotorFit, curve: Curve) -> FittedMotors:
    """A fit with its bounds and what follows from it."""
    parameters = fit.parameters
    for name in set(parameters.free) - set(fit.moving):
        parameters = parameters.fix(name, parameters[name].value)
    random, memory = motor_bounds(fit)
    model = motor_model_error(fit, random.random)
    assumed = choices.curve == "auto" and "az" not in fit.problem.axes and not data.straightened
    # The square of measured speeds is trusted where thrust did not move, and not where it moved another way.
    assumed = assumed and (data.kind != "speed" or "az" in excited_axes(fit.excitations))
    # The weight gives thrust at hover whatever the curve is; its slope is another matter.
    at_hover = with_model_errors(random, parameters, fit, data, curve_assumed=False, model=model)
    bounds = at_hover
    if assumed:
        bounds = with_model_errors(random, parameters, fit, data, curve_assumed=True, model=model)
    found = _Bounded(parameters=parameters, bounds=bounds, at_hover=at_hover, memory=memory, curve_assumed=assumed)
    return _described(data, choices, fit, curve, found)


@dataclass(frozen=True, kw_only=True)
class _Bounded:
    """Values with their bounds, and those of thrust at hover, which no assumed curve widens."""

    parameters: ParameterSet
    bounds: Bounds
    at_hover: Bounds
    memory: int = 0
    curve_assumed: bool = False


def _described(data: MotorData, choices: MotorSettings, fit: MotorFit, curve: Curve, found: _Bounded) -> FittedMotors:
    """A bounded fit and what follows from it."""
    parameters = found.parameters
    hover = float(np.mean([record.outputs.mean() for record in data.records]))
    scaled = scale_of(choices.known, tuple(axis for axis in fit.problem.axes if axis != "weight")) is not None
    units = units_of(parameters, scaled=scaled, arm_known=data.layout.arm_known, speeds=data.kind == "speed")
    # Regressions both ways are of whitened errors.
    regressions = () if choices.method == "accelerations" else inertia_regressions(fit)
    both = (replace(regression, unit=units.get(regression.parameter, regression.unit)) for regression in regressions)
    return FittedMotors(
        data=data,
        fit=fit,
        curve=curve,
        parameters=ParameterSet([replace(parameter, unit=units[parameter.name]) for parameter in parameters]),
        bounds=found.bounds,
        memory=found.memory,
        curve_assumed=found.curve_assumed,
        both=tuple(
            regression
            for regression in both
            if np.isfinite([*regression.plain, *regression.corrected, *regression.deviations]).all()
        ),
        hover_output=hover,
        load_factor=mean_force(data.records) / STANDARD_GRAVITY_M_S2,
        derived=derived_numbers(parameters, found.bounds, found.at_hover, hover, data, scaled=scaled),
    )


def _useless(fitted: FittedMotors) -> dict[str, Finding]:
    """Axes without a usable result although motors and motion moved together, with the reason."""
    channels = {CHANNELS[axis]: axis for axis in fitted.axes}
    found: dict[str, Finding] = {}
    for name, percent in fit_percents(fitted.moved, list(channels)).items():
        # Gusts whose color is in the fit may hold as much power as thrust does.
        gusty = channels[name] == "az" and fitted.fit.white_force
        if not percent >= (_LEAST_OF_GUSTY if gusty else _LEAST_EXPLAINED):
            axis = channels[name]
            cause = "Thrust and tilt" if axis in DRAG else "The motors"
            lost = DRAG[axis] if axis in DRAG else f"{AXIS_WORDS[axis]} parameters"
            found[axis] = warn(
                "poor_fit",
                name,
                f"{cause} explain only {percent:.0f} % of {name} {fitted.band_words(name)}, so no {lost} "
                f"{'is' if axis in DRAG else 'are'} given.",
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
                    f"{name} is {with_error(value, std[name])} {fitted.parameters[name].unit}, consistent with "
                    f"zero, so no {AXIS_WORDS[axis]} parameters are given.",
                    value=value,
                    std=std[name],
                )
    for axis, name in DRAG.items():
        if axis not in found and name in std and not std[name] <= _LARGEST_DRAG_STD_1_S:
            value = fitted.parameters[name].value
            found[axis] = warn(
                "not_identifiable",
                name,
                f"Not enough data for {name}: {with_error(value, std[name])} 1/s is no better known than "
                "the drag of most multirotors. Fly faster, in tilts of several seconds.",
                value=value,
                std=std[name],
            )
    return found


def last_move(fitted: FittedMotors) -> float:
    """By how many stated deviations a value moved in the last round."""
    moved = dict(zip(fitted.fit.parameters.free, fitted.fit.moved.tolist(), strict=False))
    return max(
        (abs(moved.get(name, 0.0)) / std for name, std in zip(fitted.bounds.names, fitted.bounds.std, strict=True)),
        default=0.0,
    )


def _require_end(fitted: FittedMotors, choices: MotorSettings) -> None:
    """Refuse a fit that has not converged, or converged to impossible values.

    Raises
    ------
    InsufficientDataError
        With a finding that says what is wrong.
    """
    fit, names = fitted.fit, ", ".join(dict.fromkeys(record.name for record in fitted.data.records))
    wrong: list[Finding] = []
    moved = last_move(fitted)
    if not fit.settled and not moved <= _LAST_MOVE:
        message = f"Values and noise color still changed by {moved:.1f} standard deviations after {fit.rounds} rounds."
        wrong.append(refusal("not_converged", "physical.motors", message, moved=moved))
    numbers = [*fitted.parameters.values.values(), *fitted.bounds.covariance.ravel().tolist()]
    numbers += [number for derived in fitted.derived.values() for number in (derived.value, derived.std)]
    if not np.isfinite(numbers).all():
        wrong.append(
            refusal("not_converged", "physical.motors", "The values or standard deviations of the fit are not finite.")
        )
    else:
        slope = fitted.derived["thrust_slope"]
        if not slope.std <= _LARGEST_STD * slope.value:
            message = (
                f"The slope of thrust is {with_error(slope.value, slope.std)} {slope.unit}: not enough data to "
                "estimate the thrust of a rotor."
            )
            wrong.append(refusal("not_identifiable", "thrust", message, value=slope.value, std=slope.std))
        impossible = (
            finding for finding in physical_contradictions(fitted, choices) if finding.kind == "impossible_physics"
        )
        wrong += [replace(finding, severity="error") for finding in impossible if finding.severity == "warning"]
    if wrong:
        raise InsufficientDataError(
            f"the values identified from {names} are not physical: {wrong[0].message}",
            needed="sweeps on each axis, motors logged at 40 Hz or more, and the layout of the vehicle that flew",
            remedy="check the layout, the values given with --fix, and the findings",
            findings=[*wrong, *fitted.data.findings],
        )


def _fitted(
    data: MotorData,
    choices: MotorSettings,
    levers: FloatArray,
    axes: tuple[str, ...],
) -> tuple[MotorFit, Curve, Searched | None]:
    """The fit of some axes, with a motor lag where the data show one, and the search that it went on from."""
    curve = _curve(choices, data, axes)
    if choices.method == "accelerations":
        return _by_accelerations(data, choices, levers, axes, curve)

    # Rotors so heavy that yaw follows their acceleration more than their torque.
    heavy = "r" in axes and "r" not in excited_axes(excitations(data.records, levers))
    others = tuple(axis for axis in axes if axis != "r")
    if heavy and others:
        # Such a yaw never takes along what is known without it.
        with contextlib.suppress(InsufficientDataError):
            return _by_increments(data, choices, levers, axes, curve, heavy=True)
        heavy, axes = False, others
    return _by_increments(data, choices, levers, axes, curve, heavy=heavy)


def _by_increments(
    data: MotorData, choices: MotorSettings, levers: FloatArray, axes: tuple[str, ...], curve: Curve, *, heavy: bool
) -> tuple[MotorFit, Curve, Searched | None]:
    """The fit of increments, with what yaw has besides torque where the data ask for it.

    Raises
    ------
    InsufficientDataError
        Yaw was to be explained by the spin-up of rotors, and is not, or the data do not separate the parameters.
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

    parts = _Parts(lag=data.kind != "speed", spin_up=heavy and _may_spin_up(choices))
    search = _searched(posed(parts), choices)
    start = search.values(search.minima[0]) if search else None
    _PROGRESS.info("fitting motors, thrust and inertia")
    problem = posed(parts)
    fit = fit_motors(problem, start=start)
    # What motors that were logged too slowly do not explain is no gust.
    gusty = not data.slow and gusts_between(fit) > _GUSTY
    if gusty:
        _PROGRESS.info("gusts move the vehicle as thrust does: fitting with noise color")
        fit = fit_motors(problem, white_force=True, start=start)
    if _lag_unseen(fit):
        # Without a lag of the motors their spin-up is a delay.
        parts = replace(parts, lag=False, spin_up=False)
        fit = fit_motors(posed(parts), white_force=gusty, start=start)
    alone = None
    if heavy and set(axes) != {"r"}:
        # Yaw by spin-up is so well seen that its delay would be that of all: what is known without yaw has its say.
        alone = fit_motors(posed(replace(parts, spin_up=False, yaw=False)), white_force=gusty, start=start)
    for name in (YAW_DELAY, SPIN_UP):
        more = _with_yaw_parameter(parts, name, fit, data, choices)
        begin = None if more is None else _start_of_yaw_parameter(fit, alone, posed(more), name)
        if more is not None and begin is not None:
            _PROGRESS.info(f"yaw needs {name}: fitting with it")
            again = fit_motors(posed(more), white_force=gusty, start=begin)
            if _yaw_parameter_is_certain(again, name, data, choices, curve):
                fit, parts = again, more
    if heavy and SPIN_UP not in choices.known and not _yaw_parameter_is_certain(fit, SPIN_UP, data, choices, curve):
        if alone is None:
            raise _nothing_excited(data, excitations(data.records, levers))
        fit = alone
    return fit, curve, search


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """Parts of the model in addition to thrust, inertia and damping."""

    lag: bool
    yaw: bool = True
    spin_up: bool = False
    yaw_delay: bool = False


_CERTAIN = 3.0
"""Standard deviations from zero at which yaw has a spin-up or a delay of its own."""


def _may_spin_up(choices: MotorSettings) -> bool:
    """Whether rotors may turn the vehicle by speeding up: not in the published cost, and not where it is known."""
    return choices.method != "accelerations" and SPIN_UP not in choices.known


def _with_yaw_parameter(
    parts: _Parts, name: str, fit: MotorFit, data: MotorData, choices: MotorSettings
) -> _Parts | None:
    """The model with one more parameter of yaw; ``None`` where it cannot have it, or has it already."""
    if "r" not in fit.problem.axes or name in fit.parameters.names:
        return None
    if name == SPIN_UP:
        # Without a lag of the motors their spin-up is a delay; speeds that were measured have none.
        separable = parts.lag or data.kind == "speed"
        return replace(parts, spin_up=True) if separable and _may_spin_up(choices) else None
    return replace(parts, yaw_delay=True) if {"p", "q"} & set(fit.problem.axes) else None


def _start_of_yaw_parameter(
    fit: MotorFit, alone: MotorFit | None, more: MotorProblem, name: str
) -> dict[str, float] | None:
    """Start values of the fit with one more parameter of yaw; ``None`` where the data do not ask for it.

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
        separable = apart_s > 0.5 / fit.problem.records[0].sample_rate_hz
        return {**values, **alone.parameters.values, name: here} if separable else None
    known = {
        parameter: value for parameter, value in {**values, name: here}.items() if parameter in more.parameters.free
    }
    start = fit.problem.with_parameters(more.parameters.with_values(known))
    step, std = likely_step(fit, start, name)
    if not abs(step) > _CERTAIN * std or (name == SPIN_UP and step < 0.0):
        return None
    return {**values, name: here + step}


def _yaw_parameter_is_certain(fit: MotorFit, name: str, data: MotorData, choices: MotorSettings, curve: Curve) -> bool:
    """Whether a parameter of yaw lies three deviations from nothing, model error included."""
    bounds = _bounded(data, choices, fit, curve).bounds
    if name not in bounds.names:
        return False
    away, row = fit.parameters[name].value, np.array([float(parameter == name) for parameter in bounds.names])
    if name == YAW_DELAY and "tau_gyro" in bounds.names:
        away -= fit.parameters["tau_gyro"].value
        row -= [parameter == "tau_gyro" for parameter in bounds.names]
    return abs(away) >= _CERTAIN * math.sqrt(float(row @ bounds.covariance @ row))


def _by_accelerations(
    data: MotorData, choices: MotorSettings, levers: FloatArray, axes: tuple[str, ...], curve: Curve
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
            excitations=with_translation(excitations(data.records, levers), data.records),
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


def _searched(problem: MotorProblem, choices: MotorSettings) -> Searched | None:
    """The search that was asked for, on slow motion."""
    return None if choices.search is None else _run_search(searched_motors(problem), choices)


def _run_search(problem: MotorProblem, choices: MotorSettings) -> Searched | None:
    if choices.search is None:
        return None
    settings = IdentifySettings(
        search=choices.search,
        evaluations=choices.evaluations,
        seed=choices.seed,
        runs=choices.runs,
        workers=choices.workers,
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
    # A delay below zero that takes the lag away again is no delay: both come from wrong time stamps.
    late_s = fit.parameters["tau_gyro"].value if "tau_gyro" in fit.moving else 0.0
    return late_s < 0.0 and lag_s + late_s <= 0.5 / min(record.sample_rate_hz for record in fit.problem.records)


def _curve(choices: MotorSettings, data: MotorData, axes: tuple[str, ...]) -> Curve:
    if choices.curve != "auto":
        return choices.curve
    if data.straightened:
        return "linear"
    if data.kind == "speed":
        return "quadratic"
    return "polynomial" if "az" in axes else "linear" if data.kind == "thrust_demand" else "quadratic"


def _nothing_explained(data: MotorData, left_out: Sequence[Finding]) -> InsufficientDataError:
    names = ", ".join(dict.fromkeys(record.name for record in data.records))
    slow = [finding for finding in data.findings if finding.kind == "rate_too_low"]
    message = f"The motors of {names} explain less than half of its motion on every axis"
    return InsufficientDataError(
        message,
        needed="motor outputs logged faster than the motors respond, at 40 Hz or more",
        remedy=slow[0].message if slow else "check the rotor layout and the time stamps of the log",
        findings=[refusal("poor_fit", names, f"{message}."), *left_out, *data.findings],
    )


def _nothing_excited(data: MotorData, found: tuple[Mapping[str, Excitation], ...]) -> InsufficientDataError:
    best = {axis: max(excitations[axis].correlation for excitations in found) for axis in AXIS_WORDS}
    correlation_words = ", ".join(f"{AXIS_WORDS[axis]} {correlation:.2f}" for axis, correlation in best.items())
    names = ", ".join(dict.fromkeys(record.name for record in data.records))
    slow = [finding for finding in data.findings if finding.kind == "rate_too_low"]
    message = (
        f"The motors of {names} explain its motion on no axis: the correlation of torque and acceleration up to "
        f"5 Hz is {correlation_words} ({LEAST_CORRELATION:g} needed), and no two octaves above show more"
    )
    return InsufficientDataError(
        message,
        needed="sweeps or doublets, and motor outputs logged faster than the motors respond",
        remedy=slow[0].message if slow else "fly excitations on each axis",
        findings=[
            refusal("no_excitation", names, f"{message}.", **best),
            *data.findings,
        ],
    )


def physical_contradictions(identified: FittedMotors, choices: MotorSettings) -> list[Finding]:
    """Contradictions in inertia, thrust and torque, or with the weight that flew."""
    data, values = identified.data, identified.parameters.values
    if scale_of(choices.known, identified.axes) is None:
        # All others are per kilogram.
        values = {name: value for name, value in values.items() if name not in ("I_zz", "kappa")}
    spread = covariance_of_all(identified.parameters, identified.bounds)
    names = identified.parameters.names
    pairs = {(name, two): float(spread[i, j]) for i, name in enumerate(names) for j, two in enumerate(names)}
    return check_motor_constants(
        values,
        records=data.records,
        levers=levers_of(data) if data.layout.arm_known else None,
        covariance=pairs,
        full_output=None if data.kind == "speed" else 1.0,
    )
