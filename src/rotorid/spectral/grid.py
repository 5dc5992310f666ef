"""Frequency grids: what a grid must be, and one that is fine enough to see how a response bends."""

from __future__ import annotations

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import BoolArray, FloatArray

_LARGEST_STEP = 0.1
"""Of the logarithm of frequency. The slope of a response and the level of its noise are read off neighboring points;
seven of them then span a factor of two."""


def require_grid(omega_rad_s: FloatArray, sample_rate_hz: float) -> None:
    """Refuse a grid that is not a rising row of frequencies between zero and the Nyquist frequency.

    Raises
    ------
    UsageError
        It says which of these it is not.
    """
    if np.ndim(omega_rad_s) != 1:
        raise UsageError(f"a frequency grid of shape {np.shape(omega_rad_s)} came", needed="one row of frequencies")
    # Asked so that a grid with a NaN does not pass.
    if not omega_rad_s.size or not omega_rad_s[0] > 0.0 or not np.all(np.diff(omega_rad_s) > 0.0):
        raise UsageError("a frequency grid that does not rise came", needed="rising frequencies above zero")
    nyquist_rad_s = np.pi * sample_rate_hz
    if not omega_rad_s[-1] <= nyquist_rad_s:
        raise UsageError(
            f"a frequency of {omega_rad_s[-1]:.4g} rad/s came",
            needed=f"at most the Nyquist frequency of {nyquist_rad_s:.4g} rad/s",
            remedy="lower the upper end of the band",
        )


def refined(omega_rad_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """A grid with points between those that lie far apart, so that no answer depends on how coarse a grid was asked.

    Parameters
    ----------
    omega_rad_s
        Rising, above zero, shape ``(f,)``.

    Returns
    -------
    numpy.ndarray, numpy.ndarray
        The finer grid, and which of its points were asked for, both of shape ``(g,)`` with ``g >= f``.

    Examples
    --------
    >>> fine, asked = refined(np.array([1.0, 1.2, 1.25]))
    >>> fine.round(3).tolist(), asked.tolist()
    ([1.0, 1.095, 1.2, 1.25], [True, False, True, True])
    """
    intervals = np.ceil(np.diff(np.log(omega_rad_s)) / _LARGEST_STEP).astype(np.int64)
    place = np.concatenate([[0], np.cumsum(intervals)])
    fine = np.exp(np.interp(np.arange(place[-1] + 1), place, np.log(omega_rad_s)))
    asked = np.zeros(fine.size, dtype=bool)
    asked[place] = True
    fine[place] = omega_rad_s
    return fine, asked
