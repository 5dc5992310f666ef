r"""Model error in addition to random error: the missing dynamics of a structure, as a smooth unknown over frequency.

Random errors shrink with every minute of flight, and soon the structure is what a fit is wrong by: a rotor that lags a
little differently, a drag that grows with speed, a stamp that is late by a tenth of a sample. None of this scatters
from frequency to frequency. So the residuals of a fit, magnitudes and phases with the scales :math:`s` of its cost, are
taken as

.. math:: r = J \, \delta\theta + s \, e + s B c + T d, \qquad c_k \sim N(0, a_k^2), \quad d \sim N(0, 1)

with the random error :math:`e` that the data state; a model error :math:`B c` of each response, in magnitude and in
phase a Gaussian process over :math:`\ln \omega` with the kernel :math:`\exp(-\frac12 (\Delta \ln\omega / 0.7)^2)`, one
octave; and what is known beside it :math:`T d`: scales of 0.25 % and clocks of every input and every output, and what
else :mod:`rotorid.fitting.frequency.error_shapes` lists. The values stay what the fit gave. With its own gain M, from
residuals to parameters,

.. math:: \mathrm{Cov}\,\theta = M \, (C + \sum_k E[a_k^2] \, s B_k B_k^T s + T T^T) \, M^T

Residuals say how large the model error of a response is, with what the parameters absorb projected out (restricted
likelihood). They say little where random errors are larger, so no single size is taken, but the mean square over all
sizes, by their likelihood given the other responses and a prior: half of a Cauchy distribution, with 0.3 % as its
median, whose tail hardly speaks against what residuals show (Gelman, *Prior Distributions for Variance Parameters in
Hierarchical Models*, Bayesian Analysis 1(3), 2006). No size counts above 30 %, or above three times the typical
residual: a few points at the end of a band, which nothing smooth explains, would ask for any size.

An accelerometer may lie beside the center of gravity by some centimeters. Of this column the share counts that the
residuals leave of it, its root mean square given them. What parameters follow leaves no trace there, but in their
values: an accelerometer off by a centimeter adds to each of them what it adds, and where one of them is far smaller,
its true value would have to cancel that by chance. The smallest share that a parameter shows so, with its deviation,
is an upper bound.

Errors that leave no trace in residuals, a wrong scale or a slope that depends on amplitude, are covered by the scales
alone. How often such intervals hold, over simulated flights of seven vehicles, stands in ``docs/accuracy.md``.

The idea of a prior on what is left out is that of stochastic embedding (Goodwin, Gevers and Ninness, *Quantifying the
Error in Estimated Transfer Functions with Application to Model Order Selection*, IEEE Transactions on Automatic Control
37(7), 1992).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.fitting.problem import ErrorShapes, ResidualErrors
from rotorid.typing import BoolArray, FloatArray, IntArray

SMALLEST_MODEL_ERROR, LARGEST_MODEL_ERROR = 0.005, 0.3
"""No sensor is better than the one; beyond the other nothing is described any more."""

USUAL_MODEL_ERROR = 0.003
"""Half of the responses of a fit have a smaller model error than this, before their residuals are seen."""

_OWN_ERRORS = (0.002, 0.005, 0.01, 0.02, 0.05)
"""Relative errors, independent from point to point, of which the likelihood chooses one for each group."""

_FOLLOWED = 1e-9
_TYPICAL, _NORMAL = 0.75, 0.8693
"""The upper quartile of the size of residuals is typical, also where only magnitudes are off; the standard deviation of
a normal error over it."""

_LARGEST_SHARE = 3.0
_BOX = (math.log(1e-4), math.log(LARGEST_MODEL_ERROR))
_FINE = 60
_COARSE = 9
"""Sizes that are tried for each group before the search, so that it begins near its end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelError(Immutable):
    """Missing dynamics of a structure, estimated from a fit.

    Parameters
    ----------
    shapes
        The shapes that were allowed.
    sizes
        Relative standard deviation of the model error of each group that makes the residuals most likely.
    deviations
        The one that counts: its root mean square over all sizes that residuals allow.
    scatter
        Standard deviation of what the data do not state and no smooth error explains, from residual to residual,
        shape ``(n,)``.
    expected
        The most likely course of model error and clocks in the residuals, shape ``(n,)``.
    """

    shapes: ErrorShapes
    sizes: Mapping[str, float]
    deviations: Mapping[str, float]
    scatter: FloatArray
    expected: FloatArray

    def __post_init__(self) -> None:
        self._set(
            sizes=self.sizes,
            deviations=self.deviations,
            scatter=read_only(self.scatter, np.float64, ndim=1),
            expected=read_only(self.expected, np.float64, ndim=1),
        )

    @property
    def root(self) -> FloatArray:
        """Columns whose outer products sum to the covariance of all this, shape ``(n, k)``."""
        return np.concatenate([self.shapes.root(self.deviations), np.diag(self.scatter)], axis=1)

    def moved(self, gain: FloatArray) -> FloatArray:
        """What a gain ``(p, n)`` from residuals to parameters makes of these columns, shape ``(p, k)``."""
        return np.concatenate([gain @ self.shapes.root(self.deviations), gain * self.scatter], axis=1)

    def as_parameters_show(self, gain: FloatArray, values: FloatArray, random: FloatArray) -> ModelError:
        """The same, where values of parameters bound the :attr:`~ErrorShapes.largest` columns.

        Parameters
        ----------
        gain
            From residuals to parameters, shape ``(p, n)``.
        values
            Parameters whose true value may be anything; not a number for all others, shape ``(p,)``.
        random
            Covariance of their random errors, shape ``(p, p)``.
        """
        columns = self.shapes.known.shape[1] - self.shapes.largest
        if not self.shapes.largest:
            return self
        shifts = gain @ self.shapes.known[:, columns:]
        others = replace(self, shapes=replace(self.shapes, known=self.shapes.known[:, :columns], largest=0))
        moved = others.moved(gain)
        size = np.sqrt(values**2 + random.diagonal() + np.sum(moved**2, axis=1))
        with np.errstate(divide="ignore"):
            shown = np.nan_to_num(size[:, None] / np.abs(shifts), nan=1.0)
        return replace(self, shapes=self.shapes.with_shares(np.minimum(shown.min(axis=0, initial=1.0), 1.0)))

    def at_least(self, sizes: Mapping[str, float]) -> ModelError:
        """The same, where no size that counts is below that of its group in ``sizes``."""
        return replace(
            self, deviations={name: max(size, sizes.get(name, 0.0)) for name, size in self.deviations.items()}
        )


