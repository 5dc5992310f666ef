"""Gyro filters, which all axes share, and their effect on axes that are not tuned.

A new filter is in every loop behind it. Axes whose gains do not change fly it with today's gains, so their loops are
checked with both filters. An axis that would break a limit is refused; one that cannot be checked is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.proposing.axis import KnownAxis, known_axis, log_of
from rotorid.proposing.filters import with_filters
from rotorid.proposing.flown_gains import settings_records
from rotorid.results.model import IdentifiedModel
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.tuning.proposal import Wishes, judged, newly_broken_limit
from rotorid.typing import Axis


def require_filters_hold(
    staying: Mapping[Axis, KnownAxis],
    others: Mapping[Axis, InsufficientDataError | None],
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
    *,
    filters: Mapping[str, float],
    wishes: Wishes,
    draws: int,
    seed: int,
) -> list[Finding]:
    """Refuse filters that make an axis with unchanged gains break a limit; name the axes that cannot be checked.

    Parameters
    ----------
    staying
        Axes without new gains.
    others
        Other axes that are not tuned, with the reason; ``None`` for those that were not requested.
    given, logs, filters, draws, seed
        As for :func:`rotorid.proposing.axis.known_axis`.

    Raises
    ------
    InsufficientDataError
        An axis newly breaks a limit with the filters and its flown gains.
    """
    named = ", ".join(f"{name} = {value:g}" for name, value in filters.items())
    reasons, known = [], dict(staying)
    for axis, error in others.items():
        if not _reached(axis, log_of(axis, settings_records(given, logs)), filters):
            continue
        try:
            if error is not None:
                raise error
            known[axis] = known_axis(axis, given, logs, filters=filters, draws=draws, seed=seed, findings=[])
        except InsufficientDataError as why:
            message = f"{named} also acts on {axis}, where its effect could not be checked: {why.came}."
            reasons.append(warn("filter_not_judged", axis, message))
    broken = [
        finding
        for axis, known_axis in known.items()
        if (finding := _broken(axis, known_axis, named, wishes)) is not None
    ]
    if broken:
        raise InsufficientDataError(
            broken[0].message.rstrip("."),
            remedy="tune that axis too, or choose another filter",
            findings=broken,
        )
    return reasons


def _reached(axis: Axis, record: FlightRecord | None, filters: Mapping[str, float]) -> bool:
    """Whether filters are in the loop of an axis."""
    if record is None:
        return False
    then = with_filters(record, filters)
    flown = controllers_of(record)
    before, after = (found.axis(axis) for found in (flown, flown.with_parameters(then.parameters)))
    gyro = controller_filters(record) != controller_filters(then)
    return gyro or (before is not None and after is not None and before.controller != after.controller)


def _broken(axis: Axis, known_axis: KnownAxis, named: str, wishes: Wishes) -> Finding | None:
    """The finding that an axis would break a limit with its flown gains; ``None`` where it does not."""
    drawn = known_axis.drawn()
    before, after = (
        judged(parts, drawn, known_axis.gains, from_rad_s=known_axis.plant.known_from_rad_s)
        for parts in (known_axis.flown_parts, known_axis.parts)
    )
    limit = newly_broken_limit(before, after, known_axis.plant, wishes)
    if not limit:
        return None
    peaks = [float(np.median(np.maximum(x.rate.sensitivity_peak, x.whole.sensitivity_peak))) for x in (before, after)]
    message = (
        f"With {named} and the flown gains of {axis}, {limit}: its largest M_s changes from {peaks[0]:.2f} to "
        f"{peaks[1]:.2f}."
    )
    return refusal("filter_refused", axis, message, sensitivity_peak=peaks[1])
