"""The output error of simulations as an objective of a search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.nonlinear_problem import NonlinearProblem
from rotorid.fit.solution import Solution
from rotorid.fit.time_problem import TimeProblem
from rotorid.search.design_of_starts import StartBox
from rotorid.typing import FloatArray

OutputErrorProblem: TypeAlias = TimeProblem | NonlinearProblem

_SOLVER = LevenbergMarquardt()
_FEW_STEPS = LevenbergMarquardt(iterations=10, tolerance=1e-6)


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
