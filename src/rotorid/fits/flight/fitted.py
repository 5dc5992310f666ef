"""A vehicle as its flights show it: parameters with bounds, what was predicted, and the same as a linear model.

That model leads from motors to rates and specific force about hover in still air, as that of ``physical.motors`` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.fits.flight.hover import flight_units, hover_numbers, hover_structure
from rotorid.fitting.flight.fit import FlightFit, predicted_force
from rotorid.fitting.flight.motion import motion
from rotorid.fitting.motors.excitation import SLOW_BAND_HZ, in_band
from rotorid.flights.flight_data import FlightMotion
from rotorid.flights.motor_data import MotorFlight
from rotorid.models.flight import CURVE_TERMS, FLIGHT_PARAMETERS, full_thrust
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import SimulatedRecord
from rotorid.results.summary import Derived, DragPoint
from rotorid.signal.kinematics import ACCELERATIONS
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.flight_error import usual_scatter
from rotorid.verification.verification import Scores

_ASSUMED_SHARE = 0.5
"""Standard deviation of a usual number that is assumed, as a share of it: what inflow takes, and the lag of motors."""

_FLATNESS_SHARE = 0.12
"""The same of the inertia of yaw where that of a flat vehicle is assumed: eight of ten vehicles have 0.83 to 1 of it,
two have 0.6."""

_OF_YAW = ("I_zz", "kappa", "J_r")
"""Numbers that are in proportion to the inertia of yaw."""

_MOVED_M_S2 = 0.5
"""Standard deviation of a slow specific force from which a flight shows what the model makes of it."""


class Predicted(NamedTuple):
    """Specific force of a stretch as measured and as the model makes it, behind the sensor's filter.

    Parameters
    ----------
    flight
        The stretch.
    measured, modeled
        m/s², shape ``(3, n)``.
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    """

    flight: MotorFlight
    measured: FloatArray
    modeled: FloatArray
    velocity: FloatArray
    speeds: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedFlight(Immutable):
    """The physics of a vehicle that its flights determine.

    Parameters
    ----------
    data
        What was flown.
    fit
        How it ended.
    parameters
        The identified values with their units, and what was known.
    bounds
        Their uncertainty.
    by_tilt
        Drag over mass, 1/s, where it is from the tilt as instrument; the flights were too slow for a plain fit.
    """

    data: FlightMotion
    fit: FlightFit
    parameters: ParameterSet
    bounds: Bounds
    by_tilt: Quantity | None = None

    @property
    def listed(self) -> ParameterSet:
        """All parameters."""
        return self.parameters

    @property
    def assumed(self) -> tuple[str, ...]:
        """Numbers that no flight shows and nobody gave."""
        return _assumed(self.fit, self.parameters, by_tilt=self.by_tilt is not None)

    @property
    def axes(self) -> tuple[str, ...]:
        """Rates whose inertia was identified."""
        needed = {"p": {"I_xx"}, "q": {"I_yy"}, "r": {"I_zz", "kappa"}}
        return tuple(axis for axis in RATES if needed[axis] <= set(self.parameters.names))

    @cached_property
    def predicted(self) -> tuple[Predicted, ...]:
        """Every stretch as measured and as the model makes it."""
        fit, found = self.fit, []
        for flight, wind, skew_s in zip(self.data.motors.stretches, fit.winds, fit.skews_s.tolist(), strict=True):
            driven = motion(flight.record, fit.values, kind=fit.velocity, wind=wind, skew_s=skew_s)
            modeled = predicted_force(fit.values, fit.airframe, flight.record, driven, fit.cutoff_hz)
            found.append(Predicted(flight, flight.record.force, modeled, driven.velocity, driven.speeds))
        return tuple(found)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Axes of the accelerometer that move; of others a fit would only show their noise."""
        return tuple(
            name
            for row, name in enumerate(ACCELERATIONS)
            if max(float(_slow(flown, flown.measured)[row].std()) for flown in self.predicted) >= _MOVED_M_S2
        )

    @cached_property
    def structure(self) -> LinearStructure:
        """The vehicle about hover, see :func:`hover_structure`."""
        output = self.hover["output"].value if "output" in self.hover else self.fit.hover.speed
        return hover_structure(self.parameters, self.data.layout, self.fit.hover, output=output, axes=self.axes)

    @cached_property
    def hover(self) -> dict[str, Derived]:
        """What holds in hover and does not trade as coefficients do, see :func:`hover_numbers`."""
        scaled, speeds = self.data.given.scaled, self.data.kind == "speed"
        found = hover_numbers(self.fit, self.bounds, scaled=scaled, speeds=speeds)
        if self.by_tilt is not None:
            # Drag over mass was found, and the coefficient follows from it.
            found["drag"] = Derived(value=self.by_tilt.value, std=self.by_tilt.std, unit="1/s")
        return found


