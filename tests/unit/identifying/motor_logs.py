"""Logs of a quadrotor whose motors and inertia are known, as a user has them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.speed import motor_speed
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

UNITS = {"p": "rad/s", "q": "rad/s", "r": "rad/s", "az": "m/s^2", "w": "m/s"}
THRUST_BY_SPEED = 6e-6
"""N s^2: thrust of a rotor by the square of its speed."""

ARM_M = 0.2 * 2.0**0.5


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
    record = flights(1, seed=seed, duration_s=20.0)[0]
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


def flight(path: Path, *, seed: int = 1, size: float = 1.0, every: int = 1) -> Path:
    """One flight with sums of sines on all axes, or in gusts alone."""
    return written(flights(1, seed=seed, duration_s=20.0, size=size)[0], path, every=every)


def repeated(path: Path, *, every: int) -> Path:
    """The same flight, each so-manieth sample of the motors repeated until the next."""
    record = flights(1, seed=1, duration_s=20.0)[0]
    held = np.repeat(record.outputs[:, ::every], every, axis=1)[:, : record.samples]
    return written(replace(record, outputs=held), path)
