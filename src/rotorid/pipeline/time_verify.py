"""Unseen records, simulated by a model that was fitted in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fit.time_problem import Fitted as Simulated
from rotorid.fit.time_problem import TimeProblem
from rotorid.pipeline.cutting import source_of
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import axes_of, is_command
from rotorid.pipeline.seen_data import seen_data
from rotorid.pipeline.selection import Selection
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_fit import TimeFitted, growth
from rotorid.pipeline.time_judge import nothing_unseen
from rotorid.pipeline.time_records import TimeRecords, time_records
from rotorid.pipeline.time_selection import select_records
from rotorid.pipeline.verification import Checked, UnseenLog, check_logs, unseen_logs
from rotorid.pipeline.verify_model import Candidate
from rotorid.pipeline.verify_time import remarks_on
from rotorid.typing import FloatArray
from rotorid.verify.scores import j_rms, nrmse_fit_percent, rms, theil_inequality
from rotorid.verify.verification import Scores, Verification


def check_in_time(
    fitted: TimeFitted,
    records: TimeRecords,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    progress: Callable[[str], None],
    *,
    band_rad_s: tuple[float, float] | None = None,
) -> Checked:
    """Judge a model on whatever it has not seen.

    Models of the vehicle are judged as those of the frequency domain are. Responses to set-points are simulated over
    whole records, or what stands out in them.

    Parameters
    ----------
    fitted
        The model.
    records, selection
        What it was fitted to.
    verify
        Further logs.
    settings, progress
        Choices of the run, and whom to tell.
    band_rad_s
        Where the data speak, as far as that is known.
    """
    structure = fitted.structure
    if all(is_command(name) for name in structure.inputs):
        return _as_flown(fitted, records, selection, verify, settings, progress, band_rad_s)
    parts = [_simulated(fitted, records, selection, record, settings, progress) for record in verify]
    if not parts:
        return Checked(findings=(nothing_unseen([one.record for one in records.segments]),))
    return Checked(
        verifications=tuple(check for checks, _ in parts for check in checks),
        findings=tuple(finding for _, findings in parts for finding in findings),
    )


def _as_flown(
    fitted: TimeFitted,
    records: TimeRecords,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    progress: Callable[[str], None],
    band_rad_s: tuple[float, float] | None,
) -> Checked:
    structure = fitted.structure
    candidate = Candidate(
        structure=structure,
        parameters=structure.parameters,
        band_rad_s=band_rad_s,
        sources={name: source_of(records.segments[0], name) for name in structure.outputs},
    )
    own = {id(record): record for record, _ in selection.unseen}.values()
    logs = [
        *(
            UnseenLog(record=one, outputs=structure.outputs, short=tuple(f for f in selection.unseen if f[0] is one))
            for one in own
        ),
        *unseen_logs(candidate, verify, axes_of(structure.inputs, structure.outputs), fits=selection.fits),
    ]
    if not logs:
        return Checked(findings=(nothing_unseen([one.record for one in records.segments]),))
    return check_logs(candidate, logs, settings, progress)


def _simulated(
    fitted: TimeFitted,
    records: TimeRecords,
    selection: Selection,
    record: FlightRecord,
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> tuple[list[Verification], list[Finding]]:
    progress(f"simulating {record.source.name}")
    structure = fitted.structure
    plain = replace(settings, segments=())
    seen: list[Finding] = []
    try:
        flown = select_records(structure, [record], plain).selection.fitted
        new = [item for item in flown if not selection.fits(*item)]
        seen += [seen_data(*item) for item in flown if selection.fits(*item)]
        if not new:
            return [], seen
        # The hold is that of the fit.
        unseen = time_records(structure, new, replace(plain, hold=records.hold), every_input=False)
        problem = TimeProblem(
            structure=structure,
            parameters=structure.parameters,
            records=unseen.data,
            hold=records.hold,
            unknowns=fitted.problem.unknowns,
            noise=fitted.problem.noise,
        )
        predicted = problem.predicted(structure.parameters.pack())
        shifts = estimated_shifts(problem, predicted)
    except (InsufficientDataError, ModelError) as error:
        return [], [*seen, _not_verified(record, error.came)]
    checks = [
        _check(fitted, segment, one, shift)
        for segment, one, shift in zip(unseen.segments, predicted, shifts, strict=True)
    ]
    return checks, [*seen, *(finding for check in checks for finding in remarks_on(check))]


def estimated_shifts(problem: TimeProblem, predicted: Sequence[Simulated]) -> list[FloatArray]:
    """The output shifts in predictions with unknowns estimated, for each record, shape ``(y,)``.

    A prediction is the response to the inputs, that to the initial state, and the shift. The last two are told apart
    again by the motions that initial states cause. Where one of those is a constant, as behind an integrator, nothing
    tells it from a shift, and both get a share.
    """
    if "output_shift" not in problem.unknowns:
        return [np.zeros(len(problem.structure.outputs)) for _ in predicted]
    from rotorid.simulate.linear import simulate_linear

    system = problem.structure.matrices(problem.parameters.values)
    alone = replace(problem, unknowns=()).predicted(problem.parameters.pack())
    shifts = []
    for one, driven in zip(predicted, alone, strict=True):
        still = np.zeros_like(one.record.inputs)
        states = np.eye(len(problem.structure.states) if "initial_state" in problem.unknowns else 0)
        rate_hz = one.record.sample_rate_hz
        free = [simulate_linear(system, still, sample_rate_hz=rate_hz, x0=x0).ravel() for x0 in states]
        outputs, samples = one.predicted.shape
        columns = np.column_stack([*free, np.repeat(np.eye(outputs), samples, axis=0)])
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        found = np.linalg.lstsq(columns / size, (one.predicted - driven.predicted).ravel(), rcond=None)[0] / size
        shifts.append(np.asarray(found[len(free) :]))
    return shifts


def _check(fitted: TimeFitted, segment: Segment, one: Simulated, shift: FloatArray) -> Verification:
    structure = fitted.structure
    measured, predicted = one.record.outputs, one.predicted
    trim = measured.mean(axis=1, keepdims=True)
    return Verification(
        record=segment.record,
        maneuver=segment.maneuver,
        time_s=segment.history.time_s,
        inputs=one.record.inputs,
        measured=measured,
        predicted=predicted,
        input_names=structure.inputs,
        output_names=structure.outputs,
        scores={
            name: Scores(
                nrmse_fit_percent=nrmse_fit_percent(measured[row], predicted[row]),
                tic=theil_inequality(measured[row] - trim[row], predicted[row] - trim[row]),
                rms=rms(measured[row] - predicted[row]),
                bias=0.0,
                reference_shift=float(shift[row]),
            )
            for row, name in enumerate(structure.outputs)
        },
        biases=np.zeros(len(structure.states)),
        j_rms=j_rms(measured - predicted, [STANDARD_UNITS.get(name, "1") for name in structure.outputs]),
        growth_1_s=growth(structure, structure.parameters),
    )


def _not_verified(record: FlightRecord, cause: str) -> Finding:
    name = record.source.name
    return Finding(
        kind="not_verified",
        severity="warning",
        where=name,
        message=f"{name} did not verify the model: {cause.rstrip('.')}.",
    )
