"""CIFER's cost of frequency responses as an objective of a search.

The output error of simulations as an objective of a search.

An objective of every problem that the package can fit by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.time.nonlinear import NonlinearProblem
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.search.starts import Scale, StartBox, search_box
from rotorid.typing import FloatArray

_SOLVER = LevenbergMarquardt()
_FEW_STEPS = LevenbergMarquardt(iterations=10, tolerance=1e-6)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyObjective(Immutable):
    """The weighted cost of a :class:`rotorid.fitting.frequency.problem.FrequencyProblem`.

    A point is magnitude and phase at one frequency of one response, in the order of the residuals of the problem.

    Parameters
    ----------
    problem
        Structure, data, points.
    box
        Where to search for the free parameters.
    """

    at_once: ClassVar[int] = 4

    problem: FrequencyProblem
    box: StartBox

    @property
    def name(self) -> str:
        """Name of the structure."""
        return self.problem.structure.name

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Sums of the squared residuals; infinite where the model has a pole at a point."""
        return self.problem.many_costs(thetas)

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Squared error of magnitude and phase at every point, weighted as in the cost."""
        residual = self.problem.many_residuals(thetas)[0]
        magnitude, phase = np.split(residual, 2, axis=-1)
        squares = magnitude**2 + phase**2
        return np.where(np.isfinite(squares), squares, np.inf)

    def polish(self, start: FloatArray) -> Solution:
        """Levenberg and Marquardt, with exact derivatives, within the bounds of the parameters."""
        return _SOLVER.minimize(self.problem.residuals, start, *self.problem.box)

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """A few such steps with weights of the points."""
        root = np.tile(np.sqrt(points), 2)

        def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = self.problem.residuals(theta)
            return root * residual, root[:, None] * jacobian

        return _FEW_STEPS.minimize(residuals, start, *self.problem.box)


OutputErrorProblem: TypeAlias = TimeProblem | NonlinearProblem


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeObjective(Immutable):
    """The whitened output error of a problem in time, with its covariance as it stands.

    A point is one sample with all outputs, one record after the other. A simulation that diverges, and parameters
    outside their bounds, have an infinite cost. Costs need no derivatives and are simulated without.

    Parameters
    ----------
    problem
        Linear or nonlinear structure with records.
    box
        Where to search for a vector of the problem; for a nonlinear one it has sides for starts and shifts too.
    """

    at_once: ClassVar[int] = 4

    problem: OutputErrorProblem
    box: StartBox

    @property
    def name(self) -> str:
        """Name of the structure."""
        return self.problem.structure.name

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Sums of squared whitened errors; infinite where a simulation diverges."""
        return np.asarray(self.point_costs(thetas).sum(axis=1))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # most of a wide box may diverge
    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Squared whitened errors of every sample, summed over the outputs."""
        squares = np.stack([self._squares(theta) for theta in thetas])
        return np.where(np.isfinite(squares), squares, np.inf)

    def _squares(self, theta: FloatArray) -> FloatArray:
        try:
            fitted = self.problem.predicted(theta)
        except ModelError:
            return np.full(self.problem.samples, np.inf)
        errors = [self.problem.whitening @ (one.record.outputs - one.predicted) for one in fitted]
        return np.concatenate([np.sum(error**2, axis=0) for error in errors])

    def polish(self, start: FloatArray) -> Solution:
        """Levenberg and Marquardt, with exact sensitivities, within the bounds of the parameters."""
        return _SOLVER.minimize(self.problem.residuals, start, *self.problem.box)

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """A few such steps with weights of the samples."""
        root = np.repeat(np.sqrt(points), len(self.problem.structure.outputs))

        def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = self.problem.residuals(theta)
            return root * residual, root[:, None] * jacobian

        return _FEW_STEPS.minimize(residuals, start, *self.problem.box)


SearchableProblem: TypeAlias = FrequencyProblem | TimeProblem | NonlinearProblem

_ABOUT_START = 0.1
_LEAST_START = 1e-3


def objective_of(problem: SearchableProblem, *, box: StartBox | None = None) -> FrequencyObjective | TimeObjective:
    """What a search minimizes to fit a problem.

    Parameters
    ----------
    problem
        In the frequency domain or in time.
    box
        Where to search; by default :func:`rotorid.search.starts.search_box` of the parameters. Initial states and
        shifts of a nonlinear problem are searched close to what was measured, and left to the local search otherwise.

    Returns
    -------
    FrequencyObjective or TimeObjective
        The same cost that the problem's own fit minimizes.
    """
    if isinstance(problem, FrequencyProblem):
        return FrequencyObjective(problem=problem, box=box or search_box(problem.parameters))
    if box is None:
        box = search_box(problem.parameters)
        if isinstance(problem, NonlinearProblem):
            box = _with_nuisances(box, problem)
    return TimeObjective(problem=problem, box=box)


def _with_nuisances(box: StartBox, problem: NonlinearProblem) -> StartBox:
    count = len(box.scales)
    about = problem.start[count:]
    reach = _ABOUT_START * np.maximum(np.abs(about), _LEAST_START)
    linear: tuple[Scale, ...] = tuple("linear" for _ in about)
    return StartBox(
        lower=np.concatenate([box.lower, about - reach]),
        upper=np.concatenate([box.upper, about + reach]),
        scales=box.scales + linear,
    )
