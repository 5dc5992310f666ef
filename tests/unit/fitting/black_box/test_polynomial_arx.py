"""ARX: exact without noise, with a covariance that holds."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.black_box.polynomial import PolynomialModel, PolynomialOrders, fit_arx
from rotorid.fitting.time.output_error import TimeData

TRUE = PolynomialModel.given([1.0, -1.5, 0.7], [[0.0, 1.0, 0.5], [0.0, 0.0, 0.0, -0.8]])
ORDERS = PolynomialOrders(denominator=2, numerators=(2, 1), delays=(1, 3))
COEFFICIENTS = np.array([-1.5, 0.7, 1.0, 0.5, -0.8])


def flown(seed: int, *, samples: int = 400, noise: float = 0.0, shift: float = 0.0) -> TimeData:
    """The noise passes through the denominator, as ARX assumes."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    u = rng.standard_normal((2, samples))
    e = lfilter([1.0], TRUE.denominator, noise * rng.standard_normal(samples))
    return TimeData(name="twin", inputs=u, outputs=(TRUE.simulate(u) + e + shift)[None], sample_rate_hz=5.0)


def coefficients(model: PolynomialModel) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([model.denominator[1:], model.numerators[0][1:], model.numerators[1][3:]])


def test_two_inputs_and_two_records_to_rounding() -> None:
    model = fit_arx([flown(0), flown(1)], ORDERS)
    np.testing.assert_allclose(coefficients(model), COEFFICIENTS, atol=1e-12)
    assert [len(b) for b in model.numerators] == [3, 4]
    assert model.numerators[1][:3].tolist() == [0.0, 0.0, 0.0]


def test_an_offset_is_estimated_where_it_is_asked_for() -> None:
    records = [flown(0, shift=3.0), flown(1, shift=-5.0)]
    np.testing.assert_allclose(coefficients(fit_arx(records, ORDERS, offset=True)), COEFFICIENTS, atol=1e-12)
    assert np.abs(coefficients(fit_arx(records, ORDERS)) - COEFFICIENTS).max() > 0.05


def test_the_covariance_holds() -> None:
    """Normalized errors over many seeds have unit variance: 300 x 5 numbers scatter by 2 / sqrt(1500) at most."""
    errors = []
    for seed in range(300):
        model = fit_arx([flown(seed, noise=0.5)], ORDERS)
        errors.append((coefficients(model) - COEFFICIENTS) / np.sqrt(np.diag(model.covariance)))
    assert np.var(errors) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / 300.0))
    assert model.noise_variance == pytest.approx(0.25, rel=0.3)


def test_simulation_is_the_difference_equation() -> None:
    u = np.random.default_rng(0).standard_normal((2, 30))
    y = np.zeros(30)
    for k in range(30):
        past = [y[k - i] if k >= i else 0.0 for i in (1, 2)]
        late = [u[0, k - i] if k >= i else 0.0 for i in (1, 2)] + [u[1, k - 3] if k >= 3 else 0.0]
        y[k] = 1.5 * past[0] - 0.7 * past[1] + late[0] + 0.5 * late[1] - 0.8 * late[2]
    np.testing.assert_allclose(TRUE.simulate(u), y, atol=1e-12)


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(UsageError, match="1 inputs and one output"):
        fit_arx([flown(0)], PolynomialOrders(denominator=1, numerators=(1,), delays=(0,)))
    with pytest.raises(InsufficientDataError, match="usable samples"):
        fit_arx([flown(0, samples=8)], ORDERS)
    with pytest.raises(UsageError, match="no record"):
        fit_arx([], ORDERS)
    with pytest.raises(UsageError, match="2 numerators but 1 delay"):
        PolynomialOrders(denominator=1, numerators=(1, 1), delays=(0,))
    with pytest.raises(UsageError, match="at least one coefficient"):
        PolynomialOrders(denominator=1, numerators=(0,), delays=(0,))
    with pytest.raises(UsageError, match="start with 1"):
        PolynomialModel.given([2.0, 1.0], [[1.0]])
    with pytest.raises(UsageError, match="1 input; expected 2"):
        TRUE.simulate(np.zeros((1, 5)))
