"""Least and greatest values of a channel over spans of samples, so that any zoom is drawn from a few points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.typing import FloatArray

_FACTOR = 4


@dataclass(frozen=True, eq=False)
class Pyramid:
    """A channel with its coarser levels, each of which joins four spans of the one before.

    Parameters
    ----------
    time_s, values
        The samples, of shape ``(samples,)``; ``time_s`` increases.
    extremes
        What :func:`extremes_of` makes of the values.
    """

    time_s: FloatArray
    values: FloatArray
    extremes: FloatArray

    def view(self, start_s: float, stop_s: float, points: int) -> tuple[FloatArray, FloatArray]:
        """Times and values to draw between two times: the samples themselves, or extremes of spans.

        Every value between the extremes of a span of the picture is drawn as the span, so that no peak is lost.

        Examples
        --------
        >>> time = np.arange(1000.0)
        >>> values = np.where(time == 503.0, 9.0, 0.0)
        >>> x, y = Pyramid(time, values, extremes_of(values)).view(0.0, 999.0, 20)
        >>> bool(y.max() == 9.0), x.size <= 80
        (True, True)
        """
        first = max(int(np.searchsorted(self.time_s, start_s)) - 1, 0)
        last = min(int(np.searchsorted(self.time_s, stop_s, side="right")) + 1, self.time_s.size)
        sizes = _sizes(self.time_s.size)
        level, width = 0, 1
        while (last - first) / width > 2 * points and level < len(sizes):
            level, width = level + 1, width * _FACTOR
        if level == 0:
            return self.time_s[first:last], self.values[first:last]
        spans = np.arange(first // width, -(-last // width))
        begin = np.minimum(spans * width, self.time_s.size - 1)
        middle = np.minimum(spans * width + width // 2, self.time_s.size - 1)
        x = np.stack([self.time_s[begin], self.time_s[middle]], axis=1).ravel()
        return x, self.extremes[:, sum(sizes[: level - 1]) + spans].T.ravel()


def extremes_of(values: FloatArray) -> FloatArray:
    """Least and greatest values of all levels, of shape ``(2, spans)``, the finest level first.

    Values that are not finite are no part of a span.
    """
    low = high = np.where(np.isfinite(values), values, np.nan)
    levels = [np.empty((2, 0))]
    for _ in _sizes(values.size):
        low, high = _joined(low, np.fmin), _joined(high, np.fmax)
        levels.append(np.stack([low, high]))
    return np.concatenate(levels, axis=1)


def _sizes(samples: int) -> list[int]:
    """Spans of each level."""
    sizes: list[int] = []
    while samples > 2 * _FACTOR:
        samples = -(-samples // _FACTOR)
        sizes.append(samples)
    return sizes


def _joined(values: FloatArray, join: np.ufunc) -> FloatArray:
    padding = -values.size % _FACTOR
    padded = np.concatenate([values, np.full(padding, np.nan)])
    joined: FloatArray = join.reduce(padded.reshape(-1, _FACTOR), axis=1)
    return joined
