"""The first screen of a review: a handful of judgments in words that need no control theory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.data.trust import RICH_KINDS
from rotorid.pipeline.results import IdentifiedModel
from rotorid.pipeline.review.motors import WORTH_SAYING
from rotorid.pipeline.review.values import LoopReview, MarginReview, NoiseReview, Review
from rotorid.typing import Axis

State: TypeAlias = Literal["good", "look", "cannot"]
"""Good; look here; cannot be told from this flight."""

LEAST_PHASE_MARGIN_DEG, LARGEST_SENSITIVITY = 40.0, 2.0
"""Below the one or above the other a rate loop rings, and has little left for a heavier day or a weaker battery."""

# Habits of the field, not laws. A card asks for a look where the 95 % interval of its number lies beyond the limit.

LARGEST_OVERSHOOT_PERCENT = 25.0
"""A rate loop that overshoots its set-point by more needs a look."""

SLOW_RISE_S = 0.25
"""A rate loop that takes longer from 0.1 to 0.9 of its set-point is slow."""

LARGEST_IMBALANCE = WORTH_SAYING
"""Off the mean of all motors in steady flight; a pattern is named from the same on."""

LARGEST_SATURATION = 0.05
"""Share of the flight at full output, where nothing is left for control."""

LEAST_HEADROOM = 0.15
"""Share of the range that the hardest working motor has left in hover."""

LARGEST_VIBRATION_M_S2 = 30.0
"""More, rms above 10 Hz, disturbs the estimate of height and position."""

LARGEST_CLIPPING = 1e-3
"""Share of samples at the end of the accelerometer's range; noise is remarked on from the same on."""

LARGEST_NOISE_SHARE = 0.02
"""Share of the motors' range that noise takes through D: it moves nothing, and heats motors."""

LARGEST_SAG = 0.15
"""Share of the voltage at the start that falls off at the mean current."""

LEAST_THRUST_TO_WEIGHT = 1.5
"""Full thrust over weight below which it is called little."""

_POWER = {"battery_voltage", "thrust_command", "thrust_stick", "motor_1"}
_RATES = {rate: axis for axis, rate in RATE_OF.items()}


@dataclass(frozen=True, kw_only=True)
class Card(Immutable):
    """One judgment.

    Parameters
    ----------
    key, title
        Name, and heading.
    state
        Whether it is good, needs a look, or cannot be told.
    number
        The one number that stands for it, with its unit; empty where there is none.
    sentence
        What it means, for a pilot.
    """

    key: str
    title: str
    state: State
    number: str
    sentence: str


def cards(review: Review) -> tuple[Card, ...]:
    """What a pilot should know first, in the order in which it matters."""
    found = (
        _tracking(review.loops),
        _margins(review.margins),
        _noise(review.noise),
        _motors(review),
        _power(review),
        _models(review),
    )
    if review.flight.flights:
        return found
    return tuple(replace(card, state="cannot", number="", sentence="This log holds no flight.") for card in found)


def _tracking(loops: Mapping[str, LoopReview]) -> Card:
    told = {
        name: loop.numbers["rise_time_s"]
        for name, loop in loops.items()
        if name in ("p", "q") and "rise_time_s" in loop.numbers
    }
    title = "Does it follow the stick?"
    if not told:
        sentence = "This log does not show how quickly roll and pitch follow what is asked of them."
        return Card(key="tracking", title=title, state="cannot", number="", sentence=sentence)
    name, rise = max(told.items(), key=lambda item: item[1].value)
    overshoots = {
        which: loops[which].numbers["overshoot_percent"]
        for which in told
        if "overshoot_percent" in loops[which].numbers
    }
    number = f"{_RATES[name]} rises in {_pm(rise, 1e3)} ms"
    over = max(overshoots, key=lambda which: overshoots[which].value, default=None)
    # Judged by what is sure: the nearer end of the interval has to lie beyond the limit.
    if over is not None and overshoots[over].lower > LARGEST_OVERSHOOT_PERCENT:
        sentence = (
            f"{_RATES[over].capitalize()} overshoots by {overshoots[over].value:.0f} %: it bounces after quick moves. "
            "Usually too much P or I, too little D, or a filter that is too slow."
        )
        return Card(key="tracking", title=title, state="look", number=number, sentence=sentence)
    if rise.lower > SLOW_RISE_S:
        sentence = f"{_RATES[name].capitalize()} follows slowly; more P would make it follow quicker."
        return Card(key="tracking", title=title, state="look", number=number, sentence=sentence)
    by = f", with at most {overshoots[over].value:.0f} % overshoot" if over is not None else ""
    who = "Roll and pitch follow what is asked of them" if len(told) == 2 else f"{_RATES[name].capitalize()} follows"
    sentence = f"{who}{by}."
    return Card(key="tracking", title=title, state="good", number=number, sentence=sentence)


