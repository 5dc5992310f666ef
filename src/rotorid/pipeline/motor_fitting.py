"""From records of motors to physical parameters with bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError
from rotorid.fit.motor_both_ways import BothWays, both_ways
from rotorid.fit.motor_excitation import LEAST_CORRELATION, Excitation, excitations
from rotorid.fit.motor_fit import MotorFit, excited_axes, fit_motors
from rotorid.fit.motor_problem import MotorProblem
from rotorid.models.motor_parameters import Curve, motor_parameters
from rotorid.models.parameter import ParameterSet
from rotorid.pipeline.motor_choices import MotorChoices
from rotorid.pipeline.motor_motion import CHANNELS, fit_percents, motions
from rotorid.pipeline.motor_records import MotorData
from rotorid.pipeline.motor_uncertainty import motor_bounds, with_systematic_errors
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Bounds
from rotorid.units import STANDARD_GRAVITY_M_S2

_EXPLAINED_BY_SLOW = 50.0
"""Percent of an axis that motors logged too slowly must explain to count."""

_STAMPS_S = 0.01
"""Errors of stamps, and of the rate at which a filter is taken to work, stay below."""

AXIS_WORDS = {"az": "thrust", "p": "roll", "q": "pitch", "r": "yaw"}


class Derived(NamedTuple):
    """A quantity that follows from the parameters."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorIdentified(Immutable):
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
    """

    data: MotorData
    fit: MotorFit
    curve: Curve
    curve_assumed: bool
    parameters: ParameterSet
    bounds: Bounds
    memory: int
    both: tuple[BothWays, ...]
    hover_output: float
    derived: Mapping[str, Derived]

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that some stretch excites."""
        return tuple(axis for axis in self.fit.problem.axes if axis != "weight")


def levers_of(data: MotorData) -> FloatArray:
    """Roll, pitch and yaw moment of a newton of each rotor, shape ``(3, motors)``."""
    arms, torque = data.layout.moment_arms, data.layout.torque_axes
    return np.stack([arms[0], arms[1], torque[2]])


def fit_motor_data(
    data: MotorData, choices: MotorChoices, progress: Callable[[str], None] = lambda _: None
) -> MotorIdentified:
    """Fit what was excited, and bound it.

    Axes of which the motors then explain nothing are left out: what was seen there was the controller, or motors that
    were logged too slowly. So is a motor lag that the data do not tell from zero, or from a delay. Then the rest is
    fitted again.

    Raises
    ------
    InsufficientDataError
        The motors explain the motion along no axis, or the data do not determine all parameters.
    """
    levers = levers_of(data)
    found = excitations(data.records, levers)
    axes = excited_axes(found)
    if not axes:
        raise _nothing_excited(data, found)
    fit, curve = _fitted(data, choices, levers, axes, progress)
    unexplained = _unexplained(fit, data)
    if unexplained:
        left = tuple(axis for axis in axes if axis not in unexplained)
        if not left:
            raise _nothing_explained(data)
        fit, curve = _fitted(data, choices, levers, left, progress)
    parameters = fit.parameters
    for name in set(parameters.free) - set(fit.moving):
        parameters = parameters.fix(name, parameters[name].value)
    bounds, memory = motor_bounds(fit)
    # The weight tells thrust at hover whatever the curve is; its slope is another matter.
    at_hover = with_systematic_errors(bounds, parameters, fit, data, curve_assumed=False)
    assumed = choices.curve == "auto" and "az" not in fit.problem.axes and not data.straightened
    bounds = with_systematic_errors(bounds, parameters, fit, data, curve_assumed=assumed and data.kind != "speed")
    hover = float(np.mean([record.outputs.mean() for record in data.records]))
    return MotorIdentified(
        data=data,
        fit=fit,
        curve=curve,
        parameters=parameters,
        bounds=bounds,
        memory=memory,
        curve_assumed=assumed and data.kind != "speed",
        both=both_ways(fit),
        hover_output=hover,
        derived=_derived(parameters, bounds, at_hover, hover, data),
    )


def _fitted(
    data: MotorData,
    choices: MotorChoices,
    levers: FloatArray,
    axes: tuple[str, ...],
    progress: Callable[[str], None],
) -> tuple[MotorFit, Curve]:
    """The fit of some axes, with a motor lag where the data tell one."""
    curve = _curve(choices, data, axes)

    def fitted(lag: bool) -> MotorFit:
        parameters = motor_parameters(
            curve=curve,
            known=choices.known,
            axes=axes,
            lag=lag,
            heave_damping=all(record.w.size > 0 for record in data.records),
            earliest_s=-_STAMPS_S if any(record.gyro_taps.size > 1 for record in data.records) else 0.0,
        )
        problem = MotorProblem(records=data.records, levers=levers, parameters=parameters, axes=("weight", *axes))
        return fit_motors(problem, progress=progress)

    progress("fitting motors, thrust and inertia")
    fit = fitted(data.kind != "speed")
    if _lag_unseen(fit):
        fit = fitted(False)
    return fit, curve


def _unexplained(fit: MotorFit, data: MotorData) -> set[str]:
    """Axes of which the identified motors explain nothing, although both moved together."""
    moved = motions(fit.problem, fit.solution.theta, data.flights, fit.excitations)
    channels = {CHANNELS[axis]: axis for axis in fit.problem.axes if axis in CHANNELS}
    least = _EXPLAINED_BY_SLOW if data.slow else 0.0
    return {channels[name] for name, percent in fit_percents(moved, list(channels)).items() if percent <= least}


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


def _nothing_explained(data: MotorData) -> InsufficientDataError:
    names = ", ".join(dict.fromkeys(record.name for record in data.records))
    slow = [one for one in data.findings if one.kind == "rate_too_low"]
    message = f"The motors of {names} move with the vehicle, and explain less than half of its motion along every axis"
    return InsufficientDataError(
        message if data.slow else message.replace("less than half", "nothing"),
        needed="motor outputs logged faster than the motors answer, 40 Hz and more",
        remedy=slow[0].message if slow else "look at the layout of the rotors and at the stamps of the log",
        findings=[Finding(kind="poor_fit", severity="error", where=names, message=f"{message}."), *data.findings],
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
            Finding(kind="no_excitation", severity="error", where=names, message=f"{message}.", numbers=best),
            *data.findings,
        ],
    )


def _derived(
    parameters: ParameterSet, bounds: Bounds, at_hover: Bounds, hover: float, data: MotorData
) -> dict[str, Derived]:
    """Thrust at hover, its slope, and what the rotors give at full output."""

    def of_curve(terms: Mapping[str, float], unit: str, limits: Bounds = bounds) -> Derived:
        value = sum(parameters[name].value * factor for name, factor in terms.items() if name in parameters.names)
        return Derived(float(value), _std(limits, terms), unit)

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
    found["thrust_to_weight"] = Derived(full / weight, _std(bounds, gradient), "1")
    return found


def _std(bounds: Bounds, gradient: Mapping[str, float]) -> float:
    slopes = np.array([gradient.get(name, 0.0) for name in bounds.names])
    return float(np.sqrt(slopes @ bounds.covariance @ slopes))
