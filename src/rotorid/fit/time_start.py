"""Where a fit in the time domain begins when nothing else is known: the start values of the structure."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from rotorid.fit.time_problem import TimeProblem
from rotorid.typing import FloatArray

_MOST_TRIED = 81
_KEPT = 3
_RANKED = 20_000
"""Samples by which starts are ranked; more would not rank them otherwise."""


def own_starts(problem: TimeProblem) -> list[FloatArray]:
    """Start values of the structure, the most promising first.

    Parameters that have the same start values take them together: axes side by side are alike. A gain enters linearly,
    so that its best value at every start is known.

    Parameters
    ----------
    problem
        Its parameters hold the values of all that have no others.
    """
    problem = problem.shortened(_RANKED)
    tried = [(cost, theta) for theta in _grid(problem) if np.isfinite(cost := _with_gain(problem, theta))]
    ranked = sorted(tried, key=lambda one: one[0])
    return [theta for _, theta in ranked[:_KEPT]]


def _grid(problem: TimeProblem) -> Iterator[FloatArray]:
    parameters = problem.parameters
    free = parameters.free
    groups: dict[tuple[float, ...], list[int]] = {}
    yield parameters.pack()
    for row, name in enumerate(free):
        if parameters[name].starts:
            groups.setdefault(parameters[name].starts, []).append(row)
    if not groups:
        return
    low, high = problem.box
    for number, values in enumerate(product(*groups)):
        if number == _MOST_TRIED:
            return
        theta = parameters.pack()
        for rows, value in zip(groups.values(), values, strict=True):
            theta[rows] = value
        yield np.clip(theta, low, high)


def _with_gain(problem: TimeProblem, theta: FloatArray) -> float:
    """Cost at a start, whose gain is set to its best value in place."""
    residual, slopes = problem.residuals(theta)
    gain = problem.structure.gain
    if gain not in problem.parameters.free or not np.isfinite(residual).all():
        return float(residual @ residual)
    row = problem.parameters.free.index(gain)
    column = slopes[:, row]
    size = float(column @ column)
    if size == 0.0:
        return float(residual @ residual)
    low, high = problem.box
    moved = np.clip(theta[row] - float(column @ residual) / size, low[row], high[row])
    residual = residual + column * (moved - theta[row])
    theta[row] = moved
    return float(residual @ residual)
