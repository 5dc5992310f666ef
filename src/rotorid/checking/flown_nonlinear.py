"""A nonlinear model on logs: whole flights from their first sample on, with nothing but the start estimated.

A model of large motion counts from no trim. Its inputs and outputs are taken as they stand in the log, over the longest
flight of each log or over intervals that were given, and it is simulated through them: what it misses adds up, which is
the test. Where the states begin is estimated from the record itself, since no model can know it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.flights.flights import Flight, longest_flight
from rotorid.flights.segments import TimeRecords, absolute_records, holds
from rotorid.flights.selection import given_flights
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.results.model import SimulatedRecord
from rotorid.settings.settings import IdentifySettings
from rotorid.simulation.nonlinear import Scheme
from rotorid.typing import FloatArray
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores, Verification

_START_ROUNDS = 3
"""Estimates of the noise while a start is sought: it only weighs the outputs against each other."""


def whole_flights(records: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> tuple[Flight, ...]:
    """Intervals that were given, in every log that they reach into; else the longest flight of each log.

    Raises
    ------
    UsageError
        No given interval lies inside the logs.
    InsufficientDataError
        A log never flew.
    """
    if segments:
        return given_flights(records, segments)
    return tuple(Flight(record, _whole(record)) for record in records)


def _whole(record: FlightRecord) -> Maneuver:
    start_s, stop_s = longest_flight(record, guessed=False)
    return Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="found")


def logged_outputs(structure: NonlinearStructure, records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Outputs that every log holds, or what they can be reconstructed from."""
    return tuple(name for name in structure.outputs if all(holds(record, name) for record in records))


def flown_records(
    structure: NonlinearStructure, flights: Sequence[Flight], settings: IdentifySettings | None = None
) -> TimeRecords:
    """Flights as inputs and outputs of a model, as they stand in their logs."""
    return absolute_records(
        flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings or IdentifySettings()
    )


def simulated_through(
    structure: NonlinearStructure, parameters: ParameterSet, records: TimeRecords
) -> tuple[tuple[SimulatedRecord, ...], FloatArray]:
    """Every record as the model has it, all parameters held, and where each began, shape ``(r, x)``."""
    held = ParameterSet(tuple(replace(one, status="fixed", tied=None) for one in _valued(parameters)))
    problem = NonlinearProblem(
        structure=structure, parameters=held, records=records.data, scheme=Scheme(hold=records.hold)
    )
    fit = fit_nonlinear(problem, rounds=_START_ROUNDS)
    pairs = zip(records.segments, fit.problem.predicted(fit.solution.theta), strict=True)
    shown = tuple(
        SimulatedRecord(
            record=segment.record,
            maneuver=segment.maneuver,
            time_s=segment.history.time_s,
            inputs=one.record.inputs,
            measured=one.record.outputs,
            simulated=one.predicted,
        )
        for segment, one in pairs
    )
    return shown, fit.estimate.starts


def _valued(parameters: ParameterSet) -> ParameterSet:
    """The same with the values that ties give."""
    values = parameters.values
    return ParameterSet(tuple(replace(one, value=values[one.name]) for one in parameters))


def verified_through(
    structure: NonlinearStructure, parameters: ParameterSet, flights: Sequence[Flight]
) -> tuple[tuple[Verification, ...], tuple[Finding, ...]]:
    """Flights that were not fitted, measured and simulated from their start on.

    Raises
    ------
    InsufficientDataError
        The logs hold no output of the model, or gaps leave nothing.
    """
    logs = [record for record, _ in flights]
    outputs = logged_outputs(structure, logs)
    if not outputs:
        names = ", ".join(dict.fromkeys(record.source.name for record in logs))
        raise InsufficientDataError(
            f"{names} holds none of {', '.join(structure.outputs)}", needed="a log with an output of the model"
        )
    seen = structure.select(outputs)
    records = flown_records(seen, flights)
    shown, _ = simulated_through(seen, parameters, records)
    left = [name for name in structure.outputs if name not in outputs]
    findings = [remark("missing_channel", name, f"{name} is not in the logs, and was not judged.") for name in left]
    told = [finding for finding in records.findings if "needed_hz" not in finding.numbers]
    return tuple(_verification(one, seen) for one in shown), (*told, *findings)


def _verification(shown: SimulatedRecord, structure: NonlinearStructure) -> Verification:
    maneuver = replace(shown.maneuver, start_s=float(shown.time_s[0]), stop_s=float(shown.time_s[-1]))
    driven = [name for name, row in zip(structure.inputs, shown.inputs, strict=True) if np.ptp(row) > 0.0]
    moved, seen = structure.reached(driven), zip(structure.outputs, structure.output_equations, strict=True)
    return Verification(
        record=shown.record,
        maneuver=maneuver,
        time_s=shown.time_s,
        inputs=shown.inputs,
        measured=shown.measured,
        predicted=shown.simulated,
        input_names=structure.inputs,
        output_names=structure.outputs,
        scores={
            name: output_scores(measured, simulated)
            for name, measured, simulated in zip(structure.outputs, shown.measured, shown.simulated, strict=True)
        },
        moved=tuple(name for name, one in seen if one.names & (moved | set(driven)) or not driven),
    )


def output_scores(measured: FloatArray, simulated: FloatArray) -> Scores:
    """How one output was predicted, with nothing taken off."""
    mean = measured.mean()
    return Scores(
        nrmse_fit_percent=nrmse_fit_percent(measured, simulated),
        tic=theil_inequality(measured - mean, simulated - mean),
        rms=rms(measured - simulated),
        bias=0.0,
        reference_shift=0.0,
    )
