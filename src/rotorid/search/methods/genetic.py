"""The real-coded genetic algorithm of the literature on quadrotors, as published."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.search.ending import end_of_population
from rotorid.search.evaluate import Evaluations, Report
from rotorid.search.objective import Objective
from rotorid.search.options import require_budget, whole_number
from rotorid.search.result import SearchResult
from rotorid.typing import FloatArray, IntArray

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
    local search. :mod:`rotorid.search.methods.evolution` is better at the same evaluations.

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
    >>> from_text("15x50")
    Genetic(population=15, generations=50, crossover=0.8, mutation=1.0)
    """

    population: int = 15
    generations: int | None = None
    crossover: float = 0.8
    mutation: float = 1.0

    def __post_init__(self) -> None:
        if self.population < 2:
            raise UsageError(f"a population of {self.population} came", needed="two or more")
        if not (0.0 <= self.crossover <= 1.0 and 0.0 <= self.mutation <= 1.0):
            raise UsageError(
                f"the probabilities {self.crossover:g} of crossover and {self.mutation:g} of mutation came",
                needed="numbers from zero to one",
            )

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "genetic"

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
        generations = min(self.generations or budget, budget // self.population)
        size = (generations, self.population, objective.box.lower.size)
        tried, met = np.empty(size), np.empty(size[:2])
        shares, costs = rng.random(size[1:]), np.full(self.population, np.inf)
        for generation in range(generations):
            elite = int(np.argmin(costs))
            offspring = self._offspring(shares, costs, rng) if generation else shares
            tried[generation], met[generation] = offspring, evaluations.costs(objective.box.at(offspring))
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


def from_text(options: str) -> Genetic:
    """``genetic``, ``genetic:15`` with the population, or ``genetic:15x50`` with the generations too."""
    population, _, generations = options.partition("x")
    return Genetic(
        population=whole_number(population, of="genetic", needed=_OPTIONS) if options else 15,
        generations=whole_number(generations, of="genetic", needed=_OPTIONS) if "x" in options else None,
    )