_BINS, _LEAST_BIN_S = 12, 1.0


def drag_points(fitted: FittedFlight) -> tuple[DragPoint, ...]:
    """Mean force against the airspeed along the discs, in bins of that airspeed with a second of flight and more."""
    parts = [(flown, np.hypot(flown.velocity[0], flown.velocity[1])) for flown in fitted.predicted]
    fastest = max(float(airspeed.max()) for _, airspeed in parts)
    if fitted.fit.velocity == "none" or not fastest > 0.0:
        return ()
    mass, edges = fitted.fit.airframe.mass_kg, np.linspace(0.0, fastest, _BINS + 1)[1:-1]
    sums = np.zeros((4, _BINS))
    for flown, airspeed in parts:
        along = flown.velocity[:2] / np.maximum(airspeed, 1e-9)
        bins = np.searchsorted(edges, airspeed, side="right")
        measured, modeled = (-mass * (rows[:2] * along).sum(axis=0) for rows in (flown.measured, flown.modeled))
        for row, values in enumerate((np.ones_like(airspeed), airspeed, measured, modeled)):
            weighed = values / flown.flight.record.sample_rate_hz
            sums[row] += np.bincount(bins, weights=weighed, minlength=_BINS)
    return tuple(
        DragPoint(airspeed_m_s=v / s, measured_n=a / s, modeled_n=b / s, seconds=s)
        for s, v, a, b in sums.T.tolist()
        if s >= _LEAST_BIN_S
    )


def fitted_parameters(
    data: FlightMotion, fit: FlightFit, known: Mapping[str, float], *, by_tilt: bool = False
) -> ParameterSet:
    """The values of a fit with units and status, in the order of tables."""
    usual = {name for name in fit.missing if name in fit.values and name not in known}
    flat = () if fit.moments is None else fit.moments.assumed
    free = {*fit.free, *usual, *flat, *(("k_d",) if by_tilt else ())}
    units = flight_units(scaled=data.given.scaled, speeds=data.kind == "speed")
    values = {**known, **fit.values, "m": data.given.airframe.mass_kg}
    if not {"kappa", "I_zz"} <= set(values):
        # One of them alone moves nothing.
        values = {name: value for name, value in values.items() if name not in ("kappa", "I_zz", "J_r")}
    return ParameterSet(
        [
            Parameter(
                name=name,
                value=values[name],
                unit=units[name],
                lower=-np.inf,
                upper=np.inf,
                status="free" if name in free else "fixed",
            )
            for name in FLIGHT_PARAMETERS
            if name in values
        ]
    )


def fitted_bounds(fit: FlightFit, parameters: ParameterSet, by_tilt: Quantity | None = None) -> Bounds:
    """The covariance of a fit as bounds; the usual scatter between flights where it has none.

    Parameters
    ----------
    by_tilt
        ``k_d``, where the tilt gave it.
    """
    names = parameters.free
    covariance = np.diag([max(usual_scatter(name, parameters[name].value), 1e-12) ** 2 for name in names])
    random = covariance.copy()
    if fit.errors is not None:
        own = [name for name in names if name in fit.errors.names]
        here, there = ([of.index(name) for name in own] for of in (names, fit.errors.names))
        covariance[np.ix_(here, here)] = fit.errors.covariance[np.ix_(there, there)]
        random[np.ix_(here, here)] = fit.errors.random[np.ix_(there, there)]
    for name in _assumed(fit, parameters, by_tilt=by_tilt is not None):
        moved = _moved_with(name, fit)
        spread = np.array([moved.get(other, 0.0) for other in names])
        row = names.index(name)
        covariance[row, row] = 0.0
        covariance += np.outer(spread, spread)
        random[row, row] = spread[row] ** 2
    if by_tilt is not None:
        row = names.index("k_d")
        covariance[row, row] = random[row, row] = by_tilt.std**2
    return bounds_of_covariance(names, covariance, random)


