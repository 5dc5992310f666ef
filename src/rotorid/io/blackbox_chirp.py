"""Betaflight's CHIRP: a sweep that the flight controller adds to the set-point of one axis, as its debug fields tell.

The fields hold the phase of the sweep in units of 1/5000 rad, the axis (−1 while it rests), the frequency in tenths of
a hertz, and a thousand times the cosine of the phase. Since the number of the debug mode changes with the firmware,
the fields are recognized by that redundancy.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from rotorid.data.maneuver import Maneuver
from rotorid.io.blackbox_channels import FRD, Row
from rotorid.io.blackbox_decode import Flight
from rotorid.typing import Axis, BoolArray, FloatArray

PHASE_SCALE = 5000.0
COSINE_SCALE = 1000.0
SHORTEST_S = 1.0
_TOLERANCE = 20.0
"""Of the cosine, in thousandths: the controller's fast cosine and the rounding of the phase."""
_DIRECT_HZ = 1.0
"""Below this frequency the controller lowers the amplitude in proportion to the frequency."""
_AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
_FIELDS = tuple(f"debug[{index}]" for index in range(4))


def chirp_rows(flight: Flight) -> tuple[Row, ...]:
    """Excitation of every axis that was swept, in rad/s at the rate set-point.

    This is the sweep as generated, times its amplitude: the controller's lead–lag shaping, which follows, is a known
    linear filter and takes nothing from its use as an instrument.
    """
    if not is_chirp(flight):
        return ()
    axis, wave = flight.field("debug[1]"), _wave(flight)
    rows = []
    for index, name in enumerate(_AXES):
        amplitude = flight.header.number(f"chirp_amplitude_{name}") * math.pi / 180.0
        if np.any(axis == index):
            values = np.where(axis == index, wave, 0.0) * (amplitude * FRD[index])
            rows.append(Row(f"{name}_excitation", "debug[3]", values))
    return tuple(rows)


def chirp_maneuvers(flight: Flight) -> tuple[Maneuver, ...]:
    """Sweeps of at least a second, with the band that was reached."""
    if not is_chirp(flight):
        return ()
    axis, tenths = flight.field("debug[1]"), flight.field("debug[2]")
    running = np.where(tenths > 0, axis, -1)
    borders = [0, *(np.flatnonzero(np.diff(running)) + 1).tolist(), running.size]
    found = []
    for first, stop in pairwise(borders):
        start_s, stop_s = float(flight.time_s[first]), float(flight.time_s[stop - 1])
        if running[first] < 0 or stop_s - start_s < SHORTEST_S:
            continue
        name = _AXES[int(running[first])]
        low, high = (float(edge) * 0.1 * 2.0 * math.pi for edge in (tenths[first], tenths[stop - 1]))
        found.append(
            Maneuver(
                axis=name,
                kind="sweep",
                start_s=start_s,
                stop_s=stop_s,
                band_rad_s=(min(low, high), max(low, high)),
                origin="declared",
                signal=f"{name}_excitation",
            )
        )
    return tuple(found)


def is_chirp(flight: Flight) -> bool:
    """Whether the debug fields are those of a sweep."""
    if not set(_FIELDS) <= set(flight.fields) or "chirp_time_seconds" not in flight.header.values:
        return False
    axis = flight.field("debug[1]")
    running = (axis >= 0) & (flight.field("debug[2]") > 0)
    if not running.any() or axis.min() < -1 or axis.max() > 2:
        return False
    return bool(np.all(_agrees(flight)[running]))


def _agrees(flight: Flight) -> BoolArray:
    cosine = COSINE_SCALE * np.cos(flight.field("debug[0]") / PHASE_SCALE)
    logged = flight.field("debug[3]")
    lowered = flight.field("debug[2]") < 10.0 * _DIRECT_HZ + 1.0
    agrees: BoolArray = np.where(
        lowered, np.abs(logged) <= COSINE_SCALE + _TOLERANCE, np.abs(logged - cosine) < _TOLERANCE
    )
    return agrees


def _wave(flight: Flight) -> FloatArray:
    wave: FloatArray = flight.field("debug[3]") / COSINE_SCALE
    return wave
