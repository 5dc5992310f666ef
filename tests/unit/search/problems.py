"""Problems with known minima, on which every search is tried."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from tests.unit.fitting.known_models import posed

from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.problem import Problem, StartBox
from rotorid.fitting.time.output_error import TimeData, TimeProblem
from rotorid.models.library import rate_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.toml import from_toml
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


def anything(*names: str) -> ParameterSet:
    """Free parameters without bounds or meaning."""
    return ParameterSet(Parameter(name=name, value=0.0, unit="1") for name in names)


@dataclass(frozen=True, kw_only=True, eq=False)
class Valleys(Problem):
    """Four minima near (1, 1), (1, -1), (-1, 1) and (-1, -1), the first the lowest; no value beyond a circle."""

    name: str = "valleys"
    parameters: ParameterSet = field(default_factory=lambda: anything("a", "b"))
    region: StartBox | None = field(
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

    def point_weights(self, points: FloatArray) -> FloatArray:
        return np.tile(points, 2)


def rate_problem(*, noise: float = 0.05) -> FrequencyProblem:
    truth = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}
    return posed(RATE, truth, np.geomspace(1.0, 40.0, 30), noise=noise)


def late() -> Problem:
    """A rate response whose delay may be so long that the phase wraps: two minima or more."""
    box = StartBox(
        lower=np.array([5.0, -20.0, 0.01, 0.0]),
        upper=np.array([500.0, -0.1, 0.3, 0.4]),
        scales=("logarithmic", "logarithmic", "logarithmic", "linear"),
    )
    return rate_problem().within(box)


def oscillator_problem() -> TimeProblem:
    rng = np.random.default_rng(0)
    u = np.sign(np.repeat(rng.standard_normal((1, 10)), 20, axis=1))
    y = simulate_linear(OSCILLATOR.matrices({"k": 30.0, "d": 4.0, "b": 45.0}), u, sample_rate_hz=100.0)
    record = TimeData(name="a flight", inputs=u, outputs=y + 0.02 * rng.standard_normal(y.shape), sample_rate_hz=100.0)
    return TimeProblem(structure=OSCILLATOR, parameters=OSCILLATOR.parameters, records=(record,), hold="zero")


def swinging() -> Problem:
    """An oscillator whose frequency may be wrong by a factor, so that it comes out of step."""
    box = StartBox(lower=np.array([3.0, 0.4, 4.0]), upper=np.array([300.0, 40.0, 400.0]), scales=("logarithmic",) * 3)
    return oscillator_problem().within(box)


PROBLEMS: dict[str, Problem] = {"valleys": Valleys(), "late": late(), "swinging": swinging()}

LOWEST = {
    "valleys": Valleys().polish(np.array([1.0, 1.1])),
    "late": late().polish(np.array([60.0, -2.0, 0.05, 0.012])),
    "swinging": swinging().polish(np.array([30.0, 4.0, 45.0])),
}
"""Minima from the truth, which no search is told."""
