r"""Whether an excitation repeats, as a multisine does, and which lines it then has.

A signal of period :math:`T` is its own copy one period later,

.. math:: r(\tau) = \frac{\int x(t) \, x(t + \tau) \, dt}{\sqrt{\int x^2(t) \, dt \int x^2(t + \tau) \, dt}}, \qquad
    r(T) = 1

over the time in which both are there. A command that contains feedback repeats only in part, a test input exactly.
"""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

_ALIKE = 0.95
_UNLIKE = 0.5
_LEAST_PERIODS = 1.9
_LEAST_LINE = 0.02
_FEWEST_LINES = 3


def period_of(time_s: FloatArray, motion: FloatArray, *, shortest_s: float) -> float | None:
    """Period of a signal that repeats at least once; ``None`` for one that does not.

    Parameters
    ----------
    time_s, motion
        One active interval, shapes ``(samples,)``; the stamps may jitter.
    shortest_s
        Shorter periods are those of a sine and of steps.

    Examples
    --------
    >>> t = np.arange(0.0, 40.0, 0.02)
    >>> wave = np.sin(0.7 * np.pi * t) + np.sin(1.1 * np.pi * t + 1.0) + np.sin(1.9 * np.pi * t + 2.0)
    >>> period_of(t, wave, shortest_s=5.0)
    20.0
    """
    step_s = float(np.median(np.diff(time_s)))
    grid = np.arange(time_s[0], time_s[-1], step_s)
    values = np.interp(grid, time_s, motion)
    values = values - values.mean()
    shift = _normalized(values)
    first, last = int(shortest_s / step_s), int(grid.size / _LEAST_PERIODS)
    dips = np.flatnonzero(shift[:last] < _UNLIKE)
    begin = max(first, int(dips[0]) if dips.size else last)
    alike = np.flatnonzero(shift[begin:last] > _ALIKE)
    if not alike.size:
        return None
    # The first stretch that is alike, at its best place.
    stop = begin + int(alike[0])
    while stop + 1 < last and shift[stop + 1] > _ALIKE:
        stop += 1
    best = begin + int(alike[0]) + int(np.argmax(shift[begin + int(alike[0]) : stop + 1]))
    return round(best * step_s, 9)


def lines_of(time_s: FloatArray, motion: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Lowest and highest line of a signal of known period, rad/s; ``None`` for fewer than three lines."""
    step_s = float(np.median(np.diff(time_s)))
    samples = round(period_s / step_s)
    periods = int((time_s[-1] - time_s[0]) / period_s)
    grid = time_s[0] + np.arange(samples * max(periods, 1)) * step_s
    whole = np.interp(grid, time_s, motion).reshape(-1, samples).mean(axis=0)
    size = np.abs(np.fft.rfft(whole - whole.mean()))
    lines = np.flatnonzero(size > _LEAST_LINE * size.max())
    if lines.size < _FEWEST_LINES:
        return None
    line_rad_s = 2.0 * np.pi / period_s
    return float(lines[0] * line_rad_s), float(lines[-1] * line_rad_s)


def _normalized(values: FloatArray) -> FloatArray:
    """Correlation of a signal with itself by the shift in samples, over the samples that both have."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = values.size
    length = int(next_fast_len(2 * size, real=True))
    product = irfft(np.abs(rfft(values, length)) ** 2, length)[:size]
    energy = np.concatenate([[0.0], np.cumsum(values**2)])
    kept = np.arange(size)
    early, late = energy[size - kept], energy[size] - energy[kept]
    scale = np.sqrt(early * late)
    return np.asarray(np.divide(product, scale, out=np.zeros(size), where=scale > 1e-12 * energy[size]))
