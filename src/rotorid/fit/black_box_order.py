"""Which order the data support: information criteria and the gap between singular values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import FloatArray


class InformationCriteria(NamedTuple):
    """Criteria of one model on its own data; lower is better, and only differences between models count.

    Parameters
    ----------
    aic
        Akaike's: twice the number of parameters.
    aicc
        The same, corrected for few samples; infinite where there are not more samples than parameters.
    bic
        Schwarz's, which is Rissanen's description length: the number of parameters times the logarithm of the samples.
    """

    aic: float
    aicc: float
    bic: float


def information_criteria(residuals: FloatArray, parameters: int) -> InformationCriteria:
    r"""Criteria from Gaussian residuals with an unknown covariance.

    .. math:: N \log\det \frac{1}{N} \sum_k e_k e_k^T + \begin{cases} 2p \\ 2 p N_y / (N_y - p - 1) \\ p \log N
        \end{cases}

    with :math:`N_y` all numbers of the outputs. Residuals of a simulation are hardly ever white; then neighbors are
    no news, the data count for more than they hold, and all three prefer too high an order. Scores on other records do
    not have this flaw.

    Parameters
    ----------
    residuals
        Shape ``(y, n)``.
    parameters
        How many were estimated from these residuals, initial states and offsets included.

    Raises
    ------
    UsageError
        The residuals are not finite or have another shape.
    InsufficientDataError
        There are fewer samples than outputs, or the residuals of an output vanish: their likelihood has no bound.

    References
    ----------
    H. Akaike, IEEE Transactions on Automatic Control, 1974; C. Hurvich and C.-L. Tsai, Biometrika, 1989; G. Schwarz,
    Annals of Statistics, 1978.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal((1, 400))
    >>> few, many = information_criteria(noise, 2), information_criteria(noise, 12)
    >>> round(many.aic - few.aic, 9), bool(many.bic - few.bic > many.aicc - few.aicc > 20.0)
    (20.0, True)
    """
    if residuals.ndim != 2 or not np.isfinite(residuals).all():
        raise UsageError(f"residuals of shape {residuals.shape} came", needed="finite numbers of shape (y, n)")
    outputs, samples = residuals.shape
    sign, determinant = np.linalg.slogdet(residuals @ residuals.T / max(samples, 1))
    if samples <= outputs or sign <= 0:
        raise InsufficientDataError(
            "the covariance of the residuals has no determinant", needed="more samples than outputs, and noise"
        )
    fit, count = samples * float(determinant), samples * outputs
    left = count - parameters - 1
    aicc = fit + 2.0 * parameters * count / left if left > 0 else np.inf
    return InformationCriteria(fit + 2.0 * parameters, aicc, fit + parameters * float(np.log(samples)))


def singular_value_gap(singular_values: FloatArray, *, highest: int) -> tuple[int, float]:
    r"""The order before the largest step down, :math:`\arg\max_n \sigma_n / \sigma_{n+1}`, and that ratio.

    A ratio near one says that no order stands out.

    Parameters
    ----------
    singular_values
        Of a subspace identification, largest first.
    highest
        Highest order to consider.

    Raises
    ------
    UsageError
        There are not more values than the highest order.

    Examples
    --------
    >>> singular_value_gap(np.array([9.0, 8.0, 0.1, 0.09, 0.08]), highest=4)
    (2, 80.0)
    """
    if not 1 <= highest < singular_values.size:
        raise UsageError(
            f"{singular_values.size} singular values came for orders up to {highest}", needed="more of them"
        )
    floor = max(float(singular_values[0]) * np.finfo(np.float64).eps, np.finfo(np.float64).tiny)
    values = np.maximum(singular_values[: highest + 1], floor)
    ratios = values[:-1] / values[1:]
    order = 1 + int(np.argmax(ratios))
    return order, float(ratios[order - 1])
