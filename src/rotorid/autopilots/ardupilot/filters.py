"""Filters that ArduPilot runs in front of the channels that it logs.

References
----------
ArduPilot Copter, *Complete Parameter List* (``INS_*``), *Managing Gyro Noise with the Dynamic Harmonic Notch Filters*
and *System Identification Mode*; the digital forms, and what is logged from where, are those of ``LowPassFilter2p``,
``NotchFilter``, ``HarmonicNotchFilter``, ``AP_InertialSensor_Backend`` and ``ModeSystemId``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.autopilots.filters import KnownFilter, integral_mean, moving_average, notch
from rotorid.autopilots.numbers import Parameters, broken, whole
from rotorid.autopilots.passages import (
    NARROWEST,
    Chain,
    Passage,
    built,
    doubtful,
    joined,
    moving,
    second_order,
    stage,
    through,
)
from rotorid.data.record import FlightRecord

_SENSOR_HZ = 1000.0
_GYRO_RATES = {0: 1.0, 1: 2.0, 2: 4.0, 3: 8.0}
_SINGLE_NOTCH = "INS_NOTCH"
"""Of older firmware: without harmonics, and it does not move."""

_MOVING = "moves in flight"
_DEEPEST_NOTCH_DB = 120.0
_FIXED, _THROTTLE = 0.0, 1.0
_COMPOSITE = 1 | 2 | 16 | 64
"""Options of a harmonic notch that make several of one: double, one for each source, triple, quintuple."""


def passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    """What a channel of a log has passed; at the rate that its parameters say where none is given."""
    rate_hz = sensor_rate_hz or _SENSOR_HZ * _oversampling(record.parameters)
    found = through(CHAINS, source, record.parameters, rate_hz)
    doubts = tuple(f"{doubt}{_centers(record) * (_MOVING in doubt)}" for doubt in found.doubts)
    return replace(found, doubts=doubts)


def _centers(record: FlightRecord) -> str:
    """Where the notches of the motors were, as far as the log holds it; the rest of a sentence."""
    names = [name for name in record.channel_names if name.startswith("notch_frequency_")]
    centers = [values[values > 0.0] for name in names for values in [record[name].values]]
    moved = np.concatenate(centers) / (2.0 * math.pi) if centers else np.empty(0)
    if not moved.size:
        return ""
    low, high = np.quantile(moved, (0.025, 0.975))
    return f"; it was between {low:.0f} and {high:.0f} Hz for 95 % of the log"


def _oversampling(parameters: Parameters) -> float:
    """Factor by which the first sensor is read faster."""
    fast = whole(parameters, "INS_FAST_SAMPLE") & 1
    return _GYRO_RATES.get(whole(parameters, "INS_GYRO_RATE"), 1.0) if fast else 1.0


def _loop_integral(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    return integral_mean(1.0 / values[0], rate_hz)


def _loop_mean(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    return moving_average(1.0 / values[0], rate_hz)


def _gyro_notches(parameters: Parameters, rate_hz: float) -> Passage:
    return joined(
        _harmonic_notches(prefix, parameters, rate_hz) for prefix in ("INS_HNTCH", "INS_HNTC2", _SINGLE_NOTCH)
    )


def _harmonic_notches(prefix: str, parameters: Parameters, rate_hz: float) -> Passage:
    r"""Notches of constant frequency.

    .. math:: Q = \frac{\sqrt{2^b}}{2^b - 1}, \qquad b = 2 \log_2 \frac{f_0}{f_0 - B / 2}, \qquad
        d = 10^{-A / 20}

    with quality and depth of the base frequency for all harmonics, bandwidth :math:`B`, and attenuation :math:`A` in
    dB.
    """
    if parameters.get(f"{prefix}_ENABLE", 0.0) == 0.0:
        return Passage()
    if damaged := broken(parameters, f"{prefix}_"):
        return doubtful(f"{', '.join(damaged)} in the log is no number")
    harmonic = prefix != _SINGLE_NOTCH
    names = [f"{prefix}_{name}" for name in ("FREQ", "BW", "ATT")]
    also = [f"{prefix}_{name}" for name in ("HMNCS", "REF")] if harmonic else []
    missing = [name for name in (*names, *also) if name not in parameters]
    if missing:
        return doubtful(f"{prefix}_ENABLE is set, and the log does not carry {', '.join(missing)}")
    # A reference of zero keeps the notch where it is whatever the mode; the first firmware had no other mode.
    if harmonic and parameters.get(f"{prefix}_MODE", _THROTTLE) != _FIXED and parameters[f"{prefix}_REF"] != 0.0:
        return moving(f"{prefix}_REF", parameters[f"{prefix}_REF"])
    options = whole(parameters, f"{prefix}_OPTS")
    if options & _COMPOSITE:
        return doubtful(f"a composite notch is on ({prefix}_OPTS = {options}), which is not modeled")
    center_hz, bandwidth_hz, attenuation_db = (parameters[name] for name in names)
    setting_words = ", ".join(f"{name} = {parameters[name]:g}" for name in names)
    if not (center_hz > 0.52 * bandwidth_hz > NARROWEST * center_hz and 0.0 <= attenuation_db <= _DEEPEST_NOTCH_DB):
        return doubtful(f"{setting_words} make no notch")
    octaves = 2.0 * math.log2(center_hz / (center_hz - 0.5 * bandwidth_hz))
    quality = math.sqrt(2.0**octaves) / (2.0**octaves - 1.0)
    floor = 10.0 ** (-attenuation_db / 20.0)
    harmonics = whole(parameters, f"{prefix}_HMNCS", 1)
    centers = [center_hz * number for number in range(1, 17) if harmonics >> (number - 1) & 1]
    # The autopilot leaves out what would lie too near to half of its rate.
    kept = [center for center in centers if center < 0.48 * rate_hz]
    return joined(built(setting_words, partial(notch, center, quality, rate_hz, floor=floor)) for center in kept)


CHAINS = (
    Chain(
        source=r"RATE\.(R|P|Y|Rll|Pit|Yaw)|IMU\.Gyr[XYZ]",
        stages=(stage("INS_GYRO_FILTER", second_order, needed=True),),
        also=_gyro_notches,
    ),
    Chain(
        source=r"IMU\.Acc[XYZ]",
        stages=(stage("INS_ACCEL_FILTER", second_order, needed=True),),
    ),
    Chain(
        source=r"SIDD\.G[xyz]",
        stages=(stage("SCHED_LOOP_RATE", _loop_integral, needed=True),),
    ),
    Chain(
        source=r"SIDD\.A[xyz]",
        stages=(stage("SCHED_LOOP_RATE", _loop_mean, needed=True),),
    ),
    Chain(
        source=r"RATE\.(\w*Out)|CTUN\.Th\w+|RCOU\.C\d+",
        nonlinear=("MOT_SLEW_UP_TIME", "MOT_SLEW_DN_TIME"),
    ),
)
"""Sources of a log and what they have passed."""
