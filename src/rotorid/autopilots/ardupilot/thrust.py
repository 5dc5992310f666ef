"""How ArduPilot makes outputs of its demands of thrust."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.autopilots.thrust import Linearization


def linearization(parameters: Mapping[str, float]) -> Linearization | None:
    """By its parameters; ``None`` where the log does not carry them."""
    names = ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")
    # A damaged parameter is not known either.
    if not all(np.isfinite(parameters.get(name, np.nan)) for name in names):
        return None
    expo, low, high = (parameters[name] for name in names)
    return (
        Linearization(
            expo=float(np.clip(expo, -1.0, 1.0)),
            low=low,
            high=high,
            voltage_max=parameters.get("MOT_BAT_VOLT_MAX", 0.0),
            voltage_min=parameters.get("MOT_BAT_VOLT_MIN", 0.0),
        )
        if low < high
        else None
    )
