"""Correlation of the disturbances of several outputs, from noises whose mixture is known."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import FloatArray

RATE_HZ = 20.0
SAMPLES = 40_000
WINDOWS_S = (20.0, 8.0)
OMEGA = np.geomspace(1.0, 20.0, 12)

# Points average over five neighbors of windows, of which the longest, with overlapping Hann windows, stand for some 1.8
# independent ones in each of their length. The error of a correlation of n averages is below 1 / sqrt(n); five of
# those.
AVERAGES = 1.8 * SAMPLES / RATE_HZ / max(WINDOWS_S)
TOLERANCE = 5.0 / np.sqrt(AVERAGES)


def respond(u: FloatArray, outputs: FloatArray) -> FrequencyResponse:
    rows = np.vstack([u[None], outputs])
    names = ["u", *(f"y{row}" for row in range(len(outputs)))]
    history = TimeHistory(
        values=rows,
        channels=tuple(Channel(name=name, unit="1") for name in names),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    return frequency_response([history], inputs=["u"], outputs=names[1:], omega_rad_s=OMEGA, windows_s=WINDOWS_S)


def lagged(u: FloatArray) -> FloatArray:
    """An output that follows the input with a lag of 0.3 s, periodic as the derivative below is."""
    omega = 2.0 * np.pi * np.fft.rfftfreq(u.size, 1.0 / RATE_HZ)
    return np.fft.irfft(np.fft.rfft(u) * 10.0 / (1.0 + 0.3j * omega), u.size)


def derivative(values: FloatArray) -> FloatArray:
    spectrum = np.fft.rfft(values) * 2j * np.pi * np.fft.rfftfreq(values.size, 1.0 / RATE_HZ)
    return np.fft.irfft(spectrum, values.size)


def correlation(response: FrequencyResponse) -> np.ndarray:
    found = response.output_correlation
    assert found is not None
    return found[0]


@pytest.mark.parametrize("mixed", [0.0, 0.6, -0.9])
def test_a_known_mixture_of_noises_is_found(mixed: float) -> None:
    rng = np.random.default_rng(0)
    u, one, other = rng.standard_normal((3, SAMPLES))
    noises = np.stack([one, mixed * one + np.sqrt(1.0 - mixed**2) * other])
    response = respond(u, np.stack([lagged(u), -0.3 * lagged(u)]) + noises)
    np.testing.assert_allclose(correlation(response)[0, 1], mixed, atol=TOLERANCE)


def test_a_noise_and_its_derivative_are_ninety_degrees_apart() -> None:
    rng = np.random.default_rng(1)
    u, drive = rng.standard_normal((2, SAMPLES))
    noise = lagged(drive)
    found = correlation(respond(u, np.stack([lagged(u) + noise, derivative(lagged(u) + noise)])))
    # E[V (j omega V)*] = -j omega |V|^2. Whole but for what the taper makes of it: the line of a window has a width of
    # pi / T, over which the factor omega changes.
    width = np.pi / min(WINDOWS_S) / OMEGA
    assert np.all(np.abs(found[0, 1] + 1j) <= 2.0 * width + 0.02)
    assert np.all(np.abs(found[1, 0] - 1j) <= 2.0 * width + 0.02)


def test_correlations_are_hermitian_with_ones_and_never_beyond_one() -> None:
    rng = np.random.default_rng(2)
    u = rng.standard_normal(2000)
    outputs = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.2, -1.0, 1.0]]) @ rng.standard_normal((3, 2000)) + u
    found = correlation(respond(u, outputs))
    np.testing.assert_allclose(found, found.conj().swapaxes(0, 1), atol=1e-14)
    np.testing.assert_array_equal(np.einsum("aaf->af", found), 1.0)
    matrices = np.moveaxis(found, -1, 0)
    assert np.linalg.eigvalsh(matrices).min() >= -1e-12


def test_what_the_input_moves_is_no_disturbance() -> None:
    rng = np.random.default_rng(3)
    u, one, other = rng.standard_normal((3, SAMPLES))
    loud = respond(u, np.stack([5.0 * lagged(u) + one, 2.0 * lagged(u) + other]))
    np.testing.assert_allclose(correlation(loud)[0, 1], 0.0, atol=TOLERANCE)


def without_noise() -> np.ndarray:
    u = np.random.default_rng(4).standard_normal(4000)
    return correlation(respond(u, np.stack([2.0 * u, -u, 0.5 * u])))


def test_without_noise_nothing_is_warned_of() -> None:
    assert np.isfinite(without_noise()).all()


def test_without_noise_correlations_stay_correlations() -> None:
    assert np.linalg.eigvalsh(np.moveaxis(without_noise(), -1, 0)).min() >= -1e-9
