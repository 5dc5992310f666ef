"""The matrices of a structure over its free parameters, for one parameter vector or a thousand at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray

_LINEAR = 1e-12
_SPREAD = 0.5


class Matrices(NamedTuple):
    """Matrices of a state space with any leading axes; delays in seconds, shapes ``(..., u)`` and ``(..., y)``."""

    M: FloatArray
    F: FloatArray
    G: FloatArray
    H0: FloatArray
    H1: FloatArray
    input_delays_s: FloatArray
    output_delays_s: FloatArray


class Slope(NamedTuple):
    """How one entry of a matrix changes with one parameter: a number, or an array of shape ``(b, 1)``."""

    parameter: int
    row: int
    column: int
    factor: float | FloatArray


Slopes: TypeAlias = tuple[tuple[Slope, ...], ...]
"""Entries that change, for each of the seven matrices in the order of their fields; of delays the column is zero."""


@dataclass(frozen=True, eq=False)
class ParameterMap:
    r"""From free parameters :math:`\theta` to matrices and their derivatives.

    Parameters
    ----------
    structure
        What the parameters mean.
    parameters
        Which are free; the others follow them or stand still.
    """

    structure: LinearStructure
    parameters: ParameterSet

    def tangent(self, theta: FloatArray) -> tuple[Matrices, Matrices]:
        """Matrices at ``theta``, shape ``(p,)``, and their derivatives with a leading axis of the free parameters.

        Raises
        ------
        ModelError
            A value lies outside its bounds, or an entry is not finite there.
        """
        parameters = self.parameters.unpack(theta)
        system, derivatives = self.structure.matrices_and_jacobian(parameters.values, parameters.directions)
        return Matrices(*(getattr(system, name) for name in Matrices._fields)), Matrices(*derivatives)

    @cached_property
    def _affine(self) -> tuple[Matrices, Matrices] | None:
        """Constants and slopes, where the matrices are sums of the parameters: then the slopes are one everywhere."""
        if any(
            parameter.status == "tied" and (parameter.lower > -np.inf or parameter.upper < np.inf)
            for parameter in self.parameters
        ):
            return None
        rng = np.random.default_rng(0)
        places = [self.parameters.pack(), *(generic_values(self.parameters, rng) for _ in range(2))]
        try:
            systems, slopes = zip(*(self.tangent(theta) for theta in places), strict=True)
        except ModelError:
            return None
        if not all(_same(slopes[0], other) for other in slopes[1:]):
            return None
        return _constants(systems[0], slopes[0], places[0]), slopes[0]

    @property
    def affine(self) -> bool:
        """Whether the matrices are sums of the free parameters."""
        return self._affine is not None

    @cached_property
    def _flat(self) -> tuple[FloatArray, FloatArray, Slopes]:
        """Constants of all matrices in one row, their slopes in one matrix, and the slopes by entry."""
        assert self._affine is not None
        constants, slopes = self._affine
        rows = np.concatenate([slope.reshape(len(slope), int(np.prod(slope.shape[1:]))) for slope in slopes], axis=1)
        return (
            np.concatenate([constant.ravel() for constant in constants]),
            rows,
            _sparse([slope[None] for slope in slopes]),
        )

    def tangents(self, thetas: FloatArray) -> tuple[Matrices, Slopes]:
        """Matrices at each of ``thetas``, shape ``(b, p)``, with a leading axis ``b``, and their derivatives by entry.

        Derivatives that are the same everywhere are single numbers.
        """
        if self._affine is None:
            both = [self._tangent_or_nothing(theta) for theta in thetas]
            matrices = [np.stack(column) for column in zip(*(matrices for matrices, _ in both), strict=True)]
            return Matrices(*matrices), _sparse([np.stack(c) for c in zip(*(other for _, other in both), strict=True)])
        constants, slopes, entries = self._flat
        numbers, first, parts = constants + thetas @ slopes, 0, []
        for column in self._affine[0]:
            parts.append(numbers[:, first : first + column.size].reshape(-1, *column.shape))
            first += column.size
        return Matrices(*parts), entries

    def dense_tangents(self, thetas: FloatArray) -> tuple[Matrices, Matrices]:
        """Matrices at each of ``thetas``, shape ``(b, p)``, with a leading axis ``b``, and all their derivatives.

        These have the leading axes ``b`` and ``p``; derivatives that are the same everywhere, only one ``b``. Both are
        not a number where the model has no value.
        """
        if self._affine is None:
            both = [self._tangent_or_nothing(theta) for theta in thetas]
            systems, slopes = (tuple(map(np.stack, zip(*column, strict=True))) for column in zip(*both, strict=True))
            return Matrices(*systems), Matrices(*slopes)
        return self.tangents(thetas)[0], Matrices(*(slope[None] for slope in self._affine[1]))

    def _tangent_or_nothing(self, theta: FloatArray) -> tuple[Matrices, Matrices]:
        """The tangent, or one that is not a number where the model has none: a solver steps back from there."""
        try:
            return self.tangent(theta)
        except ModelError:
            shapes = self.tangent(self.parameters.pack())
            return tuple(Matrices(*(np.full_like(one, np.nan) for one in part)) for part in shapes)  # type: ignore[return-value]


def _same(matrices: Matrices, other: Matrices) -> bool:
    pairs = zip(matrices, other, strict=True)
    return all(np.all(np.abs(a - b) <= _LINEAR * np.abs(a).max(initial=0.0)) for a, b in pairs)


def _constants(system: Matrices, slopes: Matrices, theta: FloatArray) -> Matrices:
    """Constant part of the matrices, with rounding of their sums removed."""
    parts = []
    for matrix, slope in zip(system, slopes, strict=True):
        rest = matrix - np.tensordot(theta, slope, axes=1)
        size = np.abs(matrix) + np.tensordot(np.abs(theta), np.abs(slope), axes=1)
        parts.append(np.where(np.abs(rest) <= _LINEAR * size, 0.0, rest))
    return Matrices(*parts)


def _sparse(derivatives: list[FloatArray]) -> Slopes:
    """Entries that are not zero everywhere, from arrays of shape ``(b, p, rows, columns)`` or ``(b, p, rows)``."""
    found = []
    for derivative in derivatives:
        table = derivative if derivative.ndim == 4 else derivative[..., None]
        places = zip(*(index.tolist() for index in np.nonzero(table.any(axis=0))), strict=True)
        found.append(tuple(Slope(k, i, j, _factor(table[:, k, i, j])) for k, i, j in places))
    return tuple(found)


def _factor(values: FloatArray) -> float | FloatArray:
    return float(values[0]) if values.size == 1 else values[:, None]


def generic_values(parameters: ParameterSet, rng: np.random.Generator) -> FloatArray:
    """Free parameters that no accident makes zero or equal: scattered about their values, or about one where zero."""
    free = [parameters[name] for name in parameters.free]
    value = np.array([parameter.value or 1.0 for parameter in free])
    sign = np.where([parameter.value == 0.0 for parameter in free], rng.choice([-1.0, 1.0], len(free)), 1.0)
    scattered = sign * value * np.exp(_SPREAD * rng.standard_normal(len(free)))
    lower, upper = np.array([parameter.lower for parameter in free]), np.array([parameter.upper for parameter in free])
    # A draw beyond a bound is mirrored at zero before it is cut, so that it rarely ends on the bound itself.
    inside = (scattered >= lower) & (scattered <= upper)
    return np.asarray(np.clip(np.where(inside, scattered, -scattered), lower, upper))
