"""How every search ends: in local searches, with all minima."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.fit.solution import Solution
from rotorid.search.basins import basins, worth_polishing
from rotorid.search.evaluate import Evaluations
from rotorid.search.result import SearchResult
from rotorid.typing import FloatArray

POLISHED = 8
"""Local searches at the end of a population: the best vector, and the most promising elsewhere."""

EARLY, RESERVED = 100, 4
"""Half of them are kept for places among the vectors that were tried before a population settles anywhere."""


def end_of_population(
    search: str, seed: int, evaluations: Evaluations, shares: FloatArray, costs: FloatArray
) -> SearchResult:
    """Local searches from the few vectors of a population that are worth one.

    Parameters
    ----------
    search, seed
        For the result.
    evaluations
        Those of the search.
    shares, costs
        Everything it tried, in its order, in the unit cube of the box, shapes ``(n, p)`` and ``(n,)``.

    Raises
    ------
    InsufficientDataError
        Nothing that was tried has a finite cost.
    """
    chosen = worth_polishing(shares, costs, count=POLISHED, early=EARLY, reserved=RESERVED)
    starts = evaluations.objective.box.at(shares[chosen])
    return end(search, seed, evaluations, list(evaluations.polished(starts)))


def end(search: str, seed: int, evaluations: Evaluations, found: Sequence[Solution]) -> SearchResult:
    """The result of a search that ended in these local searches.

    Raises
    ------
    InsufficientDataError
        None has a finite cost.
    """
    best, minima = basins(found, name=evaluations.objective.name)
    return SearchResult(
        search=search,
        seed=seed,
        best=best,
        theta=evaluations.theta,
        cost=evaluations.best,
        basins=minima,
        trace=tuple(evaluations.trace),
        evaluations=evaluations.count,
        polishing=evaluations.polishing,
        local_searches=len(found),
    )
