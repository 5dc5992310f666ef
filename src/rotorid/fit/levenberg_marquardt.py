"""Levenberg–Marquardt with bounds, for small problems with an exact Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rotorid.fit.solution import Outcome, Solution
from rotorid.typing import BoolArray, FloatArray

Residuals: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

LARGEST_DAMPING = 1e14


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
    def minimize(self, residuals: Residuals, start: FloatArray, lower: FloatArray, upper: FloatArray) -> Solution:
        """Minimize the sum of squares from ``start`` inside the box ``lower`` to ``upper``, each shape ``(p,)``."""
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
            held = ((theta <= lower) & (gradient > 0.0)) | ((theta >= upper) & (gradient < 0.0))
            slope = float(np.abs(gradient / scale)[~held].max(initial=0.0))
            if slope <= 1e-14 * (1.0 + np.sqrt(cost)):
                outcome = Outcome.CONVERGED
                break
            trial = np.minimum(np.maximum(theta + _step(normal, gradient, damping, ~held), lower), upper)
            step = trial - theta
            promised = -float(step @ (2.0 * gradient + normal @ step))
            if damping <= 1e-2 and 0.0 <= promised <= self.tolerance * (1e-6 + cost):
                # A step that would be the last: it is not worth the evaluation.
                outcome = Outcome.CONVERGED
                break
            new_residual, new_jacobian = residuals(trial)
            evaluations += 1
            new_cost = float(new_residual @ new_residual)
            if new_cost < cost and _usable(new_cost, new_jacobian):
                small_step = np.abs(step * scale).max() <= self.tolerance * np.sqrt(1.0 + cost)
                small_gain = cost - new_cost <= self.tolerance * (1e-6 + cost) and damping <= 1e-2
                theta, residual, jacobian, cost = trial, new_residual, new_jacobian, new_cost
                trace.append(cost)
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
