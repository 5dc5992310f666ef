"""What numbers mean, in plain words and by the guidelines of the field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rotorid.fit.frequency_cost import ACCEPTABLE_COST, EXCELLENT_COST
from rotorid.fit.motor_excitation import SLOW_HZ
from rotorid.pipeline.document import CostDocument, ParameterDocument, ResultDocument
from rotorid.pipeline.score_document import ManeuverVerificationDocument, ScoreDocument
from rotorid.plot.quantity import quantity
from rotorid.report.modes import mode_sentences
from rotorid.report.motor_words import motor_sentences
from rotorid.report.numbers import milliseconds, significant, unit, with_error
from rotorid.verify.scores import GOOD_FIT_PERCENT, GOOD_TIC, GUIDELINES, guidelines_met
from rotorid.verify.verdict import Verdict as Found

Level: TypeAlias = Literal["good", "fair", "poor"]

LEVELS: tuple[Level, ...] = ("good", "fair", "poor")

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
    "c_0": "thrust of a rotor at no output",
    "c_1": "thrust of a rotor by its output",
    "c_2": "thrust of a rotor by its output squared",
    "kappa": "torque of a rotor by its thrust",
    "kappa_per_I_zz": "torque by thrust, over yaw inertia",
}
_LATE = {"tau_gyro": "delay from outputs to the gyros", "tau_accel": "delay from outputs to the accelerometer"}
_FOUND: dict[Found, tuple[Level, str, str]] = {
    "good": ("good", "good", "predicted well"),
    "diverges": (
        "good",
        "good ahead, diverges in open loop",
        "predicted well ahead, while the open loop diverges as that of an unstable airframe must",
    ),
    "disturbed": ("fair", "disturbed", "too disturbed to judge"),
    "poor": ("poor", "poor", "predicted poorly"),
}
"""Level, badge and words of what was found on a maneuver, the best first."""

_HEADINGS = {
    "airborne": "Reaches beyond the flight",
    "assumed_geometry": "The order of the motors was assumed",
    "battery_sag": "The battery sagged",
    "clock_disorder": "Stamps out of order",
    "clock_skew": "Times of two channels",
    "colored_residuals": "Residuals that remember",
    "closed_loop_bias": "Feedback in this response",
    "correlated_inputs": "Inputs moved together",
    "corrupt_log": "The log is damaged",
    "decimated": "Logged without a filter in front",
    "disturbed_verification": "A flight that cannot judge the model",
    "dropped_parameter": "A parameter was dropped",
    "fitted_in_pieces": "Fitted in pieces",
    "gap": "A gap in the data",
    "held_out": "Judged on a held-out maneuver",
    "impossible_physics": "A value that physics does not allow",
    "insensitive_parameter": "The data hardly feel this parameter",
    "inverse_controller": "This looks like the inverse of the controller",
    "kinematic_consistency": "Sensors against each other",
    "kinematic_inconsistency": "Sensors contradict each other",
    "kinematics_unchecked": "Sensors that could not be checked",
    "known_filter": "A known filter",
    "lag_plus_delay": "Lag and delay together",
    "legacy_units": "Units of an older firmware",
    "low_coherence": "Low coherence",
    "motor_reconstruction": "Motors computed from commands",
    "missing_channel": "A channel is missing",
    "methods_disagree": "Two methods disagree",
    "never_airborne": "The vehicle never flew",
    "no_excitation": "No excitation found",
    "not_compared": "No second opinion",
    "not_converged": "The fit did not converge",
    "order_too_high": "More order than the data show",
    "not_identifiable": "Parameters that cannot be told apart",
    "not_verified": "Not verified",
    "seen_data": "Data that the model has seen",
    "off_axis_input": "Another axis moved too",
    "no_controller": "Not flown in closed loop",
    "open_loop_diverges": "An unstable airframe, not a bad model",
    "other_controller": "Another controller flew",
    "other_source": "Channels from different sources",
    "outputs_left_out": "Outputs that were not fitted",
    "parameter_at_bound": "A parameter stands at its bound",
    "poor_fit": "The model misses the measurement",
    "poor_verification": "The model misses the unseen flight",
    "rate_too_low": "Logged too slowly",
    "receive_time": "Stamps of the receiver",
    "reconstructed": "A channel was computed",
    "record_too_short": "The record is short",
    "rotor_layout": "Where the rotors are",
    "saturation": "Saturation",
    "segment_trimmed": "A segment was cut",
    "sensor_clipping": "A sensor clipped",
    "several_flights": "Several flights in one log",
    "several_vehicles": "Several vehicles in one log",
    "speed_damping_biased": "Speed damping is biased",
    "sweep_ended_early": "A sweep ended early",
    "trim": "Not a hover",
    "uncertain_parameter": "An uncertain parameter",
    "unknown_column": "A column that is not known",
    "unknown_filter": "A filter that is not known",
    "unknown_topic": "A topic that is not known",
    "unstable_model": "A growing mode",
    "vibration_filtered": "Vibration was filtered out",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """A level for the eye and words for everybody."""

    level: Level
    words: str


def cost_verdict(cost: float) -> Verdict:
    """Verdict on a frequency-domain cost, by Tischler and Remple's guidelines of 50 and 100."""
    if cost <= EXCELLENT_COST:
        return Verdict("good", "hardly distinguishable from the flight")
    if cost <= ACCEPTABLE_COST:
        return Verdict("fair", "acceptable")
    return Verdict("poor", "the model misses what was measured")


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
        return Verdict("poor", "both beyond the guideline")
    return Verdict("fair", "TIC above the guideline" if fit_percent >= GOOD_FIT_PERCENT else "fit below the guideline")


