"""Inertia, thrust, motor lag and torque of a vehicle: logs in, physics with bounds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid import __version__
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord
from rotorid.documents.result import (
    BothWaysDocument,
    DerivedDocument,
    ExcitationDocument,
    FitDocument,
    MotorsDocument,
    ProvenanceDocument,
    RecordFitDocument,
    ResultDocument,
    ScoreDocument,
    VerificationDocument,
)
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.motors.fit import MotorProblem, excitations
from rotorid.models.motors import CURVE_TERMS, scale_of
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import to_toml
from rotorid.pipeline.assemble import (
    combination_documents,
    correlation_document,
    finding_documents,
    hashes,
    maneuver_document,
    matrices_document,
    parameter_documents,
    standard_deviations,
)
from rotorid.pipeline.frequency_fit import judge_combinations
from rotorid.pipeline.identification import no_response
from rotorid.pipeline.motor_data import MotorData, motor_data
from rotorid.pipeline.motor_fit import (
    CHANNELS,
    Motion,
    MotorIdentified,
    fit_motor_data,
    fit_percents,
    hover_model,
    judge_motors,
    levers_of,
    motions,
    scores,
    simulated_record,
)
from rotorid.pipeline.results import Identification
from rotorid.pipeline.settings import MODEL, MotorChoices
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.verification.scores import GOOD_TIC
from rotorid.verification.verification import Scores, Verification


class _Unseen(NamedTuple):
    """What logs that were not fitted say of the model."""

    moved: tuple[Motion, ...]
    findings: tuple[Finding, ...]


def identify_motors(
    records: Sequence[FlightRecord],
    choices: MotorChoices | None = None,
    *,
    verify: Sequence[FlightRecord] = (),
    command: Sequence[str] = (),
) -> Identification:
    """Identify inertia, thrust, motor lag and torque constant from motor outputs, gyros and accelerometer.

    The steps: read the rotors from the log's parameters, take the motors as fast as the log tells them, find what was
    excited, fit the chain of :mod:`rotorid.fitting.motors.fit`, and bound every parameter by the color of the errors.

    Parameters
    ----------
    records
        Logs of one vehicle.
    choices
        What is known of it, and how to read the logs.
    verify
        Further logs, kept unseen.
    command
        For the provenance.

    Raises
    ------
    InsufficientDataError
        The logs cannot tell; findings say why.
    UsageError, ModelError
        A choice is wrong.
    """
    choices = choices or MotorChoices()
    data = motor_data(records, choices)
    identified = fit_motor_data(data, choices)
    channels = [CHANNELS[axis] for axis in ("p", "q", "r", "az") if axis in identified.axes]
    fit = identified.fit
    moved = motions(fit.problem, fit.solution.theta, data.flights, fit.excitations)
    percents = fit_percents(moved, channels)
    unseen = _unseen(identified, records, verify, choices)
    combinations = [
        one for one in unseen_combinations(identified.parameters, identified.bounds) if not _expected(one, identified)
    ]
    findings = [
        *(finding for record in (*records, *verify) for finding in record.findings),
        *data.findings,
        *judge_motors(identified, choices, percents),
        *judge_combinations(combinations),
        *unseen.findings,
    ]
    provenance = _provenance(records, verify, choices, command, identified)
    made = _Made(identified, choices, hover_model(identified), moved, percents, unseen)
    document = _document(made).model_copy(
        update={
            "findings": finding_documents(findings),
            "identifiability": combination_documents(combinations),
            "provenance": provenance,
        }
    )
    return _identification(document, made, channels)


def _expected(one: Combination, identified: MotorIdentified) -> bool:
    """Whether a combination needs no words: terms of one curve, and delays that are nearly none."""
    names = set(one.vector)
    curve = identified.curve == "polynomial" and names <= set(CURVE_TERMS["polynomial"])
    return curve or names <= {"tau_gyro", "tau_accel"}


class _Made(NamedTuple):
    """Everything that a run has made, for its document."""

    identified: MotorIdentified
    choices: MotorChoices
    structure: LinearStructure
    moved: tuple[Motion, ...]
    percents: dict[str, float]
    unseen: _Unseen


def _unseen(
    identified: MotorIdentified,
    records: Sequence[FlightRecord],
    verify: Sequence[FlightRecord],
    choices: MotorChoices,
) -> _Unseen:
    """The accelerations of further logs, by the identified values; what cannot be judged is told."""
    seen = {record.source.sha256 for record in records}
    moved: list[Motion] = []
    findings: list[Finding] = []
    for record in verify:
        name = record.source.name
        if record.source.sha256 in seen:
            findings.append(_remark("seen_data", name, f"{name} was fitted, and does not count as unseen."))
            continue
        try:
            data = motor_data([record], replace(choices, segments=()), reference_v=identified.data.reference_v)
        except (InsufficientDataError, UsageError) as error:
            findings.append(_remark("not_verified", name, f"{name} was not judged: {error}"))
            continue
        if not _alike(data, identified.data):
            message = f"{name} is of another layout of rotors, or tells the motors in another way, and was not judged."
            findings.append(_remark("not_verified", name, message))
            continue
        one, remarks = _judged(identified, data)
        moved += one
        findings += remarks
    return _Unseen(tuple(moved), tuple(findings))


def _alike(one: MotorData, other: MotorData) -> bool:
    same = one.layout.rotors == other.layout.rotors and np.allclose(one.layout.positions, other.layout.positions)
    return same and np.array_equal(one.layout.spins, other.layout.spins) and one.kind == other.kind


def _judged(identified: MotorIdentified, data: MotorData) -> tuple[tuple[Motion, ...], list[Finding]]:
    problem = MotorProblem(
        records=data.records,
        levers=levers_of(data),
        parameters=identified.fit.problem.parameters,
        axes=identified.axes,
    )
    found = excitations(data.records, problem.levers)
    moved = motions(problem, identified.fit.solution.theta, data.flights, found)
    findings = [*data.findings]
    for one in moved:
        where = f"{one.flight.record.name} at {one.flight.record.start_s:.1f} s"
        if not one.counted:
            message = f"{where} moves no axis that was identified, and tells nothing of the model."
            findings.append(_remark("not_verified", where, message))
        findings += [
            warn(
                "poor_verification",
                f"{where}: {name}",
                f"{name} of {where} is predicted with a Theil coefficient of {score.tic:.2f}.",
                tic=score.tic,
                nrmse_fit_percent=score.nrmse_fit_percent,
            )
            for name, score in scores(one).items()
            if score.tic > GOOD_TIC
        ]
    return tuple(one for one in moved if one.counted), findings


def _remark(kind: str, where: str, message: str) -> Finding:
    return warn(kind, where, message)


def _document(made: _Made) -> ResultDocument:
    identified, structure = made.identified, made.structure
    solution, bounds = identified.fit.solution, identified.bounds
    channels = [CHANNELS[axis] for axis in ("p", "q", "r", "az") if axis in identified.axes]
    own = structure.parameters
    return ResultDocument(
        model=MODEL,
        inputs=list(structure.inputs),
        outputs=channels,
        states=list(structure.states),
        parameters=parameter_documents(identified.parameters, bounds),
        fit_percent=made.percents,
        fit=FitDocument(
            weights="likelihood",
            outcome=solution.outcome.value,
            evaluations=solution.evaluations,
            trace=list(solution.trace),
            inflation=bounds.inflation,
        ),
        method="prediction_error",
        hold="zero",
        records=_records(made),
        correlation=correlation_document(bounds),
        constants=dict(structure.constants),
        matrices=matrices_document(structure.matrices(own.values)),
        poles=[],
        verification=_verification(made.unseen),
        motors=_motors(made),
        provenance=ProvenanceDocument(version=__version__, command=[], inputs={}, settings={}, seed=made.choices.seed),
    )


def _records(made: _Made) -> list[RecordFitDocument]:
    return [
        RecordFitDocument(
            record=one.flight.record.name,
            start_s=one.flight.record.start_s,
            stop_s=float(one.flight.record.time_s[-1]),
            samples=one.flight.record.samples,
            sample_rate_hz=one.flight.record.sample_rate_hz,
            fit_percent={name: score.nrmse_fit_percent for name, score in scores(one).items()},
        )
        for one in made.moved
    ]


def _verification(unseen: _Unseen) -> VerificationDocument:
    return VerificationDocument(
        records={
            f"{one.flight.record.name} at {one.flight.record.start_s:.1f} s": {
                name: ScoreDocument(**score._asdict()) for name, score in scores(one).items()
            }
            for one in unseen.moved
        }
    )


def _motors(made: _Made) -> MotorsDocument:
    identified = made.identified
    data = identified.data
    counted = [[axis for axis in filters if axis != "weight"] for filters in identified.fit.problem.filters]
    return MotorsDocument(
        layout=data.layout.name,
        arm_m=data.layout.arm if data.layout.arm_known else None,
        rotors=data.layout.positions.tolist(),
        spins=data.layout.spins.tolist(),
        outputs=data.kind,
        source=data.histories[0].source,
        outputs_rate_hz=min(history.sample_rate_hz for history in data.histories),
        curve=identified.curve,
        curve_assumed=identified.curve_assumed,
        reference_v=data.reference_v,
        hover_output=identified.hover_output,
        flown_outputs=_flown_outputs(data),
        scale=scale_of(made.choices.known, identified.axes),
        derived={name: DerivedDocument(**one._asdict()) for name, one in identified.derived.items()},
        both_ways=[
            BothWaysDocument(
                axis=one.axis,
                parameter=one.parameter,
                unit=one.unit,
                plain=one.plain,
                corrected=one.corrected,
                std=one.deviations,
                agrees=one.agrees,
            )
            for one in identified.both
        ],
        excitation=[
            ExcitationDocument(
                record=flight.record.name,
                start_s=flight.record.start_s,
                stop_s=float(flight.record.time_s[-1]),
                sample_rate_hz=flight.record.sample_rate_hz,
                correlation={axis: one.correlation for axis, one in seen.items()},
                counted=axes,
            )
            for flight, seen, axes in zip(data.flights, identified.fit.excitations, counted, strict=True)
        ],
    )


def _flown_outputs(data: MotorData) -> tuple[float, float]:
    low, high = np.percentile(np.concatenate([record.outputs.ravel() for record in data.records]), (1.0, 99.0))
    return float(low), float(high)


def _provenance(
    records: Sequence[FlightRecord],
    verify: Sequence[FlightRecord],
    choices: MotorChoices,
    command: Sequence[str],
    identified: MotorIdentified,
) -> ProvenanceDocument:
    return ProvenanceDocument(
        version=__version__,
        command=list(command),
        inputs=hashes((*records, *verify)),
        settings=choices.as_json(),
        seed=choices.seed,
        sources={"motors": identified.data.histories[0].source},
        maneuvers=[maneuver_document(record, maneuver) for record, maneuver in identified.data.flown],
    )


def _verified(moved: Motion, motors: Sequence[str]) -> Verification:
    """An unseen stretch for the pictures of a report; what was excited counts as moved."""
    shown = simulated_record(moved, tuple(moved.rows))
    return Verification(
        record=shown.record,
        maneuver=shown.maneuver,
        time_s=shown.time_s,
        inputs=shown.inputs,
        measured=shown.measured,
        predicted=shown.simulated,
        input_names=tuple(motors),
        output_names=tuple(moved.rows),
        scores={name: Scores(**score._asdict()) for name, score in scores(moved).items()},
        moved=moved.counted,
    )


def _identification(document: ResultDocument, made: _Made, channels: Sequence[str]) -> Identification:
    structure = made.structure
    response = no_response(structure)
    known = standard_deviations(made.identified.bounds)
    return Identification(
        document=document,
        model_toml=to_toml(
            structure, structure.parameters, {n: s for n, s in known.items() if n in structure.parameters.names}
        ),
        response=response,
        beside=None,
        model_response=response.values,
        fitted=np.zeros(response.values.shape, dtype=np.bool_),
        segments=(),
        verifications=tuple(_verified(one, structure.inputs) for one in made.unseen.moved),
        simulated=tuple(simulated_record(one, channels) for one in made.moved),
    )
