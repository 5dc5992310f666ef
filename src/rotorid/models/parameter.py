"""Parameters: a value is never without its unit, its bounds and its role."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.errors import ModelError
from rotorid.typing import FloatArray

Status: TypeAlias = Literal["free", "fixed", "tied", "dropped"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """One number of a model.

    Parameters
    ----------
    name
        Symbol of the field: ``L_p``, ``M_pitch``, ``tau_roll``, ``T_motor``.
    value
        In ``unit``.
    lower, upper
        Bounds that a fit respects.
    status
        ``free`` to be identified, ``fixed`` by the user, ``dropped`` from the structure (its value is then zero).
    starts
        Values from which a search without a better idea begins.
    """

    name: str
    value: float
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    status: Status = "free"
    starts: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (self.lower <= self.value <= self.upper and np.isfinite(self.value)):
            raise ModelError(
                f"{self.name} = {self.value:g} {self.unit} lies outside its bounds",
                needed=f"a finite value from {self.lower:g} to {self.upper:g}",
            )


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Parameters of one model, in order. Every change gives a new set."""

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        if len(set(self.names)) != len(self.parameters):
            raise ModelError("two parameters have one name", needed="every name once")

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        near = difflib.get_close_matches(name, self.names, n=1)
        raise ModelError(
            f"there is no parameter {name!r}",
            needed=f"one of {', '.join(self.names)}",
            remedy=f"did you mean {near[0]}?" if near else "",
        )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a fit may move."""
        return tuple(parameter.name for parameter in self.parameters if parameter.status == "free")

    @property
    def values(self) -> dict[str, float]:
        return {parameter.name: parameter.value for parameter in self.parameters}

    @property
    def directions(self) -> FloatArray:
        """How every parameter moves with the free ones, shape ``(parameters, free)``."""
        free = self.free
        return np.array([[float(name == one) for one in free] for name in self.names]).reshape(len(self), len(free))

    def pack(self) -> FloatArray:
        """Values of the free parameters, shape ``(n,)``."""
        return np.array([self[name].value for name in self.free])

    def unpack(self, theta: FloatArray) -> ParameterSet:
        """The same set with new values of the free parameters."""
        return self.with_values(dict(zip(self.free, map(float, theta), strict=True)))

    def with_values(self, values: Mapping[str, float]) -> ParameterSet:
        """The same set with some values changed."""
        for name in values:
            self[name]
        return ParameterSet(tuple(replace(p, value=values.get(p.name, p.value)) for p in self.parameters))

    def fix(self, name: str, value: float) -> ParameterSet:
        """The same set with one parameter held at ``value``."""
        return self._with(name, value=value, status="fixed")

    def drop(self, name: str) -> ParameterSet:
        """The same set without the effect of one parameter."""
        return self._with(name, value=0.0, status="dropped")

    def _with(self, name: str, *, value: float, status: Status) -> ParameterSet:
        changed = replace(self[name], value=value, status=status)
        return ParameterSet(tuple(changed if p.name == name else p for p in self.parameters))
