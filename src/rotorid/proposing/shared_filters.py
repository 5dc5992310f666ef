"""What axes share: filters of the gyro, which reach axes that are not tuned.

A filter that is to be flown stands in every loop behind it. Axes whose gains stay fly it with the gains they have, so
their loops are judged with both; one that would break a limit by it is refused, and one that cannot be judged is named.
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
    """Refuse filters by which an axis that keeps its gains would break a limit; name the axes that cannot be judged.

    Parameters
    ----------
    staying
        Axes that were looked at, and found no other gains.
    others
        All others that are not tuned, with why they were refused; ``None`` for those that nobody asked for.
    given, logs, filters, draws, seed
        As for :func:`rotorid.proposing.axis.known_axis`.

    Raises
    ------
    InsufficientDataError
        An axis breaks a limit with the filters and its flown gains, and did not, or less so, without them.
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
            message = (
                f"{named} stands in the loop of {axis} too, and whether its flown gains hold with it was not judged: "
                f"{why.came}."
            )
            reasons.append(warn("filter_not_judged", axis, message))
    broken = [
        finding
        for axis, known_axis in known.items()
        if (finding := _broken(axis, known_axis, named, wishes)) is not None
    ]
    if broken:
        raise InsufficientDataError(
            broken[0].message.rstrip("."),
            needed="a filter with which every axis that keeps its gains holds its limits",
            remedy="tune that axis too, or choose another filter",
            findings=broken,
        )
    return reasons


def _reached(axis: Axis, record: FlightRecord | None, filters: Mapping[str, float]) -> bool:
    """Whether filters stand in the loop of an axis."""
    if record is None:
        return False
    then = with_filters(record, filters)
    flown = controllers_of(record)
    before, after = (found.axis(axis) for found in (flown, flown.with_parameters(then.parameters)))
    gyro = controller_filters(record) != controller_filters(then)
    return gyro or (before is not None and after is not None and before.controller != after.controller)


def _broken(axis: Axis, known_axis: KnownAxis, named: str, wishes: Wishes) -> Finding | None:
    """Which limit an axis would break with its flown gains."""
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
        f"With {named} the flown gains of {axis} do not keep {limit}: its largest sensitivity peak goes from "
        f"{peaks[0]:.2f} to {peaks[1]:.2f}."
    )
    return refusal("filter_refused", axis, message, sensitivity_peak=peaks[1])
