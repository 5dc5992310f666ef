"""Findings on a fit of motor physics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95, minus
from rotorid.fits.motors.errors import CURVE_SHARE
from rotorid.fits.motors.fit import last_move, physical_contradictions
from rotorid.fits.motors.fitted import FittedMotors
from rotorid.fits.motors.loads import judge_loads
from rotorid.fits.motors.motion import CHANNELS, unexplained_by_curve
from rotorid.fits.remarks import judge_parameters
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, excited_axes
from rotorid.fitting.motors.inertia import compare_regressions
from rotorid.fitting.motors.translation import DRAG
from rotorid.models.motors import (
    DELAYS,
    SPIN_UP,
    TERMS_OF_CURVE,
    YAW_DELAY,
    check_figure_of_merit,
    scale_of,
    yaw_range,
)
from rotorid.settings.motors import MotorSettings

_GOOD_PERCENT = 50.0
"""Of the motion of an axis: where motors explain less, that is remarked on."""

_OPPOSED = 0.6
"""Correlation of motors and motion against each other, beyond which the layout is another one."""

_LEAST_LEAD_S = 0.001
"""Lead of a sensor that clocks of logs have among themselves."""

_DOUBTFUL = 0.2
"""Share of what a curve of thrust leaves that follows the outputs all the same, from which the curve is doubted."""


def judge_motors(
    identified: FittedMotors, choices: MotorSettings, fit_percent: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Remarks on what was excited, what stays undetermined, and what physics does not allow."""
    return (
        *identified.left_out,
        *(
            disagreement.finding(identified.parameters[disagreement.parameter].unit)
            for disagreement in identified.disagreeing
        ),
        *_unexcited(identified),
        *_never_leant(identified),
        *_turned_around(identified),
        *_assumed(identified),
        *_ahead(identified),
        *judge_loads(identified.logs, identified.voltage),
        *_doubted(identified, choices),
        *unused_choices(choices.known, identified.parameters.names),
        *_scale(identified, choices),
        *_arm(identified),
        *_yaw(identified),
        *_yaw_besides_torque(identified),
        *physical_contradictions(identified, choices),
        *_merit(identified, choices),
        *compare_regressions(identified.both),
        *_ended(identified),
        *_parameter_remarks(identified),
        *_poor(identified, fit_percent),
    )


def _unexcited(identified: FittedMotors) -> Iterator[Finding]:
    excited = excited_axes(identified.fit.excitations)
    missing = [axis for axis in AXIS_WORDS if axis not in (*identified.axes, *excited)]
    if not missing:
        return
    best = {axis: max(excitations[axis].correlation for excitations in identified.fit.excitations) for axis in missing}
    words = " and ".join(f"{best[axis]:.2f} in {AXIS_WORDS[axis]}" for axis in missing)
    yield warn(
        "no_excitation",
        ", ".join(AXIS_WORDS[axis] for axis in missing),
        f"Not enough data for {' and '.join(AXIS_WORDS[axis] for axis in missing)}: the correlation of motors "
        f"and motion is {words} ({LEAST_CORRELATION:g} needed). Without excitation the motors show the "
        "controller, not the vehicle. Fly a sweep or doublets on these axes.",
        **{AXIS_WORDS[axis]: correlation for axis, correlation in best.items()},
    )


def _never_leant(identified: FittedMotors) -> Iterator[Finding]:
    """Level axes along which velocity is known, and tilt does not explain it."""
    for axis, name in DRAG.items():
        shown = [record[axis].correlation for record in identified.fit.excitations if axis in record]
        if shown and max(shown) < LEAST_CORRELATION:
            yield remark(
                "no_excitation",
                name,
                f"Not enough data for {name}: the correlation of tilt and acceleration {_WAYS[axis]} is "
                f"{max(shown):.2f} ({LEAST_CORRELATION:g} needed). Fly back and forth, in tilts of several seconds.",
                correlation=max(shown),
            )


_WAYS: Mapping[str, str] = {"x": "forward", "y": "to the right"}


