"""Problems with known minima, on which every search is tried."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from tests.unit.fitting.known_models import posed

from rotorid.data.base import Immutable
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.time.output_error import TimeData, TimeProblem
from rotorid.models.library import rate_model
from rotorid.models.toml import from_toml
from rotorid.search.objectives import FrequencyObjective, TimeObjective
from rotorid.search.starts import StartBox
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

OSCILLATOR = from_toml(
    """
    name = "oscillator"
    inputs = ["u"]
    states = ["x", "v"]
    equations = ["x' = v", "v' = -k*x - d*v + b*u"]
    outputs = ["x", "v"]
    [parameters]
    k = { value = 40.0, unit = "1" }
    d = { value = 5.0, unit = "1" }
    b = { value = 30.0, unit = "1" }
    """
)
RATE = rate_model("rate.roll")


@dataclass(frozen=True, kw_only=True, eq=False)
class Valleys(Immutable):
    """Four minima near (1, 1), (1, -1), (-1, 1) and (-1, -1), the first the lowest; no value beyond a circle."""

    at_once: ClassVar[int] = 4

    name: str = "valleys"
    box: StartBox = field(
        default_factory=lambda: StartBox(lower=np.full(2, -2.5), upper=np.full(2, 2.5), scales=("linear", "linear"))
    )
    places = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])

    def residuals(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        left = np.concatenate([x**2 - 1.0, 0.1 * (x - np.array([1.0, 2.0]))])
        value = np.nan if x @ x > 9.0 else 1.0
        return value * left, np.vstack([np.diag(2.0 * x), 0.1 * np.eye(2)])

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        # One point for each of the two parameters, so that one of them alone has two minima.
        squares = np.stack([self.residuals(theta)[0] ** 2 for theta in thetas])
        squares = squares[:, :2] + squares[:, 2:]
        return np.where(np.isfinite(squares), squares, np.inf)

    def costs(self, thetas: FloatArray) -> FloatArray:
        return np.asarray(self.point_costs(thetas).sum(axis=1))

    def polish(self, start: FloatArray) -> Solution:
        return LevenbergMarquardt().minimize(self.residuals, start, np.full(2, -np.inf), np.full(2, np.inf))

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        root = np.tile(np.sqrt(points), 2)

        def weighted(x: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = self.residuals(x)
            return root * residual, root[:, None] * jacobian

        wide = np.full(2, np.inf)
        return LevenbergMarquardt(iterations=5).minimize(weighted, start, -wide, wide)


def rate_problem(*, noise: float = 0.05) -> FrequencyProblem:
    truth = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}
    return posed(RATE, truth, np.geomspace(1.0, 40.0, 30), noise=noise)


def late() -> FrequencyObjective:
    """A rate response whose delay may be so long that the phase wraps: two minima or more."""
    box = StartBox(
        lower=np.array([5.0, -20.0, 0.01, 0.0]),
        upper=np.array([500.0, -0.1, 0.3, 0.4]),
        scales=("logarithmic", "logarithmic", "logarithmic", "linear"),
    )
    return FrequencyObjective(problem=rate_problem(), box=box)


def oscillator_problem() -> TimeProblem:
    rng = np.random.default_rng(0)
    u = np.sign(np.repeat(rng.standard_normal((1, 10)), 20, axis=1))
    y = simulate_linear(OSCILLATOR.matrices({"k": 30.0, "d": 4.0, "b": 45.0}), u, sample_rate_hz=100.0)
    record = TimeData(name="a flight", inputs=u, outputs=y + 0.02 * rng.standard_normal(y.shape), sample_rate_hz=100.0)
    return TimeProblem(structure=OSCILLATOR, parameters=OSCILLATOR.parameters, records=(record,), hold="zero")


def swinging() -> TimeObjective:
    """An oscillator whose frequency may be wrong by a factor, so that it comes out of step."""
    box = StartBox(lower=np.array([3.0, 0.4, 4.0]), upper=np.array([300.0, 40.0, 400.0]), scales=("logarithmic",) * 3)
    return TimeObjective(problem=oscillator_problem(), box=box)


OBJECTIVES = {"valleys": Valleys(), "late": late(), "swinging": swinging()}

LOWEST = {
    "valleys": Valleys().polish(np.array([1.0, 1.1])),
    "late": late().polish(np.array([60.0, -2.0, 0.05, 0.012])),
    "swinging": swinging().polish(np.array([30.0, 4.0, 45.0])),
}
"""Minima from the truth, which no search is told."""
