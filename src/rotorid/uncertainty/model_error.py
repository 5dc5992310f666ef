r"""Model error in addition to random error: the missing dynamics of a structure, as a smooth unknown over frequency.

Random errors shrink with every minute of flight, and soon the structure is what a fit is wrong by: a rotor that lags a
little differently, a drag that grows with speed, a stamp that is late by a tenth of a sample. None of this scatters
from frequency to frequency. So the residuals of a fit, magnitudes and phases with the scales :math:`s` of its cost, are
taken as

.. math:: r = J \, \delta\theta + s \, e + s B c + T d, \qquad c_k \sim N(0, a_k^2), \quad d \sim N(0, 1)

with the random error :math:`e` that the data state; a model error :math:`B c` of each response, in magnitude and in
phase a Gaussian process over :math:`\ln \omega` with the kernel :math:`\exp(-\frac12 (\Delta \ln\omega / 0.7)^2)`, one
octave; and clocks :math:`T d`, a phase of :math:`0.15 \, \omega \Delta t` for every input and every output, for no log
says where within a sample a value belongs. The size :math:`a_k` of the model error of a response is the one that makes
its residuals most likely, with what the parameters absorb projected out (restricted maximum likelihood), between 0.5 %,
which no sensor is better than, and 30 %, and at most three times its typical residual: a few points at the end of a
band, which nothing smooth explains, would ask for any size. The values stay what the fit gave. With its own gain M,
from residuals to parameters,

.. math:: \mathrm{Cov}\,\theta = M \, (C + \sum_k a_k^2 s B_k B_k^T s + T T^T) \, M^T

An accelerometer may lie beside the center of gravity by some centimeters. Where no parameter follows it, that would
leave a large trace; of this column the share counts that the residuals leave of it, its root mean square given them.

Errors that leave no trace in residuals, a wrong scale or a slope that depends on amplitude, are covered by the floor
alone. How often such intervals hold, over simulated flights of seven vehicles, stands in ``docs/accuracy.md``.

The idea of a prior on what is left out is that of stochastic embedding (Goodwin, Gevers and Ninness, *Quantifying the
Error in Estimated Transfer Functions with Application to Model Order Selection*, IEEE Transactions on Automatic Control
37(7), 1992).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.fitting.problem import ErrorShapes
from rotorid.typing import FloatArray, IntArray

SMALLEST_MODEL_ERROR, LARGEST_MODEL_ERROR = 0.005, 0.3
"""No sensor and no structure is better than the one; beyond the other nothing is described any more."""

_OWN_SHARE = 0.1
_OWN_ERRORS = (0.002, 0.005, 0.01, 0.02, 0.05)
"""Least independent error of a measured covariance: a part of its variance, and a relative error chosen by the
likelihood for each group.
"""

_FOLLOWED = 1e-9
_TYPICAL, _NORMAL = 0.75, 0.8693
"""The upper quartile of the size of residuals is typical, also where only magnitudes are off; the standard deviation of
a normal error over it."""

_LARGEST_SHARE = 3.0
_BOX = (math.log(SMALLEST_MODEL_ERROR), math.log(LARGEST_MODEL_ERROR))
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
        Relative standard deviation of the model error of each group.
    scatter
        Standard deviation of what the data do not state and no smooth error explains, from residual to residual,
        shape ``(n,)``.
    expected
        The most likely course of model error and clocks in the residuals, shape ``(n,)``.
    """

    shapes: ErrorShapes
    sizes: Mapping[str, float]
    scatter: FloatArray
    expected: FloatArray

    def __post_init__(self) -> None:
        self._set(
            sizes=self.sizes,
            scatter=read_only(self.scatter, np.float64, ndim=1),
            expected=read_only(self.expected, np.float64, ndim=1),
        )

    @property
    def root(self) -> FloatArray:
        """Columns whose outer products sum to the covariance of all this, shape ``(n, k)``."""
        return np.concatenate([self.shapes.root(self.sizes), np.diag(self.scatter)], axis=1)


