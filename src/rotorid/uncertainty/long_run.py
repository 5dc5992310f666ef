r"""Errors of means and slopes of a flight in which gusts last: the variance of a sum of correlated scores.

Of :math:`n` scores :math:`g_k` in the order of time, the variance of their sum is that of their slowest cosines,

.. math:: \Lambda = \frac{1}{\nu} \sum_{j=1}^{\nu} c_j c_j^T, \qquad
          c_j = \sqrt 2 \sum_k g_k \cos\left(\pi j (k + \tfrac12) / n\right)

and as few cosines have few degrees of freedom, intervals are those of Student's t of :math:`\nu`. Assumes scores that
are correlated over less than the period of these cosines; what lasts longer is not in the error.

References
----------
Lazarus, Lewis, Stock and Watson, "HAR inference: recommendations for practice", 2018.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.data.quantity import TWO_SIDED_95
from rotorid.typing import AnyArray, FloatArray

_SLOWEST_S, _FEWEST_COSINES = 30.0, 3
"""A cosine for so many seconds of flight, of which the long-run variance is the mean."""


def long_run(scores: AnyArray, seconds: float) -> tuple[FloatArray, float]:
    """Covariance of the sum of scores that last, and the factor that makes its error as wide as Student's.

    Parameters
    ----------
    scores
        Evenly in time, shape ``(k, n)``.
    seconds
        Of flight that they come from.

    Returns
    -------
    array
        Covariance of the sums, shape ``(k, k)``.
    float
        Half width of Student's interval of 95 % over that of a normal error.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=(1, 4000))
    >>> covariance, wider = long_run(noise, 3000.0)
    >>> bool(0.7 < covariance[0, 0] / 4000.0 < 1.4), round(wider, 2)
    (True, 1.01)
    """
    rows = np.asarray(scores, dtype=np.float64)
    size = rows.shape[1]
    count = cosines(seconds)
    waves = np.cos(np.pi * np.outer(np.arange(1, count + 1), np.arange(size) + 0.5) / size)
    sums = math.sqrt(2.0) * rows @ waves.T
    return np.asarray(sums @ sums.T / count), student(count)


def cosines(seconds: float) -> int:
    """Number of cosines of a flight, which is that of the degrees of freedom.

    Examples
    --------
    >>> cosines(20.0), cosines(600.0)
    (3, 20)
    """
    return max(int(seconds / _SLOWEST_S), _FEWEST_COSINES)


def student(freedom: float) -> float:
    """Half width of Student's interval of 95 % over that of a normal error.

    Examples
    --------
    >>> round(student(3.0), 2), round(student(1000.0), 2)
    (1.62, 1.0)
    """
    from scipy.stats import t

    return float(t.ppf(0.975, freedom)) / TWO_SIDED_95
