"""Hovers in gusts of a vehicle whose thrust coefficient is known, logged as slowly as people log."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

MASS_KG, C_2, Z_W_1_S = 0.037, 3.72e-8, -0.4
"""Mass, thrust of a rotor over the square of its speed in N s²/rad², and heave damping."""

_STEP_S, _GUST_S = 0.002, 1.5


def hovers(
    count: int,
    *,
    seed: int,
    rate_hz: float,
    duration_s: float = 40.0,
    gust_m_s: float = 0.5,
    bias_m_s2: float = 0.1,
    climb_m_s: float = 0.0,
    logged: tuple[str, ...] = ("phi", "theta", "velocity_down"),
) -> list[FlightRecord]:
    r"""Flights at constant height: gusts along z, rotors that answer to them, vibration, a biased accelerometer.

    .. math:: a_z = -\frac{c_2}{m} \sum \Omega_i^2 + Z_w (w - w_g), \qquad \dot w = a_z + g

    The controller holds height and speed; rotors lag by 30 ms; each rotor has a share of its own.

    Parameters
    ----------
    rate_hz
        Of the log.
    gust_m_s
        Vertical gusts, standard deviation, correlated over 1.5 s.
    bias_m_s2
        Biases of the accelerometer are uniform up to this.
    climb_m_s
        Speed upward that is held.
    logged
        Channels beyond rates, specific force and motor speeds.
    """
    rng = np.random.default_rng(seed)
    samples, every = round(duration_s / _STEP_S), round(1.0 / rate_hz / _STEP_S)
    bias = rng.uniform(-bias_m_s2, bias_m_s2, count)
    calm = np.exp(-_STEP_S / _GUST_S)
    hover = MASS_KG * STANDARD_GRAVITY_M_S2
    gust, w, down, thrust = (np.zeros(count) for _ in range(4))
    gust, w, thrust = gust_m_s * rng.standard_normal(count), w - climb_m_s, thrust + hover
    force, speed, total = (np.zeros((count, samples)) for _ in range(3))
    for place in range(samples):
        gust = calm * gust + gust_m_s * np.sqrt(1.0 - calm**2) * rng.standard_normal(count)
        total[:, place] = thrust
        force[:, place] = -thrust / MASS_KG + Z_W_1_S * (w - gust)
        speed[:, place] = w
        w = w + _STEP_S * (force[:, place] + STANDARD_GRAVITY_M_S2)
        down = down + _STEP_S * (w + climb_m_s)
        asked = hover * (1.0 + (3.0 * (w + climb_m_s) + 2.0 * down) / STANDARD_GRAVITY_M_S2)
        thrust = thrust + (asked - thrust) * _STEP_S / 0.03
    share = 1.0 + 0.05 * np.array([1.0, -1.0, 0.5, -0.5])
    kept = slice(0, None, every)
    time_s = _STEP_S * np.arange(samples)[kept]
    found = []
    for number in range(count):
        size = time_s.size
        rows: dict[str, FloatArray] = {
            f"motor_speed_{motor}": np.sqrt(part * total[number, kept] / 4.0 / C_2)
            * (1.0 + 1e-3 * rng.normal(size=size))
            for motor, part in enumerate(share, start=1)
        }
        rows["az"] = force[number, kept] + bias[number] + 0.5 * rng.normal(size=size)
        rows |= {name: 0.05 * rng.normal(size=size) for name in ("p", "q", "r")}
        rows |= {name: 0.02 + 0.01 * rng.normal(size=size) for name in ("phi", "theta")}
        rows["velocity_down"] = speed[number, kept] + 0.03 * rng.normal(size=size)
        rows = {
            name: row for name, row in rows.items() if name not in ("phi", "theta", "velocity_down") or name in logged
        }
        channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in rows)
        topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
        found.append(FlightRecord(source=Source(name=f"{number}.csv", format="CSV", sha256=""), topics=(topic,)))
    return found
