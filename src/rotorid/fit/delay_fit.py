"""The search for a delay: on a grid first, because phases wrap, then all parameters at once, then along the profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError
from rotorid.fit.delay_model import LateLag, Order
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.solution import Solution
from rotorid.typing import ComplexArray, FloatArray

_GRID = 31
_VALLEYS = 3
_POLISHED = 2
_SCOUT, _POLISH = LevenbergMarquardt(iterations=60, tolerance=1e-6), LevenbergMarquardt(iterations=60, tolerance=1e-9)
_CHI_SQUARED_95 = 3.841
_PROFILE_STEPS = 12
_PROFILE_ACCURACY = 0.02
NORMAL_95 = 1.96
_NEGLIGIBLE, NO_EVIDENCE = 0.02, 6.0
"""An order is worth its parameters only where it lowers the misfit by more than this share of it, and the criterion by
more than what counts as strong evidence (Kass and Raftery, *Bayes Factors*, 1995)."""


class DelayProblem(Protocol):
    """What a late lag is fitted to: records or a frequency response."""

    @property
    def model(self) -> LateLag: ...

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations, ``(n,)``, and derivatives, ``(n, p)``."""

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost."""

    def thinned(self) -> DelayProblem:
        """The same with fewer points, for the search."""


@dataclass(frozen=True, kw_only=True)
class Limits(Immutable):
    """Where a delay is looked for.

    Parameters
    ----------
    delays_s
        Least and largest delay.
    fastest_rad_s
        How fast the fastest unstable pole may grow; zero where the response is known to be stable.
    """

    delays_s: tuple[float, float]
    fastest_rad_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderFit(Immutable):
    """A late lag of one order, fitted.

    Parameters
    ----------
    order
        Zeros and poles.
    count
        Real numbers that were fitted.
    solution
        Where the search ended; the delay is the last parameter.
    criterion
        Cost plus the logarithm of the number of data for each parameter; the least is best.
    poles_rad_s
        Shape ``(n,)``.
    """

    order: Order
    count: int
    solution: Solution
    criterion: float
    poles_rad_s: ComplexArray

    @property
    def delay_s(self) -> float:
        return float(self.solution.theta[-1])

    @property
    def std_s(self) -> float:
        """Standard deviation of the delay from the curvature of the cost, all other parameters free."""
        jacobian = self.solution.jacobian
        # The share of the delay's column that no other parameter can take over.
        others = np.linalg.qr(jacobian[:, :-1] / _lengths(jacobian[:, :-1]))[0]
        own = jacobian[:, -1] - others @ (others.T @ jacobian[:, -1])
        length = float(np.linalg.norm(own))
        return self.misfit / length if length > 0.0 else np.inf

    @property
    def misfit(self) -> float:
        """Standard deviation of the residuals in units of what was expected of them."""
        free = max(self.count - self.solution.theta.size, 1)
        return float(np.sqrt(self.solution.cost / free))


def fit_order(problem: DelayProblem, limits: Limits, *, start: FloatArray | None = None) -> OrderFit:
    """Fit one order: from a start, or from the valleys of the cost on a grid of delays.

    Raises
    ------
    InsufficientDataError
        No delay gives a finite cost.
    """
    lower, upper = problem.model.box(limits.fastest_rad_s, limits.delays_s)
    starts = [start] if start is not None else _starts(problem, limits, lower, upper)
    ends = [_POLISH.minimize(problem.residuals, one, lower, upper) for one in starts]
    ends = [end for end in ends if np.isfinite(end.cost)]
    if not ends:
        raise InsufficientDataError(
            f"no delay from {1e3 * limits.delays_s[0]:.4g} to {1e3 * limits.delays_s[1]:.4g} ms fits a model of "
            f"{problem.model.order.words}",
            needed="an input that moves the output",
        )
    best = min(ends, key=lambda end: end.cost)
    return OrderFit(
        order=problem.model.order,
        count=problem.count,
        solution=best,
        criterion=best.cost + (problem.model.order.coefficients + 1) * float(np.log(problem.count)),
        poles_rad_s=problem.model.poles_rad_s(best.theta),
    )


def _starts(problem: DelayProblem, limits: Limits, lower: FloatArray, upper: FloatArray) -> list[FloatArray]:
    """The best places that a search on some of the points finds, best first."""
    thin = problem.thinned()
    found = [thin.linear(float(delay_s), limits.fastest_rad_s) for delay_s in np.linspace(*limits.delays_s, _GRID)]
    cost = np.array([one for _, one in found])
    padded = np.concatenate([[np.inf], cost, [np.inf]])
    valleys = np.flatnonzero((cost <= padded[:-2]) & (cost <= padded[2:]) & np.isfinite(cost))
    lowest = valleys[np.argsort(cost[valleys])][:_VALLEYS]
    scouts = [_SCOUT.minimize(thin.residuals, found[index][0], lower, upper) for index in lowest]
    return [one.theta for one in sorted(scouts, key=lambda one: one.cost)[:_POLISHED]]


def simplest(fits: Sequence[OrderFit]) -> OrderFit:
    """The fit with the fewest parameters whose criterion is no worse than the best by more than what is negligible."""
    best = min(fits, key=lambda fit: fit.criterion)
    limit = best.criterion + max(_NEGLIGIBLE * best.solution.cost, NO_EVIDENCE)
    good = [fit for fit in fits if fit.criterion <= limit]
    return min(good, key=lambda fit: (fit.order.coefficients, fit.criterion))


def interval_s(problem: DelayProblem, fit: OrderFit, limits: Limits) -> tuple[float, float]:
    r"""Interval of 95 % for the delay by the profile of the cost.

    The delays whose least cost over all other parameters exceeds the minimum by no more than :math:`3.84\,s^2`, with
    the variance :math:`s^2` of the residuals. It ends at a limit where the profile stays below.
    """
    low, high = (_crossing(problem, fit, limits, side) for side in (-1.0, 1.0))
    return low, high


def _crossing(problem: DelayProblem, fit: OrderFit, limits: Limits, side: float) -> float:
    lower, upper = problem.model.box(limits.fastest_rad_s, limits.delays_s)
    allowed = _CHI_SQUARED_95 * fit.misfit**2
    end = limits.delays_s[1] if side > 0.0 else limits.delays_s[0]
    reach = abs(end - fit.delay_s)

    def excess(distance: float, start: FloatArray) -> tuple[float, FloatArray]:
        theta = start.copy()
        theta[-1] = fit.delay_s + side * distance
        bounds = lower.copy(), upper.copy()
        bounds[0][-1] = bounds[1][-1] = theta[-1]
        held = _SCOUT.minimize(problem.residuals, theta, *bounds)
        return held.cost - fit.solution.cost, held.theta

    # The square root of the excess grows in proportion to the distance where the cost is a parabola.
    inner, theta = 0.0, np.array(fit.solution.theta)
    trial, outer = min(NORMAL_95 * fit.std_s, reach), reach
    for _ in range(_PROFILE_STEPS):
        value, found = excess(trial, theta)
        ratio = float(np.sqrt(max(value, 0.0) / allowed))
        if abs(ratio - 1.0) <= _PROFILE_ACCURACY:
            break
        if ratio < 1.0:
            if trial >= reach:
                return end
            inner, theta = trial, found
        else:
            outer = trial
        guess = trial / ratio if ratio > 0.0 else 2.0 * trial
        trial = guess if inner < guess < outer else (min(2.0 * trial, reach) if outer == reach else (inner + outer) / 2)
    return fit.delay_s + side * trial


def _lengths(columns: FloatArray) -> FloatArray:
    length = np.sqrt(np.sum(columns**2, axis=0))
    return np.where(length > 0.0, length, 1.0)
