"""Records of a second-order lag behind a delay of any fraction of a sample, with colored noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter

from rotorid.data.record import Channel, TimeHistory
from rotorid.typing import FloatArray

RATE_HZ = 50.0
INPUT, OUTPUT = "phi_setpoint", "phi"
_FINE = 20
NATURAL_RAD_S, DAMPING = 9.0, 0.8


def record_of(u: FloatArray, y: FloatArray, rate_hz: float = RATE_HZ) -> TimeHistory:
    channels = (Channel(name=INPUT, unit="rad"), Channel(name=OUTPUT, unit="rad"))
    return TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=rate_hz, start_s=0.0)


def slower(history: TimeHistory) -> TimeHistory:
    """Every other sample, as a slower log of the same flight holds them."""
    return record_of(history[INPUT][::2], history[OUTPUT][::2], rate_hz=0.5 * history.sample_rate_hz)


def late_lag(
    seed: int, delay_samples: float, *, samples: int = 600, noise: float = 0.02, hold_samples: int = 5
) -> TimeHistory:
    """A random binary input, held, and its answer: exact, for delays in twentieths of a sample."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], size=samples // hold_samples + 1), hold_samples)[:samples]
    lag = round(delay_samples * _FINE)
    late = np.concatenate([np.zeros(lag), np.repeat(u, _FINE)])[: samples * _FINE]
    system = ([NATURAL_RAD_S**2], [1.0, 2.0 * DAMPING * NATURAL_RAD_S, NATURAL_RAD_S**2])
    above, below, _ = cont2discrete(system, 1.0 / (RATE_HZ * _FINE), method="zoh")
    y = lfilter(np.ravel(above), below, late)[::_FINE]
    colored = lfilter([1.0], [1.0, -0.8], rng.normal(size=samples + 100))[100:]
    return record_of(u, y + noise * colored)
