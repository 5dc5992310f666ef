"""The loop of a whole flight: sensors, controllers, mixer, vehicle. Importing this module imports Numba.

What the numbers mean stands in `rotorid.simulate.packed`; columns of the log in `rotorid.simulate.logged`. Numba
knows stale code by the file that holds it alone: after a change in `multirotor_kernels` or `sensor_kernels`, take the
compiled code of this module away, too (``rm src/rotorid/simulate/__pycache__/*.nb*``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rotorid.simulate.bare import bare
from rotorid.simulate.logged import (
    ACCELERATION,
    ACCELERATION_RAW,
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
from rotorid.simulate.sensor_kernels import attitude, felt, filtered, lag_weights, sense
from rotorid.typing import FloatArray

_STICK_OUT = 0.01
_LOWEST_SHARE = 0.6
"""ArduPilot's compensation takes no voltage below this share of the highest."""


class Room(NamedTuple):
    """What a flight remembers from tick to tick, and where it works."""

    now: FloatArray
    """State, shape ``(size,)``."""
    stages: FloatArray
    """See :func:`~rotorid.simulate.multirotor_kernels.advance`, shape ``(5, size + 3)``."""
    moved: FloatArray
    """Derivative of the state and specific force at the tick, shape ``(size + 3,)``."""
    lagged: FloatArray
    """Rates after the lag of the sensors, specific force after it and before it, shape ``(9,)``."""
    phases: FloatArray
    """Angles of the rotors, shape ``(rotors,)``."""
    seen: FloatArray
    """Estimated quaternion."""
    hold: FloatArray
    """Integrals and held values of the outer loops, shape ``(5,)``."""
    memory: FloatArray
    """Of the rate controllers, shape ``(7, 3)``."""
    sections: FloatArray
    """Of the filters of rates and accelerations, shape ``(6, 2)``."""
    outputs: FloatArray
    """To the motors as asked for at the tick, and as they have arrived, shape ``(rotors,)``."""
    sent: FloatArray
    late: FloatArray
    """Commands that have arrived, shape ``(4,)``."""
    weights: FloatArray
    """See :func:`~rotorid.simulate.sensor_kernels.lag_weights`."""


@bare(forceinline=True)
def _outer(row: FloatArray, asked: FloatArray, seen: FloatArray, hold: FloatArray, control: Control) -> float:
    """Angle set-points into a row of the log and the thrust command as result. ``hold``: integrals and held values."""
    tick = control.tick_s
    a, b, c, d = seen[0], seen[1], seen[2], seen[3]
    phi_wanted = asked[8] + control.stick_tilt * asked[12]
    theta_wanted = asked[9] - control.stick_tilt * asked[13]
    if control.hold_velocity:
        # Of the heading; zero over zero where the nose points straight up or down, and has none.
        cosine, sine = 1.0 - 2.0 * (c * c + d * d), 2.0 * (a * d + b * c)
        level = math.sqrt(cosine * cosine + sine * sine)
        cosine, sine = (cosine / level, sine / level) if level > 0.0 else (1.0, 0.0)
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
    if control.heading_follows and abs(asked[14]) > _STICK_OUT:
        hold[2] = math.atan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))
    else:
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
        thrust /= max(0.5, 1.0 - 2.0 * (b * b + c * c))
    return thrust


@bare(forceinline=True)
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


@bare(forceinline=True)
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


