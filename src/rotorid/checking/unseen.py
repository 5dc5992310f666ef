"""What unseen flights say about a model: maneuvers that are predicted, sweeps that are compared, one that is held out.

What was fitted flatters a model. Short maneuvers are predicted in the time domain
(:mod:`rotorid.checking.maneuvers`), sweeps compared in the frequency domain, responses to set-points
simulated. Where all that was flown was fitted, a second model is fitted without one maneuver and compared with it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rotorid.checking.candidate import UNFILTERED, Candidate, candidate_of
from rotorid.checking.maneuvers import excited_outputs, predict_maneuvers, remarks_on, usual_motion
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import STANDARD_UNITS, FlightRecord, Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fits.frequency.fit import FrequencyFit, fitted_band
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fits.time.fit import TimeFit, growth
from rotorid.fits.time.remarks import nothing_unseen
from rotorid.fitting.frequency.problem import ACCEPTABLE_COST, pair_costs, point_weights, usable_points
from rotorid.fitting.time.output_error import Fitted as Simulated
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of, axis_of, is_command
from rotorid.flights.measure import Measured, default_band, measure
from rotorid.flights.segments import (
    TimeRecords,
    holds,
    require_channels,
    source_of,
    time_records,
    with_surroundings,
)
from rotorid.flights.selection import (
    Selection,
    described,
    of_axes,
    select_records,
    wholly_flown,
)
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure, connected
from rotorid.reduction.guided import fit_and_drop
from rotorid.results.model import FrequencyCheck, Segment, Verifications
from rotorid.results.provenance import Provenance
from rotorid.results.summary import PairCost
from rotorid.settings.settings import IdentifySettings, MeasureSettings
from rotorid.signal.excitations import find_excitations
from rotorid.spectral.derived import selected
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray
from rotorid.verification.sampled import LowPass
from rotorid.verification.scores import j_rms, nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores, Verification

_PROGRESS = logging.getLogger("rotorid.progress")


def check_sweeps(
    structure: LinearStructure,
    parameters: ParameterSet,
    sweeps: Sequence[Flight],
    *,
    band_rad_s: tuple[float, float],
    settings: MeasureSettings,
) -> FrequencyCheck:
    r"""Cost of a frozen model against the responses of sweeps that were not fitted.

    Judged are the responses to inputs that were swept, where the model was fitted and where the sweeps of each input
    excite: above their end there is coherence too, of noise that the controller fed back. What the controller does
    meanwhile with the other inputs :math:`v` was measured too, and the model is given it,

    .. math:: H_{yu} + H_{yv} \, (v/u)

    A response without usable points, such as that of an output that does not follow, is left out and not judged.

    Parameters
    ----------
    structure, parameters
        The model.
    sweeps
        What it has not seen.
    band_rad_s
        The fitted band.
    settings
        Choices of the run.

    Raises
    ------
    InsufficientDataError
        A channel is missing, the sweeps are too short, or no point of them is usable in the fitted band.
    """
    swept = _swept(structure.inputs, sweeps)
    others = tuple(name for name in structure.inputs if name not in swept and _moves(name, sweeps))
    measured = measure(
        sweeps,
        inputs=swept,
        outputs=(*structure.outputs, *others),
        settings=_of_inputs(settings, structure.inputs, swept),
    )
    data = _of_outputs(measured.response, len(structure.outputs))
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = _used(measured, data, band_rad_s, limit)
    if not used.any():
        raise _nothing_usable(band_rad_s, measured.trusted_rad_s, limit)
    model = _model(structure, parameters, measured.response)
    costs = pair_costs(model, data.values, point_weights(data, used))
    pairs = {}
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if omega.size:
            band = (float(omega[0]), float(omega[-1]))
            pairs[f"{data.outputs[y]}/{data.inputs[u]}"] = PairCost(
                value=float(costs[y, u]), band_rad_s=band, points=omega.size
            )
    records = tuple(dict.fromkeys(record.source.name for record, _ in sweeps))
    return FrequencyCheck(
        pairs=pairs,
        findings=(*measured.findings, *_poor(records, pairs)),
        records=records,
        response=data,
        model_response=model,
        used=used,
    )


def _swept(inputs: Sequence[str], sweeps: Sequence[Flight]) -> tuple[str, ...]:
    """Inputs of a model that sweeps excite; one that is no command may be moved by any."""
    axes = {maneuver.axis for _, maneuver in sweeps}
    return tuple(name for name in inputs if not is_command(name) or axis_of(name) in axes)


def _moves(name: str, sweeps: Sequence[Flight]) -> bool:
    """Whether a channel is anything but constant in the logs of some sweeps."""
    return any(np.ptp(topic.values[row]) > 0.0 for record, _ in sweeps for topic, row in record.holding(name))


def _of_inputs(settings: MeasureSettings, inputs: Sequence[str], swept: Sequence[str]) -> MeasureSettings:
    """The choices of a run for some of its inputs: of instruments that were given, theirs."""
    if len(settings.instruments) != len(inputs):
        return settings
    given = dict(zip(inputs, settings.instruments, strict=True))
    return replace(settings, instruments=tuple(given[name] for name in swept))


def _of_outputs(data: FrequencyResponse, count: int) -> FrequencyResponse:
    """The responses of the first outputs only."""
    return data if len(data.outputs) == count else selected(data, outputs=data.outputs[:count])


def _model(structure: LinearStructure, parameters: ParameterSet, data: FrequencyResponse) -> ComplexArray:
    """The model with what the other inputs did, of which ``data`` holds the responses after those of its outputs."""
    whole = structure.response(parameters.values, data.omega_rad_s)
    count = len(structure.outputs)
    swept = [structure.inputs.index(name) for name in data.inputs]
    others = [structure.inputs.index(name) for name in data.outputs[count:]]
    # Records that lack an input tell nothing of it.
    moved = np.nan_to_num(data.values[count:])
    return np.asarray(whole[:, swept] + np.einsum("yvf,vuf->yuf", whole[:, others], moved))


def _used(measured: Measured, data: FrequencyResponse, fitted_rad_s: tuple[float, float], limit: float) -> BoolArray:
    """Points in the fitted band, each input as far as its own sweeps went, shape ``(y, u, f)``."""
    trusted = measured.trusted_rad_s
    used = np.zeros(data.values.shape, dtype=np.bool_)
    reached = np.asarray(measured.trusted_points(data, limit).any(axis=0))
    for u in range(len(data.inputs)):
        tops = data.omega_rad_s[reached[u]]
        if tops.size:
            band = max(fitted_rad_s[0], trusted[0]), min(fitted_rad_s[1], float(tops[-1]))
            used[:, u] = usable_points(data, coherence=limit, band_rad_s=band)[:, u]
    return used


def _nothing_usable(
    fitted_rad_s: tuple[float, float], trusted_rad_s: tuple[float, float], least_coherence: float
) -> InsufficientDataError:
    band = f"the fitted band of {fitted_rad_s[0]:.3g} to {fitted_rad_s[1]:.3g} rad/s"
    apart = trusted_rad_s[1] <= fitted_rad_s[0] or trusted_rad_s[0] >= fitted_rad_s[1]
    return InsufficientDataError(
        f"its sweeps, trusted from {trusted_rad_s[0]:.3g} to {trusted_rad_s[1]:.3g} rad/s, do not reach {band}"
        if apart
        else f"no point of its sweeps in {band} reaches the coherence of {least_coherence:g}",
        needed="usable points in the fitted band",
        remedy="fly a sweep over the fitted band",
    )


def _poor(records: Sequence[str], pairs: Mapping[str, PairCost]) -> list[Finding]:
    where = ", ".join(records)
    return [
        warn(
            "poor_verification",
            f"{where}: {name}",
            f"The model misses the response {name} of unseen sweeps with a cost of {pair.value:.0f}, above the "
            f"{ACCEPTABLE_COST:g} of an acceptable model.",
            cost=pair.value,
        )
        for name, pair in pairs.items()
        if not pair.value <= ACCEPTABLE_COST
    ]


_ADVICE = "Fly doublets, or give another log with --verify."


def hold_out(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> FrequencyCheck:
    """Fit a structure to all maneuvers but one, and judge that second model on that one.

    Held out is the last maneuver of an axis that was flown more than once: without the only sweep of an axis its
    parameters would be those of noise. The second fit begins from nothing: its band, its start values and what it drops
    come from the maneuvers that are left. It is another model than the one of the result, which has seen all of them.

    Parameters
    ----------
    structure
        What to fit.
    flights
        All maneuvers that the model of the result was fitted to.
    settings
        Choices of the run.
    """
    axes = [maneuver.axis for _, maneuver in flights]
    again = [index for index, axis in enumerate(axes) if axes.count(axis) > 1]
    if not again:
        return FrequencyCheck(findings=(nothing_left(),))
    rest, held = [*flights[: again[-1]], *flights[again[-1] + 1 :]], flights[again[-1]]
    name = f"{held[0].source.name} at {held[1].start_s:.1f} s"
    _PROGRESS.info(f"holding out {name}")
    try:
        measured = measure(rest, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        reduced = fit_and_drop(pose_screened(structure, measured, settings, rest).problem)
        parameters = reduced.problem.parameters.unpack(reduced.solution.theta)
        band = fitted_band(reduced.problem)
        there = tuple(name for name in structure.outputs if holds(held.record, name))
        seen = structure if there == structure.outputs else structure.select(outputs=there)
        judged = check_sweeps(seen, parameters, [held], band_rad_s=band, settings=settings)
    except InsufficientDataError as error:
        return FrequencyCheck(findings=(_not_held_out(name, error),))
    # What was said of the data when all of it was fitted need not be said of its parts again.
    poor = (finding for finding in judged.findings if finding.kind == "poor_verification")
    findings = (*poor, _held_out(name, max(judged.costs.values()), band))
    return replace(judged, findings=findings)


def nothing_left() -> Finding:
    """What to say where a model was judged on nothing that it had not seen, and nothing can be held out."""
    return warn(
        "not_verified",
        "verification",
        f"Everything that was flown was fitted, and no axis twice, so nothing is left to judge the model on. {_ADVICE}",
    )


def _not_held_out(name: str, error: InsufficientDataError) -> Finding:
    return warn(
        "not_verified",
        name,
        f"No maneuver is left unseen, and that of {name} could not be held out of a second fit: "
        f"{error.came.rstrip('.')}. {_ADVICE}",
    )


def _held_out(name: str, worst: float, band_rad_s: tuple[float, float]) -> Finding:
    # Fewer maneuvers may carry a narrower band, in which a model of the wrong form passes: so the band is said.
    return remark(
        "held_out",
        name,
        f"No maneuver is left unseen. A second model, fitted from {band_rad_s[0]:.2g} to {band_rad_s[1]:.3g} rad/s "
        f"without that of {name}, predicts its response with a cost of {worst:.1f}; the model of this result was "
        "fitted to all maneuvers.",
        cost=worst,
        low_rad_s=band_rad_s[0],
        high_rad_s=band_rad_s[1],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class UnseenLog:
    """One log with what the fit has not seen of it, or the cause why there is nothing."""

    record: FlightRecord
    outputs: tuple[str, ...] = ()
    short: tuple[Flight, ...] = ()
    sweeps: tuple[Flight, ...] = ()
    cause: str = ""


def verify_unseen(
    candidate: Candidate,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    *,
    usual: Mapping[str, float] | None = None,
) -> Verifications:
    """Judge a model on whatever its fit has not seen: maneuvers of the same logs, and further logs.

    Short maneuvers are predicted in the time domain, sweeps of further logs compared in the frequency domain. A log
    that was given to verify and adds nothing is said to add nothing.

    Parameters
    ----------
    candidate
        The model.
    selection
        What it was fitted to, and what of the same logs was kept unseen.
    verify
        Further logs.
    settings
        Choices of the run.
    usual
        Motion of each output where the model was fitted, see
        :func:`rotorid.checking.maneuvers.excited_outputs`.
    """
    structure = candidate.structure
    axes = axes_of(structure.inputs, structure.outputs)
    own = {id(flight.record): flight.record for flight in selection.unseen}.values()
    logs = [
        UnseenLog(
            record=record,
            outputs=tuple(name for name in structure.outputs if holds(record, name)),
            short=tuple(flight for flight in selection.unseen if flight.record is record),
            cause=_lacking(record, structure.inputs),
        )
        for record in own
    ]
    # A log without some input told of the others when it was fitted, and cannot be predicted.
    logs = [replace(log, short=()) if log.cause else log for log in logs]
    logs += unseen_logs(candidate, verify, axes, fits=selection.fits)
    return check_logs(candidate, logs, settings, usual=usual)


def verify_fitted(
    fitted: FrequencyFit,
    measured: Measured,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
) -> Verifications:
    """Judge a model of responses on whatever it has not seen.

    Where nothing was left over, the last fitted maneuver is held out of a second fit.
    """
    usual = usual_motion(measured, fitted.band_rad_s)
    found = verify_unseen(candidate_of(fitted, measured), selection, verify, settings, usual=usual)
    if found.maneuvers or found.sweeps or verify:
        return found
    held = hold_out(fitted.problem.structure, selection.fitted, settings)
    sweeps = (held,) if held.response is not None else ()
    return Verifications(frequency=held.costs, findings=(*held.findings, *found.findings), sweeps=sweeps)


def check_logs(
    candidate: Candidate,
    logs: Sequence[UnseenLog],
    settings: MeasureSettings,
    *,
    vibration_filter: LowPass = "auto",
    usual: Mapping[str, float] | None = None,
) -> Verifications:
    """Judge a model on logs that it has not seen; whatever fails leaves the others standing.

    Parameters
    ----------
    candidate
        The model.
    logs
        What there is to judge it on, see :func:`unseen_logs`.
    settings
        Choices of the run.
    vibration_filter
        See :func:`rotorid.verification.time_domain.verify_in_time`.
    usual
        Motion of each output where the model was fitted, see
        :func:`rotorid.checking.maneuvers.excited_outputs`.
    """
    parts: list[Verifications] = []
    heard: list[UnseenLog] = []
    causes = [(log, log.cause) for log in logs if log.cause]
    for members, attempt in _attempts(candidate, logs, settings, vibration_filter, usual or {}):
        try:
            parts.append(attempt())
            heard += members
        except InsufficientDataError as error:
            causes += [(log, error.came.rstrip(".")) for log in members]
    frequency: dict[str, float] = {}
    for part in parts:
        frequency |= {pair: max(cost, frequency.get(pair, 0.0)) for pair, cost in part.frequency.items()}
    return Verifications(
        maneuvers=tuple(item for part in parts for item in part.maneuvers),
        frequency=frequency,
        findings=(
            *(finding for part in parts for finding in part.findings),
            *(_not_verified(log, cause, part=log in heard) for log, cause in causes),
        ),
        sweeps=tuple(item for part in parts for item in part.sweeps),
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
        wanted = [described(record, m) for m in given if Flight(record, m).inside] if segments else found
        flights = [Flight(record, m) for m in wanted if not fits(record, m)]
        if lacking:
            logs.append(UnseenLog(record=record, cause=lacking))
        elif not flights:
            what = "no given segment" if segments else f"no excitation of {' or '.join(axes)} beyond what was fitted"
            logs.append(UnseenLog(record=record, cause=f"it holds {what}"))
        else:
            short = tuple(flight for flight in flights if flight.maneuver.kind not in RICH_KINDS)
            short = short if segments else wholly_flown(short)
            sweeps = tuple(flight for flight in flights if flight.maneuver.kind in RICH_KINDS)
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
    vibration_filter: LowPass,
    usual: Mapping[str, float],
) -> list[tuple[list[UnseenLog], Callable[[], Verifications]]]:
    """What to judge the model on, and the logs behind each."""
    axes = set(axes_of(candidate.structure.inputs, candidate.structure.outputs))
    flying = [log for log in logs if log.sweeps]
    # A log that excites every input stands alone, so that a good one does not hide a bad one in a common average.
    alone = [log for log in flying if axes <= {m.axis for _, m in log.sweeps}]
    together = [log for log in flying if log not in alone]
    groups = [*([log] for log in alone), *([together] if together else [])]
    return [
        *(([log], partial(_predict, candidate, log, settings, vibration_filter, usual)) for log in logs if log.short),
        *((group, partial(_judge, candidate, group, settings)) for group in groups),
    ]


def _predict(
    candidate: Candidate,
    log: UnseenLog,
    settings: MeasureSettings,
    vibration_filter: LowPass,
    usual: Mapping[str, float],
) -> Verifications:
    checks, findings = predict_maneuvers(
        candidate, log.short, settings, outputs=log.outputs, vibration_filter=vibration_filter
    )
    told = excited_outputs(checks, candidate, usual)
    if not told:
        raise InsufficientDataError("its short maneuvers move no output more than it moves before them")
    # Only what tells about the model is remarked on.
    said = [finding for check in checks for finding in remarks_on(check)]
    data = [finding for finding in findings if finding not in said]
    remarks = [finding for check in told for finding in remarks_on(check)]
    return Verifications(maneuvers=told, findings=(*_without(candidate, [log], log.outputs), *data, *remarks))


def _judge(candidate: Candidate, logs: Sequence[UnseenLog], settings: MeasureSettings) -> Verifications:
    sweeps = [flight for log in logs for flight in log.sweeps]
    outputs = tuple(name for name in candidate.structure.outputs if all(name in log.outputs for log in logs))
    if not outputs:
        raise InsufficientDataError("the logs have no output of the model in common")
    if any(source.endswith(UNFILTERED) for source in (candidate.sources or {}).values()):
        settings = replace(settings, correct_filters=True)
    judged = check_sweeps(
        candidate.structure if outputs == candidate.structure.outputs else candidate.structure.select(outputs=outputs),
        candidate.parameters,
        sweeps,
        band_rad_s=candidate.band_rad_s or default_band(sweeps, math.inf),
        settings=settings,
    )
    findings = (*_without(candidate, logs, outputs), *judged.findings)
    return Verifications(frequency=judged.costs, findings=findings, sweeps=(judged,))


def _without(candidate: Candidate, logs: Sequence[UnseenLog], outputs: Sequence[str]) -> list[Finding]:
    """Outputs of the model that could not be judged, because a log does not hold them."""
    left_out = [name for name in candidate.structure.outputs if name not in outputs]
    where = ", ".join(log.record.source.name for log in logs)
    return [
        remark(
            "missing_channel",
            f"{where}: {name}",
            f"{where} holds no {name}, so that output of the model was not judged there.",
        )
        for name in left_out
    ]


def _not_verified(log: UnseenLog, cause: str, *, part: bool) -> Finding:
    name = log.record.source.name
    return (remark if part else warn)(
        "not_verified", name, f"{'A part of ' if part else ''}{name} did not verify the model: {cause}."
    )


def has_seen(provenance: Provenance, record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether any part of a maneuver was fitted, by the hash of its log.

    A result that does not list its maneuvers has seen its logs as a whole.

    Parameters
    ----------
    provenance
        Where a result came from.
    record, maneuver
        What may have been fitted.
    """
    names = {name for name, sha256 in provenance.inputs.items() if sha256 == record.source.sha256}
    return bool(names) and (
        not provenance.maneuvers
        or any(
            one.record in names and one.start_s < maneuver.stop_s and maneuver.start_s < one.stop_s
            for one in provenance.maneuvers
        )
    )


