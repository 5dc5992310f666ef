"""The recursion of motors that follow their outputs. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import math

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import FloatArray, IntArray

LAG_UP, LAG_DOWN, DELAY, LEVEL, SLOPE, CURVE, FACTOR, EXPONENT, START = range(1, 10)
"""Places of the derivatives behind a value."""


@njit(cache=True, error_model="numpy")
def rate(now: FloatArray, u: FloatArray, volts: FloatArray, numbers: FloatArray, found: FloatArray) -> None:
    """Fill ``found`` with the acceleration of one motor and its derivatives, of a state, an output and a voltage.

    ``numbers`` are both lags, the three coefficients of the curve, the factor, the exponent, :math:`u_0` and
    :math:`V_0`, not a number where no voltage is known.
    """
    about = u[0] - numbers[7]
    sag, power, by_volts = 1.0, 0.0, 0.0
    if not math.isnan(numbers[8]):
        ratio = volts[0] / numbers[8] - 1.0
        power = ratio - 0.5 * ratio**2
        sag = math.exp(numbers[6] * power)
        by_volts = numbers[6] * (1.0 - ratio) / numbers[8]
    curve = numbers[2] + numbers[3] * about + numbers[4] * about**2
    scale = numbers[5] * sag
    error = scale * curve - now[0]
    # Halfway at an error of zero, as the derivative of a magnitude is.
    up = 0.5 + 0.5 * np.sign(error)
    fast = up / numbers[0] + (1.0 - up) / numbers[1]
    found[0] = error / numbers[0] if error > 0.0 else error / numbers[1]
    turned = scale * (numbers[3] + 2.0 * numbers[4] * about)
    for k in range(1, found.size):
        found[k] = fast * (turned * u[k] - now[k])
    # Steps that end at the corners of the outputs meet a ramp of the voltage elsewhere.
    found[DELAY] += fast * scale * curve * by_volts * volts[DELAY]
    found[LAG_UP] -= up * error / numbers[0] ** 2
    found[LAG_DOWN] -= (1.0 - up) * error / numbers[1] ** 2
    found[LEVEL] += fast * scale
    found[SLOPE] += fast * scale * about
    found[CURVE] += fast * scale * about**2
    found[FACTOR] += fast * sag * curve
    found[EXPONENT] += fast * scale * curve * power


@njit(cache=True, error_model="numpy")
def follow(
    numbers: FloatArray,
    places: IntArray,
    voltage: int,
    weights: FloatArray,
    lengths: FloatArray,
    pieces: IntArray,
    levels: FloatArray,
    ramps: FloatArray,
    ages: FloatArray,
    states: FloatArray,
) -> None:
    """Fill the speeds ``(n, motors, 10)``, whose first row is the start, with their derivatives.

    ``numbers`` ``(motors, 9)`` are as :func:`rate` takes them; all others as
    :func:`rotorid.simulation.nonlinear_kernels.integrate` takes them, with the delay as the only direction. ``places``
    are the inputs of the motors, and ``voltage`` is its place, negative where there is none.
    """
    samples, motors, width = states.shape
    stages, ramping = weights.shape[1], ages.shape[2]
    rates, now, at = np.zeros((stages, width)), np.zeros(width), np.zeros(width)
    u, volts = np.zeros(width), np.zeros(width)
    for motor in range(motors):
        now[:], place = states[0, motor], places[motor]
        for sample in range(samples - 1):
            for step in range(lengths.shape[0]):
                piece = pieces[step]
                for stage in range(stages + 1):
                    at[:] = now
                    for j in range(stage):
                        weight = weights[stage, j]
                        if weight != 0.0:
                            for k in range(width):
                                at[k] += weight * lengths[step, 0] * rates[j, k]
                            at[DELAY] += weight * lengths[step, 1] * rates[j, 0]
                    if stage == stages:
                        break
                    u[0] = levels[sample, piece, place]
                    if voltage >= 0:
                        volts[0] = levels[sample, piece, voltage]
                    if ramping > 0:
                        u[0] += ramps[sample, piece, place] * ages[step, stage, place, 0]
                        u[DELAY] = ramps[sample, piece, place] * ages[step, stage, place, 1]
                        if voltage >= 0:
                            volts[0] += ramps[sample, piece, voltage] * ages[step, stage, voltage, 0]
                            volts[DELAY] = ramps[sample, piece, voltage] * ages[step, stage, voltage, 1]
                    rate(at, u, volts, numbers[motor], rates[stage])
                now[:] = at
            states[sample + 1, motor] = now


@njit(cache=True, error_model="numpy")
def seen(
    numbers: FloatArray,
    places: IntArray,
    voltage: int,
    lead_s: float,
    moving: FloatArray,
    states: FloatArray,
    outputs: FloatArray,
    by_lead: FloatArray,
) -> None:
    """Fill the speeds as logged, ahead by a lead, with their derivatives, and those by the lead.

    ``moving`` ``(n, inputs, 2)`` are the inputs at the samples.
    """
    samples, motors, width = states.shape
    u, volts, turning = np.zeros(width), np.zeros(width), np.zeros(width)
    for motor in range(motors):
        for sample in range(samples):
            u[0], u[DELAY] = moving[sample, places[motor], 0], moving[sample, places[motor], 1]
            if voltage >= 0:
                volts[0] = moving[sample, voltage, 0]
            rate(states[sample, motor], u, volts, numbers[motor], turning)
            by_lead[sample, motor] = turning[0]
            for k in range(width):
                outputs[sample, motor, k] = states[sample, motor, k] + lead_s * turning[k]
