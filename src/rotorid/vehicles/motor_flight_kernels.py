"""The loop over the samples of `rotorid.vehicles.motor_flight`. Importing this module imports Numba."""

from __future__ import annotations

import math
from typing import NamedTuple

from rotorid.compiling import njit
from rotorid.typing import FloatArray


class Flying(NamedTuple):
    """What moves, one row for each flight; :func:`fly` changes it.

    Attributes
    ----------
    motor_speed, rate, w, gust
        Outputs that the motors have reached, body rates, velocity down, angular acceleration by gusts.
    angle, sway
        Integral of the measured rates, and the slow noise of the accelerometer.
    """

    motor_speed: FloatArray
    rate: FloatArray
    w: FloatArray
    gust: FloatArray
    angle: FloatArray
    sway: FloatArray


class Loop(NamedTuple):
    """Numbers of the vehicle, its controller and its air; ``mixer`` and ``gains`` of shapes ``(4, 4)`` and ``(3, 4)``.

    ``substeps`` are in a sample, and ``late`` of them pass until an output reaches the motors.
    """

    step_s: float
    substeps: int
    late: int
    mass_kg: float
    curve: tuple[float, float, float]
    heave_1_s: float
    lag_s: float
    slow_s: float
    damping: tuple[float, float, float]
    gains: FloatArray
    mixer: FloatArray
    rate_gains: tuple[float, float, float]
    attitude_rad_s: float
    heave_gain: float
    lowest: float
    highest: float
    gyro: float
    gusts: tuple[float, float, float]
    accelerometer: float
    climb_m_s: float


@njit(cache=True)
def fly(
    loop: Loop,
    flying: Flying,
    noise: FloatArray,
    first: int,
    excitation: FloatArray,
    trim: FloatArray,
    pull_m_s2: FloatArray,
    outputs: FloatArray,
    rates: FloatArray,
    force: FloatArray,
    speed: FloatArray,
) -> None:
    """Fill the samples of all flights from a first one on.

    Parameters
    ----------
    noise
        Standard normal numbers, a row for each sample: of the gyros, the slow and the white ones of the accelerometer,
        and of the gusts of each short step, flight by flight.
    first
        Sample of the first row.
    excitation, outputs
        Shape ``(flights, 4, samples)``; what comes from before is read in the outputs.
    trim, pull_m_s2
        Output at rest, and what pulls the vehicle down, shape ``(samples,)``.
    rates, force, speed
        Shapes ``(flights, 3, samples)``, ``(flights, samples)`` and ``(flights, samples)``.
    """
    count = rates.shape[0]
    short_s = loop.step_s / loop.substeps
    decay, half = math.exp(-short_s / loop.lag_s), math.exp(-0.5 * short_s / loop.lag_s)
    calm = math.exp(-short_s / loop.slow_s)
    stirred, calmer = math.sqrt(1.0 - calm**2), calm**loop.substeps
    c_0, c_1, c_2 = loop.curve
    for number in range(count):
        motor_speed, rate = flying.motor_speed[number], flying.rate[number]
        gust, angle = flying.gust[number], flying.angle[number]
        for row in range(noise.shape[0]):
            place = first + row
            w = flying.w[number]
            for axis in range(3):
                measured = rate[axis] + loop.gyro * noise[row, 3 * number + axis]
                rates[number, axis, place] = measured
                angle[axis] += loop.step_s * measured
            lift = 0.0
            for motor in range(4):
                command = (excitation[number, 3, place] + loop.heave_gain * (w + loop.climb_m_s)) * loop.mixer[3, motor]
                for axis in range(3):
                    turned = rates[number, axis, place] + loop.attitude_rad_s * angle[axis]
                    asked = excitation[number, axis, place] - loop.rate_gains[axis] * turned
                    command += asked * loop.mixer[axis, motor]
                outputs[number, motor, place] = min(max(trim[place] + command, loop.lowest), loop.highest)
                lift += c_0 + c_1 * motor_speed[motor] + c_2 * motor_speed[motor] ** 2
            speed[number, place] = w
            slow, white = noise[row, 3 * count + number], noise[row, 4 * count + number]
            flying.sway[number] = calmer * flying.sway[number] + math.sqrt(1.0 - calmer**2) * slow
            felt = loop.accelerometer * (flying.sway[number] + white)
            force[number, place] = -lift / loop.mass_kg + loop.heave_1_s * w + felt
            for short in range(loop.substeps):
                sent = loop.substeps * place + short - loop.late
                roll, pitch, yaw, lift = 0.0, 0.0, 0.0, 0.0
                for motor in range(4):
                    # What arrives before the first sample was sent is the rest.
                    held = outputs[number, motor, sent // loop.substeps] if sent >= 0 else trim[0]
                    before = motor_speed[motor] - held
                    middle, after = held + before * half, held + before * decay
                    # The mean thrust over the step is Simpson's.
                    mean = c_0 + c_1 * (motor_speed[motor] + after + 4.0 * middle) / 6.0
                    mean += c_2 * (motor_speed[motor] ** 2 + after**2 + 4.0 * middle**2) / 6.0
                    motor_speed[motor] = after
                    roll += loop.gains[0, motor] * mean
                    pitch += loop.gains[1, motor] * mean
                    yaw += loop.gains[2, motor] * mean
                    lift += mean
                pushed = (roll, pitch, yaw)
                for axis in range(3):
                    drawn = noise[row, 5 * count + 3 * (count * short + number) + axis]
                    gust[axis] = calm * gust[axis] + stirred * loop.gusts[axis] * drawn
                    damped = loop.damping[axis] * short_s
                    turned = short_s * math.exp(0.5 * damped) * (pushed[axis] + gust[axis])
                    rate[axis] = rate[axis] * math.exp(damped) + turned
                falling = pull_m_s2[place] - lift / loop.mass_kg + loop.heave_1_s * flying.w[number]
                flying.w[number] += short_s * falling
