"""Nonlinear structures: equations of states, inputs and parameters, without data or results.

Written as a paper prints them, ``vx' = -k*vx + (g + vz')*tan(theta)``, and solved for the derivatives. One that many
need is a multirotor under its own attitude controller, from any linear model of each axis to speeds and positions
(:func:`flight_structure`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.models.compiled import Entries, Tape, tape
from rotorid.models.equations import Symbols, check_delayed
from rotorid.models.expression import Expression, is_symbol, parse_expression
from rotorid.models.parameter import Parameter, ParameterSet, changed_constants, no_such
from rotorid.models.structure import LinearStructure, Row, silent_structure
from rotorid.typing import FloatArray, IntArray

_REST = 1e-9
"""Rate of a state, in its units, below which it rests."""


class Program(NamedTuple):
    """Expressions as a tape, with their derivatives.

    Parameters
    ----------
    tape
        The expressions come first among its results.
    size
        How many expressions there are.
    slopes
        Derivatives that are not zero everywhere: row of the expression, column of the name and slot of the value,
        shape ``(m, 3)``. Names count in the order states, inputs, parameters.
    """

    tape: Tape
    size: int
    slopes: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearStructure(Immutable):
    r"""Ordinary differential equations with parameters.

    .. math:: \dot x = f(x, u(t - \tau), \theta), \qquad y = g(x, u(t - \tau), \theta)

    Parameters
    ----------
    name
        Name of the model.
    inputs, states, outputs
        Channel names; states are free to choose.
    equations
        :math:`f`, one expression for each state, of states, inputs, parameters and constants.
    output_equations
        :math:`g`, one expression for each output.
    input_delays
        :math:`\tau`, one expression of parameters and constants for each input, seconds.
    parameters
        All parameters with units, bounds and start values.
    constants
        Numbers that are no parameters, such as gravity.
    starts
        What the first sample says of an initial state: an expression of outputs, inputs and constants. The initial
        value of a state that is not named here is unknown.
    source
        Where the structure comes from.

    Raises
    ------
    ModelError
        The numbers of names and expressions differ, a name means two things, an expression names something unknown,
        or a parameter that is not dropped stands nowhere.
    """

    name: str
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    equations: Row
    output_equations: Row
    input_delays: Row
    parameters: ParameterSet
    constants: Mapping[str, float] = field(default_factory=dict)
    starts: Mapping[str, Expression] = field(default_factory=dict)
    source: str = ""

    def __post_init__(self) -> None:
        pairs = (
            ("states", self.states, "equations", self.equations),
            ("outputs", self.outputs, "output equations", self.output_equations),
            ("inputs", self.inputs, "input delays", self.input_delays),
        )
        for kind, names, label, expressions in pairs:
            if len(names) != len(expressions):
                raise ModelError(f"{self.name} has {len(expressions)} {label} for {len(names)} {kind}")
            if len(set(names)) < len(names):
                raise ModelError(f"{self.name}: the {kind} are {', '.join(names)}", needed="every name once")
        if not self.states or not self.outputs:
            raise ModelError(f"{self.name} has no states or no outputs", needed="at least one of each")
        every = (*self.states, *self.inputs, *self.parameters.names, *self.constants)
        if both := sorted({name for name in every if every.count(name) > 1}):
            raise ModelError(f"{self.name}: {both[0]} means two things", needed="different names")
        if odd := [name for name, value in self.constants.items() if not math.isfinite(value)]:
            raise ModelError(f"{self.name}: the constant {odd[0]} is {self.constants[odd[0]]}", needed="finite numbers")
        constants = dict(self.constants)
        parameters = self.parameters
        if constants != parameters.constants:
            parameters = parameters.with_constants(constants)
        self._set(constants=constants, parameters=parameters, starts=self.starts)
        self._check_names()

    def _check_names(self) -> None:
        coefficients = (*self.parameters.names, *self.constants)
        moving = (*self.states, *self.inputs, *coefficients)
        measured = (*dict.fromkeys((*self.outputs, *self.inputs)), *self.constants)
        for state in self.starts:
            if state not in self.states:
                raise no_such("state", state, self.states)
        checks = (
            ((*self.equations, *self.output_equations), moving),
            (self.input_delays, coefficients),
            (tuple(self.starts.values()), measured),
        )
        for expressions, known in checks:
            for expression in expressions:
                for name in sorted(expression.names - set(known)):
                    error = no_such("symbol", name, known)
                    came = f"{self.name}: {name} in {expression} is not known"
                    raise ModelError(came, needed=error.needed, remedy=error.remedy)
        used = frozenset().union(*(e.names for e in (*self.equations, *self.output_equations, *self.input_delays)))
        reached = self.parameters.only(name for name in self.parameters.names if name in used).names
        if lost := [p.name for p in self.parameters if p.name not in reached and p.status != "dropped"]:
            raise ModelError(f"{self.name}: {', '.join(sorted(lost))} is in no equation", remedy="remove it")

    def with_constants(self, constants: Mapping[str, float]) -> NonlinearStructure:
        """The same structure with other values of some constants.

        Raises
        ------
        ModelError
            There is no such constant, or a value is not finite.
        """
        changed = changed_constants(self.constants, constants)
        return replace(self, constants=changed, parameters=self.parameters.with_constants(changed))

    def select(self, outputs: Sequence[str]) -> NonlinearStructure:
        """The structure of some outputs only, in the order given.

        States that none of them sees are left out, and parameters that then stand nowhere. Inputs stay; one that no
        longer acts has no delay. A start that only an output left out could say is unknown.

        Raises
        ------
        ModelError
            There is no such output, or it was named twice.
        """
        for name in outputs:
            if name not in self.outputs:
                raise no_such("output", name, self.outputs)
        known = {*outputs, *self.inputs, *self.constants}
        chosen = tuple(self.output_equations[self.outputs.index(name)] for name in outputs)
        rates = dict(zip(self.states, self.equations, strict=True))
        used_names = frozenset().union(*(expression.names for expression in chosen))
        while found := frozenset().union(*(rates[state].names for state in used_names & rates.keys())) - used_names:
            used_names |= found
        pairs = zip(self.inputs, self.input_delays, strict=True)
        delays = tuple(delay if name in used_names else Expression() for name, delay in pairs)
        used = used_names.union(*(delay.names for delay in delays))
        return replace(
            self,
            states=tuple(state for state in self.states if state in used_names),
            outputs=tuple(outputs),
            equations=tuple(rates[state] for state in self.states if state in used_names),
            output_equations=chosen,
            input_delays=delays,
            starts={state: s for state, s in self.starts.items() if state in used_names and s.names <= known},
            parameters=self.parameters.only(name for name in self.parameters.names if name in used),
        )

    def delays(self, values: Mapping[str, float]) -> FloatArray:
        """The delays of the inputs in seconds, shape ``(u,)``.

        Raises
        ------
        ModelError
            A delay has no finite value there.
        """
        return self._delays.at(values)

    def delays_and_jacobian(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The delays, shape ``(u,)``, and their derivatives by all parameters, shape ``(u, parameters)``."""
        delays, slopes = self._delays.with_slopes(values)
        jacobian = np.zeros((len(self.inputs), len(self.parameters)))
        jacobian[self._delays.moving] = slopes
        return delays, jacobian

    def measured_start(self, outputs: FloatArray, inputs: FloatArray) -> FloatArray:
        """What the first sample says of the initial states, shape ``(x,)``; not a number where it says nothing.

        Parameters
        ----------
        outputs, inputs
            Their values there, shapes ``(y,)`` and ``(u,)``. An input that is also an output counts as measured.
        """
        values = dict(self.constants)
        values |= dict(zip(self.inputs, inputs.tolist(), strict=True))
        values |= dict(zip(self.outputs, outputs.tolist(), strict=True))
        return np.array(
            [self.starts[state].evaluate(values) if state in self.starts else np.nan for state in self.states]
        )

    def reached(self, names: Iterable[str]) -> frozenset[str]:
        """States that some inputs or states move, directly or through others.

        Examples
        --------
        >>> from rotorid.models.library import nonlinear_model
        >>> sorted(nonlinear_model("flight.first_order").reached(["r_setpoint"]))[-2:]
        ['velocity_east', 'velocity_north']
        """
        rates = dict(zip(self.states, self.equations, strict=True))
        given = frozenset(names)
        found: frozenset[str] = frozenset()
        while new := frozenset(state for state, rate in rates.items() if rate.names & (found | given)) - found:
            found |= new
        return found

    @cached_property
    def _delays(self) -> Entries:
        return Entries(self.input_delays, self.parameters.names, self.constants)

    @cached_property
    def dynamics(self) -> Program:
        """The equations of the states, with derivatives."""
        return self._program(self.equations, slopes=True)

    @cached_property
    def measurement(self) -> Program:
        """The equations of the outputs, with derivatives."""
        return self._program(self.output_equations, slopes=True)

    @cached_property
    def plain(self) -> tuple[Program, Program]:
        """The equations of states and of outputs, without derivatives."""
        return self._program(self.equations, slopes=False), self._program(self.output_equations, slopes=False)

    def _program(self, written: Row, *, slopes: bool) -> Program:
        moving, still = (*self.states, *self.inputs), self.parameters.names
        column = {name: slot for slot, name in enumerate((*moving, *still))}
        expressions = [expression.substitute(self.constants) for expression in written]
        found = [
            (row, column[name], slope)
            for row, expression in enumerate(expressions)
            for name in sorted(expression.names, key=column.__getitem__)
            if slopes and not (slope := expression.derivative(name)).is_zero
        ]
        whole = tape([*expressions, *(slope for _, _, slope in found)], moving, still)
        slots = whole.results[len(expressions) :]
        table = [(row, place, slot) for (row, place, _), slot in zip(found, slots.tolist(), strict=True)]
        return Program(whole, len(expressions), np.array(table, dtype=np.int64).reshape(-1, 3))


