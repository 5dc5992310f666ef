"""A second-order filter whose coefficients are others in each sample."""

from __future__ import annotations

import numpy as np
from numba import njit

from rotorid.typing import FloatArray


@njit(cache=True)
def filtered(
    values: FloatArray, b0: FloatArray, b1: FloatArray, b2: FloatArray, a0: FloatArray, a2: FloatArray
) -> FloatArray:
    """Values ``(channels, n)`` behind the filter; ``a1`` is ``b1``, as a notch has it."""
    found = np.empty_like(values)
    for channel in range(values.shape[0]):
        x1 = x2 = y1 = y2 = 0.0
        for k in range(values.shape[1]):
            x0 = values[channel, k]
            y0 = (b0[k] * x0 + b1[k] * (x1 - y1) + b2[k] * x2 - a2[k] * y2) / a0[k]
            found[channel, k] = y0
            x2, x1, y2, y1 = x1, x0, y1, y0
    return found
