"""The first screen of a review: a handful of judgments in words that need no control theory.

A card asks one question. It is green only where every part of the question was measured and is good. What was measured
alone is a part, and the card names what is missing; a part that needs a look goes before everything that is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.display import capital, listed
from rotorid.data.quantity import Quantity
from rotorid.data.trust import RICH_KINDS
from rotorid.flights.oscillations import describe, gain_words, motors_limited
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Color
from rotorid.results.verdicts import verdict
from rotorid.reviewing.motors import MUCH_AT_FULL, WORTH_SAYING
from rotorid.reviewing.values import Review

State: TypeAlias = Literal["good", "look", "part", "cannot"]
"""Good; look here; what was measured is good, and a part was not measured; not enough data."""

STATES: Mapping[State, tuple[str, Color]] = MappingProxyType(
    {
        "good": ("good", "green"),
        "look": ("look here", "yellow"),
        "part": ("good in part", "gray"),
        "cannot": ("not enough data", "gray"),
    }
)
"""Word and color of a state, on every page and line: what is unknown is gray."""

LEAST_PHASE_MARGIN_DEG, LARGEST_SENSITIVITY = 40.0, 2.0
"""Below the one or above the other a rate loop rings, and has little left for a heavier day or a weaker battery."""

# Habits of the field, not laws. A card asks for a look where the whole 95 % interval of a number lies beyond the limit,
# and is good where every interval keeps to it; for what lies in between there is not enough data.

LARGEST_OVERSHOOT_PERCENT = 25.0
"""A rate loop that overshoots its set-point by more needs a look."""

SLOW_RISE_S = 0.25
"""A rate loop that takes longer from 0.1 to 0.9 of its set-point is slow."""

LARGEST_IMBALANCE = WORTH_SAYING
"""Off the mean of all motors in steady flight; a pattern is named from the same on."""

LARGEST_SATURATION = MUCH_AT_FULL
"""Share of the flight with a motor at full output, where nothing is left for control; warned of from the same on."""

_SELDOM = 5e-4
"""Share of the flight at a limit below which nothing is said of it."""

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

_MOVE_MORE = "move the {axis} stick for 30 s: quick pairs to both sides of 5 to 10 degrees, one every second"

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
        Whether it is good, needs a look, is good as far as it was measured, or was not measured.
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

    @property
    def word(self) -> str:
        """The state in words."""
        return STATES[self.state][0]

    @property
    def color(self) -> Color:
        """The state for the eye."""
        return STATES[self.state][1]


def cards(review: Review) -> tuple[Card, ...]:
    """What a pilot should know first, in the order in which it matters."""
    found = (
        _tracking(review),
        _margins(review),
        _noise(review),
        _motors(review),
        _power(review),
        _models(review),
    )
    if review.flight.flights:
        return found
    return tuple(replace(card, state="cannot", number="", sentence="This log holds no flight.") for card in found)


def _good(missing: Sequence[str]) -> State:
    """The state of a card whose every number is good: a part where something was not measured."""
    return "part" if missing else "good"


def _not_measured(missing: Sequence[str]) -> str:
    """What of a question was not measured, as a sentence; empty where everything was."""
    return f" Not measured: {listed(missing)}." if missing else ""


class _Judged(NamedTuple):
    """A number of an axis that a card judges by, with the limit that it should keep to."""

    axis: str
    name: str
    quantity: Quantity
    good_above: float = math.nan
    good_below: float = math.nan

    @property
    def verdict(self) -> State:
        """Good or not over the whole 95 % interval; else it cannot be told."""
        if self.sure_end > 1.0:
            return "look"
        return "good" if self.bad_end <= 1.0 else "cannot"

    @property
    def sure_end(self) -> float:
        """The better end of the interval over its limit: above one it is surely bad, and the worse the larger."""
        return self._over_limit(self.quantity.upper, self.quantity.lower)

    @property
    def bad_end(self) -> float:
        """The worse end of the interval over its limit: up to one it is surely good."""
        return self._over_limit(self.quantity.lower, self.quantity.upper)

    def _over_limit(self, of_high: float, of_low: float) -> float:
        if math.isnan(self.good_above):
            return of_low / self.good_below
        return self.good_above / of_high if of_high > 0.0 else math.inf


def _tracking(review: Review) -> Card:
    title, loops = "Do roll and pitch follow the stick?", review.loops
    swinging = [one.axis for one in review.oscillations]
    if swinging:
        sentence = f"{capital(listed(swinging))} {'oscillates' if len(swinging) == 1 else 'oscillate'}: end that first."
        return Card(key="tracking", title=title, state="cannot", number="", sentence=sentence)
    numbers = {name: loops[name].numbers if name in loops else {} for name in ("p", "q")}
    rises = [
        _Judged(_RATES[name], "rises in", one["rise_time_s"], good_below=SLOW_RISE_S)
        for name, one in numbers.items()
        if "rise_time_s" in one
    ]
    overshoots = [
        _Judged(_RATES[name], "overshoots by", one["overshoot_percent"], good_below=LARGEST_OVERSHOOT_PERCENT)
        for name, one in numbers.items()
        if "overshoot_percent" in one
    ]
    if not rises:
        sentence = "This log does not show how quickly roll and pitch follow their set-points."
        return Card(key="tracking", title=title, state="cannot", number="", sentence=sentence)
    bad, unsure = _sorted([*overshoots, *rises])
    if bad:
        # What bounces is said before what is slow.
        worst = next((one for one in bad if one in overshoots), bad[0])
        sentence = (
            f"{worst.axis.capitalize()} bounces after quick moves. Usually too much P or I, too little D, or a filter "
            "that is too slow."
            if worst in overshoots
            else f"{worst.axis.capitalize()} follows slowly; more P would make it follow quicker."
        )
        return Card(key="tracking", title=title, state="look", number=_number(worst), sentence=sentence)
    if unsure:
        worst = unsure[0]
        limit = f"{LARGEST_OVERSHOOT_PERCENT:.0f} %" if worst in overshoots else f"{1e3 * SLOW_RISE_S:.0f} ms"
        sentence = _unsure(f"{worst.axis} follows well", limit, "fly longer with the sticks moving")
        return Card(key="tracking", title=title, state="cannot", number=_number(worst), sentence=sentence)
    most = max(overshoots, key=lambda one: one.quantity.upper, default=None)
    by = f", with at most {most.quantity.upper:.0f} % overshoot" if most is not None else ""
    axes = [one.axis for one in rises]
    who = f"{capital(listed(axes))} {'follow their set-points' if len(axes) > 1 else 'follows its set-point'}"
    missing = [axis for axis in ("roll", "pitch") if axis not in axes]
    missing += [f"overshoot of {axis}" for axis in axes if axis not in {one.axis for one in overshoots}]
    return Card(
        key="tracking",
        title=title,
        state=_good(missing),
        number=_number(max(rises, key=lambda one: one.quantity.value)),
        sentence=f"{who}{by}.{_not_measured(missing)}",
    )


def _sorted(judged: Sequence[_Judged]) -> tuple[list[_Judged], list[_Judged]]:
    """What is surely bad and what may be, each the worst first."""
    bad = sorted((one for one in judged if one.verdict == "look"), key=lambda one: -one.sure_end)
    unsure = sorted((one for one in judged if one.verdict == "cannot"), key=lambda one: -one.bad_end)
    return bad, unsure


def _unsure(what: str, limit: str, remedy: str) -> str:
    """Why a number gives no verdict, and what would."""
    sentence = f"Not enough data to say whether {what}: the limit of {limit} lies within the interval."
    return f"{sentence} To measure it: {_lower_first(remedy)}" if remedy else sentence


_SHOWN: Mapping[str, tuple[str, float]] = {
    "rises in": (" ms", 1e3),
    "overshoots by": (" %", 1.0),
    "phase margin": ("°", 1.0),
    "M_s": ("", 1.0),
}
"""Unit and factor in which a judged number is shown."""


def _margin_number(review: Review, one: _Judged) -> str:
    """A margin, with the end of a D that moves in flight for which it was computed."""
    margin = review.margins[one.axis]  # type: ignore[index]
    known = margin.numbers.get("crossover_rad_s")
    each = {name: end.get("crossover_rad_s") for name, end in margin.ends.items()}
    same = [name for name, end in each.items() if known and end and math.isclose(end.value, known.value)]
    return f"{_number(one)}{f' with {same[0]}' if len(same) == 1 else ''}"


def _number(one: _Judged) -> str:
    return f"{one.axis} {one.name} {_told(one.quantity, *_SHOWN[one.name])}"


def _margins(review: Review) -> Card:
    title = "How close is it to shaking?"
    if review.oscillations:
        return _shaking(review)
    peaks = [
        _Judged(axis, "M_s", one.numbers["sensitivity_peak"], good_below=LARGEST_SENSITIVITY)
        for axis, one in review.margins.items()
        if "sensitivity_peak" in one.numbers
    ]
    phases = [
        _Judged(axis, "phase margin", one.numbers["phase_margin_deg"], good_above=LEAST_PHASE_MARGIN_DEG)
        for axis, one in review.margins.items()
        if "phase_margin_deg" in one.numbers
    ]
    # Number and sentence are of one loop: of those that are surely bad the worst, then of those that may be.
    bad, unsure = _sorted([*phases, *peaks])
    if bad:
        number, sentence = _margin_number(review, bad[0]), _too_close(bad[0])
        return Card(key="margins", title=title, state="look", number=number, sentence=sentence)
    # Gusts show numbers of an axis whose stick rests, and are no test of its loop.
    excited = [one for one in phases if not review.margins[one.axis].stick_idle]  # type: ignore[index]
    calm = _calm(review)
    if not excited:
        axes = [one.axis for one in phases]
        idle = f" The {listed(axes)} stick{'s' * (len(axes) > 1)} hardly moved." if axes else ""
        sentence = f"{calm}Not enough data to say how much more gain the loops can take.{idle}"
        return Card(key="margins", title=title, state="cannot", number="", sentence=sentence)
    if unsure := [one for one in unsure if one.axis in {known.axis for known in excited}]:
        worst = unsure[0]
        remedy = _remedy(review, f"margins.{worst.axis}.") or _MOVE_MORE.format(axis=worst.axis)
        limit = f"{LEAST_PHASE_MARGIN_DEG:.0f}°" if worst in phases else f"{LARGEST_SENSITIVITY:g}"
        sentence = _unsure(f"the {worst.axis} loop keeps a safe distance from instability", limit, remedy)
        return Card(key="margins", title=title, state="cannot", number=_margin_number(review, worst), sentence=sentence)
    names = [one.axis for one in excited]
    which = "loops keep" if len(names) > 1 else "loop keeps"
    others = [axis for axis in RATE_OF if axis not in names]
    resting = {axis for axis, one in review.margins.items() if one.stick_idle}
    missing = [f"{axis} (its stick hardly moved)" if axis in resting else axis for axis in others]
    missing += [f"M_s of {axis}" for axis in names if axis not in {one.axis for one in peaks}]
    missing += [f"oscillation of {axis}" for axis in names if axis not in review.calm]
    sentence = (
        f"The {listed(names)} {which} a safe distance from instability."
        if not any(one.startswith("M_s") for one in missing)
        else f"The {listed(names)} {which} a phase margin of more than {LEAST_PHASE_MARGIN_DEG:.0f}°."
    )
    least = max(excited, key=lambda one: one.bad_end)
    return Card(
        key="margins",
        title=title,
        state=_good(missing),
        number=_margin_number(review, least),
        sentence=f"{_calm(review, others)}{sentence}{_not_measured(missing)}",
    )


def _shaking(review: Review) -> Card:
    """An axis that swings is beyond all margins."""
    found = review.oscillations
    axes = [one.axis for one in found]
    first = max(found, key=lambda one: one.rms)
    number = "" if first.frequency_hz is None else f"{listed(axes)} {first.frequency_hz:.1f} Hz"
    how = "as listed below" if any(one.gains for one in found) else "to a third"
    sentence = f"{describe(found)} Lower {gain_words(found)} of {listed(axes)} before the next flight, {how}."
    return Card(
        key="margins",
        title="How close is it to shaking?",
        state="look",
        number=number or "it shakes",
        sentence=sentence,
    )


def _calm(review: Review, among: Sequence[str] = ("roll", "pitch")) -> str:
    """Which of some axes do not swing, as far as that was checked; empty where none was."""
    axes = [axis for axis in among if axis in review.calm]
    if not axes:
        return ""
    return f"{capital(listed(axes))} {'does' if len(axes) == 1 else 'do'} not oscillate. "


def _too_close(worst: _Judged) -> str:
    if worst.name == "M_s":
        times = f"{_told(worst.quantity)} times as large"
        return f"The {worst.axis} loop makes some disturbances {times}: less gain, or less delay."
    return f"The {worst.axis} loop has little room: it rings, and a stronger filter or more gain would make it shake."


def _noise(review: Review) -> Card:
    title, noise = "Does it vibrate?", review.noise
    vibration, clipping = noise.numbers.get("vibration_m_s2"), noise.numbers.get("clipping_share")
    number = "" if vibration is None else _told(vibration, " m/s²")
    if review.oscillations:
        axes = [one.axis for one in review.oscillations]
        sentence = f"{capital(listed(axes))} {'oscillates' if len(axes) == 1 else 'oscillate'}: end that first."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    shares = {name: one for name, one in noise.numbers.items() if name.endswith("_d_noise_share")}
    loud = max(shares, key=lambda one: shares[one].value, default=None)
    if not number and loud is not None:
        number = f"{_told(shares[loud], ' %', 100.0)} of the motor range"
    # What share of this flight clipped was counted, and is no estimate.
    if clipping is not None and clipping.value > LARGEST_CLIPPING:
        sentence = "The accelerometer hits its limits: mount it softer, or find what shakes."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    shaken = None if vibration is None else _Judged("", "vibration", vibration, good_below=LARGEST_VIBRATION_M_S2)
    passed = [
        _Judged(name.partition("_")[0], name, one, good_below=LARGEST_NOISE_SHARE) for name, one in shares.items()
    ]
    bad, unsure = _sorted([*([shaken] if shaken else ()), *passed])
    if shaken is not None and shaken in bad:
        sentence = (
            "Vibration is high enough to disturb height and position: balance propellers, look at mount and arms."
        )
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    if bad:
        share = f"{_told(bad[0].quantity, ' %', 100.0)} of their range"
        sentence = f"Noise passes through D of {bad[0].axis} into the motors ({share}): motors may run hot."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    strongest = max(noise.peaks, key=lambda one: one.height_db, default=None)
    where = "" if strongest is None else f" The strongest line is at {strongest.frequency_hz.value:.0f} Hz."
    if unsure and unsure[0] is shaken:
        sentence = _unsure("it vibrates little", f"{LARGEST_VIBRATION_M_S2:.0f} m/s²", "fly longer")
        return Card(key="noise", title=title, state="cannot", number=number, sentence=f"{sentence}{where}")
    if unsure:
        share = f"{_told(unsure[0].quantity, ' %', 100.0)} of the motor range"
        what = f"little noise passes through D of {unsure[0].axis} ({share})"
        sentence = _unsure(what, f"{100.0 * LARGEST_NOISE_SHARE:.0f} %", "fly longer")
        return Card(key="noise", title=title, state="cannot", number=number, sentence=f"{sentence}{where}")
    # A controller whose P was measured and that has no D passes no noise through it.
    axes = [axis for axis in ("roll", "pitch") if any(f"{axis}_{term}_noise_share" in noise.numbers for term in "pd")]
    if shaken is None and not axes:
        sentence = f"This log is too slow, or lacks the channels, to show how strongly it vibrates.{where}"
        return Card(key="noise", title=title, state="cannot", number=number, sentence=sentence)
    missing = [] if shaken is not None else ["vibration"]
    if not {"clipping_share", "clipping_count"} & noise.numbers.keys():
        missing.append("accelerometer at its limits")
    missing += [f"noise through D of {axis}" for axis in ("roll", "pitch") if axis not in axes]
    found = [
        *(["It vibrates little."] if shaken is not None else []),
        *([f"Little noise reaches the motors through D of {listed(axes)}."] if axes else []),
    ]
    sentence = f"{' '.join(found)}{_not_measured(missing)}{where}"
    return Card(key="noise", title=title, state=_good(missing), number=number, sentence=sentence)


def _motors(review: Review) -> Card:
    # Motor outputs alone say nothing of a motor that falls out of step: only logged speeds do.
    checked = review.motors.steps_checked
    title = f"Are the motors balanced{' and in step' * checked}, with room left?"
    motors, numbers = review.motors, review.motors.numbers
    imbalance, headroom, high = (numbers.get(name) for name in ("imbalance", "headroom", "saturated_high_share"))
    logged = "motor_1" in review.logging.rates_hz
    unseen = not logged or any(one.what == "motors" for one in review.cannot_tell)
    if imbalance is None and headroom is None and high is None and unseen:
        sentence = f"Motor outputs are {'not logged in the air' if logged else 'not in this log'}."
        return Card(key="motors", title=title, state="cannot", number="", sentence=sentence)
    # What share of this flight stood at a limit was counted, and is no estimate.
    full = "" if high is None else f"{100.0 * high.value:.1f} %"
    number = f"{full} at full output" if high is not None and high.value > _SELDOM else ""
    if imbalance is not None:
        number = f"{_told(imbalance, ' %', 100.0)} imbalance"
    if motors.events:
        sentence = (
            f"{len(motors.events)} times a motor slowed down while its output rose: look for a desync of its ESC."
        )
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if motors_limited(review.oscillations):
        # The share of the oscillation itself: another count would be another number for the same thing.
        axes = capital(listed([one.axis for one in review.oscillations]))
        most = max(one.at_limit_percent or 0.0 for one in review.oscillations)
        sentence = f"{axes} {'oscillates' if len(review.oscillations) == 1 else 'oscillate'}: end that first."
        return Card(key="motors", title=title, state="look", number=f"{most:.0f} % at a limit", sentence=sentence)
    uneven = None if imbalance is None else _Judged("", "imbalance", imbalance, good_below=LARGEST_IMBALANCE)
    left = None if headroom is None else _Judged("", "headroom", headroom, good_above=LEAST_HEADROOM)
    if uneven is not None and uneven.verdict == "look":
        why = f": {motors.pattern}" if motors.pattern else ""
        sentence = f"The motors do not share the work evenly in steady flight{why}."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if high is not None and high.value > LARGEST_SATURATION:
        sentence = f"A motor stood at full output for {full} of the flight: nothing is left for control then."
        return Card(key="motors", title=title, state="look", number=f"{full} at full output", sentence=sentence)
    if left is not None and left.verdict == "look":
        sentence = "There is little thrust left above hover: lighter, or stronger."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    limits = _at_limits(numbers)
    if uneven is None or left is None:
        why = next((one.why for one in review.cannot_tell if one.what == "motors.imbalance"), "")
        sentence = " ".join(part for part in ("Not enough data to say how evenly they work.", why, limits) if part)
        remedy = _remedy(review, "motors.imbalance")
        if remedy:
            sentence += f" To measure it: {_lower_first(remedy)}"
        return Card(key="motors", title=title, state="cannot", number=number, sentence=sentence)
    hover = "hover for 20 s without touching the sticks"
    if uneven.verdict == "cannot":
        sentence = _unsure("they share the work evenly", f"{100.0 * LARGEST_IMBALANCE:.0f} %", hover)
        return Card(
            key="motors", title=title, state="cannot", number=number, sentence=f"{sentence}{limits and ' '}{limits}"
        )
    room = f"{_told(left.quantity, ' %', 100.0)} of their range is left above it"
    if left.verdict == "cannot":
        sentence = _unsure(f"enough thrust is left above hover ({room})", f"{100.0 * LEAST_HEADROOM:.0f} %", hover)
        return Card(key="motors", title=title, state="cannot", number=number, sentence=sentence)
    missing = [] if high is not None else ["share of the flight at full output"]
    step = " No motor lost step." if checked else ""
    sentence = f"Balanced, with {_told(left.quantity, ' %', 100.0)} headroom in hover.{step}{limits and ' '}{limits}"
    return Card(
        key="motors",
        title=title,
        state=_good(missing),
        number=number,
        sentence=f"{sentence}{_not_measured(missing)}",
    )


def _at_limits(numbers: Mapping[str, Quantity]) -> str:
    """How much of the flight a motor stood at a limit, as far as it did."""
    words = {"saturated_high_share": "at full output", "saturated_low_share": "at its lowest"}
    parts = [
        f"{where} for {100.0 * numbers[name].value:.1f} %"
        for name, where in words.items()
        if name in numbers and numbers[name].value > _SELDOM
    ]
    return f"A motor stood {' and '.join(parts)} of the flight." if parts else ""


def _power(review: Review) -> Card:
    title = "Power and thrust"
    battery, throttle, ratio = review.flight.battery, review.flight.hover_throttle, review.flight.thrust_to_weight
    number = "" if throttle is None else f"hovers at {_told(throttle, ' %', 100.0)} throttle"
    if not number and not battery:
        logged = _POWER & review.logging.rates_hz.keys()
        sentence = (
            "Battery and throttle: not enough data in this flight."
            if logged
            else "Neither battery nor throttle is in this log."
        )
        return Card(key="power", title=title, state="cannot", number="", sentence=sentence)
    sentences: list[str] = []
    verdicts: set[State] = set()
    sagged = False
    if ratio is not None:
        sentences.append(f"Full thrust is {_told(ratio)} times the weight.")
        judged = _Judged("", "thrust", ratio, good_above=LEAST_THRUST_TO_WEIGHT)
        verdicts.add(judged.verdict)
        if judged.verdict == "look":
            sentences.append("That is little.")
        elif judged.verdict == "cannot":
            remedy = "raise the throttle to full for half a second in a safe climb"
            sentences.append(_unsure("that is enough", f"{LEAST_THRUST_TO_WEIGHT:g}", remedy))
    if battery and "start_v" in battery and "lowest_v" in battery:
        start, lowest = battery["start_v"].value, battery["lowest_v"].value
        stop = battery.get("stop_v", battery["lowest_v"]).value
        sentences.append(f"The battery went from {start:.1f} V to {stop:.1f} V, lowest {lowest:.1f} V.")
        if start > 0.0 and "sag_v" in battery:
            sagged, judged = True, _Judged("", "sag", battery["sag_v"], good_below=LARGEST_SAG * start)
            verdicts.add(judged.verdict)
            if judged.verdict == "look":
                sentences.append("It sags much under load: old, cold or too small.")
            elif judged.verdict == "cannot":
                sag = f"it sags little under load ({_told(judged.quantity, ' V')})"
                sentences.append(_unsure(sag, f"{LARGEST_SAG * start:.1f} V", "raise the throttle a few times"))
    missing = [*([] if ratio is not None else ["full thrust over weight"]), *([] if sagged else ["sag under load"])]
    state: State = next((one for one in ("look", "cannot") if one in verdicts), _good(missing))
    if not verdicts:
        state = "cannot"
    sentence = f"{' '.join(sentences)}{_not_measured(missing)}".strip()
    return Card(key="power", title=title, state=state, number=number, sentence=sentence)


def _models(review: Review) -> Card:
    title = "What can be built on this flight"
    stands = _standing(review)
    if not review.models_sought:
        sentence = "Models were not looked for (--no-models)."
        return Card(key="models", title=title, state="cannot", number="", sentence=sentence)
    if not stands:
        sentence = "No model of the vehicle can be identified from it; see below for what to fly or log."
        return Card(key="models", title=title, state="cannot", number="", sentence=sentence)
    # What the log does not support is no lack of the models that it does.
    sought = [name for name in review.models if name in stands or name not in review.unsupported]
    number = f"{len(stands)} of {len(sought)} models" if len(sought) > len(stands) else _models_words(len(stands))
    sentence = f"Identified with intervals: {', '.join(stands)}."
    doubted: dict[str, list[str]] = {}
    for name, model in stands.items():
        found = verdict(model)
        if found.color != "green":
            doubted.setdefault(found.word, []).append(name)
        if any(one.kind == "poor_verification" for one in model.findings):
            doubted.setdefault("misses unseen flight", []).append(name)
    sentence += "".join(f" {capital(word)}: {', '.join(names)}." for word, names in doubted.items())
    lacking = [name for name in sought if name not in stands]
    sentence += f" Not identified: {', '.join(lacking)}." if lacking else ""
    sentence += f" Not enough data: {', '.join(review.unsupported)}." if review.unsupported else ""
    if without_sweep(review):
        sentence += " A sweep would make them several times as certain."
    return Card(key="models", title=title, state=_good([*doubted, *lacking]), number=number, sentence=sentence)


def _models_words(count: int) -> str:
    return f"{count} model{'s' if count > 1 else ''}"


def _standing(review: Review) -> dict[str, IdentifiedModel]:
    return {name: one for name, one in review.models.items() if isinstance(one, IdentifiedModel)}


def without_sweep(review: Review) -> bool:
    """Whether the models of a review were identified without any maneuver that was made for it."""
    flown = (one for model in _standing(review).values() for one in model.provenance.maneuvers)
    return not any(one.kind in RICH_KINDS for one in flown)


def _remedy(review: Review, what: str) -> str:
    """The first thing to do about what a flight cannot tell of something; empty where nothing is known."""
    return next((one.remedy for one in review.cannot_tell if one.what.startswith(what) and one.remedy), "")


def _lower_first(sentence: str) -> str:
    """A sentence as it goes on behind a colon."""
    ended = sentence if sentence.endswith(".") else f"{sentence}."
    return ended if ended[1:2].isupper() else f"{ended[:1].lower()}{ended[1:]}"


_EVEN = 0.25
"""An interval whose halves differ by less, over their mean, is told as one half."""


def _told(quantity: Quantity, unit: str = "", factor: float = 1.0) -> str:
    """A number with its 95 % interval, both as precise as that allows: by its half, or by both ends if it is skewed."""
    value, lower, upper = (factor * one for one in (quantity.value, quantity.lower, quantity.upper))
    half = 0.5 * (upper - lower)
    if not half > 0.0:
        return f"{value:.3g}{unit}"
    digits = _digits(value - lower if math.isinf(half) else half)
    if abs(upper + lower - 2.0 * value) <= _EVEN * half < math.inf:
        return _minus(f"{value:.{digits}f} ± {half:.{digits}f}{unit}")
    ends = [f"{end:.{digits}f}" if math.isfinite(end) else "∞" for end in (lower, upper)]
    return _minus(f"{value:.{digits}f}{unit} ({ends[0]} to {ends[1]}{unit})")


def _digits(half: float) -> int:
    """Places behind the point that the half of an interval warrants: two digits of one that starts with a one."""
    if not 0.0 < half < math.inf:
        return 0
    first, _, leading = f"{half:.1e}".partition("e")
    return max(0, -int(leading) + (float(first) < 2.0))


def _minus(text: str) -> str:
    return text.replace("-", "−")
