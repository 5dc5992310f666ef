"""Phases for display: unwrapped from a sensible branch, data and model on the same one."""

from __future__ import annotations

import numpy as np

from rotorid.typing import BoolArray, ComplexArray, FloatArray

_HIGHEST_ABOVE_SLOPE_DEG = 60.0
_LEAST_HIGHEST_DEG = -60.0
_LEAST_AGREEMENT = 0.75
_SMOOTHINGS = 4
_LEAST_RUN = 3
_ANCHOR_SHARE = 1.0 / 3.0


def unwrapped_deg(omega_rad_s: FloatArray, values: ComplexArray) -> FloatArray:
    r"""Unwrapped phase of a noiseless response in degrees, shape ``(f,)``, on the branch that its slope calls for.

    Without poles and zeros on the right, and without delay, a response whose magnitude goes as :math:`\omega^n` has
    the phase :math:`90° n` (Bode's relation). Lag and delay lower it, a reversed sign lowers it by 180°. So the lowest
    third of the points is put in the turn below :math:`90° n + 60°`, though never more than a turn below −60°: an
    integrator starts at −90°, two at −180°, three at −270° (reversed at −90°), a differentiator at +90° and a reversed
    gain at −180°.

    Assumes less than half a turn from point to point; a coarse grid breaks it.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    values
        Shape ``(f,)``; what is not finite stays a gap.

    References
    ----------
    Bode, H. W.: *Network Analysis and Feedback Amplifier Design*, 1945, chapter 14.

    Examples
    --------
    >>> omega = np.array([1.0, 2.0, 4.0])
    >>> unwrapped_deg(omega, 5.0 / (1j * omega) ** 3).round(0)
    array([-270., -270., -270.])
    """
    phase = np.full(values.shape, np.nan)
    good = np.isfinite(values) & (values != 0.0)
    if good.any():
        # A response that is exactly real may come with either sign of zero: round, so that both give one branch.
        turned = np.round(np.degrees(np.unwrap(np.angle(values[good]))), 9)
        phase[good] = turned + _branch_deg(omega_rad_s[good], values[good], turned)
    return phase


def near_deg(values: ComplexArray, reference_deg: FloatArray) -> FloatArray:
    """Phase in degrees on the branch that is nearest to a reference, shape ``(f,)``.

    Examples
    --------
    >>> near_deg(np.array([-1.0 + 0.01j]), np.array([-170.0])).round(0)
    array([-181.])
    """
    phase = np.degrees(np.angle(values))
    return phase + 360.0 * np.round((np.nan_to_num(reference_deg) - phase) / 360.0)


def reference_deg(omega_rad_s: FloatArray, values: ComplexArray, trusted: BoolArray) -> FloatArray:
    """A phase to lean on when there is no model, shape ``(f,)``.

    Trusted points whose neighbors turn as they do are unwrapped, the others are interpolated between them and held
    beyond them. The branch is that of ``unwrapped_deg``, found in the longest steady run alone: noise at the ends of a
    band moves neither it nor the middle. Noise that breaks the middle into pieces can shift them by whole turns.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    values
        Measured response, shape ``(f,)``.
    trusted
        Points that may decide, shape ``(f,)``; all of them where nothing is known.
    """
    good = trusted & np.isfinite(values) & (values != 0.0)
    if not good.any():
        return np.zeros(omega_rad_s.size)
    index = np.flatnonzero(good)
    steady = _steady(values[index])
    index = index[steady] if steady.any() else index
    turned = np.degrees(np.unwrap(np.angle(values[index])))
    # The longest run without a hole of several points decides; a point or two may be missing in it.
    home = max(np.split(np.arange(index.size), np.flatnonzero(np.diff(index) > _LEAST_RUN) + 1), key=len)
    turned += _branch_deg(omega_rad_s[index[home]], values[index[home]], turned[home])
    return np.interp(np.log(omega_rad_s), np.log(omega_rad_s[index]), turned)


def _steady(values: ComplexArray) -> BoolArray:
    """Points in runs where the turn from point to point is like that of the neighbors: noise turns anyhow."""
    if values.size < 2 * _LEAST_RUN:
        return np.ones(values.size, dtype=bool)
    unit = values / np.abs(values)
    turn = unit[1:] * unit[:-1].conj()
    for _ in range(_SMOOTHINGS):
        # Weights of 1, 2, 1: their mean keeps the direction of any constant turn.
        padded = np.concatenate((turn[:1], turn, turn[-1:]))
        turn = (padded[:-2] + 2.0 * padded[1:-1] + padded[2:]) / 4.0
    agreed = np.abs(turn) >= _LEAST_AGREEMENT
    both = np.concatenate(([True], agreed)) & np.concatenate((agreed, [True]))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], both, [False])).astype(int))).reshape(-1, 2)
    steady = np.zeros(values.size, dtype=bool)
    for start, stop in edges.tolist():
        steady[start:stop] = stop - start >= _LEAST_RUN
    return steady


def _branch_deg(omega_rad_s: FloatArray, values: ComplexArray, turned_deg: FloatArray) -> float:
    """Whole turns to add to an unwrapped phase, so that it fits the slope of its magnitude at low frequency."""
    low = slice(0, max(int(np.ceil(omega_rad_s.size * _ANCHOR_SHARE)), min(2, omega_rad_s.size)))
    slope = 0.0
    if omega_rad_s[low].size > 1:
        slope = float(np.polyfit(np.log(omega_rad_s[low]), np.log(np.abs(values[low])), 1)[0])
    highest = max(90.0 * slope + _HIGHEST_ABOVE_SLOPE_DEG, _LEAST_HIGHEST_DEG)
    return 360.0 * float(np.floor((highest - np.median(turned_deg[low])) / 360.0))
