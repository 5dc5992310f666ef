"""Differential evolution with restarts: the search to take when in doubt."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.search.design_of_starts import StartBox, sobol
from rotorid.search.ending import end_of_population
from rotorid.search.evaluate import Evaluations, Report
from rotorid.search.objective import Objective
from rotorid.search.options import require_budget, whole_number
from rotorid.search.result import SearchResult
from rotorid.typing import FloatArray

_AT_REST = 1e-6
_FEWEST_GENERATIONS = 20
_FEWEST = 5
_WORST = 1e100
"""Stands for an infinite cost, of which no mean can be formed."""


@dataclass(frozen=True, kw_only=True)
class Evolution:
    r"""Differential evolution in the unit cube of the box, with restarts until the budget is spent.

    Every vector is challenged by the best one, moved by the difference of two others,

    .. math:: v = x_{best} + F (x_a - x_b), \qquad F \in (0.5, 1)

    of which each parameter is taken with a probability of 0.7, and replaced where that is better. The differences
    shrink with the population, so that steps find their own length in every direction. The population begins at Sobol
    points. Once all its costs are alike it starts anew, twice as large, which sees more of the box.

    Parameters with a meaning of their own mostly have valleys along their axes, and there this finds the lowest basin
    with fewer evaluations than a strategy that learns to turn (:mod:`rotorid.search.methods.cma`). That one is better
    in long valleys that run across many parameters, when there is no good local search.

    Parameters
    ----------
    population
        Vectors in a generation at first.

    Raises
    ------
    UsageError
        There are fewer than five vectors.

    References
    ----------
    R. Storn and K. Price, *Differential evolution: a simple and efficient heuristic for global optimization over
    continuous spaces*, Journal of Global Optimization 11, 1997. The algorithm itself is that of SciPy.

    Examples
    --------
    >>> from_text("30")
    Evolution(population=30)
    """

    population: int = 15

    def __post_init__(self) -> None:
        if self.population < _FEWEST:
            raise UsageError(f"a population of {self.population} came", needed=f"{_FEWEST} or more")

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "evolution"

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
        require_budget(budget, self.population)
        rng = np.random.default_rng(seed)
        evaluations = Evaluations(objective, executor=executor, progress=progress)
        tried: list[FloatArray] = []
        met: list[FloatArray] = []

        def costs(shares: FloatArray) -> FloatArray:
            tried.append(shares.T.copy())
            met.append(evaluations.costs(objective.box.at(shares.T)))
            evaluations.mark()
            return np.minimum(met[-1], _WORST)

        population = self.population
        while (left := (budget - evaluations.count) // population) > 0:
            _evolve(costs, population, objective.box.lower.size, generations=left, rng=rng)
            if 2 * population * _FEWEST_GENERATIONS <= budget - evaluations.count:
                population *= 2
        return end_of_population(self.name, seed, evaluations, np.concatenate(tried), np.concatenate(met))


@np.errstate(over="ignore", invalid="ignore")
def _evolve(
    costs: Callable[[FloatArray], FloatArray], population: int, size: int, *, generations: int, rng: np.random.Generator
) -> None:
    """Generations until all costs of a population are alike."""
    from scipy.optimize import Bounds, differential_evolution

    cube = StartBox(lower=np.zeros(size), upper=np.ones(size), scales=tuple("linear" for _ in range(size)))
    first = sobol(cube, population, rng=rng)
    if generations == 1:
        costs(first.T)
        return
    differential_evolution(
        costs,  # type: ignore[arg-type]  # the stubs know no function of many vectors
        Bounds(np.zeros(size), np.ones(size)),
        init=first,
        maxiter=generations - 1,
        tol=_AT_REST,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )


def from_text(options: str) -> Evolution:
    """``evolution``, or ``evolution:30`` with the population at first."""
    return Evolution(population=whole_number(options, of="evolution", needed="evolution:30") if options else 15)