@bare(forceinline=True)
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
    highest, lowest = np.inf, -np.inf
    for i in range(rotors):
        lift = control.mixer[i, 3]
        if lift > 0.0:
            tilting = share * (control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1])
            highest, lowest = min(highest, (control.high - tilting) / lift), max(lowest, (control.low - tilting) / lift)
    thrust = min(highest, max(lowest, commands[3]))
    if thrust != commands[3]:
        cut |= 4
    yaw = 1.0
    for i in range(rotors):
        tilting = control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1]
        so_far = control.mixer[i, 3] * thrust + share * tilting
        turning = control.mixer[i, 2] * commands[2]
        if turning > 0.0:
            yaw = min(yaw, max(0.0, control.high - so_far) / turning)
        elif turning < 0.0:
            yaw = min(yaw, max(0.0, so_far - control.low) / -turning)
    if yaw < 1.0:
        cut |= 2
    e = control.expo
    for i in range(rotors):
        tilting = control.mixer[i, 0] * commands[0] + control.mixer[i, 1] * commands[1]
        demand = control.mixer[i, 3] * thrust + share * tilting + yaw * control.mixer[i, 2] * commands[2]
        if e != 0.0:
            demand = (e - 1.0 + math.sqrt((1.0 - e) ** 2 + 4.0 * e * max(demand, 0.0))) / (2.0 * e)
        demand = min(1.0, max(0.0, demand / voltage_share))
        outputs[i] = control.output_low + (control.output_high - control.output_low) * demand
    return cut


@bare(forceinline=True)
def _share(voltage: float, present: bool, control: Control) -> float:
    """What the outputs are divided by; one without a battery, whose voltage is then the rated one."""
    if control.voltage_max <= 0.0 or not present:
        return 1.0
    lowest = max(control.voltage_min, _LOWEST_SHARE * control.voltage_max)
    return min(control.voltage_max, max(lowest, voltage)) / control.voltage_max


@bare(forceinline=True)
def _voltage(now: FloatArray, used_as: float, body: Body, supply: Supply) -> tuple[float, float]:
    """Voltage at the terminals and current."""
    lifted = 0.0
    for i in range(now.shape[0] - STATES):
        x = now[STATES + i]
        lifted += max(0.0, body.thrust[0] + x * (body.thrust[1] + x * body.thrust[2])) ** 1.5
    current = supply.current_per_power * lifted
    rest = supply.voltage_full - (supply.voltage_full - supply.voltage_empty) * used_as / supply.capacity_as
    return rest - supply.resistance_ohm * current, current


