r"""How long after the motors the motion of a vehicle is stamped: the skew between the clocks of motors and gyro.

The torque of the rotors about roll and pitch is, up to a gain, :math:`x = \sum_i l_i \Omega_i^2` with the levers
:math:`l_i` of the layout (outputs in place of :math:`\Omega_i^2` where no speeds are logged). In the band in which
motors turn the vehicle, :math:`\dot\omega(t) = g\, x(t - \tau) - d\, \omega(t)`. The skew is the lag with the largest
partial correlation, what the rate :math:`\omega` explains being taken out of both sides:

.. math:: \hat\tau = \arg\max_\tau \operatorname{corr}\bigl(x(t - \tau), \dot\omega(t) \mid \omega(t)\bigr)

Without the rate, damping makes the motion seem early, and gusts that come back through the controller make it seem
late, by up to 20 ms in simulated flights. With it, what is left of both grows as motors explain less: it was up to
:math:`6\,\mathrm{ms}\,(1 - R^2) / R^2`, which is part of the stated error. The random part comes from leaving out
blocks of two seconds, one after another. Roll and pitch answer independently.

**What the number contains.** With measured speeds it is the error of the stamps and the delay of the gyro's filters.
With outputs it also contains the lag of the motors, which is the same in all logs of a vehicle: differences between
logs are then errors of stamps.

**What breaks it.** Motors in another order than the layout says have no relation to the axes. Where motors explain
neither axis at any lag, there is no number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.base import Immutable, cached_by_value
from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import Quantity, milliseconds
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.consistency import filter_lag
from rotorid.flights.flight_faults import (
    logged_too_slowly,
    motors_explain_too_little,
    motors_out_of_step,
    motors_still,
)
from rotorid.flights.motor_band import (
    BAND_HZ,
    BLOCK_S,
    LEAST_S,
    MotorBand,
    fastest_motors,
    flights_off_ground,
    motor_bands,
)
from rotorid.flights.rotor_order import LEAST_CORRELATION, require_order, rotor_order
from rotorid.models.autopilots.layouts import layout_of
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import kinematic_consistency
from rotorid.signal.motors import Kind
from rotorid.signal.partial_lag import Lag, LagPart, lag_curve, together
from rotorid.typing import FloatArray

Culprit: TypeAlias = Literal["motors", "gyro", ""]

NO_RELATION = 0.3
"""Correlation below which motors are not those of this motion."""

_LONGEST_S = 0.15
"""Largest skew: the lag of slow motors and the delay of a logger together are less."""

_FAR_S = 20.0
"""How far a relation is looked for where there is none near."""

_AGREE_S: Mapping[Kind, float] = {"speed": 0.003, "output": 0.02, "thrust_demand": 0.02}
"""By how much roll and pitch may differ: the lag of motors delays fast movements less than slow ones."""

_SURE = 3.0
"""Standard deviations from which a difference counts."""

_UNKNOWN_FILTERS_S = 0.008
"""Delay of the gyro's filters where none is known: a second-order low-pass at 28 Hz."""

_MODEL_S = 1e-3
"""What drag and flapping move the peak by: it was 1 to 3 ms in simulated flights of one vehicle of four."""

_FEEDBACK_S = 0.006
"""What noise and gusts that come back through a controller move the peak by, where they are half of the motion."""

