r"""Bounds of identified parameters: CIFER's two percents, and a standard deviation that holds.

CIFER's numbers come from the curvature of the cost, :math:`H = \partial^2 (\sum J) / \partial\theta^2 = 2 J_r^T J_r`:
Cramér–Rao :math:`CR_i = 2 \sqrt{(H^{-1})_{ii}}` and insensitivity :math:`I_i = 1 / \sqrt{H_{ii}}`, in percent of the
value. They are relative numbers for comparing parameters (guidelines 20 % and 10 %), not probabilities.

The standard deviation carries the measured errors of the response through the fit. With
:math:`\delta\theta = -(J_r^T J_r)^{-1} J_r^T S e`, where :math:`e` are the logarithmic errors of the data and
:math:`S` the scales of the cost,

.. math:: \mathrm{Cov}\,\theta = D J_r^T S \, \mathrm{Cov}(e) \, S J_r D, \qquad D = (J_r^T J_r)^{-1}

with the full covariance between frequencies and outputs: neighboring points share data, and one gust moves several
outputs. For weights made of that covariance the same holds with whitened residuals. Where the residuals are larger than
these errors explain, because the structure does not fit, the covariance is scaled up to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import ResidualErrors
from rotorid.typing import FloatArray

CRAMER_RAO_GUIDELINE_PERCENT = 20.0
INSENSITIVITY_GUIDELINE_PERCENT = 10.0

Weights: TypeAlias = Literal["cifer", "covariance"]
"""Which weights a solution was found with: CIFER's, or those of the measured covariance."""

_CHANCE = 2.0
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


def bounds(problem: FrequencyProblem, solution: Solution, *, weights: Weights = "cifer") -> Bounds:
    """Uncertainty of a solution.

    Assumes that the structure holds and that the errors of the response are those it states. A direct estimate in
    closed loop is biased, and no bound here shows that.

    A direction in which the cost is flat has no bound at all. It is given one by the rounding of the Jacobian, some
    :math:`10^8` of what its parameters would have alone, so that it shows as what it is.

    Parameters
    ----------
    problem
        What was fitted.
    solution
        Its solution.
    weights
        ``cifer`` for a solution of :func:`rotorid.fitting.frequency.fit.fit`, ``covariance`` for one of
        :func:`rotorid.fitting.frequency.fit.refine`.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the cost at all.
    """
    if weights == "cifer":
        errors, residual, jacobian = problem.errors, solution.residual, solution.jacobian
        of_cost = jacobian
    else:
        errors = problem.errors_about(solution.theta)
        residual, of_cost = problem.residuals(solution.theta)
        residual, jacobian = errors.whitened(residual), errors.whitened(of_cost)
    length, _, inverse_root = _inverse_root(problem, of_cost)
    inverse = 0.5 * inverse_root @ inverse_root.T
    _, left_vectors, root = _inverse_root(problem, jacobian)
    gain = root @ left_vectors.T
    spread = _Spread.of(errors, gain, weights)
    # The part of the errors that the fit absorbs does not show in the residuals.
    expected = (
        spread.total
        - 2.0 * float(np.sum(jacobian * spread.shared.T))
        + float(np.sum((jacobian @ spread.covariance) * jacobian))
    )
    inflation = _inflation(float(residual @ residual), expected, spread.squared)
    return Bounds(
        names=problem.parameters.free,
        cramer_rao=2.0 * np.sqrt(np.diag(inverse)),
        insensitivity=1.0 / (np.sqrt(2.0) * length),
        covariance=spread.covariance * inflation**2,
        inflation=inflation,
    )


def _inflation(found: float, expected: float, squared: float) -> float:
    r"""Factor on standard deviations where residuals are larger than the errors of the data and chance explain.

    A sum of squares with the covariance :math:`E` scatters by :math:`\sqrt{2 \, \mathrm{tr} E^2}`.
    """
    if expected <= 0.0 or found <= expected + _CHANCE * math.sqrt(2.0 * squared):
        return 1.0
    return math.sqrt(found / expected)


class _Spread(NamedTuple):
    """What the errors of the data make of residuals and parameters, in the metric of the fit.

    ``covariance`` is that of the parameters and ``shared`` that of parameters and residuals, shape ``(p, 2 n)``; the
    residuals before any fit have the variances ``total`` in sum, and ``squared`` is at least the sum of the squares of
    their covariances.
    """

    covariance: FloatArray
    shared: FloatArray
    total: float
    squared: float

    @classmethod
    def of(cls, errors: ResidualErrors, gain: FloatArray, weights: Weights) -> _Spread:
        from scipy.linalg import solve_triangular

        if weights == "cifer":
            shared = gain @ errors.covariance
            total, squared = float(np.trace(errors.covariance)), float(np.vdot(errors.covariance, errors.covariance))
            return cls(shared @ gain.T, shared, total, squared)
        # With L L^T = C + C0 the whitened errors have 1 - L^-1 C0 L^-T, whose eigenvalues lie between zero and one.
        back = solve_triangular(errors.root, gain.T, lower=True, trans=1, check_finite=False)
        shared = errors.whitened(errors.covariance @ back).T
        return cls(back.T @ errors.covariance @ back, shared, errors.whitened_trace, errors.whitened_trace)


def _inverse_root(problem: FrequencyProblem, jacobian: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Column lengths, left singular vectors and a root :math:`R` of :math:`(J^T J)^{-1} = R R^T`.

    Columns of unit length make parameters of any unit comparable; :math:`J = U S V^T` then gives every inverse.
    """
    length = np.sqrt(np.sum(jacobian**2, axis=0))
    if not length.all():
        silent = [name for name, size in zip(problem.parameters.free, length, strict=True) if size == 0.0]
        raise InsufficientDataError(
            f"{', '.join(silent)} {'change' if len(silent) > 1 else 'changes'} nothing in the fitted responses",
            needed="parameters that the data can see",
            remedy=f"fix {'them' if len(silent) > 1 else 'it'} with --fix NAME=VALUE, or fit a wider band",
        )
    left_vectors, singular, right = np.linalg.svd(jacobian / length, full_matrices=False)
    return length, left_vectors, right.T / np.maximum(singular, _FLAT * singular.max(initial=0.0)) / length[:, None]
