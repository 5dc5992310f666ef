"""Products of unknowns, slopes and residuals of a record, gathered piece by piece: all that least squares needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.typing import FloatArray

_SAME_DIRECTION = 1e-10
"""Of squares: unknowns that differ by less than a hundred thousandth of their effect are one."""


@dataclass(kw_only=True, eq=False)
class Gram:
    """A sum of products, which grows.

    Parameters
    ----------
    products
        Of all columns with each other: unknowns, slopes, residual, shape ``(k + p + 1, k + p + 1)``.
    unknowns
        k.
    """

    products: FloatArray
    unknowns: int

    @classmethod
    def empty(cls, unknowns: int, parameters: int) -> Gram:
        """No samples yet."""
        size = unknowns + parameters + 1
        return cls(products=np.zeros((size, size)), unknowns=unknowns)

    def add(self, unknown: FloatArray, slopes: FloatArray, residual: FloatArray) -> None:
        """Add some samples: shapes ``(m, y, k)``, ``(m, y, p)`` and ``(m, y)``."""
        columns = np.concatenate([unknown, slopes, residual[:, :, None]], axis=2).reshape(-1, len(self.products))
        self.products += columns.T @ columns

    def beside(self) -> FloatArray:
        """Products of slopes and residual in what the unknowns leave, shape ``(p + 1, p + 1)``."""
        k = self.unknowns
        inner, cross, rest = self.products[:k, :k], self.products[:k, k:], self.products[k:, k:]
        if k == 0 or not np.isfinite(self.products).all():
            return rest
        size = np.sqrt(np.where(inner.diagonal() > 0.0, inner.diagonal(), 1.0))
        values, vectors = np.linalg.eigh(inner / np.outer(size, size))
        seen = values > _SAME_DIRECTION * values[-1]
        taken = (vectors[:, seen].T @ (cross / size[:, None])) / np.sqrt(values[seen])[:, None]
        return np.asarray(rest - taken.T @ taken)
