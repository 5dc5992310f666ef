r"""The state in which a simulation begins: a Kalman filter over what was before, or least squares over the record.

Both take the exact step of :func:`rotorid.simulate.hold.discretize`, fractional delays included. Euler's step
:math:`I + A \, \Delta t`, which is common in such filters, moves the poles of the filter's model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import Hold, discretize
from rotorid.typing import FloatArray

_UNSEEN = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class StateEstimate(Immutable):
    """A state and how well it is known.

    Parameters
    ----------
    state
        Shape ``(x,)``, what :func:`rotorid.simulate.linear.simulate_linear` takes as ``x0``.
    covariance
        Shape ``(x, x)``.
    """

    state: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        self._set(
            state=read_only(self.state, np.float64, ndim=1), covariance=read_only(self.covariance, np.float64, ndim=2)
        )

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape ``(x,)``."""
        return np.sqrt(np.diag(self.covariance))


def kalman_start(
    system: StateSpace,
    u: FloatArray,
    y: FloatArray,
    *,
    sample_rate_hz: float,
    output_std: FloatArray,
    disturbance: FloatArray,
    prior: StateEstimate,
    before: FloatArray | None = None,
    hold: Hold = "zero",
) -> StateEstimate:
    r"""Predicted state at the sample after a stretch of record, by the Kalman filter.

    .. math::

        K_k = P_k C^T (C P_k C^T + R)^{-1}, \qquad
        \hat x_{k+1} = \Phi (\hat x_k + K_k (y_k - C \hat x_k - d_k)) + f_k, \qquad
        P_{k+1} = \Phi (I - K_k C) P_k \Phi^T + Q

    with :math:`f` and :math:`d` from the held and delayed inputs, and
    :math:`Q = \int_0^{\Delta t} e^{A s} W e^{A^T s} ds`. For a linear model an extended Kalman filter is this filter.
    It forgets the prior where the outputs show the states; a stretch shorter than the slowest mode leaves some of it,
    which the covariance says. The stretch must be flown: repeating the first sample in front of a record tells the
    filter of a rest that never was.

    Parameters
    ----------
    system
        The model, without algebraic rows; all outputs equally late.
    u, y
        Inputs and outputs of the stretch, shapes ``(u, samples)`` and ``(y, samples)``.
    sample_rate_hz
        Their rate.
    output_std
        Standard deviation of the noise of each output, shape ``(y,)``, positive.
    disturbance
        W, intensity of the white noise in the state equations, shape ``(x, x)``; zero for a model that is exact.
    prior
        The state at the first sample of the stretch, before its outputs were seen.
    before
        Inputs before the stretch, shape ``(u,)``. Zero by default.
    hold
        What the inputs do between samples.

    Raises
    ------
    UsageError
        A shape does not match the model, or the model has algebraic rows or outputs of different delays.

    References
    ----------
    R. F. Stengel, *Optimal Control and Estimation*, section 4.3. Q by C. Van Loan, *Computing Integrals Involving the
    Matrix Exponential*, IEEE Transactions on Automatic Control, 1978.

    Examples
    --------
    A lag at rest, of which nothing was known; twenty samples say that it is at one:

    >>> one = np.ones((1, 1))
    >>> lag = StateSpace(M=one, F=-one, G=one, H0=one, H1=0.0 * one,
    ...                  input_delays_s=np.zeros(1), output_delays_s=np.zeros(1))
    >>> found = kalman_start(lag, np.ones((1, 20)), np.ones((1, 20)), sample_rate_hz=20.0, output_std=np.array([0.1]),
    ...                      disturbance=0.0 * one, prior=StateEstimate(state=np.zeros(1), covariance=1e4 * one))
    >>> round(float(found.state[0]), 3), round(float(found.std[0]), 3)
    (1.0, 0.012)
    """
    model = _stepped(system, u, y, sample_rate_hz, before, hold)
    R = np.diag(_spread(output_std, len(y)) ** 2)
    Q = _accumulated(model.A, _shaped(disturbance, (len(model.A), len(model.A)), "disturbance"), 1.0 / sample_rate_hz)
    state, P = prior.state, prior.covariance
    _shaped(state, (len(model.A),), "the prior")
    for seen, direct, forcing in zip(y.T, model.direct, model.forcing, strict=True):
        gain = np.linalg.solve(model.C @ P @ model.C.T + R, model.C @ P).T
        state = state + gain @ (seen - direct - model.C @ state)
        # Joseph's form stays symmetric and positive whatever is rounded.
        kept = np.eye(len(P)) - gain @ model.C
        P = kept @ P @ kept.T + gain @ R @ gain.T
        state = model.transition @ state + forcing
        P = model.transition @ P @ model.transition.T + Q
    return StateEstimate(state=state, covariance=P)


