"""What ``tune`` says to people: new gains and what they bring, margins with a scale, what stays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rotorid.data.display import capital, listed
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import MISSING, minus, significant, with_unit
from rotorid.data.trust import COMMAND_NOISE, REFUSED_PEAK, ROBUSTNESS, SAFE_PEAK
from rotorid.documents.base import FindingDocument
from rotorid.documents.review import QuantityDocument
from rotorid.documents.tune import (
    AxisJudgedDocument,
    AxisTuneDocument,
    PathStepDocument,
    TuneDocument,
)
from rotorid.models.autopilots.gains import letter_of
from rotorid.models.autopilots.outer import outer_loop_of
from rotorid.plot.curves import Frequency
from rotorid.report.loop_words import amplified, both_loops, is_outer, motion_of, shaking
from rotorid.tuning.judging import Verdict
from rotorid.tuning.kinds import KINDS, loop_words
from rotorid.tuning.proposal import Wishes
from rotorid.typing import LoopName

PATH_MARGINS = ("sensitivity_peak", "crossover_rad_s", "phase_margin_deg")
"""Predicted margins of each flight to the best gains."""

LIMIT_IS_KEPT = "95 % of the likely vehicles stay within it, so an interval may end slightly above"
"""Why the upper end of a 95 % interval may lie above a limit that the gains keep."""

_WORTH_A_FACTOR = 1.5
"""A change by more is given as a factor, a smaller one in percent."""

_TODAY = "today "
"""How a reason begins that is about the flown gains, not about what limits the new ones."""

_LITTLE_LEFT = 0.9
"""Deviation with the best gains over that with the next ones, above which a further flight brings little."""

_QUIETER, _LOUDER, _HOTTER = 0.95, 1.05, 1.3
"""Noise of the command over that of today, between which it counts as the same, and above which motors get warmer."""

_MARGINS = (
    ("rate", "sensitivity_peak"),
    ("whole", "sensitivity_peak"),
    ("rate", "phase_margin_deg"),
    ("whole", "phase_margin_deg"),
    ("rate", "gain_margin_db"),
)


@dataclass(frozen=True, kw_only=True, slots=True)
class MarginLine:
    """A margin today and with the new gains, the range that is fine, and a sentence where the new gains miss it."""

    axis: str
    name: str
    today: str
    new: str
    fine: str
    missed: str
    loop: str = ""
    number: str = ""


def headline(document: TuneDocument) -> tuple[str, ...]:
    """The answer in a few sentences: whether there are new gains, what they bring, what to watch in their flight."""
    if not document.axes:
        return ()
    changed = {axis: tuning for axis, tuning in document.axes.items() if tuning.changed}
    weak = [axis for axis, tuning in document.axes.items() if axis not in changed and _of_today(tuning)]
    kept = [axis for axis in document.axes if axis not in changed and axis not in weak]
    missing = (f"No new gains for {listed(weak)}, although today's have too little margin.",) if weak else ()
    if not changed:
        return (*missing, f"Keep today's gains of {listed(kept)}.") if kept else missing
    safer = [axis for axis, tuning in changed.items() if tuning.attitude_ratio.value > 1.0 and _of_today(tuning)]
    others = [axis for axis in changed if axis not in safer]
    found = []
    if others:
        found.append(f"New gains for {listed(others)}. With the new gains, {_disturbance(document, others)}.")
    if safer:
        why = "today's have too little margin"
        found.append(f"Safer gains for {listed(safer)}: {why}. The price: {_disturbance(document, safer)}.")
    return (*found, *missing, _watch(changed))


def _of_today(tuning: AxisTuneDocument) -> bool:
    """Whether the flown gains themselves are a reason for the change."""
    return any(reason.startswith(_TODAY) for reason in tuning.reasons)


def _disturbance(document: TuneDocument, axes: Sequence[LoopName]) -> str:
    """What a disturbance does to the vehicle compared with today; axes that change alike share a clause."""
    alike: dict[tuple[str, str], list[LoopName]] = {}
    for axis in axes:
        words = _less(document.axes[axis].attitude_ratio)
        alike.setdefault((motion_of(axis), words), []).append(axis)
    clauses, before = [], ""
    for (motion, words), same in alike.items():
        verb = "" if motion == before else f"{motion} the vehicle "
        clauses.append(f"{verb}{words}{f' in {listed(same)}' if len(alike) > 1 else ''}")
        before = motion
    return f"a disturbance {listed(clauses)} than today"


def _watch(changed: Mapping[LoopName, AxisTuneDocument]) -> str:
    """What to watch in the first flight of new gains: the loop nearest to shaking, noise, overshoot."""
    peaks = {axis: one.proposed_whole.get("sensitivity_peak") for axis, one in changed.items()}
    nearest = max(changed, key=lambda axis: math.inf if (peak := peaks[axis]) is None else peak.value)
    points = [f"{shaking(nearest)}{_at(changed[nearest].proposed_whole)}"]
    angles = {
        axis: one.proposed_whole["phase_margin_deg"].value
        for axis, one in changed.items()
        if "phase_margin_deg" in one.proposed_whole
    }
    if angles and min(angles.values()) < QUANTITIES["phase_margin_deg"].good_above:
        points.append(f"overshoot in {min(angles, key=angles.__getitem__)}")
    if max((one.noise_ratio for axis, one in changed.items() if not is_outer(axis)), default=0.0) > _HOTTER:
        points.append("hot motors")
    return f"In the first flight, watch for {listed(points)}; if in doubt, land and load the old gains."


def _at(loop: Mapping[str, QuantityDocument]) -> str:
    """Where a loop swings if it swings, which is near its crossover."""
    known = loop.get("crossover_rad_s")
    return "" if known is None else f" at about {significant(known.value / (2.0 * math.pi), digits=2)} Hz"


def tune_sentences(document: TuneDocument) -> tuple[str, ...]:
    """For each axis the new gains, or why there are none."""
    return (*(sentence for sentence, _ in axis_sentences(document)), *not_tuned(document).values())


_UNKNOWN_NOISE = "noise in the motor commands was not measured"
"""Of a log that is too slow to show it, or a result that does not have it."""

_VERDICT_WORDS: Mapping[Verdict, str] = {
    "fly": "fly these gains",
    "gently": "fly these gains gently first",
    "do_not_fly": "do not fly these gains",
    "not_enough_data": "not enough data to judge these gains",
}


def judged_sentences(document: TuneDocument) -> tuple[str, ...]:
    """The verdict on the gains of a file: of all together, then of each axis; nothing where none were judged."""
    judged = document.judged
    if judged is None:
        return ()
    named_file = f"{judged.source}: {_VERDICT_WORDS[judged.verdict]}."
    return (named_file, *(verdict_sentence(axis, found) for axis, found in judged.axes.items()))


def verdict_sentence(axis: LoopName, found: AxisJudgedDocument) -> str:
    """The verdict on the gains of an axis, its reason, what they bring, and what to lower."""
    words = [f"{capital(axis)}: {_VERDICT_WORDS[found.verdict]}{_because(axis, found)}."]
    words += [f"{capital(reason).rstrip('.')}." for reason in found.reasons]
    if found.verdict in ("fly", "gently") and found.attitude_ratio is not None:
        words.append(f"A disturbance {motion_of(axis)} the vehicle {_than_today(found.attitude_ratio)}.")
    if found.verdict in ("fly", "gently") and found.noise is None and not is_outer(axis) and not found.noisy:
        words.append(f"{capital(_UNKNOWN_NOISE)}.")
    if found.lower:
        words.append(f"Lower {listed([f'{name} to {value:.3g}' for name, value in found.lower.items()])}.")
    return " ".join(words)


def _because(axis: LoopName, found: AxisJudgedDocument) -> str:
    """Why, as the end of a sentence: what the loop does on the plant that decides."""
    plant = found.breaking
    if plant is None:
        return ""
    whole = plant.loop == "whole"
    at = f"{plant.omega_rad_s / (2.0 * math.pi):.1f} Hz{f' {plant.situation}' if plant.situation else ''}"
    if found.noisy:
        times = f"{found.noise_ratio or 1.0:.1f} times"
        if is_outer(axis):
            return f": they pass {times} as much noise of the {axis} estimate as today's"
        if found.noise is None:
            return f": {_UNKNOWN_NOISE}, white noise would be {times} today's"
        return f": noise in the motor commands is {times} today's ({100.0 * found.noise:.0f} % of their range)"
    if found.verdict == "not_enough_data":
        if found.known_to_rad_s:
            end = math.ceil(max(found.known_to_rad_s, plant.omega_rad_s) / (2.0 * math.pi))
            return f": they depend on the vehicle at {at}, which was not measured well; sweep up to {end} Hz"
        return ""
    deviation = f"gain {_signed(100.0 * (plant.gain - 1.0))} %, phase {_signed(plant.phase_deg)}°"
    if plant.sensitivity_peak is None:
        share = "" if not found.unstable else f" on {_share(found.unstable)} of the likely vehicles"
        loops = f"{both_loops(axis)} are" if whole else f"the {loop_words(axis)['rate']} is"
        return f": {loops} unstable at about {at}{share} (for example {deviation})"
    if found.verdict == "fly":
        return f": M_s stays below {plant.sensitivity_peak:.2f} on 95 % of the likely vehicles"
    scale = (
        f"above {REFUSED_PEAK:g} is too much" if found.verdict == "do_not_fly" else f"up to {SAFE_PEAK:g} is no concern"
    )
    loops = f"{both_loops(axis)} amplify" if whole else f"the {loop_words(axis)['rate']} amplifies"
    times = f"{plant.sensitivity_peak:.1f} times"
    return f": on a likely vehicle ({deviation}) {loops} {amplified(axis)} at {at} {times}; {scale}"


def _signed(value: float) -> str:
    """A whole number with its sign; zero without one."""
    return minus(f"{round(value):+d}".replace("+0", "0"))


def _share(share: float) -> str:
    return "all" if share >= 1.0 else f"{max(100.0 * share, 1.0):.0f} %"


def axis_sentences(document: TuneDocument) -> tuple[tuple[str, str], ...]:
    """New gains, or that today's stay, with what limits them; axes of which the same is true share a sentence."""
    alike: dict[tuple[str, str], list[LoopName]] = {}
    for axis, tuning in document.axes.items():
        alike.setdefault((_gains_words(axis, tuning), limiting(tuning)), []).append(axis)
    return tuple((f"{capital(listed(axes))}: {words}.", limits) for (words, limits), axes in alike.items())


