"""What an engineer remarks on the physics of motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rotorid.data.findings import Finding
from rotorid.fit.motor_both_ways import judge_both_ways
from rotorid.fit.motor_excitation import LEAST_CORRELATION
from rotorid.models.motor_constants import check_figure_of_merit, check_motor_constants, yaw_range
from rotorid.models.motor_parameters import CURVE_TERMS, scale_of
from rotorid.pipeline.judge import judge_parameters
from rotorid.pipeline.motor_choices import MotorChoices
from rotorid.pipeline.motor_fitting import AXIS_WORDS, MotorIdentified, levers_of
from rotorid.pipeline.motor_motion import unexplained_by_curve
from rotorid.pipeline.motor_uncertainty import CURVE_SHARE
from rotorid.uncertainty.propagation import covariance_of_all

_GOOD_PERCENT = 50.0
_OPPOSED = 0.6
_DOUBTFUL = 0.2


def judge_motors(
    identified: MotorIdentified, choices: MotorChoices, fit_percent: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Remarks on what was excited, what stays undetermined, and what physics does not allow."""
    return (
        *_unexcited(identified),
        *_turned_around(identified),
        *_assumed(identified),
        *_doubted(identified, choices),
        *_unused(identified, choices),
        *_scale(identified, choices),
        *_arm(identified),
        *_yaw(identified),
        *_physics(identified, choices),
        *_merit(identified, choices),
        *judge_both_ways(identified.both),
        *_ended(identified),
        *_parameters(identified),
        *_poor(fit_percent),
    )


def _unexcited(identified: MotorIdentified) -> Iterator[Finding]:
    missing = [axis for axis in AXIS_WORDS if axis not in identified.axes]
    if not missing:
        return
    best = {axis: max(one[axis].correlation for one in identified.fit.excitations) for axis in missing}
    words = " and ".join(f"{AXIS_WORDS[axis]} ({best[axis]:.2f})" for axis in missing)
    yield Finding(
        kind="no_excitation",
        severity="warning",
        where=", ".join(AXIS_WORDS[axis] for axis in missing),
        message=(
            f"Nothing was identified of {words}: so far do motors and motion go together there, and "
            f"{LEAST_CORRELATION:g} is needed, or the motors explain nothing of it. Where a controller only answers "
            "gusts and noise, motors show the controller. Fly a sweep or doublets on these axes."
        ),
        numbers={AXIS_WORDS[axis]: correlation for axis, correlation in best.items()},
    )


def _turned_around(identified: MotorIdentified) -> Iterator[Finding]:
    """Axes along which the motors act against their levers."""
    for axis, word in AXIS_WORDS.items():
        lowest = min(one[axis].opposed for one in identified.fit.excitations)
        if axis not in identified.axes and lowest <= -_OPPOSED:
            yield Finding(
                kind="rotor_layout",
                severity="warning",
                where=word,
                message=(
                    f"Motors and {word} motion go together with a correlation of {lowest:.2f}: the motors do not "
                    f"stand, are not numbered, or do not turn as {identified.data.layout.name} has them. Name the "
                    "layout with --layout."
                ),
                numbers={"correlation": lowest},
            )


def _assumed(identified: MotorIdentified) -> Iterator[Finding]:
    if not identified.curve_assumed:
        return
    yield Finding(
        kind="assumed_curve",
        severity="warning",
        where="thrust",
        message=(
            f"Thrust was not moved, so that its curve is not seen: a {identified.curve} one is assumed, and inertia "
            f"follows its slope. The deviations of thrust and inertia hold {100.0 * CURVE_SHARE:.0f} % for that. Fly a "
            "sweep of the throttle, or say with --curve what is known of the motors."
        ),
        numbers={"share": CURVE_SHARE},
    )


