"""Flights that an autopilot leads: a roll loop of known response inside loops of velocity and position, in gusts."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 200.0
ANGLE_P, RATE_RAD_S, DAMPING = 6.5, 25.0, 0.7
VELOCITY_P, POSITION_P = 1.8, 0.95


def truth(omega_rad_s: FloatArray) -> ComplexArray:
    """Roll angle over its set-point."""
    s = 1j * omega_rad_s
    loop = ANGLE_P / s * RATE_RAD_S**2 / (s**2 + 2.0 * DAMPING * RATE_RAD_S * s + RATE_RAD_S**2)
    return loop / (1.0 + loop)


def bandwidth_90deg() -> float:
    """Frequency at which the angle lags its set-point by a quarter of a turn."""
    omega = np.geomspace(1.0, 100.0, 20_000)
    return float(omega[np.argmax(np.unwrap(np.angle(truth(omega))) < -0.5 * np.pi)])


def mission(
    seed: int, *, gusts: float, leg_s: float = 6.0, legs_m: float = 4.0, length_s: float = 120.0, log_hz: float = 50.0
) -> FlightRecord:
    """A flight over points of a mission, or a hover where ``legs_m`` is zero; ``gusts`` in rad/s of roll rate, rms."""
    rng = np.random.default_rng(seed)
    samples, step_s = round(length_s * RATE_HZ), 1.0 / RATE_HZ
    goals = legs_m * rng.normal(size=round(length_s / leg_s) + 1)
    keep = np.exp(-2.0 * np.pi * 0.5 * step_s)
    phi = rate = acceleration = gust = speed = place = wanted = 0.0
    rows = np.zeros((2, samples))
    for n in range(samples):
        # Set-points of a mission are smooth.
        wanted += (goals[int(n * step_s / leg_s)] - wanted) * step_s / 0.5
        gust = keep * gust + np.sqrt(1.0 - keep**2) * gusts * rng.normal()
        setpoint = float(np.clip(VELOCITY_P * (POSITION_P * (wanted - place) - speed) / 9.81, -0.6, 0.6))
        # Two states of the rate loop, and the angle.
        jerk = RATE_RAD_S**2 * (ANGLE_P * (setpoint - phi) - rate) - 2.0 * DAMPING * RATE_RAD_S * acceleration
        acceleration += step_s * jerk
        rate, phi = rate + step_s * acceleration, phi + step_s * (rate + gust)
        speed, place = speed + step_s * 9.81 * np.tan(phi), place + step_s * speed
        rows[:, n] = setpoint, phi
    every = round(RATE_HZ / log_hz)
    logged = rows[:, ::every].copy()
    logged[1] += 0.001 * rng.normal(size=logged.shape[1])
    names = ("phi_setpoint", "phi")
    whole = ((0.0, length_s),)
    return FlightRecord(
        source=Source(name="mission", format="twin", sha256=""),
        topics=(
            Topic(
                name="attitude",
                time_s=np.arange(logged.shape[1]) / log_hz,
                channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
                values=logged,
            ),
        ),
        status=Status(armed=whole, in_air=whole, flagged_in="flags"),
    )
