"""Verification on maneuvers that the fit has not seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.building import require_channels
from rotorid.pipeline.fitting import Fitted
from rotorid.pipeline.hold_out import hold_out
from rotorid.pipeline.instruments import Flown, axes_of
from rotorid.pipeline.judged import Judged
from rotorid.pipeline.measure import Measured, default_band
from rotorid.pipeline.selection import RICH_KINDS, Selection, described, inside, of_axes, wholly_flown
from rotorid.pipeline.settings import IdentifySettings, MeasureSettings
from rotorid.pipeline.telling import telling, usual_motion
from rotorid.pipeline.unseen_sweeps import judge_sweeps
from rotorid.pipeline.verify_model import Candidate, candidate_of
from rotorid.pipeline.verify_time import predict_maneuvers, remarks_on
from rotorid.signal.segment import find_excitations
from rotorid.typing import Axis
from rotorid.verify.matching import LowPass
from rotorid.verify.verification import Verification


@dataclass(frozen=True, kw_only=True, eq=False)
class Checked:
    """What verification found.

    Parameters
    ----------
    verifications
        Unseen maneuvers in the time domain.
    frequency
        Cost of the model against each response of unseen sweeps, the worst where several logs were judged.
    findings
        Remarks.
    judged
        Unseen sweeps in the frequency domain, with the measured responses and those of the model.
    """

    verifications: tuple[Verification, ...] = ()
    frequency: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    judged: tuple[Judged, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class UnseenLog:
    """One log with what the fit has not seen of it, or the cause why there is nothing."""

    record: FlightRecord
    outputs: tuple[str, ...] = ()
    short: tuple[Flown, ...] = ()
    sweeps: tuple[Flown, ...] = ()
    cause: str = ""


def check(
    fitted: Fitted,
    measured: Measured,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> Checked:
    """Judge a fitted model on whatever it has not seen.

    Short maneuvers of the same logs and of further ones are predicted in the time domain, sweeps of further ones in
    the frequency domain. Where nothing was left over, the last fitted maneuver is held out of a second fit. A log that
    was given to verify and adds nothing is said to add nothing.
    """
    candidate = candidate_of(fitted, measured)
    axes = axes_of(fitted.structure.inputs, fitted.structure.outputs)
    own = {id(record): record for record, _ in selection.unseen}.values()
    logs = [
        *(
            UnseenLog(
                record=mine, outputs=fitted.structure.outputs, short=tuple(f for f in selection.unseen if f[0] is mine)
            )
            for mine in own
        ),
        *unseen_logs(candidate, verify, axes, fits=selection.fits),
    ]
    usual = usual_motion(measured, fitted.band_rad_s)
    found = check_logs(candidate, logs, settings, progress, usual=usual)
    if found.verifications or found.judged or verify:
        return found
    held = hold_out(fitted.problem.structure, selection.fitted, settings, progress)
    judged = (held,) if held.response is not None else ()
    return Checked(frequency=held.costs, findings=(*held.findings, *found.findings), judged=judged)


def check_logs(
    candidate: Candidate,
    logs: Sequence[UnseenLog],
    settings: MeasureSettings,
    progress: Callable[[str], None],
    *,
    vibration_filter: LowPass = "auto",
    usual: Mapping[str, float] | None = None,
) -> Checked:
    """Judge a model on logs that it has not seen; whatever fails leaves the others standing.

    Parameters
    ----------
    candidate
        The model.
    logs
        What there is to judge it on, see :func:`unseen_logs`.
    settings
        Choices of the run.
    progress
        Told what is being done.
    vibration_filter
        See :func:`rotorid.verify.time_domain.verify_in_time`.
    usual
        Motion of each output where the model was fitted, see :func:`rotorid.pipeline.telling.telling`.
    """
    parts: list[Checked] = []
    heard: list[UnseenLog] = []
    causes = [(log, log.cause) for log in logs if log.cause]
    for members, attempt in _attempts(candidate, logs, settings, progress, vibration_filter, usual or {}):
        try:
            parts.append(attempt())
            heard += members
        except InsufficientDataError as error:
            causes += [(log, error.came.rstrip(".")) for log in members]
    frequency: dict[str, float] = {}
    for part in parts:
        frequency |= {pair: max(cost, frequency.get(pair, 0.0)) for pair, cost in part.frequency.items()}
    return Checked(
        verifications=tuple(item for part in parts for item in part.verifications),
        frequency=frequency,
        findings=(
            *(finding for part in parts for finding in part.findings),
            *(_not_verified(log, cause, part=log in heard) for log, cause in causes),
        ),
        judged=tuple(item for part in parts for item in part.judged),
    )


def unseen_logs(
    candidate: Candidate,
    records: Sequence[FlightRecord],
    axes: Sequence[Axis],
    *,
    segments: Sequence[Maneuver] = (),
    fits: Callable[[FlightRecord, Maneuver], bool] = lambda _record, _maneuver: False,
) -> tuple[UnseenLog, ...]:
    """What each log has to judge a model on.

    Parameters
    ----------
    candidate
        The model; its channels are needed.
    records
        The logs.
    axes
        Axes of its inputs.
    segments
        Intervals to use instead of the excitations that are found.
    fits
        Whether a maneuver was fitted, which is no test.
    """
    given = of_axes(segments, axes)
    structure = candidate.structure
    logs = []
    for record in records:
        there = tuple(name for name in structure.outputs if not _lacking(record, [name]))
        # Without an input nothing can be predicted; of the outputs those that are there will do.
        lacking = _lacking(record, (*structure.inputs, *(there or structure.outputs)))
        found = [m for axis in axes for m in find_excitations(record, axis)]
        wanted = [described(record, m) for m in given if inside(record, m)] if segments else found
        flown = [(record, m) for m in wanted if not fits(record, m)]
        if lacking:
            logs.append(UnseenLog(record=record, cause=lacking))
        elif not flown:
            what = "no given segment" if segments else f"no excitation of {' or '.join(axes)} beyond what was fitted"
            logs.append(UnseenLog(record=record, cause=f"it holds {what}"))
        else:
            short = tuple((r, m) for r, m in flown if m.kind not in RICH_KINDS)
            short = short if segments else wholly_flown(short)
            sweeps = tuple((r, m) for r, m in flown if m.kind in RICH_KINDS)
            logs.append(UnseenLog(record=record, outputs=there, short=short, sweeps=sweeps))
    return tuple(logs)


def _lacking(record: FlightRecord, channels: Sequence[str]) -> str:
    """Why a record cannot be used, where it lacks a channel that cannot be made of others either."""
    try:
        require_channels(record, channels)
    except InsufficientDataError as error:
        return error.came
    return ""


def _attempts(
    candidate: Candidate,
    logs: Sequence[UnseenLog],
    settings: MeasureSettings,
    progress: Callable[[str], None],
    vibration_filter: LowPass,
    usual: Mapping[str, float],
) -> list[tuple[list[UnseenLog], Callable[[], Checked]]]:
    """What to judge the model on, and the logs behind each."""
    axes = set(axes_of(candidate.structure.inputs, candidate.structure.outputs))
    flying = [log for log in logs if log.sweeps]
    # A log that excites every input stands alone, so that a good one does not hide a bad one in a common average.
    alone = [log for log in flying if axes <= {m.axis for _, m in log.sweeps}]
    together = [log for log in flying if log not in alone]
    groups = [*([log] for log in alone), *([together] if together else [])]
    return [
        *(
            ([log], partial(_predict, candidate, log, settings, progress, vibration_filter, usual))
            for log in logs
            if log.short
        ),
        *((group, partial(_judge, candidate, group, settings, progress)) for group in groups),
    ]


def _predict(
    candidate: Candidate,
    log: UnseenLog,
    settings: MeasureSettings,
    progress: Callable[[str], None],
    vibration_filter: LowPass,
    usual: Mapping[str, float],
) -> Checked:
    checks, findings = predict_maneuvers(
        candidate, log.short, settings, progress, outputs=log.outputs, vibration_filter=vibration_filter
    )
    told = telling(checks, candidate, usual)
    if not told:
        raise InsufficientDataError("its short maneuvers move no output more than it moves before them")
    # Only what tells about the model is remarked on.
    said = [finding for check in checks for finding in remarks_on(check)]
    data = [finding for finding in findings if finding not in said]
    remarks = [finding for check in told for finding in remarks_on(check)]
    return Checked(verifications=told, findings=(*_without(candidate, [log], log.outputs), *data, *remarks))


def _judge(
    candidate: Candidate, logs: Sequence[UnseenLog], settings: MeasureSettings, progress: Callable[[str], None]
) -> Checked:
    sweeps = [flown for log in logs for flown in log.sweeps]
    outputs = tuple(name for name in candidate.structure.outputs if all(name in log.outputs for log in logs))
    if not outputs:
        raise InsufficientDataError("the logs have no output of the model in common")
    judged = judge_sweeps(
        candidate.structure if outputs == candidate.structure.outputs else candidate.structure.select(outputs=outputs),
        candidate.parameters,
        sweeps,
        band_rad_s=candidate.band_rad_s or default_band(sweeps, math.inf),
        settings=settings,
        progress=progress,
    )
    findings = (*_without(candidate, logs, outputs), *judged.findings)
    return Checked(frequency=judged.costs, findings=findings, judged=(judged,))


def _without(candidate: Candidate, logs: Sequence[UnseenLog], outputs: Sequence[str]) -> list[Finding]:
    """Outputs of the model that could not be judged, because a log does not hold them."""
    left_out = [name for name in candidate.structure.outputs if name not in outputs]
    where = ", ".join(log.record.source.name for log in logs)
    return [
        Finding(
            kind="missing_channel",
            severity="info",
            where=f"{where}: {name}",
            message=f"{where} holds no {name}, so that output of the model was not judged there.",
        )
        for name in left_out
    ]


def _not_verified(log: UnseenLog, cause: str, *, part: bool) -> Finding:
    name = log.record.source.name
    return Finding(
        kind="not_verified",
        severity="info" if part else "warning",
        where=name,
        message=f"{'A part of ' if part else ''}{name} did not verify the model: {cause}.",
    )
