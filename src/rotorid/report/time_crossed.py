"""A cross-validation as a table: identified on the record of a row, scored on that of a column."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.pipeline.cross_validation_document import CrossValidationDocument, FoldDocument
from rotorid.report.numbers import MISSING, significant
from rotorid.report.wording import Verdict, fit_verdict


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossedCell:
    """Mean fit over the outputs of one record; quiet where the record was seen."""

    verdict: Verdict | None
    seen: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossedRow:
    """One identification."""

    name: str
    cells: tuple[CrossedCell, ...]
    mean: str
    cause: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Crossed:
    """What the page says of a cross-validation."""

    records: tuple[str, ...]
    rows: tuple[CrossedRow, ...]
    words: str


def crossed(document: CrossValidationDocument | None) -> Crossed | None:
    """The table of a cross-validation, and its sentence."""
    if document is None:
        return None
    return Crossed(
        records=tuple(document.records),
        rows=tuple(_row(fold, document.records) for fold in document.folds),
        words=_words(document),
    )


def _row(fold: FoldDocument, records: list[str]) -> CrossedRow:
    return CrossedRow(
        name=", ".join(fold.identified) if len(fold.identified) == 1 else f"all but {', '.join(fold.unseen)}",
        cells=tuple(_cell(fold, name) for name in records),
        mean=_with_spread(fold.mean_percent, fold.spread_percent),
        cause=fold.cause,
    )


def _cell(fold: FoldDocument, record: str) -> CrossedCell:
    percents = [
        score.nrmse_fit_percent for score in fold.scores.get(record, {}).values() if score.nrmse_fit_percent is not None
    ]
    verdict = fit_verdict(sum(percents) / len(percents)) if percents else None
    return CrossedCell(verdict=verdict, seen=record in fold.identified)


def _with_spread(mean: float | None, spread: float | None) -> str:
    if mean is None:
        return MISSING
    return f"{mean:.1f} %" if spread is None else f"{mean:.1f} ± {spread:.1f} %"


def _words(document: CrossValidationDocument) -> str:
    how = (
        "Identified on each record alone and scored on all others."
        if document.kind == "each"
        else "Identified on all records but one and scored on that one."
    )
    ahead = (
        ""
        if document.horizon_s is None
        else f" The models are unstable: they predicted {document.horizon_s:.2g} s ahead, again and again."
    )
    within = (
        ""
        if document.band_rad_s is None
        else f" Only what lies within {' to '.join(significant(edge) for edge in document.band_rad_s)} rad/s counts."
    )
    looks = (
        ""
        if document.band_rad_s is None or document.horizon_s is None
        else " That filter has no phase and shows a prediction a little of what comes, so these scores are higher than "
        "those of a prediction in flight."
    )
    mean = f" Unseen records: {_with_spread(document.mean_percent, document.spread_percent)} on average."
    best = document.best
    chosen = (
        ""
        if best is None
        else f" Best to identify on is {best.record} with {best.mean_percent:.1f} %, which is optimistic: it was "
        "chosen by these very scores."
    )
    return f"{how}{ahead}{within}{looks}{mean}{chosen}"
