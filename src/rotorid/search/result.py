"""Result of a search, and its counts: evaluations, local searches, and their minima.

A search knows nothing of frequency responses, simulations or forces. It works on a few verbs of a
:class:`rotorid.fitting.problem.Problem`: costs of many vectors, whole or point by point, and a local search. Costs are
computed on as many workers as there are, with the same answer on each. Of many local searches the distinct minima are
kept with their basins, and of many tried vectors those are found that are worth a local search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Outcome, Solution, best_of, same_place
from rotorid.fitting.problem import Problem
from rotorid.typing import FloatArray, IntArray


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
class Exchange(Immutable):
    """Candidates that share the points of the data among them, at one iteration.

    Parameters
    ----------
    evaluations
        Costs and residuals that had been computed.
    thetas
        The candidates, shape ``(k, p)``.
    costs
        Of each over all points, shape ``(k,)``.
    owners
        Number of the candidate whose response is nearest to each point, shape ``(n,)``.
    """

    evaluations: int
    thetas: FloatArray
    costs: FloatArray
    owners: IntArray

    def __post_init__(self) -> None:
        self._set(
            thetas=read_only(self.thetas, np.float64, ndim=2),
            costs=read_only(self.costs, np.float64, ndim=1),
            owners=read_only(self.owners, np.int64, ndim=1),
        )


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
    exchanges
        Of the first candidates that shared the points of the data, until no point changed hands; empty for searches
        that do not share them.
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
    exchanges: tuple[Exchange, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            theta=read_only(self.theta, np.float64, ndim=1),
            exchanges=tuple(self.exchanges),
            basins=tuple(Basin(c, read_only(theta, np.float64, ndim=1), share) for c, theta, share in self.basins),
            trace=tuple(Progress(*progress) for progress in self.trace),
        )


Report: TypeAlias = Callable[[Progress], None]

Task = TypeVar("Task")
Answer = TypeVar("Answer")

_MOST_CHUNKS = 8
"""How a batch is divided, whoever works: sums over vectors may depend on their number in the last digit."""

_AHEAD = 32


class Evaluations:
    """Costs of a problem, counted and remembered, and what was best after how many.

    Parameters
    ----------
    problem
        What is minimized.
    executor
        Workers; without one the work is done here. Those in other processes are worth it only for costs that take
        longer than sending the data, some milliseconds.
    progress
        Called with every entry of the trace.
    """

    def __init__(self, problem: Problem, *, executor: Executor | None = None, progress: Report | None = None) -> None:
        self.problem = problem
        self.box = problem.search_box
        self._executor = executor
        self._progress = progress
        self.count = 0
        self.polishing = 0
        self.best = np.inf
        self.theta = self.box.at(np.full(self.box.lower.size, 0.5))
        self.trace: list[Progress] = []

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Costs of vectors ``(b, p)``, shape ``(b,)``; infinite where there is no number."""
        return self._recorded(thetas, np.concatenate(self._map(partial(_costs, self.problem), self._chunks(thetas))))

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of every point, ``(b, p)`` to ``(b, n)``."""
        costs = np.concatenate(self._map(partial(_point_costs, self.problem), self._chunks(thetas)))
        self._recorded(thetas, costs.sum(axis=1))
        return costs

    def _chunks(self, thetas: FloatArray) -> list[FloatArray]:
        size = max(self.problem.at_once, -(-len(thetas) // _MOST_CHUNKS))
        return [thetas[first : first + size] for first in range(0, len(thetas), size)]

    def _recorded(self, thetas: FloatArray, costs: FloatArray) -> FloatArray:
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
            run = partial(_polish, self.problem)
            for solution in map(run, block) if self._executor is None else self._executor.map(run, block):
                self.polishing += solution.evaluations
                yield solution

    def polished_points(self, starts: FloatArray, points: FloatArray) -> list[Solution]:
        """Ends of local searches from starts ``(k, p)``, each with its own weights of the points, ``(k, n)``."""
        found = self._map(partial(_polish_points, self.problem), list(zip(starts, points, strict=True)))
        self.polishing += sum(solution.evaluations for solution in found)
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
def _costs(problem: Problem, thetas: FloatArray) -> FloatArray:
    costs = problem.many_costs(thetas)
    return np.where(np.isfinite(costs), costs, np.inf)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _polish(problem: Problem, start: FloatArray) -> Solution:
    return problem.polish(start)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _point_costs(problem: Problem, thetas: FloatArray) -> FloatArray:
    costs = problem.point_costs(thetas)
    return np.where(np.isfinite(costs), costs, np.inf)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _polish_points(problem: Problem, task: tuple[FloatArray, FloatArray]) -> Solution:
    return problem.polish_points(*task)


_MOST_PLACES = 32
_SAME_PLACE = 0.1


def basins(found: Sequence[Solution], *, name: str) -> tuple[Solution, tuple[Basin, ...]]:
    """The best of many local searches, and every minimum that they ended in, lowest first.

    Two ends are one minimum when their costs agree and the residuals do not distinguish the places. Searches that came
    to no rest ended in no minimum and do not count, unless one of them is the best of all.

    Parameters
    ----------
    found
        Ends of local searches, in the order of their starts.
    name
        What was fitted, for the message.

    Returns
    -------
    Solution
        The lowest, with the other minima in its ``others``; of minima with one cost the first counts.
    tuple of Basin
        Shares sum to one.

    Raises
    ------
    InsufficientDataError
        None has a finite cost.
    """
    best = best_of(found, name=name)
    rested = [solution for solution in found if np.isfinite(solution.cost) and solution.outcome is Outcome.CONVERGED]
    if best.outcome is not Outcome.CONVERGED:
        rested.append(best)
    places: list[Solution] = [best]
    counts = [0]
    for solution in sorted(rested, key=lambda solution: solution.cost):
        place = next((k for k, other in enumerate(places) if same_place(other, solution)), len(places))
        if place == len(places):
            places.append(solution)
            counts.append(0)
        counts[place] += 1
    return best, tuple(Basin(p.cost, p.theta, count / len(rested)) for p, count in zip(places, counts, strict=True))


def worth_polishing(
    shares: FloatArray, costs: FloatArray, *, count: int, early: int = 0, reserved: int = 0
) -> IntArray:
    """Which of many tried vectors to begin local searches at: low, and far from anything lower.

    A lowest vector stands for all that lie close to it. Of these places, the best comes first, then those whose nearest
    better place is farthest: the foot of another valley has nothing better near, a slope of the same valley has.

    A population that settles in one valley tries so much of it that all places are there. Some can therefore be
    reserved for those that stand out of what was tried first, when the whole box was still looked at.

    Parameters
    ----------
    shares
        Where they lie in the unit cube of the box, in the order in which they were tried, shape ``(n, p)``.
    costs
        Shape ``(n,)``; those with an infinite cost are left out.
    count
        How many at most.
    early, reserved
        How many vectors count as tried first, and how many of ``count`` are reserved for places among them.

    Returns
    -------
    numpy.ndarray
        Their numbers, the lowest first.

    References
    ----------
    M. Preuss, *Niching the CMA-ES via nearest-better clustering*, GECCO 2010.

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 101)
    >>> two_valleys = np.minimum((x - 0.2) ** 2, (x - 0.8) ** 2 + 0.01)
    >>> x[worth_polishing(x[:, None], two_valleys, count=2)].round(6).tolist()
    [0.2, 0.8]
    """
    of_all = _by_promise(shares, costs)
    chosen = of_all[: count - reserved]
    for index in (*_by_promise(shares[:early], costs[:early]), *of_all):
        # Neighbors of a chosen place would lead to the same minimum.
        if len(chosen) < count and (_distance(shares[chosen].T, shares[index]) > _SAME_PLACE).all():
            chosen.append(index)
    return np.array(sorted(chosen, key=lambda index: (costs[index], index)), dtype=np.int64)


def _by_promise(shares: FloatArray, costs: FloatArray) -> list[int]:
    """The lowest of each place, those with the farthest better place first."""
    order = np.argsort(costs, kind="stable")
    order = order[np.isfinite(costs[order])]
    rising = shares[order]
    by_side = np.ascontiguousarray(rising.T)
    taken = np.zeros(order.size, dtype=np.bool_)
    places: list[int] = []
    to_better: list[float] = []
    while not taken.all() and len(places) < _MOST_PLACES:
        lowest = int(np.argmin(taken))
        to_better.append(float(_distance(rising[places].T, rising[lowest]).min(initial=np.inf)))
        taken |= _distance(by_side, rising[lowest]) <= _SAME_PLACE
        places.append(lowest)
    return [int(order[places[k]]) for k in np.argsort(-np.array(to_better), kind="stable")]


def _distance(many: FloatArray, one: FloatArray) -> FloatArray:
    """From vectors ``(p, n)`` to one, root mean square over the sides: one limit serves any number of parameters."""
    return np.asarray(np.sqrt(((many - one[:, None]) ** 2).sum(axis=0) / one.size))


def end(
    search: str,
    seed: int,
    evaluations: Evaluations,
    found: Sequence[Solution],
    exchanges: Sequence[Exchange] = (),
) -> SearchResult:
    """The result of a search that ended in these local searches.

    Raises
    ------
    InsufficientDataError
        None has a finite cost.
    """
    best, minima = basins(found, name=evaluations.problem.name)
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
        exchanges=tuple(exchanges),
    )


def whole_number(text: str, *, of: str, needed: str) -> int:
    """A positive whole number.

    Parameters
    ----------
    of
        The search whose option it is, for the message.
    needed
        What its options look like.

    Raises
    ------
    UsageError
        It is no such number.

    Examples
    --------
    >>> whole_number("64", of="sobol", needed="sobol:64")
    64
    """
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise UsageError(f"invalid option {text!r} of the search {of}", needed=f"positive numbers as in {needed}")
    return int(text)


def require_budget(budget: int, least: int) -> None:
    """Refuse a budget that does not pay the beginning of a search.

    Raises
    ------
    UsageError
        It is too small.
    """
    if budget < least:
        raise UsageError(f"a budget of {budget} evaluations is too small", needed=f"{least} or more")
