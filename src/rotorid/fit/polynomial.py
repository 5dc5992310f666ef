r"""Discrete polynomial models with one output: what they are, and their simulation.

.. math:: y_k = \sum_j \frac{B_j(q)}{F(q)} u_{j,k}, \qquad F = 1 + f_1 q^{-1} + \dots, \quad
    B_j = (b_{j,0} + b_{j,1} q^{-1} + \dots) q^{-n_j}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True)
class PolynomialOrders:
    """Orders of a polynomial model.

    Parameters
    ----------
    denominator
        Coefficients after the leading one.
    numerators
        Coefficients for each input.
    delays
        Samples by which each input acts late; one for each input.
    """

    denominator: int
    numerators: tuple[int, ...]
    delays: tuple[int, ...]

    def __post_init__(self) -> None:
        if self.denominator < 0 or min(self.numerators, default=0) < 1 or min(self.delays, default=0) < 0:
            raise UsageError(f"the orders {self} came", needed="at least one coefficient for each input")
        if len(self.numerators) != len(self.delays):
            raise UsageError(f"{len(self.numerators)} numerators and {len(self.delays)} delays came")

    @property
    def coefficients(self) -> int:
        return self.denominator + sum(self.numerators)

    @property
    def first(self) -> int:
        """The first sample whose whole past is known."""
        ages = [delay + count - 1 for delay, count in zip(self.delays, self.numerators, strict=True)]
        return max(self.denominator, *ages)

    def check(self, records: Sequence[TimeData]) -> None:
        """Refuse records that do not suit.

        Raises
        ------
        UsageError
            They have other inputs than the orders, or more than one output.
        InsufficientDataError
            They are too short.
        """
        if not records:
            raise UsageError("no record came", needed="at least one")
        for record in records:
            if (len(record.inputs), len(record.outputs)) != (len(self.numerators), 1):
                raise UsageError(
                    f"{record.name} has {len(record.inputs)} inputs and {len(record.outputs)} outputs",
                    needed=f"{len(self.numerators)} inputs and one output",
                )
        usable = sum(max(record.samples - self.first, 0) for record in records)
        if usable <= self.coefficients:
            raise InsufficientDataError(f"{usable} usable samples came", needed=f"more than {self.coefficients}")


@dataclass(frozen=True, kw_only=True, eq=False)
class PolynomialModel(Immutable):
    """A polynomial model and how well its coefficients are known.

    Parameters
    ----------
    denominator
        With its leading one, shape ``(n + 1,)``.
    numerators
        For each input, beginning with the zeros of its delay.
    covariance
        Of the coefficients that were estimated, denominator first; empty where they were given.
    noise_variance
        Of the equation error (ARX) or the output error.
    """

    denominator: FloatArray
    numerators: tuple[FloatArray, ...]
    covariance: FloatArray
    noise_variance: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            denominator=read_only(self.denominator, np.float64, ndim=1),
            numerators=tuple(read_only(numerator, np.float64, ndim=1) for numerator in self.numerators),
            covariance=read_only(self.covariance, np.float64, ndim=2),
        )
        if self.denominator.size == 0 or self.denominator[0] != 1.0:
            raise UsageError("the denominator does not begin with one", needed="1, f1, f2, ...")

    @classmethod
    def given(cls, denominator: Sequence[float], numerators: Sequence[Sequence[float]]) -> PolynomialModel:
        """A model with coefficients from elsewhere, delays as leading zeros."""
        arrays = tuple(np.asarray(numerator, dtype=np.float64) for numerator in numerators)
        none = np.zeros((0, 0))
        return cls(denominator=np.asarray(denominator, dtype=np.float64), numerators=arrays, covariance=none)

    @classmethod
    def of(
        cls, coefficients: FloatArray, orders: PolynomialOrders, covariance: FloatArray, noise_variance: float
    ) -> PolynomialModel:
        """A model from its coefficients, denominator first."""
        ends = np.cumsum([orders.denominator, *orders.numerators])
        parts = np.split(coefficients, ends[:-1])
        return cls(
            denominator=np.concatenate([[1.0], parts[0]]),
            numerators=tuple(np.concatenate([np.zeros(n), b]) for n, b in zip(orders.delays, parts[1:], strict=True)),
            covariance=covariance,
            noise_variance=noise_variance,
        )

    def simulate(self, inputs: FloatArray) -> FloatArray:
        """The output from rest, without noise, shape ``(n,)``, for inputs ``(u, n)``.

        Examples
        --------
        >>> PolynomialModel.given([1.0, -0.5], [[0.0, 1.0]]).simulate(np.ones((1, 4)))
        array([0.  , 1.  , 1.5 , 1.75])
        """
        from scipy.signal import lfilter

        if len(inputs) != len(self.numerators):
            raise UsageError(f"{len(inputs)} inputs came", needed=f"{len(self.numerators)}")
        driven = sum(
            (lfilter(b, [1.0], u) for b, u in zip(self.numerators, inputs, strict=True)), np.zeros(inputs.shape[1])
        )
        return np.asarray(lfilter([1.0], self.denominator, driven), dtype=np.float64)

    @property
    def stable(self) -> bool:
        return bool(np.all(np.abs(np.roots(self.denominator)) < 1.0))
