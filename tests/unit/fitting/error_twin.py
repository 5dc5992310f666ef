"""Responses whose errors are drawn from exactly the covariance that they state."""

from __future__ import annotations

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.models.toml import from_toml
from rotorid.typing import BoolArray, ComplexArray, FloatArray

OMEGA = np.geomspace(0.5, 20.0, 16)
LEVEL = 0.02
"""Relative error of every point."""

# A rate and its angle: what disturbs one disturbs the other, with a phase between them.
STRUCTURE = from_toml(
    """
name = "rate_and_angle"
inputs = ["a", "b"]
states = ["p", "phi"]
equations = ["p' = d*p - k*phi + g*a + h*b", "phi' = p"]
outputs = ["p", "phi"]
[delays]
a = "t"
[parameters.d]
value = -2.0
unit = "1/s"
[parameters.k]
value = 3.0
unit = "1/s^2"
[parameters.g]
value = 5.0
unit = "rad/s^2"
[parameters.h]
value = -3.0
unit = "rad/s^2"
[parameters.t]
value = 0.02
unit = "s"
"""
)
TRUTH = STRUCTURE.parameters.pack()
EXACT = STRUCTURE.response(STRUCTURE.parameters.values, OMEGA)
BETWEEN_OUTPUTS = 0.95
BETWEEN_INPUTS = 0.6


def neighbors() -> ComplexArray:
    """Correlation of errors between frequencies, ``(f, f)``: half of it left four points on, with a phase."""
    steps = np.arange(OMEGA.size)
    distance = steps[:, None] - steps
    return np.asarray(0.5 ** (np.abs(distance) / 4.0) * np.exp(0.2j * distance))


def between_inputs() -> ComplexArray:
    """Correlation between inputs and frequencies, ``(u, u, f, f)``: one instrument moves both."""
    mixed = np.array([[1.0, BETWEEN_INPUTS * np.exp(0.5j)], [BETWEEN_INPUTS * np.exp(-0.5j), 1.0]])
    return np.asarray(mixed[:, :, None, None] * neighbors())


def between_outputs(size: float = BETWEEN_OUTPUTS) -> ComplexArray:
    """Correlation between outputs, ``(u, y, y, f)``: the rate leads the angle by 90 degrees."""
    at_each = np.array([[1.0, 1j * size], [-1j * size, 1.0]])
    return np.asarray(np.broadcast_to(at_each[None, :, :, None], (2, 2, 2, OMEGA.size)))


def measured(values: ComplexArray, *, joined: bool = True, size: float = BETWEEN_OUTPUTS) -> FrequencyResponse:
    """Responses that state their errors; without correlations of outputs and inputs where nothing is ``joined``."""
    spread = np.sqrt(2.0) * LEVEL * np.abs(EXACT)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values,
        coherence=np.full(values.shape, 0.95),
        random_error=np.full(values.shape, LEVEL),
        covariance=neighbors() * spread[..., :, None] * spread[..., None, :],
        inputs=STRUCTURE.inputs,
        outputs=STRUCTURE.outputs,
        estimate="direct",
        output_correlation=between_outputs(size) if joined else None,
        input_correlation=between_inputs() if joined else None,
    )


def posed(data: FrequencyResponse, used: BoolArray | None = None) -> FrequencyProblem:
    """The problem of finding the truth in them."""
    chosen = np.ones(data.values.shape, dtype=np.bool_) if used is None else used
    return FrequencyProblem(structure=STRUCTURE, parameters=STRUCTURE.parameters, data=data, used=chosen)


def stated_covariance(data: FrequencyResponse) -> ComplexArray:
    """Covariance of all points as the response defines it, written out: ``(n, n)`` in the order y, u, f."""
    outputs, inputs, count = data.values.shape
    spread = np.sqrt(np.einsum("yuff->yuf", data.covariance).real)
    total = np.zeros((outputs, inputs, count, outputs, inputs, count), dtype=np.complex128)
    for a, u, b, v in np.ndindex(outputs, inputs, outputs, inputs):
        if data.input_correlation is None or data.output_correlation is None:
            block = data.covariance[a, u] if (a, u) == (b, v) else np.zeros((count, count))
        else:
            # One correlation of outputs holds at all frequencies and inputs of this twin.
            block = data.input_correlation[u, v] * data.output_correlation[u, a, b, 0]
            block = block * spread[a, u][:, None] * spread[b, v]
        total[a, u, :, b, v, :] = block
    size = outputs * inputs * count
    return total.reshape(size, size)


def draws(data: FrequencyResponse, count: int, seed: int) -> ComplexArray:
    """Responses with errors of the stated covariance, shape ``(count, y, u, f)``."""
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(stated_covariance(data))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    white: FloatArray = rng.standard_normal((2, root.shape[1], count))
    errors = root @ (white[0] + 1j * white[1]) / np.sqrt(2.0)
    return np.asarray(EXACT + errors.T.reshape(count, *EXACT.shape))
