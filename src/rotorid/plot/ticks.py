"""Where the axes of a Bode plot carry numbers, for a screen and for paper alike."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

NARROWEST_DB = 10.0
"""A magnitude axis spans at least this much, so that a flat response looks flat."""

_WIDE_DECADES = 1.3
_PHASE_STEPS_DEG = ((60.0, 15), (130.0, 30), (300.0, 45), (600.0, 90), (1200.0, 180))
_LONGEST_STEP_DEG = 360


def frequency_ticks(omega_rad_s: FloatArray) -> list[float]:
    """Round frequencies around a grid: 1, 2, 5 of each decade, and more where the grid spans little over one.

    Examples
    --------
    >>> frequency_ticks(np.array([1.0, 100.0]))
    [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    """
    low, high = float(omega_rad_s.min()), float(omega_rad_s.max())
    steps = (1.0, 2.0, 5.0) if high > low * 10.0**_WIDE_DECADES else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [float(f"{step * 10.0**power:.2g}") for power in powers for step in steps]
    return [tick for tick in ticks if 0.8 * low <= tick <= 1.25 * high]


def phase_step_deg(span_deg: float) -> int:
    """Distance of phase ticks: parts or multiples of a right angle, four to seven of them.

    Examples
    --------
    >>> phase_step_deg(80.0), phase_step_deg(400.0)
    (30, 90)
    """
    return next((step for limit, step in _PHASE_STEPS_DEG if span_deg < limit), _LONGEST_STEP_DEG)


def magnitude_range_db(shown_db: FloatArray) -> tuple[float, float] | None:
    """Range of a magnitude axis whose data span too little to fill it, otherwise ``None``.

    Examples
    --------
    >>> magnitude_range_db(np.array([22.0, 23.0, np.nan]))
    (17.5, 27.5)
    """
    finite = shown_db[np.isfinite(shown_db)]
    if not finite.size or np.ptp(finite) >= NARROWEST_DB:
        return None
    middle = float(finite.min() + finite.max()) / 2.0
    return middle - NARROWEST_DB / 2.0, middle + NARROWEST_DB / 2.0
