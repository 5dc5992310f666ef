"""What numbers mean, in plain words and by the guidelines of the field.

Sentences and verdicts for pages: on costs, fits and unseen maneuvers, on how a fit ended, on the poles of a model, on a
fit of ``physical.motors`` and on measured responses. Two small pictures go with them, of the poles and of the cost over
the steps of a fit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rotorid.data.axes import ANGLE_OF, AXIS_WORDS, RATE_OF
from rotorid.data.display import counted, listed
from rotorid.data.quantity import milliseconds, significant, unit, with_error
from rotorid.data.record import LOWEST_RATE_HZ
from rotorid.data.trust import EXCELLENT_COST
from rotorid.documents.result import ResultDocument
from rotorid.fitting.motors.excitation import SLOW_BAND_HZ, SLOW_HZ
from rotorid.plot.figure import quantity
from rotorid.plot.loops import s_plane
from rotorid.report.frame import Picture, drawn
from rotorid.results.summary import (
    METHODS,
    FitEnd,
    FitVerdict,
    FlightPhysics,
    ManeuverCheck,
    MotorPhysics,
    ParameterEstimate,
    PoleEstimate,
)
from rotorid.results.verdicts import (
    LEVEL_OF,
    NOT_IDENTIFIED,
    Level,
    Verdict,
    cost_verdict,
    fit_verdict,
    has_value,
    percent_level,
    refused_verdict,
)
from rotorid.verification.scores import GOOD_FIT_PERCENT, GOOD_TIC, GUIDELINES, guidelines_met
from rotorid.verification.verification import Scores
from rotorid.verification.verification import Verdict as Found

FULL_OUTPUT = 0.99
"""From here on full output was flown."""

_INERTIAS = {"I_xx": "p", "I_yy": "q", "I_zz": "r"}

_POOR_PERCENT = 0.0
"""Fit at which the motors explain nothing: the mean would do as well."""


def motor_sentences(document: ResultDocument) -> tuple[str, ...]:
    """Inertia, thrust and lag in numbers; empty for other models."""
    motors = document.motors
    if motors is None:
        return ()
    sentences = (_air(document), _inertia(document, motors), _thrust(motors), _lag(document, motors))
    return tuple(sentence for sentence in sentences if sentence)


def _air(document: ResultDocument) -> str:
    """Drag of the rotors and the error of force; empty where the air is not in the model."""
    flight = document.flight
    if flight is None:
        return ""
    drag = flight.hover.get("drag")
    words = f"Rotor drag: {with_error(drag.value, drag.std)} 1/s in hover. " if drag else ""
    unit_words = "N" if document.motors is not None and document.motors.scale else "N per kilogram"
    worst = significant(max(log.force_rms_n for log in flight.logs))
    return f"{words}Error of force: {worst} {unit_words} at airspeeds up to {flight.limits.edge_m_s[1]:.2g} m/s."


def _inertia(document: ResultDocument, motors: MotorPhysics) -> str:
    parts = [
        f"{name} {with_error(estimate.value, estimate.std)}"
        for name in _INERTIAS
        if (estimate := document.parameters.get(name)) is not None and estimate.status in ("free", "tied")
    ]
    return f"Inertia: {', '.join(parts)} kg m²{_per(motors)}." if parts else ""


def _per(motors: MotorPhysics) -> str:
    per = [*([] if motors.scale else ["kilogram of mass"]), *([] if motors.arm_m else ["meter of arm"])]
    return f" per {' and '.join(per)}" if per else ""


def _thrust(motors: MotorPhysics) -> str:
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


def _lag(document: ResultDocument, motors: MotorPhysics) -> str:
    lag = document.parameters.get("T_motor")
    if lag is None:
        return "" if motors.outputs == "speed" else f"Motor lag: {no_lag(document)}."
    word = {"fixed": " (given)", "assumed": " (assumed)"}.get(status_word(document, "T_motor"), "")
    return f"Motor lag: {milliseconds(lag.value, lag.std)} ms{word}."


def status_word(document: ResultDocument, name: str) -> str:
    """Status of a parameter: ``free``, ``fixed``, ``tied``, ``dropped``, ``assumed`` or ``not identified``."""
    if not has_value(name, document.parameters[name], document.findings):
        return NOT_IDENTIFIED
    status = document.parameters[name].status
    assumed = document.flight is not None and name in document.flight.missing
    return "assumed" if assumed and status in ("free", "fixed") else status


def no_lag(document: ResultDocument) -> str:
    """Why a fit has no motor lag.

    Parameters
    ----------
    document
        A result that has no ``T_motor``.
    """
    delay = document.parameters.get("tau_gyro")
    if delay is None:
        return "too short to separate from a delay"
    return "none found, and no delay either" if delay.value == 0.0 else "too short to separate from the delay tau_gyro"


def scale_sentence(document: ResultDocument) -> str:
    """Where the scale of mass, thrust and inertia is from; empty for other models."""
    motors = document.motors
    if motors is None:
        return ""
    if motors.scale is None:
        return (
            "No mass, thrust or inertia was given, and accelerations only show their ratios. Thrust and inertia "
            "assume a vehicle of 1 kg: multiply them by its mass."
        )
    mass = document.parameters.get("m") if motors.scale == "m" else None
    what = f"mass of {significant(mass.value, digits=4)} kg" if mass else motors.scale
    others = "thrust and inertia are" if motors.scale == "m" else "mass, thrust and inertia are"
    return f"The given {what} sets the scale: {others} wrong by the same percentage as it."


def open_questions(document: ResultDocument) -> tuple[str, ...]:
    """What this flight does not determine, and what to do, a sentence each."""
    return tuple(_open(document, document.motors)) if document.motors else ()


def _open(document: ResultDocument, motors: MotorPhysics) -> Iterator[str]:
    quiet = [axis for axis in AXIS_WORDS if not any(axis in flight.counted for flight in motors.excitation)]
    if turns := [AXIS_WORDS[axis] for axis in quiet if axis != "az"]:
        what = "Inertia and damping" if document.flight is None else "Inertia"
        yield f"{what} of {listed(turns)}: no segment excites it. Fly a sweep or doublets."
    if "az" in quiet:
        yield "Thrust curve: no segment excites thrust, so it is from the weight and the other axes. Sweep thrust."
    if motors.scale is None:
        yield "Scale of mass, thrust and inertia: weigh the vehicle and add --fix m=KILOGRAMS."
    if motors.arm_m is None and {"I_xx", "I_yy"} & set(document.parameters):
        yield (
            "Size of the vehicle: I_xx and I_yy assume an arm of 1 m. Measure from the center to the farthest rotor "
            "and add --arm METERS."
        )
    if "kappa_per_I_zz" in document.parameters and "I_zz" not in document.parameters:
        yield (
            "Yaw inertia I_zz and torque constant kappa: yaw only shows their ratio. Add --fix kappa=METERS from a "
            "test bench, or --fix I_zz=VALUE."
        )
    if motors.outputs != "speed" and "T_motor" not in document.parameters:
        yield f"Motor lag: {no_lag(document)}."
    if "thrust_full" in motors.derived and motors.flown_outputs[1] < FULL_OUTPUT and motors.curve != "linear":
        yield (
            f"Thrust above an output of {significant(motors.flown_outputs[1], digits=2)}: not flown, so full thrust "
            "is extrapolated."
        )


def motor_warnings(document: ResultDocument) -> tuple[str, ...]:
    """Why the numbers are rough: motors logged too slowly, a fit that did not converge, motion left over."""
    return tuple(_warnings(document, document.motors)) if document.motors else ()


def _warnings(document: ResultDocument, motors: MotorPhysics) -> Iterator[str]:
    if motors.outputs_rate_hz < LOWEST_RATE_HZ:
        yield (
            f"Motors were logged at {significant(motors.outputs_rate_hz, digits=2)} Hz; at least "
            f"{LOWEST_RATE_HZ:.0f} Hz are needed. Take these numbers as rough values; their ± includes the effect of "
            "the slow log."
        )
    rates = [flight.sample_rate_hz for flight in motors.excitation if flight.counted]
    if rates and min(rates) < LOWEST_RATE_HZ:
        yield f"Rates or accelerations were logged too slowly as well, at {significant(min(rates), digits=3)} Hz."
    if any(finding.kind == "not_converged" for finding in document.findings):
        yield "The fit did not converge."
    worse = [quantity(name).words for name, percent in (document.fit_percent or {}).items() if percent <= _POOR_PERCENT]
    if worse:
        yield f"The motors do not explain {listed(worse)}: do not use the values identified from it."


def method_sentences(document: ResultDocument) -> tuple[str, ...]:
    """How the values were estimated; empty for other models."""
    motors = document.motors
    if motors is None:
        return ()
    if document.flight is not None:
        return (*_flight_methods(document.flight), _between(motors))
    by = _absolute_errors() if document.method == "accelerations" else _methods(motors)
    return (*by, _between(motors))


def _flight_methods(flight: FlightPhysics) -> Iterator[str]:
    yield (
        "Force: least squares of the specific force on the terms of the model, whose inflow follows from momentum "
        "theory. A term is used where it lowers the error of data that were left out."
    )
    if flight.octaves:
        yield (
            "Inertia: only octaves in which the motors explain the angular acceleration, because the controller hides "
            "the torque of the motors elsewhere."
        )
    if flight.scatter is not None:
        yield "Uncertainty: blocks of two seconds within a flight, and the scatter between flights."


def _absolute_errors() -> Iterator[str]:
    yield (
        "Minimized absolute errors of accelerations up to 5 Hz, each relative to its deviations from the mean, as "
        "published for a genetic algorithm. Outliers count little; noise and gusts that the controller feeds back "
        "bias the values."
    )
    yield _COUNTED


def _methods(motors: MotorPhysics) -> Iterator[str]:
    counted = {axis for flight in motors.excitation for axis in flight.counted}
    if counted - {"az"}:
        yield (
            "Prediction error method: the motors predict the change of the rates from sample to sample. Noise models "
            "were estimated in turn with the values, so that a controller reacting to noise does not bias them."
        )
    if "az" in counted:
        yield "Specific force: least squares; correlated errors are included in the uncertainty."
    yield _COUNTED


def _between(motors: MotorPhysics) -> str:
    if motors.outputs == "speed":
        return "Motor speeds are interpolated linearly between samples."
    return "Motor outputs are constant between samples (zero-order hold)."


_COUNTED = "A segment is used for an axis where the motors explain its slow motion; its mean force counts as weight."


_STILL_RAD_S = 1e-9
"""A pole this near to the origin is an integrator but for rounding."""

_SURE_SIGMAS = 2.0
"""Standard deviations by which a mode must grow to be said to grow."""

_HOVERING = {"roll": ("v", "phi"), "pitch": ("u", "theta")}
"""States of the unstable oscillation of every hovering rotorcraft: it tilts, drifts, and is turned back too far."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PoleRow:
    """A mode of the model; a conjugate pair is one."""

    real: str
    imag: str
    frequency: str
    damping: str
    words: str
    unstable: bool


