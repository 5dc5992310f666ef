r"""Sandwich covariances: how a fit would scatter, judged by how its parts pull at it and by no model of the errors.

Where a structure is wrong, residuals depend on the inputs, and a covariance that takes them for noise is too small. At
the solution, with whitened slopes S beside all unknowns, residuals r and :math:`F = S^T S`, each part of the data pulls
by its score :math:`s`, and all scores sum to zero. Other data would have pulled otherwise, by about as much as these
differ:

.. math:: C = F^{-1} \sum_b s_b s_b^T F^{-1} \frac{B}{B - 1}

The parts are blocks of time, :math:`s_b = S_b^T r_b`, outputs, or bands of frequency,
:math:`s_f = \frac{1}{N} \sum_{\omega \in f} \mathrm{Re}\, \tilde S^* \tilde r`: what a value would be, were the
spectrum of the input another one. For errors that are noise, each expects the covariance of colored errors (White,
*Maximum Likelihood Estimation of Misspecified Models*, Econometrica 50(1), 1982).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.fitting.problem import Part
from rotorid.typing import FloatArray

BLOCK_S = 2.0
"""Length of blocks: errors of motors and air last less."""

_BANDS_PER_OCTAVE = 2.0


def by_blocks(parts: Sequence[Part]) -> FloatArray:
    """Covariance of the parameters by blocks of 2 s, all outputs together, shape ``(p, p)``.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> slopes, noise = rng.normal(size=(2000, 1, 1)), rng.normal(size=(2000, 1))
    >>> fitted = noise - slopes[:, :, 0] * float(np.sum(noise * slopes[:, :, 0]) / np.sum(slopes**2))
    >>> part = Part(residual=fitted, slopes=slopes, unknown=np.zeros((2000, 1, 0)), sample_rate_hz=50.0)
    >>> 0.5 < by_blocks([part]).item() * float(np.sum(slopes**2)) < 2.0
    True
    """
    scores = []
    for part in parts:
        pulled = np.einsum("nyp,ny->np", part.slopes, part.residual)
        blocks = max(1, round(len(pulled) / (BLOCK_S * part.sample_rate_hz)))
        scores += [block.sum(axis=0) for block in np.array_split(pulled, blocks)]
    return by_pulls(parts, np.array(scores))


def by_outputs(parts: Sequence[Part]) -> FloatArray:
    """Covariance of the parameters by how the outputs differ, shape ``(p, p)``; zero for a single output."""
    return by_pulls(parts, sum(np.einsum("nyp,ny->yp", part.slopes, part.residual) for part in parts))


def by_bands(parts: Sequence[Part]) -> FloatArray:
    """Covariance of the parameters by bands of half an octave, shape ``(p, p)``."""
    from scipy.fft import rfft, rfftfreq

    found: dict[int, FloatArray] = {}
    for part in parts:
        samples = len(part.residual)
        slopes, residual = rfft(part.slopes, axis=0), rfft(part.residual, axis=0)
        # All but the mean, and the last of an even number, stand for themselves and their mirror image.
        weights = np.full(len(residual), 2.0 / samples)
        weights[0] = 1.0 / samples
        weights[-1] = (1.0 if samples % 2 == 0 else 2.0) / samples
        pulled = np.einsum("nyp,ny->np", slopes.conj(), residual).real * weights[:, None]
        frequency = rfftfreq(samples, 1.0 / part.sample_rate_hz)
        frequency[0] = 0.5 * frequency[1] if frequency.size > 1 else 1.0
        _gather(found, pulled, frequency)
    return by_pulls(parts, np.array(list(found.values())))


def by_lines(parts: Sequence[Part], omega_rad_s: Sequence[FloatArray]) -> FloatArray:
    """The same of transforms over a band, whose rows are real parts of lines and then imaginary ones.

    Parameters
    ----------
    omega_rad_s
        Of the lines of each part.
    """
    found: dict[int, FloatArray] = {}
    for part, omega in zip(parts, omega_rad_s, strict=True):
        pulled = np.einsum("nyp,ny->np", part.slopes, part.residual)
        lines = pulled[: omega.size] + pulled[omega.size :]
        _gather(found, lines, omega / (2.0 * np.pi))
    return by_pulls(parts, np.array(list(found.values())))


def _gather(found: dict[int, FloatArray], pulled: FloatArray, frequency_hz: FloatArray) -> None:
    """Add pulls ``(f, p)`` to those of their bands."""
    bands = np.floor(_BANDS_PER_OCTAVE * np.log2(frequency_hz)).astype(int)
    for band in np.unique(bands).tolist():
        found[band] = found.get(band, np.zeros(pulled.shape[1])) + pulled[bands == band].sum(axis=0)


def by_pulls(parts: Sequence[Part], scores: FloatArray) -> FloatArray:
    """Covariance of the parameters by any pulls ``(b, p)`` that together are all of the data; zero of a single one."""
    slopes = np.concatenate([part.slopes.reshape(-1, part.slopes.shape[2]) for part in parts])
    size = np.linalg.norm(slopes, axis=0)
    if len(scores) < 2:
        return np.zeros((size.size, size.size))
    scaled = slopes / np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    moved = inverse @ (scores / np.where(size > 0.0, size, np.inf)).T / np.where(size > 0.0, size, np.inf)[:, None]
    return np.asarray(moved @ moved.T * len(scores) / (len(scores) - 1.0))
