"""Expressions as a tape: operations on numbered slots, in arrays that a compiled loop can run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.models.expression import Expression
from rotorid.typing import FloatArray, IntArray

ADD, MULTIPLY, DIVIDE, POWER, NEGATE, SQRT, ABS, EXP, LOG, SIN, COS, TAN, SIGN = range(13)

_BINARY: Mapping[str, int] = {"sum": ADD, "product": MULTIPLY, "quotient": DIVIDE, "power": POWER}
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
                    place = self.append(_BINARY[expression.kind], place, other)
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
    waiting, seen, numbers = list(expressions), set(), set()
    while waiting:
        part = waiting.pop()
        if part not in seen:
            seen.add(part)
            waiting += part.operands
            if part.kind == "number":
                numbers.add(part.number)
    return numbers
