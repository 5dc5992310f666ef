"""Discrete output error: exact gradient, unbiased where ARX is not, a covariance that holds."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.fitting.black_box.polynomial import (
    PolynomialModel,
    PolynomialOrders,
    _residuals,
    fit_arx,
    fit_polynomial_output_error,
)
from rotorid.fitting.time.output_error import TimeData
from rotorid.typing import FloatArray

TRUE = PolynomialModel.given([1.0, -1.5, 0.7], [[0.0, 1.0, 0.5], [0.0, 0.0, 0.0, -0.8]])
ORDERS = PolynomialOrders(denominator=2, numerators=(2, 1), delays=(1, 3))
COEFFICIENTS = np.array([-1.5, 0.7, 1.0, 0.5, -0.8])


def flown(seed: int, *, samples: int = 400, noise: float = 0.0, shift: float = 0.0) -> TimeData:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((2, samples))
    y = TRUE.simulate(u) + noise * rng.standard_normal(samples) + shift
    return TimeData(name="twin", inputs=u, outputs=y[None], sample_rate_hz=5.0)


def coefficients(model: PolynomialModel) -> FloatArray:
    return np.concatenate([model.denominator[1:], model.numerators[0][1:], model.numerators[1][3:]])


@pytest.mark.parametrize("offset", [False, True])
def test_gradient_against_central_differences(offset: bool) -> None:
    records = [flown(0, samples=60, noise=1.0), flown(1, samples=50, noise=1.0)]
    theta = COEFFICIENTS * 0.9
    _, jacobian = _residuals(theta, records, ORDERS, offset=offset)
    step = 1e-6
    for column, move in zip(jacobian.T, np.eye(theta.size) * step, strict=True):
        ahead, behind = (_residuals(theta + sign * move, records, ORDERS, offset=offset)[0] for sign in (1.0, -1.0))
        # Second-order differences: step^2 times a third derivative of some 10, and rounding over the step.
        np.testing.assert_allclose(column, (ahead - behind) / (2.0 * step), atol=1e-7 * np.abs(column).max())


def test_two_records_to_rounding() -> None:
    model = fit_polynomial_output_error([flown(0), flown(1)], ORDERS)
    np.testing.assert_allclose(coefficients(model), COEFFICIENTS, atol=1e-9)


def test_offsets_of_records_are_estimated() -> None:
    records = [flown(0, shift=30.0), flown(1, shift=-50.0)]
    np.testing.assert_allclose(
        coefficients(fit_polynomial_output_error(records, ORDERS, offset=True)), COEFFICIENTS, atol=1e-9
    )


def test_unbiased_with_a_covariance_that_holds_where_arx_is_biased() -> None:
    errors, regression = [], []
    for seed in range(60):
        record = flown(seed, noise=2.0)
        model = fit_polynomial_output_error([record], ORDERS)
        errors.append((coefficients(model) - COEFFICIENTS) / np.sqrt(np.diag(model.covariance)))
        regression.append(coefficients(fit_arx([record], ORDERS)) - COEFFICIENTS)
    mean = np.mean(errors, axis=0)
    assert np.abs(mean).max() < 4.0 / np.sqrt(60.0)
    assert np.var(errors) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / 60.0))
    bias = np.abs(np.mean(regression, axis=0)) / (np.std(regression, axis=0) / np.sqrt(60.0))
    assert bias.max() > 20.0


def test_too_short_records_are_refused() -> None:
    with pytest.raises(InsufficientDataError, match="usable samples"):
        fit_polynomial_output_error([flown(0, samples=8)], ORDERS)
