"""A flight with a known answer to its set-points: random binary signals, held, and colored noise on the outputs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.models.library import response_model
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

RATE_HZ = 50.0
TRUTH = {"K_phi": 0.95, "omega_phi": 9.0, "zeta_phi": 0.7, "tau_phi": 0.047}


def binary(samples: int, rng: np.random.Generator, *, shortest: int = 8) -> FloatArray:
    levels = np.repeat(rng.choice([-0.1, 0.1], size=samples // shortest + 1), shortest)
    return np.asarray(levels[:samples])


def flight(
    *,
    seed: int = 0,
    samples: int = 1500,
    noise: float = 0.004,
    jitter_s: float = 0.0,
    form: str = "response.second_order_delay",
    truth: Mapping[str, float] = TRUTH,
    rate_hz: float = RATE_HZ,
) -> FlightRecord:
    """Set-point and angle of roll that answers in a form; stamps stray by ``jitter_s``."""
    rng = np.random.default_rng(seed)
    setpoint = binary(samples, rng)
    model = response_model(form, [("phi_setpoint", "phi")])
    exact = simulate_linear(model.matrices(truth), setpoint[None], sample_rate_hz=rate_hz)[0]
    color = lfilter([np.sqrt(1.0 - 0.9**2)], [1.0, -0.9], rng.standard_normal(samples))
    time_s = 3.0 + np.arange(samples) / rate_hz + jitter_s * rng.uniform(-1.0, 1.0, samples)
    names = ("phi_setpoint", "phi")
    return FlightRecord(
        source=Source(name=f"flight{seed}.csv", format="CSV", sha256=f"{seed}"),
        topics=(
            Topic(
                name="motion",
                time_s=time_s,
                channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
                values=np.stack([setpoint, exact + noise * color]),
            ),
        ),
    )
