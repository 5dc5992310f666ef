r"""The thrust coefficient of the rotors from the weight balance of steady flight.

In a steady second b the rotors make the mean specific force along their axis,

.. math:: k_b \, \overline{\textstyle\sum_i \Omega_i^2} = m f_b, \qquad f_b = \overline{-a_z}, \qquad
          k = m \, \frac{\sum_b f_b}{\sum_b \overline{\sum_i \Omega_i^2}}

with measured speeds, or with outputs in place of them, at the voltage of the battery; demands of thrust count once, not
squared. No excitation is needed, and no fast log: means over a second do not depend on the rate. Without a mass the
coefficient is that over mass.

Two witnesses weigh the vehicle. The accelerometer is wrong by a bias, 0.05 m/s² where it was calibrated. A vehicle
that neither falls nor climbs faster over the seconds that count carries

.. math:: f = g \, \overline{\cos\phi \cos\theta}

up to the change of its vertical speed over the stretches, 0.3 m/s at both ends of each where that is not logged. Both
are averaged by the inverse of their variances; where they disagree, the error grows with the distance between them.

The error of the coefficient holds random errors (the scatter of ten, six and four parts of the flight, of which the
largest counts, since gusts last from one part into the next), the force, and climb:
rotors that climb thrust less, by up to 0.5 1/s of the speed over mass. The coefficient is that of the air that was
flown: wind along the disc makes it larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.errors import InsufficientDataError
from rotorid.flights.hover import WINDOW_S, steady_windows
from rotorid.signal.airborne import within
from rotorid.signal.dead_sensors import CHECK_SENSORS, shows_gravity
from rotorid.signal.motors import (
    Kind,
    MotorHistory,
    linearization_of,
    logged_outputs,
    logged_speeds,
    motor_limits,
    or_none,
    voltage_factor,
)
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

BIAS_M_S2 = 0.05
"""Standard deviation of the bias of a calibrated accelerometer."""

FEWEST_SECONDS = 6
"""Steady seconds that a coefficient needs."""

_SPEED_CHANGE_M_S = 0.3
"""Vertical speed at an end of a steady stretch, where it is not logged, rms; a tenth of it where it is."""

_CLIMB_LOSS_1_S = 0.5
"""Thrust over mass that a climb takes, by its speed, as small multirotors have it at most."""

_CLIMB_M_S = 0.15
"""Mean climb of a hover where it is not logged."""

_FASTEST_CLIMB_M_S = 1.0
"""Climb and descent up to which a second is steady."""

_STANDING = 0.3
"""Share of its median speed below which a rotor stands, or its sensor does not see it."""

_PARTS = (10, 6, 4)
"""Numbers of parts of a flight whose scatter is the random error."""

_SAG = 0.02
"""Standard deviation of thrust by outputs whose voltage is not known."""


@dataclass(frozen=True, kw_only=True)
class WeightBalance(Immutable):
    """Thrust of a rotor by the square of its speed or output, as the weight shows it.

    Parameters
    ----------
    kind
        What the motors are known by: ``speed`` in rad/s, ``output`` or ``thrust_demand`` from 0 to 1.
    coefficient
        Thrust of a rotor over the square, or over the demand, in N s²/rad² or N; per kilogram in m/rad² or m/s².
    force_m_s2
        Mean thrust of all rotors over mass.
    level
        Speed or output of a rotor that carries its share.
    seconds
        Steady seconds that count.
    source
        Topic of the motors.
    mass_kg
        The mass that was given, or ``None``.
    reference_v
        Voltage that the coefficient of an output is for; ``None`` where it does not matter or is not logged.
    """

    kind: Kind
    coefficient: Quantity
    force_m_s2: Quantity
    level: float
    seconds: int
    source: str
    mass_kg: float | None = None
    reference_v: float | None = None


def weight_balance(record: FlightRecord, flights: Intervals, *, mass_kg: float | None = None) -> WeightBalance:
    """The thrust coefficient that steady flight shows.

    Parameters
    ----------
    record
        With ``az``, and speeds or outputs of all motors.
    flights
        When it flew.
    mass_kg
        Mass in flight; without it the coefficient is per kilogram.

    Raises
    ------
    InsufficientDataError
        A channel is missing, the accelerometer shows no gravity, or fewer than six seconds are steady.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> time_s = np.arange(0.0, 40.0, 0.02)
    >>> rows = {**{f"motor_speed_{number}": np.full(time_s.size, 1500.0) for number in (1, 2, 3, 4)},
    ...         "az": np.full(time_s.size, -9.80665), "p": 0.0 * time_s, "q": 0.0 * time_s}
    >>> units = {"az": "m/s^2", "p": "rad/s", "q": "rad/s"}
    >>> channels = tuple(Channel(name=name, unit=units.get(name, "rad/s")) for name in rows)
    >>> topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
    >>> record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    >>> found = weight_balance(record, ((0.0, 40.0),), mass_kg=0.918)
    >>> float(f"{found.coefficient.value:.4g}"), found.seconds
    (1e-06, 36)
    """
    history = _motors(record)
    if "az" not in record:
        raise _missing(record, "az", "the accelerometer")
    inside = within(history.time_s, flights)
    time_s, values = history.time_s[inside], history.values[:, inside]
    strength, reference_v, sag = _strength(record, history, time_s)
    power = 1 if history.kind == "thrust_demand" else 2
    seconds = _Seconds.of(record, flights, time_s, values, np.asarray((values**power).sum(axis=0) * strength))
    count = seconds.force.size
    if count < FEWEST_SECONDS:
        raise InsufficientDataError(
            f"{record.source.name} contains {count * WINDOW_S:.0f} s of steady flight",
            needed=f"{FEWEST_SECONDS} s, to weigh the vehicle",
            remedy="hover for 20 s without touching the sticks",
        )
    if not shows_gravity(measured := float(seconds.force.mean())):
        raise InsufficientDataError(
            f"{record.source.name} shows a mean az of {0.0 - measured:.2g} m/s² in steady flight",
            needed=f"about {-STANDARD_GRAVITY_M_S2:.1f} m/s², which carries the vehicle",
            remedy=CHECK_SENSORS,
        )
    force = _force(seconds)
    ratio = force.value * count / float(seconds.squares.sum())
    random = max(_scatter(seconds, min(parts, count // 2)) for parts in _PARTS)
    climb = _CLIMB_LOSS_1_S * seconds.climb_m_s / force.value
    scale = 1.0 if mass_kg is None else mass_kg
    relative = math.sqrt(random**2 + (force.std / force.value) ** 2 + climb**2 + sag**2)
    unit = {"speed": ("m/rad^2", "N s^2/rad^2")}.get(history.kind, ("m/s^2", "N"))[mass_kg is not None]
    return WeightBalance(
        kind=history.kind,
        coefficient=Quantity.normal(scale * ratio, scale * ratio * relative, unit),
        force_m_s2=force,
        level=(float(seconds.squares.mean()) / history.motors) ** (1.0 / power),
        seconds=count,
        source=history.source,
        mass_kg=mass_kg,
        reference_v=reference_v,
    )


def _motors(record: FlightRecord) -> MotorHistory:
    """Measured speeds, or outputs."""
    found = or_none(logged_speeds, record) or or_none(logged_outputs, record)
    if found is None:
        raise _missing(record, "motor_speed_1 and motor_1", "speeds or outputs of all motors")
    return found


def _missing(record: FlightRecord, names: str, needed: str) -> InsufficientDataError:
    return InsufficientDataError(f"{record.source.name} lacks {names}", needed=needed, remedy=f"log {needed}")


def _strength(
    record: FlightRecord, history: MotorHistory, time_s: FloatArray
) -> tuple[FloatArray, float | None, float]:
    """Thrust by a square over that at the reference voltage, that voltage, and the error of what is not known."""
    one = np.ones(time_s.size)
    known = linearization_of(record) if history.kind == "thrust_demand" else None
    if history.kind == "speed" or (known is not None and known.compensates_voltage):
        return one, None, 0.0
    try:
        factor = voltage_factor(record, time_s)
    except InsufficientDataError:
        return one, None, _SAG
    return factor.values, factor.reference_v, 0.0


@dataclass(frozen=True, kw_only=True)
class _Seconds:
    """Steady seconds: mean specific force and sum of squares, shape ``(n,)``, and what is known of their motion.

    ``upright`` is the mean cosine of tilt, not a number where no attitude is logged; ``gained_m_s`` the change of the
    vertical speed upward over all of them, with its error; ``climb_m_s`` how fast they may climb on average.
    """

    force: FloatArray
    squares: FloatArray
    upright: float
    gained_m_s: float
    gained_std_m_s: float
    climb_m_s: float

    @classmethod
    def of(
        cls, record: FlightRecord, flights: Intervals, time_s: FloatArray, values: FloatArray, squares: FloatArray
    ) -> _Seconds:
        windows = steady_windows(record, flights, time_s, values, _limited(record, time_s))
        fast = _STANDING * np.median(values, axis=1, keepdims=True) if values.size else values
        az_s, az = _known(record, "az")
        rows, falling = [], []
        for window in windows:
            begin_s = float(time_s[window.start])
            force = _mean(az_s, -az, begin_s)
            speeds = _vertical_speed(record, begin_s)
            still = speeds is not None and abs(speeds.mean()) > _FASTEST_CLIMB_M_S
            if not math.isfinite(force) or still or np.any(values[:, window] < fast):
                continue
            rows.append((begin_s, force, float(squares[window].mean())))
            falling.append(speeds)
        begins, forces, sums = np.array(rows).reshape(-1, 3).T
        known = [speeds for speeds in falling if speeds is not None]
        starts = 1 + int(np.count_nonzero(np.diff(begins) > 1.5 * WINDOW_S))
        gained, std, climb = 0.0, _SPEED_CHANGE_M_S * math.sqrt(2.0 * starts), _CLIMB_M_S
        if known and len(known) == len(falling):
            together = np.stack(known)
            gained, std = float(np.sum(together[:, 0] - together[:, 1])), 0.1 * std
            climb = abs(float(together.mean()))
        return cls(
            force=forces,
            squares=sums,
            upright=_upright(record, begins),
            gained_m_s=gained,
            gained_std_m_s=std,
            climb_m_s=climb,
        )


def _limited(record: FlightRecord, time_s: FloatArray) -> BoolArray:
    """Whether a motor is at a limit at some times, by the nearest sample of the outputs."""
    limits = motor_limits(record)
    if not limits.time_s.size:
        return np.zeros(time_s.size, dtype=np.bool_)
    near = np.clip(np.searchsorted(limits.time_s, time_s), 0, limits.time_s.size - 1)
    return np.asarray(limits.limited[near], dtype=np.bool_)


def _known(record: FlightRecord, name: str) -> tuple[FloatArray, FloatArray]:
    """Stamps and finite samples of a channel; empty where it is not logged."""
    if name not in record:
        return np.zeros(0), np.zeros(0)
    track = record[name]
    kept = np.isfinite(track.values)
    return track.time_s[kept], track.values[kept]


def _mean(time_s: FloatArray, values: FloatArray, begin_s: float) -> float:
    first, last = np.searchsorted(time_s, [begin_s, begin_s + WINDOW_S]).tolist()
    return float(values[first:last].mean()) if last - first >= 3 else math.nan


def _vertical_speed(record: FlightRecord, begin_s: float) -> FloatArray | None:
    """Speed downward at both ends of a second; ``None`` where it is not logged."""
    time_s, values = _known(record, "velocity_down")
    if not time_s.size or not time_s[0] <= begin_s <= time_s[-1] - WINDOW_S:
        return None
    return np.asarray(np.interp([begin_s, begin_s + WINDOW_S], time_s, values))


def _upright(record: FlightRecord, begins: FloatArray) -> float:
    """Mean cosine of tilt over some seconds."""
    known = [_known(record, name) for name in ("phi", "theta")]
    if not begins.size or not all(stamps.size for stamps, _ in known):
        return math.nan
    at_s = (begins[:, None] + np.linspace(0.0, WINDOW_S, 10)).ravel()
    phi, theta = (np.interp(at_s, stamps, angles) for stamps, angles in known)
    return float(np.mean(np.cos(phi) * np.cos(theta)))


def _force(seconds: _Seconds) -> Quantity:
    """Mean thrust over mass: by the accelerometer, and by the weight that a steady vehicle carries."""
    measured = float(seconds.force.mean())
    if not math.isfinite(seconds.upright):
        return Quantity.normal(measured, BIAS_M_S2, "m/s^2")
    lasted_s = seconds.force.size * WINDOW_S
    carried = (STANDARD_GRAVITY_M_S2 + seconds.gained_m_s / lasted_s) * seconds.upright
    std = seconds.gained_std_m_s / lasted_s
    inverse = BIAS_M_S2**-2 + std**-2
    value = (measured * BIAS_M_S2**-2 + carried * std**-2) / inverse
    # Two witnesses that disagree are both doubted.
    doubt = max(1.0, abs(measured - carried) / math.hypot(BIAS_M_S2, std))
    return Quantity.normal(value, doubt / math.sqrt(inverse), "m/s^2")


def _scatter(seconds: _Seconds, parts: int) -> float:
    """Relative error of the mean by parts of the flight, as wide as Student's interval of 95 %."""
    from scipy.stats import t

    rows = np.array_split(np.arange(seconds.force.size), parts)
    each = np.array([seconds.force[part].sum() / seconds.squares[part].sum() for part in rows])
    student = float(t.ppf(0.975, parts - 1)) / TWO_SIDED_95
    return float(each.std(ddof=1) / each.mean()) / math.sqrt(parts) * student
