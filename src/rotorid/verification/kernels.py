"""The loop that arrays cannot express. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import FloatArray, IntArray


@njit(cache=True)
def fly_loops(
    transition: FloatArray,
    taps: FloatArray,
    lags: IntArray,
    forcing: FloatArray,
    reading: FloatArray,
    whole: IntArray,
    shares: FloatArray,
    controller: FloatArray,
    drive: FloatArray,
    read: FloatArray,
    direct: FloatArray,
    driving: FloatArray,
    start: FloatArray,
    state: FloatArray,
    steady: FloatArray,
    given: FloatArray,
    lead: int,
) -> FloatArray:
    """Airframe with delayed inputs under controllers, for many starts ``r`` at once: its states ``(steps, x, r)``.

    ``driving`` holds set-points, then test signals, shape ``(steps, 2 loops)``, which drive the first start alone.
    The airframe sees three samples of each command and its ``steady`` part, the middle one ``lags`` steps old, weighted
    with ``taps`` of shape ``(loops, x, 3)``, oldest first. Controllers read ``reading x``, ``whole`` steps and a share
    of one late. Commands are written to ``given``, shape ``(lead + steps, loops, r)``, which begins before the flight.
    """
    steps, order = forcing.shape
    loops, columns = steady.shape
    states = np.zeros((steps, order, columns))
    states[0] = start
    state, after = state.copy(), np.empty_like(state)
    driven, past = np.empty((2 * loops, columns)), np.empty((3, columns))
    for k in range(steps):
        driven[:] = 0.0
        driven[:loops, 0] = driving[k, :loops]
        for i in range(loops):
            newer, older = states[max(k - whole[i], 0)], states[max(k - whole[i] - 1, 0)]
            _add(driven[loops + i], (1.0 - shares[i]) * reading[i], newer)
            _add(driven[loops + i], shares[i] * reading[i], older)
        given[lead + k] = 0.0
        given[lead + k, :, 0] = driving[k, loops:]
        _add_all(given[lead + k], read, state)
        _add_all(given[lead + k], direct, driven)
        after[:] = 0.0
        _add_all(after, controller, state)
        _add_all(after, drive, driven)
        state, after = after, state
        if k + 1 < steps:
            states[k + 1, :, 0] = forcing[k]
            _add_all(states[k + 1], transition, states[k])
            for i in range(loops):
                first = lead + k - lags[i] - 1
                past[:] = given[first : first + 3, i]
                past += steady[i]
                _add_all(states[k + 1], taps[i], past)
    return states


@njit(cache=True)
def _add(total: FloatArray, weights: FloatArray, rows: FloatArray) -> None:
    """Add weighted rows; most weights of a controller are zero."""
    for j in range(weights.size):
        if weights[j] != 0.0:
            for c in range(total.size):
                total[c] += weights[j] * rows[j, c]


@njit(cache=True)
def _add_all(total: FloatArray, matrix: FloatArray, rows: FloatArray) -> None:
    for i in range(matrix.shape[0]):
        _add(total[i], matrix[i], rows)
