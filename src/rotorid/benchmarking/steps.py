"""States over the next half second, from many samples of flights that were not fitted.

From a measured state the motors alone fly the vehicle on, at the steps of the data. Errors are norms, means over all
starts, for each of 1 to 50 steps; that of attitude is the angle of the rotation between both. The naive model keeps the
state, and a second one keeps velocity and rates. Of each test flight the center of gravity and the skew of the motors'
stamps are found from that flight, for models of rotorid alone.

The logged position differs from the integral of the logged velocity, so both are compared: ``position`` with the one,
``displacement`` with the other.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.benchmarking.catalog import STEPS, Benchmark
from rotorid.benchmarking.flights import BenchFlight, Vehicle
from rotorid.benchmarking.foreign import Foreign, StepsTask, called, table_of
from rotorid.benchmarking.scores import BenchRow, StepErrorsOf, step_rows
from rotorid.fitting.flight.fit import fit_flight
from rotorid.fitting.flight.moment import AIR_TERMS, GAINS, center_of
from rotorid.fitting.flight.motion import motion
from rotorid.models.flight import INERTIA
from rotorid.typing import FloatArray, IntArray
from rotorid.verification.multistep import (
    FlightState,
    StepErrors,
    kept_steps,
    measured_states,
    pooled,
    predicted_steps,
    score_steps,
    spread_starts,
)

_PROGRESS = logging.getLogger("rotorid.progress")

_STATES = ("x", "y", "z", "vx", "vy", "vz", "rx", "ry", "rz", "wx", "wy", "wz")
COLUMNS = tuple(f"{name}_pred_h{step}" for step in range(1, STEPS + 1) for name in _STATES)
"""Of a CSV file of predictions, as the authors of IDSIA's benchmark write them: forward, left, up; z up; rotation
vector."""


class _Windows(NamedTuple):
    """A flight with the states that it is predicted from.

    Parameters
    ----------
    logged, integrated
        States with the logged position, and with the integral of the velocity in its place.
    starts
        Samples of the record.
    """

    flight: BenchFlight
    logged: FlightState
    integrated: FlightState
    starts: IntArray

    @property
    def step_s(self) -> float:
        return 1.0 / self.flight.record.sample_rate_hz

    def scored(self, predicted: FlightState) -> StepErrorsOf:
        """Errors of predictions that begin at the logged position."""
        shift = self.integrated.position[:, self.starts] - self.logged.position[:, self.starts]
        moved = predicted._replace(position=predicted.position + shift[:, None])
        return StepErrorsOf(
            score_steps(predicted, self.logged, starts=self.starts, step_s=self.step_s),
            score_steps(moved, self.integrated, starts=self.starts, step_s=self.step_s),
        )


def windows_of(flight: BenchFlight) -> _Windows:
    """A flight with up to 1000 starts, evenly over it."""
    record = flight.record
    integrated = measured_states(record.attitude, record.velocity, record.rates, step_s=1.0 / record.sample_rate_hz)
    logged = integrated._replace(position=flight.position)
    return _Windows(flight, logged, integrated, spread_starts(record.samples, steps=STEPS))


class StepTable(NamedTuple):
    """Rows of all models, and their errors over the steps; position as logged."""

    rows: list[BenchRow]
    steps: Mapping[str, StepErrors]


def step_table(
    benchmark: Benchmark,
    flights: Sequence[BenchFlight],
    folds: Sequence[tuple[list[int], list[int]]],
    vehicle: Vehicle,
    foreign: Foreign | None = None,
) -> StepTable:
    """Rows of all models, published ones included.

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
        (windows_of(flights[place]), tuple(flights[each] for each in fitted))
        for fitted, predicted in folds
        for place in predicted
    ]
    rows: list[BenchRow] = []
    errors: dict[str, list[StepErrorsOf]] = {}
    if foreign:  # before the long fits: its errors show at once
        errors[foreign.label] = _foreign(foreign, tests)
        rows += step_rows(foreign.label, foreign.source, errors[foreign.label], None)
    own, most = _of_rotorid(flights, folds, vehicle)
    errors |= own
    for label, found in own.items():
        source = "fitted here to the other flights" + ("; no vehicle" if "--predictor" in label else "")
        rows += step_rows(label, source, found, most)
    moving = [windows.scored(_moving_on(windows)) for windows, _ in tests]
    kept = [windows.scored(kept_steps(windows.logged, steps=STEPS, starts=windows.starts)) for windows, _ in tests]
    errors |= {_MOVING: moving, _KEPT: kept}
    rows += step_rows(_MOVING, "naive", moving, 0)
    rows += step_rows(_KEPT, "naive", kept, 0, naive=True)
    for published in benchmark.published:
        rows += [
            BenchRow(
                model=published.model, source=published.source, metric=metric, value=value, std=None, parameters=None
            )
            for metric, value in published.values.items()
        ]
    return StepTable(rows, {label: pooled([error.logged for error in found]) for label, found in errors.items()})


_KEPT, _MOVING = "state kept", "velocity and rates kept"
OURS = ("physical.flight", "physical.flight --predictor")
"""What rotorid predicts with."""


