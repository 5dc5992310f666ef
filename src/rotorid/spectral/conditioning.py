r"""The response of one window length: inputs separated, leakage and smear of the window taken out.

Several inputs that move together are conditioned on each other, with instruments or without. A window of taper
:math:`w` then sees an output :math:`y = h * u` through

.. math:: Y(\omega) = \int w(t) \, y(t) \, e^{-j\omega t} dt
          = H U + j H' U_{w'} - \tfrac12 H'' U_{w''} - \dots

where :math:`U_{w'}` is the transform of the input with the slope of the taper: what the input did before the window
still sounds in it, and the last of what it does in the window sounds after it. Taken for noise, as is the custom, the
second term makes stated errors several times too large where a vehicle remembers long; where a record ends while it is
excited, it biases the response. Both terms follow from the response itself and are taken out here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import refusal
from rotorid.errors import InsufficientDataError
from rotorid.spectral.spectra import SpectralMatrix, slope_name
from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray

_TINY = 1e-300
_LEAST_SEPARATION = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputSpectra:
    """Densities that involve one output.

    Parameters
    ----------
    cross
        :math:`S_{ay}` from every channel :math:`a` of the matrix, shape ``(f, channels)``.
    auto
        :math:`S_{yy}`, shape ``(f,)``.
    mix
        What is taken as the output: a mixture of all channels of the matrix, shape ``(f, channels)``.
    """

    cross: ComplexArray
    auto: FloatArray
    mix: ComplexArray


def output_spectra(matrix: SpectralMatrix, output: int) -> OutputSpectra:
    """The densities of one output as they stand in a matrix."""
    mix = np.zeros(matrix.values.shape[:2], dtype=np.complex128)
    mix[:, output] = 1.0
    return OutputSpectra(cross=matrix.values[:, :, output], auto=matrix.values[:, output, output].real, mix=mix)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConditionedResponse:
    r"""What instruments and inputs alone decide, shared by all outputs of one window length.

    Parameters
    ----------
    matrix
        The spectra.
    instruments, inputs
        Rows of the matrix; equal for a direct estimate.
    projection
        :math:`S_{ru}^{-1}`, shape ``(u, f, r)``.
    input_power
        :math:`\tilde G_{jj} = 1 / [S_{ru}^{-1} S_{rr} S_{ru}^{-H}]_{jj}`, shape ``(u, f)``: the part of the input's
        power that the instruments explain and the other inputs do not.
    input_noise
        :math:`[S_{uu} - S_{ur} S_{rr}^{-1} S_{ru}]_{jj}`, shape ``(u, f)``: the part that the instruments do not
        explain. Zero for a direct estimate.
    """

    matrix: SpectralMatrix
    instruments: tuple[int, ...]
    inputs: tuple[int, ...]
    projection: ComplexArray
    input_power: FloatArray
    input_noise: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditioned:
    r"""Response of one output to all inputs, from windows of one length.

    With instruments :math:`r` (the inputs themselves for a direct estimate) and :math:`y = H u + v`,

    .. math:: H^T = S_{ru}^{-1} S_{ry}

    The variance of the response to input :math:`j` is :math:`S_{vv} / (n_d \tilde G_{jj})`.

    Parameters
    ----------
    response
        Shape ``(u, f)``.
    noise
        :math:`S_{vv}`, shape ``(f,)``.
    input_residual
        :math:`S_{uv}` of each input and that noise, shape ``(u, f)``: what feedback puts into the input, zero for a
        direct estimate whatever the truth is.
    """

    response: ComplexArray
    noise: FloatArray
    input_residual: ComplexArray


def conditioned_response(
    matrix: SpectralMatrix, *, instruments: Sequence[int], inputs: Sequence[int]
) -> ConditionedResponse:
    """Show the inputs apart; ``instruments`` equals ``inputs`` for a direct estimate.

    Raises
    ------
    InsufficientDataError
        The inputs (or what the instruments see of them) are proportional to each other; the finding is
        ``correlated_inputs``.
    """
    _require_separable(matrix, instruments, inputs)
    cross, auto = matrix.block(instruments, inputs), matrix.block(instruments, instruments)
    inverse: ComplexArray = np.asarray(np.linalg.inv(cross), dtype=np.complex128)
    spread = np.einsum("fir,frs,fis->fi", inverse, auto, inverse.conj()).real
    explained = np.einsum("fri,fri->fi", cross.conj(), np.linalg.solve(auto, cross)).real
    power = np.einsum("fii->fi", matrix.block(inputs, inputs)).real
    return ConditionedResponse(
        matrix=matrix,
        instruments=tuple(instruments),
        inputs=tuple(inputs),
        projection=np.moveaxis(inverse, 1, 0),
        input_power=(1.0 / spread).T,
        input_noise=np.maximum(power - explained, 0.0).T,
    )


def condition(separated: ConditionedResponse, output: OutputSpectra) -> Conditioned:
    """The response of one output, from the densities that involve it."""
    instruments, inputs = list(separated.instruments), list(separated.inputs)
    matrix, to_output = separated.matrix, output.cross[:, instruments]
    response = np.einsum("ufr,fr->uf", separated.projection, to_output)
    predicted = np.einsum("fij,jf->fi", matrix.block(inputs, inputs), response)
    residual = output.cross[:, inputs] - predicted
    explained = np.einsum("uf,fu->f", response.conj(), output.cross[:, inputs] + residual).real
    # The difference of nearly equal numbers may come out a rounding error below zero for noise-free data.
    noise = np.maximum(output.auto - explained, output.auto * 1e-12 + _TINY)
    return Conditioned(response=response, noise=noise, input_residual=residual.T)


def instrument_coherence(separated: ConditionedResponse, output: OutputSpectra) -> FloatArray:
    r"""Coherence of each instrument and an output once the other instruments are accounted for, shape ``(u, f)``.

    With :math:`y = \sum_j a_j r_j + e` and :math:`P_j = 1 / [S_{rr}^{-1}]_{jj}`, the power of instrument j that the
    others do not have, :math:`\gamma_j^2 = |a_j|^2 P_j / (|a_j|^2 P_j + S_{ee})`. The ordinary coherence says of a
    sweep in roll that yaw does not follow it, when all it means is that the sweep in yaw moved yaw more.
    """
    instruments = list(separated.instruments)
    auto, cross = separated.matrix.block(instruments, instruments), output.cross[:, instruments]
    a = np.linalg.solve(auto, cross[:, :, None])[:, :, 0]
    unexplained = np.maximum(output.auto - np.sum(a.conj() * cross, axis=1).real, output.auto * 1e-12 + _TINY)
    own = 1.0 / np.einsum("fii->fi", np.linalg.inv(auto)).real
    explained = np.abs(a) ** 2 * own
    return np.asarray(explained / (explained + unexplained[:, None])).T


def _require_separable(matrix: SpectralMatrix, instruments: Sequence[int], inputs: Sequence[int]) -> None:
    power = np.einsum("fii->fi", matrix.values).real
    scale = np.sqrt(power[:, list(instruments)][:, :, None] * power[:, list(inputs)][:, None, :])
    cross = matrix.block(instruments, inputs)
    normalized = np.divide(cross, scale, out=np.zeros_like(cross), where=scale > 0.0)
    singular = np.linalg.svd(normalized, compute_uv=False)
    # Rounding leaves some 1e-15 of a singular value that should be zero, so the inverse would exist and mean nothing.
    lost = singular[:, -1] <= _LEAST_SEPARATION * singular[:, 0]
    if not lost.any():
        return
    names = ", ".join(matrix.channels[row] for row in inputs)
    where, count = float(matrix.omega_rad_s[lost][0]), int(lost.sum())
    raise InsufficientDataError(
        f"the inputs {names} are proportional to each other at {where:.3g} rad/s",
        needed="inputs that move independently",
        remedy="drop one of them, or fly maneuvers that excite one axis after the other",
        findings=[
            refusal(
                "correlated_inputs",
                names,
                f"{names} move together at {count} of {lost.size} frequencies and cannot be separated.",
                omega_rad_s=where,
                frequencies=count,
            )
        ],
    )


_REACH_LINES = 4.0
"""How far derivatives look to either side, in widths of a spectral line: within one of them a response is unknown
from its own noise, and noise would explain itself."""

_LEAST_NEIGHBORS = 3

_LEAST_ERROR = 1e-4
_LARGEST_ERROR = 10.0
_LEAST_SLOPE = 1e-3

_DOUBTED_ERROR = 0.15
"""A point of this relative error counts half."""

_SURE = 3.0
"""A derivative of this many standard deviations counts half."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Derivatives:
    r"""Derivatives of responses with respect to frequency.

    Parameters
    ----------
    first, second
        :math:`dH/d\omega` and :math:`d^2H/d\omega^2`, shape ``(u, f)``.
    """

    first: ComplexArray
    second: ComplexArray


