r"""Linear regression as the field does it: scaled columns, QR, and a covariance that knows colored residuals.

.. math:: y = X \theta + v, \qquad \hat\theta = (X^T X)^{-1} X^T y, \qquad
    \mathrm{PRESS} = \sum_i \left( \frac{v_i}{1 - h_{ii}} \right)^2

with the diagonal :math:`h_{ii}` of the hat matrix :math:`X (X^T X)^{-1} X^T`, the row lengths of Q. PRESS is the
squared error of predicting each sample by all others; it rises with every regressor that explains only noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import FloatArray

CONSTANT = "constant"
"""Name of the regressor that is one everywhere."""

_DEPENDENT = 1e-10
_LONGEST_LAG_SHARE = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression(Immutable):
    """A regression with everything that a report shows of it.

    Parameters
    ----------
    names
        Regressors, one for each estimate.
    estimates
        Shape ``(p,)``, units of the target over those of the regressor.
    covariance
        Of the estimates for white residuals, shape ``(p, p)``.
    colored_covariance
        The same with the autocorrelation that the residuals have; ``covariance`` where nothing is known of their order.
    residual
        Target minus fit, shape ``(n,)``.
    r_squared
        Share of the target that is explained: of its variation about its mean where there is a constant, of its mean
        square otherwise.
    press
        Sum of squared errors of predicting each sample by all others.
    """

    names: tuple[str, ...]
    estimates: FloatArray
    covariance: FloatArray
    colored_covariance: FloatArray
    residual: FloatArray
    r_squared: float
    press: float

    def __post_init__(self) -> None:
        self._set(
            names=tuple(self.names),
            estimates=read_only(self.estimates, np.float64, ndim=1),
            covariance=read_only(self.covariance, np.float64, ndim=2),
            colored_covariance=read_only(self.colored_covariance, np.float64, ndim=2),
            residual=read_only(self.residual, np.float64, ndim=1),
        )

    @property
    def std(self) -> FloatArray:
        """Standard errors for colored residuals, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.diag(self.colored_covariance)))

    @property
    def t_values(self) -> FloatArray:
        """Estimates in standard errors for white residuals, shape ``(p,)``; their squares are the partial F values."""
        spread = np.sqrt(np.diag(self.covariance))
        ratio = np.divide(self.estimates, spread, out=np.full(spread.size, np.inf), where=spread > 0.0)
        return np.asarray(ratio, dtype=np.float64)

    @property
    def partial_f(self) -> FloatArray:
        r"""What leaving out each regressor would cost, in units of the residual variance, shape ``(p,)``.

        :math:`F_j = (SSE_{-j} - SSE) / s^2 = t_j^2`.
        """
        return np.asarray(self.t_values**2)

    @property
    def residual_variance(self) -> float:
        """Unbiased variance of the residuals."""
        return float(self.residual @ self.residual / (self.residual.size - self.estimates.size))


def regress(
    regressors: FloatArray,
    target: FloatArray,
    names: Sequence[str],
    *,
    constant: bool = True,
    ordered: bool = True,
) -> Regression:
    """Least squares of a target on regressors.

    Assumes that the regressors are known exactly: noise in them pulls their estimates toward zero, by its share of
    their variance. Residuals may be colored.

    Parameters
    ----------
    regressors
        Shape ``(n, p)``.
    target
        Shape ``(n,)``.
    names
        One for each column.
    constant
        Add a regressor that is one everywhere, named ``constant``, as the last.
    ordered
        Whether rows follow each other in time, so that neighboring residuals may be alike.

    Raises
    ------
    UsageError
        Shapes do not match, or a number is not finite.
    InsufficientDataError
        There are no more samples than regressors, or a regressor is a combination of others.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapter 5.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 50)
    >>> found = regress(np.stack([x, x**2], axis=1), 3.0 * x - 0.5, ["x", "x^2"])
    >>> found.estimates.round(6).tolist(), round(found.r_squared, 6)
    ([3.0, -0.0, -0.5], 1.0)
    """
    X, y, labels = _checked(regressors, target, names, constant)
    n, p = X.shape
    length = np.sqrt(np.sum(X**2, axis=0))
    if np.any(length == 0.0):
        raise _dependent(labels[int(np.argmin(length))])
    Q, R = np.linalg.qr(X / length)
    weak = np.abs(R.diagonal()) < _DEPENDENT
    if weak.any():
        raise _dependent(labels[int(np.argmax(weak))])
    inverse = np.linalg.inv(R) / length[:, None]
    estimates = inverse @ (Q.T @ y)
    residual = y - X @ estimates
    spread = inverse @ inverse.T
    variance = float(residual @ residual) / (n - p)
    centered = y - y.mean() if CONSTANT in labels else y
    total = float(centered @ centered)
    leverage = np.minimum(np.sum(Q**2, axis=1), 1.0 - 1e-12)
    return Regression(
        names=labels,
        estimates=estimates,
        covariance=variance * spread,
        colored_covariance=colored_covariance(X, residual, spread) if ordered else variance * spread,
        residual=residual,
        r_squared=1.0 - float(residual @ residual) / total if total > 0.0 else 0.0,
        press=float(np.sum((residual / (1.0 - leverage)) ** 2)),
    )


