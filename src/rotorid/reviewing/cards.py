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
from rotorid.data.quantities import QUANTITIES, FigureOfMerit
from rotorid.data.quantity import Quantity
from rotorid.data.trust import RICH_KINDS
from rotorid.flights.oscillations import describe, gain_words, motors_limited
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Color
from rotorid.results.verdicts import verdict
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

_SELDOM = 5e-4
"""Share of the flight at a limit below which nothing is said of it."""

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


class _LimitedNumber(NamedTuple):
    """A number of an axis that a card judges by, with its row; ``per`` is what its limit is a share of."""

    axis: str
    name: str
    figure: FigureOfMerit
    quantity: Quantity
    per: float = 1.0

    @property
    def verdict(self) -> State:
        """Good or not over the whole 95 % interval; else there is not enough data."""
        return self.figure.judged(self.quantity, self.per)

    @property
    def sure_end(self) -> float:
        """The better end of the interval over its limit: above one it is surely bad, and the worse the larger."""
        return self._over_limit(self.quantity.upper, self.quantity.lower)

    @property
    def bad_end(self) -> float:
        """The worse end of the interval over its limit: up to one it is surely good."""
        return self._over_limit(self.quantity.lower, self.quantity.upper)

    def _over_limit(self, of_high: float, of_low: float) -> float:
        limit = self.per * self.figure.limit
        if math.isnan(self.figure.good_above):
            return of_low / limit
        return limit / of_high if of_high > 0.0 else math.inf

    @property
    def shown(self) -> str:
        """The number with its axis, in one line."""
        return f"{self.axis} {self.figure.before} {self.figure.shown(self.quantity)}"

    @property
    def trouble(self) -> str:
        """What it means beyond its limit."""
        return self._filled(self.figure.trouble)

    def unsure(self, remedy: str = "") -> str:
        """Why it gives no verdict, and what would."""
        whether, limit = self._filled(self.figure.whether), self.figure.limit_text(self.per)
        sentence = f"Not enough data to say whether {whether}: the limit of {limit} lies within the interval."
        remedy = remedy or self.figure.surer
        return f"{sentence} To measure it: {_lower_first(remedy)}" if remedy else sentence

    def _filled(self, words: str) -> str:
        return words.format(axis=self.axis, Axis=self.axis.capitalize(), value=self.figure.shown(self.quantity))


def _judged(card: str, numbers: Mapping[str, Quantity], axis: str = "") -> list[_LimitedNumber]:
    """The numbers that a card judges by, in the order of their table; without an axis, their names begin with it."""
    return [
        _LimitedNumber(
            axis=axis or name.partition("_")[0],
            name=name,
            figure=row,
            quantity=numbers[name],
            per=numbers[row.per].value if row.per else 1.0,
        )
        for name, row in QUANTITIES.items()
        if row.card == card and {name, row.per or name} <= numbers.keys()
    ]


def _tracking(review: Review) -> Card:
    title, loops = "Do roll and pitch follow the stick?", review.loops
    swinging = [oscillation.axis for oscillation in review.oscillations]
    if swinging:
        sentence = f"{capital(listed(swinging))} {'oscillates' if len(swinging) == 1 else 'oscillate'}: end that first."
        return Card(key="tracking", title=title, state="cannot", number="", sentence=sentence)
    judged = [
        oscillation
        for name in ("p", "q")
        if name in loops
        for oscillation in _judged("tracking", loops[name].numbers, _RATES[name])
    ]
    rises = [oscillation for oscillation in judged if oscillation.name == "rise_time_s"]
    overshoots = [oscillation for oscillation in judged if oscillation.name == "overshoot_percent"]
    if not rises:
        sentence = "This log does not show how quickly roll and pitch follow their set-points."
        return Card(key="tracking", title=title, state="cannot", number="", sentence=sentence)
    bad, unsure = _sorted(judged)
    if bad:
        # What bounces is said before what is slow.
        worst = next((number for number in bad if number not in rises), bad[0])
        return Card(key="tracking", title=title, state="look", number=worst.shown, sentence=worst.trouble)
    if unsure:
        worst = unsure[0]
        return Card(key="tracking", title=title, state="cannot", number=worst.shown, sentence=worst.unsure())
    most = max(overshoots, key=lambda number: number.quantity.upper, default=None)
    by = f", with at most {most.quantity.upper:.0f} % overshoot" if most is not None else ""
    axes = [number.axis for number in rises]
    who = f"{capital(listed(axes))} {'follow their set-points' if len(axes) > 1 else 'follows its set-point'}"
    missing = [axis for axis in ("roll", "pitch") if axis not in axes]
    missing += _lacking("tracking", axes, judged)
    return Card(
        key="tracking",
        title=title,
        state=_good(missing),
        number=max(rises, key=lambda number: number.quantity.value).shown,
        sentence=f"{who}{by}.{_not_measured(missing)}",
    )


