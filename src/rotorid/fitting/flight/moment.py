r"""The moments of flight, twice: those of the vehicle where motors show it, and those of the air at all frequencies.

With thrust held from the fit of force, :math:`M_T = \sum r_i \times (0, 0, -T_i)` turns the vehicle by
:math:`M_T / I`. A controller holds the vehicle against moments of the air: where flight is slow, motors and air cancel,
motion is little, and a regression over all frequencies finds torque that turns nothing (a share of 0.03 below 1 Hz and
of 0.8 at 8 Hz in agile flights). So

- **inertia**, :math:`\kappa` and :math:`J_r` come from the octaves in which motors explain an axis
  (:mod:`rotorid.fitting.motors.excitation`), by the fit of ``physical.motors`` with thrust in moving air in place of
  outputs: errors are whitened, feedback does not bias it. A vehicle that is flat lends its gyroscopic moments,
  :math:`\dot p = M / I_{xx} - q r`, :math:`\dot q = M / I_{yy} + p r`, which are taken out before.
- **moments of the air** are what motors and inertia leave at all frequencies, linear in their coefficients. They are on
  the left-hand side of the loop together with the motors, whose answer is known, so that a regression on motion finds
  them. They enter only if they lower the error of data that were not fitted, and of no flight raise it; of a single
  flight, by more than twice what its blocks say of that gain's error.

The *predictor* frees everything over all frequencies. It predicts flights under the same controller better, is another
vehicle than that which flew, and is kept apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable, read_only
from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.motion import Motion, without_noise
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, SLOW_HZ, excitations, excited_axes, octaves
from rotorid.fitting.motors.fit import LEAST_SAMPLES, MotorFit, fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.models.flight import (
    CURVE_TERMS,
    FLIGHT_PARAMETERS,
    HUB_TERMS,
    INERTIA,
    SIDE_TERMS,
    Air,
    Airframe,
    center_columns,
    flight_columns,
    full_thrust,
    hover_thrust,
    inflow_thrust,
    rotor_air,
    rotor_thrusts,
)
from rotorid.models.motors import SPIN_UP, Curve, motor_parameters
from rotorid.typing import FloatArray

AIR_TERMS = (*HUB_TERMS, "x_cg", "y_cg", "z_cg")
"""Moments that motors and inertia leave."""

MOMENT_NUMBERS = (*INERTIA.values(), "kappa", "J_r", *AIR_TERMS)
"""What is found from moments."""

GAINS = ("gain_p", "gain_q", "gain_r")
"""Numbers of the predictor: the share of the motors' moments that shows about each axis."""

LADDER: tuple[tuple[str, ...], ...] = (
    ("m_f",),
    ("m_fx",),
    ("x_cg", "y_cg"),
    ("z_cg",),
    ("m_s",),
    ("kappa_lambda",),
    ("k_r",),
)
"""Moments of the air in the order in which they are tried."""

_LIKE_HEIGHT: tuple[tuple[str, ...], ...] = (("x_cg", "y_cg"), ("m_fx",), ("m_f",))
"""What may have entered for rotors that are higher than the layout has them, and is then judged again."""

MOMENT_HZ = 25.0
"""Up to here moments are compared: beyond, differences of gyros are noise."""

LEAST_ADVANCE = 0.37
"""Airspeed over the induced velocity of hover below which a flight shows no hub moment, which goes with their ratio:
3 m/s of a racing quadrotor, 1.6 m/s of one of 45 g."""

_FITTED_HZ = 150.0
_COMPARED_HZ = 75.0
_SAMPLES_A_CYCLE, _YAW_HZ = 8.0, 7.5
_EARLIEST_S = -0.02
_FOLDS, _BLOCKS = 3, 5
_SHOWN = 2.0
"""Errors of a gain, by its blocks, from which it is one."""

_ROUNDS = 2


class Octave(NamedTuple):
    """How far the motors explain one axis in one octave.

    Parameters
    ----------
    axis
        ``p``, ``q`` or ``r``.
    low_hz, high_hz
        The octave.
    correlation
        Of the motors' moment with the acceleration, at the best lag, in the record that shows most.
    kept
        Whether it belongs to the band in which the inertia of the axis is fitted.
    """

    axis: str
    low_hz: float
    high_hz: float
    correlation: float
    kept: bool


class MomentRung(NamedTuple):
    """One step of the ladder of moments.

    Parameters
    ----------
    terms
        Their names.
    before, after
        Root mean square of the error of moment, N m, on data that were not fitted, without and with them.
    entered
        Whether they were kept.
    """

    terms: tuple[str, ...]
    before: float
    after: float
    entered: bool


