r"""Equation error of a whole structure: its equations of motion as regressions on measured states, solved together.

.. math:: M \dot x - F x - G u(t - \tau) = e, \qquad y - H_0 x - H_1 M^{-1} (F x + G u(t - \tau)) = e

Parameters that several equations share are estimated from all of them, each equation weighted by the inverse of its
own misfit; delays as fractions of a sample, with them. What enters in products is found by Gauss--Newton steps, what
enters linearly in one such step.

**Biased.** Noise in measured states pulls their derivatives toward zero, by about its share of their power in the
domain; and where a controller answers to gusts, gusts go together with states and inputs. Over a band
(:class:`rotorid.fitting.equations.regression.InBand`) only the noise inside counts and nothing is differentiated, so
that this is the domain to prefer. The values are starts for output error and prediction error, and quick answers.

The covariance counts what equations share, whatever the color of their residuals. Findings name noise in regressors and
what could not be estimated. Which states and inputs an equation needs at all, stepwise regression on records shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.equations.regression import CONSTANT, InTime, StepwiseRegression, stepwise
from rotorid.fitting.equations.rows import EquationDomain, EquationRows, Errors, simulated_parameters, stacked
from rotorid.fitting.frequency.parameter_map import ParameterMap
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.problem import Part
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.parameter import ParameterSet, no_such
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold
from rotorid.typing import BoolArray, FloatArray

_LONGEST_LAG_SHARE = 0.2


def covariance(parts: Sequence[Errors], weights: FloatArray, inverse: FloatArray, *, ordered: bool) -> FloatArray:
    r"""Covariance :math:`D \, [\sum_{ij} J_i^T E[e_i e_j^T] J_j] \, D` with :math:`D = (J^T J)^{-1}`.

    Errors of all equations at one place go together as they do. In time they also resemble their neighbors: their
    auto- and cross-correlations are tapered to zero at a fifth of the record (Morelli and Klein). Over a band their
    transforms do not, but have a spectrum: each frequency counts with the error that it shows (White).

    Parameters
    ----------
    parts
        Errors and derivatives of each record.
    weights
        Of the equations, shape ``(e,)``.
    inverse
        :math:`D`, shape ``(p, p)``.
    ordered
        Whether rows follow each other in time; otherwise they are real parts and then imaginary ones of lines.

    References
    ----------
    E. A. Morelli and V. Klein, *Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data*, Journal of
    Guidance, Control, and Dynamics 20(1), 1997. H. White, *A Heteroskedasticity-Consistent Covariance Matrix Estimator
    and a Direct Test for Heteroskedasticity*, Econometrica 48(4), 1980.
    """
    middle, rows = np.zeros_like(inverse), 0
    for part in parts:
        error, slopes = weights[:, None] * part.error, weights[:, None] * part.slopes
        middle += _in_time(error, slopes) if ordered else _in_band(error, slopes, inverse)
        rows += error.size
    return np.asarray(inverse @ middle @ inverse * rows / max(rows - len(inverse), 1))


def _in_band(error: FloatArray, slopes: FloatArray, inverse: FloatArray) -> FloatArray:
    """Outer products of the scores of each line, its errors as they would be were it left out of the fit."""
    leverage = np.einsum("pen,pq,qen->en", slopes, inverse, slopes, optimize=True)
    error = error / (1.0 - np.minimum(leverage, 0.9))
    scores = np.einsum("en,pen->np", error, slopes)
    lines = scores[: len(scores) // 2] + scores[len(scores) // 2 :]
    return np.asarray(lines.T @ lines)


def _in_time(error: FloatArray, slopes: FloatArray) -> FloatArray:
    """Derivatives smoothed by the correlation of the errors, for each pair of equations."""
    from scipy.fft import irfft, next_fast_len, rfft

    equations, n = error.shape
    lags = max(1, int(_LONGEST_LAG_SHARE * n))
    size = next_fast_len(2 * n, real=True)
    taper = np.zeros(size)
    taper[:lags] = 1.0 - np.arange(lags) / lags
    taper[size - lags + 1 :] = taper[lags - 1 : 0 : -1]
    spectrum = rfft(error, size)
    moved = rfft(slopes, size)
    middle = np.zeros((len(slopes), len(slopes)))
    for a in range(equations):
        smooth = np.zeros((len(slopes), n))
        for b in range(equations):
            correlation = irfft(spectrum[a] * spectrum[b].conj(), size) / n * taper
            smooth += irfft(rfft(correlation) * moved[:, b], size)[:, :n]
        middle += slopes[:, a] @ smooth.T
    return np.asarray(0.5 * (middle + middle.T))


_NOISE_BAND = (0.6, 0.95)
"""Of the Nyquist frequency: there a record shows its sensors and nothing of the vehicle."""

_NOTABLE_SHARE = 0.01
_LARGE_SHARE = 0.1
_SEED = 1


def left_findings(parameters: ParameterSet, left: Sequence[str], fixed_names: Sequence[str]) -> tuple[Finding, ...]:
    """Findings on parameters that were not estimated.

    Parameters
    ----------
    parameters
        With the values that were kept.
    left, fixed_names
        Free parameters that were not estimated, and those that states were simulated with.
    """
    simulated = "it shapes a state that is not measured; --method output_error estimates it"
    nowhere = "it appears in no equation whose states were all measured, or it was not searched"
    return tuple(
        warn(
            "not_in_measured_equations",
            name,
            f"{name} was not estimated and keeps its value of {parameters[name].value:.4g} "
            f"{parameters[name].unit}: {simulated if name in fixed_names else nowhere}.",
            value=parameters[name].value,
        )
        for name in left
    )


def noise_findings(
    rows: EquationRows,
    theta: FloatArray,
    weights: FloatArray,
    inverse: FloatArray,
    covariance: FloatArray,
    moving: Sequence[int],
) -> tuple[Finding, ...]:
    """States that are noisy regressors, and parameters that their noise moves by more than a standard deviation.

    Parameters
    ----------
    rows, theta, weights
        Equations, free parameters, weights of the equations.
    inverse, covariance
        :math:`(J^T J)^{-1}` and the covariance of the estimated parameters.
    moving
        Indices of those among the free ones.
    """
    found = [
        (warn if share > _LARGE_SHARE else remark)(
            "noisy_regressors",
            state,
            f"About {100.0 * share:.2g} % of the power of {state} is sensor noise, which pulls its derivatives "
            "toward zero.",
            share=share,
        )
        for state, share in noise_shares(rows).items()
        if share > _NOTABLE_SHARE
    ]
    bias = noise_bias(rows, theta, weights, inverse, moving)
    for k, pull, std in zip(moving, bias.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True):
        if abs(pull) > std:
            name = rows.map.parameters.free[k]
            found.append(
                warn(
                    "biased_by_noise",
                    name,
                    f"White sensor noise shifts {name} = {theta[k]:.4g} by about {pull:.2g}, "
                    f"{abs(pull) / std:.2g} times its standard deviation.",
                    value=theta[k],
                    bias=pull,
                    std=std,
                )
            )
    return tuple(found)


def noise_variances(rows: EquationRows) -> FloatArray:
    """Variance of white noise on each state of each record, as the highest frequencies show it, shape ``(r, x)``.

    Only for states that are measured; noise that is not white is another there than where the vehicle moves.
    """
    weights, found = rows.plan.weights, []
    for record in rows.records:
        power = np.abs(np.fft.rfft(record.outputs - record.outputs.mean(axis=1, keepdims=True))) ** 2
        share = np.arange(power.shape[1]) / (power.shape[1] - 1)
        high = (share > _NOISE_BAND[0]) & (share < _NOISE_BAND[1])
        # The median of an exponential distribution is log 2 of its mean, and single tones do not count.
        level = np.median(power[:, high], axis=1) / np.log(2.0) / record.samples
        found.append(weights**2 @ level)
    return np.array(found)


def _per_variance(rows: EquationRows, record: int) -> tuple[float, float]:
    """Mean squares in the domain of white noise with a variance of one, and of its slope."""
    history = rows.histories[record]
    noise = np.random.default_rng(_SEED).standard_normal((1, history.values.shape[1]))
    white = TimeHistory(
        values=noise, channels=(Channel(name="n", unit="1"),), sample_rate_hz=history.sample_rate_hz, start_s=0.0
    )
    level, slope = rows.domain.level(white, "n", 0.0), rows.domain.slope(white, "n")
    return float(level @ level), float(slope @ slope)


def noise_shares(rows: EquationRows) -> dict[str, float]:
    """Share of noise in the power of each measured state, in the domain of the fit."""
    variances = noise_variances(rows)
    noise, power = np.zeros(variances.shape[1]), np.zeros(variances.shape[1])
    for record in range(len(rows.records)):
        c = rows.columns(record, np.zeros(len(rows.map.structure.inputs)))
        noise += variances[record] * _per_variance(rows, record)[0]
        power += np.sum(c.levels**2, axis=1)
    return {
        rows.map.structure.states[k]: float(min(noise[k] / power[k], 1.0))
        for k in rows.plan.of("measured")
        if power[k] > 0.0
    }


def noise_bias(
    rows: EquationRows, theta: FloatArray, weights: FloatArray, inverse: FloatArray, moving: Sequence[int]
) -> FloatArray:
    r"""Shift of the estimates by white sensor noise, to first order, shape ``(p,)``.

    .. math:: \delta\theta = -(J^T J)^{-1} \, E[J_\nu^T e_\nu], \qquad e_\nu = A \dot\nu - B \nu

    Parameters
    ----------
    rows, theta, weights, inverse, moving
        As for :func:`noise_findings`.
    """
    system, slopes = rows.map.tangent(theta)
    now, moves = rows.rows(system), rows.rows(slopes)
    pull = np.zeros(len(theta))
    for record, variance in enumerate(noise_variances(rows)):
        level, slope = _per_variance(rows, record)
        both = level * moves.B * now.B + slope * moves.A * now.A
        pull += np.einsum("kex,e,x->k", both, weights**2, variance)
    return np.asarray(-inverse @ pull[list(moving)])


_ROUNDS = 8
_AT_REST = 1e-4
_LEAST_MISFIT = 1e-9
_SECTIONS = 13
_RANK_TOLERANCE = 1e-10
_LONGEST_SHARE = 0.95


class EquationScore(NamedTuple):
    """Fit of one equation.

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
    rows
        Of each equation, for each record: residuals are those of all equations of a record, then of the next.
    """

    parameters: ParameterSet
    names: tuple[str, ...]
    left: tuple[str, ...]
    covariance: FloatArray
    equations: tuple[EquationScore, ...]
    solution: Solution
    findings: tuple[Finding, ...]
    rows: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        self._set(covariance=read_only(self.covariance, np.float64, ndim=2))

    def parts(self, sample_rate_hz: float) -> list[Part]:
        """Weighted errors and derivatives of each record, rows and equations apart.

        Parameters
        ----------
        sample_rate_hz
            Of rows that follow each other in time.
        """
        equations, place, found = len(self.equations), 0, []
        for rows in self.rows:
            stop = place + equations * rows
            error = self.solution.residual[place:stop].reshape(equations, rows).T
            slopes = self.solution.jacobian[place:stop].reshape(equations, rows, -1).swapaxes(0, 1)
            found.append(Part(error, slopes, np.zeros((rows, equations, 0)), sample_rate_hz))
            place = stop
        return found

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
        :class:`rotorid.fitting.equations.regression.InBand` or :class:`rotorid.fitting.equations.regression.InTime`,
        the latter by default.
    hold
        What the inputs do between their samples.
    search_delays
        Whether delays are estimated; otherwise they stay at their start values.

    Raises
    ------
    InsufficientDataError
        No equation has all its states among what the outputs show, or parameters cannot be separated.

    Notes
    -----
    A constant in every equation of every record is estimated with the parameters: trim and shifts of sensors. Delays
    are searched up to what the domain leaves out at the start of a record.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapters 5 and 7.

    Examples
    --------
    >>> from rotorid.fitting.equations.regression import InBand
    >>> from rotorid.models.library import response_model
    >>> from rotorid.simulation.linear import simulate_linear
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
    """Searched parameters: some of the free ones, the others at their start values.

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
        lower, upper = (
            np.array([parameter.lower for parameter in free]),
            np.array([parameter.upper for parameter in free]),
        )
        late: BoolArray = np.any(slopes.input_delays_s, axis=1)
        # Half a sample of hold and a small shift for the derivative by the delay must fit into the margin.
        longest_s = _LONGEST_SHARE * rows.domain.longest_delay_s - max(
            1.0 / record.sample_rate_hz for record in rows.records
        )
        lower, upper = (
            np.where(late, np.maximum(lower, 0.0), lower),
            np.where(late, np.minimum(upper, longest_s), upper),
        )
        start = np.clip(parameters.pack(), lower, upper)
        size = np.sum([np.sum(part.slopes**2, axis=(1, 2)) for part in rows.errors(start)], axis=0)
        visible = (size > 0.0) & ~(late & (not search_delays))
        moving = tuple(np.flatnonzero(visible).tolist())
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
        """Values at which each delay fits best on a grid, one after the other, with the other parameters solved for."""
        for k in self.delays:
            tried = [self._linear(theta, k, value) for value in np.linspace(self.box[0][k], self.box[1][k], _SECTIONS)]
            theta = min(tried, key=lambda item: item[0])[1]
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
        step = np.linalg.lstsq(scaled.T @ scaled, -scaled.T @ residual, rcond=_RANK_TOLERANCE)[0]
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
    if values[0] < _RANK_TOLERANCE:
        mixed = [name for name, share in zip(names, np.abs(vectors[:, 0]), strict=True) if share > 0.1]
        raise InsufficientDataError(
            f"the equations do not separate {', '.join(mixed)}",
            needed="records in which states and inputs move independently",
            remedy="fix some with --fix NAME=VALUE, or excite the axes independently",
        )
    inverse = np.linalg.inv(scaled.T @ scaled) / np.outer(size, size)
    leverage = np.einsum("np,pq,nq->n", solution.jacobian, inverse, solution.jacobian)
    parameters = rows.map.parameters.unpack(theta)
    left = tuple(name for name in free if name not in names)
    simulated = simulated_parameters(rows.plan, rows.start[1], free)
    spread = covariance(parts, weights, inverse, ordered=rows.domain.ordered)
    findings = noise_findings(rows, theta, weights, inverse, spread, moving) + left_findings(
        parameters, left, simulated
    )
    return EquationErrorFit(
        parameters=parameters,
        names=names,
        left=left,
        covariance=spread,
        equations=_scores(search, parts, leverage),
        solution=solution,
        findings=findings,
        rows=tuple(part.error.shape[1] for part in parts),
    )