_BLOCKS = round(2.0 / BLOCK_S)
_STILL = 1e-6
"""Variance of the levers times the thrusts, in parts of the mean thrust, below which motors rest."""
_AXES = ("roll", "pitch")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorSkew(Immutable):
    """How long after the motors the motion that they cause is stamped.

    Parameters
    ----------
    late_s
        Of the motion after the motors: to take it out, delay the motors by it.
    by_axis
        The same of roll and pitch, as far as motors explain the axis.
    correlation
        Axis to the largest correlation of the torque of the motors with the angular acceleration.
    kind
        What the log holds of the motors; of ``speed`` the lag of the motors is not in the skew.
    filters_s
        Least and most of the skew that filters of the gyro make; up to 8 ms where none is known.
    gyro_after_attitude_s
        How long after the attitude the gyro is stamped; ``None`` where the log has no attitude that shows it.
    """

    late_s: Quantity
    by_axis: Mapping[str, Quantity]
    correlation: Mapping[str, float]
    kind: Kind
    filters_s: tuple[float, float] = (0.0, 0.0)
    gyro_after_attitude_s: Quantity | None = None
    axes_agree: bool = field(init=False, default=True)

    def __post_init__(self) -> None:
        self._set(
            by_axis=self.by_axis, correlation=self.correlation, axes_agree=_agree(self.by_axis, _AGREE_S[self.kind])
        )

    @property
    def unexplained_s(self) -> float:
        """What neither filters nor, with outputs, the lag of motors explains: surely an error of stamps."""
        low, high = self.filters_s
        early = min(self.late_s.value - low, 0.0)
        late = max(self.late_s.value - high, 0.0) if self.kind == "speed" else 0.0
        left = early + late
        return left if abs(left) > max(_AGREE_S["speed"], _SURE * self.late_s.std) else 0.0

    @property
    def culprit(self) -> Culprit:
        """Whose stamps are wrong, by the gyro against the attitude; empty where that does not decide."""
        left, gyro = self.unexplained_s, self.gyro_after_attitude_s
        if not left or gyro is None:
            return ""
        if abs(left - gyro.value) + _SURE * gyro.std < 0.5 * abs(left):
            return "gyro"
        return "motors" if abs(gyro.value) + _SURE * gyro.std < 0.5 * abs(left) else ""

    def findings(self, where: str) -> tuple[Finding, ...]:
        """A warning where stamps are surely wrong, and where roll and pitch differ; nothing where all is well."""
        return tuple(self._findings(where))

    def _findings(self, where: str) -> Iterator[Finding]:
        numbers = {f"{axis}_s": found.value for axis, found in self.by_axis.items()}
        numbers |= {f"correlation_{axis}": value for axis, value in self.correlation.items()}
        numbers |= {"late_s": self.late_s.value, "std_s": self.late_s.std}
        late = milliseconds(abs(self.late_s.value), self.late_s.std)
        if self.unexplained_s:
            order = "after" if self.late_s.value > 0.0 else "before"
            cause = {
                "motors": "The gyro agrees with the attitude, so the stamps of the motors are wrong.",
                "gyro": "The gyro differs as much from the attitude, so its stamps are wrong.",
                "": "The log does not show which of the two stamps is wrong.",
            }[self.culprit]
            yield warn(
                "motor_stamps",
                where,
                f"The motion comes {late} ms {order} the {'speeds' if self.kind == 'speed' else 'outputs'} of the "
                f"motors. {cause} Models that need motors and rates together are wrong unless the fit removes the "
                "offset, as physical.flight does.",
                **numbers,
            )
        if not self.axes_agree:
            values = " and ".join(
                f"{milliseconds(found.value, found.std)} ms in {axis}" for axis, found in self.by_axis.items()
            )
            yield warn(
                "motor_stamps",
                where,
                f"The motion comes after the motors by {values}; one clock gives the same in both. Part of the log is "
                "damaged, or the rotors sit elsewhere than the layout says.",
                **numbers,
            )


def motor_skew(record: FlightRecord, layout: RotorLayout, *, intervals: Intervals = ()) -> MotorSkew:
    """Skew of the motors of a log against its gyro.

    Parameters
    ----------
    record
        Rates, and motor speeds, outputs, or commands with the autopilot's mixer.
    layout
        The rotors in the order of the motors.
    intervals
        Start and stop of what to use; the flights of the log by default.

    Raises
    ------
    InsufficientDataError
        The motors are numbered in another order, were logged too slowly, did not move, or have no relation to the
        motion; the finding says which, and what to do.
    UsageError
        The log has another number of motors than the layout.

    Examples
    --------
    >>> skew = motor_skew(rotorid.read("flight.ulg"), library_layout("quad.x"))  # doctest: +SKIP
    >>> skew.late_s.value, skew.culprit  # doctest: +SKIP
    (0.0126, 'motors')
    """
    history = fastest_motors(record, layout)
    if history.motors != layout.rotors:
        raise UsageError(
            f"{record.source.name} has {history.motors} motors, but {layout.name} has {layout.rotors} rotors",
            needed="the layout of the vehicle that flew",
            remedy="name it with --layout",
        )
    for what, rate_hz in (("motors", history.sample_rate_hz), *((name, record.rate_hz(name)) for name in RATES)):
        if rate_hz < LOWEST_RATE_HZ:
            raise logged_too_slowly(record, what, rate_hz)
    bands = list(motor_bands(record, history, intervals or flights_off_ground(record)))
    if sum(np.count_nonzero(band.kept) * band.step_s for band in bands) < LEAST_S:
        raise InsufficientDataError(
            f"{record.source.name} has less than {LEAST_S:.0f} s without gaps and motor limits",
            needed="motors and rates over a flight",
            remedy="log a longer flight",
        )
    levers = layout.moment_arms[:2] / np.abs(layout.moment_arms[:2]).max()
    torques = [band.passed(levers @ band.thrust) for band in bands]
    if max(float(np.var(torque)) for torque in torques) < _STILL:
        raise motors_still(record, BAND_HZ)
    lags = {axis: _lag(bands, torques, place) for place, axis in enumerate(_AXES)}
    correlation = {axis: lag.correlation for axis, lag in lags.items()}
    if max(correlation.values()) < NO_RELATION:
        # Motors in another order have no relation to the axes either: that has a message of its own.
        require_order(rotor_order(record, layout, intervals=intervals), record.source.name)
        raise motors_out_of_step(record, correlation, _far(bands, torques))
    explained = [axis for axis in _AXES if correlation[axis] >= LEAST_CORRELATION]
    if not explained:
        raise motors_explain_too_little(record, correlation, LEAST_CORRELATION)
    by_axis = {axis: _with_feedback(lags[axis]) for axis in explained}
    return MotorSkew(
        late_s=together(by_axis.values()),
        by_axis=by_axis,
        correlation=correlation,
        kind=history.kind,
        filters_s=_gyro_filters(record),
        gyro_after_attitude_s=_gyro_after_attitude(record, bands),
    )