def _gains_words(axis: LoopName, tuning: AxisTuneDocument) -> str:
    """New gains of an axis and what becomes of the noise; or that today's gains stay, and why."""
    if not tuning.changed:
        kept = "no new gains" if _of_today(tuning) else "keep today's gains"
        return ": ".join(filter(None, (kept, "; ".join(tuning.reasons))))
    return f"{changed_gains(tuning)}{'' if is_outer(axis) else _noise(tuning)}"


def changed_gains(tuning: AxisTuneDocument) -> str:
    """Gains and filters that change: ``P 0.15 → 0.3, angle P 4 → 5.5``."""
    return ", ".join(
        f"{_short(name)} {gain.flown:.4g} → {gain.proposed:.4g}"
        for name, gain in tuning.gains.items()
        if gain.flown != gain.proposed
    )


def _short(name: str) -> str:
    """What a pilot calls a gain; a filter has the firmware's name."""
    letter = letter_of(name)
    return _angle(name) if letter == "A" else letter or name


def _angle(name: str) -> str:
    """What a pilot calls the gain of an angle or, of an outer loop, of the place."""
    return f"{KINDS[outer_loop_of(name) or 'roll'].angle} P"


def _less(ratio: QuantityDocument) -> str:
    """A deviation over that of today, for people, before "than today"."""
    if ratio.value <= 1.0 / _WORTH_A_FACTOR:
        return f"{1.0 / ratio.value:.2g} times less"
    if ratio.value >= _WORTH_A_FACTOR:
        return f"{ratio.value:.2g} times more"
    change = 100.0 * (ratio.value - 1.0)
    return f"{abs(change):.0f} % {'less' if change < 0.0 else 'more'}"