def least_squares_start(
    system: StateSpace,
    u: FloatArray,
    y: FloatArray,
    *,
    sample_rate_hz: float,
    output_std: FloatArray,
    before: FloatArray | None = None,
    hold: Hold = "zero",
) -> StateEstimate:
    r"""State at the first sample of a record, by weighted least squares over the record itself.

    .. math:: \hat x_0 = \arg\min_{x_0} \sum_k \left\| R^{-1/2} (y_k - \hat y_k - C \Phi^k x_0) \right\|^2

    with :math:`\hat y` the response from rest. Needs nothing before the record. It takes the model for exact and the
    noise for white; what the model misses in the first moments goes into the state. The state is fitted to the data
    that it then predicts, so a fit in percent flatters a little, the more so the shorter the record.

    Parameters and errors are those of :func:`kalman_start`.

    Raises
    ------
    InsufficientDataError
        The outputs do not show all states.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> lag = StateSpace(M=one, F=-one, G=one, H0=one, H1=0.0 * one,
    ...                  input_delays_s=np.zeros(1), output_delays_s=np.zeros(1))
    >>> fading = 2.0 * np.exp(-np.arange(20) / 20.0)[None]
    >>> found = least_squares_start(lag, np.zeros((1, 20)), fading, sample_rate_hz=20.0, output_std=np.array([0.1]))
    >>> round(float(found.state[0]), 12)
    2.0
    """
    model = _stepped(system, u, y, sample_rate_hz, before, hold)
    std = _spread(output_std, len(y))
    forced, free = np.zeros(len(model.A)), np.eye(len(model.A))
    rows, left = [], []
    for seen, direct, forcing in zip(y.T, model.direct, model.forcing, strict=True):
        rows.append(model.C @ free / std[:, None])
        left.append((seen - direct - model.C @ forced) / std)
        forced = model.transition @ forced + forcing
        free = model.transition @ free
    columns = np.concatenate(rows)
    _, sizes, right = np.linalg.svd(columns, full_matrices=False)
    if sizes[-1] <= _UNSEEN * sizes[0]:
        raise InsufficientDataError(
            f"the outputs show {int(np.sum(sizes > _UNSEEN * sizes[0]))} of {len(model.A)} states",
            needed="a record that shows all of them",
            remedy="use a model without the states that no output shows",
        )
    state = np.linalg.lstsq(columns, np.concatenate(left), rcond=None)[0]
    return StateEstimate(state=state, covariance=(right.T / sizes**2) @ right)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stepped:
    """A model on the samples of a record."""

    A: FloatArray
    C: FloatArray
    transition: FloatArray
    forcing: FloatArray
    direct: FloatArray


def _stepped(
    system: StateSpace, u: FloatArray, y: FloatArray, sample_rate_hz: float, before: FloatArray | None, hold: Hold
) -> _Stepped:
    inputs, outputs = system.G.shape[1], system.H0.shape[0]
    if np.ndim(u) != 2 or np.ndim(y) != 2 or (len(u), len(y)) != (inputs, outputs) or u.shape[1] != y.shape[1]:
        raise UsageError(
            f"inputs of shape {np.shape(u)} and outputs of shape {np.shape(y)} came",
            needed=f"shapes ({inputs}, samples) and ({outputs}, samples)",
        )
    A, B, C, D = system.proper()
    late_s = system.output_delays_s
    if len(A) != len(system.F) or np.ptp(late_s) > 0.0:
        raise UsageError(
            "the model has algebraic rows or outputs of different delays",
            needed="states that are all dynamic, seen at one time",
            remedy="condense the structure, or take outputs of one delay",
        )
    past = np.zeros(inputs) if before is None else _shaped(before, (inputs,), "before")
    step = discretize(A, B, delays_s=system.input_delays_s + late_s[0], step_s=1.0 / sample_rate_hz, hold=hold)
    return _Stepped(
        A=A,
        C=C,
        transition=step.transition,
        forcing=step.forcing(u, past),
        direct=(D @ step.delayed(u, past)).T,
    )


def _accumulated(A: FloatArray, W: FloatArray, step_s: float) -> FloatArray:
    """Covariance that white noise of intensity W adds in one step."""
    from scipy.linalg import expm

    size = len(A)
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size], block[:size, size:], block[size:, size:] = -A, W, A.T
    exponential = expm(block * step_s)
    Q = exponential[size:, size:].T @ exponential[:size, size:]
    return np.asarray(0.5 * (Q + Q.T), dtype=np.float64)


def _spread(output_std: FloatArray, outputs: int) -> FloatArray:
    std = _shaped(output_std, (outputs,), "output_std")
    if not (std > 0.0).all():
        raise UsageError("a standard deviation of an output is not positive", needed="the noise of each output")
    return std


def _shaped(values: FloatArray, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise UsageError(f"{name} of shape {array.shape} came", needed=f"shape {shape}")
    return array
