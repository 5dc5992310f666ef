r"""Windowed Fourier transforms of many channels onto any frequency grid, fast.

The samples are cut into short blocks. Inside the band of interest a block of :math:`b` samples has only some
:math:`r \approx \omega_{max} T_b / \pi + 20` degrees of freedom, so each block is projected once onto an orthonormal
basis :math:`Q` of the exponentials of the band. A window is a row of blocks, and its tapered transform is one product

.. math:: X_k(\omega) = \sum_{m} \left[ Q^T x_{k+m} \right]^T W_m(\omega),
   \qquad W_m(\omega) = Q^T \left[ w(t) e^{-j\omega t} \right]_{\text{block } m}

shared by all channels and positions. The cost no longer grows with the sample rate.

Tapers are even about the middle of their window. Seen from there, the real part of a transform is a sum over the even
part of the samples and the imaginary part one over the odd part. Both are folded from the two halves of a window, so
real products over half as many blocks give the complex transform. For this the basis keeps its even and its odd
functions apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray

_RANK_TOLERANCE = 1e-13

_MOST_PARTS = 10
"""Of the hop of the shortest window, where windows of given lengths need finer blocks."""


@dataclass(frozen=True, kw_only=True, slots=True)
class BlockGrid:
    """How a record is cut: samples per block, and windows counted in blocks.

    Parameters
    ----------
    samples_per_block
        Length of a block.
    """

    samples_per_block: int
    sample_rate_hz: float

    @property
    def block_s(self) -> float:
        return self.samples_per_block / self.sample_rate_hz

    @classmethod
    def for_windows(
        cls, lengths_s: Sequence[float], overlap: float, sample_rate_hz: float, *, within: float = math.inf
    ) -> BlockGrid:
        """The grid whose block is the hop of the shortest window, or a part of it.

        Parameters
        ----------
        within
            How far a window may be from its length, as a share: the hop is divided until all are that close. Blocks
            stay longer than a tenth of it.
        """
        hop_s = min(lengths_s) * (1.0 - overlap)

        def part(parts: int) -> BlockGrid:
            return cls(samples_per_block=max(1, round(hop_s * sample_rate_hz / parts)), sample_rate_hz=sample_rate_hz)

        def misses(grid: BlockGrid) -> float:
            return max(abs(grid.window(one, overlap).blocks * grid.block_s / one - 1.0) for one in lengths_s)

        grids = [part(parts) for parts in range(1, _MOST_PARTS + 1)] if within < math.inf else [part(1)]
        return next((grid for grid in grids if misses(grid) <= within), min(grids, key=misses))

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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BandBasis:
    """Orthonormal functions on one block that span all sinusoids of a band.

    Parameters
    ----------
    functions
        Shape ``(samples, rank)``, those even about the middle of the block first.
    n_even
        How many are even; the others are odd.
    """

    functions: FloatArray
    n_even: int

    @property
    def parity(self) -> FloatArray:
        """One for each even function and minus one for each odd one, shape ``(rank,)``."""
        return np.where(np.arange(self.functions.shape[1]) < self.n_even, 1.0, -1.0)

    def project(self, lines: ComplexArray) -> ComplexArray:
        r"""Inner products with functions of the form :math:`e^{j a n}`, :math:`n` from the middle of the block.

        Their real part is even and their imaginary part odd, so half of the products vanish.
        """
        even, odd = self.functions[:, : self.n_even], self.functions[:, self.n_even :]
        return np.concatenate([even.T @ lines.real, 1j * (odd.T @ lines.imag)])


def band_basis(grid: BlockGrid, highest_rad_s: float) -> BandBasis:
    """Orthonormal basis of all sinusoids up to ``highest_rad_s`` on one block."""
    highest_rad_s = min(highest_rad_s, np.pi * grid.sample_rate_hz)
    # Chebyshev nodes resolve every sinusoid of the band once there are some more of them than degrees of freedom.
    count = int(highest_rad_s * grid.block_s / np.pi) + 24
    nodes = highest_rad_s * 0.5 * (1.0 - np.cos(np.pi * (np.arange(count) + 0.5) / count))
    first_half = _centered(grid.samples_per_block)[: (grid.samples_per_block + 1) // 2]
    phase = first_half[:, None] / grid.sample_rate_hz * nodes
    even = _span(np.cos(phase), grid.samples_per_block, parity=1.0)
    odd = _span(np.sin(phase), grid.samples_per_block, parity=-1.0)
    return BandBasis(functions=np.ascontiguousarray(np.hstack([even, odd])), n_even=even.shape[1])


def compress(values: FloatArray, grid: BlockGrid, basis: BandBasis) -> FloatArray:
    """Blocks of every channel in the basis, ``(channels, blocks, rank)``; an incomplete last block is left out."""
    channels, samples = values.shape
    blocks = samples // grid.samples_per_block
    cut = values[:, : blocks * grid.samples_per_block].reshape(channels * blocks, grid.samples_per_block)
    return np.asarray(cut @ basis.functions).reshape(channels, blocks, basis.functions.shape[1])


def transform(
    compressed: FloatArray,
    window: BlockWindow,
    omega_rad_s: FloatArray,
    *,
    grid: BlockGrid,
    basis: BandBasis,
    taper: Taper,
) -> ComplexArray:
    r"""Tapered transforms at every position of a window, shape ``(positions, channels, f)``.

    .. math:: X_k(\omega) = \sum_{n=0}^{N-1} w_n \, x_{n + k h} \, e^{-j \omega n / f_s}

    The phase reference is the first sample of each window. Frequencies must lie in the band of the basis, with the
    shifts of the taper: beyond it the sum silently loses what the basis does not span.

    Parameters
    ----------
    compressed
        Blocks in the basis, shape ``(channels, blocks, rank)``.
    window
        Length :math:`N` and hop :math:`h` in blocks.
    omega_rad_s
        Frequencies, shape ``(f,)``.
    grid, basis
        How the record was cut and compressed.
    taper
        :math:`w`, even or odd about the middle of the window.
    """
    channels, blocks, _ = compressed.shape
    positions, half = window.positions(blocks), (window.blocks + 1) // 2
    # Both views run over adjacent numbers: the second one walks through a copy that lies there backward in time.
    backward = np.multiply(compressed[:, ::-1], basis.parity, order="C")
    ahead = _rows_of_blocks(compressed, half, slice(0, None, window.hop))[:, :positions]
    mirrored = _rows_of_blocks(backward, half, slice(blocks - window.blocks, None, -window.hop))[:, :positions]
    weights = _half_weights(window, omega_rad_s, grid=grid, basis=basis, taper=taper)
    shape = (channels * positions, len(weights))
    product = np.empty((omega_rad_s.size, channels * positions), dtype=np.complex128)
    # An odd taper turns the symmetry of what it multiplies around.
    for_real, for_imag = (np.subtract, np.add) if taper.odd else (np.add, np.subtract)
    product.real = (for_real(ahead, mirrored, order="C").reshape(shape) @ weights.real).T
    product.imag = (for_imag(ahead, mirrored, order="C").reshape(shape) @ weights.imag).T
    to_middle_s = 0.5 * (window.blocks * grid.samples_per_block - 1) / grid.sample_rate_hz
    product *= np.exp(-1j * omega_rad_s * to_middle_s)[:, None]
    return product.reshape(omega_rad_s.size, channels, positions).transpose(2, 1, 0)


def _rows_of_blocks(compressed: FloatArray, count: int, firsts: slice) -> FloatArray:
    """Runs of ``count`` blocks, one for each first block, as a view of shape ``(channels, runs, count, rank)``."""
    runs = np.lib.stride_tricks.sliding_window_view(compressed, count, axis=1)[:, firsts]
    return np.asarray(runs.swapaxes(2, 3))


def _half_weights(
    window: BlockWindow, omega_rad_s: FloatArray, *, grid: BlockGrid, basis: BandBasis, taper: Taper
) -> ComplexArray:
    """What the first half of a window contributes, seen from its middle, shape ``(blocks * rank, f)``.

    The real part weighs the even part of the samples, the imaginary part the odd one.
    """
    count, half = window.blocks * grid.samples_per_block, (window.blocks + 1) // 2
    within = _centered(grid.samples_per_block)[:, None]
    middles = (_centered(window.blocks)[:half] * grid.samples_per_block)[:, None]
    line = np.exp(-1j * within * (omega_rad_s / grid.sample_rate_hz))
    weights = np.zeros((half, basis.functions.shape[1], omega_rad_s.size), dtype=np.complex128)
    for shift, amplitude in taper.terms:
        turn = np.pi * shift / count
        projected = basis.project(line * np.exp(1j * turn * within))
        at_middle = amplitude * np.exp(0.5j * np.pi * shift)
        moved = at_middle * np.exp(1j * middles * (turn - omega_rad_s / grid.sample_rate_hz))
        weights += moved[:, None, :] * projected
    if window.blocks % 2:
        weights[-1] *= 0.5  # the block in the middle is its own mirror image and would count twice
    return weights.reshape(-1, omega_rad_s.size)


def _centered(count: int) -> FloatArray:
    return np.asarray(np.arange(count) - 0.5 * (count - 1), dtype=np.float64)


def _span(first_half: FloatArray, samples: int, *, parity: float) -> FloatArray:
    """Orthonormal basis of even or odd vectors, given by their first halves, as far as doubles separate them.

    Decomposing halves makes the parity exact; rounding would mix it into the weakest vectors of whole blocks.
    """
    has_middle = bool(samples % 2)
    weighted = first_half.copy()
    if has_middle:
        weighted[-1] *= np.sqrt(0.5)  # all others stand for two samples
    left, values, _ = np.linalg.svd(weighted, full_matrices=False)
    half = left[:, values > values[0] * _RANK_TOLERANCE] * np.sqrt(0.5)
    if has_middle:
        half[-1] *= np.sqrt(2.0)
    return np.concatenate([half, parity * half[: samples // 2][::-1]])
