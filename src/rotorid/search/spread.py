"""Spread of the results of a repeated search: the study behind a table of a hundred runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.errors import UsageError
from rotorid.fitting.problem import Problem
from rotorid.search.catalog import Search
from rotorid.search.result import SearchResult
from rotorid.typing import BoolArray, FloatArray, IntArray
from rotorid.uncertainty.resampling import LeftOut, RunProgress, SpreadTable, each_run, spread_of

RunSearch: TypeAlias = Callable[[int], SearchResult]
"""A search from a seed. It may draw its data from the seed too: noise, or a whole flight."""

_NOTHING = 1e-9
"""Of the cost at which searches begin: below it a cost is zero, as of data without noise."""

_LARGEST_SEED = 2**32


@dataclass(frozen=True, eq=False)
class Repeated:
    """The same search of the same problem, from any seed.

    Parameters
    ----------
    search, problem, budget
        As in :meth:`rotorid.search.catalog.Search.run`.
    """

    search: Search
    problem: Problem
    budget: int

    def __call__(self, seed: int) -> SearchResult:
        """The search with one seed."""
        return self.search.run(self.problem, budget=self.budget, seed=seed)


class Share(NamedTuple):
    """A share of runs, zero to one, with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchSpread(Immutable):
    """End points of many runs of one search, before and after the local search.

    Where two minima have one cost, as those of a structure whose poles can change places, runs end in either; the
    parameters then lie far apart although every run succeeded.

    Parameters
    ----------
    before, after
        Parameters, about those of the lowest cost of all.
    seeds
        Of the runs that count: the search with this seed alone gives the same again.
    costs_before, costs_after
        Shape ``(n,)``.
    targets
        The cost that counts as found, for each run, shape ``(n,)``.
    tolerance
        By how much of it a cost may lie above.
    floors
        Costs below which a run counts in any case, shape ``(n,)``.
    evaluations, polishing
        Costs computed by the search, and residuals with Jacobians by its local searches, shape ``(n,)``.
    """

    before: SpreadTable
    after: SpreadTable
    seeds: tuple[int, ...]
    costs_before: FloatArray
    costs_after: FloatArray
    targets: FloatArray
    tolerance: float
    floors: FloatArray
    evaluations: IntArray
    polishing: IntArray

    def __post_init__(self) -> None:
        real = ("costs_before", "costs_after", "targets", "floors")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in real})
        self._set(**{name: read_only(getattr(self, name), np.int64, ndim=1) for name in ("evaluations", "polishing")})

    @property
    def success_before(self) -> Share:
        """Share of the runs within the tolerance before the local search."""
        return self._share(self.costs_before)

    @property
    def success(self) -> Share:
        """Share of the runs within the tolerance after it. A failed run counts as one that did not reach it."""
        return self._share(self.costs_after)

    def _share(self, costs: FloatArray) -> Share:
        found: BoolArray = costs <= np.maximum((1.0 + self.tolerance) * self.targets, self.floors)
        return wilson(int(found.sum()), self.after.runs)


def spread_over_starts(
    run_search: RunSearch,
    *,
    names: Sequence[str],
    runs: int,
    seed: int,
    units: Sequence[str] = (),
    tolerance: float = 0.01,
    target: float | Callable[[int], float] | None = None,
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SearchSpread:
    """Run a search from many seeds, and return how far its answers differ and how often it succeeds.

    On one set of data this is the scatter of the search alone, of which a good one that ends in a local search has
    none; it says nothing about the errors of the parameters. With noise that is drawn from the seed it is both.

    Parameters
    ----------
    run_search
        The search: a :class:`Repeated`, or any function of a seed; with workers in other processes it must pickle.
    names, units
        Of the parameters.
    runs
        How many.
    seed
        Run k has a seed of its own made of this one, whatever other runs there are.
    tolerance
        By how much of the target a cost may lie above it and still count.
    target
        The cost that counts as found: a number, or from the seed of a run to its number where each has data of its own,
        for instance the cost at the true parameters. By default the lowest that any run ended at, which holds for one
        set of data only.
    executor, progress
        As in :func:`rotorid.uncertainty.resampling.resample`. Searches in workers should have none of their own.

    Raises
    ------
    UsageError
        Fewer than two runs were asked for, or the tolerance is negative.
    InsufficientDataError
        Fewer than two runs had an answer.
    """
    if not 0.0 <= tolerance < math.inf:
        raise UsageError(f"the tolerance {tolerance:g} is not zero or positive")
    done = each_run(_Seeded(run_search, target), runs=runs, seed=seed, executor=executor, progress=progress)
    found = [run for run in done if not isinstance(run, LeftOut)]
    best = min(found, key=lambda run: run.cost_after, default=None)
    estimate = np.zeros(len(names)) if best is None else best.after

    def table(side: str) -> SpreadTable:
        values = [run if isinstance(run, LeftOut) else getattr(run, side) for run in done]
        return spread_of(values, names=names, units=units, estimate=estimate, seed=seed)

    lowest = math.inf if best is None else best.cost_after
    return SearchSpread(
        before=table("before"),
        after=table("after"),
        seeds=tuple(run.seed for run in found),
        costs_before=np.array([run.cost_before for run in found]),
        costs_after=np.array([run.cost_after for run in found]),
        targets=np.array([lowest if run.target is None else run.target for run in found]),
        tolerance=tolerance,
        floors=np.array([_NOTHING * run.began for run in found]),
        evaluations=np.array([run.evaluations for run in found]),
        polishing=np.array([run.polishing for run in found]),
    )


def wilson(found: int, runs: int) -> Share:
    """A share with its 95 % interval, which is honest also for none and for all of few runs.

    Parameters
    ----------
    found
        Runs that found it.
    runs
        All runs.

    References
    ----------
    E. B. Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, Journal of the American
    Statistical Association 22(158), 1927.

    Examples
    --------
    >>> [round(value, 2) for value in wilson(20, 20)]
    [1.0, 0.84, 1.0]
    """
    share, square = found / runs, TWO_SIDED_95**2
    center = (share + square / (2.0 * runs)) / (1.0 + square / runs)
    half = TWO_SIDED_95 / (1.0 + square / runs) * math.sqrt(share * (1.0 - share) / runs + square / (4.0 * runs**2))
    # Rounding must not leave the share of none or all outside.
    return Share(share, max(min(center - half, share), 0.0), min(max(center + half, share), 1.0))


class _Run(NamedTuple):
    """Record of a search; ``began`` is the cost after its first evaluations."""

    seed: int
    before: FloatArray
    after: FloatArray
    cost_before: float
    cost_after: float
    target: float | None
    began: float
    evaluations: int
    polishing: int


@dataclass(frozen=True)
class _Seeded:
    run_search: RunSearch
    target: float | Callable[[int], float] | None

    def __call__(self, rng: np.random.Generator) -> _Run:
        seed = int(rng.integers(_LARGEST_SEED))
        result = self.run_search(seed)
        return _Run(
            seed=seed,
            before=result.theta,
            after=result.best.theta,
            cost_before=result.cost,
            cost_after=result.best.cost,
            target=self.target(seed) if callable(self.target) else self.target,
            began=result.trace[0].best if result.trace else 0.0,
            evaluations=result.evaluations,
            polishing=result.polishing,
        )
