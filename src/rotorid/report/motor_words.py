"""What a fit of ``physical.motors`` found, rests on and leaves open, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

from rotorid.data.channel import LOWEST_RATE_HZ
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.motor_document import MotorsDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import milliseconds, significant, with_error

AXIS_WORDS = {"az": "thrust", "p": "roll", "q": "pitch", "r": "yaw"}
"""Axes of the excitations in words."""

FULL_OUTPUT = 0.99
"""From here on full output was flown."""

_INERTIAS = {"I_xx": "p", "I_yy": "q", "I_zz": "r"}
_POOR_PERCENT = 0.0


def motor_sentences(document: ResultDocument) -> tuple[str, ...]:
    """Inertia, thrust and lag in numbers, and a scale that was assumed; empty for other models.

    Parameters
    ----------
    document
        The result.
    """
    motors = document.motors
    if motors is None:
        return ()
    assumed = scale_sentence(document) if motors.scale is None else ""
    told = (_inertia(document, motors), _thrust(motors), _lag(document, motors), assumed)
    return tuple(sentence for sentence in told if sentence)


def _inertia(document: ResultDocument, motors: MotorsDocument) -> str:
    parts = [
        f"{name} {with_error(one.value, one.std)}"
        for name in _INERTIAS
        if (one := document.parameters.get(name)) is not None and one.status in ("free", "tied")
    ]
    return f"Inertia: {', '.join(parts)} kg m²{_per(motors)}." if parts else ""


def _per(motors: MotorsDocument) -> str:
    per = [*([] if motors.scale else ["kilogram of mass"]), *([] if motors.arm_m else ["meter of arm"])]
    return f" per {' and '.join(per)}" if per else ""


def _thrust(motors: MotorsDocument) -> str:
    found = motors.derived
    beyond = "" if motors.flown_outputs[1] >= FULL_OUTPUT else " (extrapolated)"
    parts = [
        f"{with_error(found[name].value, found[name].std)} N {where}"
        for name, where in (("thrust_hover", "near hover"), ("thrust_full", f"at full output{beyond}"))
        if name in found
    ]
    if not parts:
        return ""
    ratio = found.get("thrust_to_weight")
    over = f", {with_error(ratio.value, ratio.std)} times its share of the weight" if ratio else ""
    return f"Thrust of a rotor: {' and '.join(parts)}{over}{'' if motors.scale else ', for a vehicle of 1 kg'}."


def _lag(document: ResultDocument, motors: MotorsDocument) -> str:
    lag = document.parameters.get("T_motor")
    if lag is None:
        return "" if motors.outputs == "speed" else f"Motor lag: {no_lag(document)}."
    return f"Motor lag: {milliseconds(lag.value, lag.std)} ms{' (given)' if lag.status == 'fixed' else ''}."


def no_lag(document: ResultDocument) -> str:
    """What a fit without a motor lag says of it.

    Parameters
    ----------
    document
        A result that has no ``T_motor``.
    """
    delay = document.parameters.get("tau_gyro")
    if delay is None:
        return "not told from none, or from a delay"
    return "none is seen, nor a delay" if delay.value == 0.0 else "not told from none, or from the delay tau_gyro"


def scale_sentence(document: ResultDocument) -> str:
    """What the scale of mass, thrust and inertia rests on; empty for other models.

    Parameters
    ----------
    document
        The result.
    """
    motors = document.motors
    if motors is None:
        return ""
    if motors.scale is None:
        return (
            "No mass, thrust or inertia was given, and accelerations tell their ratios alone: the numbers are those of "
            "a vehicle of 1 kg, to be multiplied with its mass."
        )
    mass = document.parameters.get("m") if motors.scale == "m" else None
    what = f"mass of {significant(mass.value, digits=4)} kg" if mass else motors.scale
    others = "thrust and inertia are" if motors.scale == "m" else "mass, thrust and inertia are"
    return f"The given {what} sets the scale: {others} off by the percent that it is off."


def open_questions(document: ResultDocument) -> tuple[str, ...]:
    """What stays undetermined and why, a sentence each."""
    return tuple(_open(document, document.motors)) if document.motors else ()


def _open(document: ResultDocument, motors: MotorsDocument) -> Iterator[str]:
    quiet = [axis for axis in AXIS_WORDS if not any(axis in one.counted for one in motors.excitation)]
    if turns := [AXIS_WORDS[axis] for axis in quiet if axis != "az"]:
        yield f"Inertia and damping of {_listed(turns)}: no stretch excites that. Fly a sweep or doublets."
    if "az" in quiet:
        yield "The curve of thrust: no stretch excites thrust, and it rests on the weight and the other axes alone."
    if motors.scale is None:
        yield "The scale of mass, thrust and inertia: weigh the vehicle and give --fix m=KILOGRAMS."
    if motors.arm_m is None and {"I_xx", "I_yy"} & set(document.parameters):
        yield (
            "The size of the vehicle: I_xx and I_yy are those of an arm of 1 m. Measure from the center to the "
            "farthest rotor and give --arm METERS."
        )
    if "kappa_per_I_zz" in document.parameters and "I_zz" not in document.parameters:
        yield (
            "The yaw inertia I_zz and the torque constant kappa apart: yaw tells their ratio alone. Give "
            "--fix kappa=METERS from a bench, or --fix I_zz=VALUE."
        )
    if motors.outputs != "speed" and "T_motor" not in document.parameters:
        yield f"The lag of the motors: {no_lag(document)}."
    if "thrust_full" in motors.derived and motors.flown_outputs[1] < FULL_OUTPUT and motors.curve != "linear":
        yield (
            f"Thrust beyond an output of {significant(motors.flown_outputs[1], digits=2)}: nothing was flown there, "
            "and full thrust is extrapolated."
        )


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def motor_warnings(document: ResultDocument) -> tuple[str, ...]:
    """What makes the numbers rough: motors that were logged too slowly, a fit that did not rest, motion left over."""
    return tuple(_warnings(document, document.motors)) if document.motors else ()


def _warnings(document: ResultDocument, motors: MotorsDocument) -> Iterator[str]:
    if motors.outputs_rate_hz < LOWEST_RATE_HZ:
        yield (
            f"The motors are known only {significant(motors.outputs_rate_hz, digits=2)} times a second, and at least "
            f"{LOWEST_RATE_HZ:.0f} are needed: what they did in between is not in the log. Take these numbers as rough "
            "values; their ± includes what the gaps may hide."
        )
    rates = [one.sample_rate_hz for one in motors.excitation if one.counted]
    if rates and min(rates) < LOWEST_RATE_HZ:
        yield f"Rates or accelerations were logged at {significant(min(rates), digits=3)} Hz, too slowly as well."
    if any(finding.kind == "not_converged" for finding in document.findings):
        yield "The fit did not come to rest."
    worse = [quantity(name).words for name, percent in (document.fit_percent or {}).items() if percent <= _POOR_PERCENT]
    if worse:
        yield f"Of {', '.join(worse)} the motors explain nothing: do not use what was identified from it."


def method_sentences(document: ResultDocument) -> tuple[str, ...]:
    """How the values were found; empty for other models."""
    motors = document.motors
    if motors is None:
        return ()
    return (*_methods(motors), _between(motors))


def _methods(motors: MotorsDocument) -> Iterator[str]:
    counted = {axis for one in motors.excitation for axis in one.counted}
    if counted - {"az"}:
        yield (
            "Prediction error: from sample to sample the motors predict how the rates change. The autoregressions that "
            "whiten the errors of that were estimated by turns with the values, so that a controller that answers to "
            "noise does not bias them."
        )
    if "az" in counted:
        yield "Errors of the specific force were squared as they are; their color counts in the uncertainty."
    yield "A stretch counts for an axis where its motors explain the slow motion; its mean force counts as weight."


def _between(motors: MotorsDocument) -> str:
    if motors.outputs == "speed":
        return "Measured speeds were joined by straight lines between their samples."
    return "Outputs were held between their samples, as motors are told them."