def colored_covariance(regressors: FloatArray, residual: FloatArray, inverse: FloatArray) -> FloatArray:
    r"""Covariance of least-squares estimates with residuals that resemble their neighbors.

    .. math:: \mathrm{Cov} = (X^T X)^{-1} \Big[ \sum_i x_i \sum_j \hat R_{vv}(i - j) \, x_j^T \Big] (X^T X)^{-1}

    Lags reach to a fifth of the record; the autocorrelation is tapered to zero there, so that the sum stays positive.

    Parameters
    ----------
    regressors
        X, shape ``(n, p)``, rows in order of time.
    residual
        Shape ``(n,)``.
    inverse
        :math:`(X^T X)^{-1}`, shape ``(p, p)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(p, p)``.

    References
    ----------
    E. A. Morelli and V. Klein, *Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data*, Journal of
    Guidance, Control, and Dynamics, 1997.
    """
    n, p = regressors.shape
    lags = max(1, int(_LONGEST_LAG_SHARE * n))
    size = 2 * n
    power = np.abs(np.fft.rfft(residual, size)) ** 2
    correlation = np.fft.irfft(power, size)[:lags] / (n - p) * (1.0 - np.arange(lags) / lags)
    # The sum over j is a convolution, and a product of transforms.
    kernel = np.zeros(size)
    kernel[:lags] = correlation
    kernel[size - lags + 1 :] = correlation[:0:-1]
    spectrum = np.fft.rfft(kernel)[:, None]
    smoothed = np.fft.irfft(spectrum * np.fft.rfft(regressors, size, axis=0), size, axis=0)[:n]
    middle = regressors.T @ smoothed
    return np.asarray(inverse @ (0.5 * (middle + middle.T)) @ inverse)


def _checked(
    regressors: FloatArray, target: FloatArray, names: Sequence[str], constant: bool
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    X, y = np.asarray(regressors, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if X.ndim != 2 or y.shape != (X.shape[0],) or X.shape[1] != len(names):
        raise UsageError(
            f"regressors of shape {X.shape}, {len(names)} names and a target of shape {y.shape} came",
            needed="shapes (n, p), p and (n,)",
        )
    if not (np.isfinite(X).all() and np.isfinite(y).all()):
        raise UsageError("samples that are not finite came", needed="finite samples", remedy="cut the stretch there")
    labels = tuple(names)
    if constant:
        X, labels = np.column_stack([X, np.ones(len(X))]), (*labels, CONSTANT)
    if len(set(labels)) < len(labels):
        raise UsageError(f"the regressors {', '.join(labels)} came", needed="each name once")
    if X.shape[0] <= X.shape[1]:
        raise InsufficientDataError(f"{X.shape[0]} samples came", needed=f"more than {X.shape[1]}")
    return X, y, labels


def _dependent(name: str) -> InsufficientDataError:
    return InsufficientDataError(
        f"the regressor {name} is zero or a combination of the others",
        needed="regressors that the data can tell apart",
        remedy="leave it out, or excite the axes independently",
    )
