"""The physical model of flight fitted to records: what entered, its numbers, and where they were found.

Force comes first (:mod:`rotorid.fitting.flight.force`), because thrust that is wrong spoils every moment; moments with
the thrust held follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.flight.force import through_sensor
from rotorid.fitting.flight.ladder import ForceChoices, Rung, fit_force
from rotorid.fitting.flight.moment import MomentChoices, MomentFit, Octave, fit_moments, motor_lag
from rotorid.fitting.flight.motion import Motion, VelocityClass, motion, velocity_class
from rotorid.fitting.motors.fit import MotorFit
from rotorid.models.flight import (
    CURVE_TERMS,
    Airframe,
    HoverThrust,
    felt,
    hover_thrust,
)
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, kw_only=True)
class FlightChoices(Immutable):
    """What is decided before a fit.

    Parameters
    ----------
    values
        Numbers that are known, which are held.
    terms
        Coefficients beyond those of every fit that may enter; ``None``: all of the ladder, as far as data carry them.
    velocity
        How the velocity is had; ``None``: the best way that all records allow.
    wind
        Whether each record has a wind of its own; ``None``: where the velocity was measured and the attitude too.
    cutoff_hz
        Of the accelerometers' filter; ``None``: found from the data, where no taps are known.
    skews_s
        By which the stamps of the motors of each record are earlier than those of the gyros; none by default.
    least_gain
        Share by which a term has to lower the error of data that were not fitted.
    predictor
        Whether numbers that predict this closed loop best are wanted beside those of the vehicle.
    straight
        Whether thrust follows what is known of the motors in a line, as the parameters of the autopilot say; the data
        may bend it.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[str, ...] | None = None
    velocity: VelocityClass | None = None
    wind: bool | None = None
    cutoff_hz: float | None = None
    skews_s: tuple[float, ...] = ()
    least_gain: float = 0.01
    predictor: bool = False
    straight: bool = False

    def __post_init__(self) -> None:
        self._set(values=self.values)