def derivatives(
    omega_rad_s: FloatArray, response: ComplexArray, error: FloatArray, *, line_rad_s: float
) -> Derivatives:
    r"""Derivatives of measured responses, from a local parabola through :math:`\ln H` over :math:`\ln \omega`.

    The parabola spans four widths of a spectral line to either side, with weights that fall to zero there. Each
    derivative is shrunk by its own significance, :math:`c / (1 + (3 \sigma_c / |c|)^4)`, so that noise asks for no
    correction; points on one line count as one, and what the parabola misses counts as noise. Resonances narrower than
    a few lines are therefore left uncorrected.

    Parameters
    ----------
    omega_rad_s
        Rising, shape ``(f,)``.
    response, error
        Responses and their relative errors, shape ``(u, f)``.
    line_rad_s
        Width of a spectral line of the windows that are to be corrected, :math:`2 \pi / T`.

    Examples
    --------
    An integrator with a delay of 20 ms:

    >>> omega = np.geomspace(1.0, 10.0, 30)
    >>> response = np.exp(-0.02j * omega) / (1j * omega)
    >>> found = derivatives(omega, response[None], np.full((1, 30), 1e-3), line_rad_s=0.3)
    >>> exact = -response * (1.0 / omega + 0.02j)
    >>> bool(np.abs(found.first[0] / exact - 1.0).max() < 0.01)
    True
    """
    if omega_rad_s.size < 2 * _LEAST_NEIGHBORS + 1:
        return Derivatives(first=np.zeros_like(response), second=np.zeros_like(response))
    away = np.log(omega_rad_s) - np.log(omega_rad_s)[:, None]
    basis = np.stack([np.ones_like(away), away, away**2], axis=-1)
    # Unwrapped along the grid: between neighbors a measured phase turns by less than half a circle.
    values = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response), axis=-1)
    near = _nearness(omega_rad_s, line_rad_s)
    weight = near[None] * (np.clip(error, _LEAST_ERROR, _LARGEST_ERROR) ** -2.0)[:, None, :]
    inverse = np.linalg.inv(np.einsum("kni,ukn,knj->ukij", basis, weight, basis, optimize=True))
    fitted = np.einsum("ukij,knj,ukn,un->uki", inverse, basis, weight, values, optimize=True)
    misfit = np.abs(values[:, None, :] - np.einsum("kni,uki->ukn", basis, fitted)) ** 2
    repeated = np.maximum(line_rad_s / np.gradient(omega_rad_s), 1.0)
    excess = np.maximum(np.sum(weight * misfit, axis=-1) / np.sum(near, axis=-1), 1.0)
    spread = np.sqrt(np.einsum("ukii->uki", inverse) * (repeated * excess)[..., None])
    slope, bend = (_shrunk(fitted[..., i] * i, spread[..., i] * i) for i in (1, 2))
    # Where hardly anything is known of a response, nothing is known of what windows add to it.
    believed = response / (1.0 + (error / _DOUBTED_ERROR) ** 4)
    return Derivatives(
        first=believed * slope / omega_rad_s, second=believed * (bend - slope + slope**2) / omega_rad_s**2
    )


