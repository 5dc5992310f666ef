r"""Drag and wind of an ordinary flight: regression of the specific force on velocity, with tilt as the instrument.

The accelerometers along the body measure no gravity, so in flight they show the drag of rotors and body. With the
velocity :math:`v` over ground in body axes, the wind :math:`W` and the rotation :math:`R` from body to earth,

.. math::

    y = -(a_x, a_y) = (d\sqrt n + c\,|v_a|)\, v_a - h\,(\dot q + p r,\; q r - \dot p) + b,
    \qquad v_a = v - R^T (W_N, W_E, 0)^T, \quad n = -a_z / g

axis by axis (x and y), with the drag d and c over mass, the place h of the accelerometer along z from the center of
gravity, and its bias b. A rotor of speed :math:`\Omega` drags with :math:`k_d\,\Omega\,v_a`, and all carry the load
factor n, :math:`m g n = \sum k_T \Omega^2`. So :math:`\Omega = \Omega_1 \sqrt n`, and d is drag at one g,
:math:`\sum k_d\,\Omega_1 / m`. (Inflow moves :math:`\Omega` as well, but not with n: logged speeds follow
:math:`\sqrt n` with a slope of 0.89 to 1.02.) What grows with the airspeed is drag of the body, whatever the load. So
drag in proportion to the airspeed is assumed to be that of rotors; where it is of the body, as in simulators, d is too
small by the mean of :math:`\sqrt n`, which is nothing near one g. Where :math:`a_z` is not logged, n is one.

Least squares of logged velocities is low by up to half, because their error is as large as the motion in a hover. The
error of the velocity is not that of the tilt: :math:`z`, the horizontal acceleration of thrust that carries the weight,
over the earth behind a lag and turned into the body, moves with the velocity and replaces it; with the load, both
times :math:`\sqrt n`,

.. math:: \hat d = (z \cdot y) / (z \cdot v)

The lag is the one of 0.5 to 6 s with which z follows v best, about mass over drag: with another one, the instrument of
a vehicle that turns at speed points elsewhere.
The specific force is the accelerometer's own, never the acceleration that follows from the attitude, so that an error
of the attitude enters z alone. The place belongs in the regression: without it, a log whose sensor sits 4.5 cm
above the center of gravity showed 0.19 to 0.32 1/s, by the fastest motion that counted.

Only motion between 0.1 and 1 Hz counts for the drag: below, wind and the estimator's velocity drift, and a vehicle that
holds its speed leans against gusts; above, vibration and flapping. The wind follows from what is left at all lower
frequencies. A bias turns with the body and the wind does not, but of a flight at one heading the two are one number:
the bias then has a standard deviation of 0.2 m/s², which is an accelerometer mounted 1.2° off the plane of the rotors.
Where a wind without any bias is another one beyond chance, the difference is part of the error.

The regression is on the cosine coefficients of each stretch, of which the errors are independent in steady weather. Its
standard errors are White's with the residuals over one minus their leverage (HC3), as wide as Student's t of the
coefficients that count. Where something else than drag moves with the tilt, bands from 0.05 Hz or to 0.5 Hz show
another drag, and the larger difference beyond chance is part of the error. So is that of instruments of half and of
twice the lag, which differ where a vehicle that holds its speed leans against gusts, and not where the velocity is
wrong. A share of 1.5 % is added to drag, its spread between flights of one vehicle. Gusts last, so the error of the
wind is that of the slowest cosines (:mod:`rotorid.uncertainty.long_run`).

Other rooms: ``drag.linear`` and ``drag.quadratic`` follow the velocity that tilts cause, in one wind, from maneuvers;
``X_u`` and ``Y_v`` of ``hover.*`` (``two_step_force`` too) are this drag for small motion about hover, from sweeps;
:mod:`rotorid.flights.steady_wind` needs the force of the wind and not its speed; and
:mod:`rotorid.flying.flight_air` takes the drag of a known vehicle to find the wind. Of an ordinary flight this is the
only answer.

Fails where an autopilot controls speed or position in gusts and the flight hardly moves otherwise: there, the tilt
follows the wind. Where that goes unnoticed, the drag is too large by up to half (docs/accuracy.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import TWO_SIDED_95, Quantity, with_error, with_half
from rotorid.data.record import FlightRecord, Intervals
from rotorid.errors import InsufficientDataError
from rotorid.flights.braking import HIGH_HZ, LOW_HZ, Stretch, stretches_of, velocities_of
from rotorid.models.flight import ALONG_BODY_BIAS_M_S2
from rotorid.typing import FloatArray
from rotorid.uncertainty.long_run import cosines, long_run, student
from rotorid.units import STANDARD_GRAVITY_M_S2

_LAGS_S = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Lags of the instrument that are tried: mass over drag of vehicles."""

