r"""The AscTec Hummingbird in hover, as published: one model each of pitch, yaw and heave.

A quadrotor in a plus, flown outdoors with pilot's sweeps below 2 Hz and injected ones above (Niermeyer, Raffler and
Holzapfel, *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via Closed-Loop Flight Testing*,
tables 2 to 4). Commands are those of its motor controllers, 1 to 200, as differences of rotor speeds (eq 6).

Pitch was published with the scaled state :math:`q_T = 100 z q`, because the tool of its authors had no parameters in
output matrices. In SI units, with :math:`1/(100 z)` = 0.7416 (so the accelerometer sits 13.5 mm above the center of
gravity), the printed 8.207 becomes M_u = 6.086 rad/(s m) and the printed 2.977 M_pitch = 2.208 rad/s². Its delays are
those of each response: the gyroscope's is ``tau_pitch``, and ``tau_ax`` what the accelerometer has beyond that. Roll
and pitch of this vehicle are alike.

Yaw was published with the motor speed in rad/s, fed by the constant :math:`k_{\omega\delta}` that is not printed. The
model ``axis.yaw`` holds the same system with the speed as a fraction of its steady answer:

.. math::

    T_{motor} = -1/M_{mot,\omega}, \qquad N_{yaw} = -N_\omega (k_{\omega\delta} + M_{mot,yaw}/M_{mot,\omega}), \qquad
    N_{spin} = -N_\omega k_{\omega\delta} T_{motor}

The steady speed is 3.603 rad/s a step; :math:`k_{\omega\delta}` must be larger, for a motor controller without
integral part never quite reaches what it is asked for. Here it is 3.94, which is ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.models.catalog import library_model
from rotorid.models.state_space import StateSpace

_PER_SCALED_RATE = 0.7416
"""1/(100 z) of table 2, 1/m over 100."""

PITCH: Mapping[str, float] = MappingProxyType(
    {
        "M_pitch": 2.977 * _PER_SCALED_RATE,
        "M_q": 0.0,
        "M_u": 8.207 * _PER_SCALED_RATE,
        "X_q": 0.0,
        "X_u": -0.2090,
        "z_imu": 0.01 / _PER_SCALED_RATE,
        "tau_pitch": 0.02423,
        "tau_ax": 0.05791 - 0.02423,
        "T_motor": 0.0,
    }
)
"""Table 2 in SI units; a zero was dropped there, and motor lag is part of the delays."""

_MOTOR_POLE = -42.21
_MOTOR_GAIN = 152.1
_N_OMEGA = -0.5541
_SPEED_PER_COMMAND = 3.94

YAW: Mapping[str, float] = MappingProxyType(
    {
        "N_yaw": -_N_OMEGA * (_SPEED_PER_COMMAND + _MOTOR_GAIN / _MOTOR_POLE),
        "N_spin": _N_OMEGA * _SPEED_PER_COMMAND / _MOTOR_POLE,
        "N_r": 0.0,
        "tau_yaw": 0.01313,
        "T_motor": -1.0 / _MOTOR_POLE,
    }
)
"""Table 3 in the parameters of ``axis.yaw``; N_r was dropped there."""

VERTICAL: Mapping[str, float] = MappingProxyType(
    {"Z_thrust": -0.1692, "Z_w": -0.5934, "tau_thrust": 0.05202, "tau_az": 0.0, "T_motor": 0.0}
)
"""Table 4."""

TRUTH: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"axis.pitch": PITCH, "axis.yaw": YAW, "axis.vertical": VERTICAL}
)
"""Parameters of each model of the library that describes this vehicle."""


def pitch() -> StateSpace:
    """Pitch: outputs ``q u theta ax`` after the pitch command, unstable without an autopilot.

    Examples
    --------
    >>> pitch().poles().round(2)
    array([ 1.88-3.38j, 1.88+3.38j, -3.98+0.j ])
    """
    return _system("axis.pitch")


def yaw() -> StateSpace:
    """Yaw: output ``r`` after the yaw command, with the speed of the motors as a state.

    Examples
    --------
    >>> yaw().poles().round(2)
    array([ 0. +0.j, -42.21+0.j])
    """
    return _system("axis.yaw")


def vertical() -> StateSpace:
    """Heave: outputs ``w az`` after the thrust command.

    Examples
    --------
    >>> vertical().poles().round(4)
    array([-0.5934+0.j])
    """
    return _system("axis.vertical")


def _system(name: str) -> StateSpace:
    model = library_model(name)
    parameters = model.parameters.with_values(TRUTH[name])
    if not TRUTH[name]["T_motor"]:
        parameters = parameters.drop("T_motor")
    return model.condensed(parameters).matrices(parameters.values)
