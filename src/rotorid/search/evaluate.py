"""Costs and local searches of many vectors, on as many workers as there are, with the same answer on each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TypeAlias, TypeVar

import numpy as np

from rotorid.fit.solution import Solution
from rotorid.search.objective import Objective
from rotorid.search.result import Progress
from rotorid.typing import FloatArray

Report: TypeAlias = Callable[[Progress], None]

Task = TypeVar("Task")
Answer = TypeVar("Answer")

_MOST_CHUNKS = 8
"""How a batch is divided, whoever works: sums over vectors may depend on their number in the last digit."""

_AHEAD = 32


class Evaluations:
    """Costs of an objective, counted and remembered, and what was best after how many.

    Parameters
    ----------
    objective
        What is minimized.
    executor
        Workers; without one the work is done here. Those in other processes are worth it only for costs that take
        longer than sending the data, some milliseconds.
    progress
        Called with every entry of the trace.
    """

    def __init__(
        self, objective: Objective, *, executor: Executor | None = None, progress: Report | None = None
    ) -> None:
        self.objective = objective
        self._executor = executor
        self._progress = progress
        self.count = 0
        self.polishing = 0
        self.best = np.inf
        self.theta = objective.box.at(np.full(objective.box.lower.size, 0.5))
        self.trace: list[Progress] = []

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Costs of vectors ``(b, p)``, shape ``(b,)``; infinite where there is no number."""
        return self._remembered(
            thetas, np.concatenate(self._map(partial(_costs, self.objective), self._chunks(thetas)))
        )

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """What every point adds to these costs, ``(b, p)`` to ``(b, n)``."""
        costs = np.concatenate(self._map(partial(_point_costs, self.objective), self._chunks(thetas)))
        self._remembered(thetas, costs.sum(axis=1))
        return costs

    def _chunks(self, thetas: FloatArray) -> list[FloatArray]:
        size = max(self.objective.at_once, -(-len(thetas) // _MOST_CHUNKS))
        return [thetas[first : first + size] for first in range(0, len(thetas), size)]

    def _remembered(self, thetas: FloatArray, costs: FloatArray) -> FloatArray:
        self.count += len(thetas)
        lowest = int(np.argmin(costs))
        if costs[lowest] < self.best:
            self.best, self.theta = float(costs[lowest]), thetas[lowest].copy()
        return costs

    def polished(self, starts: FloatArray) -> Iterator[Solution]:
        """Ends of local searches from starts ``(k, p)``, in their order, counted as they are taken.

        Workers run ahead; what is not taken is not counted.
        """
        for first in range(0, len(starts), _AHEAD):
            block = starts[first : first + _AHEAD]
            run = partial(_polish, self.objective)
            for solution in map(run, block) if self._executor is None else self._executor.map(run, block):
                self.polishing += solution.evaluations
                yield solution

    def polished_points(self, starts: FloatArray, points: FloatArray) -> list[Solution]:
        """Ends of local searches from starts ``(k, p)``, each with its own weights of the points, ``(k, n)``."""
        found = self._map(partial(_polish_points, self.objective), list(zip(starts, points, strict=True)))
        self.polishing += sum(one.evaluations for one in found)
        return found

    def _map(self, run: Callable[[Task], Answer], tasks: Sequence[Task]) -> list[Answer]:
        # One task is done here: sending it away gains nothing.
        if self._executor is None or len(tasks) == 1:
            return [run(task) for task in tasks]
        return list(self._executor.map(run, tasks))

    @property
    def spent(self) -> int:
        """Costs and residuals so far."""
        return self.count + self.polishing

    def mark(self, best: float | None = None) -> None:
        """Add an entry to the trace, with the lowest cost that was computed or another one."""
        self.trace.append(Progress(self.spent, self.best if best is None else best))
        if self._progress is not None:
            self._progress(self.trace[-1])


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a vector far off has a cost that is no number
def _costs(objective: Objective, thetas: FloatArray) -> FloatArray:
    costs = objective.costs(thetas)
    return np.where(np.isfinite(costs), costs, np.inf)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _polish(objective: Objective, start: FloatArray) -> Solution:
    return objective.polish(start)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _point_costs(objective: Objective, thetas: FloatArray) -> FloatArray:
    costs = objective.point_costs(thetas)
    return np.where(np.isfinite(costs), costs, np.inf)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _polish_points(objective: Objective, task: tuple[FloatArray, FloatArray]) -> Solution:
    return objective.polish_points(*task)