def _margins(margins: Mapping[Axis, MarginReview]) -> Card:
    title = "How close is it to shaking?"
    told = {axis: one.numbers["phase_margin_deg"] for axis, one in margins.items() if "phase_margin_deg" in one.numbers}
    if not told:
        sentence = "How much more gain the loops would stand cannot be told from this log."
        return Card(key="margins", title=title, state="cannot", number="", sentence=sentence)
    axis = min(told, key=lambda one: told[one].value)
    number = f"{axis} phase margin {_pm(told[axis])}°"
    peaks = {
        name: one.numbers["sensitivity_peak"] for name, one in margins.items() if "sensitivity_peak" in one.numbers
    }
    worst = max(peaks, key=lambda one: peaks[one].value, default=None)
    if told[axis].upper < LEAST_PHASE_MARGIN_DEG:
        sentence = f"The {axis} loop has little room: it rings, and a stronger filter or more gain would make it shake."
        return Card(key="margins", title=title, state="look", number=number, sentence=sentence)
    if worst is not None and peaks[worst].lower > LARGEST_SENSITIVITY:
        times = f"{peaks[worst].value:.1f} times as large"
        sentence = f"The {worst} loop makes some disturbances {times}: less gain, or less delay."
        return Card(key="margins", title=title, state="look", number=number, sentence=sentence)
    sentence = "The loops keep a safe distance from instability."
    return Card(key="margins", title=title, state="good", number=number, sentence=sentence)


def _noise(noise: NoiseReview) -> Card:
    title = "Does it vibrate?"
    vibration, clipping = noise.numbers.get("vibration_m_s2"), noise.numbers.get("clipping_share")
    shares = {name: one for name, one in noise.numbers.items() if name.endswith("_d_noise_share")}
    loud = max(shares, key=lambda one: shares[one].value, default=None)
    if vibration is None and loud is None and not noise.peaks:
        sentence = "This log is too slow, or lacks the channels, to show vibration."
        return Card(key="noise", title=title, state="cannot", number="", sentence=sentence)
    number = "" if vibration is None else f"{_pm(vibration)} m/s²"
    if not number and loud is not None:
        number = f"{100.0 * shares[loud].value:.1f} % of the motor range"
    if clipping is not None and clipping.lower > LARGEST_CLIPPING:
        sentence = "The accelerometer hits its limits: mount it softer, or find what shakes."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    if vibration is not None and vibration.lower > LARGEST_VIBRATION_M_S2:
        sentence = (
            "Vibration is high enough to disturb height and position: balance propellers, look at mount and arms."
        )
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    if loud is not None and shares[loud].lower > LARGEST_NOISE_SHARE:
        axis = loud.partition("_")[0]
        share = f"{100.0 * shares[loud].value:.1f} % of their range"
        sentence = f"Noise passes through D of {axis} into the motors ({share}): motors may run hot."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    strongest = max(noise.peaks, key=lambda one: one.height_db, default=None)
    where = "" if strongest is None else f" The strongest line is at {strongest.frequency_hz.value:.0f} Hz."
    return Card(
        key="noise", title=title, state="good", number=number, sentence=f"Nothing that would disturb the loops.{where}"
    )


