r"""How an autopilot makes outputs of its demands of thrust, and which parameter straightens the curve of its motors.

.. math:: x = x_0 + \frac{x_1 - x_0}{v} s(d), \qquad s(t) = \frac{e - 1 + \sqrt{(1 - e)^2 + 4 e t}}{2 e}

with a demand :math:`d`, the expo :math:`e` of the curve that is undone, outputs :math:`x_0, x_1` of no and of full
thrust, and the battery's resting voltage over its highest :math:`v`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.typing import FloatArray

_LOWEST_SHARE = 0.6
"""ArduPilot takes no voltage below this share of the highest."""

_LINEAR = 1e-9


def expo_thrust(share: FloatArray, expo: float) -> FloatArray:
    r"""Thrust of an output, both shares of the largest: :math:`(1 - e) s + e s^2`.

    Parameters
    ----------
    share
        Outputs :math:`s`, shape ``(n,)``.
    expo
        The bend :math:`e`: zero is straight, one a parabola.
    """
    return np.asarray((1.0 - expo) * share + expo * share**2)


def expo_share(thrust: FloatArray, expo: float) -> FloatArray:
    """Output that makes a thrust, both shares of the largest; the inverse of :func:`expo_thrust`.

    Examples
    --------
    >>> expo_share(expo_thrust(np.array([0.2, 0.7]), 0.65), 0.65).round(12).tolist()
    [0.2, 0.7]
    """
    if abs(expo) < _LINEAR:
        return np.array(thrust, dtype=np.float64)
    root = np.sqrt(np.maximum((1.0 - expo) ** 2 + 4.0 * expo * np.asarray(thrust), 0.0))
    return np.asarray((expo - 1.0 + root) / (2.0 * expo))


@dataclass(frozen=True, kw_only=True)
class Linearization(Immutable):
    """How an autopilot turns a demand of thrust into an output.

    Parameters
    ----------
    expo
        Curve of the motors that it undoes.
    low, high
        Outputs of no and of full thrust.
    voltage_max, voltage_min
        Range of voltage that it compensates, in volts; zero when it does not.
    """

    expo: float = 0.0
    low: float = 0.0
    high: float = 1.0
    voltage_max: float = 0.0
    voltage_min: float = 0.0

    @property
    def compensates_voltage(self) -> bool:
        return self.voltage_max > 0.0 and self.voltage_min < self.voltage_max

    def voltage_share(self, voltage_v: FloatArray) -> FloatArray:
        """What the autopilot divides its outputs by, from the resting voltage of the battery."""
        if not self.compensates_voltage:
            return np.ones_like(voltage_v)
        lowest = max(self.voltage_min, _LOWEST_SHARE * self.voltage_max)
        return np.asarray(np.clip(voltage_v, lowest, self.voltage_max) / self.voltage_max)

    def outputs(self, demands: FloatArray, *, gain: float = 1.0, voltage_share: FloatArray | float = 1.0) -> FloatArray:
        """Outputs to the motors, between ``low`` and ``high``.

        Parameters
        ----------
        demands
            Shares of the largest thrust, any shape.
        gain
            One over the density of the air over that at sea level.
        voltage_share
            Of :meth:`voltage_share`.
        """
        share = expo_share(np.maximum(gain * demands, 0.0), self.expo) / voltage_share
        return np.asarray(self.low + (self.high - self.low) * np.clip(share, 0.0, 1.0))

    def demands(self, outputs: FloatArray, *, voltage_share: FloatArray | float = 1.0) -> FloatArray:
        """Demands behind outputs, up to the gain."""
        share = (outputs - self.low) / (self.high - self.low) * voltage_share
        return expo_thrust(np.asarray(share), self.expo)


@dataclass(frozen=True, kw_only=True)
class ThrustParameter:
    """The parameter by which an autopilot straightens the curve of the motors.

    Parameters
    ----------
    name
        As the firmware has it.
    largest
        Its largest value.
    integer
        Whether it is a whole number.
    bend
        Derivative of the demand by the output, of outputs ``(1, x)`` and parameters ``(p, 1)``.
    demand
        Demand of which an output is made, of the same.
    """

    name: str
    largest: float = 1.0
    integer: bool = False
    bend: Callable[[FloatArray, FloatArray], FloatArray]
    demand: Callable[[FloatArray, FloatArray], FloatArray]


def by_expo(name: str) -> ThrustParameter:
    """A parameter that is the expo of the curve."""
    return ThrustParameter(name=name, bend=expo_bend, demand=_expo_demand)


def _expo_demand(share: FloatArray, expo: FloatArray) -> FloatArray:
    return (1.0 - expo) * share + expo * share**2


def expo_bend(share: FloatArray, expo: FloatArray) -> FloatArray:
    """Derivative of :func:`expo_thrust` by the share."""
    return 1.0 - expo + 2.0 * expo * share
