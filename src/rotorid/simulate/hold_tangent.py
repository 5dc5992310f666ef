"""Exact discretization of a system with delayed inputs, with its exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.simulate.exponential import exponential_tangent
from rotorid.simulate.hold import WHOLE_SAMPLE, Discretized, Hold
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscretizedTangent:
    r"""How a :class:`rotorid.simulate.hold.Discretized` moves along directions of the parameters.

    Parameters
    ----------
    transition
        Derivatives of :math:`\Phi`, shape ``(p, x, x)``.
    taps
        Derivatives of :math:`\Gamma`, shape ``(p, 3, u, x)``.
    weights
        Derivatives of :math:`w`, shape ``(p, 2, u)``. A zero-order hold jumps; between two jumps they are zero.
    """

    transition: FloatArray
    taps: FloatArray
    weights: FloatArray


def discretize_tangent(
    A: FloatArray,
    B: FloatArray,
    dA: FloatArray,
    dB: FloatArray,
    *,
    delays_s: FloatArray,
    ddelays_s: FloatArray,
    step_s: float,
    hold: Hold,
) -> tuple[Discretized, DiscretizedTangent]:
    r"""Discretize :math:`\dot x = A x + B u(t - \tau)` exactly, as :func:`rotorid.simulate.hold.discretize` does.

    A delay moves the corner of the held input within a step; the integrals on both sides of it are differentiated with
    respect to their lengths, so that the derivative with respect to a delay is exact for any fraction of a sample.

    Parameters
    ----------
    A, B
        Shapes ``(x, x)`` and ``(x, u)``.
    dA, dB
        Their derivatives, shapes ``(p, x, x)`` and ``(p, x, u)``.
    delays_s, ddelays_s
        Delays, shape ``(u,)``, not negative, and their derivatives, shape ``(p, u)``.
    step_s
        Sample interval.
    hold
        What the inputs do between their samples.

    Returns
    -------
    Discretized
        The step.
    DiscretizedTangent
        Its derivatives.
    """
    directions, (order, inputs) = len(dA), B.shape
    delays = np.asarray(delays_s, dtype=np.float64) / step_s
    lags = np.floor(delays + WHOLE_SAMPLE).astype(np.int64)
    fractions = np.maximum(delays - lags, 0.0)
    fractions[fractions < WHOLE_SAMPLE] = 0.0
    transition, moving = exponential_tangent(A * step_s, dA * step_s)
    taps, slopes = np.empty((3, inputs, order)), np.empty((directions, 3, inputs, order))
    for i, fraction in enumerate(fractions):
        step = _Step(A=A, b=B[:, i], dA=dA, db=dB[:, :, i], step_s=step_s, dfraction=ddelays_s[:, i] / step_s)
        taps[:, i], slopes[:, :, i] = step.zero(fraction) if hold == "zero" else step.first(fraction)
    older = (fractions > 0.0).astype(np.float64) if hold == "zero" else fractions
    dolder = np.zeros_like(ddelays_s) if hold == "zero" else ddelays_s / step_s
    return (
        Discretized(transition=transition, taps=taps, weights=np.stack([older, 1.0 - older]), lags=lags),
        DiscretizedTangent(transition=moving, taps=slopes, weights=np.stack([dolder, -dolder], axis=1)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Step:
    """One step of one delayed input; every method gives a value and its derivatives with a leading axis."""

    A: FloatArray
    b: FloatArray
    dA: FloatArray
    db: FloatArray
    step_s: float
    dfraction: FloatArray

    def zero(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Taps of a held input whose corner lies at a fraction of the step, oldest first."""
        taps, slopes = np.zeros((3, self.b.size)), np.zeros((len(self.db), 3, self.b.size))
        onward, donward, taps[1], slopes[:, 1], _, _ = self._integrals(1.0 - fraction, -self.dfraction, ramp=False)
        # With a whole delay the older sample has no share, but the share grows with the delay.
        if fraction > 0.0 or self.dfraction.any():
            _, _, before, dbefore, _, _ = self._integrals(fraction, self.dfraction, ramp=False)
            taps[0] = onward @ before
            slopes[:, 0] = donward @ before + dbefore @ onward.T
        return taps, slopes

    def first(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Taps of an input that goes straight from sample to sample."""
        h, df = self.step_s, self.dfraction[:, None]
        onward, donward, after, dafter, ramp, dramp = self._integrals(1.0 - fraction, -self.dfraction)
        _, _, before, dbefore, rising, drising = self._integrals(fraction, self.dfraction)
        ramp, dramp, rising, drising = ramp / h, dramp / h, rising / h, drising / h
        old = fraction * before - rising
        dold = df * before + fraction * dbefore - drising
        new = (1.0 - fraction) * before + rising
        dnew = -df * before + (1.0 - fraction) * dbefore + drising
        taps = np.stack([onward @ old, onward @ new + after - ramp, ramp])
        slopes = np.stack(
            [donward @ old + dold @ onward.T, donward @ new + dnew @ onward.T + dafter - dramp, dramp], axis=1
        )
        return taps, slopes

    def _integrals(self, share: float, dshare: FloatArray, *, ramp: bool = True) -> tuple[FloatArray, ...]:
        r""":math:`e^{AT}`, :math:`\int_0^T e^{A(T-s)} b \, ds`, :math:`\int_0^T e^{A(T-s)} b s \, ds`, each derived."""
        order, extra = self.b.size, 2 if ramp else 1
        block = np.zeros((order + extra, order + extra))
        block[:order, :order], block[:order, order] = self.A, self.b
        moves = np.zeros((len(self.db), *block.shape))
        moves[:, :order, :order], moves[:, :order, order] = self.dA, self.db
        if ramp:
            block[order, order + 1] = 1.0
        time_s = share * self.step_s
        value, slope = exponential_tangent(
            block * time_s, moves * time_s + block * (dshare * self.step_s)[:, None, None]
        )
        last = order + extra - 1
        return (
            value[:order, :order],
            slope[:, :order, :order],
            value[:order, order],
            slope[:, :order, order],
            value[:order, last],
            slope[:, :order, last],
        )
