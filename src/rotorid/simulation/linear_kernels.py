"""The loops over time that arrays cannot express: responses, closed loops, and their sensitivities.

Importing this module imports Numba: do it inside a function.
"""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
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
    observed = np.zeros(count, dtype=np.bool_)
    for c in range(count):
        observed[c] = np.any(direct[c])
    for k in range(samples):
        row = slopes[k]
        for c in range(count):
            if observed[c]:
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
    responses = np.zeros((samples, outputs, columns))
    now, following = start.copy(), np.zeros((order, columns))
    for k in range(samples):
        if decays and k % 64 == 0 and np.abs(now).max() < least:
            break
        for y in range(outputs):
            for x in range(order):
                factor = measured[y, x]
                if factor != 0.0:
                    for c in range(columns):
                        responses[k, y, c] += factor * now[x, c]
        following[:] = constant
        for i in range(order):
            for j in range(order):
                factor = transition[i, j]
                for c in range(columns):
                    following[i, c] += factor * now[j, c]
        now, following = following, now
    return responses


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
