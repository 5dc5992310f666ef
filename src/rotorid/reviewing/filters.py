"""Filters of a review: which to fly against the noise of a flight, its card, and its files with a way back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital, counted, listed
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.loops.filter_choice import NOISY, FilterPart, FilterProposal, KnownLoop, propose_filters
from rotorid.models.autopilots.betaflight_settings import command_line_name
from rotorid.reviewing.card import Card, State, together
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import MarginReview, Review
from rotorid.tuning.files import parameter_files
from rotorid.typing import Axis

if TYPE_CHECKING:
    from rotorid.autopilots.notches import FilterGroup

TITLE = "Are the filters right?"

MOTOR_NOISE_SCALE = (
    f"below {100.0 * NOISY:g} % is quiet, above {QUANTITIES['roll_d_noise_share'].limit_text()} is trouble"
)
"""What is usual for noise in the commands of the motors, over their range, of D alone and of P and D together."""

_MARGINS = {"phase_margin_deg", "sensitivity_peak"}

_WORDS: Mapping[FilterGroup, str] = {
    "moving notch": "a notch that follows the motors",
    "fixed notch": "a notch at the resonance",
    "gyro low-pass": "gyro low-pass",
    "D low-pass": "D low-pass",
}


def filters(
    record: FlightRecord, margins: Mapping[Axis, MarginReview], unmeasured: Sequence[Unavailable] = ()
) -> tuple[FilterProposal | None, tuple[Unavailable, ...]]:
    """Filters to fly with the flown gains, and why none are known.

    Parameters
    ----------
    margins
        Of the axes that were measured: the phase that a filter costs counts at their crossover.
    unmeasured
        What the flight does not show, margins among it.
    """
    loops = _loops(margins)
    try:
        noise = gyro_noise(record)
    except InsufficientDataError as error:
        return None, (_unknown(error, error.remedy),)
    try:
        return propose_filters(record, noise, loops), ()
    except InsufficientDataError as error:
        # Without margins, what would measure them is the one thing to do.
        known = {"roll", "pitch"} <= loops.keys()
        of_margins = (gap.remedy for gap in unmeasured if gap.what.startswith("margins") and gap.remedy)
        return None, (_unknown(error, error.remedy if known else next(of_margins, error.remedy)),)


def _unknown(error: InsufficientDataError, remedy: str) -> Unavailable:
    return Unavailable(what="filters", why=f"{capital(error.came)}.", remedy=remedy)


def _loops(margins: Mapping[Axis, MarginReview]) -> dict[Axis, KnownLoop]:
    return {
        axis: KnownLoop(
            plant=margin.plant, source=margin.source, crossover_rad_s=margin.numbers["crossover_rad_s"].value
        )
        for axis, margin in margins.items()
        if margin.plant is not None and margin.verdict is not None and "crossover_rad_s" in margin.numbers
    }


def filter_files(review: Review) -> dict[str, str]:
    """Files with the proposed filters, and with the flown ones to go back; none where the flown ones stay."""
    found = review.filters
    if found is None or not found.changed:
        return {}
    pairs = {command_line_name(name): both for part in found.parts for name, both in part.values.items()}
    values = {name: new for name, (_, new) in pairs.items()}
    flown = {name: before for name, (before, _) in pairs.items() if before is not None}
    # A notch that was off has no parameters in the log: switched off again, the rest of them does not matter.
    try:
        return {
            name: text
            for role, of_role in (("filters", values), ("filters_rollback", flown))
            for name, text in parameter_files(
                review.vehicle.autopilot,
                of_role,
                role=role,  # type: ignore[arg-type]
                firmware=review.vehicle.firmware,
            ).items()
        }
    except UsageError:
        return {}


def filter_card(review: Review) -> Card:
    """Whether the filters fit the noise, what better ones save and cost, or why that is not known."""
    found = review.filters
    if review.oscillations:
        return Card(key="filters", title=TITLE, state="cannot", headline="Not judged while an axis oscillates.")
    if found is None:
        gap = next((gap for gap in review.cannot_tell if gap.what == "filters"), None)
        why = "This log does not show what the filters do." if gap is None else gap.why
        return Card(
            key="filters",
            title=TITLE,
            state="cannot",
            headline=why,
            remedy="" if gap is None else gap.remedy,
        )
    number = f"noise through P and D {100.0 * found.rms:.2g} % of the motor range"
    unknown = _unknown_margins(review, found)
    unchecked = together(
        f"Not checked, since their margins are not known: {listed(unknown)}." if unknown else "",
        f"Moving notches were not checked: {found.unseen}." if found.unseen else "",
    )
    card = Card(key="filters", title=TITLE, state="good", headline="", number=number, scale=MOTOR_NOISE_SCALE)
    if found.changed:
        return _with(card, "look", _changed_words(found), together(_settings(found), unchecked))
    if found.need == "noise":
        why = (
            f"None was found that would help: {found.refused}." if found.refused else "None was found that would help."
        )
        advice = "Balance the propellers and mount the autopilot more softly."
        return _with(card, "look", "Much noise reaches the motors.", together(why, advice, unchecked))
    words = "Keep your filters: little noise reaches the motors."
    return _with(card, "part" if unchecked else "good", words, unchecked)


def _unknown_margins(review: Review, found: FilterProposal) -> list[Axis]:
    """Axes that the filters reach and whose margins are unknown: one of them may be too small."""
    unknown: set[Axis] = {axis for axis, verdict in found.verdicts.items() if verdict.verdict == "not_enough_data"}
    for axis in (*found.flown.powers, *found.verdicts):
        margin = review.margins.get(axis)
        if margin is None or margin.stick_idle or not margin.numbers.keys() >= _MARGINS:
            unknown.add(axis)
    return [axis for axis in RATE_OF if axis in {*found.unchecked, *unknown}]


def _with(card: Card, state: State, headline: str, details: str) -> Card:
    return replace(card, state=state, headline=headline, details=details)


def _changed_words(found: FilterProposal) -> str:
    what = listed([_part_words(part) for part in found.parts])
    worst = max(found.proposed.costs_deg.values(), key=lambda cost: cost.value)
    if found.need == "margin":
        more = -found.saves_percent.value
        return f"{capital(what)} would give {-worst.value:.1f}° more phase margin, for {more:.0f} % more motor noise."
    cost = f"for {worst.value:.1f}° of phase" if worst.value > 0.05 else "without a loss of phase"
    return f"{capital(what)} would cut motor noise by {_percent(found.saves_percent)} {cost}."


def _part_words(part: FilterPart) -> str:
    if part.group in ("moving notch", "fixed notch"):
        return _WORDS[part.group]
    lower = any(flown is not None and new < flown for flown, new in part.values.values())
    return f"a {'lower' if lower else 'higher'} {_WORDS[part.group]}"


def _percent(quantity: Quantity) -> str:
    return f"{quantity.value:.0f} % ({quantity.lower:.0f} to {quantity.upper:.0f} %)"


def _settings(found: FilterProposal) -> str:
    """What to set, all of it in the file too."""
    values = [f"{command_line_name(name)} = {new:g}" for part in found.parts for name, (_, new) in part.values.items()]
    shown = ", ".join(values[:6])
    more = f" and {counted(len(values) - 6, 'more')}" if len(values) > 6 else ""
    return f"Set {shown}{more}; the file filters sets them all, the file filters_rollback restores today's values."