class FlightRange(NamedTuple):
    """What the records covered: least and largest, the outermost half percent of samples left out on either side.

    Parameters
    ----------
    edge
        Edgewise airspeed of the body, m/s.
    climb
        Through the air along the rotors' axis, m/s.
    speed
        Of the rotors, rad/s or shares.
    load
        Specific force along the rotors' axis over g.
    """

    edge: tuple[float, float]
    climb: tuple[float, float]
    speed: tuple[float, float]
    load: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightErrors(Immutable):
    """How well the numbers are known.

    Parameters
    ----------
    names
        In the order of rows and columns.
    covariance
        Of the vehicle's numbers, of which every flight shows others, shape ``(p, p)``: 1.96 deviations hold 95 %.
    random
        Of what noise and gusts do within the flights alone, shape ``(p, p)``.
    how
        Where the scatter between flights comes from: ``flights`` or ``assumed``.
    scatter
        Standard deviation of each number between flights, shape ``(p,)``; none by default.
    shared
        Deviations from causes that act alike in all flights, a column for each cause, shape ``(p, causes)``; they are
        part of both covariances. None by default.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    random: FloatArray
    how: str
    scatter: FloatArray = field(default_factory=lambda: np.zeros(0))
    shared: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        scatter = self.scatter if self.scatter.size else np.zeros(len(self.names))
        shared = self.shared if self.shared.size else np.zeros((len(self.names), 0))
        self._set(
            covariance=read_only(self.covariance, np.float64, ndim=2),
            random=read_only(self.random, np.float64, ndim=2),
            scatter=read_only(scatter, np.float64, ndim=1),
            shared=read_only(shared, np.float64, ndim=2),
        )

    def std(self, name: str) -> float:
        """One standard deviation of a number of the vehicle, the scatter between flights included."""
        place = self.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))

    def std_of_another(self, name: str, std: float = 0.0, shared: FloatArray | None = None) -> float:
        """One standard deviation of the difference between these numbers and what another flight alone shows.

        What acts alike in all flights moves both, and counts only as far as it moves them differently.

        Parameters
        ----------
        std, shared
            Random error of the other flight, and its row of :attr:`shared`; by default none, and the one of these.
        """
        place = self.names.index(name)
        own = self.shared[place]
        apart = 0.0 if shared is None else float(np.linalg.norm(own - shared))
        alone = max(float(self.covariance[place, place] - own @ own), 0.0)
        return float(np.sqrt(alone + self.scatter[place] ** 2 + std**2 + apart**2))


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightFit(Immutable):
    """The physical model of flight with its numbers.

    Parameters
    ----------
    airframe
        What was known of the vehicle.
    records
        Names of the records, in the order of everything that there is one of for each.
    values
        Parameter to value, those of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`, held ones included.
    free
        Those that were fitted.
    entered
        Terms that the ladder added.
    ladder
        What was tried.
    velocity
        How the velocity was had.
    missing
        Terms that these records cannot show at all, and why, term to reason.
    winds, wind_stds
        Of each record, toward north and east, m/s, shape ``(records, 2)``; not finite where none was fitted.
    skews_s
        By which the stamps of the motors are earlier than those of the gyros, shape ``(records,)``.
    cutoff_hz
        Of the low-pass that stands for the accelerometers' filter; ``None`` where taps are known or none was found.
    force_rms_n
        Error of force of each record, root mean square of the length of the vector, shape ``(records,)``.
    force_axes_n
        The same axis by axis, shape ``(records, 3)``.
    tested
        What the records covered.
    hover
        Thrust and slope in hover, which do not trade as coefficients do.
    errors
        How well the numbers are known; ``None`` where that was not worked out.
    octaves
        How far the motors explain each axis by octave.
    moment_rms_nm
        Error of moment of each record, shape ``(records,)``; empty where moments were not fitted.
    predictor
        Numbers that predict this closed loop best, and are not the vehicle's; empty where they were not asked for.
    moments
        Fit of the moments; ``None`` where there was none.
    lag
        Fit of roll and pitch that the lag of the motors is from; ``None`` where it is known or from force.
    """

    airframe: Airframe
    records: tuple[str, ...]
    values: Mapping[str, float]
    free: tuple[str, ...]
    entered: tuple[str, ...]
    ladder: tuple[Rung, ...]
    velocity: VelocityClass
    missing: Mapping[str, str]
    winds: FloatArray
    wind_stds: FloatArray
    skews_s: FloatArray
    cutoff_hz: float | None
    force_rms_n: FloatArray
    force_axes_n: FloatArray
    tested: FlightRange
    hover: HoverThrust
    errors: FlightErrors | None = None
    octaves: tuple[Octave, ...] = ()
    moment_rms_nm: FloatArray = field(default_factory=lambda: np.zeros(0))
    predictor: Mapping[str, float] = field(default_factory=dict)
    moments: MomentFit | None = None
    lag: MotorFit | None = None

    def __post_init__(self) -> None:
        vectors = {name: read_only(getattr(self, name), np.float64, ndim=1) for name in _VECTORS}
        tables = {name: read_only(getattr(self, name), np.float64, ndim=2) for name in _TABLES}
        self._set(values=self.values, missing=self.missing, predictor=self.predictor, **vectors, **tables)


_SHORTEST_S = 6.0
"""Three blocks of two seconds, by which errors are known."""

_VECTORS = ("skews_s", "force_rms_n", "moment_rms_nm")
_TABLES = ("winds", "wind_stds", "force_axes_n")


def fit_flight(records: Sequence[MotorRecord], airframe: Airframe, choices: FlightChoices | None = None) -> FlightFit:
    """Fit the physical model of flight.

    Parameters
    ----------
    records
        Flights of one vehicle, with specific force along all axes.
    airframe
        What is known of it.
    choices
        What is decided before; by default nothing.

    Raises
    ------
    UsageError
        Records and airframe have different numbers of rotors, there is no record, or a thrust curve is known in part.
    InsufficientDataError
        A record has no specific force along all axes, or its motors never turn, or all together last
        less than 6 s.
    """
    records = tuple(records)
    given = choices or FlightChoices()
    _check(records, airframe, given)
    lag = _lag(records, airframe, given)
    choices = _with_lag(given, lag)
    kind = choices.velocity or velocity_class(records)
    skews = np.array(choices.skews_s or np.zeros(len(records)))
    turned = all(record.attitude.shape[1] for record in records)
    wind = (choices.wind is None or choices.wind) and kind == "measured" and turned
    wanted = ForceChoices(
        choices.values, choices.terms, kind, wind, choices.cutoff_hz, skews, choices.least_gain, choices.straight
    )
    force = fit_force(records, airframe, wanted)
    if lag is not None and "c_1" in force.free:
        # The lag was found with a square, and outputs that change much turn a vehicle by what the curve is.
        lag = motor_lag(records, airframe, force.values) or lag
        choices = _with_lag(given, lag)
        force = fit_force(records, airframe, wanted._replace(known=choices.values))
    values = dict(force.values)
    if lag is not None and "T_motor" not in lag.moving:
        # A lag far shorter than the samples is none.
        del values["T_motor"]
    driven = [
        motion(record, values, kind=kind, wind=blown, skew_s=float(skew))
        for record, blown, skew in zip(records, force.winds, skews, strict=True)
    ]
    left = np.array(
        [
            _size(airframe.mass_kg * (record.force - predicted_force(values, airframe, record, moved, force.cutoff_hz)))
            for record, moved in zip(records, driven, strict=True)
        ]
    )
    forces = FlightFit(
        airframe=airframe,
        records=tuple(record.name for record in records),
        values=values,
        free=(*force.free, *(name for name in choices.values if name not in given.values and name in values)),
        entered=force.entered,
        ladder=force.ladder,
        velocity=kind,
        missing=force.missing,
        winds=force.winds,
        wind_stds=force.wind_stds,
        skews_s=skews,
        cutoff_hz=force.cutoff_hz,
        force_rms_n=np.sqrt((left**2).sum(axis=1)),
        force_axes_n=left,
        tested=covered(records, driven),
        hover=hover_thrust(values, airframe),
        lag=lag,
    )
    return with_moments(forces, records, choices)


def fitted_motion(fit: FlightFit, records: Sequence[MotorRecord]) -> list[Motion]:
    """What drives the model over the records of a fit."""
    return [
        motion(record, fit.values, kind=fit.velocity, wind=wind, skew_s=float(skew))
        for record, wind, skew in zip(records, fit.winds, fit.skews_s, strict=True)
    ]


def with_moments(forces: FlightFit, records: Sequence[MotorRecord], choices: FlightChoices) -> FlightFit:
    """A fit of forces with the moments that follow with them held (:mod:`rotorid.fitting.flight.moment`)."""
    wanted = MomentChoices(
        known=choices.values,
        terms=choices.terms,
        least_gain=choices.least_gain,
        predictor=choices.predictor,
        # Without drag there is no wind either.
        airspeed=forces.velocity == "measured" and ("k_d" in forces.values or choices.wind is False),
    )
    found = fit_moments(records, forces.airframe, fitted_motion(forces, records), forces.values, wanted)
    return replace(
        forces,
        values={**forces.values, **found.values},
        free=(*forces.free, *(name for name in found.free if name not in forces.free)),
        entered=(*forces.entered, *found.entered),
        missing={**forces.missing, **found.missing},
        octaves=found.octaves,
        moment_rms_nm=found.rms_nm,
        predictor=found.predictor,
        moments=found,
    )


def _lag(records: Sequence[MotorRecord], airframe: Airframe, choices: FlightChoices) -> MotorFit | None:
    """Motors known by their outputs follow them with a lag, which roll and pitch show before thrust is known."""
    if "T_motor" in choices.values or all(record.between == "lines" for record in records):
        return None
    return motor_lag(records, airframe)


def _with_lag(choices: FlightChoices, lag: MotorFit | None) -> FlightChoices:
    if lag is None:
        return choices
    return replace(choices, values={**choices.values, "T_motor": lag.parameters["T_motor"].value})


def _size(rows: FloatArray) -> FloatArray:
    """Root mean square of each row."""
    return np.asarray(np.sqrt(np.mean(rows**2, axis=1)))


def predicted_force(
    values: Mapping[str, float],
    airframe: Airframe,
    record: MotorRecord,
    driven: Motion,
    cutoff_hz: float | None = None,
) -> FloatArray:
    """Specific force that the model predicts behind the accelerometer's filter, m/s², shape ``(3, n)``.

    Parameters
    ----------
    values
        Of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`.
    record
        For the filter of its accelerometer.
    driven
        What drives the model, of :func:`rotorid.fitting.flight.motion.motion`.
    cutoff_hz
        Of :attr:`FlightFit.cutoff_hz`.
    """
    force = felt(driven.loads(values, airframe), values, airframe.mass_kg, driven.rates, driven.acceleration)
    return through_sensor(force, record, cutoff_hz)


def covered(records: Sequence[MotorRecord], driven: Sequence[Motion]) -> FlightRange:
    """What records covered."""
    edge, climb = (
        np.concatenate([np.hypot(moved.velocity[0], moved.velocity[1]) for moved in driven]),
        np.concatenate([-moved.velocity[2] for moved in driven]),
    )
    speed = np.concatenate([moved.speeds.ravel() for moved in driven])
    load = np.concatenate([-record.force[2] for record in records]) / STANDARD_GRAVITY_M_S2

    def span(values: FloatArray) -> tuple[float, float]:
        low, high = np.quantile(values, (0.005, 0.995))
        return float(low), float(high)

    return FlightRange(span(edge), span(climb), span(speed), span(load))


def _check(records: Sequence[MotorRecord], airframe: Airframe, choices: FlightChoices) -> None:
    if not records:
        raise UsageError("no records were given", needed="at least one")
    bent = [name for name in CURVE_TERMS[:2] if choices.values.get(name, 0.0) != 0.0]
    if bent and "c_2" not in choices.values:
        raise UsageError(
            f"of the thrust curve only {' and '.join(bent)} is known",
            needed="c_0, c_1 and c_2",
            remedy="fix c_2 too, or leave the curve to the fit",
        )
    seconds = sum(record.duration_s for record in records)
    if seconds < _SHORTEST_S:
        raise InsufficientDataError(f"the flights last {seconds:.2g} s", needed=f"{_SHORTEST_S:g} s")
    for record in records:
        if record.outputs.shape[0] != airframe.rotors:
            raise UsageError(
                f"{record.name} has {record.outputs.shape[0]} motors", needed=f"{airframe.rotors}, as in the layout"
            )
        if not record.outputs.any():
            raise InsufficientDataError(f"the motors of {record.name} stand still", needed="motors that turn")
        if not record.force.shape[1]:
            raise InsufficientDataError(f"{record.name} has no specific force", needed="three accelerometers")