LEAST_SPEED_M_S, _LEAST_CORRELATION = 0.2, 0.7
"""Motion in the band, rms, and its correlation with the instrument."""

_FEWEST_S = 20.0
"""Length of all stretches."""

_WORST = 0.25
"""Standard deviation over drag from which there is none."""

_SCATTER = 0.015
"""Standard deviation of rotor drag between flights of one vehicle, as a share: assumed for one flight."""

_WORTH_SAYING_M_S = 0.5
"""A wind that a bias moves by less is not remarked on."""

_NO_BIAS_M_S2 = 1e-4
"""Standard deviation of an accelerometer's bias that counts as none."""

_MOST_LEVERAGE = 0.7
"""Of one coefficient on an estimate, above which its residual shows no more of its error."""

_FACTOR = 3.0
"""Ratio of fast to slow airspeed along the axes from which drag that grows with the square is asked for."""

_ROUNDS = 6
"""Of drag and wind in turn, each by the other."""

TOP_SPEED_TILT_RAD = math.radians(30.0)
"""Tilt of the top speed that a drag is shown by."""


@dataclass(frozen=True, kw_only=True)
class TiltDrag(Immutable):
    r"""Drag over mass of a vehicle, and the wind that it met.

    Parameters
    ----------
    drag
        In proportion to the airspeed at one g, in 1/s, by the instrument: the mean slope over the airspeeds that were
        flown.
    plain
        The same by least squares of the logged velocity.
    at_rest, quadratic
        The parts d in 1/s and c in 1/m of a drag :math:`(d \sqrt n + c |v_a|) v_a` along each axis; ``None`` where the
        airspeed varies too little to show both.
    wind_north, wind_east
        Where the air moves, m/s, of the longest flight; ``None`` where the heading is not logged.
    height
        Place of the accelerometer along z (down) from the center of gravity, m.
    airspeed_m_s
        5 and 95 % quantiles of the horizontal airspeed.
    correlation
        Of velocity and instrument in the band.
    speed_m_s
        Horizontal motion in the band, rms.
    seconds
        Flight that counts.
    velocity_source
        Source of the velocity in the log, or its channel.
    difference_std
        Standard deviation of the difference of ``plain`` and ``drag``, which share their noise.
    wind_by_bias_m_s
        How far beyond chance the wind is another one where the accelerometer counts as without bias; zero where it is
        not.
    """

    drag: Quantity
    plain: Quantity
    at_rest: Quantity | None
    quadratic: Quantity | None
    wind_north: Quantity | None
    wind_east: Quantity | None
    height: Quantity
    airspeed_m_s: tuple[float, float]
    correlation: float
    speed_m_s: float
    seconds: float
    velocity_source: str
    difference_std: float
    wind_by_bias_m_s: float = 0.0

    @property
    def difference(self) -> Quantity:
        """How much larger ``drag`` is than ``plain``, with random errors alone: the noise that they share drops out."""
        std = math.hypot(self.difference_std, math.sqrt(2.0) * _SCATTER * self.drag.value)
        return _quantity(self.drag.value - self.plain.value, std, "1/s")

    @property
    def agrees(self) -> bool:
        """Whether the difference of both ways is within chance, or within the standard deviation of one of them."""
        most = max(TWO_SIDED_95 * self.difference.std, self.drag.std, self.plain.std)
        return abs(self.difference.value) <= most

    def top_speed(self, tilt_rad: float = TOP_SPEED_TILT_RAD) -> Quantity:
        r"""Airspeed of level flight at a tilt, m/s.

        Drag along the body balances gravity, :math:`(d + c\,V\cos\vartheta)\,V\cos\vartheta = g \sin\vartheta`. Where
        the flight does not show c for sure, :func:`top_speed` says what it may be.
        """
        if self.quadratic is None or self.at_rest is None or self.quadratic.lower <= 0.0:
            return top_speed(self.drag, self.airspeed_m_s[1], tilt_rad)
        d, c = self.at_rest, self.quadratic
        value = _level_speed(d.value, c.value, tilt_rad)
        # Far beyond the speeds that were flown the square counts, whatever the two share of their errors.
        upper, lower = _level_speed(d.value, c.lower, tilt_rad), _level_speed(d.value, c.upper, tilt_rad)
        return Quantity(value=value, std=(upper - lower) / (2.0 * TWO_SIDED_95), lower=lower, upper=upper, unit="m/s")

    def findings(self, where: str = "flight.drag") -> tuple[Finding, ...]:
        """That both ways disagree, and that wind and bias are not separated, where that is so."""
        return (*self._ways(where), *self._unseparated())

    def _unseparated(self) -> tuple[Finding, ...]:
        if self.wind_by_bias_m_s < _WORTH_SAYING_M_S:
            return ()
        message = (
            "Wind and accelerometer bias are not separated: without a bias, the wind would be another one by "
            f"{self.wind_by_bias_m_s:.1f} m/s. Its interval contains both. Turn once while hovering."
        )
        return (warn("wind_or_bias", "flight.wind", message, difference_m_s=self.wind_by_bias_m_s),)

    def _ways(self, where: str) -> tuple[Finding, ...]:
        if self.agrees:
            return ()
        drag, plain, apart = (
            with_half(found.value, found.lower, found.upper, found.unit)
            for found in (self.drag, self.plain, self.difference)
        )
        message = (
            f"Drag is {drag} with the tilt as instrument and {plain} by plain regression on {self.velocity_source}. "
            f"The difference is {apart}, because noise that both share drops out. Errors of that velocity make the "
            "second too small; gusts that the vehicle leans against make the first too large. The first one counts."
        )
        return (warn("both_ways_disagree", where, message, drag_1_s=self.drag.value, plain_1_s=self.plain.value),)


