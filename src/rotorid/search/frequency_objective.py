"""CIFER's cost of frequency responses as an objective of a search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.search.design_of_starts import StartBox
from rotorid.typing import FloatArray

_SOLVER = LevenbergMarquardt()
_FEW_STEPS = LevenbergMarquardt(iterations=10, tolerance=1e-6)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyObjective(Immutable):
    """The weighted cost of a :class:`rotorid.fit.problem.FrequencyProblem`.

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