def pole_rows(poles: Sequence[PoleEstimate]) -> tuple[PoleRow, ...]:
    """One row for each mode, slow ones first; the lower pole of a conjugate pair is left out."""
    return tuple(
        PoleRow(
            real=with_error(pole.real, pole.real_std) if pole.real_std else significant(pole.real),
            imag=(with_error(pole.imag, pole.imag_std) if pole.imag_std else significant(pole.imag))
            if pole.imag
            else "0",
            frequency=with_error(pole.frequency_rad_s, pole.frequency_std_rad_s)
            if pole.frequency_std_rad_s
            else significant(pole.frequency_rad_s),
            damping=with_error(pole.damping, pole.damping_std)
            if pole.damping_std
            else significant(pole.damping, digits=2),
            words=pole_words(pole),
            unstable=grows(pole),
        )
        for pole in _modes(poles)
    )


def pole_words(pole: PoleEstimate) -> str:
    """How a mode moves: its time constant, or how fast it grows, and its oscillation.

    Examples
    --------
    >>> pole_words(PoleEstimate(real=-4.0, imag=0.0, damping=1.0, frequency_rad_s=4.0))
    'stable, time constant 0.25 s'
    """
    swing = f", oscillates at {significant(pole.frequency_rad_s)} rad/s" if pole.imag else ""
    if abs(pole.real) <= _STILL_RAD_S:
        return f"neither decays nor grows{swing}"
    if not _sure(pole):
        return f"{'decays' if pole.real < 0.0 else 'grows'} slowly, or not at all within 2 σ{swing}"
    if pole.real < 0.0:
        return f"stable, time constant {significant(-1.0 / pole.real)} s{swing}"
    return f"grows, doubling in {_doubling(pole)} s{swing}"


