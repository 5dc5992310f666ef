"""The first screen of a review: a handful of judgments in words that need no control theory.

A card asks one question. It is green only where every part of the question was measured and is good, and it names the
parts that were not measured. A part that needs a look goes before everything that is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rotorid.autopilots.advice import move_stick
from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital, counted, listed
from rotorid.data.quantities import QUANTITIES, words_of_path
from rotorid.data.quantity import Quantity
from rotorid.data.trust import RICH_KINDS
from rotorid.flights.oscillations import describe, gain_words, motors_limited
from rotorid.results.model import IdentifiedModel
from rotorid.results.verdicts import verdict
from rotorid.reviewing.baseline import balance_words, shown_change
from rotorid.reviewing.card import (
    Card,
    LimitedNumber,
    State,
    bad_and_unsure,
    judged_numbers,
    lacking_numbers,
    lower_first,
    together,
)
from rotorid.reviewing.filters import MOTOR_NOISE_SCALE, filter_card
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.motors import EVEN, possible_causes
from rotorid.reviewing.values import MarginReview, Review
from rotorid.signal.witnesses import MOTION
from rotorid.tuning.judging import VERDICT_NAMES, WORST_FIRST, Verdict
from rotorid.typing import Axis

_SELDOM = 5e-4
"""Share of the flight at a limit that is too small to mention."""


_POWER = {"battery_voltage", "thrust_command", "thrust_stick", "motor_1"}
_RATES = {rate: axis for axis, rate in RATE_OF.items()}


def interval_words(answers: Sequence[Card]) -> str:
    """What ± says in cards, which is another thing in tables of models; empty where they state no interval.

    Examples
    --------
    >>> interval_words([Card(key="power", title="Enough power?", state="good", headline="Yes.", number="2.0 ± 0.1")])
    '± and ranges in parentheses are 95 % intervals.'
    """
    shown = any("±" in f"{card.number}{card.headline}{card.details}" for card in answers)
    return "± and ranges in parentheses are 95 % intervals." if shown else ""


def cards(review: Review) -> tuple[Card, ...]:
    """What a pilot should know first, in the order in which it matters."""
    found = (
        _tracking(review),
        _margins(review),
        _noise(review),
        filter_card(review),
        _motors(review),
        _power(review),
        _models(review),
    )
    if review.flight.flights:
        return tuple(_as_flown(_with_loss(card, review), review) for card in found)
    first, *others = (
        Card(key=card.key, title=card.title, state="cannot", headline=no_flight(review)) for card in found
    )
    gap = _gap(review, "flight") or Unavailable(what="flight", why="")
    remedy = gap.remedy if gap.remedy and not _never_flew(review) else "fly, and log from take-off to landing"
    return replace(first, details=_sentence(gap.why), remedy=remedy), *others


def _as_flown(card: Card, review: Review) -> Card:
    """A card that is not green where motion alone shows a flight: a vehicle that is carried about moves too."""
    if card.state != "good" or not review.flight.seen_in.startswith(MOTION):
        return card
    only = "Only motion shows that it flew: log thrust, motors, height or the landed flag."
    return replace(card, state="part", details=together(card.details, only))


def no_flight(review: Review) -> str:
    """That a log contains no flight, or does not show whether it does, as a sentence."""
    if failed := next((gap.why for gap in review.cannot_tell if gap.what == "flight" and gap.fault), ""):
        return failed
    if of_bench(review):
        return "This log is of a bench, where nothing flies."
    if _never_flew(review) or _gap(review, "flight") is None:
        return "This log contains no flight."
    return "This log does not show whether the vehicle flew."


def of_bench(review: Review) -> str:
    """That a log is of a bench, and with what, as a sentence; empty for others."""
    found = next((finding.message for finding in review.findings if finding.kind == "bench_log"), "")
    return found.replace(review.name, "This", 1)


def _never_flew(review: Review) -> bool:
    return any(finding.kind == "never_airborne" for finding in review.findings)


def _sentence(words: str) -> str:
    return f"{words.rstrip('.')}." if words else ""


def _with_loss(card: Card, review: Review) -> Card:
    """A card that asks for what a loss of control came from; the flight before the loss may look healthy."""
    lost = review.control
    if lost is None or lost.lost_at_s is None or card.key != ("power" if lost.cause == "power lost" else "motors"):
        return card
    motor = lost.numbers.get("motor")
    if card.key == "power":
        headline, check = "Thrust was lost in flight", "check battery, connectors, ESCs and the power supply"
    elif motor is not None:
        headline = f"Motor {motor:.0f} was at its limit when control was lost"
        check = "check this motor, its ESC and its propeller first"
    else:
        headline, check = "Control was lost", "check motors, ESCs and propellers"
    return Card(
        key=card.key,
        title=card.title,
        state="look",
        headline=f"{headline}, at {lost.lost_at_s:.1f} s.",
        details=f"Before the next flight, {check}. Before that moment: {lower_first(card.headline)}",
    )


def _good(missing: Sequence[str]) -> State:
    """The state of a card whose every number is good: a part where something was not measured."""
    return "part" if missing else "good"


def _not_measured(missing: Sequence[str]) -> str:
    """What of a question was not measured, as a sentence; empty where everything was."""
    return f"Not measured: {listed(missing)}." if missing else ""


def _unanswered(key: str, title: str, gap: Unavailable | None, otherwise: str, details: str = "") -> Card:
    """A card without an answer: what was missing, and the one remedy.

    Parameters
    ----------
    gap
        What of the question was not measured first.
    otherwise
        What was missing where no reason is known.
    details
        What is known all the same.
    """
    why, _, more = (otherwise if gap is None else gap.why).partition(". ")
    return Card(
        key=key,
        title=title,
        state="cannot",
        headline=f"{capital(why).rstrip('.')}.",
        details=together(details, more),
        remedy="" if gap is None else gap.remedy,
    )


def _tracking(review: Review) -> Card:
    key, title, loops = "tracking", "Do roll and pitch follow the stick?", review.loops
    if review.oscillations:
        return Card(key=key, title=title, state="cannot", headline=_stop_first(review))
    judged = [
        number
        for name in ("p", "q")
        if name in loops
        for number in judged_numbers(key, loops[name].numbers, _RATES[name])
    ]
    rises = [number for number in judged if number.name == "rise_time_s"]
    overshoots = [number for number in judged if number.name == "overshoot_percent"]
    if not rises:
        gap = _gap(review, "loops.p", "loops.q", "loops")
        return _unanswered(key, title, gap, "this log does not show how roll and pitch follow.")
    bad, unsure = bad_and_unsure(judged)
    if bad:
        # What bounces is mentioned before what is slow.
        return next((number for number in bad if number not in rises), bad[0]).bad(key, title)
    if unsure:
        return unsure[0].doubtful(key, title)
    most = max(overshoots, key=lambda number: number.quantity.upper, default=None)
    by = f", with at most {most.quantity.upper:.0f} % overshoot" if most is not None else ""
    axes = [number.axis for number in rises]
    missing = [axis for axis in ("roll", "pitch") if axis not in axes]
    missing += lacking_numbers(key, axes, judged)
    slowest = max(rises, key=lambda number: number.quantity.value)
    return Card(
        key=key,
        title=title,
        state=_good(missing),
        headline=f"{capital(listed(axes))} {'follow' if len(axes) > 1 else 'follows'} well{by}.",
        number=slowest.shown,
        scale=slowest.scale,
        details=_not_measured(missing),
    )


def _stop_first(review: Review) -> str:
    """What keeps a flight that oscillates from answering anything else."""
    axes = [oscillation.axis for oscillation in review.oscillations]
    return f"{capital(listed(axes))} {'oscillates' if len(axes) == 1 else 'oscillate'}: stop that first."


def _ends(margin: MarginReview) -> dict[str, Mapping[str, Quantity]]:
    """The margins that are stated, and those at the other ends of a D that moves in flight, each by its end."""
    known = margin.numbers.get("crossover_rad_s")
    each = {name: end.get("crossover_rad_s") for name, end in margin.ends.items()}
    same = [name for name, end in each.items() if known and end and math.isclose(end.value, known.value)]
    main = same[0] if len(same) == 1 else ""
    return {main: margin.numbers} | {name: end for name, end in margin.ends.items() if name not in same}


def _margin_number(review: Review, number: LimitedNumber) -> str:
    """A margin, with the end of a D that moves in flight for which it was computed."""
    ends = _ends(review.margins[number.axis])  # type: ignore[index]
    end = next(name for name, numbers in ends.items() if numbers.get(number.name) is number.quantity)
    return f"{number.shown}{f' with {end}' if end else ''}"


def _margins(review: Review) -> Card:
    key, title = "margins", "How close is it to shaking?"
    if review.oscillations:
        return _shaking(review, key, title)
    card = _far_from_shaking(review, key, title)
    verdicts = {axis: margin.verdict.verdict for axis, margin in review.margins.items() if margin.verdict is not None}
    if not verdicts:
        return card
    refused = [
        axis for axis, found in verdicts.items() if found == "do_not_fly" and not review.margins[axis].stick_idle
    ]
    if refused and card.state in ("good", "part"):
        loops = f"The {listed(refused)} loop{'s are' if len(refused) > 1 else ' is'}"
        card = replace(card, state="look", headline=f"{loops} too close to shaking on a likely vehicle.")
    return replace(card, details=together(_verdict_words(verdicts), card.details))


def _verdict_words(verdicts: Mapping[Axis, Verdict]) -> str:
    """The verdict on the flown gains, the worst first."""
    found = [
        f"{VERDICT_NAMES[words]} ({listed(axes)})"
        for words in WORST_FIRST
        if (axes := [axis for axis, each in verdicts.items() if each == words])
    ]
    return f"Verdict on the flown gains: {listed(found)}."


def _far_from_shaking(review: Review, key: str, title: str) -> Card:
    """The answer by the margins themselves."""
    # A D that moves in flight passes both of its ends, and each has to be safe.
    judged = [
        item
        for axis, margin in review.margins.items()
        for numbers in _ends(margin).values()
        for item in judged_numbers(key, numbers, axis)
    ]
    phases = [margin for margin in judged if margin.name == "phase_margin_deg"]
    # Number and sentence are of one loop: of those that are surely bad the worst, then of those that may be.
    bad, unsure = bad_and_unsure(judged)
    if bad:
        return bad[0].bad(key, title, _margin_number(review, bad[0]))
    # Gusts show numbers of an axis whose stick is idle, and are no test of its loop.
    excited = [number for number in phases if not review.margins[number.axis].stick_idle]  # type: ignore[index]
    if not excited:
        axes = [axis for axis in review.margins if any(number.axis == axis for number in phases)]
        gap = _gap(review, "margins")
        if axes:
            why = f"the {listed(axes)} stick{'s' * (len(axes) > 1)} barely moved."
            gap = Unavailable(what=key, why=why, remedy=_remedy(review, "margins") or move_stick(axes[0]))
        return _unanswered(
            key, title, gap, "this log does not show how much more gain the loops can take.", _calm(review)
        )
    if unsure := [number for number in unsure if number.axis in {known.axis for known in excited}]:
        worst = unsure[0]
        remedy = _remedy(review, f"margins.{worst.axis}.") or move_stick(worst.axis)  # type: ignore[arg-type]
        return worst.doubtful(key, title, number=_margin_number(review, worst), remedy=remedy)
    names = list(dict.fromkeys(number.axis for number in excited))
    loops = f"The {listed(names)} loop{'s' * (len(names) > 1)}"
    others = [axis for axis in RATE_OF if axis not in names]
    idle = {axis for axis, margin in review.margins.items() if margin.stick_idle}
    missing = [f"{axis} (its stick barely moved)" if axis in idle else axis for axis in others]
    missing += (unknown := lacking_numbers(key, names, judged))
    missing += [f"oscillation of {axis}" for axis in names if axis not in review.calm]
    headline = (
        f"{loops} {'are' if len(names) > 1 else 'is'} far from oscillation."
        if not unknown
        else f"{loops} {'have' if len(names) > 1 else 'has'} a phase margin above {phases[0].figure.limit_text()}."
    )
    least = max(excited, key=lambda number: number.bad_end)
    return Card(
        key=key,
        title=title,
        state=_good(missing),
        headline=headline,
        number=_margin_number(review, least),
        scale=least.scale,
        quantity=least.name,
        details=together(_calm(review, others), _not_measured(missing)),
    )


def _shaking(review: Review, key: str, title: str) -> Card:
    """An axis that swings is beyond all margins."""
    found = review.oscillations
    axes = [oscillation.axis for oscillation in found]
    first = max(found, key=lambda oscillation: oscillation.rms)
    number = "" if first.frequency_hz is None else f"{listed(axes)} {first.frequency_hz:.1f} Hz"
    how = "as listed below" if any(oscillation.gains for oscillation in found) else "to a third"
    return Card(
        key=key,
        title=title,
        state="look",
        headline=describe(found),
        number=number or "it shakes",
        details=f"Lower {gain_words(found)} of {listed(axes)} before the next flight, {how}.",
    )


def _calm(review: Review, among: Sequence[str] = ("roll", "pitch")) -> str:
    """Which of some axes do not swing, as far as that was checked; empty where none was."""
    axes = [axis for axis in among if axis in review.calm]
    return f"{capital(listed(axes))} {'does' if len(axes) == 1 else 'do'} not oscillate." if axes else ""


def _noise(review: Review) -> Card:
    key, title, noise = "noise", "Does it vibrate?", review.noise
    judged = judged_numbers(key, noise.numbers)
    shaken = next((number for number in judged if number.name == "vibration_m_s2"), None)
    shares = [number for number in judged if number.name.endswith("_d_noise_share")]
    loud = max(shares, key=lambda number: number.quantity.value, default=None)
    first = shaken or loud
    number = "" if first is None else first.figure.shown(first.quantity)
    scale = "" if first is None else first.scale
    if first is not None and first is loud:
        number, scale = f"{first.figure.before} {number} of the motor range", MOTOR_NOISE_SCALE
    if review.oscillations:
        return Card(key=key, title=title, state="look", headline=_stop_first(review), number=number, scale=scale)
    clipping = noise.numbers.get("clipping_share")
    # What share of this flight clipped was counted, and is no estimate.
    if clipping is not None and clipping.value > QUANTITIES["clipping_share"].limit:
        headline, _, details = QUANTITIES["clipping_share"].trouble.partition(". ")
        return Card(
            key=key,
            title=title,
            state="look",
            headline=f"{headline}.",
            number=number,
            scale=scale,
            details=details,
        )
    bad, unsure = bad_and_unsure([number for number in judged if number.name != "clipping_share"])
    if risen := _risen_vibration(review):
        return Card(key=key, title=title, state="look", headline=risen[0], number=number, scale=scale, details=risen[1])
    if bad:
        worst = shaken if shaken is not None and shaken in bad else bad[0]
        return replace(worst.bad(key, title, number), scale=scale)
    strongest = max(noise.peaks, key=lambda peak: peak.height_db, default=None)
    where = "" if strongest is None else f"The strongest vibration is at {strongest.frequency_hz.value:.0f} Hz."
    if unsure:
        return replace(unsure[0].doubtful(key, title, number=number, details=where), scale=scale)
    # A controller whose P was measured and that has no D passes no noise through it.
    axes = [axis for axis in ("roll", "pitch") if any(f"{axis}_{term}_noise_share" in noise.numbers for term in "pd")]
    if shaken is None and not axes:
        gap = _gap(review, "noise.vibration", "noise")
        return _unanswered(key, title, gap, "this log is too slow, or lacks the channels.", where)
    missing = [] if shaken is not None else ["vibration"]
    if not {"clipping_share", "clipping_count"} & noise.numbers.keys():
        missing.append("accelerometer at its limits")
    if unknown := [axis for axis in ("roll", "pitch") if axis not in axes]:
        missing.append(f"noise through D of {listed(unknown)}")
    passed = f"little noise reaches the motors through D of {listed(axes)}" if axes else ""
    answers = [*(["vibration is low"] if shaken is not None else []), *([passed] if passed else [])]
    headline = f"{capital(listed(answers))}."
    if shaken is None:
        # The question is not answered by what the motors get.
        gap = _gap(review, "noise.vibration")
        why = "" if gap is None else gap.why.partition(". ")[0].rstrip(".")
        headline = together(f"Vibration was not measured{f': {why[0].lower()}{why[1:]}' if why else ''}.", headline)
        missing.remove("vibration")
        headline, where = together(headline, where), ""
    return Card(
        key=key,
        title=title,
        state="part" if shaken is None else _good(missing),
        headline=headline,
        number=number,
        scale=scale,
        details=together(_not_measured(missing), where),
    )


def _risen_vibration(review: Review) -> tuple[str, str] | None:
    """More vibration than in earlier flights, with its usual cause."""
    figures = {} if review.baseline is None else review.baseline.figures
    for path, one in figures.items():
        rose = one.verdict == "changed" and one.expected is not None and one.now.value > one.expected.value
        if rose and path.startswith(("noise.vibration", "noise.rotor_line")):
            words = f"{capital(words_of_path(path))} is higher than in earlier flights: {shown_change(path, one)}."
            return words, f"Usual cause: {QUANTITIES[path.partition('.')[2]].health}."
    return None


def _motors(review: Review) -> Card:
    key, title = "motors", "Are the motors healthy?"
    motors, numbers = review.motors, review.motors.numbers
    imbalance, headroom, high = (numbers.get(name) for name in ("imbalance", "headroom", "saturated_high_share"))
    logged = "motor_1" in review.logging.rates_hz
    unseen = not logged or any(gap.what == "motors" for gap in review.cannot_tell)
    if imbalance is None and headroom is None and high is None and unseen:
        gap = _gap(review, "motors")
        why = f"motor outputs are not logged{' in the air' * logged}."
        return _unanswered(key, title, replace(gap, why=why) if gap and not logged else gap, why)
    # What share of this flight a motor was at a limit was counted, and is no estimate.
    full = "" if high is None else f"{100.0 * high.value:.1f} %"
    judged = {number.name: number for number in judged_numbers(key, numbers)}
    uneven, left = judged.get("imbalance"), judged.get("headroom")
    number = f"{full} at full output" if high is not None and high.value > _SELDOM else ""
    scale = judged["saturated_high_share"].figure.scale("good") if number else ""
    if uneven is not None:
        number, scale = f"{uneven.figure.shown(uneven.quantity)} imbalance", uneven.scale
    even = Card(key=key, title=title, state="look", headline="", number=number, scale=scale)
    if motors.events:
        return replace(
            even,
            headline=f"{capital(counted(len(motors.events), 'time'))} a motor slowed down while its output rose.",
            details="Look for a desync of its ESC.",
        )
    if motors_limited(review.oscillations):
        # The share of the oscillation itself: another count would be another number for the same thing.
        most = max(oscillation.at_limit_percent or 0.0 for oscillation in review.oscillations)
        return replace(even, headline=_stop_first(review), number=f"{most:.0f} % at a limit", scale="")
    balance = None if review.baseline is None else review.baseline.balance
    if balance is not None and balance.verdict == "changed":
        return replace(even, headline=balance_words(balance), details=f"Usual cause: {balance.usual}.")
    # What the vehicle always had is no fault, however uneven.
    known = balance is not None and balance.verdict == "unchanged"
    if uneven is not None and uneven.verdict == "look" and not known:
        headline = "The motors share the work less evenly than usual."
        return replace(even, headline=headline, details=possible_causes(motors.pattern))
    if high is not None and high.value > QUANTITIES["saturated_high_share"].limit:
        return replace(
            even,
            headline=f"A motor was at full output for {full} of the flight.",
            details="Nothing is left for control then.",
            number=f"{full} at full output",
            scale=QUANTITIES["saturated_high_share"].scale("look"),
        )
    # Shares at a limit were counted, and are no estimates.
    own = ("imbalance",) if known else ()
    estimated = [number for name, number in judged.items() if not name.startswith(("saturated", *own))]
    bad, unsure = bad_and_unsure(estimated)
    if bad:
        return replace(bad[0].bad(key, title, number), scale=scale)
    limits = _at_limits(numbers)
    if uneven is None or left is None:
        gap = _gap(review, "motors.imbalance", "motors.saturated", "motors")
        unknown = _unanswered(key, title, gap, "this log does not show how evenly they work.", limits)
        return replace(unknown, number=number, scale=scale)
    if unsure:
        first = next(number for number in estimated if number.verdict == "cannot")
        return replace(first.doubtful(key, title, number=number, details=limits), scale=scale)
    missing = [] if high is not None else ["share of the flight at full output"]
    desync = "No desync was found." if motors.steps_checked else "Desync was not checked."
    words = _balance_words(uneven.quantity, known=known)
    return replace(
        even,
        state=_good(missing),
        headline=f"{words}, with {100.0 * left.quantity.value:.0f} % headroom in hover.",
        details=together(desync, limits, _not_measured(missing)),
    )


def _balance_words(imbalance: Quantity, *, known: bool) -> str:
    """How evenly motors work that do so as before, or within the spread of healthy vehicles."""
    if known:
        return "Balanced as in earlier flights"
    return "Balanced" if imbalance.upper <= EVEN else "As even as usual"


def _at_limits(numbers: Mapping[str, Quantity]) -> str:
    """How much of the flight a motor was at a limit, as far as it was."""
    parts = [
        f"{QUANTITIES[name].short} for {100.0 * numbers[name].value:.1f} %"
        for name in ("saturated_high_share", "saturated_low_share")
        if name in numbers and numbers[name].value > _SELDOM
    ]
    return f"A motor was {' and '.join(parts)} of the flight." if parts else ""


def _drag_words(review: Review) -> str:
    """Drag, the speed that it allows, and the wind, as a sentence; empty where there is no drag."""
    drag, wind = review.flight.drag, review.flight.wind
    if "drag_1_s" not in drag:
        return ""
    numbers = {name: QUANTITIES[name].shown(number) for name, number in {**drag, **wind}.items()}
    reach = f"Drag is {numbers['drag_1_s']}: level flight at 30° of tilt would reach about {numbers['top_speed_m_s']}."
    if "speed_m_s" not in numbers:
        return reach
    source = f" from {numbers['direction_deg']}" if "direction_deg" in numbers else ""
    return f"{reach} The wind was {numbers['speed_m_s']}{source}."


def _power(review: Review) -> Card:
    key, title = "power", "Is there enough power?"
    battery, throttle, ratio = review.flight.battery, review.flight.hover_throttle, review.flight.thrust_to_weight
    if throttle is None and not battery:
        gap = _gap(review, "flight.battery", "flight.hover_throttle")
        logged = _POWER & review.logging.rates_hz.keys()
        why = "neither battery nor throttle could be read." if logged else "neither battery nor throttle is logged."
        known = replace(gap, why=why) if gap and " not logged" in gap.why else gap
        unknown = _unanswered(key, title, known, why, _drag_words(review))
        return replace(unknown, number=_thrust_words(review))
    hover = "" if throttle is None else f"hovers at {QUANTITIES['hover_throttle'].shown(throttle)} throttle"
    volts = _battery_words(battery)
    judged = [] if ratio is None else judged_numbers(key, {"thrust_to_weight": ratio})
    if volts and battery["start_v"].value > 0.0:
        judged += judged_numbers(key, battery)
    names = {number.name for number in judged}
    missing = [*([] if ratio is not None else ["full thrust"]), *([] if "sag_v" in names else ["sag under load"])]
    thrust = "" if ratio is None else f"full thrust {QUANTITIES['thrust_to_weight'].shown(ratio)} times the weight"
    number, scale = (thrust, judged[0].scale) if thrust else (hover, "")
    weighed = _thrust_words(review)
    also = together(
        f"It {hover}." if thrust and hover else "",
        capital(f"{weighed}.") if weighed else "",
        _drag_words(review),
        volts,
        _not_measured(missing),
    )
    for row in judged:
        if row.verdict == "look":
            shown, measure = (number, scale) if row.name == "thrust_to_weight" else (row.shown_alone, row.scale)
            return replace(row.bad(key, title, shown), scale=measure, details=together(row.trouble[1], also))
    for row in judged:
        if row.verdict == "cannot":
            shown, measure = (number, scale) if row.name == "thrust_to_weight" else (row.shown_alone, row.scale)
            return replace(row.doubtful(key, title, number=shown, details=also), scale=measure)
    if not judged:
        gap = _gap(review, "flight.thrust_to_weight", "flight.battery")
        unknown = _unanswered(
            key, title, gap, "this log does not show the full thrust.", together(_drag_words(review), volts)
        )
        return replace(unknown, number="; ".join(text for text in (number, weighed) if text))
    return Card(
        key=key,
        title=title,
        state=_good(missing),
        headline="There is enough thrust." if ratio is not None else "The battery sags little under load.",
        number=number,
        scale=scale,
        details=also,
    )


def _thrust_words(review: Review) -> str:
    """The thrust coefficient by measured speeds; outputs of another battery or ESC make another one."""
    for name in ("thrust_coefficient", "thrust_coefficient_per_mass"):
        if name in review.motors.numbers:
            figure = QUANTITIES[name]
            return f"{figure.before} {figure.shown(review.motors.numbers[name])}"
    return ""


def _battery_words(battery: Mapping[str, Quantity]) -> str:
    """From which voltage to which the battery went, with the lowest where that was not the last."""
    if not {"start_v", "lowest_v"} <= battery.keys():
        return ""
    start, lowest = battery["start_v"].value, battery["lowest_v"].value
    stop = battery.get("stop_v", battery["lowest_v"]).value
    least = f", with {lowest:.1f} V at the lowest" if lowest < min(start, stop) - 0.05 else ""
    return f"The battery went from {start:.1f} to {stop:.1f} V{least}."


def _models(review: Review) -> Card:
    key, title = "models", "Which models can be identified?"
    identified = _identified(review)
    if not review.models_sought:
        return Card(key=key, title=title, state="cannot", headline="Models were not identified (--no-models).")
    if not identified:
        gap = _gap(review, "models.rate", "models") or Unavailable(what=key, why="")
        return Card(
            key=key,
            title=title,
            state="cannot",
            headline="No model of the vehicle.",
            details=gap.why.partition(". ")[0].rstrip(".") + "." * bool(gap.why),
            remedy=gap.remedy,
        )
    # A model that the log does not support is no gap.
    sought = [name for name in review.models if name in identified or name not in review.unsupported]
    number = (
        f"{len(identified)} of {len(sought)} models"
        if len(sought) > len(identified)
        else counted(len(identified), "model")
    )
    doubted: dict[str, list[str]] = {}
    for name, model in identified.items():
        found = verdict(model)
        if found.color != "green":
            doubted.setdefault(found.word, []).append(name)
        if any(finding.kind == "poor_verification" for finding in model.findings):
            doubted.setdefault("misses unseen flight", []).append(name)
    lacking = [name for name in sought if name not in identified]
    details = together(
        *(f"{capital(word)}: {', '.join(names)}." for word, names in doubted.items()),
        f"Not identified: {', '.join(lacking)}." if lacking else "",
        f"Not enough data: {', '.join(review.unsupported)}." if review.unsupported else "",
        "A sweep would make them several times more certain." if without_sweep(review) else "",
    )
    return Card(
        key=key,
        title=title,
        state=_good([*doubted, *lacking]),
        headline=f"Identified: {listed(list(identified))}.",
        number=number,
        details=details,
    )


def _identified(review: Review) -> dict[str, IdentifiedModel]:
    return {name: model for name, model in review.models.items() if isinstance(model, IdentifiedModel)}


def without_sweep(review: Review) -> bool:
    """Whether the models of a review were identified without any maneuver that was made for it."""
    maneuvers = (maneuver for model in _identified(review).values() for maneuver in model.provenance.maneuvers)
    return not any(maneuver.kind in RICH_KINDS for maneuver in maneuvers)


def _gap(review: Review, *parts: str) -> Unavailable | None:
    """The first thing of some parts of a review that was not measured; of the first part that has one."""
    return next((gap for part in parts for gap in review.cannot_tell if gap.what.startswith(part)), None)


def _remedy(review: Review, what: str) -> str:
    """The first thing to do about what was not measured of something; empty where nothing is known."""
    return next((gap.remedy for gap in review.cannot_tell if gap.what.startswith(what) and gap.remedy), "")