def model_error(shapes: ErrorShapes, residual: FloatArray, jacobian: FloatArray, covariance: FloatArray) -> ModelError:
    r"""Sizes of model errors that make residuals most likely.

    With everything in units of the random error and outside of what the parameters can follow, columns X and residuals
    :math:`\rho` give :math:`S = X^T X`, :math:`y = X^T \rho`, and of sizes D the logarithm of the restricted likelihood
    is :math:`-\frac12 \ln\det(1 + D S D) + \frac12 (D y)^T (1 + D S D)^{-1} D y`.

    Parameters
    ----------
    shapes
        What errors may look like.
    residual, jacobian
        Of the problem at its solution, shapes ``(n,)`` and ``(n, p)``.
    covariance
        Of the random errors in the residuals, shape ``(n, n)``.

    Examples
    --------
    Residuals of 5 % that nothing but a smooth error explains:

    >>> from rotorid.fitting.frequency.error_shapes import response_error_shapes
    >>> omega = np.geomspace(1.0, 50.0, 40)
    >>> nothing = np.zeros(40, dtype=np.int64)
    >>> shapes = response_error_shapes(omega, nothing, nothing, np.ones(80), outputs=["p"], inputs=["roll"],
    ...                                sample_rate_hz=None)
    >>> residual = np.concatenate([0.05 * np.sin(3.0 * np.log(omega)), np.zeros(40)])
    >>> found = model_error(shapes, residual, np.zeros((80, 0)), 1e-6 * np.eye(80))
    >>> 0.01 < found.sizes["p/roll"] < 0.1
    True
    """
    own, start, tops = np.zeros(residual.size), np.zeros(len(shapes.names)), np.zeros(len(shapes.names))
    scale = _scale_of(shapes, np.diag(covariance))
    for place in range(len(shapes.names)):
        rows = np.flatnonzero(shapes.smooth[:, shapes.group == place].any(axis=1))
        part = _part(shapes, place, rows)
        typical = _NORMAL * float(np.quantile(np.abs(residual[rows]) / scale[rows], _TYPICAL))
        tops[place] = np.clip(math.log(max(_LARGEST_SHARE * typical, SMALLEST_MODEL_ERROR)), _BOX[0] + 1e-6, _BOX[1])
        grid = np.linspace(_BOX[0], tops[place], _COARSE)
        block = covariance[np.ix_(rows, rows)]
        tried = [
            _coarse(_Likelihood.of(part, residual[rows], jacobian[rows], block, error * scale[rows]), grid)
            for error in _OWN_ERRORS
        ]
        best = min(range(len(tried)), key=lambda which: tried[which][0])
        own[rows], start[place] = _OWN_ERRORS[best] * scale[rows], tried[best][1]
    likelihood = _Likelihood.of(shapes, residual, jacobian, covariance, own)
    logs = likelihood.best(start, tops)
    columns = np.concatenate([shapes.smooth, shapes.known], axis=1)
    return ModelError(
        shapes=shapes.with_shares(likelihood.shares(logs)[columns.shape[1] - shapes.largest :]),
        sizes=dict(zip(shapes.names, map(float, np.exp(logs)), strict=True)),
        scatter=own,
        expected=columns @ likelihood.expected(logs),
    )


def _part(shapes: ErrorShapes, place: int, rows: IntArray) -> ErrorShapes:
    """One group alone, with the clocks at its residuals."""
    columns = shapes.group == place
    return ErrorShapes(
        names=(shapes.names[place],),
        smooth=shapes.smooth[np.ix_(rows, np.flatnonzero(columns))],
        group=np.zeros(int(columns.sum()), dtype=np.int64),
        known=shapes.known[rows],
    )


