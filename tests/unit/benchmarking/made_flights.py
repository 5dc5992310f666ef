"""Flights of a benchmark whose forces are known: thrust by the squares of the speeds, and a moment about roll."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io

from rotorid.benchmarking.foreign import LoadsTask

MASS_KG, I_XX = 0.752, 2.52e-3
C = 1.8e-6
"""N s² of each rotor."""

NETWORK_MISSES_N = 0.3
RATE_HZ, SAMPLES = 400.0, 2000


def neurobem_folder(folder: Path, *, flights: int = 2, columns: int = 41) -> Path:
    """Files as NeuroBEM's, forward left up, of a vehicle that hangs level and rolls."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(flights):
        scipy.io.savemat(folder / f"bemnn2021022310480{number}seg1.mat", {"bemnn": made_flight(number)[:, :columns]})
    return folder


def made_flight(seed: int) -> np.ndarray:
    """The table of one flight; every speed follows slow sines of its own, far below all filters."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(SAMPLES) / RATE_HZ
    speeds = 1000.0 + 60.0 * np.sin(
        2.0 * np.pi * rng.uniform(0.3, 0.8, 4)[:, None] * time_s + rng.uniform(0, 6, (4, 1))
    )
    thrust = C * (speeds**2).sum(axis=0)
    phi = 0.2 * np.sin(2.0 * np.pi * 0.4 * time_s)
    p = 0.2 * 2.0 * np.pi * 0.4 * np.cos(2.0 * np.pi * 0.4 * time_s)
    p_dot = -0.2 * (2.0 * np.pi * 0.4) ** 2 * np.sin(2.0 * np.pi * 0.4 * time_s)
    table = np.zeros((SAMPLES, 41))
    table[:, 0] = time_s
    table[:, 1], table[:, 4] = p_dot, p
    table[:, 7], table[:, 10] = np.sin(0.5 * phi), np.cos(0.5 * phi)
    table[:, 13] = thrust / MASS_KG
    table[:, 20:24] = speeds.T
    table[:, 28] = 160.0
    # The published network: right but for a constant force to the left.
    table[:, 31], table[:, 30] = thrust, NETWORK_MISSES_N
    table[:, 32] = I_XX * p_dot
    return table


def thrust_by_speed(task: LoadsTask, training: tuple[LoadsTask, ...]) -> np.ndarray:
    """A model of a user: fits one number to the flights that it is given, and knows the moment of the motion."""
    squares = np.concatenate([(each.motors**2).sum(axis=0) for each in training])
    up = np.concatenate([-each.force[2] for each in training])
    loads = np.zeros((6, task.motors.shape[1]))
    loads[2] = -float(squares @ up / (squares @ squares)) * (task.motors**2).sum(axis=0)
    loads[3] = I_XX * np.gradient(task.rates[0], task.time_s)
    return loads


def fails(task: LoadsTask, training: tuple[LoadsTask, ...]) -> np.ndarray:
    """A model of a user with a fault."""
    return np.array(1.0 / 0)


def no_number(task: LoadsTask, training: tuple[LoadsTask, ...]) -> np.ndarray:
    """A model of a user that diverged."""
    return np.full((6, task.motors.shape[1]), np.nan)


def too_short(task: LoadsTask, training: tuple[LoadsTask, ...]) -> np.ndarray:
    """A model of a user that answers for one sample."""
    return np.zeros(6)
