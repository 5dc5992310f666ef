"""Composite windows: the weighted mean and the least squares over spectra and coherence."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.composite import PairSpectra, compose_by_least_squares, compose_by_weights, window_weights
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import FloatArray


def objective(point: FloatArray, pairs: PairSpectra, weights: FloatArray, column: int) -> complex:
    """The objective of the documentation, written out literally for one frequency.

    ``point`` holds Gxx, Gyy, Re Gxy and Im Gxy; analytic, so that a complex step differentiates it exactly.
    """
    share = weights[:, column] ** 2 / np.sum(weights[:, column] ** 2)
    mean_xx = np.sum(share * pairs.input_auto[:, column])
    mean_yy = np.sum(share * pairs.output_auto[:, column])
    mean_xy = abs(np.sum(share * pairs.cross[:, column]))
    mean_coherence = mean_xy**2 / (mean_xx * mean_yy)
    xx, yy, real, imag = point
    coherence = (real**2 + imag**2) / (xx * yy)
    total = 0.0 + 0.0j
    for i, weight in enumerate(weights[:, column]):
        xx_i, yy_i, xy_i = pairs.input_auto[i, column], pairs.output_auto[i, column], pairs.cross[i, column]
        coherence_i = abs(xy_i) ** 2 / (xx_i * yy_i)
        total += weight * (
            ((xx - xx_i) / mean_xx) ** 2
            + ((yy - yy_i) / mean_yy) ** 2
            + ((real - xy_i.real) / mean_xy) ** 2
            + ((imag - xy_i.imag) / mean_xy) ** 2
            + 5.0 * ((coherence - coherence_i) / mean_coherence) ** 2
        )
    return complex(total)


def gradient(point: FloatArray, pairs: PairSpectra, weights: FloatArray, column: int) -> FloatArray:
    """Derivative by relative change of each coordinate, by complex step."""
    size = np.array([point[0], point[1], np.hypot(point[2], point[3]), np.hypot(point[2], point[3])])
    steps = np.diag(1e-30j * size)
    return np.array([objective(point + step, pairs, weights, column).imag / 1e-30 for step in steps])


def scattered(spread: float, *, windows: int = 5, points: int = 30, seed: int = 0) -> PairSpectra:
    """Windows of coherence around 0.8 that differ by ``spread``."""
    rng = np.random.default_rng(seed)
    xx = np.exp(spread * rng.standard_normal((windows, points)))
    phase = rng.uniform(-np.pi, np.pi, points) + spread * rng.standard_normal((windows, points))
    cross = 2.0 * np.exp(spread * rng.standard_normal((windows, points)) + 1j * phase) * xx
    coherence = np.clip(0.8 + 0.3 * spread * rng.standard_normal((windows, points)), 0.4, 0.99)
    return PairSpectra(input_auto=xx, output_auto=np.abs(cross) ** 2 / (xx * coherence), cross=cross)


def weights_like(pairs: PairSpectra, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).uniform(0.05, 1.0, pairs.input_auto.shape)


def test_windows_that_agree_are_returned_by_both_forms() -> None:
    one = scattered(0.2, windows=1)
    pairs = PairSpectra(
        input_auto=np.repeat(one.input_auto, 4, axis=0),
        output_auto=np.repeat(one.output_auto, 4, axis=0),
        cross=np.repeat(one.cross, 4, axis=0),
    )
    for compose in (compose_by_weights, compose_by_least_squares):
        total = compose(pairs, weights_like(pairs))
        assert np.allclose(total.cross, one.cross[0], rtol=1e-13, atol=0.0)
        assert np.allclose(total.input_auto, one.input_auto[0], rtol=1e-13, atol=0.0)
        assert np.allclose(total.coherence, one.coherence[0], rtol=1e-13, atol=0.0)


def test_least_squares_is_a_stationary_point_of_the_stated_objective() -> None:
    pairs = scattered(0.1)
    weights = weights_like(pairs)
    total, start = compose_by_least_squares(pairs, weights), compose_by_weights(pairs, weights)
    for column in range(pairs.cross.shape[1]):
        found, began = (
            np.array([p.input_auto[column], p.output_auto[column], p.cross[column].real, p.cross[column].imag])
            for p in (total, start)
        )
        slope, slope_before = (np.abs(gradient(x, pairs, weights, column)).max() for x in (found, began))
        # Newton without second derivatives of the coherence converges linearly; thirty steps reach rounding.
        assert slope <= 1e-9 * slope_before
        assert objective(found, pairs, weights, column).real <= objective(began, pairs, weights, column).real


def test_a_single_window_is_its_own_composite() -> None:
    pairs = scattered(0.1, windows=1)
    total = compose_by_least_squares(pairs, np.ones_like(pairs.input_auto))
    assert np.allclose(total.response, pairs.response[0], rtol=1e-13, atol=0.0)


def test_hardly_coherent_points_stay_finite() -> None:
    rng = np.random.default_rng(2)
    shape = (5, 200)
    xx, yy = np.exp(2.0 * rng.standard_normal((2, *shape)))
    coherence = 10.0 ** rng.uniform(-12.0, -2.0, shape)
    cross = np.sqrt(coherence * xx * yy) * np.exp(1j * rng.uniform(-np.pi, np.pi, shape))
    total = compose_by_least_squares(
        PairSpectra(input_auto=xx, output_auto=yy, cross=cross), rng.uniform(0.0, 1.0, shape)
    )
    for array in (total.input_auto, total.output_auto, total.cross):
        assert np.all(np.isfinite(array))
    assert total.input_auto.min() > 0.0
    assert total.output_auto.min() > 0.0


def test_weights_fall_with_the_fourth_power_of_the_error() -> None:
    error = np.array([[0.1, 0.2, 0.3], [0.2, 0.1, 0.05]])
    valid = np.array([[True, True, True], [True, True, False]])
    expected = np.array([[1.0, 2.0**-4, 1.0], [2.0**-4, 1.0, 0.0]])
    assert np.allclose(window_weights(error, valid), expected, rtol=1e-14)


def test_perfect_and_hopeless_windows_have_finite_weights() -> None:
    weights = window_weights(np.array([[0.0, np.inf], [0.1, 1.0]]), np.ones((2, 2), dtype=bool))
    assert np.all(np.isfinite(weights))
    assert weights[0, 0] == weights[1, 1] == 1.0


@pytest.mark.parametrize("seed", range(3))
def test_both_forms_tell_the_same_story_on_data(seed: int) -> None:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(12_000)
    y = np.convolve(u, np.exp(-np.arange(80) / 12.0), mode="same") + 2.0 * rng.standard_normal(u.size)
    channels = (Channel(name="u", unit="1"), Channel(name="y", unit="1"))
    history = TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=100.0, start_s=0.0)
    responses = [
        frequency_response(
            [history],
            inputs=["u"],
            outputs=["y"],
            omega_rad_s=np.geomspace(1.0, 50.0, 40),
            windows_s=[24.0, 12.0, 6.0, 3.0],
            composition=composition,
        )
        for composition in ("least_squares", "weights")
    ]
    # They weigh the same windows, linearly or by squares: the difference stays within the estimate's own error.
    difference = np.abs(responses[0].values / responses[1].values - 1.0)
    assert np.all(difference <= 3.0 * responses[1].random_error)
    assert np.median(difference / responses[1].random_error) < 0.5
