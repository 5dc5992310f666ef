"""What residuals say of errors that have a shape: how large they are, and that they are not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.fitting.frequency.error_shapes import response_error_shapes
from rotorid.fitting.problem import ErrorShapes, ResidualErrors
from rotorid.typing import FloatArray
from rotorid.uncertainty.model_error import model_error, model_error_evidence

OMEGA = np.geomspace(1.0, 50.0, 60)
NOISE = 0.003


def shapes(column: FloatArray, *, largest: int) -> ErrorShapes:
    """One response, and a column of known size beside its smooth error."""
    nothing = np.zeros(OMEGA.size, dtype=np.int64)
    plain = response_error_shapes(
        OMEGA, nothing, nothing, np.ones(2 * OMEGA.size), outputs=["ax"], inputs=["pitch"], clock_error_s=None
    )
    return replace(plain, known=column[:, None], largest=largest)


def random_errors(variance: float, correlation: FloatArray | None = None) -> ResidualErrors:
    """Errors of magnitudes and phases of one variance, correlated between points or not."""
    relative = 2.0 * variance * (np.eye(OMEGA.size) if correlation is None else correlation)
    return ResidualErrors(relative=relative, scale=np.ones(2 * len(relative)))


def left(residual: FloatArray, column: FloatArray, *, largest: int = 1, jacobian: FloatArray | None = None) -> float:
    """Size that the column has at the end, as a share of what it may have."""
    count = residual.size
    slopes = np.zeros((count, 0)) if jacobian is None else jacobian
    found = model_error(shapes(column, largest=largest), residual, slopes, random_errors(NOISE**2))
    return float(np.linalg.norm(found.shapes.known) / np.linalg.norm(column))


@pytest.fixture(scope="module")
def steep() -> FloatArray:
    """An error that grows tenfold over the band, as that of an accelerometer beside the center of gravity."""
    return np.concatenate([0.5 * (OMEGA / OMEGA[-1]) ** 2, np.zeros(OMEGA.size)])


@pytest.fixture(scope="module")
def noise() -> FloatArray:
    return NOISE * np.random.default_rng(1).standard_normal(2 * OMEGA.size)


def test_an_error_that_would_show_and_does_not_is_none(steep: FloatArray, noise: FloatArray) -> None:
    assert left(noise, steep) < 0.1


def test_an_error_that_shows_counts_as_much_as_it_shows(steep: FloatArray, noise: FloatArray) -> None:
    assert left(noise + 0.6 * steep, steep) == pytest.approx(0.6, abs=0.1)


def test_no_more_counts_than_there_may_be(steep: FloatArray, noise: FloatArray) -> None:
    assert left(noise + 3.0 * steep, steep) == pytest.approx(1.0)


def test_an_error_that_parameters_follow_leaves_no_trace_and_counts_whole(steep: FloatArray, noise: FloatArray) -> None:
    assert left(noise, steep, jacobian=steep[:, None]) == pytest.approx(1.0)


def test_a_clock_counts_whole_whatever_residuals_show(steep: FloatArray, noise: FloatArray) -> None:
    assert left(noise, steep, largest=0) == 1.0


@pytest.mark.parametrize(("size", "level", "certain"), [(0.0, NOISE, False), (0.04, NOISE, True), (0.04, 0.3, False)])
def test_a_model_error_is_certain_where_noise_would_not_make_it(size: float, level: float, certain: bool) -> None:
    noise = level * np.random.default_rng(3).standard_normal(2 * OMEGA.size)
    bend = np.concatenate([size * np.sin(2.0 * np.log(OMEGA)), np.zeros(OMEGA.size)])
    given = (np.zeros((noise.size, 0)), random_errors(level**2))
    nothing = np.zeros(noise.size)
    found = model_error(shapes(nothing, largest=0), bend + noise, *given)
    said = model_error_evidence(found, bend + noise, *given, ["ax/pitch", "q/pitch"], asked=0.1)
    assert list(said) == ["ax/pitch"]
    assert (said["ax/pitch"].found > 3.0) is certain
    assert (said["ax/pitch"].expected > 3.0) is (level == NOISE)


def test_the_size_that_counts_is_a_mean_over_what_residuals_allow(steep: FloatArray, noise: FloatArray) -> None:
    quiet, loud = (
        model_error(
            shapes(steep, largest=0),
            factor * noise,
            np.zeros((noise.size, 0)),
            random_errors((factor * NOISE) ** 2),
        )
        for factor in (0.1, 10.0)
    )
    # Exact data show that there is hardly an error; loud ones leave what is usual.
    assert quiet.deviations["ax/pitch"] < 0.001
    assert 0.001 < loud.deviations["ax/pitch"] < 0.02


def test_a_parameter_that_shows_little_of_a_column_bounds_it(steep: FloatArray, noise: FloatArray) -> None:
    jacobian = steep[:, None]
    gain = np.linalg.pinv(jacobian)
    found = model_error(shapes(steep, largest=1), noise, jacobian, random_errors(NOISE**2))
    random = NOISE**2 * gain @ gain.T

    def share(value: float) -> float:
        shown = found.as_parameters_show(gain, np.array([value]), random)
        return float(np.linalg.norm(shown.shapes.known) / np.linalg.norm(steep))

    # The whole column moves the parameter by one.
    assert share(0.3) == pytest.approx(0.3, abs=0.02)
    assert share(5.0) == pytest.approx(1.0)
    assert 0.0 < share(0.0) < 0.1
    assert share(np.nan) == pytest.approx(1.0)


def size(residual: FloatArray, stated: float) -> float:
    """The model error that counts, of residuals whose random errors are said to have a size."""
    nothing = np.zeros(residual.size)
    found = model_error(shapes(nothing, largest=0), residual, np.zeros((residual.size, 0)), random_errors(stated**2))
    return found.deviations["ax/pitch"]


def test_residuals_that_are_smaller_than_stated_leave_half_a_percent(noise: FloatArray) -> None:
    """They are small by chance, or their errors are overstated: a sensor is no better than 0.5 %."""
    assert 0.001 < size(0.003 * noise, 0.05) <= 0.005


def test_no_model_error_is_larger_than_three_times_the_typical_residual(noise: FloatArray) -> None:
    """Where random errors are said to be a hundred times as large, residuals still bound it."""
    typical = 0.8693 * float(np.quantile(np.abs(0.7 * noise), 0.75))
    assert 0.5 * typical < size(0.7 * noise, 0.9) <= 3.0 * typical


def test_beyond_30_percent_nothing_is_described() -> None:
    assert size(np.concatenate([2.0 * np.sin(2.0 * np.log(OMEGA)), np.zeros(OMEGA.size)]), NOISE) <= 0.3001


def test_half_of_what_no_residual_shows_is_below_the_usual_size() -> None:
    """Errors of 300 % leave what is usual of model errors: 0.3 %, and the tail of larger ones."""
    loud = 3.0 * np.random.default_rng(4).standard_normal(2 * OMEGA.size)
    assert 0.005 < size(loud, 3.0) < 0.03


@pytest.mark.parametrize("seed", range(3))
def test_errors_that_are_less_correlated_than_stated_are_no_model_error(seed: int) -> None:
    """Their difference is larger than stated, and no smooth error of one response alone."""
    omega, stated, level = np.geomspace(1.0, 50.0, 16), 0.9, 0.1
    count = 4 * omega.size
    pair = response_error_shapes(
        np.tile(omega, 2),
        np.zeros(2 * omega.size, dtype=np.int64),
        np.repeat([0, 1], omega.size),
        np.ones(count),
        outputs=["ax"],
        inputs=["pitch", "roll"],
        clock_error_s=None,
    )
    correlation = np.kron((1.0 - stated) * np.eye(2) + stated, np.eye(omega.size))
    given = (
        level * np.random.default_rng(seed).standard_normal(count),
        np.zeros((count, 0)),
        random_errors(level**2, correlation),
    )
    said = model_error_evidence(model_error(pair, *given), *given, pair.names, asked=0.1)
    assert max(one.found for one in said.values()) < 3.0