@bare(forceinline=True)
def _coast(
    k: int,
    share: float,
    wind: FloatArray,
    gain: float,
    body: Body,
    senses: Senses,
    control: Control,
    stride: int,
    log: FloatArray,
    room: Room,
) -> None:
    """One tick of the vehicle, in steps that end where a command arrives and take at most ``stride`` grid steps."""
    now, lagged, phases, late, sent, weights = room.now, room.lagged, room.phases, room.late, room.sent, room.weights
    substeps = control.substeps
    shaking = senses.gyro_vibration > 0.0 or senses.accelerometer_vibration > 0.0
    shown, j = -1, 0
    while j < substeps:
        # The commands that have arrived by now, each after its own delay, and how long no other one will.
        arrived, left = 0, substeps - j
        for axis in range(4):
            since = k * substeps + j - control.delay_steps[axis]
            tick = max(0, since // substeps)
            late[axis] = log[tick, COMMAND + axis]
            arrived += tick
            left = min(left, substeps - since % substeps)
        if arrived != shown:
            _mixed(late, control, share, sent)
            shown = arrived
        # Even steps: five grid steps by at most three are three and two.
        pieces = (left + stride - 1) // stride
        n = (left + pieces - 1) // pieces
        h = n * control.tick_s / substeps
        for axis in range(3):
            lagged[axis] = weights[n, 0] * lagged[axis] + weights[n, 1] * now[10 + axis]
        advance(now, sent, wind, gain, body, h, room.stages)
        for axis in range(3):
            if senses.gyro_lag_s > 0.0:
                for stage in range(4):
                    lagged[axis] += weights[n, 2 + stage] * room.stages[stage, 10 + axis]
            else:
                lagged[axis] = now[10 + axis]
        if shaking:
            for i in range(phases.shape[0]):
                slopes = room.stages[1, STATES + i] + room.stages[2, STATES + i] + room.stages[3, STATES + i]
                phases[i] += h * senses.blade_rad_s * (now[STATES + i] - h / 6.0 * slopes)
        j += n


@bare(forceinline=True)
def _fly(
    asked: FloatArray,
    winds: FloatArray,
    noise: FloatArray,
    body: Body,
    supply: Supply,
    senses: Senses,
    control: Control,
    log: FloatArray,
    truth: FloatArray,
    stride: int,
    room: Room,
) -> int:
    """All ticks of :func:`flight`."""
    ticks: int = asked.shape[0]
    size: int = room.now.shape[0]
    rotors = size - STATES
    now, moved, lagged, seen, hold = room.now, room.moved, room.lagged, room.seen, room.hold
    memory, sections, outputs, sent = room.memory, room.sections, room.outputs, room.sent
    force_keep = math.exp(-control.tick_s / senses.accelerometer_lag_s) if senses.accelerometer_lag_s > 0.0 else 0.0
    force_new = 1.0 - senses.accelerometer_lag_s / control.tick_s * (1.0 - force_keep)
    used_as, voltage, gain = 0.0, 0.0, 1.0
    for axis in range(3):
        lagged[axis] = now[10 + axis]
    for k in range(ticks):
        row = log[k]
        if supply.present:
            voltage, current = _voltage(now, used_as, body, supply)
            used_as += control.tick_s * current
            gain = voltage / supply.voltage_rated
        derivative(now, sent if k > 0 else now[STATES:], winds[k], gain, body, moved)
        felt(now, moved, force_keep if k > 0 else 0.0, force_new if k > 0 else 1.0, lagged, senses)
        sense(now, lagged, room.phases, noise[k], senses, row)
        attitude(now, noise[k], senses.attitude_noise, seen, row)
        for axis in range(3):
            row[RATE + axis] = filtered(control.gyro_filter, sections[axis], row[RATE_RAW + axis])
            value = row[ACCELERATION_RAW + axis]
            row[ACCELERATION + axis] = filtered(control.accelerometer_filter, sections[3 + axis], value)
        thrust = _outer(row, asked[k], seen, hold, control)
        _angles(row, asked[k], seen, control)
        _rates(row, asked[k], memory, k == 0, control)
        row[COMMAND + 3] = min(1.0, max(0.0, thrust + asked[k, 3]))
        share = _share(voltage, supply.present, control)
        cut = _mixed(row[COMMAND : COMMAND + 4], control, share, outputs)
        for axis in range(3):
            memory[6, axis] = memory[5, axis] if cut & (2 if axis == 2 else 1) else 0.0
        row[VOLTAGE], row[SATURATED] = voltage, cut
        for i in range(rotors):
            row[MOTORS + i] = outputs[i]
        for j in range(size + 3):
            truth[k, j] = now[j] if j < size else moved[j]
        _coast(k, share, winds[k], gain, body, senses, control, stride, log, room)
        # Upside down, or no number: what a hover's autopilot does not come back from.
        if not 2.0 * (now[7] * now[7] + now[8] * now[8]) < 1.0:
            return k
    return ticks


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
    stride: int,
) -> int:
    """Fly, and fill ``log`` and ``truth``; the number of ticks flown before the state stopped being a number.

    ``asked``: test inputs ``(ticks, 16)``, four axes of command, rate, attitude and stick; ``winds`` ``(ticks, 3)``;
    ``noise`` ``(ticks, 15)`` standard normal. ``stride``: how many of the ``substeps`` of a tick, on which delays are
    counted, the integrator may take at once.
    """
    rotors = start.shape[0] - STATES
    room = Room(
        now=start.copy(),
        stages=np.empty((5, start.shape[0] + 3)),
        moved=np.zeros(start.shape[0] + 3),
        lagged=np.zeros(9),
        phases=np.zeros(rotors),
        seen=np.empty(4),
        hold=np.zeros(5),
        memory=np.zeros((7, 3)),
        sections=np.zeros((6, 2)),
        outputs=np.empty(rotors),
        sent=np.empty(rotors),
        late=np.empty(4),
        weights=lag_weights(control.substeps, control.tick_s / control.substeps, max(senses.gyro_lag_s, 1e-9)),
    )
    room.hold[2], room.hold[3] = 2.0 * math.atan2(start[9], start[6]), start[2]
    return _fly(asked, winds, noise, body, supply, senses, control, log, truth, stride, room)