def _nearness(omega_rad_s: FloatArray, line_rad_s: float) -> FloatArray:
    """How much each point counts for the parabola at another one, shape ``(f, f)``: one there, zero from afar."""
    distance = np.abs(omega_rad_s - omega_rad_s[:, None])
    # Coarse grids take the nearest points whatever the lines are.
    least = np.sort(distance, axis=1)[:, 2 * _LEAST_NEIGHBORS] * 1.2
    reach = np.maximum(_REACH_LINES * line_rad_s, least)
    share = np.minimum(distance / reach[:, None], 1.0)
    return np.asarray((1.0 - share**3) ** 3)


def without_leakage(
    matrix: SpectralMatrix,
    *,
    output: int,
    inputs: Sequence[int],
    derivatives: Derivatives,
    taper: Taper,
) -> OutputSpectra:
    r"""Densities of :math:`\tilde Y = Y - j H' U_{w'} - \tfrac12 \sigma_\omega^2 H'' U`.

    :math:`\sigma_\omega^2 = \overline{w'^2} / \overline{w^2}` is the variance of the window's spectral line,
    :math:`(\pi/T)^2` for a half-sine and 4/3 of it for Hann.

    Parameters
    ----------
    matrix
        Spectra with the slopes of the inputs.
    output, inputs
        Rows of the matrix.
    derivatives
        On the grid of the matrix, shape ``(u, f)``.
    taper
        That of the windows.
    """
    variance = line_variance(taper, matrix.window_s)
    slopes = [matrix.channels.index(slope_name(matrix.channels[row])) for row in inputs]
    mix = np.zeros((matrix.omega_rad_s.size, len(matrix.channels)), dtype=np.complex128)
    mix[:, output] = 1.0
    mix[:, slopes] = -1j * derivatives.first.T
    mix[:, list(inputs)] -= 0.5 * variance * derivatives.second.T
    cross = np.einsum("fab,fb->fa", matrix.values, mix)
    return OutputSpectra(cross=cross, auto=np.einsum("fa,fa->f", mix.conj(), cross).real, mix=mix)


def line_variance(taper: Taper, window_s: float) -> float:
    """Variance in rad²/s² of the spectral line of a window.

    Examples
    --------
    >>> from rotorid.spectral.windows import HALF_SINE
    >>> round(line_variance(HALF_SINE, np.pi), 12)
    1.0
    """
    return taper.slope.mean_square / taper.mean_square / window_s**2


def _shrunk(value: ComplexArray, spread: FloatArray) -> ComplexArray:
    size = np.maximum(np.abs(value), _LEAST_SLOPE)
    return np.asarray(value / (1.0 + (_SURE * spread / size) ** 4))
