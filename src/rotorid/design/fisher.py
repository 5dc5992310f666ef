"""Fisher's information about parameters in the records of a planned flight."""

from __future__ import annotations

import numpy as np

from rotorid.design.foreseen import excited_channels, loop_rows
from rotorid.design.loop import LoopModel
from rotorid.design.planned import Planned
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import ComplexArray, FloatArray

_LEAST_NOISE = 1e-12
"""Of the noise of all outputs: one that is the integral of another errs alike."""

_LEAST_DENSITY = 1e-20
"""In units of an output squared and per Hz: no sensor is quieter, and a loop without noise has an answer too."""


def fisher_information(problem: FrequencyProblem, theta: FloatArray, loop: LoopModel, planned: Planned) -> FloatArray:
    r"""Information about the free parameters that the test inputs bring into the records, shape ``(p, p)``.

    .. math:: F_{ij} = 4 \int \mathrm{Re} \left[ \left(\frac{\partial G}{\partial \theta_i} U\right)^H S_{vv}^{-1}
        \frac{\partial G}{\partial \theta_j} U \right] df

    over the fitted band, with the transforms U of the commands without noise over whole records. What gusts and noise
    move the commands by is not counted: no instrument sees it.

    Parameters
    ----------
    problem, theta
        Structure, free parameters and points, and where to take the derivatives.
    loop, planned
        What will fly, and what.
    """
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    parameters = problem.parameters.unpack(theta)
    total = np.zeros((theta.size, theta.size))
    for record in planned.records():
        count = record.values.shape[1]
        line_hz = record.sample_rate_hz / count
        bins = 2.0 * np.pi * line_hz * np.arange(count // 2 + 1)
        inside = (bins >= omega[0]) & (bins <= omega[-1])
        flown = np.fft.rfft(record.values - record.values.mean(axis=1, keepdims=True), axis=1) / record.sample_rate_hz
        excited = excited_channels(loop, planned, bins[inside], problem.data.inputs)
        commands = np.einsum("usf,sf->uf", excited, flown[:, inside])
        _, slopes = problem.structure.response_and_jacobian(parameters.values, bins[inside], parameters.directions)
        moved = np.einsum("pyuf,uf->fyp", slopes, commands)
        noise = open_loop_noise(loop, planned, bins[inside], problem.data.inputs, problem.data.outputs)
        weighted = np.linalg.solve(noise, moved)
        total += 4.0 * line_hz * np.einsum("fyp,fyq->pq", moved.conj(), weighted).real
    return total


def open_loop_noise(
    loop: LoopModel, planned: Planned, omega_rad_s: FloatArray, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> ComplexArray:
    """Densities of the outputs beside their responses to the inputs, as they are logged, shape ``(f, y, y)``.

    The responses are those that instruments show, with the loops closed that other commands close.
    """
    chosen = loop_rows(loop, (*inputs, *outputs))
    excited = np.moveaxis(excited_channels(loop, planned, omega_rad_s, (*inputs, *outputs)), -1, 0)
    moved, seen = np.split(excited[:, :, : len(inputs)], [len(inputs)], axis=1)
    response = seen @ np.linalg.inv(moved)
    own = np.broadcast_to(np.eye(len(outputs)), (omega_rad_s.size, len(outputs), len(outputs)))
    mix = np.concatenate([-response, own], axis=2)
    logged = np.moveaxis(loop.logged_noise(omega_rad_s)[np.ix_(chosen, chosen)], -1, 0)
    noise = mix @ logged @ mix.conj().swapaxes(1, 2)
    floor = _LEAST_NOISE * np.trace(noise, axis1=1, axis2=2).real[:, None, None] + _LEAST_DENSITY
    return np.asarray(noise + floor * np.eye(len(outputs)))