def _coarse(likelihood: _Likelihood, grid: FloatArray) -> tuple[float, float]:
    """The best of some sizes of a single group, its value first."""
    return min((likelihood(np.array([size]))[0], float(size)) for size in grid)


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
        cls, shapes: ErrorShapes, residual: FloatArray, jacobian: FloatArray, covariance: FloatArray, own: FloatArray
    ) -> _Likelihood:
        from scipy.linalg import solve_triangular

        root = np.linalg.cholesky(covariance + np.diag(_OWN_SHARE * np.diag(covariance) + own**2))
        stacked = np.concatenate([jacobian, shapes.smooth, shapes.known, residual[:, None]], axis=1)
        white = solve_triangular(root, stacked, lower=True, check_finite=False)
        slopes, nuisance_slopes = np.split(white, [jacobian.shape[1]], axis=1)
        length = np.linalg.norm(slopes, axis=0)
        left, singular, _ = np.linalg.svd(slopes / np.where(length > 0.0, length, 1.0), full_matrices=False)
        followed = singular > _FOLLOWED * singular.max(initial=0.0)
        nuisance_slopes = nuisance_slopes - left[:, followed] @ (left[:, followed].T @ nuisance_slopes)
        columns, rho = nuisance_slopes[:, :-1], nuisance_slopes[:, -1]
        rest = np.log(np.diag(root)).sum() + np.log(singular[followed]).sum() + np.log(length[length > 0.0]).sum()
        member = _members(shapes.group, len(shapes.names), columns.shape[1])
        return cls(columns.T @ columns, columns.T @ rho, member, float(rest) + 0.5 * float(rho @ rho))

    def _sizes(self, logs: FloatArray) -> FloatArray:
        return np.asarray(np.exp(logs @ self.member))

    def __call__(self, logs: FloatArray) -> tuple[float, FloatArray]:
        D = self._sizes(logs)
        inner = np.eye(D.size) + D[:, None] * self.S * D
        G = np.linalg.inv(inner)
        x = G @ (D * self.y)
        value = self.rest + 0.5 * float(np.linalg.slogdet(inner)[1]) - 0.5 * float((D * self.y) @ x)
        return value, self.member @ (1.0 - np.diag(G) - x**2)

    def best(self, start: FloatArray, tops: FloatArray) -> FloatArray:
        """The most likely logarithms of the sizes up to some, from a start near them."""
        from scipy.optimize import minimize

        box = [(_BOX[0], top) for top in tops.tolist()]
        found = minimize(self, start, jac=True, method="L-BFGS-B", bounds=box)
        return np.clip(found.x, _BOX[0], tops)

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


class Evidence(NamedTuple):
    """How much residuals say of the model error of one response.

    Parameters
    ----------
    found
        By how much the size that was found makes the residuals more likely than the least one, as a logarithm. Chance
        makes it 3 in one of 140 fits of an exact structure.
    expected
        What it would be in the mean if the model error were as large as asked.
    """

    found: float
    expected: float


def model_error_evidence(
    found: ModelError,
    residual: FloatArray,
    jacobian: FloatArray,
    covariance: FloatArray,
    names: Iterable[str],
    *,
    asked: float,
) -> dict[str, Evidence]:
    r"""What residuals say of model errors: whether one is there, and whether they would show it.

    The logarithm of the restricted likelihood with the size that was found, less that with 0.5 %; and its mean, were
    the size :math:`a`, with the eigenvalues :math:`\mu_i` of what the columns of the response are in units of all
    other errors: :math:`\frac12 \sum_i [\lambda_i - \ln(1 + \lambda_i)]`, :math:`\lambda_i = a^2 \mu_i`.

    Parameters
    ----------
    found, residual, jacobian, covariance
        Result and arguments of :func:`model_error`.
    names
        Responses of interest; one that shares the size of another is left out.
    asked
        The size that the residuals ought to show, relative.
    """
    shapes = found.shapes
    likelihood = _Likelihood.of(shapes, residual, jacobian, covariance, found.scatter)
    logs = np.log([found.sizes[name] for name in shapes.names])
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
