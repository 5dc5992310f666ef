r"""Start values from the data, so that nobody has to type them.

*The response as a fraction.* A transfer function :math:`T = B / A` is no linear function of its coefficients, but
:math:`A T_{data} - B` is. Levy's least squares on it weigh high frequencies too much, by :math:`|A|^2`; dividing by the
denominator of the step before takes that away (Sanathanan and Koerner, *Transfer function synthesis as a ratio of two
complex polynomials*, IEEE Transactions on Automatic Control, 1963). Any state space is such a fraction, with
:math:`\det(j\omega M - F)` below the line. Where its parameters stand in products, a step is one of Gauss and Newton,
not the whole way.

*Equation error.* The states are taken from the measured responses, not from the model. Where the outputs and the
equations without unknowns (:math:`\dot\theta = q`) determine the states :math:`X(\omega)`, every other state equation

.. math:: (j\omega M_i - F_i) X - G_i e^{-j\omega\tau} = 0

is linear in its own parameters, and least squares need no start (Klein and Morelli, *Aircraft System Identification*,
AIAA 2006, section 7.3). Noise on the states biases the result by a few percent, which a start value may be off by.

Its delays and lags are looked for on a grid first, because phases wrap, then between its points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rotorid.errors import RotoridError
from rotorid.fitting.frequency.parameter_map import Matrices
from rotorid.fitting.frequency.problem import FrequencyProblem, equation_errors, log_error
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

_STEPS = 8
_TRANSFER_RANK = 1e-12


def fraction_starts(problem: FrequencyProblem, thetas: FloatArray) -> tuple[FloatArray, ...]:
    """The two best parameters met on the way of Sanathanan and Koerner from each of ``thetas``.

    Parameters
    ----------
    thetas
        Where to begin, shape ``(b, p)``. Delays stay as they are; give a grid of them, no coarser than half a radian at
        the highest frequency.

    Returns
    -------
    tuple of numpy.ndarray
        Free parameters, each shape ``(p,)``, best first.
    """
    lower, upper = problem.box
    moving = ~delays(problem)
    weight = np.sqrt(problem.point_scales[0] ** 2 + problem.point_scales[1] ** 2)
    now = best = np.clip(thetas, lower, upper)
    cost = np.full(len(now), np.inf)

    def better(found: FloatArray) -> tuple[FloatArray, FloatArray]:
        lower_now = found < cost
        return np.where(lower_now[:, None], now, best), np.where(lower_now, found, cost)

    for _ in range(_STEPS):
        error, slope, found = equation_errors(problem.parameter_map, now, problem.points, problem.point_scales)
        best, cost = better(found)
        step = np.zeros_like(now)
        step[:, moving], _ = _least_squares(_parts(weight * slope[:, moving]), _parts(weight * error), _TRANSFER_RANK)
        now = np.clip(now + step, lower, upper)
    best, cost = better(problem.many_costs(now))
    order = np.argsort(cost, kind="stable")[:2]
    return tuple(best[slot] for slot in order if np.isfinite(cost[slot]))


def delays(problem: FrequencyProblem) -> BoolArray:
    """Which free parameters are part of a delay, shape ``(p,)``."""
    _, slopes = problem.parameter_map.tangent(problem.parameters.pack())
    found = slopes.input_delays_s.any(axis=-1) | slopes.output_delays_s.any(axis=-1)
    return np.asarray(found, dtype=np.bool_)


def _parts(values: ComplexArray) -> FloatArray:
    """Real and imaginary parts of ``(..., n)``, one after the other."""
    return np.concatenate([values.real, values.imag], axis=-1)


def _least_squares(columns: FloatArray, right: FloatArray, rank: float) -> tuple[FloatArray, FloatArray]:
    """Steps along ``columns`` that bring ``right`` nearest to zero, and the mean square that each leaves.

    Shapes ``(b, k, n)`` and ``(b, n)`` to ``(b, k)`` and ``(b,)``. Columns are scaled to one length, and of several
    steps the smallest counts: singular values below ``rank`` of the largest are zero. Where something is not a number
    the step is zero and its square infinite.
    """
    length = np.sqrt(np.sum(columns**2, axis=-1))
    # Values so far off that they overflow lead nowhere, and LAPACK complains about them by itself.
    known = np.isfinite(length).all(axis=-1) & np.isfinite(right).all(axis=-1)
    step, misfit = np.zeros(length.shape), np.full(len(right), np.inf)
    length = np.where(length > 0.0, length, 1.0)[known]
    stacked = np.concatenate([columns[known] / length[..., None], right[known][:, None]], axis=1)
    # A triangle holds all that least squares ask for, and has as few rows as there are parameters.
    triangle: FloatArray = np.asarray(np.linalg.qr(stacked.swapaxes(1, 2), mode="r"))
    small, target = triangle[..., :-1], triangle[..., -1:]
    left, singular, turned = np.linalg.svd(small, full_matrices=False)
    large = singular > rank * singular.max(axis=1, keepdims=True, initial=0.0)
    along = (left.swapaxes(1, 2) @ target)[..., 0]
    along = -np.where(large, along / np.where(large, singular, 1.0), 0.0)
    scaled = turned.swapaxes(1, 2) @ along[..., None]
    step[known] = scaled[..., 0] / length
    misfit[known] = np.sum((target + small @ scaled)[..., 0] ** 2, axis=1) / stacked.shape[2]
    return step, misfit


_EQUATION_RANK = 1e-9
_ERROR_FLOOR = 0.02
_EQUATION_FLOOR = 0.02
_REWEIGHTINGS = 3
_UNSEEN = 1e-10
_SMALL_SINGULAR = 1e-15


class Roles(NamedTuple):
    """State equations that are known, shape ``(x,)``, and parameters that the others give, ``(p,)``."""

    known: BoolArray
    linear: BoolArray


@dataclass(frozen=True, eq=False)
class _States:
    """States that explain the measured outputs at many parameters, and their errors.

    States, ``(b, f, x, u)``; the directions that known equations leave open, ``(b, f, x, d)``; and the covariance of
    the errors along these, ``(b, f, u, d, d)``. Of the last two there is one ``b`` where all are the same.
    """

    values: ComplexArray
    open: ComplexArray
    covariance: ComplexArray


def roles(problem: FrequencyProblem, theta: FloatArray) -> Roles | None:
    """How a problem splits at given values, or ``None`` where no equation is left to find parameters from.

    As long as outputs and known equations do not determine the states, the equation with the fewest unknowns is taken
    as known too, at the values that its parameters have: a motor lag, as a rule.
    """
    system, slopes = problem.parameter_map.tangent(theta)
    rows = (np.any(matrix, axis=-1) for matrix in (slopes.M, slopes.F, slopes.G))
    standing = np.asarray(np.logical_or.reduce(list(rows)), dtype=np.bool_)
    observed = slopes.H0.any(axis=(-1, -2)) | slopes.H1.any(axis=(-1, -2))
    observed |= slopes.output_delays_s.any(axis=-1) | slopes.input_delays_s.any(axis=-1)
    linear: BoolArray = np.asarray(np.any(standing, axis=-1) & ~observed, dtype=np.bool_)
    while linear.any():
        unknowns = np.count_nonzero(standing[linear], axis=0)
        known = np.asarray(unknowns == 0, dtype=np.bool_)
        if _determined(problem, system, known):
            return Roles(known, linear)
        row = int(np.argmin(np.where(known, linear.size + 1, unknowns)))
        linear = linear & ~standing[:, row]
    return None


def _determined(problem: FrequencyProblem, system: Matrices, known: BoolArray) -> bool:
    """Whether outputs and known equations determine all states, for every input that has data."""
    omega = problem.points.omega_rad_s
    jw = 1j * omega[omega.size // 2]
    equations = (jw * system.M - system.F)[known]
    outputs = system.H0 + jw * system.H1
    for measured in np.asarray(problem.used.any(axis=-1)).T:
        rows = np.concatenate([equations, outputs[measured]])
        length = np.sqrt(np.sum(np.abs(rows) ** 2, axis=1, keepdims=True))
        rows = rows / np.where(length > 0.0, length, 1.0)
        if measured.any() and np.linalg.matrix_rank(rows, tol=_EQUATION_RANK) < len(system.F):
            return False
    return True


def equation_error(problem: FrequencyProblem, thetas: FloatArray, role: Roles) -> tuple[FloatArray, FloatArray]:
    """Parameters that make the unknown state equations hold best, the others as they are in each of ``thetas``.

    Parameters
    ----------
    thetas
        Free parameters, shape ``(b, p)``. Those in delays, outputs and known equations stay.
    role
        As :func:`roles` gives them.

    Returns
    -------
    numpy.ndarray
        Free parameters, shape ``(b, p)``, within their bounds.
    numpy.ndarray
        Mean square of the errors of the equations over what the data explain, shape ``(b,)``; one for a perfect
        structure, infinite where the model has no value.
    """
    lower, upper = problem.box
    found, misfit = np.clip(thetas, lower, upper), np.full(len(thetas), np.inf)
    inside = np.all(found == thetas, axis=1)
    for matrix in problem.parameter_map.dense_tangents(found)[0]:
        inside &= np.isfinite(matrix).all(axis=tuple(range(1, matrix.ndim)))
    if not inside.any():
        return found, misfit
    thetas = thetas[inside]
    system, slopes = problem.parameter_map.dense_tangents(thetas)
    states = _states(problem, system, role.known)
    for reweighting in range(_REWEIGHTINGS):
        if reweighting:
            system, slopes = problem.parameter_map.dense_tangents(np.clip(thetas, lower, upper))
        error, derivative = _errors(problem, system, slopes, states, role)
        weight = 1.0 / _spread(problem, system, states, role)
        columns = (weight[:, None] * derivative).reshape(*derivative.shape[:2], -1)
        right = (weight * error).reshape(len(error), -1)
        step, misfit[inside] = _least_squares(_parts(columns), _parts(right), _EQUATION_RANK)
        thetas = thetas.copy()
        thetas[:, role.linear] += step
    found[inside] = np.clip(thetas, lower, upper)
    return found, misfit


def _alike(matrices: FloatArray) -> FloatArray:
    """One of many matrices where all are the same, so that what follows from them is worked out once."""
    return matrices[:1] if np.all(matrices == matrices[:1]) else matrices


def _states(problem: FrequencyProblem, system: Matrices, known: BoolArray) -> _States:
    """States in the space that the known equations leave open, by least squares on the measured outputs."""
    data, columns = problem.data, problem.used.any(axis=(0, 1))
    omega = problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    used, values, error = (
        np.moveaxis(array[:, :, columns], -1, 0) for array in (problem.used, data.values, data.random_error)
    )
    weight = np.abs(values) * np.hypot(error, _ERROR_FLOOR)
    weight = np.where(used, 1.0 / np.maximum(weight, np.finfo(np.float64).tiny), 0.0)
    late_in, late_out = (_alike(late)[:, None] for late in (system.input_delays_s, system.output_delays_s))
    shift_in, shift_out = np.exp(-1j * omega[:, None] * late_in), np.exp(1j * omega[:, None] * late_out)
    measured = np.where(used, values * shift_out[..., None], 0.0)
    M, F, G = (_alike(matrix[:, known])[:, None] for matrix in (system.M, system.F, system.G))
    H0, H1 = (_alike(matrix)[:, None] for matrix in (system.H0, system.H1))
    inverse_of_known, basis = _inverse_and_kernel(np.asarray(jw * M - F, dtype=np.complex128))
    particular = inverse_of_known @ (G * shift_in[:, :, None, :])
    outputs = H0 + jw * H1
    # One least-squares problem for each frequency and input: rows are outputs, columns the open directions.
    rows = weight.swapaxes(-1, -2)[..., None] * (outputs @ basis)[:, :, None]
    rest = (weight * (measured - outputs @ particular)).swapaxes(-1, -2)[..., None]
    turned = rows.conj().swapaxes(-1, -2)
    normal = turned @ rows
    scale = np.sqrt(np.einsum("...ii->...i", normal).real)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = normal / (scale[..., :, None] * scale[..., None, :]) + _UNSEEN * np.eye(normal.shape[-1])
    inverse = np.linalg.inv(scaled) / (scale[..., :, None] * scale[..., None, :])
    open_part = (inverse @ (turned @ rest))[..., 0].swapaxes(-1, -2)
    return _States(particular + basis @ open_part, basis, inverse)


def _inverse_and_kernel(matrices: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Pseudo-inverses of matrices ``(..., k, x)`` and bases of what they map to zero, ``(..., x, k)``, ``(..., x, d)``.

    Rows of the matrices, fewer than columns, are independent.
    """
    left, singular, right = np.linalg.svd(matrices)
    turned, rank = right.conj().swapaxes(-1, -2), singular.shape[-1]
    large = singular > _SMALL_SINGULAR * singular.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.where(large, 1.0 / np.where(large, singular, 1.0), 0.0)
    return (turned[..., :rank] * inverse[..., None, :]) @ left.conj().swapaxes(-1, -2), turned[..., rank:]


