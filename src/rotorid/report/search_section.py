"""What a page says of a global search: how the cost fell, and every minimum that was met."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.pipeline.document import SearchDocument
from rotorid.plot.search import convergence
from rotorid.report.numbers import percent, significant
from rotorid.report.picture import Picture
from rotorid.search.result import Progress

_MOST_ROWS = 12
_COSTS = {
    "frequency": "CIFER's cost, summed over the responses",
    "output_error": "the sum of squared output errors, outputs weighed by their size",
}
_POPULATIONS = ("cma", "evolution", "genetic")


@dataclass(frozen=True, kw_only=True, slots=True)
class BasinRow:
    """A minimum: its cost, the percent of local searches that ended there, its parameters."""

    cost: str
    share: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchShown:
    """A search on the page."""

    words: str
    minima_words: str
    names: tuple[str, ...]
    rows: tuple[BasinRow, ...]
    more: int
    population: bool
    picture: Picture | None


def search_shown(document: SearchDocument | None, *, key: str) -> SearchShown | None:
    """What to show of a search; nothing where none was made.

    Parameters
    ----------
    document
        The search.
    key
        Identifier of its picture.
    """
    if document is None:
        return None
    minima = document.minima
    names = tuple(minima[0].parameters)
    rows = tuple(
        BasinRow(
            cost=significant(one.cost, digits=5),
            share=percent(100.0 * one.share),
            values=tuple(significant(one.parameters[name], digits=4) for name in names),
        )
        for one in minima[:_MOST_ROWS]
    )
    return SearchShown(
        words=_words(document),
        minima_words=_minima_words(document),
        names=names,
        rows=rows,
        more=max(len(minima) - _MOST_ROWS, 0),
        population=document.name.partition(":")[0] in _POPULATIONS,
        picture=_picture(document, key),
    )


def _words(document: SearchDocument) -> str:
    local = "1 local search" if document.local_searches == 1 else f"{document.local_searches} local searches"
    return (
        f"Before the fit, {document.name} searched {_COSTS[document.objective]}: {document.evaluations} evaluations, "
        f"and {document.polishing} of residuals with their derivatives in {local}."
    )


def _minima_words(document: SearchDocument) -> str:
    count = len(document.minima)
    if count == 1:
        return "Every local search that came to rest ended in one place, from which the fit went on."
    ways = {
        "frequency": "the first of them",
        "output_error": "all of them, and from the starts of the model",
    }
    return f"Local searches came to rest in {count} places. The fit went on from {ways[document.objective]}."


def _picture(document: SearchDocument, key: str) -> Picture | None:
    """The cost over the evaluations; nothing where the first of them was the best."""
    costs = [best for _, best in document.trace]
    if not costs or max(costs) == min(costs):
        return None
    trace = [Progress(evaluations, best) for evaluations, best in document.trace]
    return Picture(
        key=key,
        description=f"Lowest cost so far over the evaluations of {document.name}, and the lowest minimum",
        figure=convergence({document.name: trace}, levels={"lowest minimum": document.minima[0].cost}),
    )
