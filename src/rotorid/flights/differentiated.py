r"""Rates and specific force out of angles and height, for logs that hold no gyros and no accelerometer.

.. math::

    p = \dot\phi - \dot\psi \sin\theta, \qquad
    q = \dot\theta \cos\phi + \dot\psi \sin\phi \cos\theta, \qquad
    r = -\dot\theta \sin\phi + \dot\psi \cos\phi \cos\theta, \qquad
    a_z = (\ddot z_{down} - g) / (\cos\phi \cos\theta)

as in a paper that identifies inertias from angles and a barometer, but not for small angles alone. Derivatives are
those of the cubic spline through the samples. The price is noise: an error of a sample of a signal that is
differentiated twice grows with the square of the frequency,

.. math:: \sigma_a = \sigma \sqrt{\tfrac{2}{f_s} \int_0^{f_s/2} |H(f)|^2 (2 f_s \sin(\pi f/f_s))^4 \, df}

behind the low-pass H of the fit, or :math:`\sqrt 6 f_s^2 \sigma` for second differences without one. It is stated for
each log (``differentiated``). What differentiation cannot undo: angles of an estimator that are smoothed or late.
Velocities are derivatives of positions in the same way.

The vertical force assumes that the vehicle pushes along its own z axis and drag along x and y is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.record import Channel, FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.fitting.motors.excitation import SLOW_HZ
from rotorid.frames import rates_from_attitude
from rotorid.signal.clock import rises
from rotorid.signal.kinematics import EARTH_VELOCITIES, VELOCITIES
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

HEIGHT = "down"
POSITIONS = ("north", "east", HEIGHT)

_LEAST_ANGLE_HZ = 5.0 * SLOW_HZ
"""Least rate of angles that are differentiated twice."""

_LEAST_HEIGHT_HZ = SLOW_HZ
"""Least rate of a height that is."""

_LEAST_POSITION_HZ = 2.0 * SLOW_HZ
"""Least rate of positions that are."""

_FEWEST = 16
"""Least number of samples that are."""

_LEVEL = 0.2
"""Least cosine of the tilt by which a vertical force is divided."""


def from_angles(record: FlightRecord, outputs: Sequence[str] = ()) -> tuple[FlightRecord, tuple[Finding, ...]]:
    """A record whose rates, specific force or both are derivatives, and what that costs.

    Parameters
    ----------
    record
        The log; one that holds gyros and accelerometer stays as it is.
    outputs
        Channels to differentiate although gyros and accelerometer were logged: angles, ``down`` or both.

    Raises
    ------
    InsufficientDataError
        Angles or height are missing where gyros or accelerometer are, or were logged too slowly.
    """
    logged = set(record.channel_names)
    of_angles = bool(set(outputs) & set(ATTITUDE)) or not set(RATES) <= logged
    of_height = HEIGHT in outputs or "az" not in logged
    if not (of_angles or of_height):
        return record, ()
    angles = _samples(record, ATTITUDE, least_hz=_LEAST_ANGLE_HZ if of_angles else 0.0)
    topics: list[Topic] = []
    findings: list[Finding] = []
    if of_angles:
        rates, finding = _rates(record, angles)
        topics.append(rates)
        findings.append(finding)
    if of_height:
        force, finding = _force(record, angles, _samples(record, (HEIGHT,), least_hz=_LEAST_HEIGHT_HZ))
        topics.append(force)
        findings.append(finding)
    return replace(record, topics=(*topics, *record.topics)), tuple(findings)


def with_velocities(record: FlightRecord, outputs: Sequence[str] = ()) -> tuple[FlightRecord, tuple[Finding, ...]]:
    """A record whose velocities are derivatives of its positions, and what that costs.

    Parameters
    ----------
    record
        The log; one that holds velocities stays as it is, and so does one without positions at 10 Hz and more.
    outputs
        Channels to differentiate although velocities were logged: ``north``, ``east`` or both.

    Raises
    ------
    InsufficientDataError
        Positions are asked for and missing, or were logged too slowly.
    """
    wanted, logged = bool(set(outputs) & set(POSITIONS[:2])), set(record.channel_names)
    if not wanted and (set(EARTH_VELOCITIES) <= logged or set(VELOCITIES) <= logged):
        return record, ()
    try:
        positions = _samples(record, POSITIONS, least_hz=_LEAST_POSITION_HZ)
    except InsufficientDataError:
        if wanted:
            raise
        return record, ()
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(positions.time_s, positions.values, axis=1)
    topic = Topic(
        name=f"{positions.topic}, differentiated",
        time_s=positions.time_s,
        channels=tuple(Channel(name=name, unit="m/s") for name in EARTH_VELOCITIES),
        values=spline(positions.time_s, 1),
    )
    across = positions._replace(names=POSITIONS[:2])
    accelerations = spline(positions.time_s, 2)[:2]
    words = "the velocities"
    finding = _price(record, across, positions.values[:2], accelerations, words=words, unit="m")
    return replace(record, topics=(topic, *record.topics)), (finding,)


class _Samples(NamedTuple):
    """Channels of one topic on stamps that only go forward; angles without jumps."""

    names: tuple[str, ...]
    topic: str
    time_s: FloatArray
    values: FloatArray
    rate_hz: float


def _samples(record: FlightRecord, names: Sequence[str], *, least_hz: float) -> _Samples:
    whole = [topic for topic in record.topics if all(topic.row(name) is not None for name in names)]
    if not whole:
        missing = [name for name in names if name not in record.channel_names] or list(names)
        message = f"{record.source.name} contains no {' and no '.join(missing)}, so no accelerations can be derived."
        raise InsufficientDataError(
            message.rstrip("."),
            needed="gyros and accelerometer, or phi, theta, psi and down",
            remedy="log them, or name them with --map",
            findings=[refusal("missing_channel", ", ".join(missing), message)],
        )
    best = max(whole, key=lambda topic: topic.sample_rate_hz)
    rows = [row for name in names if (row := best.row(name)) is not None]
    values = best.values[rows]
    good = np.isfinite(values).all(axis=0) & np.isfinite(best.time_s)
    time_s, values = best.time_s[good], values[:, good]
    rising = rises(time_s)
    time_s, values = time_s[rising], values[:, rising]
    rate_hz = best.sample_rate_hz
    if time_s.size < _FEWEST or rate_hz < least_hz:
        message = f"{best.name} of {record.source.name} was logged at only {rate_hz:.3g} Hz."
        raise InsufficientDataError(
            message.rstrip("."),
            needed=f"{least_hz:g} Hz and more, to differentiate twice up to {SLOW_HZ:g} Hz",
            remedy="log them faster",
            findings=[refusal("rate_too_low", best.name, message, rate_hz=rate_hz, needed_hz=least_hz)],
        )
    if set(names) <= set(ATTITUDE):
        values = np.unwrap(values, axis=1)
    return _Samples(tuple(names), best.name, np.asarray(time_s), np.asarray(values), rate_hz)


def _rates(record: FlightRecord, angles: _Samples) -> tuple[Topic, Finding]:
    from scipy.interpolate import CubicSpline

    change = CubicSpline(angles.time_s, angles.values, axis=1)(angles.time_s, 1)
    rates = rates_from_attitude(angles.values, change)
    channels = tuple(Channel(name=name, unit="rad/s") for name in RATES)
    topic = Topic(name=f"{angles.topic}, differentiated", time_s=angles.time_s, channels=channels, values=rates)
    accelerations = np.gradient(rates[:2], angles.time_s, axis=1)
    return topic, _price(record, angles, angles.values[:2], accelerations, words="p, q and r", unit="rad")


def _force(record: FlightRecord, angles: _Samples, height: _Samples) -> tuple[Topic, Finding]:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(height.time_s, height.values[0])
    # On the clock of the angles, which is mostly the faster one: one slow channel would slow all others down.
    time_s = angles.time_s if angles.rate_hz > height.rate_hz else height.time_s
    time_s = time_s[(time_s >= height.time_s[0]) & (time_s <= height.time_s[-1])]
    phi, theta = (np.interp(time_s, angles.time_s, row) for row in angles.values[:2])
    upright = np.maximum(np.cos(phi) * np.cos(theta), _LEVEL)
    topic = Topic(
        name=f"{height.topic}, differentiated",
        time_s=time_s,
        channels=(Channel(name="az", unit="m/s^2"),),
        values=((spline(time_s, 2) - STANDARD_GRAVITY_M_S2) / upright)[None],
    )
    falling = spline(height.time_s, 2)
    return topic, _price(record, height, height.values, falling[None], words="az", unit="m")


def _price(
    record: FlightRecord, of: _Samples, values: FloatArray, accelerations: FloatArray, *, words: str, unit: str
) -> Finding:
    """Amplification of a sample error by differentiation, and the scatter of the samples."""
    gain, plain = noise_gain(of.rate_hz), 6.0**0.5 * of.rate_hz**2
    scatter = float(np.median(np.abs(np.diff(values, 3, axis=1)))) / (0.6745 * 20.0**0.5)
    motion = float(np.median(np.abs(_slow(accelerations, of.rate_hz)))) / 0.6745
    noise = gain * scatter
    return warn(
        "differentiated",
        f"{record.source.name}: {of.topic}",
        f"Derivatives of {listed(of.names)} at {of.rate_hz:.3g} Hz replace {words} of {record.source.name}. "
        f"Up to {SLOW_HZ:g} Hz, the accelerations contain {noise:.2g} {unit}/s^2 of noise and {motion:.2g} {unit}/s^2 "
        "in all. Smoothing or delay in the logged signals remains.",
        noise_gain_1_s2=gain,
        plain_gain_1_s2=plain,
        scatter=scatter,
        acceleration_noise=noise,
        acceleration=motion,
        rate_hz=of.rate_hz,
    )


def noise_gain(sample_rate_hz: float) -> float:
    """Standard deviation of a second derivative over that of white errors of the samples, behind the low-pass [1/s²].

    The low-pass is that of second order which the accelerations pass, with its corner at :data:`SLOW_HZ`.

    Examples
    --------
    >>> round(noise_gain(250.0)), round(6.0**0.5 * 250.0**2)
    (569, 153093)
    """
    from scipy.signal import butter, freqz

    omega = np.linspace(0.0, np.pi, 2001)
    _, passed = freqz(*butter(2, SLOW_HZ, fs=sample_rate_hz), worN=omega)
    second = (2.0 * np.sin(0.5 * omega) * sample_rate_hz) ** 4
    return float(np.sqrt(np.mean(np.abs(passed) ** 2 * second)))


def _slow(rows: FloatArray, rate_hz: float) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    if rate_hz <= 2.5 * SLOW_HZ:
        return rows
    return np.asarray(sosfiltfilt(butter(2, SLOW_HZ, fs=rate_hz, output="sos"), rows, axis=1))