def model_error(shapes: ErrorShapes, residual: FloatArray, jacobian: FloatArray, errors: ResidualErrors) -> ModelError:
    r"""Sizes of model errors by what residuals say of them.

    With everything in units of the random error and outside of what the parameters can follow, columns X and residuals
    :math:`\rho` give :math:`S = X^T X`, :math:`y = X^T \rho`, and of sizes D the logarithm of the restricted likelihood
    is :math:`-\frac12 \ln\det(1 + D S D) + \frac12 (D y)^T (1 + D S D)^{-1} D y`.

    Parameters
    ----------
    shapes
        What errors may look like.
    residual, jacobian
        Of the problem at its solution, shapes ``(n,)`` and ``(n, p)``.
    errors
        Random errors of the residuals.

    Examples
    --------
    Residuals of 5 % that nothing but a smooth error explains:

    >>> from rotorid.fitting.frequency.error_shapes import response_error_shapes
    >>> omega = np.geomspace(1.0, 50.0, 40)
    >>> nothing = np.zeros(40, dtype=np.int64)
    >>> shapes = response_error_shapes(omega, nothing, nothing, np.ones(80), outputs=["p"], inputs=["roll"],
    ...                                clock_error_s=None)
    >>> residual = np.concatenate([0.05 * np.sin(3.0 * np.log(omega)), np.zeros(40)])
    >>> errors = ResidualErrors(relative=2e-6 * np.eye(40), scale=np.ones(80))
    >>> found = model_error(shapes, residual, np.zeros((80, 0)), errors)
    >>> 0.01 < found.sizes["p/roll"] < 0.1, 0.01 < found.deviations["p/roll"] < 0.1
    (True, True)
    """
    return _most_likely(shapes, residual, jacobian, errors)[0]


