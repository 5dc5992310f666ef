r"""Discrete output-error models: rational in the shift, with the error at the output.

.. math:: y_k = \sum_j \frac{B_j(q)}{F(q)} u_{j,k} + e_k

The search is Levenberg and Marquardt's with the exact gradient, which filters give:

.. math:: \frac{\partial \hat y}{\partial b_{j,i}} = \frac{q^{-n_j - i}}{F} u_j, \qquad
    \frac{\partial \hat y}{\partial f_i} = - \frac{q^{-i}}{F} \hat y
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.arx import fit_arx, regressors
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.polynomial import PolynomialModel, PolynomialOrders
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray

_ROUNDS = 20
_AT_REST = 1e-8


def fit_polynomial_output_error(
    records: Sequence[TimeData],
    orders: PolynomialOrders,
    *,
    offset: bool = False,
    solver: LevenbergMarquardt | None = None,
) -> PolynomialModel:
    """Minimize the error of the simulation from rest over several records.

    The starts are an ARX model, instrumental variables made from it, and the iterations of Steiglitz and McBride; the
    best end counts. The covariance is right where the output error is white; the values are unbiased where it does not
    depend on the inputs.

    Parameters
    ----------
    records
        One output; inputs and output as differences from a trim.
    orders
        Coefficients and delays.
    offset
        Whether the output of each record has a constant of its own, which is estimated beside the coefficients: then
        the variance of the error is minimized, and not its mean square.
    solver
        Local solver.

    Raises
    ------
    UsageError
        The records have other inputs than the orders, or more than one output.
    InsufficientDataError
        They hold fewer samples than there are coefficients, or no start is stable.

    References
    ----------
    L. Ljung, *System Identification: Theory for the User*, second edition, sections 7.6 and 10.2.
    K. Steiglitz and L. McBride, *A technique for the identification of linear systems*, IEEE Transactions on Automatic
    Control, 1965.

    Examples
    --------
    >>> u = np.random.default_rng(0).standard_normal((1, 200))
    >>> y = PolynomialModel.given([1.0, -0.8], [[0.0, 0.5]]).simulate(u)[None]
    >>> record = TimeData(name="lag", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> orders = PolynomialOrders(denominator=1, numerators=(1,), delays=(1,))
    >>> fit_polynomial_output_error([record], orders).denominator.round(9).tolist()
    [1.0, -0.8]
    """
    orders.check(records)
    solver = solver or LevenbergMarquardt()
    far = np.full(orders.coefficients, np.inf)

    def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _residuals(theta, records, orders, offset=offset)

    ends = [solver.minimize(residuals, start, -far, far) for start in _starts(records, orders, offset=offset)]
    best = min(ends, key=lambda end: end.cost, default=None)
    if best is None or not np.isfinite(best.cost):
        raise InsufficientDataError(
            "no start of the output-error model is stable", remedy="take lower orders or another delay"
        )
    variance = best.cost / (best.residual.size - orders.coefficients - offset * len(records))
    covariance = variance * np.linalg.pinv(best.jacobian.T @ best.jacobian, hermitian=True)
    return PolynomialModel.of(best.theta, orders, np.asarray(covariance, dtype=np.float64), variance)


def _residuals(
    theta: FloatArray, records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool
) -> tuple[FloatArray, FloatArray]:
    """Measured minus simulated, shape ``(samples,)``, and its Jacobian; not a number where the model is unstable."""
    model = _model(theta, orders)
    samples = sum(record.samples for record in records)
    if not model.stable:
        return np.full(samples, np.nan), np.full((samples, theta.size), np.nan)
    parts = [_slopes(model, record, orders) for record in records]
    errors = [record.outputs[0] - y for record, (y, _) in zip(records, parts, strict=True)]
    slopes = [columns for _, columns in parts]
    if offset:
        # The best constant of a record takes the mean away, and so does its share in every derivative.
        errors = [error - error.mean() for error in errors]
        slopes = [columns - columns.mean(axis=0) for columns in slopes]
    return np.concatenate(errors), -np.vstack(slopes)


def _slopes(model: PolynomialModel, record: TimeData, orders: PolynomialOrders) -> tuple[FloatArray, FloatArray]:
    """The simulated output ``(n,)`` and its derivatives ``(n, coefficients)``."""
    from scipy.signal import lfilter

    y = model.simulate(record.inputs)
    moved = -lfilter([1.0], model.denominator, y)
    columns = [_late(moved, lag) for lag in range(1, orders.denominator + 1)]
    for u, count, delay in zip(record.inputs, orders.numerators, orders.delays, strict=True):
        filtered = lfilter([1.0], model.denominator, u)
        columns += [_late(filtered, delay + lag) for lag in range(count)]
    return y, np.column_stack(columns)


def _late(values: FloatArray, samples: int) -> FloatArray:
    return np.concatenate([np.zeros(samples), values[: values.size - samples]])


def _model(theta: FloatArray, orders: PolynomialOrders) -> PolynomialModel:
    return PolynomialModel.of(theta, orders, np.zeros((0, 0)), 0.0)


def _coefficients(model: PolynomialModel, orders: PolynomialOrders) -> FloatArray:
    numerators = [b[delay:] for b, delay in zip(model.numerators, orders.delays, strict=True)]
    return np.concatenate([model.denominator[1:], *numerators])


def _starts(records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool) -> list[FloatArray]:
    """Coefficients of stable models, ARX first."""
    if offset:
        records = [_centered(record) for record in records]
    regression = _inside(fit_arx(records, orders))
    found = [regression, _inside(_instrumented(records, orders, regression)), _filtered(records, orders, regression)]
    return [_coefficients(model, orders) for model in found]


def _centered(record: TimeData) -> TimeData:
    inputs, outputs = (values - values.mean(axis=1, keepdims=True) for values in (record.inputs, record.outputs))
    return TimeData(name=record.name, inputs=inputs, outputs=outputs, sample_rate_hz=record.sample_rate_hz)


def _inside(model: PolynomialModel) -> PolynomialModel:
    """The same model with poles outside the unit circle mirrored into it."""
    if model.stable:
        return model
    poles = np.roots(model.denominator)
    poles = np.where(np.abs(poles) > 1.0, 1.0 / np.conj(poles), poles)
    return replace(model, denominator=np.asarray(np.poly(poles).real, dtype=np.float64))


def _instrumented(
    records: Sequence[TimeData], orders: PolynomialOrders, regression: PolynomialModel
) -> PolynomialModel:
    """Instrumental variables: past outputs replaced by simulated ones, which do not know the noise."""
    products = np.zeros((orders.coefficients, orders.coefficients))
    right = np.zeros(orders.coefficients)
    for record in records:
        instruments = regressors(record, orders, regression.simulate(record.inputs))
        products += instruments.T @ regressors(record, orders)
        right += instruments.T @ record.outputs[0, orders.first :]
    return _model(np.asarray(np.linalg.lstsq(products, right, rcond=None)[0], dtype=np.float64), orders)


def _filtered(records: Sequence[TimeData], orders: PolynomialOrders, start: PolynomialModel) -> PolynomialModel:
    """ARX models of records filtered by the denominator before, until it rests; the best of them."""
    from scipy.signal import lfilter

    model, best = start, start
    lowest = _error(start, records)
    for _ in range(_ROUNDS):
        passed = [
            TimeData(
                name=one.name,
                inputs=lfilter([1.0], model.denominator, one.inputs, axis=1),
                outputs=lfilter([1.0], model.denominator, one.outputs, axis=1),
                sample_rate_hz=one.sample_rate_hz,
            )
            for one in records
        ]
        following = _inside(fit_arx(passed, orders))
        moved = np.abs(following.denominator - model.denominator).max()
        model, error = following, _error(following, records)
        if error < lowest:
            best, lowest = model, error
        if moved < _AT_REST:
            break
    return best


def _error(model: PolynomialModel, records: Sequence[TimeData]) -> float:
    return float(sum(np.sum((one.outputs[0] - model.simulate(one.inputs)) ** 2) for one in records))
