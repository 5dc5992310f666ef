r"""Transfer functions as structures: any order, several responses over one denominator, a delay for each input.

.. math:: \frac{y_i}{u_j} = \frac{b_0 + b_1 s + \dots + b_m s^m}{a_0 + a_1 s + \dots + a_{n-1} s^{n-1} + s^n}
    e^{-\tau_j s}

In controllable canonical form the first state of an input is :math:`x_1 = u_j / (a_0 + \dots + s^n)`, the next ones are
its derivatives, and every numerator is a row of an output matrix; one of order :math:`n` needs :math:`\dot x_n` too.
"""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.errors import ModelError
from rotorid.models.equations import structure_from_equations
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.units import STANDARD_GRAVITY_M_S2

_HIGHEST_ORDER = 20


def transfer_function(
    *,
    numerator: int = 1,
    denominator: int = 2,
    inputs: Sequence[str] = ("theta",),
    outputs: Sequence[str] = ("u_dot",),
) -> LinearStructure:
    r"""Transfer functions from every input to every output over one denominator.

    The denominator has a leading coefficient of one; all coefficients and delays are free, those of the polynomials
    without a start value of their own. A pole and a zero that nearly cancel are hardly seen: choose the lowest orders
    that fit.

    Parameters
    ----------
    numerator
        Order :math:`m` of the numerators, at most that of the denominator.
    denominator
        Order :math:`n`, from 1 to 20.
    inputs, outputs
        Names of the channels.

    Returns
    -------
    LinearStructure
        With the parameters ``b0`` … ``bm``, ``a0`` …, ``tau``; with several responses ``b0_OUTPUT_INPUT`` … and
        ``tau_INPUT``. Units are those of a response without one.

    Raises
    ------
    ModelError
        The orders are impossible, or a name cannot stand in an equation.

    Examples
    --------
    >>> transfer_function(numerator=0, denominator=2, inputs=["roll_command"], outputs=["p"]).parameters.names
    ('b0', 'a0', 'a1', 'tau')
    """
    if not (0 <= numerator <= denominator and 1 <= denominator <= _HIGHEST_ORDER):
        raise ModelError(
            f"a transfer function of the orders {numerator} over {denominator} was asked for",
            needed=f"an order of the denominator from 1 to {_HIGHEST_ORDER} and of the numerator from 0 up to that",
        )
    single = len(inputs) == len(outputs) == 1
    tails = {(y, u): "" if single else f"_{y}_{u}" for y in outputs for u in inputs}
    states = {u: [f"x{k}" if len(inputs) == 1 else f"x{k}_{u}" for k in range(1, denominator + 1)] for u in inputs}
    feedback = [
        f"{x}' = {following}"
        for u in inputs
        for x, following in zip(states[u], [*states[u][1:], _feedback(states[u], u)], strict=True)
    ]
    seen = [
        f"{y} = "
        + " + ".join(
            f"b{k}{tails[y, u]}*{x}"
            for u in inputs
            for k, x in zip(range(numerator + 1), [*states[u], f"{states[u][-1]}'"], strict=False)
        )
        for y in outputs
    ]
    delays = {u: "tau" if single else f"tau_{u}" for u in inputs}
    return structure_from_equations(
        name=f"transfer_function.{numerator}.{denominator}",
        inputs=inputs,
        states=[x for u in inputs for x in states[u]],
        equations=feedback,
        outputs=seen,
        delays=delays,
        parameters=ParameterSet(_parameters(numerator, denominator, tuple(tails.values()), tuple(delays.values()))),
        gain="b0" if single and numerator == 0 else None,
        source="controllable canonical form",
    )


def _feedback(states: Sequence[str], u: str) -> str:
    """What the derivative of the last state is."""
    return "".join(f"-a{k}*{x} " for k, x in enumerate(states)) + f"+ {u}"


def _parameters(numerator: int, denominator: int, tails: tuple[str, ...], delays: tuple[str, ...]) -> list[Parameter]:
    def coefficient(name: str, order: int) -> Parameter:
        power = denominator - order
        return Parameter(name=name, unit={0: "1", 1: "1/s"}.get(power, f"1/s^{power}"))

    return [
        *(coefficient(f"b{k}{tail}", k) for tail in tails for k in range(numerator + 1)),
        *(coefficient(f"a{k}", k) for k in range(denominator)),
        *(Parameter(name=name, unit="s", lower=0.0, upper=1.0, starts=(0.002, 0.02, 0.06)) for name in delays),
    ]


_SPEED_DAMPING = {
    ("u_dot", "theta"): ("X_u", "u", "-"),
    ("v_dot", "phi"): ("Y_v", "v", "+"),
}


def speed_damping(output: str, input: str) -> LinearStructure:
    r"""The response of a speed to the attitude alone, from which the damping of the speed is read.

    .. math:: \frac{\dot u}{\theta} = \frac{-s g}{s - X_u}, \qquad \frac{\dot v}{\phi} = \frac{s g}{s - Y_v}

    It leaves out that a command moves the vehicle sideways by itself, and so is biased where ``X_pitch`` or ``Y_roll``
    is not small: on noise-free responses of a published vehicle with X_u = -0.25 it says -0.10. Fitting all responses
    together does not have this bias.

    Parameters
    ----------
    output, input
        ``u_dot`` and ``theta``, or ``v_dot`` and ``phi``.

    Raises
    ------
    ModelError
        There is no such response.

    References
    ----------
    *System Identification of an S500 Quadrotor UAV*, equations 4 and 5.

    Examples
    --------
    >>> speed_damping("v_dot", "phi").parameters.names
    ('Y_v',)
    """
    if (output, input) not in _SPEED_DAMPING:
        raise ModelError(f"speed damping was asked for from {output} / {input}", needed="u_dot / theta, or v_dot / phi")
    damping, speed, sign = _SPEED_DAMPING[output, input]
    return structure_from_equations(
        name=f"speed_damping.{speed}",
        inputs=(input,),
        states=(speed,),
        equations=(f"{speed}' = {damping}*{speed} {sign} g*{input}",),
        outputs=(f"{output} = {speed}'",),
        parameters=ParameterSet([Parameter(name=damping, value=-0.2, unit="1/s", upper=0.0, essential=True)]),
        constants={"g": STANDARD_GRAVITY_M_S2},
        source="response of speed to attitude without the forces of the command",
    )
