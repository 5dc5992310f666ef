r"""How late the velocity of a log is: GPS and estimators report where the vehicle was a while ago.

Over the earth the velocity changes by what the accelerometer and gravity make together, whatever flew:

.. math:: \dot v(t) = \bigl(R f + g\bigr)(t - \tau) + d\, v(t)

axis by axis. The delay is the lag of the largest partial correlation; the velocity itself is taken out of both sides,
because an accelerometer with an error of its scale or its bias shows a part of the drag only, which is out of phase
with the motion. Assumes an attitude with the stamps of the accelerometer, as an autopilot logs it: in the horizontal
axes it is the attitude that is compared. A velocity in body axes is that of the attitude of its own time, so that its
delay is searched from several starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Intervals, TimeHistory, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.flight_faults import velocity_late
from rotorid.flights.motor_band import flights_off_ground
from rotorid.frames import body_to_earth
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import ACCELERATIONS, EARTH_VELOCITIES, VELOCITIES, derivative
from rotorid.signal.partial_lag import Lag, LagPart, lag_curve, together
from rotorid.typing import FloatArray

_BAND_HZ = (0.3, 3.0)
"""Where ordinary flying moves a vehicle: above the drift of estimators, below vibration."""

_NYQUIST_SHARE = 0.8
_LEAST_RATE_HZ, _CLOCK_HZ = 4.0, 50.0
_LONGEST_S = 0.5
_LEAST_S, _BLOCK_S = 10.0, 4.0
_LEAST_CORRELATION = 0.6
_ROUNDS = 3
_LEAST_DELAY_S, _SURE = 0.02, 3.0
"""Delay, and its standard deviations, from which a velocity is moved."""

_AXES = ("north", "east", "down")


@dataclass(frozen=True, kw_only=True, eq=False)
class VelocityDelay(Immutable):
    """How long after the motion the velocity is stamped.

    Parameters
    ----------
    late_s
        The delay: to take it out, move the velocity ahead by it.
    by_axis
        The same of north, east and down, as far as the axis moved.
    correlation
        Axis to the partial correlation of the change of velocity with the acceleration.
    """

    late_s: Quantity
    by_axis: Mapping[str, Quantity]
    correlation: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(by_axis=self.by_axis, correlation=self.correlation)

    def findings(self, where: str) -> tuple[Finding, ...]:
        """A warning where the velocity is late by enough to change drag."""
        return velocity_late(self.late_s, where)


def velocity_delay(record: FlightRecord, stretches: Intervals) -> VelocityDelay:
    """Delay of the logged velocity against acceleration and attitude.

    Parameters
    ----------
    record
        Specific force, attitude, and velocity over the earth or in body axes.
    stretches
        Start and stop of each flight.

    Raises
    ------
    InsufficientDataError
        A channel is missing or too slow, the flight is too short, or the velocity does not follow the acceleration.

    Examples
    --------
    >>> delay = velocity_delay(rotorid.read("flight.ulg"), [(10.0, 90.0)])  # doctest: +SKIP
    >>> delay.late_s.value  # doctest: +SKIP
    0.11
    """
    velocities = _velocities(record)
    rate_hz = min(record.rate_hz(name) for name in (*velocities, *ATTITUDE, *ACCELERATIONS))
    if rate_hz < _LEAST_RATE_HZ:
        raise InsufficientDataError(
            f"velocity, attitude and specific force of {record.source.name} are logged at {rate_hz:.2g} Hz",
            needed=f"{_LEAST_RATE_HZ:g} Hz",
            remedy="log them faster",
        )
    histories = _histories(record, velocities, stretches)
    # In body axes the delayed velocity belongs to the delayed attitude, which the first search does not know.
    starts_s = (0.0, 0.1, 0.2, 0.3) if velocities == VELOCITIES else (0.0,)
    high_hz = min(_BAND_HZ[1], 0.5 * _NYQUIST_SHARE * rate_hz)
    where = f"velocity of {record.source.name}"
    best = max(
        (_lags(histories, velocities, high_hz, start_s, where) for start_s in starts_s),
        key=lambda lags: sum(lag.correlation for lag in lags),
    )
    if velocities == VELOCITIES:
        for _ in range(_ROUNDS):
            best = _lags(histories, velocities, high_hz, max(best, key=lambda lag: lag.correlation).seconds, where)
    lags = dict(zip(_AXES, best, strict=True))
    correlation = {axis: lag.correlation for axis, lag in lags.items()}
    by_axis = {
        axis: Quantity.normal(lag.seconds, lag.std, "s")
        for axis, lag in lags.items()
        if lag.correlation >= _LEAST_CORRELATION
    }
    if not by_axis:
        values = ", ".join(f"{value:.2f} {axis}" for axis, value in correlation.items())
        raise InsufficientDataError(
            f"the velocity of {record.source.name} does not follow its acceleration (correlation {values})",
            needed=f"{_LEAST_CORRELATION:g} in one axis",
            remedy="fly back and forth at 1 m/s and more",
        )
    return VelocityDelay(late_s=together(by_axis.values()), by_axis=by_axis, correlation=correlation)


def prompt_velocity(record: FlightRecord) -> tuple[FlightRecord, tuple[Finding, ...]]:
    """A log whose velocity is stamped when it was, and a warning where the delay changes drag.

    The log as it is where its velocity is not surely late, or nothing shows whether it is.
    """
    try:
        found = velocity_delay(record, flights_off_ground(record))
    except InsufficientDataError:
        return record, ()
    late_s = found.late_s.value
    if abs(late_s) < max(_LEAST_DELAY_S, _SURE * found.late_s.std):
        return record, ()
    return _shifted(record, -late_s), found.findings(record.source.name)


def _shifted(record: FlightRecord, seconds: float) -> FlightRecord:
    """A log with other stamps of its velocities."""
    topics: list[Topic] = []
    for topic in record.topics:
        moved = [channel.name in (*EARTH_VELOCITIES, *VELOCITIES) for channel in topic.channels]
        for rows, shift_s in ((np.flatnonzero(moved), seconds), (np.flatnonzero(np.logical_not(moved)), 0.0)):
            if rows.size:
                channels = tuple(topic.channels[row] for row in rows)
                topics.append(
                    replace(topic, time_s=topic.time_s + shift_s, channels=channels, values=topic.values[rows])
                )
    return replace(record, topics=tuple(topics))


def _velocities(record: FlightRecord) -> tuple[str, ...]:
    """Channels of the velocity: over the earth, else in body axes."""
    names = set(record.channel_names)
    velocities = VELOCITIES if set(VELOCITIES) <= names and not set(EARTH_VELOCITIES) <= names else EARTH_VELOCITIES
    missing = [name for name in (*velocities, *ATTITUDE, *ACCELERATIONS) if name not in names]
    if not missing:
        return velocities
    raise InsufficientDataError(
        f"{record.source.name} lacks {missing[0]}",
        needed="specific force, attitude and velocity",
        remedy="log accelerometers, attitude and an estimated velocity",
    )


def _histories(record: FlightRecord, velocities: tuple[str, ...], stretches: Intervals) -> list[TimeHistory]:
    """Stretches without gaps on one clock."""
    found: list[TimeHistory] = []
    for start_s, stop_s in stretches:
        if stop_s - start_s >= _LEAST_S:
            channels = (*velocities, *ATTITUDE, *ACCELERATIONS)
            clock = resample(record, channels=channels, start_s=start_s, stop_s=stop_s, sample_rate_hz=_CLOCK_HZ)
            found += [history for history in clock.histories if history.duration_s >= _LEAST_S]
    return found


def _lags(
    histories: Sequence[TimeHistory], velocities: tuple[str, ...], high_hz: float, start_s: float, where: str
) -> tuple[Lag, ...]:
    """Lag of each axis; velocities in body axes are turned by the attitude of the start before."""
    turned = [_over_earth(history, velocities, high_hz, start_s) for history in histories]
    return tuple(
        lag_curve(
            (_part(*(rows[axis] for rows in motion)) for motion in turned),
            step_s=1.0 / _CLOCK_HZ,
            longest_s=_LONGEST_S,
            where=where,
        ).lag()
        for axis in range(len(_AXES))
    )


def _over_earth(
    history: TimeHistory, velocities: tuple[str, ...], high_hz: float, start_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Acceleration, change of velocity and velocity over the earth in the band, each of shape ``(3, samples)``."""
    from scipy.signal import butter, sosfiltfilt

    attitude, force, velocity = (
        np.stack([history[name] for name in names]) for names in (ATTITUDE, ACCELERATIONS, velocities)
    )
    if velocities == VELOCITIES:
        time_s = history.time_s
        then = np.stack([np.interp(time_s - start_s, time_s, np.unwrap(angle)) for angle in attitude])
        velocity = body_to_earth(then, velocity)
    rows = (body_to_earth(attitude, force), derivative(velocity, _CLOCK_HZ), velocity)
    band = butter(2, (_BAND_HZ[0], high_hz), "bandpass", fs=_CLOCK_HZ, output="sos")
    acceleration, change, velocity = (np.asarray(sosfiltfilt(band, row, axis=1)) for row in rows)
    return acceleration, change, velocity


def _part(acceleration: FloatArray, change: FloatArray, velocity: FloatArray) -> LagPart:
    block = np.arange(change.size) // round(_BLOCK_S * _CLOCK_HZ)
    return LagPart(acceleration, change, velocity, block, np.ones(change.size, dtype=np.bool_))
