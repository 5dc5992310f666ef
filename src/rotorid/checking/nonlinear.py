"""A nonlinear model on logs: whole flights from their first sample on, with nothing but the start estimated.

A model of large motion counts from no trim. Its inputs and outputs are taken as they stand in the log, over the longest
flight of each log or over intervals that were given, and it is simulated through them: what it misses adds up, which is
the test. Where the states begin is estimated from the record itself, since no model can know it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rotorid.checking.predictions import (
    NOTHING_FITTED,
    Predictions,
    Simulation,
    Trial,
    between,
    fixed_score,
    missing_outputs,
    piece_starts,
    plain_scores,
    predict_each,
    refuse_choices_of_responses,
    whole_flights,
)
from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, absolute_records, holds
from rotorid.flights.selection import Selection, require_reached
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.results.model import Verifications
from rotorid.results.segment import Segment
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verifying import VerifySettings
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear
from rotorid.typing import FloatArray
from rotorid.verification.driven import driven
from rotorid.verification.fixed_parameters import FixedParameterScores
from rotorid.verification.verification import Scores, Verification

_START_ROUNDS = 3
"""Estimates of the noise while a start is sought: it only weighs the outputs against each other."""


@dataclass(frozen=True)
class NonlinearPredictor:
    """A nonlinear model with its values."""

    about_trim: ClassVar[bool] = False

    equations: NonlinearStructure

    @property
    def parameters(self) -> ParameterSet:
        """Its values."""
        return self.equations.parameters

    @property
    def needed(self) -> str:
        """The flights that can judge it."""
        return f"a flight with {' or '.join(self.equations.outputs)}"

    def predict(
        self, records: Sequence[FlightRecord], settings: VerifySettings, fitted: Selection = NOTHING_FITTED
    ) -> Predictions:
        """Flights simulated from their start on, see :class:`rotorid.checking.predictions.Predictor`."""
        refuse_choices_of_responses(self.equations.name, settings)
        return predict_each(records, settings, fitted, lambda record: self._simulated(record, settings.segments))

    def trials(self, record: FlightRecord, settings: IdentifySettings) -> list[Trial]:
        """Flights of a log; their scores know neither horizon nor band."""
        require_reached(record, settings.segments)
        return [
            Trial(Flight(record, maneuver.maneuver), fixed_score(_compared(maneuver)))
            for maneuver in self._simulated(record, settings.segments).found.maneuvers
        ]

    def simulations(self, record: FlightRecord, settings: FlySettings) -> tuple[list[Simulation], list[Finding]]:
        """Whole flights, or pieces of them, with all outputs of the model."""
        equations = self.equations
        outputs = logged_outputs(equations, [record])
        if not outputs:
            raise InsufficientDataError(
                f"it contains none of {', '.join(equations.outputs)}", needed="an output of the model to start from"
            )
        logged = equations.select(outputs)
        flights = whole_flights([record], settings.segments)
        records = flown_records(logged, flights, IdentifySettings(hold=settings.hold))
        found = [
            self._simulation(segment, data, logged, Scheme(hold=records.hold), settings.pieces_s)
            for segment, data in zip(records.segments, records.data, strict=True)
        ]
        return found, [*_remarks(records), *missing_outputs(equations.outputs, outputs, record)]

    def _simulated(self, record: FlightRecord, segments: Sequence[Maneuver]) -> Predictions:
        flights, whole = whole_flights([record], segments), self.equations
        outputs = logged_outputs(whole, [record])
        if not outputs:
            raise InsufficientDataError(
                f"{record.source.name} contains none of {', '.join(whole.outputs)}",
                needed="a log with an output of the model",
            )
        logged = whole.select(outputs)
        records = flown_records(logged, flights)
        problem = _fixed_problem(logged, whole.parameters, records.data, Scheme(hold=records.hold))
        fit = fit_nonlinear(problem, rounds=_START_ROUNDS)
        pairs = zip(records.segments, fit.problem.predicted(fit.solution.theta), strict=True)
        checks = [_verification(segment, one.record, one.predicted, logged) for segment, one in pairs]
        if not any(check.moved for check in checks):
            raise InsufficientDataError(
                f"no input moved {' or '.join(outputs)} clearly",
                needed=f"a flight in which {' or '.join(whole.inputs)} moves",
            )
        left = [name for name in whole.outputs if name not in outputs]
        return Predictions(
            found=Verifications(
                maneuvers=tuple(check for check in checks if check.moved),
                findings=(
                    *_remarks(records),
                    *(remark("missing_channel", name, f"{name} is not logged, so it was not judged.") for name in left),
                ),
            ),
            flights=flights,
        )

    def _simulation(
        self, segment: Segment, data: TimeData, logged: NonlinearStructure, scheme: Scheme, pieces_s: float | None
    ) -> Simulation:
        equations = self.equations
        pieces = [data] if pieces_s is None else list(data.pieces(pieces_s))
        starts = self._starts(pieces, logged, scheme)

        def outputs_at(values: Mapping[str, float]) -> FloatArray:
            rows = [
                simulate_nonlinear(
                    equations,
                    values,
                    piece.inputs,
                    sample_rate_hz=piece.sample_rate_hz,
                    x0=start,
                    before=piece.before,
                    scheme=scheme,
                )
                for piece, start in zip(pieces, starts, strict=True)
            ]
            return np.hstack(rows)

        measured = np.full((len(equations.outputs), data.samples), np.nan)
        for name, values in zip(logged.outputs, data.outputs, strict=True):
            measured[equations.outputs.index(name)] = values
        return Simulation(
            record=segment.record,
            maneuver=segment.maneuver,
            time_s=segment.history.time_s,
            inputs=data.inputs,
            measured=measured,
            input_names=equations.inputs,
            output_names=equations.outputs,
            outputs_at=outputs_at,
            starts=piece_starts(pieces),
            held=scheme.hold == "zero",
            moved=driven(equations, data.inputs),
        )

    def _starts(self, pieces: Sequence[TimeData], logged: NonlinearStructure, scheme: Scheme) -> FloatArray:
        """Start of each piece, shape ``(pieces, x)``: the best fit to the measurement, else its first sample."""
        equations = self.equations
        problem = _fixed_problem(logged, equations.parameters, pieces, scheme)
        found = fit_nonlinear(problem, rounds=_START_ROUNDS).estimate.starts
        whole = np.zeros((len(pieces), len(equations.states)))
        for number, piece in enumerate(pieces):
            first = dict(zip(logged.outputs, piece.outputs[:, 0].tolist(), strict=True))
            first |= dict(zip(logged.inputs, piece.inputs[:, 0].tolist(), strict=True))
            whole[number] = _measured_start(equations, first)
            for state, value in zip(logged.states, found[number], strict=True):
                whole[number, equations.states.index(state)] = value
        return whole


def logged_outputs(structure: NonlinearStructure, records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Outputs in every log, logged or computed."""
    return tuple(name for name in structure.outputs if all(holds(record, name) for record in records))