def _errors(
    problem: FrequencyProblem, system: Matrices, slopes: Matrices, states: _States, role: Roles
) -> tuple[ComplexArray, ComplexArray]:
    """Errors of the unknown equations, ``(b, f, i, u)``, and their derivatives, ``(b, k, f, i, u)``."""
    rows, omega = ~role.known, problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    shift = np.exp(-1j * omega[:, None] * _alike(system.input_delays_s)[:, None])[:, :, None, :]
    M, F, G = (matrix[:, rows][:, None] for matrix in (system.M, system.F, system.G))
    dM, dF, dG = (slope[:, role.linear][:, :, None, rows] for slope in (slopes.M, slopes.F, slopes.G))
    error = (jw * M - F) @ states.values - G * shift
    return error, (jw * dM - dF) @ states.values[:, None] - dG * shift[:, None]


def _spread(problem: FrequencyProblem, system: Matrices, states: _States, role: Roles) -> FloatArray:
    """Standard deviations of the errors of the unknown equations that the data explain, ``(b, f, i, u)``."""
    rows, omega = ~role.known, problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    factor = ((jw * system.M[:, None, rows] - system.F[:, None, rows]) @ states.open)[:, :, None]
    moved = factor @ states.covariance
    variance = np.sum(moved.real * factor.real + moved.imag * factor.imag, axis=-1)
    level = np.abs(jw * system.M[:, None, rows]) @ np.abs(states.values)
    spread = np.sqrt(np.maximum(variance.swapaxes(-1, -2), 0.0) + (_EQUATION_FLOOR * level) ** 2)
    # An equation without any state in it, at a frequency where nothing was measured, says nothing.
    return np.where(spread > 0.0, spread, np.inf)


