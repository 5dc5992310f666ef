r"""Wind and gyroscope noise of a flight, for the plan of the next one.

What gusts and noise take of the room within limits is not there for a test input. Both are measured on the user's own
log, with the vehicle that the plan is made for. Wind, from how the vehicle leans and drifts,

.. math:: d(v - w) = -\left(\dot v - g \tan \vartheta\right)

for each horizontal axis, with the velocity v over ground, the lean :math:`\vartheta`, the drag d of the model and the
wind w; slow motion only, in which the lift carries the weight. Gusts faster than two seconds average out of it, and
those slower than the flight count as wind. Noise of the gyroscopes, from the fast part of the
logged rates, which the closed loop of the plan would show for noise of one unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.data.record import AXES, FlightRecord, Intervals, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.flights.hover import hover_throttle
from rotorid.flights.whole_flights import FlightData, flown
from rotorid.flying.settings import DesignSettings
from rotorid.planning.aircraft import aircraft_loop
from rotorid.signal.excitations import find_excitations
from rotorid.simulation.multirotor import Multirotor, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_MOVING = ("velocity_north", "velocity_east", "phi", "theta", "psi")
_SMOOTH_S = 2.0
"""Over which the acceleration is taken: what gusts carry is slower."""

_LEAST_AIR_S = 20.0
_LEAST_NOISE_S = 8.0
_EDGE_S = 3.0
"""Left out after the start and before the landing."""

_FASTEST_M_S = 40.0
_WINDOW_S = 2.0
_LEAST_HZ = 12.0
"""Slower motion is the vehicle's, not the sensor's."""

_SLOW_RAD_S = 0.8 * 2.0 * math.pi * _LEAST_HZ
"""Test inputs that end below it leave the noise alone."""

_NARROW = 4.0
"""Mean over median density, above which the fast part of a rate is a line and no noise."""

_TOP = 0.8
"""Share of half of the log's rate up to which a spectrum is read."""


@dataclass(frozen=True, kw_only=True)
class LoggedAir(Immutable):
    """Wind and noise of a log; ``None`` where the log does not show them.

    Parameters
    ----------
    wind
        Mean and gusts.
    gyro_noise_rad_s
        Standard deviation of white noise, each sample of the control loop.
    findings
        What was taken, and what could not be.
    """

    wind: Wind | None
    gyro_noise_rad_s: float | None
    findings: tuple[Finding, ...]


def logged_air(record: FlightRecord, aircraft: Aircraft, *, height_m: float = 10.0) -> LoggedAir:
    """Wind and gyroscope noise of a log, as the vehicle of a plan would have met them.

    Parameters
    ----------
    aircraft
        The vehicle of the plan, with the gains of the log.
    height_m
        Above ground, for the size of the gusts.
    """
    name = record.source.name
    try:
        flight = flown(record)
    except InsufficientDataError as error:
        message = f"{name} shows neither wind nor noise ({error.came}); the plan has those of its own."
        return LoggedAir(wind=None, gyro_noise_rad_s=None, findings=(remark("air_not_logged", name, message),))
    found: list[Finding] = []
    wind, noise = None, None
    try:
        wind = _wind(flight, aircraft.vehicle, height_m)
        blows = f"wind {wind.speed_m_s:.1f} m/s, gusts {wind.turbulence_m_s:.1f} m/s"
    except InsufficientDataError as error:
        blows = f"no wind: {error.came}"
    try:
        noise = _gyro_noise(flight, aircraft)
        noisy = f"gyroscope noise {noise:.2g} rad/s a sample"
    except InsufficientDataError as error:
        noisy = f"no noise: {error.came}"
    numbers = {} if wind is None else {"wind_m_s": wind.speed_m_s, "turbulence_m_s": wind.turbulence_m_s}
    if noise is not None:
        numbers["gyro_noise_rad_s"] = noise
    kind = "air_of_log" if wind is not None or noise is not None else "air_not_logged"
    found.append(remark(kind, name, f"From {name}: {blows}; {noisy}.", **numbers))
    return LoggedAir(wind=wind, gyro_noise_rad_s=noise, findings=tuple(found))


