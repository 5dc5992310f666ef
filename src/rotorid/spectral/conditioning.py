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
class Conditioned:
    r"""Response of one output to all inputs, from windows of one length.

    With instruments :math:`r` (the inputs themselves for a direct estimate) and :math:`y = H u + v`,

    .. math:: H^T = S_{ru}^{-1} S_{ry}, \qquad
       \tilde G_{jj} = 1 / [S_{ru}^{-1} S_{rr} S_{ru}^{-H}]_{jj}

    :math:`\tilde G_{jj}` is the part of the input's power that the instruments explain and the other inputs do not:
    for a single direct input its auto-spectrum, for several the conditioned one. The variance of the response is
    :math:`S_{vv} / (n_d \tilde G_{jj})`.

    Parameters
    ----------
    response
        Shape ``(u, f)``.
    input_power
        :math:`\tilde G`, shape ``(u, f)``.
    noise
        :math:`S_{vv}`, shape ``(f,)``.
    projection
        :math:`S_{ru}^{-1}`, shape ``(u, f, r)``.
    instrument_coherence
        Coherence of each instrument and the output, shape ``(u, f)``.
    """

    response: ComplexArray
    input_power: FloatArray
    noise: FloatArray
    projection: ComplexArray
    instrument_coherence: FloatArray


def condition(matrix: SpectralMatrix, *, instruments: Sequence[int], inputs: Sequence[int], output: int) -> Conditioned:
    """Separate the inputs of one output; ``instruments`` equals ``inputs`` for a direct estimate.

    Raises
    ------
    InsufficientDataError
        The inputs (or what the instruments see of them) are proportional to each other; the finding is
        ``correlated_inputs``.
    """
    _require_separable(matrix, instruments, inputs)
    inverse: ComplexArray = np.asarray(np.linalg.inv(matrix.block(instruments, inputs)), dtype=np.complex128)
    to_output = matrix.block(instruments, [output])
    response = (inverse @ to_output)[:, :, 0]
    spread = inverse @ matrix.block(instruments, instruments) @ np.swapaxes(inverse.conj(), 1, 2)
    output_auto = matrix.values[:, output, output].real
    to_inputs = matrix.block([output], inputs)[:, 0]
    explained = 2.0 * np.sum(response * to_inputs, axis=1).real
    power = np.einsum("fi,fij,fj->f", response.conj(), matrix.block(inputs, inputs), response).real
    instrument_auto = np.einsum("fii->fi", matrix.block(instruments, instruments)).real
    # The difference of nearly equal numbers may come out a rounding error below zero for noise-free data.
    noise = np.maximum(output_auto - explained + power, output_auto * 1e-12 + _TINY)
    return Conditioned(
        response=response.T,
        input_power=(1.0 / np.einsum("fii->fi", spread).real).T,
        noise=noise,
        projection=np.moveaxis(inverse, 1, 0),
        instrument_coherence=(np.abs(to_output[:, :, 0]) ** 2 / (instrument_auto * output_auto[:, None])).T,
    )


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
