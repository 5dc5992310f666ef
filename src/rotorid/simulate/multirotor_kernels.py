"""The equations of a multirotor and their integration. Importing this module imports Numba: do it inside a function.

Everything here works on plain arrays; what they mean stands in `rotorid.simulate.packed`. :func:`derivative` is written
so that its uncompiled form takes complex numbers, from which linear models are made without finite differences.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rotorid.simulate.bare import bare
from rotorid.simulate.packed import STATES, Body
from rotorid.typing import FloatArray


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
        if body.has_air:
            rx, ry, rz = body.hubs[i, 0], body.hubs[i, 1], body.hubs[i, 2]
            ui, vi, wi = u + q * rz - r * ry, v + r * rx - p * rz, w + p * ry - q * rx
            thrust += body.inflow * x * wi
            drag = -body.induced_drag * x
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
            L -= body.spin_momentum[0, i] * speed_rate
            M -= body.spin_momentum[1, i] * speed_rate
            N -= body.spin_momentum[2, i] * speed_rate
            hx += body.spin_momentum[0, i] * x
            hy += body.spin_momentum[1, i] * x
            hz += body.spin_momentum[2, i] * x
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
