"""The controller of an axis from the parameters of any autopilot that the package knows."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.autopilots import ardupilot, betaflight, px4
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.typing import Axis

_ANY_RAD_S = np.array([1.0, 10.0, 100.0])


def axis_controller(
    parameters: Mapping[str, float],
    axis: Axis,
    *,
    firmware: str = "",
    loop_rate_hz: float | None = None,
    throttle: float = 0.0,
    sensor_rate_hz: float | None = None,
) -> AxisController | None:
    """The controller of an axis, from the parameters of a PX4 or ArduPilot log or the header of a Betaflight log.

    Parameters
    ----------
    parameters
        Names and values as the autopilot has them; of lists in a blackbox header one name each, ``rollPID_P``.
    axis
        ``roll``, ``pitch`` or ``yaw``; thrust is not controlled by a rate.
    firmware
        What the log calls it. Betaflight's settings mean nothing without their version.
    loop_rate_hz
        Steps of the program per second, where the caller knows better than the parameters (a slow sensor holds PX4's
        loop back, whatever ``IMU_GYRO_RATEMAX`` allows); zero for continuous time. Where neither says it, time is
        continuous.
    throttle
        Share of the throttle that was flown, which moves gains and filters of Betaflight.
    sensor_rate_hz
        Rate of the gyro's samples, at which PX4 makes its derivative; that of the loop when not given.

    Returns
    -------
    AxisController or None
        ``None`` when the gains are not there, are all zero, or are none that an autopilot could fly with.

    Notes
    -----
    A gain that changed in flight and limits are not seen. Whether the angle loop was closed depends on the flight mode;
    see :attr:`rotorid.models.RateController.rate_loop`.

    Examples
    --------
    >>> header = {"rollPID_P": 45.0, "rollPID_I": 80.0, "rollPID_D": 30.0, "looptime": 125.0}
    >>> roll = axis_controller(header, "roll", firmware="Betaflight 4.5.1")
    >>> round(roll.controller.proportional_s, 5), round(roll.controller.integral, 4), roll.loop_rate_hz
    (0.08258, 1.1202, 8000.0)
    """

    def read(given: Mapping[str, float]) -> AxisController | None:
        return (
            px4.read(given, axis, firmware=firmware, loop_rate_hz=loop_rate_hz, sensor_rate_hz=sensor_rate_hz)
            or ardupilot.read(given, axis, firmware=firmware, loop_rate_hz=loop_rate_hz)
            or betaflight.read(given, axis, firmware=firmware, loop_rate_hz=loop_rate_hz, throttle=throttle)
        )

    damaged = [name for name, value in parameters.items() if not math.isfinite(value)]
    try:
        # Of a controller that hangs on a number that is none, nothing is known.
        controller, other = (read({**parameters, **dict.fromkeys(damaged, value)}) for value in (1.0, 2.0))
        if controller is None or other is None or controller.controller != other.controller:
            return None
        return controller if np.isfinite(controller.controller.response(_ANY_RAD_S)).all() else None
    except (UsageError, ArithmeticError):
        # Numbers with which no program could run: damage.
        return None


def rate_controller(
    parameters: Mapping[str, float],
    axis: Axis,
    *,
    firmware: str = "",
    loop_rate_hz: float | None = None,
    throttle: float = 0.0,
) -> RateController | None:
    """The rate controller of an axis with its angle loop; see :func:`axis_controller`, which has more.

    Parameters
    ----------
    parameters, axis, firmware, loop_rate_hz, throttle
        As for :func:`axis_controller`.

    Returns
    -------
    RateController or None
        ``None`` when the gains are not there, are all zero, or are none that an autopilot could fly with.

    Examples
    --------
    >>> rate_controller({"MC_YAWRATE_P": 0.15, "MC_YAWRATE_I": 0.2, "MC_YAW_P": 1.0}, "yaw").angle_1_s
    1.0
    >>> rate_controller({}, "yaw") is None
    True
    """
    found = axis_controller(parameters, axis, firmware=firmware, loop_rate_hz=loop_rate_hz, throttle=throttle)
    return None if found is None else found.controller
