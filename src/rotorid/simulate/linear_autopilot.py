r"""An autopilot around hover as a linear system: what its commands make of what is measured, and of test inputs.

The cascade of :mod:`rotorid.simulate.autopilot` without its limits, in continuous time. Each part that it computes once
a turn :math:`T` is replaced by the continuous one with the same gain and the same lateness at low frequencies:

.. math::

    \frac{1 - a}{1 - a z^{-1}} \to \frac{1}{1 + s\,T a/(1 - a)}, \qquad
    \frac{1 - z^{-1}}{T} \to \frac{s}{1 + s T/2}, \qquad
    \frac{T z^{-1}}{1 - z^{-1}} \to \frac{1}{s} - \frac{T}{2}

and the Butterworth filter by that of the cutoff :math:`2 \tan(\omega_c T/2)/T`. What is left is of second order in
:math:`\omega T`: it holds up to about a tenth of the rate of the loop. That commands are late and held for a turn
belongs to the vehicle (:func:`rotorid.simulate.linearize.linearize`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.flight_plan import Entry
from rotorid.models.state_space import StateSpace
from rotorid.simulate.autopilot import Autopilot
from rotorid.simulate.vehicle import OUTPUTS
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_RATES, _ANGLES = ("p", "q", "r"), ("phi", "theta", "psi")
_MOST_STATES = 64


def feedback_of(autopilot: Autopilot, *, gyro_lag_s: float = 0.0) -> StateSpace:
    """Commands of roll, pitch, yaw and thrust by the measured ``p q r phi theta psi u v w ax ay az``, with their signs.

    Closes the loop around :func:`rotorid.simulate.linearize.linearize`: ``u = feedback(y) + test input``. North and
    east are the integrals of u and v, height that of w, which holds near hover on a heading of zero.

    Parameters
    ----------
    autopilot
        Gains, filters, guidance and rate.
    gyro_lag_s
        Lag of the gyroscope in front of the filters.

    Examples
    --------
    >>> from rotorid.simulate.autopilot import RateLoop
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> response = feedback_of(autopilot).response(np.array([1.0]))
    >>> response[0, OUTPUTS.index("p"), 0].real.round(6), response[0, OUTPUTS.index("phi"), 0].real.round(6)
    (np.float64(-0.1), np.float64(-0.4))
    """
    return _cascade(autopilot, OUTPUTS, gyro_lag_s)


def entry_of(autopilot: Autopilot, entry: Entry) -> StateSpace:
    """Commands by test inputs of the four axes at an entry of the cascade, with nothing fed back.

    Parameters
    ----------
    autopilot
        See :func:`feedback_of`.
    entry
        ``command``, ``rate_setpoint``, ``attitude_setpoint`` or ``stick``; thrust has no set-point of rate or attitude,
        and nothing comes of it there.
    """
    return _cascade(autopilot, tuple(f"{axis}_{entry}" for axis in AXES))


@dataclass(frozen=True)
class _Wiring:
    """A growing linear system. A signal is a row: what it takes of each input, and after them of each state."""

    turn_s: float
    inputs: tuple[str, ...]
    slopes: list[FloatArray] = field(default_factory=list)
    """Of each state, a signal."""

    def input(self, name: str) -> FloatArray:
        """An input; nothing when the system is made for others."""
        row = np.zeros(len(self.inputs) + _MOST_STATES)
        if name in self.inputs:
            row[self.inputs.index(name)] = 1.0
        return row

    def state(self) -> FloatArray:
        """A new one, whose slope is still to be set."""
        row = np.zeros(len(self.inputs) + _MOST_STATES)
        row[len(self.inputs) + len(self.slopes)] = 1.0
        self.slopes.append(np.zeros_like(row))
        return row

    def low_pass(self, signal: FloatArray, lag_s: float) -> FloatArray:
        if lag_s <= 0.0 or not signal.any():
            return signal
        passed = self.state()
        self.slopes[-1][:] = (signal - passed) / lag_s
        return passed

    def butterworth(self, signal: FloatArray, cutoff_hz: float) -> FloatArray:
        if cutoff_hz <= 0.0 or not signal.any():
            return signal
        omega = 2.0 / self.turn_s * math.tan(math.pi * cutoff_hz * self.turn_s)
        passed, slope = self.state(), self.state()
        self.slopes[-2][:] = slope
        self.slopes[-1][:] = omega**2 * (signal - passed) - math.sqrt(2.0) * omega * slope
        return passed

    def slope(self, signal: FloatArray) -> FloatArray:
        """Difference to the turn before, over its length."""
        return (signal - self.low_pass(signal, 0.5 * self.turn_s)) / (0.5 * self.turn_s)

    def moved(self, signal: FloatArray, gain: float) -> FloatArray:
        """A gain times the integral."""
        if gain == 0.0 or not signal.any():
            return np.zeros_like(signal)
        integral = self.state()
        self.slopes[-1][:] = signal
        return gain * integral

    def summed(self, signal: FloatArray, gain: float) -> FloatArray:
        """A gain times the sum of all turns before this one, and times their length."""
        return self.moved(signal, gain) - 0.5 * gain * self.turn_s * signal


def _cascade(autopilot: Autopilot, inputs: tuple[str, ...], gyro_lag_s: float = 0.0) -> StateSpace:
    """All commands by inputs of the cascade."""
    wires = _Wiring(1.0 / autopilot.rate_hz, inputs)
    *attitude, thrust = _outer(autopilot, wires)
    commands = [_inner(autopilot, wires, gyro_lag_s, axis, wanted) for axis, wanted in enumerate(attitude)]
    commands.append(thrust)
    added = [wires.input(f"{axis}_command") for axis in AXES]
    taken, size = len(inputs), len(inputs) + len(wires.slopes)
    # Inputs are algebraic states, 0 = u - x, for they pass to the commands at once.
    M, F, G = np.eye(size), np.zeros((size, size)), np.zeros((size, taken))
    M[:taken] = 0.0
    F[:taken, :taken] = -np.eye(taken)
    F[taken:] = np.reshape(wires.slopes, (size - taken, taken + _MOST_STATES))[:, :size]
    G[:taken] = np.eye(taken)
    return StateSpace(
        M=M,
        F=F,
        G=G,
        H0=np.stack([one + more for one, more in zip(commands, added, strict=True)])[:, :size],
        H1=np.zeros((len(AXES), size)),
        input_delays_s=np.zeros(taken),
        output_delays_s=np.zeros(len(AXES)),
    )


def _outer(autopilot: Autopilot, wires: _Wiring) -> tuple[FloatArray, ...]:
    """Set-points of roll, pitch and heading, and the command of thrust."""
    own, put = autopilot.guidance, wires.input
    phi = put("roll_attitude_setpoint") + own.stick_tilt_rad * put("roll_stick")
    theta = put("pitch_attitude_setpoint") - own.stick_tilt_rad * put("pitch_stick")
    if own.hold_velocity:
        right = -put("v") - wires.moved(put("v"), own.position_p_1_s)
        ahead = -put("u") - wires.moved(put("u"), own.position_p_1_s)
        right = own.velocity_p_1_s * right + wires.summed(right, own.velocity_i_1_s2)
        ahead = own.velocity_p_1_s * ahead + wires.summed(ahead, own.velocity_i_1_s2)
        phi, theta = phi + right / STANDARD_GRAVITY_M_S2, theta - ahead / STANDARD_GRAVITY_M_S2
    # Where the heading follows while the stick is out, there is nothing that the stick leads to.
    led = 0.0 if own.heading_follows else own.stick_yaw_rate_rad_s
    psi = put("yaw_attitude_setpoint") + wires.moved(put("yaw_stick"), led)
    direct = 0.0 if own.stick_climb_m_s else own.stick_thrust
    if not own.hold_height:
        return phi, theta, psi, direct * put("thrust_stick")
    sink = put("w") + own.stick_climb_m_s * put("thrust_stick")
    sink = sink + wires.moved(sink, own.height_p_1_s)
    held = own.climb_p * sink + wires.summed(sink, own.climb_i)
    return phi, theta, psi, held + direct * put("thrust_stick")


def _inner(autopilot: Autopilot, wires: _Wiring, gyro_lag_s: float, axis: int, wanted: FloatArray) -> FloatArray:
    """Command of an axis by the set-point of its angle."""
    own, put = autopilot.rates, wires.input
    name = AXES[axis]
    rate = wires.butterworth(wires.low_pass(put(_RATES[axis]), gyro_lag_s), autopilot.gyro_cutoff_hz)
    target = autopilot.angle_1_s[axis] * (wanted - put(_ANGLES[axis])) + put(f"{name}_rate_setpoint")
    if name == "yaw":
        target = target + autopilot.guidance.stick_yaw_rate_rad_s * put("yaw_stick")
    target = wires.low_pass(target, _lag(own.target_cutoff_hz[axis]))
    error = wires.low_pass(target - rate, _lag(own.error_cutoff_hz[axis]))
    command = own.proportional[axis] * error + own.feedforward[axis] * target
    command = command + wires.summed(error, own.integral[axis])
    if own.derivative[axis]:
        slope = wires.slope(error if own.derivative_of_error else -rate)
        command = command + own.derivative[axis] * wires.low_pass(slope, _lag(own.derivative_cutoff_hz[axis]))
    return wires.low_pass(command, _lag(own.command_cutoff_hz[axis]))


def _lag(cutoff_hz: float) -> float:
    return 0.5 / (math.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0
