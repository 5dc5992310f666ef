"""What sensors make of the state of a vehicle, and filters of the sensors. Importing this module imports Numba.

What the numbers mean stands in `rotorid.simulate.packed`; columns of the log in `rotorid.simulate.logged`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rotorid.simulate.bare import bare
from rotorid.simulate.logged import ACCELERATION_RAW, ANGLE, POSITION, RATE_RAW, VELOCITY
from rotorid.simulate.packed import STATES, Senses
from rotorid.typing import FloatArray

_SERIES = 24


@bare(forceinline=True)
def felt(now: FloatArray, moved: FloatArray, keep: float, new: float, lagged: FloatArray, senses: Senses) -> None:
    """Specific force where the accelerometer sits, into places 6 to 8 of ``lagged``, and after its lag into 3 to 5."""
    px, py, pz = senses.accelerometer_place[0], senses.accelerometer_place[1], senses.accelerometer_place[2]
    p, q, r = now[10], now[11], now[12]
    pd, qd, rd = moved[10], moved[11], moved[12]
    force = now.shape[0]
    old_x, old_y, old_z = lagged[6], lagged[7], lagged[8]
    # Away from the center of gravity: tangential and centripetal acceleration.
    lagged[6] = moved[force] + qd * pz - rd * py + q * (p * py - q * px) - r * (r * px - p * pz)
    lagged[7] = moved[force + 1] + rd * px - pd * pz + r * (q * pz - r * py) - p * (p * py - q * px)
    lagged[8] = moved[force + 2] + pd * py - qd * px + p * (r * px - p * pz) - q * (q * pz - r * py)
    lagged[3] = keep * lagged[3] + new * lagged[6] + (1.0 - keep - new) * old_x
    lagged[4] = keep * lagged[4] + new * lagged[7] + (1.0 - keep - new) * old_y
    lagged[5] = keep * lagged[5] + new * lagged[8] + (1.0 - keep - new) * old_z


@bare(forceinline=True)
def sense(
    now: FloatArray, lagged: FloatArray, phases: FloatArray, noise: FloatArray, senses: Senses, row: FloatArray
) -> None:
    """Raw rates and accelerations, and the estimates of velocity and position, into a row of the log."""
    rotors = now.shape[0] - STATES
    for axis in range(3):
        shake = 0.0
        if senses.gyro_vibration > 0.0 or senses.accelerometer_vibration > 0.0:
            for i in range(rotors):
                speed = now[STATES + i]
                shake += speed * speed * math.sin(phases[i] + 2.1 * axis)
        rate = lagged[axis] + senses.gyro_bias[axis] + senses.gyro_noise * noise[axis] + senses.gyro_vibration * shake
        force_seen = lagged[3 + axis] + senses.accelerometer_bias[axis] + senses.accelerometer_noise * noise[3 + axis]
        force_seen += senses.accelerometer_vibration * shake
        if senses.gyro_step > 0.0:
            rate = senses.gyro_step * math.floor(rate / senses.gyro_step + 0.5)
        if senses.accelerometer_step > 0.0:
            force_seen = senses.accelerometer_step * math.floor(force_seen / senses.accelerometer_step + 0.5)
        row[RATE_RAW + axis] = rate
        row[ACCELERATION_RAW + axis] = force_seen
        row[VELOCITY + axis] = now[3 + axis] + senses.velocity_noise * noise[9 + axis]
        row[POSITION + axis] = now[axis] + senses.position_noise * noise[12 + axis]


@bare(forceinline=True)
def attitude(now: FloatArray, noise: FloatArray, spread: float, seen: FloatArray, row: FloatArray) -> None:
    """The estimated quaternion, and its angles into a row of the log."""
    qw, qx, qy, qz = now[6], now[7], now[8], now[9]
    ex, ey, ez = 0.5 * spread * noise[6], 0.5 * spread * noise[7], 0.5 * spread * noise[8]
    a = qw - qx * ex - qy * ey - qz * ez
    b = qx + qw * ex + qy * ez - qz * ey
    c = qy + qw * ey + qz * ex - qx * ez
    d = qz + qw * ez + qx * ey - qy * ex
    norm = math.sqrt(a * a + b * b + c * c + d * d)
    a, b, c, d = a / norm, b / norm, c / norm, d / norm
    seen[0], seen[1], seen[2], seen[3] = a, b, c, d
    row[ANGLE] = math.atan2(2.0 * (a * b + c * d), 1.0 - 2.0 * (b * b + c * c))
    row[ANGLE + 1] = math.asin(min(1.0, max(-1.0, 2.0 * (a * c - d * b))))
    row[ANGLE + 2] = math.atan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))


@bare(forceinline=True)
def filtered(taps: FloatArray, memory: FloatArray, value: float) -> float:
    """One step of a second-order section; taps b0 b1 b2 a1 a2."""
    result: float = taps[0] * value + memory[0]
    memory[0] = taps[1] * value - taps[3] * result + memory[1]
    memory[1] = taps[2] * value - taps[4] * result
    return result


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def lag_weights(steps: int, step_s: float, lag_s: float) -> FloatArray:
    """What a first-order lag makes of a step of Runge and Kutta, for steps of one to ``steps`` grid steps.

    Columns: what it keeps of its old value, what it takes of the old input, and of each of the four slopes of the
    input. Exact for the cubic that belongs to the method between the ends of a step.
    """
    weights = np.zeros((steps + 1, 6))
    for n in range(1, steps + 1):
        h = n * step_s
        z = h / lag_s
        # Moments of the lag's memory over the step: m(i) = z int exp(-z (1 - t)) t^i dt.
        moments = np.zeros(4)
        if z < 2.0:
            for i in range(4):
                part = z
                for j in range(1, i + 1):
                    part *= j
                for j in range(1, i + 2):
                    part /= j
                for j in range(_SERIES):
                    moments[i] += part
                    part *= -z / (i + j + 2)
        else:
            moments[0] = 1.0 - math.exp(-z)
            for i in range(1, 4):
                moments[i] = 1.0 - i / z * moments[i - 1]
        cubic = 2.0 / 3.0 * moments[3]
        weights[n, 0], weights[n, 1] = 1.0 - moments[0], moments[0]
        weights[n, 2] = h * (moments[1] - 1.5 * moments[2] + cubic)
        weights[n, 3] = h * (moments[2] - cubic)
        weights[n, 4] = weights[n, 3]
        weights[n, 5] = h * (cubic - 0.5 * moments[2])
    return weights
