"""Nonlinear least squares: Levenberg–Marquardt with bounds, for small problems with an exact Jacobian.

A solution says where a solver ended, how, and how it came there. Of several searches the lowest minimum counts, and the
others that they met are kept beside it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.typing import BoolArray, FloatArray

_UNTOLD = 0.05
"""Part of a standard deviation by which two solutions are the same."""


class Outcome(Enum):
    """How a solver ended. The values are sentences."""

    CONVERGED = "The cost no longer falls and the parameters no longer move."
    STALLED = "No step lowers the cost any more, although the gradient is not zero."
    OUT_OF_ITERATIONS = "The allowed number of iterations was used up before the parameters settled."


class Minimum(NamedTuple):
    """End point of a local search.

    Parameters
    ----------
    cost
        Sum of squared residuals there.
    theta
        Free parameters, shape ``(p,)``.
    """

    cost: float
    theta: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Immutable):
    """End of a fit.

    Parameters
    ----------
    theta
        Free parameters, shape ``(p,)``.
    cost
        Sum of squared residuals.
    outcome
        How it ended.
    residual, jacobian
        At ``theta``, shapes ``(n,)`` and ``(n, p)``.
    evaluations
        How often residuals and Jacobian were computed.
    trace
        Cost after each accepted step.
    at_bound
        Which parameters ended on a bound, shape ``(p,)``.
    others
        Other minima that the search met, best first.
    """

    theta: FloatArray
    cost: float
    outcome: Outcome
    residual: FloatArray
    jacobian: FloatArray
    evaluations: int
    trace: tuple[float, ...]
    at_bound: tuple[bool, ...]
    others: tuple[Minimum, ...] = ()

    @property
    def settled(self) -> bool:
        r"""Whether it is at a minimum, or nearer to one than residuals can tell.

        A search that was stopped on a flat floor counts, if one more undamped step would move no combination of
        parameters by a twentieth of its deviation: :math:`|J \delta|^2 < 0.05^2 |r|^2 / n`.
        """
        if self.outcome is Outcome.CONVERGED:
            return True
        slopes = self.jacobian[:, ~np.array(self.at_bound, dtype=np.bool_)]
        step = np.linalg.lstsq(slopes, self.residual, rcond=None)[0]
        return bool(np.sum((slopes @ step) ** 2) < _UNTOLD**2 * self.cost / self.residual.size)

    def __post_init__(self) -> None:
        self._set(
            theta=read_only(self.theta, np.float64, ndim=1),
            residual=read_only(self.residual, np.float64, ndim=1),
            jacobian=read_only(self.jacobian, np.float64, ndim=2),
            others=tuple(Minimum(cost, read_only(theta, np.float64, ndim=1)) for cost, theta in self.others),
        )


Residuals: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_PROGRESS = logging.getLogger("rotorid.progress")
LARGEST_DAMPING = 1e14
_NO_DOUBT = 1e-6
"""Of a cost: two ways to sum it up differ by less."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LevenbergMarquardt:
    r"""Damped Gauss–Newton steps :math:`(J^T J + \lambda \, \mathrm{diag} J^T J) \, \delta = -J^T r`.

    Marquardt's scaling makes the path independent of the units of the parameters. Parameters on a bound whose gradient
    points outward are held there for the step; steps are clipped to the box.

    Parameters
    ----------
    iterations
        Steps that may be tried.
    tolerance
        Relative change of cost, or of every parameter against its scale, that counts as rest.
    """

    iterations: int = 200
    tolerance: float = 1e-10

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a step too far gives a cost that is no number
    def minimize(
        self,
        residuals: Residuals,
        start: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
        *,
        cost_alone: Callable[[FloatArray], float] | None = None,
    ) -> Solution:
        """Minimize the sum of squares from ``start`` inside the box ``lower`` to ``upper``, each shape ``(p,)``.

        Parameters
        ----------
        residuals
            Residuals and Jacobian.
        start, lower, upper
            Free parameters and their bounds.
        cost_alone
            The sum of squares where it comes cheaper than with its derivatives: a step that it finds worse beyond
            doubt is turned back without them. The search takes the same path with or without.
        """
        theta = np.clip(start, lower, upper)
        residual, jacobian = residuals(theta)
        cost = float(residual @ residual)
        trace, damping, outcome = [cost], 1e-3, Outcome.OUT_OF_ITERATIONS
        evaluations = 1
        if not _usable(cost, jacobian):
            return Solution(
                theta=theta,
                cost=np.inf,
                outcome=Outcome.STALLED,
                residual=residual,
                jacobian=jacobian,
                evaluations=evaluations,
                trace=(np.inf,),
                at_bound=_at_bound(theta, lower, upper),
            )
        for _ in range(self.iterations):
            gradient, normal = jacobian.T @ residual, jacobian.T @ jacobian
            # Column lengths of the Jacobian: gradients over them, and steps times them, have the unit of the residuals.
            scale = np.sqrt(np.maximum(normal.diagonal(), 1e-300))
            at_bound = ((theta <= lower) & (gradient > 0.0)) | ((theta >= upper) & (gradient < 0.0))
            slope = float(np.abs(gradient / scale)[~at_bound].max(initial=0.0))
            if slope <= 1e-14 * (1.0 + np.sqrt(cost)):
                outcome = Outcome.CONVERGED
                break
            trial = np.minimum(np.maximum(theta + _step(normal, gradient, damping, ~at_bound), lower), upper)
            step = trial - theta
            promised = -float(step @ (2.0 * gradient + normal @ step))
            if damping <= 1e-2 and 0.0 <= promised <= self.tolerance * (1e-6 + cost):
                # A step that would be the last: it is not worth the evaluation.
                outcome = Outcome.CONVERGED
                break
            evaluations += 1
            new_cost = np.inf
            if cost_alone is None or cost_alone(trial) <= cost * (1.0 + _NO_DOUBT):
                new_residual, new_jacobian = residuals(trial)
                new_cost = float(new_residual @ new_residual)
            if new_cost < cost and _usable(new_cost, new_jacobian):
                small_step = np.abs(step * scale).max() <= self.tolerance * np.sqrt(1.0 + cost)
                small_gain = cost - new_cost <= self.tolerance * (1e-6 + cost) and damping <= 1e-2
                theta, residual, jacobian, cost = trial, new_residual, new_jacobian, new_cost
                trace.append(cost)
                _PROGRESS.debug("a step of a fit", extra={"cost": cost})
                damping = max(damping / 9.0, 1e-12)
                if small_step or small_gain:
                    outcome = Outcome.CONVERGED
                    break
            else:
                damping *= 6.0
                if damping > LARGEST_DAMPING or np.abs(step * scale).max() <= 1e-13 * np.sqrt(1.0 + cost):
                    # Rounding of the cost hides a slope of 1e-8 of the residual; a steeper one should have led down.
                    outcome = Outcome.CONVERGED if slope <= 1e-6 * np.sqrt(1e-6 + cost) else Outcome.STALLED
                    break
        return Solution(
            theta=theta,
            cost=cost,
            outcome=outcome,
            residual=residual,
            jacobian=jacobian,
            evaluations=evaluations,
            trace=tuple(trace),
            at_bound=_at_bound(theta, lower, upper),
        )


