"""Responses to set-points that have just been fitted, simulated through flights that were not.

Whole records are simulated, or what stands out in them, with the hold, the unknowns and the noise of the fit.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.checking.maneuvers import remarks_on
from rotorid.checking.predictions import fitted_before, not_verified
from rotorid.data.findings import Finding
from rotorid.data.record import STANDARD_UNITS, FlightRecord
from rotorid.errors import reason_of
from rotorid.fits.time.fit import TimeFit, growth
from rotorid.fitting.time.output_error import Fitted as Simulated
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, time_records, with_surroundings
from rotorid.flights.selection import Selection, select_records
from rotorid.models.structure import LinearStructure, connected
from rotorid.results.model import Verifications
from rotorid.results.segment import Segment
from rotorid.settings.identifying import IdentifySettings
from rotorid.typing import FloatArray
from rotorid.verification.scores import j_rms
from rotorid.verification.verification import Scores, Verification

_PROGRESS = logging.getLogger("rotorid.progress")

_REST_S = 1.5
"""Of quiet time around a doublet: the answer to its end belongs to it."""


@dataclass(frozen=True)
class FittedResponses:
    """A model behind set-points, and the records that it was fitted to.

    Parameters
    ----------
    records
        What it was fitted to.
    """

    fitted: TimeFit
    records: TimeRecords
    settings: IdentifySettings

    def predict(self, records: Sequence[FlightRecord], fitted: Selection) -> Verifications:
        """Simulate further logs, and what of the fitted logs was kept unseen.

        Parameters
        ----------
        records
            Further logs.
        fitted
            Flights that the model was fitted to, and those of the same logs that it was not.
        """
        parts = [self._whole(record, fitted) for record in records]
        parts += [self._short(flight) for flight in fitted.unseen]
        return Verifications(
            maneuvers=tuple(check for part in parts for check in part.maneuvers),
            findings=tuple(finding for part in parts for finding in part.findings),
        )

    def _whole(self, record: FlightRecord, fitted: Selection) -> Verifications:
        """A further log, without its fitted parts."""
        _PROGRESS.info(f"simulating {record.source.name}")
        structure = self.fitted.structure
        fitted_too: list[Finding] = []
        try:
            flights = select_records(structure, [record], replace(self.settings, segments=())).selection.fitted
            new = [flight for flight in flights if not fitted.fits(flight)]
            fitted_too += [fitted_before(flight) for flight in flights if fitted.fits(flight)]
            checks = self._simulated(structure, new) if new else []
        except Exception as failure:
            # A log that fails, by a fault of ours too, ends no other: it is listed with its reason.
            error = reason_of(failure, f"the prediction of {record.source.name}")
            return Verifications(findings=(*fitted_too, not_verified(record, error.came)))
        return _remarked(checks, fitted_too)

    def _short(self, flight: Flight) -> Verifications:
        """A doublet or multistep of a fitted log, by the responses to the set-points that it moves."""
        moved = [
            name
            for name in self.fitted.structure.inputs
            if any(samples.values.size and float(np.ptp(samples.values)) > 0.0 for samples in flight.samples(name))
        ]
        if not moved:
            return Verifications()
        structure = connected(self.fitted.structure.select(inputs=moved))
        try:
            wider = with_surroundings([flight], _REST_S, (*structure.inputs, *structure.outputs))
            return _remarked(self._simulated(structure, wider))
        except Exception as failure:
            # Of one maneuver alike.
            error = reason_of(failure, f"the prediction of {flight.record.source.name}")
            return Verifications(findings=(not_verified(flight.record, error.came),))

    def _simulated(self, structure: LinearStructure, flights: Sequence[Flight]) -> list[Verification]:
        """Flights by a part of the fitted model, with the hold of the fit."""
        fitted, hold = self.fitted, self.records.hold
        unseen = time_records(structure, flights, replace(self.settings, segments=(), hold=hold), every_input=False)
        rows = [fitted.structure.outputs.index(name) for name in structure.outputs]
        problem = TimeProblem(
            structure=structure,
            parameters=structure.parameters,
            records=unseen.data,
            hold=hold,
            unknowns=fitted.problem.unknowns,
            noise=fitted.problem.noise[np.ix_(rows, rows)],
        )
        predicted = problem.predicted(structure.parameters.pack())
        shifts = estimated_shifts(problem, predicted)
        return [
            replace(_verification(structure, segment, simulated, shift), biases=np.zeros(len(fitted.structure.states)))
            for segment, simulated, shift in zip(unseen.segments, predicted, shifts, strict=True)
        ]


def _remarked(checks: Sequence[Verification], others: Sequence[Finding] = ()) -> Verifications:
    remarks = (finding for check in checks for finding in remarks_on(check))
    return Verifications(maneuvers=tuple(checks), findings=(*others, *remarks))


def estimated_shifts(problem: TimeProblem, predicted: Sequence[Simulated]) -> list[FloatArray]:
    """The output shifts in predictions with unknowns estimated, for each record, shape ``(y,)``.

    A prediction is the response to the inputs, that to the initial state, and the shift. The last two are separated
    again by the motions that initial states cause. Where one of those is a constant, as behind an integrator, nothing
    separates it from a shift, and both get a share.
    """
    if "output_shift" not in problem.unknowns:
        return [np.zeros(len(problem.structure.outputs)) for _ in predicted]
    from rotorid.simulation.linear import simulate_linear

    system = problem.structure.matrices(problem.parameters.values)
    unshifted = replace(problem, unknowns=()).predicted(problem.parameters.pack())
    shifts = []
    for fitted, driven in zip(predicted, unshifted, strict=True):
        still = np.zeros_like(fitted.record.inputs)
        states = np.eye(len(problem.structure.states) if "initial_state" in problem.unknowns else 0)
        rate_hz = fitted.record.sample_rate_hz
        free = [simulate_linear(system, still, sample_rate_hz=rate_hz, x0=x0).ravel() for x0 in states]
        outputs, samples = fitted.predicted.shape
        columns = np.column_stack([*free, np.repeat(np.eye(outputs), samples, axis=0)])
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        found = np.linalg.lstsq(columns / size, (fitted.predicted - driven.predicted).ravel(), rcond=None)[0] / size
        shifts.append(np.asarray(found[len(free) :]))
    return shifts


def _verification(
    structure: LinearStructure, segment: Segment, simulated: Simulated, shift: FloatArray
) -> Verification:
    measured, predicted = simulated.record.outputs, simulated.predicted
    return Verification(
        record=segment.record,
        maneuver=segment.maneuver,
        time_s=segment.history.time_s,
        inputs=simulated.record.inputs,
        measured=measured,
        predicted=predicted,
        input_names=structure.inputs,
        output_names=structure.outputs,
        scores={
            name: replace(Scores.plain(measured[row], predicted[row]), reference_shift=float(shift[row]))
            for row, name in enumerate(structure.outputs)
        },
        j_rms=j_rms(measured - predicted, [STANDARD_UNITS.get(name, "1") for name in structure.outputs]),
        growth_1_s=growth(structure, structure.parameters),
    )
