"""Sandwich covariances: those of noise where errors are noise, and larger where the structure is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from rotorid.fitting.problem import Part
from rotorid.typing import FloatArray
from rotorid.uncertainty.sandwich import by_bands, by_blocks, by_lines, by_outputs

SAMPLES, OUTPUTS, RATE_HZ = 4000, 8, 50.0

WAYS = [by_blocks, by_outputs, by_bands]


def part_of(slopes: FloatArray, errors: FloatArray) -> Part:
    flat = slopes.reshape(-1, slopes.shape[2])
    taken = flat @ np.linalg.lstsq(flat, errors.ravel(), rcond=None)[0]
    residual = errors - taken.reshape(errors.shape)
    return Part(residual=residual, slopes=slopes, unknown=np.zeros((*errors.shape, 0)), sample_rate_hz=RATE_HZ)


@pytest.mark.parametrize("way", WAYS)
def test_of_white_errors_each_expects_the_covariance_of_least_squares(
    way: Callable[[Sequence[Part]], FloatArray],
) -> None:
    rng, ratios = np.random.default_rng(0), []
    for _ in range(40):
        slopes = rng.normal(size=(SAMPLES // 4, OUTPUTS, 2)) * np.array([1.0, 1e-4])
        flat = slopes.reshape(-1, 2)
        expected = np.linalg.inv(flat.T @ flat).diagonal()
        ratios.append(way([part_of(slopes, rng.normal(size=slopes.shape[:2]))]).diagonal() / expected)
    assert np.mean(ratios, axis=0) == pytest.approx([1.0, 1.0], rel=0.35)


def test_a_gain_that_differs_between_outputs_is_an_error_by_outputs() -> None:
    rng = np.random.default_rng(1)
    slopes = rng.normal(size=(SAMPLES, OUTPUTS, 1))
    gains = 1.0 + 0.1 * rng.normal(size=OUTPUTS)
    part = part_of(slopes, slopes[:, :, 0] * gains)
    scatter = np.std(gains, ddof=1) / np.sqrt(OUTPUTS)
    assert np.sqrt(by_outputs([part]).item()) == pytest.approx(scatter, rel=0.1)
    assert by_blocks([part]).item() < 0.1 * scatter**2


def test_a_gain_that_falls_with_frequency_is_an_error_by_bands() -> None:
    rng = np.random.default_rng(2)
    driven = rng.normal(size=SAMPLES)
    late = np.convolve(driven, [0.5, 0.5], mode="same")
    part = part_of(driven[:, None, None], late[:, None])
    assert by_bands([part]).item() > 10.0 * by_blocks([part]).item()


def test_a_single_part_says_nothing() -> None:
    part = part_of(np.ones((50, 1, 1)), np.random.default_rng(3).normal(size=(50, 1)))
    assert by_outputs([part]).item() == by_blocks([part]).item() == 0.0


def test_lines_of_a_band_expect_the_covariance_of_least_squares_too() -> None:
    rng, ratios = np.random.default_rng(4), []
    omega = np.linspace(1.0, 40.0, 200)
    for _ in range(40):
        slopes = rng.normal(size=(2 * omega.size, 2, 2))
        flat = slopes.reshape(-1, 2)
        expected = np.linalg.inv(flat.T @ flat).diagonal()
        part = part_of(slopes, rng.normal(size=slopes.shape[:2]))
        ratios.append(by_lines([part], [omega]).diagonal() / expected)
    assert np.mean(ratios, axis=0) == pytest.approx([1.0, 1.0], rel=0.35)


def test_an_equation_that_lacks_a_lag_is_wrong_by_bands() -> None:
    omega = np.linspace(1.0, 40.0, 200)
    driven = np.random.default_rng(5).normal(size=omega.size)
    fell = driven / (1.0 + (0.1 * omega) ** 2)
    slopes = np.concatenate([driven, driven])[:, None, None]
    part = part_of(slopes, np.concatenate([fell, -0.1 * omega * fell])[:, None])
    white = np.sum(part.residual**2) / part.residual.size / np.sum(slopes**2)
    assert by_lines([part], [omega]).item() > 2.0 * float(white)
