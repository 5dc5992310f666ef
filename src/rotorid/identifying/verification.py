"""Judge an identified model on logs that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from rotorid.checking.candidate import Candidate, candidate_model, read_candidate
from rotorid.checking.checks import maneuver_check
from rotorid.checking.flown_motors import KnownMotors, predicted_by, verification_of
from rotorid.checking.flown_nonlinear import verified_through, whole_flights
from rotorid.checking.unseen import UnseenLog, check_logs, has_seen, seen_data, unseen_logs
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal, warn, worst_first
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.coverage import covered_by, trim_of
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of
from rotorid.flights.segments import cut
from rotorid.flights.selection import each_once, require_inside, require_reached
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.results.model import IdentifiedModel, Records, Refused, Verifications
from rotorid.results.provenance import Provenance, provenance
from rotorid.results.summary import ManeuverCheck, Range, Trim
from rotorid.settings.settings import VerifySettings, as_records, as_settings
from rotorid.verification.verification import Verification

Judged: TypeAlias = str | Path | Candidate | IdentifiedModel
"""A model to judge, or where it was written."""

_QUIET_S = 1.5
_SPEEDS_AND_ANGLES = ("u", "v", "w", "theta", "phi")


@dataclass(frozen=True, kw_only=True, eq=False)
class Verified(Immutable):
    """A finished verification.

    Parameters
    ----------
    candidate
        What was judged.
    found
        Unseen maneuvers, measured and predicted; unseen sweeps, measured and modeled responses.
    maneuvers
        The maneuvers in numbers, each with its trim.
    covered
        Ranges of speeds, angles and commands that the logs covered.
    scale
        Of the vehicle, for the guideline of J_rms.
    findings
        Remarks, the worst first.
    provenance
        Which logs it was judged on.
    """

    candidate: Candidate
    found: Verifications
    maneuvers: tuple[ManeuverCheck, ...]
    covered: Mapping[str, Range]
    scale: float | None
    findings: tuple[Finding, ...]
    provenance: Provenance


def verify(
    model: Judged,
    records: Records,
    *,
    settings: VerifySettings | None = None,
    **options: Any,
) -> Verified:
    """Judge an identified model on other data.

    Short maneuvers are predicted in the time domain, in open loop and a little ahead from every sample; sweeps and
    random signals are compared in the frequency domain. Nothing of the model is adjusted. What was fitted flatters:
    where the result says what that was, such a maneuver is shown with the finding ``seen_data``; else it is for the
    caller to know.

    Parameters
    ----------
    model
        What ``identify`` answered, a folder that it wrote, its ``result.json``, a ``model.toml``, or a model with its
        band.
    records
        Logs as :func:`rotorid.read` gives them, or their files; one may come without a list around it.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.settings.settings.VerifySettings`, which go before ``settings``.

    Raises
    ------
    InsufficientDataError
        No log can judge the model; the findings say why.
    UsageError, ModelError
        The model cannot be read, a record came twice, or an option is wrong.
    """
    settings, records = as_settings(VerifySettings, settings, options), as_records(records)
    candidate = chosen(model, settings)
    each_once(records)
    require_inside(records, settings.segments)
    if candidate.motors is not None:
        return _verify_motors(candidate, candidate.motors, records, settings)
    if candidate.nonlinear is not None:
        return _verify_nonlinear(candidate, candidate.nonlinear, records, settings)
    axes = axes_of(candidate.structure.inputs, candidate.structure.outputs)
    logs = unseen_logs(candidate, records, axes, segments=settings.segments)
    checked = check_logs(candidate, logs, settings, vibration_filter=settings.vibration_filter)
    findings = (*(f for record in records for f in record.findings), *_seen(candidate, logs), *checked.findings)
    if not checked.maneuvers and not checked.sweeps:
        causes = "; ".join(f.message.rstrip(".") for f in checked.findings if f.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log can judge the model",
            needed=f"a sweep or a doublet of {' or '.join(axes)} with all channels of the model",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    flights = [item for log in logs for item in (*log.short, *log.sweeps)]
    states = candidate.structure.states
    return Verified(
        candidate=candidate,
        found=checked,
        maneuvers=tuple(maneuver_check(check, states, _trim(check, flights)) for check in checked.maneuvers),
        covered=covered_by(flights),
        scale=settings.scale,
        findings=worst_first(findings),
        provenance=provenance(records, settings, flights=flights),
    )


def _verify_motors(
    candidate: Candidate, known: KnownMotors, records: Sequence[FlightRecord], settings: VerifySettings
) -> Verified:
    """Judge a vehicle of ``physical.motors``: accelerations from motors, see :mod:`.checking.flown_motors`."""
    _refuse_of_responses(candidate, settings)
    checks: list[Verification] = []
    findings = [finding for record in records for finding in record.findings]
    flights: list[Flight] = []
    for record in records:
        try:
            require_reached(record, settings.segments)
            found = predicted_by(known, record, settings.segments)
        except InsufficientDataError as error:
            name = record.source.name
            findings += [*error.findings, warn("not_verified", name, f"{name} was not judged: {error}")]
            continue
        findings += found.findings
        seen = [Flight(record, replace(one.flight.maneuver)) for one in found.moved]
        if candidate.provenance is not None:
            findings += [seen_data(*item) for item in seen if has_seen(candidate.provenance, *item)]
        flights += seen
        checks += [verification_of(one, candidate.structure.inputs) for one in found.moved]
    if not checks:
        causes = "; ".join(one.message.rstrip(".") for one in findings if one.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log can judge the model",
            needed="motors, gyros and accelerometer of the vehicle, and motion on an axis that was identified",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    return Verified(
        candidate=candidate,
        found=Verifications(maneuvers=tuple(checks)),
        maneuvers=tuple(maneuver_check(check, ()) for check in checks),
        covered=covered_by(flights),
        scale=settings.scale,
        findings=worst_first(findings),
        provenance=provenance(records, settings, flights=flights),
    )


def _verify_nonlinear(
    candidate: Candidate, equations: NonlinearStructure, records: Sequence[FlightRecord], settings: VerifySettings
) -> Verified:
    """Judge a nonlinear model: whole flights, or given intervals of them, simulated from their start on."""
    _refuse_of_responses(candidate, settings)
    checks: list[Verification] = []
    findings = [finding for record in records for finding in record.findings]
    judged: list[Flight] = []
    for record in records:
        try:
            require_reached(record, settings.segments)
            flights = whole_flights([record], settings.segments)
            found, told = verified_through(equations, equations.parameters, flights)
        except InsufficientDataError as error:
            name = record.source.name
            findings += [*error.findings, warn("not_verified", name, f"{name} was not judged: {error}")]
            continue
        if candidate.provenance is not None:
            findings += [seen_data(*item) for item in flights if has_seen(candidate.provenance, *item)]
        judged += flights
        checks += found
        findings += told
    if not checks:
        causes = "; ".join(one.message.rstrip(".") for one in findings if one.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log can judge the model",
            needed=f"a flight with {' or '.join(equations.outputs)}",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    return Verified(
        candidate=candidate,
        found=Verifications(maneuvers=tuple(checks)),
        maneuvers=tuple(maneuver_check(check, ()) for check in checks),
        covered=covered_by(judged),
        scale=settings.scale,
        findings=worst_first(findings),
        provenance=provenance(records, settings, flights=judged),
    )


def _refuse_of_responses(candidate: Candidate, settings: VerifySettings) -> None:
    """Refuse options of models that are judged by responses and short maneuvers."""
    given = {"--band": settings.band_rad_s, "--instrument": settings.instruments, "--controller": settings.controllers}
    if wrong := [name for name, value in given.items() if value]:
        raise UsageError(
            f"{', '.join(wrong)} came with a result of {candidate.structure.name}",
            needed="logs, and --segment where excitations are not found",
        )


def _seen(candidate: Candidate, logs: Sequence[UnseenLog]) -> list[Finding]:
    """Maneuvers that the model was fitted to."""
    known = candidate.provenance
    flights = [item for log in logs for item in (*log.short, *log.sweeps)]
    return [] if known is None else [seen_data(*item) for item in flights if has_seen(known, *item)]


def chosen(model: Judged, settings: VerifySettings) -> Candidate:
    """The model that is meant, with the band and the controllers that were asked for."""
    if isinstance(model, IdentifiedModel):
        model = candidate_model(model)
    candidate = model if isinstance(model, Candidate) else read_candidate(Path(model))
    return replace(
        candidate,
        band_rad_s=settings.band_rad_s or candidate.band_rad_s,
        controllers={**candidate.controllers, **settings.controllers},
    )


def _trim(check: Verification, flights: Sequence[Flight]) -> Trim | None:
    """Trim before a maneuver, of what its log holds of speeds and angles."""
    for record, maneuver in flights:
        if (
            record.source.name != check.record
            or maneuver.start_s > check.time_s[-1]
            or maneuver.stop_s < check.time_s[0]
        ):
            continue
        channels = [name for name in _SPEEDS_AND_ANGLES if name in record.channel_names]
        try:
            segments, _ = cut([Flight(record, maneuver)], channels=channels, rest_s=_QUIET_S) if channels else ((), ())
            return trim_of(segments[0].history, until_s=maneuver.start_s) if segments else None
        except InsufficientDataError:
            return None
    return None


def refused_verification(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    model: Judged,
    *,
    settings: VerifySettings,
) -> Refused:
    """What to say of logs that cannot judge a model."""
    structure = chosen(model, settings).structure
    remarks = [finding for record in records for finding in record.findings]
    return Refused(
        name=structure.name,
        structure=structure,
        findings=worst_first(error.findings or [*remarks, refusal("not_verified", structure.name, str(error))]),
        provenance=provenance(records, settings),
    )
