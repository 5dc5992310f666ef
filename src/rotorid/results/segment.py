"""A maneuver cut out of a log."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.data.record import Maneuver, TimeHistory


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A maneuver with the data around it, on one clock."""

    record: str
    maneuver: Maneuver
    history: TimeHistory
