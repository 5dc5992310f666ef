r"""Hover: steady seconds of a flight, the throttle that they ask for, and the curve of the motors' thrust.

A second is steady when the vehicle hardly turns (rates below 0.25 rad/s rms, without vibration), is near level, near
its usual thrust, and no motor is at a limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.signal.airborne import in_air, within
from rotorid.signal.clock import even_step_s
from rotorid.signal.motors import linearization_of, logged_outputs, motor_limits, or_none
from rotorid.typing import BoolArray, FloatArray

_STEADY_RAD_S = 0.25
"""Body rate up to which a second is steady."""

_LEVEL_RAD = 0.2
"""Roll and pitch up to which it is."""

_USUAL = 0.3
"""How far the mean output may lie from the usual one in it, over that."""

_RUNNING = 0.05
"""Mean output, or thrust, from which the motors run."""

WINDOW_S = 1.0
"""Length of a steady second."""

FEWEST_SECONDS = 5
"""Steady seconds from which throttle, balance and headroom of hover are stated."""

USUAL_EXPO = 0.65
"""Curve of usual motors, as ArduPilot takes it by default: thrust :math:`(1 - e) u + e u^2` of an output :math:`u`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hover(Immutable):
    """The throttle of a flight, and what it is in steady seconds.

    Parameters
    ----------
    time_s, throttle
        Mean of what the motors, or the vehicle, were asked for in the air, zero to one, shape ``(n,)``.
    steady_s
        Length of the steady seconds that were found.
    hovering
        Throttle in them; ``None`` where they are fewer than five.
    """

    time_s: FloatArray
    throttle: FloatArray
    steady_s: int
    hovering: Quantity | None


def hover_of(record: FlightRecord, flights: Intervals) -> Hover | None:
    """Throttle of a flight, and that of hover; ``None`` where neither thrust nor motors are logged.

    Parameters
    ----------
    flights
        When it flew.
    """
    history = or_none(logged_outputs, record)
    name = "thrust_command" if "thrust_command" in record else ""
    time_s, values = in_air(record, name, flights) if name else (np.zeros(0), np.zeros(0))
    rows = values[None]
    if autopilot_of(record).log.hover_by_motors or time_s.size < 20:
        if history is None:
            return None
        inside = within(history.time_s, flights)
        time_s, rows = history.time_s[inside], history.values[:, inside]
    throttle = rows.mean(axis=0)
    windows = _steady(record, flights, time_s, rows)
    each = np.array([mean for window in windows if np.isfinite(mean := _between(time_s, throttle, window))])
    hovering = None
    if each.size >= FEWEST_SECONDS:
        parts = [float(np.mean(part)) for part in np.array_split(each, min(10, each.size // 2))]
        std = math.hypot(float(np.std(parts, ddof=1)) / math.sqrt(len(parts)), 0.003)
        hovering = Quantity.normal(float(np.median(each)), std, "1")
    return Hover(time_s=time_s, throttle=throttle, steady_s=each.size, hovering=hovering)


def hover_throttle(record: FlightRecord, flights: Intervals) -> Quantity | None:
    """Throttle in steady seconds of a flight, from zero to one; ``None`` where there were too few of them."""
    found = hover_of(record, flights)
    return found.hovering if found is not None else None


def thrust_curve(record: FlightRecord) -> tuple[float, float, float]:
    """Expo of the thrust by the logged outputs, and the lowest and highest that it may be.

    Where the autopilot straightens the curve (``THR_MDL_FAC``, ``MOT_THST_EXPO``), its number is taken, to a quarter;
    elsewhere the usual one, between a line and a square.
    """
    if autopilot_of(record).log.thrust_demand:
        # What is logged is asked for in thrust, and bent on its way out.
        return (0.0, 0.0, 0.25) if record.parameters.get("THR_MDL_FAC", 0.0) > 0.0 else (USUAL_EXPO, 0.0, 1.0)
    known = linearization_of(record)
    if known is not None:
        return known.expo, max(known.expo - 0.25, 0.0), min(known.expo + 0.25, 1.0)
    return USUAL_EXPO, 0.0, 1.0


def steady_windows(
    record: FlightRecord, flights: Intervals, time_s: FloatArray, values: FloatArray, limited: BoolArray
) -> list[slice]:
    """Seconds of steady flight: samples of the outputs that lie in each.

    Parameters
    ----------
    flights
        In the air.
    time_s, values
        Of the outputs, shapes ``(n,)`` and ``(motors, n)``.
    limited
        Whether a motor is at a limit, shape ``(n,)``.
    """
    mean = values.mean(axis=0)
    running = mean[mean > _RUNNING]
    if not running.size:
        return []
    usual = float(np.median(running))
    calm: list[tuple[FloatArray, FloatArray, float]] = []
    limits = {**dict.fromkeys(RATES, _STEADY_RAD_S), **dict.fromkeys(("phi", "theta"), _LEVEL_RAD)}
    for name, most in limits.items():
        if name in record:
            track = record[name]
            kept = np.isfinite(track.values)
            stamps, size = track.time_s[kept], track.values[kept]
            if stamps.size:
                size = _smooth(stamps, size, 0.1) if name in RATES else size
                calm.append((stamps, np.abs(size), most))
    if not calm:
        return []
    found = []
    for start_s, stop_s in flights:
        # The first and last seconds hold take-off and landing.
        for begin_s in np.arange(start_s + 1.5, stop_s - 1.5 - WINDOW_S, WINDOW_S).tolist():
            first, last = np.searchsorted(time_s, [begin_s, begin_s + WINDOW_S]).tolist()
            if last - first < 3 or not abs(float(mean[first:last].mean()) / usual - 1.0) <= _USUAL:
                continue
            if not limited[first:last].any() and all(
                _quiet(stamps, size, begin_s, most) for stamps, size, most in calm
            ):
                found.append(slice(first, last))
    return found


def _quiet(time_s: FloatArray, size: FloatArray, begin_s: float, most: float) -> bool:
    first, last = np.searchsorted(time_s, [begin_s, begin_s + WINDOW_S]).tolist()
    if last <= first:
        return False
    return bool(np.sqrt(np.mean(np.square(size[first:last]))) < most)


def _smooth(time_s: FloatArray, values: FloatArray, over_s: float) -> FloatArray:
    from scipy.ndimage import uniform_filter1d

    step_s = even_step_s(time_s) if time_s.size > 1 else 0.0
    size = max(int(over_s / step_s), 1) if step_s > 0.0 else 1
    return np.asarray(uniform_filter1d(values, size, mode="nearest"))


def _steady(record: FlightRecord, flights: Intervals, time_s: FloatArray, rows: FloatArray) -> Intervals:
    """Seconds of steady flight: by the motors where they are logged, else by what asks for thrust."""
    limits, limited = motor_limits(record), np.zeros(time_s.size, dtype=np.bool_)
    if limits.time_s.size:
        flying = limits.counted
        time_s, rows, limited = limits.time_s[flying], limits.outputs[:, flying], limits.limited[flying]
    found = steady_windows(record, flights, time_s, rows, limited)
    return tuple((float(time_s[window][0]), float(time_s[window][-1])) for window in found)


def _between(time_s: FloatArray, values: FloatArray, window: tuple[float, float]) -> float:
    inside = values[(time_s >= window[0]) & (time_s <= window[1])]
    return float(inside.mean()) if inside.size else math.nan
