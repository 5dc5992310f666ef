"""Model error of fits in time: none of noise, and what a missing term moves where the structure is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t

from rotorid.fitting.problem import Part
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, bounds_of_parts
from rotorid.uncertainty.time_error import by_records, with_time_error

SAMPLES, RATE_HZ = 4000, 50.0
NAMES = ("gain", "other")


class Alone(NamedTuple):
    values: dict[str, float]
    stds: dict[str, float]
    random: Mapping[str, float] = MappingProxyType({})


def part_of(slopes: FloatArray, measured: FloatArray) -> Part:
    left = measured - slopes @ np.linalg.lstsq(slopes, measured, rcond=None)[0]
    return Part(left[:, None], slopes[:, None], np.zeros((len(left), 1, 0)), sample_rate_hz=RATE_HZ)


def ratio(part: Part) -> FloatArray:
    bounds = with_time_error(bounds_of_parts([part], NAMES), [part])
    return bounds.std / bounds.random_std


def estimates(values: Sequence[float], std: float = 1.0) -> list[Alone]:
    return [Alone({"gain": value}, {"gain": std}) for value in values]


def bounded(std: float) -> Bounds:
    covariance = np.array([[std**2]])
    flat = np.ones(1)
    return Bounds(
        names=("gain",), cramer_rao=flat, insensitivity=flat, covariance=covariance, random=covariance, colored=1.0
    )


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_noise_of_any_color_leaves_the_random_error(pole: float) -> None:
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        noise = lfilter([1.0], [1.0, -pole], rng.normal(size=SAMPLES))
        found.append(ratio(part_of(rng.normal(size=(SAMPLES, 2)), noise)))
    assert 1.0 <= float(np.mean(found)) < 1.3


def test_a_missing_lag_is_model_error() -> None:
    """The gain of a lag depends on the spectrum of the input; noise is a hundredth of it."""
    rng = np.random.default_rng(1)
    driven = lfilter([1.0], [1.0, -0.9], rng.normal(size=(SAMPLES, 2)), axis=0)
    lagged = lfilter([0.1], [1.0, -0.9], driven[:, 0]) + 0.01 * rng.normal(size=SAMPLES)
    assert ratio(part_of(driven, lagged))[0] > 3.0


def test_the_correlations_are_those_of_the_random_errors() -> None:
    rng = np.random.default_rng(2)
    driven = rng.normal(size=(SAMPLES, 2)) @ np.array([[1.0, 0.6], [0.0, 0.8]])
    part = part_of(driven, np.convolve(driven[:, 0], [0.5, 0.5], mode="same"))
    random = bounds_of_parts([part], NAMES)
    found = with_time_error(random, [part])
    np.testing.assert_allclose(found.correlation, random.correlation)
    np.testing.assert_array_equal(found.random, random.random)


def test_columns_of_a_noise_model_have_no_bounds_of_their_own() -> None:
    rng = np.random.default_rng(3)
    part = part_of(rng.normal(size=(SAMPLES, 3)), rng.normal(size=SAMPLES))
    assert with_time_error(bounds_of_parts([part], NAMES), [part]).names == NAMES


def test_records_count_by_their_scatter_and_by_students_factor() -> None:
    values = [1.0, 2.0, 3.0, 6.0]
    factor = float(t.ppf(0.975, 3)) / 1.959964
    expected = factor * np.std(values, ddof=1) / 2.0
    assert np.sqrt(by_records(bounded(0.5), estimates(values))) == pytest.approx([expected], rel=1e-6)


@pytest.mark.parametrize(
    "alone",
    [
        pytest.param(estimates([1.0, 5.0]), id="two records"),
        pytest.param(estimates([1.0, 5.0, 9.0], std=20.0), id="what only their difference shows"),
        pytest.param([Alone({"gain": value}, {}) for value in (1.0, 5.0, 9.0)], id="records that do not show it"),
    ],
)
def test_records_that_say_too_little_say_nothing(alone: list[Alone]) -> None:
    assert by_records(bounded(0.5), alone).tolist() == [0.0]


def test_records_that_agree_make_no_interval_small() -> None:
    rng = np.random.default_rng(4)
    part = part_of(rng.normal(size=(SAMPLES, 1)), rng.normal(size=SAMPLES))
    bounds = bounds_of_parts([part], ("gain",))
    agreeing = [Alone({"gain": 1.0}, {"gain": bounds.std[0]}) for _ in range(4)]
    np.testing.assert_array_equal(
        with_time_error(bounds, [part], alone=agreeing).std, with_time_error(bounds, [part]).std
    )


def test_what_stays_on_its_bound_moves_nothing() -> None:
    """Two columns that nearly do the same, one of them on a bound that the data push against."""
    rng = np.random.default_rng(6)
    driven = rng.normal(size=SAMPLES)
    like = driven + 0.01 * rng.normal(size=SAMPLES)
    gain = float(driven @ like) / float(driven @ driven)
    part = Part((like - gain * driven)[:, None], np.stack([driven, like], axis=1)[:, None], np.zeros((SAMPLES, 1, 0)))
    bounds = bounds_of_parts([part], NAMES)
    free, held = (with_time_error(bounds, [part], held=names) for names in ((), ("other",)))
    assert held.stds["other"] == pytest.approx(bounds.stds["other"])
    assert held.stds["gain"] <= free.stds["gain"]


def test_clocks_add_in_squares() -> None:
    rng = np.random.default_rng(5)
    part = part_of(rng.normal(size=(SAMPLES, 2)), rng.normal(size=SAMPLES))
    bounds = bounds_of_parts([part], NAMES)
    plain = with_time_error(bounds, [part])
    moved = with_time_error(bounds, [part], added=[{"gain": 3.0, "elsewhere": 9.0}, {"gain": 4.0}])
    assert moved.std == pytest.approx([np.hypot(plain.std[0], 5.0), plain.std[1]])
