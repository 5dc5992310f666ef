r"""Parameters by equation error: the states are taken from the measured responses, not from the model.

Where the outputs and the equations without unknowns (:math:`\dot\theta = q`) determine the states :math:`X(\omega)`,
every other state equation

.. math:: (j\omega M_i - F_i) X - G_i e^{-j\omega\tau} = 0

is linear in its own parameters, and least squares need no start (Klein and Morelli, *Aircraft System Identification*,
AIAA 2006, section 7.3). Noise on the states biases the result by a few percent, which a start value may be off by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.fit.parameter_map import Matrices
from rotorid.fit.problem import FrequencyProblem
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_RANK = 1e-9
_ERROR_FLOOR = 0.02
_EQUATION_FLOOR = 0.02
_REWEIGHTINGS = 3
_UNSEEN = 1e-10


class Roles(NamedTuple):
    """Which state equations hold as they stand, shape ``(x,)``, and which parameters the others give, ``(p,)``."""

    known: BoolArray
    linear: BoolArray


@dataclass(frozen=True, eq=False)
class _States:
    """States that explain the measured outputs, ``(f, x, u)``, and the covariance of their errors, ``(f, u, x, x)``."""

    values: ComplexArray
    covariance: ComplexArray


def roles(problem: FrequencyProblem, theta: FloatArray) -> Roles | None:
    """How a problem splits at given values, or ``None`` where no equation is left to find parameters from.

    As long as outputs and known equations do not determine the states, the equation with the fewest unknowns is taken
    as known too, at the values that its parameters have: a motor lag, as a rule.
    """
    system, slopes = problem.parameter_map.tangent(theta)
    rows = (np.any(matrix, axis=-1) for matrix in (slopes.M, slopes.F, slopes.G))
    standing = np.asarray(np.logical_or.reduce(list(rows)), dtype=np.bool_)
    seen = slopes.H0.any(axis=(-1, -2)) | slopes.H1.any(axis=(-1, -2))
    seen |= slopes.output_delays_s.any(axis=-1) | slopes.input_delays_s.any(axis=-1)
    linear: BoolArray = np.asarray(np.any(standing, axis=-1) & ~seen, dtype=np.bool_)
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
        if measured.any() and np.linalg.matrix_rank(rows, tol=_RANK) < len(system.F):
            return False
    return True


def equation_error(problem: FrequencyProblem, theta: FloatArray, role: Roles) -> tuple[FloatArray, float]:
    """Parameters that make the unknown state equations hold best, the others as they are in ``theta``.

    Parameters
    ----------
    problem
        Structure, data, points.
    theta
        Free parameters, shape ``(p,)``. Those in delays, outputs and known equations stay.
    role
        As :func:`roles` gives them.

    Returns
    -------
    numpy.ndarray
        Free parameters, shape ``(p,)``, within their bounds.
    float
        Mean square of the errors of the equations over what the data explain; one for a perfect structure.
    """
    lower, upper = problem.box
    system, slopes = problem.parameter_map.tangent(theta)
    states = _states(problem, system, role.known)
    misfit = np.inf
    for _ in range(_REWEIGHTINGS):
        error, derivative = _errors(problem, system, slopes, states, role)
        weight = 1.0 / _spread(problem, system, states, role)
        theta = theta.copy()
        step, misfit = _solve(weight * error, weight * derivative)
        theta[role.linear] += step
        system, slopes = problem.parameter_map.tangent(np.clip(theta, lower, upper))
    return np.clip(theta, lower, upper), misfit


def _states(problem: FrequencyProblem, system: Matrices, known: BoolArray) -> _States:
    """States in the space that the known equations leave open, by least squares on the measured outputs."""
    data, columns = problem.data, problem.used.any(axis=(0, 1))
    omega = problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    used = np.moveaxis(problem.used[:, :, columns], -1, 0)
    shift_in = np.exp(-1j * omega[:, None] * system.input_delays_s)
    shift_out = np.exp(1j * omega[:, None] * system.output_delays_s)[..., None]
    measured = np.where(used, np.moveaxis(data.values[:, :, columns], -1, 0) * shift_out, 0.0)
    error = np.hypot(np.moveaxis(data.random_error[:, :, columns], -1, 0), _ERROR_FLOOR)
    weight = np.where(used, 1.0 / np.maximum(np.abs(measured) * error, np.finfo(np.float64).tiny), 0.0)
    equations = (jw * system.M - system.F)[:, known]
    right = system.G[known] * shift_in[:, None, :]
    particular = np.linalg.pinv(equations) @ right
    basis = np.swapaxes(np.linalg.svd(equations)[2][:, int(known.sum()) :].conj(), -1, -2)
    outputs = system.H0 + jw * system.H1
    # One least-squares problem for each frequency and input: rows are outputs, columns the open directions.
    rows = weight.swapaxes(-1, -2)[..., None] * (outputs @ basis)[:, None]
    rest = (weight * (measured - outputs @ particular)).swapaxes(-1, -2)[..., None]
    turned = rows.conj().swapaxes(-1, -2)
    normal = turned @ rows
    scale = np.sqrt(np.einsum("fuii->fui", normal).real)
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = normal / (scale[..., :, None] * scale[..., None, :]) + _UNSEEN * np.eye(normal.shape[-1])
    inverse = np.linalg.inv(scaled) / (scale[..., :, None] * scale[..., None, :])
    open_part = (inverse @ (turned @ rest))[..., 0].swapaxes(-1, -2)
    wide = basis[:, None]
    return _States(particular + basis @ open_part, wide @ inverse @ wide.conj().swapaxes(-1, -2))


def _errors(
    problem: FrequencyProblem, system: Matrices, slopes: Matrices, states: _States, role: Roles
) -> tuple[ComplexArray, ComplexArray]:
    """Errors of the unknown equations, ``(f, i, u)``, and their derivatives, ``(k, f, i, u)``."""
    rows, omega = ~role.known, problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    shift = np.exp(-1j * omega[:, None] * system.input_delays_s)[:, None, :]
    M, F, G = (matrix[rows] for matrix in (system.M, system.F, system.G))
    dM, dF, dG = (slope[role.linear][:, None][:, :, rows] for slope in (slopes.M, slopes.F, slopes.G))
    error = (jw * M - F) @ states.values - G * shift
    return error, (jw * dM - dF) @ states.values - dG * shift


def _spread(problem: FrequencyProblem, system: Matrices, states: _States, role: Roles) -> FloatArray:
    """Standard deviations of the errors of the unknown equations that the data explain, ``(f, i, u)``."""
    rows, omega = ~role.known, problem.points.omega_rad_s
    jw = 1j * omega[:, None, None]
    factor = (jw * system.M - system.F)[:, rows]
    variance = np.einsum("fix,fuxz,fiz->fiu", factor, states.covariance, factor.conj()).real
    level = np.abs(jw * system.M[rows]) @ np.abs(states.values)
    spread = np.sqrt(np.maximum(variance, 0.0) + (_EQUATION_FLOOR * level) ** 2)
    # An equation without any state in it, at a frequency where nothing was measured, says nothing.
    return np.where(spread > 0.0, spread, np.inf)


def _solve(error: ComplexArray, derivative: ComplexArray) -> tuple[FloatArray, float]:
    """Step of the linear parameters and the mean square that is left."""
    columns = derivative.reshape(len(derivative), -1)
    right = np.concatenate([error.real.ravel(), error.imag.ravel()])
    matrix = np.concatenate([columns.real, columns.imag], axis=1).T
    length = np.sqrt(np.sum(matrix**2, axis=0))
    if not (np.isfinite(length).all() and np.isfinite(right).all()):
        # Values so far off that they overflow lead nowhere, and LAPACK complains about them by itself.
        return np.zeros(len(columns)), np.inf
    length = np.where(length > 0.0, length, 1.0)
    step = np.linalg.lstsq(matrix / length, -right, rcond=_RANK)[0] / length
    left = right + matrix @ step
    return step, float(left @ left / left.size)