def _turned_around(identified: FittedMotors) -> Iterator[Finding]:
    """Axes along which the motors act against their levers, where the order of the rotors did not answer that."""
    known = [finding for finding in identified.data.findings if finding.kind == "rotor_order"]
    answered = {*(("p", "q") if known else ()), *(("r",) if any(f.severity == "warning" for f in known) else ())}
    for axis, word in AXIS_WORDS.items():
        lowest = min(excitations[axis].opposed for excitations in identified.fit.excitations)
        if axis not in (*identified.axes, *answered) and lowest <= -_OPPOSED:
            yield warn(
                "rotor_layout",
                word,
                f"Motors and {word} motion have a correlation of {lowest:.2f}: the positions, numbers or spin "
                f"directions of the motors differ from {identified.data.layout.name}. Name the layout with "
                "--layout.",
                correlation=lowest,
            )


def _assumed(identified: FittedMotors) -> Iterator[Finding]:
    if not identified.curve_assumed:
        return
    reason = (
        "Thrust changed, but did not follow the measured speeds; inertia depends on the slope of the "
        f"{identified.curve} curve. "
        if identified.data.kind == "speed"
        else f"Thrust did not change, so a {identified.curve} thrust curve was assumed; inertia depends on its slope. "
    )
    yield warn(
        "assumed_curve",
        "thrust",
        f"{reason}The errors of thrust and inertia include {100.0 * CURVE_SHARE:.0f} % for that. Fly a throttle sweep "
        "in hover, or give the known curve with --curve.",
        share=CURVE_SHARE,
    )


def _ahead(identified: FittedMotors) -> Iterator[Finding]:
    """Sensors that would show motion before it happens."""
    for name in DELAYS:
        if name not in identified.bounds.names:
            continue
        value_s, std_s = identified.parameters[name].value, identified.bounds.random_stds[name]
        if value_s < -TWO_SIDED_95 * std_s and value_s < -_LEAST_LEAD_S:
            yield warn(
                "tie_contradicted",
                name,
                f"{name} = {minus(f'{1e3 * value_s:.1f}')} ms: no sensor shows motion before it happens. The filter in "
                "the log, or the time stamps of motors and sensors, are off by at least as much; the errors of lag "
                "and delay include that.",
                delay_s=value_s,
                std_s=std_s,
            )


def _doubted(identified: FittedMotors, choices: MotorSettings) -> Iterator[Finding]:
    """A curve that was named and leaves of the specific force what another curve would explain."""
    if choices.curve in ("auto", "polynomial") or "az" not in identified.axes:
        return
    share = unexplained_by_curve(identified.fit.problem, identified.fit.solution.theta, identified.fit.excitations)
    if share < _DOUBTFUL:
        return
    yield warn(
        "assumed_curve",
        "thrust",
        f"The {identified.curve} thrust curve does not fit: {100.0 * share:.0f} % of the unexplained specific "
        "force still follows the outputs. Inertia, which depends on its slope, is wrong too. Leave --curve out, "
        "or use --curve polynomial.",
        share=share,
    )


def unused_choices(known: Mapping[str, float], used: Sequence[str]) -> Iterator[Finding]:
    """Values that were given and are in no equation that was fitted."""
    names = [name for name in known if name not in used]
    if names:
        yield warn(
            "unused_choice",
            ", ".join(names),
            f"{' and '.join(names)} {'was' if len(names) == 1 else 'were'} given but not used: the logs do not "
            "excite it.",
        )


def _scale(identified: FittedMotors, choices: MotorSettings) -> Iterator[Finding]:
    if scale_of(choices.known, identified.axes) is not None:
        return
    yield scale_finding("thrust and inertia", ", or a thrust from a bench")


def scale_finding(what: str, otherwise: str = "") -> Finding:
    """That nobody weighed the vehicle, so that numbers are per kilogram."""
    return warn(
        "not_identifiable",
        "m",
        f"Accelerations determine only ratios of mass, thrust and inertia: {what} are for a vehicle "
        f"of 1 kg and scale with its mass. Weigh it and give --fix m=KILOGRAMS{otherwise}.",
    )


