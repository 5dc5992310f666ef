"""Logs of a quadrotor whose motors and inertia are known, as a user has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.twins.twin_motors import flights

from rotorid.data.motor_record import MotorRecord

UNITS = {"p": "rad/s", "q": "rad/s", "r": "rad/s", "az": "m/s^2", "w": "m/s"}
ARM_M = 0.2 * 2.0**0.5


def written(record: MotorRecord, path: Path, *, every: int = 1) -> Path:
    """The record as a table, its motors at each so-manieth sample joined by straight lines."""
    kept = record.time_s[::every]
    motors = [np.interp(record.time_s, kept, row[::every]) for row in record.outputs]
    columns = [record.time_s, *motors, *record.rates, record.az, record.w]
    names = [
        "time [s]",
        *(f"motor_{i} [1]" for i in range(1, 5)),
        *(f"{name} [{unit}]" for name, unit in UNITS.items()),
    ]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


def flight(path: Path, *, seed: int = 1, size: float = 1.0, every: int = 1) -> Path:
    """One flight with sums of sines on all axes, or in gusts alone."""
    return written(flights(1, seed=seed, duration_s=20.0, size=size)[0], path, every=every)
