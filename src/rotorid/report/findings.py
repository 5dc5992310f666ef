"""Findings as rows of a page: grave ones first, those of one kind folded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rotorid.data.findings import KINDS, SEVERITIES, Finding, without_repeated
from rotorid.data.quantity import significant
from rotorid.report.frame import typeset

if TYPE_CHECKING:
    from rotorid.documents.base import FindingDocument


@dataclass(frozen=True, kw_only=True, slots=True)
class FindingRow:
    """A finding with a heading, and its numbers as text."""

    severity: str
    heading: str
    where: str
    message: str
    numbers: str
    others: tuple[FindingRow, ...] = ()
    """More of the same kind, which fold away."""


_MOST_OF_A_KIND = 2


def finding_rows(findings: Sequence[Finding | FindingDocument]) -> tuple[FindingRow, ...]:
    """Findings, the grave ones first; of one kind and gravity all but the first two fold into the first."""
    ordered = sorted(without_repeated(findings), key=lambda finding: SEVERITIES.index(finding.severity))
    kinds: dict[tuple[str, str], list[FindingRow]] = {}
    for finding in ordered:
        kinds.setdefault((finding.severity, finding.kind), []).append(_finding_row(finding))
    rows: list[FindingRow] = []
    for same in kinds.values():
        folds = len(same) > _MOST_OF_A_KIND
        rows += [replace(same[0], others=tuple(same[1:]))] if folds else same
    return tuple(rows)


def _finding_row(finding: Finding | FindingDocument) -> FindingRow:
    return FindingRow(
        severity=finding.severity,
        heading=finding_heading(finding.kind),
        where=finding.where,
        message=typeset(finding.message),
        numbers=", ".join(f"{name} {significant(value, digits=4)}" for name, value in finding.numbers.items()),
    )


def finding_heading(kind: str) -> str:
    """Heading of a kind of finding.

    Examples
    --------
    >>> finding_heading("gap"), finding_heading("odd_thing")
    ('Gap in the data', 'Odd thing')
    """
    return KINDS[kind].heading if kind in KINDS else kind.replace("_", " ").capitalize()
