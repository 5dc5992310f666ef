r"""Responses to set-points: what an autopilot with the vehicle below it makes of a command, channel by channel.

.. math::

    \text{first order:}\quad & T \dot y = K u(t - \tau) - y \\
    \text{second order:}\quad & \frac{y}{u} = \frac{K \omega^2 (1 + T_{zero} s)}{s^2 + 2 \zeta \omega s + \omega^2}
        \, e^{-\tau s}

Each response has an input of its own, and any number of them stand side by side without touching each other: that an
axis does not answer to the command of another is an assumption, and :mod:`rotorid.signal.cross_terms` puts it to the
test. The autopilot is inside: another tuning of it is another model.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from rotorid.data.channel import STANDARD_UNITS
from rotorid.errors import ModelError
from rotorid.models.equations import structure_from_equations
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.parameter_unit import is_parameter_unit
from rotorid.models.structure import LinearStructure
from rotorid.models.ties import no_such

_SETPOINT = "_setpoint"
_SOURCE = "Bebop 2 with random binary signals, eqs 15 and 16; second order in gain, frequency and damping"


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
    zero are hardly told apart by a record whose rate is low.

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
        states=[state for one in written for state in one.states],
        equations=[equation for one in written for equation in one.equations],
        outputs=[one.output for one in written],
        delays={u: f"tau_{y}" for u, y in pairs} if form.delay else None,
        parameters=ParameterSet(parameter for u, y in pairs for parameter in _parameters(u, y, form)),
        gain=f"K_{pairs[0][1]}" if len(pairs) == 1 else None,
        source=_SOURCE,
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


def _parameters(u: str, y: str, form: _Form) -> list[Parameter]:
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
        raise ModelError("no pair of set-point and response came", needed="one and more, such as phi_setpoint and phi")
    if twice := [name for name in names if names.count(name) > 1]:
        raise ModelError(f"{twice[0]} stands twice in the pairs", needed="an input of its own for every response")
