r"""Rate models of one axis: gain, damping, motor lag and delay.

A multirotor in hover answers a torque command with

.. math:: \dot p = L_p p + L_{roll} \, \delta, \qquad T_{motor} \dot\delta = -\delta + u(t - \tau_{roll})

and a thrust command with :math:`\dot w = Z_w w + Z_{thrust} \delta`, seen by the accelerometer as :math:`a_z = \dot w`
(without gravity). A hovering vehicle damps its own rates, so damping is bounded by zero. Below the speed modes of the
airframe, some 3 to 8 rad/s, the rate of a real vehicle follows more than its own axis; there a hover model is needed.
"""

from __future__ import annotations

from typing import NamedTuple

from rotorid.errors import ModelError
from rotorid.models.equations import structure_from_equations
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure

MOTOR_LAG = "T_motor"


class _Axis(NamedTuple):
    input: str
    output: str
    state: str
    gain: str
    gain_unit: str
    damping: str
    delay: str


RATE_AXES = {
    "rate.roll": _Axis("roll_command", "p", "p", "L_roll", "rad/s^2", "L_p", "tau_roll"),
    "rate.pitch": _Axis("pitch_command", "q", "q", "M_pitch", "rad/s^2", "M_q", "tau_pitch"),
    "rate.yaw": _Axis("yaw_command", "r", "r", "N_yaw", "rad/s^2", "N_r", "tau_yaw"),
    "rate.vertical": _Axis("thrust_command", "az", "w", "Z_thrust", "m/s^2", "Z_w", "tau_thrust"),
}

_SOURCE = "Tischler and Remple, Aircraft and Rotorcraft System Identification, AIAA; first-order rate response in hover"


def rate_model(name: str) -> LinearStructure:
    """The rate model ``rate.roll``, ``rate.pitch``, ``rate.yaw`` or ``rate.vertical``.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> rate_model("rate.roll").parameters.names
    ('L_roll', 'L_p', 'T_motor', 'tau_roll')
    """
    if name not in RATE_AXES:
        raise ModelError(f"there is no model {name!r}", needed=f"one of {', '.join(RATE_AXES)}")
    axis = RATE_AXES[name]
    vertical = name == "rate.vertical"
    parameters = (
        Parameter(name=axis.gain, value=-10.0 if vertical else 100.0, unit=axis.gain_unit),
        Parameter(name=axis.damping, value=-1.0, unit="1/s", lower=-200.0, upper=0.0, starts=(-0.5, -4.0)),
        Parameter(name=MOTOR_LAG, value=0.03, unit="s", lower=0.0, upper=2.0, starts=(0.01, 0.04, 0.1)),
        Parameter(name=axis.delay, value=0.01, unit="s", lower=0.0, upper=1.0, starts=(0.002, 0.02, 0.06)),
    )
    lag = f"{MOTOR_LAG}*motor' = -motor + {axis.input}"
    return structure_from_equations(
        name=name,
        inputs=(axis.input,),
        states=(axis.state, "motor"),
        equations=(f"{axis.state}' = {axis.damping}*{axis.state} + {axis.gain}*motor", lag),
        outputs=(f"{axis.output} = {axis.state}'" if vertical else axis.output,),
        delays={axis.input: axis.delay},
        parameters=ParameterSet(parameters),
        gain=axis.gain,
        optional=(MOTOR_LAG,),
        source=_SOURCE,
    )