def _than_today(ratio: QuantityDocument) -> str:
    """A deviation compared with that of today, for people."""
    same = round(100.0 * (ratio.value - 1.0)) == 0
    return "as much as today" if same else f"{_less(ratio)} than today"


def _noise(tuning: AxisTuneDocument) -> str:
    """What happens to the noise of the motor commands."""
    ratio = tuning.noise_ratio
    if tuning.noise_flown is None:
        return f"; {_UNKNOWN_NOISE}, white noise would be {100.0 * ratio:.0f} % of today's"
    if _QUIETER <= ratio <= _LOUDER:
        return ""
    limit = f" (limit {100.0 * COMMAND_NOISE:.0f} %)" if 1.0 < ratio <= COMMAND_NOISE else ""
    change = "grows" if ratio > 1.0 else "falls"
    return f"; noise in the motor commands {change} to {100.0 * ratio:.0f} % of today's{limit}"


def not_tuned(document: TuneDocument) -> dict[str, str]:
    """Why an axis has no new gains and what to do, by axis."""
    return {finding.where: finding.message for finding in document.findings if finding.kind == "not_tuned"}


def unread(document: TuneDocument) -> tuple[FindingDocument, ...]:
    """Findings that :func:`tune_sentences` does not contain already."""
    shown = not_tuned(document).values()
    return tuple(
        finding
        for finding in document.findings
        if not any(finding.message.partition(";")[0].rstrip(".") in message for message in shown)
    )