LONGEST_DELAY_S = 0.3
"""Delays of multirotors are below; a grid goes further where the present values do."""

_LONGEST_GRID_S = 3.0
"""Largest delay of a vehicle, which limits the grid."""

_RADIANS_PER_STEP = 0.5
_LAGS_S = (0.01, 0.03, 0.1)
_SCAN_FREQUENCIES = 24
_SECTIONS = 7
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def delay_grid_s(problem: FrequencyProblem) -> FloatArray:
    """Delays from zero, at most half a radian apart at the highest frequency, shape ``(g,)``."""
    highest = float(problem.points.omega_rad_s.max(initial=1.0))
    present = np.abs(problem.parameters.pack()[delays(problem)]).max(initial=0.0)
    longest = min(max(LONGEST_DELAY_S, 1.5 * float(present)), _LONGEST_GRID_S)
    return np.linspace(0.0, longest, 2 + int(longest * highest / _RADIANS_PER_STEP))


def equation_error_start(problem: FrequencyProblem) -> FloatArray | None:
    """Start values by equation error with the best delays and lags; ``None`` where it cannot be used.

    All delays are first taken as one, and so are the lags of equations that the data do not show. Then each delay is
    moved alone, and delays and lags are refined by golden section. Other parameters that equation error cannot give
    stay at their values.

    Parameters
    ----------
    problem
        Structure, data, points.

    Returns
    -------
    numpy.ndarray or None
        Free parameters, shape ``(p,)``.
    """
    theta = problem.parameters.pack()
    role = roles(problem, theta)
    if role is None:
        return None
    thin = _thinned(problem)
    late, lag = np.flatnonzero(delays(problem)), _lags(problem, role)
    grid = delay_grid_s(problem) if late.size else np.zeros(1)
    lags_s = np.array(_LAGS_S if lag.size else (0.0,))
    trials = np.tile(theta, (lags_s.size, grid.size, 1))
    trials[:, :, late], trials[:, :, lag] = grid[:, None], lags_s[:, None, None]
    # Of one lag the states follow from the delays alone. Of equals the shortest delay counts, then the smallest lag.
    misfits = np.stack([_misfits(thin, row, role) for row in trials], axis=1)
    best = int(np.argmin(misfits))
    delay, which = divmod(best, lags_s.size)
    start = trials[which, delay] if np.isfinite(misfits.flat[best]) else theta
    (found,), _ = equation_error(problem, _refined(thin, start, role, late, lag)[None], role)
    return np.asarray(found)


