r"""Force and moment of a physical model on a flight, in newtons and newton meters, and where that flight lies.

What the vehicle felt is known from its sensors: force over mass from the accelerometer, and the moment from the gyro,

.. math:: M = I \dot\omega + \omega \times I \omega.

An error is the root mean square of the length of the difference, so that three axes are one number; each axis is
given too. The model passes the accelerometer's filter; moments are compared up to 25 Hz, because beyond it a
derivative of the gyro is noise. Motors, the velocity through the air and the rates of the same moment go in, and
nothing from before: what was logged, differentiated over 10 ms, needs no model to come closer than any
(docs/accuracy.md).

A model was identified over ranges of airspeed, climb, load factor and rotor speed. Outside of them it extrapolates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import FlightRange, predicted_force
from rotorid.fitting.flight.moment import moment_error
from rotorid.fitting.flight.motion import Motion
from rotorid.models.flight import INERTIA, Airframe
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.verification.multistep import StepErrors, pooled


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightLoads(Immutable):
    """Force and moment of a stretch, measured and modeled.

    Parameters
    ----------
    measured_force, modeled_force
        Mass times specific force at the accelerometer, N, shape ``(3, n)``.
    measured_turning, modeled_turning
        Angular acceleration, rad/s², a row for each axis of :attr:`axes`.
    missed_moment
        Error of the moment up to 25 Hz, N m, a row for each axis.
    axes
        Rates whose inertia is known.
    """

    measured_force: FloatArray
    modeled_force: FloatArray
    measured_turning: FloatArray
    modeled_turning: FloatArray
    missed_moment: FloatArray
    axes: tuple[str, ...]

    def __post_init__(self) -> None:
        names = ("measured_force", "modeled_force", "measured_turning", "modeled_turning", "missed_moment")
        self._set(axes=tuple(self.axes), **{name: read_only(getattr(self, name), np.float64, ndim=2) for name in names})


def flight_loads_of(
    values: Mapping[str, float],
    airframe: Airframe,
    record: MotorRecord,
    driven: Motion,
    *,
    cutoff_hz: float | None = None,
) -> FlightLoads:
    """What a stretch measures and a model makes.

    Parameters
    ----------
    values, airframe, record, driven, cutoff_hz
        As for :func:`rotorid.fitting.flight.fit.predicted_force`.
    """
    force = predicted_force(values, airframe, record, driven, cutoff_hz)
    axes = tuple(axis for axis, inertia in INERTIA.items() if values.get(inertia, 0.0) > 0.0)
    rows = [list(INERTIA).index(axis) for axis in axes]
    inertia = np.array([values.get(name, 0.0) for name in INERTIA.values()])[:, None]
    moment = driven.loads(values, airframe).moment
    if len(axes) == len(INERTIA):
        moment = moment - np.cross(driven.rates, inertia * driven.rates, axis=0)
    return FlightLoads(
        measured_force=airframe.mass_kg * record.force,
        modeled_force=airframe.mass_kg * force,
        measured_turning=driven.acceleration[rows],
        modeled_turning=moment[rows] / inertia[rows],
        missed_moment=moment_error(values, airframe, record, driven)[rows],
        axes=axes,
    )


class AxisError(NamedTuple):
    """Root mean square of the errors along and about an axis, N and N m; ``None`` where the model has none."""

    force_rms_n: float | None
    moment_rms_nm: float | None


class LoadErrors(NamedTuple):
    """Errors of force and moment.

    Parameters
    ----------
    force_rms_n, moment_rms_nm
        Root mean square of the length of the difference; ``None`` where the model has no such axis.
    axes
        ``x``, ``y`` and ``z`` with their own.
    """

    force_rms_n: float | None
    moment_rms_nm: float | None
    axes: Mapping[str, AxisError]


BODY = ("x", "y", "z")
"""Names of the axes of force and moment."""


def load_errors(force: Mapping[str, FloatArray], moment: Mapping[str, FloatArray]) -> LoadErrors:
    """Errors from differences, axis ``x``, ``y``, ``z`` to a row of N or N m; axes that a model lacks are left out.

    Examples
    --------
    >>> found = load_errors({"x": np.array([3.0, -3.0]), "z": np.array([4.0, 4.0])}, {})
    >>> found.force_rms_n, found.moment_rms_nm, found.axes["z"]
    (5.0, None, AxisError(force_rms_n=4.0, moment_rms_nm=None))
    """

    def mean_square(rows: Mapping[str, FloatArray]) -> dict[str, float]:
        return {axis: float(np.mean(row**2)) for axis, row in rows.items()}

    squares = mean_square(force), mean_square(moment)
    forces, moments = ({axis: square**0.5 for axis, square in found.items()} for found in squares)
    whole = [sum(found.values()) ** 0.5 if found else None for found in squares]
    return LoadErrors(
        force_rms_n=whole[0],
        moment_rms_nm=whole[1],
        axes={axis: AxisError(forces.get(axis), moments.get(axis)) for axis in BODY},
    )


def differences(parts: list[FlightLoads]) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Errors of force and moment of several stretches, one after another, axis to row."""
    force = np.concatenate([part.measured_force - part.modeled_force for part in parts], axis=1)
    moment = np.concatenate([part.missed_moment for part in parts], axis=1)
    turned = dict(zip(INERTIA, BODY, strict=True))
    return dict(zip(BODY, force, strict=True)), {
        turned[axis]: row for axis, row in zip(parts[0].axes, moment, strict=True)
    }


