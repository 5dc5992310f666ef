"""A stitched model from step to step, under its controllers. Importing this module imports Numba."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import FloatArray, IntArray

GRAVITY_M_S2 = 9.80665


class Tables(NamedTuple):
    """A stitched model over speed, see :class:`rotorid.simulation.stitched.StitchedModel`."""

    speed_m_s: FloatArray
    derivatives: FloatArray
    trim: FloatArray
    lag_s: FloatArray
    delay_s: FloatArray


class Loops(NamedTuple):
    """Controllers as one recursion; its inputs are all set-points, then all rates."""

    controlled: IntArray
    """Which command each of them gives, shape ``(loops,)``."""
    angle: IntArray
    """Row of the state that stands for the angle of each, shape ``(loops,)``."""
    transition: FloatArray
    drive: FloatArray
    read: FloatArray
    direct: FloatArray
    start: FloatArray
    setpoints: FloatArray
    """Shape ``(steps, loops)``."""
    excitations: FloatArray
    """The same, added to the commands."""


@njit(cache=True, error_model="numpy")
def _place(speeds: FloatArray, speed: float) -> tuple[int, float]:
    """The interval of a speed and the share of its upper end; the ends hold beyond them."""
    last = speeds.size - 1
    if last == 0 or speed <= speeds[0]:
        return 0, 0.0
    if speed >= speeds[last]:
        return last - 1, 1.0
    k = 0
    while speeds[k + 1] < speed:
        k += 1
    return k, (speed - speeds[k]) / (speeds[k + 1] - speeds[k])


@njit(cache=True, error_model="numpy")
def _between(table: FloatArray, k: int, share: float, column: int) -> float:
    upper = min(k + 1, table.shape[0] - 1)
    return float((1.0 - share) * table[k, column] + share * table[upper, column])


@njit(cache=True, error_model="numpy")
def _slopes(x: FloatArray, late: FloatArray, tables: Tables, filter_1_s: float, out: FloatArray) -> None:
    """Rates of ``u v w p q r phi theta psi``, four lagged commands and the filtered speed; then the specific force."""
    k, share = _place(tables.speed_m_s, x[13])
    upper = min(k + 1, tables.speed_m_s.size - 1)
    u, v, w, p, q, r = x[0], x[1], x[2], x[3], x[4], x[5]
    phi, theta = x[6], x[7]
    phi_0, theta_0 = _between(tables.trim, k, share, 3), _between(tables.trim, k, share, 4)
    change = np.empty(10)
    for i in range(3):
        change[i] = x[i] - _between(tables.trim, k, share, i)
        change[3 + i] = x[3 + i]
    for i in range(4):
        change[6 + i] = x[9 + i] - _between(tables.trim, k, share, 5 + i)
    force = np.zeros(6)
    for i in range(6):
        for j in range(10):
            slope = (1.0 - share) * tables.derivatives[k, i, j] + share * tables.derivatives[upper, i, j]
            force[i] += slope * change[j]
    force[0] += GRAVITY_M_S2 * math.sin(theta_0)
    force[1] -= GRAVITY_M_S2 * math.cos(theta_0) * math.sin(phi_0)
    force[2] -= GRAVITY_M_S2 * math.cos(theta_0) * math.cos(phi_0)
    out[0] = force[0] - GRAVITY_M_S2 * math.sin(theta) - q * w + r * v
    out[1] = force[1] + GRAVITY_M_S2 * math.cos(theta) * math.sin(phi) - r * u + p * w
    out[2] = force[2] + GRAVITY_M_S2 * math.cos(theta) * math.cos(phi) - p * v + q * u
    out[3], out[4], out[5] = force[3], force[4], force[5]
    swing = q * math.sin(phi) + r * math.cos(phi)
    out[6] = p + swing * math.tan(theta)
    out[7] = q * math.cos(phi) - r * math.sin(phi)
    out[8] = swing / math.cos(theta)
    for i in range(4):
        lag = _between(tables.lag_s, k, share, i)
        out[9 + i] = (late[i] - x[9 + i]) / max(lag, 1e-3)
    out[13] = filter_1_s * (u - x[13])
    out[14], out[15], out[16] = force[0], force[1], force[2]


@njit(cache=True, error_model="numpy")
def _arrived(given: FloatArray, step: float, tables: Tables, speed: float, step_s: float, late: FloatArray) -> None:
    """Commands that have arrived at a step and its fractions, straight between steps; the newest one holds."""
    k, share = _place(tables.speed_m_s, speed)
    newest = given.shape[0] - 1
    for i in range(4):
        when = step - _between(tables.delay_s, k, share, i) / step_s
        when = min(max(when, 0.0), newest)
        whole = int(when)
        part = when - whole
        following = min(whole + 1, newest)
        late[i] = (1.0 - part) * given[whole, i] + part * given[following, i]


@njit(cache=True, error_model="numpy")
def fly_stitched(
    start: FloatArray, commands: FloatArray, tables: Tables, loops: Loops, step_s: float, filter_1_s: float
) -> tuple[FloatArray, FloatArray]:
    """States with specific force ``(steps, 17)`` and commands ``(steps, 4)``; Runge and Kutta's fourth order.

    ``start`` has the first 14 states; commands whose loop is closed are replaced.
    """
    steps, count = commands.shape[0], loops.controlled.size
    given = commands.copy()
    states = np.empty((steps, 17))
    x = start.copy()
    z = loops.start.copy()
    inputs = np.empty(2 * count)
    late = np.empty(4)
    slopes = np.empty((4, 17))
    middle = np.empty(14)
    for k in range(steps):
        for i in range(count):
            axis = loops.controlled[i]
            inputs[i], inputs[count + i] = loops.setpoints[k, i], x[3 + axis]
            # The controller integrates the rate to an angle; the angle of the vehicle takes its place.
            z[loops.angle[i]] = x[6 + axis] - step_s * x[3 + axis]
        if count:
            answers = loops.read @ z + loops.direct @ inputs
            for i in range(count):
                given[k, loops.controlled[i]] = answers[i] + loops.excitations[k, i]
            z = loops.transition @ z + loops.drive @ inputs
        for stage in range(4):
            ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for j in range(14):
                middle[j] = x[j] + (ahead * step_s * slopes[stage - 1, j] if stage else 0.0)
            _arrived(given[: k + 1], k + ahead, tables, x[13], step_s, late)
            _slopes(middle, late, tables, filter_1_s, slopes[stage])
        for j in range(14):
            states[k, j] = x[j]
            x[j] += step_s / 6.0 * (slopes[0, j] + 2.0 * (slopes[1, j] + slopes[2, j]) + slopes[3, j])
        for j in range(14, 17):
            states[k, j] = slopes[0, j]
        if not (abs(x[7]) < 1.5 and abs(x[6]) < 1.5):
            states[k + 1 :] = np.nan
            given[k + 1 :] = np.nan
            break
    return states, given