def about_rest(structure: NonlinearStructure) -> LinearStructure:
    r"""The linear structure of small motion about rest, with the same parameters.

    .. math:: \dot x = \frac{\partial f}{\partial x} x + \frac{\partial f}{\partial u} u(t - \tau), \qquad
        y = \frac{\partial g}{\partial x} x

    at zero states and inputs; the derivatives are those of the equations, exact. Parameters that act on larger motion
    only, such as a drag that is quadratic in the speed, do not stand in it.

    Parameters
    ----------
    structure
        The nonlinear one.

    Raises
    ------
    ModelError
        Zero states do not rest, the equations have no derivative there, or an output follows an input at once.

    Examples
    --------
    >>> from rotorid.models.library import nonlinear_model
    >>> hover = about_rest(nonlinear_model("flight.first_order"))
    >>> hover.matrices(hover.parameters.values).poles().real.round(2).tolist()
    [0.0, 0.0, 0.0, 0.0, -0.25, -0.33, -5.0, -5.0, -5.0, -5.0]
    """
    zero = dict.fromkeys((*structure.states, *structure.inputs), 0.0)
    values = {**structure.constants, **structure.parameters.values}
    moving = (*structure.equations, *structure.output_equations)
    if any(abs(expression.substitute(zero).evaluate(values)) > _REST for expression in moving):
        raise ModelError(f"{structure.name} does not rest at zero", needed="equations that are zero there")

    def slopes(rows: Row, names: Sequence[str]) -> tuple[Row, ...]:
        return tuple(tuple(row.derivative(name).substitute(zero) for name in names) for row in rows)

    through = [
        expression
        for row in slopes(structure.output_equations, structure.inputs)
        for expression in row
        if not expression.is_zero
    ]
    if any(expression.evaluate(values) != 0.0 for expression in through):
        raise ModelError(f"an output of {structure.name} follows an input at once", needed="outputs of states")
    F, G = (slopes(structure.equations, names) for names in (structure.states, structure.inputs))
    H0 = slopes(structure.output_equations, structure.states)
    order = range(len(structure.states))
    entries = [entry for rows in (F, G, H0, (structure.input_delays,)) for row in rows for entry in row]
    used = frozenset().union(*(entry.names for entry in entries))
    return LinearStructure(
        name=structure.name,
        inputs=structure.inputs,
        states=structure.states,
        outputs=structure.outputs,
        M=tuple(tuple(Expression.constant(float(i == j)) for j in order) for i in order),
        F=F,
        G=G,
        H0=H0,
        H1=tuple((Expression(),) * len(structure.states) for _ in structure.outputs),
        input_delays=structure.input_delays,
        output_delays=(Expression(),) * len(structure.outputs),
        parameters=structure.parameters.only(name for name in structure.parameters.names if name in used),
        constants=structure.constants,
        source=structure.source,
    )


