r"""Yaw drift and yaw trim with a centered stick, and how both change with the voltage of the battery.

A vehicle that is not asked to turn drifts in heading where nothing holds it, and where an autopilot holds it, the yaw
command carries what would turn it. Both are means over 2 s windows in which stick and set-point of yaw are at rest,

.. math:: \dot\psi_k = \frac{\psi(t_k + 2) - \psi(t_k)}{2}, \qquad y_k = a + b\,(V_k - \bar V) + e_k

with the mean :math:`a` and the slope :math:`b` by least squares. Errors are those of what lasts
(:mod:`rotorid.uncertainty.long_run`), with the degree of freedom of the slope taken out.

Within one flight voltage falls with time, so that whatever else warms up or wears during a flight is in the slope too;
``fleet`` compares it with the slope between flights (:mod:`rotorid.fleets.yaw_drift`). Without a logged heading the
drift is the mean yaw rate, which holds the bias of the gyro.

References
----------
Paper 5 of docs/papers.md, appendix F: heading drifts at a yaw rate input of zero, perhaps by the battery level.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.reviewing.missing import Unavailable
from rotorid.signal.airborne import in_air
from rotorid.typing import FloatArray
from rotorid.uncertainty.long_run import cosines, long_run, student

_WINDOW_S, _ENDS_S = 2.0, 3.0
"""Length of a window; take-off and landing, which turn a vehicle."""

_FEWEST = 20
"""Windows from which a drift is stated."""

_LEAST_MOTION = 0.02
"""Change of the voltage from which it shows a slope, as a share."""

_CENTERED, _TURN_RAD_S = 0.03, 0.02
"""Yaw stick, and rate of its set-points, up to which the vehicle is not asked to turn."""

_LEVEL_RAD = 0.35
"""Mean tilt up to which a window counts: air that flows past a tilted vehicle turns it."""

_REMEDY = "hover without touching the yaw stick"


class _Channel(NamedTuple):
    """Samples of a channel in the air."""

    time_s: FloatArray
    values: FloatArray

    def mean(self, start_s: float, stop_s: float) -> float:
        """Over a window; not a number where it has no sample."""
        first, last = np.searchsorted(self.time_s, [start_s, stop_s]).tolist()
        return float(self.values[first:last].mean()) if last > first else math.nan

    def slope(self, start_s: float, stop_s: float) -> float:
        """Rate from one end of a window to the other; not a number where a sample is far from one of them."""
        near = np.searchsorted(self.time_s, [start_s, stop_s])
        if near[0] == near[1] or near[1] >= self.time_s.size:
            return math.nan
        ends = np.interp([start_s, stop_s], self.time_s, self.values)
        return float(ends[1] - ends[0]) / (stop_s - start_s)


def yaw_drift(record: FlightRecord, flights: Intervals) -> tuple[dict[str, Quantity], list[Unavailable]]:
    """Drift and trim of yaw with a centered stick, their slopes over the voltage, and what the flight does not show.

    Parameters
    ----------
    record
        With ``psi`` or ``r``, and ``yaw_stick``, ``psi_setpoint`` or ``r_setpoint``; ``yaw_command`` for the trim,
        ``battery_voltage`` for the slopes.
    flights
        When it flew.

    Returns
    -------
    dict of Quantity
        Figures of ``yaw`` in :data:`rotorid.data.quantities.QUANTITIES`.
    list of Unavailable
        What is missing, and why.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 120.0, 0.1)
    >>> volts = 16.0 - time_s / 100.0
    >>> rows = {"r": 0.1 + 0.05 * (volts - 15.4), "yaw_stick": 0.0 * time_s, "battery_voltage": volts}
    >>> channels = tuple(Channel(name=name, unit="") for name in rows)
    >>> topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
    >>> log = FlightRecord(source=Source(name="a", format="CSV", sha256=""), topics=(topic,))
    >>> found, _ = yaw_drift(log, ((0.0, 120.0),))
    >>> round(found["drift_rad_s"].value, 2), round(found["drift_per_volt"].value, 3)
    (0.1, 0.05)
    """
    if not {"psi", "r"} & set(record.channel_names):
        return {}, [_missing("drift_rad_s", "Neither heading nor yaw rate is logged.")]
    if not {"yaw_stick", "psi_setpoint", "r_setpoint"} & set(record.channel_names):
        return {}, [_missing("drift_rad_s", "Neither the yaw stick nor a set-point of yaw is logged.")]
    windows = np.array(list(_windows(record, flights))).reshape(-1, 3)
    seconds = _WINDOW_S * windows.shape[0]
    if windows.shape[0] < _FEWEST:
        why = f"The yaw stick was centered for {seconds:.0f} s of level flight; {_FEWEST * _WINDOW_S:.0f} s are needed."
        return {}, [_missing("drift_rad_s", why, _REMEDY)]
    volts = windows[:, 2]
    numbers: dict[str, Quantity] = {}
    unavailable: list[Unavailable] = []
    gap = _voltage_gap(volts)
    for name, unit, values in (("drift", "rad/s", windows[:, 0]), ("trim", "1", windows[:, 1])):
        mean = {"drift": "drift_rad_s", "trim": "yaw_trim"}[name]
        slope = {"drift": "drift_per_volt", "trim": "yaw_trim_per_volt"}[name]
        known = np.isfinite(values)
        if np.count_nonzero(known) < _FEWEST:
            continue
        if gap:
            numbers[mean], _ = _line(values[known], np.zeros(values[known].size), unit)
            unavailable.append(_missing(slope, gap, "fly until the battery is half empty"))
        else:
            numbers[mean], numbers[slope] = _line(values[known], volts[known], unit)
    return numbers, unavailable


def _missing(name: str, why: str, remedy: str = "") -> Unavailable:
    return Unavailable(what=f"yaw.{name}", why=why, remedy=remedy)


def _voltage_gap(volts: FloatArray) -> str:
    """Why the voltage shows no slope; empty where it does."""
    if not np.isfinite(volts).all():
        return "Battery voltage is not logged in the air."
    low, high = (float(end) for end in np.percentile(volts, [5.0, 95.0]))
    needed = _LEAST_MOTION * float(np.median(volts))
    if high - low >= needed > 0.0:
        return ""
    changed = f"The battery voltage changed by {high - low:.2f} V while the yaw stick was centered"
    return f"{changed}; {needed:.2f} V are needed."


def _windows(record: FlightRecord, flights: Intervals) -> Iterator[tuple[float, float, float]]:
    """Drift, trim and voltage of each window of level flight in which yaw was not asked to turn."""
    names = ("psi", "r", "yaw_command", "battery_voltage", "yaw_stick", "psi_setpoint", "r_setpoint", "phi", "theta")
    found = {name: _Channel(*in_air(record, name, flights)) for name in names if name in record}
    found = {name: channel for name, channel in found.items() if channel.time_s.size}
    for name in ("psi", "psi_setpoint"):
        if name in found:
            found[name] = _Channel(found[name].time_s, np.unwrap(found[name].values))
    if "yaw_stick" in found:
        found["yaw_stick"] = _Channel(found["yaw_stick"].time_s, np.abs(found["yaw_stick"].values))
    # A rate set-point may hold what corrects the heading, so that windows in which it rests would hide the drift.
    by_rate = not {"yaw_stick", "psi_setpoint"} & set(found)
    voltage = found.get("battery_voltage")
    for start_s, stop_s in flights:
        for begin_s in np.arange(start_s + _ENDS_S, stop_s - _ENDS_S - _WINDOW_S, _WINDOW_S).tolist():
            ends = begin_s, begin_s + _WINDOW_S
            asked = [found["yaw_stick"].mean(*ends) / _CENTERED] if "yaw_stick" in found else []
            if "psi_setpoint" in found:
                asked.append(abs(found["psi_setpoint"].slope(*ends)) / _TURN_RAD_S)
            if by_rate and "r_setpoint" in found:
                asked.append(abs(found["r_setpoint"].mean(*ends)) / _TURN_RAD_S)
            tilts = [abs(found[name].mean(*ends)) for name in ("phi", "theta") if name in found]
            if not asked or not max(asked) <= 1.0 or any(tilt > _LEVEL_RAD for tilt in tilts):
                continue
            drift = found["psi"].slope(*ends) if "psi" in found else found["r"].mean(*ends)
            trim = found["yaw_command"].mean(*ends) if "yaw_command" in found else math.nan
            # A monitor may log less often than a window lasts.
            volts = math.nan if voltage is None else float(np.interp(begin_s + 1.0, voltage.time_s, voltage.values))
            yield drift, trim, volts


def _line(values: FloatArray, volts: FloatArray, unit: str) -> tuple[Quantity, Quantity]:
    """Mean and slope over the voltage of windows in the order of time, with errors of what lasts."""
    x = volts - volts.mean()
    size, seconds = values.size, _WINDOW_S * values.size
    squares = float(x @ x)
    slope = float(x @ values) / squares if squares > 0.0 else 0.0
    mean = float(values.mean())
    left = values - mean - slope * x
    scores = np.stack([left / size, left * x / squares if squares > 0.0 else 0.0 * x])
    covariance, _ = long_run(scores, seconds)
    # A line takes from the slowest cosine what looks like it.
    freedom = cosines(seconds) - 1 if squares > 0.0 else cosines(seconds)
    variances = np.diag(covariance) * cosines(seconds) / freedom * size / (size - 2)
    stds = np.sqrt(variances) * student(freedom)
    return Quantity.normal(mean, float(stds[0]), unit), Quantity.normal(slope, float(stds[1]), f"{unit}/V")
