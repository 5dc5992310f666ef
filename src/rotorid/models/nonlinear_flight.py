"""A multirotor under its own attitude controller, from any linear model of each axis to speeds and positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from rotorid.errors import ModelError
from rotorid.models.condense import Row
from rotorid.models.expression import Expression
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.ties import no_such

AXES = ("phi", "theta", "psi_dot", "velocity_down")
"""What the attitude controller is commanded: two angles, the yaw rate and the vertical speed."""

_DRAG = ("k_Dx", "k_Dy")
_PLAIN = ("north", "east", "down", "velocity_north", "velocity_east")
_OUTPUTS = ("north", "east", "down", "velocity_north", "velocity_east", "velocity_down", "phi", "theta", "psi")
_FORWARD = "(velocity_north*cos(psi) + velocity_east*sin(psi))"
_RIGHT = "(velocity_east*cos(psi) - velocity_north*sin(psi))"
_LIFT = "-(g - acceleration_down)"
_NORTH = (
    f"{_LIFT}*(cos(psi)*tan(theta) + sin(psi)*tan(phi)/cos(theta)) - k_Dx*cos(psi)*{_FORWARD} + k_Dy*sin(psi)*{_RIGHT}"
)
_EAST = (
    f"{_LIFT}*(sin(psi)*tan(theta) - cos(psi)*tan(phi)/cos(theta)) - k_Dx*sin(psi)*{_FORWARD} - k_Dy*cos(psi)*{_RIGHT}"
)


class _Part(NamedTuple):
    """One axis in the names of the whole: its input, states and their derivatives, its output, delay and parameters."""

    input: str
    states: tuple[str, ...]
    rates: Row
    output: Expression
    delay: Expression
    parameters: tuple[Parameter, ...]

    @property
    def output_rate(self) -> Expression:
        slopes = (self.output.derivative(name) * rate for name, rate in zip(self.states, self.rates, strict=True))
        return sum(slopes, Expression())


def flight_structure(
    axes: Mapping[str, LinearStructure],
    *,
    drag_per_s: tuple[float, float] = (0.25, 0.33),
    gravity_m_s2: float = 9.80665,
    name: str = "flight",
) -> NonlinearStructure:
    r"""The whole motion from a linear model of each axis.

    .. math:: \dot v = R_z(\psi) \left[ -(g - \dot v_d) \begin{pmatrix} \tan\theta \\ -\tan\phi / \cos\theta
        \end{pmatrix} - \begin{pmatrix} k_{Dx} & 0 \\ 0 & k_{Dy} \end{pmatrix} R_z(\psi)^T v \right]

    with v to north and east: the thrust carries the weight and the vertical acceleration, and its tilt accelerates.
    Drag is linear and acts along the heading; still air is assumed. Euler angles are in the order yaw, pitch, roll.

    Parameters
    ----------
    axes
        A model of one input and one output for ``phi``, ``theta``, ``psi_dot`` and ``velocity_down``, with the
        parameters it shall start from. States and parameters get the name of their axis: ``T`` becomes ``T_phi``.
    drag_per_s
        Start values of ``k_Dx`` and ``k_Dy``.
    gravity_m_s2
        Gravity.
    name
        Of the model.

    Returns
    -------
    NonlinearStructure
        Inputs as in ``axes``; outputs ``north``, ``east``, ``down``, their velocities, ``phi``, ``theta`` and ``psi``.
        States of an axis that are not its output have unknown starts.

    Raises
    ------
    ModelError
        An axis is missing or unknown, has several inputs or outputs, or lags that are not one for each state; or the
        vertical speed follows its command at once, so that its derivative is none.

    References
    ----------
    Bebop 2 identification from motion capture in the time domain, eqs 6 to 18 and appendix B; there with z up, and with
    :math:`v_z + g` printed for :math:`\dot v_z + g` in equation 11.

    Examples
    --------
    >>> from rotorid.models.equations import structure_from_equations
    >>> lags = {axis: structure_from_equations(
    ...     name="lag", inputs=[f"{axis}_setpoint"], states=["x"], equations=[f"T*x' = -x + {axis}_setpoint"],
    ...     outputs=["x"], parameters=ParameterSet([Parameter(name="T", value=0.2, unit="s")])) for axis in AXES}
    >>> flight = flight_structure(lags)
    >>> flight.parameters.names
    ('k_Dx', 'k_Dy', 'T_phi', 'T_theta', 'T_psi_dot', 'T_velocity_down')
    >>> len(flight.states)
    10
    """
    for axis in axes:
        if axis not in AXES:
            raise no_such("axis", axis, AXES)
    if missing := [axis for axis in AXES if axis not in axes]:
        raise ModelError(f"the flight lacks the axis {', '.join(missing)}", needed=", ".join(AXES))
    parts = {axis: _part(axis, axes[axis]) for axis in AXES}
    vertical = parts["velocity_down"]
    if vertical.input in vertical.output.names:
        raise ModelError("the vertical speed follows its command at once", needed="an output of states only")
    meant = {axis: part.output for axis, part in parts.items()}
    meant["acceleration_down"] = vertical.output_rate
    drag = tuple(Parameter(name=k, value=value, unit="1/s") for k, value in zip(_DRAG, drag_per_s, strict=True))
    parsed = {text: Expression.parse(text).substitute(meant) for text in (*_OUTPUTS, _NORTH, _EAST)}
    rates = [parsed[text] for text in ("velocity_north", "velocity_east", "velocity_down", _NORTH, _EAST)]
    inner = [state for part in parts.values() for state in part.states]
    measured = dict.fromkeys((*_PLAIN, "psi"))
    own = {str(part.output): axis for axis, part in parts.items() if axis != "psi_dot" and str(part.output) in inner}
    return NonlinearStructure(
        name=name,
        inputs=tuple(part.input for part in parts.values()),
        states=(*_PLAIN, *inner, "psi"),
        outputs=_OUTPUTS,
        equations=(*rates, *(rate for part in parts.values() for rate in part.rates), meant["psi_dot"]),
        output_equations=tuple(parsed[output] for output in _OUTPUTS),
        input_delays=tuple(part.delay for part in parts.values()),
        parameters=ParameterSet((*drag, *(one for part in parts.values() for one in part.parameters))),
        constants={"g": gravity_m_s2},
        starts={state: Expression.symbol(output) for state, output in ({s: s for s in measured} | own).items()},
        source="Bebop 2 identification from motion capture in the time domain, appendix B",
    )


def _part(axis: str, model: LinearStructure) -> _Part:
    """One axis, its names made unique."""
    if len(model.inputs) != 1 or len(model.outputs) != 1:
        came = f"the axis {axis} has {len(model.inputs)} inputs and {len(model.outputs)} outputs"
        raise ModelError(came, needed="one of each", remedy="select them")
    lags = [[j for j, entry in enumerate(row) if not entry.is_zero] for row in model.M]
    if sorted(lags) != [[j] for j in range(len(model.states))]:
        raise ModelError(f"the equations of the axis {axis} hold several derivatives", needed="one derivative in each")
    states = tuple(f"{axis}_{state}" for state in model.states)
    new = {one: Expression.symbol(f"{one}_{axis}") for one in model.parameters.names}
    inside: dict[str, Expression | float] = {**model.constants, **new}
    signals = [Expression.symbol(state) for state in (*states, *model.inputs)]
    rates = dict.fromkeys(range(len(states)), Expression())
    for (j,), M, F, G in zip(lags, model.M, model.F, model.G, strict=True):
        rates[j] = _total((*F, *G), signals, inside) / M[j].substitute(inside)
    ordered = tuple(rates[j] for j in range(len(states)))
    output = _total((*model.H0[0], *model.H1[0]), [*signals[:-1], *ordered], inside)
    parameters = tuple(
        replace(one, name=f"{one.name}_{axis}", tied=one.tied.substitute(inside) if one.tied is not None else None)
        for one in model.parameters
    )
    delay = (model.input_delays[0] + model.output_delays[0]).substitute(inside)
    return _Part(model.inputs[0], states, ordered, output, delay, parameters)


def _total(factors: Row, signals: list[Expression], inside: Mapping[str, Expression | float]) -> Expression:
    terms = (factor.substitute(inside) * signal for factor, signal in zip(factors, signals, strict=True))
    return sum(terms, Expression())
