"""Structures from the equations as a paper prints them: ``q' = M_q*q + M_u*u + M_pitch*pitch_command``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import NamedTuple

from rotorid.errors import ModelError
from rotorid.models.expression import Expression, is_symbol, parse_expression
from rotorid.models.parameter import ParameterSet, no_such
from rotorid.models.structure import LinearStructure, Row


class Symbols(NamedTuple):
    """The names that may stand in the equations of one model."""

    inputs: tuple[str, ...]
    states: tuple[str, ...]
    coefficients: tuple[str, ...]
    """Parameters and constants."""

    @property
    def derivatives(self) -> tuple[str, ...]:
        return tuple(f"{state}'" for state in self.states)

    @property
    def moving(self) -> frozenset[str]:
        return frozenset((*self.states, *self.derivatives, *self.inputs))

    def check(self, name: str) -> None:
        """Refuse a name that is ambiguous in an equation.

        Raises
        ------
        ModelError
            The name means two things, or is no name that can stand in an equation.
        """
        if not is_symbol(name):
            raise ModelError(
                f"{name!r} is not allowed in an equation",
                needed="a name of letters, digits and underscores that is no function",
            )
        if (*self.inputs, *self.states, *self.coefficients).count(name) > 1:
            raise ModelError(f"{name} means two things in the equations", needed="different names")


def structure_from_equations(
    *,
    name: str,
    inputs: Sequence[str],
    states: Sequence[str],
    equations: Sequence[str],
    outputs: Sequence[str],
    parameters: ParameterSet,
    delays: Mapping[str, str | float] | None = None,
    constants: Mapping[str, float] | None = None,
    gain: str | None = None,
    optional: Sequence[str] = (),
    source: str = "",
) -> LinearStructure:
    """A structure from its equations.

    Parameters
    ----------
    name
        Name of the model.
    inputs, states
        Names of the inputs and of the states.
    equations
        One for each state: a linear combination of derivatives, written with a prime, on the left; states and inputs
        on the right. Factors are expressions of parameters and constants. An algebraic equation has ``0`` on its left.
    outputs
        A state's name, or ``name = ...`` with states, derivatives and inputs on the right.
    parameters
        Every parameter of the factors.
    delays
        Delays of inputs and outputs, by their names; zero for the others.
    constants, gain, optional, source
        See :class:`~rotorid.models.structure.LinearStructure`.

    Raises
    ------
    ModelError
        An equation cannot be read, is not linear, names something unknown, stands twice or is missing.

    Examples
    --------
    >>> from rotorid.models.parameter import Parameter
    >>> lag = structure_from_equations(
    ...     name="lag", inputs=["u"], states=["x"], equations=["T*x' = -x + u"], outputs=["x"],
    ...     parameters=ParameterSet([Parameter(name="T", value=0.1, unit="s")]))
    >>> lag.matrices({"T": 0.1}).poles().real
    array([-10.])
    """
    states, equations, outputs = with_direct_inputs(inputs, states, equations, outputs)
    symbols = Symbols(tuple(inputs), tuple(states), (*parameters.names, *(constants or {})))
    for symbol in (*inputs, *states, *symbols.coefficients):
        symbols.check(symbol)
    rows = [dynamic_rows(text, symbols) for text in equations]
    check_equations(rows, symbols.states)
    output_equations = [output_rows(text, symbols) for text in outputs]
    names = tuple(row.name for row in output_equations)
    delayed = {key: Expression.parse(value) for key, value in (delays or {}).items()}
    for key in delayed:
        check_delayed(key, symbols.inputs, names)
    return LinearStructure(
        name=name,
        inputs=symbols.inputs,
        states=symbols.states,
        outputs=names,
        M=tuple(row.M for row in rows),
        F=tuple(row.F for row in rows),
        G=tuple(row.G for row in rows),
        H0=tuple(row.H0 for row in output_equations),
        H1=tuple(row.H1 for row in output_equations),
        input_delays=tuple(delayed.get(key, Expression()) for key in symbols.inputs),
        output_delays=tuple(delayed.get(key, Expression()) for key in names),
        parameters=parameters,
        constants=constants or {},
        gain=gain,
        optional=tuple(optional),
        source=source,
    )


class Written(NamedTuple):
    """States, equations and outputs as text."""

    states: tuple[str, ...]
    equations: tuple[str, ...]
    outputs: tuple[str, ...]


def with_direct_inputs(
    inputs: Sequence[str], states: Sequence[str], equations: Sequence[str], outputs: Sequence[str]
) -> Written:
    r"""Equations in which inputs of outputs have a state each, which is the input at once.

    An output with a direct term, :math:`y = H_0 x + J u`, is one of states alone where :math:`0 = u - x_u` is added:
    such a state has no dynamics, and its input keeps its delay.

    Parameters
    ----------
    inputs, states, equations, outputs
        As for :func:`structure_from_equations`.

    Examples
    --------
    >>> found = with_direct_inputs(["u"], ["x"], ["x' = -x + u"], ["y = x + 0.5*u"])
    >>> found.states, found.equations[1], found.outputs
    (('x', 'u_direct'), '0 = u - u_direct', ('y = x + 0.5*u_direct',))
    """
    written, direct = list(outputs), []
    for name in inputs:
        whole = re.compile(rf"(?<![\w.]){re.escape(name)}(?![\w'])")
        for place, text in enumerate(written):
            left, equal, right = text.partition("=")
            if equal and whole.search(right):
                written[place] = f"{left}={whole.sub(f'{name}_direct', right)}"
                direct += [name] if name not in direct else []
    return Written(
        states=(*states, *(f"{name}_direct" for name in direct)),
        equations=(*equations, *(f"0 = {name} - {name}_direct" for name in direct)),
        outputs=tuple(written),
    )


class DynamicRows(NamedTuple):
    """One equation as a row of each matrix."""

    M: Row
    F: Row
    G: Row


class OutputRows(NamedTuple):
    """One output as a row of each matrix."""

    name: str
    H0: Row
    H1: Row


def dynamic_rows(text: str, symbols: Symbols) -> DynamicRows:
    """Rows of ``M``, ``F`` and ``G`` that an equation says.

    Raises
    ------
    ModelError
        It is no such equation.
    """
    left, right = _sides(text)
    of_derivatives = _linear(left, symbols, allowed=symbols.derivatives, what=f"the left side of {text!r}")
    of_others = _linear(right, symbols, allowed=(*symbols.states, *symbols.inputs), what=f"the right side of {text!r}")
    return DynamicRows(
        M=_row(of_derivatives, symbols.derivatives),
        F=_row(of_others, symbols.states),
        G=_row(of_others, symbols.inputs),
    )


def output_rows(text: str, symbols: Symbols) -> OutputRows:
    """Name of an output, and its rows of ``H0`` and ``H1``.

    Raises
    ------
    ModelError
        It is neither the name of a state nor a name and what it is.
    """
    if "=" in text:
        name, right = (part.strip() for part in text.split("=", 1))
    else:
        name = right = text.strip()
        if name not in symbols.states:
            raise _with_remedy(no_such("state", name, symbols.states), "or define it: 'name = ...'")
    if not is_symbol(name):
        raise ModelError(f"the output {text!r} has no name", needed="a name in front of the first =")
    what = f"the output {text!r}"
    factors = _linear(right, symbols, allowed=(*symbols.states, *symbols.derivatives), what=what)
    return OutputRows(name=name, H0=_row(factors, symbols.states), H1=_row(factors, symbols.derivatives))


def check_once(rows: Sequence[DynamicRows], states: Sequence[str]) -> None:
    """See that no two equations say what the same derivative is.

    Raises
    ------
    ModelError
        Two do.
    """
    determined = [
        row.M.index(own[0]) for row in rows if len(own := [entry for entry in row.M if not entry.is_zero]) == 1
    ]
    for slot in determined:
        if determined.count(slot) > 1:
            raise ModelError(f"two equations define {states[slot]}'", needed="one equation for each state")


def check_equations(rows: Sequence[DynamicRows], states: Sequence[str]) -> None:
    """See that every state has its equation and none has two.

    Raises
    ------
    ModelError
        An equation is missing, or there is one too many.
    """
    check_once(rows, states)
    if len(rows) == len(states):
        return
    came = f"got {len(rows)} equations for {len(states)} states"
    if len(rows) < len(states):
        used_slots = {slot for row in rows for slot, entry in enumerate(row.M) if not entry.is_zero}
        lost = [f"{state}'" for slot, state in enumerate(states) if slot not in used_slots]
        came += f"; none defines {' and '.join(lost)}" if lost else ""
    raise ModelError(came, needed="one equation for each state")


def check_delayed(name: str, inputs: Sequence[str], outputs: Sequence[str] = ()) -> None:
    """See that what is said to be delayed is one input, or one output where those may be.

    Raises
    ------
    ModelError
        It is neither, or both.
    """
    if name not in (*inputs, *outputs):
        raise no_such("input or output" if outputs else "input", name, (*inputs, *outputs))
    if name in inputs and name in outputs:
        raise ModelError(f"{name} is an input and an output", needed="another name for one of them, or matrices")


def can_be_equations(structure: LinearStructure) -> bool:
    """Whether the names of a structure can stand in equations."""
    symbols = Symbols(structure.inputs, structure.states, (*structure.parameters.names, *structure.constants))
    try:
        for name in (*symbols.inputs, *symbols.states, *symbols.coefficients):
            symbols.check(name)
    except ModelError:
        return False
    outputs = structure.outputs
    return all(is_symbol(name) for name in outputs) and not set(outputs) & set(structure.inputs)


def written_equations(structure: LinearStructure) -> list[str]:
    """The equations of a structure, one term for each symbol; the names must allow it."""
    primed = tuple(f"{state}'" for state in structure.states)
    rows = zip(structure.M, structure.F, structure.G, strict=True)
    return [f"{_total(m, primed)} = {_total((*f, *g), (*structure.states, *structure.inputs))}" for m, f, g in rows]


def written_outputs(structure: LinearStructure) -> list[str]:
    """The outputs of a structure; a state under its own name is that name alone."""
    names = (*(f"{state}'" for state in structure.states), *structure.states)
    rows = zip(structure.outputs, structure.H0, structure.H1, strict=True)
    totals = [(name, str(_total((*h1, *h0), names))) for name, h0, h1 in rows]
    return [name if name == total else f"{name} = {total}" for name, total in totals]


def _total(factors: Iterable[Expression], names: Iterable[str]) -> Expression:
    terms = (factor * Expression.symbol(name) for factor, name in zip(factors, names, strict=True))
    return sum(terms, Expression())


def _row(factors: Mapping[str, Expression], names: Sequence[str]) -> Row:
    return tuple(factors.get(name, Expression()) for name in names)


def _sides(text: str) -> tuple[str, str]:
    sides = text.split("=")
    if len(sides) != 2:
        raise ModelError(f"the equation {text!r} has {len(sides) - 1} signs of equality", needed='one: "x\' = ..."')
    return sides[0], sides[1]


def _linear(text: str, symbols: Symbols, *, allowed: Sequence[str], what: str) -> dict[str, Expression]:
    """The factors of the states, derivatives and inputs in one side of an equation."""
    expression = parse_expression(text, derivatives=True)
    _check_names(expression.names, symbols, what)
    rest, factors = expression.linear_in(symbols.moving)
    if wrong := sorted(factors.keys() - set(allowed)):
        raise ModelError(f"{wrong[0]} is not allowed in {what}", needed=f"{', '.join(allowed)}, each times a factor")
    if not rest.is_zero:
        raise ModelError(f"{rest} is alone in {what}", needed="terms with a state or an input each")
    return factors


def _check_names(names: Set[str], symbols: Symbols, what: str) -> None:
    known = (*symbols.states, *symbols.derivatives, *symbols.inputs, *symbols.coefficients)
    for name in sorted(names - set(known)):
        if name.endswith("'") and name[:-1] in known:
            raise ModelError(f"{name} is not allowed in {what}", needed="derivatives of states only, not of inputs")
        unknown = no_such("symbol", name, known)
        raise ModelError(f"{name} in {what} is not known", needed=unknown.needed, remedy=unknown.remedy)


def _with_remedy(error: ModelError, remedy: str) -> ModelError:
    return ModelError(error.came, needed=error.needed, remedy=f"{error.remedy} {remedy}".strip())
