"""A whole flight, turn by turn: vehicle, sensors, controllers, mixer. Importing this module imports Numba.

Everything here works on plain arrays; what they mean stands in `rotorid.simulation.multirotor`, and so do the columns
of the log. :func:`derivative` is written so that its uncompiled form takes complex numbers, from which linear models
are made without finite differences.

Numba keeps compiled code beside the file and knows stale code by that file alone. Everything that a flight calls is
therefore here. Only the numbers that come from `rotorid.simulation.multirotor` (order of states, columns of the log)
are compiled in from outside: after a change of those, remove ``__pycache__/flight_kernels*.nb*``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rotorid.compiling import njit
from rotorid.simulation.multirotor import (
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
    STATES,
    VELOCITY,
    VOLTAGE,
    Body,
    Control,
    Senses,
    Supply,
)
from rotorid.typing import FloatArray

Kernel = TypeVar("Kernel", bound=Callable[..., object])

_STILL_M_S, _STILL = 1e-6, 1e-12
_NEWTON_STEPS, _LEAST_SLOPE = 12, 0.3
"""At most, and the least slope: in the vortex ring state momentum theory has none that leads anywhere."""
_SOLVED = 1e-9
"""Last change of the induced velocity over that of hover: the next one is its square, and so is the error of slopes."""


def bare(**options: Any) -> Callable[[Kernel], Kernel]:
    """Compile a kernel without the counting of references.

    Numba counts who holds an array wherever a kernel takes a row or a field, with instructions that lock the bus: in
    the loop of a flight that was a third of the time. A kernel that makes no array needs none of it, and Numba refuses
    to compile one that does. The option has no public name; Numba's own sorting is compiled so.

    Parameters
    ----------
    options
        More for ``njit``, such as ``forceinline`` and ``fastmath``.
    """
    return njit(cache=True, nogil=True, error_model="numpy", _nrt=False, **options)


@bare(fastmath={"contract", "nsz"}, forceinline=True)
def derivative(
    state: FloatArray, outputs: FloatArray, wind: FloatArray, gain: float, body: Body, out: FloatArray
) -> None:
    """Write the time derivative of ``state`` to the first places of ``out``, and the specific force after it.

    ``out`` has ``13 + rotors + 3`` places, ``gain`` is what the voltage makes of the outputs to the motors.

    One function, however long: its uncompiled form takes complex numbers, for which any kernel that it called would be
    compiled anew.
    """
    rotors = outputs.shape[0]
    qw, qx, qy, qz = state[6], state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    # Body to earth.
    r00, r01, r02 = 1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)
    r10, r11, r12 = 2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qw * qx)
    r20, r21, r22 = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
    north, east, down = state[3] - wind[0], state[4] - wind[1], state[5] - wind[2]
    u = r00 * north + r10 * east + r20 * down
    v = r01 * north + r11 * east + r21 * down
    w = r02 * north + r12 * east + r22 * down
    X, Y, Z = 0.0 * u, 0.0 * u, 0.0 * u
    L, M, N = 0.0 * u, 0.0 * u, 0.0 * u
    hx, hy, hz = 0.0 * u, 0.0 * u, 0.0 * u
    # Into locals once: the compiler cannot know that `out` is none of them.
    c0, c1, c2 = body.thrust[0], body.thrust[1], body.thrust[2]
    d0, d1, d2 = body.torque[0], body.torque[1], body.torque[2]
    # Up and down without a branch, which noise on the outputs would make a gamble; equal lags are exact for complex.
    mean_rate, more_up = 0.5 / body.lag_up + 0.5 / body.lag_down, 0.5 / body.lag_up - 0.5 / body.lag_down
    E, T = body.effectiveness, body.torque_axes
    for i in range(rotors):
        x = state[STATES + i] if body.has_lag else gain * outputs[i]
        gap = gain * outputs[i] - x
        speed_rate = mean_rate * gap + more_up * abs(gap)
        out[STATES + i] = speed_rate
        thrust = c0 + x * (c1 + x * c2)
        torque = d0 + x * (d1 + x * d2)
        spin, spin_rate = x, speed_rate
        if body.has_air:
            rx, ry, rz = body.hubs[i, 0], body.hubs[i, 1], body.hubs[i, 2]
            ui, vi, wi = u + q * rz - r * ry, v + r * rx - p * rz, w + p * ry - q * rx
            if body.has_flow:
                # The speed that the thrust in hover gives, of which thrust is the square.
                spin = np.sqrt(thrust / body.full_thrust) if thrust.real > 0.0 else 0.0 * x
                spin_rate = (c1 + 2.0 * c2 * x) * speed_rate / (2.0 * body.full_thrust * (spin + _STILL))
            thrust += body.inflow * spin * wi
            drag = -body.induced_drag * spin
            if body.has_flow:
                # The induced velocity of momentum theory, from that of hover by Newton's method, as in models.flight.
                hover = body.induced_per_share * spin
                induced, strength, climb = hover, hover * hover, -wi
                across = ui * ui + vi * vi
                for _ in range(_NEWTON_STEPS):
                    through = induced + climb
                    length = np.sqrt(across + through * through) + 1e-9
                    slope = 1.0 + strength * through / (length * length * length)
                    if slope.real < _LEAST_SLOPE:
                        slope = _LEAST_SLOPE + 0.0 * slope
                    change = (induced - strength / length) / slope
                    induced = induced - change
                    if induced.real < 0.0:
                        induced = 0.0 * induced
                    elif induced.real > 3.0 * hover.real + 1.0:
                        induced = 3.0 * hover + 1.0
                    if abs(change.real) <= _SOLVED * hover.real:
                        break
                lam = climb + induced
                thrust -= body.inflow * spin * (induced - hover)
                torque += body.inflow_torque * (lam * lam - strength)
                # Without a corner where there is no edgewise flow.
                edge = np.sqrt(across + 1e-18)
                thrust += edge * (body.edge_lift * spin + body.edge_climb_lift * climb)
                thrust += edge * body.edge_speed_lift * np.sqrt(climb * climb)
                thrust += body.wake * (rx * ui + ry * vi) * climb
                drag -= body.climb_drag * climb
                through = lam if lam.real >= 0.0 else -lam
                length = through + np.sqrt(across + lam * lam) + _STILL_M_S
                L += body.side_flapping[i] * spin * ui - body.flapping * spin * induced / length * vi
                backward = body.flapping + body.forward_flapping
                M += body.side_flapping[i] * spin * vi + backward * spin * induced / length * ui
                N -= body.yaw_damping * spin * r
            if body.inclined:
                across = ui * ui + vi * vi
                total = across + wi * wi
                drag = drag * np.sqrt(across / total) if total.real > 0.0 else 0.0 * drag
            dx, dy = drag * ui, drag * vi
            X += dx
            Y += dy
            L -= rz * dy
            M += rz * dx
            N += rx * dy - ry * dx
        X += E[0, i] * thrust
        Y += E[1, i] * thrust
        Z += E[2, i] * thrust
        L += E[3, i] * thrust + T[0, i] * torque
        M += E[4, i] * thrust + T[1, i] * torque
        N += E[5, i] * thrust + T[2, i] * torque
        if body.has_spin:
            L -= body.spin_momentum[0, i] * spin_rate
            M -= body.spin_momentum[1, i] * spin_rate
            N -= body.spin_momentum[2, i] * spin_rate
            hx += body.spin_momentum[0, i] * spin
            hy += body.spin_momentum[1, i] * spin
            hz += body.spin_momentum[2, i] * spin
    if body.has_aerodynamics:
        A = body.aerodynamics
        X += A[0, 0] * u + A[0, 1] * v + A[0, 2] * w + A[0, 3] * p + A[0, 4] * q + A[0, 5] * r
        Y += A[1, 0] * u + A[1, 1] * v + A[1, 2] * w + A[1, 3] * p + A[1, 4] * q + A[1, 5] * r
        Z += A[2, 0] * u + A[2, 1] * v + A[2, 2] * w + A[2, 3] * p + A[2, 4] * q + A[2, 5] * r
        L += A[3, 0] * u + A[3, 1] * v + A[3, 2] * w + A[3, 3] * p + A[3, 4] * q + A[3, 5] * r
        M += A[4, 0] * u + A[4, 1] * v + A[4, 2] * w + A[4, 3] * p + A[4, 4] * q + A[4, 5] * r
        N += A[5, 0] * u + A[5, 1] * v + A[5, 2] * w + A[5, 3] * p + A[5, 4] * q + A[5, 5] * r
    if body.has_quadratic_drag:
        X -= body.quadratic_drag[0] * u * np.sqrt(u * u)
        Y -= body.quadratic_drag[1] * v * np.sqrt(v * v)
        Z -= body.quadratic_drag[2] * w * np.sqrt(w * w)
    if body.vertical_drag != 0.0:
        Z -= body.vertical_drag * w * np.sqrt(u * u + v * v + w * w)
    lightness = 1.0 / body.mass
    ax, ay, az = X * lightness, Y * lightness, Z * lightness
    J, K = body.inertia, body.inverse_inertia
    hx += J[0, 0] * p + J[0, 1] * q + J[0, 2] * r
    hy += J[1, 0] * p + J[1, 1] * q + J[1, 2] * r
    hz += J[2, 0] * p + J[2, 1] * q + J[2, 2] * r
    L -= q * hz - r * hy
    M -= r * hx - p * hz
    N -= p * hy - q * hx
    out[0], out[1], out[2] = state[3], state[4], state[5]
    out[3] = r00 * ax + r01 * ay + r02 * az
    out[4] = r10 * ax + r11 * ay + r12 * az
    out[5] = r20 * ax + r21 * ay + r22 * az + body.gravity
    out[6] = -0.5 * (qx * p + qy * q + qz * r)
    out[7] = 0.5 * (qw * p + qy * r - qz * q)
    out[8] = 0.5 * (qw * q + qz * p - qx * r)
    out[9] = 0.5 * (qw * r + qx * q - qy * p)
    out[10] = K[0, 0] * L + K[0, 1] * M + K[0, 2] * N
    out[11] = K[1, 0] * L + K[1, 1] * M + K[1, 2] * N
    out[12] = K[2, 0] * L + K[2, 1] * M + K[2, 2] * N
    out[STATES + rotors], out[STATES + rotors + 1], out[STATES + rotors + 2] = ax, ay, az


@bare()
def advance(
    state: FloatArray, outputs: FloatArray, wind: FloatArray, gain: float, body: Body, step_s: float, room: FloatArray
) -> None:
    """Replace ``state`` by that one step later: Runge and Kutta, order 4, inputs held.

    ``room`` has ``(5, size + 3)`` places; its first four rows keep the slopes of the four stages.
    """
    size = state.shape[0]
    middle = room[4]
    if not body.has_lag:
        for i in range(outputs.shape[0]):
            state[STATES + i] = gain * outputs[i]
    for j in range(size):
        middle[j] = state[j]
    # One call in a loop, so that the compiler can put the equations in its place.
    for stage in range(4):
        derivative(middle, outputs, wind, gain, body, room[stage])
        ahead = step_s if stage == 2 else 0.5 * step_s
        for j in range(size):
            middle[j] = state[j] + ahead * room[stage, j]
    for j in range(size):
        state[j] += step_s / 6.0 * (room[0, j] + 2.0 * (room[1, j] + room[2, j]) + room[3, j])
    norm = np.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    for j in range(6, 10):
        state[j] /= norm


@njit(cache=True, nogil=True, error_model="numpy")
def glide(
    state: FloatArray, outputs: FloatArray, winds: FloatArray, gain: float, body: Body, step_s: float
) -> FloatArray:
    """States ``(steps + 1, size)`` under given ``outputs`` ``(steps, rotors)`` and ``winds`` ``(steps, 3)``."""
    steps, rotors = outputs.shape
    states = np.empty((steps + 1, STATES + rotors))
    room = np.empty((5, STATES + rotors + 3))
    now = state.copy()
    states[0] = now
    for k in range(steps):
        advance(now, outputs[k], winds[k], gain, body, step_s, room)
        states[k + 1] = now
    return states


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
def attitude(now: FloatArray, noise: FloatArray, spread: float, measured: FloatArray, row: FloatArray) -> None:
    """The estimated quaternion, and its angles into a row of the log."""
    qw, qx, qy, qz = now[6], now[7], now[8], now[9]
    ex, ey, ez = 0.5 * spread * noise[6], 0.5 * spread * noise[7], 0.5 * spread * noise[8]
    a = qw - qx * ex - qy * ey - qz * ez
    b = qx + qw * ex + qy * ez - qz * ey
    c = qy + qw * ey + qz * ex - qx * ez
    d = qz + qw * ez + qx * ey - qy * ex
    norm = math.sqrt(a * a + b * b + c * c + d * d)
    a, b, c, d = a / norm, b / norm, c / norm, d / norm
    measured[0], measured[1], measured[2], measured[3] = a, b, c, d
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


_STICK_OUT = 0.01
_LOWEST_SHARE = 0.6
"""ArduPilot's compensation takes no voltage below this share of the highest."""


