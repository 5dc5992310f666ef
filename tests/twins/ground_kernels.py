"""A flight from the ground to the ground, or into it: the simulator's own kernels with a floor and motors that fail.

Sensors, controllers, mixer and vehicle are those of `rotorid.simulation.flight_kernels`. Added are a floor on which the
vehicle stands and against which it strikes, a share of each motor's output that arrives, a hand that carries the
vehicle, and a pilot of the throttle who follows a height.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rotorid.simulation.flight_kernels import (
    _angles,
    _mixed,
    _outer,
    _rates,
    advance,
    attitude,
    derivative,
    felt,
    filtered,
    sense,
)
from rotorid.simulation.multirotor import (
    ACCELERATION,
    ACCELERATION_RAW,
    COMMAND,
    MOTORS,
    RATE,
    RATE_RAW,
    RATE_SETPOINT,
    SATURATED,
    STATES,
    Body,
    Control,
    Senses,
)
from rotorid.typing import FloatArray

OFF, IDLE, FLYING, LANDING = 0, 1, 2, 3
"""Phases that the pilot asks for."""

_G = 9.80665
_STRIKE_S = 0.02
"""How long a strike lasts."""
_BOUNCE, _SPIN_KEPT, _REST_M_S = 0.25, 0.4, 0.6
_SPOOL_DOWN_S = 0.8


@njit(cache=True, nogil=True, error_model="numpy")
def ground_flight(
    start: FloatArray,
    asked: FloatArray,
    wanted: FloatArray,
    hand: FloatArray,
    health: FloatArray,
    kicks: FloatArray,
    winds: FloatArray,
    noise: FloatArray,
    body: Body,
    senses: Senses,
    control: Control,
    idle: float,
    log: FloatArray,
    truth: FloatArray,
) -> None:
    """Fill ``log`` (as the simulator's), and ``truth``: state, specific force, then contact, phase, speed of a strike.

    ``wanted`` ``(ticks, 3)``: phase, height and climb that the pilot wants. ``hand`` ``(ticks, 7)``: whether a hand
    holds the vehicle, its angles and rates. ``health`` ``(ticks, rotors)``: share of the output that arrives; ``kicks``
    ``(ticks, 3)``: rates that a collision adds.
    """
    ticks = asked.shape[0]
    size = start.shape[0]
    rotors = size - STATES
    now = start.copy()
    moved, stages = np.zeros(size + 3), np.empty((5, size + 3))
    lagged, phases, measured, hold = np.zeros(9), np.zeros(rotors), np.empty(4), np.zeros(7)
    memory, sections = np.zeros((7, 3)), np.zeros((6, 2))
    outputs, sent = np.zeros(rotors), np.zeros(rotors)
    step_s = control.tick_s / control.substeps
    landed_s, strike_left, strike = -1.0, 0.0, 0.0
    wrecked = False
    for k in range(ticks):
        row = log[k]
        contact = now[2] >= 0.0
        phase = int(wanted[k, 0])
        if phase == LANDING and contact and landed_s < 0.0:
            landed_s = k * control.tick_s
        if phase < FLYING:
            landed_s = -1.0
        for axis in range(3):
            now[10 + axis] += kicks[k, axis]
        derivative(now, sent, winds[k], 1.0, body, moved)
        held = hand[k, 0] > 0.0
        resting = contact and (moved[5] >= 0.0 or wrecked or phase < FLYING) and strike_left <= 0.0
        if held:
            for j in range(3):
                now[10 + j] = hand[k, 4 + j]
            cr, sr = math.cos(0.5 * hand[k, 1]), math.sin(0.5 * hand[k, 1])
            cp, sp = math.cos(0.5 * hand[k, 2]), math.sin(0.5 * hand[k, 2])
            cy, sy = math.cos(0.5 * hand[k, 3]), math.sin(0.5 * hand[k, 3])
            now[6], now[7] = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
            now[8], now[9] = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
        if resting or held:
            for j in range(3):
                now[3 + j] = 0.0
                moved[10 + j] = 0.0
                if not held:
                    now[10 + j] = 0.0
        qw, qx, qy, qz = now[6], now[7], now[8], now[9]
        down0, down1 = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx)
        down2 = 1.0 - 2.0 * (qx * qx + qy * qy)
        push = 0.0
        if strike_left > 0.0:
            push = strike / _STRIKE_S
            strike_left -= control.tick_s
        if resting or held:
            moved[size], moved[size + 1], moved[size + 2] = -_G * down0, -_G * down1, -_G * down2
        moved[size] -= push * down0
        moved[size + 1] -= push * down1
        moved[size + 2] -= push * down2
        if k == 0:
            lagged[6], lagged[7], lagged[8] = moved[size], moved[size + 1], moved[size + 2]
        felt(now, moved, 0.0, 1.0, lagged, senses)
        for axis in range(3):
            lagged[axis] = now[10 + axis]
        sense(now, lagged, phases, noise[k], senses, row)
        attitude(now, noise[k], senses.attitude_noise, measured, row)
        for axis in range(3):
            row[RATE + axis] = filtered(control.gyro_filter, sections[axis], row[RATE_RAW + axis])
            value = row[ACCELERATION_RAW + axis]
            row[ACCELERATION + axis] = filtered(control.accelerometer_filter, sections[3 + axis], value)
        _outer(row, asked[k], measured, hold, control)
        # The pilot's throttle: where it hovers, with what height and climb lack, and for the tilt.
        lack = 1.5 * (wanted[k, 1] + now[2]) + 2.0 * (wanted[k, 2] + now[5])
        level = 1.0 - 2.0 * (measured[1] ** 2 + measured[2] ** 2)
        thrust = control.hover_thrust * (1.0 + lack / (2.0 * _G)) / max(0.7, level)
        thrust = min(1.0, max(0.15 * control.hover_thrust, thrust))
        if landed_s >= 0.0:
            thrust = control.hover_thrust * max(0.0, 1.0 - (k * control.tick_s - landed_s) / _SPOOL_DOWN_S)
        elif contact and phase == FLYING and not wrecked:
            thrust = control.hover_thrust * max(0.0, 1.05 + wanted[k, 1])
        thrust += asked[k, 3]
        _angles(row, asked[k], measured, control)
        if resting:
            for axis in range(3):
                row[RATE_SETPOINT + axis] *= 0.2
                memory[3, axis] = 0.0
        _rates(row, asked[k], memory, k == 0, control)
        row[COMMAND + 3] = min(1.0, max(0.0, thrust))
        spent = landed_s >= 0.0 and k * control.tick_s - landed_s > _SPOOL_DOWN_S
        if phase < FLYING or spent:
            for axis in range(4):
                row[COMMAND + axis] = 0.0
            for i in range(rotors):
                outputs[i] = 0.0 if phase == OFF else idle
            row[SATURATED] = 0.0
        else:
            cut = _mixed(row[COMMAND : COMMAND + 4], control, 1.0, outputs)
            for axis in range(3):
                memory[6, axis] = memory[5, axis] if cut & (2 if axis == 2 else 1) else 0.0
            row[SATURATED] = cut
        for i in range(rotors):
            row[MOTORS + i] = outputs[i]
            sent[i] = outputs[i] * health[k, i]
        for j in range(size):
            truth[k, j] = now[j]
        for j in range(3):
            truth[k, size + j] = moved[size + j]
        truth[k, size + 3] = 1.0 if (resting or held) else 0.0
        truth[k, size + 4] = phase
        truth[k, size + 5] = strike if push > 0.0 else 0.0
        # The vehicle: held or at rest its rotors alone turn.
        kept = now.copy()
        for _ in range(control.substeps):
            advance(now, sent, winds[k], 1.0, body, step_s, stages)
            for i in range(rotors):
                phases[i] += step_s * senses.blade_rad_s * now[STATES + i]
        if resting or held:
            for j in range(STATES):
                now[j] = kept[j]
        elif now[2] > 0.0:
            speed = now[5]
            if speed > 0.05:
                strike, strike_left = speed, _STRIKE_S
            tilted = 1.0 - 2.0 * (now[7] ** 2 + now[8] ** 2) < 0.7
            wrecked = wrecked or tilted or speed > 3.0
            now[2] = 0.0
            now[5] = -_BOUNCE * speed if speed > _REST_M_S else 0.0
            for j in range(3):
                now[10 + j] *= _SPIN_KEPT if wrecked else 0.0
            now[3] *= 0.3
            now[4] *= 0.3
            if now[5] < 0.0:
                now[2] = -1e-6
