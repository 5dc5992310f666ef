"""Logs of a quadrotor whose motors and inertia are known, as a user has them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.speed import motor_speed
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.io.tables import write_csv
from rotorid.vehicles.motor_flight import TRUTH, channels, flights, levers

UNITS = {"p": "rad/s", "q": "rad/s", "r": "rad/s", "az": "m/s^2", "w": "m/s"}
THRUST_BY_SPEED = 6e-6
"""N s^2: thrust of a rotor by the square of its speed."""

ARM_M = 0.2 * 2.0**0.5


@cache
def flown(seed: int, size: float = 1.0) -> MotorRecord:
    """A flight of 20 s, made once for all its logs."""
    return flights(1, seed=seed, duration_s=20.0, size=size)[0]


def written(record: MotorRecord, path: Path, *, every: int = 1) -> Path:
    """The record as a table, its motors at each so-manieth sample joined by straight lines."""
    kept = record.time_s[::every]
    motors = [np.interp(record.time_s, kept, row[::every]) for row in record.outputs]
    columns = [record.time_s, *motors, *record.rates, record.az, record.w]
    names = [
        "time [s]",
        *(f"motor_{i} [1]" for i in range(1, 5)),
        *(f"{name} [{unit}]" for name, unit in UNITS.items()),
    ]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


def with_speeds(path: Path, *, seed: int = 1, momentum: float = 0.0) -> Path:
    """The same flight with measured speeds of the rotors instead of outputs.

    Of what a rotor gains of its speed the vehicle takes up a share, its inertia over that of yaw.
    """
    record = flown(seed)
    level = motor_speed(
        record.outputs, lag_s=TRUTH["T_motor"], delay_s=TRUTH["tau_gyro"], step_s=1.0 / record.sample_rate_hz
    ).level.real
    thrust = TRUTH["c_0"] + TRUTH["c_1"] * level + TRUTH["c_2"] * level**2
    speeds = np.sqrt(thrust / THRUST_BY_SPEED)
    gained = np.diff(levers()[2] @ speeds, prepend=0.0)
    gained[0] = 0.0
    damping = np.exp(TRUTH["N_r"] / record.sample_rate_hz)
    rates = record.rates.copy()
    rates[2] += momentum * lfilter([1.0], [1.0, -damping], gained)
    names = ["time [s]", *(f"motor_speed_{i} [rad/s]" for i in range(1, 5))]
    names += [f"{name} [{unit}]" for name, unit in UNITS.items()]
    columns = [record.time_s, *speeds, *rates, record.az, record.w]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


DRAG = {"X_u": -0.4, "Y_v": -0.25}


def leaning(path: Path, *, seed: int = 1, still: bool = False, positions: bool = False) -> Path:
    """One flight with attitude and velocity, or positions, of a vehicle that its tilt moves against known drag.

    Where it is still nothing moves it sideways, as on a rope, and velocity is noise.
    """
    record = flown(seed)
    rng, step = np.random.default_rng(seed), 1.0 / record.sample_rate_hz
    level = motor_speed(record.outputs, lag_s=TRUTH["T_motor"], delay_s=TRUTH["tau_gyro"], step_s=step).level.real
    force = (
        TRUTH["Z_w"] * record.w
        - (TRUTH["c_0"] + TRUTH["c_1"] * level + TRUTH["c_2"] * level**2).sum(axis=0) / (TRUTH["m"])
    )
    phi, theta = np.cumsum(record.rates[:2], axis=1) * step
    attitude = np.stack([phi, theta, 0.4 + 0.0 * phi])
    body, earth = np.zeros((3, record.samples)), np.zeros((3, record.samples))
    for place in range(record.samples - 1):
        here = attitude[:, place, None]
        body[:, place] = earth_to_body(here, earth[:, place, None])[:, 0]
        pushed = np.array([DRAG["X_u"] * body[0, place], DRAG["Y_v"] * body[1, place], force[place]])
        gained = body_to_earth(here, pushed[:, None])[:, 0]
        earth[:2, place + 1] = 0.0 if still else earth[:2, place] + step * gained[:2]
        earth[2, place + 1] = record.w[place + 1]
    units = {"phi": "rad", "theta": "rad", "psi": "rad"}
    if positions:
        names, rows = ("north", "east", "down"), np.cumsum(earth, axis=1) * step
        rows = rows + 1e-4 * rng.standard_normal(rows.shape)
        units |= dict.fromkeys(names, "m")
    else:
        names = ("velocity_north", "velocity_east", "velocity_down")
        rows = earth + 0.01 * rng.standard_normal(earth.shape)
        units |= dict.fromkeys(names, "m/s")
    columns = channels(record)
    del columns["w"]
    write_csv(path, record.time_s, {**columns, **dict(zip(units, (*attitude, *rows), strict=True))})
    return path


def flight(path: Path, *, seed: int = 1, size: float = 1.0, every: int = 1) -> Path:
    """One flight with sums of sines on all axes, or in gusts alone."""
    return written(flown(seed, size), path, every=every)


def repeated(path: Path, *, every: int) -> Path:
    """The same flight, each so-manieth sample of the motors repeated until the next."""
    record = flown(1)
    held = np.repeat(record.outputs[:, ::every], every, axis=1)[:, : record.samples]
    return written(replace(record, outputs=held), path)