def fit_verdict(percent: float) -> Verdict:
    """Verdict on how much of an output a model explains: 50 % and more are good, below 0 % the mean would do better.

    Examples
    --------
    >>> fit_verdict(83.2)
    Verdict(level='good', words='83.2 %')
    """
    level: Level = "good" if percent >= GOOD_FIT_PERCENT else "fair" if percent > 0.0 else "poor"
    return Verdict(level, f"{percent:.1f} %")


def maneuver_verdict(found: Found) -> Verdict:
    """Verdict on an unseen maneuver as a badge.

    Examples
    --------
    >>> maneuver_verdict("disturbed")
    Verdict(level='fair', words='disturbed')
    """
    level, words, _ = _FOUND[found]
    return Verdict(level, words)


def worst_maneuver(maneuvers: Sequence[ManeuverVerificationDocument]) -> Verdict | None:
    """Verdict on the worst of several maneuvers, with how many are like it; ``None`` without any."""
    found = [one.verdict for one in maneuvers]
    worst = max(found, key=list(_FOUND).index, default=None)
    if worst is None:
        return None
    level, words, _ = _FOUND[worst]
    count = found.count(worst)
    return Verdict(level, words if count == len(found) else f"{count} of {len(found)} {words}")


def unseen_sentences(maneuvers: Sequence[ManeuverVerificationDocument]) -> tuple[str, ...]:
    """What unseen maneuvers say about the model: how many of each verdict, and the worst open loop of what moved."""
    found = [one.verdict for one in maneuvers]
    several = "1 maneuver" if len(found) == 1 else f"{len(found)} maneuvers"
    groups = [(found.count(kind), words) for kind, (_, _, words) in _FOUND.items() if kind in found]
    told = groups[0][1] if len(groups) == 1 else ", ".join(f"{count} {words}" for count, words in groups)
    sentence = f"Unseen flight: {several}{' ' if len(groups) == 1 else ', '}{told}."
    scores = [(name, one) for each in maneuvers for name, one in each.scores.items() if name in (each.moved or [name])]
    if not scores:
        return (sentence,)
    name, worst = max(scores, key=lambda item: _badness(item[1]))
    return (
        sentence,
        f"In open loop {'the worst' if len(scores) > 1 else 'the output'} is {quantity(name).words} with a TIC of "
        f"{significant(worst.tic, digits=2)} and a fit of {significant(worst.nrmse_fit_percent, digits=2)} % (good: "
        f"TIC up to {GOOD_TIC:g} and a fit of {GOOD_FIT_PERCENT:g} % and more).",
    )


def worst_record(records: Mapping[str, Mapping[str, ScoreDocument]]) -> Verdict | None:
    """Verdict on the worst output of unseen records that are judged by their scores alone; ``None`` without any."""
    scores = [one for record in records.values() for one in record.values()]
    worst = max(scores, key=_badness, default=None)
    return None if worst is None else prediction_verdict(worst.tic, worst.nrmse_fit_percent)


