r"""ARX models by linear least squares, for comparison with models whose error stands at the output.

.. math:: A(q) y_k = \sum_j B_j(q) u_{j,k} + e_k

The noise passes through the poles of the system. Where it does not, the poles are biased towards those of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.fit.polynomial import PolynomialModel, PolynomialOrders
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray


def fit_arx(records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool = False) -> PolynomialModel:
    r"""Least squares of the equation error over several records, each from its first sample with a whole past.

    The covariance is :math:`\sigma^2 (\Phi^T \Phi)^{-1}`, right where the equation error is white.

    Parameters
    ----------
    records
        One output; inputs and output as differences from a trim.
    orders
        Coefficients and delays.
    offset
        Whether each record has a constant of its own, which is estimated beside the coefficients.

    Raises
    ------
    UsageError
        The records have other inputs than the orders, or more than one output.
    InsufficientDataError
        They hold fewer samples than there are coefficients.

    References
    ----------
    L. Ljung, *System Identification: Theory for the User*, second edition, section 7.3.

    Examples
    --------
    >>> u = np.random.default_rng(0).standard_normal((1, 100))
    >>> y = PolynomialModel.given([1.0, -0.8], [[0.0, 0.5]]).simulate(u)[None]
    >>> record = TimeData(name="lag", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> fit_arx([record], PolynomialOrders(denominator=1, numerators=(1,), delays=(1,))).denominator.round(9).tolist()
    [1.0, -0.8]
    """
    orders.check(records)
    blocks = [(regressors(record, orders), record.outputs[0, orders.first :]) for record in records]
    if offset:
        blocks = [(columns - columns.mean(axis=0), values - values.mean()) for columns, values in blocks]
    phi, y = np.vstack([columns for columns, _ in blocks]), np.concatenate([values for _, values in blocks])
    size = np.linalg.norm(phi, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    found, _, _, _ = np.linalg.lstsq(phi / size, y, rcond=None)
    coefficients = np.asarray(found / size, dtype=np.float64)
    error = y - phi @ coefficients
    variance = float(error @ error) / (y.size - orders.coefficients - offset * len(records))
    covariance = variance * np.linalg.pinv((phi / size).T @ (phi / size)) / np.outer(size, size)
    return PolynomialModel.of(coefficients, orders, np.asarray(covariance, dtype=np.float64), variance)


def regressors(record: TimeData, orders: PolynomialOrders, past: FloatArray | None = None) -> FloatArray:
    """What each coefficient multiplies, shape ``(samples - first, coefficients)``, denominator first.

    Parameters
    ----------
    record
        Inputs and output.
    orders
        Coefficients and delays.
    past
        What stands for the past outputs, shape ``(n,)``, the measured ones by default; instruments stand there.
    """
    first, samples = orders.first, record.samples
    y = record.outputs[0] if past is None else past
    columns = [-y[first - lag : samples - lag] for lag in range(1, orders.denominator + 1)]
    for u, count, delay in zip(record.inputs, orders.numerators, orders.delays, strict=True):
        columns += [u[first - delay - lag : samples - delay - lag] for lag in range(count)]
    return np.column_stack(columns)