def _lacking(card: str, axes: Sequence[str], judged: Sequence[_LimitedNumber]) -> list[str]:
    """Numbers of a card that some axes lack, in words."""
    known = {(number.axis, number.name) for number in judged}
    rows = {name: row for name, row in QUANTITIES.items() if row.card == card}
    return [f"{row.words} of {axis}" for axis in axes for name, row in rows.items() if (axis, name) not in known]


def _sorted(judged: Sequence[_LimitedNumber]) -> tuple[list[_LimitedNumber], list[_LimitedNumber]]:
    """What is surely bad and what may be, each the worst first."""
    bad = sorted((number for number in judged if number.verdict == "look"), key=lambda number: -number.sure_end)
    unsure = sorted((number for number in judged if number.verdict == "cannot"), key=lambda number: -number.bad_end)
    return bad, unsure


def _margin_number(review: Review, number: _LimitedNumber) -> str:
    """A margin, with the end of a D that moves in flight for which it was computed."""
    margin = review.margins[number.axis]  # type: ignore[index]
    known = margin.numbers.get("crossover_rad_s")
    each = {name: end.get("crossover_rad_s") for name, end in margin.ends.items()}
    same = [name for name, end in each.items() if known and end and math.isclose(end.value, known.value)]
    return f"{number.shown}{f' with {same[0]}' if len(same) == 1 else ''}"


def _margins(review: Review) -> Card:
    title = "How close is it to shaking?"
    if review.oscillations:
        return _shaking(review)
    judged = [item for axis, margin in review.margins.items() for item in _judged("margins", margin.numbers, axis)]
    phases = [margin for margin in judged if margin.name == "phase_margin_deg"]
    # Number and sentence are of one loop: of those that are surely bad the worst, then of those that may be.
    bad, unsure = _sorted(judged)
    if bad:
        number, sentence = _margin_number(review, bad[0]), bad[0].trouble
        return Card(key="margins", title=title, state="look", number=number, sentence=sentence)
    # Gusts show numbers of an axis whose stick rests, and are no test of its loop.
    excited = [number for number in phases if not review.margins[number.axis].stick_idle]  # type: ignore[index]
    calm = _calm(review)
    if not excited:
        axes = [number.axis for number in phases]
        idle = f" The {listed(axes)} stick{'s' * (len(axes) > 1)} hardly moved." if axes else ""
        sentence = f"{calm}Not enough data to say how much more gain the loops can take.{idle}"
        return Card(key="margins", title=title, state="cannot", number="", sentence=sentence)
    if unsure := [number for number in unsure if number.axis in {known.axis for known in excited}]:
        worst = unsure[0]
        remedy = _remedy(review, f"margins.{worst.axis}.") or _MOVE_MORE.format(axis=worst.axis)
        number, sentence = _margin_number(review, worst), worst.unsure(remedy)
        return Card(key="margins", title=title, state="cannot", number=number, sentence=sentence)
    names = [number.axis for number in excited]
    which = "loops keep" if len(names) > 1 else "loop keeps"
    others = [axis for axis in RATE_OF if axis not in names]
    resting = {axis for axis, margin in review.margins.items() if margin.stick_idle}
    missing = [f"{axis} (its stick hardly moved)" if axis in resting else axis for axis in others]
    missing += (unknown := _lacking("margins", names, judged))
    missing += [f"oscillation of {axis}" for axis in names if axis not in review.calm]
    sentence = (
        f"The {listed(names)} {which} a safe distance from instability."
        if not unknown
        else f"The {listed(names)} {which} a phase margin of more than {phases[0].figure.limit_text()}."
    )
    least = max(excited, key=lambda number: number.bad_end)
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
    axes = [oscillation.axis for oscillation in found]
    first = max(found, key=lambda oscillation: oscillation.rms)
    number = "" if first.frequency_hz is None else f"{listed(axes)} {first.frequency_hz:.1f} Hz"
    how = "as listed below" if any(oscillation.gains for oscillation in found) else "to a third"
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


