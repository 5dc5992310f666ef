"""Exact discretization of a linear system whose sampled inputs arrive late by any fraction of a sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.typing import FloatArray, IntArray

Hold: TypeAlias = Literal["zero", "first"]
"""How an input goes on between its samples: constant until the next one, or straight to it."""

# A delay given in seconds meets a whole sample only up to rounding.
WHOLE_SAMPLE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Discretized:
    r"""A step of a system with delayed inputs, exactly.

    .. math:: x_{k+1} = \Phi x_k + \sum_i \sum_{j=0}^{2} \Gamma_{j,i} \, u_{i,\,k-n_i-1+j}, \qquad
        u_i(t_k - \tau_i) = \sum_{j=0}^{1} w_{j,i} \, u_{i,\,k-n_i-1+j}

    Parameters
    ----------
    transition
        :math:`\Phi`, shape ``(x, x)``.
    taps
        :math:`\Gamma`, shape ``(3, u, x)``, oldest sample first.
    weights
        :math:`w`, shape ``(2, u)``.
    lags
        :math:`n`, whole samples of delay, shape ``(u,)``.
    """

    transition: FloatArray
    taps: FloatArray
    weights: FloatArray
    lags: IntArray

    def forcing(self, u: FloatArray, past: FloatArray) -> FloatArray:
        """What the inputs add to the state in each step, shape ``(samples, x)``.

        Parameters
        ----------
        u
            Inputs, shape ``(u, samples)``. Beyond the last sample the last one stands.
        past
            Inputs before the first sample, shape ``(u,)``.
        """
        terms = (self.shifted(u, past, tap).T @ self.taps[tap] for tap in range(3))
        total: FloatArray = sum(terms, start=np.zeros((u.shape[1], self.taps.shape[2])))
        return total

    def delayed(self, u: FloatArray, past: FloatArray) -> FloatArray:
        """The late inputs at the sample instants, shape ``(u, samples)``."""
        late: FloatArray = sum(
            (self.weights[tap, :, None] * self.shifted(u, past, tap) for tap in range(2)), start=np.zeros_like(u)
        )
        return late

    def shifted(self, u: FloatArray, past: FloatArray, tap: int) -> FloatArray:
        """The samples of each input that a tap weighs in every step, shape ``(u, samples)``."""
        late = np.empty_like(u)
        for row, values, first, lag in zip(late, u, past, self.lags + 1 - tap, strict=True):
            # A lag of -1 is the sample at the end of the step, which a first-order hold goes to.
            kept = values[max(-lag, 0) : max(values.size - lag, 0)]
            ahead = min(max(lag, 0), values.size)
            row[:ahead] = first
            row[ahead : ahead + kept.size] = kept
            row[ahead + kept.size :] = values[-1]
        return late


def discretize(A: FloatArray, B: FloatArray, *, delays_s: FloatArray, step_s: float, hold: Hold) -> Discretized:
    r"""Discretize :math:`\dot x = A x + B u(t - \tau)` exactly between the samples.

    A delay of :math:`(n + f)` samples moves the corner of the held input to the fraction f of every step; the integral
    is taken exactly on both sides of it.

    Parameters
    ----------
    A, B
        Shapes ``(x, x)`` and ``(x, u)``.
    delays_s
        Shape ``(u,)``, not negative.
    step_s
        Sample interval.
    hold
        ``zero`` keeps each sample until the next, which is what an autopilot's output does; ``first`` interpolates
        linearly, which is right for samples of a smooth signal. With ``first`` the state after a step depends on
        the sample at its end, unless the delay is at least one step.
    """
    from scipy.linalg import expm

    order, inputs = B.shape
    delays = np.asarray(delays_s, dtype=np.float64) / step_s
    lags = np.floor(delays + WHOLE_SAMPLE).astype(np.int64)
    fractions = np.maximum(delays - lags, 0.0)
    fractions[fractions < WHOLE_SAMPLE] = 0.0
    taps = np.empty((3, inputs, order))
    for i, fraction in enumerate(fractions):
        column = B[:, [i]]
        _, before, ramp_before = _integrals(A, column, fraction * step_s)
        onward, after, ramp_after = _integrals(A, column, (1.0 - fraction) * step_s)
        ramp_before, ramp_after = ramp_before / step_s, ramp_after / step_s
        if hold == "zero":
            taps[:, i] = onward @ before, after, np.zeros(order)
        else:
            oldest = onward @ (fraction * before - ramp_before)
            middle = onward @ ((1.0 - fraction) * before + ramp_before) + after - ramp_after
            taps[:, i] = oldest, middle, ramp_after
    # The value at a jump is the one just after it: a held sample counts from its own instant on.
    older = (fractions > 0.0).astype(np.float64) if hold == "zero" else fractions
    return Discretized(transition=expm(A * step_s), taps=taps, weights=np.stack([older, 1.0 - older]), lags=lags)


def _integrals(A: FloatArray, column: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    r""":math:`e^{AT}`, :math:`\int_0^T e^{A(T-s)} b \, ds` and :math:`\int_0^T e^{A(T-s)} b s \, ds`.

    All three are blocks of one matrix exponential (Van Loan, *Computing Integrals Involving the Matrix Exponential*,
    IEEE Transactions on Automatic Control, 1978).
    """
    from scipy.linalg import expm

    order = A.shape[0]
    block = np.zeros((order + 2, order + 2))
    block[:order, :order] = A
    block[:order, [order]] = column
    block[order, order + 1] = 1.0
    exponential = expm(block * time_s)
    return exponential[:order, :order], exponential[:order, order], exponential[:order, order + 1]
