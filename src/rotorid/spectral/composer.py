"""All window lengths of one output joined into composite responses with their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from rotorid.spectral.composite import (
    PairSpectra,
    compose_by_least_squares,
    compose_by_weights,
    minimum_variance_share,
    smoothed,
    window_weights,
)
from rotorid.spectral.conditioning import Conditioned, OutputSpectra, Separated, condition
from rotorid.spectral.errors import compacted, influence, random_error, response_covariance, smear
from rotorid.spectral.freedom import residual_share
from rotorid.spectral.kernel import BlockGrid
from rotorid.spectral.weakness import weak_instrument_factor
from rotorid.spectral.windows import Taper
from rotorid.typing import BoolArray, ComplexArray, FloatArray

Composition: TypeAlias = Literal["minimum_variance", "least_squares", "weights"]

_MOMENTS_IN_WINDOW = 5
_MOMENTS_AT_ONCE = 4096
_LARGEST_PUBLISHED_ERROR = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class Composed:
    """Responses of one output to every input.

    Parameters
    ----------
    values
        Shape ``(u, f)``.
    coherence, random_error
        Shape ``(u, f)``.
    covariance
        Shape ``(u, f, f)``; empty in a draft.
    share
        Share of each window in the composite, shape ``(u, w, f)``.
    window_error
        Random error of each window alone, shape ``(u, w, f)``; not a number where it does not count.
    multiple_coherence
        Share of the output's power that all inputs explain, shape ``(f,)``.
    weakness
        Factor on the errors because instruments are weak, shape ``(u, f)``.
    """

    values: ComplexArray
    coherence: FloatArray
    random_error: FloatArray
    covariance: ComplexArray
    share: FloatArray
    window_error: FloatArray
    multiple_coherence: FloatArray
    weakness: FloatArray

    def at(self, points: BoolArray) -> Composed:
        """The same at some of the frequencies only; ``points`` has shape ``(f,)``."""
        return Composed(
            values=self.values[:, points],
            coherence=self.coherence[:, points],
            random_error=self.random_error[:, points],
            covariance=self.covariance[:, points][:, :, points],
            share=self.share[..., points],
            window_error=self.window_error[..., points],
            multiple_coherence=self.multiple_coherence[points],
            weakness=self.weakness[:, points],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Composer:
    """Composes one output at a time; holds what all of them share.

    Parameters
    ----------
    windows
        Inputs told apart, for each window length.
    omega_rad_s
        The union of their grids, shape ``(f,)``.
    grid, blocks
        How the records were cut, and into how many blocks.
    overlap, taper
        How windows overlap and fade.
    corrected
        Whether leakage is taken out of the densities that come.
    composition
        How windows are joined.
    """

    windows: Sequence[Separated]
    omega_rad_s: FloatArray
    grid: BlockGrid
    blocks: int
    overlap: float
    taper: Taper
    corrected: bool
    composition: Composition

    def responses(self, spectra: Sequence[OutputSpectra], *, draft: bool = False) -> Composed:
        """Responses of the output whose densities came, one set for each window length.

        A draft has the textbook's random error of the composite and no covariance; it is for what needs a response
        before the final one can be formed.
        """
        parts = [condition(window, output) for window, output in zip(self.windows, spectra, strict=True)]
        columns = [self._one(parts, index, draft) for index in range(len(self.windows[0].inputs))]
        values, coherence, error, covariance, share, single, weakness = (
            np.stack(arrays) for arrays in zip(*columns, strict=True)
        )
        mean = share.mean(axis=0)
        explained = 1.0 - np.sum(mean * self._padded([part.noise for part in parts], 0.0).real, axis=0) / np.sum(
            mean * self._padded([output.auto for output in spectra], 1.0).real, axis=0
        )
        return Composed(
            values=values,
            coherence=coherence,
            random_error=error,
            covariance=covariance,
            share=share,
            window_error=single,
            multiple_coherence=explained,
            weakness=weakness,
        )

    @property
    def _direct(self) -> bool:
        return self.windows[0].instruments == self.windows[0].inputs

    def _one(
        self, parts: Sequence[Conditioned], index: int, draft: bool
    ) -> tuple[ComplexArray, FloatArray, FloatArray, ComplexArray, FloatArray, FloatArray, FloatArray]:
        power = self._padded([window.input_power[index] for window in self.windows], 1.0).real
        response = self._padded([part.response[index] for part in parts], 1.0)
        noise = self._padded([part.noise / left for part, left in zip(parts, self.left, strict=True)], 1.0).real
        pairs = PairSpectra(input_auto=power, output_auto=np.abs(response) ** 2 * power + noise, cross=response * power)
        single = random_error(pairs.coherence, self._averages, overlap=self.overlap)
        weights = self._weights(single)
        compose = compose_by_weights if self.composition == "weights" else compose_by_least_squares
        total = compose(pairs, weights)
        # Least squares weigh the windows once, the weighted mean by the squares of the same weights.
        share = weights ** (2 if self.composition == "weights" else 1) * power
        share = share / share.sum(axis=0)
        values, coherence = total.response, total.coherence
        if self.composition == "minimum_variance" and not draft:
            share = self._best_share(index, noise, np.abs(values))
            values, coherence = np.sum(share * response, axis=0), np.sum(share * pairs.coherence, axis=0)
        if not self._direct:
            seen = self._padded([part.instrument_coherence[index] for part in parts], 0.0).real
            coherence = np.sum(share * seen, axis=0)
        coherence = np.clip(coherence, 0.0, 1.0)
        single = np.where(self._valid, single, np.nan)
        if draft:
            averages = np.sum(share * self._averages, axis=0)
            error = random_error(np.clip(total.coherence, 0.0, 1.0), averages, overlap=self.overlap)
            return values, coherence, error, np.zeros(0, dtype=np.complex128), share, single, np.ones_like(error)
        covariance, weakness = self._covariance(parts, index, share, _smooth(np.sum(share * noise, axis=0)))
        spread = np.sqrt(0.5 * np.einsum("ff->f", covariance).real) / np.abs(values)
        return values, coherence, np.minimum(spread, _LARGEST_PUBLISHED_ERROR), covariance, share, single, weakness

    def _best_share(self, index: int, noise: FloatArray, size: FloatArray) -> FloatArray:
        """Shares of the least error, from how a disturbance at each moment enters each window's estimate."""
        reached = self._influences[index]
        together = np.einsum("wfm,vfm->fwv", reached, reached.conj(), optimize=True).real
        bias = (self._left_over * size).T
        level = np.sqrt(np.stack([_smooth(row) for row in noise]) * self._moment_s).T
        covariance = together * level[:, :, None] * level[:, None, :] + bias[:, :, None] * bias[:, None, :]
        return minimum_variance_share(covariance, self._valid)

    def _weights(self, error: FloatArray) -> FloatArray:
        return window_weights(np.hypot(error, self._left_over), self._valid)

    @cached_property
    def _left_over(self) -> FloatArray:
        """Relative bias of each window that its correction leaves, shape ``(w, f)``; see :func:`smear`.

        The next term of the same series; without a correction the first one.
        """
        lengths_s = np.array([window.matrix.window_s for window in self.windows])[:, None]
        first = smear(self.omega_rad_s, lengths_s)
        return 3.0 * first**2 if self.corrected else first

    @cached_property
    def _valid(self) -> BoolArray:
        # Grids of shorter windows are tails of the longest one's.
        return np.stack([self.omega_rad_s >= window.matrix.omega_rad_s[0] for window in self.windows])

    @cached_property
    def _averages(self) -> FloatArray:
        return np.array([window.matrix.averages for window in self.windows])[:, None]

    @cached_property
    def left(self) -> tuple[FloatArray, ...]:
        """Share of the noise that estimating the response has left, of each window."""
        return tuple(residual_share(window, self.taper) for window in self.windows)

    def _padded(self, arrays: Sequence[FloatArray | ComplexArray], fill: float) -> ComplexArray:
        padded = np.full((len(arrays), self.omega_rad_s.size), fill, dtype=np.complex128)
        for row, array in zip(padded, arrays, strict=True):
            row[row.size - array.size :] = array
        return padded

    @cached_property
    def _moments(self) -> int:
        # Little overlap makes long blocks, in which the taper would be seen too seldom for a variance.
        return math.ceil(_MOMENTS_IN_WINDOW / min(window.matrix.window.blocks for window in self.windows))

    @property
    def _moment_s(self) -> float:
        return self.grid.block_s / self._moments

    @cached_property
    def _influences(self) -> tuple[ComplexArray, ...]:
        """Influence of each moment on each window's estimate, for every input, shape ``(w, f, moments)``.

        Compacted where records are long: see :func:`rotorid.spectral.errors.compacted`.
        """
        return tuple(
            compacted((self._reached(index, *stretch) for stretch in self._stretches), self.blocks * self._moments)
            for index in range(len(self.windows[0].inputs))
        )

    def input_correlation(self, share: FloatArray, points: BoolArray) -> ComplexArray:
        r"""Correlation of the errors of responses to two inputs, shape ``(u, u, f, f)``.

        Where one instrument moves several inputs, the same disturbance enters the responses to all of them:
        :math:`E[\delta H_{u,i} \, \delta H_{v,j}^*] \propto \sum_m g_{u,i}(t_m) g_{v,j}^*(t_m)`.

        Parameters
        ----------
        share
            Share of each window for each input, the mean over the outputs, shape ``(u, w, f)``.
        points
            Frequencies to answer for, shape ``(f,)``.
        """
        inputs, count = share.shape[0], int(np.count_nonzero(points))
        products = np.zeros((inputs * count, inputs * count), dtype=np.complex128)
        for stretch in self._stretches:
            reached = [
                np.einsum("wf,wfm->fm", share[index][:, points], self._reached(index, *stretch)[:, points])
                for index in range(inputs)
            ]
            together = np.concatenate(reached)
            products += together @ together.conj().T
        omega = np.tile(self.omega_rad_s[points], inputs)
        products *= np.sinc(0.5 * (omega[:, None] - omega) * self._moment_s / np.pi)
        level = np.sqrt(np.einsum("nn->n", products).real)
        shape = (inputs, count, inputs, count)
        return np.asarray(np.moveaxis((products / (level[:, None] * level)).reshape(shape), 2, 1))

    @property
    def _stretches(self) -> list[tuple[int, int]]:
        step = max(1, _MOMENTS_AT_ONCE // self._moments)
        return [(first, min(step, self.blocks - first)) for first in range(0, self.blocks, step)]

    def _reached(self, index: int, first_block: int, blocks: int) -> ComplexArray:
        """Influences of a stretch of time, shape ``(w, f, moments)``."""
        reached = np.zeros((len(self.windows), self.omega_rad_s.size, blocks * self._moments), dtype=np.complex128)
        for row, window in zip(reached, self.windows, strict=True):
            here = influence(
                window, index, blocks=blocks, taper=self.taper, moments=self._moments, first_block=first_block
            )
            row[self.omega_rad_s.size - len(here) :] = here
        return reached

    def _covariance(
        self, parts: Sequence[Conditioned], index: int, share: FloatArray, noise: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        total = np.einsum("wf,wfm->fm", share, self._influences[index])
        covariance = response_covariance([total], self.omega_rad_s, noise, self._moment_s)
        if self._direct:
            return covariance, np.ones(len(covariance))
        unexplained = self._padded([window.input_noise[index] for window in self.windows], 0.0).real
        residual = self._padded([part.input_residual[index] for part in parts], 0.0)
        factor = weak_instrument_factor(
            np.einsum("ff->f", covariance).real,
            noise,
            np.sum(share * unexplained, axis=0),
            np.sum(share * residual, axis=0),
        )
        return np.asarray(covariance * factor[:, None] * factor), factor


def _smooth(noise: FloatArray) -> FloatArray:
    return np.asarray(smoothed(np.asarray(noise, dtype=np.complex128)).real)
