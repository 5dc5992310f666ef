r"""What a motor with a lag makes of held outputs, between the samples too.

A motor takes its output :math:`u`, held from sample to sample and late by :math:`\tau`, with a first-order lag,

.. math:: T \dot x(t) = u(t - \tau) - x(t),

so that within a stretch of constant input :math:`x = u + (x_0 - u) e^{-t/T}`, and what thrust and torque need over a
sample, :math:`\int x \, dt` and :math:`\int x^2 \, dt`, has closed forms. Everything here is analytic in T and
:math:`\tau`: complex numbers pass, for exact derivatives by a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotorid.typing import FloatArray

Lagged = NDArray[np.float64] | NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Turning:
    """Motors over a record.

    Parameters
    ----------
    level
        Lagged output at every sample, shape ``(motors, n)``.
    stretches
        Two for each sample, before and after the input changes: lagged output at their start, the input that stands,
        their length and the lag.
    """

    level: Lagged
    stretches: tuple[_Stretch, _Stretch]

    @cached_property
    def first(self) -> Lagged:
        """Integral of the lagged output from each sample to the next, shape ``(motors, n - 1)``."""
        late, early = (one.held * one.span_s + one.once for one in self.stretches)
        return (late + early)[:, :-1]

    @cached_property
    def second(self) -> Lagged:
        """Integral of its square, shape ``(motors, n - 1)``."""
        late, early = (one.squared for one in self.stretches)
        return (late + early)[:, :-1]


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A time in which the input stands."""

    start: Lagged
    held: FloatArray
    span_s: complex
    lag_s: complex

    @cached_property
    def once(self) -> Lagged:
        """Integral of what is left of the step to the input."""
        once: Lagged = self.lag_s * (1.0 - np.exp(-self.span_s / self.lag_s)) * (self.start - self.held)
        return once

    @property
    def squared(self) -> Lagged:
        left = np.exp(-2.0 * self.span_s / self.lag_s)
        away = 0.5 * self.lag_s * (1.0 - left) * (self.start - self.held) ** 2
        squared: Lagged = self.held**2 * self.span_s + 2.0 * self.held * self.once + away
        return squared


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
    return Turning(level, (_Stretch(level, before, rest, lag_s), _Stretch(reached[:, 1:], after, step_s - rest, lag_s)))
