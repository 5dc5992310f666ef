r"""Logarithmic errors of a model at measured points, and their slopes, for many parameter vectors in one sweep.

A parameter stands in few entries of the matrices. With :math:`A = j\omega M - F`, :math:`X = A^{-1} G` and
:math:`L = (H_0 + j\omega H_1) A^{-1}`, one entry of a matrix changes the response by an outer product, for instance
:math:`F_{ij}` by :math:`L_{yi} X_{ju}`. At the points alone, and entry by entry, this costs a few products per point
and parameter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.fit.frequency_cost import expansion_point, log_error, log_error_from
from rotorid.fit.parameter_map import Matrices, ParameterMap, Slopes
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Points:
    """Measured points: frequencies of all, shape ``(f,)``, and for each point its indices and value, shape ``(n,)``.

    ``outputs`` and ``inputs`` count all channels, also those without a point.
    """

    omega_rad_s: FloatArray
    output: IntArray
    input: IntArray
    frequency: IntArray
    values: ComplexArray
    outputs: int
    inputs: int

    @classmethod
    def of(cls, omega_rad_s: FloatArray, values: ComplexArray, used: BoolArray) -> Points:
        """The used points of measured responses, in the order of ``values[used]``."""
        columns = used.any(axis=(0, 1))
        output, source, frequency = np.nonzero(used[:, :, columns])
        return cls(omega_rad_s[columns], output, source, frequency, values[used], *used.shape[:2])

    @cached_property
    def s(self) -> ComplexArray:
        r""":math:`j\omega` of all frequencies, shape ``(f, 1, 1)``."""
        return np.asarray(1j * self.omega_rad_s[:, None, None])

    @cached_property
    def point_s(self) -> ComplexArray:
        r""":math:`j\omega` of the points, shape ``(n,)``."""
        return np.asarray(1j * self.omega_rad_s[self.frequency])

    @cached_property
    def of_output(self) -> tuple[FloatArray, ...]:
        """For each output, one at its points and zero at the others, shape ``(n,)``."""
        return _one_hot(self.output, self.outputs)

    @cached_property
    def of_input(self) -> tuple[FloatArray, ...]:
        """For each input, one at its points and zero at the others, shape ``(n,)``."""
        return _one_hot(self.input, self.inputs)


def _one_hot(channel: IntArray, count: int) -> tuple[FloatArray, ...]:
    return tuple(np.asarray(channel == one, dtype=np.float64) for one in range(count))


class _Response(NamedTuple):
    """Response at the points, shape ``(b, n)``, with what its derivatives are made of.

    The inverse of :math:`A` at all frequencies, ``(b, f, x, x)``, rows of :math:`L` and columns of :math:`X` at the
    points, ``(b, x, n)``, and the delays as a factor, ``(b, n)``.
    """

    values: ComplexArray
    inverse: ComplexArray
    left: ComplexArray
    right: ComplexArray
    shift: ComplexArray


@np.errstate(invalid="ignore")
def log_errors(parameter_map: ParameterMap, thetas: FloatArray, points: Points) -> tuple[ComplexArray, ComplexArray]:
    """Logarithm of model over data at the points, and its derivatives.

    Parameters
    ----------
    parameter_map
        From parameters to matrices.
    thetas
        Free parameters, shape ``(b, p)``.
    points
        Where, and what was measured there.

    Returns
    -------
    numpy.ndarray
        Errors, shape ``(b, n)``; not a number where the model has a pole on the imaginary axis at a point.
    numpy.ndarray
        Their derivatives, shape ``(b, p, n)``.
    """
    system, slopes = parameter_map.tangents(thetas)
    model = _response(system, points)
    place = expansion_point(model.values, points.values)
    error = log_error_from(model.values, place, points.values)
    return error, _slopes(slopes, thetas.shape[1], model, place, points)


@np.errstate(invalid="ignore")
def equation_errors(
    parameter_map: ParameterMap, thetas: FloatArray, points: Points
) -> tuple[ComplexArray, ComplexArray]:
    r"""Errors of the model multiplied by its denominator, relative to data and denominator, and their derivatives.

    With the denominator :math:`D = \det(j\omega M - F)`, :math:`e = (D / D_0) (T / T_{data} - 1)` is linear in the
    parameters of a transfer function, where the response :math:`T` is not; :math:`D_0` is the denominator at the
    present parameters, and stands still.

    Returns
    -------
    numpy.ndarray
        Errors, shape ``(b, n)``.
    numpy.ndarray
        Their derivatives, shape ``(b, p, n)``.
    """
    system, slopes = parameter_map.tangents(thetas)
    model = _response(system, points)
    error = model.values / points.values - 1.0
    responses = _slopes(slopes, thetas.shape[1], model, np.broadcast_to(points.values, error.shape), points)
    determinants = _determinant_slopes(slopes, thetas.shape[1], model.inverse, points)
    return error, responses + determinants * error[:, None]


@np.errstate(invalid="ignore")
def sums_of_squares(
    parameter_map: ParameterMap, thetas: FloatArray, points: Points, scales: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Cost of each of many parameter vectors, shape ``(b,)``; infinite where the model has no response."""
    model = _response(parameter_map.tangents(thetas)[0], points).values
    error = log_error(model, points.values)
    squares = np.sum((scales[0] * error.real) ** 2 + (scales[1] * error.imag) ** 2, axis=-1)
    return np.where(np.isfinite(squares), squares, np.inf)


