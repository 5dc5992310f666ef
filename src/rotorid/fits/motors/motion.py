"""Measured and modeled accelerations in the band that the motors explain, by which a fit is judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.record import Maneuver
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, SLOW_BAND_HZ, SLOW_HZ, Excitation, in_band
from rotorid.fitting.motors.problem import Axis, MotorProblem
from rotorid.fitting.motors.speed import motor_speed
from rotorid.flights.motor_data import MotorFlight
from rotorid.results.model import SimulatedRecord
from rotorid.typing import FloatArray
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores

CHANNELS: Mapping[str, str] = {
    "p": "p_dot",
    "q": "q_dot",
    "r": "r_dot",
    "az": "az",
    "x": "velocity_forward_dot",
    "y": "velocity_right_dot",
}
"""Equation to the channel that it is about."""


class Motion(NamedTuple):
    """A stretch: measured and modeled motion.

    Parameters
    ----------
    counted
        Channels whose axis was excited.
    rows
        Channel to measurement and model, slow, shape ``(n,)`` each at the samples :attr:`kept`; the mean of an angular
        acceleration is taken off.
    """

    flight: MotorFlight
    counted: tuple[str, ...]
    rows: Mapping[str, tuple[FloatArray, FloatArray]]

    @property
    def kept(self) -> slice:
        """The samples of the record that the rows are of: none near its ends, where a low-pass knows too little."""
        return slice(1 + _edge(self.flight.record.sample_rate_hz), -_edge(self.flight.record.sample_rate_hz))


def motions(
    problem: MotorProblem,
    theta: FloatArray,
    flights: Sequence[MotorFlight],
    found: Sequence[Mapping[str, Excitation]],
) -> tuple[Motion, ...]:
    """Every stretch with its axes of the problem, passed through a low-pass without phase."""
    moved = []
    for flight, record, excited in zip(flights, problem.equations(theta), found, strict=True):
        rate_hz = flight.record.sample_rate_hz
        axes = [axis for axis in record if axis.name in CHANNELS]
        moved.append(
            Motion(
                flight,
                tuple(CHANNELS[axis.name] for axis in axes if excited[axis.name].correlation >= LEAST_CORRELATION),
                {CHANNELS[axis.name]: _pair(axis, rate_hz, excited[axis.name].band_hz) for axis in axes},
            )
        )
    return tuple(moved)


def _pair(axis: Axis, rate_hz: float, band_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    factor = rate_hz if axis.name in RATES else 1.0
    measured, modeled = (_slow(factor * row, rate_hz, band_hz) for row in (axis.measured, axis.predicted))
    if axis.name == "az":
        return measured, modeled
    return measured - measured.mean(), modeled - modeled.mean()


def _edge(rate_hz: float) -> int:
    return max(1, round(rate_hz / SLOW_HZ))


def _slow(row: FloatArray, rate_hz: float, band_hz: tuple[float, float] = SLOW_BAND_HZ) -> FloatArray:
    return in_band(row, band_hz, rate_hz)[_edge(rate_hz) : -_edge(rate_hz)]


def unexplained_by_curve(problem: MotorProblem, theta: FloatArray, found: Sequence[Mapping[str, Excitation]]) -> float:
    """Share of the slow errors of specific force that a constant, the outputs and their squares would explain."""
    errors, columns = [], []
    for record, equations, excited in zip(problem.records, problem.equations(theta, ["az"]), found, strict=True):
        force = next((axis for axis in equations if axis.name == "az"), None)
        if force is None or excited["az"].correlation < LEAST_CORRELATION:
            continue
        lag = problem.parameters.unpack(theta).values.get("T_motor", excited["az"].lag_s)
        motors = motor_speed(
            record.outputs, lag_s=max(lag, 1e-4), delay_s=0.0, step_s=1.0 / record.sample_rate_hz, integrals=False
        )
        level = np.asarray(motors.level, dtype=np.float64)[:, 1:]
        sums = [_slow(row, record.sample_rate_hz) for row in (level.sum(axis=0), (level**2).sum(axis=0))]
        errors.append(_slow(force.measured - force.predicted, record.sample_rate_hz))
        columns.append(np.stack([np.ones(sums[0].size), *sums], axis=1))
    if not errors:
        return 0.0
    error, columns_together = np.concatenate(errors), np.concatenate(columns)
    coefficients = np.linalg.lstsq(columns_together, error, rcond=None)[0]
    size = float(error @ error)
    return 1.0 - float(np.sum((error - columns_together @ coefficients) ** 2)) / size if size > 0.0 else 0.0


def fit_percents(moved: Sequence[Motion], channels: Sequence[str]) -> dict[str, float]:
    """Channel to the share of its slow motion that is explained, of all stretches that excite it."""
    percents = {}
    for name in channels:
        pairs = [motion.rows[name] for motion in moved if name in motion.counted]
        missed = sum(float(np.sum((a - b) ** 2)) for a, b in pairs)
        spread = sum(float(np.sum((a - a.mean()) ** 2)) for a, _ in pairs)
        if spread > 0.0:
            percents[name] = 100.0 * (1.0 - (missed / spread) ** 0.5)
    return percents


def scores(moved: Motion) -> dict[str, Scores]:
    """Scores of the excited channels of a stretch."""
    found = {}
    for name in moved.counted:
        measured, modeled = moved.rows[name]
        # Where an accelerometer has its zero is no matter of the motors.
        shift = float(np.mean(measured - modeled))
        modeled = modeled + shift
        found[name] = Scores(
            nrmse_fit_percent=nrmse_fit_percent(measured, modeled),
            tic=theil_inequality(measured - measured.mean(), modeled - measured.mean()),
            rms=rms(measured - modeled),
            bias=0.0,
            reference_shift=shift,
        )
    return found


def simulated_record(moved: Motion, channels: Sequence[str]) -> SimulatedRecord:
    """A stretch for the pictures of a report."""
    record = moved.flight.record
    outputs = record.outputs[:, moved.kept]
    maneuver: Maneuver = moved.flight.maneuver
    return SimulatedRecord(
        record=record.name,
        maneuver=maneuver,
        time_s=record.time_s[moved.kept],
        inputs=outputs - outputs.mean(axis=1, keepdims=True),
        measured=np.stack([moved.rows[name][0] for name in channels]),
        simulated=np.stack([moved.rows[name][1] for name in channels]),
    )
