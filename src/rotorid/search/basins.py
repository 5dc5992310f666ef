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


def worth_polishing(shares: FloatArray, costs: FloatArray, *, count: int) -> IntArray:
    """Which of many tried vectors to begin local searches at: low, and far from anything lower.

    A lowest vector stands for all that lie close to it. Of these places, the best comes first, then those whose nearest
    better place is farthest: the foot of another valley has nothing better near, a slope of the same valley has.

    Parameters
    ----------
    shares
        Where they lie in the unit cube of the box, shape ``(n, p)``.
    costs
        Shape ``(n,)``; those with an infinite cost are left out.
    count
        How many at most.

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
    order = np.argsort(costs, kind="stable")
    left = order[np.isfinite(costs[order])]
    places: list[int] = []
    while left.size and len(places) < _MOST_PLACES:
        places.append(int(left[0]))
        left = left[_distance(shares[left], shares[left[0]]) > _ONE_PLACE]
    spots = shares[places]
    to_better = [float(_distance(spots[:k], spots[k]).min(initial=np.inf)) for k in range(len(places))]
    chosen = np.argsort(-np.array(to_better), kind="stable")[:count]
    return np.asarray(places, dtype=np.int64)[np.sort(chosen)]


def _distance(many: FloatArray, one: FloatArray) -> FloatArray:
    """Root mean square over the sides, so that one limit serves any number of parameters."""
    moved = many - one
    return np.asarray(np.sqrt(np.einsum("np,np->n", moved, moved) / one.size))
