"""Responses that a structure cannot have, whatever its parameters are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.errors import ModelError
from rotorid.fit.pairs import pair_names
from rotorid.fit.parameter_map import generic_values
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import BoolArray

_DRAWS = 3
_ZERO = 1e-9


def without_structural_zeros(problem: FrequencyProblem) -> tuple[FrequencyProblem, tuple[str, ...]]:
    """The problem without the responses that its structure cannot produce.

    Theta to a yaw command, say, in a model without coupling: the data may show such a response, but no parameter can
    follow it, and its logarithm says nothing. The structure is tried at three sets of generic values of the free
    parameters, from a fixed seed, so that present values of zero do not count as structure; fixed, tied and dropped
    parameters keep to what they are. A response counts as zero where it is below 1e-9 of the geometric mean of the
    largest responses of its output and to its input.

    Parameters
    ----------
    problem
        With all points that the data would allow.

    Returns
    -------
    FrequencyProblem
        With fewer points, or the same problem.
    tuple of str
        Names ``output/input`` of the responses that had points and are taken out.
    """
    silent = problem.used.any(axis=-1) & _zero_everywhere(problem)
    if not silent.any():
        return problem, ()
    names = tuple(name for name, zero in zip(pair_names(problem.data), silent.ravel(), strict=True) if zero)
    return replace(problem, used=problem.used & ~silent[..., None]), names


def _zero_everywhere(problem: FrequencyProblem) -> BoolArray:
    """Responses that are zero at every set of generic values, shape ``(y, u)``; none where no set has a response."""
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    zero = np.ones(problem.used.shape[:2], dtype=np.bool_)
    rng, drawn = np.random.default_rng(0), 0
    for _ in range(_DRAWS):
        theta = generic_values(problem.parameters, rng)
        try:
            response = problem.structure.response(problem.parameters.unpack(theta).values, omega)
        except (ModelError, np.linalg.LinAlgError):
            continue
        size = np.abs(response).max(axis=-1, initial=0.0)
        # The root of each, for their product may be too large for a number.
        level = np.sqrt(size.max(axis=0, keepdims=True)) * np.sqrt(size.max(axis=1, keepdims=True))
        zero &= size <= _ZERO * level
        drawn += 1
    return zero & (drawn > 0)