class Room(NamedTuple):
    """What a flight remembers from tick to tick, and where it works."""

    now: FloatArray
    """State, shape ``(size,)``."""
    stages: FloatArray
    """See :func:`advance`, shape ``(5, size + 3)``."""
    moved: FloatArray
    """Derivative of the state and specific force at the tick, shape ``(size + 3,)``."""
    lagged: FloatArray
    """Rates after the lag of the sensors, specific force after it and before it, shape ``(9,)``."""
    phases: FloatArray
    """Angles of the rotors, shape ``(rotors,)``."""
    seen: FloatArray
    """Estimated quaternion."""
    hold: FloatArray
    """Integrals and held values of the outer loops, the place that is held last, shape ``(7,)``."""
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
    """See :func:`lag_weights`."""


@bare(forceinline=True)
def _outer(row: FloatArray, asked: FloatArray, measured: FloatArray, hold: FloatArray, control: Control) -> float:
    """Angle set-points into a row of the log and the thrust command as result. ``hold``: integrals and held values."""
    tick = control.tick_s
    a, b, c, d = measured[0], measured[1], measured[2], measured[3]
    phi_wanted = asked[8] + control.stick_tilt * asked[12]
    theta_wanted = asked[9] - control.stick_tilt * asked[13]
    if control.hold_velocity:
        # Of the heading; zero over zero where the nose points straight up or down, and has none.
        cosine, sine = 1.0 - 2.0 * (c * c + d * d), 2.0 * (a * d + b * c)
        level = math.sqrt(cosine * cosine + sine * sine)
        cosine, sine = (cosine / level, sine / level) if level > 0.0 else (1.0, 0.0)
        ahead = cosine * row[VELOCITY] + sine * row[VELOCITY + 1]
        right = -sine * row[VELOCITY] + cosine * row[VELOCITY + 1]
        # The place that is held moves ahead with the speed that is asked for.
        north, east = row[POSITION] - hold[5], row[POSITION + 1] - hold[6]
        off_ahead = -control.position_p * (cosine * north + sine * east) - ahead + asked[16]
        off_right = -control.position_p * (-sine * north + cosine * east) - right
        hold[5] += tick * cosine * asked[16]
        hold[6] += tick * sine * asked[16]
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
def _angles(row: FloatArray, asked: FloatArray, measured: FloatArray, control: Control) -> None:
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
    qw, qx, qy, qz = measured[0], measured[1], measured[2], measured[3]
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
        motor_speed = control.mixer[i, 2] * commands[2]
        if motor_speed > 0.0:
            yaw = min(yaw, max(0.0, control.high - so_far) / motor_speed)
        elif motor_speed < 0.0:
            yaw = min(yaw, max(0.0, so_far - control.low) / -motor_speed)
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
    now, moved, lagged, measured, hold = room.now, room.moved, room.lagged, room.seen, room.hold
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
        attitude(now, noise[k], senses.attitude_noise, measured, row)
        for axis in range(3):
            row[RATE + axis] = filtered(control.gyro_filter, sections[axis], row[RATE_RAW + axis])
            value = row[ACCELERATION_RAW + axis]
            row[ACCELERATION + axis] = filtered(control.accelerometer_filter, sections[3 + axis], value)
        thrust = _outer(row, asked[k], measured, hold, control)
        _angles(row, asked[k], measured, control)
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

    ``asked``: test inputs ``(ticks, 17)``, four axes of command, rate, attitude and stick, and the speed ahead that is
    held; ``winds`` ``(ticks, 3)``; ``noise`` ``(ticks, 15)`` standard normal. ``stride``: how many of the ``substeps``
    of a tick, on which delays are counted, the integrator may take at once.
    """
    rotors = start.shape[0] - STATES
    room = Room(
        now=start.copy(),
        stages=np.empty((5, start.shape[0] + 3)),
        moved=np.zeros(start.shape[0] + 3),
        lagged=np.zeros(9),
        phases=np.zeros(rotors),
        seen=np.empty(4),
        hold=np.zeros(7),
        memory=np.zeros((7, 3)),
        sections=np.zeros((6, 2)),
        outputs=np.empty(rotors),
        sent=np.empty(rotors),
        late=np.empty(4),
        weights=lag_weights(control.substeps, control.tick_s / control.substeps, max(senses.gyro_lag_s, 1e-9)),
    )
    room.hold[2], room.hold[3] = 2.0 * math.atan2(start[9], start[6]), start[2]
    return _fly(asked, winds, noise, body, supply, senses, control, log, truth, stride, room)
