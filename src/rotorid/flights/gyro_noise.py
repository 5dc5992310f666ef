"""Noise of the gyro as the rate controllers take it, moment by moment, and the lines in it.

The rate behind the filters is taken as it was logged; where it is logged too slowly, the rate before them is sent
through the flown filters. A log that is slower than its controller folds faster noise down, where no filter is judged
rightly: it counts only where the motors' speeds show that their first line lies within it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.advice import gap_advice, logging_advice, raw_gyro_advice, sensor_advice
from rotorid.autopilots.filters import combined_response
from rotorid.autopilots.notches import Motion, NoiseLines
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATES
from rotorid.data.base import Immutable, cached_by_value, read_only
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.flights.sensor_samples import (
    LEAST_RATE_HZ,
    LINES_ABOVE_HZ,
    OF_RATE,
    Sensor,
    level_of,
    rotor_speeds_hz,
    sensors_of,
)
from rotorid.signal.airborne import airborne
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.spectral.noise import OVERLAP, WINDOW_S, ShortSpectra, by_level, lines, short_spectra
from rotorid.typing import FloatArray

_MOST_WINDOWS = 480
_FEWEST_WINDOWS = 24
"""Windows without which the scatter of a flight is not known."""

_LEVELS = 26
"""Edges of the levels of throttle by which lines are followed."""

_SEES_ALL = 0.9
"""Rate of a log over that of its controller from which the controller sees nothing that the log does not."""

_FAST_HZ = 500.0
"""Rate from which a log holds the first lines of usual rotors, where their speeds are not known."""

_ONE_RATE = 0.02
"""Largest difference of the rates of two axes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GyroNoise(Immutable):
    """Densities of the rates that the controllers take, in ``n`` moments.

    Parameters
    ----------
    time_s
        Shape ``(n,)``.
    frequency_hz
        Shape ``(f,)``.
    density
        ``p``, ``q``, ``r`` to one-sided densities in (rad/s)²/Hz, shape ``(n, f)`` each.
    motion
        Speeds of the motors and throttle in these moments.
    lines
        What stands out.
    """

    time_s: FloatArray
    frequency_hz: FloatArray
    density: Mapping[str, FloatArray]
    motion: Motion
    lines: NoiseLines

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            frequency_hz=read_only(self.frequency_hz, np.float64, ndim=1),
            density={name: read_only(rows, np.float64, ndim=2) for name, rows in self.density.items()},
        )

    @property
    def omega_rad_s(self) -> FloatArray:
        """Frequencies in rad/s, shape ``(f,)``."""
        return 2.0 * np.pi * self.frequency_hz


@cached_by_value
def gyro_noise(record: FlightRecord) -> GyroNoise:
    """Noise of roll, pitch and yaw rate as the controllers of a flight took it.

    Raises
    ------
    InsufficientDataError
        The log is too slow, too short, or does not say how its gyro was filtered; the remedy says what to log.
    """
    flights = airborne(record).intervals
    sensors = [sensor for sensor in sensors_of(record, flights) if sensor.channel in RATES]
    for stage in ("before", "after"):
        chosen = {sensor.channel: sensor for sensor in sensors if sensor.stage == stage}
        if len(chosen) == len(RATES) and _usable(record, chosen, stage):
            return _noise_of(record, chosen, raw=stage == "before")
    raise _too_slow(record, sensors)


def _too_slow(record: FlightRecord, sensors: list[Sensor]) -> InsufficientDataError:
    after = [sensor for sensor in sensors if sensor.stage == "after"]
    if not sensors:
        return InsufficientDataError("the body rates are not logged in the air", remedy=logging_advice(record, 0.0))
    rate_hz = min(sensor.rate_hz for sensor in after or sensors)
    fast = rate_hz >= LEAST_RATE_HZ
    why = f"the gyro is logged at {rate_hz:.0f} Hz"
    remedy = (fast and raw_gyro_advice(record)) or sensor_advice(record, rate_hz) or logging_advice(record, rate_hz)
    return InsufficientDataError(f"{why}, too slow for the noise of the motors", remedy=remedy or "log it faster")


def _too_few_windows(record: FlightRecord) -> InsufficientDataError:
    flown_s = sum(stop - start for start, stop in airborne(record).intervals)
    if flown_s > WINDOW_S * (1.0 + _FEWEST_WINDOWS * (1.0 - OVERLAP)):
        why = "the gyro is logged with too many gaps to measure its noise"
        return InsufficientDataError(why, remedy=gap_advice(record))
    return InsufficientDataError(
        "the flight is too short to measure the noise of its gyro", remedy="fly and log for 20 s or more"
    )


def _usable(record: FlightRecord, sensors: Mapping[str, Sensor], stage: str) -> bool:
    """Whether sensors of one stage show the noise that their controller takes."""
    rates = [sensor.rate_hz for sensor in sensors.values()]
    rate_hz = min(rates)
    if rate_hz < LEAST_RATE_HZ or max(rates) > (1.0 + _ONE_RATE) * rate_hz:
        return False
    first = sensors["p"]
    if stage == "before" and (first.topic == "sensor_combined" or _unknown_chain(record, first)):
        return False
    speeds = rotor_speeds_hz(record, first.time_s)
    turning = np.zeros(0) if speeds is None else speeds[np.isfinite(speeds) & (speeds > LINES_ABOVE_HZ)]
    if turning.size:
        return float(np.quantile(turning, 0.95)) <= OF_RATE * rate_hz
    return rate_hz >= min(_SEES_ALL * _loop_hz(record), _FAST_HZ)


