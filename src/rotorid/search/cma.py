"""Evolution strategy with covariance matrix adaptation and restarts."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.errors import UsageError
from rotorid.fitting.problem import Problem
from rotorid.search.population import end_of_population
from rotorid.search.result import Evaluations, Report, SearchResult, require_budget, whole_number
from rotorid.typing import FloatArray

_STEP = 0.3
_AT_REST = 1e-6
_FEWEST_GENERATIONS = 20
_WORST = 1e300
"""Finite substitute for an infinite cost, of which the strategy cannot form differences."""


@dataclass(frozen=True, kw_only=True)
class CovarianceAdaptation:
    r"""CMA-ES in the unit cube of the box, with restarts until the budget is spent.

    A cloud of vectors moves, stretches and turns along the valleys of the cost; it needs only the order of the costs,
    so that neither scales nor kinks nor places without a value disturb it. It begins about the center of the box.
    Whenever it comes to rest it starts anew somewhere else: in turns with a population twice as large as any before,
    which sees the whole box, and with a small one in a small part of it, whichever has spent less (BIPOP). Steps over a
    face of the box are reflected.

    It is the best search where a valley runs across many parameters and the local search is no help. With a few hundred
    evaluations, or many basins, :mod:`rotorid.search.population` finds the lowest more often.

    Parameters
    ----------
    population
        Vectors in a generation at first; none for :math:`4 + 3 \ln p`.

    Raises
    ------
    UsageError
        There are fewer than four vectors.

    References
    ----------
    N. Hansen, *The CMA evolution strategy: a tutorial*, arXiv:1604.00772, 2016; N. Hansen, *Benchmarking a
    BI-population CMA-ES*, GECCO 2009. The strategy itself is that of the package ``cmaes``.

    Examples
    --------
    >>> cma_from_text("16")
    CovarianceAdaptation(population=16)
    """

    population: int | None = None

    def __post_init__(self) -> None:
        if self.population is not None and self.population < 4:
            raise UsageError(f"a population of {self.population} is too small", needed="four or more")

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "cma"

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
        size = problem.search_box.lower.size
        first = self.population or 4 + int(3.0 * np.log(size))
        require_budget(budget, first)
        rng = np.random.default_rng(seed)
        evaluations = Evaluations(problem, executor=executor, progress=progress)
        tried: list[FloatArray] = []
        met: list[FloatArray] = []
        run, largest, spent = _Run(first, _STEP, np.full(size, 0.5)), first, {"large": 0, "small": 0}
        while evaluations.count + run.population <= budget:
            before = evaluations.count
            _descend(run, evaluations, budget, rng, tried, met)
            spent["large" if run.population == largest else "small"] += evaluations.count - before
            pays = 2 * largest * _FEWEST_GENERATIONS <= budget - evaluations.count
            if pays and spent["large"] <= spent["small"]:
                largest *= 2
                run = _Run(largest, _STEP, rng.random(size))
            else:
                run = _small_run(first, largest, rng, size)
        return end_of_population(self.name, seed, evaluations, np.concatenate(tried), np.concatenate(met))


class _Run(NamedTuple):
    """One descent: how many, how far, from where in the unit cube."""

    population: int
    step: float
    mean: FloatArray


def _small_run(first: int, largest: int, rng: np.random.Generator, size: int) -> _Run:
    """A population between the first and half the largest, with a step of up to a hundredth of the usual one."""
    population = int(first * max(0.5 * largest / first, 1.0) ** (rng.random() ** 2))
    return _Run(population, _STEP * 10.0 ** (-2.0 * rng.random()), rng.random(size))


def _descend(
    run: _Run,
    evaluations: Evaluations,
    budget: int,
    rng: np.random.Generator,
    tried: list[FloatArray],
    met: list[FloatArray],
) -> None:
    """Generations until the costs converge, or the budget is spent."""
    try:
        import cmaes
    except ImportError:
        raise UsageError(
            "the search cma needs the package cmaes",
            remedy="pip install 'rotorid[search]', or use the search evolution",
        ) from None

    strategy = cmaes.CMA(mean=run.mean, sigma=run.step, population_size=run.population, seed=int(rng.integers(2**31)))
    history = 10 + int(np.ceil(30 * run.mean.size / run.population))
    lowest: list[float] = []
    while evaluations.count + run.population <= budget:
        steps = [strategy.ask() for _ in range(run.population)]
        shares = _folded(np.array(steps))
        costs = evaluations.costs(evaluations.box.at(shares))
        strategy.tell(list(zip(steps, np.minimum(costs, _WORST).tolist(), strict=True)))
        evaluations.mark()
        tried.append(shares)
        met.append(costs)
        lowest.append(min(float(costs.min()), _WORST))
        recent = lowest[-history:]
        at_rest = len(lowest) >= history and max(recent) - min(recent) <= _AT_REST * min(recent)
        if at_rest or strategy.should_stop():
            return


def _folded(steps: FloatArray) -> FloatArray:
    """Steps beyond a face of the unit cube, reflected into it."""
    return 1.0 - np.abs(1.0 - np.mod(steps, 2.0))


def cma_from_text(options: str) -> CovarianceAdaptation:
    """``cma``, or ``cma:16`` with the population at first."""
    return CovarianceAdaptation(population=whole_number(options, of="cma", needed="cma:16") if options else None)
