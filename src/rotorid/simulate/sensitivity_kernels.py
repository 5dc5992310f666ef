"""Time recursions of sensitivities. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np
from numba import njit

from rotorid.typing import FloatArray


@njit(cache=True, fastmath={"contract"})
def add_state_sensitivities(
    transition: FloatArray,
    forcing: FloatArray,
    measured: FloatArray,
    direct: FloatArray,
    regressors: FloatArray,
    slopes: FloatArray,
) -> None:
    """Add to ``slopes``, shape ``(n, y p)``, those of the outputs of ``s[k+1] = transition s[k] + forcing z[k]``.

    The sensitivities ``s`` of the states begin at rest. ``regressors`` are ``z``, shape ``(n, c)``: states and late
    inputs; ``forcing`` has the shape ``(c, x p)`` and ``direct``, what ``z`` adds to the slopes of the outputs at once,
    ``(c, y p)``. The innermost loops run over parameters, which lie side by side in memory.
    """
    samples, count = regressors.shape
    order, outputs = len(transition), len(measured)
    parameters = forcing.shape[1] // order
    width = order * parameters
    now, following = np.zeros(width), np.zeros(width)
    seen = np.zeros(count, dtype=np.bool_)
    for c in range(count):
        seen[c] = np.any(direct[c])
    for k in range(samples):
        row = slopes[k]
        for c in range(count):
            if seen[c]:
                value = regressors[k, c]
                for m in range(outputs * parameters):
                    row[m] += value * direct[c, m]
        for y in range(outputs):
            for x in range(order):
                factor = measured[y, x]
                if factor != 0.0:
                    for p in range(parameters):
                        row[y * parameters + p] += factor * now[x * parameters + p]
        following[:] = 0.0
        for c in range(count):
            value, weights = regressors[k, c], forcing[c]
            for m in range(width):
                following[m] += value * weights[m]
        for i in range(order):
            for j in range(order):
                factor = transition[i, j]
                for p in range(parameters):
                    following[i * parameters + p] += factor * now[j * parameters + p]
        now, following = following, now


@njit(cache=True, fastmath={"contract"})
def free_responses(
    transition: FloatArray, start: FloatArray, constant: FloatArray, measured: FloatArray, samples: int
) -> FloatArray:
    """Outputs ``measured e[k]`` of ``e[k+1] = transition e[k] + constant`` from ``start``, shape ``(n, y, k)``.

    What has decayed below rounding of its start is zero from there on.
    """
    order, columns = start.shape
    outputs = measured.shape[0]
    decays = not np.any(constant)
    least = 1e-18 * np.abs(start).max() if columns else 0.0
    seen = np.zeros((samples, outputs, columns))
    now, following = start.copy(), np.zeros((order, columns))
    for k in range(samples):
        if decays and k % 64 == 0 and np.abs(now).max() < least:
            break
        for y in range(outputs):
            for x in range(order):
                factor = measured[y, x]
                if factor != 0.0:
                    for c in range(columns):
                        seen[k, y, c] += factor * now[x, c]
        following[:] = constant
        for i in range(order):
            for j in range(order):
                factor = transition[i, j]
                for c in range(columns):
                    following[i, c] += factor * now[j, c]
        now, following = following, now
    return seen
