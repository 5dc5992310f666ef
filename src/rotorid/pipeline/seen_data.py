"""Data that a model was identified on: they flatter it, and are no test of it."""

from __future__ import annotations

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.pipeline.document import ProvenanceDocument


def has_seen(provenance: ProvenanceDocument, record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether any part of a maneuver was fitted, by the hash of its log.

    A result that does not list its maneuvers has seen its logs as a whole.

    Parameters
    ----------
    provenance
        Where a result came from.
    record, maneuver
        What may have been fitted.
    """
    # Logs of one name are told apart by a number behind it.
    names = {_plain(name) for name, sha256 in provenance.inputs.items() if sha256 == record.source.sha256}
    return bool(names) and (
        not provenance.maneuvers
        or any(
            _plain(one.record) in names and one.start_s < maneuver.stop_s and maneuver.start_s < one.stop_s
            for one in provenance.maneuvers
        )
    )


def fitted_logs(provenance: ProvenanceDocument) -> frozenset[str]:
    """Hashes of the logs that a result was fitted to, without those that only verified it."""
    names = {_plain(one.record) for one in provenance.maneuvers}
    return frozenset(sha256 for name, sha256 in provenance.inputs.items() if not names or _plain(name) in names)


def seen_data(record: FlightRecord, maneuver: Maneuver) -> Finding:
    """What to say of a maneuver that was to verify a model and was fitted by it."""
    name = record.source.name
    return Finding(
        kind="seen_data",
        severity="warning",
        where=name,
        message=(
            f"{name} from {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s was fitted, at least in part: it flatters "
            "the model and does not count as a verification. Give another log."
        ),
        numbers={"start_s": maneuver.start_s, "stop_s": maneuver.stop_s},
    )


def _plain(name: str) -> str:
    return name.partition(" (")[0]
