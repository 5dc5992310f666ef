"""Stretches of ordinary flight as columns that drag is regressed on: braking, velocity, tilt and load, in a band.

Braking is the specific force with its sign changed; :mod:`rotorid.flights.tilt_drag` has the equation. The cosines of a
stretch are its coefficients in a band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.record import FlightRecord, Intervals, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.whole_flights import flown
from rotorid.frames import body_to_earth, rates_from_attitude
from rotorid.signal.dead_sensors import CHECK_SENSORS, dead_accelerometer
from rotorid.signal.kinematics import derivative, to_body
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

LOW_HZ, HIGH_HZ = 0.1, 1.0
"""Band of the motion that shows drag."""

_LOAD_HZ = 2.0 * HIGH_HZ
"""Faster load is vibration: with motion up to the end of the band, it makes none in the band."""

_LEAST_UPRIGHT = 0.2
"""Cosine of tilt below which tilts beyond it count as this one."""

_EDGE_S = 3.0
"""Left out after the take-off and before the landing."""

_SHORTEST_S = 10.0
"""Length of a stretch."""


@dataclass(frozen=True)
class Stretch:
    """Columns of a stretch of flight, each of shape ``(2, n)``: forward and right.

    ``braking`` is the specific force with its sign changed, ``pushed`` the acceleration by the tilt, north and east,
    that becomes the instrument behind ``lag_s``, ``lever`` what an accelerometer 1 m below the center of gravity adds
    to ``braking``, ``north`` and ``east`` these directions in body axes. ``faster`` is the rotor speed over that at one
    g, shape ``(n,)``.
    """

    rate_hz: float
    braking: FloatArray
    velocity: FloatArray
    pushed: FloatArray
    lever: FloatArray
    north: FloatArray
    east: FloatArray
    faster: FloatArray
    heading_known: bool
    lag_s: float = 1.0

    @cached_property
    def tilt(self) -> FloatArray:
        """The instrument, shape ``(2, n)``."""
        return self.behind(self.lag_s)

    def behind(self, lag_s: float) -> FloatArray:
        """Acceleration by the tilt behind a lag, in body axes, from rest at the first sample, shape ``(2, n)``."""
        from scipy.signal import lfilter

        keep = math.exp(-1.0 / (self.rate_hz * lag_s))
        lagged, _ = lfilter([1.0 - keep], [1.0, -keep], self.pushed, axis=-1, zi=keep * self.pushed[:, :1])
        return np.asarray(lagged[0] * self.north + lagged[1] * self.east)

    @property
    def seconds(self) -> float:
        """Length."""
        return float(self.braking.shape[1] / self.rate_hz)

    def in_band(self, values: FloatArray, band_hz: tuple[float, float] | None = None) -> FloatArray:
        """Cosine coefficients in the band of columns, shape ``(..., n)``; their squares add up to integrals over time.

        The cosines of a stretch are orthogonal, so that leaving some out is a projection, without transients.
        """
        from scipy.fft import dct

        return np.asarray(
            dct(values, norm="ortho", axis=-1)[..., self._kept(values, band_hz)] / math.sqrt(self.rate_hz)
        )

    def only_band(self, values: FloatArray) -> FloatArray:
        """The part of columns of shape ``(..., n)`` that is in the band."""
        from scipy.fft import dct, idct

        return np.asarray(idct(dct(values, norm="ortho", axis=-1) * self._kept(values), norm="ortho", axis=-1))

    def _kept(self, values: FloatArray, band_hz: tuple[float, float] | None = None) -> BoolArray:
        return _inside(values.shape[-1], self.rate_hz, *(band_hz or (LOW_HZ, HIGH_HZ)))

    def part(self, low_hz: float, high_hz: float) -> FloatArray:
        """As ``linear`` in another band, shape ``(4, 2, k)``."""
        rows = np.stack([self.braking, self.faster * self.velocity, self.lever, self.faster * self.tilt])
        return self.in_band(rows, (low_hz, high_hz))

    def thinned(self, values: FloatArray) -> FloatArray:
        """Five samples of the fastest motion in the band."""
        return np.asarray(values[..., :: max(1, int(self.rate_hz / (5.0 * HIGH_HZ)))])

    def airspeed(self, wind: FloatArray, velocity: FloatArray | None = None) -> FloatArray:
        """Velocity through the air in body axes, shape ``(2, n)``."""
        ground = self.velocity if velocity is None else velocity
        return np.asarray(ground - wind[0] * self.north - wind[1] * self.east)

    @cached_property
    def linear(self) -> FloatArray:
        """Braking, velocity times rotor speed, lever and tilt times rotor speed in the band, shape ``(4, 2, k)``."""
        return self.part(LOW_HZ, HIGH_HZ)


def _inside(size: int, rate_hz: float, low_hz: float, high_hz: float) -> BoolArray:
    """Which cosines of so many samples are in a band."""
    frequency_hz = 0.5 * rate_hz * np.arange(size) / size
    return np.asarray((frequency_hz >= low_hz) & (frequency_hz <= high_hz))


def velocities_of(record: FlightRecord) -> tuple[str, ...]:
    """Channels of the horizontal velocity: in body axes, or over the earth."""
    names = record.channel_names
    if "u" in names and "v" in names and not {"velocity_north", "velocity_east", "psi"} <= set(names):
        return ("u", "v")
    return ("velocity_north", "velocity_east")


def stretches_of(record: FlightRecord, intervals: Intervals) -> list[Stretch]:
    """Stretches of 10 s and more of the flights, without their ends."""
    if why := dead_accelerometer(record):
        raise InsufficientDataError(why, needed="an accelerometer, to measure drag", remedy=CHECK_SENSORS)
    names = record.channel_names
    velocities = velocities_of(record)
    wanted = ["ax", "ay", "phi", "theta", *velocities]
    if velocities[0] != "u":
        wanted.append("psi")
    missing = [name for name in wanted if name not in names]
    if missing:
        raise InsufficientDataError(
            f"{record.source.name} lacks {missing[0]}",
            needed="specific force, attitude and velocity, to measure drag",
            remedy="log accelerometers, attitude and an estimated velocity",
        )
    wanted += [name for name in ("psi", "velocity_down", "az") if name in names and name not in wanted]
    inner = tuple(
        (start_s + _EDGE_S, stop_s - _EDGE_S)
        for start_s, stop_s in intervals
        if stop_s - start_s > _SHORTEST_S + 2.0 * _EDGE_S
    )
    if not inner:
        return []
    histories = flown(record).histories(wanted, intervals=inner)
    return [_stretch(history) for history in histories if history.duration_s >= _SHORTEST_S]


def _stretch(history: TimeHistory) -> Stretch:
    size, rate_hz = history.values.shape[1], history.sample_rate_hz
    one, zero = np.ones(size), np.zeros(size)
    known = "psi" in history.names
    if not known:
        psi = replace(history.channels[0], name="psi", unit="rad", source="")
        history = replace(history, values=np.vstack([history.values, zero]), channels=(*history.channels, psi))
    if "u" in history.names:
        velocity = np.stack([history["u"], history["v"]])
    else:
        down = history["velocity_down"] if "velocity_down" in history.names else zero
        velocity = to_body(history, np.stack([history["velocity_north"], history["velocity_east"], down]))[:2]
    north = to_body(history, np.stack([one, zero, zero]))[:2]
    east = to_body(history, np.stack([zero, one, zero]))[:2]
    p, q, r = _rates(history)
    p_dot, q_dot = derivative(np.stack([p, q]), rate_hz)
    return Stretch(
        rate_hz=rate_hz,
        braking=-np.stack([history["ax"], history["ay"]]),
        velocity=velocity,
        pushed=_acceleration(history),
        lever=-np.stack([q_dot + p * r, q * r - p_dot]),
        north=north,
        east=east,
        faster=_rotor_speed(history),
        heading_known=known,
    )


def _rotor_speed(history: TimeHistory) -> FloatArray:
    """Rotor speed over that at one g, shape ``(n,)``: one where the load is not logged, zero where nothing lifts."""
    from scipy.fft import dct, idct

    size = history.values.shape[1]
    if "az" not in history.names:
        return np.ones(size)
    kept = _inside(size, history.sample_rate_hz, 0.0, _LOAD_HZ)
    load = idct(dct(-history["az"] / STANDARD_GRAVITY_M_S2, norm="ortho") * kept, norm="ortho")
    return np.asarray(np.sqrt(np.maximum(load, 0.0)))


def _acceleration(history: TimeHistory) -> FloatArray:
    """North and east acceleration of thrust that carries the weight, by the tilt, shape ``(2, n)``."""
    attitude = np.stack([history[name] for name in ATTITUDE])
    zero = np.zeros(attitude.shape[1])
    *axis, upright = body_to_earth(attitude, np.stack([zero, zero, zero + 1.0]))
    return np.asarray(-STANDARD_GRAVITY_M_S2 * np.stack(axis) / np.maximum(upright, _LEAST_UPRIGHT))


def _rates(history: TimeHistory) -> FloatArray:
    """Body rates from the attitude, which is logged as fast as the instrument needs."""
    # Unwrapped, a heading that passes south is no jump.
    angles = np.unwrap(np.stack([history[name] for name in ATTITUDE]), axis=-1)
    return rates_from_attitude(angles, derivative(angles, history.sample_rate_hz))
