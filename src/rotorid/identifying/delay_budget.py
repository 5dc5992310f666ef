r"""Where the delay between a command and a sensor comes from.

.. math:: \tau_{y/u} = \tau_u + T_{motor} + \tau_y

The delay of the input holds what computation, transport and motor controllers need, the lag of the motors counts as a
delay of its time constant, which it is well below its corner, and the delay of the output is that of the sensor beyond
the others. What filters of the autopilot delay is in these numbers; where their settings are logged it is said how much
of the total they are. After *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via Closed-Loop
Flight Testing*, eq 21.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rotorid.models.library import MOTOR_LAG
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.summary import DelayBudget
from rotorid.typing import BoolArray, FloatArray
from rotorid.uncertainty.cramer_rao import (
    Bounds,
)
from rotorid.uncertainty.propagation import covariance_of_all


def delay_budget(
    structure: LinearStructure,
    parameters: ParameterSet,
    bounds: Bounds,
    fitted: BoolArray,
    known_filters_s: Mapping[str, float],
) -> dict[str, DelayBudget]:
    """Delays of every fitted response ``output/input``.

    Parameters
    ----------
    fitted
        Which responses were fitted, shape ``(y, u)``.
    known_filters_s
        Output to the delay of the autopilot's filters in front of it, known from the log.
    """
    covariance = covariance_of_all(parameters, bounds)
    system, derivatives = structure.matrices_and_jacobian(parameters.values, np.eye(len(parameters)))
    lag, slope = _motor_lag(parameters)
    budget = {}
    for y, u in np.argwhere(fitted):
        total = derivatives[5][:, u] + derivatives[6][:, y] + slope
        before, after = float(system.input_delays_s[u]), float(system.output_delays_s[y])
        spread = math.sqrt(max(float(total @ covariance @ total), 0.0))
        budget[f"{structure.outputs[y]}/{structure.inputs[u]}"] = DelayBudget(
            input_delay_s=before,
            motor_lag_s=lag,
            output_delay_s=after,
            total_s=before + lag + after,
            total_std_s=spread if spread > 0.0 else None,
            known_filters_s=known_filters_s.get(structure.outputs[y]),
        )
    return budget


def _motor_lag(parameters: ParameterSet) -> tuple[float, FloatArray]:
    """The lag of the motors, and how it moves with the parameters."""
    slope = np.array([float(name == MOTOR_LAG) for name in parameters.names])
    return (parameters[MOTOR_LAG].value if MOTOR_LAG in parameters.names else 0.0), slope
