"""Inertia, thrust, motor lag and torque of a vehicle: the method that fits accelerations to motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.thrust import Linearization
from rotorid.checking.motors import MotorPredictor
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.fits.motors.fit import fit_motor_data
from rotorid.fits.motors.fitted import FittedMotors
from rotorid.fits.motors.motion import Motion, fit_percents, scores, simulated_record
from rotorid.fits.motors.remarks import judge_motors
from rotorid.fits.remarks import judge_combinations
from rotorid.fits.searching import judge_minima, search_summary, searched_minima
from rotorid.flights.flights import Flight
from rotorid.flights.motor_data import MotorData, motor_data
from rotorid.flights.selection import Selection
from rotorid.identifying.methods import FitReport
from rotorid.models.motors import DELAYS, TERMS_OF_CURVE, scale_of
from rotorid.results.model import FittedData, Verifications, no_response
from rotorid.results.summary import (
    Checks,
    ExcitedFlight,
    Fit,
    FitEnd,
    InertiaEstimate,
    MotorPhysics,
    RecordFit,
    Straightening,
)
from rotorid.settings.motors import MotorSettings
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.motors import linearization_of, logged_outputs, or_none
from rotorid.uncertainty.identifiability import Combination, unseen_combinations


@dataclass(frozen=True)
class Motors:
    """Fit the chain of :mod:`rotorid.fitting.motors.fit`: motor outputs, thrust and torque, gyros and accelerometer.

    Parameters
    ----------
    settings
        What is known of the vehicle, and how to read the logs.
    """

    settings: MotorSettings

    def prepare(self, records: Sequence[FlightRecord]) -> MotorData:
        """Read the rotors from the log's parameters, and the motors at the rate of the log."""
        return motor_data(records, self.settings)

    def fit(self, data: MotorData) -> FittedMotors:
        """Fit what was excited, and bound every parameter by the color of the errors."""
        return fit_motor_data(data, self.settings)

    def verify(self, data: MotorData, fitted: FittedMotors, records: Sequence[FlightRecord]) -> Verifications:
        """Predict the accelerations of further logs by the identified values; a finding names what cannot be judged."""
        problem = fitted.fit.problem
        predictor = MotorPredictor(
            parameters=problem.parameters.unpack(fitted.fit.solution.theta),
            layout=data.layout,
            kind=data.kind,
            axes=problem.axes,
            reference_v=data.reference_v,
            scaled=scale_of(self.settings.known, fitted.axes) is not None,
            tested=_flown_outputs(data),
            choices=self.settings,
        )
        return predictor.predict(records, VerifySettings(), Selection(fitted=data.flights, unseen=())).found

    def checks(self, fitted: FittedMotors, found: Verifications) -> Checks:  # noqa: ARG002 - as all methods
        """Scores of the excited axes of each stretch."""
        return Checks(
            records={
                f"{check.record} at {check.maneuver.start_s:.1f} s": dict(check.scores) for check in found.maneuvers
            }
        )

    def describe(self, data: MotorData, fitted: FittedMotors) -> FitReport:  # noqa: ARG002 - as all methods
        """Fits of the stretches, rotors and thrust."""
        response, solution = no_response(fitted.structure), fitted.fit.solution
        combinations = unseen_combinations(fitted.parameters, fitted.bounds)
        return FitReport(
            fit=Fit(
                method=self.settings.method,
                outputs=fitted.channels,
                end=FitEnd(
                    weights="absolute" if self.settings.method == "accelerations" else "likelihood",
                    outcome=solution.outcome.value,
                    evaluations=solution.evaluations,
                    trace=tuple(solution.trace),
                    inflation=fitted.bounds.inflation,
                ),
                fit_percent=fit_percents(fitted.moved, fitted.channels),
                hold="first" if fitted.data.kind == "speed" else "zero",
                minima=searched_minima(fitted.search),
                search=search_summary(fitted.search),
                bootstrap=fitted.bootstrap.summary if fitted.bootstrap else None,
                records=tuple(_record_fit(motion) for motion in fitted.moved),
            ),
            data=FittedData(
                response=response,
                direct=None,
                model_response=response.values,
                used=np.zeros(response.values.shape, dtype=np.bool_),
                simulated=tuple(simulated_record(motion, fitted.channels) for motion in fitted.moved),
            ),
            combinations=[found for found in combinations if not _expected(found, fitted)],
            motors=_physics(fitted, self.settings.known),
        )

    def remarks(self, data: MotorData, fitted: FittedMotors, report: FitReport) -> Sequence[Finding]:  # noqa: ARG002 - as all methods
        """On what was excited, what stays undetermined, and what physics does not allow."""
        return (
            *judge_motors(fitted, self.settings, report.fit.fit_percent or {}),
            *judge_combinations(report.combinations),
            *judge_minima(fitted.search, fitted.parameters, fitted.bounds),
            *(fitted.bootstrap.findings if fitted.bootstrap else ()),
        )


