"""The two loops that arrays cannot express. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np
from numba import njit

from rotorid.typing import FloatArray, IntArray


@njit(cache=True)
def recursion(transition: FloatArray, forcing: FloatArray, start: FloatArray) -> FloatArray:
    """States of ``x[k+1] = transition x[k] + forcing[k]``, shape ``(samples, x)``, beginning with ``start``."""
    samples, order = forcing.shape
    states = np.empty((samples, order))
    states[0] = start
    for k in range(samples - 1):
        for i in range(order):
            total = forcing[k, i]
            for j in range(order):
                total += transition[i, j] * states[k, j]
            states[k + 1, i] = total
    return states


@njit(cache=True)
def closed_loop(
    transition: FloatArray,
    taps: FloatArray,
    lags: IntArray,
    disturbance: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    error: FloatArray,
    proportional: FloatArray,
    integral: FloatArray,
    excitation: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Plant with delayed inputs under proportional-integral control: states ``(k, x)`` and commands ``(k, u)``.

    ``y[k] = measured x[k] + noise[k]``, ``e[k] = error y[k]``, ``u[k] = P e[k] + I z[k] + excitation[k]``,
    ``z[k+1] = z[k] + e[k]``, and the plant sees three samples of each command, the middle one ``lags`` samples old,
    weighted with ``taps`` of shape ``(3, u, x)``, oldest first. Before the flight all commands are zero.
    """
    steps, inputs = excitation.shape
    order = transition.shape[0]
    sensors = measured.shape[0]
    states = np.zeros((steps, order))
    commands = np.zeros((steps, inputs))
    reading = np.empty(sensors)
    integrals = np.zeros(inputs)
    for k in range(steps):
        for s in range(sensors):
            total = noise[k, s]
            for j in range(order):
                total += measured[s, j] * states[k, j]
            reading[s] = total
        for i in range(inputs):
            total = 0.0
            for s in range(sensors):
                total += error[i, s] * reading[s]
            commands[k, i] = proportional[i] * total + integral[i] * integrals[i] + excitation[k, i]
            integrals[i] += total
        if k + 1 == steps:
            break
        for x in range(order):
            total = disturbance[k, x]
            for j in range(order):
                total += transition[x, j] * states[k, j]
            states[k + 1, x] = total
        for i in range(inputs):
            for tap in range(3):
                past = k - lags[i] - 1 + tap
                if past >= 0:
                    for x in range(order):
                        states[k + 1, x] += taps[tap, i, x] * commands[past, i]
    return states, commands
