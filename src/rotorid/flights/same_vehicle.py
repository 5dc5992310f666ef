"""Are logs, and models of logs, of one vehicle? Autopilot, frame and gains are compared if both logs have them.

What one log leaves out is not different: only two names that contradict each other make two vehicles. Gains may change
from flight to flight of one vehicle, and then loops and margins change with them; derivatives do not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.registry import autopilot_of, named, writer_of
from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flights.controllers import controllers_of
from rotorid.models.autopilots.layouts import layout_of
from rotorid.results.model import IdentifiedModel
from rotorid.typing import Axis

_COUNTED: Mapping[int, str] = {3: "tri", 4: "quad", 6: "hexa", 8: "octa", 12: "dodeca"}


@dataclass(frozen=True, kw_only=True)
class Aircraft(Immutable):
    """Vehicle according to a log; empty fields are unknown."""

    autopilot: str = ""
    kind: str = ""
    frame: str = ""

    def contradiction(self, other: Aircraft) -> str:
        """The contradiction between two logs of one vehicle, in words; empty if there is none.

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
    """The vehicle according to a log."""
    return Aircraft(autopilot=writer_of(record).name, kind=record.status.vehicle, frame=frame_of(record)[0])


def frame_of(record: FlightRecord) -> tuple[str, str]:
    """Name of the frame, empty if the log has none, and in brackets its other description."""
    named_frame = autopilot_of(record).log.frame(record)
    if named_frame is not None:
        return named_frame
    try:
        layout = layout_of(record)
    except (InsufficientDataError, ModelError):
        return "", ""
    count = int(layout.positions.shape[0])
    # Arms straight ahead or to the side make a plus, arms in between an X.
    angles = np.arctan2(layout.positions[:, 1], layout.positions[:, 0])
    off_axis = float(np.min(np.abs(np.sin(2.0 * angles))))
    shape = "plus" if count == 4 and float(np.max(np.abs(np.sin(2.0 * angles)))) < 0.3 else ""
    shape = "X" if count == 4 and off_axis > 0.3 else shape
    return f"{_COUNTED.get(count, f'{count} rotors')} {shape}".strip(), ""


def require_one_autopilot(models: Sequence[IdentifiedModel], records: Sequence[FlightRecord]) -> tuple[Finding, ...]:
    """Refuse models and logs of different autopilots, and remark on a model that is of none of the logs.

    Parameters
    ----------
    models, records
        Results of earlier runs, and the logs beside which they are used.

    Returns
    -------
    tuple of Finding
        ``other_log`` for each model that was identified on other logs: whether both are of one vehicle is not known.

    Raises
    ------
    UsageError
        A model was identified on a log of another autopilot.
    """
    flown = {record.source.sha256 for record in records if record.source.sha256}
    findings = []
    for model in models:
        known = model.controller.autopilot if model.controller is not None else ""
        came = ", ".join(model.provenance.inputs) or "data without a name"
        for record in records:
            own = writer_of(record).name
            if named(known).name and own and own != known:
                raise UsageError(
                    f"{model.name} was identified on {came} of {known}, but {record.source.name} is from {own}",
                    needed="a model and logs of one vehicle",
                    remedy=f"identify {model.name} on {record.source.name}, or give the logs of the model",
                )
        if flown and not flown & set(model.provenance.inputs.values()):
            logs = ", ".join(record.source.name for record in records)
            findings.append(
                warn(
                    "other_log",
                    model.name,
                    f"{model.name} was identified on {came}, not on {logs}, and they may be of different "
                    "vehicles. Identify the model on a log of the flight itself.",
                )
            )
    return tuple(findings)


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
                    f"{other.source.name} and {record.source.name} are from two vehicles: {words}",
                    needed="logs of one vehicle",
                    remedy="identify them separately, or compare many vehicles with rotorid fleet",
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
