"""The best of several searches, and the other minima that they met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.solution import Minimum, Outcome, Solution

_SAME_COST = 1e-6
_SAME_PLACE = 1e-3


def best_of(found: Sequence[Solution], *, name: str) -> Solution:
    """The lowest of several solutions of one problem; the other minima are kept in its ``others``.

    Of minima with one cost the first counts.

    Parameters
    ----------
    found
        Solutions, in the order of their starts; those without a finite cost do not count.
    name
        What was fitted, for the message.

    Raises
    ------
    InsufficientDataError
        None has a finite cost.
    """
    finite = [one for one in found if np.isfinite(one.cost)]
    if not finite:
        raise InsufficientDataError(
            f"{name} has no response at any start",
            needed="parameters with which it has one at every point of the data",
            remedy="give other start values",
        )
    lowest = min(one.cost for one in finite)
    best = next(one for one in finite if same_cost(one.cost, lowest))
    others = _others(best, finite)
    return replace(best, others=others) if others else best


def same_cost(one: float, other: float) -> bool:
    """Whether two costs differ by no more than the tolerance of a search."""
    return abs(one - other) <= _SAME_COST * (1.0 + min(one, other))


def same_place(one: Solution, other: Solution) -> bool:
    """Whether two searches ended in one place, as far as the residuals can tell."""
    with np.errstate(over="ignore", invalid="ignore"):  # places too far apart to measure are not the same
        moved = float(np.sum((one.jacobian @ (one.theta - other.theta)) ** 2))
    return same_cost(one.cost, other.cost) and moved <= _SAME_PLACE**2 * (1.0 + one.cost)


def _others(best: Solution, found: Sequence[Solution]) -> tuple[Minimum, ...]:
    """Minima other than the best, each once, best first."""
    kept = [best]
    for solution in sorted(found, key=lambda one: one.cost):
        if solution.outcome is Outcome.CONVERGED and not any(same_place(one, solution) for one in kept):
            kept.append(solution)
    return tuple(Minimum(one.cost, one.theta) for one in kept[1:])
