"""Gusts: air velocity as a first-order Gauss–Markov process, the shape of Dryden's longitudinal spectrum."""

from __future__ import annotations

import math

import numpy as np

from rotorid.typing import FloatArray


def gauss_markov(
    samples: int, *, intensity: float, correlation_s: float, sample_rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    r"""Stationary noise with the autocorrelation :math:`\sigma^2 e^{-|t|/T}`.

    .. math:: g_{k+1} = a g_k + \sigma \sqrt{1 - a^2} \, n_k, \qquad a = e^{-h/T}, \qquad
        S(\omega) = \frac{4 \sigma^2 T}{1 + \omega^2 T^2} \text{ per Hz}

    It is Dryden's longitudinal gust for T = scale length over airspeed. In hover the airspeed is the wind itself, so T
    is given directly; the transverse components of Dryden fall off a little differently.

    Parameters
    ----------
    samples
        Number of samples.
    intensity
        Standard deviation :math:`\sigma`, in the unit of the result.
    correlation_s
        T, the time after which the correlation has fallen to 1/e.
    sample_rate_hz
        Rate of the samples; the recursion is exact at any rate.
    rng
        Random generator; ``samples`` numbers are drawn from it.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``; already stationary at its first sample.

    Examples
    --------
    >>> gust = gauss_markov(9, intensity=0.5, correlation_s=2.0, sample_rate_hz=100.0, rng=np.random.default_rng(0))
    >>> gust.shape
    (9,)
    """
    from scipy.signal import lfilter

    decay = math.exp(-1.0 / (correlation_s * sample_rate_hz))
    innovation = rng.standard_normal(samples)
    # The first sample is drawn from the stationary distribution, all others bring what the decay took away.
    innovation[1:] *= math.sqrt(1.0 - decay**2)
    gust: FloatArray = intensity * lfilter([1.0], [1.0, -decay], innovation)
    return gust
