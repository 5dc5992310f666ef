r"""What a motor with a lag makes of held outputs, between the samples too.

A motor takes its output :math:`u`, held from sample to sample and late by :math:`\tau`, with a first-order lag,

.. math:: T \dot x(t) = u(t - \tau) - x(t),

so that within a stretch of constant input :math:`x = u + (x_0 - u) e^{-t/T}`, and what thrust and torque need over a
sample, :math:`\int x \, dt` and :math:`\int x^2 \, dt`, has closed forms. Everything here is analytic in T and
:math:`\tau`: complex numbers pass, for exact derivatives by a complex step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotorid.typing import FloatArray

Lagged = NDArray[np.float64] | NDArray[np.complex128]


class Turning(NamedTuple):
    """Motors over a record.

    Parameters
    ----------
    level
        Lagged output at every sample, shape ``(motors, n)``.
    first, second
        Integrals of the lagged output and of its square from each sample to the next, shape ``(motors, n - 1)``.
    """

    level: Lagged
    first: Lagged
    second: Lagged


def turning(outputs: FloatArray, *, lag_s: complex, delay_s: complex, step_s: float) -> Turning:
    """Lagged and delayed outputs at the samples, and their integrals between them, exactly.

    Parameters
    ----------
    outputs
        Held from each sample to the next, shape ``(motors, n)``; before the first they stood as there.
    lag_s, delay_s
        Time constant, positive, and delay; complex ones for a complex step. A delay below zero, of stamps that do not
        belong together, needs outputs after the last one, which are taken to stand.
    step_s
        Time between samples.

    Examples
    --------
    >>> step = np.array([[0.0, 1.0, 1.0, 1.0]])
    >>> turning(step, lag_s=0.1, delay_s=0.05, step_s=0.1).level.round(4).tolist()
    [[0.0, 0.0, 0.3935, 0.7769]]
    """
    from scipy.signal import lfilter

    whole = int(np.floor(delay_s.real / step_s))
    rest = delay_s - whole * step_s
    decay = np.exp(-step_s / lag_s)
    first = outputs[:, :1]
    # Before the record begins all motors turn as at its first sample.
    samples = outputs.shape[1]
    held = outputs[:, np.clip(np.arange(samples + 1) - (whole + 1), 0, samples - 1)]
    reached = first + lfilter(np.array([0.0, 1.0 - decay]), np.array([1.0, -decay]), held - first, axis=1)
    # A sample of the late clock lies `rest` before one of the early clock.
    before, after = held[:, :-1], held[:, 1:]
    level = before + (reached[:, :-1] - before) * np.exp(-(step_s - rest) / lag_s)
    late = _integrals(level, before, rest, lag_s)
    early = _integrals(reached[:, 1:], after, step_s - rest, lag_s)
    one, two = (first_part + second_part for first_part, second_part in zip(late, early, strict=True))
    return Turning(level, one[:, :-1], two[:, :-1])


def _integrals(start: Lagged, held: FloatArray, span_s: complex, lag_s: complex) -> tuple[Lagged, Lagged]:
    """Integrals of the lagged output and of its square over a stretch in which the input stands."""
    left = np.exp(-span_s / lag_s)
    away = start - held
    once = lag_s * (1.0 - left) * away
    return held * span_s + once, held**2 * span_s + 2.0 * held * once + 0.5 * lag_s * (1.0 - left**2) * away**2
