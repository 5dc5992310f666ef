"""Start values from the data, so that nobody has to type them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from contextlib import suppress

import numpy as np

from rotorid.errors import RotoridError
from rotorid.fit.equation_error_search import delay_grid_s, equation_error_start
from rotorid.fit.frequency_cost import log_error
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.transfer_start import delays, fraction_starts
from rotorid.typing import FloatArray

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
    responses (:mod:`rotorid.fit.equation_error`); least squares on the response as a fraction
    (:mod:`rotorid.fit.transfer_start`) over a grid of delays, where none of these is close; and a few scattered about
    the best.
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

    They know what the author of a structure knew and data cannot tell: of a fast and a slow pole in a row, which is the
    motor. Those are left out that are off by more than a factor of e or a radian, in the rms over all points: a search
    from there could end anywhere.

    Parameters
    ----------
    problem
        Structure, data, points.
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
    choices = [one.starts or (one.value,) for one in parameters]
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
