"""Noise at the outputs like that which a fit in time has left: what a bootstrap draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rotorid.errors import UsageError
from rotorid.fit.time_problem import Part
from rotorid.typing import ComplexArray, FloatArray
from rotorid.uncertainty.colored import Process, residual_process

_CHANCE = 2.0
_LONGEST_SHARE = 8
"""A record gives at least so many blocks, or every draw of it would be much the same."""


class OutputNoise(Protocol):
    """Draws whitened errors of all records, shape ``(n, y)`` each."""

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """One draw."""
        ...


@dataclass(frozen=True, eq=False)
class ColoredNoise:
    r"""Draws of a vector autoregression :math:`e_k = \sum_i A_i e_{k-i} + w_k` with normal :math:`w`.

    Drawn by its spectrum over twice the length of a record, so that it is stationary from the first sample on.

    Parameters
    ----------
    process
        Stable coefficients and covariance of the noise.
    samples
        Of each record.

    Examples
    --------
    >>> process = Process(np.array([[[0.8]]]), np.array([[1.0]]))
    >>> (e,) = ColoredNoise(process, (20000,)).draw(np.random.default_rng(0))
    >>> round(float(np.mean(e[1:] * e[:-1]) / np.mean(e**2)), 1)
    0.8
    """

    process: Process
    samples: tuple[int, ...]

    @classmethod
    def of(cls, parts: Sequence[Part]) -> ColoredNoise:
        """The process of the errors of a fit, with what the fit took from its residuals given back."""
        return cls(residual_process(parts), tuple(len(part.residual) for part in parts))

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """One draw of all records, shape ``(n, y)`` each."""
        return tuple(self._record(samples, rng) for samples in self.samples)

    def _record(self, samples: int, rng: np.random.Generator) -> FloatArray:
        from scipy.fft import irfft, next_fast_len, rfft

        length = int(next_fast_len(2 * samples, real=True))
        white = rng.standard_normal((length, len(self.process.noise)))
        color = rfft(white, axis=0)[:, :, None]
        drawn = irfft((self._filter(length) @ color)[:, :, 0], n=length, axis=0)
        return np.asarray(drawn[:samples], dtype=np.float64)

    def _filter(self, length: int) -> ComplexArray:
        """From white noise to the process, shape ``(length // 2 + 1, y, y)``."""
        from scipy.fft import rfft

        polynomial = np.concatenate([np.eye(len(self.process.noise))[None], -self.process.coefficients])
        root = np.linalg.cholesky(self.process.noise)
        return np.asarray(np.linalg.solve(rfft(polynomial, n=length, axis=0), root.astype(np.complex128)))


@dataclass(frozen=True, eq=False)
class BlockNoise:
    """Draws blocks of the residuals themselves, all outputs together, from any record and round its end.

    For residuals that no autoregression describes: with outliers, or of changing size. What is longer than a block is
    lost, and with it the spread by slow errors; blocks that are long are few and draw the same again and again.

    Parameters
    ----------
    residuals
        Whitened residuals of each record, shape ``(n, y)``.
    length
        Samples of a block.

    References
    ----------
    D. N. Politis and J. P. Romano, *A Circular Block-Resampling Procedure for Stationary Data*, in Exploring the Limits
    of Bootstrap, 1992.
    """

    residuals: tuple[FloatArray, ...]
    length: int

    def __post_init__(self) -> None:
        shortest = min(len(one) for one in self.residuals)
        if not 1 <= self.length <= shortest:
            raise UsageError(f"blocks of {self.length} samples came", needed=f"from 1 to {shortest} samples")

    @classmethod
    def of(cls, parts: Sequence[Part], *, length: int | None = None) -> BlockNoise:
        r"""Blocks of the residuals of a fit.

        They are centered, and stretched by :math:`\sqrt{N / (N - k)}` for the k numbers that the fit took from them.

        Parameters
        ----------
        parts
            Whitened residuals, slopes and unknowns of each record.
        length
            Samples of a block. By default twice the memory of the residuals, the cube root of the samples at least and
            an eighth of a record at most.
        """
        count = sum(part.residual.size for part in parts)
        taken = parts[0].slopes.shape[2] + sum(part.unknown.shape[2] for part in parts)
        stretch = math.sqrt(count / max(count - taken, 1))
        residuals = tuple(stretch * (part.residual - part.residual.mean(axis=0)) for part in parts)
        return cls(residuals, block_length(residuals) if length is None else length)

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """One draw of all records, shape ``(n, y)`` each."""
        return tuple(self._record(len(one), rng) for one in self.residuals)

    def _record(self, samples: int, rng: np.random.Generator) -> FloatArray:
        whole = np.cumsum([len(one) for one in self.residuals])
        blocks = []
        for place in rng.integers(0, whole[-1], -(-samples // self.length)).tolist():
            record = int(np.searchsorted(whole, place, side="right"))
            first = place - int(whole[record]) + len(self.residuals[record])
            rows = np.arange(first, first + self.length) % len(self.residuals[record])
            blocks.append(self.residuals[record][rows])
        return np.concatenate(blocks)[:samples]


def block_length(residuals: Sequence[FloatArray]) -> int:
    r"""Samples of a block that hold the memory of residuals ``(n, y)``.

    Twice the last lag at which the autocorrelation of an output leaves :math:`2 / \sqrt N`; the cube root of the
    samples at least, an eighth of the shortest record at most.

    Examples
    --------
    >>> block_length([np.random.default_rng(0).standard_normal((1000, 1))])
    10
    """
    count = sum(len(one) for one in residuals)
    longest = max(min(len(one) for one in residuals) // _LONGEST_SHARE, 1)
    power = sum((np.sum(one**2, axis=0) for one in residuals), start=np.zeros(residuals[0].shape[1]))
    memory = 0
    for lag in range(1, longest + 1):
        product = sum((np.sum(one[lag:] * one[:-lag], axis=0) for one in residuals), start=np.zeros_like(power))
        if np.all(np.abs(product) <= _CHANCE / math.sqrt(count) * power):
            break
        memory = lag
    return min(max(2 * memory, math.ceil(math.cbrt(count) - 1e-9)), longest)