def top_speed(drag: Quantity, flown_m_s: float, tilt_rad: float = TOP_SPEED_TILT_RAD) -> Quantity:
    r"""Airspeed of level flight at a tilt by a drag over mass that is known up to some airspeed, m/s.

    In proportion to the airspeed, :math:`V = g \tan\vartheta / d`. Beyond what was flown drag may grow with the square:
    the lower end is that of one that is all square and as large at the airspeed flown, :math:`c = d / v`.

    Parameters
    ----------
    drag
        1/s.
    flown_m_s
        The airspeed up to which it is known.
    tilt_rad
        Of the flight.

    Examples
    --------
    >>> found = top_speed(Quantity.normal(0.3, 0.01, "1/s"), 4.0)
    >>> round(found.value, 1), round(found.lower, 1), round(found.upper, 1)
    (18.9, 9.0, 20.2)
    """
    value, lower, upper = (_level_speed(slope, 0.0, tilt_rad) for slope in (drag.value, drag.upper, drag.lower))
    if lower > flown_m_s > 0.0:
        lower = _level_speed(0.0, drag.upper / flown_m_s, tilt_rad)
    return Quantity(value=value, std=(upper - lower) / (2.0 * TWO_SIDED_95), lower=lower, upper=upper, unit="m/s")


def _level_speed(d: float, c: float, tilt_rad: float) -> float:
    """Airspeed at which drag :math:`(d + c v) v` along the body holds gravity, m/s."""
    force, along = STANDARD_GRAVITY_M_S2 * math.sin(tilt_rad), math.cos(tilt_rad)
    if c == 0.0:
        return force / (along * d)
    return (math.sqrt(d * d + 4.0 * c * force) - d) / (2.0 * c * along)