def _loop_hz(record: FlightRecord) -> float:
    """Steps per second of the rate controller; infinite where they are not known."""
    found = controllers_of(record).axis("roll")
    step_s = 0.0 if found is None else found.controller.step_s
    return 1.0 / step_s if step_s > 0.0 else math.inf


def _unknown_chain(record: FlightRecord, sensor: Sensor) -> bool:
    """Whether what the flown filters did to a raw rate is not known."""
    log = autopilot_of(record).log
    motion = _motion(record, sensor.time_s[:: max(sensor.time_s.size // 16, 1)])
    moves = log.moving_notches(record, motion)
    static = log.passage(record, log.rate_source, None) if log.rate_source else None
    doubts = () if static is None else tuple(doubt for doubt in static.doubts if "moves in flight" not in doubt)
    return static is None or bool(doubts) or bool(moves.unknown) or (bool(static.doubts) and not moves.settings)


def _motion(record: FlightRecord, time_s: FloatArray) -> Motion:
    return Motion(
        speeds_hz=rotor_speeds_hz(record, time_s),
        throttle=_throttle(record, time_s),
        centers_hz=_centers_hz(record, time_s),
    )


def _centers_hz(record: FlightRecord, time_s: FloatArray) -> FloatArray | None:
    """Logged centers of notches; where one is at rest, that of the moments around it."""
    rows = []
    for name in (name for name in record.channel_names if name.startswith("notch_frequency_")):
        track = record[name]
        moved = np.isfinite(track.values) & (track.values > 0.0)
        if np.count_nonzero(moved) > 2:
            rows.append(np.interp(time_s, track.time_s[moved], track.values[moved]) / (2.0 * np.pi))
    return np.stack(rows) if rows else None


def _throttle(record: FlightRecord, time_s: FloatArray) -> FloatArray | None:
    """The thrust command where there is one, which notches follow; else the mean of the motors."""
    if "thrust_command" in record:
        track = record["thrust_command"]
        kept = np.isfinite(track.values)
        if np.count_nonzero(kept) > 2:
            return np.interp(time_s, track.time_s[kept], track.values[kept])
    level = level_of(record)
    return None if level is None else np.nan_to_num(level.at(time_s), nan=float(np.nanmedian(level.values)))


def _noise_of(record: FlightRecord, sensors: Mapping[str, Sensor], *, raw: bool) -> GyroNoise:
    found = {name: short_spectra(sensor.time_s, sensor.values) for name, sensor in sensors.items()}
    spectra = {name: one for name, one in found.items() if one is not None}
    count = min((one.time_s.size for one in spectra.values()), default=0)
    same = {one.frequency_hz.size for one in spectra.values()}
    if len(spectra) < len(RATES) or count < _FEWEST_WINDOWS or len(same) != 1:
        raise _too_few_windows(record)
    first = spectra["p"]
    rows = np.unique(np.linspace(0, count - 1, min(count, _MOST_WINDOWS)).astype(np.int64))
    motion = _motion(record, first.time_s[:count])
    if motion.speeds_hz is not None:
        rows = rows[np.all(np.isfinite(motion.speeds_hz[:, rows]), axis=0)]
    if rows.size < _FEWEST_WINDOWS:
        raise InsufficientDataError(
            "throttle and motor speeds are logged for a small part of the flight only",
            remedy="log the motors all the time",
        )
    at = motion.at(rows)
    density = {name: one.density[rows] for name, one in spectra.items()}
    if raw:
        omega = 2.0 * np.pi * first.frequency_hz
        passed = np.abs(combined_response(controller_filters(record), omega)) ** 2
        moved = np.abs(autopilot_of(record).log.moving_notches(record, at).response(omega)) ** 2
        density = {name: rows_of * passed * moved for name, rows_of in density.items()}
    return GyroNoise(
        time_s=first.time_s[rows],
        frequency_hz=first.frequency_hz,
        density=density,
        motion=at,
        lines=_lines(spectra, motion, count),
    )


def _lines(spectra: Mapping[str, ShortSpectra], motion: Motion, count: int) -> NoiseLines:
    """The rotors' first line and those that stay, of roll and pitch."""
    level = motion.throttle
    usual = float(np.median(level)) if level is not None else math.nan
    moving: list[tuple[float, float]] = []
    fixed: list[tuple[float, float]] = []
    for name in ("p", "q"):
        if level is None:
            break
        one = spectra[name]
        part = ShortSpectra(
            time_s=one.time_s[:count],
            frequency_hz=one.frequency_hz,
            density=one.density[:count],
            window_s=one.window_s,
        )
        edges = np.linspace(0.0, 1.0, _LEVELS)
        for line in lines(by_level(part, level, edges=edges), one.frequency_hz, above_hz=LINES_ABOVE_HZ):
            if float(line.frequency_hz.max()) > OF_RATE * 2.0 * float(one.frequency_hz[-1]):
                continue
            if line.maker == "frame":
                fixed.append((float(line.height_db.mean()), float(np.median(line.frequency_hz))))
            elif line.maker == "rotor":
                at = line.frequency_hz.mean() + line.slope_hz * (usual - line.level.mean())
                moving.append((float(line.frequency_hz.min()), float(at)))
    speeds = motion.speeds_hz
    if speeds is not None:
        turning = speeds[np.isfinite(speeds) & (speeds > LINES_ABOVE_HZ)]
        rotor = (float(np.quantile(turning, 0.05)), float(np.median(turning))) if turning.size else None
    else:
        rotor = min(moving, key=lambda pair: pair[1], default=None)
    fixed_hz = tuple(hz for _, hz in sorted(fixed, reverse=True))
    return NoiseLines(rotor_hz=rotor, speeds_logged=speeds is not None, throttle=usual, fixed_hz=fixed_hz)
