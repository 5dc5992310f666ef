r"""Windowed Fourier transforms of many channels onto any frequency grid, fast.

The samples are cut into short blocks. Inside the band of interest a block of :math:`b` samples has only some
:math:`r \approx \omega_{max} T_b / \pi + 20` degrees of freedom, so each block is projected once onto an orthonormal
basis :math:`Q` of the exponentials of the band. A window is a row of blocks, and its tapered transform is one product

.. math:: X_k(\omega) = \sum_{m} \left[ Q^T x_{k+m} \right]^T W_m(\omega),
   \qquad W_m(\omega) = Q^T \left[ w(t) e^{-j\omega t} \right]_{\text{block } m}

shared by all channels and positions. The cost no longer grows with the sample rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray

_RANK_TOLERANCE = 1e-13


@dataclass(frozen=True, kw_only=True, slots=True)
class BlockGrid:
    """How a record is cut: samples per block, and windows counted in blocks.

    Parameters
    ----------
    samples_per_block
        Length of a block.
    sample_rate_hz
        Rate of the record.
    """

    samples_per_block: int
    sample_rate_hz: float

    @property
    def block_s(self) -> float:
        return self.samples_per_block / self.sample_rate_hz

    @classmethod
    def for_windows(cls, lengths_s: Sequence[float], overlap: float, sample_rate_hz: float) -> BlockGrid:
        """The grid whose block is the hop of the shortest window."""
        hop_s = min(lengths_s) * (1.0 - overlap)
        return cls(samples_per_block=max(1, round(hop_s * sample_rate_hz)), sample_rate_hz=sample_rate_hz)

    def window(self, length_s: float, overlap: float) -> BlockWindow:
        """A window of about ``length_s``, in whole blocks."""
        blocks = max(1, round(length_s / self.block_s))
        return BlockWindow(blocks=blocks, hop=max(1, round(blocks * (1.0 - overlap))))


@dataclass(frozen=True, kw_only=True, slots=True)
class BlockWindow:
    """Length and hop of a window, in blocks."""

    blocks: int
    hop: int

    def positions(self, blocks: int) -> int:
        """How many positions fit into a record of ``blocks``."""
        return max(0, (blocks - self.blocks) // self.hop + 1)


def band_basis(grid: BlockGrid, highest_rad_s: float) -> FloatArray:
    """Orthonormal basis of all sinusoids up to ``highest_rad_s`` on one block, shape ``(samples, rank)``."""
    time_s = (np.arange(grid.samples_per_block) - 0.5 * (grid.samples_per_block - 1)) / grid.sample_rate_hz
    highest_rad_s = min(highest_rad_s, np.pi * grid.sample_rate_hz)
    # Chebyshev nodes resolve every sinusoid of the band once there are some more of them than degrees of freedom.
    count = int(highest_rad_s * grid.block_s / np.pi) + 24
    nodes = highest_rad_s * 0.5 * (1.0 - np.cos(np.pi * (np.arange(count) + 0.5) / count))
    phase = time_s[:, None] * nodes
    left, values, _ = np.linalg.svd(np.hstack([np.cos(phase), np.sin(phase)]), full_matrices=False)
    return np.ascontiguousarray(left[:, values > values[0] * _RANK_TOLERANCE])


def compress(values: FloatArray, grid: BlockGrid, basis: FloatArray) -> FloatArray:
    """Blocks of every channel in the basis, ``(channels, blocks, rank)``; an incomplete last block is left out."""
    channels, samples = values.shape
    blocks = samples // grid.samples_per_block
    cut = values[:, : blocks * grid.samples_per_block].reshape(channels * blocks, grid.samples_per_block)
    return np.asarray(cut @ basis).reshape(channels, blocks, basis.shape[1])


def transform(
    compressed: FloatArray,
    window: BlockWindow,
    omega_rad_s: FloatArray,
    *,
    grid: BlockGrid,
    basis: FloatArray,
    taper: Taper,
) -> ComplexArray:
    """Tapered transforms at every position of a window, shape ``(positions, channels, f)``.

    The phase reference is the first sample of each window.
    """
    channels, blocks, rank = compressed.shape
    positions = window.positions(blocks)
    view = np.lib.stride_tricks.sliding_window_view(compressed, (window.blocks, rank), axis=(1, 2))
    rows = view[:, :: window.hop, 0][:, :positions].reshape(channels * positions, window.blocks * rank)
    weights = _window_weights(window, omega_rad_s, grid=grid, basis=basis, taper=taper)
    product = rows @ np.hstack([weights.real, weights.imag])
    complex_product = product[:, : omega_rad_s.size] + 1j * product[:, omega_rad_s.size :]
    return complex_product.reshape(channels, positions, omega_rad_s.size).transpose(1, 0, 2)


def _window_weights(
    window: BlockWindow, omega_rad_s: FloatArray, *, grid: BlockGrid, basis: FloatArray, taper: Taper
) -> ComplexArray:
    count = window.blocks * grid.samples_per_block
    sample = np.arange(grid.samples_per_block)
    starts = np.arange(window.blocks) * grid.samples_per_block
    weights = np.zeros((window.blocks, basis.shape[1], omega_rad_s.size), dtype=np.complex128)
    for shift, amplitude in taper.terms:
        step = np.pi * shift / count - omega_rad_s / grid.sample_rate_hz
        projected = basis.T @ np.exp(1j * sample[:, None] * step)
        offset = amplitude * np.exp(0.5j * np.pi * shift / count)
        weights += offset * np.exp(1j * starts[:, None] * step)[:, None, :] * projected
    return weights.reshape(window.blocks * basis.shape[1], omega_rad_s.size)