def linear_of(structure: NonlinearStructure) -> LinearStructure:
    """Small motion about rest as :func:`about_rest` has it; its names alone where there is no such motion."""
    try:
        found = about_rest(structure)
        found.matrices(found.parameters.values)
    except ModelError:
        names = {kind: getattr(structure, kind) for kind in ("inputs", "states", "outputs")}
        return silent_structure(structure.name, **names)
    return found


def nonlinear_structure(
    *,
    name: str,
    inputs: Sequence[str],
    states: Sequence[str],
    equations: Sequence[str],
    outputs: Sequence[str],
    parameters: ParameterSet,
    delays: Mapping[str, str | float] | None = None,
    constants: Mapping[str, float] | None = None,
    starts: Mapping[str, str | float] | None = None,
    source: str = "",
) -> NonlinearStructure:
    """A nonlinear structure from its equations.

    Parameters
    ----------
    name
        Name of the model.
    inputs, states
        Names of the inputs and of the states.
    equations
        One for each state: its derivative, written with a prime, on the left, times a factor where it has one. On the
        right any expression of states, inputs, parameters and constants; a derivative there stands for what its own
        equation says.
    outputs
        A state's name, or ``name = ...`` with an expression, derivatives included.
    parameters
        Every parameter.
    delays
        Delays of inputs, by their names; zero for the others.
    constants, source
        See :class:`~rotorid.models.nonlinear.NonlinearStructure`.
    starts
        What the first sample says of the states, as expressions of outputs, inputs and constants.

    Raises
    ------
    ModelError
        An equation cannot be read, names something unknown, stands twice or is missing, or derivatives go in a loop.

    Examples
    --------
    >>> from rotorid.models.parameter import Parameter
    >>> pendulum = nonlinear_structure(
    ...     name="pendulum", inputs=["torque"], states=["angle", "rate"],
    ...     equations=["angle' = rate", "J*rate' = torque - 2*sin(angle)"], outputs=["angle"],
    ...     parameters=ParameterSet([Parameter(name="J", value=0.1, unit="kg m^2")]), starts={"angle": "angle"})
    >>> [str(equation) for equation in pendulum.equations]
    ['rate', '(torque - 2*sin(angle))/J']
    """
    symbols = Symbols(tuple(inputs), tuple(states), (*parameters.names, *(constants or {})))
    for symbol in (*inputs, *states, *symbols.coefficients):
        symbols.check(symbol)
    rates = explicit([equation(text, symbols) for text in equations], symbols.states)
    output_equations = [output(text, symbols, rates) for text in outputs]
    delayed = {key: Expression.parse(value) for key, value in (delays or {}).items()}
    for key in delayed:
        check_delayed(key, symbols.inputs)
    return NonlinearStructure(
        name=name,
        inputs=symbols.inputs,
        states=symbols.states,
        outputs=tuple(key for key, _ in output_equations),
        equations=tuple(rates[f"{state}'"] for state in symbols.states),
        output_equations=tuple(expression for _, expression in output_equations),
        input_delays=tuple(delayed.get(key, Expression()) for key in symbols.inputs),
        parameters=parameters,
        constants=constants or {},
        starts={state: Expression.parse(value) for state, value in (starts or {}).items()},
        source=source,
    )


