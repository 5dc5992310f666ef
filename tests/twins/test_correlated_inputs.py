"""Three inputs that move together, three outputs, noise: every conditioned response within its error band."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.estimate import diagnosed_response
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 50.0
SAMPLES = 30_000
INPUTS, OUTPUTS = ("roll_command", "pitch_command", "yaw_command"), ("p", "q")
OMEGA = np.geomspace(1.5, 25.0, 30)
WINDOWS_S = (25.0, 14.0, 8.0)
SHARED = 0.5
"""Coherence of every two inputs: each is its own noise plus as much of a common one."""

GAINS = np.array([[20.0, 4.0, -8.0], [3.0, -15.0, 6.0]])
DAMPINGS = np.array([[2.0, 3.0, 1.0], [4.0, 1.5, 2.0]])
POLES = np.exp(-DAMPINGS / RATE_HZ)
STEPS = GAINS / DAMPINGS * (1.0 - POLES)


def plants(omega_rad_s: FloatArray) -> ComplexArray:
    """Zero-order-hold equivalents, shape ``(y, u, f)``."""
    return STEPS[..., None] / (np.exp(1j * omega_rad_s / RATE_HZ) - POLES[..., None])


def fly(seed: int) -> TimeHistory:
    rng = np.random.default_rng(seed)
    own, common = rng.standard_normal((3, SAMPLES)), rng.standard_normal(SAMPLES)
    # |S_12|² / (S_11 S_22) = SHARED where the common part has the share sqrt(SHARED) of the power.
    u = np.sqrt(1.0 - np.sqrt(SHARED)) * own + SHARED**0.25 * common
    y = np.stack(
        [
            sum(signal.lfilter([0.0, STEPS[i, j]], [1.0, -POLES[i, j]], u[j]) for j in range(3))
            + 1.5 * rng.standard_normal(SAMPLES)
            for i in range(2)
        ]
    )
    names = [(name, "1") for name in INPUTS] + [(name, "rad/s") for name in OUTPUTS]
    channels = tuple(Channel(name=name, unit=unit) for name, unit in names)
    return TimeHistory(values=np.vstack([u, y]), channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def normalized(response: FrequencyResponse) -> FloatArray:
    """Errors over the stated standard deviation of the complex value, shape ``(y, u, f)``."""
    error = response.values - plants(response.omega_rad_s)
    return np.abs(error) / np.sqrt(np.einsum("yuff->yuf", response.covariance).real)


@pytest.fixture(scope="module")
def flights() -> list[FrequencyResponse]:
    return [
        diagnosed_response([fly(seed)], inputs=INPUTS, outputs=OUTPUTS, omega_rad_s=OMEGA, windows_s=WINDOWS_S)[0]
        for seed in range(12)
    ]


def test_each_conditioned_response_is_within_its_error_band(flights: list[FrequencyResponse]) -> None:
    z = np.stack([normalized(response) for response in flights])
    # |z|² of a right error is exponential with mean one: 95 % lie below sqrt(3). Some seven independent points stand
    # behind each of 72 responses.
    assert np.mean(z < np.sqrt(3.0)) == pytest.approx(0.95, abs=0.03)
    per_pair = np.sqrt(np.mean(z**2, axis=(0, 3)))
    assert per_pair == pytest.approx(np.ones((2, 3)), abs=0.2)


def test_ignoring_the_other_inputs_would_be_wrong_by_far_more() -> None:
    alone, _ = diagnosed_response(
        [fly(0)], inputs=INPUTS[1:2], outputs=OUTPUTS[:1], omega_rad_s=OMEGA, windows_s=WINDOWS_S
    )
    error = np.abs(alone.values[0, 0] / plants(OMEGA)[0, 1] - 1.0)
    assert np.median(error) > 1.0
    assert np.median(error / alone.random_error[0, 0]) > 10.0


def test_what_the_inputs_share_is_said() -> None:
    response, diagnostics = diagnosed_response(
        [fly(1)], inputs=INPUTS, outputs=OUTPUTS, omega_rad_s=OMEGA, windows_s=WINDOWS_S
    )
    off = ~np.eye(3, dtype=bool)
    # A coherence from some forty independent windows is too high by a few hundredths and scatters by 0.1 at each point.
    assert diagnostics.input_coherence[off].mean() == pytest.approx(SHARED, abs=0.06)
    assert np.allclose(diagnostics.input_coherence[~off], 1.0)
    # Eigenvalues of a matrix of ones and sqrt(0.5): 1 + 2 sqrt(0.5) and 1 - sqrt(0.5).
    assert np.median(diagnostics.condition) == pytest.approx((1 + np.sqrt(2)) / (1 - np.sqrt(0.5)), rel=0.3)
    assert np.all(diagnostics.multiple_coherence >= response.coherence.max(axis=1) - 0.1)
    assert np.allclose(diagnostics.share.sum(axis=2), 1.0)
