r"""The speed of motors by their outputs: a curve, the battery's voltage, and a lag that differs up and down.

.. math::

    \dot\Omega_i &= \frac{e_i}{T}, \quad e_i = \Omega^*_i - \Omega_i, \quad
        T = T_{up} \text{ where } e_i > 0, \; T_{down} \text{ where } e_i < 0 \\
    \Omega^*_i &= f_i \left(\Omega_0 + \Omega_1 (u_i - u_0) + \Omega_2 (u_i - u_0)^2\right) (V / V_0)^{n_V}

with the output :math:`u_i(t - \tau)`, the factor :math:`f_i` of each motor (their mean is one), and the voltage
:math:`V`, whose exponent is 1 for controllers of the duty cycle and 0 for those that govern the speed. Coefficients
belong to the mean output of the record, :math:`u_0`, where data know them best. Speeds may be logged after the outputs
that already act on them; :math:`y = \Omega + \tau_y \dot\Omega` says so to first order.
"""

from __future__ import annotations

from typing import NamedTuple

from rotorid.models.nonlinear import NonlinearStructure, nonlinear_structure
from rotorid.models.parameter import Parameter, ParameterSet

NAME = "motor.speed"

VOLTAGE = "battery_voltage"

LAG_UP, LAG_DOWN, DELAY, LEAD, EXPONENT = "T_motor_up", "T_motor_down", "tau", "tau_y", "n_V"

CURVE = ("Omega_0", "Omega_1", "Omega_2")
"""Coefficients of the steady speed over the output."""

UNITS = {LAG_UP: "s", LAG_DOWN: "s", DELAY: "s", LEAD: "s", EXPONENT: "1"} | dict.fromkeys(CURVE, "rad/s")
"""Units of the parameters; the factors of the motors have none."""

_LAG_S = (0.04, 0.0005, 2.0)
_LONGEST_DELAY_S = 0.2


class Operation(NamedTuple):
    r"""Where a model of motor speeds counts from, and what is known before a fit.

    Parameters
    ----------
    output
        :math:`u_0`.
    speed, slope
        Start values of :math:`\Omega_0` and :math:`\Omega_1`, rad/s.
    volts
        :math:`V_0`; ``None`` where the voltage is left out.
    curved
        Whether outputs moved enough for a curve.
    step_s
        Time between samples: speeds are at most that much ahead.
    """

    output: float
    speed: float
    slope: float
    volts: float | None = None
    curved: bool = True
    step_s: float = 0.01


def motor_speed_model(motors: int, at: Operation) -> NonlinearStructure:
    """The equations for some motors, about an operating point.

    Examples
    --------
    >>> model = motor_speed_model(2, Operation(output=0.5, speed=600.0, slope=800.0))
    >>> model.inputs, model.outputs, model.parameters.free[:3]
    (('motor_1', 'motor_2'), ('motor_speed_1', 'motor_speed_2'), ('T_motor_up', 'T_motor_down', 'tau'))
    >>> str(model.equations[0])[:20]
    '(0.5/T_motor_up + 0.'
    """
    numbers = range(1, motors + 1)
    outputs, speeds, states = ([f"{name}{k}" for k in numbers] for name in ("motor_", "motor_speed_", "Omega_of_"))
    # The power to second order, which has a value where no voltage is logged.
    ratio = f"({VOLTAGE}/V_0 - 1)"
    sag = "" if at.volts is None else f"*exp({EXPONENT}*({ratio} - 0.5*{ratio}**2))"
    # The mean of the factors is one: the first follows from the others.
    factors = [f"({motors} - {' - '.join(f'f_{k}' for k in numbers[1:])})" if motors > 1 else "1"]
    factors += [f"f_{k}" for k in numbers[1:]]
    equations = []
    for factor, output, state in zip(factors, outputs, states, strict=True):
        about = f"({output} - u_0)"
        error = f"({factor}*(Omega_0 + Omega_1*{about} + Omega_2*{about}**2){sag} - {state})"
        faster = f"(0.5/{LAG_UP} - 0.5/{LAG_DOWN})"
        equations.append(f"{state}' = (0.5/{LAG_UP} + 0.5/{LAG_DOWN})*{error} + {faster}*abs({error})")
    return nonlinear_structure(
        name=NAME,
        inputs=[*outputs, *(() if at.volts is None else (VOLTAGE,))],
        states=states,
        equations=equations,
        outputs=[f"{speed} = {state} + {LEAD}*{state}'" for speed, state in zip(speeds, states, strict=True)],
        parameters=_parameters(motors, at),
        delays=dict.fromkeys(outputs, DELAY),
        constants={"u_0": at.output} | ({} if at.volts is None else {"V_0": at.volts}),
        starts=dict(zip(states, speeds, strict=True)),
        source="first-order lag, as in every simulator of multirotors",
    )


def _parameters(motors: int, at: Operation) -> ParameterSet:
    lag, shortest, longest = _LAG_S
    found = [
        *(Parameter(name=name, value=lag, unit="s", lower=shortest, upper=longest) for name in (LAG_UP, LAG_DOWN)),
        Parameter(name=DELAY, value=min(0.002, at.step_s), unit="s", lower=0.0, upper=_LONGEST_DELAY_S),
        Parameter(name=LEAD, value=0.0, unit="s", lower=0.0, upper=1.5 * at.step_s, status="fixed"),
        Parameter(name="Omega_0", value=at.speed, unit="rad/s", lower=0.0),
        Parameter(name="Omega_1", value=at.slope, unit="rad/s"),
        Parameter(name="Omega_2", value=0.0, unit="rad/s", status="free" if at.curved else "fixed"),
        *(Parameter(name=f"f_{k}", value=1.0, unit="1", lower=0.1, upper=3.0) for k in range(2, motors + 1)),
    ]
    if at.volts is not None:
        found.append(Parameter(name=EXPONENT, value=0.5, unit="1", lower=-1.0, upper=3.0))
    return ParameterSet(found)