def _usable(cost: float, jacobian: FloatArray) -> bool:
    """Whether sums of squares are numbers: no pole lies on a point, and nothing has grown beyond all measure."""
    return bool(np.isfinite(cost) and np.isfinite(np.sum(jacobian**2)))


def _at_bound(theta: FloatArray, lower: FloatArray, upper: FloatArray) -> tuple[bool, ...]:
    return tuple(bool(flag) for flag in (theta <= lower) | (theta >= upper))


def _step(normal: FloatArray, gradient: FloatArray, damping: float, moving: BoolArray) -> FloatArray:
    # A parameter without any effect has no scale of its own, and its step is zero whatever it is given.
    diagonal = normal.diagonal()
    diagonal = np.where(diagonal > 0.0, diagonal, 1.0)
    system = normal.copy()
    system.flat[:: len(system) + 1] += damping * diagonal
    scale = np.sqrt(system.diagonal())
    system /= np.outer(scale, scale)
    if moving.all():
        return np.asarray(-np.linalg.solve(system, gradient / scale) / scale)
    step = np.zeros_like(gradient)
    chosen = system[np.ix_(moving, moving)]
    step[moving] = -np.linalg.solve(chosen, gradient[moving] / scale[moving]) / scale[moving]
    return step


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
    finite = [solution for solution in found if np.isfinite(solution.cost)]
    if not finite:
        raise InsufficientDataError(
            f"{name} has no response at any start",
            needed="parameters with a finite response at every point of the data",
            remedy="use other start values",
        )
    lowest = min(solution.cost for solution in finite)
    best = next(solution for solution in finite if same_cost(solution.cost, lowest))
    others = _others(best, finite)
    return replace(best, others=others) if others else best


def same_cost(one: float, other: float) -> bool:
    """Whether two costs differ by no more than the tolerance of a search."""
    return abs(one - other) <= _SAME_COST * (1.0 + min(one, other))


def same_place(solution: Solution, other: Solution) -> bool:
    """Whether two searches ended in one place, judged by the residuals."""
    with np.errstate(over="ignore", invalid="ignore"):  # places too far apart to measure are not the same
        moved = float(np.sum((solution.jacobian @ (solution.theta - other.theta)) ** 2))
    return same_cost(solution.cost, other.cost) and moved <= _SAME_PLACE**2 * (1.0 + solution.cost)


def _others(best: Solution, found: Sequence[Solution]) -> tuple[Minimum, ...]:
    """Minima other than the best, each once, best first."""
    kept = [best]
    for solution in sorted(found, key=lambda solution: solution.cost):
        if solution.outcome is Outcome.CONVERGED and not any(same_place(item, solution) for item in kept):
            kept.append(solution)
    return tuple(Minimum(solution.cost, solution.theta) for solution in kept[1:])
