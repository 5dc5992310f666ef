"""Findings and provenance as documents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rotorid.data.findings import Finding, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.pipeline.flights import Flight
from rotorid.pipeline.provenance import hashes as hashes
from rotorid.pipeline.provenance import logged, provenance
from rotorid.pipeline.settings import MeasureSettings


def finding_documents(findings: Sequence[Finding]) -> list[FindingDocument]:
    """Findings by severity, each once."""
    return [FindingDocument.model_validate(finding) for finding in worst_first(findings)]


def provenance_document(
    records: Sequence[FlightRecord],
    settings: MeasureSettings,
    *,
    command: Sequence[str],
    flown: Sequence[Flight] = (),
    response: FrequencyResponse | None = None,
    sources: Mapping[str, str] | None = None,
) -> ProvenanceDocument:
    """Where the result came from."""
    return ProvenanceDocument.model_validate(
        provenance(records, settings, command=command, flights=flown, response=response, sources=sources)
    )


def maneuver_document(record: FlightRecord, maneuver: Maneuver) -> ManeuverDocument:
    """One maneuver."""
    return ManeuverDocument.model_validate(logged(record, maneuver))