def flown_as(choices: DesignSettings, record: FlightRecord) -> DesignSettings:
    """The choices of a design with the gains, the noise, the wind and the hover throttle of a log.

    The throttle of hover is that of the log where nobody knows the rotors better: not where results of its motors, or
    the user, say how strong they are.

    Parameters
    ----------
    choices
        A wind that they name stays; one of zero is that of the log.
    record
        A log of the autopilot of the vehicle.

    Raises
    ------
    UsageError
        The log holds no gains, or those of another autopilot.
    """
    flown = controllers_of(record)
    chosen = replace(choices, gains=flown.parameters, gains_source=record.source.name, firmware=flown.firmware.name)
    if not (chosen.own is not None and chosen.own.has_motors) and not {"thrust", "m"} & chosen.changes.keys():
        chosen = replace(chosen, hover_throttle=_hover(record))
    air = logged_air(record, chosen.aircraft, height_m=choices.plan.wind.height_m)
    calm = not choices.plan.wind.speed_m_s and not choices.plan.wind.turbulence_m_s
    plan = replace(choices.plan, wind=air.wind) if calm and air.wind is not None else choices.plan
    return replace(chosen, plan=plan, gyro_noise_rad_s=air.gyro_noise_rad_s, remarks=(*chosen.remarks, *air.findings))


_LEAST_HOVER, _MOST_HOVER = 0.1, 0.9
"""Outside of it a throttle is none of hover, or is not in the unit of a thrust command."""


def _hover(record: FlightRecord) -> float | None:
    """Thrust command in hover; ``None`` where the log does not show it."""
    try:
        found = hover_throttle(record, flown(record).flights)
    except InsufficientDataError:
        return None
    if "thrust_command" not in record or found is None or not _LEAST_HOVER < found.value < _MOST_HOVER:
        return None
    return found.value


def _wind(flight: FlightData, vehicle: Multirotor, height_m: float) -> Wind:
    linear = vehicle.aerodynamics
    drag_1_s = 0.0 if linear is None else -float(linear[0, 0]) / vehicle.mass_kg
    square_1_m = float(vehicle.quadratic_drag_n_s2_m2[0]) / vehicle.mass_kg
    if drag_1_s <= 0.0 and square_1_m <= 0.0:
        raise InsufficientDataError(f"{vehicle.name} has no drag model, so wind cannot be measured")
    missing = [name for name in _MOVING if name not in flight.record.channel_names]
    if missing:
        raise InsufficientDataError(f"{missing[0]} is not logged", needed="velocity and attitude")
    air_parts = [
        _air(history, drag_1_s, square_1_m)
        for history in flight.histories(_MOVING, intervals=_inner(flight.flights))
        if history.values.shape[1] / history.sample_rate_hz > 3.0 * _SMOOTH_S
    ]
    seconds = sum(part.shape[1] for part in air_parts) * _SMOOTH_S / 2.0
    if seconds < _LEAST_AIR_S:
        raise InsufficientDataError(f"only {seconds:.0f} s in the air", needed=f"{_LEAST_AIR_S:.0f} s")
    air = np.concatenate(air_parts, axis=1)
    north, east = np.median(air, axis=1)
    # Of a normal distribution; single gusts of a landing or a stick count no more than once.
    gusts = np.median(np.abs(air - [[north], [east]])) / 0.6745
    return Wind(north_m_s=float(north), east_m_s=float(east), turbulence_m_s=float(gusts), height_m=height_m)


def _inner(flights: Intervals) -> Intervals:
    return tuple((start_s + _EDGE_S, stop_s - _EDGE_S) for start_s, stop_s in flights if stop_s - start_s > 4 * _EDGE_S)


