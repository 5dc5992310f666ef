"""The covariance of residuals is that of the errors that a response states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.fitting.error_twin import EXACT, OMEGA, between_inputs, draws, measured, posed, stated_covariance

from rotorid.fitting.problem import MODEL_ERROR, ResidualErrors
from rotorid.typing import FloatArray

JOINED = measured(EXACT)
APART = measured(EXACT, joined=False)


def of_residuals(relative: np.ndarray, scale: FloatArray) -> FloatArray:
    """Residuals are real and imaginary parts of minus the logarithmic errors, times their scales."""
    dense = np.block([[relative.real, -relative.imag], [relative.imag, relative.real]]) / 2.0
    return np.asarray(scale[:, None] * dense * scale)


@pytest.mark.parametrize("data", [JOINED, APART], ids=["joined", "apart"])
def test_covariance_is_the_stated_one_written_out(data: object) -> None:
    problem = posed(data)  # type: ignore[arg-type]
    flat = EXACT.reshape(-1)
    relative = stated_covariance(problem.data) / (flat[:, None] * flat.conj())
    expected = of_residuals(relative, problem.errors.scale)
    largest = np.abs(expected).max()
    # The factor of outputs has a jitter of 1e-9.
    np.testing.assert_allclose(problem.errors.covariance, expected, rtol=0.0, atol=3e-9 * largest)
    np.testing.assert_array_equal(problem.errors.scale, np.concatenate(problem.point_scales))


def test_residuals_of_drawn_responses_scatter_as_stated() -> None:
    count = 2000
    values = draws(JOINED, count, 5)
    errors = posed(JOINED).errors
    logarithms = np.log(EXACT / values).reshape(count, -1)
    residuals = errors.scale * np.concatenate([logarithms.real, logarithms.imag], axis=1)
    drawn = posed(replace(JOINED, values=values[0]))
    np.testing.assert_allclose(drawn.residuals(drawn.parameters.pack())[0], residuals[0], rtol=1e-9, atol=1e-9)
    found = np.cov(residuals.T)
    level = np.sqrt(np.diag(errors.covariance))
    # A covariance of n normal draws scatters by sqrt((1 + rho^2) / n) of the variances at most; 5 of those, for some
    # 8000 entries, and the square of the relative error of 2 % for the logarithm.
    tolerance = 5.0 * np.sqrt(2.0 / count) + 4.0 * 0.02**2
    np.testing.assert_allclose((found - errors.covariance) / np.outer(level, level), 0.0, atol=tolerance)


def test_points_that_do_not_count_leave_the_others_as_they_are() -> None:
    used = np.random.default_rng(0).random(EXACT.shape) < 0.6
    errors, whole = posed(JOINED, used).errors, posed(JOINED).errors
    kept = np.flatnonzero(np.concatenate([used.reshape(-1)] * 2))
    relative = errors.covariance / np.outer(errors.scale, errors.scale)
    expected = (whole.covariance / np.outer(whole.scale, whole.scale))[np.ix_(kept, kept)]
    np.testing.assert_allclose(relative, expected, rtol=1e-12, atol=1e-15)


def test_responses_without_correlations_err_on_their_own() -> None:
    covariance = posed(APART).errors.covariance
    pair = np.repeat(np.arange(4), OMEGA.size)
    pair = np.concatenate([pair, pair])
    assert np.all(covariance[pair[:, None] != pair] == 0.0)
    assert np.abs(covariance[pair[:, None] == pair]).min() > 0.0


def test_inputs_err_on_their_own_where_only_outputs_are_correlated() -> None:
    data = replace(JOINED, input_correlation=None)
    covariance = posed(data).errors.covariance
    source = np.tile(np.repeat(np.arange(2), OMEGA.size), 4)
    assert np.all(covariance[source[:, None] != source] == 0.0)
    # Within an input it is what it is with both, since all outputs share the windows.
    same = source[:, None] == source
    level = np.abs(covariance).max()
    np.testing.assert_allclose(covariance[same], posed(JOINED).errors.covariance[same], rtol=0.0, atol=1e-8 * level)


@pytest.mark.parametrize("size", [0.0, 0.9, 1.0])
def test_weights_exist_also_where_outputs_err_alike(size: float) -> None:
    errors = posed(measured(EXACT, size=size)).errors
    lowest, highest = np.linalg.eigvalsh(errors.covariance)[[0, -1]]
    assert lowest >= -1e-12 * highest
    total = errors.covariance + np.diag(errors.own)
    root = np.linalg.inv(errors.whitened(np.eye(errors.scale.size)))
    np.testing.assert_allclose(root @ root.T, total, rtol=0.0, atol=1e-12 * highest)
    assert errors.whitening.log_determinant == pytest.approx(0.5 * np.linalg.slogdet(total)[1], rel=1e-12)
    # No weight is beyond what the error of the model itself leaves.
    assert np.linalg.eigvalsh(total)[0] >= (MODEL_ERROR * errors.scale.min()) ** 2


def test_weights_exist_where_inputs_are_wholly_correlated_too() -> None:
    alike = np.array(between_inputs())
    alike[0, 1] = alike[0, 0]
    alike[1, 0] = alike[0, 0]
    errors = posed(replace(measured(EXACT, size=1.0), input_correlation=alike)).errors
    assert np.isfinite(errors.whitened(np.eye(errors.scale.size))).all()


def test_whitened_residuals_have_the_covariance_that_is_measured_of_them() -> None:
    errors = posed(JOINED).errors
    white = errors.whitened(errors.whitened(errors.covariance).T)
    np.testing.assert_allclose(white, white.T, atol=1e-12)
    inside = np.linalg.eigvalsh(white)
    assert inside[0] >= -1e-10
    assert inside[-1] < 1.0


def test_what_a_gain_makes_of_errors_is_the_product_written_out() -> None:
    errors = posed(JOINED).errors
    gain = np.random.default_rng(0).standard_normal((3, errors.scale.size)) / errors.scale
    expected = gain @ errors.covariance @ gain.T
    np.testing.assert_allclose(errors.propagated(gain), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(errors.variance, errors.covariance.diagonal(), rtol=1e-14)
    behind = gain @ errors.whitened(np.eye(errors.scale.size))
    np.testing.assert_allclose(errors.whitening.of_residuals(gain), behind, rtol=0.0, atol=1e-12 * np.abs(behind).max())


def test_some_points_have_the_errors_that_they_have_among_all() -> None:
    errors, points = posed(JOINED).errors, np.array([3, 17, 40])
    rows = np.concatenate([points, points + len(errors.relative)])
    np.testing.assert_array_equal(errors.at(points).covariance, errors.covariance[np.ix_(rows, rows)])


def test_a_residual_without_weight_cannot_weigh_others() -> None:
    errors = ResidualErrors(relative=np.eye(1), scale=np.array([1.0, 0.0]))
    with pytest.raises(np.linalg.LinAlgError):
        errors.whitened(np.ones(2))


def test_errors_are_values() -> None:
    errors = ResidualErrors(relative=np.eye(1), scale=np.ones(2))
    for values in (errors.relative, errors.covariance):
        with pytest.raises(ValueError, match="read-only"):
            values[0, 0] = 2.0