def _of_rotorid(
    flights: Sequence[BenchFlight], folds: Sequence[tuple[list[int], list[int]]], vehicle: Vehicle
) -> tuple[dict[str, list[StepErrorsOf]], int]:
    """Errors of the vehicle and of its predictor, and the most free numbers of a fit."""
    found: dict[str, list[StepErrorsOf]] = {}
    most = 0
    for number, (fitted, predicted) in enumerate(folds):
        _PROGRESS.info("fitting part %d of %d", number + 1, len(folds))
        choices = replace(vehicle.choices, skews_s=tuple(flights[place].skew_s for place in fitted))
        fit = fit_flight([flights[place].record for place in fitted], vehicle.airframe, choices)
        most = max(most, len(fit.free))
        numbers = [fit.values, *([predictor_values(fit.values, fit.predictor)] if fit.predictor else [])]
        for place in predicted:
            flight = flights[place]
            windows = windows_of(flight)
            driven = motion(flight.record, fit.values, skew_s=flight.skew_s)
            for label, values in zip(OURS, numbers, strict=False):
                # Of each flight its own: the battery is put in anew.
                own = {**values, **center_of(values, vehicle.airframe, flight.record, driven)}
                reached = predicted_steps(
                    own,
                    vehicle.airframe,
                    windows.logged,
                    driven.speeds,
                    step_s=windows.step_s,
                    steps=STEPS,
                    starts=windows.starts,
                )
                found.setdefault(label, []).append(windows.scored(reached))
    whole = sum(len(predicted) for _, predicted in folds)
    return {label: errors for label, errors in found.items() if len(errors) == whole}, most


def predictor_values(values: Mapping[str, float], predictor: Mapping[str, float]) -> dict[str, float]:
    """Numbers of a vehicle that moves as the predictor says: a share of a moment is a larger inertia.

    Parameters
    ----------
    values, predictor
        Of a fit; an axis without a gain keeps its inertia.
    """
    gains = [predictor.get(name, 1.0) for name in GAINS]
    tilting = float(np.sqrt(gains[0] * gains[1]))
    shares = {"m_fx": gains[1], "x_cg": gains[1], "y_cg": gains[0], "kappa_lambda": gains[2], "k_r": gains[2]}
    bare = {name: value for name, value in values.items() if name not in AIR_TERMS}
    air = {name: value / shares.get(name, tilting) for name, value in predictor.items() if name in AIR_TERMS}
    heavy = {name: values[name] / gain for name, gain in zip(INERTIA.values(), gains, strict=True) if name in values}
    return {**bare, **air, **heavy}


def _moving_on(windows: _Windows) -> FlightState:
    """Velocity over ground and body rates stay as they are at the start."""
    from scipy.spatial.transform import Rotation

    first = windows.logged.at(windows.starts)
    ahead_s = windows.step_s * np.arange(1, STEPS + 1)
    begun = Rotation.from_quat(np.roll(first.attitude, -1, axis=0).T)
    turned = np.stack(
        [(begun * Rotation.from_rotvec(time_s * first.rates.T)).as_quat().T for time_s in ahead_s], axis=1
    )
    kept = kept_steps(windows.logged, steps=STEPS, starts=windows.starts)
    return kept._replace(
        position=kept.position + ahead_s[None, :, None] * first.velocity[:, None], attitude=np.roll(turned, 1, axis=0)
    )


def _foreign(foreign: Foreign, tests: Sequence[tuple[_Windows, tuple[BenchFlight, ...]]]) -> list[StepErrorsOf]:
    if foreign.path is None:
        return [
            windows.scored(
                _as_state(called(foreign, _task(windows), [_whole(each) for each in training], _shape(windows)))
            )
            for windows, training in tests
        ]
    wanted = [(windows.flight.name, windows.flight.samples - STEPS) for windows, _ in tests]
    tables = table_of(foreign.path, COLUMNS, wanted)
    return [
        windows.scored(_from_table(table[:, windows.flight.first + windows.starts]))
        for (windows, _), table in zip(tests, tables, strict=True)
    ]


def _shape(windows: _Windows) -> tuple[int, int, int]:
    return 13, STEPS, windows.starts.size


def _task(windows: _Windows) -> StepsTask:
    """What a function is given of the windows of a flight: states at the starts, and motors all through."""
    first = windows.logged.at(windows.starts)
    through = windows.starts[None] + np.arange(STEPS + 1)[:, None]
    return StepsTask(windows.flight.name, windows.step_s, windows.flight.record.outputs[:, through], *first)


def _whole(flight: BenchFlight) -> StepsTask:
    """A flight to learn from."""
    windows = windows_of(flight)
    return StepsTask(flight.name, windows.step_s, flight.record.outputs, *windows.logged)


def _as_state(rows: FloatArray) -> FlightState:
    """Position, velocity, quaternion and rates as states; the quaternion is normed."""
    attitude = rows[6:10] / np.maximum(np.sqrt((rows[6:10] ** 2).sum(axis=0)), 1e-12)
    return FlightState(rows[:3], rows[3:6], attitude, rows[10:])


def _from_table(table: FloatArray) -> FlightState:
    """States of a file, which are forward, left, up with z up, and rotation vectors."""
    from scipy.spatial.transform import Rotation

    flip = np.array([1.0, -1.0, -1.0])[:, None, None]
    position, velocity, turned, rates = (flip * part for part in table.reshape(STEPS, 4, 3, -1).transpose(1, 2, 0, 3))
    quaternion = Rotation.from_rotvec(turned.reshape(3, -1).T).as_quat().T.reshape(4, *turned.shape[1:])
    return FlightState(position, velocity, np.roll(quaternion, 1, axis=0), rates)
