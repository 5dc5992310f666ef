"""Plain multi-start from points drawn evenly over the box.

Plain multi-start from Sobol points: the first choice where local searches are cheap.

Plain multi-start from a central composite design: for few parameters, without anything random.

Plain multi-start: a local search from one start after the other, until the budget is spent.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.fitting.least_squares import Solution
from rotorid.search.objective import (
    Evaluations,
    Objective,
    Report,
    SearchResult,
    no_options,
    require_budget,
    whole_number,
)
from rotorid.search.population import end
from rotorid.search.starts import at_random, central_composite, sobol
from rotorid.typing import FloatArray


def search_from(
    search: str,
    objective: Objective,
    starts: FloatArray,
    *,
    budget: int,
    seed: int,
    executor: Executor | None = None,
    progress: Report | None = None,
) -> SearchResult:
    """Search from every start ``(n, p)``, in order, as long as budget is left.

    A local search that was begun is finished, so that the last may pass the budget. Evaluations count the costs of the
    starts and the residuals of the local searches alike.

    Raises
    ------
    UsageError
        The budget is not positive.
    InsufficientDataError
        No start has a finite cost.
    """
    require_budget(budget, 1)
    evaluations = Evaluations(objective, executor=executor, progress=progress)
    found: list[Solution] = []
    lowest = np.inf
    for start, solution in zip(starts, evaluations.polished(starts), strict=True):
        evaluations.costs(start[None])
        lowest = min(lowest, solution.cost)
        found.append(solution)
        evaluations.mark(lowest)
        if evaluations.spent >= budget:
            break
    return end(search, seed, evaluations, found)


def most_starts(budget: int) -> int:
    """How many starts a budget can pay at most: each takes a cost and a residual."""
    return max(budget // 2, 1)


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
    >>> random_from_text("64")
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


def random_from_text(options: str) -> Random:
    """``random`` or ``random:64``, with the number of starts."""
    return Random(starts=whole_number(options, of="random", needed="random:64") if options else None)


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
    >>> sobol_from_text("64")
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


def sobol_from_text(options: str) -> Sobol:
    """``sobol`` or ``sobol:64``, with the number of starts."""
    return Sobol(starts=whole_number(options, of="sobol", needed="sobol:64") if options else None)


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


def central_from_text(options: str) -> Central:
    """``central``."""
    no_options(options, of="central")
    return Central()