def grows(pole: PoleEstimate) -> bool:
    """Whether a mode grows for sure: by more than two standard deviations where one is known."""
    return pole.real > _STILL_RAD_S and _sure(pole)


def mode_sentences(document: ResultDocument) -> tuple[str, ...]:
    """Unstable modes; nothing where no mode is unstable for sure."""
    growing = [pole for pole in _modes(document.poles) if grows(pole)]
    swinging = [pole for pole in growing if pole.imag]
    hovering = [axis for axis, states in _HOVERING.items() if set(states) <= set(document.states)]
    axes = hovering or [axis for axis in RATE_OF if {RATE_OF[axis], ANGLE_OF[axis]} & set(document.states)]
    of = axes[0].capitalize() if len(axes) == 1 else "The vehicle"
    known = ", as usual for a multirotor without an autopilot" if hovering else ""
    sentences = []
    if len(swinging) == 1:
        (pole,) = swinging
        speed = significant(pole.frequency_rad_s)
        sentences.append(f"{of} is unstable: it oscillates at {speed} rad/s and doubles in {_doubling(pole)} s{known}.")
    elif swinging:
        fastest = max(swinging, key=lambda pole: pole.real)
        sentences.append(
            f"{len(swinging)} oscillations are unstable; the fastest doubles in {_doubling(fastest)} s{known}."
        )
    sentences += [
        f"One mode is unstable without oscillation and doubles in {_doubling(pole)} s."
        for pole in growing
        if not pole.imag
    ]
    return tuple(sentences)