def equation(text: str, symbols: Symbols) -> tuple[str, Expression]:
    """The derivative that an equation says, with its prime, and what it is.

    Raises
    ------
    ModelError
        It is no such equation.
    """
    sides = text.split("=")
    if len(sides) != 2:
        raise ModelError(f"the equation {text!r} has {len(sides) - 1} signs of equality", needed='one: "x\' = ..."')
    left, right = (parse_expression(side, derivatives=True) for side in sides)
    for side in (left, right):
        _check_names(side, symbols, text)
    rest, factors = left.linear_in(frozenset(symbols.derivatives))
    if len(factors) != 1 or not rest.is_zero:
        raise ModelError(
            f"the left side of {text!r} is {left}", needed="one derivative, times a factor where it has one"
        )
    ((derivative, factor),) = factors.items()
    return derivative, right / factor


def explicit(rows: Iterable[tuple[str, Expression]], states: Sequence[str]) -> dict[str, Expression]:
    """What each derivative is, without any derivatives on the right.

    Raises
    ------
    ModelError
        A derivative has two equations or none, or derivatives stand for each other in a loop.
    """
    solved: dict[str, Expression] = {}
    for derivative, expression in rows:
        if derivative in solved:
            raise ModelError(f"two equations define {derivative}", needed="one equation for each state")
        solved[derivative] = expression
    if lost := [f"{state}'" for state in states if f"{state}'" not in solved]:
        raise ModelError(f"no equation defines {' and '.join(lost)}", needed="one equation for each state")
    done: dict[str, Expression] = {}

    def resolve(derivative: str, path: tuple[str, ...]) -> Expression:
        if derivative in path:
            loop = " -> ".join([*path[path.index(derivative) :], derivative])
            raise ModelError(f"the derivatives go in a loop: {loop}", remedy="solve the equations for them")
        if derivative not in done:
            inner = sorted(name for name in solved[derivative].names if name.endswith("'"))
            meant = {name: resolve(name, (*path, derivative)) for name in inner}
            done[derivative] = solved[derivative].substitute(meant)
        return done[derivative]

    for derivative in solved:
        resolve(derivative, ())
    return done


