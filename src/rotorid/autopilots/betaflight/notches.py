"""Notches of Betaflight that follow the motors, and the filters that it offers against noise.

References
----------
Betaflight wiki, *Bidirectional DSHOT and RPM Filter*; ``rpm_filter.c`` and ``dyn_notch_filter.c``.
"""

from __future__ import annotations

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

_HARMONICS = (1, 2, 3)
_NEAR_NYQUIST = 0.48
DYNAMIC_FEATURE = 1 << 29
"""Bit of ``features`` that switches the dynamic notches on."""
_NOTCH_CUTOFF = 0.85
"""Lower cutoff of a fixed notch over its center."""


def _loop_hz(parameters: Parameters) -> float:
    period_us = parameters.get("looptime", 125.0)
    return 1e6 / period_us / max(parameters.get("pid_process_denom", 1.0), 1.0)


def moving_notches(parameters: Parameters, motion: Motion) -> MovingNotches:
    """The notches at the harmonics of each motor, which fade in above the least frequency.

    The dynamic notches follow the spectrum, and no log says where they were.
    """
    settings = {
        name: value for name, value in parameters.items() if name.startswith(("rpm_filter_", "dyn_notch_", "features"))
    }
    if whole(parameters, "features") & DYNAMIC_FEATURE and whole(parameters, "dyn_notch_count", 1):
        return no_notches(SPECTRUM, settings)
    harmonics = whole(parameters, "rpm_filter_harmonics")
    if not harmonics or not parameters.get("dshot_bidir", 1.0):
        return no_notches()
    if motion.speeds_hz is None:
        return no_notches(SPEEDS_UNKNOWN, settings)
    rate_hz, least_hz = _loop_hz(parameters), parameters.get("rpm_filter_min_hz", 100.0)
    orders = np.arange(1, harmonics + 1)
    centers = np.clip(orders[:, None, None] * motion.speeds_hz, least_hz, _NEAR_NYQUIST * rate_hz)
    fade_hz = max(parameters.get("rpm_filter_fade_range_hz", 50.0), 1e-9)
    weights = np.array([parameters.get(f"rpm_filter_weights_{order - 1}", 100.0) / 100.0 for order in orders])
    weight = weights[:, None, None] * np.clip((centers - least_hz) / fade_hz, 0.0, 1.0)
    quality = parameters.get("rpm_filter_q", 500.0) / 100.0
    damping = np.sin(2.0 * np.pi * centers / rate_hz) / (2.0 * quality)
    return rows_of(centers, damping, 1.0 - weight, rate_hz, settings)


def filter_changes(parameters: Parameters, lines: NoiseLines) -> list[FilterChange]:
    """What Betaflight offers: the RPM filter, a fixed notch, and the low-passes of gyro and D with fixed cutoffs."""
    found = []
    off = parameters.get("rpm_filter_harmonics", 1.0) == 0.0
    if lines.rotor_hz is not None and lines.speeds_logged and off and parameters.get("dshot_bidir", 0.0):
        least = float(np.clip(round(0.7 * lines.rotor_hz[0]), 30, 200))
        found += [
            FilterChange(
                group="moving notch", values={"rpm_filter_harmonics": float(count), "rpm_filter_min_hz": least}
            )
            for count in _HARMONICS
        ]
    free = next((place for place in range(2) if parameters.get(f"gyro_notch_hz_{place}", 1.0) == 0.0), None)
    for line_hz in lines.fixed_hz[:1] if free is not None else ():
        values = {
            f"gyro_notch_hz_{free}": float(round(line_hz)),
            f"gyro_notch_cutoff_{free}": float(round(_NOTCH_CUTOFF * line_hz)),
        }
        found.append(FilterChange(group="fixed notch", values=values))
    moves = parameters.get("gyro_lpf1_dyn_hz_0", parameters.get("gyro_lowpass_dyn_hz_0", 0.0)) > 0.0
    gyro = ["gyro_lpf2_static_hz", "gyro_lowpass2_hz", *([] if moves else ["gyro_lpf1_static_hz", "gyro_lowpass_hz"])]
    by_throttle = [name for end in (0, 1) for name in (f"dterm_lpf1_dyn_hz_{end}", f"dterm_lowpass_dyn_hz_{end}")]
    of_d = by_throttle if any(parameters.get(name, 0.0) for name in by_throttle) else ["dterm_lpf1_static_hz"]
    return [
        *found,
        *scaled_cutoffs("gyro low-pass", parameters, gyro),
        *scaled_cutoffs("D low-pass", parameters, [*of_d, "dterm_lpf2_static_hz", "dterm_lowpass2_hz"]),
    ]
