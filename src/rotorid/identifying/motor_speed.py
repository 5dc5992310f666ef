"""Speeds of motors by their outputs: the method of ``motor.speed``.

The equations of :mod:`rotorid.models.motor_speed` are fitted as every nonlinear model is, by output error. What is
added: as many motors as the log has, start values from a regression of speeds on outputs, the voltage where it sagged,
a stretch of the log that is kept for verification, and for speeds that are logged after the outputs that act on them a
lead in place of the delay.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotorid.checking.motor_speed import MotorSpeedPredictor, motors_of, stretches, with_speeds
from rotorid.checking.predictions import Predictions
from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import UsageError
from rotorid.fits.motors.speeds import Leftover, with_model_errors
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.motors.following import MotorSpeedProblem
from rotorid.flights.selection import Selection
from rotorid.identifying.nonlinear import FittedNonlinear, Nonlinear, NonlinearData
from rotorid.models.motor_speed import DELAY, LEAD, VOLTAGE, Operation, motor_speed_model
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.results.model import Verifications
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.motors import logged_outputs, logged_speeds

_PROGRESS = logging.getLogger("rotorid.progress")

_SAGGING = 0.05
"""Spread of the voltage, as a part of it, from which its influence is estimated."""

_CURVED = 0.15
"""Range of outputs from which a curve can be told from a line."""

_SOLVER = LevenbergMarquardt(tolerance=1e-8)
"""Of a cost of some ten thousand samples, a step that gains less moves no parameter by a hundredth of its deviation."""

_AT_ZERO = 0.05
"""Delay in samples below which it counts as none."""


@dataclass(frozen=True, kw_only=True)
class MotorSpeeds:
    """Fit lag, curve and voltage from outputs to speeds of all motors of a log."""

    settings: IdentifySettings

    def prepare(self, records: Sequence[FlightRecord]) -> NonlinearData:
        """Choose stretches in which all motors turn."""
        _PROGRESS.info("motors: outputs and speeds")
        logs = [with_speeds(record) for record in records]
        counts = {motors_of(record) for record in records}
        if len(counts) > 1:
            raise UsageError(
                f"the logs have {' and '.join(map(str, sorted(counts)))} motors",
                needed="logs of one vehicle",
                remedy="identify each by itself",
            )
        segments = self.settings.segments or tuple(
            stretch for record in records for stretch in stretches(record).fitted
        )
        model = motor_speed_model(counts.pop(), _operation(logs, segments))
        return self._nonlinear(model, segments).prepare(logs)

    def fit(self, data: NonlinearData) -> FittedNonlinear:
        """Fit with a delay; where the speeds are ahead of the outputs, with a lead."""
        method = self._nonlinear(data.whole, ())
        if DELAY in data.parameters.free:
            step_s = 1.0 / data.records.data[0].sample_rate_hz
            found = method.first_fit(data)
            if found[DELAY].value <= _AT_ZERO * step_s:
                found = found.fix(DELAY, 0.0).free_again(LEAD).with_values({LEAD: 0.5 * step_s})
            data = data._replace(parameters=found)
        fitted = method.fit(data)
        return _with_model_errors(data, fitted)

    def _nonlinear(self, model: NonlinearStructure, segments: Sequence[Maneuver]) -> Nonlinear:
        settings = replace(self.settings, segments=tuple(segments))
        return Nonlinear(model=model, settings=settings, flies=False, problem=MotorSpeedProblem, solver=_SOLVER)

    def verify(self, data: NonlinearData, fitted: FittedNonlinear, records: Sequence[FlightRecord]) -> Verifications:
        """Predict the stretches that were kept, and further logs."""
        predictor = MotorSpeedPredictor(fitted.model)
        found: list[Predictions] = []
        if not self.settings.segments:
            logs = {id(flight.record): flight.record for flight in data.flights}.values()
            found = [predictor.held_out(record, kept) for record in logs if (kept := stretches(record).unseen)]
        if records or not found:
            found.append(self._of_others(data, fitted, records))
        return Verifications(
            maneuvers=tuple(check for part in found for check in part.found.maneuvers),
            findings=tuple(finding for part in found for finding in part.found.findings),
        )

    def _of_others(self, data: NonlinearData, fitted: FittedNonlinear, records: Sequence[FlightRecord]) -> Predictions:
        if not records:
            return Predictions(found=self._nonlinear(data.whole, ()).verify(data, fitted, ()))
        selection = Selection(fitted=data.flights, unseen=())
        return MotorSpeedPredictor(fitted.model).predict(records, VerifySettings(), selection)

    def checks(self, fitted: FittedNonlinear, found: Verifications) -> Any:
        """Scores of the stretches."""
        return self._nonlinear(fitted.model, ()).checks(fitted, found)

    def describe(self, data: NonlinearData, fitted: FittedNonlinear) -> Any:
        """Fits of the stretches and their residuals."""
        return self._nonlinear(data.whole, ()).describe(data, fitted)

    def remarks(self, data: NonlinearData, fitted: FittedNonlinear, report: Any) -> Sequence[Finding]:
        """On the fit, and on what the outputs did not show."""
        found = list(self._nonlinear(data.whole, ()).remarks(data, fitted, report))
        if fitted.listed["Omega_2"].status == "fixed":
            message = "The outputs moved too little for a curve; speed was taken as a line of the output."
            found.append(remark("assumed_curve", "Omega_2", message))
        return found


def _with_model_errors(data: NonlinearData, fitted: FittedNonlinear) -> FittedNonlinear:
    """The fit with the model error of its bounds."""
    logs = {id(flight.record): flight.record for flight in data.flights}.values()
    rates = [data.records.data[0].sample_rate_hz]
    rates += [history.sample_rate_hz for log in logs for history in (logged_outputs(log), logged_speeds(log))]
    left = Leftover(
        parts=fitted.fit.problem.parts(fitted.fit.solution.theta),
        alone=fitted.alone,
        simulated=fitted.simulated,
        step_s=1.0 / min(rates),
    )
    return replace(fitted, bounds=with_model_errors(fitted.bounds, fitted.listed.values, left))


def _operation(logs: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> Operation:
    """Where the outputs are, and a line of the speeds over them."""
    outputs, speeds, volts = [], [], []
    for record in logs:
        history, turned = logged_outputs(record), logged_speeds(record)
        inside = np.zeros(history.time_s.size, dtype=np.bool_)
        for segment in segments:
            inside |= (history.time_s >= segment.start_s) & (history.time_s <= segment.stop_s)
        time_s = history.time_s[inside]
        count = min(history.motors, turned.motors)
        outputs.append(history.values[:count, inside])
        speeds.append(np.stack([np.interp(time_s, turned.time_s, row) for row in turned.values[:count]]))
        if VOLTAGE in record.channel_names and time_s.size:
            track = record[VOLTAGE]
            kept = np.isfinite(track.values) & (track.values > 0.0)
            if kept.any():
                volts.append(np.interp(time_s, track.time_s[kept], track.values[kept]))
    all_outputs, all_speeds = np.concatenate(outputs, axis=1), np.concatenate(speeds, axis=1)
    mean = float(all_outputs.mean())
    moved = all_outputs.ravel() - mean
    power = float(moved @ moved)
    slope = float(moved @ (all_speeds.ravel() - all_speeds.mean())) / power if power > 0.0 else 0.0
    low, high = np.percentile(all_outputs, (2.5, 97.5))
    together = np.concatenate(volts) if len(volts) == len(logs) else np.zeros(0)
    sags = together.size > 0 and float(np.ptp(together)) > _SAGGING * float(together.mean())
    return Operation(
        output=mean,
        speed=float(all_speeds.mean()),
        slope=max(slope, 0.1 * float(all_speeds.mean())),
        volts=float(np.median(together)) if sags else None,
        curved=bool(high - low >= _CURVED),
        step_s=1.0 / min(logged_outputs(logs[0]).sample_rate_hz, logged_speeds(logs[0]).sample_rate_hz),
    )
