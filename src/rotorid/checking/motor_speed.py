"""Motor speeds by motor outputs on a log: which stretches serve, and predictions of those that were not fitted.

A stretch serves where all motors turn, in flight where the log shows one and on the bench where it does not: neither
gyro nor accelerometer takes part. Speeds are read as every other reader of them reads them
(:func:`rotorid.signal.motors.logged_speeds`), without samples in which a sensor lost its motor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.advice import logging_advice, speed_advice
from rotorid.checking.nonlinear import NonlinearPredictor
from rotorid.checking.predictions import (
    NOTHING_FITTED,
    Predictions,
    Simulation,
    Trial,
    predict_each,
    refuse_choices_of_responses,
)
from rotorid.data.findings import Finding, refusal
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals, Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.flights.selection import Selection
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.airborne import airborne, within
from rotorid.signal.motors import MotorHistory, logged_outputs, logged_speeds, or_none, with_motors
from rotorid.typing import BoolArray

_TURNING = 0.15
"""Part of the median speed below which a motor counts as stopped."""

_LEAST_S = 3.0
_FITTED, _MOST_FITTED_S, _MOST_UNSEEN_S, _PARTS = 0.6, 18.0, 12.0, 3
"""Share of a stretch that is fitted, in parts whose scatter is seen; the rest is predicted."""

_FAST_HZ = 200.0
"""Rate above which samples are averaged."""


class Stretches(NamedTuple):
    """What of a log is fitted, and what is kept for verification."""

    fitted: tuple[Maneuver, ...]
    unseen: tuple[Maneuver, ...]


def with_speeds(record: FlightRecord) -> FlightRecord:
    """The record with outputs and speeds of its motors as first choice.

    Raises
    ------
    InsufficientDataError
        Either is not logged, or too slowly.
    """
    outputs, speeds = or_none(logged_outputs, record), or_none(logged_speeds, record)
    name = record.source.name
    if outputs is None or speeds is None:
        lost = "motor_1" if outputs is None else "motor_speed_1"
        message = f"{name} has no {'outputs' if outputs is None else 'speeds'} of the motors"
        remedy = speed_advice(record) if outputs is not None else logging_advice(record, 0.0, (lost,))
        raise InsufficientDataError(
            message,
            needed="outputs and speeds of all motors",
            remedy=remedy,
            findings=[refusal("missing_channel", lost, f"{message}.")],
        )
    rate_hz = min(outputs.sample_rate_hz, speeds.sample_rate_hz)
    if rate_hz < LOWEST_RATE_HZ:
        message = f"{name} logs outputs and speeds of the motors together at {rate_hz:.0f} Hz only"
        raise InsufficientDataError(
            message,
            needed=f"{LOWEST_RATE_HZ:.0f} Hz, for the lag of a motor",
            remedy=logging_advice(record, rate_hz),
            findings=[refusal("rate_too_low", speeds.source, f"{message}.", rate_hz=rate_hz, needed_hz=LOWEST_RATE_HZ)],
        )
    return with_motors(with_motors(record, _thinned(speeds)), _thinned(outputs))


def _thinned(history: MotorHistory) -> MotorHistory:
    """Means over some samples of a log that is much faster than any motor: both sides of the model alike."""
    share = int(history.sample_rate_hz / _FAST_HZ)
    blocks = history.time_s.size // max(share, 1)
    if share < 2 or not blocks:
        return history
    shape = (blocks, share)
    time_s = history.time_s[: blocks * share].reshape(shape).mean(axis=1)
    values = history.values[:, : blocks * share].reshape(-1, *shape).mean(axis=2)
    return replace(history, time_s=time_s, values=values)


def motors_of(record: FlightRecord) -> int:
    """Motors whose output and speed are logged."""
    return min(logged_outputs(record).motors, logged_speeds(record).motors)


def stretches(record: FlightRecord) -> Stretches:
    """The longest stretch in which all motors turn: most of it to fit, the rest to verify.

    Raises
    ------
    InsufficientDataError
        The motors never turn for three seconds.
    """
    speeds = logged_speeds(record)
    turning = np.all(speeds.values > _TURNING * np.median(speeds.values), axis=0)
    flown = _flown(record)
    if flown:
        turning &= within(speeds.time_s, flown)
    start_s, stop_s = _longest(turning, speeds.time_s)
    if stop_s - start_s < _LEAST_S:
        message = f"The motors of {record.source.name} turn together for {stop_s - start_s:.1f} s"
        raise InsufficientDataError(
            message,
            needed=f"{_LEAST_S:.0f} s, in flight or on the bench",
            findings=[refusal("record_too_short", "motor_speed_1", f"{message}.")],
        )
    share = _FITTED if stop_s - start_s >= _LEAST_S / (1.0 - _FITTED) else 1.0
    middle_s = start_s + min(share * (stop_s - start_s), _MOST_FITTED_S)
    kept = () if share == 1.0 else (_stretch(middle_s, min(stop_s, middle_s + _MOST_UNSEEN_S)),)
    parts = max(1, min(_PARTS, int((middle_s - start_s) / _LEAST_S)))
    edges = np.linspace(start_s, middle_s, parts + 1).tolist()
    return Stretches(tuple(_stretch(first, last) for first, last in pairwise(edges)), kept)


def _stretch(start_s: float, stop_s: float) -> Maneuver:
    return Maneuver(axis="thrust", kind="other", start_s=start_s, stop_s=stop_s, origin="found")


def _flown(record: FlightRecord) -> Intervals:
    try:
        found = airborne(record)
    except InsufficientDataError:
        return ()
    return found.intervals


def _longest(on: BoolArray, time_s: np.ndarray) -> tuple[float, float]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    runs = [(float(time_s[first]), float(time_s[last - 1])) for first, last in edges.reshape(-1, 2)]
    return max(runs, key=lambda run: run[1] - run[0], default=(0.0, 0.0))


@dataclass(frozen=True)
class MotorSpeedPredictor(NonlinearPredictor):
    """Speeds of the motors of a result, simulated from the start of a stretch on."""

    @property
    def needed(self) -> str:
        """The logs that can judge it."""
        return "a log with outputs and speeds of the motors"

    def predict(
        self, records: Sequence[FlightRecord], settings: VerifySettings, fitted: Selection = NOTHING_FITTED
    ) -> Predictions:
        """Stretches simulated from their start on, see :class:`rotorid.checking.predictions.Predictor`."""
        refuse_choices_of_responses(self.equations.name, settings)
        return predict_each(records, settings, fitted, lambda record: self.held_out(record, settings.segments))

    def trials(self, record: FlightRecord, settings: IdentifySettings) -> list[Trial]:
        """Stretches of a log."""
        return super().trials(with_speeds(record), replace(settings, segments=_all_of(record, settings.segments)))

    def simulations(self, record: FlightRecord, settings: FlySettings) -> tuple[list[Simulation], list[Finding]]:
        """Stretches of a log, whole or in pieces."""
        return super().simulations(with_speeds(record), replace(settings, segments=_all_of(record, settings.segments)))

    def held_out(self, record: FlightRecord, segments: Sequence[Maneuver]) -> Predictions:
        """Predictions of some stretches, by default of all of a log."""
        return self._simulated(with_speeds(record), _all_of(record, segments))


def _all_of(record: FlightRecord, segments: Sequence[Maneuver]) -> tuple[Maneuver, ...]:
    found = stretches(record)
    return tuple(segments) or (*found.fitted, *found.unseen)
