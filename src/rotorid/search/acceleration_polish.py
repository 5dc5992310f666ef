r"""The local search of :class:`rotorid.search.acceleration.AccelerationProblem`, in closed form where there is one.

With the lag of the motors held, what they carry is known, :math:`x_c`, and each acceleration has a gain :math:`g_c`:

.. math:: f = \sum_c w_c \sum_k |a_c(k) - g_c x_c(k)|

is convex in each gain, and least at the weighted median of :math:`a_c/x_c` with the weights :math:`|x_c|`; for squares
at :math:`\sum a_c x_c / \sum x_c^2`. The logarithms of the gains are sums of those of the parameters, so the nearest
parameters with these gains are one linear solution away. Where there are none, because some are held, bounded or tied,
or where the lag is free, steps of least squares lead down.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.solution import Outcome, Solution
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.search.acceleration import AccelerationProblem

# Corners of absolute values are rounded off over these parts of the mean error, one after the other.
_ROUNDED = (1.0, 0.1, 0.01)
_FINEST = 1e-9
_REACHED = 1e-9


def polished(problem: AccelerationProblem, start: FloatArray, points: FloatArray | None) -> Solution:
    r"""Local search from a start ``(p,)``; never ends above it.

    Absolute errors have corners. Where there is no closed form they are rounded off,
    :math:`|e| \to \sqrt{e^2 + \epsilon^2} - \epsilon`, first over the size of the mean error and in the end over a
    hundredth of it.

    Parameters
    ----------
    problem
        Data and parameters.
    start
        It is brought into the bounds.
    points
        Weights of the samples, shape ``(n,)``; one each by default.
    """
    weights = np.ones(problem.tilt.size) if points is None else points
    cost = _Cost(problem, problem.channel_weights[:, None] * weights)
    theta = np.clip(start, problem.box.lower, problem.box.upper)
    reached = _closed_form(problem, theta, points)
    return cost.descend(theta) if reached is None else cost.solution(reached, began=cost.sum(theta))


def best_gains(problem: AccelerationProblem, points: FloatArray | None) -> FloatArray:
    """The gain of each acceleration that alone has the least cost, where the lag is held; shape ``(4,)``."""
    carried = problem.carried(problem.parameters.pack())
    weights = np.ones(problem.tilt.size) if points is None else points
    if problem.error == "squared":
        return np.asarray(np.sum(weights * problem.made * carried, axis=1) / np.sum(weights * carried**2, axis=1))
    return np.array([_median(a, x, weights) for a, x in zip(problem.made, carried, strict=True)])


def _median(made: FloatArray, carried: FloatArray, weights: FloatArray) -> float:
    """The factor on ``carried`` with the least sum of absolute errors."""
    moved = carried != 0.0
    ratios = made[moved] / carried[moved]
    order = np.argsort(ratios, kind="stable")
    passed = np.cumsum((weights[moved] * np.abs(carried[moved]))[order])
    return float(ratios[order[np.searchsorted(passed, 0.5 * passed[-1])]]) if passed.size else np.nan


def _closed_form(problem: AccelerationProblem, theta: FloatArray, points: FloatArray | None) -> FloatArray | None:
    """The parameters with the best gains that are nearest to a start, relatively; ``None`` where there are none."""
    if problem.free_powers is None:
        return None
    wanted = problem.best_gains if points is None else best_gains(problem, points)
    ratios = wanted / problem.gains(theta)[0]
    if not np.all(np.isfinite(ratios) & (ratios > 0.0)):
        return None
    steps = np.linalg.pinv(problem.free_powers) @ np.log(ratios)
    reached = theta * np.exp(steps)
    inside = np.all((reached >= problem.box.lower) & (reached <= problem.box.upper))
    missed = np.abs(problem.free_powers @ steps - np.log(ratios)).max()
    return reached if inside and missed <= _REACHED else None


class _Cost:
    """Errors and derivatives as residuals; ``scales`` ``(4, n)`` weigh each error."""

    def __init__(self, problem: AccelerationProblem, scales: FloatArray) -> None:
        self.problem, self.scales, self.root = problem, scales, np.sqrt(scales)
        self.absolute = problem.error == "absolute"

    def descend(self, theta: FloatArray) -> Solution:
        """Steps of least squares, with ever sharper corners."""
        lower, upper = self.problem.box.lower, self.problem.box.upper
        best = self.solution(theta, began=self.sum(theta))
        evaluations, trace = 0, [best.cost]
        for rounded in _ROUNDED if self.absolute else (0.0,):
            corner = rounded * self.mean_errors(theta)

            def residuals(at: FloatArray, corner: FloatArray = corner) -> tuple[FloatArray, FloatArray]:
                return self.residuals(at, corner)

            found = self.sharp(LevenbergMarquardt().minimize(residuals, theta, lower, upper))
            evaluations += found.evaluations
            # Rounded corners may lead up, by as much as they take off.
            if found.cost <= best.cost:
                best, theta = found, found.theta
                trace.append(found.cost)
        return replace(best, evaluations=evaluations, trace=tuple(trace))

    def solution(self, theta: FloatArray, *, began: float) -> Solution:
        """A solution at a place that is known to be one."""
        jacobian = self.residuals(theta, _ROUNDED[-1] * self.mean_errors(theta))[1]
        residual = self.sharp_residual(theta)
        lower, upper = self.problem.box.lower, self.problem.box.upper
        cost = float(residual @ residual)
        return Solution(
            theta=theta,
            cost=cost,
            outcome=Outcome.CONVERGED,
            residual=residual,
            jacobian=jacobian,
            evaluations=1,
            trace=(began, cost),
            at_bound=tuple(((theta <= lower) | (theta >= upper)).tolist()),
        )

    def sum(self, theta: FloatArray) -> float:
        """The cost."""
        errors = self.errors(theta)
        return float(np.sum(self.scales * (np.abs(errors) if self.absolute else errors**2)))

    def errors(self, theta: FloatArray) -> FloatArray:
        """Measured less modeled, shape ``(4, n)``."""
        errors: FloatArray = self.problem.made - self.problem.gains(theta)[0][:, None] * self.problem.carried(theta)
        return errors

    def residuals(self, theta: FloatArray, corner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(4 n,)`` whose squares add up to the cost with rounded corners, and derivatives ``(4 n, p)``."""
        errors, slopes = self.errors(theta), self.problem.slopes(theta)
        factor, steep = self.root, self.root
        if self.absolute:
            smooth = np.sqrt(errors**2 + corner**2)
            # Rounding off leaves e^2 / (smooth + corner), the square of what stands here.
            factor = self.root / np.sqrt(smooth + corner)
            steep = 0.5 * self.root * np.sqrt(smooth + corner) / smooth
        return (factor * errors).ravel(), -(steep * slopes).reshape(len(theta), -1).T

    def mean_errors(self, theta: FloatArray) -> FloatArray:
        """Mean absolute error of each channel over samples that count, shape ``(4, 1)``; never zero."""
        counted = np.maximum(np.sum(self.scales, axis=1), np.finfo(np.float64).tiny)
        mean = np.sum(self.scales * np.abs(self.errors(theta)), axis=1) / counted
        size = np.abs(self.problem.made).mean(axis=1)
        return np.asarray(np.maximum(mean, _FINEST * size)[:, None])

    def sharp(self, found: Solution) -> Solution:
        """A solution of rounded corners with the cost and the residuals of the sharp ones."""
        residual = self.sharp_residual(found.theta)
        return replace(found, residual=residual, cost=float(residual @ residual))

    def sharp_residual(self, theta: FloatArray) -> FloatArray:
        """Residuals whose squares add up to the cost, shape ``(4 n,)``."""
        errors = self.errors(theta)
        if not self.absolute:
            return (self.root * errors).ravel()
        return (np.sign(errors) * np.sqrt(self.scales * np.abs(errors))).ravel()
