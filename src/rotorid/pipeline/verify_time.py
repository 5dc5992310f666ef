"""Unseen maneuvers of one log, predicted in the time domain and judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.cutting import cut, source_of
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.measure import default_band
from rotorid.pipeline.settings import MeasureSettings
from rotorid.pipeline.verify_controller import RATES, Controllers
from rotorid.pipeline.verify_filters import with_known_delays, with_known_filters
from rotorid.pipeline.verify_loop import fly_maneuver, looped_axes
from rotorid.pipeline.verify_model import Candidate
from rotorid.verify.matching import LowPass
from rotorid.verify.scores import GOOD_FIT_PERCENT, GOOD_TIC
from rotorid.verify.time_domain import matched, verify_in_time
from rotorid.verify.verdict import disturbed_ahead, judged_horizon, poor_ahead, poor_outputs, verdict
from rotorid.verify.verification import Verification

REST_S = 0.5
"""Seconds before and after a maneuver that the open loop takes along."""

_AROUND_S = 3.5
_SETTLED_S = 0.5
_MOVING = 0.25
_SHORTEST_S = 1.0


def predict_maneuvers(
    candidate: Candidate,
    short: Sequence[Flown],
    settings: MeasureSettings,
    progress: Callable[[str], None],
    *,
    outputs: tuple[str, ...],
    vibration_filter: LowPass = "auto",
) -> tuple[tuple[Verification, ...], tuple[Finding, ...]]:
    """Predict short maneuvers of one log, and remark on how that went.

    Parameters
    ----------
    candidate
        The model.
    short
        Maneuvers of one log.
    settings
        Choices of the run.
    progress
        Told what is being done.
    outputs
        Outputs of the model that the log has.
    vibration_filter
        See :func:`rotorid.verify.time_domain.verify_in_time`.

    Raises
    ------
    InsufficientDataError
        Nothing of a second is left without a gap, or a channel is missing.
    """
    inputs = candidate.structure.inputs
    record = short[0][0]
    controllers = Controllers(record=record, given=candidate.controllers)
    segments, findings = cut(
        short,
        channels=(*inputs, *outputs),
        followers=controllers.channels(looped_axes(inputs, outputs)),
        shifts=settings.shifts,
        rest_s=_AROUND_S,
        progress=progress,
    )
    checks: list[Verification] = []
    remarks = list(findings)
    for segment in segments:
        start_s, stop_s = _active(segment)
        history = _within(segment.history, start_s - REST_S, stop_s + REST_S)
        if history is None or history.duration_s < _SHORTEST_S:
            continue
        judged = {name: source_of(segment, name) for name in outputs}
        system, said = with_known_delays(
            candidate.system_of(outputs), record, outputs, fitted=candidate.sources or {}, judged=judged
        )
        band = candidate.band_rad_s or default_band([(record, segment.maneuver)], history.sample_rate_hz)
        around = _around(segment, short)
        check = verify_in_time(
            system,
            history,
            inputs=inputs,
            outputs=outputs,
            band_rad_s=band,
            record=segment.record,
            maneuver=segment.maneuver,
            around=around,
            vibration_filter=vibration_filter,
        )
        read = [RATES[axis][0] for axis in looped_axes(inputs, outputs)]
        flown, why_not = fly_maneuver(
            with_known_filters(system, record, outputs, read=read, fitted=candidate.sources or {}, judged=judged),
            around,
            segment.maneuver,
            controllers,
            inputs=inputs,
            outputs=outputs,
            filtered=matched(band, check.low_pass_rad_s, around),
        )
        checks.append(replace(check, closed_loop=flown))
        remarks += [*(said or _other_source(candidate, segment, outputs)), *(f for f in why_not if f not in remarks)]
    if not checks:
        raise InsufficientDataError(
            f"its unseen maneuvers leave less than {_SHORTEST_S:g} s of data without a gap", needed="a longer maneuver"
        )
    return tuple(checks), (*remarks, *(f for check in checks for f in remarks_on(check)))


def _active(segment: Segment) -> tuple[float, float]:
    """A maneuver without the quiet time in which its own command does not move: noise alone tells of no model."""
    maneuver, name = segment.maneuver, f"{segment.maneuver.axis}_command"
    time_s = segment.history.time_s
    inside = (time_s >= maneuver.start_s) & (time_s <= maneuver.stop_s)
    if name not in segment.history.names or not inside.any():
        return maneuver.start_s, maneuver.stop_s
    command = segment.history[name]
    size = np.abs(command - np.median(command[inside]))
    moving = time_s[inside & (size > _MOVING * size[inside].max())]
    if not moving.size:
        return maneuver.start_s, maneuver.stop_s
    return max(maneuver.start_s, float(moving[0])), maneuver.stop_s


def _around(segment: Segment, short: Sequence[Flown]) -> TimeHistory:
    """A maneuver with the quiet time around it: as far as the maneuvers before and after it have died out."""
    maneuver, history = segment.maneuver, segment.history
    before = [m.stop_s + _SETTLED_S for _, m in short if m.stop_s <= maneuver.start_s]
    after = [m.start_s for _, m in short if m.start_s >= maneuver.stop_s]
    start_s = min(max([history.start_s, *before]), maneuver.start_s - REST_S)
    stop_s = max(min([float(history.time_s[-1]), *after]), maneuver.stop_s + REST_S)
    return _within(history, start_s, stop_s) or history


def _within(history: TimeHistory, start_s: float, stop_s: float) -> TimeHistory | None:
    """The part of a history between two instants."""
    # A stamp that is meant may miss by a rounding error.
    slack = 1e-6 / history.sample_rate_hz
    inside = np.flatnonzero((history.time_s >= start_s - slack) & (history.time_s <= stop_s + slack))
    if not inside.size:
        return None
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    return replace(history, values=history.values[:, part], start_s=float(history.time_s[inside[0]]))


def _other_source(candidate: Candidate, segment: Segment, outputs: Sequence[str]) -> list[Finding]:
    """Outputs that stand elsewhere in this log, where no filter is known that makes the difference."""
    return [
        Finding(
            kind="other_source",
            severity="warning",
            where=f"{segment.record}: {name}",
            message=(
                f"{name} comes from {there} in the logs that were fitted and from {here} in {segment.record}. Where "
                "the autopilot filters one and not the other, they differ by the delay of that filter."
            ),
        )
        for name, there in (candidate.sources or {}).items()
        if name in outputs and (here := source_of(segment, name)) != there
    ]


def remarks_on(check: Verification) -> list[Finding]:
    """What to say about one maneuver: a poor prediction, or an open loop that diverges as it must."""
    found = verdict(check)
    said = [_filtered(check)] if check.low_pass_rad_s is not None else []
    if found == "disturbed":
        return [*said, _disturbed(check)]
    if found == "diverges":
        return [*said, _diverges(check)]
    if found == "poor":
        return [*said, *(_poor_ahead(check) if judged_horizon(check) else _poor(check))]
    return said


def _where(check: Verification) -> str:
    return f"{check.record} at {check.maneuver.start_s:.1f} s"


def _poor(check: Verification) -> list[Finding]:
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=_where(check),
            message=(
                f"{name} of the {check.maneuver.kind} at {check.maneuver.start_s:.1f} s is predicted with a Theil "
                f"coefficient of {scores.tic:.2f} (good: up to {GOOD_TIC:g}) and a fit of "
                f"{scores.nrmse_fit_percent:.0f} % (good: {GOOD_FIT_PERCENT:g} % and more)."
            ),
            numbers={"tic": scores.tic, "nrmse_fit_percent": scores.nrmse_fit_percent},
        )
        for name, scores in check.scores.items()
        if name in poor_outputs(check)
    ]


def _poor_ahead(check: Verification) -> list[Finding]:
    horizon = judged_horizon(check)
    assert horizon is not None
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=_where(check),
            message=(
                f"{name} of the {check.maneuver.kind} at {check.maneuver.start_s:.1f} s is predicted "
                f"{horizon.horizon_s:.2g} s ahead with a Theil coefficient of {scores.tic:.2f} (good: up to "
                f"{GOOD_TIC:g}) and a fit of {scores.nrmse_fit_percent:.0f} % (good: {GOOD_FIT_PERCENT:g} % and more). "
                "An unstable airframe is judged so, because in open loop any model of it diverges."
            ),
            numbers={
                "horizon_s": horizon.horizon_s,
                "tic": scores.tic,
                "nrmse_fit_percent": scores.nrmse_fit_percent,
                "skill": scores.skill,
            },
        )
        for name, scores in horizon.scores.items()
        if name in poor_ahead(check)
    ]


def _diverges(check: Verification) -> Finding:
    horizon = judged_horizon(check)
    assert horizon is not None
    assert check.ahead is not None
    holds_s = min(check.ahead.holds_s[name] for name in check.moved or check.output_names)
    worst = max(horizon.scores[name].tic for name in check.moved or check.output_names)
    return Finding(
        kind="open_loop_diverges",
        severity="info",
        where=_where(check),
        message=(
            f"In open loop the model leaves the measurement of the {check.maneuver.kind} at "
            f"{check.maneuver.start_s:.1f} s, as that of an unstable airframe must: an error grows e-fold in "
            f"{1.0 / check.growth_1_s:.2g} s. Predictions hold for {holds_s:.2g} s, and {horizon.horizon_s:.2g} s "
            f"ahead their Theil coefficient is {worst:.2f} at most, so the model is not called poor."
        ),
        numbers={"holds_s": holds_s, "growth_1_s": check.growth_1_s, "horizon_s": horizon.horizon_s, "tic": worst},
    )


def _disturbed(check: Verification) -> Finding:
    horizon = judged_horizon(check)
    assert horizon is not None
    names = disturbed_ahead(check)
    worst = max(horizon.scores[name].over_quiet or 0.0 for name in names)
    return Finding(
        kind="disturbed_verification",
        severity="warning",
        where=_where(check),
        message=(
            f"The {check.maneuver.kind} at {check.maneuver.start_s:.1f} s cannot judge {', '.join(names)}: the error "
            f"{horizon.horizon_s:.2g} s ahead is at most {worst:.1f} times that before the maneuver, as gusts alone "
            "would make it. Fly a larger maneuver or in calmer air."
        ),
        numbers={"horizon_s": horizon.horizon_s, "over_quiet": worst},
    )


def _filtered(check: Verification) -> Finding:
    assert check.low_pass_rad_s is not None
    return Finding(
        kind="vibration_filtered",
        severity="info",
        where=_where(check),
        message=(
            f"More than a tenth of the power of an output lies above the fitted band, so measurement and prediction "
            f"passed a first-order low-pass of {check.low_pass_rad_s:.4g} rad/s before they were compared."
        ),
        numbers={"low_pass_rad_s": check.low_pass_rad_s},
    )
