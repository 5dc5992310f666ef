"""Delays and lags for the equation error: on a grid first, because phases wrap, then between its points."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.errors import ModelError
from rotorid.fit.equation_error import Roles, equation_error, roles
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.transfer_start import delays
from rotorid.typing import BoolArray, FloatArray, IntArray

LONGEST_DELAY_S = 0.3
"""Delays of multirotors are below; a grid goes further where the present values do."""

_LONGEST_GRID_S = 3.0
"""What is later than this is no delay of a vehicle, and its grid would have no end."""

_RADIANS_PER_STEP = 0.5
_LAGS_S = (0.01, 0.03, 0.1)
_SCAN_FREQUENCIES = 24
_SECTIONS = 7
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def delay_grid_s(problem: FrequencyProblem) -> FloatArray:
    """Delays from zero up, at most half a radian apart at the highest frequency, shape ``(g,)``."""
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
    best, least = theta, np.inf
    for delay_s, lag_s in itertools.product(grid, _LAGS_S if lag.size else (0.0,)):
        trial = theta.copy()
        trial[late], trial[lag] = delay_s, lag_s
        misfit = _misfit(thin, trial, role)
        if misfit < least:
            best, least = trial, misfit
    return equation_error(problem, _refined(thin, best, role, late, lag), role)[0]


def _lags(problem: FrequencyProblem, role: Roles) -> IntArray:
    """Times that stand before a derivative and that equation error cannot give."""
    _, slopes = problem.parameter_map.tangent(problem.parameters.pack())
    seconds = np.array([problem.parameters[name].unit == "s" for name in problem.parameters.free], dtype=np.bool_)
    chosen: BoolArray = seconds & slopes.M.any(axis=(-1, -2)) & ~role.linear
    return np.flatnonzero(chosen)


def _thinned(problem: FrequencyProblem) -> FrequencyProblem:
    """The problem at some of its frequencies, of which each response keeps its share."""
    columns = np.flatnonzero(problem.used.any(axis=(0, 1)))
    every = 1 + (columns.size - 1) // _SCAN_FREQUENCIES
    kept = np.zeros(problem.used.shape[-1], dtype=np.bool_)
    kept[columns[:: max(every, 1)]] = True
    return replace(problem, used=problem.used & kept)


def _misfit(problem: FrequencyProblem, theta: FloatArray, role: Roles) -> float:
    try:
        return equation_error(problem, theta, role)[1]
    except (ModelError, np.linalg.LinAlgError):
        return np.inf


def _refined(problem: FrequencyProblem, theta: FloatArray, role: Roles, late: IntArray, lag: IntArray) -> FloatArray:
    """Each delay alone on the whole grid, then delays and lags between its points."""
    grid = delay_grid_s(problem)
    lower, upper = problem.box

    def along(slot: int, value: float) -> FloatArray:
        moved = theta.copy()
        moved[slot] = np.clip(value, lower[slot], upper[slot])
        return moved

    def misfit(slot: int, value: float) -> float:
        return _misfit(problem, along(slot, value), role)

    for slot in late if late.size > 1 else ():
        theta = along(slot, min(grid.tolist(), key=partial(misfit, slot)))
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
