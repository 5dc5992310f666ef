"""Whether a controller is the one that flew, which shows without any model of the airframe."""

from __future__ import annotations

import math

import numpy as np

from rotorid.models.controller_steps import STATES, UNKNOWN, stepped
from rotorid.typing import FloatArray
from rotorid.verify.closed_loop import STEP_RATE_HZ, Loop, LoopScores, scored
from rotorid.verify.matching import Filter


def controller_alone(
    loop: Loop, rate: FloatArray, command: FloatArray, *, filtered: Filter, sample_rate_hz: float
) -> LoopScores:
    """How well a controller makes the measured command of the measured rate and set-point.

    This needs no model of the airframe: it says whether the controller is the one that flew. Offset, angle and integral
    at the beginning are estimated.

    Parameters
    ----------
    loop
        The controller and what drove it.
    rate, command
        As measured, shape ``(samples,)``.
    filtered
        As in :func:`rotorid.verify.closed_loop.closed_loop`.
    sample_rate_hz
        Their rate.
    """
    from rotorid.simulate.kernels import recursion

    fine = max(1, math.ceil(STEP_RATE_HZ / sample_rate_hz - 1e-9))
    samples = np.arange(rate.size)
    grid = np.arange((rate.size - 1) * fine + 1) / fine
    own = stepped(loop.controller, step_s=1.0 / (fine * sample_rate_hz), driven=loop.driven)
    late = grid - loop.controller.delay_s * sample_rate_hz
    driving = np.stack(
        [
            np.interp(grid, samples, loop.setpoint - loop.setpoint.mean()),
            np.interp(late, samples, rate - rate.mean()),
        ]
    )
    forcing = np.ascontiguousarray((own.drive @ driving).T)
    starts = [np.zeros(len(STATES)), *(np.eye(len(STATES))[STATES.index(name)] for name in UNKNOWN)]
    made = np.array(
        [
            recursion(own.transition, forcing if not start.any() else np.zeros_like(forcing), start) @ own.read[0]
            for start in starts
        ]
    )
    made[0] += (own.direct @ driving)[0] + np.interp(grid, samples, loop.excitation)
    whole = made[:, ::fine]
    columns = filtered(np.vstack([whole[1:], np.ones((1, rate.size))]))
    target, forced = filtered(command[None])[0], filtered(whole[:1])[0]
    predicted = forced + columns.T @ np.linalg.lstsq(columns.T, target - forced, rcond=1e-9)[0]
    return scored(target, predicted)
