"""Thrust, inflow, drag and inertia of a vehicle, from hover to fast flight: the method of ``physical.flight``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.checking.flight import FlightPredictor, torque_bands
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.fits.flight.fit import fit_flight_data
from rotorid.fits.flight.fitted import FittedFlight, drag_points, fit_percents, force_scores, simulated_record
from rotorid.fits.flight.remarks import judge_flight
from rotorid.fits.remarks import judge_combinations
from rotorid.flights.flight_data import FlightMotion, flight_data
from rotorid.flights.selection import Selection
from rotorid.identifying.methods import FitReport
from rotorid.identifying.motors import straightening_of
from rotorid.models.flight import FLIGHT_PARAMETERS, INERTIA
from rotorid.models.motors import TERMS_OF_CURVE
from rotorid.results.model import FittedData, Verifications, no_response
from rotorid.results.summary import (
    Checks,
    Derived,
    ExcitedFlight,
    Fit,
    FitEnd,
    FlightLimits,
    FlightOfLog,
    FlightPhysics,
    LadderStep,
    MotorOctave,
    MotorPhysics,
    RecordFit,
)
from rotorid.settings.motors import MotorSettings
from rotorid.settings.verifying import VerifySettings
from rotorid.uncertainty.identifiability import Combination, unseen_combinations


@dataclass(frozen=True, kw_only=True)
class Flights:
    """Fit the force and the moment of whole flights (:mod:`rotorid.fitting.flight`).

    Parameters
    ----------
    settings
        What is known of the vehicle, and how to read the logs.
    """

    settings: MotorSettings

    def prepare(self, records: Sequence[FlightRecord]) -> FlightMotion:
        """Read rotors and motors as for ``physical.motors``, with velocity and attitude where they are logged."""
        return flight_data(records, self.settings)

    def fit(self, data: FlightMotion) -> FittedFlight:
        """Fit force and moment; bound every number by its scatter within and between flights."""
        return fit_flight_data(data, self.settings)

    def verify(self, data: FlightMotion, fitted: FittedFlight, records: Sequence[FlightRecord]) -> Verifications:
        """Predict force and moment of further logs; a finding names what cannot be judged."""
        fit = fitted.fit
        predictor = FlightPredictor(
            parameters=fitted.parameters,
            airframe=fit.airframe,
            layout=data.layout,
            kind=data.kind,
            velocity=fit.velocity,
            tested=fit.tested,
            bands_hz=torque_bands(
                [(octave.axis, octave.low_hz, octave.high_hz) for octave in fit.octaves if octave.kept]
            ),
            windy=bool(np.isfinite(fit.winds).any()),
            cutoff_hz=fit.cutoff_hz,
            scaled=data.given.scaled,
            reference_v=data.motors.reference_v,
            choices=self.settings,
        )
        return predictor.predict(records, VerifySettings(), Selection(fitted=data.flights, unseen=())).found

    def checks(self, fitted: FittedFlight, found: Verifications) -> Checks:  # noqa: ARG002 - as all methods
        """Scores of each stretch, of what it judges."""
        return Checks(
            records={
                f"{check.record} at {check.maneuver.start_s:.1f} s": {name: check.scores[name] for name in check.moved}
                for check in found.maneuvers
            }
        )

    def describe(self, data: FlightMotion, fitted: FittedFlight) -> FitReport:
        """Fits of the stretches, rotors, thrust and air."""
        response = no_response(fitted.structure)
        return FitReport(
            fit=Fit(
                method="equation_error",
                outputs=("ax", "ay", "az"),
                end=FitEnd(
                    weights="likelihood",
                    outcome="converged",
                    evaluations=len(fitted.fit.ladder) + 1,
                    trace=(),
                    inflation=fitted.bounds.inflation,
                ),
                fit_percent=fit_percents(fitted),
                hold="first" if data.kind == "speed" else "zero",
                records=tuple(
                    RecordFit(
                        record=flown.flight.record.name,
                        start_s=flown.flight.record.start_s,
                        stop_s=float(flown.flight.record.time_s[-1]),
                        samples=flown.flight.record.samples,
                        sample_rate_hz=flown.flight.record.sample_rate_hz,
                        fit_percent={
                            name: score.nrmse_fit_percent
                            for name, score in force_scores(flown, fitted.channels).items()
                        },
                    )
                    for flown in fitted.predicted
                ),
            ),
            data=FittedData(
                response=response,
                direct=None,
                model_response=response.values,
                used=np.zeros(response.values.shape, dtype=np.bool_),
                simulated=tuple(simulated_record(flown) for flown in fitted.predicted),
            ),
            combinations=tuple(_unseen(fitted)),
            motors=_motors(fitted),
            flight=flight_physics(fitted),
        )

    def remarks(self, data: FlightMotion, fitted: FittedFlight, report: FitReport) -> Sequence[Finding]:  # noqa: ARG002 - as all methods
        """On what was assumed, what stays undetermined, and what physics does not allow."""
        return (
            *judge_flight(fitted, self.settings, report.fit.fit_percent or {}),
            *judge_combinations(report.combinations),
        )


def _unseen(fitted: FittedFlight) -> Iterator[Combination]:
    """What the flights cannot separate; a place that may be zero is no less known for a large share of it."""
    found = unseen_combinations(fitted.parameters, fitted.bounds) if fitted.bounds.names else ()
    for one in found:
        if not all(FLIGHT_PARAMETERS[name].absolute for name in one.names or [max(one.vector, key=_size_in(one))]):
            yield one


def _size_in(one: Combination) -> Callable[[str], float]:
    return lambda name: abs(one.vector[name])


def flight_physics(fitted: FittedFlight) -> FlightPhysics:
    """The air of a fit, as results hold it."""
    fit, data = fitted.fit, fitted.data
    airframe, tested = fit.airframe, fit.tested
    return FlightPhysics(
        velocity=fit.velocity,
        velocity_source=data.sources.get("velocity", ""),
        disc_m2=airframe.disc_m2,
        disc_assumed=data.given.disc_assumed,
        density_kg_m3=airframe.density_kg_m3,
        cutoff_hz=fit.cutoff_hz,
        ladder=tuple(
            LadderStep(terms=rung.terms, before_n=rung.before, after_n=rung.after, entered=rung.entered, why=rung.why)
            for rung in fit.ladder
        ),
        missing=dict(fit.missing),
        octaves=tuple(
            MotorOctave(
                axis=octave.axis,
                low_hz=octave.low_hz,
                high_hz=octave.high_hz,
                correlation=octave.correlation,
                fitted=octave.kept,
            )
            for octave in fit.octaves
        ),
        logs=tuple(_of_log(fitted, number) for number in range(len(data.records))),
        limits=FlightLimits(edge_m_s=tested.edge, climb_m_s=tested.climb, load=tested.load, motors=tested.speed),
        hover={name: fitted.hover[name] for name in _OF_RESULT if name in fitted.hover},
        drag=drag_points(fitted),
        scatter=None if fit.errors is None else ("flights" if fit.errors.how == "flights" else "assumed"),
        predictor=dict(fit.predictor),
    )


def _of_log(fitted: FittedFlight, number: int) -> FlightOfLog:
    fit, record = fitted.fit, fitted.data.records[number]
    north, east = (float(value) for value in fit.winds[number])
    north_std, east_std = (float(value) for value in fit.wind_stds[number])
    blown = bool(np.isfinite([north, east]).all())
    ahead, right, down = (float(value) for value in fit.force_axes_n[number])
    return FlightOfLog(
        record=record.name,
        start_s=record.start_s,
        stop_s=float(record.time_s[-1]),
        sample_rate_hz=record.sample_rate_hz,
        wind_m_s=(north, east) if blown else None,
        wind_std_m_s=(north_std, east_std) if blown and bool(np.isfinite([north_std, east_std]).all()) else None,
        skew_s=float(fit.skews_s[number]),
        force_rms_n=float(fit.force_rms_n[number]),
        force_axes_n=(ahead, right, down),
        moment_rms_nm=float(fit.moment_rms_nm[number]) if fit.moment_rms_nm.size else None,
    )


def _motors(fitted: FittedFlight) -> MotorPhysics:
    """Rotors and thrust, for all that need no more than these."""
    data, fit = fitted.data, fitted.fit
    motors = data.motors
    low, high = np.percentile(np.concatenate([record.outputs.ravel() for record in data.records]), (1.0, 99.0))
    return MotorPhysics(
        layout=data.layout.name,
        arm_m=data.layout.arm,
        rotors=tuple(tuple(float(number) for number in place) for place in data.layout.positions),
        spins=tuple(float(spin) for spin in data.layout.spins),
        outputs=data.kind,
        source=motors.histories[0].source,
        outputs_rate_hz=min(history.sample_rate_hz for history in motors.histories),
        curve=_curve(fitted),
        reference_v=motors.reference_v,
        hover_output=fitted.hover["output"].value if "output" in fitted.hover else fit.hover.speed,
        load_factor=1.0,
        flown_outputs=(float(low), float(high)),
        scale="m" if data.given.scaled else None,
        straightening=straightening_of(data.flights),
        derived=_derived(fitted),
        excitation=tuple(_excited(fitted, number) for number in range(len(data.records))),
    )


def _derived(fitted: FittedFlight) -> dict[str, Derived]:
    """Thrust of a rotor in hover and its slope, by output where that is what is known of the motors."""
    names = {
        "thrust_hover": "thrust_hover",
        "thrust_slope": "output_slope" if "output_slope" in fitted.hover else "thrust_slope",
        "thrust_full": "thrust_full",
        "thrust_to_weight": "thrust_to_weight",
    }
    return {name: fitted.hover[own] for name, own in names.items() if own in fitted.hover}


_OF_RESULT = ("thrust_coefficient", "thrust_slope", "speed", "induced_velocity", "drag")
"""Numbers of hover that are about the air."""


def _curve(fitted: FittedFlight) -> str:
    """The thrust curve by its terms; one with several is a polynomial."""
    terms = {name for name in ("c_0", "c_1", "c_2") if fitted.fit.values.get(name, 0.0) != 0.0}
    return next((curve for curve, names in TERMS_OF_CURVE.items() if set(names) == terms), "polynomial")


def _excited(fitted: FittedFlight, number: int) -> ExcitedFlight:
    """Which axes the motors explain, and where; those of all flights together."""
    record, octaves = fitted.data.records[number], fitted.fit.octaves
    own = {axis: [octave for octave in octaves if octave.axis == axis] for axis in INERTIA}
    fits = {axis: [octave for octave in found if octave.kept] for axis, found in own.items()}
    return ExcitedFlight(
        record=record.name,
        start_s=record.start_s,
        stop_s=float(record.time_s[-1]),
        sample_rate_hz=record.sample_rate_hz,
        correlation={axis: max(octave.correlation for octave in found) for axis, found in own.items() if found},
        counted=("az", *(axis for axis in INERTIA if fits[axis])),
        band_hz={
            axis: (min(octave.low_hz for octave in found), max(octave.high_hz for octave in found))
            for axis, found in fits.items()
            if found
        },
    )
