r"""Motors over a record: outputs with lag and delay, or measured speeds, at its samples and between them.

A motor takes its output :math:`u`, held from sample to sample and late by :math:`\tau`, with a first-order lag,

.. math:: T \dot x(t) = u(t - \tau) - x(t),

so that within a stretch of constant input :math:`x = u + (x_0 - u) e^{-t/T}`, and what thrust and torque need over a
sample, :math:`\int x \, dt` and :math:`\int x^2 \, dt`, has closed forms. Speeds that were measured go from sample to
sample in lines, and have closed forms too. So do the derivatives of all of it by T and :math:`\tau`; where a switch of
an input meets a sample, they are those of a longer delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.typing import FloatArray


@dataclass(frozen=True, eq=False)
class MotorSpeed:
    """Motors over a record.

    Parameters
    ----------
    level
        Lagged output at every sample, shape ``(motors, n)``.
    first
        Integral of the lagged output from each sample to the next, shape ``(motors, n - 1)``.
    second
        Integral of its square, shape ``(motors, n - 1)``.
    moved
        The derivatives of all three by ``lag`` and ``delay``, where they were asked for.
    """

    level: FloatArray
    first: FloatArray
    second: FloatArray
    moved: Mapping[str, MotorSpeed] = field(default_factory=dict)


def motor_speed(
    outputs: FloatArray, *, lag_s: float, delay_s: float, step_s: float, moved: bool = False, integrals: bool = True
) -> MotorSpeed:
    """Lagged and delayed outputs at the samples, and their integrals between them, exactly.

    Parameters
    ----------
    outputs
        Held from each sample to the next, shape ``(motors, n)``; before the first they stood as there.
    lag_s, delay_s
        Time constant, positive, and delay. A delay below zero, of stamps that do not belong together, needs outputs
        after the last one, which are taken to stand.
    moved
        Whether derivatives by lag and delay are worked out too.
    integrals
        Whether those are, or the samples alone.

    Examples
    --------
    >>> step = np.array([[0.0, 1.0, 1.0, 1.0]])
    >>> motor_speed(step, lag_s=0.1, delay_s=0.05, step_s=0.1).level.round(4).tolist()
    [[0.0, 0.0, 0.3935, 0.7769]]
    """
    from rotorid.fitting.motors.speed_kernels import lagged

    whole = int(np.floor(delay_s / step_s))
    found = lagged(np.asarray(outputs, np.float64), whole, delay_s - whole * step_s, lag_s, step_s, moved, integrals)
    kinds = [MotorSpeed(*(rows[kind] for rows in found)) for kind in range(3 if moved else 1)]
    here, *others = kinds
    return MotorSpeed(here.level, here.first, here.second, dict(zip(("lag", "delay"), others, strict=False)))


def measured_speed(speeds: FloatArray, *, delay_s: float, step_s: float, moved: bool = False) -> MotorSpeed:
    """Measured speeds, joined by lines and delayed, at the samples, and their integrals between them, exactly.

    Parameters
    ----------
    speeds
        At the samples, shape ``(motors, n)``; before the first and after the last they stand.
    moved
        Whether the derivative by the delay is worked out too.

    Examples
    --------
    >>> rising = measured_speed(np.array([[0.0, 1.0, 2.0, 3.0]]), delay_s=0.025, step_s=0.1)
    >>> rising.level.round(4).tolist(), rising.first.round(4).tolist()
    ([[0.0, 0.75, 1.75, 2.75]], [[0.0281, 0.125, 0.225]])
    """
    samples = speeds.shape[1]
    whole = int(np.floor(delay_s / step_s))
    rest = delay_s - whole * step_s
    ago = [speeds[:, np.clip(np.arange(samples) - whole - row, 0, samples - 1)] for row in (0, 1)]
    slope = (ago[1] - ago[0]) / step_s
    level = ago[0] + slope * rest
    # The late clock has a sample `rest` after each of the early one.
    here, passed, following, span = level[:, :-1], ago[0][:, :-1], level[:, 1:], step_s - rest
    first = 0.5 * (rest * (here + passed) + span * (passed + following))
    squares = here**2 + here * passed + passed**2, passed**2 + passed * following + following**2
    second = (rest * squares[0] + span * squares[1]) / 3.0
    if not moved:
        return MotorSpeed(level, first, second)
    here_slope, following_slope = slope[:, :-1], slope[:, 1:]
    first_slope = 0.5 * (here - following + rest * here_slope + span * following_slope)
    second_slope = (
        squares[0]
        - squares[1]
        + rest * (2.0 * here + passed) * here_slope
        + span * (2.0 * following + passed) * following_slope
    ) / 3.0
    return MotorSpeed(level, first, second, {"delay": MotorSpeed(slope, first_slope, second_slope)})
