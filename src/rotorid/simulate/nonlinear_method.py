"""Fixed-step integrators by name, as their Butcher tableaus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.models.ties import no_such
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RungeKutta(Immutable):
    r"""An explicit Runge–Kutta method.

    .. math:: k_i = f\Bigl(t + c_i h, \; x + h \sum_{j<i} a_{ij} k_j\Bigr), \qquad x \to x + h \sum_i b_i k_i

    Parameters
    ----------
    order
        The error after a given time falls with this power of the step, where inputs and equations are smooth.
    a, b, c
        The tableau, shapes ``(s, s)``, ``(s,)`` and ``(s,)``.
    """

    order: int
    a: FloatArray
    b: FloatArray
    c: FloatArray

    def __post_init__(self) -> None:
        self._set(
            a=read_only(self.a, np.float64, ndim=2),
            b=read_only(self.b, np.float64, ndim=1),
            c=read_only(self.c, np.float64, ndim=1),
        )


def _method(order: int, rows: list[list[float]], weights: list[float]) -> RungeKutta:
    a = np.zeros((len(weights), len(weights)))
    for i, row in enumerate(rows, start=1):
        a[i, : len(row)] = row
    return RungeKutta(order=order, a=a, b=np.array(weights), c=a.sum(axis=1))


METHODS: Mapping[str, RungeKutta] = MappingProxyType(
    {
        "euler": _method(1, [], [1.0]),
        "heun": _method(2, [[1.0]], [0.5, 0.5]),
        # Bogacki and Shampine, the third order of MATLAB's ode23.
        "rk23": _method(3, [[1 / 2], [0.0, 3 / 4]], [2 / 9, 1 / 3, 4 / 9]),
        "rk4": _method(4, [[1 / 2], [0.0, 1 / 2], [0.0, 0.0, 1.0]], [1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        # Dormand and Prince, the fifth order of MATLAB's ode45.
        "rk45": _method(
            5,
            [
                [1 / 5],
                [3 / 40, 9 / 40],
                [44 / 45, -56 / 15, 32 / 9],
                [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
                [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
            ],
            [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
        ),
    }
)
"""Integrators by name, in the order of their accuracy."""


def runge_kutta(name: str) -> RungeKutta:
    """An integrator by its name.

    Raises
    ------
    UsageError
        There is none of that name.

    Examples
    --------
    >>> runge_kutta("rk4").order
    4
    """
    if name not in METHODS:
        error = no_such("fixed-step method", name, METHODS)
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy)
    return METHODS[name]
