"""Ties between parameters: the order in which they are computed, and how a value moves with those it is tied to."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.operations import Operations
from rotorid.typing import FloatArray


class TieError(ModelError):
    """A tie that cannot stand; ``parameter`` is the one whose tie it is."""

    def __init__(self, parameter: str, came: str, *, needed: str = "", remedy: str = "") -> None:
        super().__init__(came, needed=needed, remedy=remedy)
        self.parameter = parameter


class Network:
    """Which parameters are free and which are computed, for one set of names. It holds no values.

    Parameters
    ----------
    names
        Every parameter, in order.
    free
        Slots of the free ones.
    tied
        Expressions of the computed ones, by their names.
    constants
        Numbers that ties may name besides parameters.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        free: Sequence[int],
        tied: Mapping[str, Expression],
        constants: Mapping[str, float],
    ) -> None:
        self.names = names
        self.free = tuple(free)
        plain = {name: expression.substitute(constants) for name, expression in tied.items()}
        self.ties = {name: plain[name] for name in _in_order(names, plain)}
        self._slots = [names.index(name) for name in self.ties]
        self._values = Operations(list(self.ties.values()), names, self.ties)

    def resolve(self, numbers: list[float]) -> None:
        """Compute the tied values in place.

        Raises
        ------
        ModelError
            A tie has no finite value there.
        """
        if not self._slots:
            return
        try:
            results = self._values(numbers)
        except (ArithmeticError, ValueError):
            self._blame(numbers)
            raise
        for slot, value in zip(self._slots, results, strict=True):
            numbers[slot] = value

    def _blame(self, numbers: Sequence[float]) -> None:
        """Say which tie has no value: slow, and only on the way to an error."""
        values = dict(zip(self.names, numbers, strict=True))
        for name, expression in self.ties.items():
            try:
                values[name] = expression.evaluate(values)
            except ModelError as error:
                raise TieError(name, f"{name} is tied, and {error.came}", needed=error.needed) from None

    def directions(self, numbers: Sequence[float]) -> FloatArray:
        """How every value moves with the free ones, shape ``(parameters, free)``, read-only.

        Raises
        ------
        ModelError
            A tie has no finite derivative there.
        """
        return self._constant_directions if self._is_affine else self._directions(numbers)

    @cached_property
    def _is_affine(self) -> bool:
        return all(expression.as_affine() is not None for expression in self.ties.values())

    @cached_property
    def _constant_directions(self) -> FloatArray:
        return self._directions([0.0] * len(self.names))

    @cached_property
    def _sources(self) -> list[tuple[int, list[int], slice]]:
        """For each tie its slot, those of its sources, and where its slopes stand in the list of all."""
        counts = [len(expression.names) for expression in self.ties.values()]
        ends = np.cumsum([0, *counts]).tolist()
        sources = [[self.names.index(name) for name in sorted(e.names)] for e in self.ties.values()]
        return [(slot, s, slice(a, b)) for slot, s, a, b in zip(self._slots, sources, ends, ends[1:], strict=False)]

    @cached_property
    def _slopes(self) -> Operations:
        slopes = [e.derivative(name) for e in self.ties.values() for name in sorted(e.names)]
        return Operations(slopes, self.names)

    def _directions(self, numbers: Sequence[float]) -> FloatArray:
        directions = np.zeros((len(self.names), len(self.free)))
        directions[list(self.free), range(len(self.free))] = 1.0
        slopes = self._gradients(numbers)
        for slot, sources, where in self._sources:
            directions[slot] = slopes[where] @ directions[sources]
        directions.setflags(write=False)
        return directions

    def _gradients(self, numbers: Sequence[float]) -> FloatArray:
        try:
            slopes = np.array(self._slopes(numbers), dtype=np.float64)
        except (ArithmeticError, ValueError):
            slopes = np.array([np.nan])
        if not np.isfinite(slopes).all():
            values = dict(zip(self.names, numbers, strict=True))
            for name, expression in self.ties.items():
                for source in sorted(expression.names):
                    try:
                        expression.derivative(source).evaluate(values)
                    except ModelError as error:
                        came = f"{name} is tied and has no derivative with respect to {source}: {error.came}"
                        raise TieError(name, came, needed=error.needed) from None
        return slopes


def no_such(kind: str, name: str, known: Iterable[str]) -> ModelError:
    """The error for a name that does not exist, with the nearest one that does."""
    names = tuple(known)
    near = difflib.get_close_matches(name, names, n=1) or [one for one in names if name and one.startswith(name)]
    return ModelError(
        f"there is no {kind} {name!r}",
        needed=f"one of {', '.join(names)}" if names else f"no {kind} at all",
        remedy=f"did you mean {near[0]}?" if near else "",
    )


def _in_order(names: tuple[str, ...], tied: Mapping[str, Expression]) -> list[str]:
    """The tied parameters, each after those it is tied to."""
    needed = {name: sorted(expression.names) for name, expression in tied.items()}
    for name, sources in needed.items():
        for source in sources:
            if source not in names:
                unknown = no_such("parameter", source, names)
                came = f"{name} is tied to {source!r}, which is no parameter"
                raise TieError(name, came, needed=unknown.needed, remedy=unknown.remedy)
    done: list[str] = []
    for start in needed:
        path, pending = [start], [iter(needed[start])]
        while pending and start not in done:
            source = next(pending[-1], "")
            if not source:
                done.append(path.pop())
                pending.pop()
            elif source in path:
                loop = " -> ".join([*path[path.index(source) :], source])
                raise TieError(source, f"the ties go in a loop: {loop}", remedy="free or fix one of them")
            elif source in needed and source not in done:
                path.append(source)
                pending.append(iter(needed[source]))
    return done