def poles_sentence(poles: Sequence[PoleEstimate]) -> str:
    """How many poles there are and how many of them are unstable."""
    growing = sum(grows(pole) for pole in poles)
    return f"{counted(len(poles), 'pole')}, {growing or 'none'} unstable."


def poles_picture(poles: Sequence[PoleEstimate], *, key: str) -> Picture | None:
    """The poles in the plane of s; none where there are no finite poles."""
    finite = [pole for pole in poles if math.isfinite(pole.real) and math.isfinite(pole.imag)]
    if not finite:
        return None
    draw = partial(
        s_plane,
        np.array([complex(pole.real, pole.imag) for pole in finite]),
        std=np.array([_spread(pole) for pole in finite]),
        words=[f"{_value(pole)}<br>{pole_words(pole)}".replace("<br>", ": ") for pole in finite],
    )
    return Picture(
        key=key, description="Poles of the model in the complex plane, with their uncertainty", figure=drawn(draw)
    )


def _modes(poles: Sequence[PoleEstimate]) -> list[PoleEstimate]:
    return sorted((pole for pole in poles if pole.imag >= 0.0), key=lambda pole: pole.frequency_rad_s)


def _sure(pole: PoleEstimate) -> bool:
    return pole.real_std is None or abs(pole.real) > _SURE_SIGMAS * pole.real_std


def _doubling(pole: PoleEstimate) -> str:
    """Time in which the amplitude doubles: ln 2 over the real part."""
    return significant(math.log(2.0) / pole.real, digits=2)


def _spread(pole: PoleEstimate) -> complex:
    if pole.real_std is None or pole.imag_std is None:
        return complex(math.nan, math.nan)
    return complex(pole.real_std, pole.imag_std)


def _value(pole: PoleEstimate) -> str:
    sign = "−" if pole.imag < 0.0 else "+"
    return significant(pole.real) + (f" {sign} {significant(abs(pole.imag))} j" if pole.imag else "")


_LAG = "T_motor"
_GAINS = {
    "roll_command": ("Roll", "L_roll", "tau_roll"),
    "pitch_command": ("Pitch", "M_pitch", "tau_pitch"),
    "yaw_command": ("Yaw", "N_yaw", "tau_yaw"),
    "thrust_command": ("Thrust", "Z_thrust", "tau_thrust"),
}
_EFFECTS = {
    "L": "rolling moment",
    "M": "pitching moment",
    "N": "yawing moment",
    "X": "forward force",
    "Y": "side force",
    "Z": "vertical force",
}
_DELAYS = "delays and lags"
_MASSES = "mass, thrust and inertia"
_PHYSICAL = {
    "m": "mass",
    "I_xx": "roll inertia",
    "I_yy": "pitch inertia",
    "I_zz": "yaw inertia",
    "c_0": "thrust of a rotor at zero output",
    "c_1": "thrust of a rotor per output",
    "c_2": "thrust of a rotor per output squared",
    "kappa": "torque of a rotor per thrust",
    "kappa_per_I_zz": "torque per thrust, over yaw inertia",
    "h_per_I_zz": "angular momentum of a rotor over yaw inertia",
}
_LATE = {
    "tau_gyro": "delay from motor outputs to the gyros",
    "tau_gyro_yaw": "delay from motor outputs to the yaw gyro",
    "tau_accel": "delay from motor outputs to the accelerometer",
}
_FOUND: dict[Found, tuple[Level, str, str]] = {
    "good": ("good", "good", "predicted well"),
    "diverges": (
        "good",
        "good short-term, diverges in open loop",
        "predicted well over short times (the airframe is unstable, so the open loop diverges)",
    ),
    "disturbed": ("fair", "disturbed", "too disturbed to judge"),
    "poor": ("poor", "poor", "predicted poorly"),
}
"""Level, badge and words of what was found on a maneuver, the best first."""


