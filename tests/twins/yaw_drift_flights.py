"""Hovering flights of a vehicle whose heading drifts by the voltage of its battery, or by something else, or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic

_STEP_S = 0.1
_GUST_S = 3.0


def yaw_drift_flight(
    *,
    seed: int,
    drift_per_volt: float = 0.0,
    trim_per_volt: float = 0.0,
    drift_rad_s: float = 0.0,
    start_v: float = 16.6,
    fall_v: float = 1.2,
    gust_rad_s: float = 0.03,
    duration_s: float = 240.0,
) -> dict[str, np.ndarray]:
    r"""Columns of a log at 10 Hz: hover in gusts, with turns by the stick in between.

    .. math:: \dot\psi = \dot\psi_0 + b (V - 15.5) + w + k u, \qquad \delta = 0.03 + b_\delta (V - 15.5) + w_\delta

    with the voltage V, gusts w correlated over 3 s, and the yaw stick u, which moves for a tenth of the time.

    Parameters
    ----------
    drift_per_volt, trim_per_volt
        Slopes :math:`b` in rad/s/V and :math:`b_\delta` in 1/V.
    drift_rad_s
        At 15.5 V.
    start_v, fall_v
        Voltage at the start, and how much of it the flight takes.
    gust_rad_s
        Standard deviation of what gusts turn.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration_s, _STEP_S)
    keep = np.exp(-_STEP_S / _GUST_S)

    def gusts(size: float) -> np.ndarray:
        noise = size * np.sqrt(1.0 - keep**2) * rng.standard_normal(time_s.size + 500)
        return np.asarray(lfilter([1.0], [1.0, -keep], noise)[500:])

    volts = start_v - fall_v * time_s / duration_s
    stick = np.where((time_s % 40.0 > 20.0) & (time_s % 40.0 < 24.0), 0.4, 0.0)
    rate = drift_rad_s + drift_per_volt * (volts - 15.5) + gusts(gust_rad_s) + 1.5 * stick
    trim = 0.03 + trim_per_volt * (volts - 15.5) + gusts(0.01) + 0.3 * stick
    thrust = np.where((time_s < 2.0) | (time_s > duration_s - 2.0), 0.0, 0.4)
    small = {name: 0.02 * rng.standard_normal(time_s.size) for name in ("p", "q", "phi", "theta")}
    return {
        "time": time_s,
        "psi": _STEP_S * np.cumsum(rate) + 0.002 * rng.standard_normal(time_s.size),
        "r": rate + 0.01 * rng.standard_normal(time_s.size),
        "yaw_stick": stick,
        "yaw_command": trim,
        "battery_voltage": volts + 0.03 * rng.standard_normal(time_s.size),
        "thrust_command": thrust,
        "down": np.where(thrust > 0.0, -2.0, 0.0),
        **small,
    }


def yaw_drift_record(columns: dict[str, np.ndarray], name: str = "flight.csv") -> FlightRecord:
    """The columns as a record."""
    channels = tuple(Channel(name=column, unit=STANDARD_UNITS[column]) for column in columns if column != "time")
    values = np.stack([columns[channel.name] for channel in channels])
    topic = Topic(name="samples", time_s=columns["time"], channels=channels, values=values)
    return FlightRecord(source=Source(name=name, format="CSV", sha256=name), topics=(topic,))


def write_flight(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """The columns as a CSV log."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.6g")
    return path