def _noise(review: Review) -> Card:
    title, noise = "Does it vibrate?", review.noise
    vibration, clipping = noise.numbers.get("vibration_m_s2"), noise.numbers.get("clipping_share")
    number = "" if vibration is None else QUANTITIES["vibration_m_s2"].shown(vibration)
    if review.oscillations:
        axes = [oscillation.axis for oscillation in review.oscillations]
        sentence = f"{capital(listed(axes))} {'oscillates' if len(axes) == 1 else 'oscillate'}: end that first."
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    judged = _judged("noise", noise.numbers)
    shares = [oscillation for oscillation in judged if oscillation.name.endswith("_d_noise_share")]
    loud = max(shares, key=lambda oscillation: oscillation.quantity.value, default=None)
    if not number and loud is not None:
        number = f"{loud.figure.shown(loud.quantity)} of the motor range"
    # What share of this flight clipped was counted, and is no estimate.
    if clipping is not None and clipping.value > QUANTITIES["clipping_share"].limit:
        sentence = QUANTITIES["clipping_share"].trouble
        return Card(key="noise", title=title, state="look", number=number, sentence=sentence)
    shaken = next((oscillation for oscillation in judged if oscillation.name == "vibration_m_s2"), None)
    bad, unsure = _sorted([oscillation for oscillation in judged if oscillation.name != "clipping_share"])
    if bad:
        worst = shaken if shaken in bad else bad[0]
        return Card(key="noise", title=title, state="look", number=number, sentence=worst.trouble)
    strongest = max(noise.peaks, key=lambda peak: peak.height_db, default=None)
    where = "" if strongest is None else f" The strongest line is at {strongest.frequency_hz.value:.0f} Hz."
    if unsure:
        return Card(key="noise", title=title, state="cannot", number=number, sentence=f"{unsure[0].unsure()}{where}")
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
    unseen = not logged or any(gap.what == "motors" for gap in review.cannot_tell)
    if imbalance is None and headroom is None and high is None and unseen:
        sentence = f"Motor outputs are {'not logged in the air' if logged else 'not in this log'}."
        return Card(key="motors", title=title, state="cannot", number="", sentence=sentence)
    # What share of this flight stood at a limit was counted, and is no estimate.
    full = "" if high is None else f"{100.0 * high.value:.1f} %"
    number = f"{full} at full output" if high is not None and high.value > _SELDOM else ""
    judged = {gap.name: gap for gap in _judged("motors", numbers)}
    uneven, left = judged.get("imbalance"), judged.get("headroom")
    if uneven is not None:
        number = f"{uneven.figure.shown(uneven.quantity)} imbalance"
    if motors.events:
        sentence = (
            f"{len(motors.events)} times a motor slowed down while its output rose: look for a desync of its ESC."
        )
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if motors_limited(review.oscillations):
        # The share of the oscillation itself: another count would be another number for the same thing.
        axes = capital(listed([oscillation.axis for oscillation in review.oscillations]))
        most = max(oscillation.at_limit_percent or 0.0 for oscillation in review.oscillations)
        sentence = f"{axes} {'oscillates' if len(review.oscillations) == 1 else 'oscillate'}: end that first."
        return Card(key="motors", title=title, state="look", number=f"{most:.0f} % at a limit", sentence=sentence)
    if uneven is not None and uneven.verdict == "look":
        why = f": {motors.pattern}" if motors.pattern else ""
        sentence = f"The motors do not share the work evenly in steady flight{why}."
        return Card(key="motors", title=title, state="look", number=number, sentence=sentence)
    if high is not None and high.value > QUANTITIES["saturated_high_share"].limit:
        sentence = f"A motor stood at full output for {full} of the flight: nothing is left for control then."
        return Card(key="motors", title=title, state="look", number=f"{full} at full output", sentence=sentence)
    # Shares at a limit were counted, and are no estimates.
    estimated = [gap for gap in judged.values() if not gap.name.startswith("saturated")]
    bad, _ = _sorted(estimated)
    if bad:
        return Card(key="motors", title=title, state="look", number=number, sentence=bad[0].trouble)
    limits = _at_limits(numbers)
    if uneven is None or left is None:
        why = next((gap.why for gap in review.cannot_tell if gap.what == "motors.imbalance"), "")
        sentence = " ".join(part for part in ("Not enough data to say how evenly they work.", why, limits) if part)
        remedy = _remedy(review, "motors.imbalance")
        if remedy:
            sentence += f" To measure it: {_lower_first(remedy)}"
        return Card(key="motors", title=title, state="cannot", number=number, sentence=sentence)
    unsure = next((gap for gap in estimated if gap.verdict == "cannot"), None)
    if unsure is not None:
        sentence = f"{unsure.unsure()}{limits and ' '}{limits}"
        return Card(key="motors", title=title, state="cannot", number=number, sentence=sentence)
    missing = [] if high is not None else ["share of the flight at full output"]
    step = " No motor lost step." if checked else ""
    sentence = f"Balanced, with {left.figure.shown(left.quantity)} headroom in hover.{step}{limits and ' '}{limits}"
    return Card(
        key="motors",
        title=title,
        state=_good(missing),
        number=number,
        sentence=f"{sentence}{_not_measured(missing)}",
    )