def prediction_verdict(tic: float, fit_percent: float) -> Verdict:
    """Verdict on a prediction by both of its scores: a Theil coefficient up to 0.25 and a fit of 50 % and more.

    Good needs both. One alone is fair at most, and the words say which guideline was missed.

    Examples
    --------
    >>> prediction_verdict(0.06, 91.0).words, prediction_verdict(0.23, 41.0).words
    ('good', 'fit below the guideline')
    """
    met = guidelines_met(tic, fit_percent)
    if met == GUIDELINES:
        return Verdict("good", "good")
    if met == 0:
        return Verdict("poor", "TIC and fit outside the guideline")
    return Verdict("fair", "TIC above the guideline" if fit_percent >= GOOD_FIT_PERCENT else "fit below the guideline")


def percent_verdict(percent: float) -> Verdict:
    """Verdict on how much of an output a model explains: 50 % and more are good, below 0 % the mean would do better.

    Examples
    --------
    >>> percent_verdict(83.2)
    Verdict(level='good', words='83.2 %')
    """
    return Verdict(percent_level(percent), f"{percent:.1f} %")


def maneuver_verdict(found: Found) -> Verdict:
    """Verdict on an unseen maneuver as a badge.

    Examples
    --------
    >>> maneuver_verdict("disturbed")
    Verdict(level='fair', words='disturbed')
    """
    level, words, _ = _FOUND[found]
    return Verdict(level, words)


def worst_maneuver(maneuvers: Sequence[ManeuverCheck]) -> Verdict | None:
    """Verdict on the worst of several maneuvers, with how many are like it; ``None`` without any."""
    found = [check.verdict for check in maneuvers]
    worst = max(found, key=list(_FOUND).index, default=None)
    if worst is None:
        return None
    level, words, _ = _FOUND[worst]
    count = found.count(worst)
    return Verdict(level, words if count == len(found) else f"{count} of {len(found)} {words}")


def unseen_sentences(maneuvers: Sequence[ManeuverCheck]) -> tuple[str, ...]:
    """How the model did on unseen maneuvers: how many of each verdict, and the worst output in open loop."""
    found = [check.verdict for check in maneuvers]
    several = "1 maneuver" if len(found) == 1 else f"{len(found)} maneuvers"
    groups = [(found.count(kind), words) for kind, (_, _, words) in _FOUND.items() if kind in found]
    summary = groups[0][1] if len(groups) == 1 else ", ".join(f"{count} {words}" for count, words in groups)
    sentence = f"Unseen flight: {several}{' ' if len(groups) == 1 else ', '}{summary}."
    scores = [
        (name, scores) for each in maneuvers for name, scores in each.scores.items() if name in (each.moved or [name])
    ]
    if not scores:
        return (sentence,)
    name, worst = max(scores, key=lambda item: _badness(item[1]))
    return (
        sentence,
        f"{'Worst output' if len(scores) > 1 else 'Output'} in open loop: {quantity(name).words}, TIC "
        f"{significant(worst.tic, digits=2)}, fit {significant(worst.nrmse_fit_percent, digits=2)} % (good: TIC up to "
        f"{GOOD_TIC:g}, fit {GOOD_FIT_PERCENT:g} % and more).",
    )


def worst_record(records: Mapping[str, Mapping[str, Scores]]) -> Verdict | None:
    """Verdict on the worst output of unseen records that are judged by their scores alone; ``None`` without any."""
    scores = [scores for record in records.values() for scores in record.values()]
    worst = max(scores, key=_badness, default=None)
    return None if worst is None else prediction_verdict(worst.tic, worst.nrmse_fit_percent)


