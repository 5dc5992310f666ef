"""How Betaflight straightens the curve of the motors."""

from __future__ import annotations

import numpy as np

from rotorid.autopilots.thrust import ThrustParameter
from rotorid.typing import FloatArray


def _demand(output: FloatArray, percent: FloatArray) -> FloatArray:
    """Demand of which an output is made: output = d (1 + k (1 - d)²), by bisection."""
    low, high = np.zeros(np.broadcast_shapes(output.shape, percent.shape)), np.ones(1)
    high = np.ones_like(low)
    for _ in range(40):
        middle = 0.5 * (low + high)
        over = middle * (1.0 + percent / 100.0 * (1.0 - middle) ** 2) > output
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return 0.5 * (low + high)


def _bend(output: FloatArray, percent: FloatArray) -> FloatArray:
    d, k = _demand(output, percent), percent / 100.0
    return 1.0 / (1.0 + k * (1.0 - d) ** 2 - 2.0 * k * d * (1.0 - d))


# Above 100 its curve is not monotonic any more.
THRUST_LINEAR = ThrustParameter(name="thrust_linear", largest=100.0, integer=True, bend=_bend, demand=_demand)