def _at_limits(numbers: Mapping[str, Quantity]) -> str:
    """How much of the flight a motor stood at a limit, as far as it did."""
    parts = [
        f"{QUANTITIES[name].short} for {100.0 * numbers[name].value:.1f} %"
        for name in ("saturated_high_share", "saturated_low_share")
        if name in numbers and numbers[name].value > _SELDOM
    ]
    return f"A motor stood {' and '.join(parts)} of the flight." if parts else ""


def _power(review: Review) -> Card:
    title = "Power and thrust"
    battery, throttle, ratio = review.flight.battery, review.flight.hover_throttle, review.flight.thrust_to_weight
    number = "" if throttle is None else f"hovers at {QUANTITIES['hover_throttle'].shown(throttle)} throttle"
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

    def judge(found: Sequence[_LimitedNumber]) -> None:
        verdicts.update(number.verdict for number in found)
        sentences.extend(
            number.trouble if number.verdict == "look" else number.unsure()
            for number in found
            if number.verdict != "good"
        )

    if ratio is not None:
        sentences.append(f"Full thrust is {QUANTITIES['thrust_to_weight'].shown(ratio)} times the weight.")
        judge(_judged("power", {"thrust_to_weight": ratio}))
    if battery and "start_v" in battery and "lowest_v" in battery:
        start, lowest = battery["start_v"].value, battery["lowest_v"].value
        stop = battery.get("stop_v", battery["lowest_v"]).value
        sentences.append(f"The battery went from {start:.1f} V to {stop:.1f} V, lowest {lowest:.1f} V.")
        if start > 0.0:
            sagged = "sag_v" in battery
            judge(_judged("power", battery))
    missing = [*([] if ratio is not None else ["full thrust over weight"]), *([] if sagged else ["sag under load"])]
    state: State = next((state for state in ("look", "cannot") if state in verdicts), _good(missing))
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
        if any(finding.kind == "poor_verification" for finding in model.findings):
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
    return {name: model for name, model in review.models.items() if isinstance(model, IdentifiedModel)}


def without_sweep(review: Review) -> bool:
    """Whether the models of a review were identified without any maneuver that was made for it."""
    flown = (maneuver for model in _standing(review).values() for maneuver in model.provenance.maneuvers)
    return not any(maneuver.kind in RICH_KINDS for maneuver in flown)


def _remedy(review: Review, what: str) -> str:
    """The first thing to do about what a flight cannot tell of something; empty where nothing is known."""
    return next((gap.remedy for gap in review.cannot_tell if gap.what.startswith(what) and gap.remedy), "")


def _lower_first(sentence: str) -> str:
    """A sentence as it goes on behind a colon."""
    ended = sentence if sentence.endswith(".") else f"{sentence}."
    return ended if ended[1:2].isupper() else f"{ended[:1].lower()}{ended[1:]}"
