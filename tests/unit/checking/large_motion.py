"""Whole flights of a vehicle behind set-points with a known answer, logged as motion capture does."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.models.library import nonlinear_model
from rotorid.simulation.nonlinear import simulate_nonlinear
from rotorid.typing import FloatArray

RATE_HZ = 20.0
TRUTH = {
    "k_Dx": 0.28,
    "k_Dy": 0.42,
    "K_phi": 0.95,
    "T_phi": 0.18,
    "tau_phi": 0.06,
    "K_theta": 1.02,
    "T_theta": 0.22,
    "tau_theta": 0.04,
    "K_down": 0.9,
    "T_down": 0.25,
    "tau_down": 0.08,
}
NOISE = {"phi": 0.004, "theta": 0.004, "psi": 0.002, "velocity": 0.02, "position": 0.005}


def binary(size: float, samples: int, rng: np.random.Generator) -> FloatArray:
    holds = rng.integers(4, 24, size=samples)
    return np.asarray(np.repeat(rng.choice([-size, size], size=samples), holds)[:samples])


def large_motion(
    *,
    seed: int = 0,
    samples: int = 500,
    heading_rad: float = 0.6,
    without: tuple[str, ...] = (),
    still: tuple[str, ...] = (),
) -> FlightRecord:
    """Set-points of roll, pitch and climb, and what motion capture sees of the answer; yaw is not commanded."""
    rng = np.random.default_rng(seed)
    model = nonlinear_model("flight.first_order")
    values = {**model.parameters.values, **TRUTH}
    setpoints = {
        "phi_setpoint": binary(0.12, samples, rng),
        "theta_setpoint": binary(0.12, samples, rng),
        "r_setpoint": np.zeros(samples),
        "velocity_down_setpoint": binary(0.5, samples, rng),
    }
    setpoints |= {name: np.zeros(samples) for name in still}
    start = np.zeros(len(model.states))
    start[model.states.index("psi")] = heading_rad
    inputs = np.stack([setpoints[name] for name in model.inputs])
    answer = simulate_nonlinear(model, values, inputs, sample_rate_hz=RATE_HZ, x0=start, before=np.zeros(4))
    rows = {name: row for name, row in setpoints.items() if name != "r_setpoint"}
    for name, row in zip(model.outputs, answer, strict=True):
        kind = name if name in NOISE else "velocity" if name.startswith("velocity") else "position"
        rows[name] = row + NOISE[kind] * rng.standard_normal(samples)
    rows = {name: row for name, row in rows.items() if name not in without}
    return FlightRecord(
        source=Source(name=f"flight{seed}.csv", format="CSV", sha256=f"large-{seed}"),
        topics=(
            Topic(
                name="motion",
                time_s=np.arange(samples) / RATE_HZ,
                channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in rows),
                values=np.stack(list(rows.values())),
            ),
        ),
    )
