"""A global search before a fit: run, handed on with all of its minima, and judged."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.errors import UsageError
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import same_cost
from rotorid.fitting.problem import Problem
from rotorid.io.pool import pool
from rotorid.models.parameter import ParameterSet
from rotorid.results.summary import (
    Cluster,
    ClusterIteration,
    Minimum,
    Objective,
    RunSpread,
    RunTable,
    SearchMinimum,
    SearchRuns,
    SearchSummary,
    SharedPoint,
)
from rotorid.search.result import Basin, Exchange, Progress, SearchResult
from rotorid.settings.identifying import EVALUATIONS, IdentifySettings
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.resampling import SpreadTable

if TYPE_CHECKING:
    from rotorid.search.spread import SearchSpread

_PROGRESS = logging.getLogger("rotorid.progress")


NEARLY_AS_GOOD = 0.10
"""Of the cost: a misfit that is 5 % larger, which no look at the fit would show."""

_FAR_SIGMAS = 3.0
_FAR = 0.10
_NAMED = 3
_WITHOUT_LIMIT = 2**62
"""Budget of a design of starts: all of them are tried."""

_SEARCHED = 20_000
"""Samples of long records on which a search in time works; the fit from what it found has all of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Searched(Immutable):
    """A search of a problem, and where it left the fit that goes on from it.

    Parameters
    ----------
    name
        The search as it was asked for, with its options.
    cost
        What was minimized, as :attr:`rotorid.fitting.problem.Problem.method` says it: CIFER's cost, summed over the
        responses, or the squared output errors, weighed by the size of the outputs.
    parameters
        Of the problem: names, and the values of the model before the search.
    result
        What the search found.
    runs
        The same from other seeds, where they were asked for.
    points
        Of the responses, where candidates shared them.
    """

    name: str
    cost: str
    parameters: ParameterSet
    result: SearchResult
    runs: SearchSpread | None = None
    points: tuple[SharedPoint, ...] = ()

    @property
    def objective(self) -> Objective:
        """The minimized cost, as results name it."""
        known: dict[str, Objective] = {"frequency": "frequency", "accelerations": "accelerations"}
        return known.get(self.cost, "output_error")

    @property
    def minima(self) -> tuple[Basin, ...]:
        """All minima, lowest first; of those with one cost the one closest to the values of the model leads.

        Where two poles can change places, as a damping and a motor lag in a row, the values of the model know which is
        which and the data do not.
        """
        basins = self.result.basins
        alike = [basin for basin in basins if same_cost(basin.cost, basins[0].cost)]
        first = min(alike, key=lambda basin: self._distance(basin.theta))
        return (first, *(basin for basin in basins if basin is not first))

    def _distance(self, theta: FloatArray) -> float:
        """From the values of the model, each parameter by its size."""
        own = self.parameters.pack()
        theta = theta[: own.size]
        size = np.maximum(np.abs(own), np.abs(theta))
        moved = np.divide(np.abs(theta - own), size, out=np.zeros(own.shape), where=size > 0.0)
        return float(moved @ moved)

    def values(self, basin: Basin) -> dict[str, float]:
        """Free parameters at a minimum, by their names."""
        free = self.parameters.free
        return dict(zip(free, map(float, basin.theta[: len(free)]), strict=True))