def fitted_logs(provenance: Provenance) -> frozenset[str]:
    """Hashes of the logs that a result was fitted to, without those that only verified it."""
    names = {one.record for one in provenance.maneuvers}
    return frozenset(sha256 for name, sha256 in provenance.inputs.items() if not names or name in names)


def seen_data(record: FlightRecord, maneuver: Maneuver) -> Finding:
    """What to say of a maneuver that was to verify a model and was fitted by it."""
    name = record.source.name
    return warn(
        "seen_data",
        name,
        f"{name} from {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s was fitted, at least in part: it flatters "
        "the model and does not count as a verification. Give another log.",
        start_s=maneuver.start_s,
        stop_s=maneuver.stop_s,
    )


def verify_apart(
    records: Sequence[FlightRecord],
    judge: Callable[[FlightRecord], tuple[Sequence[Verification], Sequence[Finding]]],
    *,
    fitted: Sequence[Flight],
) -> Verifications:
    """Judge further logs one by one; those that were fitted, and those that cannot be judged, are told.

    Parameters
    ----------
    records
        The logs.
    judge
        What a log shows of the model; raises what keeps it from that.
    fitted
        Flights of the fit.
    """
    seen = {record.source.sha256 for record, _ in fitted}
    checks: list[Verification] = []
    findings: list[Finding] = []
    for record in records:
        name = record.source.name
        if record.source.sha256 in seen:
            findings.append(warn("seen_data", name, f"{name} was fitted, and does not count as unseen."))
            continue
        try:
            found, said = judge(record)
        except (InsufficientDataError, UsageError) as error:
            findings.append(warn("not_verified", name, f"{name} was not judged: {error}"))
            continue
        checks += found
        findings += said
    return Verifications(maneuvers=tuple(checks), findings=tuple(findings))


