"""Unseen maneuvers of one log, predicted in the time domain and in closed loop, and judged.

A model is judged on the sensor of this log, which may stand behind other filters than the one it was fitted to: its
outputs are made as late as the known filters of the autopilot make them (:func:`with_known_delays`,
:func:`with_known_filters`). Each maneuver is predicted in open loop and, where the controller of the log is known and
explains the command, flown in closed loop (:func:`fly_maneuver`). Only outputs that the maneuver moved are scored
(:func:`excited_outputs`): what does not move shows noise, and says nothing about the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.autopilots.filters import KnownFilter
from rotorid.checking.candidate import Candidate
from rotorid.data.axes import RATE_OF
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.flights import Flight
from rotorid.flights.given_controllers import Controllers, doubts_of, no_controller
from rotorid.flights.instruments import axis_of, is_command
from rotorid.flights.measure import Measured, default_band
from rotorid.flights.segments import cut, source_of
from rotorid.models.state_space import StateSpace
from rotorid.results.segment import Segment
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.autopilot_filters import known_filters
from rotorid.typing import Axis, FloatArray
from rotorid.verification.closed_loop import ClosedLoop, closed_loop, scored
from rotorid.verification.sampled import Filter, band_pass
from rotorid.verification.scores import GOOD_FIT_PERCENT, GOOD_TIC
from rotorid.verification.time_domain import matched, verify_in_time
from rotorid.verification.verification import (
    Verification,
    disturbed_ahead,
    judged_horizon,
    poor_ahead,
    poor_outputs,
    verdict,
)

_WORTH_SAYING_S = 1e-4


def with_known_delays(
    system: StateSpace,
    record: FlightRecord,
    outputs: Sequence[str],
    *,
    fitted: Mapping[str, str],
    judged: Mapping[str, str],
) -> tuple[StateSpace, tuple[Finding, ...]]:
    """A model whose outputs are as late as the filters make them in the log it is judged on.

    Autopilots log one quantity before and after their filters. A model that was fitted to one of them shows the other
    too, later by the difference of the delays; below some third of a filter's cutoff that is all it does.

    Parameters
    ----------
    system
        The model as it was fitted.
    record
        The log it is judged on; its parameters name the filters of both places.
    fitted, judged
        Output to where it stands in the logs: those that were fitted, and this one.
    """
    delays = system.output_delays_s.copy()
    findings = []
    for row, name in enumerate(outputs):
        here, there = judged.get(name, ""), fitted.get(name, "")
        if not there or here == there:
            continue
        later_s = _delay_s(record, here) - _delay_s(record, there)
        if abs(later_s) < _WORTH_SAYING_S:
            continue
        delays[row] += later_s
        findings.append(_shifted(record, name, here, there, later_s))
    if not findings:
        return system, ()
    # An output cannot be early: what lies before all others is taken off the inputs, as far as they are late.
    early_s = min(float(delays.min()), 0.0)
    inputs = np.maximum(system.input_delays_s + early_s, 0.0)
    return replace(system, output_delays_s=delays - early_s, input_delays_s=inputs), tuple(findings)


def with_known_filters(
    system: StateSpace,
    record: FlightRecord,
    outputs: Sequence[str],
    *,
    read: Sequence[str],
    fitted: Mapping[str, str],
    judged: Mapping[str, str],
) -> StateSpace:
    """A model whose fed-back outputs pass the filters themselves, where :func:`with_known_delays` took their delays.

    In a loop that is closed beyond a third of a filter's cutoff the delay is not enough: the filter also attenuates,
    and a controller with a derivative is stable through it that would not be through the delay. Means over a few
    samples stay delays.

    Parameters
    ----------
    system
        The model, its outputs as late as :func:`with_known_delays` made them.
    record
        The log it is judged on.
    read
        Those that a controller reads.
    fitted, judged
        Output to where it stands in the logs: those that were fitted, and this one.
    """
    for name in read:
        here, there = judged.get(name, ""), fitted.get(name, "")
        if not there or here == there:
            continue
        passed = known_filters(record, there)
        for known_filter in known_filters(record, here):
            if len(known_filter.denominator) > 1 and known_filter not in passed:
                system = _through(system, outputs.index(name), known_filter)
    return system


def _through(system: StateSpace, row: int, passed: KnownFilter) -> StateSpace:
    """A system with one output behind a filter, and as much earlier as the filter is late."""
    A, B, C, D = _analog(passed)
    order, states, count = len(A), system.F.shape[0], system.H0.shape[0]
    zero = np.zeros((states, order))
    H0, H1 = np.hstack([system.H0, np.zeros((count, order))]), np.hstack([system.H1, np.zeros((count, order))])
    H0[row], H1[row] = np.append(D * system.H0[row], C), np.append(D * system.H1[row], np.zeros(order))
    delays = system.output_delays_s.copy()
    delays[row] = max(delays[row] - passed.delay_s, 0.0)
    return StateSpace(
        M=np.block([[system.M, zero], [-np.outer(B, system.H1[row]), np.eye(order)]]),
        F=np.block([[system.F, zero], [np.outer(B, system.H0[row]), A]]),
        G=np.vstack([system.G, np.zeros((order, system.G.shape[1]))]),
        H0=H0,
        H1=H1,
        input_delays_s=system.input_delays_s,
        output_delays_s=delays,
    )


def _analog(passed: KnownFilter) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """The analog filter of a digital one made by the bilinear transform."""
    from scipy.signal import tf2ss

    A, B, C, D = tf2ss(passed.numerator, passed.denominator)
    inverse = np.linalg.inv(np.eye(len(A)) + A)
    scale = 2.0 * np.sqrt(passed.rate_hz)
    return (
        2.0 * passed.rate_hz * (A - np.eye(len(A))) @ inverse,
        scale * (inverse @ B)[:, 0],
        scale * (C @ inverse)[0],
        float((D - C @ inverse @ B)[0, 0]),
    )


def _delay_s(record: FlightRecord, source: str) -> float:
    return sum(known.delay_s for known in known_filters(record, source))


def _shifted(record: FlightRecord, name: str, here: str, there: str, later_s: float) -> Finding:
    return remark(
        "known_filter",
        f"{record.source.name}: {name}",
        f"The model was fitted to {name} from {there} but judged on {here}, which the autopilot's filters make "
        f"{1e3 * abs(later_s):.1f} ms {'later' if later_s > 0.0 else 'earlier'}, so the prediction is shifted by "
        "that.",
        delay_s=later_s,
    )


def looped_axes(inputs: tuple[str, ...], outputs: tuple[str, ...]) -> tuple[Axis, ...]:
    """Axes of a model whose command and rate it has."""
    axes = [axis_of(name) for name in inputs if is_command(name)]
    return tuple(axis for axis in axes if axis in RATE_OF and RATE_OF[axis] in outputs)


def fly_maneuver(
    system: StateSpace,
    history: TimeHistory,
    maneuver: Maneuver,
    controllers: Controllers,
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    filtered: Filter,
) -> tuple[ClosedLoop | None, tuple[Finding, ...]]:
    """Simulate a model under the controllers of the log, with a finding if that is impossible.

    The loop of the maneuver's own axis must be closed; those of other axes are as far as their controllers are known
    and explain their commands, else their measured commands drive the model.

    Parameters
    ----------
    system
        The airframe.
    history
        The maneuver with time around it: inputs, outputs and what drives the controllers.
    controllers
        What is known of the controllers.
    inputs, outputs
        Of the system.
    filtered
        What measurement and prediction pass alike.
    """
    own = [axis for axis in looped_axes(inputs, outputs) if axis == maneuver.axis]
    if not own:
        return None, ()
    tried = {axis: controllers.loop(axis, history, filtered) for axis in looped_axes(inputs, outputs)}
    found = {axis: item for axis, item in tried.items() if item is not None}
    if maneuver.axis not in found:
        return None, (no_controller(controllers, own),)
    checks = {axis: doubts_of(controllers, axis, item) for axis, item in found.items()}
    closes, remarks = checks[maneuver.axis]
    if not closes:
        return None, tuple(remarks)
    closed = {axis: item for axis, item in found.items() if checks[axis][0]}
    loops = [loop for loop, _, _ in closed.values()]
    u = np.stack([history[name] for name in inputs])
    measured, predicted = closed_loop(
        system,
        u - u.mean(axis=1, keepdims=True),
        loops=loops,
        input_names=inputs,
        output_names=outputs,
        measured=np.stack([history[name] for name in outputs]),
        commands=np.stack([history[loop.command] for loop in loops]),
        filtered=filtered,
        sample_rate_hz=history.sample_rate_hz,
    )
    names = (*outputs, *(loop.command for loop in loops))
    flown = ClosedLoop(
        time_s=history.time_s,
        names=names,
        outputs=len(outputs),
        measured=measured,
        predicted=predicted,
        scores={name: scored(*pair) for name, *pair in zip(names, measured, predicted, strict=True)},
        setpoints={loop.command: name for loop, name, _ in closed.values()},
        controller_tic={loop.command: scores.tic for loop, _, scores in closed.values()},
    )
    return flown, tuple(remarks)


REST_S = 0.5
"""Seconds before and after a maneuver that the open loop takes along."""

_AROUND_S = 3.5
_SETTLED_S = 0.5
_MOVING = 0.25
_SHORTEST_S = 1.0


def predict_maneuvers(
    candidate: Candidate,
    short: Sequence[Flight],
    settings: VerifySettings,
    *,
    outputs: tuple[str, ...],
) -> tuple[tuple[Verification, ...], tuple[Finding, ...]]:
    """Predict short maneuvers of one log, and remark on how that went.

    Parameters
    ----------
    short
        Maneuvers of one log.
    outputs
        Outputs of the model that the log has.

    Raises
    ------
    InsufficientDataError
        Nothing of a second is left without a gap, or a channel is missing.
    """
    inputs = candidate.structure.inputs
    record = short[0].record
    controllers = Controllers(record=record, given=candidate.controllers)
    segments, findings = cut(
        short,
        channels=(*inputs, *outputs),
        followers=controllers.channels(looped_axes(inputs, outputs)),
        shifts=settings.shifts,
        rest_s=_AROUND_S,
    )
    checks: list[Verification] = []
    remarks = list(findings)
    for segment in segments:
        start_s, stop_s = _active(segment)
        history = _within(segment.history, start_s - REST_S, stop_s + REST_S)
        if history is None or history.duration_s < _SHORTEST_S:
            continue
        check, on_check = _predicted(
            candidate, segment, history, _around(segment, short), controllers, outputs, settings
        )
        checks.append(check)
        remarks += [finding for finding in on_check if finding not in remarks]
    if not checks:
        raise InsufficientDataError(
            f"its unseen maneuvers have less than {_SHORTEST_S:g} s without a gap", needed="a longer maneuver"
        )
    return tuple(checks), (*remarks, *(f for check in checks for f in remarks_on(check)))


def _predicted(
    candidate: Candidate,
    segment: Segment,
    history: TimeHistory,
    around: TimeHistory,
    controllers: Controllers,
    outputs: tuple[str, ...],
    settings: VerifySettings,
) -> tuple[Verification, list[Finding]]:
    """A maneuver in open loop and under its controllers, behind the filters of this log."""
    inputs, record, maneuver = candidate.structure.inputs, controllers.record, segment.maneuver
    fitted, judged = candidate.sources or {}, {name: source_of(segment, name) for name in outputs}
    system, delayed = with_known_delays(candidate.system_of(outputs), record, outputs, fitted=fitted, judged=judged)
    band = candidate.band_rad_s or default_band([Flight(record, maneuver)], history.sample_rate_hz)
    check = verify_in_time(
        system,
        history,
        inputs=inputs,
        outputs=outputs,
        band_rad_s=band,
        record=segment.record,
        maneuver=maneuver,
        around=around,
        vibration_filter=settings.vibration_filter,
    )
    read = [RATE_OF[axis] for axis in looped_axes(inputs, outputs)]
    flown, why_not = fly_maneuver(
        with_known_filters(system, record, outputs, read=read, fitted=fitted, judged=judged),
        around,
        maneuver,
        controllers,
        inputs=inputs,
        outputs=outputs,
        filtered=matched(band, check.low_pass_rad_s, around),
    )
    return replace(check, closed_loop=flown), [*(delayed or _other_source(candidate, segment, outputs)), *why_not]


def _active(segment: Segment) -> tuple[float, float]:
    """A maneuver without the quiet time in which its own command does not move: noise alone tests no model."""
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


def _around(segment: Segment, short: Sequence[Flight]) -> TimeHistory:
    """A maneuver with the quiet time around it, outside the decay of its neighbors."""
    maneuver, history = segment.maneuver, segment.history
    others = [flight.maneuver for flight in short]
    before = [other.stop_s + _SETTLED_S for other in others if other.stop_s <= maneuver.start_s]
    after = [other.start_s for other in others if other.start_s >= maneuver.stop_s]
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
    """Outputs with another source in this log, unless a known filter explains the difference."""
    return [
        warn(
            "other_source",
            f"{segment.record}: {name}",
            f"{name} comes from {there} in the fitted logs and from {here} in {segment.record}. If the autopilot "
            "filters only one of them, they differ by the delay of that filter.",
        )
        for name, there in (candidate.sources or {}).items()
        if name in outputs and (here := source_of(segment, name)) != there
    ]


def remarks_on(check: Verification) -> list[Finding]:
    """Findings on one maneuver: a poor prediction, or an open loop that diverges as expected."""
    found = verdict(check)
    remarks = [_filtered(check)] if check.low_pass_rad_s is not None else []
    if found == "disturbed":
        return [*remarks, _disturbed(check)]
    if found == "diverges":
        return [*remarks, _diverges(check)]
    if found == "poor":
        return [*remarks, *(_poor_ahead(check) if judged_horizon(check) else _poor(check))]
    return remarks


def _where(check: Verification) -> str:
    return f"{check.record} at {check.maneuver.start_s:.1f} s"


def _words(check: Verification) -> str:
    return f"{check.maneuver.axis} {check.maneuver.kind} at {check.maneuver.start_s:.1f} s of {check.record}"


def _poor(check: Verification) -> list[Finding]:
    return [
        warn(
            "poor_verification",
            _where(check),
            f"{name} of the {_words(check)} is predicted with a Theil "
            f"coefficient of {scores.tic:.2f} (good: up to {GOOD_TIC:g}) and a fit of "
            f"{scores.nrmse_fit_percent:.0f} % (good: {GOOD_FIT_PERCENT:g} % and more).",
            tic=scores.tic,
            nrmse_fit_percent=scores.nrmse_fit_percent,
        )
        for name, scores in check.scores.items()
        if name in poor_outputs(check)
    ]


def _poor_ahead(check: Verification) -> list[Finding]:
    horizon = judged_horizon(check)
    assert horizon is not None
    return [
        warn(
            "poor_verification",
            _where(check),
            f"{name} of the {_words(check)} is predicted {horizon.horizon_s:.2g} s ahead with a Theil "
            f"coefficient of {scores.tic:.2f} (good: up to {GOOD_TIC:g}) and a fit of "
            f"{scores.nrmse_fit_percent:.0f} % (good: {GOOD_FIT_PERCENT:g} % and more). An unstable airframe is "
            "judged this way because it diverges in any open-loop simulation.",
            horizon_s=horizon.horizon_s,
            tic=scores.tic,
            nrmse_fit_percent=scores.nrmse_fit_percent,
            skill=scores.skill,
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
    return remark(
        "open_loop_diverges",
        _where(check),
        f"In open loop the model diverges from the {_words(check)}, as for any unstable airframe: an error grows "
        f"by a factor of e in {1.0 / check.growth_1_s:.2g} s. Predictions are valid for {holds_s:.2g} s; "
        f"{horizon.horizon_s:.2g} s ahead their Theil coefficient is at most {worst:.2f}, so the model is not "
        "rated poor.",
        holds_s=holds_s,
        growth_1_s=check.growth_1_s,
        horizon_s=horizon.horizon_s,
        tic=worst,
    )


def _disturbed(check: Verification) -> Finding:
    horizon = judged_horizon(check)
    assert horizon is not None
    names = disturbed_ahead(check)
    worst = max(horizon.scores[name].over_quiet or 0.0 for name in names)
    return warn(
        "disturbed_verification",
        _where(check),
        f"The {_words(check)} cannot judge {', '.join(names)}: the error {horizon.horizon_s:.2g} s ahead is at "
        f"most {worst:.1f} times the error before the maneuver, which gusts alone would cause. Fly a larger "
        "maneuver or in calmer air.",
        horizon_s=horizon.horizon_s,
        over_quiet=worst,
    )


def _filtered(check: Verification) -> Finding:
    assert check.low_pass_rad_s is not None
    return remark(
        "vibration_filtered",
        _where(check),
        "More than a tenth of the power of an output lies above the fitted band, so measurement and prediction "
        f"were low-pass filtered at {check.low_pass_rad_s:.4g} rad/s before the comparison.",
        low_pass_rad_s=check.low_pass_rad_s,
    )


SHARE = 0.25
"""An output that the model does not connect with a maneuver counts from this share of its usual motion: what
moves less is noise, or a coupling that is no part of a model of each axis."""

_UNCONNECTED = 1e-9


def usual_motion(measured: Measured, band_rad_s: tuple[float, float]) -> dict[str, float]:
    """Largest standard deviation of each output in the fitted maneuvers, within the fitted band.

    Parameters
    ----------
    measured
        With the maneuvers that were fitted.
    band_rad_s
        The fitted band.
    """
    largest = dict.fromkeys(measured.response.outputs, 0.0)
    for segment in measured.segments:
        for name in largest:
            largest[name] = max(largest[name], _motion(segment, name, band_rad_s))
    return largest


def excited_outputs(checks: Sequence[Verification], candidate: Candidate) -> tuple[Verification, ...]:
    """Verifications with the outputs that their maneuver excites as ``moved``; only these are scored.

    An output counts where it moves clearly more than before the maneuver, see
    :func:`rotorid.verification.time_domain.verify_in_time`, and where it should move or does: the model connects it
    with the input of the maneuver, or it moves by a quarter of its usual motion. The latter shows a coupling that the
    model lacks.

    Parameters
    ----------
    checks
        Maneuvers of one log, measured and predicted.
    candidate
        The model, with the usual motion of its outputs, see :func:`usual_motion`; that in the other maneuvers counts
        too.
    """
    largest = dict(candidate.usual)
    for check in checks:
        for name, values in zip(check.output_names, check.measured, strict=True):
            largest[name] = max(largest.get(name, 0.0), float(values.std()))
    excited = (replace(check, moved=_excited(check, candidate, largest)) for check in checks)
    return tuple(check for check in excited if check.moved)


def _excited(check: Verification, candidate: Candidate, largest: Mapping[str, float]) -> tuple[str, ...]:
    expected = _connected(check, candidate.system_of(check.output_names))
    return tuple(
        name
        for name, values in zip(check.output_names, check.measured, strict=True)
        if name in check.moved and (name in expected or values.std() >= SHARE * largest[name])
    )


def _connected(check: Verification, system: StateSpace) -> tuple[str, ...]:
    """Outputs that the model connects with the input of a maneuver; all, where that is none of its inputs."""
    command = f"{check.maneuver.axis}_command"
    if command not in check.input_names:
        return check.output_names
    rows = _gain(system)
    own = rows[:, check.input_names.index(command)]
    return tuple(
        name
        for name, gain, row in zip(check.output_names, own, rows, strict=True)
        if gain > _UNCONNECTED * row.max(initial=0.0)
    )


def _gain(system: StateSpace) -> FloatArray:
    """Largest magnitude of each response over three decades, shape ``(y, u)``."""
    return np.asarray(np.abs(system.response(np.geomspace(0.1, 100.0, 7))).max(axis=-1))


def _motion(segment: Segment, name: str, band_rad_s: tuple[float, float]) -> float:
    history, maneuver = segment.history, segment.maneuver
    inside = (history.time_s >= maneuver.start_s) & (history.time_s <= maneuver.stop_s)
    if name not in history.names or not inside.any():
        return 0.0
    filtered = band_pass(band_rad_s, history.sample_rate_hz, history.duration_s)(history[name])
    return float(filtered[inside].std())
