r"""Bounds of identified parameters: CIFER's two percents, and a standard deviation that holds.

CIFER's numbers come from the curvature of the cost, :math:`H = \partial^2 (\sum J) / \partial\theta^2 = 2 J_r^T J_r`:
Cramér–Rao :math:`CR_i = 2 \sqrt{(H^{-1})_{ii}}` and insensitivity :math:`I_i = 1 / \sqrt{H_{ii}}`, in percent of the
value. They are relative numbers for comparing parameters (guidelines 20 % and 10 %), not probabilities.

The standard deviation carries the measured errors of the response through the fit. With
:math:`\delta\theta = -(J_r^T J_r)^{-1} J_r^T S e`, where :math:`e` are the logarithmic errors of the data and
:math:`S` the scales of the cost,

.. math:: \mathrm{Cov}\,\theta = D J_r^T S \, \mathrm{Cov}(e) \, S J_r D, \qquad D = (J_r^T J_r)^{-1}

with the full covariance between frequencies: neighboring points share data, so their errors are colored. Where the
residuals are larger than these errors explain, because the structure does not fit, the covariance is scaled up to them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import residual_scales
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.typing import ComplexArray, FloatArray

CRAMER_RAO_GUIDELINE_PERCENT = 20.0
INSENSITIVITY_GUIDELINE_PERCENT = 10.0

_FLAT = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds(Immutable):
    """Uncertainty of the free parameters, in their order.

    Parameters
    ----------
    names
        Free parameters.
    cramer_rao, insensitivity
        CIFER's bounds in the unit of each parameter, shape ``(p,)``.
    covariance
        Honest covariance, shape ``(p, p)``.
    inflation
        Factor on the standard deviations because the residuals were larger than the errors of the data; at least one.
    """

    names: tuple[str, ...]
    cramer_rao: FloatArray
    insensitivity: FloatArray
    covariance: FloatArray
    inflation: float

    def __post_init__(self) -> None:
        self._set(
            cramer_rao=read_only(self.cramer_rao, np.float64, ndim=1),
            insensitivity=read_only(self.insensitivity, np.float64, ndim=1),
            covariance=read_only(self.covariance, np.float64, ndim=2),
        )

    @property
    def std(self) -> FloatArray:
        """One standard deviation of each parameter, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the parameters, shape ``(p, p)``."""
        return np.asarray(self.covariance / np.outer(self.std, self.std))


def bounds(problem: FrequencyProblem, solution: Solution) -> Bounds:
    """Uncertainty of a solution.

    Assumes that the structure holds and that the errors of the response are those it states. A direct estimate in
    closed loop is biased, and no bound here shows that.

    A direction in which the cost is flat has no bound at all. It is given one by the rounding of the Jacobian, some
    :math:`10^8` of what its parameters would have alone, so that it shows as what it is.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the cost at all.
    """
    # Columns of unit length make parameters of any unit comparable; J = U diag(s) V^T then gives every inverse.
    length = np.sqrt(np.sum(solution.jacobian**2, axis=0))
    if not length.all():
        silent = [name for name, size in zip(problem.parameters.free, length, strict=True) if size == 0.0]
        raise InsufficientDataError(
            f"{', '.join(silent)} changes nothing in the fitted responses",
            needed="parameters that the data can see",
            remedy="fix it with --fix NAME=VALUE, or fit a wider band",
        )
    left_vectors, singular, right = np.linalg.svd(solution.jacobian / length, full_matrices=False)
    root = right.T / np.maximum(singular, _FLAT * singular.max(initial=0.0)) / length[:, None]
    inverse = 0.5 * root @ root.T
    errors = _residual_covariance(problem)
    gain = root @ left_vectors.T
    covariance = gain @ errors @ gain.T
    # The part of the errors that the fit absorbs does not show in the residuals.
    left = np.eye(len(errors)) - solution.jacobian @ gain
    expected = float(np.einsum("ij,jk,ik->", left, errors, left))
    inflation = float(np.sqrt(max(1.0, solution.cost / expected))) if expected > 0.0 else 1.0
    return Bounds(
        names=problem.parameters.free,
        cramer_rao=2.0 * np.sqrt(np.diag(inverse)),
        insensitivity=1.0 / (np.sqrt(2.0) * length),
        covariance=covariance * inflation**2,
        inflation=inflation,
    )


def _residual_covariance(problem: FrequencyProblem) -> FloatArray:
    """Covariance of the residuals from that of the response, shape ``(2 n, 2 n)``, magnitudes first."""
    used = problem.used
    magnitude, phase = (scale[used] for scale in residual_scales(problem.weights))
    relative = _relative_covariance(problem)
    # The real and imaginary parts of a circular error: half of the covariance each, coupled by its imaginary part.
    real, cross = 0.5 * relative.real, -0.5 * relative.imag
    total = np.block([[real, cross], [cross.T, real]])
    scales = np.concatenate([magnitude, phase])
    return np.asarray(scales[:, None] * total * scales)


def _relative_covariance(problem: FrequencyProblem) -> ComplexArray:
    """Relative covariance of all used points; responses of different pairs are taken as independent."""
    data, used = problem.data, problem.used
    count = int(np.count_nonzero(used))
    total = np.zeros((count, count), dtype=np.complex128)
    position = 0
    for y, u in np.ndindex(used.shape[:2]):
        chosen = np.flatnonzero(used[y, u])
        values = data.values[y, u, chosen]
        block = data.covariance[y, u][np.ix_(chosen, chosen)] / (values[:, None] * values.conj())
        total[position : position + chosen.size, position : position + chosen.size] = block
        position += chosen.size
    return total
