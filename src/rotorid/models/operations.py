"""Expressions as one list of operations on plain numbers, in which every common part is computed once."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from rotorid.models.expression import Expression, real_power, scalar_function

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
