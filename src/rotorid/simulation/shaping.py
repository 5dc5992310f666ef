r"""ArduPilot's shaping of attitude set-points, before its attitude controller.

GUIDED mode does not fly an attitude set-point: it moves a target towards it, and the target is what flies and what the
log shows. With the set-point :math:`u`, the target :math:`a`, its rate :math:`w` and the tick :math:`h`, each axis does

.. math::

    a_{k+1} = a_k + h\, w_k, \qquad
    w_k = w_{k-1} + \mathrm{clip}\big(s(u_k - a_k) - w_{k-1},\; \pm h\, \dot w_{max}\big)

    s(e) = e / T \text{ for } |e| \le \dot w_{max} T^2, \qquad
    s(e) = \mathrm{sign}(e) \sqrt{2\, \dot w_{max} \left(|e| - \dot w_{max} T^2 / 2\right)} \text{ beyond}

A small and slow set-point meets a lag of first order, :math:`1/(1 + T s)`. One that asks for more than the largest
angular acceleration :math:`\dot w_{max}` is followed late and smaller, and no linear system describes it. The target's
rate goes to the rate controller as well, so that the vehicle follows the target closely.

The law is that of ``AC_AttitudeControl::input_quaternion`` of Copter 4.5 to 4.7, for each axis by itself. Left out: the
turn of the axes at large tilts, and the lean that holds the place, which is shaped together with the test input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.record import AXES
from rotorid.typing import Axis, FloatArray

_LETTERS: Mapping[Axis, str] = {"roll": "R", "pitch": "P", "yaw": "Y"}
_INPUT_TC_S = 0.15
_ACCELERATION_DEG_S2: Mapping[Axis, float] = {"roll": 1100.0, "pitch": 1100.0, "yaw": 270.0}
"""The firmware's defaults, for logs that lack the parameter."""

_SHORTEST_TC_S = 0.01

_TAIL_S = 1.0
"""After an input the target comes back to rest within it."""


@dataclass(frozen=True, kw_only=True)
class InputShaping(Immutable):
    """How set-points of one axis are smoothed.

    Parameters
    ----------
    lag_s
        T, ``ATC_INPUT_TC``.
    acceleration_rad_s2
        Largest angular acceleration of the target, ``ATC_ACCEL_R_MAX`` and its like; zero for no limit.
    rate_rad_s
        Largest rate of the target, ``ATC_RATE_R_MAX`` and its like; zero for no limit.
    """

    lag_s: float
    acceleration_rad_s2: float
    rate_rad_s: float = 0.0

    @property
    def corner_rad_s(self) -> float:
        """Where the lag takes 3 dB off a small set-point."""
        return 1.0 / self.lag_s

    def shaped(self, setpoint: FloatArray, sample_rate_hz: float) -> tuple[FloatArray, FloatArray]:
        """The target that flies and its rate, at rest before the first sample; shapes of the set-point.

        Parameters
        ----------
        setpoint
            Angles in rad at the ticks of the autopilot, shape ``(n,)``.
        sample_rate_hz
            Of the ticks.

        Examples
        --------
        A small step meets the lag: 63 % after it.

        >>> shaping = InputShaping(lag_s=0.15, acceleration_rad_s2=19.2)
        >>> angle, rate = shaping.shaped(np.full(400, 0.01), 400.0)
        >>> float(angle[60].round(4)), float(rate[0].round(3))
        (0.0063, 0.048)
        """
        tick = 1.0 / sample_rate_hz
        gain, limit = 1.0 / max(self.lag_s, _SHORTEST_TC_S), self.acceleration_rad_s2
        near = limit / gain**2 if limit > 0.0 else math.inf
        step = limit * tick if limit > 0.0 else math.inf
        fastest = self.rate_rad_s if self.rate_rad_s > 0.0 else math.inf
        angle = rate = 0.0
        angles, rates = [], []
        # A plain loop: each tick needs the one before, and a minute takes some hundredths of a second.
        for wanted in np.asarray(setpoint, dtype=np.float64).tolist():
            angle += tick * rate
            error = wanted - angle
            off = abs(error)
            speed = gain * off if off <= near else math.sqrt(2.0 * limit * (off - 0.5 * near))
            asked = math.copysign(min(speed, off / tick, fastest), error)
            rate += min(max(asked - rate, -step), step)
            angles.append(angle)
            rates.append(rate)
        return np.array(angles), np.array(rates)


