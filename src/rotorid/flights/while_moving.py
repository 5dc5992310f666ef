"""Mean of a quantity weighted by the motion of an input at each frequency.

A sweep takes its frequencies one after the other, and what changes meanwhile, the mean thrust or how far the vehicle
leans, is another one for each of them.
"""

from __future__ import annotations

import math
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
        # One room for all frequencies: to ask for memory costs more than to calculate in it.
        room = np.empty((2, 3, 1 + inputs, part.values.size + 1), dtype=np.complex128)
        for place, omega in enumerate(grid.tolist()):
            rate_hz, watched, moved = part.coarser(omega)
            length_s = max(_PERIODS * 2.0 * np.pi / omega, _SHORTEST_S)
            window = np.hanning(min(int(length_s * rate_hz), watched.size) + 2)[1:-1]
            rows, sums = room[0, ..., : watched.size], room[1, ..., : watched.size + 1]
            rows[0, 0] = watched
            np.multiply(moved, _turning(omega / rate_hz, watched.size), out=rows[0, 1:])
            mean, *swings = _slid(rows, sums, window.size)
            swing = np.array([turned.real**2 + turned.imag**2 for turned in swings]) / window.sum() ** 2
            power[:, place] += swing.sum(axis=1) / rate_hz
            weighted[:, place] += (swing * transform(mean.real / _covered(window, watched.size))).sum(axis=1) / rate_hz
    means = np.divide(weighted, power, out=np.zeros_like(power), where=power > 0.0)
    return np.array([np.interp(np.log(omega_rad_s), np.log(grid), row) for row in means])


def _slid(rows: ComplexArray, sums: ComplexArray, length: int) -> ComplexArray:
    """Sums of the rows ``rows[0]`` under a Hann window of ``length`` samples sliding over them, in their place.

    The window is a constant and two exponentials, and a sum between two moments the difference of two running sums.

    Parameters
    ----------
    rows, sums
        Room for the products with these three and for their running sums, shapes ``(3, k, n)`` and ``(3, k, n + 1)``.
    """
    count, ahead = rows.shape[-1], (length - 1) // 2
    behind, line = length - 1 - ahead, 2.0 * np.pi / (length + 1)
    turn = _turning(line, count)
    back = turn.conj()
    np.multiply(rows[0], turn, out=rows[1])
    np.multiply(rows[0], back, out=rows[2])
    sums[..., 0] = 0.0
    np.cumsum(rows, axis=-1, out=sums[..., 1:])
    rows[..., : count - ahead] = sums[..., ahead + 1 :]
    rows[..., count - ahead :] = sums[..., -1:]
    rows[..., behind:] -= sums[..., : count - behind]
    turn *= -0.25 * np.exp(-1j * line * (ahead + 1))
    back *= -0.25 * np.exp(1j * line * (ahead + 1))
    rows[0] *= 0.5
    rows[0] += np.multiply(rows[1], back, out=rows[1])
    rows[0] += np.multiply(rows[2], turn, out=rows[2])
    slid: ComplexArray = rows[0]
    return slid


def _turning(angle: float, count: int) -> ComplexArray:
    """Turns by an angle from each sample to the next, ``exp(-j angle n)``, shape ``(n,)``: an outer product."""
    width = math.isqrt(count) + 1
    coarse = np.exp(-1j * angle * width * np.arange(-(-count // width)))
    return np.asarray((coarse[:, None] * np.exp(-1j * angle * np.arange(width))).ravel()[:count])


def _covered(window: FloatArray, samples: int) -> FloatArray:
    """Sum of the window inside the record at each position, shape ``(n,)``."""
    sums = np.concatenate([[0.0], np.cumsum(window)])
    last = np.arange(samples) + (window.size - 1) // 2
    return np.asarray(sums[np.minimum(last + 1, window.size)] - sums[np.maximum(last - samples + 1, 0)])
