"""The time recursion of a predictor's sensitivities. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np
from numba import njit

from rotorid.typing import FloatArray


@njit(cache=True, fastmath={"contract"})
def advance(
    transition: FloatArray, forcing: FloatArray, measured: FloatArray, start: FloatArray, seen: FloatArray
) -> FloatArray:
    """Advance ``s[k+1] = transition s[k] + forcing[k]``, and add ``measured s[k]`` to ``seen[k]``; the next start.

    ``forcing`` has the shape ``(n, x, p)``, ``seen`` ``(n, y, p)`` and ``start`` ``(x, p)``. The innermost loop runs
    over the parameters, which lie side by side in memory.
    """
    samples, order, parameters = forcing.shape
    outputs = measured.shape[0]
    now, following = start.copy(), np.empty((order, parameters))
    for k in range(samples):
        for y in range(outputs):
            for x in range(order):
                factor = measured[y, x]
                for p in range(parameters):
                    seen[k, y, p] += factor * now[x, p]
        for i in range(order):
            for p in range(parameters):
                following[i, p] = forcing[k, i, p]
            for j in range(order):
                factor = transition[i, j]
                for p in range(parameters):
                    following[i, p] += factor * now[j, p]
        now, following = following, now
    return now
