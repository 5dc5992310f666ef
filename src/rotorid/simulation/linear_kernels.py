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
    # Of models in sections a state pushes those of its own only.
    first, beyond = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for c in range(count):
        observed[c] = np.any(direct[c])
        pushed = np.flatnonzero(forcing[c])
        if pushed.size:
            first[c], beyond[c] = pushed[0], pushed[-1] + 1
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
            for m in range(first[c], beyond[c]):
                following[m] += value * weights[m]
        for i in range(order):
            for j in range(order):
                factor = transition[i, j]
                if factor != 0.0:
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
    # Four states at a time, so that sums stay in registers; what is missing to the last four is zero.
    width = -(-order // 4) * 4
    onward, shown = np.zeros((order, width)), np.zeros((outputs, width))
    onward[:, :order], shown[:, :order] = transition, measured
    now, following = np.zeros((width, parameters)), np.zeros((width, parameters))
    now[:order] = start
    for k in range(samples):
        for y in range(outputs):
            for x in range(0, width, 4):
                a, b, c, d = shown[y, x], shown[y, x + 1], shown[y, x + 2], shown[y, x + 3]
                for p in range(parameters):
                    seen[k, y, p] += a * now[x, p] + b * now[x + 1, p] + c * now[x + 2, p] + d * now[x + 3, p]
        following[:order] = forcing[k]
        for i in range(order):
            for x in range(0, width, 4):
                a, b, c, d = onward[i, x], onward[i, x + 1], onward[i, x + 2], onward[i, x + 3]
                for p in range(parameters):
                    following[i, p] += a * now[x, p] + b * now[x + 1, p] + c * now[x + 2, p] + d * now[x + 3, p]
        now, following = following, now
    return now[:order].copy()


@njit(cache=True, fastmath={"contract"})
def exponential_series(
    matrix: FloatArray, moves: FloatArray, degree: int, squarings: int
) -> tuple[FloatArray, FloatArray]:
    r"""The sum of :math:`X^k / k!` up to a degree, squared so many times, and its derivatives along directions.

    ``matrix`` has the shape ``(n, n)``, and ``moves``, with the directions side by side in memory, ``(n, n, p)``. The
    sum is Horner's, :math:`1 + X (1 + X/2 (1 + X/3 (...)))`, and the derivatives are those of its products.
    """
    value, slopes = np.eye(len(matrix)) + matrix / degree, moves / degree
    for k in range(degree - 1, 0, -1):
        value, slopes = _product_rule(matrix, moves, value, slopes)
        value, slopes = np.eye(len(matrix)) + value / k, slopes / k
    for _ in range(squarings):
        value, slopes = _product_rule(value, slopes, value, slopes)
    return value, slopes


@njit(cache=True, fastmath={"contract"})
def _product_rule(
    left: FloatArray, dleft: FloatArray, right: FloatArray, dright: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A product of matrices ``(n, n)`` and its derivatives ``(n, n, p)``."""
    order, _, count = dleft.shape
    value, slopes = np.zeros((order, order)), np.zeros((order, order, count))
    for i in range(order):
        for j in range(order):
            for k in range(order):
                a, b = left[i, j], right[j, k]
                value[i, k] += a * b
                if a != 0.0 or b != 0.0:
                    for p in range(count):
                        slopes[i, k, p] += dleft[i, j, p] * b + a * dright[j, k, p]
    return value, slopes
