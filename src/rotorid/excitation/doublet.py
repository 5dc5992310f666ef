"""Doublets and multisteps: short maneuvers that a model has not seen, for verification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray


def multistep(
    widths: Sequence[float], *, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0
) -> FloatArray:
    """Steps of alternating sign.

    Parameters
    ----------
    widths
        Length of each step in units: ``(1, 1)`` is a doublet, ``(3, 2, 1, 1)`` the classic multistep, which spreads
        its energy over a wider band than a doublet of the same length.
    amplitude
        Height of the first step, in the unit of what is excited; negative begins the other way.
    unit_s
        Length of one unit. The energy of a doublet peaks near :math:`2.3 / unit` rad/s.
    sample_rate_hz
        Rate of the returned samples.
    trim_s
        Zeros before and after.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``.

    Raises
    ------
    UsageError
        A step is shorter than one sample.

    Examples
    --------
    >>> multistep((2, 1), amplitude=1.0, unit_s=0.1, sample_rate_hz=10.0, trim_s=0.1)
    array([ 0.,  1.,  1., -1.,  0.])
    """
    # Edges are rounded, not widths, so that the errors of rounding do not add up.
    edges = np.round(np.concatenate([[0.0], np.cumsum(widths)]) * unit_s * sample_rate_hz).astype(np.int64)
    if edges.size < 2 or np.diff(edges).min() < 1:
        raise UsageError(
            f"steps of {list(widths)} times {unit_s:g} s at {sample_rate_hz:g} Hz",
            needed="steps of at least one sample",
            remedy="lengthen the unit or raise the sample rate",
        )
    signs = np.where(np.arange(edges.size - 1) % 2 == 0, 1.0, -1.0)
    return np.pad(np.repeat(amplitude * signs, np.diff(edges)), round(trim_s * sample_rate_hz))


def doublet(*, amplitude: float, pulse_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """One step and its opposite, each ``pulse_s`` long; see :func:`multistep`.

    Examples
    --------
    >>> doublet(amplitude=0.2, pulse_s=0.2, sample_rate_hz=10.0, trim_s=0.1)
    array([ 0. ,  0.2,  0.2, -0.2, -0.2,  0. ])
    """
    return multistep((1, 1), amplitude=amplitude, unit_s=pulse_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)


def three_two_one_one(*, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """The 3-2-1-1 of flight test, ``7 unit_s`` long; see :func:`multistep`.

    It holds its first sign for one unit more than the other, so an unstable vehicle ends away from trim.

    Examples
    --------
    >>> three_two_one_one(amplitude=1.0, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    array([ 1.,  1.,  1., -1., -1.,  1., -1.])
    """
    return multistep((3, 2, 1, 1), amplitude=amplitude, unit_s=unit_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)