USUAL_OUTSIDE_PERCENT = 10.0
"""Up to here a flight like those that were fitted may lie outside: half a percent of the samples at each end of every
range was left out, of each of four rotors."""


def outside_range(
    tested: FlightRange, record: MotorRecord, driven: Motion, *, velocity_known: bool = True
) -> dict[str, BoolArray]:
    """When a flight is outside of what was identified, see :func:`outside`; of airspeed only where that is known."""
    load = -record.force[2] / STANDARD_GRAVITY_M_S2
    found = outside(tested, velocity=driven.velocity, speeds=driven.speeds, load=load)
    return {name: row for name, row in found.items() if velocity_known or name not in _BY_VELOCITY}


_BY_VELOCITY = ("airspeed", "climb")


def outside(tested: FlightRange, *, velocity: FloatArray, speeds: FloatArray, load: FloatArray) -> dict[str, BoolArray]:
    """When a flight is outside of what was identified: ``airspeed``, ``climb``, ``motors``, ``load``, shape ``(n,)``.

    Parameters
    ----------
    tested
        What the fitted flights covered.
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    load
        Specific force along the rotors' axis over g, shape ``(n,)``.
    """

    def beyond(span: tuple[float, float], row: FloatArray) -> BoolArray:
        return np.asarray((row < span[0]) | (row > span[1]))

    return {
        "airspeed": beyond(tested.edge, np.hypot(velocity[0], velocity[1])),
        "climb": beyond(tested.climb, -velocity[2]),
        "motors": np.asarray(beyond(tested.speed, speeds).any(axis=0)),
        "load": beyond(tested.load, load),
    }


def percents(outside: list[dict[str, BoolArray]]) -> tuple[float, dict[str, float]]:
    """Share of the time of several stretches outside of any range, and of each.

    Examples
    --------
    >>> percents([{"load": np.array([True, False]), "climb": np.array([False, False])}])
    (50.0, {'load': 50.0, 'climb': 0.0})
    """
    rows = {name: np.concatenate([part[name] for part in outside]) for name in outside[0]}
    anywhere = np.any(list(rows.values()), axis=0)
    return 100.0 * float(anywhere.mean()), {name: 100.0 * float(row.mean()) for name, row in rows.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightJudgement(Immutable):
    """A physical model on one stretch of a flight.

    Parameters
    ----------
    samples
        How many it was judged on.
    errors
        Of force and moment.
    outside_percent
        Share of the time outside of any identified range; ``None`` where no range is known.
    outside
        The same of each range.
    ahead
        Predictions over many steps from states of the log; ``None`` where the log has no velocity and attitude, or the
        model no inertia.
    wind
        Toward north and east, m/s, found in this flight.
    skew_s
        How much earlier the stamps of the motors were than those of the gyro; taken out.
    center
        ``x_cg`` and ``y_cg`` of this flight, m; taken out.
    """

    samples: int
    errors: LoadErrors
    outside_percent: float | None = None
    outside: Mapping[str, float] = field(default_factory=dict)
    ahead: StepErrors | None = None
    wind: tuple[float, float] | None = None
    skew_s: float | None = None
    center: Mapping[str, float] = field(default_factory=dict)


def together(judged: Sequence[FlightJudgement]) -> FlightJudgement:
    """Several stretches as one: means of squares and of times by their samples, steps by their starts.

    Wind, skew and center of gravity are those of a stretch, so that only a single one keeps them.
    """
    if len(judged) == 1:
        return judged[0]
    weights = np.array([part.samples for part in judged], dtype=np.float64)

    def root(values: Sequence[float | None]) -> float | None:
        known = [(value, weight) for value, weight in zip(values, weights, strict=True) if value is not None]
        if not known:
            return None
        squares, shares = zip(*((value**2, weight) for value, weight in known), strict=True)
        return math.sqrt(float(np.average(squares, weights=shares)))

    def mean(values: Sequence[float | None]) -> float | None:
        return float(np.average([v or 0.0 for v in values], weights=weights)) if None not in values else None

    ahead = [part.ahead for part in judged if part.ahead is not None]
    alike = [part for part in ahead if part.horizons_s.shape == ahead[0].horizons_s.shape]
    return FlightJudgement(
        samples=int(weights.sum()),
        errors=LoadErrors(
            root([part.errors.force_rms_n for part in judged]),
            root([part.errors.moment_rms_nm for part in judged]),
            {
                axis: AxisError(
                    root([part.errors.axes[axis].force_rms_n for part in judged]),
                    root([part.errors.axes[axis].moment_rms_nm for part in judged]),
                )
                for axis in BODY
            },
        ),
        outside_percent=mean([part.outside_percent for part in judged]),
        outside={
            name: share
            for name in judged[0].outside
            if (share := mean([part.outside.get(name) for part in judged])) is not None
        },
        ahead=pooled(alike) if alike else None,
    )
