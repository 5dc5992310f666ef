"""The time recursion of a nonlinear model and its sensitivities.

Importing this module imports Numba: do it inside a function. Plain loops throughout: slices, tuples and calls would
take several times as long to compile.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.compiling import njit
from rotorid.models.compiled import ABS, ADD, COS, DIVIDE, EXP, LOG, MULTIPLY, NEGATE, POWER, SIN, SQRT, TAN
from rotorid.typing import FloatArray, IntArray


@njit(cache=True, error_model="numpy")
def run(operations: IntArray, first: int, last: int, slots: FloatArray) -> None:
    """Run some operations of a tape; what has no value is not a number."""
    leaves = slots.size - operations.shape[0]
    for n in range(first, last):
        code = operations[n, 0]
        left = slots[operations[n, 1]]
        right = slots[operations[n, 2]]
        if code == ADD:
            value = left + right
        elif code == MULTIPLY:
            value = left * right
        elif code == NEGATE:
            value = -left
        elif code == DIVIDE:
            value = left / right
        elif code == POWER:
            value = left**right
        elif code == SQRT:
            value = math.sqrt(left)
        elif code == ABS:
            value = abs(left)
        elif code == EXP:
            value = math.exp(left)
        elif code == LOG:
            value = math.log(left)
        elif code == SIN:
            value = math.sin(left)
        elif code == COS:
            value = math.cos(left)
        elif code == TAN:
            value = math.tan(left)
        else:  # the sign, zero at zero
            value = math.copysign(1.0, left) if left != 0.0 else 0.0
        slots[leaves + n] = value


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def integrate(
    operations: IntArray,
    results: IntArray,
    slopes: IntArray,
    settled: int,
    slots: FloatArray,
    names: FloatArray,
    weights: FloatArray,
    lengths: FloatArray,
    pieces: IntArray,
    levels: FloatArray,
    ramps: FloatArray,
    ages: FloatArray,
    states: FloatArray,
) -> None:
    """Fill the states ``(n, x, 1 + k)``, whose first row is the start.

    The last axis holds a value and after it its derivatives in ``k`` directions; so do ``names`` ``(x + u + p, 1 + k)``
    of states, inputs and parameters, ``lengths`` and ``ages``. Every sample interval takes the same steps, with
    ``lengths`` ``(s, 1 + k)`` in seconds, in ``pieces`` ``(s,)`` between the corners of the inputs. Row ``i`` of
    ``weights`` ``(g + 1, g)`` makes stage ``i`` of a step, and the last one the step. ``levels`` ``(n - 1, pieces, u)``
    are the inputs, to which come ``ramps`` ``(n - 1, pieces, u)`` times ``ages`` ``(s, g, u, 1 + k)``.
    """
    samples, order, width = states.shape
    stages, inputs, ramping = weights.shape[1], levels.shape[2], ages.shape[2]
    rates, now = np.zeros((stages, order, width)), states[0].copy()
    for sample in range(samples - 1):
        for step in range(lengths.shape[0]):
            for stage in range(stages + 1):
                for x in range(order):
                    for k in range(width):
                        names[x, k] = now[x, k]
                    for j in range(stage):
                        length = weights[stage, j] * lengths[step, 0]
                        rate = weights[stage, j] * rates[j, x, 0]
                        names[x, 0] += length * rates[j, x, 0]
                        for k in range(1, width):
                            names[x, k] += length * rates[j, x, k] + lengths[step, k] * rate
                if stage == stages:
                    break
                for i in range(inputs):
                    names[order + i, 0] = levels[sample, pieces[step], i]
                for i in range(ramping):
                    names[order + i, 0] += ramps[sample, pieces[step], i] * ages[step, stage, i, 0]
                    for k in range(1, width):
                        names[order + i, k] = ramps[sample, pieces[step], i] * ages[step, stage, i, k]
                for n in range(order + inputs):
                    slots[n] = names[n, 0]
                run(operations, settled, operations.shape[0], slots)
                for x in range(order):
                    rates[stage, x, 0] = slots[results[x]]
                    for k in range(1, width):
                        rates[stage, x, k] = 0.0
                for n in range(slopes.shape[0]):
                    slope = slots[slopes[n, 2]]
                    for k in range(1, width):
                        rates[stage, slopes[n, 0], k] += slope * names[slopes[n, 1], k]
            for x in range(order):
                for k in range(width):
                    now[x, k] = names[x, k]
        for x in range(order):
            for k in range(width):
                states[sample + 1, x, k] = now[x, k]


@njit(cache=True, error_model="numpy")
def observe(
    operations: IntArray,
    results: IntArray,
    slopes: IntArray,
    settled: int,
    slots: FloatArray,
    moving: FloatArray,
    still: FloatArray,
    outputs: FloatArray,
) -> None:
    """Fill the outputs ``(n, y, 1 + k)``, derivatives after the value.

    ``moving`` ``(n, x + u, 1 + k)`` are states and inputs, ``still`` ``(p, 1 + k)`` the parameters.
    """
    samples, names, width = moving.shape
    for sample in range(samples):
        for i in range(names):
            slots[i] = moving[sample, i, 0]
        run(operations, settled, operations.shape[0], slots)
        for y in range(results.size):
            outputs[sample, y, 0] = slots[results[y]]
        for n in range(slopes.shape[0]):
            column, slope = slopes[n, 1], slots[slopes[n, 2]]
            for k in range(1, width):
                tangent = moving[sample, column, k] if column < names else still[column - names, k]
                outputs[sample, slopes[n, 0], k] += slope * tangent
