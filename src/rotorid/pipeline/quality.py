"""Remarks on the data of the maneuvers that are used: saturation, other inputs, the battery."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.data.findings import Finding
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown
from rotorid.signal.quality import battery_sag, quality_findings

_REMARKED_SAG_PERCENT = 1.0


def data_quality(flown: Sequence[Flown], segments: Sequence[Segment]) -> tuple[Finding, ...]:
    """Remarks on all maneuvers, each kind and place once; of several maneuvers the first that shows it speaks."""
    remarks = [f for segment in segments for f in quality_findings(segment.history, axis=segment.maneuver.axis)]
    sags = (battery_sag(record, maneuver) for record, maneuver in flown)
    remarks += [sag for sag in sags if sag and abs(sag.numbers["change_percent"]) >= _REMARKED_SAG_PERCENT]
    return tuple({(finding.kind, finding.where): finding for finding in reversed(remarks)}.values())
