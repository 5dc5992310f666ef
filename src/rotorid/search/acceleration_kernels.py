"""Motors that lag, and errors of a whole population. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import FloatArray


@njit(cache=True, nogil=True)
def lagged(drives: FloatArray, kept: float) -> FloatArray:
    """First-order lag of inputs ``(c, n)``, settled at first: ``x[k+1] = kept x[k] + (1 - kept) u[k]``."""
    channels, samples = drives.shape
    states = np.empty((channels, samples))
    for c in range(channels):
        states[c, 0] = drives[c, 0]
    for k in range(samples - 1):
        for c in range(channels):
            states[c, k + 1] = kept * states[c, k] + (1.0 - kept) * drives[c, k]
    return states


@njit(cache=True, nogil=True)
def products(values: FloatArray, powers: FloatArray) -> FloatArray:
    """Products of powers of the values of every candidate, ``(b, v)`` and ``(c, v)`` to ``(b, c)``."""
    candidates, factors = values.shape
    channels = powers.shape[0]
    gains = np.ones((candidates, channels))
    for b in range(candidates):
        for c in range(channels):
            for v in range(factors):
                if powers[c, v] != 0.0:
                    gains[b, c] *= values[b, v] ** powers[c, v]
    return gains


# Sums in any order: processors add several numbers at once.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def error_sums(gains: FloatArray, settled: FloatArray, measured: FloatArray, squared: bool) -> FloatArray:
    """Sums of errors ``measured - gain settled`` of every candidate and channel, of squares or of absolute values.

    ``gains`` are ``(b, c)`` and the sums too, ``settled`` and ``measured`` ``(c, n)``.
    """
    candidates, channels = gains.shape
    samples = settled.shape[1]
    sums = np.empty((candidates, channels))
    for b in range(candidates):
        for c in range(channels):
            gain = gains[b, c]
            total = 0.0
            if squared:
                for k in range(samples):
                    error = measured[c, k] - gain * settled[c, k]
                    total += error * error
            else:
                for k in range(samples):
                    total += abs(measured[c, k] - gain * settled[c, k])
            sums[b, c] = total
    return sums
