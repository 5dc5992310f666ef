"""The recursion of lagged motors. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import FloatArray


@njit(cache=True, nogil=True)
def lagged(
    outputs: FloatArray, whole: int, rest_s: float, lag_s: float, step_s: float, moved: bool, integrals: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lagged outputs at the samples, and integrals of them and of their squares from each sample to the next.

    The outputs ``(motors, n)`` are held for a step and late by ``whole`` steps and a rest; before the first and after
    the last they stand. Levels are ``(kinds, motors, n)``, integrals ``(kinds, motors, n - 1)``, or of no motor where
    they are not wanted: first the values, and if ``moved`` their derivatives by the lag and by the delay.
    """
    motors, samples = outputs.shape
    kinds, summed = 3 if moved else 1, motors if integrals else 0
    level = np.empty((kinds, motors, samples))
    first = np.empty((kinds, summed, samples - 1))
    second = np.empty((kinds, summed, samples - 1))
    span_s = step_s - rest_s
    decay, early, late = np.exp(-step_s / lag_s), np.exp(-rest_s / lag_s), np.exp(-span_s / lag_s)
    # Integrals of the remaining step to the input, and of its square, while the input is constant.
    once_early, once_late = lag_s * (1.0 - early), lag_s * (1.0 - late)
    twice_early, twice_late = 0.5 * lag_s * (1.0 - early**2), 0.5 * lag_s * (1.0 - late**2)
    decay_by_lag = decay * step_s / lag_s**2
    early_by_lag, late_by_lag = early * rest_s / lag_s**2, late * span_s / lag_s**2
    once_early_by_lag, once_late_by_lag = (1.0 - early) - lag_s * early_by_lag, (1.0 - late) - lag_s * late_by_lag
    twice_early_by_lag = 0.5 * (1.0 - early**2) - lag_s * early * early_by_lag
    twice_late_by_lag = 0.5 * (1.0 - late**2) - lag_s * late * late_by_lag
    for i in range(motors):
        # Before the record begins all motors turn as at its first sample.
        reached, reached_by_lag = outputs[i, 0], 0.0
        for k in range(samples):
            before = outputs[i, min(max(k - whole - 1, 0), samples - 1)]
            after = outputs[i, min(max(k - whole, 0), samples - 1)]
            # A sample of the clock of the inputs is `rest` before one of the record.
            gap = reached - before
            here = before + gap * late
            following = before + gap * decay
            left, begun = here - before, following - after
            level[0, i, k] = here
            if moved:
                here_by_lag = reached_by_lag * late + gap * late_by_lag
                here_by_delay = gap * late / lag_s
                following_by_lag = reached_by_lag * decay + gap * decay_by_lag
                level[1, i, k] = here_by_lag
                level[2, i, k] = here_by_delay
            if integrals and k < samples - 1:
                in_early, in_late = once_early * left, once_late * begun
                first[0, i, k] = before * rest_s + in_early + after * span_s + in_late
                second[0, i, k] = (
                    before * (before * rest_s + 2.0 * in_early)
                    + twice_early * left**2
                    + after * (after * span_s + 2.0 * in_late)
                    + twice_late * begun**2
                )
                if moved:
                    early_1 = once_early_by_lag * left + once_early * here_by_lag
                    late_1 = once_late_by_lag * begun + once_late * following_by_lag
                    first[1, i, k] = early_1 + late_1
                    second[1, i, k] = (
                        2.0 * (before * early_1 + after * late_1)
                        + twice_early_by_lag * left**2
                        + twice_late_by_lag * begun**2
                        + 2.0 * (twice_early * left * here_by_lag + twice_late * begun * following_by_lag)
                    )
                    # A longer delay makes the early stretch longer, and the late one as much shorter.
                    early_2 = early * left + once_early * here_by_delay
                    late_2 = -late * begun
                    first[2, i, k] = before + early_2 - after + late_2
                    second[2, i, k] = (
                        before * (before + 2.0 * early_2)
                        + left * (early**2 * left + 2.0 * twice_early * here_by_delay)
                        - after * (after - 2.0 * late_2)
                        - late**2 * begun**2
                    )
            reached = following
            if moved:
                reached_by_lag = following_by_lag
    return level, first, second
