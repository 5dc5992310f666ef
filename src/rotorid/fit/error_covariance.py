r"""What the measured errors of a response mean for the residuals of a fit: their covariance, and weights made of it.

Points of one response share data with their neighbors, and one gust moves several outputs at once. Of two outputs a
and b of one input at two frequencies

.. math:: E[\delta H_a(\omega_i) \, \delta H_b^*(\omega_j)]
          = \rho_{ij} \, [K_i K_j^H]_{ab} \, \sigma_{a,i} \sigma_{b,j}

with the correlation :math:`\rho` between frequencies, which the windows make and all outputs share, and
:math:`K_i K_i^H` that between outputs, which the disturbance makes. Responses to different inputs are taken as
independent: they come from times at which different instruments moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.response import FrequencyResponse
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import ComplexArray, FloatArray, IntArray

MODEL_ERROR = 0.01
"""Relative error of the model itself, independent from point to point: no structure and no sensor is better."""

_OWN_SHARE = 0.1
"""Part of a point's own variance that no other point shares: measured covariances are not known better than that."""

_JITTER = 1e-9
"""Outputs of which one is the integral of another err alike to the last digit; a factor needs some distance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBlock(Immutable):
    """Residuals whose errors go together.

    Parameters
    ----------
    rows
        Which residuals of the problem, shape ``(n,)``.
    covariance
        Of those residuals, from the errors of the data, shape ``(n, n)``.
    scale
        Factor from a relative error to each residual, shape ``(n,)``.
    """

    rows: IntArray
    covariance: FloatArray
    scale: FloatArray

    def __post_init__(self) -> None:
        self._set(
            rows=read_only(self.rows, np.int64, ndim=1),
            covariance=read_only(self.covariance, np.float64, ndim=2),
            scale=read_only(self.scale, np.float64, ndim=1),
        )

    def root(self) -> FloatArray:
        """Cholesky factor of the covariance with what no measured covariance knows, shape ``(n, n)``."""
        own = _OWN_SHARE * np.diag(self.covariance) + (MODEL_ERROR * self.scale) ** 2
        return np.asarray(np.linalg.cholesky(self.covariance + np.diag(own)))


def error_blocks(problem: FrequencyProblem) -> tuple[ErrorBlock, ...]:
    """Covariance of the residuals of a problem, one block for each input that has points."""
    y, u, f = np.nonzero(problem.used)
    magnitude, phase = problem.point_scales
    blocks = []
    for index in range(problem.used.shape[1]):
        rows = np.flatnonzero(u == index)
        if not rows.size:
            continue
        relative = _relative_covariance(problem.data, index, y[rows], f[rows])
        # The real and imaginary parts of a circular error: half of the covariance each, coupled by its imaginary part.
        real, cross = 0.5 * relative.real, -0.5 * relative.imag
        scale = np.concatenate([magnitude[rows], phase[rows]])
        blocks.append(
            ErrorBlock(
                rows=np.concatenate([rows, rows + u.size]),
                covariance=scale[:, None] * np.block([[real, cross], [cross.T, real]]) * scale,
                scale=scale,
            )
        )
    return tuple(blocks)


def _relative_covariance(data: FrequencyResponse, u: int, output: IntArray, point: IntArray) -> ComplexArray:
    """Relative covariance of points of the responses to one input, complex, shape ``(n, n)``."""
    values = data.values[output, u, point]
    over = values[:, None] * values.conj()
    if data.output_correlation is None or np.all(output == output[0]):
        alike = output[:, None] == output
        own = data.covariance[output[:, None], u, point[:, None], point]
        return np.asarray(np.where(alike, own, 0.0) / over)
    spread = np.sqrt(np.einsum("yff->yf", data.covariance[:, u]).real)
    frequencies = np.mean(data.covariance[:, u] / (spread[:, :, None] * spread[:, None, :]), axis=0)
    between = np.moveaxis(data.output_correlation[u], -1, 0)
    factor = np.linalg.cholesky(between + _JITTER * np.eye(between.shape[-1]))[point, output]
    level = spread[output, point]
    together = frequencies[point[:, None], point] * (factor @ factor.conj().T)
    return np.asarray(together * level[:, None] * level / over)
