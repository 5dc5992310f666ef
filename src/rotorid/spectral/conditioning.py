"""From spectral matrices to one response of one window length: several inputs, with or without instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.spectral.spectra import SpectralMatrix
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
class Separated:
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
    instrument_coherence
        Partial coherence of each instrument and the output, shape ``(u, f)``.
    """

    response: ComplexArray
    noise: FloatArray
    input_residual: ComplexArray
    instrument_coherence: FloatArray


def separate(matrix: SpectralMatrix, *, instruments: Sequence[int], inputs: Sequence[int]) -> Separated:
    """Tell the inputs apart; ``instruments`` equals ``inputs`` for a direct estimate.

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
    return Separated(
        matrix=matrix,
        instruments=tuple(instruments),
        inputs=tuple(inputs),
        projection=np.moveaxis(inverse, 1, 0),
        input_power=(1.0 / spread).T,
        input_noise=np.maximum(power - explained, 0.0).T,
    )


def condition(separated: Separated, output: OutputSpectra) -> Conditioned:
    """The response of one output, from the densities that involve it."""
    instruments, inputs = list(separated.instruments), list(separated.inputs)
    matrix, to_output = separated.matrix, output.cross[:, instruments]
    response = np.einsum("ufr,fr->uf", separated.projection, to_output)
    predicted = np.einsum("fij,jf->fi", matrix.block(inputs, inputs), response)
    residual = output.cross[:, inputs] - predicted
    explained = np.einsum("uf,fu->f", response.conj(), output.cross[:, inputs] + residual).real
    # The difference of nearly equal numbers may come out a rounding error below zero for noise-free data.
    noise = np.maximum(output.auto - explained, output.auto * 1e-12 + _TINY)
    return Conditioned(
        response=response,
        noise=noise,
        input_residual=residual.T,
        instrument_coherence=_partial_coherence(matrix.block(instruments, instruments), to_output, output.auto).T,
    )


def _partial_coherence(auto: ComplexArray, cross: ComplexArray, output: FloatArray) -> FloatArray:
    r"""Coherence of each instrument and the output once the other instruments are accounted for, shape ``(f, r)``.

    With :math:`y = \sum_j a_j r_j + e` and :math:`P_j = 1 / [S_{rr}^{-1}]_{jj}`, the power of instrument j that the
    others do not have, :math:`\gamma_j^2 = |a_j|^2 P_j / (|a_j|^2 P_j + S_{ee})`. The ordinary coherence says of a
    sweep in roll that yaw does not follow it, when all it means is that the sweep in yaw moved yaw more.
    """
    a = np.linalg.solve(auto, cross[:, :, None])[:, :, 0]
    unexplained = np.maximum(output - np.sum(a.conj() * cross, axis=1).real, output * 1e-12 + _TINY)
    own = 1.0 / np.einsum("fii->fi", np.linalg.inv(auto)).real
    explained = np.abs(a) ** 2 * own
    return np.asarray(explained / (explained + unexplained[:, None]))


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
            Finding(
                kind="correlated_inputs",
                severity="error",
                where=names,
                message=f"{names} move together at {count} of {lost.size} frequencies and cannot be told apart.",
                numbers={"omega_rad_s": where, "frequencies": count},
            )
        ],
    )
