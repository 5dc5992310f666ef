"""Are logs of one vehicle? What they say of autopilot, frame and gains, where both say it.

What one log leaves out is not different: only two names that contradict each other make two vehicles. Gains may change
from flight to flight of one vehicle, and then loops and margins change with them; derivatives do not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.pipeline.preparation.controllers import controllers_of
from rotorid.pipeline.review.flight import vehicle
from rotorid.typing import Axis

AUTOPILOTS = ("PX4", "ArduPilot", "Betaflight", "Crazyflie")


@dataclass(frozen=True, kw_only=True)
class Aircraft(Immutable):
    """What a log says of the vehicle that flew; empty where it does not."""

    autopilot: str = ""
    kind: str = ""
    frame: str = ""

    def contradiction(self, other: Aircraft) -> str:
        """What two logs of one vehicle cannot both say, in words; empty where nothing speaks against one vehicle.

        Examples
        --------
        >>> Aircraft(autopilot="PX4").contradiction(Aircraft(autopilot="ArduPilot", frame="quad X"))
        'PX4 and ArduPilot'
        >>> Aircraft(autopilot="PX4").contradiction(Aircraft(autopilot="PX4", frame="quad X"))
        ''
        """
        pairs = ((self.autopilot, other.autopilot), (self.kind, other.kind), (self.frame, other.frame))
        return next((f"{here} and {there}" for here, there in pairs if here and there and here != there), "")


def aircraft_of(record: FlightRecord) -> Aircraft:
    """What a log says of the vehicle that flew."""
    found, _ = vehicle(record)
    autopilot = found.autopilot if found.autopilot in AUTOPILOTS else ""
    return Aircraft(autopilot=autopilot, kind=found.kind, frame=found.frame)


def require_one_vehicle(records: Sequence[FlightRecord]) -> None:
    """Refuse logs that name two autopilots or two frames.

    Raises
    ------
    UsageError
        Two logs are of two vehicles.
    """
    known: list[tuple[FlightRecord, Aircraft]] = []
    for record in records if len(records) > 1 else ():
        own = aircraft_of(record)
        for other, before in known:
            if words := before.contradiction(own):
                raise UsageError(
                    f"{other.source.name} and {record.source.name} are of two vehicles: {words}",
                    needed="logs of one vehicle",
                    remedy="identify them apart, or compare many vehicles with rotorid fleet",
                )
        known.append((record, own))


def gains_of(record: FlightRecord, axes: Sequence[Axis] = tuple(RATE_OF)) -> dict[str, float]:
    """Gains and filters of the rate loops by the firmware's names; empty where the log has none."""
    found: dict[str, float] = {}
    for axis in axes:
        known = controllers_of(record).axis(axis)
        found |= dict(known.gains) if known is not None else {}
    return found


def different_gains(here: Mapping[str, float], there: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Gains that both have, with other values.

    Examples
    --------
    >>> different_gains({"P": 0.15, "D": 0.003}, {"P": 0.2, "D": 0.003, "I": 0.2})
    {'P': (0.15, 0.2)}
    """
    return {name: (here[name], there[name]) for name in sorted(here.keys() & there) if here[name] != there[name]}
