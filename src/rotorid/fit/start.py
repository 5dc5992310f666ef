"""Start values from the data, so that nobody has to type them."""

from __future__ import annotations

import itertools

import numpy as np

from rotorid.fit.frequency_cost import log_error
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import FloatArray


def start_values(problem: FrequencyProblem, *, count: int = 3) -> tuple[FloatArray, ...]:
    """The best few of the parameters' own values and a coarse grid over their start values, each shape ``(p,)``.

    The gain of the structure, where it has one, is solved for at every grid point: the weighted mean of the logarithm
    of data over model gives its magnitude, and the nearer branch of the phase its sign.
    """
    free = problem.parameters.free
    gain = problem.structure.gain if problem.structure.gain in free else None
    choices = [problem.parameters[name].starts or (problem.parameters[name].value,) for name in free]
    starts = [(float(problem.costs(problem.parameters.pack()).sum()), problem.parameters.pack())]
    for point in itertools.product(*choices):
        theta = np.array(point)
        if gain is not None:
            theta[free.index(gain)] *= _gain_factor(problem, theta)
        starts.append((float(problem.costs(theta).sum()), theta))
    starts.sort(key=lambda pair: pair[0])
    return tuple(theta for _, theta in starts[:count])


def _gain_factor(problem: FrequencyProblem, theta: FloatArray) -> float:
    """Real factor on the model that brings it nearest to the data."""
    model = problem.structure.response(problem.parameters.unpack(theta).values, problem.data.omega_rad_s)
    error = log_error(problem.data.values[problem.used], model[problem.used])
    weight = problem.weights[problem.used]
    magnitude = float(np.exp(np.sum(weight * error.real) / np.sum(weight)))
    aligned = float(np.sum(weight * np.cos(error.imag)))
    return magnitude if aligned >= 0.0 else -magnitude
