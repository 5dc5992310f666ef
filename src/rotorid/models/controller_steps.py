"""The rate controller of an autopilot step by step, as its program runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.models.controller import RateController
from rotorid.typing import FloatArray

Driven: TypeAlias = Literal["angle", "rate"]
"""What the set-point of a controller is."""

STATES = ("angle", "integral", "target", "error", "damped", "seen", "slope", "command")
UNKNOWN = ("angle", "integral")
"""States that remember for long, so that no record shows how they began; the others settle within their filters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SteppedController(Immutable):
    r"""A controller as a linear recursion.

    .. math:: z_{k+1} = A z_k + B [r_k, y_k]^T, \qquad u_k = C z_k + D [r_k, y_k]^T

    with the set-point :math:`r`, the measured rate :math:`y` and the command :math:`u`.

    Parameters
    ----------
    transition, drive, read, direct
        A, B, C and D, shapes ``(z, z)``, ``(z, 2)``, ``(1, z)`` and ``(1, 2)``.
    """

    transition: FloatArray
    drive: FloatArray
    read: FloatArray
    direct: FloatArray

    def __post_init__(self) -> None:
        names = ("transition", "drive", "read", "direct")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2) for name in names})


def stepped(controller: RateController, *, step_s: float, driven: Driven) -> SteppedController:
    r"""A controller at the rate of an autopilot's program.

    Each step integrates the angle, filters the rate set-point :math:`A (r - \int y)`, filters the error, differences
    and filters the derivative, integrates the error, and filters the command. Filters are
    :math:`x_k = x_{k-1} + \frac{h}{h + 1/\omega_c} (v_k - x_{k-1})`, integrals :math:`x_k = x_{k-1} + h v_k`, as PX4
    and ArduPilot have them. All of it is within the order of the step of :meth:`RateController.response`; the delay
    of the controller is not part of it.

    Parameters
    ----------
    controller
        Gains and filters.
    step_s
        Length of a step.
    driven
        Whether the set-point is an angle or, as rate modes fly it, a rate.

    Examples
    --------
    >>> half = stepped(RateController(proportional_s=0.5), step_s=0.001, driven="rate")
    >>> half.direct
    array([[ 0.5, -0.5]])
    """
    count = len(STATES)
    columns = [_advanced(controller, step_s, driven, unit) for unit in np.eye(count + 2)]
    matrix = np.array(columns).T
    command = matrix[-1:]
    return SteppedController(
        transition=matrix[:, :count], drive=matrix[:, count:], read=command[:, :count], direct=command[:, count:]
    )


def _advanced(controller: RateController, step_s: float, driven: Driven, before: FloatArray) -> list[float]:
    """The states after one step; the command is the last of them."""
    angle, integral, target, error, damped, seen, slope, command, setpoint, rate = before.tolist()

    def low_pass(last: float, value: float, cutoff_hz: float) -> float:
        share = step_s / (step_s + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0
        return last + share * (value - last)

    angle += step_s * rate
    wanted = controller.angle_1_s * (setpoint - angle) if driven == "angle" else setpoint
    target = low_pass(target, wanted, controller.target_cutoff_hz)
    error = low_pass(error, target - rate, controller.error_cutoff_hz)
    damped = low_pass(damped, -rate, controller.error_cutoff_hz)
    now = error if controller.derivative_of_error else damped
    slope = low_pass(slope, (now - seen) / step_s, controller.derivative_cutoff_hz)
    integral += step_s * error
    total = controller.proportional_s * error + controller.integral * integral + controller.derivative_s2 * slope
    command = low_pass(command, total, controller.command_cutoff_hz)
    return [angle, integral, target, error, damped, now, slope, command]
