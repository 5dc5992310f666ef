"""Doublets and multisteps: short maneuvers that a model has not seen, for verification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray

BALANCED_HEIGHTS = (2.0 / 3.0, 1.0, 11.0 / 12.0, 11.0 / 12.0)
"""Heights 0.8, 1.2, 1.1, 1.1 of a 3-2-1-1 over the largest: as much area above zero as below."""


def multistep(
    widths: Sequence[float],
    *,
    amplitude: float,
    unit_s: float,
    sample_rate_hz: float,
    trim_s: float = 1.0,
    heights: Sequence[float] | None = None,
) -> FloatArray:
    """Steps of alternating sign.

    Parameters
    ----------
    widths
        Length of each step in units: ``(1, 1)`` is a doublet, ``(3, 2, 1, 1)`` the classic multistep, which spreads
        its energy over a wider band than a doublet of the same length.
    amplitude
        Height of the steps, in the unit of what is excited; negative begins the other way.
    unit_s
        Length of one unit. The energy of a doublet peaks near :math:`2.3 / unit` rad/s.
    sample_rate_hz
        Rate of the returned samples.
    trim_s
        Zeros before and after.
    heights
        Height of each step over the amplitude; all one by default.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``.

    Raises
    ------
    UsageError
        A step is shorter than one sample, or there are not as many heights as steps.

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
    if heights is not None and len(heights) != len(widths):
        raise UsageError(f"{len(heights)} heights came for {len(widths)} steps", needed="one for each")
    signs = np.where(np.arange(edges.size - 1) % 2 == 0, 1.0, -1.0)
    levels = amplitude * signs * (1.0 if heights is None else np.asarray(heights))
    return np.pad(np.repeat(levels, np.diff(edges)), round(trim_s * sample_rate_hz))


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


def balanced_three_two_one_one(
    *, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0
) -> FloatArray:
    """A 3-2-1-1 of unequal heights, whose area above zero is that below; see :func:`multistep`.

    What integrates the input comes back to where it was. The amplitude is the height of the highest step, the second.

    References
    ----------
    Jategaonkar, *Flight Vehicle System Identification*, 2nd edition, 2015, on multistep inputs.

    Examples
    --------
    >>> values = balanced_three_two_one_one(amplitude=1.2, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    >>> values.round(12).tolist()
    [0.8, 0.8, 0.8, -1.2, -1.2, 1.1, -1.1]
    """
    return multistep(
        (3, 2, 1, 1),
        amplitude=amplitude,
        unit_s=unit_s,
        sample_rate_hz=sample_rate_hz,
        trim_s=trim_s,
        heights=BALANCED_HEIGHTS,
    )


def two_one_one(*, amplitude: float, unit_s: float, sample_rate_hz: float, trim_s: float = 1.0) -> FloatArray:
    """The 2-1-1 of flight test, ``4 unit_s`` long; see :func:`multistep`.

    Shorter than a 3-2-1-1, and it reaches lower in frequency than a doublet of the same unit. It holds its first sign
    for two units more than the other.

    References
    ----------
    Morelli and Klein, *Aircraft System Identification*, 2nd edition, 2016, chapter 9.

    Examples
    --------
    >>> two_one_one(amplitude=1.0, unit_s=1.0, sample_rate_hz=1.0, trim_s=0.0)
    array([ 1.,  1., -1.,  1.])
    """
    return multistep((2, 1, 1), amplitude=amplitude, unit_s=unit_s, sample_rate_hz=sample_rate_hz, trim_s=trim_s)
