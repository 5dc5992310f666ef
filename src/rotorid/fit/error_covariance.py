r"""What the measured errors of a response mean for the residuals of a fit: their covariance, and weights made of it.

Points of one response share data with their neighbors, one gust moves several outputs at once, and one instrument may
move several inputs. Of two outputs a and b, inputs u and v, and frequencies i and j

.. math:: E[\delta H_{au}(\omega_i) \, \delta H_{bv}^*(\omega_j)]
          = \rho_{ui,vj} \, [K_i K_j^H]_{ab} \, \sigma_{au,i} \sigma_{bv,j}

with the correlation :math:`\rho`, which windows and instruments make and all outputs share, and :math:`K_i K_i^H`, that
between outputs, which the disturbance makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.disturbances import level_about, output_correlation
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

MODEL_ERROR = 0.01
"""Relative error of the model itself, independent from point to point: no structure and no sensor is better."""

_OWN_SHARE = 0.1
"""Part of a point's own variance that no other point shares: measured covariances are not known better than that."""

_JITTER = 1e-9
"""Outputs of which one is the integral of another err alike to the last digit; a factor needs some distance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualErrors(Immutable):
    """What the errors of the data make of the residuals of a problem.

    Parameters
    ----------
    covariance
        Of the residuals, shape ``(2 n, 2 n)``.
    scale
        Factor from a relative error to each residual, shape ``(2 n,)``.
    """

    covariance: FloatArray
    scale: FloatArray

    def __post_init__(self) -> None:
        self._set(
            covariance=read_only(self.covariance, np.float64, ndim=2),
            scale=read_only(self.scale, np.float64, ndim=1),
        )

    @cached_property
    def root(self) -> FloatArray:
        """Cholesky factor of the covariance with what no measured covariance knows, shape ``(2 n, 2 n)``."""
        return np.asarray(np.linalg.cholesky(self.covariance + np.diag(self.own)))

    @property
    def own(self) -> FloatArray:
        """Variances of what no measured covariance knows, independent from residual to residual, shape ``(2 n,)``."""
        return np.asarray(_OWN_SHARE * np.diag(self.covariance) + (MODEL_ERROR * self.scale) ** 2)

    def whitened(self, values: FloatArray) -> FloatArray:
        """Residuals, or columns of a Jacobian, in units in which their errors have no correlation and variance one."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.root, values, lower=True, check_finite=False))

    @cached_property
    def whitened_trace(self) -> float:
        """Sum of the variances of whitened residuals: what is measured of them, without what no covariance knows."""
        from scipy.linalg.lapack import dtrtri

        inverse = dtrtri(self.root.T, lower=0)[0]
        return float(self.scale.size - np.einsum("ij,ij,i->", inverse, inverse, self.own))


def residual_errors(
    data: FrequencyResponse,
    used: BoolArray,
    scales: tuple[FloatArray, FloatArray],
    *,
    model: ComplexArray | None = None,
) -> ResidualErrors:
    """Covariance of the residuals of a fit.

    Parameters
    ----------
    data
        Measured responses.
    used
        Points that count, shape ``(y, u, f)``.
    scales
        Factors of magnitude and phase errors in the residuals of these points, each shape ``(n,)``.
    model
        The response about which errors are wanted, shape ``(y, u, f)``: that of a fit knows better than single points
        what is response and what disturbance. None for the measured one itself.
    """
    if model is not None:
        data = _about(data, used, model)
    relative = _relative_covariance(data, *np.nonzero(used))
    # The real and imaginary parts of a circular error: half of the covariance each, coupled by its imaginary part.
    real, cross = 0.5 * relative.real, -0.5 * relative.imag
    scale = np.concatenate(scales)
    total = np.block([[real, cross], [cross.T, real]])
    return ResidualErrors(covariance=scale[:, None] * total * scale, scale=scale)


def _about(data: FrequencyResponse, used: BoolArray, model: ComplexArray) -> FrequencyResponse:
    """The data with the errors that they have about a model: relative to it, and of what it leaves of the outputs."""
    factor = np.where(used, data.values / np.where(used, model, 1.0), 1.0)
    if data.disturbance is None:
        return replace(data, covariance=data.covariance * factor[..., :, None] * factor.conj()[..., None, :])
    difference = np.where(used, data.values - model, 0.0)
    correlation = output_correlation(data.disturbance, data.omega_rad_s, difference)
    factor = factor * level_about(data.disturbance, difference)
    return replace(
        data,
        covariance=data.covariance * factor[..., :, None] * factor.conj()[..., None, :],
        output_correlation=np.stack([correlation] * len(data.inputs)),
    )


def _relative_covariance(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Relative covariance of points of several responses, shape ``(n, n)``."""
    values = data.values[output, source, point]
    level = np.sqrt(np.einsum("yuff->yuf", data.covariance).real)[output, source, point] / np.abs(values)
    phase = values / np.abs(values)
    together = _between_points(data, output, source, point) * _between_outputs(data, output, source, point)
    return np.asarray(together * level[:, None] * level / (phase[:, None] * phase.conj()))


def _between_points(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Correlation of errors between frequencies and inputs, for a disturbance that all outputs share."""
    alike = source[:, None] == source
    if data.input_correlation is not None:
        return np.asarray(data.input_correlation[source[:, None], source, point[:, None], point])
    level = np.sqrt(np.einsum("yuff->yuf", data.covariance).real)
    each = data.covariance / (level[..., :, None] * level[..., None, :])
    if data.output_correlation is None:
        own = each[output[:, None], source[:, None], point[:, None], point]
        return np.asarray(np.where(alike, own, 0.0))
    return np.asarray(np.where(alike, each.mean(axis=0)[source[:, None], point[:, None], point], 0.0))


def _between_outputs(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Correlation of errors between outputs."""
    if data.output_correlation is None:
        return np.asarray(output[:, None] == output, dtype=np.complex128)
    between = np.moveaxis(data.output_correlation, -1, 1)
    factor = np.linalg.cholesky(between + _JITTER * np.eye(between.shape[-1]))[source, point, output]
    return np.asarray(factor @ factor.conj().T)