def _scores(search: _Search, parts: Sequence[Errors], leverage: FloatArray) -> tuple[EquationScore, ...]:
    """R squared and PRESS of each equation."""
    found, count = [], len(search.rows.names)
    edges = np.cumsum([part.error.size for part in parts])[:-1]
    hats = [part.reshape(count, -1) for part in np.split(np.minimum(leverage, 1.0 - 1e-12), edges)]
    for row, name in enumerate(search.rows.names):
        error = np.concatenate([part.error[row] for part in parts])
        target = np.concatenate([part.target[row] for part in parts])
        hat = np.concatenate([hat[row] for hat in hats])
        ratio = float(error @ error) / max(float(target @ target), np.finfo(np.float64).tiny)
        found.append(EquationScore(name, 1.0 - ratio, float(np.sum((error / (1.0 - hat)) ** 2)), float(np.sqrt(ratio))))
    return tuple(found)


def stepwise_equation(
    structure: LinearStructure,
    parameters: ParameterSet,
    equation: str,
    records: Sequence[TimeData],
    *,
    candidates: Sequence[str] | None = None,
    domain: EquationDomain | None = None,
    hold: Hold = "first",
    keep: Sequence[str] = (),
) -> StepwiseRegression:
    """Enter and remove states and inputs of one equation by their partial F; the model of least PRESS is the answer.

    The left side is the derivative of the state, without the terms that the structure knows: gravity, as a rule.

    Parameters
    ----------
    structure, parameters, records, domain, hold
        As for :func:`rotorid.fitting.equations.equation_error.fit_equation_error`; delays are those of ``parameters``.
    equation
        State whose equation it is, such as ``q``, or an output that sees its derivative, such as ``ax``.
    candidates
        States and inputs that may stand on the right; by default all states that the outputs show and all inputs.
    keep
        Candidates that stand there in any case.

    Raises
    ------
    UsageError
        There is no such equation with measured states, or a candidate is neither a measured state nor an input.
    InsufficientDataError
        As for :func:`rotorid.fitting.equations.regression.stepwise`.

    Notes
    -----
    Biased as any equation error: noise in a state lets others enter in its place, see
    :mod:`rotorid.fitting.equations.equation_error`.

    Examples
    --------
    >>> from rotorid.models.library import response_model
    >>> from rotorid.simulation.linear import simulate_linear
    >>> structure = response_model("response.first_order", [("r_setpoint", "r")])
    >>> u = np.sin(np.arange(2000) ** 1.5 / 1e3)[None]
    >>> system = structure.matrices(structure.parameters.values)
    >>> y = simulate_linear(system, u, sample_rate_hz=50.0, hold="first")
    >>> record = TimeData(name="twin", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> stepwise_equation(structure, structure.parameters, "r", [record]).regression.names
    ('constant', 'r_setpoint', 'r')
    """
    rows = EquationRows(ParameterMap(structure, parameters), tuple(records), domain or InTime(), hold).checked()
    # A derivative is written as the state in the call, and with a prime among outputs.
    names = [name.removesuffix("'") for name in rows.names]
    if equation not in names:
        raise UsageError(
            f"{structure.name} has no equation {equation} with all states measured",
            needed=f"one of {', '.join(names)}",
        )
    row = names.index(equation)
    known = [structure.states[source.state] for source in rows.plan.sources]
    offered = tuple(candidates) if candidates is not None else (*known, *structure.inputs)
    for name in offered:
        if name not in known and name not in structure.inputs:
            raise no_such("measured state or input", name, (*known, *structure.inputs))
    delays_s = rows.start[0].input_delays_s
    blocks = [_block(rows, record, row, offered, delays_s) for record in range(len(records))]
    return stepwise(
        np.concatenate([matrix for matrix, _ in blocks]),
        np.concatenate([left for _, left in blocks]),
        (*offered, CONSTANT),
        keep=(CONSTANT, *keep),
        constant=False,
        ordered=rows.domain.ordered and len(records) == 1,
    )


def _block(
    rows: EquationRows, record: int, row: int, offered: Sequence[str], delays_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Candidates and a constant, shape ``(n, c)``, and the left side of one equation, ``(n,)``."""
    structure, (system, slopes) = rows.map.structure, rows.start
    now, moves = rows.rows(system), rows.rows(slopes)
    columns = rows.columns(record, delays_s)
    firm = np.where(moves.B[:, row].any(axis=0), 0.0, now.B[row])
    left = now.A[row] @ columns.slopes + now.D[row] @ columns.outputs - firm @ columns.levels
    levels = dict(zip(structure.states, columns.levels, strict=True))
    inputs = dict(zip(structure.inputs, columns.inputs, strict=True))
    constant = rows.domain.constant_term(rows.histories[record])
    chosen = [inputs[name] if name in inputs else levels[name] for name in offered]
    return np.stack([*chosen, constant], axis=1), left