def tilt_drag(record: FlightRecord, stretches: Intervals) -> TiltDrag:
    """Drag and wind that an ordinary flight shows.

    Parameters
    ----------
    record
        With ``ax ay phi theta``, and ``u v`` or ``velocity_north velocity_east psi``; with ``az``, the load counts.
    stretches
        When it flew; 3 s at both ends of each are left out.

    Raises
    ------
    InsufficientDataError
        A channel is missing, the flight is too short, the vehicle hardly moved, its velocity does not follow its tilt,
        or the error is more than a quarter of the drag.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 90.0, 0.04)
    >>> u = np.sin(1.2 * time_s) + np.cos(0.7 * time_s)
    >>> u_dot = 1.2 * np.cos(1.2 * time_s) - 0.7 * np.sin(0.7 * time_s)
    >>> theta = -np.arcsin((u_dot + 0.3 * u) / 9.80665)
    >>> rows = {"ax": -0.3 * u, "ay": 0.0 * u, "phi": 0.0 * u, "theta": theta, "psi": 0.0 * u, "u": u, "v": 0.0 * u}
    >>> channels = tuple(Channel(name=name, unit="") for name in rows)
    >>> topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
    >>> found = tilt_drag(FlightRecord(source=Source(name="a", format="CSV", sha256=""), topics=(topic,)), ((0., 90.),))
    >>> round(found.drag.value, 2), round(found.top_speed().value, 1)
    (0.3, 18.9)
    """
    return tilt_drag_of(((record, stretches),))


def tilt_drag_of(logs: Sequence[tuple[FlightRecord, Intervals]]) -> TiltDrag:
    """The same of several logs of one vehicle, each with its own wind and the weight of its own noise.

    Raises
    ------
    InsufficientDataError
        As :func:`tilt_drag`.
    """
    name = logs[0][0].source.name
    by_log = [stretches_of(record, intervals) for record, intervals in logs]
    seconds = sum(stretch.seconds for log in by_log for stretch in log)
    if seconds < _FEWEST_S:
        raise InsufficientDataError(
            f"{name} contains {seconds:.0f} s in the air without gaps",
            needed=f"{_FEWEST_S:.0f} s, to measure drag",
            remedy=_FLY,
        )
    by_log = _with_best_lag(by_log)
    solved = _Solved.of(by_log)
    _require_motion(name, solved)
    drag = _quantity(solved.value[0], math.hypot(solved.std, _SCATTER * solved.value[0]), "1/s")
    if not 0.0 < drag.std < _WORST * solved.value[0]:
        raise InsufficientDataError(
            f"{name} shows a drag of {with_error(drag.value, drag.std)} 1/s",
            needed=f"an error below {100.0 * _WORST:.0f} % of the drag",
            remedy=_FLY,
        )
    winds = [_wind(log, solved.value[0], 0.0) for log in by_log]
    parts = _with_square(by_log, solved, [wind.mean for wind in winds])
    if parts is not None and parts.grows:
        winds = [_wind(log, parts.at_rest.value, parts.quadratic.value) for log in by_log]
    longest = max(range(len(by_log)), key=lambda place: sum(stretch.seconds for stretch in by_log[place]))
    (north, east), by_bias_m_s = _wind_quantities(by_log[longest], winds[longest], solved, parts)
    record = logs[longest][0]
    channel = velocities_of(record)[0]
    source = next(record.holding(channel))
    return TiltDrag(
        drag=drag,
        plain=_quantity(solved.plain, solved.plain_std, "1/s"),
        at_rest=None if parts is None else parts.at_rest,
        quadratic=None if parts is None else parts.quadratic,
        wind_north=north,
        wind_east=east,
        height=_quantity(solved.value[1], solved.height_std, "m"),
        airspeed_m_s=_airspeeds(by_log, [wind.mean for wind in winds]),
        correlation=solved.correlation,
        speed_m_s=solved.speed_m_s,
        seconds=seconds,
        velocity_source=source[0].channels[source[1]].source or channel,
        difference_std=solved.difference_std,
        wind_by_bias_m_s=by_bias_m_s,
    )


