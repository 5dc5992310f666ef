"""Errors of responses: the formula, the exact covariance of a linear estimate, and Monte Carlo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.conditioning import conditioned_response
from rotorid.spectral.errors import compacted, influence, overlap_constant, random_error, response_covariance
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.spectra import spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper
from rotorid.typing import ComplexArray, FloatArray


def history(values: FloatArray, rate_hz: float) -> TimeHistory:
    channels = tuple(Channel(name=f"channel_{row}", unit="1") for row in range(len(values)))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=rate_hz, start_s=0.0)


@pytest.mark.parametrize(("overlap", "square"), [(0.0, 1.0), (0.5, 0.55), (0.65, 0.525), (0.8, 0.5), (0.95, 0.5)])
def test_overlap_constant_has_the_book_s_values(overlap: float, square: float) -> None:
    assert overlap_constant(overlap) ** 2 == pytest.approx(square, rel=1e-14)


@pytest.mark.parametrize(
    ("coherence", "averages", "overlap", "expected"),
    [
        (0.5, 10.0, 0.8, np.sqrt(0.5 / 20.0)),  # (1 - 0.5) / 0.5 = 1
        (0.8, 5.0, 0.5, np.sqrt(0.55 * 0.25 / 10.0)),
        (1.0, 3.0, 0.8, 0.0),
    ],
)
def test_random_error_is_the_printed_formula(
    coherence: float, averages: float, overlap: float, expected: float
) -> None:
    assert random_error(np.array(coherence), averages, overlap=overlap) == pytest.approx(expected, rel=1e-12)


def test_random_error_of_no_coherence_is_large_and_finite() -> None:
    error = random_error(np.array([0.0, -1e-18]), 10.0)
    assert np.all(np.isfinite(error))
    assert error.min() > 1e4


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.7, 0.8])
def test_covariance_is_that_of_the_linear_map_from_disturbance_to_estimate(taper: Taper, overlap: float) -> None:
    # For one window length the estimate is linear in the output. The answers to an impulse at every sample are the
    # whole map, and white noise of variance one has the covariance "map times its conjugate transpose", exactly.
    rate_hz, samples, window_s = 20.0, 800, 4.0
    u = np.random.default_rng(0).standard_normal(samples)
    (matrix,), grid = spectral_matrices(
        [history(np.vstack([u, np.eye(samples)]), rate_hz)],
        np.geomspace(3.2, 40.0, 25),
        windows_s=[window_s],
        overlap=overlap,
        taper=taper,
    )
    answers = matrix.values[:, 0, 1:] / matrix.values[:, 0, :1]
    exact = answers @ answers.conj().T
    moments = int(np.ceil(5 / matrix.window.blocks))
    here = influence(
        conditioned_response(matrix, instruments=[0], inputs=[0]),
        0,
        blocks=samples // grid.samples_per_block,
        taper=taper,
        moments=moments,
    )
    density = np.full(matrix.omega_rad_s.size, 2.0 / rate_hz)
    predicted = response_covariance([here], matrix.omega_rad_s, density, grid.block_s / moments)
    variance = np.diag(exact).real
    # The midpoint rule over products of two tapers. Half-sines meet the ends of their windows with a corner of slope
    # pi / T, which costs of the order (pi / n)**2 / 12 for n = 5 moments in a window.
    assert np.abs(np.diag(predicted).real / variance - 1.0).max() < (np.pi / 5.0) ** 2 / 12.0
    scale = np.sqrt(variance[:, None] * variance)
    assert np.abs(predicted - exact).max() / np.abs(scale).max() < 0.1
    # The comparison means something: neighbors are nearly equal, far points independent.
    assert np.abs(exact / scale)[0, 1] > 0.9
    assert np.abs(exact / scale)[0, -1] < 0.3


def test_influences_in_pieces_and_compacted_have_the_products_of_the_whole() -> None:
    u = np.random.default_rng(0).standard_normal((2, 30_000))
    (matrix,), grid = spectral_matrices([history(u, 20.0)], np.geomspace(3.2, 40.0, 9), windows_s=[4.0])
    separated, blocks = conditioned_response(matrix, instruments=[0], inputs=[0]), 30_000 // grid.samples_per_block
    whole = influence(separated, 0, blocks=blocks, taper=HANN)
    pieces = [
        influence(separated, 0, blocks=min(77, blocks - first), taper=HANN, first_block=first)
        for first in range(0, blocks, 77)
    ]
    assert np.abs(np.concatenate(pieces, axis=1) - whole).max() <= 1e-14 * np.abs(whole).max()
    # A window that counts nowhere stays without influence.
    stacked = [np.stack([piece, np.zeros_like(piece)]) for piece in pieces]
    small = compacted(stacked, blocks)
    assert small.shape == (2, 9, 18)
    assert np.all(small[1] == 0.0)
    level = np.sqrt(np.sum(np.abs(whole) ** 2, axis=1))
    error = (small[0] @ small[0].conj().T - whole @ whole.conj().T) / (level[:, None] * level)
    assert np.abs(error).max() < 1e-10


@dataclass(frozen=True, kw_only=True)
class Study:
    """Errors of many flights, normalized with the covariance that each flight published."""

    normalized: ComplexArray
    correlation: ComplexArray
    coherence: FloatArray
    magnitude_error: FloatArray


RATE_HZ = 50.0
IMPULSE_RESPONSE = np.exp(-np.arange(100) / 8.0) * 0.2
OMEGA = np.geomspace(2.0, 40.0, 25)


def study(flights: int, *, noise: float, samples: int, seed: int) -> Study:
    rng = np.random.default_rng(seed)
    truth = np.exp(-1j * np.arange(100) * OMEGA[:, None] / RATE_HZ) @ IMPULSE_RESPONSE
    rows = []
    for _ in range(flights):
        u, v = rng.standard_normal((2, samples))
        y = np.convolve(u, IMPULSE_RESPONSE)[:samples] + noise * v
        result = frequency_response(
            [history(np.stack([u, y]), RATE_HZ)],
            inputs=["channel_0"],
            outputs=["channel_1"],
            omega_rad_s=OMEGA,
            windows_s=[samples / RATE_HZ / 5.0, samples / RATE_HZ / 10.0, samples / RATE_HZ / 20.0],
        )
        covariance = result.covariance[0, 0]
        deviation = np.sqrt(np.diag(covariance).real)
        rows.append(
            (
                (result.values[0, 0] - truth) / deviation,
                covariance / (deviation[:, None] * deviation),
                result.coherence[0, 0],
                np.log(np.abs(result.values[0, 0] / truth)) / result.random_error[0, 0],
            )
        )
    normalized, correlation, coherence, magnitude = (np.stack(parts) for parts in zip(*rows, strict=True))
    return Study(
        normalized=normalized, correlation=correlation, coherence=coherence.mean(axis=0), magnitude_error=magnitude
    )


def test_covariance_holds_over_sixty_flights() -> None:
    flights = 60
    result = study(flights, noise=0.5, samples=4000, seed=0)
    ratio = np.mean(np.abs(result.normalized) ** 2, axis=0)
    # |z|² of one point is exponential: relative deviation 1/sqrt(60). Neighbors share data; the mean over the grid
    # has the freedom that the predicted correlation leaves. Ten percent are the estimator's own (see the slow study).
    predicted = np.mean(result.correlation, axis=0)
    freedom = flights * OMEGA.size**2 / np.sum(np.abs(predicted) ** 2)
    assert ratio.mean() == pytest.approx(1.0, abs=0.1 + 4.0 / np.sqrt(freedom))
    assert ratio.max() < 1.0 + 5.0 / np.sqrt(flights)
    assert ratio.min() > 1.0 - 4.0 / np.sqrt(flights)


def test_neighboring_frequencies_err_together_as_predicted() -> None:
    flights = 60
    result = study(flights, noise=0.5, samples=4000, seed=1)
    z = result.normalized
    seen = np.mean(z[:, :-1] * z[:, 1:].conj(), axis=0)
    predicted = np.mean(np.diagonal(result.correlation, offset=1, axis1=1, axis2=2), axis=0)
    # A product of unit variables scatters by one at most, so its mean by 1/sqrt(60) at each pair.
    assert np.abs(seen - predicted).max() < 4.0 / np.sqrt(flights)
    assert np.abs(seen - predicted).mean() < 1.5 / np.sqrt(flights)
    assert np.abs(predicted[:5]).min() > 0.6
    assert np.abs(predicted[-1]) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.25, 1.0])
def test_normalized_errors_have_unit_spread_over_five_hundred_flights(noise: float) -> None:
    result = study(500, noise=noise, samples=4000, seed=2)
    trusted = result.coherence > 0.5
    assert trusted.sum() >= 5
    spread = np.sqrt(np.mean(np.abs(result.normalized[:, trusted]) ** 2, axis=0))
    # Five hundred complex numbers give a spread within 2.2 %, so the band of 10 % is the estimator's, not chance.
    assert spread.min() > 0.9
    assert spread.max() < 1.1
    magnitude = np.std(result.magnitude_error[:, trusted], axis=0)
    assert magnitude.mean() == pytest.approx(1.0, abs=0.1)
