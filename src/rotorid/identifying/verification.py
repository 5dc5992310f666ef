"""Validation of an identified model on unseen logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, Unpack

from rotorid.checking.candidate import Candidate, candidate_model, read_candidate
from rotorid.checking.checks import maneuver_check
from rotorid.checking.predictions import fitted_before, was_fitted
from rotorid.checking.predictors import predictor_of
from rotorid.data.base import Immutable, ShownByDocument
from rotorid.data.findings import Finding, refusal, worst_first
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.coverage import covered_by, trim_of
from rotorid.flights.flights import Flight
from rotorid.flights.segments import cut
from rotorid.flights.selection import each_once, require_inside
from rotorid.io.records import as_records
from rotorid.results.model import IdentifiedModel, Records, Refused, Verifications
from rotorid.results.provenance import Provenance, provenance
from rotorid.results.summary import ManeuverCheck, Range, Trim
from rotorid.settings.option import as_settings
from rotorid.settings.verifying import VerifySettings
from rotorid.verification.verification import Verification

if TYPE_CHECKING:
    from rotorid.settings.option_types import VerifyOptions

ModelSource: TypeAlias = str | Path | Candidate | IdentifiedModel
"""A model to judge, or where it was written."""

_QUIET_S = 1.5
_SPEEDS_AND_ANGLES = ("u", "v", "w", "theta", "phi")


@dataclass(frozen=True, kw_only=True, eq=False)
class Verified(ShownByDocument, Immutable):
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
    model: ModelSource,
    records: Records,
    *,
    settings: VerifySettings | None = None,
    **options: Unpack[VerifyOptions],
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
        Fields of :class:`rotorid.settings.verifying.VerifySettings`, which go before ``settings``.

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
    predictor = predictor_of(candidate)
    predicted = predictor.predict(records, settings)
    found, flights = predicted.found, predicted.flights
    findings = (
        *(finding for record in records for finding in record.findings),
        *_fitted_maneuvers(candidate, flights),
        *predicted.refusals,
        *found.findings,
    )
    if not found.maneuvers and not found.sweeps:
        causes = "; ".join(finding.message.rstrip(".") for finding in found.findings if finding.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log can judge the model",
            needed=predictor.needed,
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    states = candidate.structure.states if predictor.about_trim else ()
    trims = [_trim(check, flights) if predictor.about_trim else None for check in found.maneuvers]
    return Verified(
        candidate=candidate,
        found=found,
        maneuvers=tuple(
            maneuver_check(check, states, trim) for check, trim in zip(found.maneuvers, trims, strict=True)
        ),
        covered=covered_by(flights),
        scale=settings.scale,
        findings=worst_first(findings),
        provenance=provenance(records, settings, flights=flights),
    )


def _fitted_maneuvers(candidate: Candidate, flights: Sequence[Flight]) -> list[Finding]:
    """Maneuvers that the model was fitted to."""
    known = candidate.provenance
    return [] if known is None else [fitted_before(flight) for flight in flights if was_fitted(known, flight)]


def chosen(model: ModelSource, settings: VerifySettings) -> Candidate:
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
    """Trim before a maneuver, from the logged speeds and angles."""
    for flight in flights:
        record, maneuver = flight.record, flight.maneuver
        same = record.source.name == check.record
        if not same or maneuver.start_s > check.time_s[-1] or maneuver.stop_s < check.time_s[0]:
            continue
        channels = [name for name in _SPEEDS_AND_ANGLES if name in record.channel_names]
        try:
            segments, _ = cut([flight], channels=channels, rest_s=_QUIET_S) if channels else ((), ())
            return trim_of(segments[0].history, until_s=maneuver.start_s) if segments else None
        except InsufficientDataError:
            return None
    return None


def refused_verification(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    model: ModelSource,
    *,
    settings: VerifySettings,
) -> Refused:
    """The result for logs that cannot judge a model."""
    structure = chosen(model, settings).structure
    remarks = [finding for record in records for finding in record.findings]
    return Refused(
        name=structure.name,
        structure=structure,
        findings=worst_first(error.findings or [*remarks, refusal("not_verified", structure.name, str(error))]),
        provenance=provenance(records, settings),
    )