_FLY = "fly back and forth and to both sides for 60 s, at 1 m/s and more"


def _require_motion(name: str, solved: _Solved) -> None:
    """Refuse a flight that hardly moved, or whose velocity does not follow its tilt."""
    if solved.speed_m_s < LEAST_SPEED_M_S:
        raise InsufficientDataError(
            f"the horizontal motion of {name} is {solved.speed_m_s:.2g} m/s rms",
            needed=f"{LEAST_SPEED_M_S:g} m/s, to measure drag",
            remedy=_FLY,
        )
    if not solved.correlation >= _LEAST_CORRELATION:
        raise InsufficientDataError(
            f"the velocity in {name} follows the tilt with a correlation of {solved.correlation:.2f}",
            needed=f"{_LEAST_CORRELATION:g}, to measure drag",
            remedy=f"{_FLY}, in calm air",
        )


def _quantity(value: float, std: float, unit: str) -> Quantity:
    return Quantity.normal(float(value), float(std), unit)


def _with_best_lag(by_log: Sequence[Sequence[Stretch]]) -> list[list[Stretch]]:
    """The stretches with the lag behind which the tilt follows the velocity best."""
    velocity = np.concatenate([stretch.in_band(stretch.velocity).ravel() for log in by_log for stretch in log])

    def follows(lag_s: float) -> float:
        tilts = [stretch.in_band(stretch.behind(lag_s)).ravel() for log in by_log for stretch in log]
        return _correlation(velocity, np.concatenate(tilts))

    best_s = max(_LAGS_S, key=follows)
    return [[replace(stretch, lag_s=best_s) for stretch in log] for log in by_log]


def _correlation(velocity: FloatArray, tilt: FloatArray) -> float:
    """Of velocity and instrument in the band; zero where one does not move."""
    size = math.sqrt(float(velocity @ velocity) * float(tilt @ tilt))
    return float(velocity @ tilt) / size if size > 0.0 else 0.0


def _std(moved: FloatArray) -> float:
    """Standard deviation by what each coefficient moves an estimate by, as wide as Student's.

    Of normal errors the fourth power is three times the squared variance, hence the degrees of freedom.
    """
    squares = moved.ravel() ** 2
    total = float(squares.sum())
    if not total > 0.0:
        return 0.0
    return math.sqrt(total) * student(max(3.0 * total**2 / float(squares @ squares), 2.0))


