r"""The steady Kalman predictor of a sampled system, with its exact derivatives.

The covariance of the state's prediction error solves the Riccati equation

.. math:: P = \Phi P \Phi^T + Q - K S K^T, \qquad S = C P C^T + R, \qquad K = \Phi P C^T S^{-1}

At its solution the gain is the best one, so that a change of it does not move :math:`P` to first order. With
:math:`\bar\Phi = \Phi - K C` what is left is linear, a Lyapunov equation for each direction:

.. math:: \dot P = \bar\Phi \dot P \bar\Phi^T + X + X^T + \dot Q + K \dot R K^T, \qquad
    X = (\dot\Phi - K \dot C) P \bar\Phi^T
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.typing import FloatArray

_DOUBLINGS = 60
_AT_REST = 1e-14
_DEAD = 1e-18


class Predictor(NamedTuple):
    """The steady predictor.

    Parameters
    ----------
    gain
        K, shape ``(x, y)``.
    closed
        The transition of its errors, shape ``(x, x)``; all eigenvalues lie inside the unit circle.
    error
        Covariance P of the predicted state, shape ``(x, x)``.
    innovation
        Covariance S of the innovations, shape ``(y, y)``.
    """

    gain: FloatArray
    closed: FloatArray
    error: FloatArray
    innovation: FloatArray


@np.errstate(over="ignore", invalid="ignore")  # a motion that nothing shows grows without end
def steady_predictor(
    transition: FloatArray, measured: FloatArray, process: FloatArray, sensor: FloatArray
) -> Predictor:
    r"""Solve the Riccati equation by doubling.

    Each step doubles the time over which the covariance has settled, so that the slowest of errors takes few steps.
    The system may be unstable: the predictor of an unstable vehicle is stable all the same.

    Parameters
    ----------
    transition, measured
        :math:`\Phi` and C, shapes ``(x, x)`` and ``(y, x)``.
    process
        Covariance Q of what disturbs the state in a step, shape ``(x, x)``.
    sensor
        Variances R of the noise of each output, shape ``(y,)``, above zero.

    Raises
    ------
    ModelError
        There is no stable predictor: a motion that does not decay is not seen or never disturbed.

    References
    ----------
    Chu, Fan, Lin and Wang, *Structure-Preserving Algorithms for Periodic Discrete-Time Algebraic Riccati Equations*,
    International Journal of Control 77, 2004, for the doubling.

    Examples
    --------
    A random walk of unit steps, seen with unit noise, has the golden ratio as its covariance:

    >>> one = np.ones((1, 1))
    >>> float(steady_predictor(one, one, one, np.ones(1)).error[0, 0].round(12))
    1.61803398875
    """
    identity = np.eye(len(transition))
    late, seen, error = transition.T, (measured.T / sensor) @ measured, process
    for _ in range(_DOUBLINGS):
        growing = identity + seen @ error
        if not np.isfinite(growing).all():
            raise _unseen()
        inverse = np.linalg.inv(growing)
        grown = late.T @ error @ inverse @ late
        seen = seen + late @ inverse @ seen @ late.T
        seen = 0.5 * (seen + seen.T)
        error = error + 0.5 * (grown + grown.T)
        late = late @ inverse @ late
        if not np.isfinite(error).all() or np.abs(grown).max() <= _AT_REST * np.abs(error).max():
            break
    if not np.isfinite(error).all():
        raise _unseen()
    innovation = measured @ error @ measured.T + np.diag(sensor)
    gain = np.asarray(np.linalg.solve(innovation, measured @ error @ transition.T).T, dtype=np.float64)
    closed = transition - gain @ measured
    if np.abs(np.linalg.eigvals(closed)).max(initial=0.0) >= 1.0:
        raise _unseen()
    return Predictor(gain=gain, closed=closed, error=error, innovation=innovation)


def _unseen() -> ModelError:
    return ModelError(
        "there is no stable predictor of this model",
        needed="every motion that does not decay seen by an output and moved by a disturbance",
        remedy="let a disturbance act on its equation, or measure it",
    )


def gain_slopes(
    steady: Predictor,
    transition: FloatArray,
    measured: FloatArray,
    *,
    dtransition: FloatArray,
    dmeasured: FloatArray,
    dprocess: FloatArray,
    dsensor: FloatArray,
) -> FloatArray:
    """Exact derivatives of the gain along ``p`` directions, shape ``(p, x, y)``.

    Parameters
    ----------
    steady
        The predictor there.
    transition, measured
        As in :func:`steady_predictor`.
    dtransition, dmeasured, dprocess, dsensor
        Derivatives of its four arguments with a leading axis ``p``.
    """
    K, P, closed = steady.gain, steady.error, steady.closed
    half = (dtransition - K @ dmeasured) @ P @ closed.T
    moved = half + half.swapaxes(1, 2) + dprocess + (K * dsensor[:, None, :]) @ K.T
    dP = lyapunov(closed, moved)
    dcross = dtransition @ P @ measured.T + transition @ dP @ measured.T + transition @ P @ dmeasured.swapaxes(1, 2)
    seen = dmeasured @ P @ measured.T
    dS = seen + seen.swapaxes(1, 2) + measured @ dP @ measured.T + dsensor[:, :, None] * np.eye(len(measured))
    slopes = np.linalg.solve(steady.innovation, (dcross - K @ dS).swapaxes(1, 2)).swapaxes(1, 2)
    return np.asarray(slopes, dtype=np.float64)


def lyapunov(closed: FloatArray, forcing: FloatArray) -> FloatArray:
    r"""Solve :math:`X = A X A^T + W` for many symmetric W at once, by doubling.

    Parameters
    ----------
    closed
        A, shape ``(x, x)``, all eigenvalues inside the unit circle.
    forcing
        W, shape ``(p, x, x)``.
    """
    total, power = forcing, closed
    for _ in range(_DOUBLINGS):
        total = total + power @ total @ power.T
        power = power @ power
        if np.abs(power).max(initial=0.0) < _DEAD:
            break
    return total
