"""K-means pattern search: candidates share the points of the data, each learns from those that it explains best."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Problem
from rotorid.search.multistart import most_starts
from rotorid.search.result import Evaluations, Exchange, Report, SearchResult, end, require_budget, whole_number
from rotorid.search.starts import sobol
from rotorid.typing import FloatArray, IntArray

_MOST_EXCHANGES = 10
_DEAREST = 12
"""Largest cost of an exchange per candidate."""
_OPTIONS = "kmeans:5 or kmeans:5:100"


@dataclass(frozen=True, kw_only=True)
class KMeans:
    r"""K-means clustering of the points of the data about the responses of k candidates.

    1. k Sobol points of the box; their responses are the centers.
    2. Every point goes to the candidate j whose response is nearest to it, in the distance of the cost itself,
       :math:`W_\gamma [W_g (\Delta |T|_{dB})^2 + W_p (\Delta \angle T_{deg})^2]`.
    3. Every candidate is fitted to its own points by a few steps of its local search.
    4. Again from 2 until no point changes its candidate.
    5. Every candidate is fitted to all points; their minima are kept.

    With a limit of the cost, a candidate that falls below it ends the exchanges, as in the paper, and its local search
    ends the whole. Otherwise it begins again with the next Sobol points until the budget is spent.

    The paper leaves three things open. It averages the responses of a cluster, and does not say how parameters follow
    from a mean response: here the parameters are fitted to the points of the cluster, which is the same wherever the
    model can take on that mean, and still a model where it cannot. It assigns a point where magnitude *and* phase are
    nearer, which leaves out all points where these disagree: here the one distance decides that the cost weighs them
    with. It says nothing of candidates that lose their points: one with fewer points than parameters, which these could
    not determine, is fitted to all points.

    An exchange costs one evaluation and up to eleven residuals for every candidate, as much as half a local search; it
    is left out where the budget does not pay it. In return a candidate that fits a part of the band is drawn into it,
    where the cost of the whole would lead it astray. At small budgets that may be worth it on frequency responses: with
    100 evaluations, on five problems with a delay that wraps the phase, with two lightly damped modes, of an unstable
    hover model and of lags over decades, it found the lowest minimum in 69 of 100 runs, Sobol starts in 56, which is
    1.9 standard errors. At 1000 evaluations nothing is left of the difference (``python -m benchmarks.searches``).

    On the rig that it was published for it gains nothing: with the paper's unknowns every local search ends in the one
    minimum, so that exchanges only come on top; with two bending modes it is as good as Sobol starts, and with delays
    searched up to 3 s it found the lowest less often (0.80 to 0.85 against 1.0 of 20 seeds,
    ``python -m benchmarks.kmeans``). On samples in time it does harm (0.70 against 1.0 with 300 evaluations).

    Plain multi-start (:mod:`rotorid.search.multistart`) is better where any start leads to the lowest minimum, as
    exchanges then come on top; with many workers, of which this occupies k at a time; for samples in time, where the
    end of a record says little of its beginning; and for the shares of the basins, which candidates that have learned
    from each other distort.

    Parameters
    ----------
    candidates
        k; the paper used three to five.
    acceptable
        Cost with which the search ends; none to spend the whole budget. The paper stops at an average of 100 for a
        response, which is a cost of 100 times the number of responses.

    Raises
    ------
    UsageError
        The limit is not positive, or there is no candidate.

    References
    ----------
    *Improved frequency-domain identification of quadrotor drones with composite windows and K-means clustering*:
    cluster centers, assignment of points, convergence, J_ave of 100.

    Examples
    --------
    >>> kmeans_from_text("5:100")
    KMeans(candidates=5, acceptable=100.0)
    """

    candidates: int = 3
    acceptable: float | None = None

    def __post_init__(self) -> None:
        if self.candidates < 1 or not (self.acceptable is None or self.acceptable > 0.0):
            raise UsageError(
                f"invalid {self.candidates} candidates with an acceptable cost of {self.acceptable}",
                needed="positive numbers",
            )

    @property
    def name(self) -> str:
        """Its name in the catalog."""
        return "kmeans"

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
        require_budget(budget, 1)
        evaluations = Evaluations(problem, executor=executor, progress=progress)
        found: list[Solution] = []
        exchanges: list[Exchange] = []
        lowest = np.inf
        for starts in self._rounds(problem, budget, seed):
            thetas, shared = self._settled(evaluations, starts, budget, lowest)
            exchanges = exchanges or shared
            for solution in evaluations.polished(thetas):
                found.append(solution)
                lowest = min(lowest, solution.cost)
                evaluations.mark(min(lowest, evaluations.best))
                if evaluations.spent >= budget or self._accepts(lowest):
                    break
            if evaluations.spent >= budget or self._accepts(lowest):
                break
        return end(self.name, seed, evaluations, found, exchanges)

    def _accepts(self, cost: float) -> bool:
        return self.acceptable is not None and cost <= self.acceptable

    def _rounds(self, problem: Problem, budget: int, seed: int) -> Iterator[FloatArray]:
        """Start vectors of one round after the other, as many as the budget can pay."""
        count = self.candidates * (1 + most_starts(budget) // self.candidates)
        points = sobol(problem.search_box, count, rng=np.random.default_rng(seed))
        return iter(points.reshape(-1, self.candidates, points.shape[1]))

    def _settled(
        self, evaluations: Evaluations, thetas: FloatArray, budget: int, lowest: float
    ) -> tuple[FloatArray, list[Exchange]]:
        """The candidates after they have exchanged points until none moves, or the budget is spent; the best first.

        With them who owned which point at each iteration.
        """
        shared: list[Exchange] = []
        distances = evaluations.point_costs(thetas)
        evaluations.mark(min(lowest, evaluations.best))
        owner: IntArray | None = None
        for _ in range(_MOST_EXCHANGES):
            nearest = np.argmin(distances, axis=0)
            shared.append(
                Exchange(evaluations=evaluations.spent, thetas=thetas, costs=distances.sum(axis=1), owners=nearest)
            )
            at_rest = owner is not None and np.array_equal(nearest, owner)
            if at_rest or self._accepts(evaluations.best) or evaluations.spent + _DEAREST * len(thetas) > budget:
                break
            owner = nearest
            weights = np.array([nearest == index for index in range(len(thetas))], dtype=np.float64)
            weights[weights.sum(axis=1) < thetas.shape[1]] = 1.0
            thetas = np.array([solution.theta for solution in evaluations.polished_points(thetas, weights)])
            distances = evaluations.point_costs(thetas)
            evaluations.mark(min(lowest, evaluations.best))
        return thetas[np.argsort(distances.sum(axis=1), kind="stable")], shared


def kmeans_from_text(options: str) -> KMeans:
    """``kmeans``, ``kmeans:5`` with the candidates, or ``kmeans:5:100`` with the acceptable cost too."""
    candidates, _, acceptable = options.partition(":")
    return KMeans(
        candidates=whole_number(candidates, of="kmeans", needed=_OPTIONS) if options else 3,
        acceptable=float(whole_number(acceptable, of="kmeans", needed=_OPTIONS)) if ":" in options else None,
    )
