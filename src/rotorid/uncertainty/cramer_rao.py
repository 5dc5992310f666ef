r"""Bounds of identified parameters: CIFER's two percentages, and a reliable standard deviation.

CIFER's numbers come from the curvature of the cost, :math:`H = \partial^2 (\sum J) / \partial\theta^2 = 2 J_r^T J_r`:
Cramér–Rao :math:`CR_i = 2 \sqrt{(H^{-1})_{ii}}` and insensitivity :math:`I_i = 1 / \sqrt{H_{ii}}`, in percent of the
value. They are relative numbers for comparing parameters (guidelines 20 % and 10 %), not probabilities.

The standard deviation carries the measured errors of the response through the fit. With
:math:`\delta\theta = -(J_r^T J_r)^{-1} J_r^T S e`, where :math:`e` are the logarithmic errors of the data and
:math:`S` the scales of the cost,

.. math:: \mathrm{Cov}\,\theta = D J_r^T S \, \mathrm{Cov}(e) \, S J_r D, \qquad D = (J_r^T J_r)^{-1}

with the full covariance between frequencies and outputs: neighboring points share data, and one gust moves several
outputs. For weights made of that covariance the same holds with whitened residuals. What the structure leaves out, and
clocks, come on top of these random errors (:mod:`rotorid.uncertainty.model_error`).

Records in time state no errors. There Fisher's matrix :math:`F = \sum_i S_i^T S_i` of whitened residuals takes the
place of half the curvature, and the covariance is corrected for the color that the residuals show
(:mod:`rotorid.uncertainty.colored`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import refusal
from rotorid.errors import InsufficientDataError
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Part, Problem
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_by_part, colored_covariance
from rotorid.uncertainty.model_error import ModelError, model_error

Weights: TypeAlias = Literal["cifer", "covariance"]
"""Which weights a solution was found with: CIFER's, or those of the measured covariance."""

