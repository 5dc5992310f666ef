"""What a search answers: the best it found, every minimum with its basin, and what it cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray


class Progress(NamedTuple):
    """Where a search was after so many evaluations.

    Parameters
    ----------
    evaluations
        Costs that had been computed, and residuals of local searches where these are the search.
    best
        Lowest cost so far.
    """

    evaluations: int
    best: float


class Basin(NamedTuple):
    """A minimum and how much leads to it.

    Parameters
    ----------
    cost
        At the minimum.
    theta
        Free parameters there, shape ``(p,)``.
    share
        Part of the local searches that came to rest which ended there, zero to one.
    """

    cost: float
    theta: FloatArray
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchResult(Immutable):
    """End of a global search.

    Parameters
    ----------
    search
        Its name in the catalog.
    seed
        What it was seeded with; the same seed gives the same result on any number of workers.
    best
        The lowest minimum after the local search.
    theta, cost
        The best before the local search, shape ``(p,)``.
    basins
        Every minimum that local searches ended in, lowest first. The shares of a design of starts are those of the box,
        as far as the starts are many; those of a population, which polishes a chosen few, say little.
    trace
        Best cost by evaluations; for a population after each generation.
    evaluations
        Costs that were computed by the search itself.
    polishing
        Residuals with Jacobians that the local searches took.
    local_searches
        How many there were, with those that came to no rest.
    """

    search: str
    seed: int
    best: Solution
    theta: FloatArray
    cost: float
    basins: tuple[Basin, ...]
    trace: tuple[Progress, ...]
    evaluations: int
    polishing: int
    local_searches: int

    def __post_init__(self) -> None:
        self._set(
            theta=read_only(self.theta, np.float64, ndim=1),
            basins=tuple(Basin(c, read_only(theta, np.float64, ndim=1), share) for c, theta, share in self.basins),
            trace=tuple(Progress(*one) for one in self.trace),
        )