def _lags(problem: FrequencyProblem, role: Roles) -> IntArray:
    """Time constants of a derivative, which equation error cannot estimate."""
    _, slopes = problem.parameter_map.tangent(problem.parameters.pack())
    seconds = np.array([problem.parameters[name].unit == "s" for name in problem.parameters.free], dtype=np.bool_)
    chosen: BoolArray = seconds & slopes.M.any(axis=(-1, -2)) & ~role.linear
    return np.flatnonzero(chosen)


def _thinned(problem: FrequencyProblem) -> FrequencyProblem:
    """The problem at some of its frequencies, with the same share of each response."""
    columns = np.flatnonzero(problem.used.any(axis=(0, 1)))
    every = 1 + (columns.size - 1) // _SCAN_FREQUENCIES
    kept = np.zeros(problem.used.shape[-1], dtype=np.bool_)
    kept[columns[:: max(every, 1)]] = True
    return replace(problem, used=problem.used & kept)


def _misfits(problem: FrequencyProblem, thetas: FloatArray, role: Roles) -> FloatArray:
    """Mean squares of the errors of equations, shape ``(b,)``; infinite where there is no number."""
    try:
        return equation_error(problem, thetas, role)[1]
    except np.linalg.LinAlgError:
        # One of them has no solution; it is not worth the others.
        alone = len(thetas) == 1
        return np.full(1, np.inf) if alone else np.concatenate([_misfits(problem, row[None], role) for row in thetas])


