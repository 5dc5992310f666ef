"""The loop of a whole flight: sensors, controllers, mixer, vehicle. Importing this module imports Numba.

What the numbers mean stands in `rotorid.simulate.packed`; columns of the log in `rotorid.simulate.logged`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rotorid.simulate.logged import (
    ACCELERATION,
    ACCELERATION_RAW,
    ANGLE,
    ANGLE_SETPOINT,
    COMMAND,
    MOTORS,
    POSITION,
    RATE,
    RATE_RAW,
    RATE_SETPOINT,
    SATURATED,
    VELOCITY,
    VOLTAGE,
)
from rotorid.simulate.multirotor_kernels import advance, derivative
from rotorid.simulate.packed import STATES, Body, Control, Senses, Supply
from rotorid.typing import FloatArray

_LOWEST_SHARE = 0.6
"""ArduPilot's compensation takes no voltage below this share of the highest."""


@njit(cache=True, nogil=True, error_model="numpy")
def _felt(now: FloatArray, moved: FloatArray, keep: float, new: float, lagged: FloatArray, senses: Senses) -> None:
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


@njit(cache=True, nogil=True, error_model="numpy")
def _sense(
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


@njit(cache=True, nogil=True, error_model="numpy")
def _attitude(now: FloatArray, noise: FloatArray, spread: float, seen: FloatArray, row: FloatArray) -> None:
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


@njit(cache=True, nogil=True, error_model="numpy")
def _filtered(taps: FloatArray, memory: FloatArray, value: float) -> float:
    """One step of a second-order section; taps b0 b1 b2 a1 a2."""
    result: float = taps[0] * value + memory[0]
    memory[0] = taps[1] * value - taps[3] * result + memory[1]
    memory[1] = taps[2] * value - taps[4] * result
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def _outer(row: FloatArray, asked: FloatArray, hold: FloatArray, control: Control) -> float:
    """Angle set-points into a row of the log and the thrust command as result. ``hold``: integrals and held values."""
    tick = control.tick_s
    psi = row[ANGLE + 2]
    phi_wanted = asked[8] + control.stick_tilt * asked[12]
    theta_wanted = asked[9] - control.stick_tilt * asked[13]
    if control.hold_velocity:
        cosine, sine = math.cos(psi), math.sin(psi)
        ahead = cosine * row[VELOCITY] + sine * row[VELOCITY + 1]
        right = -sine * row[VELOCITY] + cosine * row[VELOCITY + 1]
        off_ahead = -control.position_p * (cosine * row[POSITION] + sine * row[POSITION + 1]) - ahead
        off_right = -control.position_p * (-sine * row[POSITION] + cosine * row[POSITION + 1]) - right
        phi_wanted += math.atan((control.velocity_p * off_right + control.velocity_i * hold[1]) / 9.80665)
        theta_wanted -= math.atan((control.velocity_p * off_ahead + control.velocity_i * hold[0]) / 9.80665)
        hold[0] += tick * off_ahead
        hold[1] += tick * off_right
    limit = control.tilt_limit
    row[ANGLE_SETPOINT] = min(limit, max(-limit, phi_wanted))
    row[ANGLE_SETPOINT + 1] = min(limit, max(-limit, theta_wanted))
    hold[2] += tick * control.stick_yaw_rate * asked[14]
    row[ANGLE_SETPOINT + 2] = hold[2] + asked[10]
    climb = control.stick_climb * asked[15]
    thrust: float = control.hover_thrust + control.stick_thrust * asked[15]
    if control.hold_height:
        hold[3] -= tick * climb
        off = row[VELOCITY + 2] + climb - control.height_p * (hold[3] - row[POSITION + 2])
        thrust += control.climb_p * off + control.climb_i * hold[4]
        hold[4] += tick * off
    if control.tilt_compensation:
        thrust /= max(0.5, math.cos(row[ANGLE]) * math.cos(row[ANGLE + 1]))
    return thrust


@njit(cache=True, nogil=True, error_model="numpy")
def _angles(row: FloatArray, asked: FloatArray, seen: FloatArray, control: Control) -> None:
    """Rate set-points: twice the vector of the attitude error's quaternion, times a gain for each axis."""
    phi, theta, psi = 0.5 * row[ANGLE_SETPOINT], 0.5 * row[ANGLE_SETPOINT + 1], 0.5 * row[ANGLE_SETPOINT + 2]
    cr, sr, cp, sp, cy, sy = (
        math.cos(phi),
        math.sin(phi),
        math.cos(theta),
        math.sin(theta),
        math.cos(psi),
        math.sin(psi),
    )
    a = cr * cp * cy + sr * sp * sy
    b = sr * cp * cy - cr * sp * sy
    c = cr * sp * cy + sr * cp * sy
    d = cr * cp * sy - sr * sp * cy
    qw, qx, qy, qz = seen[0], seen[1], seen[2], seen[3]
    side = 2.0 if qw * a + qx * b + qy * c + qz * d >= 0.0 else -2.0
    turn = control.stick_yaw_rate * asked[14]
    wanted = (
        control.angle[0] * side * (qw * b - qx * a - qy * d + qz * c),
        control.angle[1] * side * (qw * c + qx * d - qy * a - qz * b),
        control.angle[2] * side * (qw * d - qx * c + qy * b - qz * a) + turn,
    )
    for axis in range(3):
        limit = control.rate_limit[axis]
        row[RATE_SETPOINT + axis] = min(limit, max(-limit, wanted[axis])) + asked[4 + axis]


@njit(cache=True, nogil=True, error_model="numpy")
def _rates(row: FloatArray, asked: FloatArray, memory: FloatArray, first: bool, control: Control) -> None:
    """Commands of roll, pitch, yaw. ``memory`` ``(7, 3)``: target, error, derivative, integral, last, command, cut."""
    tick = control.tick_s
    for axis in range(3):
        rate = row[RATE + axis]
        keep = control.target_keep[axis]
        target = keep * memory[0, axis] + (1.0 - keep) * row[RATE_SETPOINT + axis]
        keep = control.error_keep[axis]
        error = keep * memory[1, axis] + (1.0 - keep) * (target - rate)
        of = error if control.derivative_of_error else -rate
        keep = control.derivative_keep[axis]
        slope = 0.0 if first else (of - memory[4, axis]) / tick
        slope = keep * memory[2, axis] + (1.0 - keep) * slope
        command = control.proportional[axis] * error + memory[3, axis] + control.derivative[axis] * slope
        command += control.feedforward[axis] * target
        keep = control.command_keep[axis]
        command = keep * memory[5, axis] + (1.0 - keep) * command
        memory[0, axis], memory[1, axis], memory[2, axis] = target, error, slope
        memory[4, axis], memory[5, axis] = of, command
        # A command that the motors could not follow does not wind the integral up any further.
        if memory[6, axis] * error <= 0.0:
            limit = control.integral_limit[axis]
            memory[3, axis] = min(limit, max(-limit, memory[3, axis] + control.integral[axis] * error * tick))
        row[COMMAND + axis] = min(1.0, max(-1.0, command + asked[axis]))


@njit(cache=True, nogil=True, error_model="numpy")
def _mixed(commands: FloatArray, control: Control, voltage_share: float, outputs: FloatArray) -> int:
    """Outputs to the motors: yaw gives way first, then thrust moves, then roll and pitch shrink. Bits: what was cut."""
    rotors = outputs.shape[0]
    cut = 0
    most, least = -np.inf, np.inf
    for i in range(rotors):
        tilting = control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1]
        most, least = max(most, tilting), min(least, tilting)
    room = control.high - control.low
    share = 1.0
    if most - least > room:
        share, cut = room / (most - least), cut | 1
    lift = control.mixer[0, 3] * commands[3]
    shifted = min(control.high - share * most, max(control.low - share * least, lift))
    if shifted != lift:
        cut |= 4
    yaw = 1.0
    for i in range(rotors):
        so_far = shifted + share * (control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1])
        turning = control.mixer[i, 2] * commands[2]
        if turning > 0.0:
            yaw = min(yaw, max(0.0, control.high - so_far) / turning)
        elif turning < 0.0:
            yaw = min(yaw, max(0.0, so_far - control.low) / -turning)
    if yaw < 1.0:
        cut |= 2
    e = control.expo
    for i in range(rotors):
        demand = shifted + share * (control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1])
        demand += yaw * control.mixer[i, 2] * commands[2]
        if e != 0.0:
            demand = (e - 1.0 + math.sqrt((1.0 - e) ** 2 + 4.0 * e * max(demand, 0.0))) / (2.0 * e)
        demand = min(1.0, max(0.0, demand / voltage_share))
        outputs[i] = control.output_low + (control.output_high - control.output_low) * demand
    return cut