def flown_records(
    structure: NonlinearStructure, flights: Sequence[Flight], settings: IdentifySettings | None = None
) -> TimeRecords:
    """Flights as inputs and outputs of a model, as logged."""
    return absolute_records(
        flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings or IdentifySettings()
    )


def _remarks(records: TimeRecords) -> list[Finding]:
    """Remarks on the way from the logs: neither motor lag nor delay of a small multirotor is asked of a flight."""
    return [finding for finding in records.findings if "needed_hz" not in finding.numbers]


def _fixed_problem(
    structure: NonlinearStructure, parameters: ParameterSet, data: Sequence[TimeData], scheme: Scheme
) -> NonlinearProblem:
    """The start of each record, with every parameter fixed at its value, or at that of its tie."""
    values = parameters.values
    fixed = [replace(parameter, value=values[parameter.name], status="fixed", tied=None) for parameter in parameters]
    return NonlinearProblem(structure=structure, parameters=ParameterSet(fixed), records=tuple(data), scheme=scheme)


def _measured_start(equations: NonlinearStructure, first: Mapping[str, float]) -> FloatArray:
    """States from a first sample; zero if not measured."""
    known = {**equations.constants, **first}
    starts = {state: expression for state, expression in equations.starts.items() if expression.names <= set(known)}
    return np.array([starts[state].evaluate(known) if state in starts else 0.0 for state in equations.states])


def _verification(
    segment: Segment, data: TimeData, predicted: FloatArray, structure: NonlinearStructure
) -> Verification:
    time_s = segment.history.time_s
    scores = {
        name: Scores.plain(measured, simulated)
        for name, measured, simulated in zip(structure.outputs, data.outputs, predicted, strict=True)
    }
    moved = driven(structure, data.inputs)
    shown = [name for name, one in scores.items() if math.isfinite(moved.judged(name, one.nrmse_fit_percent))]
    return Verification(
        record=segment.record,
        maneuver=between(segment.maneuver, time_s),
        time_s=time_s,
        inputs=data.inputs,
        measured=data.outputs,
        predicted=predicted,
        input_names=structure.inputs,
        output_names=structure.outputs,
        scores=scores,
        moved=tuple(shown),
    )


def _compared(check: Verification) -> FixedParameterScores:
    """A simulated flight as a comparison has it."""
    return FixedParameterScores(
        record=check.record,
        horizon_s=math.inf,
        scores=plain_scores(check.scores, check.moved),
        time_s=check.time_s - check.time_s[0],
        measured=check.measured,
        predicted=check.predicted,
    )