def searched(problem: Problem, settings: IdentifySettings) -> Searched | None:
    """Search a problem as the settings ask; nothing where they ask for none.

    Parameters
    ----------
    problem
        Long records of one in time are searched on their first part.
    settings
        ``search`` with its budget, or ``starts``, which is a search from all points of a design.

    Raises
    ------
    UsageError
        The budget does not pay the beginning of the search, or it cannot take so many parameters.
    InsufficientDataError
        Nothing that was tried has a finite cost.
    """
    name = wanted_search(settings)
    if name is None or not problem.parameters.free:
        return None
    from rotorid.search.catalog import search

    budget = settings.evaluations or (EVALUATIONS if settings.search else _WITHOUT_LIMIT)

    def say(at: Progress) -> None:
        counted = {"done": at.evaluations, "total": budget} if settings.search else {}
        _PROGRESS.info(f"searching by {name}: {at.evaluations} evaluations, best cost {at.best:.4g}", extra=counted)

    shorter, chosen = problem.shortened(_SEARCHED), search(name)
    result = chosen.run(shorter, budget=budget, seed=settings.seed, progress=say)
    runs = None
    if settings.runs is not None:
        from rotorid.search.spread import Repeated, spread_over_starts

        free = problem.parameters.free
        with pool(settings.workers) as workers:
            runs = spread_over_starts(
                workers.shared(_OfParameters(Repeated(chosen, shorter, budget), len(free))),
                names=free,
                units=[problem.parameters[parameter].unit for parameter in free],
                runs=settings.runs,
                seed=settings.seed,
                executor=workers.executor,
                progress=_counted,
            )
    return Searched(
        name=name,
        cost=problem.method,
        parameters=problem.parameters,
        result=result,
        runs=runs,
        points=_shared_points(shorter) if result.exchanges else (),
    )


@dataclass(frozen=True)
class _OfParameters:
    """A repeated search without the unknowns other than parameters, such as initial states."""

    repeated: Callable[[int], SearchResult]
    count: int

    def __call__(self, seed: int) -> SearchResult:
        found = self.repeated(seed)
        return replace(
            found, theta=found.theta[: self.count], best=replace(found.best, theta=found.best.theta[: self.count])
        )


def _counted(done: int, runs: int) -> None:
    _PROGRESS.info(f"searching from {runs} seeds: {done} done", extra={"done": done, "total": runs})


def wanted_search(settings: IdentifySettings) -> str | None:
    """The search that was asked for, ``None`` for none."""
    if settings.search is not None:
        return settings.search
    return None if settings.starts == "default" else settings.starts


def refuse_search(settings: IdentifySettings, what: str, remedy: str) -> None:
    """Refuse a search where there is nothing to search.

    Parameters
    ----------
    what
        What takes no search, for the message.
    remedy
        What to do instead.

    Raises
    ------
    UsageError
        One was asked for.
    """
    if wanted_search(settings) is not None:
        option = "--search" if settings.search is not None else "--starts"
        raise UsageError(f"{option} does not work with {what}", remedy=remedy)


def search_summary(found: Searched | None) -> SearchSummary | None:
    """A search with all of its minima."""
    if found is None:
        return None
    result = found.result
    return SearchSummary(
        name=found.name,
        objective=found.objective,
        evaluations=result.evaluations,
        polishing=result.polishing,
        local_searches=result.local_searches,
        minima=tuple(
            SearchMinimum(cost=basin.cost, share=basin.share, parameters=found.values(basin)) for basin in found.minima
        ),
        trace=tuple((at.evaluations, at.best) for at in result.trace if math.isfinite(at.best)),
        alone=Minimum(cost=result.cost, parameters=found.values(Basin(result.cost, result.theta, 0.0))),
        runs=None if found.runs is None else _runs(found.runs),
        iterations=tuple(_iteration(found, exchange) for exchange in result.exchanges),
        points=found.points,
    )


def _iteration(found: Searched, exchange: Exchange) -> ClusterIteration:
    free = found.parameters.free
    return ClusterIteration(
        evaluations=exchange.evaluations,
        clusters=tuple(
            Cluster(
                cost=float(cost) if math.isfinite(cost) else None,
                points=int(np.count_nonzero(exchange.owners == number)),
                parameters=dict(zip(free, map(float, theta[: len(free)]), strict=True)),
            )
            for number, (theta, cost) in enumerate(zip(exchange.thetas, exchange.costs, strict=True))
        ),
        owners=tuple(map(int, exchange.owners)),
    )


def _shared_points(problem: Problem) -> tuple[SharedPoint, ...]:
    """The points of measured responses, in the order of the problem's; none of a problem in time."""
    if not isinstance(problem, FrequencyProblem):
        return ()
    data, points = problem.data, problem.points
    return tuple(
        SharedPoint(response=f"{data.outputs[y]}/{data.inputs[u]}", omega_rad_s=float(omega))
        for y, u, omega in zip(points.output, points.input, points.omega_rad_s[points.frequency], strict=True)
    )


