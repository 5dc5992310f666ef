"""The matrix exponential together with its exact derivatives along many directions."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

_LARGEST_NORM = 0.5
_ROUNDING = 2.0**-54


def exponential_tangent(matrix: FloatArray, moves: FloatArray) -> tuple[FloatArray, FloatArray]:
    r""":math:`e^X` and its Fréchet derivatives :math:`\frac{d}{d\varepsilon} e^{X + \varepsilon \dot X}`.

    A Taylor series after scaling, squared back, with the product rule applied to every product: the derivatives are
    exact to rounding, and all directions share the powers of the matrix.

    Parameters
    ----------
    matrix
        :math:`X`, shape ``(n, n)``.
    moves
        Directions :math:`\dot X`, shape ``(p, n, n)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(n, n)``.
    numpy.ndarray
        Shape ``(p, n, n)``.

    Examples
    --------
    >>> value, slope = exponential_tangent(np.array([[-1.0]]), np.array([[[2.0]]]))
    >>> bool(np.allclose([value[0, 0], slope[0, 0, 0]], [np.exp(-1.0), 2.0 * np.exp(-1.0)], rtol=1e-15))
    True
    """
    norm = float(np.abs(matrix).sum(axis=0).max(initial=0.0))
    if not np.isfinite(norm):
        return np.full_like(matrix, np.nan), np.full_like(moves, np.nan)
    squarings = max(0, int(np.ceil(np.log2(norm / _LARGEST_NORM)))) if norm > 0.0 else 0
    X, dX = matrix * 0.5**squarings, moves * 0.5**squarings
    identity = np.eye(len(matrix))
    degree = _degree(norm * 0.5**squarings)
    # Horner's scheme: 1 + X (1 + X/2 (1 + X/3 (...))).
    value, slope = identity + X / degree, dX / degree
    for k in range(degree - 1, 0, -1):
        slope = (dX @ value + X @ slope) / k
        value = identity + X @ value / k
    for _ in range(squarings):
        slope = slope @ value + value @ slope
        value = value @ value
    return value, slope


def _degree(norm: float) -> int:
    """Terms of the series after which the next one, and its derivative, is lost in rounding."""
    degree, term = 1, 1.0
    while term > _ROUNDING:
        term *= norm / degree
        degree += 1
    return degree
