"""Plain multi-start from a central composite design: for few parameters, without anything random."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

from rotorid.search.design_of_starts import central_composite
from rotorid.search.evaluate import Report
from rotorid.search.from_starts import search_from
from rotorid.search.objective import Objective
from rotorid.search.options import no_options
from rotorid.search.result import SearchResult


@dataclass(frozen=True)
class Central:
    """Local searches from the center of the box, the corners of a cube about it and a star on its faces.

    With k parameters there are :math:`2^k + 2 k + 1` starts; those that the budget does not pay are left out, the star
    first. The seed changes nothing. Twelve parameters or fewer are needed.
    """

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "central"

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
        starts = central_composite(objective.box)
        return search_from(self.name, objective, starts, budget=budget, seed=seed, executor=executor, progress=progress)


def from_text(options: str) -> Central:
    """``central``."""
    no_options(options, of="central")
    return Central()
