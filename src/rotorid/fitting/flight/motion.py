r"""What the model of flight is driven by, from a record: speeds of the rotors, air velocity, angular acceleration.

Where the velocity was not logged but the attitude was, it is integrated from the specific force, with a leak that
forgets what the errors of the accelerometer add up to:

.. math:: \dot v_{earth} = R f + g - v_{earth} / T, \qquad T = 8\,\mathrm{s}

A velocity that stays the same for much longer than that is lost, and with it the drag of steady flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fitting.motors.speed import measured_speed, motor_speed
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.models.flight import Airframe, Columns, flight_loads, speeds_of_outputs
from rotorid.signal.kinematics import derivative
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

VelocityClass: TypeAlias = Literal["measured", "attitude", "none"]
"""Where the velocity comes from, the best first: the log, the attitude and the accelerometer, or nowhere."""

VELOCITY_CLASSES: tuple[VelocityClass, ...] = get_args(VelocityClass)

_LEAK_S = 8.0
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
        return record.velocity
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
    lag_s = max(values.get("T_motor", 0.0), _NO_LAG_S)
    lagged = motor_speed(record.outputs, lag_s=lag_s, delay_s=skew_s, step_s=step).level
    return speeds_of_outputs(values, lagged) * np.sqrt(record.strength)


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