def limiting(tuning: AxisTuneDocument) -> str:
    """What limits the new gains of an axis, in a sentence; empty where nothing does."""
    if not tuning.changed or not tuning.reasons:
        return ""
    today = [reason for reason in tuning.reasons if reason.startswith(_TODAY)]
    bounds = [reason for reason in tuning.reasons if not reason.startswith(_TODAY)]
    why = f"reason for the change: {'; '.join(today)}. " if today else ""
    return f"{why}{'limited' if not why else 'Limited'} by: {'; '.join(bounds)}." if bounds else why.strip()


def margin_lines(document: TuneDocument) -> tuple[MarginLine, ...]:
    """The margins that a pilot looks at first, with the scale of the house."""
    found = []
    for axis, tuning in document.axes.items():
        today = {"rate": tuning.flown, "whole": tuning.flown_whole}
        new = {"rate": tuning.proposed, "whole": tuning.proposed_whole}
        for loop, name in _MARGINS:
            if name not in new[loop]:
                continue
            found.append(
                MarginLine(
                    axis=axis,
                    name=f"{QUANTITIES[name].before}, {loop_words(axis)[loop]}",
                    today=margin_text(name, today[loop].get(name)),
                    new=margin_text(name, new[loop][name]) if tuning.changed else "unchanged",
                    fine=fine_text(name),
                    missed=_missed(axis, loop, name, new[loop][name]),
                    loop=loop_words(axis)[loop],
                    number=_number(name, new[loop][name]),
                )
            )
    return tuple(found)


def _missed(axis: LoopName, loop: str, name: str, quantity: QuantityDocument) -> str:
    """That a margin is not in the range that is fine; empty where it is."""
    figure = QUANTITIES[name]
    least = 20.0 * math.log10(Wishes().gain_margin) if name == "gain_margin_db" else figure.good_above
    if not (quantity.value < least or quantity.value > figure.good_below):
        return ""
    where = f"of the {loop_words(axis)[loop]}" if loop == "rate" else loop_words(axis)[loop]
    return f"{capital(axis)}: the {figure.before} {where} is {_number(name, quantity)}; {fine_text(name)} is fine."


def _number(name: str, quantity: QuantityDocument) -> str:
    return with_unit(QUANTITIES[name].cells(quantity)[0], QUANTITIES[name].unit)


def missed_sentences(lines: Sequence[MarginLine]) -> tuple[str, ...]:
    """Which margins are not in the range that is fine: both loops of an axis in one sentence."""
    pairs: dict[tuple[str, str], list[MarginLine]] = {}
    for line in lines:
        if line.missed:
            pairs.setdefault((line.axis, line.name.partition(",")[0]), []).append(line)
    return tuple(
        same[0].missed
        if len(same) == 1
        else f"{capital(axis)}: the {name} is {listed([f'{line.number} ({line.loop})' for line in same])}; "
        f"{same[0].fine} is fine."
        for (axis, name), same in pairs.items()
    )


