"""How well measured accelerations determine motor and inertia constants, and which of these they cannot tell apart."""

from __future__ import annotations

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.search.acceleration import AccelerationProblem
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Bounds

_NEAR = 0.5
"""Errors smaller than this part of the median count as being about zero: some 26 % of normal ones."""

_FLAT = 1e-10
_UNSEEN = 1e8


def acceleration_bounds(problem: AccelerationProblem, theta: FloatArray) -> Bounds:
    r"""Covariance of the parameters at the end of a fit.

    .. math:: \mathrm{Cov}\,\theta = H^{-1} V H^{-1}, \qquad H = \sum_c k_c S_c^T S_c, \quad V = \sum_c v_c S_c^T S_c

    with the slopes :math:`S_c` of each acceleration and its weight :math:`w_c`. Absolute errors have
    :math:`k_c = 2 w_c f_c(0)`, twice the density of the errors at zero, and :math:`v_c = w_c^2`; squares have
    :math:`k_c = 2 w_c` and :math:`v_c = 4 w_c^2 \sigma_c^2`. Assumes errors that are white: those of differentiated
    signals are not, and their covariance is larger at low frequencies and smaller at high ones.

    A direction in which the cost is flat is given :math:`10^8` of what its parameters would have alone, so that
    :func:`rotorid.uncertainty.identifiability.unseen_combinations` names it.

    Parameters
    ----------
    problem
        What was fitted.
    theta
        Where it ended, shape ``(p,)``.

    Returns
    -------
    Bounds
        Of what CIFER's percents are made has no meaning here: ``cramer_rao`` is the standard deviation, and
        ``insensitivity`` that with all other parameters held.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the accelerations.

    References
    ----------
    R. Koenker and G. Bassett, *Regression Quantiles*, Econometrica 46(1), 1978.
    """
    errors, slopes = problem.accelerations - problem.modeled(theta), problem.slopes(theta)
    grams = np.einsum("icn,jcn->cij", slopes, slopes)
    weights = problem.channel_weights
    if problem.error == "squared":
        curvature, variance = 2.0 * weights, 4.0 * weights**2 * np.mean(errors**2, axis=1)
    else:
        curvature, variance = 2.0 * weights * _density_at_zero(errors), weights**2
    H, V = np.tensordot(curvature, grams, axes=1), np.tensordot(variance, grams, axes=1)
    length = np.sqrt(np.diag(H))
    if not np.all(length > 0.0):
        still = ", ".join(name for name, size in zip(problem.parameters.free, length, strict=True) if not size > 0.0)
        raise InsufficientDataError(f"{still} has no effect on the accelerations", remedy="fix it")
    alone = np.sqrt(np.diag(V)) / np.diag(H)
    covariance = _sandwich(H / np.outer(length, length), V / np.outer(length, length)) / np.outer(length, length)
    return Bounds(
        names=problem.parameters.free,
        cramer_rao=np.sqrt(np.diag(covariance)),
        insensitivity=alone,
        covariance=covariance,
        inflation=1.0,
    )


def _density_at_zero(errors: FloatArray) -> FloatArray:
    """Probability density of each channel's errors at zero, shape ``(4,)``."""
    near = np.maximum(_NEAR * np.median(np.abs(errors), axis=1), np.finfo(np.float64).tiny)
    return np.asarray(np.mean(np.abs(errors) <= near[:, None], axis=1) / (2.0 * near))


def _sandwich(H: FloatArray, V: FloatArray) -> FloatArray:
    """``H^-1 V H^-1`` where H sees anything, and very much where it does not."""
    sizes, directions = np.linalg.eigh(H)
    seen = sizes > _FLAT * sizes.max()
    inverse = directions[:, seen] / sizes[seen] @ directions[:, seen].T
    flat = directions[:, ~seen]
    return np.asarray(inverse @ V @ inverse + _UNSEEN**2 * np.mean(np.diag(V)) * flat @ flat.T)