def _records_sentence(records: Mapping[str, Mapping[str, ScoreDocument]]) -> str:
    told = [(where, name, one) for where, record in records.items() for name, one in record.items()]
    if not told:
        return "The unseen flight moves no axis enough to judge the model."
    where, name, worst = max(told, key=lambda item: _badness(item[2]))
    good = sum(guidelines_met(one.tic, one.nrmse_fit_percent) == GUIDELINES for _, _, one in told)
    return (
        f"Unseen flight: {good} of {len(told)} predicted well{'; the worst is' if len(told) > 1 else ':'} "
        f"{quantity(name).words} of {where} with a TIC of {significant(worst.tic, digits=2)} and a fit of "
        f"{significant(worst.nrmse_fit_percent, digits=2)} % (good: TIC up to {GOOD_TIC:g} and a fit of "
        f"{GOOD_FIT_PERCENT:g} % and more)."
    )


def _badness(scores: ScoreDocument) -> tuple[int, float]:
    tic = scores.tic if math.isfinite(scores.tic) else math.inf
    return -guidelines_met(scores.tic, scores.nrmse_fit_percent), tic


def held_out(document: ResultDocument) -> bool:
    """Whether the costs on unseen sweeps are those of a second model, fitted without the last maneuver."""
    return any(finding.kind == "held_out" for finding in document.findings)


def summary(document: ResultDocument) -> tuple[str, ...]:
    """What was found: each input, modes that grow, the cost or the fit, and each kind of check.

    Parameters
    ----------
    document
        The result.
    """
    sentences = [sentence for name in document.inputs if (sentence := _input_sentence(document, name))]
    sentences += motor_sentences(document)
    if not sentences:
        free = sum(parameter.status == "free" for parameter in document.parameters.values())
        sentences.append(f"{document.model}: {free} parameters identified.")
    if lag := _lag_sentence(document):
        sentences.append(lag)
    sentences += mode_sentences(document)
    if document.fit_percent:
        parts = [
            f"{significant(percent)} % of {quantity(name).words}" for name, percent in document.fit_percent.items()
        ]
        slow = f", up to {SLOW_HZ:g} Hz" if document.motors else ""
        sentences.append(f"The model explains {', '.join(parts)}{slow}.")
    if document.cost is not None:
        sentences.append(_cost_sentence(document.cost))
    return (*sentences, *_unseen_sentences(document))


def _cost_sentence(cost: CostDocument) -> str:
    words = cost_verdict(cost.average).words
    several = f" on average of {len(cost.pairs)} responses" if len(cost.pairs) > 1 else ""
    sentence = f"Cost {significant(cost.average)}{several}: {words} (guideline: below {EXCELLENT_COST:.0f})."
    worst = max(cost.pairs, key=lambda pair: cost.pairs[pair].value, default="")
    if several and cost.pairs[worst].value > EXCELLENT_COST:
        value = cost.pairs[worst].value
        sentence += f" The worst is {worst} with {significant(value)}: {cost_verdict(value).words}."
    return sentence


def _unseen_sentences(document: ResultDocument) -> tuple[str, ...]:
    sentences: list[str] = []
    if document.verification.maneuvers:
        sentences += unseen_sentences(document.verification.maneuvers)
    elif document.verification.records:
        sentences.append(_records_sentence(document.verification.records))
    if costs := document.verification.frequency:
        cost = max(costs.values())
        what = "Held-out maneuver, by a second model fitted without it" if held_out(document) else "Unseen sweeps"
        sentences.append(f"{what}: cost at worst {significant(cost)}, {cost_verdict(cost).words}.")
    crossed = document.cross_validation
    if crossed is not None and crossed.mean_percent is not None:
        sentences.append(f"On records it was not identified on it explains {significant(crossed.mean_percent)} %.")
    return tuple(sentences) or ("Not verified on an unseen flight yet.",)


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


def _milliseconds(parameter: ParameterDocument) -> str:
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


def finding_heading(kind: str) -> str:
    """A friendly heading for a kind of finding.

    Examples
    --------
    >>> finding_heading("gap"), finding_heading("odd_thing")
    ('A gap in the data', 'Odd thing')
    """
    return _HEADINGS.get(kind, kind.replace("_", " ").capitalize())
