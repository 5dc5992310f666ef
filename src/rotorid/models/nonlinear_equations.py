"""Nonlinear structures from their equations as a paper prints them: ``vx' = -k*vx + (g + vz')*tan(theta)``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rotorid.errors import ModelError
from rotorid.models.equations import Symbols
from rotorid.models.expression import Expression
from rotorid.models.expression_parser import is_symbol, parse_expression
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.models.ties import no_such


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
    seen = [output(text, symbols, rates) for text in outputs]
    late = {key: Expression.parse(value) for key, value in (delays or {}).items()}
    for key in late:
        check_late(key, symbols)
    return NonlinearStructure(
        name=name,
        inputs=symbols.inputs,
        states=symbols.states,
        outputs=tuple(one for one, _ in seen),
        equations=tuple(rates[f"{state}'"] for state in symbols.states),
        output_equations=tuple(expression for _, expression in seen),
        input_delays=tuple(late.get(key, Expression()) for key in symbols.inputs),
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
    said: dict[str, Expression] = {}
    for derivative, expression in rows:
        if derivative in said:
            raise ModelError(f"two equations say what {derivative} is", needed="one equation for each state")
        said[derivative] = expression
    if lost := [f"{state}'" for state in states if f"{state}'" not in said]:
        raise ModelError(f"no equation says what {' and '.join(lost)} is", needed="one equation for each state")
    done: dict[str, Expression] = {}

    def resolve(derivative: str, path: tuple[str, ...]) -> Expression:
        if derivative in path:
            loop = " -> ".join([*path[path.index(derivative) :], derivative])
            raise ModelError(f"the derivatives go in a loop: {loop}", remedy="solve the equations for them")
        if derivative not in done:
            inner = sorted(name for name in said[derivative].names if name.endswith("'"))
            meant = {name: resolve(name, (*path, derivative)) for name in inner}
            done[derivative] = said[derivative].substitute(meant)
        return done[derivative]

    for derivative in said:
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
            remedy = f"{error.remedy} or say what it is: 'name = ...'".strip()
            raise ModelError(error.came, needed=error.needed, remedy=remedy)
        return name, Expression.symbol(name)
    name, right = (part.strip() for part in text.split("=", 1))
    if not is_symbol(name):
        raise ModelError(f"the output {text!r} has no name", needed="a name in front of the first =")
    expression = parse_expression(right, derivatives=True)
    _check_names(expression, symbols, text)
    return name, expression.substitute(dict(rates))


def check_late(name: str, symbols: Symbols) -> None:
    """See that a name that is said to be late is an input.

    Raises
    ------
    ModelError
        It is not.
    """
    if name not in symbols.inputs:
        error = no_such("input", name, symbols.inputs)
        raise ModelError(error.came, needed=error.needed, remedy=error.remedy)


def _check_names(expression: Expression, symbols: Symbols, text: str) -> None:
    known = (*symbols.states, *symbols.derivatives, *symbols.inputs, *symbols.coefficients)
    for name in sorted(expression.names - set(known)):
        if name.endswith("'") and name[:-1] in known:
            raise ModelError(f"{name} stands in {text!r}", needed="derivatives of states only")
        unknown = no_such("symbol", name, known)
        raise ModelError(f"{name} in {text!r} is not known", needed=unknown.needed, remedy=unknown.remedy)
