r"""Errors of the physics of flight: within flights, and between flights.

Within a flight, errors are colored and the structure leaves much: the sandwich of blocks of 2 s
(:func:`rotorid.uncertainty.sandwich.by_blocks`), equation by equation. Inertia comes from whitened equations of its
band, moments of the air from all frequencies with inertia held.

Flights of one vehicle still differ by more: by :math:`\tau`, of which experience says how large it usually is
(``scatter`` of :data:`~rotorid.models.flight.FLIGHT_PARAMETERS`), and the flights of this fit say how large it is here
(DerSimonian and Laird, :func:`~rotorid.uncertainty.next_flight.random_effects_mean`). Each counts by its degrees of
freedom, five for the usual scatter, which six flights gave:

.. math::

    \tau^2 = \frac{5 \tau_0^2 + (n - 1) \tau_{DL}^2}{5 + n - 1}, \qquad
    \pm \sqrt{t^2 \tau^2 / n + z^2 (s^2 + b^2)}, \qquad
    \pm \sqrt{t^2 (\tau^2 + \tau^2 / n) + z^2 (s^2 + s_{new}^2 + (b - b_{new})^2)}

is where the number of the vehicle lies, and that of another flight alone, with Student's :math:`t_{5 + n - 1}` of what
few flights say, and :math:`z = 1.96` of what many blocks say. What motors do not explain of an axis, b, acts alike in
all flights: it moves each as far as it is there, and no scatter shows it. Where a flight does not show a number, it is
held as all together show it, so that flights compare. A single flight has the usual scatter, a stated assumption.
Thrust without inflow and what inflow takes trade: what scatters on its own is thrust in hover, by
2 %, and c_2 follows from it and from what inflow takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import stdtrit

from rotorid.data.quantity import TWO_SIDED_95
from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fitting.flight.fit import (
    FlightChoices,
    FlightErrors,
    FlightFit,
    fit_flight,
    predicted_force,
)
from rotorid.fitting.flight.force import PLACE, whitening
from rotorid.fitting.flight.ladder import USUAL_BEND, USUAL_REST
from rotorid.fitting.flight.moment import AIR_TERMS, MOMENT_NUMBERS, moment_error
from rotorid.fitting.flight.motion import motion
from rotorid.fitting.motors.fit import MotorFit
from rotorid.fitting.problem import Part
from rotorid.models.flight import CURVE_TERMS, FLIGHT_PARAMETERS, FORCE_TERMS, INERTIA, full_thrust, speeds_of_outputs
from rotorid.models.motors import SPIN_UP
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_covariance
from rotorid.uncertainty.next_flight import random_effects_mean
from rotorid.uncertainty.sandwich import by_bands, by_blocks

USUAL_FREEDOM = 5.0
"""Degrees of freedom of the usual scatter: six flights of one vehicle gave it."""

_UNKNOWN_SHARE = 1.0
"""Of a number of which nobody knows how flights differ: its size."""

HOVER_SCATTER, _AGAINST = 0.02, -0.9
"""Scatter of thrust in hover between flights, and its correlation with that of what inflow takes: three flights of a
racing quadrotor to 2.4 g differ by 1.9 % and by 11 %, correlated by -0.97, and their slopes in hover by 1.0 %."""

_HELD = frozenset((*FORCE_TERMS, *PLACE, *AIR_TERMS)) - {*CURVE_TERMS}
"""Numbers that a flight may not show, and that those which it shows depend on."""

_HOVER = "hover"
_FEWEST = 2
_THINNED_HZ = 50.0
_STEP = 1e-4
_LEAST_STEPS: Mapping[str, float] = {"s": 1e-3, "m": 1e-4, "m/s": 1e-2}


class OneFlight(NamedTuple):
    """Numbers that one flight shows alone, their deviations within it, and what acts alike in all flights.

    Parameters
    ----------
    values, stds
        By name.
    shared
        By name, rows as of ``FlightErrors.shared``.
    """

    values: Mapping[str, float]
    stds: Mapping[str, float]
    shared: Mapping[str, FloatArray]


class _Within(NamedTuple):
    """Covariance of random errors within flights, ``(p, p)``, and deviations of what acts alike in all, ``(p, 2)``."""

    random: FloatArray
    shared: FloatArray

    @property
    def covariance(self) -> FloatArray:
        return np.asarray(self.random + self.shared @ self.shared.T)


def with_errors(fit: FlightFit, records: Sequence[MotorRecord], choices: FlightChoices | None = None) -> FlightFit:
    """A fit with the errors of its numbers.

    Parameters
    ----------
    fit
        Of :func:`rotorid.fitting.flight.fit.fit_flight`.
    records
        The flights that were fitted.
    choices
        As for the fit: several flights are fitted alone too.
    """
    records = tuple(records)
    names = tuple(name for name in fit.free if name in fit.values)
    within = _within(fit, records, names)
    random = within.covariance
    alone = flights_alone(fit, records, choices or FlightChoices())
    total = random.copy()
    measured = False
    spread, between = np.zeros(len(names)), np.zeros(len(names))
    alike = [name for name in names if name not in CURVE_TERMS]
    for name in (*alike, *([_HOVER] if len(alike) < len(names) else ())):
        value = fit.hover.coefficient if name == _HOVER else fit.values[name]
        usual = HOVER_SCATTER * value if name == _HOVER else usual_scatter(name, value)
        shown = [one for one in alone if name in one.values]
        known = [one.stds[name] for one in shown]
        scatter, count = usual, max(len(shown), 1)
        if len(shown) > 1:
            values = np.array([one.values[name] for one in shown])
            scatter = pooled_scatter(usual, values, np.array(known))
            measured = True
        freedom = USUAL_FREEDOM + count - 1.0
        factor = float(stdtrit(freedom, 0.975)) / TWO_SIDED_95
        places = [k for k, one in enumerate(names) if (one in CURVE_TERMS if name == _HOVER else one == name)]
        between[places] = factor * scatter
        spread[places] = between[places] / np.sqrt(count)
    mixed = _mixed(fit, names)
    total += _scattered(mixed, spread, names)
    between = np.sqrt(_scattered(mixed, between, names).diagonal())
    # Squares of deviations, so that saved ones give them back to the last digit.
    np.fill_diagonal(total, np.sqrt(total.diagonal()) ** 2)
    how = "flights" if measured else "assumed"
    errors = FlightErrors(names=names, covariance=total, random=random, how=how, scatter=between, shared=within.shared)
    return replace(fit, errors=errors)


def pooled_scatter(usual: float, values: FloatArray, stds: FloatArray) -> float:
    """Scatter between flights, of experience and of what these flights show.

    Examples
    --------
    >>> round(pooled_scatter(1.0, np.array([1.0, 5.0]), np.array([0.1, 0.1])), 2)
    1.47
    """
    _, _, here = random_effects_mean(values, stds)
    more = values.size - 1.0
    return float(np.sqrt((USUAL_FREEDOM * usual**2 + more * here**2) / (USUAL_FREEDOM + more)))


def usual_scatter(name: str, value: float) -> float:
    """By how much a number usually differs between flights of one vehicle; its size where nobody knows."""
    about = FLIGHT_PARAMETERS[name]
    share = _UNKNOWN_SHARE if about.scatter is None else about.scatter
    return share if about.absolute else share * abs(value)


def flights_alone(
    fit: FlightFit, records: Sequence[MotorRecord], choices: FlightChoices, *, fewest: int = _FEWEST
) -> tuple[OneFlight, ...]:
    """What each flight shows alone, with the terms of all; stretches of one log are one flight.

    Terms that it does not show are held as all together show them: without them, the others would be other numbers.
    Flights that show nothing are left out, and so are numbers that end on a bound.
    """
    flights: dict[str, list[int]] = {}
    for place, record in enumerate(records):
        flights.setdefault(record.name, []).append(place)
    if len(flights) < fewest:
        return ()
    found = []
    for places in flights.values():
        own = replace(
            choices,
            terms=fit.entered,
            velocity=fit.velocity,
            cutoff_hz=choices.cutoff_hz or fit.cutoff_hz,
            skews_s=tuple(float(fit.skews_s[place]) for place in places),
            predictor=False,
        )
        stretches = [records[place] for place in places]
        try:
            alone = fit_flight(stretches, fit.airframe, own)
            hidden = {name: fit.values[name] for name in fit.free if name in _HELD and name not in alone.free}
            if hidden:
                alone = fit_flight(stretches, fit.airframe, replace(own, values={**own.values, **hidden}))
        except (InsufficientDataError, ModelError):
            continue
        shown = (name for name in alone.free if name in fit.free and name not in alone.missing)
        names = tuple(name for name in shown if alone.values.get(name, 0.0) != 0.0)
        within = _within(alone, stretches, names)
        stds = np.sqrt(np.maximum(within.random.diagonal(), 0.0))
        found.append(
            OneFlight(
                {**{name: alone.values[name] for name in names}, _HOVER: alone.hover.coefficient},
                {**{name: float(std) for name, std in zip(names, stds, strict=True)}, _HOVER: 0.0},
                dict(zip(names, within.shared, strict=True)),
            )
        )
    return tuple(found)


def _scattered(mixed: FloatArray, deviations: FloatArray, names: Sequence[str]) -> FloatArray:
    """Covariance between flights, of deviations of thrust in hover (once for the curve) and of each other number."""
    found = np.diag(deviations**2)
    curve = [place for place, name in enumerate(names) if name in CURVE_TERMS]
    found[np.ix_(curve, curve)] = np.outer(deviations[curve], deviations[curve])
    if "c_lambda" in names:
        place = list(names).index("c_lambda")
        found[curve, place] = found[place, curve] = _AGAINST * deviations[curve] * deviations[place]
    return np.asarray(mixed @ found @ mixed.T)


def _mixed(fit: FlightFit, names: Sequence[str]) -> FloatArray:
    """How numbers move with thrust in hover and with what inflow takes, shape ``(p, p)``: the curve keeps its shape."""
    found = np.eye(len(names))
    full = full_thrust(fit.values)
    for place, name in enumerate(names):
        if name in CURVE_TERMS:
            found[place, place] = fit.values[name] / full
            if "c_lambda" in names:
                lost = fit.hover.induced_m_s / fit.hover.speed
                found[place, list(names).index("c_lambda")] = found[place, place] * lost
    return found


def _within(fit: FlightFit, records: Sequence[MotorRecord], names: Sequence[str]) -> _Within:
    """Errors within flights: forces, each band, and moments of the air, one after the other.

    Each holds what the ones before found, and errs with it: inertia with thrust, moments of the air with thrust, drag,
    winds and inertia.
    """
    by_turning = _band_stds(fit)
    force = [name for name in names if name not in MOMENT_NUMBERS and name not in by_turning]
    air = [name for name in names if name in AIR_TERMS]
    blown = [place for place, wind in enumerate(fit.winds) if np.isfinite(wind).all()]
    size = len(names) + 2 * len(blown)
    found, shared = np.zeros((size, size)), np.zeros((size, len(_TILTING)))
    if force:
        places = [*(names.index(name) for name in force), *range(len(names), size)]
        found[np.ix_(places, places)] = covariance(_force_parts(fit, records, force, blown))
    found = _followed(found, _by_thrust(fit, records, names))
    for name, std in by_turning.items():
        if name in names:
            found[names.index(name), names.index(name)] += std**2
    for column, (name, axis) in enumerate(_TILTING.items()):
        if name in by_turning and name in names:
            # What motors do not explain of an axis may be an error of either side: of their torque, or of the motion.
            left = [1.0 - octave.correlation**2 for octave in fit.octaves if octave.axis == axis and octave.kept]
            shared[names.index(name), column] = fit.values[name] * float(np.mean(left)) if left else 0.0
    if air:
        parts = _air_parts(fit, records, names, blown)
        places = [names.index(name) for name in air]
        own = [part._replace(slopes=part.slopes[..., places]) for part in parts]
        by_held = _by_held(parts, places)
        found, shared = _followed(found, by_held), shared + by_held @ shared
        found[np.ix_(places, places)] += covariance(own)
    return _Within(found[: len(names), : len(names)], shared[: len(names)])


def covariance(parts: Sequence[Part]) -> FloatArray:
    """Covariance of colored errors, with the larger variance of each number where parts of the data pull harder.

    Gusts last longer than a block of time, and as far as a controller answers them, what is slow pulls otherwise than
    what is fast: of blocks, bands and colored errors none says all.

    Parameters
    ----------
    parts
        Errors and slopes of records; of a single row, what was known before.
    """
    longer = [part for part in parts if len(part.residual) > 1]
    pulled = by_blocks(parts)
    try:
        found = colored_covariance(parts).corrected
    except (InsufficientDataError, np.linalg.LinAlgError):
        # A number without effect, which blocks leave at zero.
        return pulled
    larger = np.maximum(pulled.diagonal(), by_bands(longer).diagonal())
    factor = np.sqrt(np.maximum(larger / found.diagonal(), 1.0))
    return np.asarray(found * np.outer(factor, factor))


def _followed(found: FloatArray, slopes: FloatArray) -> FloatArray:
    """A covariance after numbers that hold others move with them, by slopes ``(p, p)`` of no further numbers."""
    moved = np.zeros_like(found)
    moved[: slopes.shape[0], : slopes.shape[1]] = slopes
    return np.asarray(found + moved @ found @ moved.T + moved @ found + found @ moved.T)


def _by_held(parts: Sequence[Part], places: Sequence[int]) -> FloatArray:
    """Slopes of the numbers of some places, found by least squares, by all others, which are held, ``(p, p)``."""
    slopes = np.concatenate([part.slopes.reshape(-1, part.slopes.shape[2]) for part in parts])
    own, found = slopes[:, places], np.zeros((slopes.shape[1], slopes.shape[1]))
    found[places] = -np.linalg.lstsq(own, slopes, rcond=None)[0]
    found[:, places] = 0.0
    return found


_TILTING: Mapping[str, str] = {"I_xx": "p", "I_yy": "q"}

_BY_GAIN: Mapping[str, Literal["lifted", "static", "speed"]] = {
    "I_xx": "lifted",
    "I_yy": "lifted",
    "kappa": "static",
    "J_r": "speed",
}
"""Numbers of moments to what of a rotor changes with its output as they do, upright or, of kappa and J_r, inversely."""


def _by_thrust(fit: FlightFit, records: Sequence[MotorRecord], names: Sequence[str]) -> FloatArray:
    """Slopes of inertia, ``kappa`` and ``J_r`` by numbers of thrust, which their fit holds, shape ``(p, p)``."""
    level = float(np.mean([record.outputs.mean() for record in records]))
    measured = all(record.between == "lines" for record in records)
    found = np.zeros((len(names), len(names)))
    here = _gains(fit.values, fit, level, measured=measured)
    for column, name in enumerate(names):
        if name not in ("c_0", "c_1", "c_2", "c_lambda"):
            continue
        value = fit.values[name]
        step = _STEP * max(abs(value), 1e-3 * full_thrust(fit.values))
        there = _gains({**fit.values, name: value + step}, fit, level, measured=measured)
        for row, other in enumerate(names):
            if other in _BY_GAIN:
                share = (there[_BY_GAIN[other]] / here[_BY_GAIN[other]] - 1.0) / step
                found[row, column] = fit.values[other] * (share if _BY_GAIN[other] == "lifted" else -share)
    return found


def _gains(values: Mapping[str, float], fit: FlightFit, level: float, *, measured: bool) -> dict[str, float]:
    """Changes of lift, of thrust without inflow, and of speed with the output of a rotor."""
    levels = level * np.array([1.0 - _STEP, 1.0 + _STEP])
    speeds = levels if measured else speeds_of_outputs(values, levels)
    static = full_thrust(values) * speeds**2
    lifted = static - values.get("c_lambda", 0.0) * fit.hover.induced_m_s * speeds
    return {name: float(np.diff(rows)[0]) for name, rows in (("lifted", lifted), ("static", static), ("speed", speeds))}


def _force_parts(
    fit: FlightFit, records: Sequence[MotorRecord], names: Sequence[str], blown: Sequence[int]
) -> list[Part]:
    """Errors of specific force over their size, and their slopes, axes together, by winds of records at the end."""
    parts = []
    for place, (record, skew_s) in enumerate(zip(records, fit.skews_s.tolist(), strict=True)):
        every = max(1, round(record.sample_rate_hz / _THINNED_HZ))

        def left(
            values: Mapping[str, float],
            record: MotorRecord = record,
            wind: FloatArray = fit.winds[place],
            skew_s: float = skew_s,
            every: int = every,
        ) -> FloatArray:
            driven = motion(record, values, kind=fit.velocity, wind=wind + _more_wind(values), skew_s=skew_s)
            made = predicted_force(values, fit.airframe, record, driven, fit.cutoff_hz)
            return np.asarray((made - record.force)[:, ::every])

        part = _part(left, fit.values, names, record.sample_rate_hz / every, place, blown)
        parts.append(_whitened(part) if "c_1" in names else part)
    size = max(float(np.sqrt(np.mean(np.concatenate([part.residual.ravel() for part in parts]) ** 2))), 1e-12)
    parts = [part._replace(residual=part.residual / size, slopes=part.slopes / size) for part in parts]
    return [*parts, *_curve_parts(fit, records, names, parts)]


def _whitened(part: Part) -> Part:
    """Errors and slopes as the fit of a curve of outputs weighs them."""
    samples = len(part.residual)
    left = np.fft.rfft(part.residual, axis=0)
    hz = np.asarray(np.fft.rfftfreq(samples, 1.0 / part.sample_rate_hz), dtype=np.float64)
    weights = whitening(left.T, hz).T
    slopes = np.fft.rfft(part.slopes, axis=0) * weights[..., None]
    return part._replace(
        residual=np.fft.irfft(left * weights, samples, axis=0), slopes=np.fft.irfft(slopes, samples, axis=0)
    )


def _curve_parts(
    fit: FlightFit, records: Sequence[MotorRecord], names: Sequence[str], parts: Sequence[Part]
) -> list[Part]:
    """What the fit takes as usual of a curve of outputs, each as one error of its usual size, or of that found."""
    if not set(CURVE_TERMS) <= set(names):
        return []
    level = float(np.mean([record.outputs.mean() for record in records]))
    powers = level ** np.arange(3.0)
    thrust = float(sum(fit.values[name] * power for name, power in zip(CURVE_TERMS, powers, strict=True)))
    places = [list(names).index(name) for name in CURVE_TERMS]
    found = []
    for count, usual in ((1, USUAL_REST), (2, USUAL_BEND)):
        slopes = np.zeros((1, 3, parts[0].slopes.shape[2]))
        slopes[0, 0, places[:count]] = powers[:count] / (usual * thrust)
        residual = np.zeros((1, 3))
        # No curve has a constant part by itself, so that one is the error of what is usual; of a line some have all.
        here = abs(fit.values["c_0"]) / (usual * thrust) if count == 1 else 1.0
        residual[0, 0] = max(1.0, here)
        found.append(Part(residual, slopes, np.zeros((1, 3, 0)), parts[0].sample_rate_hz))
    return found


_WINDS = ("wind_north", "wind_east")


def _more_wind(values: Mapping[str, float]) -> FloatArray:
    return np.array([values.get(name, 0.0) for name in _WINDS])


def _air_parts(
    fit: FlightFit, records: Sequence[MotorRecord], names: Sequence[str], blown: Sequence[int]
) -> list[Part]:
    """Errors of moment and their slopes by all numbers, axes together, by winds of records at the end."""
    delays = fit.moments.delays_s.tolist() if fit.moments is not None else [0.0] * len(records)
    inertia = [fit.values.get(name, np.nan) for name in INERTIA.values()]
    parts = []
    for place, (record, delay_s) in enumerate(zip(records, delays, strict=True)):

        def left(
            values: Mapping[str, float],
            record: MotorRecord = record,
            wind: FloatArray = fit.winds[place],
            skew_s: float = float(fit.skews_s[place]),
            delay_s: float = delay_s,
        ) -> FloatArray:
            driven = motion(record, values, kind=fit.velocity, wind=wind + _more_wind(values), skew_s=skew_s)
            # An axis without inertia counts for nothing.
            return np.nan_to_num(moment_error(values, fit.airframe, record, driven, delay_s=delay_s, inertia=inertia))

        rate_hz = left(fit.values).shape[1] / record.duration_s
        parts.append(_part(left, fit.values, names, rate_hz, place, blown))
    return parts


def _part(
    left: Callable[[Mapping[str, float]], FloatArray],
    values: Mapping[str, float],
    names: Sequence[str],
    rate_hz: float,
    place: int,
    blown: Sequence[int],
) -> Part:
    """Errors ``(n, 3)`` of a record and their slopes by numbers and by winds of records, from small steps."""
    here = left(values)
    slopes = np.zeros((here.shape[1], 3, len(names) + 2 * len(blown)))
    own = _WINDS if place in blown else ()
    first = len(names) + 2 * blown.index(place) if own else 0
    for column, name in [*enumerate(names), *enumerate(own, first)]:
        value = values.get(name, 0.0)
        unit = FLIGHT_PARAMETERS[name].unit if name in FLIGHT_PARAMETERS else "m/s"
        step = max(_STEP * abs(value), _LEAST_STEPS.get(unit, 1e-12))
        slopes[:, :, column] = ((left({**values, name: value + step}) - here) / step).T
    return Part(here.T, slopes, np.zeros((here.shape[1], 3, 0)), rate_hz)


def _band_stds(fit: FlightFit) -> dict[str, float]:
    """Deviations of lag, inertia and what yaw shows, within flights: means of flights, each by blocks."""
    shown = {} if fit.lag is None else _variances(fit.lag)
    lag = {"T_motor": float(np.sqrt(shown["T_motor"]))} if "T_motor" in shown else {}
    if fit.moments is None:
        return lag
    variances: dict[str, list[float]] = {}
    for alone in fit.moments.alone:
        late = 0.0
        for chain in alone.chains:
            own = _variances(chain, late)
            late = own.get("tau_gyro", 0.0)
            for name, variance in own.items():
                variances.setdefault(name, []).append(variance)
    stds = {name: float(np.sqrt(sum(each)) / len(each)) for name, each in variances.items()}
    inertia = fit.values.get("I_zz", 0.0)
    found = lag | {name: stds[name] for name in _TILTING if name in stds}
    if SPIN_UP in stds:
        found["J_r"] = stds[SPIN_UP] * inertia
    if "kappa_per_I_zz" in stds:
        found["kappa"] = stds["kappa_per_I_zz"] * inertia
        if "kappa" in fit.values and inertia:
            found["I_zz"] = stds["kappa_per_I_zz"] * inertia**2 / fit.values["kappa"]
    return found


def _variances(chain: MotorFit, late_s2: float = 0.0) -> dict[str, float]:
    """Variance of each number of a fit of some axes, by blocks of time or by bands of frequency, the larger.

    Parameters
    ----------
    late_s2
        Variance of the delay of the gyro, where the fit holds it.
    """
    rate_hz = chain.problem.records[0].sample_rate_hz
    parts = [part._replace(sample_rate_hz=rate_hz) for part in chain.parts()]
    found = np.maximum(by_blocks(parts).diagonal(), by_bands(parts).diagonal())
    if late_s2 and chain.problem.parameters["tau_gyro"].status == "fixed":
        freed = chain.parameters.free_again("tau_gyro")
        every = replace(chain.problem, parameters=freed).parts(freed.pack())
        names = [*chain.moving, "tau_gyro"]
        places = [freed.free.index(name) for name in names]
        parts = [part._replace(slopes=part.slopes[..., places]) for part in every]
        found = found + _by_held(parts, [*range(len(names) - 1)])[:-1, -1] ** 2 * late_s2
    return dict(zip(chain.moving, found.tolist(), strict=True))
