r"""Equation error of a whole structure: its equations of motion as regressions on measured states, solved together.

.. math:: M \dot x - F x - G u(t - \tau) = e, \qquad y - H_0 x - H_1 M^{-1} (F x + G u(t - \tau)) = e

Parameters that several equations share are estimated from all of them, each equation weighted by the inverse of its
own misfit; delays as fractions of a sample, with them. What enters in products is found by Gauss--Newton steps, what
enters linearly in one such step.

**Biased.** Noise in measured states pulls their derivatives toward zero, by about its share of their power in the
domain; and where a controller answers to gusts, gusts go together with states and inputs. Over a band
(:class:`rotorid.fit.time_equation_error.InBand`) only the noise inside counts and nothing is differentiated, so that
this is the domain to prefer. The values are starts for output error and prediction error, and quick answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.parameter_map import ParameterMap
from rotorid.fit.solution import Solution
from rotorid.fit.structure_equation_covariance import covariance
from rotorid.fit.structure_equation_findings import left_findings, noise_findings
from rotorid.fit.structure_equation_rows import EquationDomain, EquationRows, Errors, stacked
from rotorid.fit.structure_equation_states import held_parameters
from rotorid.fit.time_data import TimeData
from rotorid.fit.time_equation_error import InTime
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulate.hold import Hold
from rotorid.typing import BoolArray, FloatArray

_ROUNDS = 8
_AT_REST = 1e-4
_LEAST_MISFIT = 1e-9
_SECTIONS = 13
_SEEN = 1e-10
_LONGEST_SHARE = 0.95


class EquationScore(NamedTuple):
    """How well one equation holds.

    Parameters
    ----------
    name
        Its left side: ``q'`` for the derivative of a state, the name of an output otherwise.
    r_squared
        Share of the left side that is explained.
    press
        Squared error of predicting each row by all others, in units of the left side squared.
    misfit
        Root mean square of the residual over that of the left side.
    """

    name: str
    r_squared: float
    press: float
    misfit: float


@dataclass(frozen=True, kw_only=True, eq=False)
class EquationErrorFit(Immutable):
    """End of an equation-error fit.

    Parameters
    ----------
    parameters
        The identified values; those that no equation shows are as they were.
    names
        Parameters that were estimated.
    left
        Free parameters that were not, because no equation with measured states holds them.
    covariance
        Of those estimated, for residuals of any color, shape ``(p, p)``. It knows nothing of the bias.
    equations
        How well each equation holds.
    solution
        How the solver ended, at the last weights.
    findings
        What limits the trust: ``noisy_regressors`` for states, ``biased_by_noise`` and
        ``not_in_measured_equations`` for parameters.
    """

    parameters: ParameterSet
    names: tuple[str, ...]
    left: tuple[str, ...]
    covariance: FloatArray
    equations: tuple[EquationScore, ...]
    solution: Solution
    findings: tuple[Finding, ...]

    def __post_init__(self) -> None:
        self._set(covariance=read_only(self.covariance, np.float64, ndim=2))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of what was estimated."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def fit_equation_error(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: Sequence[TimeData],
    *,
    domain: EquationDomain | None = None,
    hold: Hold = "first",
    search_delays: bool = True,
) -> EquationErrorFit:
    """Fit a structure by the errors of its equations.

    Parameters
    ----------
    structure
        Its inputs and outputs name the rows of the records.
    parameters
        Which are free, and from where to start.
    records
        What was measured.
    domain
        :class:`rotorid.fit.time_equation_error.InBand` or :class:`rotorid.fit.time_equation_error.InTime`, the latter
        by default.
    hold
        What the inputs do between their samples.
    search_delays
        Whether delays are estimated; otherwise they stay at their start values.

    Raises
    ------
    InsufficientDataError
        No equation has all its states among what the outputs show, or parameters cannot be told apart.

    Notes
    -----
    A constant in every equation of every record is estimated with the parameters: trim and shifts of sensors. Delays
    are searched up to what the domain leaves out at the start of a record.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapters 5 and 7.

    Examples
    --------
    >>> from rotorid.fit.time_equation_error import InBand
    >>> from rotorid.models.response import response_model
    >>> from rotorid.simulate.linear import simulate_linear
    >>> structure = response_model("response.first_order", [("r_setpoint", "r")])
    >>> truth = structure.parameters.with_values({"K_r": 0.9, "T_r": 0.3})
    >>> u = np.sin(np.arange(2000) ** 1.5 / 1e3)[None]
    >>> system = structure.matrices(truth.values)
    >>> y = simulate_linear(system, u, sample_rate_hz=50.0, hold="first")
    >>> record = TimeData(name="twin", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> found = fit_equation_error(structure, structure.parameters, [record], domain=InBand(band_rad_s=(0.5, 6.0)))
    >>> {name: round(value, 2) for name, value in found.parameters.values.items()}
    {'K_r': 0.9, 'T_r': 0.3}
    """
    chosen = domain or InTime()
    rows = EquationRows(ParameterMap(structure, parameters), tuple(records), chosen, hold).checked()
    search = _Search.of(rows, search_delays)
    theta = search.with_delays(search.start)
    weights = search.weights(theta)
    solution = search.solve(theta, weights)
    for _ in range(_ROUNDS):
        before, weights = weights, search.weights(search.whole(solution.theta))
        if np.abs(weights / before - 1.0).max() < _AT_REST:
            break
        solution = search.solve(search.whole(solution.theta), weights)
    theta = search.whole(solution.theta)
    return _ended(search, theta, weights, solution)


@dataclass(frozen=True, eq=False)
class _Search:
    """What is searched: some of the free parameters, the others as they start.

    Parameters
    ----------
    rows
        Equations and records.
    moving
        Indices of the parameters that equations show, shape ``(p,)``.
    delays
        Which of those are delays, as indices of the free parameters.
    box
        Bounds of all free parameters.
    """

    rows: EquationRows
    moving: tuple[int, ...]
    delays: tuple[int, ...]
    box: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, rows: EquationRows, search_delays: bool) -> _Search:
        parameters, (_, slopes) = rows.map.parameters, rows.start
        free = [parameters[name] for name in parameters.free]
        lower, upper = np.array([one.lower for one in free]), np.array([one.upper for one in free])
        late: BoolArray = np.any(slopes.input_delays_s, axis=1)
        # Half a sample of a held input and a nudge to see what a delay does must fit into what is left out.
        longest_s = _LONGEST_SHARE * rows.domain.longest_delay_s - max(1.0 / one.sample_rate_hz for one in rows.records)
        lower, upper = (
            np.where(late, np.maximum(lower, 0.0), lower),
            np.where(late, np.minimum(upper, longest_s), upper),
        )
        start = np.clip(parameters.pack(), lower, upper)
        size = np.sum([np.sum(part.slopes**2, axis=(1, 2)) for part in rows.errors(start)], axis=0)
        seen = (size > 0.0) & ~(late & (not search_delays))
        moving = tuple(np.flatnonzero(seen).tolist())
        return cls(rows, moving, tuple(k for k in moving if late[k]), (lower, upper))

    @property
    def start(self) -> FloatArray:
        """All free parameters at their start."""
        return np.clip(self.rows.map.parameters.pack(), *self.box)

    def whole(self, theta: FloatArray) -> FloatArray:
        """All free parameters, of those that move."""
        whole = self.start
        whole[list(self.moving)] = theta
        return whole

    def weights(self, theta: FloatArray) -> FloatArray:
        """One over the root mean square of each equation's error, shape ``(e,)``."""
        parts = self.rows.errors(theta)
        error = np.concatenate([part.error for part in parts], axis=1)
        target = np.concatenate([part.target for part in parts], axis=1)
        size = np.sqrt(np.mean(error**2, axis=1) + _LEAST_MISFIT**2 * np.mean(target**2, axis=1))
        return np.asarray(1.0 / np.where(size > 0.0, size, 1.0))

    def solve(self, theta: FloatArray, weights: FloatArray) -> Solution:
        """Least squares from some values on."""
        moving = list(self.moving)

        def residuals(part: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = stacked(self.rows.errors(self.whole(part)), weights)
            return residual, jacobian[:, moving]

        solver = LevenbergMarquardt(iterations=100)
        return solver.minimize(residuals, theta[moving], self.box[0][moving], self.box[1][moving])

    def with_delays(self, theta: FloatArray) -> FloatArray:
        """Values at which each delay fits best on a grid, one after the other, the rest solved for."""
        for k in self.delays:
            tried = [self._linear(theta, k, value) for value in np.linspace(self.box[0][k], self.box[1][k], _SECTIONS)]
            theta = min(tried, key=lambda one: one[0])[1]
        return theta

    def _linear(self, theta: FloatArray, delay: int, value: float) -> tuple[float, FloatArray]:
        """Squares that are left with one delay, relative for each equation, and the values that leave them."""
        theta = theta.copy()
        theta[delay] = value
        others = [k for k in self.moving if k not in self.delays]
        parts = self.rows.errors(theta)
        target = sum(np.sum(part.target**2, axis=1) for part in parts)
        residual, jacobian = stacked(parts, 1.0 / np.sqrt(np.where(np.asarray(target) > 0.0, target, 1.0)))
        columns = jacobian[:, others]
        length = np.sqrt(np.sum(columns**2, axis=0))
        length = np.where(length > 0.0, length, 1.0)
        scaled = columns / length
        step = np.linalg.lstsq(scaled.T @ scaled, -scaled.T @ residual, rcond=_SEEN)[0]
        theta[others] = np.clip(theta[others] + step / length, self.box[0][others], self.box[1][others])
        left = residual + scaled @ step
        return float(left @ left), theta


def _ended(search: _Search, theta: FloatArray, weights: FloatArray, solution: Solution) -> EquationErrorFit:
    rows, free = search.rows, search.rows.map.parameters.free
    moving = list(search.moving)
    names = tuple(free[k] for k in moving)
    parts = [part._replace(slopes=part.slopes[moving]) for part in rows.errors(theta)]
    size = np.sqrt(np.sum(solution.jacobian**2, axis=0))
    scaled = solution.jacobian / np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    if values[0] < _SEEN:
        mixed = [name for name, share in zip(names, np.abs(vectors[:, 0]), strict=True) if share > 0.1]
        raise InsufficientDataError(
            f"the equations do not tell {', '.join(mixed)} apart",
            needed="records in which states and inputs move independently",
            remedy="fix some with --fix NAME=VALUE, or excite the axes independently",
        )
    inverse = np.linalg.inv(scaled.T @ scaled) / np.outer(size, size)
    leverage = np.einsum("np,pq,nq->n", solution.jacobian, inverse, solution.jacobian)
    parameters = rows.map.parameters.unpack(theta)
    left = tuple(name for name in free if name not in names)
    held = held_parameters(rows.plan, rows.start[1], free)
    spread = covariance(parts, weights, inverse, ordered=rows.domain.ordered)
    findings = noise_findings(rows, theta, weights, inverse, spread, moving) + left_findings(parameters, left, held)
    return EquationErrorFit(
        parameters=parameters,
        names=names,
        left=left,
        covariance=spread,
        equations=_scores(search, parts, leverage),
        solution=solution,
        findings=findings,
    )


def _scores(search: _Search, parts: Sequence[Errors], leverage: FloatArray) -> tuple[EquationScore, ...]:
    """R squared and PRESS of each equation."""
    found, count = [], len(search.rows.names)
    edges = np.cumsum([part.error.size for part in parts])[:-1]
    hats = [one.reshape(count, -1) for one in np.split(np.minimum(leverage, 1.0 - 1e-12), edges)]
    for row, name in enumerate(search.rows.names):
        error = np.concatenate([part.error[row] for part in parts])
        target = np.concatenate([part.target[row] for part in parts])
        hat = np.concatenate([one[row] for one in hats])
        ratio = float(error @ error) / max(float(target @ target), np.finfo(np.float64).tiny)
        found.append(EquationScore(name, 1.0 - ratio, float(np.sum((error / (1.0 - hat)) ** 2)), float(np.sqrt(ratio))))
    return tuple(found)