def input_shaping(parameters: Mapping[str, float], axis: Axis) -> InputShaping | None:
    """How ArduPilot smooths the attitude set-points of an axis; ``None`` where it does not.

    Parameters
    ----------
    parameters
        By ArduPilot's names. Copter up to 4.6 has ``ATC_ACCEL_*_MAX`` in hundredths of a degree per s², later ones
        ``ATC_ACC_*_MAX`` in degrees per s². What is missing is taken from the firmware's defaults.
    axis
        Roll, pitch or yaw; thrust has no attitude.

    Examples
    --------
    >>> input_shaping({"ATC_INPUT_TC": 0.2, "ATC_ACCEL_R_MAX": 90000.0}, "roll").acceleration_rad_s2
    15.707963267948966
    >>> input_shaping({"ATC_RATE_FF_ENAB": 0.0}, "roll") is None
    True
    """
    if axis not in _LETTERS or not parameters.get("ATC_RATE_FF_ENAB", 1.0):
        return None
    letter = _LETTERS[axis]
    largest = parameters.get(f"ATC_ACC_{letter}_MAX")
    if largest is None:
        largest = parameters.get(f"ATC_ACCEL_{letter}_MAX", 100.0 * _ACCELERATION_DEG_S2[axis]) / 100.0
    return InputShaping(
        lag_s=max(parameters.get("ATC_INPUT_TC", _INPUT_TC_S), _SHORTEST_TC_S),
        acceleration_rad_s2=math.radians(largest),
        rate_rad_s=math.radians(parameters.get(f"ATC_RATE_{letter}_MAX", 0.0)),
    )


def shaped_plan(plan: FlightPlan, shaping: Mapping[Axis, InputShaping], sample_rate_hz: float) -> FlightPlan:
    """A plan whose attitude set-points are those that fly; the same plan where none is smoothed.

    Each input is shaped by itself, from rest to a second behind its last sample, in which the target comes back.

    Parameters
    ----------
    shaping
        By axis, of :func:`input_shaping`.
    sample_rate_hz
        Of the autopilot's ticks.
    """
    return replace(plan, inputs=tuple(_shaped(entered, shaping, sample_rate_hz) for entered in plan.inputs))


def _shaped(entered: PlannedInput, shaping: Mapping[Axis, InputShaping], sample_rate_hz: float) -> PlannedInput:
    if entered.entry != "attitude_setpoint" or entered.axis not in shaping:
        return entered
    count = entered.values.size + round(_TAIL_S * entered.sample_rate_hz)
    own_s = entered.start_s + np.arange(count) / entered.sample_rate_hz
    time_s = np.arange(entered.start_s, own_s[-1] + 1.0 / sample_rate_hz, 1.0 / sample_rate_hz)
    angle, _ = shaping[entered.axis].shaped(entered.at(time_s), sample_rate_hz)
    values = np.interp(own_s, time_s, angle)
    return replace(entered, values=values, amplitude=math.copysign(float(np.abs(values).max()), entered.amplitude))


def add_shaping(asked: FloatArray, shaping: Mapping[Axis, InputShaping], sample_rate_hz: float) -> None:
    """Replace attitude set-points by what flies, and add its rate to the rate set-points, in place.

    Parameters
    ----------
    asked
        Test inputs on the ticks, one row each: of commands, rates, attitudes and sticks, four columns each.
    shaping
        By axis, of :func:`input_shaping`.
    sample_rate_hz
        Of the ticks.
    """
    for axis, own in shaping.items():
        place = AXES.index(axis)
        wanted = asked[:, 2 * len(AXES) + place]
        if wanted.any():
            angle, rate = own.shaped(wanted, sample_rate_hz)
            asked[:, 2 * len(AXES) + place] = angle
            asked[:, len(AXES) + place] += rate