def stricter_sentence(document: TuneDocument) -> str:
    """Why the new gains keep a lower M_s than the one that is fine; empty where they do not."""
    asked, fine = _robustness(document), QUANTITIES["sensitivity_peak"].good_below
    if not document.axes or asked >= fine:
        return ""
    return (
        f"M_s is the largest amplification of a disturbance: below {fine:g} is fine for a flown loop. New gains keep "
        f"it below {asked:g}, with a reserve for another battery, payload or propeller. Change it with --robustness."
    )


def limit_sentences(document: TuneDocument) -> tuple[str, ...]:
    """The limits of the new gains."""
    least = math.degrees(Wishes().phase_margin_rad)
    words = f"The phase margin of the rate loop stays above {least:.0f}°; with the angle loop only M_s is limited."
    return (
        f"Limit of the new gains: {document.robustness}.",
        f"{capital(LIMIT_IS_KEPT)}.",
        KINDS[next(iter(document.axes), "roll")].worded(words),
    )


def _robustness(document: TuneDocument) -> float:
    """The largest peak sensitivity that was asked for."""
    value = document.provenance.settings.get("robustness")
    return float(value) if isinstance(value, (int, float)) else ROBUSTNESS


def margin_text(name: str, quantity: QuantityDocument | None) -> str:
    """A margin with unit and interval; a dash where the flight does not show it."""
    if quantity is None:
        return MISSING
    figure = QUANTITIES[name]
    number, interval = figure.cells(quantity)
    return f"{with_unit(number, figure.unit)} ({interval})" if interval else with_unit(number, figure.unit)


def fine_text(name: str) -> str:
    """The range of a margin that is fine; empty without one."""
    figure = QUANTITIES[name]
    if not math.isnan(figure.limit):
        return f"{'above' if math.isnan(figure.good_below) else 'below'} {figure.limit_text()}"
    if name == "gain_margin_db":
        return f"{significant(20.0 * math.log10(Wishes().gain_margin), digits=1)} dB or more"
    return ""


def next_flight(document: TuneDocument) -> str:
    """How the new gains are flown, in a sentence; empty where there are none."""
    if not document.changed:
        return ""
    highest = _sweep_to_hz(document)
    sweep = f" with a sweep up to {highest:.0f} Hz" if highest else ""
    return f"Fly the new gains gently{sweep} and keep the old gains at hand."


def is_checked(document: TuneDocument) -> bool:
    """Whether a flight with the new gains can be compared with them."""
    return any(tuning.changed for tuning in document.axes.values())


def following(document: TuneDocument) -> str:
    """Whether a further flight brings better gains, in a sentence; empty where it does not."""
    paths = {axis: tuning.path for axis, tuning in document.axes.items() if tuning.path}
    if not paths:
        return ""
    shares = {axis: path[-1].attitude_ratio.value / path[0].attitude_ratio.value for axis, path in paths.items()}
    axis = min(shares, key=shares.__getitem__)
    first, *_, goal = paths[axis]
    change = f"{motion_of(axis)} the vehicle {_fewer(shares[axis])} less ({axis})"
    name = "sensitivity_peak"
    if name in first.whole and name in goal.whole:
        before, after = first.whole[name], goal.whole[name]
        if not (before.lower or 0.0) <= after.value <= (before.upper or math.inf):
            peaks = [significant(peak.value, digits=3) for peak in (after, before)]
            change += f", with an M_s of {peaks[0]} instead of {peaks[1]}"
    lead = (
        "These gains are nearly the best, so a further tune is optional: after"
        if shares[axis] >= _LITTLE_LEFT
        else ("Better gains need more flights, so tune again from that log: after")
    )
    return f"{lead} {goal.flight} flights in all, a disturbance {change}."


def _sweep_to_hz(document: TuneDocument) -> float:
    """Upper end of the sweep that the best gains need; zero where one flight reaches them."""
    highest = max((tuning.path[-1].sweep_to_rad_s for tuning in document.axes.values() if tuning.path), default=0.0)
    return highest / (2.0 * math.pi)


