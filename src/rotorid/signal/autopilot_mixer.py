r"""From the commands of the controllers to the motors, as the autopilots' mixers do it.

ArduPilot asks each motor for a share of the largest thrust that is linear in the commands, and PX4 for an actuator that
is:

.. math:: d_i = m_{i1} u_{roll} + m_{i2} u_{pitch} + m_{i3} u_{yaw} + m_{i4} u_{thrust}

as long as no motor is at a limit; beyond, yaw and then thrust give way. ArduPilot then undoes what it knows of the
motor: with the expo :math:`e` (``MOT_THST_EXPO``), the air's density over that at sea level :math:`\rho` and the
battery's resting voltage over its highest :math:`v` (``MOT_BAT_VOLT_MAX``, one without it), the output is

.. math:: x_i = x_0 + \frac{x_1 - x_0}{v} s(d_i / \rho), \qquad s(t) = \frac{e - 1 + \sqrt{(1 - e)^2 + 4 e t}}{2 e}

between ``MOT_SPIN_MIN`` and ``MOT_SPIN_MAX``. The demand is therefore the better input for a model whose thrust is
linear, and the output for one whose curve is to be found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.data.record import FlightRecord
from rotorid.typing import FloatArray

COMMANDS = ("roll_command", "pitch_command", "yaw_command", "thrust_command")
"""Columns of a mixer."""

_LOWEST_SHARE = 0.6
"""ArduPilot takes no voltage below this share of the highest."""

_LINEAR = 1e-9


def expo_thrust(share: FloatArray, expo: float) -> FloatArray:
    r"""Thrust of an output, both shares of the largest: :math:`(1 - e) s + e s^2`."""
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


def linearization_of(record: FlightRecord) -> Linearization | None:
    """How the autopilot that wrote a log turns demands into its logged motor outputs; ``None`` when that is not known.

    What PX4 logs as ``actuator_motors`` is the demand itself; ``THR_MDL_FAC`` acts after it.
    """
    if record.source.format.startswith("PX4"):
        return Linearization()
    return _ardupilot(record.parameters) if record.source.format.startswith(("ArduPilot", "MAVLink")) else None


def _ardupilot(parameters: Mapping[str, float]) -> Linearization | None:
    names = ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")
    if any(name not in parameters for name in names):
        return None
    expo, low, high = (parameters[name] for name in names)
    return (
        Linearization(
            expo=float(np.clip(expo, -1.0, 1.0)),
            low=low,
            high=high,
            voltage_max=parameters.get("MOT_BAT_VOLT_MAX", 0.0),
            voltage_min=parameters.get("MOT_BAT_VOLT_MIN", 0.0),
        )
        if low < high
        else None
    )
