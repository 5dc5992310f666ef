"""Rows of the report's tables: text for the page, and which cells deserve attention."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.data.maneuver import Maneuver
from rotorid.pipeline.document import FindingDocument, ManeuverDocument, ResultDocument
from rotorid.pipeline.score_document import PairCost
from rotorid.report.model_pictures import by_axis
from rotorid.report.numbers import MISSING, significant
from rotorid.report.wording import Verdict, cost_verdict, finding_heading

_SEVERITIES = ("error", "warning", "info")


@dataclass(frozen=True, kw_only=True, slots=True)
class CostRow:
    """The cost of one response, where it was fitted and on sweeps that were not."""

    pair: str
    value: str
    verdict: Verdict | None
    band: str
    points: str
    unseen: Verdict | None


def cost_rows(document: ResultDocument) -> tuple[CostRow, ...]:
    """Cost of each response on the axis of its input, then of the others; each with that on unseen sweeps."""
    fitted = document.cost.pairs if document.cost else {}
    unseen = document.verification.frequency
    names = [*fitted, *(pair for pair in unseen if pair not in fitted)]
    split = [(pair.partition("/")[0], pair.partition("/")[2]) for pair in names]
    ordered = ["/".join(part for part in pair if part) for pair in by_axis(split)]
    return tuple(_cost_row(pair, fitted.get(pair), unseen.get(pair)) for pair in ordered)


def _cost_row(pair: str, cost: PairCost | None, unseen: float | None) -> CostRow:
    return CostRow(
        pair=pair,
        value=significant(cost.value if cost else None),
        verdict=cost_verdict(cost.value) if cost else None,
        band=_interval(cost.band_rad_s, "rad/s") if cost else MISSING,
        points=str(cost.points) if cost else MISSING,
        unseen=None if unseen is None else Verdict(cost_verdict(unseen).level, significant(unseen)),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverRow:
    """An excitation on the log's own clock."""

    record: str
    kind: str
    interval: str
    duration: str
    band: str
    origin: str


def maneuver_row(record: str, maneuver: Maneuver | ManeuverDocument) -> ManeuverRow:
    """One maneuver in words."""
    return ManeuverRow(
        record=record,
        kind=f"{maneuver.axis} {maneuver.kind.replace('_', ' ')}",
        interval=f"{maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s",
        duration=f"{maneuver.stop_s - maneuver.start_s:.1f} s",
        band=_interval(maneuver.band_rad_s, "rad/s") if maneuver.band_rad_s else MISSING,
        origin=f"{maneuver.origin} in {maneuver.signal}" if maneuver.signal else maneuver.origin,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FindingRow:
    """A finding with a heading, and its numbers as text."""

    severity: str
    heading: str
    where: str
    message: str
    numbers: str


def finding_rows(findings: list[FindingDocument]) -> tuple[FindingRow, ...]:
    """Findings, the grave ones first."""
    ordered = sorted(findings, key=lambda finding: _SEVERITIES.index(finding.severity))
    return tuple(
        FindingRow(
            severity=finding.severity,
            heading=finding_heading(finding.kind),
            where=finding.where,
            message=finding.message,
            numbers=", ".join(f"{name} {significant(value, digits=4)}" for name, value in finding.numbers.items()),
        )
        for finding in ordered
    )


def _interval(band: tuple[float, float], of: str) -> str:
    return f"{significant(band[0])} to {significant(band[1])} {of}"
