"""Filters that make an error white."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

_RIDGE = 1e-9


def whitening_taps(error: FloatArray, order: int) -> FloatArray:
    r"""Taps of :math:`A(z^{-1}) = 1 - a_1 z^{-1} - \dots`, with which an error becomes (nearly) white.

    The autoregression follows from the sample autocorrelation by the equations of Yule and Walker, so that its inverse
    is stable.

    Parameters
    ----------
    error
        Shape ``(n,)``, with n well above the order.
    order
        Number of past samples.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> noise = rng.standard_normal(20000)
    >>> colored = noise[1:] + 0.5 * noise[:-1]
    >>> white = np.convolve(colored, whitening_taps(colored, 10), mode="valid")
    >>> bool(abs(np.mean(white[1:] * white[:-1]) / np.mean(white**2)) < 0.02)
    True
    """
    from scipy.linalg import solve_toeplitz

    size = int(2 ** np.ceil(np.log2(2 * error.size)))
    power = np.abs(np.fft.rfft(error, size)) ** 2
    correlation = np.fft.irfft(power, size)[: order + 1] / error.size
    correlation[0] *= 1.0 + _RIDGE
    coefficients = solve_toeplitz(correlation[:order], correlation[1:])
    return np.concatenate([[1.0], -coefficients])
