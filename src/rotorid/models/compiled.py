"""Many expressions as one list of operations, in which every common part is computed once.

For one set of numbers (:class:`Operations`), for the entries of matrices with their slopes (:class:`Entries`: affine
ones by one matrix product, the others by operations), and as arrays that a compiled loop can run (:class:`Tape`).
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.models.expression import Expression, real_power, scalar_function
from rotorid.typing import FloatArray, IntArray

_BINARY: Mapping[str, Callable[[float, float], float]] = {
    "sum": operator.add,
    "product": operator.mul,
    "quotient": operator.truediv,
    "power": real_power,
}


class _Step(NamedTuple):
    """One operation on the results so far; a second place below zero says that there is only one operand."""

    function: Callable[..., float]
    one: int
    two: int


class Operations:
    """Several expressions of the same names, in which every common part is computed once.

    Parameters
    ----------
    expressions
        What to compute.
    names
        The names, in the order in which their values come.
    definitions
        Names that stand for expressions of the others and of definitions before them.
    """

    def __init__(
        self,
        expressions: Sequence[Expression],
        names: Sequence[str],
        definitions: Mapping[str, Expression] | None = None,
    ) -> None:
        meant = definitions or {}
        self._known: dict[Expression, int] = {Expression.symbol(name): slot for slot, name in enumerate(names)}
        self._steps: list[_Step] = []
        every = [part for expression in (*expressions, *meant.values()) for part in _parts(expression)]
        numbers = sorted({part.number for part in every if part.kind == "number"})
        self._numbers = numbers
        self._known |= {Expression.constant(number): len(names) + slot for slot, number in enumerate(numbers)}
        self._count = len(names) + len(numbers)
        for name, expression in meant.items():
            self._known[Expression.symbol(name)] = self._place(expression)
        self._results = [self._place(expression) for expression in expressions]

    def _place(self, expression: Expression) -> int:
        """Where the value of an expression will stand."""
        if expression not in self._known:
            places = [self._place(operand) for operand in expression.operands]
            if expression.kind == "function":
                place = self._append(scalar_function(expression.name), places[0], -1)
            elif expression.kind == "negative":
                place = self._append(operator.neg, places[0], -1)
            else:
                place = places[0]
                for other in places[1:]:
                    place = self._append(_BINARY[expression.kind], place, other)
            self._known[expression] = place
        return self._known[expression]

    def _append(self, function: Callable[..., float], one: int, two: int) -> int:
        self._steps.append(_Step(function, one, two))
        self._count += 1
        return self._count - 1

    def __call__(self, values: Sequence[float]) -> list[float]:
        """Every expression at one point; ValueError or ArithmeticError where one has no value."""
        slots: list[float] = [*values, *self._numbers]
        for function, one, two in self._steps:
            slots.append(function(slots[one], slots[two]) if two >= 0 else function(slots[one]))
        return [slots[place] for place in self._results]


def _parts(expression: Expression) -> list[Expression]:
    found = [expression]
    for part in found:
        found += part.operands
    return found


class Entries:
    """A list of entries as functions of the parameters.

    Parameters
    ----------
    entries
        Expressions of parameters and constants.
    names
        The parameters, in order.
    constants
        Values of the constants.
    """

    def __init__(self, entries: Sequence[Expression], names: Sequence[str], constants: Mapping[str, float]) -> None:
        self.names = tuple(names)
        column = {name: slot for slot, name in enumerate(names)}
        self._offset = np.zeros(len(entries))
        self._slope = np.zeros((len(entries), len(names)))
        curved: dict[int, Expression] = {}
        for slot, written in enumerate(entries):
            entry = written.substitute(constants)
            affine = entry.as_affine()
            if affine is None:
                curved[slot] = entry
                continue
            self._offset[slot] = affine[0]
            for name, factor in affine[1].items():
                self._slope[slot, column[name]] = factor
        self._curved = curved
        self._rows = list(curved)
        self.moving = (self._slope != 0.0).any(axis=1)
        self.moving[self._rows] = True
        self._moving_slope = self._slope[self.moving]
        # Where a derivative goes: the row counts those entries only that move.
        row = np.cumsum(self.moving) - 1
        places = [(slot, name) for slot, entry in curved.items() for name in sorted(entry.names)]
        self._places = ([row[slot] for slot, _ in places], [column[name] for _, name in places])
        slopes = [curved[slot].derivative(name) for slot, name in places]
        self._values = Operations(list(curved.values()), names)
        self._both = Operations([*curved.values(), *slopes], names)

    def at(self, values: Mapping[str, float]) -> FloatArray:
        """The entries, shape ``(e,)``.

        Raises
        ------
        ModelError
            An entry has no finite value there.
        """
        theta = [float(values[name]) for name in self.names]
        numbers: FloatArray = self._offset + self._slope @ np.array(theta)
        if self._curved:
            numbers[self._rows] = self._run(self._values, theta, values)
        return numbers

    def with_slopes(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The entries, shape ``(e,)``, and the derivatives of those that move, shape ``(moving, parameters)``.

        Raises
        ------
        ModelError
            An entry or a derivative has no finite value there.
        """
        theta = [float(values[name]) for name in self.names]
        numbers: FloatArray = self._offset + self._slope @ np.array(theta)
        if not self._curved:
            return numbers, self._moving_slope
        results = self._run(self._both, theta, values)
        numbers[self._rows] = results[: len(self._rows)]
        slopes = self._moving_slope.copy()
        slopes[self._places] = results[len(self._rows) :]
        return numbers, slopes

    def _run(self, operations: Operations, theta: list[float], values: Mapping[str, Any]) -> list[float]:
        try:
            results = operations(theta)
            failed = not np.isfinite(results).all()
        except (ArithmeticError, ValueError):
            failed = True
        if failed:
            self._blame(values)
        return results

    def _blame(self, values: Mapping[str, Any]) -> None:
        """Say which expression has no value: slow, and only on the way to an error."""
        for entry in self._curved.values():
            entry.evaluate(values)
            for name in sorted(entry.names):
                entry.derivative(name).evaluate(values)