def _arm(identified: FittedMotors) -> Iterator[Finding]:
    if identified.data.layout.arm_known or not {"p", "q"} & set(identified.axes):
        return
    yield warn(
        "not_identifiable",
        "I_xx, I_yy",
        "The log does not show the size of the vehicle: I_xx and I_yy are for an arm of 1 m and scale with its "
        "length. Measure from the center to the farthest rotor and give --arm METERS.",
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
            f"I_zz cannot exceed I_xx + I_yy = {inertia.high:.4g} kg m^2, so kappa is at most {torque.high:.4g} "
            "m; a flat vehicle comes close to both. "
        )
        numbers |= {"I_zz_at_most": inertia.high, "kappa_at_most": torque.high}
    yield remark(
        "not_identifiable",
        "kappa, I_zz",
        f"Yaw determines only kappa over I_zz, {ratio:.4g} 1/(kg m). {bound}{known}",
        **numbers,
    )


def _yaw_besides_torque(identified: FittedMotors) -> Iterator[Finding]:
    """Findings on yaw: rotors that speed up, and a delay other than that of roll and pitch."""
    parameters = identified.parameters
    if SPIN_UP in parameters.free:
        value = parameters[SPIN_UP].value
        lead_s = value / (parameters["kappa_per_I_zz"].value * identified.derived["thrust_slope"].value)
        speeds = identified.data.kind == "speed"
        of_one = (
            f"{value:.3g} of the speed gained by one"
            if speeds
            else (f"{value:.3g} rad/s for a rotor from standstill to full output")
        )
        yield remark(
            "spin_up",
            SPIN_UP,
            f"Accelerating rotors turn the vehicle too, by {of_one}: above {1.0 / lead_s:.2g} rad/s this moves "
            "yaw more than rotor torque does.",
            lead_s=lead_s,
            **({"share": value} if speeds else {"rad_s": value}),
        )
    if YAW_DELAY in parameters.free and "tau_gyro" in parameters.names:
        own_s, other_s = parameters[YAW_DELAY].value, parameters["tau_gyro"].value
        yield remark(
            "delay_of_yaw",
            YAW_DELAY,
            f"Yaw lags by {1e3 * own_s:.3g} ms, roll and pitch by {1e3 * other_s:.3g} ms. Axes of one gyro have "
            "the same delay, so the model lacks something that turns the vehicle, or the axes come from "
            "different sensors.",
            yaw_s=own_s,
            roll_pitch_s=other_s,
        )


def _parameter_remarks(identified: FittedMotors) -> Iterator[Finding]:
    """Guidelines of single parameters; coefficients of one curve trade against each other, and their sum counts."""
    for finding in judge_parameters(identified.parameters, identified.bounds):
        if not (identified.curve == "polynomial" and finding.where in TERMS_OF_CURVE["polynomial"]):
            yield finding


def _merit(identified: FittedMotors, choices: MotorSettings) -> list[Finding]:
    """The figure of merit of the rotors, where their speed was measured and their size is known."""
    data = identified.data
    weighed = scale_of(choices.known, identified.axes) is not None
    if data.kind != "speed" or choices.rotor_diameter_m is None or not weighed:
        return []
    return check_figure_of_merit(
        identified.parameters.values,
        speed_rad_s=identified.hover_output,
        load_factor=identified.load_factor,
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
                f"{name} reached its bound, {value:g} {fit.parameters[name].unit}, and was fixed there.",
                value=value,
            )
    if identified.data.kind != "speed" and "T_motor" not in identified.parameters.names:
        both = "; tau_gyro contains both" if "tau_gyro" in identified.parameters.names else ""
        yield remark(
            "lag_plus_delay", "T_motor", f"The data do not separate a motor lag from zero, or from a delay{both}."
        )
    if not fit.settled:
        moved = last_move(identified)
        yield warn(
            "not_converged",
            "physical.motors",
            f"Values and noise color still changed by {moved:.2g} standard deviations after {fit.rounds} rounds.",
            moved=moved,
        )


def _poor(identified: FittedMotors, fit_percent: Mapping[str, float]) -> Iterator[Finding]:
    for name, percent in fit_percent.items():
        if percent < _GOOD_PERCENT:
            cause = "Thrust and tilt" if name in map(CHANNELS.get, DRAG) else "The motors"
            message = f"{cause} explain only {percent:.0f} % of {name} {identified.band_words(name)}."
            yield warn("poor_fit", name, message, fit_percent=percent)
