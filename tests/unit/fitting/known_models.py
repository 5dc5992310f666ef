"""Measured responses of known models, for the tests of fits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray


def measured(
    structure: LinearStructure, truth: Mapping[str, float], omega: FloatArray, *, noise: float = 0.0, seed: int = 0
) -> FrequencyResponse:
    """What a flight of the truth shows, each point with its own relative error."""
    exact = structure.response(truth, omega)
    rng = np.random.default_rng(seed)
    scatter = noise * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    return FrequencyResponse(
        omega_rad_s=omega,
        values=exact * (1.0 + scatter),
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, max(noise, 0.02)),
        covariance=np.zeros((*exact.shape, omega.size)),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )


def posed(
    structure: LinearStructure,
    truth: Mapping[str, float],
    omega: FloatArray,
    *,
    parameters: ParameterSet | None = None,
    noise: float = 0.0,
    seed: int = 0,
) -> FrequencyProblem:
    """The problem of finding the truth from these responses, all points used."""
    data = measured(structure, truth, omega, noise=noise, seed=seed)
    return FrequencyProblem(
        structure=structure,
        parameters=parameters or structure.parameters,
        data=data,
        used=np.ones(data.values.shape, dtype=np.bool_),
    )


def at_zero(parameters: ParameterSet) -> ParameterSet:
    """The same parameters with every free value at zero, or as near to it as its bounds allow."""
    return parameters.unpack(
        np.array([np.clip(0.0, parameters[name].lower, parameters[name].upper) for name in parameters.free])
    )
