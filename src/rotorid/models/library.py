r"""Models by name: the library of hover and nonlinear models, and families that are made to order.

**Hover and nonlinear models** are one TOML file each.

**Rate models** of one axis have gain, damping, motor lag and delay. A multirotor in hover answers a torque command with

.. math:: \dot p = L_p p + L_{roll} \, \delta, \qquad T_{motor} \dot\delta = -\delta + u(t - \tau_{roll})

and a thrust command with :math:`\dot w = Z_w w + Z_{thrust} \delta`, seen by the accelerometer as :math:`a_z = \dot w`
(without gravity). A hovering vehicle damps its own rates, so damping is bounded by zero. Below the speed modes of the
airframe, some 3 to 8 rad/s, the rate of a real vehicle follows more than its own axis; there a hover model is needed.

**Responses to set-points** say what an autopilot with the vehicle below it makes of a command, channel by channel.

.. math::

    \text{first order:}\quad & T \dot y = K u(t - \tau) - y \\
    \text{second order:}\quad & \frac{y}{u} = \frac{K \omega^2 (1 + T_{zero} s)}{s^2 + 2 \zeta \omega s + \omega^2}
        \, e^{-\tau s}

Each response has an input of its own, and any number of them stand side by side without touching each other: that an
axis does not answer to the command of another is an assumption, and :mod:`rotorid.signal.step_response` puts it to the
test. The autopilot is inside: another tuning of it is another model.

**Transfer functions** of any order have several responses over one denominator and a delay for each input.

.. math:: \frac{y_i}{u_j} = \frac{b_0 + b_1 s + \dots + b_m s^m}{a_0 + a_1 s + \dots + a_{n-1} s^{n-1} + s^n}
    e^{-\tau_j s}

In controllable canonical form the first state of an input is :math:`x_1 = u_j / (a_0 + \dots + s^n)`, the next ones are
its derivatives, and every numerator is a row of an output matrix; one of order :math:`n` needs :math:`\dot x_n` too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from types import MappingProxyType
from typing import NamedTuple

from rotorid.data.record import STANDARD_UNITS
from rotorid.errors import ModelError, nearest_name
from rotorid.models.equations import structure_from_equations
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import Parameter, ParameterSet, is_parameter_unit, no_such
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, nonlinear_from_toml
from rotorid.units import STANDARD_GRAVITY_M_S2

_SUFFIX = ".toml"


def model_names() -> tuple[str, ...]:
    """Names of the models in the library, sorted.

    Examples
    --------
    >>> [name for name in model_names() if name.startswith("hover")]
    ['hover.full', 'hover.lateral', 'hover.longitudinal']
    """
    folder = files("rotorid.models").joinpath("library")
    return tuple(sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX)))


def library_text(name: str) -> str:
    """The file of a model as it ships, comments included: what a user copies to write a model of one's own.

    Parameters
    ----------
    name
        One of :func:`model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> print(library_text("rig.roll").splitlines()[0])
    # Roll of a quadrotor on a pivot without friction, driven by two opposite motors, each with its own delay.
    """
    names = model_names()
    if name not in names:
        near = nearest_name(name, names)
        raise ModelError(
            f"the library has no model {name!r}",
            needed=f"one of {', '.join(names)}",
            remedy=f"did you mean {near}?" if near else "",
        )
    return files("rotorid.models").joinpath("library", name + _SUFFIX).read_text(encoding="utf-8")


def library_model(name: str) -> LinearStructure:
    """A model of the library, its parameters at typical start values.

    Parameters
    ----------
    name
        One of :func:`model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> library_model("axis.yaw").parameters.names
    ('N_yaw', 'N_spin', 'N_r', 'tau_yaw', 'T_motor')
    """
    return from_toml(library_text(name), where=f"the model {name}")


_FOLDER = "nonlinear_library"


def nonlinear_model_names() -> tuple[str, ...]:
    """Names of the nonlinear models in the library, sorted.

    Examples
    --------
    >>> nonlinear_model_names()
    ('drag.linear', 'drag.quadratic', 'flight.first_order', 'flight.first_order_limit')
    """
    folder = files("rotorid.models").joinpath(_FOLDER)
    written = [file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX)]
    return tuple(sorted([*written, f"{_UNLIMITED}_limit"]))


def nonlinear_library_text(name: str) -> str:
    """The file of a nonlinear model as it ships, comments included.

    Raises
    ------
    ModelError
        There is no such model.
    """
    names = nonlinear_model_names()
    if name not in names:
        error = no_such("nonlinear model", name, names)
        raise ModelError(error.came, needed=error.needed, remedy=error.remedy)
    if name == f"{_UNLIMITED}_limit":
        return _with_thrust_limit(nonlinear_library_text(_UNLIMITED))
    return files("rotorid.models").joinpath(_FOLDER, name + _SUFFIX).read_text(encoding="utf-8")


_UNLIMITED = "flight.first_order"
THRUST_LIMIT = "n_max"
"""Highest thrust over weight; no parameter of a model without a limit."""

_CLIMB = "(K_down*velocity_down_setpoint - velocity_down)"
_AT_LIMIT = f"g*(1 - {THRUST_LIMIT}*cos(phi)*cos(theta))"


def _with_thrust_limit(text: str) -> str:
    """The same flight where thrust ends at a multiple of the weight: the larger of two downward accelerations."""
    larger = f"0.5*({_CLIMB}/T_down + {_AT_LIMIT} + abs({_CLIMB}/T_down - {_AT_LIMIT}))"
    text = text.replace("attitude controller, from", "attitude controller with limited thrust, from", 1)
    text = text.replace(f'name = "{_UNLIMITED}"', f'name = "{_UNLIMITED}_limit"')
    text = text.replace(f"T_down*velocity_down' = {_CLIMB[1:-1]}", f"velocity_down' = {larger}")
    return f'{text}\n[parameters.{THRUST_LIMIT}]\nvalue = 2.0\nunit = "1"\nlower = 1.0\nupper = 100.0\n'


def nonlinear_model(name: str) -> NonlinearStructure:
    """A nonlinear model of the library, its parameters at typical start values.

    Parameters
    ----------
    name
        One of :func:`nonlinear_model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> nonlinear_model("drag.linear").parameters.names
    ('k_Dx', 'k_Dy')
    """
    return nonlinear_from_toml(nonlinear_library_text(name), where=f"the model {name}")


MOTOR_LAG = "T_motor"
SPIN_UP = "N_spin"


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

_RATE_SOURCE = (
    "Tischler and Remple, Aircraft and Rotorcraft System Identification, AIAA; first-order rate response in hover"
)


def rate_model(name: str) -> LinearStructure:
    """The rate model ``rate.roll``, ``rate.pitch``, ``rate.yaw`` or ``rate.vertical``.

    Yaw has the reaction to the spin-up of the rotors besides, as ``axis.yaw``: above a few rad/s it turns many vehicles
    more than drag does, and what lacks it takes it for control power and damping. Of light rotors it is dropped.

    Parameters
    ----------
    name
        One of these.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> rate_model("rate.roll").parameters.names
    ('L_roll', 'L_p', 'T_motor', 'tau_roll')
    >>> rate_model("rate.yaw").parameters.names
    ('N_yaw', 'N_spin', 'N_r', 'T_motor', 'tau_yaw')
    """
    if name not in RATE_AXES:
        raise ModelError(f"there is no model {name!r}", needed=f"one of {', '.join(RATE_AXES)}")
    axis = RATE_AXES[name]
    lead = [Parameter(name=SPIN_UP, value=0.5, unit="rad/s", lower=0.0)] if axis.input == "yaw_command" else []
    vertical = name == "rate.vertical"
    parameters = (
        Parameter(name=axis.gain, value=-10.0 if vertical else 100.0, unit=axis.gain_unit),
        *lead,
        Parameter(name=axis.damping, value=-1.0, unit="1/s", lower=-200.0, upper=0.0, starts=(-0.5, -4.0)),
        Parameter(name=MOTOR_LAG, value=0.03, unit="s", lower=0.0, upper=2.0, starts=(0.01, 0.04, 0.1)),
        Parameter(name=axis.delay, value=0.01, unit="s", lower=0.0, upper=1.0, starts=(0.002, 0.02, 0.06)),
    )
    left = f"{axis.state}'" + (f" - {SPIN_UP}*motor'" if lead else "")
    lag = f"{MOTOR_LAG}*motor' = -motor + {axis.input}"
    return structure_from_equations(
        name=name,
        inputs=(axis.input,),
        states=(axis.state, "motor"),
        equations=(f"{left} = {axis.damping}*{axis.state} + {axis.gain}*motor", lag),
        outputs=(f"{axis.output} = {axis.state}'" if vertical else axis.output,),
        delays={axis.input: axis.delay},
        parameters=ParameterSet(parameters),
        gain=axis.gain,
        optional=(*(parameter.name for parameter in lead), MOTOR_LAG),
        source=_RATE_SOURCE,
    )


_SETPOINT = "_setpoint"
_RESPONSE_SOURCE = "Bebop 2 with random binary signals, eqs 15 and 16; second order in gain, frequency and damping"


@dataclass(frozen=True, kw_only=True)
class _Form:
    """What the responses of a model are made of."""

    order: int
    zero: bool = False
    delay: bool = False


_FORMS = MappingProxyType(
    {
        "response.first_order": _Form(order=1),
        "response.first_order_delay": _Form(order=1, delay=True),
        "response.second_order": _Form(order=2),
        "response.second_order_delay": _Form(order=2, delay=True),
        "response.second_order_zero": _Form(order=2, zero=True),
        "response.second_order_zero_delay": _Form(order=2, zero=True, delay=True),
    }
)
RESPONSE_MODELS: tuple[str, ...] = tuple(_FORMS)
"""Names that :func:`response_model` knows."""


def response_pairs(channel_names: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Pairs of set-point and response that a log offers.

    Parameters
    ----------
    channel_names
        Names of its channels.

    Returns
    -------
    tuple
        ``(setpoint, response)`` of every channel that has both, in the order of the vocabulary, then others by name.

    Examples
    --------
    >>> response_pairs(["phi", "phi_setpoint", "theta", "r_setpoint", "velocity_down", "velocity_down_setpoint"])
    (('phi_setpoint', 'phi'), ('velocity_down_setpoint', 'velocity_down'))
    """
    logged = set(channel_names)
    known = [name for name in STANDARD_UNITS if name in logged]
    return tuple(
        (f"{name}{_SETPOINT}", name)
        for name in (*known, *sorted(logged - set(known)))
        if f"{name}{_SETPOINT}" in logged
    )


def response_model(name: str, pairs: Sequence[tuple[str, str]]) -> LinearStructure:
    r"""A model of responses to set-points, one beside the other.

    Parameters
    ----------
    name
        One of :data:`RESPONSE_MODELS`.
    pairs
        ``(setpoint, response)`` each, such as ``("phi_setpoint", "phi")``; every name once.

    Returns
    -------
    LinearStructure
        For a response ``phi`` the gain ``K_phi``, and of those that the model has: the time constant ``T_phi`` (s); the
        natural frequency ``omega_phi`` (rad/s), the damping ``zeta_phi``, above one for two real poles, and the time
        constant of the zero ``T_zero_phi`` (s), negative for an answer that begins in the wrong direction; the delay
        ``tau_phi`` (s). One response has these suffixes too.

    Raises
    ------
    ModelError
        There is no such model, no pair, or a name stands twice.

    Notes
    -----
    Delays are bounded by zero. The outputs of a record that passed a zero-phase filter while its inputs did not begin
    to answer before they were asked; a delay that ends at its bound there is a sign of it. A delay, a fast lag and a
    zero can hardly be separated with a record of low rate.

    Examples
    --------
    >>> model = response_model("response.first_order_delay", [("phi_setpoint", "phi"), ("r_setpoint", "r")])
    >>> model.parameters.names
    ('K_phi', 'T_phi', 'tau_phi', 'K_r', 'T_r', 'tau_r')
    >>> model.matrices(model.parameters.values | {"T_phi": 0.25, "T_r": 0.5}).poles().real.tolist()
    [-2.0, -4.0]
    """
    if name not in _FORMS:
        raise no_such("response model", name, RESPONSE_MODELS)
    _check(pairs)
    form = _FORMS[name]
    written = [_written(u, y, form) for u, y in pairs]
    return structure_from_equations(
        name=name,
        inputs=[u for u, _ in pairs],
        states=[state for response in written for state in response.states],
        equations=[equation for response in written for equation in response.equations],
        outputs=[response.output for response in written],
        delays={u: f"tau_{y}" for u, y in pairs} if form.delay else None,
        parameters=ParameterSet(parameter for u, y in pairs for parameter in _response_parameters(u, y, form)),
        gain=f"K_{pairs[0][1]}" if len(pairs) == 1 else None,
        source=_RESPONSE_SOURCE,
    )


@dataclass(frozen=True, kw_only=True)
class _Written:
    """The states, equations and output of one response."""

    states: tuple[str, ...]
    equations: tuple[str, ...]
    output: str


def _written(u: str, y: str, form: _Form) -> _Written:
    if form.order == 1:
        return _Written(states=(y,), equations=(f"T_{y}*{y}' = K_{y}*{u} - {y}",), output=y)
    # The states are those of the response without its zero, which is a row of the outputs.
    state, rate = f"x_{y}", f"v_{y}"
    stiffness = f"omega_{y}*omega_{y}"
    return _Written(
        states=(state, rate),
        equations=(
            f"{state}' = {rate}",
            f"{rate}' = {stiffness}*K_{y}*{u} - {stiffness}*{state} - 2*zeta_{y}*omega_{y}*{rate}",
        ),
        output=f"{y} = {state} + T_zero_{y}*{rate}" if form.zero else f"{y} = {state}",
    )


def _response_parameters(u: str, y: str, form: _Form) -> list[Parameter]:
    chosen = [Parameter(name=f"K_{y}", value=1.0, unit=_gain_unit(u, y), essential=True)]
    if form.order == 1:
        chosen += [
            Parameter(
                name=f"T_{y}", value=0.2, unit="s", lower=1e-3, upper=100.0, starts=(0.05, 0.2, 1.0), essential=True
            )
        ]
    else:
        chosen += [
            Parameter(
                name=f"omega_{y}",
                value=5.0,
                unit="rad/s",
                lower=0.01,
                upper=1000.0,
                starts=(1.5, 5.0, 15.0),
                essential=True,
            ),
            Parameter(
                name=f"zeta_{y}", value=0.8, unit="1", lower=0.0, upper=20.0, starts=(0.4, 0.8, 1.5), essential=True
            ),
        ]
    if form.zero:
        chosen += [
            Parameter(name=f"T_zero_{y}", value=0.05, unit="s", lower=-10.0, upper=10.0, starts=(-0.05, 0.05, 0.2))
        ]
    if form.delay:
        chosen += [Parameter(name=f"tau_{y}", value=0.05, unit="s", lower=0.0, upper=1.0, starts=(0.01, 0.05, 0.15))]
    return chosen


def _gain_unit(u: str, y: str) -> str:
    """Unit of the response over that of the set-point; one where the vocabulary does not have them."""
    above, below = STANDARD_UNITS.get(y, "1"), STANDARD_UNITS.get(u, "1")
    if above == below:
        return "1"
    joined = above if below == "1" else f"{above}/({below})" if " " in below else f"{above}/{below}"
    return joined if is_parameter_unit(joined) else "1"


def _check(pairs: Sequence[tuple[str, str]]) -> None:
    names = [name for pair in pairs for name in pair]
    if not pairs:
        raise ModelError("got no pair of set-point and response", needed="one and more, such as phi_setpoint and phi")
    if twice := [name for name in names if names.count(name) > 1]:
        raise ModelError(f"{twice[0]} stands twice in the pairs", needed="an input of its own for every response")


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
        The orders are impossible, or a name is not allowed in an equation.

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
    equations = [
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
        outputs=equations,
        delays=delays,
        parameters=ParameterSet(
            _coefficients_of(numerator, denominator, tuple(tails.values()), tuple(delays.values()))
        ),
        gain="b0" if single and numerator == 0 else None,
        source="controllable canonical form",
    )


def _feedback(states: Sequence[str], u: str) -> str:
    """What the derivative of the last state is."""
    return "".join(f"-a{k}*{x} " for k, x in enumerate(states)) + f"+ {u}"


def _coefficients_of(
    numerator: int, denominator: int, tails: tuple[str, ...], delays: tuple[str, ...]
) -> list[Parameter]:
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
