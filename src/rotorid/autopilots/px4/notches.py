"""Notches of PX4 that follow the motors, and the filters that it offers against noise.

References
----------
PX4 User Guide, Parameter Reference (``IMU_GYRO_*``) and *MC Filter Tuning & Control Latency*; ``NotchFilter.hpp`` and
``VehicleAngularVelocity.cpp``.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.autopilots.notches import (
    SPECTRUM,
    SPEEDS_UNKNOWN,
    FilterChange,
    Motion,
    MovingNotches,
    NoiseLines,
    no_notches,
    rows_of,
    scaled_cutoffs,
)
from rotorid.autopilots.numbers import Parameters, whole
from rotorid.autopilots.px4.filters import SENSOR_HZ

_BY_ESC, _BY_SPECTRUM = 1, 2
_HARMONICS = (1, 2, 3)
_WIDTH = 0.25
"""Width of a fixed notch over its frequency."""


def moving_notches(parameters: Parameters, motion: Motion) -> MovingNotches:
    """Notches by the ESCs' speeds: each motor has its harmonics, none lower than the least frequency."""
    enabled = whole(parameters, "IMU_GYRO_DNF_EN")
    if not enabled:
        return no_notches()
    settings = {name: value for name, value in parameters.items() if name.startswith("IMU_GYRO_DNF_")}
    if enabled & _BY_SPECTRUM or motion.speeds_hz is None:
        return no_notches(SPECTRUM if enabled & _BY_SPECTRUM else SPEEDS_UNKNOWN, settings)
    width_hz = float(np.clip(parameters.get("IMU_GYRO_DNF_BW", 15.0), 5.0, 30.0))
    orders = np.arange(1, int(np.clip(whole(parameters, "IMU_GYRO_DNF_HMC", 3), 1, 7)) + 1)
    least_hz = max(parameters.get("IMU_GYRO_DNF_MIN", 25.0), width_hz) + 0.5 * (orders - 1) * width_hz
    centers = np.maximum(orders[:, None, None] * motion.speeds_hz, least_hz[:, None, None])
    damping = np.full_like(centers, math.tan(math.pi * width_hz / SENSOR_HZ))
    return rows_of(centers, damping, np.zeros(1), SENSOR_HZ, settings)


def filter_changes(parameters: Parameters, lines: NoiseLines) -> list[FilterChange]:
    """What PX4 offers: notches by ESC speeds, a fixed notch, and the low-passes of gyro and D."""
    found = []
    if lines.rotor_hz is not None and lines.speeds_logged and not whole(parameters, "IMU_GYRO_DNF_EN"):
        least = float(max(math.floor(0.8 * lines.rotor_hz[0]), 10))
        shared = {"IMU_GYRO_DNF_EN": float(_BY_ESC), "IMU_GYRO_DNF_MIN": least}
        found += [
            FilterChange(group="moving notch", values={**shared, "IMU_GYRO_DNF_HMC": float(order)})
            for order in _HARMONICS
        ]
    free = next((name for name in ("IMU_GYRO_NF0", "IMU_GYRO_NF1") if not parameters.get(f"{name}_FRQ", 1.0)), None)
    for line_hz in lines.fixed_hz[:1] if free else ():
        values = {f"{free}_FRQ": float(round(line_hz)), f"{free}_BW": float(max(round(_WIDTH * line_hz), 10))}
        found.append(FilterChange(group="fixed notch", values=values))
    return [
        *found,
        *scaled_cutoffs("gyro low-pass", parameters, ["IMU_GYRO_CUTOFF"]),
        *scaled_cutoffs("D low-pass", parameters, ["IMU_DGYRO_CUTOFF"]),
    ]
