"""The entries of a structure as numbers: affine ones by one matrix product, others by a list of shared operations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.models.expression import Expression
from rotorid.models.operations import Operations
from rotorid.typing import FloatArray


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
