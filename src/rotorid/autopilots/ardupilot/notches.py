r"""Notches of ArduPilot that follow the motors, and the filters that it offers against noise.

A harmonic notch that follows the throttle has its center at :math:`f_0 \sqrt{u / u_{ref}}`; below the lowest center it
stays there and becomes shallower. Of one that follows the spectrum, the centers are those of the log.

References
----------
ArduPilot Copter, *Managing Gyro Noise with the Dynamic Harmonic Notch Filters*; ``HarmonicNotchFilter.cpp``,
``NotchFilter.cpp`` and ``AP_Vehicle.cpp``.
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

_SENSOR_HZ = 1000.0
_FIXED, _THROTTLE, _ESC, _SPECTRUM = 0, 1, 3, 4
_EACH_MOTOR, _LOW_AS_LEAST = 2, 32
_SEVERAL = 1 | 16 | 64
_LOGGED = "INS_HNTCH"
"""Whose centers are in the channels of a record."""
_HARMONIC_BITS = (1.0, 3.0, 7.0)
"""The first harmonic, the first two, the first three."""
_DEPTH_DB = 40.0
_FADES_OVER = 0.75
"""Part of the lowest center over which a notch below it becomes shallower until it is off."""
_RANGE_HZ = (10.0, 495.0)


def moving_notches(parameters: Parameters, motion: Motion) -> MovingNotches:
    """The harmonic notches that move."""
    found = [_one(prefix, parameters, motion) for prefix in ("INS_HNTCH", "INS_HNTC2")]
    unknown = next((one.unknown for one in found if one.unknown), "")
    settings = {name: value for one in found for name, value in one.settings.items()}
    moves = [one for one in found if one.center_hz.size]
    if unknown or not moves:
        return no_notches(unknown, settings)
    center, damping, floor = (
        np.concatenate([getattr(one, name) for one in moves]) for name in ("center_hz", "damping", "floor")
    )
    return rows_of(center, damping, floor, _SENSOR_HZ, settings)


def _one(prefix: str, parameters: Parameters, motion: Motion) -> MovingNotches:
    reference, mode = parameters.get(f"{prefix}_REF", 0.0), whole(parameters, f"{prefix}_MODE", _THROTTLE)
    if not parameters.get(f"{prefix}_ENABLE", 0.0) or not reference or mode == _FIXED:
        return no_notches()
    settings = {name: value for name, value in parameters.items() if name.startswith(prefix)}
    options = whole(parameters, f"{prefix}_OPTS")
    if options & _SEVERAL:
        return no_notches(f"a composite notch ({prefix}_OPTS = {options}) is not modeled", settings)
    base_hz, width_hz = parameters.get(f"{prefix}_FREQ", 80.0), parameters.get(f"{prefix}_BW", 40.0)
    if mode == _THROTTLE and motion.throttle is not None:
        wanted = base_hz * np.sqrt(np.maximum(motion.throttle, 0.0) / reference)[None]
    elif mode == _ESC and motion.speeds_hz is not None:
        wanted = motion.speeds_hz if options & _EACH_MOTOR else motion.speeds_hz.mean(axis=0)[None] * reference
    elif mode == _SPECTRUM and motion.centers_hz is not None and prefix == _LOGGED:
        wanted = motion.centers_hz
    else:
        return no_notches(SPECTRUM if mode == _SPECTRUM else SPEEDS_UNKNOWN, settings)
    lowest_hz = base_hz * parameters.get(f"{prefix}_FM_RAT", 1.0)
    octaves = 2.0 * math.log2(base_hz / (base_hz - 0.5 * width_hz))
    quality = math.sqrt(2.0**octaves) / (2.0**octaves - 1.0)
    deep = 10.0 ** (-parameters.get(f"{prefix}_ATT", _DEPTH_DB) / 20.0)
    faded = np.clip((lowest_hz - wanted) / (_FADES_OVER * lowest_hz), 0.0, 1.0)
    floor = np.full_like(wanted, deep) if options & _LOW_AS_LEAST else deep + (1.0 - deep) * faded
    harmonics = whole(parameters, f"{prefix}_HMNCS", 1)
    orders = np.array([order for order in range(1, 17) if harmonics >> (order - 1) & 1] or [1], dtype=np.float64)
    centers = orders[:, None, None] * np.maximum(wanted, lowest_hz)
    # What would lie too near to half of the rate is left out.
    near = centers >= 0.48 * _SENSOR_HZ
    centers = np.where(near, 0.25 * _SENSOR_HZ, centers)
    floor = np.where(near, 1.0, floor)
    damping = np.sin(2.0 * np.pi * centers / _SENSOR_HZ) / (2.0 * quality)
    return rows_of(centers, damping, floor, _SENSOR_HZ, settings)


def filter_changes(parameters: Parameters, lines: NoiseLines) -> list[FilterChange]:
    """What ArduPilot offers: a harmonic notch by ESC speeds or throttle, a fixed notch, and two low-passes."""
    found = []
    if lines.rotor_hz is not None and not _moves("INS_HNTCH", parameters):
        low_hz, usual_hz = lines.rotor_hz
        by_esc = lines.speeds_logged
        base = float(np.clip(round(0.9 * low_hz if by_esc else usual_hz), *_RANGE_HZ))
        shared = {
            "INS_HNTCH_ENABLE": 1.0,
            "INS_HNTCH_MODE": float(_ESC if by_esc else _THROTTLE),
            "INS_HNTCH_REF": 1.0 if by_esc else float(f"{lines.throttle:.3f}"),
            "INS_HNTCH_FREQ": base,
            "INS_HNTCH_BW": float(round(0.5 * base)),
            "INS_HNTCH_ATT": _DEPTH_DB,
            "INS_HNTCH_FM_RAT": 1.0 if by_esc else float(f"{min(low_hz / usual_hz, 1.0):.2f}"),
            "INS_HNTCH_OPTS": float(_EACH_MOTOR if by_esc else 0),
        }
        found += [
            FilterChange(group="moving notch", values={**shared, "INS_HNTCH_HMNCS": bits}) for bits in _HARMONIC_BITS
        ]
    for line_hz in lines.fixed_hz[:1] if not parameters.get("INS_HNTC2_ENABLE", 0.0) else ():
        values = {
            "INS_HNTC2_ENABLE": 1.0,
            "INS_HNTC2_MODE": float(_FIXED),
            "INS_HNTC2_REF": 0.0,
            "INS_HNTC2_FREQ": float(round(line_hz)),
            "INS_HNTC2_BW": float(max(round(0.25 * line_hz), 5)),
            "INS_HNTC2_ATT": _DEPTH_DB,
            "INS_HNTC2_HMNCS": 1.0,
            "INS_HNTC2_OPTS": 0.0,
        }
        found.append(FilterChange(group="fixed notch", values=values))
    return [
        *found,
        *scaled_cutoffs("gyro low-pass", parameters, ["INS_GYRO_FILTER"], high_hz=256.0),
        *scaled_cutoffs("D low-pass", parameters, ["ATC_RAT_RLL_FLTD", "ATC_RAT_PIT_FLTD"], low_hz=5.0, high_hz=100.0),
    ]


def _moves(prefix: str, parameters: Parameters) -> bool:
    """Whether a notch follows something already."""
    fixed = whole(parameters, f"{prefix}_MODE", _THROTTLE) == _FIXED or not parameters.get(f"{prefix}_REF", 0.0)
    return bool(parameters.get(f"{prefix}_ENABLE", 0.0)) and not fixed
