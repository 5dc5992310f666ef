"""The trim of a model: speeds and angles about which it was linearized, from the record or given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from rotorid.data.findings import Finding
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.coverage import HOVER_M_S
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.settings import IdentifySettings

_CHANNELS = {"U0": "u", "V0": "v", "W0": "w", "theta0": "theta", "phi0": "phi"}
_SPEEDS = ("U0", "V0", "W0")
_LEVEL_RAD = 0.05
"""Up to here the cosine is one within a thousandth, and gravity along the body a twentieth of itself."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trimmed:
    """A structure at a trim, with the remark on it where it is no hover."""

    structure: LinearStructure
    findings: tuple[Finding, ...] = ()


def trimmed(structure: LinearStructure, flown: Sequence[Flown], settings: IdentifySettings) -> Trimmed:
    """A structure with its trim constants set.

    Given constants count. The others are means over the maneuvers, where the record holds them: speeds below 0.5 m/s
    and angles below 3° are hover, and stay zero.

    Parameters
    ----------
    structure
        Its constants ``U0 V0 W0 theta0 phi0`` are set; one without them stays as it is.
    flown
        Maneuvers.
    settings
        Whose ``constants`` were given.

    Raises
    ------
    ModelError
        A constant was given that the structure does not have.
    """
    measured = {}
    for name, channel in _CHANNELS.items():
        if name in structure.constants and name not in settings.constants:
            limit = HOVER_M_S if name in _SPEEDS else _LEVEL_RAD
            value = _mean(flown, channel)
            if abs(value) >= limit:
                measured[name] = value
    constants = {**measured, **settings.constants}
    if not constants:
        return Trimmed(structure=structure)
    return Trimmed(structure=structure.with_constants(constants), findings=(_finding(measured),) if measured else ())


def _mean(flown: Sequence[Flown], channel: str) -> float:
    parts = []
    for record, maneuver in flown:
        for topic, row in islice(record.holding(channel), 1):
            inside = (topic.time_s >= maneuver.start_s) & (topic.time_s <= maneuver.stop_s)
            values = topic.values[row, inside]
            parts.append(values[np.isfinite(values)])
    together = np.concatenate(parts) if parts else np.zeros(0)
    return float(together.mean()) if together.size else 0.0


def _finding(trim: dict[str, float]) -> Finding:
    parts = ", ".join(
        f"{name} = {value:.2f} m/s" if name in _SPEEDS else f"{name} = {np.degrees(value):.1f}°"
        for name, value in trim.items()
    )
    return Finding(
        kind="trim",
        severity="info",
        where=", ".join(trim),
        message=(
            f"The record is no hover: {parts} on average, and the model is linearized there. Give other values with "
            "--constant NAME=VALUE."
        ),
        numbers=trim,
    )
