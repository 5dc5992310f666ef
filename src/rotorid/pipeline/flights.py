"""Maneuvers as far as they fly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.instruments import Flown
from rotorid.signal.airborne import Airborne, airborne

_WORTH_CUTTING_S = 0.25
_SHORTEST_LEFT = 0.5
"""A maneuver that flies for less than this share of it is more likely mistaken for landed than landed."""


def while_flying(flown: Sequence[Flown]) -> tuple[list[Flown], list[Finding]]:
    """Maneuvers without what lies before take-off or after landing, and a warning for each that lost something."""
    flights: dict[str, Airborne | None] = {}
    cut_down, findings = [], []
    for record, maneuver in flown:
        key = record.source.sha256 or record.source.name
        if key not in flights:
            flights[key] = flights_by_thrust(record)
        kept, remark = _flying_part(maneuver, flights[key])
        cut_down.append((record, kept))
        findings += remark
    return cut_down, findings


def flights_by_thrust(record: FlightRecord) -> Airborne | None:
    """Flights that thrust or motors tell. The activity of sensors is no reason to throw data away."""
    try:
        found = airborne(record, margin_s=0.0)
    except InsufficientDataError:
        # A rig or a bench has no flight; its maneuvers count as they are.
        return None
    return found if found.by_thrust else None


def _flying_part(maneuver: Maneuver, flight: Airborne | None) -> tuple[Maneuver, list[Finding]]:
    if flight is None:
        return maneuver, []
    shared = [(max(a, maneuver.start_s), min(b, maneuver.stop_s)) for a, b in flight.intervals]
    start_s, stop_s = max(shared, key=lambda part: part[1] - part[0])
    lost_s = maneuver.duration_s - (stop_s - start_s)
    if lost_s <= _WORTH_CUTTING_S:
        return maneuver, []
    whole = f"{maneuver.axis} {maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s"
    if stop_s - start_s < _SHORTEST_LEFT * maneuver.duration_s:
        kept, said = maneuver, f"{whole} lies mostly on the ground, as {flight.seen_in} tells; it was used as it is."
    else:
        kept = replace(maneuver, start_s=start_s, stop_s=stop_s)
        said = (
            f"{whole} reaches beyond the flight, as {flight.seen_in} tells; {start_s:.2f} to {stop_s:.2f} s was used."
        )
    numbers = {"start_s": kept.start_s, "stop_s": kept.stop_s, "on_ground_s": lost_s}
    return kept, [Finding(kind="airborne", severity="warning", where=whole, message=said, numbers=numbers)]