def _records_sentence(records: Mapping[str, Mapping[str, Scores]]) -> str:
    rows = [(where, name, scores) for where, record in records.items() for name, scores in record.items()]
    if not rows:
        return "The unseen flight does not move any axis enough to judge the model."
    where, name, worst = max(rows, key=lambda item: _badness(item[2]))
    good = sum(guidelines_met(scores.tic, scores.nrmse_fit_percent) == GUIDELINES for _, _, scores in rows)
    return (
        f"Unseen flight: {good} of {len(rows)} predicted well{'. Worst' if len(rows) > 1 else ''}: "
        f"{quantity(name).words} in {where}, TIC {significant(worst.tic, digits=2)}, fit "
        f"{significant(worst.nrmse_fit_percent, digits=2)} % (good: TIC up to {GOOD_TIC:g}, fit {GOOD_FIT_PERCENT:g} % "
        "and more)."
    )


def _badness(scores: Scores) -> tuple[int, float]:
    tic = scores.tic if math.isfinite(scores.tic) else math.inf
    return -guidelines_met(scores.tic, scores.nrmse_fit_percent), tic


def has_held_out_costs(document: ResultDocument) -> bool:
    """Whether the costs on unseen sweeps are those of a second model, fitted without the last maneuver."""
    return any(finding.kind == "held_out" for finding in document.findings)


_VERDICTS: Mapping[Level, str] = {"good": "well", "fair": "in part", "poor": "poorly", "": "without a verdict"}


def several_sentences(documents: Sequence[ResultDocument], refused: Iterable[str]) -> tuple[str, ...]:
    """How many of several models fit, which do not, and how they did on unseen flight.

    Parameters
    ----------
    documents
        The identified models.
    refused
        Names of models that the data cannot support.
    """
    fits: dict[Level, list[str]] = {}
    for document in documents:
        fits.setdefault(LEVEL_OF[document_verdict(document).color], []).append(document.model)
    refused = list(refused)
    total = len(documents) + len(refused)
    good = len(fits.pop("good", ()))
    if good == total:
        answer = "The model fits the data well." if total == 1 else f"All {total} models fit the data well."
    else:
        parts = [f"{good} of {counted(total, 'model')} {'fits' if good == 1 else 'fit'} the data well"]
        parts += [f"{len(names)} {_VERDICTS[level]} ({listed(names)})" for level, names in fits.items()]
        parts += [f"{len(refused)} {'has' if len(refused) == 1 else 'have'} not enough data"] if refused else []
        answer = f"{listed(parts)}."
    checks = [document.verification for document in documents]
    tested = sum(bool(found.maneuvers or found.records or found.frequency) for found in checks)
    if not tested:
        return (answer, "None was checked on unseen flight yet, so treat them as fits, not as predictions.")
    return (answer, f"{tested} of {counted(len(documents), 'model')} checked on unseen flight.")


def result_sentences(document: ResultDocument) -> tuple[str, ...]:
    """The main numbers of a model: gain, lag and delay of each input, or inertia, thrust and lag."""
    sentences = [sentence for name in document.inputs if (sentence := _input_sentence(document, name))]
    sentences += motor_sentences(document)
    if not sentences:
        free = sum(parameter.status == "free" for parameter in document.parameters.values())
        sentences.append(f"{document.model}: {counted(free, 'parameter')} identified.")
    if lag := _lag_sentence(document):
        sentences.append(lag)
    return tuple(sentences)


def _band_words(document: ResultDocument) -> str:
    """Where the motors were to explain the motion; nothing for other models."""
    if document.motors is None:
        return ""
    bands = {flight.band_hz.get(axis, SLOW_BAND_HZ) for flight in document.motors.excitation for axis in flight.counted}
    fast = sorted(band for band in bands if band != SLOW_BAND_HZ)
    words = [] if fast and SLOW_BAND_HZ not in bands else [f"up to {SLOW_HZ:g} Hz"]
    words += [f"from {fast[0][0]:g} to {max(high for _, high in fast):g} Hz"] if fast else []
    return f", {' or '.join(words)}"


