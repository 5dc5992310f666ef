"""Populations: differential evolution with restarts, and the genetic algorithm of the literature on quadrotors.

Differential evolution is the search to take when in doubt; the genetic one is here to reproduce what was published.
Both spend their budget on costs, and end in local searches from the few vectors that are worth one.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.fitting.problem import Problem, StartBox
from rotorid.search.result import (
    Evaluations,
    Report,
    SearchResult,
    end,
    require_budget,
    whole_number,
    worth_polishing,
)
from rotorid.search.starts import sobol
from rotorid.typing import FloatArray, IntArray

POLISHED = 8
"""Local searches at the end of a population: the best vector, and the most promising elsewhere."""

EARLY, RESERVED = 100, 4
"""Half of them are kept for places among the vectors that were tried before a population settles anywhere."""


def end_of_population(
    search: str, seed: int, evaluations: Evaluations, shares: FloatArray, costs: FloatArray
) -> SearchResult:
    """Local searches from the few vectors of a population that are worth one.

    Parameters
    ----------
    search, seed
        For the result.
    evaluations
        Those of the search.
    shares, costs
        Everything it tried, in its order, in the unit cube of the box, shapes ``(n, p)`` and ``(n,)``.

    Raises
    ------
    InsufficientDataError
        Nothing that was tried has a finite cost.
    """
    chosen = worth_polishing(shares, costs, count=POLISHED, early=EARLY, reserved=RESERVED)
    starts = evaluations.box.at(shares[chosen])
    return end(search, seed, evaluations, list(evaluations.polished(starts)))


_AT_REST = 1e-6
_FEWEST_GENERATIONS = 20
_FEWEST = 5
_WORST = 1e100
"""Finite substitute for an infinite cost, of which no mean can be formed."""


@dataclass(frozen=True, kw_only=True)
class Evolution:
    r"""Differential evolution in the unit cube of the box, with restarts until the budget is spent.

    Every vector is challenged by the best one, moved by the difference of two others,

    .. math:: v = x_{best} + F (x_a - x_b), \qquad F \in (0.5, 1)

    of which each parameter is taken with a probability of 0.7, and replaced where that is better. The differences
    shrink with the population, so that steps find their own length in every direction. The population begins at Sobol
    points. Once all its costs are alike it starts anew, twice as large, which sees more of the box.

    Parameters with a meaning of their own mostly have valleys along their axes, and there this finds the lowest basin
    with fewer evaluations than a strategy that learns to turn (:mod:`rotorid.search.cma`). That one is better
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
    >>> evolution_from_text("30")
    Evolution(population=30)
    """

    population: int = 15

    def __post_init__(self) -> None:
        if self.population < _FEWEST:
            raise UsageError(f"a population of {self.population} is too small", needed=f"{_FEWEST} or more")

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "evolution"

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
        require_budget(budget, self.population)
        rng = np.random.default_rng(seed)
        evaluations = Evaluations(problem, executor=executor, progress=progress)
        tried: list[FloatArray] = []
        met: list[FloatArray] = []

        def costs(shares: FloatArray) -> FloatArray:
            tried.append(shares.T.copy())
            met.append(evaluations.costs(evaluations.box.at(shares.T)))
            evaluations.mark()
            return np.minimum(met[-1], _WORST)

        population = self.population
        while (left := (budget - evaluations.count) // population) > 0:
            _evolve(costs, population, evaluations.box.lower.size, generations=left, rng=rng)
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


def evolution_from_text(options: str) -> Evolution:
    """``evolution``, or ``evolution:30`` with the population at first."""
    return Evolution(population=whole_number(options, of="evolution", needed="evolution:30") if options else 15)


_OPTIONS = "genetic:15 or genetic:15x50"


@dataclass(frozen=True, kw_only=True)
class Genetic:
    r"""Roulette on the inverse of the cost, single-point crossover, uniform mutation, one elite.

    Every generation draws its parents with probabilities :math:`1/J_i / \sum_j 1/J_j`. Two parents exchange all genes
    behind a random place. Then one random gene of the offspring is drawn anew, evenly over its side of the box, by its
    logarithm where the side is logarithmic. All offspring are evaluated, and the best vector so far takes the place of
    the worst of them, so that 15 individuals and 50 generations are 750 evaluations.

    The paper leaves open how often parents cross and offspring mutate, and how many elites there are. Here parents
    cross with a probability of 0.8, the middle of what is usual for this crossover. It makes no new values of genes,
    and a roulette on the inverse of costs that are nearly alike hardly selects, so mutation is all that improves a
    single number: every offspring has one gene drawn anew, which is the paper's sentence to the letter, and the usual
    rate of one over the number of genes. Fewer mutants end higher on accelerations of five parameters. One elite is the
    least that preserves the best chromosome.

    It is here to reproduce what was published. Mutation over whole sides does not refine: its last digits come from the
    local search. :mod:`rotorid.search.population` is better at the same evaluations.

    Parameters
    ----------
    population
        Individuals.
    generations
        With the first, drawn evenly over the box; none for as many as the budget pays.
    crossover
        Probability that two parents exchange genes.
    mutation
        Probability that one gene of an offspring is drawn anew.

    Raises
    ------
    UsageError
        There are fewer than two individuals, or a probability is none.

    References
    ----------
    *System parameter identification of quadrotor drones with a real-coded genetic algorithm*: 15 individuals,
    50 generations, the sum of absolute errors of accelerations.

    Examples
    --------
    >>> genetic_from_text("15x50")
    Genetic(population=15, generations=50, crossover=0.8, mutation=1.0)
    """

    population: int = 15
    generations: int | None = None
    crossover: float = 0.8
    mutation: float = 1.0

    def __post_init__(self) -> None:
        if self.population < 2:
            raise UsageError(f"a population of {self.population} is too small", needed="two or more")
        if not (0.0 <= self.crossover <= 1.0 and 0.0 <= self.mutation <= 1.0):
            raise UsageError(
                f"invalid probabilities {self.crossover:g} of crossover and {self.mutation:g} of mutation",
                needed="numbers from zero to one",
            )

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "genetic"

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
        require_budget(budget, self.population)
        rng = np.random.default_rng(seed)
        evaluations = Evaluations(problem, executor=executor, progress=progress)
        generations = min(self.generations or budget, budget // self.population)
        size = (generations, self.population, evaluations.box.lower.size)
        tried, met = np.empty(size), np.empty(size[:2])
        shares, costs = rng.random(size[1:]), np.full(self.population, np.inf)
        for generation in range(generations):
            elite = int(np.argmin(costs))
            offspring = self._offspring(shares, costs, rng) if generation else shares
            tried[generation], met[generation] = offspring, evaluations.costs(evaluations.box.at(offspring))
            evaluations.mark()
            worst = int(np.argmax(met[generation]))
            best, lowest = shares[elite].copy(), costs[elite]
            shares, costs = offspring, met[generation].copy()
            if lowest < costs[worst]:
                shares[worst], costs[worst] = best, lowest
        return end_of_population(self.name, seed, evaluations, tried.reshape(-1, size[2]), met.ravel())

    def _offspring(self, shares: FloatArray, costs: FloatArray, rng: np.random.Generator) -> FloatArray:
        count, genes = shares.shape
        pairs = (count + 1) // 2
        parents = shares[_roulette(costs, 2 * pairs, rng)]
        first, second = parents[:pairs], parents[pairs:]
        # A place that no gene is behind leaves the parents as they are.
        place = np.where(rng.random(pairs) < self.crossover, rng.integers(1, max(genes, 2), size=pairs), genes)
        exchanged = np.arange(genes) >= place[:, None]
        offspring = np.concatenate([np.where(exchanged, second, first), np.where(exchanged, first, second)])[:count]
        mutants = np.flatnonzero(rng.random(count) < self.mutation)
        offspring[mutants, rng.integers(genes, size=mutants.size)] = rng.random(mutants.size)
        return offspring


def _roulette(costs: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Individuals drawn with probabilities that are inverse to their costs."""
    lowest = costs.min()
    if not np.isfinite(lowest):
        return rng.integers(len(costs), size=count)
    slots = np.cumsum(np.where(costs > lowest, lowest / np.where(costs > 0.0, costs, 1.0), 1.0))
    return np.asarray(np.searchsorted(slots, slots[-1] * rng.random(count), side="right"))


def genetic_from_text(options: str) -> Genetic:
    """``genetic``, ``genetic:15`` with the population, or ``genetic:15x50`` with the generations too."""
    population, _, generations = options.partition("x")
    return Genetic(
        population=whole_number(population, of="genetic", needed=_OPTIONS) if options else 15,
        generations=whole_number(generations, of="genetic", needed=_OPTIONS) if "x" in options else None,
    )