_FLAT = 1e-8
_SAME_MOTION = 1e-7
"""Singular value over the largest, of derivatives of unit length, that the rounding of a normal matrix hides."""


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
        Of random and model errors together, shape ``(p, p)``.
    random
        Of random errors alone, shape ``(p, p)``: what would scatter from flight to flight.
    colored
        Where the data state no errors: standard deviations by colored residuals over those by white ones, in the
        geometric mean.
    ar_order
        Order of the autoregression that describes this color; zero where none does, or none was asked.
    model_error
        What the structure leaves out, where that was looked for.
    assumed
        Columns whose outer products are in the covariance too, shape ``(p, k)``: what assumptions may be wrong by that
        make physical parameters out of the response, and leave the response as it is.
    implied
        Ties that the data contradict, each to one more such column, shape ``(p,)``: how far parameters have to move
        that give the tied one its measured value. Other tied ones were measured, and do not move with them.
    """

    names: tuple[str, ...]
    cramer_rao: FloatArray
    insensitivity: FloatArray
    covariance: FloatArray
    random: FloatArray
    colored: float | None = None
    ar_order: int = 0
    model_error: ModelError | None = None
    assumed: FloatArray | None = None
    implied: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            random=read_only(self.random, np.float64, ndim=2),
            cramer_rao=read_only(self.cramer_rao, np.float64, ndim=1),
            insensitivity=read_only(self.insensitivity, np.float64, ndim=1),
            covariance=read_only(self.covariance, np.float64, ndim=2),
            assumed=None if self.assumed is None else read_only(self.assumed, np.float64, ndim=2),
            implied={tie: read_only(moved, np.float64, ndim=1) for tie, moved in self.implied.items()},
        )

    @property
    def of_response(self) -> Bounds:
        """The same without what leaves the response as it is."""
        if self.assumed is None:
            return self
        return replace(self, covariance=self.covariance - self.assumed @ self.assumed.T, assumed=None)

    def of_measured(self, ties: Collection[str]) -> Bounds:
        """The same for a parameter that was measured, made of some ties: without what other ties imply."""
        found = self.of_response
        others = [moved for tie, moved in self.implied.items() if tie not in ties]
        if not others:
            return found
        kept = {tie: moved for tie, moved in self.implied.items() if tie in ties}
        moved = np.stack(others, axis=1)
        return replace(found, covariance=found.covariance - moved @ moved.T, implied=kept)

    @property
    def std(self) -> FloatArray:
        """One standard deviation of each parameter, random and model error together, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def stds(self) -> dict[str, float]:
        """Parameter to its standard deviation."""
        return dict(zip(self.names, self.std.tolist(), strict=True))

    @property
    def random_stds(self) -> dict[str, float]:
        """Parameter to the standard deviation of its random errors."""
        return dict(zip(self.names, self.random_std.tolist(), strict=True))

    @property
    def random_std(self) -> FloatArray:
        """Its random part, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.diag(self.random)))

    @property
    def model_std(self) -> FloatArray:
        """The part of model errors and clocks, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance) - np.diag(self.random), 0.0)))

    @property
    def inflation(self) -> float:
        """Factor on the standard deviations, in the geometric mean: of all errors over random errors alone.

        Where the data state no errors, that of colored residuals over white ones.
        """
        return _ratio(self.covariance, self.random) if self.colored is None else self.colored

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the parameters, shape ``(p, p)``."""
        return np.asarray(self.covariance / np.outer(self.std, self.std))

    def with_errors(self, random: FloatArray, model: FloatArray) -> Bounds:
        """The same with other covariances, of random errors and of model errors and clocks, shape ``(p, p)`` each."""
        return replace(self, covariance=random + model, random=random)


def bounds(
    problem: Problem,
    solution: Solution,
    *,
    weights: Weights = "cifer",
    model_errors: bool = True,
    least_model_errors: Mapping[str, float] | None = None,
) -> Bounds:
    """Uncertainty of a solution.

    Where the data state their errors, as responses do, these are believed, and what the structure leaves out is seen in
    what they do not explain; a direct estimate in closed loop is biased, and no bound here shows that. Otherwise the
    residuals show, see :func:`bounds_of_parts`.

    A direction in which the cost is flat has no bound at all. It is given one by the rounding of the Jacobian, some
    :math:`10^8` of what its parameters would have alone, so that it shows as what it is.

    Parameters
    ----------
    problem
        What was fitted; in time with the covariance of the output errors that the fit ended with.
    solution
        Its solution.
    weights
        Of responses: ``cifer`` for a solution of :func:`rotorid.fitting.frequency.fit.fit_frequency`, ``covariance``
        for one of :func:`rotorid.fitting.frequency.fit.refine`.
    model_errors
        Whether errors of the structure and of clocks count too; random errors alone say how certain a parameter is
        within the structure, which is what reductions ask.
    least_model_errors
        Relative sizes of the model error of responses that are known from elsewhere, as a plan knows them from a
        previous flight: no smaller ones are taken.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the cost at all, or several cannot be separated at all.
    """
    errors = problem.stated_errors(solution.theta, weights=weights)
    if errors is None:
        known = problem.determined(solution)
        names = tuple(name for name, kept in zip(problem.parameters.free, known, strict=True) if kept)
        parts = problem.parts(solution.theta)
        # Numbers beyond the parameters are those of a noise: on a bound it has no effect any more.
        beyond = ~np.array(solution.at_bound, dtype=np.bool_)[known.size : parts[0].slopes.shape[2]]
        columns = np.concatenate([known, beyond])
        parts = [part._replace(slopes=part.slopes[:, :, columns]) for part in parts]
        return bounds_of_parts(parts, names, alike=problem.alike)
    residual, of_cost = solution.residual, solution.jacobian
    if weights == "covariance":
        residual, of_cost = problem.residuals(solution.theta)
    jacobian = of_cost if weights == "cifer" else errors.whitened(of_cost)
    length, _, inverse_root = _inverse_root(problem, of_cost)
    inverse = 0.5 * inverse_root @ inverse_root.T
    _, left_vectors, root = _inverse_root(problem, jacobian)
    gain = root @ left_vectors.T
    if weights == "covariance":
        gain = errors.whitening.of_residuals(gain)
    random = errors.propagated(gain)
    total, found = random, None
    shapes = problem.error_shapes(solution.theta) if model_errors else None
    if shapes is not None:
        about = errors if weights == "covariance" else problem.stated_errors(solution.theta, weights="covariance")
        assert about is not None
        found = model_error(shapes, residual, of_cost, about).at_least(least_model_errors or {})
        # A value at a bound says nothing of what else is in it.
        anything = ~np.isfinite(problem.box[0]) & ~np.isfinite(problem.box[1])
        found = found.as_parameters_show(gain, np.where(anything, solution.theta, np.nan), random)
        moved = found.moved(gain)
        total = random + moved @ moved.T
    return Bounds(
        names=problem.parameters.free,
        cramer_rao=2.0 * np.sqrt(np.diag(inverse)),
        insensitivity=1.0 / (np.sqrt(2.0) * length),
        covariance=total,
        random=random,
        model_error=found,
    )


def colored_of(parts: Sequence[Bounds]) -> float | None:
    """``colored`` of several bounds together: over all parameters, as that of each is over its own."""
    if all(part.colored is None for part in parts):
        return None
    return math.exp(float(np.average([math.log(p.inflation) for p in parts], weights=[len(p.names) for p in parts])))


def _ratio(total: FloatArray, random: FloatArray) -> float:
    """Standard deviations of one covariance over those of another, in the geometric mean."""
    known = random.diagonal() > 0.0
    if not known.any():
        return 1.0
    return math.exp(0.5 * float(np.mean(np.log(total.diagonal()[known] / random.diagonal()[known]))))


def bounds_of_parts(parts: Sequence[Part], names: tuple[str, ...], *, alike: bool = True) -> Bounds:
    r"""Uncertainty from what a fit has left, where the data state no errors.

    Cramér–Rao and insensitivity are CIFER's, :math:`2 \sqrt{(F^{-1})_{ii}}` and :math:`1 / \sqrt{F_{ii}}`, so that the
    same guidelines apply. The covariance is corrected for the color of the residuals; ``colored`` is how much larger
    than for white ones the standard deviations are, in the geometric mean.

    Parameters
    ----------
    parts
        Whitened residuals of each record at the solution. Columns of the slopes beyond the names are those of a noise
        model, which is estimated with them.
    names
        Parameters.
    alike
        Whether the errors of all parts are draws of one process.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect, or several cannot be separated at all.
    """
    count = len(names)
    slopes = np.concatenate([part.slopes.reshape(-1, part.slopes.shape[2]) for part in parts])
    fisher = slopes.T @ slopes
    silent = [name for name, size in zip(names, fisher.diagonal()[:count], strict=True) if size == 0.0]
    if silent:
        raise _not_determined(silent)
    try:
        colored = colored_covariance(parts) if alike else colored_by_part(parts)
    except np.linalg.LinAlgError as error:
        raise _not_determined(_mixed(slopes, names)) from error
    length = np.sqrt(fisher.diagonal())
    inverse = np.linalg.inv(fisher / np.outer(length, length)).diagonal() / fisher.diagonal()
    corrected, white = colored.corrected[:count, :count], colored.white[:count, :count]
    # Numbers that cancel leave variances of zero or less: nothing is known of these parameters.
    known = (corrected.diagonal() > 0.0) & (white.diagonal() > 0.0) & (inverse[:count] > 0.0)
    if not known.all():
        raise _not_determined([name for name, is_known in zip(names, known.tolist(), strict=True) if not is_known])
    ratio = np.log(corrected.diagonal() / white.diagonal())
    return Bounds(
        names=names,
        cramer_rao=2.0 * np.sqrt(inverse[:count]),
        insensitivity=1.0 / length[:count],
        covariance=corrected,
        random=corrected,
        colored=math.exp(0.5 * float(np.mean(ratio))),
        ar_order=colored.ar_order,
    )


def _mixed(slopes: FloatArray, names: Sequence[str]) -> list[str]:
    """Parameters whose effects cannot be separated; all if none is clear."""
    length = np.sqrt(np.sum(slopes**2, axis=0))
    _, singular, right = np.linalg.svd(slopes / np.where(length > 0.0, length, 1.0), full_matrices=False)
    flat = np.abs(right[singular <= _SAME_MOTION * singular.max(initial=0.0), : len(names)])
    return [name for name, share in zip(names, flat.max(axis=0, initial=0.0), strict=True) if share > 0.1] or [*names]


def _not_determined(names: Sequence[str]) -> InsufficientDataError:
    message = f"The records do not determine {', '.join(names)}."
    return InsufficientDataError(
        message,
        needed="parameters that affect the data",
        remedy="fix some with --fix NAME=VALUE, or use a smaller model",
        findings=[refusal("not_identifiable", name, message) for name in names],
    )


def _inverse_root(problem: Problem, jacobian: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Column lengths, left singular vectors and a root :math:`R` of :math:`(J^T J)^{-1} = R R^T`.

    Columns of unit length make parameters of any unit comparable; :math:`J = U S V^T` then gives every inverse.
    """
    length = np.sqrt(np.sum(jacobian**2, axis=0))
    if not length.all():
        silent = [name for name, size in zip(problem.parameters.free, length, strict=True) if size == 0.0]
        raise InsufficientDataError(
            f"{', '.join(silent)} {'have' if len(silent) > 1 else 'has'} no effect on the fitted responses",
            needed="parameters that affect the data",
            remedy=f"fix {'them' if len(silent) > 1 else 'it'} with --fix NAME=VALUE, or fit a wider band",
        )
    left_vectors, singular, right = np.linalg.svd(jacobian / length, full_matrices=False)
    return length, left_vectors, right.T / np.maximum(singular, _FLAT * singular.max(initial=0.0)) / length[:, None]
