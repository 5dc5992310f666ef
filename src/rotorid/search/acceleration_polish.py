r"""The local search of :class:`rotorid.search.acceleration.AccelerationProblem`, in closed form where there is one.

With the lag of the motors held, what they carry is known, :math:`x_c`, and each acceleration has a gain :math:`g_c`:

.. math:: f = \sum_c w_c \sum_k |a_c(k) - g_c x_c(k)|

is convex in each gain, and least at the weighted median of :math:`a_c/x_c` with the weights :math:`|x_c|`; for squares
at :math:`\sum a_c x_c / \sum x_c^2`. The logarithms of the gains are sums of those of the parameters, so the nearest
parameters with these gains are one linear solution away, or a few where bounds are in the way. Where there are none,
because some are held, bounded or tied, or where the lag is free, steps of least squares lead down.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.solution import Outcome, Solution
from rotorid.search.acceleration_sums import ErrorSum, absolute_sum, squared_sum
from rotorid.search.design_of_starts import StartBox
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


def error_sums(problem: AccelerationProblem, points: FloatArray | None) -> tuple[ErrorSum, ...]:
    """Sum of errors of each acceleration by its gain, where the lag is held."""
    total = squared_sum if problem.error == "squared" else absolute_sum
    carried = problem.carried(problem.parameters.pack())
    return tuple(total(a, x, points) for a, x in zip(problem.made, carried, strict=True))


def _closed_form(problem: AccelerationProblem, theta: FloatArray, points: FloatArray | None) -> FloatArray | None:
    """The parameters with the best gains that are nearest to a start, relatively; ``None`` where there are none."""
    if problem.free_powers is None:
        return None
    sums = problem.sums if points is None else error_sums(problem, points)
    ratios = np.array([one.best for one in sums]) / problem.gains(theta)[0]
    if not np.all(np.isfinite(ratios) & (ratios > 0.0)):
        return None
    return _moved(theta, problem.free_powers, np.log(ratios), problem.box)


def _moved(theta: FloatArray, powers: FloatArray, wanted: FloatArray, box: StartBox) -> FloatArray | None:
    """Parameters within their bounds whose products of powers have moved by ``wanted``, in logarithms.

    Those that would leave the box stay at the bound that they meet, and the others make up for them.
    """
    with np.errstate(divide="ignore"):
        low, high = np.log(np.maximum(np.sort([box.lower / theta, box.upper / theta], axis=0), 0.0))
    steps, free = np.zeros(theta.size), np.ones(theta.size, dtype=np.bool_)
    while free.any():
        steps[free] = np.linalg.pinv(powers[:, free]) @ (wanted - powers[:, ~free] @ steps[~free])
        over = free & ~((steps >= low) & (steps <= high))
        if not over.any():
            break
        steps, free = np.clip(steps, low, high), free & ~over
    if np.abs(powers @ steps - wanted).max() > _REACHED:
        return None
    reached = np.clip(theta * np.exp(steps), box.lower, box.upper)
    met = np.where(reached - box.lower < box.upper - reached, box.lower, box.upper)
    return np.where(free, reached, met)


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
            corner = rounded * self.mean_errors(self.errors(theta))

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
        errors = self.errors(theta)
        jacobian = self.derivatives(theta, errors, _ROUNDED[-1] * self.mean_errors(errors))
        residual = self.sharp_residual(errors)
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
        errors = self.errors(theta)
        # Rounding off leaves e^2 / (smooth + corner), the square of what stands here.
        factor = self.root / np.sqrt(np.sqrt(errors**2 + corner**2) + corner) if self.absolute else self.root
        return (factor * errors).ravel(), self.derivatives(theta, errors, corner)

    def derivatives(self, theta: FloatArray, errors: FloatArray, corner: FloatArray) -> FloatArray:
        """Derivatives of the residuals, ``(4 n, p)``."""
        steep = self.root
        if self.absolute:
            smooth = np.sqrt(errors**2 + corner**2)
            steep = 0.5 * self.root * np.sqrt(smooth + corner) / smooth
        return -(steep * self.problem.slopes(theta)).reshape(len(theta), -1).T

    def mean_errors(self, errors: FloatArray) -> FloatArray:
        """Mean absolute error of each channel over samples that count, shape ``(4, 1)``; never zero."""
        counted = np.maximum(np.sum(self.scales, axis=1), np.finfo(np.float64).tiny)
        mean = np.sum(self.scales * np.abs(errors), axis=1) / counted
        size = np.abs(self.problem.made).mean(axis=1)
        return np.asarray(np.maximum(mean, _FINEST * size)[:, None])

    def sharp(self, found: Solution) -> Solution:
        """A solution of rounded corners with the cost and the residuals of the sharp ones."""
        residual = self.sharp_residual(self.errors(found.theta))
        return replace(found, residual=residual, cost=float(residual @ residual))

    def sharp_residual(self, errors: FloatArray) -> FloatArray:
        """Residuals whose squares add up to the cost, shape ``(4 n,)``."""
        if not self.absolute:
            return (self.root * errors).ravel()
        return (np.sign(errors) * np.sqrt(self.scales * np.abs(errors))).ravel()