def _runs(found: SearchSpread) -> SearchRuns:
    return SearchRuns(
        runs=found.after.runs,
        seed=found.after.seed,
        left_out=dict(found.after.left_out),
        alone=_run_table(found.before, found.costs_before),
        polished=_run_table(found.after, found.costs_after),
    )


def _run_table(table: SpreadTable, costs: FloatArray) -> RunTable:
    columns = dict(zip(table.names, table.draws.T, strict=True))
    return RunTable(
        cost=_spread(costs),
        parameters={name: _spread(column) for name, column in columns.items()},
        costs=tuple(costs.tolist()),
        draws={name: tuple(column.tolist()) for name, column in columns.items()},
    )


def _spread(values: FloatArray) -> RunSpread:
    low, high = float(values.min()), float(values.max())
    return RunSpread(mean=float(values.mean()), std=float(values.std(ddof=1)), min=low, max=high)


def searched_minima(found: Searched | None) -> tuple[Minimum, ...]:
    """Other minima than the one that the fit went on from."""
    others = found.minima[1:] if found else ()
    return tuple(Minimum(cost=basin.cost, parameters=found.values(basin)) for basin in others if found)


def judge_minima(found: Searched | None, parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Other minima of a search that are nearly as good and have clearly other parameters.

    Parameters
    ----------
    parameters
        The identified values.
    bounds
        Their uncertainty: clearly other is what lies more than three standard deviations and a tenth away, from the
        identified values and from the lowest minimum.

    Returns
    -------
    tuple of Finding
        ``other_minimum`` where there is one whose cost is at most a tenth above the lowest, on the best of them.
    """
    if found is None:
        return ()
    std = bounds.stds
    lowest, *others = found.minima
    known = (found.values(lowest), parameters.values)
    limit = (1.0 + NEARLY_AS_GOOD) * lowest.cost
    near = [basin for basin in others if basin.cost <= limit or same_cost(basin.cost, lowest.cost)]
    clear = [(basin, moved) for basin in near if (moved := _moved(found.values(basin), known, std))]
    return (_other_minimum(found, lowest, *clear[0], more=len(clear) - 1),) if clear else ()


def _moved(
    values: Mapping[str, float], known: Sequence[Mapping[str, float]], std: Mapping[str, float]
) -> dict[str, float]:
    """Parameters that are clearly others there, the farthest first, with their values.

    A minimum whose parameters are those of the lowest one or those of the result is no other model: between these two
    lie other weights and the parameters that were dropped.
    """
    away: dict[str, float] = {}
    for name in std.keys() & values.keys():
        size = max(abs(values[name]), *(abs(values[name]) for values in known))
        distance = min(abs(values[name] - item[name]) for item in known)
        if distance > max(_FAR_SIGMAS * std[name], _FAR * size):
            away[name] = distance / size
    return {name: values[name] for name in sorted(away, key=lambda name: (-away[name], name))}


def _other_minimum(found: Searched, lowest: Basin, basin: Basin, moved: dict[str, float], *, more: int) -> Finding:
    same = same_cost(basin.cost, lowest.cost)
    named = ", ".join(f"{name} = {value:.4g}" for name, value in list(moved.items())[:_NAMED])
    how_good = "the same cost" if same else f"a cost only {100.0 * (basin.cost / lowest.cost - 1.0):.1f} % higher"
    others = (
        f"; {more} more {'is' if more == 1 else 'are'} at most {100.0 * NEARLY_AS_GOOD:.0f} % higher" if more else ""
    )
    ending = (
        "The data cannot separate the two, as when two poles swap; the one closest to the initial values was used."
        if same
        else "Only other data can show which is true: fix known parameters, widen the band, or verify both on an "
        "unseen flight."
    )
    return warn(
        "other_minimum",
        next(iter(moved)),
        f"The search by {found.name} found a second minimum with {how_good}, at {named}{others}. {ending}",
        **{"cost": basin.cost, "lowest_cost": lowest.cost, "share": basin.share, "more": more, **moved},
    )
