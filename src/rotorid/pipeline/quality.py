"""Remarks on the data of the maneuvers that are used: saturation, other inputs, the battery, sensors and clocks."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.data.findings import Finding
from rotorid.pipeline.consistency import SHORTEST_S, check_consistency, stretches
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown
from rotorid.signal.quality import battery_sag, quality_findings

_REMARKED_SAG_PERCENT = 1.0


def data_quality(flown: Sequence[Flown], segments: Sequence[Segment], inputs: Sequence[str]) -> tuple[Finding, ...]:
    """Remarks on all maneuvers, each kind and place once; of several maneuvers the first that shows it speaks."""
    remarks = [
        finding
        for segment in segments
        for finding in quality_findings(segment.history, axis=segment.maneuver.axis, accounted=inputs)
    ]
    sags = (battery_sag(record, maneuver) for record, maneuver in flown)
    remarks += [sag for sag in sags if sag and abs(sag.numbers["change_percent"]) >= _REMARKED_SAG_PERCENT]
    remarks += _consistency(flown)
    return tuple({(finding.kind, finding.where): finding for finding in reversed(remarks)}.values())


def _consistency(flown: Sequence[Flown]) -> list[Finding]:
    """Whether sensors and clocks agree over the longest maneuver of each axis, in each log."""
    records = {id(record): record for record, _ in flown}
    groups = [(record, [m for r, m in flown if r is record]) for record in records.values()]
    return [
        finding
        for record, maneuvers in groups
        if max(maneuver.duration_s for maneuver in maneuvers) >= SHORTEST_S
        for finding in check_consistency(record, stretches(record, maneuvers)).findings
    ]
