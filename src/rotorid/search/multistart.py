"""Multi-start: a local search from one start after the other, until the budget is spent.

The starts are a design over the box. Scrambled Sobol points fill it more evenly than random ones, so that fewer of them
miss a basin; a central composite design has nothing random, and suits few parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Problem, StartBox
from rotorid.search.result import Evaluations, Report, SearchResult, end, require_budget, whole_number
from rotorid.search.starts import at_random, central_composite, sobol
from rotorid.typing import FloatArray

Design: TypeAlias = Literal["central", "random", "sobol"]


class Starts(Protocol):
    """Lays out about so many starts over a box, shape ``(n, p)``."""

    def __call__(self, box: StartBox, count: int, *, rng: np.random.Generator) -> FloatArray: ...


def _all_of_composite(box: StartBox, count: int, *, rng: np.random.Generator) -> FloatArray:
    """The whole design: what the budget does not pay is left out as it is spent, the star first."""
    del count, rng
    return central_composite(box)


_DESIGNS: Mapping[Design, Starts] = {"central": _all_of_composite, "random": at_random, "sobol": sobol}


def search_from(
    search: str,
    problem: Problem,
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

    Parameters
    ----------
    search
        Its name, kept with the result.
    problem
        What is minimized.
    starts
        Points, shape ``(n, p)``.
    budget
        Evaluations that are allowed.
    seed
        Kept with the result.
    executor
        Evaluates several points at the same time; one after the other without it.
    progress
        Called with what was found so far.

    Raises
    ------
    UsageError
        The budget is not positive.
    InsufficientDataError
        No start has a finite cost.
    """
    require_budget(budget, 1)
    evaluations = Evaluations(problem, executor=executor, progress=progress)
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
    """How many starts a budget can pay at most: each takes a cost and a residual.

    Parameters
    ----------
    budget
        Evaluations that are allowed.
    """
    return max(budget // 2, 1)


@dataclass(frozen=True)
class MultiStart:
    """Local searches from as many points of a design as the budget pays.

    - ``random`` points are the yardstick for every other search: each start falls into a basin with the probability of
      its share of the box.
    - ``sobol`` points are the first choice where local searches are cheap.
    - ``central`` has the center of the box, the corners of a cube about it and a star on its faces,
      :math:`2^k + 2 k + 1` starts with k parameters, of which twelve or fewer are needed. The seed changes nothing.

    Parameters
    ----------
    design
        How the starts lie; the name of the search in the catalog.
    starts
        How many at most; none for as many as the budget pays.

    Examples
    --------
    >>> multistart_from_text("sobol", "64")
    MultiStart(design='sobol', starts=64)
    """

    design: Design
    starts: int | None = None

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return self.design

    def run(
        self,
        problem: Problem,
        *,
        budget: int,
        seed: int,
        executor: Executor | None = None,
        progress: Report | None = None,
    ) -> SearchResult:
        """Search for the lowest minimum, see :class:`rotorid.search.catalog.Search`."""
        count = min(self.starts or most_starts(budget), most_starts(budget))
        starts = _DESIGNS[self.design](problem.search_box, count, rng=np.random.default_rng(seed))
        return search_from(self.name, problem, starts, budget=budget, seed=seed, executor=executor, progress=progress)


def multistart_from_text(design: Design, options: str) -> MultiStart:
    """``sobol`` and ``random``, or ``sobol:64`` with the number of starts; ``central``, which has no options."""
    if design == "central" and options:
        raise UsageError(f"invalid option in central:{options}", needed="central, which has no options")
    return MultiStart(design, whole_number(options, of=design, needed=f"{design}:64") if options else None)
