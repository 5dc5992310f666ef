"""Mean of a quantity weighted by the motion of an input at each frequency.

A sweep takes its frequencies one after the other, and what changes meanwhile, the mean thrust or how far the vehicle
leans, is another one for each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.record import TimeHistory
from rotorid.typing import ComplexArray, FloatArray

_PERIODS, _SHORTEST_S, _FREQUENCIES = 3.0, 1.0, 24

_LONG, _IN_PERIOD = 30_000, 12.0
"""Samples of a record up to which all count, and so many of a period at least beyond that."""


class WeightedMean(NamedTuple):
    """Quantity and inputs to average over: shapes ``(n,)`` and ``(inputs, n)``."""

    rate_hz: float
    values: FloatArray
    moved: FloatArray

    @classmethod
    def of(cls, record: TimeHistory, inputs: Sequence[str], watched: FloatArray) -> WeightedMean:
        """Inputs of a record about their means, and what is watched at the same times."""
        return cls(record.sample_rate_hz, watched, np.array([record[name] - record[name].mean() for name in inputs]))

    def coarser(self, omega_rad_s: float) -> WeightedMean:
        """Means over the samples of a long record, if a period keeps enough of them."""
        in_period = 2.0 * np.pi / omega_rad_s * self.rate_hz
        every = max(min(int(in_period / _IN_PERIOD), self.values.size // _LONG), 1)
        if every == 1:
            return self
        kept = self.values.size // every * every
        return WeightedMean(
            self.rate_hz / every,
            self.values[:kept].reshape(-1, every).mean(axis=1),
            self.moved[:, :kept].reshape(len(self.moved), -1, every).mean(axis=2),
        )


def input_weighted_mean(
    parts: Sequence[WeightedMean], omega_rad_s: FloatArray, transform: Callable[[FloatArray], FloatArray] = np.asarray
) -> FloatArray:
    """Mean of what is watched while each input moves at each frequency, shape ``(inputs, f)``.

    A window of three periods slides over each part: its mean counts as much as the power of the input at the frequency.

    Parameters
    ----------
    parts
        Each with the same inputs.
    omega_rad_s
        Frequencies, shape ``(f,)``.
    transform
        What becomes of the mean in a window before the average is taken.

    Examples
    --------
    A chirp from 2 to 20 rad/s while what is watched falls from one to zero:

    >>> time_s = np.arange(0.0, 60.0, 0.02)
    >>> chirp = np.sin(2.0 * time_s + 0.15 * time_s**2)
    >>> falling = WeightedMean(50.0, 1.0 - time_s / 60.0, chirp[None])
    >>> input_weighted_mean([falling], np.array([3.0, 11.0, 19.0])).round(1)
    array([[0.9, 0.5, 0.2]])
    """
    low, high = float(omega_rad_s[0]), float(omega_rad_s[-1])
    grid = np.geomspace(low, high, _FREQUENCIES) if high > low else np.array([low])
    inputs = len(parts[0].moved)
    power, weighted = np.zeros((inputs, grid.size)), np.zeros((inputs, grid.size))
    for part in parts:
        for place, omega in enumerate(grid.tolist()):
            rate_hz, watched, moved = part.coarser(omega)
            length = max(_PERIODS * 2.0 * np.pi / omega, _SHORTEST_S)
            window = np.hanning(min(int(length * rate_hz), watched.size) + 2)[1:-1]
            turned = moved * np.exp(-1j * omega / rate_hz * np.arange(watched.size))
            mean, *swings = _slid(window, watched, turned)
            swing = np.abs(np.array(swings)) ** 2 / window.sum() ** 2
            power[:, place] += swing.sum(axis=1) / rate_hz
            weighted[:, place] += (swing * transform(mean.real / _covered(window, watched.size))).sum(axis=1) / rate_hz
    means = np.divide(weighted, power, out=np.zeros_like(power), where=power > 0.0)
    return np.array([np.interp(np.log(omega_rad_s), np.log(grid), row) for row in means])


def _slid(window: FloatArray, watched: FloatArray, turned: ComplexArray) -> ComplexArray:
    """Sums under a window sliding over what is watched and over motions, ``(1 + inputs, n)``: one transform each."""
    from scipy.fft import fft, ifft, next_fast_len

    size = next_fast_len(watched.size + window.size - 1)
    rows = np.vstack([watched[None].astype(np.complex128), turned])
    first = (window.size - 1) // 2
    return np.asarray(ifft(fft(rows, size) * fft(window, size), size)[:, first : first + watched.size])


def _covered(window: FloatArray, samples: int) -> FloatArray:
    """Sum of the window inside the record at each position, shape ``(n,)``."""
    sums = np.concatenate([[0.0], np.cumsum(window)])
    last = np.arange(samples) + (window.size - 1) // 2
    return np.asarray(sums[np.minimum(last + 1, window.size)] - sums[np.maximum(last - samples + 1, 0)])