def verify_fitted_in_time(
    fitted: TimeFit,
    records: TimeRecords,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    *,
    band_rad_s: tuple[float, float] | None = None,
) -> Verifications:
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
    settings
        Choices of the run.
    band_rad_s
        Where the data speak, as far as that is known.
    """
    structure = fitted.structure
    if all(is_command(name) for name in structure.inputs):
        if not selection.unseen and not verify:
            return Verifications(findings=(nothing_unseen([segment.record for segment in records.segments]),))
        sources = {name: source_of(records.segments[0], name) for name in structure.outputs}
        candidate = Candidate(
            structure=structure, parameters=structure.parameters, band_rad_s=band_rad_s, sources=sources
        )
        return verify_unseen(candidate, selection, verify, settings)
    parts = [_simulated(fitted, records, selection, record, settings) for record in verify]
    parts += [_simulated_short(fitted, records, flight, settings) for flight in selection.unseen]
    if not parts:
        return Verifications(findings=(nothing_unseen([one.record for one in records.segments]),))
    return Verifications(
        maneuvers=tuple(check for checks, _ in parts for check in checks),
        findings=tuple(finding for _, findings in parts for finding in findings),
    )


def _simulated(
    fitted: TimeFit,
    records: TimeRecords,
    selection: Selection,
    record: FlightRecord,
    settings: IdentifySettings,
) -> tuple[list[Verification], list[Finding]]:
    _PROGRESS.info(f"simulating {record.source.name}")
    structure = fitted.structure
    plain = replace(settings, segments=())
    seen: list[Finding] = []
    try:
        flights = select_records(structure, [record], plain).selection.fitted
        new = [item for item in flights if not selection.fits(*item)]
        seen += [seen_data(*item) for item in flights if selection.fits(*item)]
        if not new:
            return [], seen
        checks = _checks(fitted, structure, records, new, plain)
    except (InsufficientDataError, ModelError) as error:
        return [], [*seen, _record_not_verified(record, error.came)]
    return checks, [*seen, *(finding for check in checks for finding in remarks_on(check))]


_REST_S = 1.5
"""Of quiet time around a doublet: the answer to its end belongs to it."""


def _simulated_short(
    fitted: TimeFit, records: TimeRecords, flight: Flight, settings: IdentifySettings
) -> tuple[list[Verification], list[Finding]]:
    """A doublet or multistep of a fitted log, by the responses to the set-points that it moves."""
    moved = [
        name
        for name in fitted.structure.inputs
        if any(samples.values.size and float(np.ptp(samples.values)) > 0.0 for samples in flight.samples(name))
    ]
    if not moved:
        return [], []
    structure = connected(fitted.structure.select(inputs=moved))
    try:
        wider = with_surroundings([flight], _REST_S, (*structure.inputs, *structure.outputs))
        checks = _checks(fitted, structure, records, wider, replace(settings, segments=()))
    except (InsufficientDataError, ModelError) as error:
        return [], [_record_not_verified(flight.record, error.came)]
    return checks, [finding for check in checks for finding in remarks_on(check)]


def _checks(
    fitted: TimeFit,
    structure: LinearStructure,
    records: TimeRecords,
    flights: Sequence[Flight],
    settings: IdentifySettings,
) -> list[Verification]:
    """Flights by a part of the fitted model, with the hold of the fit."""
    unseen = time_records(structure, flights, replace(settings, hold=records.hold), every_input=False)
    rows = [fitted.structure.outputs.index(name) for name in structure.outputs]
    problem = TimeProblem(
        structure=structure,
        parameters=structure.parameters,
        records=unseen.data,
        hold=records.hold,
        unknowns=fitted.problem.unknowns,
        noise=fitted.problem.noise[np.ix_(rows, rows)],
    )
    predicted = problem.predicted(structure.parameters.pack())
    shifts = estimated_shifts(problem, predicted)
    return [
        replace(_check(structure, segment, one, shift), biases=np.zeros(len(fitted.structure.states)))
        for segment, one, shift in zip(unseen.segments, predicted, shifts, strict=True)
    ]


def estimated_shifts(problem: TimeProblem, predicted: Sequence[Simulated]) -> list[FloatArray]:
    """The output shifts in predictions with unknowns estimated, for each record, shape ``(y,)``.

    A prediction is the response to the inputs, that to the initial state, and the shift. The last two are told apart
    again by the motions that initial states cause. Where one of those is a constant, as behind an integrator, nothing
    tells it from a shift, and both get a share.
    """
    if "output_shift" not in problem.unknowns:
        return [np.zeros(len(problem.structure.outputs)) for _ in predicted]
    from rotorid.simulation.linear import simulate_linear

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


def _check(structure: LinearStructure, segment: Segment, one: Simulated, shift: FloatArray) -> Verification:
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


def _record_not_verified(record: FlightRecord, cause: str) -> Finding:
    name = record.source.name
    return warn("not_verified", name, f"{name} did not verify the model: {cause.rstrip('.')}.")
