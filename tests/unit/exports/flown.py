"""Equations of other simulators, flown in the open loop: attitude and steps are ours, forces and lags theirs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from tests.unit.exports.motion import named

from rotorid.typing import FloatArray

GRAVITY = np.array([0.0, 0.0, 9.80665])


def rotated(rates: FloatArray) -> FloatArray:
    """Rotation by a vector of angles."""
    angle = float(np.linalg.norm(rates))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = rates / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def flown(
    accelerations: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    outputs: FloatArray,
    lag: Callable[[FloatArray, FloatArray], FloatArray],
    step_s: float,
) -> dict[str, FloatArray]:
    """Rates and velocity over ground after each step.

    Parameters
    ----------
    accelerations
        Of lagged outputs, velocity and rates in body axes: six accelerations without gravity.
    outputs
        Shape ``(steps, rotors)``.
    lag
        The lagged outputs after a step, of those before it and the outputs.
    step_s
        Of the simulator.
    """
    x, attitude = outputs[0].copy(), np.eye(3)
    velocity, rates = np.zeros(3), np.zeros(3)
    kept = np.empty((len(outputs), 6))
    for k, row in enumerate(outputs):
        x = lag(x, row)
        found = accelerations(x, attitude.T @ velocity, rates)
        velocity = velocity + step_s * (attitude @ found[:3] + GRAVITY)
        rates = rates + step_s * found[3:]
        attitude = attitude @ rotated(step_s * rates)
        kept[k] = [*rates, *velocity]
    return named(kept[:, :3], kept[:, 3:])