class Alone(NamedTuple):
    """What one record shows in the octaves in which motors explain it.

    Parameters
    ----------
    values, stds
        Of ``I_xx``, ``I_yy``, and over the inertia of yaw ``kappa_per_I_zz`` and ``h_per_I_zz``; deviations of white
        errors.
    delay_s
        By which its rates follow moments; ``None`` where it shows no axis.
    chains
        Fits of roll and pitch, and of yaw.
    octaves
        How far motors explain each axis.
    """

    values: Mapping[str, float]
    stds: Mapping[str, float]
    delay_s: float | None
    chains: tuple[MotorFit, ...]
    octaves: tuple[Octave, ...]


@dataclass(frozen=True, kw_only=True)
class MomentChoices(Immutable):
    """What is decided before moments are fitted.

    Parameters
    ----------
    known
        Numbers that are known, which are held.
    terms
        Moments of the air that may enter; ``None``: all of the ladder.
    least_gain
        Share by which a term has to lower the error of data that were not fitted.
    predictor
        Whether the predictor is wanted too.
    airspeed
        Whether steady airspeed is known: velocity was measured, and wind is found or known to be none.
    """

    known: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[str, ...] | None = None
    least_gain: float = 0.01
    predictor: bool = False
    airspeed: bool = True

    def __post_init__(self) -> None:
        self._set(known=self.known)


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentFit(Immutable):
    """Moments of a vehicle in flight.

    Parameters
    ----------
    values
        Inertia, ``kappa``, ``J_r`` and moments of the air, known ones included; none of an axis that motors do not
        explain.
    free
        Those that were fitted.
    assumed
        Those that no flight shows and that were not known: ``I_zz``, taken as that of a flat vehicle, to which
        ``kappa`` and ``J_r`` are in proportion.
    entered
        Moments of the air among them.
    ladder
        What was tried.
    missing
        What these records cannot show, and why.
    octaves
        How far the motors explain each axis by octave.
    delay_s
        By which rates follow moments, sensors and stamps together, on average over the records.
    rms_nm
        Error of moment of each record over the axes that are known, root mean square of the length, ``(records,)``;
        empty where none is.
    axes_nm
        The same axis by axis, not a number where an axis is not known, shape ``(records, 3)``.
    alone
        What each record shows in its band.
    delays_s
        By which rates of each record follow moments, shape ``(records,)``.
    predictor
        What predicts flights under this controller best, and is not the vehicle; empty where it was not wanted.
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    assumed: tuple[str, ...]
    entered: tuple[str, ...]
    ladder: tuple[MomentRung, ...]
    missing: Mapping[str, str]
    octaves: tuple[Octave, ...]
    delay_s: float
    rms_nm: FloatArray
    axes_nm: FloatArray
    alone: tuple[Alone, ...]
    delays_s: FloatArray
    predictor: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            values=self.values,
            missing=self.missing,
            predictor=self.predictor,
            rms_nm=read_only(self.rms_nm, np.float64, ndim=1),
            delays_s=read_only(self.delays_s, np.float64, ndim=1),
            axes_nm=read_only(self.axes_nm, np.float64, ndim=2),
        )


def fit_moments(
    records: Sequence[MotorRecord],
    airframe: Airframe,
    driven: Sequence[Motion],
    force: Mapping[str, float],
    choices: MomentChoices | None = None,
) -> MomentFit:
    """Fit the moments of flights whose forces are known.

    Parameters
    ----------
    records
        Flights of one vehicle.
    airframe
        What is known of it.
    driven
        What drives each, of :func:`rotorid.fitting.flight.motion.motion`.
    force
        Coefficients of force, which are held.
    choices
        What is decided before; by default nothing.
    """
    choices = choices or MomentChoices()
    known = {name: value for name, value in choices.known.items() if name in MOMENT_NUMBERS}
    alone = [_in_band(record, airframe, moved, force, known) for record, moved in zip(records, driven, strict=True)]
    shown, table = _mean(alone), _octaves(alone)
    inertia = {name: value for name, value in shown.items() if name in INERTIA.values()}
    values = {**force, **inertia, **known}
    assumed: tuple[str, ...] = ()
    if "I_zz" not in values and "kappa" not in values and {"I_xx", "I_yy"} <= values.keys():
        values["I_zz"], assumed = values["I_xx"] + values["I_yy"], ("I_zz",)
    values |= _yaw(shown, values, known)
    delays = np.array([np.nan if one.delay_s is None else one.delay_s for one in alone])
    delay_s = float(np.nanmean(delays)) if np.isfinite(delays).any() else 0.0
    delays = np.where(np.isfinite(delays), delays, delay_s)
    axes = [
        place
        for place, axis in enumerate(RATES)
        if INERTIA[axis] in values and (axis != "r" or {"kappa", "J_r"} & values.keys())
    ]
    missing = {INERTIA[axis]: _why_not(axis, table) for axis in "pq" if INERTIA[axis] not in values}
    if "kappa" not in values:
        # Yaw that motors explain gives the ratio to an inertia that follows from roll and pitch.
        unknown_inertia = shown.get("kappa_per_I_zz", 0.0) > 0.0
        missing["kappa"] = "I_zz is not known" if unknown_inertia else _why_not("r", table)
    elif assumed:
        missing["I_zz"] = "assumed to be I_xx + I_yy, as of a flat vehicle and the most that there can be"
    air: dict[str, float] = {}
    ladder: tuple[MomentRung, ...] = ()
    rows = [
        _rows(record, moved, airframe, values, float(late))
        for record, moved, late in zip(records, driven, delays, strict=True)
    ]
    least_m_s = LEAST_ADVANCE * hover_thrust(values, airframe).induced_m_s
    slow = "" if _fastest(driven) > least_m_s else f"the flight is slower than {least_m_s:.2g} m/s"
    # Drag at the hubs turns a vehicle that flies, and damps one that yaws.
    alike = "" if "k_d" in force else "rotor drag is not known, whose moment looks alike"
    hidden = {name: why for name, why in {"m_f": slow or alike, "z_cg": slow or alike, "k_r": alike}.items() if why}
    if axes:
        air, ladder = _climbed(rows, axes, choices, missing, hidden)
    left = [_rest(row, tuple(air), np.array(list(air.values()))) for row in rows]
    unknown = [place for place in range(3) if place not in axes]
    sizes = np.array([np.sqrt(np.mean(one**2, axis=1)) for one in left])
    sizes[:, unknown] = np.nan
    values |= air
    numbers = {name: values[name] for name in MOMENT_NUMBERS if name in values}
    return MomentFit(
        values=numbers,
        free=tuple(name for name in numbers if name not in known and name not in assumed),
        assumed=assumed,
        entered=tuple(air),
        ladder=ladder,
        missing=missing,
        octaves=table,
        delay_s=delay_s,
        rms_nm=np.sqrt(np.nansum(sizes**2, axis=1)) if axes else np.zeros(0),
        axes_nm=sizes,
        alone=tuple(alone),
        delays_s=delays,
        predictor=_predictor(rows, axes) if choices.predictor and axes else {},
    )


def _fastest(driven: Sequence[Motion]) -> float:
    """Airspeed that a flight exceeds for a twentieth of its time, m/s."""
    return float(max(np.quantile(np.hypot(moved.velocity[0], moved.velocity[1]), 0.95) for moved in driven))


def moment_error(
    values: Mapping[str, float],
    airframe: Airframe,
    record: MotorRecord,
    driven: Motion,
    *,
    delay_s: float = 0.0,
    inertia: Sequence[float] | None = None,
    predictor: Mapping[str, float] | None = None,
) -> FloatArray:
    r"""Error of the moment that the model predicts, N m, shape ``(3, k)``; not a number where an axis has no inertia.

    .. math:: J \left( \dot\omega - I^{-1} (M - \omega \times I \omega) \right)

    behind a low-pass of 25 Hz without phase, thinned to some 75 samples in a second. A scale that inertia and moment
    share changes no motion, so that what counts is the error of angular acceleration, in units of moment by J.

    Parameters
    ----------
    values
        Of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`, those of force too.
    delay_s
        Of :attr:`MomentFit.delay_s`.
    inertia
        J about the three axes, kg m²; that of the values by default.
    predictor
        Of :attr:`MomentFit.predictor`, which then stands for moments of the air and scales those of motors.
    """
    if predictor:
        motors = {name: value for name, value in values.items() if name not in AIR_TERMS}
        freed = {name: value for name, value in predictor.items() if name not in GAINS}
        gains = np.array([predictor.get(name, 1.0) for name in GAINS])[:, None]
        made = driven.loads(motors | freed, airframe).moment + (gains - 1.0) * driven.loads(motors, airframe).moment
    else:
        made = driven.loads(values, airframe).moment
    turned = _matrix(values)
    rate_hz = record.sample_rate_hz
    moment, coupled, acceleration = _compared(
        np.stack([_late(made, delay_s * rate_hz), _gyroscopic(turned, driven.rates), driven.acceleration]), rate_hz
    )
    known = turned[:, None]
    weights = known if inertia is None else np.asarray(inertia, dtype=np.float64)[:, None]
    return np.asarray(weights * (acceleration - (moment - coupled) / known))


def missed_moment(moment: FloatArray, record: MotorRecord, driven: Motion, inertia: Sequence[float]) -> FloatArray:
    r"""Error of a moment that anybody predicts, N m, shape ``(3, k)``, filtered and thinned as by :func:`moment_error`.

    .. math:: J \dot\omega + \omega \times J \omega - M

    Parameters
    ----------
    moment
        About the center of gravity, N m, shape ``(3, n)``.
    inertia
        J about the three axes, kg m².
    """
    known = np.asarray(inertia, dtype=np.float64)
    measured = known[:, None] * driven.acceleration + _gyroscopic(known, driven.rates)
    return _compared(measured - moment, record.sample_rate_hz)


def center_of(values: Mapping[str, float], airframe: Airframe, record: MotorRecord, driven: Motion) -> dict[str, float]:
    """Center of gravity of one flight of a known vehicle, ``x_cg`` and ``y_cg`` in m.

    It moves with the battery: half a millimeter turns a quadrotor of 45 g by 7 rad/s². Over a flight, angular
    acceleration is nothing on average, and the moment that is left then comes from the center of gravity, or from
    rotors that differ, which looks the same. An axis without its inertia keeps what the values have.
    """
    left = moment_error(values, airframe, record, driven).mean(axis=1)
    thrust = -float(driven.loads(values, airframe).force[2].mean())
    moved = {"x_cg": -float(left[1]) / thrust, "y_cg": float(left[0]) / thrust}
    return {name: values.get(name, 0.0) + shift for name, shift in moved.items() if np.isfinite(shift)}


def turned_axes(
    values: Mapping[str, float], airframe: Airframe, record: MotorRecord, driven: Motion
) -> tuple[str, ...]:
    """Axes that the motors turn in a flight, rightly or the other way: the others judge no vehicle.

    As for a fit, thrust in moving air has to explain roll and pitch, and speeds yaw.
    """
    air = rotor_air(airframe, driven.velocity, driven.rates, inflow_thrust(values, airframe, driven.speeds))
    thrust = rotor_thrusts(values, airframe, driven.speeds, air)
    rates = _free_rates(record, _matrix(values), _side_moments(values, airframe, driven, air))
    found: list[str] = []
    for axes, outputs in (("pq", thrust), ("r", driven.speeds)):
        thinned = _thinned(record, outputs, rates)
        (shown,) = excitations([thinned], _levers(airframe), spin_up=axes == "r")
        found += [a for a in axes if max(shown[a].correlation, -shown[a].opposed) >= LEAST_CORRELATION]
    return tuple(found)


def motor_lag(
    records: Sequence[MotorRecord], airframe: Airframe, curve: Mapping[str, float] | None = None
) -> MotorFit | None:
    """Lag and delay of motors known by their outputs, as ``physical.motors`` finds them from roll and pitch.

    Inertia is fitted again with thrust in moving air: only the shape of thrust counts. ``None`` where motors explain
    neither axis.

    Parameters
    ----------
    curve
        Of thrust by output; before one is known, its square is near enough where outputs change little.
    """
    levers = _levers(airframe)
    # Without specific force, so that axes are looked for in octaves although thrust is shown by slow motion.
    turning = [replace(record, az=np.zeros(record.samples)) for record in records]
    axes = tuple(axis for axis in excited_axes(excitations(turning, levers, in_air=True)) if axis in "pq")
    if not axes or min(record.samples for record in records) < LEAST_SAMPLES:
        return None
    known = {"m": airframe.mass_kg, "c_2": float(np.mean([_square_thrust(record, airframe) for record in records]))}
    if curve is not None:
        known |= {name: curve.get(name, 0.0) for name in CURVE_TERMS}
    shape: Curve = "quadratic" if curve is None else "polynomial"
    parameters = motor_parameters(curve=shape, known=known, axes=axes, earliest_s=_EARLIEST_S)
    return fit_motors(
        MotorProblem(records=tuple(turning), levers=levers, parameters=parameters, axes=axes, in_air=True)
    )


def _square_thrust(record: MotorRecord, airframe: Airframe) -> float:
    """Thrust of a rotor by the square of its output that makes the mean specific force, N."""
    squares = float((record.outputs**2 * record.strength).sum(axis=0).mean())
    return airframe.mass_kg * max(-float(record.az.mean()), 1.0) / max(squares, 1e-300)


def _levers(airframe: Airframe) -> FloatArray:
    return np.stack([-airframe.positions[:, 1], airframe.positions[:, 0], airframe.spins])


def _matrix(values: Mapping[str, float]) -> FloatArray:
    """Moments of inertia about the three axes; not a number where they are not known."""
    return np.array([values.get(INERTIA[axis], np.nan) for axis in RATES])


def _gyroscopic(inertia: FloatArray, rates: FloatArray) -> FloatArray:
    r""":math:`\omega \times I \omega`, of a flat vehicle where that of yaw is not known, else without what is not."""
    I_xx, I_yy, I_zz = inertia
    turned = np.array([I_xx, I_yy, I_xx + I_yy if np.isnan(I_zz) else I_zz])[:, None] * rates
    return np.nan_to_num(np.cross(rates, turned, axis=0))


def _late(rows: FloatArray, samples: float) -> FloatArray:
    """Rows ``(3, n)`` later by some samples, the first and the last value going on."""
    clock = np.arange(rows.shape[-1])
    return np.stack([np.interp(clock - samples, clock, row) for row in rows])


def _compared(rows: FloatArray, rate_hz: float) -> FloatArray:
    """Rows ``(..., n)`` behind the low-pass of moments, thinned."""
    from scipy.signal import butter, sosfiltfilt

    if rate_hz > 2.2 * MOMENT_HZ:
        rows = sosfiltfilt(butter(2, MOMENT_HZ, fs=rate_hz, output="sos"), rows, axis=-1)
    return np.asarray(rows[..., :: max(1, round(rate_hz / _COMPARED_HZ))])


def _thinned(record: MotorRecord, outputs: FloatArray, rates: FloatArray) -> MotorRecord:
    """A record for the fit of the band: thrusts or speeds in place of outputs, means over a few samples."""
    whole = MotorRecord(
        name=record.name,
        sample_rate_hz=record.sample_rate_hz,
        outputs=outputs,
        rates=rates,
        az=record.az,
        gyro_taps=record.gyro_taps,
        start_s=record.start_s,
        between="lines",
    )
    return _means(whole, _FITTED_HZ)


def _means(record: MotorRecord, rate_hz: float) -> MotorRecord:
    """A record at a lower rate, of means over its samples; as it is where filters are known at its own rate."""
    every = 1 if record.gyro_taps.size > 1 else max(1, int(record.sample_rate_hz / rate_hz))
    count = record.samples // every

    def mean(rows: FloatArray) -> FloatArray:
        return np.asarray(rows[..., : count * every].reshape(*rows.shape[:-1], count, every).mean(axis=-1))

    return MotorRecord(
        name=record.name,
        sample_rate_hz=record.sample_rate_hz / every,
        outputs=mean(record.outputs),
        rates=mean(record.rates),
        az=mean(record.az),
        gyro_taps=record.gyro_taps,
        start_s=record.start_s,
        between=record.between,
    )


def _shown(record: MotorRecord, levers: FloatArray, axes: Sequence[str]) -> MotorRecord:
    """A record up to the frequencies at which motors explain an axis.

    Above them, noise of measured speeds looks like torque that turns nothing, and whitened errors make much of it.
    """
    highest = SLOW_HZ
    for axis in axes:
        place = RATES.index(axis)
        found = octaves(record, levers[place], np.diff(record.rates[place]))
        highest = max([highest, *(one.band_hz[1] for one in found if one.counts)])
    return _means(record, _SAMPLES_A_CYCLE * highest)


def _free_rates(record: MotorRecord, inertia: FloatArray, known_nm: FloatArray) -> FloatArray:
    """Rates without what gyroscopic moments add, of a flat vehicle where inertia is not known, and known moments."""
    I_xx, I_yy, I_zz = inertia
    ratios = np.array([(I_yy - I_zz) / I_xx, (I_zz - I_xx) / I_yy, (I_xx - I_yy) / I_zz])
    ratios = np.where(np.isfinite(ratios), ratios, (-1.0, 1.0, 0.0))
    p, q, r = record.rates
    turned = ratios[:, None] * np.stack([q * r, p * r, p * q]) + np.nan_to_num(known_nm / inertia[:, None])
    return np.asarray(record.rates - np.cumsum(turned, axis=1) / record.sample_rate_hz)


def _in_band(
    record: MotorRecord, airframe: Airframe, moved: Motion, force: Mapping[str, float], known: Mapping[str, float]
) -> Alone:
    """Inertia of roll and pitch, and yaw torque over its inertia, in the octaves that show them.

    Moments of rotor drag are known with the forces, and are taken out before as far as inertia is known: yaw comes
    after roll and pitch, which come twice where rotors are above or below the center of gravity.
    """
    if record.between == "lines":
        # Noise of speeds would seem to turn nothing.
        moved = moved._replace(speeds=without_noise(moved.speeds, record.sample_rate_hz))
    levers, mass = _levers(airframe), {"m": airframe.mass_kg}
    air = rotor_air(airframe, moved.velocity, moved.rates, inflow_thrust(force, airframe, moved.speeds))
    thrust, side = rotor_thrusts(force, airframe, moved.speeds, air), _side_moments(force, airframe, moved, air)

    def prepared(outputs: FloatArray, values: Mapping[str, float]) -> MotorRecord:
        return _thinned(record, outputs, _free_rates(record, _matrix(values), side))

    values = {name: known[name] for name in ("I_xx", "I_yy", "I_zz") if name in known}
    turning = {name: value for name, value in values.items() if name != "I_zz"}
    for _ in range(2 if np.any(airframe.positions[:, 2]) else 1):
        by_thrust = prepared(thrust, values)
        tilting = _chain(by_thrust, levers, ("p", "q"), "linear", mass | {"c_1": 1.0} | turning)
        if tilting is not None:
            free = [name for name in ("I_xx", "I_yy") if name in tilting.parameters.free]
            values |= {name: tilting.parameters[name].value for name in free}
    flat = {"I_zz": values["I_xx"] + values["I_yy"]} if {"I_xx", "I_yy"} <= values.keys() else {}
    by_speed = prepared(moved.speeds, flat | values)
    # One gyro on one clock: yaw alone hardly shows how late it is, and takes that from the torque.
    late = {"tau_gyro": tilting.parameters["tau_gyro"].value} if tilting is not None else {}
    yawing = _chain(by_speed, levers, ("r",), "quadratic", mass | {"c_2": full_thrust(force)} | late)
    chains = tuple(chain for chain in (tilting, yawing) if chain is not None)
    found: dict[str, float] = {}
    stds: dict[str, float] = {}
    for chain in chains:
        names = [name for name in chain.moving if name in _SCATTER]
        found |= {name: chain.parameters[name].value for name in names}
        spread = np.sqrt(np.diag(np.linalg.pinv(chain.solution.jacobian.T @ chain.solution.jacobian, hermitian=True)))
        stds |= {name: float(spread[chain.parameters.free.index(name)]) for name in names}
    table = _table(by_thrust, levers, ("p", "q"), tilting) + _table(by_speed, levers, ("r",), yawing)
    return Alone(found, stds, chains[0].parameters["tau_gyro"].value if chains else None, chains, table)


_SCATTER = {"I_xx": "I_xx", "I_yy": "I_yy", "kappa_per_I_zz": "kappa", SPIN_UP: "J_r"}
"""Numbers of a record to those whose usual scatter between flights they have."""


def _mean(records: Sequence[Alone]) -> dict[str, float]:
    """Numbers of the vehicle: means over the records that show them.

    Flights differ by more than their errors say, so that each counts by its error and by the usual scatter together.
    """
    found = {}
    for name, usual in _SCATTER.items():
        shown = [one for one in records if name in one.values and one.values[name] > 0.0]
        if shown:
            values, stds = (np.array([getattr(one, what)[name] for one in shown]) for what in ("values", "stds"))
            scatter = FLIGHT_PARAMETERS[usual].scatter or 0.0
            weights = 1.0 / (stds**2 + (scatter * values) ** 2)
            found[name] = float(weights @ values / weights.sum())
    return found


def _octaves(records: Sequence[Alone]) -> tuple[Octave, ...]:
    """How far motors explain each axis in the record that shows most."""
    return tuple(
        here[0]._replace(correlation=max(one.correlation for one in here), kept=any(one.kept for one in here))
        for here in zip(*(one.octaves for one in records), strict=True)
    )


def _side_moments(force: Mapping[str, float], airframe: Airframe, moved: Motion, air: Air) -> FloatArray:
    """Moments that rotor drag makes about the center of gravity, N m, shape ``(3, n)``."""
    names = tuple(name for name in SIDE_TERMS if force.get(name, 0.0) != 0.0)
    made = flight_columns(names, airframe, moved.speeds, air, moved.velocity, moved.rates)
    return sum((force[name] * made[name].moment for name in names), start=np.zeros_like(moved.rates))


def _chain(
    record: MotorRecord, levers: FloatArray, wanted: tuple[str, ...], curve: Curve, known: Mapping[str, float]
) -> MotorFit | None:
    """The fit of some axes in the octaves that show them; ``None`` where none does."""
    yaw = "r" in wanted
    axes = tuple(axis for axis in excited_axes(excitations([record], levers, spin_up=yaw)) if axis in wanted)
    if not axes or record.samples < LEAST_SAMPLES:
        return None
    unseen = {INERTIA[axis] for axis in wanted if axis not in axes}
    held = {name: value for name, value in known.items() if name not in unseen}
    parameters = motor_parameters(
        curve=curve, known=held, axes=axes, lag=False, heave_damping=False, earliest_s=_EARLIEST_S, spin_up=yaw
    )
    # The spin-up of rotors turns the nose faster than their torque does, up to where differences of speeds are noise.
    shown = _means(record, _SAMPLES_A_CYCLE * _YAW_HZ) if yaw else _shown(record, levers, axes)
    # With fewer samples an axis may be shown no longer.
    still = set(axes) <= set(excited_axes(excitations([shown], levers, spin_up=yaw)))
    used = shown if still and shown.samples >= LEAST_SAMPLES else record
    return fit_motors(MotorProblem(records=(used,), levers=levers, parameters=parameters, axes=axes))


def _table(
    record: MotorRecord, levers: FloatArray, axes: tuple[str, ...], chain: MotorFit | None
) -> tuple[Octave, ...]:
    rows = []
    for axis in axes:
        place = RATES.index(axis)
        shown = chain.excitations[0][axis] if chain is not None else None
        for here in octaves(record, levers[place], np.diff(record.rates[place]), spin_up=axis == "r"):
            low, high = here.band_hz
            kept = shown is not None and shown.counts and shown.band_hz[0] < high and low < shown.band_hz[1]
            rows.append(Octave(axis, low, high, here.correlation, kept))
    return tuple(rows)


def _yaw(shown: Mapping[str, float], values: Mapping[str, float], known: Mapping[str, float]) -> dict[str, float]:
    """Inertia, torque by thrust and rotor inertia of yaw, from their ratios and the one that is known."""
    ratio = shown.get("kappa_per_I_zz", 0.0)
    if ratio <= 0.0:
        return {}
    found = {}
    if "I_zz" not in known and "kappa" in known:
        found["I_zz"] = known["kappa"] / ratio
    inertia = found.get("I_zz", values.get("I_zz"))
    if inertia is None:
        return found
    if "kappa" not in known:
        found["kappa"] = ratio * inertia
    if "J_r" not in known and SPIN_UP in shown:
        found["J_r"] = shown[SPIN_UP] * inertia
    return found


def _why_not(axis: str, table: Sequence[Octave]) -> str:
    best = max((one for one in table if one.axis == axis), key=lambda one: one.correlation)
    return (
        f"motors and motion correlate by {best.correlation:.2f} at best, from {best.low_hz:g} to {best.high_hz:g} Hz; "
        f"{LEAST_CORRELATION:g} over two neighboring octaves together is needed"
    )


class _Rows(NamedTuple):
    """One record: what motors and inertia leave as moment, and what each moment of the air makes at one, ``(3, k)``."""

    left: FloatArray
    columns: Mapping[str, FloatArray]
    motors: FloatArray


def _rows(record: MotorRecord, moved: Motion, airframe: Airframe, values: Mapping[str, float], delay_s: float) -> _Rows:
    plain = {name: value for name, value in values.items() if name not in AIR_TERMS}
    left = moment_error(plain, airframe, record, moved, delay_s=delay_s)
    air = rotor_air(airframe, moved.velocity, moved.rates, inflow_thrust(values, airframe, moved.speeds))
    made = flight_columns(HUB_TERMS, airframe, moved.speeds, air, moved.velocity, moved.rates)
    columns = {name: column.moment for name, column in made.items()}
    up = rotor_thrusts(values, airframe, moved.speeds, air).sum(axis=0)
    sides = flight_columns(SIDE_TERMS, airframe, moved.speeds, air, moved.velocity, moved.rates)
    of_rotors = sum((values.get(name, 0.0) * one.force for name, one in sides.items()), start=np.zeros((3, up.size)))
    of_rotors[2] -= up
    columns |= center_columns(of_rotors)
    late = np.stack([_late(rows, delay_s * record.sample_rate_hz) for rows in columns.values()])
    thinned = _compared(late, record.sample_rate_hz)
    turned = _matrix(values)
    bare = _compared(turned[:, None] * moved.acceleration + _gyroscopic(turned, moved.rates), record.sample_rate_hz)
    return _Rows(left, dict(zip(columns, thinned, strict=True)), bare - left)


def _solved(rows: Sequence[_Rows], names: Sequence[str], axes: Sequence[int]) -> FloatArray:
    """Coefficients of least squares, each axis in units of what it leaves."""
    left = np.concatenate([row.left[axes] for row in rows], axis=1)
    columns = np.concatenate([np.stack([row.columns[name][axes] for name in names]) for row in rows], axis=2)
    weights, found = np.ones(len(axes)), np.zeros(len(names))
    for _ in range(_ROUNDS):
        slopes = (columns * weights[:, None]).reshape(len(names), -1)
        size = np.maximum(np.linalg.norm(slopes, axis=1), 1e-300)
        found = np.linalg.lstsq((slopes / size[:, None]).T, (left * weights[:, None]).ravel(), rcond=1e-10)[0] / size
        rest = left - np.tensordot(found, columns, axes=1)
        weights = 1.0 / np.maximum(np.sqrt(np.mean(rest**2, axis=1)), 1e-300)
    return found


def _rest(row: _Rows, names: Sequence[str], found: FloatArray) -> FloatArray:
    if not names:
        return row.left
    return np.asarray(row.left - np.tensordot(found, np.stack([row.columns[name] for name in names]), axes=1))


def _folds(rows: Sequence[_Rows]) -> list[tuple[list[_Rows], _Rows]]:
    """What is fitted and what is judged: flights, or thirds of one."""
    parts = list(rows)
    if len(parts) == 1:
        edges = np.linspace(0, parts[0].left.shape[1], _FOLDS + 1).astype(int)
        cut = [slice(*ends) for ends in pairwise(edges.tolist())]
        parts = [
            _Rows(
                rows[0].left[:, part],
                {name: column[:, part] for name, column in rows[0].columns.items()},
                rows[0].motors[:, part],
            )
            for part in cut
        ]
    return [([other for other in parts if other is not part], part) for part in parts]


def _judged(rows: Sequence[_Rows], names: Sequence[str], axes: Sequence[int]) -> FloatArray:
    """Mean square of the error of moment of each part that was not fitted, N² m², by its share of the samples.

    Shape ``(parts, blocks)``, whose sum is that of all.
    """
    squares, samples = [], sum(row.left.shape[1] for row in rows)
    for fitted, judged in _folds(rows):
        found = _solved(fitted, names, axes) if names else np.zeros(0)
        left = (_rest(judged, names, found)[axes] ** 2).sum(axis=0) / samples
        squares.append([float(block.sum()) for block in np.array_split(left, _BLOCKS)])
    return np.array(squares)


def _gains(before: FloatArray, after: FloatArray, *, flights: int) -> bool:
    """Whether a gain is none of the wildest flight alone, or, of one flight, beyond what its blocks differ by."""
    if flights > 1:
        return bool(np.all(after.sum(axis=1) <= before.sum(axis=1)))
    gain = (before - after).ravel()
    shown = float(gain.mean()) > _SHOWN * float(gain.std(ddof=1)) / np.sqrt(gain.size)
    return shown and bool(np.all(after.sum(axis=1) <= before.sum(axis=1)))


def _climbed(
    rows: Sequence[_Rows],
    axes: Sequence[int],
    choices: MomentChoices,
    missing: dict[str, str],
    hidden: Mapping[str, str],
) -> tuple[dict[str, float], tuple[MomentRung, ...]]:
    """Moments of the air that make data better which were not fitted, and what was tried."""
    known = {name: choices.known[name] for name in AIR_TERMS if name in choices.known}
    for name, value in known.items():
        rows = [row._replace(left=row.left - value * row.columns[name]) for row in rows]
    names: list[str] = []
    ladder: list[MomentRung] = []
    before = _judged(rows, names, axes)
    for terms in LADDER:
        tried = [name for name in terms if name not in known and (choices.terms is None or name in choices.terms)]
        if not tried or not any(_acts(rows, name, axes) for name in tried):
            continue
        if hidden.keys() & set(tried):
            missing |= {name: hidden[name] for name in tried if name != "z_cg"}
            continue
        if "m_fx" in tried and "m_f" not in {*names, *known}:
            continue
        if not choices.airspeed and {"x_cg", "z_cg"} & set(tried):
            # Steady airspeed is lost, whose hub moment is steady too.
            missing |= dict.fromkeys(tried, "steady airspeed is not known, whose moment looks alike")
            continue
        after = _judged(rows, [*names, *tried], axes)
        rms, rms_after = float(np.sqrt(before.sum())), float(np.sqrt(after.sum()))
        entered = rms_after < (1.0 - choices.least_gain) * rms and _gains(before, after, flights=len(rows))
        fewer = [*names, *tried]
        if entered and "z_cg" in tried:
            fewer = _without_superfluous(rows, fewer, axes, choices.least_gain)
            after = _judged(rows, fewer, axes)
            entered = float(after.sum()) < float(before.sum())
        entered = entered and not _tilts_forward(rows, fewer, axes)
        ladder.append(MomentRung(tuple(tried), rms, float(np.sqrt(after.sum())), entered))
        if entered:
            names, before = fewer, after
            ladder = [rung._replace(entered=rung.entered and set(rung.terms) <= set(names)) for rung in ladder]
    found = _solved(rows, names, axes) if names else np.zeros(0)
    return known | dict(zip(names, map(float, found), strict=True)), tuple(ladder)


def _without_superfluous(rows: Sequence[_Rows], names: list[str], axes: Sequence[int], least_gain: float) -> list[str]:
    """Terms without what drag of high rotors has made superfluous."""
    for terms in _LIKE_HEIGHT:
        fewer = [name for name in names if name not in terms]
        # What forward flight adds has to be added to something.
        if fewer == names or ("m_fx" in fewer and "m_f" not in fewer):
            continue
        rms, rms_without = (float(np.sqrt(_judged(rows, some, axes).sum())) for some in (names, fewer))
        forward = "m_f" in terms and _tilts_forward(rows, names, axes)
        if forward or rms >= (1.0 - least_gain) * rms_without:
            names = fewer
    return names


def _tilts_forward(rows: Sequence[_Rows], names: Sequence[str], axes: Sequence[int]) -> bool:
    """Whether ``m_f`` would be negative, as it is of no rotor, but of drag that acts elsewhere than assumed."""
    return "m_f" in names and float(_solved(rows, names, axes)[list(names).index("m_f")]) < 0.0


def _acts(rows: Sequence[_Rows], name: str, axes: Sequence[int]) -> bool:
    return any(bool(np.any(row.columns[name][axes])) for row in rows)


def _predictor(rows: Sequence[_Rows], axes: Sequence[int]) -> dict[str, float]:
    """Everything free over all frequencies: the share of the motors' moments that shows, and all moments of the air."""
    # Height of the rotors and the skewed wake predict alike.
    names = [name for name in AIR_TERMS if name != "z_cg" and _acts(rows, name, axes)]
    gains = [GAINS[place] for place in axes]
    freed = []
    for row in rows:
        columns = dict(row.columns)
        for place in axes:
            columns[GAINS[place]] = np.zeros_like(row.motors)
            columns[GAINS[place]][place] = row.motors[place]
        freed.append(row._replace(left=row.left + row.motors, columns=columns))
    names = [*gains, *names]
    return dict(zip(names, map(float, _solved(freed, names, axes)), strict=True))