def summary(document: ResultDocument) -> tuple[str, ...]:
    """The main numbers, unstable modes, the cost or the fit, and each kind of check."""
    sentences = [*result_sentences(document), *mode_sentences(document)]
    if document.motors is not None and document.motors.scale is None:
        sentences.append(scale_sentence(document))
    if document.fit_percent:
        parts = [
            f"{significant(percent)} % of {quantity(name).words}" for name, percent in document.fit_percent.items()
        ]
        sentences.append(f"The model explains {', '.join(parts)}{_band_words(document)}.")
    if document.cost is not None or document.fit_percent:
        sentences.append(_fit_sentence(document))
    return (*sentences, *_unseen_sentences(document))


def document_verdict(document: ResultDocument) -> FitVerdict:
    """The verdict of the fit behind a document."""
    if not document.parameters:
        return refused_verdict(document.findings)
    return fit_verdict(
        method=document.method, cost=document.cost, fit_percent=document.fit_percent, findings=document.findings
    )


def _fit_sentence(document: ResultDocument) -> str:
    """The verdict of the fit with its reason, and the response that costs most where that is much."""
    found = document_verdict(document)
    sentence = f"Fit: {found.word}. {found.reason}"
    pairs = document.cost.pairs if document.cost is not None else {}
    worst = max(pairs, key=lambda pair: pairs[pair].value, default="")
    if len(pairs) > 1 and pairs[worst].value > EXCELLENT_COST:
        value = pairs[worst].value
        sentence += f" Worst of {len(pairs)} responses: {worst}, cost {significant(value)} "
        sentence += f"({cost_verdict(value).words})."
    return sentence


def _unseen_sentences(document: ResultDocument) -> tuple[str, ...]:
    sentences: list[str] = []
    if document.verification.maneuvers:
        sentences += unseen_sentences(document.verification.maneuvers)
    elif document.verification.records:
        sentences.append(_records_sentence(document.verification.records))
    if costs := document.verification.frequency:
        cost = max(costs.values())
        what = (
            "Held-out maneuver (second model, fitted without it)" if has_held_out_costs(document) else "Unseen sweeps"
        )
        sentences.append(f"{what}: worst cost {significant(cost)} ({cost_verdict(cost).words}).")
    crossed = document.cross_validation
    if crossed is not None and crossed.mean_percent is not None:
        sentences.append(f"Cross-validation: explains {significant(crossed.mean_percent)} % of unseen records.")
    return tuple(sentences) or ("Not checked on unseen flight yet.",)


def _input_sentence(document: ResultDocument, name: str) -> str:
    if name not in _GAINS:
        return ""
    axis, gain, delay = _GAINS[name]
    found = {key: value for key, value in document.parameters.items() if value.status != "dropped"}
    if gain not in found:
        return ""
    parts = [f"{with_error(found[gain].value, found[gain].std)} {unit(found[gain].unit)} per unit command"]
    parts += [
        f"{words} {_milliseconds(found[key])}"
        for key, words in ((_LAG, "motor lag"), (delay, "delay"))
        if key in found and found[key].unit == "s" and not (key == _LAG and _several(document))
    ]
    return f"{axis}: {', '.join(parts)}."


def _several(document: ResultDocument) -> bool:
    """Whether several axes share the motor lag, which then has a sentence of its own."""
    return sum(name in _GAINS for name in document.inputs) > 1


def _lag_sentence(document: ResultDocument) -> str:
    lag = document.parameters.get(_LAG)
    if lag is None or lag.status == "dropped" or not _several(document):
        return ""
    return f"Motor lag of all axes: {_milliseconds(lag)}."


def _milliseconds(parameter: ParameterEstimate) -> str:
    return f"{milliseconds(parameter.value, parameter.std)} ms"


def parameter_words(name: str) -> str:
    """What a derivative or delay is; empty for a name that follows no convention.

    Examples
    --------
    >>> parameter_words("L_roll"), parameter_words("tau_pitch"), parameter_words("k1")
    ('rolling moment due to roll command', 'delay of the pitch command', '')
    """
    if name == _LAG:
        return "motor lag"
    if name in _PHYSICAL or name in _LATE:
        return _PHYSICAL.get(name) or _LATE[name]
    kind, _, of = name.partition("_")
    command = f"{of}_command" in _GAINS
    if kind == "tau":
        return f"delay of the {of} command" if command else ""
    known = quantity(of).words
    cause = f"{of} command" if command else known.removesuffix(f" {of}") if known.endswith(f" {of}") else ""
    return f"{_EFFECTS[kind]} due to {cause}" if kind in _EFFECTS and cause else ""


