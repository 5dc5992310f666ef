"""Weak instruments: how much larger an error is than its linear formula says when feedback rules the input."""

from __future__ import annotations

import numpy as np

from rotorid.typing import ComplexArray, FloatArray

_LEAST_STRENGTH = 0.02
_LARGEST_FACTOR = 1e3


def weak_instrument_factor(
    variance: FloatArray, noise: FloatArray, input_noise: FloatArray, input_residual: ComplexArray
) -> FloatArray:
    r"""Factor on the standard deviation of a joint estimate for the noise in its denominator.

    The estimate is a ratio, :math:`\hat H = S_{ry} / S_{ru}`, and feedback makes numerator and denominator err
    together. The textbook's linear formula :math:`\sigma^2 = s S_{vv}` evaluates the noise at the estimate, which has
    adapted to it. Those :math:`H = \hat H + \delta` whose own noise explains the data at one standard deviation are

    .. math:: |\delta|^2 \le s \left( S_{vv} - 2 \,\mathrm{Re}\, \delta^* S_{uv} + |\delta|^2 \Omega_{uu} \right)

    a disk around :math:`-s S_{uv} / A` with :math:`A = 1 - s \Omega_{uu}`; its farthest point is the honest error. For
    a strong instrument :math:`s \Omega_{uu} \to 0` and the factor is one. Where the disk is unbounded the data say
    nothing, and the factor is a thousand.

    Parameters
    ----------
    variance
        :math:`s S_{vv}` of the linear formula, any shape.
    noise
        :math:`S_{vv}`, same shape.
    input_noise
        :math:`\Omega_{uu}`, the density of the input that the instruments do not explain, same shape.
    input_residual
        :math:`S_{uv}`, same shape.

    References
    ----------
    E. C. Fieller, *Some Problems in Interval Estimation*, Journal of the Royal Statistical Society B 16, 1954;
    T. W. Anderson and H. Rubin, *Estimation of the Parameters of a Single Equation in a Complete System of Stochastic
    Equations*, Annals of Mathematical Statistics 20, 1949.

    Examples
    --------
    An instrument that explains the whole input, and one that explains as much as noise does:

    >>> half = np.array([0.5])
    >>> float(weak_instrument_factor(half, half, np.array([0.0]), np.array([0j]))[0])
    1.0
    >>> float(weak_instrument_factor(half, half, np.array([1.0]), np.array([0j]))[0])
    1000.0
    """
    scale = variance / noise
    strength = 1.0 - scale * input_noise
    held = np.maximum(strength, _LEAST_STRENGTH)
    center = scale * np.abs(input_residual) / held
    farthest = center + np.sqrt(center**2 + variance / held)
    factor = np.where(strength > _LEAST_STRENGTH, farthest / np.sqrt(variance), _LARGEST_FACTOR)
    return np.asarray(np.clip(factor, 1.0, _LARGEST_FACTOR))
