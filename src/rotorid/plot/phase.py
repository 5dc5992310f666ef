"""Phases for display: unwrapped from a sensible branch, data and model on the same one."""

from __future__ import annotations

import numpy as np

from rotorid.typing import BoolArray, ComplexArray, FloatArray

_LOWEST_START_DEG = -270.0


def unwrapped_deg(values: ComplexArray) -> FloatArray:
    """Unwrapped phase in degrees, shape ``(f,)``; the first finite point lies in −270° ≤ φ < 90°.

    That branch writes an integrator as −90°, a reversed gain as −180° and a differentiator as +90° minus its lag, as
    an engineer would. Assumes less than half a turn from point to point; noise or a coarse grid breaks it.

    Examples
    --------
    >>> unwrapped_deg(np.exp(1j * np.array([3.0, 3.1, 3.2]))).round(0)
    array([-188., -182., -177.])
    """
    phase = np.full(values.shape, np.nan)
    good = np.isfinite(values)
    if good.any():
        # A response that is exactly real may come with either sign of zero: round, so that both give one branch.
        turn = np.round(np.degrees(np.unwrap(np.angle(values[good]))), 9)
        phase[good] = turn - 360.0 * np.floor((turn[0] - _LOWEST_START_DEG) / 360.0)
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
    """A phase to lean on when there is no model: trusted points unwrapped, the others interpolated between them."""
    good = trusted & np.isfinite(values)
    if not good.any():
        return np.zeros(omega_rad_s.size)
    return np.interp(np.log(omega_rad_s), np.log(omega_rad_s[good]), unwrapped_deg(values[good]))