def _response(system: Matrices, points: Points) -> _Response:
    jw = points.s
    inverse = _inverse(np.asarray(jw * system.M[:, None] - system.F[:, None], dtype=np.complex128))
    X = inverse @ system.G[:, None]
    H = system.H0[:, None] + jw * system.H1[:, None]
    L = H @ inverse
    rational = (H @ X)[:, points.frequency, points.output, points.input]
    delays = system.output_delays_s[:, points.output] + system.input_delays_s[:, points.input]
    shift = np.exp(-points.point_s * delays)
    return _Response(
        values=rational * shift,
        inverse=inverse,
        left=L.transpose(0, 3, 2, 1)[:, :, points.output, points.frequency],
        right=X.transpose(0, 2, 3, 1)[:, :, points.input, points.frequency],
        shift=shift,
    )


def _inverse(matrices: ComplexArray) -> ComplexArray:
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        # One of them is singular, and the call does not say which.
        flat = matrices.reshape(-1, *matrices.shape[-2:])
        regular = np.linalg.cond(flat) < 1.0 / np.finfo(np.float64).eps
        inverse = np.full_like(flat, np.nan)
        inverse[regular] = np.linalg.inv(flat[regular])
        return inverse.reshape(matrices.shape)


def _slopes(slopes: Slopes, size: int, model: _Response, place: ComplexArray, points: Points) -> ComplexArray:
    """Derivatives of the logarithm along ``size`` parameters, shape ``(b, size, n)``."""
    relative = model.shift / place
    left, right = model.left, model.right * relative[:, None]
    jw = points.point_s
    total = np.zeros((len(place), size, place.shape[1]), dtype=np.complex128)
    M, F, G, H0, H1, input_delays, output_delays = slopes
    for k, i, j, factor in F:
        total[:, k] += _times(left[:, i] * right[:, j], factor)
    for k, i, j, factor in M:
        total[:, k] -= _times(jw * left[:, i] * right[:, j], factor)
    for k, i, j, factor in G:
        total[:, k] += _times(left[:, i] * relative * points.of_input[j], factor)
    for k, i, j, factor in H0:
        total[:, k] += _times(right[:, j] * points.of_output[i], factor)
    for k, i, j, factor in H1:
        total[:, k] += _times(jw * right[:, j] * points.of_output[i], factor)
    for k, j, _, factor in input_delays:
        total[:, k] -= _times(jw * model.values / place * points.of_input[j], factor)
    for k, i, _, factor in output_delays:
        total[:, k] -= _times(jw * model.values / place * points.of_output[i], factor)
    return total


def _times(values: ComplexArray, factor: float | FloatArray) -> ComplexArray:
    # Most parameters stand alone in their entry, and a product by one is a whole sweep over the points.
    return values if isinstance(factor, float) and factor == 1.0 else values * factor


def _determinant_slopes(slopes: Slopes, size: int, inverse: ComplexArray, points: Points) -> ComplexArray:
    r"""Derivatives of :math:`\log\det A`, :math:`\mathrm{tr}(A^{-1} \dot A)`, at the points, ``(b, size, n)``."""
    jw = points.s[:, 0, 0]
    total = np.zeros((len(inverse), size, jw.size), dtype=np.complex128)
    for k, i, j, factor in slopes[0]:
        total[:, k] += factor * jw * inverse[:, :, j, i]
    for k, i, j, factor in slopes[1]:
        total[:, k] -= factor * inverse[:, :, j, i]
    return np.asarray(total[:, :, points.frequency])