@njit(cache=True, nogil=True, error_model="numpy")
def _share(voltage: float, control: Control) -> float:
    if control.voltage_max <= 0.0:
        return 1.0
    lowest = max(control.voltage_min, _LOWEST_SHARE * control.voltage_max)
    return min(control.voltage_max, max(lowest, voltage)) / control.voltage_max


@njit(cache=True, nogil=True, error_model="numpy")
def _voltage(now: FloatArray, used_as: float, body: Body, supply: Supply) -> tuple[float, float]:
    """Voltage at the terminals and current."""
    lifted = 0.0
    for i in range(now.shape[0] - STATES):
        x = now[STATES + i]
        lifted += max(0.0, body.thrust[0] + x * (body.thrust[1] + x * body.thrust[2])) ** 1.5
    current = supply.current_per_power * lifted
    rest = supply.voltage_full - (supply.voltage_full - supply.voltage_empty) * used_as / supply.capacity_as
    return rest - supply.resistance_ohm * current, current


@njit(cache=True, nogil=True, error_model="numpy")
def flight(
    start: FloatArray,
    asked: FloatArray,
    winds: FloatArray,
    noise: FloatArray,
    body: Body,
    supply: Supply,
    senses: Senses,
    control: Control,
    log: FloatArray,
    truth: FloatArray,
) -> int:
    """Fly, and fill ``log`` and ``truth``; the number of ticks flown before the state stopped being a number.

    ``asked``: test inputs ``(ticks, 16)``, four axes of command, rate, attitude and stick; ``winds`` ``(ticks, 3)``;
    ``noise`` ``(ticks, 15)`` standard normal.
    """
    ticks: int = asked.shape[0]
    size: int = start.shape[0]
    rotors = size - STATES
    step_s = control.tick_s / control.substeps
    now, room = start.copy(), np.empty((5, size + 3))
    moved, lagged, phases = np.zeros(size + 3), np.zeros(9), np.zeros(rotors)
    seen, hold, memory = np.empty(4), np.zeros(5), np.zeros((7, 3))
    sections = np.zeros((6, 2))
    outputs, sent, late = np.empty(rotors), np.empty(rotors), np.empty(4)
    hold[2], hold[3] = 2.0 * math.atan2(start[9], start[6]), start[2]
    gyro_keep = math.exp(-step_s / senses.gyro_lag_s) if senses.gyro_lag_s > 0.0 else 0.0
    gyro_new = 1.0 - senses.gyro_lag_s / step_s * (1.0 - gyro_keep)
    force_keep = math.exp(-control.tick_s / senses.accelerometer_lag_s) if senses.accelerometer_lag_s > 0.0 else 0.0
    force_new = 1.0 - senses.accelerometer_lag_s / control.tick_s * (1.0 - force_keep)
    used_as, voltage, gain = 0.0, 0.0, 1.0
    past = np.empty(3)
    for axis in range(3):
        lagged[axis] = now[10 + axis]
    for k in range(ticks):
        row = log[k]
        if supply.present:
            voltage, current = _voltage(now, used_as, body, supply)
            used_as += control.tick_s * current
            gain = voltage / supply.voltage_rated
        derivative(now, sent if k > 0 else now[STATES:], winds[k], gain, body, moved)
        _felt(now, moved, force_keep, force_new, lagged, senses)
        _sense(now, lagged, phases, noise[k], senses, row)
        _attitude(now, noise[k], senses.attitude_noise, seen, row)
        for axis in range(3):
            row[RATE + axis] = _filtered(control.gyro_filter, sections[axis], row[RATE_RAW + axis])
            value = row[ACCELERATION_RAW + axis]
            row[ACCELERATION + axis] = _filtered(control.accelerometer_filter, sections[3 + axis], value)
        thrust = _outer(row, asked[k], hold, control)
        _angles(row, asked[k], seen, control)
        _rates(row, asked[k], memory, k == 0, control)
        row[COMMAND + 3] = min(1.0, max(0.0, thrust + asked[k, 3]))
        share = _share(voltage, control)
        cut = _mixed(row[COMMAND : COMMAND + 4], control, share, outputs)
        for axis in range(3):
            memory[6, axis] = memory[5, axis] if cut & (2 if axis == 2 else 1) else 0.0
        row[VOLTAGE], row[SATURATED] = voltage, cut
        for i in range(rotors):
            row[MOTORS + i] = outputs[i]
        for j in range(size + 3):
            truth[k, j] = now[j] if j < size else moved[j]
        shown = -1
        for j in range(control.substeps):
            place = k * control.substeps + j
            # The commands that have arrived by now; each has its own delay.
            arrived = 0
            for axis in range(4):
                tick = max(0, (place - control.delay_steps[axis]) // control.substeps)
                late[axis] = log[tick, COMMAND + axis]
                arrived += tick
            if arrived != shown:
                _mixed(late, control, share, sent)
                shown = arrived
            past[0], past[1], past[2] = now[10], now[11], now[12]
            advance(now, sent, winds[k], gain, body, step_s, room)
            for axis in range(3):
                fresh = gyro_new * now[10 + axis] + (1.0 - gyro_keep - gyro_new) * past[axis]
                lagged[axis] = gyro_keep * lagged[axis] + fresh
            for i in range(rotors):
                phases[i] += step_s * senses.blade_rad_s * now[STATES + i]
        if not math.isfinite(now[10] + now[0] + now[6]):
            return k
    return ticks
