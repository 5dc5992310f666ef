"""Plain multi-start from Sobol points: the first choice where local searches are cheap."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.search.design_of_starts import sobol
from rotorid.search.evaluate import Report
from rotorid.search.from_starts import most_starts, search_from
from rotorid.search.objective import Objective
from rotorid.search.options import whole_number
from rotorid.search.result import SearchResult


@dataclass(frozen=True, kw_only=True)
class Sobol:
    """Local searches from as many points as the budget pays.

    Scrambled Sobol points fill the box more evenly than random ones, so that fewer starts miss a basin.

    Parameters
    ----------
    starts
        How many at most; none for as many as the budget pays.

    Examples
    --------
    >>> from_text("64")
    Sobol(starts=64)
    """

    starts: int | None = None

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "sobol"

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
        starts = sobol(objective.box, count, rng=np.random.default_rng(seed))
        return search_from(self.name, objective, starts, budget=budget, seed=seed, executor=executor, progress=progress)


def from_text(options: str) -> Sobol:
    """``sobol`` or ``sobol:64``, with the number of starts."""
    return Sobol(starts=whole_number(options, of="sobol", needed="sobol:64") if options else None)