def _expected(found: Combination, fitted: FittedMotors) -> bool:
    """Whether a combination needs no words: terms of one curve, and delays that are nearly none."""
    names = set(found.vector)
    curve = fitted.curve == "polynomial" and names <= set(TERMS_OF_CURVE["polynomial"])
    return curve or names <= {*DELAYS}


def _record_fit(moved: Motion) -> RecordFit:
    record = moved.flight.record
    return RecordFit(
        record=record.name,
        start_s=record.start_s,
        stop_s=float(record.time_s[-1]),
        samples=record.samples,
        sample_rate_hz=record.sample_rate_hz,
        fit_percent={name: score.nrmse_fit_percent for name, score in scores(moved).items()},
    )


def straightening_of(flights: Sequence[Flight]) -> Straightening | None:
    """How the autopilot makes outputs of demands, by the first log; none that only passes them on."""
    known = linearization_of(flights[0].record) if flights else None
    if known is None or known == Linearization():
        return None
    shares = []
    for flight in flights:
        outputs, maneuver = or_none(logged_outputs, flight.record), flight.maneuver
        if outputs is not None:
            inside = (outputs.time_s >= maneuver.start_s) & (outputs.time_s <= maneuver.stop_s)
            shares.append(known.demands(np.maximum(outputs.values[:, inside], known.low)).ravel())
    together = np.concatenate(shares) if shares else np.zeros(0)
    if not together.size:
        return None
    return Straightening(expo=known.expo, low=known.low, high=known.high, hover_share=float(together.mean()))


def _flown_outputs(data: MotorData) -> tuple[float, float]:
    """Range of the outputs but for one percent at each end."""
    low, high = np.percentile(np.concatenate([record.outputs.ravel() for record in data.records]), (1.0, 99.0))
    return float(low), float(high)


def _physics(fitted: FittedMotors, known: Mapping[str, float]) -> MotorPhysics:
    data = fitted.data
    counted = [[axis for axis in filters if axis != "weight"] for filters in fitted.fit.problem.filters]
    return MotorPhysics(
        layout=data.layout.name,
        arm_m=data.layout.arm if data.layout.arm_known else None,
        rotors=tuple(tuple(float(number) for number in place) for place in data.layout.positions),
        spins=tuple(float(spin) for spin in data.layout.spins),
        outputs=data.kind,
        source=data.histories[0].source,
        outputs_rate_hz=min(history.sample_rate_hz for history in data.histories),
        curve=fitted.curve,
        curve_assumed=fitted.curve_assumed,
        reference_v=data.reference_v,
        hover_output=fitted.hover_output,
        load_factor=fitted.load_factor,
        flown_outputs=_flown_outputs(data),
        scale=scale_of(known, fitted.axes),
        straightening=straightening_of(data.flights),
        derived=dict(fitted.derived),
        logs=fitted.logs,
        voltage=fitted.voltage,
        both_ways=tuple(
            InertiaEstimate(
                axis=inertia.axis,
                parameter=inertia.parameter,
                unit=inertia.unit,
                plain=inertia.plain,
                corrected=inertia.corrected,
                std=inertia.deviations,
                agrees=inertia.agrees,
            )
            for inertia in fitted.both
        ),
        excitation=tuple(
            ExcitedFlight(
                record=flight.record.name,
                start_s=flight.record.start_s,
                stop_s=float(flight.record.time_s[-1]),
                sample_rate_hz=flight.record.sample_rate_hz,
                correlation={axis: excitation.correlation for axis, excitation in excited.items()},
                counted=tuple(axes),
                band_hz={axis: excitation.band_hz for axis, excitation in excited.items()},
            )
            for flight, excited, axes in zip(data.stretches, fitted.fit.excitations, counted, strict=True)
        ),
    )
