r"""CIFER's frequency-domain cost, as residuals with an exact Jacobian.

.. math:: J = \frac{20}{n_\omega} \sum W \left[ (\Delta |T|_{dB})^2 + 0.01745 \, (\Delta \angle T_{deg})^2 \right]

Up to 100 is acceptable, up to 50 hardly to be told from the flight (Tischler and Remple, *Aircraft and Rotorcraft
System Identification*, chapter 11).
"""

from __future__ import annotations

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.typing import BoolArray, ComplexArray, FloatArray

ACCEPTABLE_COST = 100.0
EXCELLENT_COST = 50.0

PHASE_WEIGHT = 0.01745
DB_PER_NEPER = 20.0 / np.log(10.0)
DEG_PER_RAD = 180.0 / np.pi
_COST_SCALE = 20.0
_ERROR_FLOOR = 0.02
_SMALLEST_RATIO = 1e-4


def coherence_weight(coherence: FloatArray) -> FloatArray:
    r"""Weight of a point, :math:`W_\gamma = [1.58 (1 - e^{-\gamma^2})]^2`.

    Examples
    --------
    >>> coherence_weight(np.array([0.6, 1.0])).round(2)
    array([0.51, 1.  ])
    """
    return np.asarray((1.58 * (1.0 - np.exp(-coherence))) ** 2)


def point_weights(data: FrequencyResponse, used: BoolArray) -> FloatArray:
    r"""Weights of all points, shape ``(y, u, f)``; zero where a point is not used.

    Direct estimates are weighted by coherence, as CIFER does. Joint estimates are weighted by the variance of the
    instrument-variable estimate, :math:`1/(\varepsilon^2 + \varepsilon_0^2)`, because no coherence of theirs tells how
    good a point is; the weights are scaled to the same sum, so that costs stay comparable. The floor
    :math:`\varepsilon_0 = 2\,\%` stands for what random errors leave out: leakage, calibration, the model itself.
    """
    weights = np.where(used, coherence_weight(data.coherence), 0.0)
    if data.estimate == "direct":
        return weights
    precise = np.where(used, 1.0 / (data.random_error**2 + _ERROR_FLOOR**2), 0.0)
    total = precise.sum(axis=-1, keepdims=True)
    share = weights.sum(axis=-1, keepdims=True) / np.where(total > 0.0, total, 1.0)
    return np.asarray(precise * share)


def residual_scales(weights: FloatArray, phase_weight: float = PHASE_WEIGHT) -> tuple[FloatArray, FloatArray]:
    """Factors of magnitude (neper) and phase (radian) errors whose squares sum to the cost, each ``(y, u, f)``."""
    points = np.count_nonzero(weights, axis=-1, keepdims=True)
    root = np.sqrt(_COST_SCALE * weights / np.maximum(points, 1))
    return root * DB_PER_NEPER, root * np.sqrt(phase_weight) * DEG_PER_RAD


def expansion_point(model: ComplexArray, data: ComplexArray) -> ComplexArray:
    """The model, or 1e-4 of the data where the model is smaller than that.

    The logarithm of the model is taken there, and continued as a straight line. It is the model itself wherever a
    model means anything (80 dB); below, the slope leads from a response of zero toward the data, where the logarithm
    has none.
    """
    small = np.abs(model) < _SMALLEST_RATIO * np.abs(data)
    return np.where(small, _SMALLEST_RATIO * data, model) if small.any() else model


def log_error(model: ComplexArray, data: ComplexArray) -> ComplexArray:
    """Model over data as a complex logarithm: magnitude error in neper and phase error in radians, wrapped to ±π.

    A model below 1e-4 of the data has a finite error too, about 10 neper: :func:`expansion_point` says how.

    Examples
    --------
    >>> log_error(np.array([1j, 0.0]), np.array([1.0, 1.0])).round(2)
    array([  0.  +1.57j, -10.21+0.j  ])
    """
    return log_error_from(model, expansion_point(model, data), data)


def log_error_from(model: ComplexArray, point: ComplexArray, data: ComplexArray) -> ComplexArray:
    """The same, where the point of expansion is known."""
    error = np.log(point / data)
    return np.asarray(error if point is model else error + (model - point) / point)


def pair_costs(model: ComplexArray, data: ComplexArray, weights: FloatArray) -> FloatArray:
    """Cost of each response, shape ``(y, u)``; zero where no point is used."""
    magnitude, phase = residual_scales(weights)
    used = weights > 0.0
    error = np.zeros(used.shape, dtype=np.complex128)
    # Where no point is used, model and data may both be zero.
    error[used] = log_error(*(np.broadcast_to(values, used.shape)[used] for values in (model, data)))
    return np.asarray(np.sum((magnitude * error.real) ** 2 + (phase * error.imag) ** 2, axis=-1))
