"""Of many local searches the distinct minima, and of many tried vectors those worth a local search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.fit.minima import best_of, same_place
from rotorid.fit.solution import Outcome, Solution
from rotorid.search.result import Basin
from rotorid.typing import FloatArray, IntArray

_MOST_PLACES = 32
_ONE_PLACE = 0.1


def basins(found: Sequence[Solution], *, name: str) -> tuple[Solution, tuple[Basin, ...]]:
    """The best of many local searches, and every minimum that they ended in, lowest first.

    Two ends are one minimum when their costs agree and the residuals cannot tell the places apart. Searches that came
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
    rested = [one for one in found if np.isfinite(one.cost) and one.outcome is Outcome.CONVERGED]
    if best.outcome is not Outcome.CONVERGED:
        rested.append(best)
    places: list[Solution] = [best]
    counts = [0]
    for one in sorted(rested, key=lambda one: one.cost):
        place = next((k for k, other in enumerate(places) if same_place(other, one)), len(places))
        if place == len(places):
            places.append(one)
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
    for one in (*_by_promise(shares[:early], costs[:early]), *of_all):
        # What lies beside a place that was chosen would lead to where that one leads.
        if len(chosen) < count and (_distance(shares[chosen].T, shares[one]) > _ONE_PLACE).all():
            chosen.append(one)
    return np.array(sorted(chosen, key=lambda one: (costs[one], one)), dtype=np.int64)


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
        taken |= _distance(by_side, rising[lowest]) <= _ONE_PLACE
        places.append(lowest)
    return [int(order[places[k]]) for k in np.argsort(-np.array(to_better), kind="stable")]


def _distance(many: FloatArray, one: FloatArray) -> FloatArray:
    """From vectors ``(p, n)`` to one, root mean square over the sides: one limit serves any number of parameters."""
    return np.asarray(np.sqrt(((many - one[:, None]) ** 2).sum(axis=0) / one.size))