ADD, MULTIPLY, DIVIDE, POWER, NEGATE, SQRT, ABS, EXP, LOG, SIN, COS, TAN, SIGN = range(13)

_BINARY_CODES: Mapping[str, int] = {"sum": ADD, "product": MULTIPLY, "quotient": DIVIDE, "power": POWER}
_FUNCTIONS: Mapping[str, int] = {
    "sqrt": SQRT,
    "abs": ABS,
    "exp": EXP,
    "log": LOG,
    "sin": SIN,
    "cos": COS,
    "tan": TAN,
    "sign": SIGN,
}
_SQUARE = Expression.constant(2.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tape(Immutable):
    """Several expressions as one list of operations, in which every common part is computed once.

    Slots hold the values of the names first, then numbers, then one result for each operation.

    Parameters
    ----------
    names
        How many names there are.
    numbers
        The numbers that stand in the expressions.
    operations
        Code, and slots of the one or two operands, shape ``(n, 3)``. The result goes into the next slot.
    settled
        How many operations, from the first on, do not depend on the moving names: they need to run only once.
    results
        Slots of the expressions, shape ``(e,)``.
    """

    names: int
    numbers: FloatArray
    operations: IntArray
    settled: int
    results: IntArray

    def __post_init__(self) -> None:
        self._set(
            numbers=read_only(self.numbers, np.float64, ndim=1),
            operations=read_only(self.operations, np.int64, ndim=2),
            results=read_only(self.results, np.int64, ndim=1),
        )

    def slots(self, values: FloatArray) -> FloatArray:
        """All slots with the values of the names and the numbers in place."""
        slots = np.zeros(self.names + self.numbers.size + len(self.operations))
        slots[: self.names] = values
        slots[self.names : self.names + self.numbers.size] = self.numbers
        return slots


def tape(expressions: Sequence[Expression], moving: Sequence[str], still: Sequence[str]) -> Tape:
    """Expressions of some names as a tape.

    Parameters
    ----------
    expressions
        What to compute.
    moving, still
        The names, moving ones first. What depends on still ones only is computed once.

    Examples
    --------
    >>> both = tape([Expression.parse("a*x + b"), Expression.parse("a*x")], ["x"], ["a", "b"])
    >>> both.operations.tolist(), both.results.tolist()
    ([[1, 1, 0], [0, 3, 2]], [4, 3])
    """
    return _Writing(expressions, moving, still).tape()


class _Writing:
    """A tape while it is written; slots of operations count from zero until all numbers are known."""

    def __init__(self, expressions: Sequence[Expression], moving: Sequence[str], still: Sequence[str]) -> None:
        names = (*moving, *still)
        self.names = len(names)
        self.slots = {Expression.symbol(name): slot for slot, name in enumerate(names)}
        self.numbers = sorted(_numbers(expressions))
        self.slots |= {Expression.constant(number): self.names + i for i, number in enumerate(self.numbers)}
        self.leaves = self.names + len(self.numbers)
        self.moves = [slot < len(moving) for slot in range(self.leaves)]
        self.operations: list[tuple[int, int, int]] = []
        self.results = [self.place(expression) for expression in expressions]

    def place(self, expression: Expression) -> int:
        """The slot in which the value of an expression will stand."""
        if expression not in self.slots:
            places = [self.place(operand) for operand in expression.operands]
            if expression.kind == "function":
                place = self.append(_FUNCTIONS[expression.name], places[0], places[0])
            elif expression.kind == "negative":
                place = self.append(NEGATE, places[0], places[0])
            elif expression.kind == "power" and expression.operands[1] == _SQUARE:
                place = self.append(MULTIPLY, places[0], places[0])
            else:
                place = places[0]
                for other in places[1:]:
                    place = self.append(_BINARY_CODES[expression.kind], place, other)
            self.slots[expression] = place
        return self.slots[expression]

    def append(self, code: int, one: int, two: int) -> int:
        self.operations.append((code, one, two))
        self.moves.append(self.moves[one] or self.moves[two])
        return len(self.moves) - 1

    def tape(self) -> Tape:
        """The tape, its operations on still names in front."""
        moves = self.moves[self.leaves :]
        order = sorted(range(len(moves)), key=moves.__getitem__)
        new = list(range(self.leaves)) + [0] * len(moves)
        for place, old in enumerate(order):
            new[self.leaves + old] = self.leaves + place
        operations = [(code, new[one], new[two]) for code, one, two in (self.operations[old] for old in order)]
        return Tape(
            names=self.names,
            numbers=np.array(self.numbers, dtype=np.float64),
            operations=np.array(operations, dtype=np.int64).reshape(-1, 3),
            settled=moves.count(False),
            results=np.array([new[slot] for slot in self.results], dtype=np.int64),
        )


def _numbers(expressions: Sequence[Expression]) -> set[float]:
    """Every number that stands in the expressions."""
    waiting, visited, numbers = list(expressions), set(), set()
    while waiting:
        part = waiting.pop()
        if part not in visited:
            visited.add(part)
            waiting += part.operands
            if part.kind == "number":
                numbers.add(part.number)
    return numbers
