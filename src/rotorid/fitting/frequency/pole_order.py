r"""Which of two poles in a row is the motor: the faster one.

A rate that answers a command through a motor lag and a damping,

.. math:: \frac{r}{\delta}(s) = \frac{N_1 s + N_0}{(s - N_r)(T s + 1)},

is the same response with :math:`T' = -1/N_r`, :math:`N_r' = -1/T` and numerators that are :math:`-1/(N_r T)` times as
large. Data cannot tell the two apart, physics can: the motors of a multirotor answer faster than the air stops its
rotation.
"""

from __future__ import annotations

import numpy as np

from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.typing import FloatArray

_MOTOR = "T_motor"


def with_faster_motor(problem: FrequencyProblem, theta: FloatArray) -> FloatArray | None:
    """Free parameters with the motor lag and a damping exchanged, where the lag is the slower of the two; else `None`.

    They are where to fit again: of a structure with more than these two poles the response is not quite the same.

    Parameters
    ----------
    problem
        Structure and free parameters; those in 1/s that are negative are dampings.
    theta
        Free parameters, shape ``(p,)``.
    """
    names = list(problem.parameters.free)
    if _MOTOR not in names:
        return None
    units = [problem.parameters[name].unit for name in names]
    lag_s = float(theta[names.index(_MOTOR)])
    dampings = [row for row, unit in enumerate(units) if unit == "1/s" and theta[row] * lag_s < -1.0]
    if not dampings:
        return None
    damping = min(dampings, key=lambda row: float(theta[row]))
    exchanged = theta.copy()
    exchanged[names.index(_MOTOR)] = -1.0 / theta[damping]
    exchanged[damping] = -1.0 / lag_s
    gains = [row for row, unit in enumerate(units) if unit not in ("s", "1/s")]
    exchanged[gains] *= -1.0 / (theta[damping] * lag_s)
    return np.clip(exchanged, *problem.box)