def _motors(review: Review) -> Card:
    title = "Are the motors well?"
    motors, numbers = review.motors, review.motors.numbers
    if not numbers:
        logged = "motor_1" in review.logging.rates_hz
        sentence = f"Motor outputs are {'not logged in the air' if logged else 'not in this log'}."
        return Card(key="motors", title=title, state="cannot", number="", sentence=sentence)
    imbalance, high = numbers.get("imbalance"), numbers.get("saturated_high_share")
    number = "" if imbalance is None else f"{100.0 * imbalance.value:.0f} % imbalance"
    if motors.events:
        sentence = (
            f"{len(motors.events)} times a motor was told to speed up and slowed down: look for a desync of its ESC."
        )
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if imbalance is not None and imbalance.lower > LARGEST_IMBALANCE:
        why = f": {motors.pattern}" if motors.pattern else ""
        sentence = f"The motors do not share the work evenly in steady flight{why}."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if high is not None and high.lower > LARGEST_SATURATION:
        number = number or f"{100.0 * high.value:.0f} % at full output"
        share = f"{100.0 * high.value:.0f} % of the flight"
        sentence = f"Motors stood at full output for {share}: nothing is left for control then."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    headroom = numbers.get("headroom")
    if headroom is not None and headroom.upper < LEAST_HEADROOM:
        sentence = "There is little thrust left above hover: lighter, or stronger."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    return Card(
        key="motors",
        title=title,
        state="good",
        number=number,
        sentence="They share the work, and have room to control.",
    )


def _power(review: Review) -> Card:
    title = "Power and thrust"
    battery, throttle, ratio = review.flight.battery, review.flight.hover_throttle, review.flight.thrust_to_weight
    number = "" if throttle is None else f"hovers at {100.0 * throttle.value:.0f} % throttle"
    if not number and not battery:
        logged = _POWER & review.logging.rates_hz.keys()
        sentence = (
            "What is logged of battery and throttle tells nothing of this flight."
            if logged
            else "Neither battery nor throttle is in this log."
        )
        return Card(key="power", title=title, state="cannot", number="", sentence=sentence)
    sentences = []
    state: State = "good"
    if ratio is not None:
        sentences.append(f"Full thrust is {ratio.value:.1f} times the weight.")
        if ratio.upper < LEAST_THRUST_TO_WEIGHT:
            state = "look"
            sentences.append("That is little.")
    if battery and "start_v" in battery and "lowest_v" in battery:
        start, lowest = battery["start_v"].value, battery["lowest_v"].value
        stop = battery.get("stop_v", battery["lowest_v"]).value
        sentences.append(f"The battery went from {start:.1f} V to {stop:.1f} V, lowest {lowest:.1f} V.")
        if start > 0.0 and "sag_v" in battery and battery["sag_v"].lower > LARGEST_SAG * start:
            state = "look"
            sentences.append("It sags much under load: old, cold or too small.")
    return Card(
        key="power", title=title, state=state, number=number, sentence=" ".join(sentences) or "Nothing to remark."
    )


def _models(review: Review) -> Card:
    title = "What can be built on this flight"
    stands = _standing(review)
    if not stands:
        sentence = "No model of the vehicle can be identified from it; below stands what to fly or log."
        return Card(key="models", title=title, state="cannot", number="", sentence=sentence)
    number = f"{len(stands)} model{'s' if len(stands) > 1 else ''}"
    sentence = f"Identified with intervals: {', '.join(stands)}."
    if without_sweep(review):
        sentence += " A sweep would make them several times as certain."
    return Card(key="models", title=title, state="good", number=number, sentence=sentence)


def _standing(review: Review) -> dict[str, IdentifiedModel]:
    return {name: one for name, one in review.models.items() if isinstance(one, IdentifiedModel)}


def without_sweep(review: Review) -> bool:
    """Whether the models of a review were identified without any maneuver that was made for it."""
    flown = (one for model in _standing(review).values() for one in model.provenance.maneuvers)
    return not any(one.kind in RICH_KINDS for one in flown)


def _pm(quantity: Quantity, factor: float = 1.0) -> str:
    """A number with half of its interval, both as precise as that allows."""
    value, half = factor * quantity.value, 0.5 * factor * (quantity.upper - quantity.lower)
    if not 0.0 < half < 1e6:
        return f"{value:.3g}"
    digits = max(0, -int(f"{half:.0e}".partition("e")[2]))
    return f"{value:.{digits}f} ± {half:.{digits}f}"
