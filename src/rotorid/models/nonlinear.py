"""Nonlinear structures: equations of states, inputs and parameters. A structure holds no data and no result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.models.condense import Row
from rotorid.models.entries import Entries
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet
from rotorid.models.tape import Tape, tape
from rotorid.models.ties import no_such
from rotorid.typing import FloatArray, IntArray


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
        for kind, names, said, expressions in pairs:
            if len(names) != len(expressions):
                raise ModelError(f"{self.name}: {len(expressions)} {said} came for {len(names)} {kind}")
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
            raise ModelError(f"{self.name}: {', '.join(sorted(lost))} stands in no equation", remedy="remove it")

    def with_constants(self, constants: Mapping[str, float]) -> NonlinearStructure:
        """The same structure with other values of some constants.

        Raises
        ------
        ModelError
            There is no such constant, or a value is not finite.
        """
        for name in constants:
            if name not in self.constants:
                raise no_such("constant", name, self.constants)
        changed = {**self.constants, **constants}
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
        seen = frozenset().union(*(expression.names for expression in chosen))
        while found := frozenset().union(*(rates[state].names for state in seen & rates.keys())) - seen:
            seen |= found
        pairs = zip(self.inputs, self.input_delays, strict=True)
        delays = tuple(delay if name in seen else Expression() for name, delay in pairs)
        used = seen.union(*(delay.names for delay in delays))
        return replace(
            self,
            states=tuple(state for state in self.states if state in seen),
            outputs=tuple(outputs),
            equations=tuple(rates[state] for state in self.states if state in seen),
            output_equations=chosen,
            input_delays=delays,
            starts={state: s for state, s in self.starts.items() if state in seen and s.names <= known},
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