def output(text: str, symbols: Symbols, rates: Mapping[str, Expression]) -> tuple[str, Expression]:
    """Name of an output, and what it is.

    Raises
    ------
    ModelError
        It is neither the name of a state nor a name and what it is.
    """
    if "=" not in text:
        name = text.strip()
        if name not in symbols.states:
            error = no_such("state", name, symbols.states)
            remedy = f"{error.remedy} or define it: 'name = ...'".strip()
            raise ModelError(error.came, needed=error.needed, remedy=remedy)
        return name, Expression.symbol(name)
    name, right = (part.strip() for part in text.split("=", 1))
    if not is_symbol(name):
        raise ModelError(f"the output {text!r} has no name", needed="a name in front of the first =")
    expression = parse_expression(right, derivatives=True)
    _check_names(expression, symbols, text)
    return name, expression.substitute(dict(rates))


def _check_names(expression: Expression, symbols: Symbols, text: str) -> None:
    known = (*symbols.states, *symbols.derivatives, *symbols.inputs, *symbols.coefficients)
    for name in sorted(expression.names - set(known)):
        if name.endswith("'") and name[:-1] in known:
            raise ModelError(f"{name} is not allowed in {text!r}", needed="derivatives of states only")
        unknown = no_such("symbol", name, known)
        raise ModelError(f"{name} in {text!r} is not known", needed=unknown.needed, remedy=unknown.remedy)


AXES = ("phi", "theta", "psi_dot", "velocity_down")
"""What the attitude controller is commanded: two angles, the yaw rate and the vertical speed."""

_DRAG = ("k_Dx", "k_Dy")
_PLAIN = ("north", "east", "down", "velocity_north", "velocity_east")
_OUTPUTS = ("north", "east", "down", "velocity_north", "velocity_east", "velocity_down", "phi", "theta", "psi")
_FORWARD = "(velocity_north*cos(psi) + velocity_east*sin(psi) - velocity_down*tan(theta))"
_RIGHT = "(velocity_east*cos(psi) - velocity_north*sin(psi) + velocity_down*tan(phi)/cos(theta))"
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
        parameters=ParameterSet((*drag, *(parameter for part in parts.values() for parameter in part.parameters))),
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
    new = {known: Expression.symbol(f"{known}_{axis}") for known in model.parameters.names}
    inside: dict[str, Expression | float] = {**model.constants, **new}
    signals = [Expression.symbol(state) for state in (*states, *model.inputs)]
    rates = dict.fromkeys(range(len(states)), Expression())
    for (j,), M, F, G in zip(lags, model.M, model.F, model.G, strict=True):
        rates[j] = _total((*F, *G), signals, inside) / M[j].substitute(inside)
    ordered = tuple(rates[j] for j in range(len(states)))
    output = _total((*model.H0[0], *model.H1[0]), [*signals[:-1], *ordered], inside)
    parameters = tuple(
        replace(
            parameter,
            name=f"{parameter.name}_{axis}",
            tied=parameter.tied.substitute(inside) if parameter.tied is not None else None,
        )
        for parameter in model.parameters
    )
    delay = (model.input_delays[0] + model.output_delays[0]).substitute(inside)
    return _Part(model.inputs[0], states, ordered, output, delay, parameters)


def _total(factors: Row, signals: list[Expression], inside: Mapping[str, Expression | float]) -> Expression:
    terms = (factor.substitute(inside) * signal for factor, signal in zip(factors, signals, strict=True))
    return sum(terms, Expression())