def _assumed(fit: FlightFit, parameters: ParameterSet, *, by_tilt: bool) -> tuple[str, ...]:
    """Numbers with an error that come from neither the fit nor the tilt."""
    found = {*fit.free, *(("k_d",) if by_tilt else ())}
    return tuple(name for name in parameters.free if name not in found)


def _moved_with(name: str, fit: FlightFit) -> dict[str, float]:
    """One standard deviation of an assumed number, and by how much others move with it."""
    values = fit.values
    if name == "I_zz":
        return {other: _FLATNESS_SHARE * values[other] for other in _OF_YAW if other in values}
    moved = {name: _ASSUMED_SHARE * values[name]}
    if name == "c_lambda":
        # Thrust in hover was measured: thrust without inflow makes up for what inflow takes.
        share = moved[name] * fit.hover.induced_m_s / fit.hover.speed / full_thrust(values)
        moved |= {term: share * values[term] for term in CURVE_TERMS if term in values}
    return moved


def bounds_of_covariance(names: tuple[str, ...], covariance: FloatArray, random: FloatArray) -> Bounds:
    """Bounds by CIFER's rules from covariances: twice the random error, and the error with all others known."""
    size = np.sqrt(np.maximum(random.diagonal(), 1e-300))
    information = np.linalg.pinv(random / np.outer(size, size), hermitian=True).diagonal() / size**2
    return Bounds(
        names=names,
        cramer_rao=2.0 * size,
        insensitivity=1.0 / np.sqrt(np.maximum(information, 1e-300)),
        covariance=covariance,
        random=random,
        colored=1.0,
    )


def _slow(flown: Predicted, rows: FloatArray) -> FloatArray:
    """Slow part of some rows, shape ``(3, n)``."""
    return in_band(rows, SLOW_BAND_HZ, flown.flight.record.sample_rate_hz)


def force_scores(flown: Predicted, channels: tuple[str, ...]) -> dict[str, Scores]:
    """How the force of a stretch is predicted, axis by axis, up to 5 Hz."""
    measured, modeled = (_slow(flown, rows) for rows in (flown.measured, flown.modeled))
    return {
        name: Scores.plain(measured[row], modeled[row]) for row, name in enumerate(ACCELERATIONS) if name in channels
    }


def fit_percents(fitted: FittedFlight) -> dict[str, float]:
    """Channel to the share of its slow motion that the model explains, of all stretches."""
    percents = {}
    for name in fitted.channels:
        row = ACCELERATIONS.index(name)
        pairs = [(_slow(flown, flown.measured)[row], _slow(flown, flown.modeled)[row]) for flown in fitted.predicted]
        missed = sum(float(np.sum((a - b) ** 2)) for a, b in pairs)
        spread = sum(float(np.sum((a - a.mean()) ** 2)) for a, _ in pairs)
        if spread > 0.0:
            percents[name] = 100.0 * (1.0 - (missed / spread) ** 0.5)
    return percents


def simulated_record(flown: Predicted) -> SimulatedRecord:
    """A stretch for the pictures of a report."""
    record = flown.flight.record
    return SimulatedRecord(
        record=record.name,
        maneuver=flown.flight.maneuver,
        time_s=record.time_s,
        inputs=record.outputs - record.outputs.mean(axis=1, keepdims=True),
        measured=_slow(flown, flown.measured),
        simulated=_slow(flown, flown.modeled),
    )