@dataclass(frozen=True)
class _Solved:
    """Both regressions of all logs: drag and height by the instrument, drag by least squares, and their errors."""

    value: FloatArray
    std: float
    systematic: float
    height_std: float
    plain: float
    plain_std: float
    difference_std: float
    correlation: float
    speed_m_s: float
    weights: tuple[float, ...]

    @classmethod
    def of(cls, by_log: Sequence[Sequence[Stretch]]) -> _Solved:
        weights = [1.0] * len(by_log)
        # Second, each log by the noise that the first fit left of it.
        for _ in range(1 if len(by_log) == 1 else 2):
            braking, columns, by_tilt = _together(by_log, weights)
            found, moved = _fitted(braking, columns, by_tilt)
            weights = [
                1.0 / math.sqrt(float(np.mean([np.mean(_left(s.linear, found) ** 2) for s in log]))) if log else 0.0
                for log in by_log
            ]
        plain, plain_moved = _fitted(braking, columns, columns)
        # Gusts that the vehicle leans against are slow; what turns with the tilt, as flapping, is fast.
        wide, slow = (0.5 * LOW_HZ, HIGH_HZ), (LOW_HZ, 0.5 * HIGH_HZ)
        others = [_fitted(*_together(by_log, weights, band)) for band in (wide, slow)]
        of_band = max(
            _beyond_chance(other[0] - found[0], abs(_std(shown[0]) ** 2 - _std(moved[0]) ** 2))
            for other, shown in others
        )
        # A tilt that answers the wind is correlated with it by another lag than with the velocity.
        early, late = (_fitted(*_together(_lagging(by_log, factor), weights)) for factor in (0.5, 2.0))
        of_lag = _beyond_chance(late[0][0] - early[0][0], _std(late[1][0] - early[1][0]) ** 2)
        systematic = math.hypot(of_band, of_lag)
        stretches = [stretch for log in by_log for stretch in log]
        motion = sum(float(np.sum(stretch.in_band(stretch.velocity, wide) ** 2)) for stretch in stretches)
        return cls(
            value=found,
            std=math.hypot(_std(moved[0]), systematic),
            systematic=systematic,
            height_std=_std(moved[1]),
            plain=float(plain[0]),
            plain_std=_std(plain_moved[0]),
            difference_std=_std(moved[0] - plain_moved[0]),
            correlation=_correlation(columns[0].ravel(), by_tilt[0].ravel()),
            speed_m_s=math.sqrt(motion / sum(stretch.seconds for stretch in stretches)),
            weights=tuple(weights),
        )


def _beyond_chance(difference: float, variance: float) -> float:
    """What random errors leave of a difference of two estimates.

    Where one has most of the data of the other, the variance of their difference is the difference of their variances
    (Hausman, "Specification tests in econometrics", 1978).
    """
    return math.sqrt(max(float(difference) ** 2 - variance, 0.0))


def _lagging(by_log: Sequence[Sequence[Stretch]], factor: float) -> list[list[Stretch]]:
    """The stretches with another lag of the instrument."""
    return [[replace(stretch, lag_s=factor * stretch.lag_s) for stretch in log] for log in by_log]


def _left(linear: FloatArray, found: FloatArray) -> FloatArray:
    braking, velocity, lever, _ = linear
    return np.asarray(braking - found[0] * velocity - found[1] * lever)


