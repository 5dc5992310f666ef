"""Plain multi-start from points drawn evenly over the box."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.search.design_of_starts import at_random
from rotorid.search.evaluate import Report
from rotorid.search.from_starts import most_starts, search_from
from rotorid.search.objective import Objective
from rotorid.search.options import whole_number
from rotorid.search.result import SearchResult


@dataclass(frozen=True, kw_only=True)
class Random:
    """Local searches from as many points as the budget pays.

    The yardstick for every other search: each start falls into a basin with the probability of its share of the box.

    Parameters
    ----------
    starts
        How many at most; none for as many as the budget pays.

    Examples
    --------
    >>> from_text("64")
    Random(starts=64)
    """

    starts: int | None = None

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "random"

    def run(
        self,
        objective: Objective,
        *,
        budget: int,
        seed: int,
        executor: Executor | None = None,
        progress: Report | None = None,
    ) -> SearchResult:
        """Search for the lowest minimum, see :class:`rotorid.search.catalog.Search`."""
        count = min(self.starts or most_starts(budget), most_starts(budget))
        starts = at_random(objective.box, count, rng=np.random.default_rng(seed))
        return search_from(self.name, objective, starts, budget=budget, seed=seed, executor=executor, progress=progress)


def from_text(options: str) -> Random:
    """``random`` or ``random:64``, with the number of starts."""
    return Random(starts=whole_number(options, of="random", needed="random:64") if options else None)
