"""Plain multi-start: a local search from one start after the other, until the budget is spent."""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np

from rotorid.fit.solution import Solution
from rotorid.search.ending import end
from rotorid.search.evaluate import Evaluations, Report
from rotorid.search.objective import Objective
from rotorid.search.options import require_budget
from rotorid.search.result import SearchResult
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