def _together(
    by_log: Sequence[Sequence[Stretch]], weights: Sequence[float], band_hz: tuple[float, float] | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Braking, columns and instruments of all logs, each by its weight."""
    rows = [
        weight * (stretch.linear if band_hz is None else stretch.part(*band_hz))
        for log, weight in zip(by_log, weights, strict=True)
        for stretch in log
    ]
    braking, velocity, lever, tilt = np.concatenate(rows, axis=-1)
    return braking, np.stack([velocity, lever]), np.stack([tilt, lever])


def _fitted(braking: FloatArray, columns: FloatArray, instruments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Estimates, and what the error of each coefficient moves them by, shape ``(estimates, 2, k)``.

    Columns and instruments have the shape ``(estimates, 2, k)``.
    """
    crossed = np.einsum("ian,jan->ij", instruments, columns)
    pulled = np.einsum("ij,jan->ian", np.linalg.pinv(crossed, rcond=1e-12), instruments)
    found = np.einsum("ian,an->i", pulled, braking)
    left = braking - np.einsum("i,ian->an", found, columns)
    leverage = np.clip(np.einsum("ian,ian->an", pulled, columns), 0.0, _MOST_LEVERAGE)
    return found, np.asarray(pulled * left / (1.0 - leverage))


@dataclass(frozen=True)
class _Wind:
    """Wind and bias of a log with their covariance: north, east, forward, right."""

    value: FloatArray
    covariance: FloatArray
    wider: float

    @property
    def mean(self) -> FloatArray:
        return self.value[:2]


def _wind(log: Sequence[Stretch], at_rest: float, square: float, bias_m_s2: float = ALONG_BODY_BIAS_M_S2) -> _Wind:
    """Wind by what braking leaves at all frequencies, with the bias as a number that is known to some m/s²."""
    found, known = np.zeros(4), np.diag([0.0, 0.0, bias_m_s2**-2, bias_m_s2**-2])
    seconds = sum(stretch.seconds for stretch in log)
    for _ in range(_ROUNDS if square else 1):
        left, slopes = _wind_columns(log, found, at_rest, square)
        # Without the bias first, for the size of what lasts.
        first = np.linalg.lstsq(slopes[:2].reshape(2, -1).T, left.ravel(), rcond=None)[0]
        rest = left - np.einsum("k,kan->an", first, slopes[:2])
        size = rest.shape[1]
        lasting = float(np.trace(long_run(rest, seconds)[0])) / (2.0 * size)
        lasting = max(lasting, 1e-6)
        information = np.einsum("kan,lan->kl", slopes, slopes) / lasting + known
        inverse = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
        # The bias is about zero, whatever the last round found.
        step = inverse @ (np.einsum("kan,an->k", slopes, left) / lasting - known @ found)
        found = found + step
    left = left - np.einsum("k,kan->an", step, slopes)
    scores = np.einsum("kan,an->kn", slopes, left) / lasting
    covariance, wider = long_run(scores, seconds)
    # As far as the flight shows the bias, it takes from what lasts, which then looks smaller than it is.
    taken = 2.0 - float(np.sum(np.diag(inverse @ known)))
    slowest = 2.0 * cosines(seconds)
    # What is known of the bias counts as one more observation.
    total = inverse @ (covariance * slowest / (slowest - taken) + known) @ inverse
    return _Wind(found, np.asarray(total), wider)


def _wind_columns(
    log: Sequence[Stretch], found: FloatArray, at_rest: float, square: float
) -> tuple[FloatArray, FloatArray]:
    """What braking leaves, and its slopes by wind and bias, shapes ``(2, n)`` and ``(4, 2, n)``."""
    left, slopes = [], []
    for stretch in log:
        air = stretch.airspeed(found[:2])
        size = air.shape[1]
        bias = np.stack([np.stack([np.ones(size), np.zeros(size)]), np.stack([np.zeros(size), np.ones(size)])])
        rotors, body = at_rest * stretch.faster, square * np.abs(air)
        slope = rotors + 2.0 * body
        rest = stretch.braking - (rotors + body) * air - np.einsum("k,kan->an", found[2:], bias)
        left.append(stretch.thinned(rest))
        slopes.append(stretch.thinned(np.stack([-slope * stretch.north, -slope * stretch.east, *bias])))
    return np.concatenate(left, axis=-1), np.concatenate(slopes, axis=-1)


@dataclass(frozen=True)
class _Parts:
    """Drag at rest and by the square."""

    at_rest: Quantity
    quadratic: Quantity

    @property
    def grows(self) -> bool:
        """Whether the slope grows with the airspeed for sure, so that wind and top speed count with it."""
        return self.quadratic.lower > 0.0


def _with_square(by_log: Sequence[Sequence[Stretch]], solved: _Solved, winds: Sequence[FloatArray]) -> _Parts | None:
    """Drag at rest and by the square of the airspeed along each axis; ``None`` where the airspeed varies too little."""
    speeds = np.concatenate(
        [np.abs(s.airspeed(wind)).ravel() for log, wind in zip(by_log, winds, strict=True) for s in log]
    )
    slow, fast = np.percentile(speeds, [5, 95])
    if not all(stretch.heading_known for log in by_log for stretch in log) or fast < _FACTOR * slow:
        return None
    values = np.array([solved.value[0], 0.0])
    for _ in range(_ROUNDS):
        values, moved = _square_fit(by_log, solved, winds)
        if not (values[0] > 0.0 and values[0] + values[1] * fast > 0.0):
            return None
        winds = [_wind(log, values[0], values[1]).mean for log in by_log]
    stds = np.array([math.hypot(_std(moved[0]), solved.systematic), _std(moved[1])])
    for place, log in enumerate(by_log):
        found = _wind(log, values[0], values[1])
        for axis in range(2):
            # What the error of the wind moves both by.
            others = [wind.copy() for wind in winds]
            others[place][axis] += math.sqrt(found.covariance[axis, axis])
            stds = np.hypot(stds, _square_fit(by_log, solved, others)[0][:2] - values[:2])
    stds = np.hypot(stds, _SCATTER * np.abs(values[:2]))
    # A square that is known no better than the drag itself at full speed shows nothing.
    if stds[1] * fast > _WORST * solved.value[0]:
        return None
    return _Parts(_quantity(values[0], stds[0], "1/s"), _quantity(values[1], stds[1], "1/m"))


def _square_fit(
    by_log: Sequence[Sequence[Stretch]], solved: _Solved, winds: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Drag at rest, by the square, height, and what each coefficient moves them by, at some winds."""
    braking, columns, instruments = [], [], []
    for log, wind, weight in zip(by_log, winds, solved.weights, strict=True):
        for stretch in log:
            moved, tilt = stretch.in_band(stretch.velocity), stretch.in_band(stretch.tilt)
            gain = float(np.sum(moved * tilt)) / float(np.sum(tilt * tilt))
            # In the band as the tilt makes it; slower, as it was logged.
            made = stretch.velocity + stretch.only_band(gain * stretch.tilt - stretch.velocity)
            air, predicted = stretch.airspeed(wind), stretch.airspeed(wind, made)
            rows = stretch.in_band(np.stack([np.abs(air) * air, np.abs(predicted) * predicted]))
            measured, velocity, lever, by_tilt = stretch.linear
            braking.append(weight * measured)
            columns.append(weight * np.stack([velocity, rows[0], lever]))
            instruments.append(weight * np.stack([by_tilt, rows[1], lever]))
    return _fitted(*(np.concatenate(part, axis=-1) for part in (braking, columns, instruments)))


def _wind_quantities(
    log: Sequence[Stretch], wind: _Wind, solved: _Solved, parts: _Parts | None
) -> tuple[tuple[Quantity | None, Quantity | None], float]:
    """Wind to north and east with the errors of what is left, of the bias, and of the drag; by how much the bias."""
    if not all(stretch.heading_known for stretch in log):
        return (None, None), 0.0
    if parts is None or not parts.grows:
        drag, square = float(solved.value[0]), 0.0
        others = [_wind(log, drag + math.hypot(solved.std, _SCATTER * drag), 0.0)]
    else:
        drag, square = parts.at_rest.value, parts.quadratic.value
        others = [_wind(log, drag + parts.at_rest.std, square), _wind(log, drag, square + parts.quadratic.std)]
    random = np.diag(wind.covariance)[:2]
    stds = wind.wider * np.sqrt(random)
    # Where the turns of the flight should separate wind and bias and do not, the interval contains both.
    plain = _wind(log, drag, square, bias_m_s2=_NO_BIAS_M_S2)
    chance = np.abs(random - np.diag(plain.covariance)[:2]).tolist()
    differences = (plain.mean - wind.mean).tolist()
    by_bias = [_beyond_chance(*pair) for pair in zip(differences, chance, strict=True)]
    stds = np.hypot(stds, by_bias)
    for other in others:
        stds = np.hypot(stds, other.mean - wind.mean)
    north, east = (_quantity(value, std, "m/s") for value, std in zip(wind.mean, stds, strict=True))
    return (north, east), math.hypot(*by_bias)


def _airspeeds(by_log: Sequence[Sequence[Stretch]], winds: Sequence[FloatArray]) -> tuple[float, float]:
    """5 and 95 % quantiles of the horizontal airspeed."""
    speeds = np.concatenate([np.hypot(*s.airspeed(wind)) for log, wind in zip(by_log, winds, strict=True) for s in log])
    slow, fast = np.percentile(speeds, [5, 95]).tolist()
    return slow, fast
