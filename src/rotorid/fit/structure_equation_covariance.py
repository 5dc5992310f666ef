"""The covariance of parameters that several equations share, whatever the color of their residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.fit.structure_equation_rows import Errors
from rotorid.typing import FloatArray

_LONGEST_LAG_SHARE = 0.2


def covariance(parts: Sequence[Errors], weights: FloatArray, inverse: FloatArray, *, ordered: bool) -> FloatArray:
    r"""Covariance :math:`D \, [\sum_{ij} J_i^T E[e_i e_j^T] J_j] \, D` with :math:`D = (J^T J)^{-1}`.

    Errors of all equations at one place go together as they do. In time they also resemble their neighbors: their
    auto- and cross-correlations are tapered to zero at a fifth of the record (Morelli and Klein). Over a band their
    transforms do not, but have a spectrum: each frequency counts with the error that it shows (White).

    Parameters
    ----------
    parts
        Errors and derivatives of each record.
    weights
        Of the equations, shape ``(e,)``.
    inverse
        :math:`D`, shape ``(p, p)``.
    ordered
        Whether rows follow each other in time; otherwise they are real parts and then imaginary ones of lines.

    References
    ----------
    E. A. Morelli and V. Klein, *Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data*, Journal of
    Guidance, Control, and Dynamics 20(1), 1997. H. White, *A Heteroskedasticity-Consistent Covariance Matrix Estimator
    and a Direct Test for Heteroskedasticity*, Econometrica 48(4), 1980.
    """
    middle, rows = np.zeros_like(inverse), 0
    for part in parts:
        error, slopes = weights[:, None] * part.error, weights[:, None] * part.slopes
        middle += _in_time(error, slopes) if ordered else _in_band(error, slopes, inverse)
        rows += error.size
    return np.asarray(inverse @ middle @ inverse * rows / max(rows - len(inverse), 1))


def _in_band(error: FloatArray, slopes: FloatArray, inverse: FloatArray) -> FloatArray:
    """Outer products of the scores of each line, its errors as they would be were it left out of the fit."""
    leverage = np.einsum("pen,pq,qen->en", slopes, inverse, slopes, optimize=True)
    error = error / (1.0 - np.minimum(leverage, 0.9))
    scores = np.einsum("en,pen->np", error, slopes)
    lines = scores[: len(scores) // 2] + scores[len(scores) // 2 :]
    return np.asarray(lines.T @ lines)


def _in_time(error: FloatArray, slopes: FloatArray) -> FloatArray:
    """Derivatives smoothed by the correlation of the errors, for each pair of equations."""
    from scipy.fft import irfft, next_fast_len, rfft

    equations, n = error.shape
    lags = max(1, int(_LONGEST_LAG_SHARE * n))
    size = next_fast_len(2 * n, real=True)
    taper = np.zeros(size)
    taper[:lags] = 1.0 - np.arange(lags) / lags
    taper[size - lags + 1 :] = taper[lags - 1 : 0 : -1]
    seen = rfft(error, size)
    moved = rfft(slopes, size)
    middle = np.zeros((len(slopes), len(slopes)))
    for a in range(equations):
        smooth = np.zeros((len(slopes), n))
        for b in range(equations):
            correlation = irfft(seen[a] * seen[b].conj(), size) / n * taper
            smooth += irfft(rfft(correlation) * moved[:, b], size)[:, :n]
        middle += slopes[:, a] @ smooth.T
    return np.asarray(0.5 * (middle + middle.T))
