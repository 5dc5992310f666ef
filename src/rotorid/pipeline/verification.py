"""Judge an identified model on logs that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.assemble import finding_documents, provenance_document, range_documents
from rotorid.pipeline.candidate import Candidate, read_candidate
from rotorid.pipeline.coverage import Trim, covered_by, trim_of
from rotorid.pipeline.frequency_check import FrequencyCheck
from rotorid.pipeline.instruments import Flown, axes_of
from rotorid.pipeline.segments import cut
from rotorid.pipeline.selection import each_once
from rotorid.pipeline.settings import VerifySettings
from rotorid.pipeline.unseen import UnseenLog, Verifications, check_logs, has_seen, seen_data, unseen_logs
from rotorid.pipeline.verify_document import (
    VerifyDocument,
    guideline_document,
    maneuver_verification,
    sweep_verification,
)
from rotorid.verification.verification import Verification

_QUIET_S = 1.5
_SPEEDS_AND_ANGLES = ("u", "v", "w", "theta", "phi")


@dataclass(frozen=True, kw_only=True, eq=False)
class Verified(Immutable):
    """A finished verification.

    Parameters
    ----------
    document
        What ``verification.json`` holds.
    verifications
        Unseen maneuvers, measured and predicted.
    judged
        Unseen sweeps, measured and modelled responses.
    """

    document: VerifyDocument
    verifications: tuple[Verification, ...] = ()
    judged: tuple[FrequencyCheck, ...] = ()


def verify(
    model: str | Path | Candidate,
    records: Sequence[FlightRecord],
    *,
    settings: VerifySettings | None = None,
    command: Sequence[str] = (),
) -> Verified:
    """Judge an identified model on other data.

    Short maneuvers are predicted in the time domain, in open loop and a little ahead from every sample; sweeps and
    random signals are compared in the frequency domain. Nothing of the model is adjusted. What was fitted flatters:
    where the result says what that was, such a maneuver is shown with the finding ``seen_data``; else it is for the
    caller to know.

    Parameters
    ----------
    model
        A folder that ``identify`` wrote, its ``result.json``, a ``model.toml``, or a model with its band.
    records
        Logs as :func:`rotorid.read` gives them.
    settings
        Choices; everything has a default.
    command
        For the provenance.

    Raises
    ------
    InsufficientDataError
        No log can judge the model; the findings say why.
    UsageError, ModelError
        The model cannot be read, a record came twice, or an option is wrong.
    """
    settings = settings or VerifySettings()
    candidate = chosen(model, settings)
    each_once(records)
    axes = axes_of(candidate.structure.inputs, candidate.structure.outputs)
    logs = unseen_logs(candidate, records, axes, segments=settings.segments)
    checked = check_logs(candidate, logs, settings, vibration_filter=settings.vibration_filter)
    findings = (*(f for record in records for f in record.findings), *_seen(candidate, logs), *checked.findings)
    if not checked.verifications and not checked.judged:
        causes = "; ".join(f.message.rstrip(".") for f in checked.findings if f.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log can judge the model",
            needed=f"a sweep or a doublet of {' or '.join(axes)} with all channels of the model",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    document = _document(candidate, records, logs, checked, findings, settings, command)
    return Verified(document=document, verifications=checked.verifications, judged=checked.judged)


def _seen(candidate: Candidate, logs: Sequence[UnseenLog]) -> list[Finding]:
    """Maneuvers that the model was fitted to."""
    known = candidate.provenance
    flown = [item for log in logs for item in (*log.short, *log.sweeps)]
    return [] if known is None else [seen_data(*item) for item in flown if has_seen(known, *item)]


def chosen(model: str | Path | Candidate, settings: VerifySettings) -> Candidate:
    """The model that is meant, with the band and the controllers that were asked for."""
    candidate = model if isinstance(model, Candidate) else read_candidate(Path(model))
    return replace(
        candidate,
        band_rad_s=settings.band_rad_s or candidate.band_rad_s,
        controllers={**candidate.controllers, **settings.controllers},
    )


def _document(
    candidate: Candidate,
    records: Sequence[FlightRecord],
    logs: Sequence[UnseenLog],
    checked: Verifications,
    findings: Sequence[Finding],
    settings: VerifySettings,
    command: Sequence[str],
) -> VerifyDocument:
    structure = candidate.structure
    flown = [item for log in logs for item in (*log.short, *log.sweeps)]
    return VerifyDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        band_rad_s=candidate.band_rad_s,
        maneuvers=[
            maneuver_verification(check, structure.states, _trim(check, flown)) for check in checked.verifications
        ],
        frequency=[sweep_verification(item) for item in checked.judged],
        j_rms_guideline=guideline_document(settings.scale),
        covered=range_documents(covered_by(flown)),
        findings=finding_documents(findings),
        provenance=provenance_document(records, settings, command=command, flown=flown),
    )


def _trim(check: Verification, flown: Sequence[Flown]) -> Trim | None:
    """Trim before a maneuver, of what its log holds of speeds and angles."""
    for record, maneuver in flown:
        if (
            record.source.name != check.record
            or maneuver.start_s > check.time_s[-1]
            or maneuver.stop_s < check.time_s[0]
        ):
            continue
        channels = [name for name in _SPEEDS_AND_ANGLES if name in record.channel_names]
        try:
            segments, _ = cut([(record, maneuver)], channels=channels, rest_s=_QUIET_S) if channels else ((), ())
            return trim_of(segments[0].history, until_s=maneuver.start_s) if segments else None
        except InsufficientDataError:
            return None
    return None


def refused_verification(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    model: str | Path | Candidate,
    *,
    settings: VerifySettings,
    command: Sequence[str] = (),
) -> VerifyDocument:
    """The document for logs that cannot judge a model: its findings say why, and no number is given."""
    structure = chosen(model, settings).structure
    findings = list(error.findings) or [f for record in records for f in record.findings]
    if not error.findings:
        findings.append(refusal("not_verified", structure.name, str(error)))
    return VerifyDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        findings=finding_documents(findings),
        provenance=provenance_document(records, settings, command=command),
    )
