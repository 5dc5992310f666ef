"""Why axes have no new gains, what limits those they have, and which flight would show more."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, reason_of
from rotorid.flying.next_steps import sweep_for_tune
from rotorid.proposing.axis_tuning import AxisTuning
from rotorid.proposing.plants import flight_by_stick
from rotorid.proposing.settings import TUNED_AXES
from rotorid.proposing.thrust import ThrustLinearization
from rotorid.signal.excitations import rich_excitations
from rotorid.tuning.bands import BAND_OVER_CROSSOVER
from rotorid.typing import Axis, LoopName

_PROGRESS = logging.getLogger("rotorid.progress")

_NEARLY = 1.15
_SAME_GAIN = 1e-3


def reason_without_gains(axis: LoopName, failure: Exception) -> tuple[InsufficientDataError, list[Finding]]:
    """Why an axis has no gains, and what to say of it."""
    error = reason_of(failure, f"gains of {axis}")
    lack = error if isinstance(error, InsufficientDataError) else None
    # tune does not have the options of identify.
    todo = error.expectation if "--" in error.remedy or not error.remedy else error.remedy
    why = "; ".join(part.rstrip(".") for part in (error.came, todo) if part)
    head = "Not enough data to tune" if error.needed else "No new gains for"
    _PROGRESS.info(f"{axis}: {error}")
    refused = lack or InsufficientDataError(error.came, needed=error.needed, remedy=error.remedy)
    return refused, [*(lack.findings if lack else ()), warn("not_tuned", axis, f"{head} {axis}: {why}.")]


def thrust_remarks(thrust: ThrustLinearization) -> list[Finding]:
    """How the thrust curve changes the gains."""
    low, high = thrust.flown_range
    if high - low <= _SAME_GAIN:
        return []
    message = (
        f"Over the flown throttle, the loop gain is {low:.2f} to {high:.2f} times that in hover, by the identified "
        "thrust curve. The new gains keep their limits over this whole range."
    )
    return [remark("thrust_range", thrust.parameter, message, lowest=low, highest=high)]


def remarks_of(axes: Mapping[LoopName, AxisTuning], settings_from: Sequence[FlightRecord]) -> Iterator[Finding]:
    """Why gains do not change, what limits them, and which sweep would measure more."""
    short = [axis for axis in TUNED_AXES if axis in axes and _ends_early(axes[axis])]
    command = sweep_for_tune(settings_from[0], short) if short and settings_from else ""
    for axis, tuned in axes.items():
        if tuned.proposal.reasons:
            words = "; ".join(tuned.proposal.reasons)
            what = "are limited" if tuned.proposal.changed else "do not change"
            yield remark("tuning_bound", axis, f"The gains of {axis} {what}: {words}.")
        if axis in short:
            crossover, top = tuned.proposal.proposed.rate.usual_crossover_rad_s, tuned.plant.band_rad_s[1]
            loop = "new loop" if tuned.proposal.changed else "loop"
            message = (
                f"{capital(axis)} was measured up to {_hz(top)}, close to the crossover of the {loop} "
                f"({_hz(crossover)}), so the margins rely on the model. "
                f"{_next_flight(axis, settings_from, tuned.needed_rad_s, command)}"
            )
            numbers = {"crossover_rad_s": crossover, "needed_rad_s": tuned.needed_rad_s}
            yield warn("band_below_crossover", axis, message, **numbers)


def _next_flight(axis: Axis, logs: Sequence[FlightRecord], needed_rad_s: float, command: str) -> str:
    """The flight that shows an axis up to a frequency, as a sentence: a sweep, or 30 s in acro after one by stick."""
    sweep = f"fly a sweep up to {_hz(needed_rad_s)}{f', planned by: {command}' if command else ''}"
    flown = [record for record in logs if record.topics]
    if not flown or any(rich_excitations(record, axis) for record in flown):
        return capital(sweep if command else f"{sweep}.")
    stick = capital(flight_by_stick(axis))
    return f"{stick}; or {sweep}" if command else f"{stick}."


def _hz(omega_rad_s: float) -> str:
    """A frequency as pilots set it."""
    return f"{omega_rad_s / (2.0 * np.pi):.1f} Hz"


def _ends_early(tuned: AxisTuning) -> bool:
    """Whether the measured band ends below what the proposed gains need."""
    top = tuned.plant.band_rad_s[1]
    crosses = tuned.proposal.proposed.rate.usual_crossover_rad_s
    # A measured band ends a little below the end of its sweep.
    return crosses * BAND_OVER_CROSSOVER > top and tuned.needed_rad_s > _NEARLY * top
