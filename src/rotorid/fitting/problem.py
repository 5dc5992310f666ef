r"""Fitting problem: the one interface for solvers, searches, bounds and bootstraps.

A problem is a value. It poses a sum of squares over the free parameters :math:`\theta` of a model,

.. math:: J(\theta) = \sum_i r_i(\theta)^2,

and a new one needs little more than its residuals with their exact Jacobian: bounds, costs of many vectors, local
searches and the box of a global search follow from these. What data know of their own errors differs. Measured
responses state them (:meth:`Problem.stated_errors`); records in time do not, and the residuals of a fit must show them
(:meth:`Problem.parts`). By this, and by nothing else, bounds and bootstraps choose their way.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt, Minimum, Solution
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

_SOLVER = LevenbergMarquardt()
_FEW_STEPS = LevenbergMarquardt(iterations=10, tolerance=1e-6)

MODEL_ERROR = 0.01
"""Relative error of the model itself, independent from point to point: no structure and no sensor is better."""

_OWN_SHARE = 0.1
"""Part of a point's own variance that no other point shares: measured covariances are not known better than that."""

_ROOT_TWO = math.sqrt(2.0)
"""A complex number of variance two has real and imaginary parts of variance one."""


class Part(NamedTuple):
    """One record, or one equation over it, at some parameters; in units in which errors have variance one.

    Parameters
    ----------
    residual
        Beside all unknowns, shape ``(n, y)``.
    slopes
        Its derivatives, shape ``(n, y, p)``.
    unknown
        Orthonormal basis of what the unknowns can explain, shape ``(n, y, k)``.
    sample_rate_hz
        Of its samples: errors that last as long in seconds last more samples at a higher rate.
    """

    residual: FloatArray
    slopes: FloatArray
    unknown: FloatArray
    sample_rate_hz: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualErrors(Immutable):
    r"""Covariance of the residuals of a problem from the errors of the data.

    Residuals are magnitudes and then phases of relative errors :math:`e`, each times a scale. Such an error is
    circular: it turns as easily into a phase as into a magnitude, so that one complex matrix :math:`C = E[e e^H]` says
    all, and half of its real and imaginary parts are the covariances of both. Its Cholesky factor takes a quarter of
    the time of that of the residuals.

    Parameters
    ----------
    relative
        Covariance :math:`C` of the relative errors, shape ``(n, n)``.
    scale
        Factor from a relative error to each residual, shape ``(2 n,)``.
    """

    relative: ComplexArray
    scale: FloatArray

    def __post_init__(self) -> None:
        self._set(
            relative=read_only(self.relative, np.complex128, ndim=2),
            scale=read_only(self.scale, np.float64, ndim=1),
        )

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the residuals, shape ``(2 n, 2 n)``."""
        real, cross = 0.5 * self.relative.real, -0.5 * self.relative.imag
        total = np.block([[real, cross], [cross.T, real]])
        return read_only(self.scale[:, None] * total * self.scale, np.float64, ndim=2)

    @property
    def variance(self) -> FloatArray:
        """Of the residuals, shape ``(2 n,)``."""
        return np.asarray(self.scale * np.tile(0.5 * self.relative.diagonal().real, 2) * self.scale)

    @property
    def own(self) -> FloatArray:
        """Variances of what no measured covariance knows, independent from residual to residual, shape ``(2 n,)``."""
        return np.asarray(_OWN_SHARE * self.variance + (MODEL_ERROR * self.scale) ** 2)

    @cached_property
    def whitening(self) -> Whitening:
        """What makes residuals independent, whose errors have this covariance and what no measured one knows."""
        return self.whitening_with(np.full(len(self.relative), MODEL_ERROR))

    def whitening_with(self, own: FloatArray) -> Whitening:
        """The same with another relative error of each point that no other point shares, shape ``(n,)``.

        Raises
        ------
        numpy.linalg.LinAlgError
            A residual has no weight, or its errors are wholly those of others.
        """
        from scipy.linalg import cholesky

        if not self.scale.all():
            raise np.linalg.LinAlgError("a residual without weight has no error to be measured by")
        total = self.relative.copy()
        total.flat[:: len(total) + 1] += _OWN_SHARE * self.relative.diagonal().real + 2.0 * own**2
        return Whitening(cholesky(total, lower=True, overwrite_a=True, check_finite=False), self.scale)

    def whitened(self, values: FloatArray) -> FloatArray:
        """Residuals, or columns of a Jacobian, in units in which their errors have no correlation and variance one."""
        return self.whitening.whitened(values)

    def propagated(self, gain: FloatArray) -> FloatArray:
        """Covariance of what a gain ``(p, 2 n)`` makes of residuals, shape ``(p, p)``."""
        rows = as_complex((gain * self.scale).T)
        return np.asarray(0.5 * (rows.conj().T @ self.relative @ rows).real)

    def at(self, points: IntArray) -> ResidualErrors:
        """Errors of some points."""
        rows = np.concatenate([points, points + len(self.relative)])
        return ResidualErrors(relative=self.relative[np.ix_(points, points)], scale=self.scale[rows])

    def with_own(self, share: float) -> ResidualErrors:
        """The same, where a further share of the variance of each point is its own."""
        return replace(self, relative=self.relative + share * np.diag(self.relative.diagonal().real))


def as_complex(values: FloatArray) -> ComplexArray:
    """The first half of ``(2 n, ...)`` as real parts, the second as imaginary ones, shape ``(n, ...)``."""
    real, imaginary = np.split(values, 2)
    return real + 1j * imaginary


class Whitening(NamedTuple):
    """What takes residuals to units in which their errors have no correlation and variance one.

    Parameters
    ----------
    root
        Cholesky factor of the covariance of relative errors, shape ``(n, n)``.
    scale
        Factor from a relative error to each residual, shape ``(2 n,)``.
    """

    root: ComplexArray
    scale: FloatArray

    def whitened(self, values: FloatArray) -> FloatArray:
        """Residuals ``(2 n,)``, or columns of a Jacobian ``(2 n, p)``, in these units."""
        from scipy.linalg import solve_triangular

        relative = as_complex((values.T / self.scale).T)
        white = _ROOT_TWO * solve_triangular(self.root, relative, lower=True, check_finite=False)
        return np.concatenate([white.real, white.imag])

    def of_residuals(self, gain: FloatArray) -> FloatArray:
        """From a gain ``(p, 2 n)`` that acts on residuals in these units to one that acts on residuals."""
        from scipy.linalg import solve_triangular

        rows = _ROOT_TWO * solve_triangular(self.root, as_complex(gain.T), lower=True, trans="C", check_finite=False)
        return np.asarray(np.concatenate([rows.real, rows.imag]).T / self.scale)

    @property
    def log_determinant(self) -> float:
        """Half the logarithm of the determinant of the covariance of the residuals."""
        return float(np.sum(2.0 * np.log(self.root.diagonal().real) - math.log(2.0)) + np.sum(np.log(self.scale)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorShapes(Immutable):
    """Shapes of the systematic errors in the residuals of a problem.

    Parameters
    ----------
    names
        Groups of columns that share one size, such as responses ``output/input``.
    smooth
        Columns of unit size, shape ``(n, m)``.
    group
        Index of the group of each column, shape ``(m,)``.
    known
        Columns of known size, shape ``(n, c)``: clocks, and places of sensors.
    largest
        How many of the last of these state the largest size there may be: residuals say how much of it is there.
    """

    names: tuple[str, ...]
    smooth: FloatArray
    group: IntArray
    known: FloatArray
    largest: int = 0

    def __post_init__(self) -> None:
        self._set(
            smooth=read_only(self.smooth, np.float64, ndim=2),
            group=read_only(self.group, np.int64, ndim=1),
            known=read_only(self.known, np.float64, ndim=2),
        )

    def with_shares(self, shares: FloatArray) -> ErrorShapes:
        """The same shapes, where residuals show shares of their :attr:`largest` columns."""
        factors = np.ones(self.known.shape[1])
        factors[factors.size - self.largest :] = shares
        return replace(self, known=self.known * factors)

    def covariance(self, sizes: Mapping[str, float]) -> FloatArray:
        """Of the residuals, for given sizes of the groups, shape ``(n, n)``."""
        root = self.root(sizes)
        return np.asarray(root @ root.T)

    def root(self, sizes: Mapping[str, float]) -> FloatArray:
        """Columns whose outer products sum to that covariance, shape ``(n, m + c)``."""
        each = np.array([sizes[name] for name in self.names])
        return np.concatenate([self.smooth * each[self.group], self.known], axis=1)


Scale: TypeAlias = Literal["linear", "logarithmic"]


@dataclass(frozen=True, kw_only=True, eq=False)
class StartBox(Immutable):
    """A box in which starts are laid out.

    Parameters
    ----------
    lower, upper
        Shape ``(p,)``.
    scales
        How each side is divided: ``linear``, or ``logarithmic`` for what may lie anywhere in several decades of one
        sign.

    Raises
    ------
    UsageError
        A side is empty or infinite, or a logarithmic one reaches zero.

    Examples
    --------
    >>> box = StartBox(lower=np.array([-1.0, 0.01]), upper=np.array([1.0, 1.0]), scales=("linear", "logarithmic"))
    >>> box.at(np.array([[0.5, 0.5]])).round(6).tolist()
    [[0.0, 0.1]]
    """

    lower: FloatArray
    upper: FloatArray
    scales: tuple[Scale, ...]

    def __post_init__(self) -> None:
        lower, upper = (read_only(side, np.float64, ndim=1) for side in (self.lower, self.upper))
        if not lower.size == upper.size == len(self.scales):
            raise UsageError(
                f"{lower.size} lower and {upper.size} upper bounds for {len(self.scales)} scales",
                needed="one of each for each parameter",
            )
        for low, high, scale in zip(lower.tolist(), upper.tolist(), self.scales, strict=True):
            if not -np.inf < low < high < np.inf:
                raise UsageError(f"bounds from {low:g} to {high:g}", needed="finite bounds with lower < upper")
            if scale == "logarithmic" and low * high <= 0.0:
                raise UsageError(f"a logarithmic scale from {low:g} to {high:g}", needed="bounds of one sign")
        self._set(lower=lower, upper=upper, scales=tuple(self.scales))

    def at(self, share: FloatArray) -> FloatArray:
        """Points at given shares of every side, zero to one; shape ``(..., p)`` as it comes."""
        logarithmic: BoolArray = np.array([scale == "logarithmic" for scale in self.scales], dtype=np.bool_)
        sign = np.where(logarithmic, np.sign(self.lower), 1.0)
        low = np.where(logarithmic, np.log(np.abs(np.where(logarithmic, self.lower, 1.0))), self.lower)
        high = np.where(logarithmic, np.log(np.abs(np.where(logarithmic, self.upper, 1.0))), self.upper)
        inside = low + share * (high - low)
        return np.where(logarithmic, sign * np.exp(np.where(logarithmic, inside, 0.0)), inside)

    def extended(self, lower: FloatArray, upper: FloatArray) -> StartBox:
        """The box with more sides after its own, divided evenly."""
        linear: tuple[Scale, ...] = tuple("linear" for _ in lower)
        return StartBox(
            lower=np.concatenate([self.lower, lower]),
            upper=np.concatenate([self.upper, upper]),
            scales=self.scales + linear,
        )


_WIDER = 3.0
_LEAST_SIZE = 1e-3


def search_box(parameters: ParameterSet, *, wider: float = _WIDER) -> StartBox:
    """The box of the free parameters, from their start values.

    It reaches from the smallest start value over ``wider`` to the largest times ``wider``; without start values, as far
    about the value. Values of both signs, or zero, have a box about zero. Bounds cut it. A side without zero is divided
    by its logarithm.

    Parameters
    ----------
    parameters
        Of a problem.
    wider
        How far the box reaches beyond the start values; ten for what may be off by a decade.

    Returns
    -------
    StartBox
        With as many sides as there are free parameters.

    Raises
    ------
    UsageError
        The bounds leave nothing of a side.

    Examples
    --------
    >>> lag = Parameter(name="T_motor", value=0.05, unit="s", lower=0.0, starts=(0.03, 0.1))
    >>> box = search_box(ParameterSet([lag]))
    >>> box.lower.round(3).tolist(), box.upper.round(3).tolist(), box.scales
    ([0.01], [0.3], ('logarithmic',))
    """
    sides = [_side(parameters[name], wider) for name in parameters.free]
    scales: tuple[Scale, ...] = tuple("logarithmic" if low * high > 0.0 else "linear" for low, high in sides)
    lower, upper = np.array(sides, dtype=np.float64).reshape(-1, 2).T
    return StartBox(lower=lower, upper=upper, scales=scales)


def _side(parameter: Parameter, wider: float) -> tuple[float, float]:
    values = parameter.starts or (parameter.value,)
    low, high = min(values), max(values)
    if low > 0.0:
        low, high = low / wider, high * wider
    elif high < 0.0:
        low, high = low * wider, high / wider
    else:
        size = wider * max(abs(low), abs(high), _LEAST_SIZE)
        low, high = -size, size
    return max(low, parameter.lower), min(high, parameter.upper)


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem(Immutable, ABC):
    """A sum of squares over the free parameters of a model.

    A subclass says its :attr:`name` and its :meth:`residuals`; everything else can be left as it is here, and is
    overridden where it is cheaper or where the data know more. The cost of a vector depends on that vector only, and
    problems pickle, so that workers in other processes can compute it.

    Where a vector of the problem has more numbers than there are free parameters, these come first.

    Parameters
    ----------
    parameters
        Which parameters are free, and from where to start.
    region
        Where a global search looks; by default :func:`search_box` of the parameters. A local search may leave it as far
        as the bounds of the parameters allow.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, kw_only=True, eq=False)
    ... class Root(Problem):
    ...     square: float
    ...     name = "a square root"
    ...
    ...     def residuals(self, theta):
    ...         return theta**2 - self.square, 2.0 * np.diag(theta)
    >>> problem = Root(parameters=ParameterSet([Parameter(name="x", value=1.0, unit="1", lower=0.0)]), square=2.0)
    >>> problem.polish(problem.start).theta.round(6).tolist(), problem.many_costs(np.array([[1.0], [2.0]])).tolist()
    ([1.414214], [1.0, 4.0])
    """

    at_once: ClassVar[int] = 4
    """How many vectors a worker is given at least: hundreds where one costs microseconds."""

    method: ClassVar[str] = "least_squares"
    """By what it is fitted: ``frequency``, ``output_error``, ``nonlinear``, ``prediction_error``, ``motors``."""

    alike: ClassVar[bool] = True
    """Whether the errors of all parts are draws of one process; otherwise each part has a color of its own."""

    kept: ClassVar[tuple[str, ...]] = ()
    """Cached values that follow from the data alone, and need not be worked out again for other parameters."""

    parameters: ParameterSet
    region: StartBox | None = None

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the fit for messages."""

    @abstractmethod
    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals at a vector ``(p,)``, shape ``(n,)``, and their Jacobian ``(n, p)``.

        Both are not a number where the model has no value, so that a search turns back.
        """

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of a vector, each shape ``(p,)``."""
        return self.parameters.box

    @property
    def start(self) -> FloatArray:
        """Where a search begins that has no better idea, shape ``(p,)``."""
        return self.parameters.pack()

    @property
    def search_box(self) -> StartBox:
        """Where a global search looks."""
        return self.region or search_box(self.parameters)

    def with_parameters(self, parameters: ParameterSet) -> Self:
        """The same problem with other free parameters or another start; a global search looks about these."""
        return self._changed(parameters=parameters, region=None)

    def within(self, region: StartBox) -> Self:
        """The same problem, with a global search that looks elsewhere."""
        return self._changed(region=region)

    def _changed(self, **changes: Any) -> Self:
        changed = replace(self, **changes)
        changed.__dict__.update({name: self.__dict__[name] for name in self.kept if name in self.__dict__})
        return changed

    def shortened(self, samples: int) -> Self:
        """The same problem on about so many samples, where it has more; for searches that need not have all."""
        del samples
        return self

    def many_residuals(self, thetas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals of many vectors ``(b, p)``, shape ``(b, n)``, and their derivatives ``(b, p, n)``."""
        residual, jacobian = zip(*(self.residuals(theta) for theta in thetas), strict=True)
        return np.stack(residual), np.stack(jacobian).swapaxes(1, 2)

    def many_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of many vectors ``(b, p)``, shape ``(b,)``; infinite where the model has no value."""
        return np.asarray(self.point_costs(thetas).sum(axis=1))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # most of a wide box may diverge
    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of every point of the data, ``(b, p)`` to ``(b, n)``; infinite where the model has no value.

        A point is what is measured at once: magnitude and phase at one frequency, all outputs at one sample.
        """
        squares = np.stack([self._squares(theta) for theta in thetas])
        return np.where(np.isfinite(squares), squares, np.inf)

    def _squares(self, theta: FloatArray) -> FloatArray:
        try:
            return self.residuals(theta)[0] ** 2
        except ModelError:
            return np.full(self.residuals(self.start)[0].size, np.inf)

    def point_weights(self, points: FloatArray) -> FloatArray:
        """Weights of points ``(n,)`` as those of the squared residuals."""
        return points

    def polish(self, start: FloatArray) -> Solution:
        """Local search from a start ``(p,)``, by Levenberg and Marquardt; its cost is that of :meth:`many_costs`."""
        return _SOLVER.minimize(self.residuals, start, *self.box)

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """Weights of the points for a few steps on a part of the data, zero or more, shape ``(n,)``."""
        root = self.point_weights(np.sqrt(points))

        def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = self.residuals(theta)
            return root * residual, root[:, None] * jacobian

        return _FEW_STEPS.minimize(residuals, start, *self.box)

    def stated_errors(
        self, theta: FloatArray, *, weights: Literal["cifer", "covariance"] = "cifer"
    ) -> ResidualErrors | None:
        """Errors of the residuals stated by the data themselves; none by default, see :meth:`parts`.

        Parameters
        ----------
        theta
            Where a fit ended, shape ``(p,)``.
        weights
            With which it was found.
        """
        del theta, weights
        return None

    def error_shapes(self, theta: FloatArray) -> ErrorShapes | None:
        """Shapes of errors in the residuals about the model at ``theta`` that are no noise; none by default."""
        del theta
        return None

    def parts(self, theta: FloatArray) -> list[Part]:
        """Residuals of each record, for errors that the data do not state.

        At the end of a fit this is what :func:`rotorid.uncertainty.colored.colored_covariance` takes.
        """
        residual, jacobian = self.residuals(theta)
        return [Part(residual[:, None], jacobian[:, None], np.zeros((residual.size, 1, 0)))]

    def determined(self, solution: Solution) -> BoolArray:
        """Which free parameters have an uncertainty at the end of a fit, shape ``(p,)``; all by default."""
        del solution
        return np.ones(len(self.parameters.free), dtype=np.bool_)

    def noiseless(self, theta: FloatArray) -> Self:
        """The same problem with the predictions of the model at ``theta`` as data.

        Raises
        ------
        UsageError
            Nobody can say what these would be.
        """
        del theta
        raise UsageError(f"{self.name} cannot simulate new data", needed="a problem that can")

    def disturbed(self, errors: Sequence[FloatArray]) -> Self:
        """The same problem with errors added to its data: one array ``(n, y)`` for each part, in its units."""
        del errors
        raise UsageError(f"{self.name} cannot simulate new data", needed="a problem that can")


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Immutable):
    """End of a fit.

    Parameters
    ----------
    problem
        What was fitted, with the noise as it was estimated.
    solution
        End of the last search.
    """

    problem: Problem
    solution: Solution

    @property
    def parameters(self) -> ParameterSet:
        """The identified values."""
        free = self.problem.parameters.free
        return self.problem.parameters.unpack(self.solution.theta[: len(free)])

    @property
    def others(self) -> tuple[Minimum, ...]:
        """Other minima that the search met, best first."""
        return self.solution.others