@cached_by_value
def stamp_findings(record: FlightRecord) -> tuple[Finding, ...]:
    """Whether the motors of a log are in step with its gyro.

    For the layout that the log names; of four motors that no layout is named for, in the order that the flight shows.
    A warning where they surely are not; nothing where they are, where they were logged too slowly to show it, and
    where the motors explain the motion at no lag: gusts alone do that too.
    """
    try:
        layout = _layout(record)
        if layout is None or fastest_motors(record, layout).sample_rate_hz < LOWEST_RATE_HZ:
            return ()
        return motor_skew(record, layout).findings("motors")
    except InsufficientDataError as error:
        sure = [found for found in error.findings if found.kind == "motor_stamps" and "late_s" in found.numbers]
        return tuple(replace(found, severity="warning") for found in sure)
    except UsageError:
        return ()


def _layout(record: FlightRecord) -> RotorLayout | None:
    """The rotors by the log, else by the flight; ``None`` where neither shows them."""
    try:
        return layout_of(record)
    except (InsufficientDataError, UsageError):
        quad = library_layout("quad.x")
        history = fastest_motors(record, quad)
        fast = history.motors == quad.rotors and history.sample_rate_hz >= LOWEST_RATE_HZ
        return rotor_order(record, quad).fitting if fast else None


def _lag(bands: Sequence[MotorBand], torques: Sequence[FloatArray], axis: int) -> Lag:
    """Lag of the angular acceleration of one axis behind the torque of the motors."""
    parts = (
        LagPart(torque[axis], band.accelerations[axis], band.rates[axis], band.block // _BLOCKS, band.kept)
        for band, torque in zip(bands, torques, strict=True)
    )
    return lag_curve(parts, step_s=bands[0].step_s, longest_s=_LONGEST_S, where=f"motors in {_AXES[axis]}").lag()


def _with_feedback(lag: Lag) -> Quantity:
    """A lag with its random error, with what feedback makes of it, and what else turns the vehicle."""
    feedback_s = _FEEDBACK_S * (lag.correlation**-2.0 - 1.0)
    return Quantity.normal(lag.seconds, math.hypot(lag.std, feedback_s, _MODEL_S), "s")


def _far(bands: Sequence[MotorBand], torques: Sequence[FloatArray]) -> float | None:
    """The skew beyond the search of :func:`motor_skew` at which motors do explain roll and pitch, if there is one."""
    from scipy.signal import correlate, correlation_lags

    band, torque = max(zip(bands, torques, strict=True), key=lambda pair: pair[0].time_s.size)
    pairs = list(zip(band.accelerations[:2], torque, strict=True))
    lags_s = correlation_lags(band.time_s.size, band.time_s.size) * band.step_s
    near = np.abs(lags_s) <= min(_FAR_S, 0.5 * band.time_s.size * band.step_s)
    size = [math.sqrt(float(motion @ motion) * float(made @ made)) for motion, made in pairs]
    if not all(size):
        return None
    curves = [correlate(motion, made)[near] / power for (motion, made), power in zip(pairs, size, strict=True)]
    best = int(np.argmax(np.sum(curves, axis=0)))
    return float(lags_s[near][best]) if min(curve[best] for curve in curves) >= NO_RELATION else None


def _agree(by_axis: Mapping[str, Quantity], tolerance_s: float) -> bool:
    """Whether roll and pitch show one skew, as far as both are known."""
    if len(by_axis) < len(_AXES):
        return True
    roll, pitch = (by_axis[axis] for axis in _AXES)
    return abs(roll.value - pitch.value) <= max(tolerance_s, _SURE * math.hypot(roll.std, pitch.std))


def _gyro_filters(record: FlightRecord) -> tuple[float, float]:
    """Least and most delay of the filters of the gyro that is used."""
    topic, row = next(record.holding(RATES[0]))
    low, high = filter_lag(record, topic, topic.channels[row])
    return (low, high) if high > 0.0 else (0.0, _UNKNOWN_FILTERS_S)


def _gyro_after_attitude(record: FlightRecord, bands: Sequence[MotorBand]) -> Quantity | None:
    """How long after the attitude the gyro is stamped, by roll and pitch over the longest flight."""
    band = max(bands, key=lambda part: part.time_s.size)
    try:
        history = resample(
            record,
            channels=(*ATTITUDE, *RATES[:2]),
            start_s=float(band.time_s[0]),
            stop_s=float(band.time_s[-1]),
        ).longest
        checks = kinematic_consistency(history, channels=RATES[:2]).checks
    except InsufficientDataError:
        return None
    known = {check.channel: check for check in checks if check.relation == "same"}
    if not known:
        return None
    return together(Quantity.normal(check.lag_s, check.lag_std_s, "s") for check in known.values())