def parameter_group(name: str, unit: str) -> str:
    """The force or moment that a derivative belongs to, or that it is a delay, a mass or a thrust; empty for others.

    Examples
    --------
    >>> parameter_group("M_q", "1/s"), parameter_group("T_motor", "s"), parameter_group("J_x", "kg m^2")
    ('Pitching moment', 'Delays and lags', '')
    """
    kind = name.partition("_")[0]
    group = _DELAYS if unit == "s" else _MASSES if name in _PHYSICAL else _EFFECTS.get(kind, "")
    return group.capitalize()


_WEIGHTS = {
    "cifer": "Errors are weighted by coherence, as in CIFER.",
    "covariance": (
        "Errors are weighted by their measured covariance over frequencies and outputs, after a first fit with CIFER's "
        "weights."
    ),
}
_WIDTH, _HEIGHT, _MARGIN = 120.0, 26.0, 3.0


def fit_sentences(fit: FitEnd) -> tuple[str, ...]:
    """The weights, how the solver ended, and how the residuals changed the standard deviations."""
    outcome = fit.outcome.rstrip(".")
    count = "1 evaluation" if fit.evaluations == 1 else f"{fit.evaluations} evaluations"
    sentences = [_WEIGHTS[fit.weights], f"The solver ended after {count}: {outcome[:1].lower()}{outcome[1:]}."]
    if len(fit.trace) > 1:
        steps = "1 step" if len(fit.trace) == 2 else f"{len(fit.trace) - 1} steps"
        first, last = significant(fit.trace[0]), significant(fit.trace[-1])
        sentences.append(f"In {steps} the total cost fell from {first} to {last}.")
    if fit.model_error:
        worst = max(fit.model_error, key=lambda name: fit.model_error[name])
        sentences.append(
            f"The model structure misses {worst} by {significant(100.0 * fit.model_error[worst], digits=2)} %"
            f"{' and the others by less' if len(fit.model_error) > 1 else ''}. With this and with clock errors, "
            f"standard deviations are {significant(fit.inflation, digits=2)} times those of random errors."
        )
    return tuple(sentences)


def sparkline(trace: Sequence[float]) -> str:
    """Corners of a small curve of the cost on a logarithmic scale, as an SVG polyline of 120 by 26 takes them.

    Empty where there is nothing to draw: fewer than three positive costs.

    Examples
    --------
    >>> sparkline([100.0, 10.0, 1.0])
    '3.0,3.0 60.0,13.0 117.0,23.0'
    """
    levels = [math.log(cost) for cost in trace if math.isfinite(cost) and cost > 0.0]
    if len(levels) < 3:
        return ""
    low, high = min(levels), max(levels)
    across = (_WIDTH - 2.0 * _MARGIN) / (len(levels) - 1)
    down = (_HEIGHT - 2.0 * _MARGIN) / (high - low) if high > low else 0.0
    corners = [(_MARGIN + across * at, _MARGIN + down * (high - level)) for at, level in enumerate(levels)]
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


_HOLDS = {
    "zero": "Inputs are constant between samples (zero-order hold), as the commands were sent.",
    "first": "Inputs are interpolated linearly between samples.",
}


def time_sentences(document: ResultDocument, fit: FitEnd) -> tuple[str, ...]:
    """The method, what inputs did between samples, how the solver ended, and the color of the residuals."""
    outcome = fit.outcome.rstrip(".")
    count = "1 evaluation" if fit.evaluations == 1 else f"{fit.evaluations} evaluations"
    if document.motors is not None:
        last = f"The last search ended after {count}: {outcome[:1].lower()}{outcome[1:]}."
        return (*method_sentences(document), last)
    sentences = [METHODS[document.method].how]
    if document.hold:
        sentences.append(_HOLDS[document.hold])
    if document.pieces_s is not None:
        sentences.append(f"The simulation restarted every {significant(document.pieces_s)} s.")
    sentences.append(f"The solver ended after {count}: {outcome[:1].lower()}{outcome[1:]}.")
    if document.residuals and document.residuals.memory:
        sentences.append(
            f"Residuals are correlated over about {document.residuals.memory} samples, so standard deviations are "
            f"{significant(document.residuals.inflation, digits=2)} times those of white residuals."
        )
    return tuple(sentences)
