"""Verification on maneuvers that the fit has not seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.cutting import cut, other_sources
from rotorid.pipeline.fitting import Fitted
from rotorid.pipeline.hold_out import hold_out
from rotorid.pipeline.instruments import Flown, axis_of
from rotorid.pipeline.measure import Measured
from rotorid.pipeline.selection import RICH_KINDS, Selection
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.unseen_sweeps import judge_sweeps
from rotorid.signal.clock import missing_channel
from rotorid.signal.segment import find_excitations
from rotorid.typing import Axis
from rotorid.verify.scores import GOOD_FIT_PERCENT, GOOD_TIC, GUIDELINES, guidelines_met
from rotorid.verify.time_domain import verify_in_time
from rotorid.verify.verification import Verification

_REST_S = 0.5
_SHORTEST_S = 1.0


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
    """

    verifications: tuple[Verification, ...] = ()
    frequency: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Log:
    """One log with what the fit has not seen of it, or the cause why there is nothing."""

    record: FlightRecord
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
    axes = [axis_of(name) for name in fitted.structure.inputs]
    logs = _unseen(fitted, selection, verify, axes)
    attempts = _attempts(fitted, measured, logs, axes, settings, progress)
    parts: list[Checked] = []
    heard: list[_Log] = []
    causes = [(log, log.cause) for log in logs if log.cause]
    for members, attempt in attempts:
        try:
            parts.append(attempt())
            heard += members
        except InsufficientDataError as error:
            causes += [(log, error.came.rstrip(".")) for log in members]
    if not parts and not verify:
        held = hold_out(fitted.structure, selection.fitted, settings, progress)
        parts.append(Checked(frequency=held.costs, findings=held.findings))
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
    )


def _unseen(
    fitted: Fitted, selection: Selection, verify: Sequence[FlightRecord], axes: Sequence[Axis]
) -> tuple[_Log, ...]:
    own = {id(record): record for record, _ in selection.unseen}.values()
    logs = [_Log(record=mine, short=tuple(f for f in selection.unseen if f[0] is mine)) for mine in own]
    channels = (*fitted.structure.inputs, *fitted.structure.outputs)
    for record in verify:
        lacking = [name for name in channels if name not in record.channel_names]
        flown = [(record, m) for axis in axes for m in find_excitations(record, axis) if not selection.fits(record, m)]
        if lacking:
            logs.append(_Log(record=record, cause=missing_channel(record, lacking[0]).came))
        elif not flown:
            logs.append(
                _Log(record=record, cause=f"it holds no excitation of {' or '.join(axes)} beyond what was fitted")
            )
        else:
            short = tuple((r, m) for r, m in flown if m.kind not in RICH_KINDS)
            sweeps = tuple((r, m) for r, m in flown if m.kind in RICH_KINDS)
            logs.append(_Log(record=record, short=short, sweeps=sweeps))
    return tuple(logs)


def _attempts(
    fitted: Fitted,
    measured: Measured,
    logs: Sequence[_Log],
    axes: Sequence[Axis],
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> list[tuple[list[_Log], Callable[[], Checked]]]:
    """What to judge the model on, and the logs behind each: whatever fails leaves the others standing."""
    flying = [log for log in logs if log.sweeps]
    # A log that excites every input stands alone, so that a good one does not hide a bad one in a common average.
    alone = [log for log in flying if set(axes) <= {m.axis for _, m in log.sweeps}]
    together = [log for log in flying if log not in alone]
    groups = [*([log] for log in alone), *([together] if together else [])]
    return [
        *(([log], partial(_predict, fitted, measured, log.short, settings, progress)) for log in logs if log.short),
        *((group, partial(_judge, fitted, group, settings, progress)) for group in groups),
    ]


def _predict(
    fitted: Fitted,
    measured: Measured,
    short: Sequence[Flown],
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> Checked:
    inputs, outputs = fitted.structure.inputs, fitted.structure.outputs
    segments, findings = cut(
        short, channels=(*inputs, *outputs), shifts=settings.shifts, rest_s=_REST_S, progress=progress
    )
    checks = tuple(
        verify_in_time(
            fitted.system,
            segment.history,
            inputs=inputs,
            outputs=outputs,
            band_rad_s=fitted.band_rad_s,
            record=segment.record,
            maneuver=segment.maneuver,
        )
        for segment in segments
        if segment.history.duration_s >= _SHORTEST_S
    )
    if not checks:
        raise InsufficientDataError(
            f"its unseen maneuvers leave less than {_SHORTEST_S:g} s of data without a gap", needed="a longer maneuver"
        )
    remarks = (*findings, *other_sources(measured.segments, segments, outputs), *(f for c in checks for f in _poor(c)))
    return Checked(verifications=checks, findings=remarks)


def _judge(
    fitted: Fitted, logs: Sequence[_Log], settings: IdentifySettings, progress: Callable[[str], None]
) -> Checked:
    sweeps = [flown for log in logs for flown in log.sweeps]
    judged = judge_sweeps(
        fitted.structure,
        fitted.parameters,
        sweeps,
        band_rad_s=fitted.band_rad_s,
        settings=settings,
        progress=progress,
    )
    return Checked(frequency=judged.costs, findings=judged.findings)


def _poor(check: Verification) -> list[Finding]:
    where = f"{check.record} at {check.maneuver.start_s:.1f} s"
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=where,
            message=(
                f"{name} of the {check.maneuver.kind} at {check.maneuver.start_s:.1f} s is predicted with a Theil "
                f"coefficient of {scores.tic:.2f} (good: up to {GOOD_TIC:g}) and a fit of "
                f"{scores.nrmse_fit_percent:.0f} % (good: {GOOD_FIT_PERCENT:g} % and more)."
            ),
            numbers={"tic": scores.tic, "nrmse_fit_percent": scores.nrmse_fit_percent},
        )
        for name, scores in check.scores.items()
        if guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES
    ]


def _not_verified(log: _Log, cause: str, *, part: bool) -> Finding:
    name = log.record.source.name
    return Finding(
        kind="not_verified",
        severity="info" if part else "warning",
        where=name,
        message=f"{'A part of ' if part else ''}{name} did not verify the model: {cause}.",
    )
