"""What a page says of a bootstrap: mean, spread and interval of every parameter beside what is stated."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.pipeline.document import BootstrapDocument, ResultDocument
from rotorid.report.numbers import percent, significant, unit
from rotorid.report.parameter_table import Cell

_SOURCES = {
    "responses": "errors of the responses, as they are stated and as they go together",
    "outputs": "noise of the outputs, colored as the residuals are",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class SpreadLine:
    """A parameter over all runs; ``std`` is marked where it, or the mean, contradicts what is stated."""

    name: str
    unit: str
    value: str
    stated: str
    mean: str
    std: Cell
    relative: str
    interval: str


@dataclass(frozen=True, kw_only=True, slots=True)
class BootstrapShown:
    """A bootstrap on the page."""

    words: str
    rows: tuple[SpreadLine, ...]


def bootstrap_shown(document: ResultDocument) -> BootstrapShown | None:
    """What to show of a bootstrap; nothing where none was made."""
    again = document.bootstrap
    if again is None:
        return None
    disagrees = {finding.where for finding in document.findings if finding.kind == "bootstrap_disagrees"}
    return BootstrapShown(
        words=_words(again), rows=tuple(_line(document, again, name, name in disagrees) for name in again.parameters)
    )


def _line(document: ResultDocument, again: BootstrapDocument, name: str, disagrees: bool) -> SpreadLine:
    one, spread = document.parameters[name], again.parameters[name]
    return SpreadLine(
        name=name,
        unit=unit(one.unit),
        value=significant(one.value, digits=4),
        stated=significant(one.std, digits=2),
        mean=significant(spread.mean, digits=4),
        std=Cell(significant(spread.std, digits=2), disagrees),
        relative=percent(spread.relative_percent),
        interval=f"{significant(spread.low, digits=4)} to {significant(spread.high, digits=4)}",
    )


def _words(again: BootstrapDocument) -> str:
    left = sum(again.left_out.values())
    without = f" {left} of them had no answer and do not count." if left else ""
    return f"{again.runs} refits of the model, each to {_SOURCES[again.source]}, drawn anew.{without}"
