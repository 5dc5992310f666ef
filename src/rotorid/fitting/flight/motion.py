r"""What the model of flight is driven by, from a record: speeds of the rotors, air velocity, angular acceleration.

Where the velocity was not logged but the attitude was, it is integrated from the specific force, with a leak that
forgets what the errors of the accelerometer add up to:

.. math:: \dot v_{earth} = R f + g - v_{earth} / T, \qquad T = 8\,\mathrm{s}

A velocity that stays the same for much longer than that is lost, and with it the drag of steady flight.

Noise of measured speeds makes motors seem to turn the vehicle by less than they do, small vehicles by a fifth; noise of
the velocity hides inflow. What a regression needs is what was so on average where such values were measured
(:func:`without_noise`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fitting.motors.speed import measured_speed, motor_speed
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.models.flight import CURVE_TERMS, Airframe, Columns, flight_loads, speeds_of_outputs
from rotorid.signal.kinematics import derivative
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

VelocityClass: TypeAlias = Literal["measured", "attitude", "none"]
"""Where the velocity comes from, the best first: the log, the attitude and the accelerometer, or nowhere."""

VELOCITY_CLASSES: tuple[VelocityClass, ...] = get_args(VelocityClass)

_LEAK_S = 8.0
_WINDOW_S, _LEAST_WINDOWS = 4.0, 8
_QUIET = 0.35
"""Frequency over the sample rate above which speeds are noise."""
_NO_LAG_S = 1e-6


class Motion(NamedTuple):
    """What drives the model over a record.

    Parameters
    ----------
    speeds
        Of the rotors, lags, curve and skew taken in, rad/s or shares of the full speed, shape ``(rotors, n)``.
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``; zero where it is not known.
    rates, acceleration
        About the axes, rad/s and rad/s², shape ``(3, n)``.
    spin_up
        Change of the speeds, shape ``(rotors, n)``.
    """

    speeds: FloatArray
    velocity: FloatArray
    rates: FloatArray
    acceleration: FloatArray
    spin_up: FloatArray

    def loads(self, values: Mapping[str, float], airframe: Airframe) -> Columns:
        """Force and moment that the model makes of it, see :func:`rotorid.models.flight.flight_loads`."""
        return flight_loads(
            values, airframe, speeds=self.speeds, velocity=self.velocity, rates=self.rates, spin_up=self.spin_up
        )


def velocity_class(records: Sequence[MotorRecord], best: VelocityClass = "measured") -> VelocityClass:
    """How the velocity is had: the best way that all records allow.

    Parameters
    ----------
    best
        What a fit had: nothing better counts.
    """
    allowed = {
        "measured": all(record.velocity.shape[1] for record in records),
        "attitude": all(record.attitude.shape[1] for record in records),
        "none": True,
    }
    return next(kind for kind in VELOCITY_CLASSES[VELOCITY_CLASSES.index(best) :] if allowed[kind])


def ground_velocity(record: MotorRecord, kind: VelocityClass) -> FloatArray:
    """Velocity over ground in body axes, m/s, shape ``(3, n)``.

    Raises
    ------
    UsageError
        The record lacks what this kind needs.
    """
    if kind == "none":
        return np.zeros((3, record.samples))
    if kind == "measured":
        if not record.velocity.shape[1]:
            raise UsageError(f"{record.name} has no velocity", needed="one in body axes")
        return _smooth_velocity(record)
    if not record.attitude.shape[1]:
        raise UsageError(f"{record.name} has no attitude", needed="roll, pitch and heading")
    from scipy.signal import lfilter

    moved = body_to_earth(record.attitude, record.force)
    moved[2] += STANDARD_GRAVITY_M_S2
    # What is constant over the whole flight is an error of the accelerometer: it would be the velocity of a leak.
    moved -= moved.mean(axis=1, keepdims=True)
    step = 1.0 / record.sample_rate_hz
    keep = np.exp(-step / _LEAK_S)
    reached = lfilter([0.5 * step, 0.5 * step], [1.0, -keep], moved, axis=1)
    return earth_to_body(record.attitude, reached)


def wind_in_body(record: MotorRecord, wind: FloatArray) -> FloatArray:
    """A wind toward north and east, m/s, in body axes, shape ``(3, n)``; none where there is no attitude."""
    if not record.attitude.shape[1] or not np.any(wind):
        return np.zeros((3, record.samples))
    return earth_to_body(record.attitude, np.tile(np.array([*wind, 0.0])[:, None], record.samples))


def rotor_speeds(record: MotorRecord, values: Mapping[str, float] | None = None, *, skew_s: float = 0.0) -> FloatArray:
    """Speeds of the rotors: measured ones, or shares of the full speed by the outputs, their lag, curve and voltage.

    Parameters
    ----------
    record
        With speeds (``lines``) or outputs (``held``).
    values
        For ``T_motor`` and the curve, which outputs need.
    skew_s
        How much earlier the stamps of the motors are than those of the gyros.
    """
    values = values or {}
    step = 1.0 / record.sample_rate_hz
    if record.between == "lines":
        return measured_speed(record.outputs, delay_s=skew_s, step_s=step).level if skew_s else record.outputs
    return speeds_of_outputs(values, _lagged(record, values, skew_s)) * np.sqrt(record.strength)


def curve_columns(record: MotorRecord, values: Mapping[str, float], *, skew_s: float = 0.0) -> dict[str, FloatArray]:
    """Thrust of all rotors without inflow that each coefficient of the curve of outputs makes at one, ``(n,)`` each."""
    lagged = _lagged(record, values, skew_s)
    return {name: (lagged**power * record.strength).sum(axis=0) for power, name in enumerate(CURVE_TERMS)}


def _lagged(record: MotorRecord, values: Mapping[str, float], skew_s: float) -> FloatArray:
    lag_s = max(values.get("T_motor", 0.0), _NO_LAG_S)
    return motor_speed(record.outputs, lag_s=lag_s, delay_s=skew_s, step_s=1.0 / record.sample_rate_hz).level


@lru_cache(maxsize=16)
def _smooth_velocity(record: MotorRecord) -> FloatArray:
    return without_noise(record.velocity, record.sample_rate_hz)


def without_noise(speeds: FloatArray, sample_rate_hz: float) -> FloatArray:
    r"""Measured speeds, or a velocity, as one expects the true ones to be: Wiener's filter of all rows together.

    .. math:: H(f) = I - N S(f)^{-1}

    with the spectra S of the speeds and their noise N, which is white, and is what they have near the Nyquist
    frequency. A regression on these speeds is free of the bias that their noise makes.

    Parameters
    ----------
    speeds
        Shape ``(rows, n)``.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> true = np.sin(np.arange(4000.0) / 50.0)[None]
    >>> found = without_noise(true + 0.1 * rng.normal(size=true.shape), 100.0)
    >>> bool(np.std(found - true) < 0.05)
    True
    """
    from scipy.signal import csd

    samples = speeds.shape[1]
    window = min(round(_WINDOW_S * sample_rate_hz), 2 * samples // (_LEAST_WINDOWS + 1))
    if window < speeds.shape[0]:
        return speeds
    hz, spectra = csd(speeds[:, None], speeds[None], sample_rate_hz, nperseg=window)
    spectra = np.moveaxis(spectra, -1, 0)
    own = np.diagonal(spectra, axis1=1, axis2=2).real
    noise = np.sqrt(np.median(own[hz > _QUIET * sample_rate_hz], axis=0))
    if not np.all(noise > 0.0):
        return speeds
    sizes, ways = np.linalg.eigh(spectra / np.outer(noise, noise))
    kept = np.maximum(1.0 - 1.0 / np.maximum(sizes, 1.0), 0.0)
    # What is slower than a window, windows do not show.
    kept[:2] = 1.0
    filters = (ways * kept[:, None]) @ ways.conj().swapaxes(1, 2) * np.divide.outer(noise, noise)
    steps = np.fft.rfftfreq(samples, 1.0 / sample_rate_hz)
    fine = np.array([[np.interp(steps, hz, way) for way in row] for row in filters.transpose(1, 2, 0)])
    middle = speeds.mean(axis=1, keepdims=True)
    passed = np.einsum("ijf,jf->if", fine, np.fft.rfft(speeds - middle, axis=1))
    return np.asarray(middle + np.fft.irfft(passed, samples, axis=1))


def motion(
    record: MotorRecord,
    values: Mapping[str, float] | None = None,
    *,
    kind: VelocityClass | None = None,
    wind: FloatArray | None = None,
    skew_s: float = 0.0,
) -> Motion:
    """What drives the model over a record.

    Parameters
    ----------
    record
        What was flown.
    values
        Numbers of the model; lags and the curve of outputs count.
    kind
        Of the velocity; by default the best that the record allows.
    wind
        Toward north and east, m/s; none where it is not finite.
    skew_s
        How much earlier the stamps of the motors are than those of the gyros.
    """
    rate_hz = record.sample_rate_hz
    speeds = rotor_speeds(record, values, skew_s=skew_s)
    velocity = ground_velocity(record, kind or velocity_class([record]))
    if wind is not None and np.isfinite(wind).all():
        velocity = velocity - wind_in_body(record, wind)
    return Motion(speeds, velocity, record.rates, derivative(record.rates, rate_hz), derivative(speeds, rate_hz))
