"""What numbers mean, in plain words and by the guidelines of the field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rotorid.pipeline.document import ParameterDocument, PoleDocument, ResultDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import significant, unit, with_error
from rotorid.verify.scores import GOOD_TIC

Level: TypeAlias = Literal["good", "fair", "poor"]

GOOD_COST, ACCEPTABLE_COST = 50.0, 100.0

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
_HEADINGS = {
    "clock_skew": "Clocks of the log disagree",
    "closed_loop_bias": "Feedback in this response",
    "corrupt_log": "The log is damaged",
    "correlated_inputs": "Inputs moved together",
    "dropped_parameter": "A parameter was dropped",
    "gap": "A gap in the data",
    "impossible_physics": "A value that physics does not allow",
    "insensitive_parameter": "The data hardly feel this parameter",
    "inverse_controller": "This looks like the inverse of the controller",
    "low_coherence": "Low coherence",
    "missing_channel": "A channel is missing",
    "no_excitation": "No excitation found",
    "not_identifiable": "Parameters that cannot be told apart",
    "poor_fit": "The model misses the measurement",
    "poor_verification": "The model misses the unseen flight",
    "rate_too_low": "Logged too slowly",
    "record_too_short": "The record is short",
    "saturation": "Saturation",
    "speed_damping_biased": "Speed damping is biased",
    "uncertain_parameter": "An uncertain parameter",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """A level for the eye and words for everybody."""

    level: Level
    words: str


def cost_verdict(cost: float) -> Verdict:
    """Verdict on a frequency-domain cost, by Tischler and Remple's guidelines of 50 and 100."""
    if cost <= GOOD_COST:
        return Verdict("good", "hardly distinguishable from the flight")
    if cost <= ACCEPTABLE_COST:
        return Verdict("fair", "acceptable")
    return Verdict("poor", "the model misses what was measured")


def tic_verdict(tic: float) -> Verdict:
    """Verdict on a Theil inequality coefficient, by the guideline of 0.25."""
    return Verdict("good", "good") if tic <= GOOD_TIC else Verdict("poor", "above the guideline")


def summary(document: ResultDocument, *, tics: Sequence[float] = ()) -> tuple[str, ...]:
    """What was found, one sentence for each input, and one for the cost or the fit.

    Parameters
    ----------
    document
        The result.
    tics
        Theil inequality coefficients of all outputs of all unseen maneuvers.
    """
    sentences = [sentence for name in document.inputs if (sentence := _input_sentence(document, name))]
    if not sentences:
        free = sum(parameter.status == "free" for parameter in document.parameters.values())
        sentences.append(f"{document.model}: {free} parameters identified.")
    if document.cost is not None:
        words = cost_verdict(document.cost.average).words
        sentences.append(f"Cost {significant(document.cost.average)}: {words} (guideline: below {GOOD_COST:.0f}).")
    for name, percent in (document.fit_percent or {}).items():
        sentences.append(f"The model explains {significant(percent)} % of {quantity(name).words}.")
    sentences.append(_unseen_sentence(tics))
    return tuple(sentences)


def _unseen_sentence(tics: Sequence[float]) -> str:
    if not tics:
        return "Not verified on an unseen flight yet."
    count = f"{len(tics)} prediction{'' if len(tics) == 1 else 's'}"
    worst = f"TIC at worst {significant(max(tics), digits=2)}, {tic_verdict(max(tics)).words}"
    return f"Unseen flight: {count}, {worst} (guideline: up to {GOOD_TIC})."


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
        if key in found and found[key].unit == "s"
    ]
    return f"{axis}: {', '.join(parts)}."


def _milliseconds(parameter: ParameterDocument) -> str:
    std = None if parameter.std is None else 1e3 * parameter.std
    return f"{with_error(1e3 * parameter.value, std)} ms"


def parameter_words(name: str) -> str:
    """What a derivative or delay is; empty for a name that follows no convention.

    Examples
    --------
    >>> parameter_words("L_roll"), parameter_words("tau_pitch"), parameter_words("k1")
    ('rolling moment due to roll command', 'delay of the pitch command', '')
    """
    if name == _LAG:
        return "motor lag"
    kind, _, of = name.partition("_")
    command = f"{of}_command" in _GAINS
    if kind == "tau":
        return f"delay of the {of} command" if command else ""
    known = quantity(of).words
    cause = f"{of} command" if command else known.removesuffix(f" {of}") if known.endswith(f" {of}") else ""
    return f"{_EFFECTS[kind]} due to {cause}" if kind in _EFFECTS and cause else ""


def finding_heading(kind: str) -> str:
    """A friendly heading for a kind of finding.

    Examples
    --------
    >>> finding_heading("gap"), finding_heading("odd_thing")
    ('A gap in the data', 'Odd thing')
    """
    return _HEADINGS.get(kind, kind.replace("_", " ").capitalize())


def pole_words(pole: PoleDocument) -> str:
    """How a mode moves: its time constant, or how fast it grows, and its oscillation."""
    swing = f", oscillates at {significant(pole.frequency_rad_s)} rad/s" if pole.imag else ""
    if pole.real == 0.0:
        return f"neither decays nor grows{swing}"
    rate = abs(1.0 / pole.real)
    if pole.real < 0.0:
        return f"stable, time constant {significant(rate)} s{swing}"
    # ln 2 / real: the time in which the amplitude doubles.
    return f"unstable, doubles in {significant(0.6931 * rate)} s{swing}"
