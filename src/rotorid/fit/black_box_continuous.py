"""From the samples back to continuous time: the exact inverse of the zero-order and of the first-order hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.simulate.hold import Hold, discretize
from rotorid.typing import FloatArray

_FASTEST = float(np.exp(-np.pi))
"""A decaying mode as fast as the fastest oscillation that samples show."""

_ROUNDING = 1e-8


class Continuous(NamedTuple):
    """A and B of a system in continuous time, and how many modes had none and were replaced."""

    A: FloatArray
    B: FloatArray
    replaced: int


def continuous_from_discrete(A: FloatArray, B: FloatArray, *, step_s: float, hold: Hold) -> Continuous:
    r"""The system :math:`\dot x = A_c x + B_c u` whose samples under a hold obey :math:`x_{k+1} = A x_k + B u_k`.

    .. math:: A_c = \frac{1}{T} \log A, \qquad B = (\Gamma_0 + A \Gamma_1) B_c

    with the hold's integrals :math:`\Gamma_0` and :math:`\Gamma_1` for the samples at both ends of a step; a zero-order
    hold has no share of the end. Under a first-order hold a system without feedthrough shows one from sample to sample,
    :math:`C \Gamma_1 B_c`; it belongs to B here.

    A negative real eigenvalue changes its sign with every sample and no continuous system of the same order does that;
    it is mostly noise near the Nyquist frequency, or a delay. It is replaced by the decay :math:`e^{-\pi}`, and
    counted: the outcome is then a start and no equivalent.

    Parameters
    ----------
    A, B
        Shapes ``(x, x)`` and ``(x, u)``.
    step_s
        Sample interval.
    hold
        What the inputs do between their samples.

    Raises
    ------
    ModelError
        The matrix has no real logarithm, or its inputs cannot be traced back.

    Examples
    --------
    >>> one = continuous_from_discrete(np.array([[np.exp(-0.2)]]), np.array([[1.0 - np.exp(-0.2)]]),
    ...                                step_s=0.1, hold="zero")
    >>> round(float(one.A[0, 0]), 12), round(float(one.B[0, 0]), 12), one.replaced
    (-2.0, 2.0, 0)
    """
    from scipy.linalg import logm

    transition, replaced = _with_logarithm(A)
    rate = np.asarray(logm(transition)) / step_s
    if not np.isfinite(rate).all() or np.abs(rate.imag).max() > _ROUNDING * np.abs(rate).max():
        raise ModelError("the discrete system has no continuous one", remedy="take a lower order")
    system = np.asarray(rate.real, dtype=np.float64)
    order = len(A)
    taps = discretize(system, np.eye(order), delays_s=np.zeros(order), step_s=step_s, hold=hold).taps
    reached = taps[1].T + transition @ taps[2].T
    if np.linalg.cond(reached) > 1.0 / _ROUNDING:
        raise ModelError("an input cannot be traced back through its hold", remedy="take a lower order")
    return Continuous(system, np.asarray(np.linalg.solve(reached, B), dtype=np.float64), replaced)


def _with_logarithm(A: FloatArray) -> tuple[FloatArray, int]:
    """The matrix without real eigenvalues up to zero, and how many there were."""
    from scipy.linalg import schur

    triangle, vectors = schur(A, output="real")
    below = np.append(np.abs(np.diag(triangle, -1)) > 0.0, False)
    single = ~(below | np.append(False, below[:-1]))
    lost = np.flatnonzero(single & (np.diag(triangle) <= _ROUNDING))
    if lost.size == 0:
        return A, 0
    triangle = triangle.copy()
    # Each its own decay, so that they stay apart.
    triangle[lost, lost] = _FASTEST * 1.1 ** np.arange(lost.size)
    return np.asarray(vectors @ triangle @ vectors.T, dtype=np.float64), int(lost.size)