def _refined(problem: FrequencyProblem, theta: FloatArray, role: Roles, late: IntArray, lag: IntArray) -> FloatArray:
    """Each delay alone on the whole grid, then delays and lags between its points."""
    grid = delay_grid_s(problem)
    lower, upper = problem.box

    def along(slot: int, value: float) -> FloatArray:
        moved = theta.copy()
        moved[slot] = np.clip(value, lower[slot], upper[slot])
        return moved

    def misfit(slot: int, value: float) -> float:
        return float(_misfits(problem, along(slot, value)[None], role)[0])

    for slot in late if late.size > 1 else ():
        trials = np.stack([along(slot, value) for value in grid])
        theta = trials[int(np.argmin(_misfits(problem, trials, role)))]
    for slot in (*late, *lag, *late):
        reach = theta[slot] if slot in lag else grid[1]
        low, high = max(theta[slot] - reach, lower[slot]), min(theta[slot] + reach, upper[slot])
        theta = along(slot, _golden_section(partial(misfit, slot), low, high))
    return theta


def _golden_section(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one valley between two places is smallest, to some 5 % of their distance."""
    inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_inner, at_outer = function(inner), function(outer)
    for _ in range(_SECTIONS):
        if at_inner <= at_outer:
            high, outer, at_outer = outer, inner, at_inner
            inner = high - _GOLDEN * (high - low)
            at_inner = function(inner)
        else:
            low, inner, at_inner = inner, outer, at_outer
            outer = low + _GOLDEN * (high - low)
            at_outer = function(outer)
    return 0.5 * (low + high)


_LARGEST_GRID = 256
_SCATTERED = 8
_SCATTER = 0.5
_ALIKE = 0.05
_CREDIBLE, _CLOSE = 1.0, 0.5


def start_values(
    problem: FrequencyProblem, *, count: int = 3, rng: np.random.Generator | None = None
) -> tuple[FloatArray, ...]:
    """The best few of what several ways to a start give, each shape ``(p,)``.

    These are the parameters' own values and a coarse grid over their ``starts``; equation error on the measured
    responses (:mod:`rotorid.fitting.frequency.starts`); least squares on the response as a fraction
    (:mod:`rotorid.fitting.frequency.starts`) over a grid of delays, where none of these is close; and a few scattered
    about the best.
    The gain of the structure, where it has one, is solved for in each: the weighted mean of the logarithm of data over
    model gives its magnitude, and the nearer branch of the phase its sign. Ways that a structure does not allow are
    passed over.

    Parameters
    ----------
    problem
        Structure, data, points.
    count
        How many to give back, no two of them within 5 % of each other.
    rng
        For the scattered ones, and for a grid that is too large to be tried as a whole; by default from a fixed seed.

    Returns
    -------
    tuple of numpy.ndarray
        Free parameters, each shape ``(p,)``, best first.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    thetas = [problem.parameters.pack(), *_grid(problem, rng)]
    with suppress(RotoridError, np.linalg.LinAlgError):
        equations = equation_error_start(problem)
        thetas += [equations] if equations is not None else []
    found = _ranked(problem, thetas)
    if found[0][0] > _CLOSE**2 * _unit_cost(problem):
        with suppress(RotoridError, np.linalg.LinAlgError):
            thetas += fraction_starts(problem, _over_delays(problem, found[0][1]))
            found = _ranked(problem, thetas)
    found = _ranked(problem, [*(theta for _, theta in found), *_scattered(problem, found[0][1], rng)])
    return _distinct([theta for _, theta in found], count)


def own_starts(
    problem: FrequencyProblem, *, count: int = 2, rng: np.random.Generator | None = None
) -> tuple[FloatArray, ...]:
    """The best few of the parameters' own values and a coarse grid over their ``starts``, where they mean anything.

    They know what the author of a structure knew and data do not show: of a fast and a slow pole in a row, which is the
    motor. Those are left out that are off by more than a factor of e or a radian, in the rms over all points: a search
    from there could end anywhere.

    Parameters
    ----------
    count, rng
        As for :func:`start_values`.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    limit = _CREDIBLE**2 * _unit_cost(problem)
    ranked = _ranked(problem, [problem.parameters.pack(), *_grid(problem, rng)])
    return _distinct([theta for cost, theta in ranked if cost <= limit], count)


def _unit_cost(problem: FrequencyProblem) -> float:
    """Cost of a model that is off by a factor of e and a radian everywhere."""
    magnitude, phase = problem.point_scales
    return float(np.sum(magnitude**2 + phase**2))


def _grid(problem: FrequencyProblem, rng: np.random.Generator) -> list[FloatArray]:
    """All combinations of the parameters' start values, or some of them where they are too many."""
    parameters = [problem.parameters[name] for name in problem.parameters.free]
    choices = [parameter.starts or (parameter.value,) for parameter in parameters]
    if math.prod(map(len, choices)) <= _LARGEST_GRID:
        return [np.array(point) for point in itertools.product(*choices)]
    return [np.array([rng.choice(choice) for choice in choices]) for _ in range(_LARGEST_GRID)]


def _over_delays(problem: FrequencyProblem, theta: FloatArray) -> FloatArray:
    """Parameters with every common delay of the grid, and with their own, shape ``(g, p)``."""
    late = delays(problem)
    if not late.any():
        return theta[None]
    grid = delay_grid_s(problem)
    thetas = np.repeat(theta[None], grid.size + 1, axis=0)
    thetas[1:, late] = grid[:, None]
    return thetas


def _scattered(problem: FrequencyProblem, theta: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Parameters within half a decade or so of a place."""
    factors = 10.0 ** (_SCATTER * rng.standard_normal((_SCATTERED, theta.size)))
    lower, upper = problem.box
    return list(np.clip(theta * factors, lower, upper))


def _ranked(problem: FrequencyProblem, thetas: Iterable[FloatArray]) -> list[tuple[float, FloatArray]]:
    """Start values with their gain solved and their cost, best first."""
    lower, upper = problem.box
    solved = np.clip([_with_gain(problem, theta) for theta in thetas], lower, upper)
    pairs = zip(problem.many_costs(solved).tolist(), solved, strict=True)
    return sorted(pairs, key=lambda pair: pair[0])


def _with_gain(problem: FrequencyProblem, theta: FloatArray) -> FloatArray:
    """The same with its gain solved, where the structure has a free one and a response to scale."""
    free, gain = problem.parameters.free, problem.structure.gain
    if gain is None or gain not in free:
        return theta
    solved = theta.copy()
    # A gain of zero has no factor that brings it anywhere.
    solved[free.index(gain)] = solved[free.index(gain)] or 1.0
    try:
        factor = _gain_factor(problem, solved)
    except (RotoridError, np.linalg.LinAlgError):
        return theta
    solved[free.index(gain)] *= factor
    return solved


def _gain_factor(problem: FrequencyProblem, theta: FloatArray) -> float:
    """Real factor on the model that brings it nearest to the data."""
    model = problem.structure.response(problem.parameters.unpack(theta).values, problem.data.omega_rad_s)
    error = log_error(model[problem.used], problem.data.values[problem.used])
    weight = problem.weights[problem.used]
    magnitude = float(np.exp(-np.sum(weight * error.real) / np.sum(weight)))
    aligned = float(np.sum(weight * np.cos(error.imag)))
    return magnitude if aligned >= 0.0 else -magnitude


def _distinct(thetas: list[FloatArray], count: int) -> tuple[FloatArray, ...]:
    """The first few that differ from one another."""
    kept: list[FloatArray] = []
    for theta in thetas:
        size = [_ALIKE * (np.abs(theta) + np.abs(other)) / 2.0 for other in kept]
        if all(np.any(np.abs(theta - other) > limit) for other, limit in zip(kept, size, strict=True)):
            kept.append(theta)
        if len(kept) == count:
            break
    return tuple(kept)