def _most_likely(
    shapes: ErrorShapes, residual: FloatArray, jacobian: FloatArray, errors: ResidualErrors
) -> tuple[ModelError, _Likelihood, FloatArray]:
    """The model error with the likelihood of its shapes, and the logarithms of the most likely sizes."""
    own, start, tops = np.zeros(residual.size), np.zeros(len(shapes.names)), np.zeros(len(shapes.names))
    scale = _scale_of(shapes, errors.variance)
    for place in range(len(shapes.names)):
        points = np.flatnonzero(np.any(np.split(shapes.smooth[:, shapes.group == place].any(axis=1), 2), axis=0))
        rows = np.concatenate([points, points + residual.size // 2])
        part, here = _part(shapes, place, rows), errors.at(points)
        typical = _NORMAL * float(np.quantile(np.abs(residual[rows]) / scale[rows], _TYPICAL))
        tops[place] = np.clip(math.log(max(_LARGEST_SHARE * typical, SMALLEST_MODEL_ERROR)), _BOX[0] + 1e-6, _BOX[1])
        grid = np.linspace(_BOX[0], tops[place], _COARSE)
        tried = [
            _coarse(_Likelihood.of(part, residual[rows], jacobian[rows], here, error * scale[rows]), grid)
            for error in _OWN_ERRORS
        ]
        best = min(range(len(tried)), key=lambda which: tried[which][0])
        own[rows], start[place] = _OWN_ERRORS[best] * scale[rows], tried[best][1]
    likelihood = _Likelihood.of(shapes, residual, jacobian, errors, own)
    logs = likelihood.best(start, tops)
    columns = np.concatenate([shapes.smooth, shapes.known], axis=1)
    shares = np.ones(columns.shape[1])
    shares[shares.size - shapes.largest :] = likelihood.shares(logs)[shares.size - shapes.largest :]
    found = ModelError(
        shapes=shapes.with_shares(shares[shares.size - shapes.largest :]),
        sizes=dict(zip(shapes.names, map(float, np.exp(logs)), strict=True)),
        deviations=dict(zip(shapes.names, likelihood.mean_sizes(logs, tops), strict=True)),
        scatter=own,
        expected=columns @ likelihood.expected(logs),
    )
    return found, likelihood.with_shares(shares), logs


def _part(shapes: ErrorShapes, place: int, rows: IntArray) -> ErrorShapes:
    """One group alone, with what is known at its residuals."""
    columns, known = shapes.group == place, shapes.known[rows]
    return ErrorShapes(
        names=(shapes.names[place],),
        smooth=shapes.smooth[np.ix_(rows, np.flatnonzero(columns))],
        group=np.zeros(int(columns.sum()), dtype=np.int64),
        known=known[:, known.any(axis=0)],
    )


def _coarse(likelihood: _Likelihood, grid: FloatArray) -> tuple[float, float]:
    """The best of some sizes of a single group, its value first."""
    rest, gains = likelihood.along(np.zeros(1), likelihood.member[0] > 0.0, grid)
    best = int(np.argmax(gains))
    return rest - float(gains[best]), float(grid[best])


def _scale_of(shapes: ErrorShapes, variance: FloatArray) -> FloatArray:
    """Factor from a relative error to each residual: smooth columns have unit size everywhere."""
    size = np.sqrt(np.sum(shapes.smooth**2, axis=1))
    return np.where(size > 0.0, size, np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Minus the logarithm of the restricted likelihood over the logarithms of the sizes, with its gradient.

    ``S`` and ``y`` are the products of the columns with each other and with the residuals, outside of what parameters
    can follow; ``member`` says which columns belong to which group, and those of no group have size one. ``rest`` does
    not depend on the sizes.
    """

    S: FloatArray
    y: FloatArray
    member: FloatArray
    rest: float

    @classmethod
    def of(
        cls, shapes: ErrorShapes, residual: FloatArray, jacobian: FloatArray, errors: ResidualErrors, own: FloatArray
    ) -> _Likelihood:
        whitening = errors.whitening_with((own / errors.scale)[: own.size // 2])
        white = whitening.whitened(np.concatenate([jacobian, shapes.smooth, shapes.known, residual[:, None]], axis=1))
        slopes, nuisance_slopes = np.split(white, [jacobian.shape[1]], axis=1)
        length = np.linalg.norm(slopes, axis=0)
        left, singular, _ = np.linalg.svd(slopes / np.where(length > 0.0, length, 1.0), full_matrices=False)
        followed = singular > _FOLLOWED * singular.max(initial=0.0)
        nuisance_slopes = nuisance_slopes - left[:, followed] @ (left[:, followed].T @ nuisance_slopes)
        columns, rho = nuisance_slopes[:, :-1], nuisance_slopes[:, -1]
        rest = whitening.log_determinant + np.log(singular[followed]).sum() + np.log(length[length > 0.0]).sum()
        member = _members(shapes.group, len(shapes.names), columns.shape[1])
        return cls(columns.T @ columns, columns.T @ rho, member, float(rest) + 0.5 * float(rho @ rho))

    def _sizes(self, logs: FloatArray) -> FloatArray:
        return np.asarray(np.exp(logs @ self.member))

    def __call__(self, logs: FloatArray) -> tuple[float, FloatArray]:
        from scipy.linalg.lapack import dpotri

        value, root, x = self._solved(logs)
        inverse = dpotri(root, lower=1, overwrite_c=1)[0]
        return value, self.member @ (1.0 - np.diag(inverse) - x**2)

    def _solved(self, logs: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        from scipy.linalg.lapack import dpotrf, dpotrs

        D = self._sizes(logs)
        total = D[:, None] * self.S * D
        total.flat[:: D.size + 1] += 1.0
        # A search comes here hundreds of times: one triangle gives determinant, solution and diagonal of the inverse.
        # It is symmetric, so that its transpose has the order of LAPACK and needs no copy.
        root, failed = dpotrf(total.T, lower=1, overwrite_a=1)
        if failed:
            raise np.linalg.LinAlgError("model errors of no finite size")
        x = dpotrs(root, D * self.y, lower=1)[0]
        value = self.rest + float(np.log(np.diag(root)).sum()) - 0.5 * float((D * self.y) @ x)
        return value, root, x

    def best(self, start: FloatArray, tops: FloatArray) -> FloatArray:
        """The most likely logarithms of the sizes up to some, from a start near them."""
        from scipy.optimize import minimize

        box = [(_BOX[0], top) for top in tops.tolist()]
        found = minimize(self, start, jac=True, method="L-BFGS-B", bounds=box)
        return np.clip(found.x, _BOX[0], tops)

    def along(self, logs: FloatArray, own: BoolArray, grid: FloatArray) -> tuple[float, FloatArray]:
        r"""It over the size of one group, given the sizes of all others: a constant, and what each size takes off.

        With the other columns marginalized, :math:`S_{kk \mid o} = V \Lambda V^T` and :math:`v = V^T y_{k \mid o}`, a
        size takes off :math:`\frac12 \sum a^2 v_i^2 / (1 + a^2 \lambda_i) - \frac12 \sum \ln(1 + a^2 \lambda_i)`.

        Parameters
        ----------
        logs
            Logarithms of the sizes; that of the group does not count.
        own
            Columns of the group.
        grid
            Logarithms of its sizes.
        """
        size = self._sizes(logs)[~own]
        inner = np.eye(size.size) + size[:, None] * self.S[np.ix_(~own, ~own)] * size
        cross, y = size[:, None] * self.S[np.ix_(~own, own)], size * self.y[~own]
        explained = np.linalg.solve(inner, np.column_stack([cross, y]))
        roots, vectors = np.linalg.eigh(self.S[np.ix_(own, own)] - cross.T @ explained[:, :-1])
        squares = (vectors.T @ (self.y[own] - cross.T @ explained[:, -1])) ** 2
        power = np.exp(2.0 * grid)[:, None]
        inside = 1.0 + power * np.maximum(roots, 0.0)
        rest = self.rest + 0.5 * float(np.linalg.slogdet(inner)[1]) - 0.5 * float(y @ explained[:, -1])
        return rest, 0.5 * np.sum(power * squares / inside - np.log(inside), axis=1)

    def mean_sizes(self, logs: FloatArray, tops: FloatArray) -> list[float]:
        """Root mean square of each size over its posterior, given the most likely sizes of all others."""
        found = []
        for own, top in zip(self.member > 0.0, tops.tolist(), strict=True):
            grid = np.linspace(_BOX[0], top, _FINE)
            chance = self.along(logs, own, grid)[1] + grid
            chance -= np.log1p(np.exp(2.0 * (grid - math.log(USUAL_MODEL_ERROR))))
            weight = np.exp(chance - chance.max())
            found.append(float(np.sqrt(weight @ np.exp(2.0 * grid) / weight.sum())))
        return found

    def with_shares(self, shares: FloatArray) -> _Likelihood:
        """The same, where each column has a share of its size, shape ``(k,)``."""
        return replace(self, S=shares[:, None] * self.S * shares, y=shares * self.y)

    def expected(self, logs: FloatArray) -> FloatArray:
        """Most likely factors of all columns."""
        D = self._sizes(logs)
        return np.asarray(D * np.linalg.solve(np.eye(D.size) + D[:, None] * self.S * D, D * self.y))

    def shares(self, logs: FloatArray) -> FloatArray:
        """Share of the prior size of each column left in the residuals: root mean square, at most one."""
        D = self._sizes(logs)
        left = np.linalg.inv(np.eye(D.size) + D[:, None] * self.S * D)
        return np.asarray(np.sqrt(np.minimum((left @ (D * self.y)) ** 2 + np.diag(left), 1.0)))


def _members(group: IntArray, groups: int, columns: int) -> FloatArray:
    member = np.zeros((groups, columns))
    member[group, np.arange(group.size)] = 1.0
    return member


_OVERSTATED = 0.2
"""What correlations of random errors overstate: of those that are stated between neighbors and between inputs, flights
of the rig in gusts show 75 to 90 %. Differences of such errors would seem to be known far too well."""


class Evidence(NamedTuple):
    """How much residuals say of the model error of one response.

    Parameters
    ----------
    found
        By how much the most likely size makes the residuals more likely than the least one, as a logarithm. Chance
        makes it 2 in one of fifty fits of an exact structure.
    expected
        What it would be in the mean if the model error were as large as asked.
    """

    found: float
    expected: float


def as_normal(residual: FloatArray, errors: ResidualErrors, freedom: FloatArray) -> FloatArray:
    r"""Residuals of normal errors of known size that are as improbable as those that came, shape ``(2 n,)``.

    Relative to the model, an error :math:`e` of a response is circular, and its logarithm is not: where the data are
    small by chance it runs away. A size that is known with :math:`\nu` degrees of freedom makes :math:`q = |e|^2 /
    \sigma^2` Student's, which is as improbable as the normal :math:`\nu \ln(1 + q / \nu)`.

    Parameters
    ----------
    residual
        Logarithms of model over data, magnitudes and then phases, in the units of the errors, shape ``(2 n,)``.
    freedom
        Shape ``(n,)``; infinite where the size is known.

    Examples
    --------
    Five deviations of an error whose size three windows show are three of a known one:

    >>> errors = ResidualErrors(relative=2e-6 * np.eye(1), scale=np.ones(2))
    >>> (as_normal(np.array([0.005, 0.0]), errors, np.array([4.0])) * 1e3).round(1).tolist()
    [2.8, 0.0]
    """
    magnitude, phase = np.split(_over(residual, errors.scale), 2)
    error = 1.0 - np.exp(-(magnitude + 1j * phase))
    plain = errors.scale * np.concatenate([error.real, error.imag])
    ratio = np.sum(_over(plain**2, errors.variance).reshape(2, -1), axis=0)
    known = np.isinf(freedom) | (ratio == 0.0)
    nu, q = np.where(known, 1.0, freedom), np.where(known, 1.0, ratio)
    return np.asarray(plain * np.tile(np.where(known, 1.0, np.sqrt(nu * np.log1p(q / nu) / q)), 2))


def _over(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """The ratio, and zero where phases do not count."""
    return np.asarray(np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0.0))


def model_error_evidence(
    found: ModelError,
    residual: FloatArray,
    jacobian: FloatArray,
    errors: ResidualErrors,
    names: Iterable[str],
    *,
    asked: float,
) -> dict[str, Evidence]:
    r"""What residuals say of model errors: whether one is there, and whether they would show it.

    The logarithm of the restricted likelihood with the most likely size, less that with 0.5 %; and its mean, were the
    size :math:`a`, with the eigenvalues :math:`\mu_i` of what the columns of the response are in units of all
    other errors: :math:`\frac12 \sum_i [\lambda_i - \ln(1 + \lambda_i)]`, :math:`\lambda_i = a^2 \mu_i`.

    Parameters
    ----------
    found, residual, jacobian, errors
        Result and arguments of :func:`model_error`; residuals may be those of :func:`as_normal`.
    names
        Responses of interest; one that shares the size of another is left out.
    asked
        The size that the residuals ought to show, relative.
    """
    found, likelihood, logs = _most_likely(found.shapes, residual, jacobian, errors.with_own(_OVERSTATED))
    shapes = found.shapes
    said = {}
    for name in names:
        if name not in shapes.names:
            continue
        place = shapes.names.index(name)
        least = logs.copy()
        least[place] = min(math.log(SMALLEST_MODEL_ERROR), logs[place])
        gain = likelihood(least)[0] - likelihood(logs)[0]
        D, own = np.exp(least @ likelihood.member), likelihood.member[place] > 0.0
        scaled = likelihood.S * D
        shown = likelihood.S - scaled @ np.linalg.solve(np.eye(D.size) + D[:, None] * scaled, scaled.T)
        growth = np.linalg.eigvalsh(shown[np.ix_(own, own)]).clip(min=0.0) * asked**2
        said[name] = Evidence(float(gain), 0.5 * float(np.sum(growth - np.log1p(growth))))
    return said
