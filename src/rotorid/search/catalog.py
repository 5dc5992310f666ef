"""The searches that there are, by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from functools import partial
from typing import Protocol

from rotorid.errors import unknown_name
from rotorid.fitting.problem import Problem
from rotorid.search.cma import cma_from_text
from rotorid.search.kmeans import kmeans_from_text
from rotorid.search.multistart import multistart_from_text
from rotorid.search.population import evolution_from_text, genetic_from_text
from rotorid.search.result import Report, SearchResult


class Search(Protocol):
    """A global search as a value: what it is and its options, without what it is used on."""

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        ...

    def run(
        self,
        problem: Problem,
        *,
        budget: int,
        seed: int,
        executor: Executor | None = None,
        progress: Report | None = None,
    ) -> SearchResult:
        """Search for the lowest minimum.

        Parameters
        ----------
        problem
            What is minimized; its ``search_box`` says where.
        budget
            Evaluations that may be spent. A population spends them on costs, and ends in a few local searches beyond;
            a search that is made of local searches spends them on these, and finishes the last.
        seed
            Of all that is random. The same seed gives the same result on any number of workers.
        executor
            Workers; none for the calling thread alone.
        progress
            Called after each generation, or each local search.

        Raises
        ------
        UsageError
            The budget does not pay the beginning.
        InsufficientDataError
            Nothing that was tried has a finite cost.
        """
        ...


_SEARCHES: Mapping[str, Callable[[str], Search]] = {
    "central": partial(multistart_from_text, "central"),
    "cma": cma_from_text,
    "evolution": evolution_from_text,
    "genetic": genetic_from_text,
    "kmeans": kmeans_from_text,
    "random": partial(multistart_from_text, "random"),
    "sobol": partial(multistart_from_text, "sobol"),
}
"""Constructors of the searches from the text of their options."""


POPULATIONS = ("cma", "evolution", "genetic")
"""Searches that spend their budget on costs, and end in local searches beyond it."""


def searches() -> tuple[str, ...]:
    """Names of all searches, sorted.

    Examples
    --------
    >>> searches()
    ('central', 'cma', 'evolution', 'genetic', 'kmeans', 'random', 'sobol')
    """
    return tuple(sorted(_SEARCHES))


def search(text: str) -> Search:
    """A search by its name, with options after a colon: ``sobol``, ``sobol:64``, ``kmeans:5``, ``genetic:15x50``.

    Parameters
    ----------
    text
        One of :func:`searches`, with the options documented in its file.

    Raises
    ------
    UsageError
        There is no such search, or it has no such options.

    Examples
    --------
    >>> search("genetic:15x50")
    Genetic(population=15, generations=50, crossover=0.8, mutation=1.0)
    """
    name, _, options = text.partition(":")
    names = searches()
    if name not in names:
        raise unknown_name("search", name, names)
    return _SEARCHES[name](options)
