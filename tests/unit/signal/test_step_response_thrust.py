"""Thrust from the motion: a flight whose thrust is known, with and without a limit."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import UsageError
from rotorid.signal.step_response import CHANNELS, thrust_limit, thrust_over_weight
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2 as G

RATE_HZ = 50.0
TIME_S = np.arange(0.0, 40.0, 1.0 / RATE_HZ)


def flight(limit: float = np.inf, *, noise: float = 0.0) -> tuple[TimeHistory, FloatArray]:
    """Tilts and thrusts of a few frequencies; the velocity is the exact integral on a fine clock."""
    fine_s = np.arange(0.0, 40.0, 0.1 / RATE_HZ)
    phi, theta = 0.2 * np.sin(1.1 * fine_s), 0.15 * np.sin(1.7 * fine_s + 1.0)
    thrust = np.minimum(1.02 + 0.2 * np.sin(0.9 * fine_s) + 0.15 * np.sin(2.3 * fine_s), limit)
    down = G * (1.0 - thrust * np.cos(phi) * np.cos(theta))
    velocity = np.concatenate([[0.0], np.cumsum(0.5 * (down[1:] + down[:-1])) * 0.1 / RATE_HZ])
    rows = np.stack([velocity, phi, theta])[:, ::10]
    rows[0] += noise * np.random.default_rng(0).standard_normal(rows.shape[1])
    history = TimeHistory(
        values=rows,
        channels=tuple(Channel(name=name, unit="1") for name in CHANNELS),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    return history, thrust[::10]


def test_thrust_comes_back_from_the_motion() -> None:
    history, thrust = flight()
    # The derivative of a spline is right to (omega h)^4 / 180, 1e-8 here, away from its ends, and the trapezoidal rule
    # to (omega h)^2 / 12 of the fine clock, 2e-6.
    np.testing.assert_allclose(thrust_over_weight(history)[10:-10], thrust[10:-10], atol=1e-5)


def test_noise_is_filtered_before_the_derivative() -> None:
    history, thrust = flight(noise=0.02)
    raw, smooth = thrust_over_weight(history), thrust_over_weight(history, cutoff_rad_s=12.0)
    error = {name: float(np.std((ratio - thrust)[50:-50])) for name, ratio in (("raw", raw), ("smooth", smooth))}
    assert error["smooth"] < 0.1 * error["raw"]


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(("limit", "saturated"), [(np.inf, False), (1.2, True)])
def test_a_limit_is_seen_and_none_is_invented(limit: float, saturated: bool, noise: float) -> None:
    history, _ = flight(limit, noise=noise)
    ratio = thrust_over_weight(history, cutoff_rad_s=12.0 if noise else None)
    found = thrust_limit(ratio[25:-25], sample_rate_hz=RATE_HZ)
    assert found.saturated is saturated
    assert found.finding.severity == ("warning" if saturated else "info")
    assert found.finding.numbers["highest"] == found.highest
    if saturated:
        assert found.highest == pytest.approx(1.2, abs=0.05)
        assert found.longest_stay_s > 0.3


def test_hover_is_no_limit() -> None:
    steady = 1.0 + 1e-4 * np.random.default_rng(0).standard_normal(400)
    assert not thrust_limit(steady, sample_rate_hz=20.0).saturated
    assert not thrust_limit(np.ones(400), sample_rate_hz=20.0).saturated


def test_a_missing_channel_is_named() -> None:
    history, _ = flight()
    lame = TimeHistory(values=history.values[1:], channels=history.channels[1:], sample_rate_hz=RATE_HZ, start_s=0.0)
    with pytest.raises(UsageError, match="no velocity_down"):
        thrust_over_weight(lame)
