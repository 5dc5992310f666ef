"""Thrust by the voltage of the battery: whether it follows it, and at which voltage it is told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.motor_sampling import Motors
from rotorid.signal.autopilot_mixer import linearization_of
from rotorid.signal.battery import voltage_factor
from rotorid.signal.motor_outputs import MotorHistory

_SAGGING = 0.02


class FlownMotors(NamedTuple):
    """A stretch of a log with its motors."""

    record: FlightRecord
    motors: Motors
    stretch: Maneuver


class Voltage(NamedTuple):
    """The voltage at which thrust is told; ``None`` where it does not matter."""

    reference_v: float | None
    findings: tuple[Finding, ...] = ()


def common_voltage(flown: Sequence[FlownMotors], reference_v: float | None) -> Voltage:
    """One voltage for all stretches, where outputs follow the battery and it sagged in them."""
    if any(_compensated(one.record, one.motors.history) for one in flown):
        return Voltage(None)
    factors = []
    for one in flown:
        time_s = one.motors.history.time_s
        inside = time_s[(time_s >= one.stretch.start_s) & (time_s <= one.stretch.stop_s)]
        try:
            factors.append(voltage_factor(one.record, inside, reference_v=1.0).values)
        except InsufficientDataError:
            return Voltage(None)
    together = np.concatenate(factors) if factors else np.ones(1)
    if not together.size or together.min() <= 0.0:
        return Voltage(None)
    reference = float(np.sqrt(np.median(together))) if reference_v is None else reference_v
    spread = float(together.max() / together.min() - 1.0)
    if spread < _SAGGING and reference_v is None:
        return Voltage(None)
    message = (
        f"The battery makes thrust vary by {100.0 * spread:.0f} % at one output; thrust is that at {reference:.3g} V."
    )
    numbers = {"spread": spread, "reference_v": reference}
    where = ", ".join(dict.fromkeys(one.record.source.name for one in flown))
    return Voltage(
        reference, (Finding(kind="battery_sag", severity="info", where=where, message=message, numbers=numbers),)
    )


def _compensated(record: FlightRecord, history: MotorHistory) -> bool:
    """Whether thrust at a value of the motors does not follow the voltage: speeds, and demands that are corrected."""
    if history.kind == "speed":
        return True
    if history.kind == "output":
        return False
    known = linearization_of(record)
    return (known is not None and known.compensates_voltage) or record.parameters.get("MC_BAT_SCALE_EN", 0.0) == 1.0