def end_of(tuning: AxisTuneDocument) -> str:
    """Where in its range the D of the numbers of an axis is; empty for a D that does not change in flight."""
    known = tuning.proposed.get("crossover_rad_s")
    each = {name: end.get("crossover_rad_s") for name, end in tuning.ends.items()}
    same = [name for name, end in each.items() if known and end and math.isclose(end.value, known.value)]
    return same[0] if len(same) == 1 else ""


def moving_d_sentence(document: TuneDocument) -> str:
    """For which D the margins are where it changes in flight, and M_s for its other end; empty where no D does."""
    moving = {axis: tuning for axis, tuning in document.axes.items() if end_of(tuning)}
    if not moving:
        return ""
    peaks: dict[str, list[str]] = {}
    for axis, tuning in moving.items():
        for end, figures in tuning.ends.items():
            if end != end_of(tuning) and "sensitivity_peak" in figures:
                text = margin_text("sensitivity_peak", figures["sensitivity_peak"])
                peaks.setdefault(end, []).append(f"{text} in {axis}")
    shown = listed(list(dict.fromkeys(map(end_of, moving.values()))))
    new = " with the new gains" if any(tuning.changed for tuning in moving.values()) else ""
    others = "".join(f" M_s of the rate loop{new} with {end}: {listed(texts)}." for end, texts in peaks.items())
    return f"D of {listed([*moving])} changes in flight; these margins are for {shown}.{others}"


def balance_sentence(axis: LoopName, tuning: AxisTuneDocument) -> str:
    """What D is worth beside P, in a sentence; empty for a loop without D."""
    which = "proposed" if tuning.changed else "flown"
    if which not in tuning.without_d or is_outer(axis):
        return ""
    known = (tuning.proposed if tuning.changed else tuning.flown).get("phase_margin_deg")
    without = tuning.without_d[which]
    gains = "the new gains" if tuning.changed else "today's gains"
    end = "the loop may be unstable" if without is None else margin_text("phase_margin_deg", without)
    return (
        f"P/D balance: with {gains} the phase margin of the rate loop is {margin_text('phase_margin_deg', known)}; "
        f"without D {'it would be ' if without is not None else ''}{end}."
        if known is not None
        else ""
    )


def row_words(name: str, frequency: Frequency) -> str:
    """The head of a figure in a table, with its unit."""
    figure = QUANTITIES[name]
    unit = frequency if figure.unit == "rad/s" else figure.unit
    return f"{figure.before} in {unit}" if unit else figure.before


def row_numbers(name: str, quantity: QuantityDocument, frequency: Frequency) -> str:
    """A figure with its interval, in the unit of :func:`row_words`."""
    if QUANTITIES[name].unit == "rad/s" and frequency == "Hz":
        ends = (None if end is None else end / (2.0 * math.pi) for end in (quantity.lower, quantity.upper))
        lower, upper = ends
        quantity = quantity.model_copy(
            update={"value": quantity.value / (2.0 * math.pi), "lower": lower, "upper": upper}
        )
    return QUANTITIES[name].with_ends(quantity)


def step_name(step: PathStepDocument) -> str:
    """What people call a flight of the path."""
    return f"{step.flight}, proposed" if step.flight == 1 else f"{step.flight}, goal" if step.goal else f"{step.flight}"


def _fewer(left: float) -> str:
    """How much less a deviation is, of which a share is left."""
    return f"{1.0 / left:.2g} times" if left <= 1.0 / _WORTH_A_FACTOR else f"{100.0 * (1.0 - left):.0f} %"


def path_sentence(path: Sequence[PathStepDocument], axis: LoopName = "roll") -> str:
    """How several flights lead to the best gains."""
    first, *_, goal = path
    less = _fewer(goal.attitude_ratio.value / first.attitude_ratio.value)
    sweep = "" if is_outer(axis) else f" with a sweep up to {goal.sweep_to_rad_s / (2.0 * math.pi):.0f} Hz"
    return (
        f"P, D and {KINDS[axis].angle} P at most double in one flight. Fly the new gains{sweep}, check that "
        f"flight, and tune again. With the final gains, a disturbance {motion_of(axis)} the vehicle {less} less than "
        "with the gains proposed now."
    )
