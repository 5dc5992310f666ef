"""Force and moment of flights that were not fitted, by models of rotorid, by others, and by two that know no model.

Predicted forces pass the filter of the data before they are compared; moments are compared up to 25 Hz by the published
inertia. The naive model is a thrust that follows the squares of the speeds, and no moment. The differentiator takes
force and moment as differences of the logged velocity and rates over the last 10 ms: it knows the attitude, all past
velocities and rates, and no motor, which shows how much past states as inputs give away.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.benchmarking.catalog import LOADS
from rotorid.benchmarking.flights import BenchFlight, Vehicle
from rotorid.benchmarking.foreign import Foreign, LoadsTask, called, table_of
from rotorid.benchmarking.scores import BenchRow, LoadErrorsOf, load_rows
from rotorid.fitting.flight.fit import FlightFit, fit_flight, predicted_force
from rotorid.fitting.flight.force import through_sensor
from rotorid.fitting.flight.moment import missed_moment, moment_error
from rotorid.fitting.flight.motion import Motion, motion
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_PROGRESS = logging.getLogger("rotorid.progress")

_PAST_S = 0.01
COLUMNS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
"""Of a CSV file of predictions, N and N m, forward, right, down."""


class _Test(NamedTuple):
    """A flight to predict, what drives it, and the flights that may be learned from."""

    flight: BenchFlight
    driven: Motion
    training: tuple[BenchFlight, ...]


def load_table(
    flights: Sequence[BenchFlight],
    folds: Sequence[tuple[list[int], list[int]]],
    vehicle: Vehicle,
    foreign: Foreign | None = None,
) -> list[BenchRow]:
    """Rows of all models.

    Parameters
    ----------
    flights
        Of the benchmark.
    folds
        Flights that are fitted, and those that are predicted.
    foreign
        Anybody's predictions.
    """
    tests = [
        _Test(flights[place], motion(flights[place].record), tuple(flights[each] for each in fitted))
        for fitted, predicted in folds
        for place in predicted
    ]
    rows = _foreign(foreign, tests, vehicle) if foreign else []  # before the long fits: its errors show at once
    rows += _of_rotorid(flights, folds, vehicle)
    rows += _rows("thrust by speed alone, no moment", "naive", tests, lambda test: _naive(test, vehicle), 1)
    if all(test.flight.network.size for test in tests):
        rows += _rows(
            "NeuroBEM's network",
            "predictions in the files; trained on other flights of the set",
            tests,
            lambda test: _judged(test, test.flight.network, vehicle, filtered=True),
            None,
        )
    return rows + _rows(
        "differentiator over 10 ms", "past velocities and rates, no motor", tests, lambda test: _past(test, vehicle), 0
    )


def _rows(
    model: str, source: str, tests: Sequence[_Test], errors: Callable[[_Test], LoadErrorsOf], parameters: int | None
) -> list[BenchRow]:
    return load_rows(model, source, LOADS, [errors(test) for test in tests], parameters)


def _of_rotorid(
    flights: Sequence[BenchFlight], folds: Sequence[tuple[list[int], list[int]]], vehicle: Vehicle
) -> list[BenchRow]:
    """The vehicle, and the numbers that predict its closed loop best."""
    found: dict[bool, list[LoadErrorsOf]] = {False: [], True: []}
    most = 0
    for number, (fitted, predicted) in enumerate(folds):
        _PROGRESS.info("fitting part %d of %d", number + 1, len(folds))
        fit = fit_flight([flights[place].record for place in fitted], vehicle.airframe, vehicle.choices)
        most = max(most, len(fit.free))
        for place in predicted:
            for predictor, errors in found.items():
                errors.append(_of_fit(fit, flights[place], vehicle, predictor=predictor))
    source = "fitted here to the other flights"
    return [
        *load_rows("physical.flight", source, LOADS, found[False], most),
        *load_rows("physical.flight --predictor", f"{source}; no vehicle", LOADS, found[True], most),
    ]


def _of_fit(fit: FlightFit, flight: BenchFlight, vehicle: Vehicle, *, predictor: bool) -> LoadErrorsOf:
    record = flight.record
    driven = motion(record, fit.values, kind=fit.velocity)
    force = predicted_force(fit.values, vehicle.airframe, record, driven, vehicle.cutoff_hz)
    moment = moment_error(
        fit.values,
        vehicle.airframe,
        record,
        driven,
        delay_s=fit.moments.delay_s if fit.moments else 0.0,
        inertia=vehicle.published_inertia,
        predictor=fit.predictor if predictor else None,
    )
    return LoadErrorsOf(vehicle.airframe.mass_kg * (record.force - force), moment)


def _judged(test: _Test, loads: FloatArray, vehicle: Vehicle, *, filtered: bool) -> LoadErrorsOf:
    """Errors of force and moment, shape ``(6, n)``, behind the filters of the data."""
    record, mass = test.flight.record, vehicle.airframe.mass_kg
    force = through_sensor(loads[:3], record, vehicle.cutoff_hz) if filtered else loads[:3]
    return LoadErrorsOf(
        mass * record.force - force, missed_moment(loads[3:], record, test.driven, vehicle.published_inertia)
    )


def _naive(test: _Test, vehicle: Vehicle) -> LoadErrorsOf:
    r"""One number, :math:`c = \sum S f / \sum S^2` with :math:`S = \sum \Omega^2`, of the flights to learn from."""
    squares = [(each.record.outputs**2).sum(axis=0) for each in test.training]
    up = [-vehicle.airframe.mass_kg * each.record.force[2] for each in test.training]
    c = sum(float(s @ f) for s, f in zip(squares, up, strict=True)) / sum(float(s @ s) for s in squares)
    loads = np.zeros((6, test.flight.record.samples))
    loads[2] = -c * (test.flight.record.outputs**2).sum(axis=0)
    return _judged(test, loads, vehicle, filtered=True)


def _past(test: _Test, vehicle: Vehicle) -> LoadErrorsOf:
    """Differences over the last 10 ms; the first samples, which have no past, are left out."""
    record = test.flight.record
    past = max(1, round(_PAST_S * record.sample_rate_hz))

    def slope(rows: FloatArray) -> FloatArray:
        return np.asarray((rows[:, past:] - rows[:, :-past]) * (record.sample_rate_hz / past))

    over_earth = slope(body_to_earth(record.attitude, record.velocity))
    over_earth[2] -= STANDARD_GRAVITY_M_S2
    force = vehicle.airframe.mass_kg * earth_to_body(record.attitude[:, past:], over_earth)
    inertia = np.array(vehicle.published_inertia)[:, None]
    turned = np.cross(record.rates, inertia * record.rates, axis=0)
    moment = turned.copy()
    moment[:, past:] += inertia * slope(record.rates)
    moment[:, :past] += inertia * test.driven.acceleration[:, :past]
    return LoadErrorsOf(
        vehicle.airframe.mass_kg * record.force[:, past:] - force,
        missed_moment(moment, record, test.driven, vehicle.published_inertia),
    )


def _foreign(foreign: Foreign, tests: Sequence[_Test], vehicle: Vehicle) -> list[BenchRow]:
    if foreign.path is not None:
        found = table_of(foreign.path, COLUMNS, [(test.flight.name, test.flight.samples) for test in tests])
    else:
        found = [
            called(
                foreign,
                _task(test.flight, vehicle, known=False),
                [_task(each, vehicle, known=True) for each in test.training],
                (6, test.flight.record.samples),
            )
            for test in tests
        ]
    errors = [_judged(test, loads, vehicle, filtered=True) for test, loads in zip(tests, found, strict=True)]
    return load_rows(foreign.label, foreign.source, LOADS, errors, None)


def _task(flight: BenchFlight, vehicle: Vehicle, *, known: bool) -> LoadsTask:
    """What a function is given of a flight; with force and moment in one to learn from."""
    record = flight.record
    nothing = np.zeros((3, 0))
    inertia = np.array(vehicle.published_inertia)[:, None]
    moment = inertia * motion(record).acceleration + np.cross(record.rates, inertia * record.rates, axis=0)
    return LoadsTask(
        name=flight.name,
        time_s=record.time_s - record.start_s,
        motors=record.outputs,
        velocity=record.velocity,
        rates=record.rates,
        attitude=record.attitude,
        force=vehicle.airframe.mass_kg * record.force if known else nothing,
        moment=moment if known else nothing,
    )