def _air(history: TimeHistory, drag_1_s: float, square_1_m: float) -> FloatArray:
    """Wind to north and east, means over half overlapping stretches, shape ``(2, n)``."""
    size = round(_SMOOTH_S * history.sample_rate_hz)
    phi, theta, psi = (history[name] for name in ("phi", "theta", "psi"))
    ahead, right = -STANDARD_GRAVITY_M_S2 * np.tan(theta), STANDARD_GRAVITY_M_S2 * np.tan(phi) / np.cos(theta)
    tilts = np.stack([np.cos(psi) * ahead - np.sin(psi) * right, np.sin(psi) * ahead + np.cos(psi) * right])
    speeds = np.stack([history["velocity_north"], history["velocity_east"]])
    found = []
    for first in range(0, speeds.shape[1] - size, size // 2):
        last = first + size
        gained = (speeds[:, last] - speeds[:, first]) / _SMOOTH_S
        braked = tilts[:, first:last].mean(axis=1) - gained
        found.append(speeds[:, first:last].mean(axis=1) - _airspeed(braked, drag_1_s, square_1_m))
    return np.stack(found, axis=1)


def _airspeed(braked_m_s2: FloatArray, drag_1_s: float, square_1_m: float) -> FloatArray:
    """Speed through the air at which drag brakes so much, along it."""
    size = float(np.hypot(*braked_m_s2))
    if square_1_m > 0.0:
        speed = (math.sqrt(drag_1_s**2 + 4.0 * square_1_m * size) - drag_1_s) / (2.0 * square_1_m)
    else:
        speed = size / drag_1_s
    return braked_m_s2 * (min(speed, _FASTEST_M_S) / size) if size > 0.0 else np.zeros(2)


def _gyro_noise(flight: FlightData, aircraft: Aircraft) -> float:
    """Median over frequency of logged over unit density, of roll and pitch."""
    names = RATES[:2]
    if missing := [name for name in names if name not in flight.record.channel_names]:
        raise InsufficientDataError(f"{missing[0]} is not logged", needed="body rates")
    rate_hz = flight.rate_hz(names[0])
    if _TOP * 0.5 * rate_hz < 2.0 * _LEAST_HZ:
        raise InsufficientDataError(f"rates are logged at only {rate_hz:.0f} Hz", needed=f"{5.0 * _LEAST_HZ:.0f} Hz")
    histories = flight.histories(names, intervals=_quiet(flight))
    spectra = [_densities(history) for history in histories]
    seconds = sum(history.values.shape[1] / history.sample_rate_hz for history in histories)
    if seconds < _LEAST_NOISE_S:
        raise InsufficientDataError(f"only {seconds:.0f} s without test inputs", needed=f"{_LEAST_NOISE_S:.0f} s")
    weights = [history.values.shape[1] for history in histories]
    frequency_hz = spectra[0][0]
    density = np.average([density for _, density in spectra], axis=0, weights=weights)
    rate_hz = histories[0].sample_rate_hz
    inside = (frequency_hz >= _LEAST_HZ) & (frequency_hz <= _TOP * 0.5 * rate_hz)
    gyro_only = replace(
        aircraft, sensors=replace(_SILENT, gyro_noise_rad_s=1.0, gyro_lag_s=aircraft.sensors.gyro_lag_s)
    )
    loop = aircraft_loop(gyro_only, log_rate_hz=min(rate_hz, aircraft.autopilot.rate_hz), filtered=True)
    first = len(AXES)
    unit = loop.logged_noise(2.0 * np.pi * frequency_hz[inside])
    ratios = [density[row, inside] / unit[first + row, first + row].real for row in range(len(names))]
    usual = float(np.median(ratios))
    if float(np.mean(ratios)) > _NARROW * usual:
        raise InsufficientDataError("the vehicle oscillates", needed="a flight without an oscillation")
    return math.sqrt(usual)


_SILENT = Sensors(gyro_noise_rad_s=0.0, accelerometer_noise_m_s2=0.0, attitude_noise_rad=0.0, velocity_noise_m_s=0.0)


def _quiet(flight: FlightData) -> Intervals:
    """Parts of the flights in which no test input reaches the frequencies of the noise."""
    axes: tuple[Axis, ...] = AXES  # type: ignore[assignment]
    tested = [
        maneuver
        for axis in axes
        for maneuver in find_excitations(flight.record, axis)
        if _fastest_rad_s(maneuver) > _SLOW_RAD_S
    ]
    kept = _inner(flight.flights)
    for maneuver in tested:
        kept = tuple(
            part for interval in kept for part in _without(interval, maneuver.start_s - 1.0, maneuver.stop_s + 1.0)
        )
    return kept


def _fastest_rad_s(maneuver: Maneuver) -> float:
    """Upper end of its band; infinite where it has none, as steps."""
    return maneuver.band_rad_s[1] if maneuver.band_rad_s is not None else math.inf


def _without(interval: tuple[float, float], start_s: float, stop_s: float) -> Sequence[tuple[float, float]]:
    parts = ((interval[0], min(interval[1], start_s)), (max(interval[0], stop_s), interval[1]))
    return [part for part in parts if part[1] > part[0]]


def _densities(history: TimeHistory) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz and one-sided densities of all channels."""
    from scipy.signal import welch

    size = round(_WINDOW_S * history.sample_rate_hz)
    frequency_hz, density = welch(history.values, fs=history.sample_rate_hz, nperseg=size, detrend="constant", axis=1)
    return frequency_hz, density