def _doubted(identified: MotorIdentified, choices: MotorChoices) -> Iterator[Finding]:
    """A curve that was named and leaves of the specific force what another curve would explain."""
    if choices.curve in ("auto", "polynomial") or "az" not in identified.axes:
        return
    share = unexplained_by_curve(identified.fit.problem, identified.fit.solution.theta, identified.fit.excitations)
    if share < _DOUBTFUL:
        return
    yield Finding(
        kind="assumed_curve",
        severity="warning",
        where="thrust",
        message=(
            f"{100.0 * share:.0f} % of what the {identified.curve} curve of thrust leaves of the specific force "
            "follows the outputs in another way: the curve is another one, and inertia follows its slope. Leave "
            "--curve out, or give --curve polynomial."
        ),
        numbers={"share": share},
    )


def _unused(identified: MotorIdentified, choices: MotorChoices) -> Iterator[Finding]:
    names = [name for name in choices.known if name not in identified.parameters.names]
    if names:
        yield Finding(
            kind="unused_choice",
            severity="warning",
            where=", ".join(names),
            message=f"{' and '.join(names)} {'was' if len(names) == 1 else 'were'} given and used nowhere: what the "
            "logs excite does not show it.",
        )


def _scale(identified: MotorIdentified, choices: MotorChoices) -> Iterator[Finding]:
    if scale_of(choices.known, identified.axes) is not None:
        return
    yield Finding(
        kind="not_identifiable",
        severity="warning",
        where="m",
        message=(
            "Accelerations tell ratios of mass, thrust and inertia alone: thrust and inertia are those of a vehicle of "
            "1 kg, to be multiplied with its mass. Weigh it and give --fix m=KILOGRAMS, or a thrust from a bench."
        ),
    )


def _arm(identified: MotorIdentified) -> Iterator[Finding]:
    if identified.data.layout.arm_known or not {"p", "q"} & set(identified.axes):
        return
    yield Finding(
        kind="not_identifiable",
        severity="warning",
        where="I_xx, I_yy",
        message=(
            "The log does not tell the size of the vehicle: I_xx and I_yy are those of an arm of 1 m, to be multiplied "
            "with its length. Measure from the center to the farthest rotor and give --arm METERS."
        ),
    )


def _yaw(identified: MotorIdentified) -> Iterator[Finding]:
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
    yield Finding(
        kind="not_identifiable",
        severity="info",
        where="kappa, I_zz",
        message=f"Yaw tells kappa over I_zz alone, {ratio:.4g} 1/(kg m). {bound}{known}",
        numbers=numbers,
    )


def _parameters(identified: MotorIdentified) -> Iterator[Finding]:
    """Guidelines of single parameters; coefficients of one curve trade against each other, and their sum counts."""
    for finding in judge_parameters(identified.parameters, identified.bounds):
        if not (identified.curve == "polynomial" and finding.where in CURVE_TERMS["polynomial"]):
            yield finding


def _physics(identified: MotorIdentified, choices: MotorChoices) -> list[Finding]:
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


def _merit(identified: MotorIdentified, choices: MotorChoices) -> list[Finding]:
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


def _ended(identified: MotorIdentified) -> Iterator[Finding]:
    fit = identified.fit
    for name in fit.parameters.free:
        if name not in fit.moving:
            value = fit.parameters[name].value
            yield Finding(
                kind="parameter_at_bound",
                severity="info" if value == 0.0 else "warning",
                where=name,
                message=f"{name} went to its bound, {value:g} {fit.parameters[name].unit}, and is held there.",
                numbers={"value": value},
            )
    if identified.data.kind != "speed" and "T_motor" not in identified.parameters.names:
        yield Finding(
            kind="lag_plus_delay",
            severity="info",
            where="T_motor",
            message="The data do not tell a motor lag from none, or from a delay; tau_gyro stands for both.",
        )
    if not fit.settled:
        yield Finding(
            kind="not_converged",
            severity="warning",
            where="physical.motors",
            message=f"Values and color of the errors still moved after {fit.rounds} rounds.",
        )


def _poor(fit_percent: Mapping[str, float]) -> Iterator[Finding]:
    for name, percent in fit_percent.items():
        if percent < _GOOD_PERCENT:
            yield Finding(
                kind="poor_fit",
                severity="warning",
                where=name,
                message=f"The motors explain {percent:.0f} % of {name} up to 5 Hz.",
                numbers={"fit_percent": percent},
            )
