r"""One-step predictions of a linear model that follows its measured outputs, and the state in which they begin.

.. math:: \hat x_{k+1} = \Phi \hat x_k + \sum_j \Gamma_j u_{k-n-1+j} + K e_k, \qquad
    e_k = y_k - C \hat x_k - D \, u(t_k - \tau)

The predictor's own transition is :math:`\Phi - K C`. With the gain of a Kalman filter it is stable however unstable the
vehicle is, and so are its exact sensitivities: the innovations :math:`e` of an unstable model never diverge.

The state at the start comes from a Kalman filter over what was before, or from least squares over the record. All take
the exact step of :func:`rotorid.simulation.linear.discretize`, fractional delays included. Euler's step
:math:`I + A \, \Delta t`, which is common in such filters, moves the poles of the filter's model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import Discretized, Hold, checked_past, discretize
from rotorid.simulation.sensitivity import DiscretizedTangent, Slopes, discretize_tangent, proper_tangent
from rotorid.typing import FloatArray

_CHUNK = 1024
"""Samples whose sensitivities are held at a time: few enough to stay in the cache."""


class SampledModel(NamedTuple):
    """A model on the samples of a record, with its derivatives along ``p`` directions.

    Parameters
    ----------
    step, tangent
        One step for held inputs, and its derivatives.
    C, D
        Outputs of states and late inputs, shapes ``(y, x)`` and ``(y, u)``.
    dC, dD
        Their derivatives.
    """

    step: Discretized
    tangent: DiscretizedTangent
    C: FloatArray
    D: FloatArray
    dC: FloatArray
    dD: FloatArray


def sampled_model(system: StateSpace, slopes: Slopes, *, sample_rate_hz: float, hold: Hold) -> SampledModel:
    """Put a model on samples.

    Parameters
    ----------
    system
        The model; ``M`` regular, no output late.
    slopes
        Its derivatives along ``p`` directions.
    sample_rate_hz
        Rate of inputs and outputs.
    hold
        What the inputs do between their samples.

    Raises
    ------
    UsageError
        An output is late.
    ModelError
        ``M`` is singular: a state follows the input at once.
    """
    if np.any(system.output_delays_s) or np.any(slopes.output_delays_s):
        raise UsageError(
            "the model has a delay at an output, which prediction error cannot use",
            remedy="move a delay that all outputs share to the inputs, or use --method output_error",
        )
    proper, moves = proper_tangent(system, slopes)
    step, tangent = discretize_tangent(
        proper.A,
        proper.B,
        moves.A,
        moves.B,
        delays_s=system.input_delays_s,
        ddelays_s=slopes.input_delays_s,
        step_s=1.0 / sample_rate_hz,
        hold=hold,
    )
    return SampledModel(step, tangent, proper.C, proper.D, moves.C, moves.D)


class Innovations(NamedTuple):
    """Prediction of a record.

    Parameters
    ----------
    states
        Predicted states, shape ``(n, x)``.
    values
        Innovations, shape ``(n, y)``.
    """

    states: FloatArray
    values: FloatArray


def innovations(
    model: SampledModel, gain: FloatArray, u: FloatArray, y: FloatArray, *, before: FloatArray, start: FloatArray
) -> Innovations:
    """Run a predictor over a record.

    Parameters
    ----------
    model
        The model on its samples.
    gain
        K, shape ``(x, y)``, such that the predictor is stable.
    u, y
        Inputs ``(u, n)`` and measured outputs ``(y, n)``.
    before
        Inputs before the first sample, shape ``(u,)``.
    start
        What is predicted for the first sample, shape ``(x,)``.
    """
    from rotorid.simulation.linear_kernels import recursion

    closed = model.step.transition - gain @ model.C
    shown = y.T - model.step.delayed(u, before).T @ model.D.T
    states = recursion(closed, model.step.forcing(u, before) + shown @ gain.T, start)
    return Innovations(states=states, values=shown - states @ model.C.T)


def free_innovations(model: SampledModel, gain: FloatArray, samples: int, *, constants: int) -> FloatArray:
    """Derivatives of the innovations by what no model knows, shape ``(n, y, x + constants + y)``.

    They are the state that is predicted for the first sample, the value of each of the last inputs, were it constant,
    and a shift of each output.

    Parameters
    ----------
    model, gain
        As in :func:`innovations`.
    samples
        Length of the record.
    constants
        How many of the last inputs are constant.
    """
    from rotorid.simulation.linear_kernels import free_responses

    outputs, order = model.C.shape
    first = model.D.shape[1] - constants
    direct = np.hstack([model.D[:, first:], np.eye(outputs)])
    growth = np.hstack([model.step.taps[:, first:].sum(axis=0).T, np.zeros((order, outputs))]) - gain @ direct
    closed = model.step.transition - gain @ model.C
    still = np.zeros((order, order))
    free = free_responses(
        closed,
        np.hstack([np.eye(order), np.zeros_like(growth)]),
        np.hstack([still, growth]),
        np.ascontiguousarray(model.C),
        samples,
    )
    free[:, :, order:] += direct
    return -free


def innovation_slopes(
    model: SampledModel,
    gain: FloatArray,
    dgain: FloatArray,
    run: Innovations,
    u: FloatArray,
    *,
    before: FloatArray,
    whitening: FloatArray,
) -> Iterator[FloatArray]:
    r"""Exact derivatives of whitened innovations, piece by piece of the record.

    .. math:: \dot x_{k+1} = (\Phi - K C) \dot x_k + (\dot\Phi - K \dot C) \hat x_k
        + (\dot\Gamma - K \dot{(D w)}) u + \dot K e_k, \qquad \dot e_k = -C \dot x_k - \dot C \hat x_k - \dot{(D w)} u

    Parameters
    ----------
    model, gain, u, before
        As in :func:`innovations`.
    dgain
        Derivatives of K, shape ``(p, x, y)``.
    whitening
        A matrix that multiplies every innovation, shape ``(y, y)``.

    Yields
    ------
    numpy.ndarray
        Shape ``(m, y, p)``, in the order of time; its memory is used again for the next piece.
    """
    from rotorid.simulation.linear_kernels import advance

    step, tangent, order = model.step, model.tangent, len(gain)
    through = [model.dD * step.weights[tap] + model.D * tangent.weights[:, tap, None] for tap in range(2)]
    unseen = np.zeros((len(dgain), *whitening.shape))
    at_once = [model.dC, *through, np.zeros_like(through[0]), unseen]
    direct = np.concatenate([part.transpose(2, 1, 0) for part in at_once])
    into = [tangent.transition - gain @ model.dC]
    into += [tangent.taps[:, tap].swapaxes(1, 2) - gain @ through[tap] for tap in range(2)]
    into += [tangent.taps[:, 2].swapaxes(1, 2), dgain]
    forcing = np.concatenate([part.transpose(2, 1, 0) for part in into])
    # Inputs that never move are one constant.
    moved = np.ptp(np.column_stack([before, u]), axis=1) > 0.0
    kept = np.concatenate(
        [np.ones(order, dtype=np.bool_), moved, moved, moved, np.ones(len(whitening), dtype=np.bool_)]
    )
    still = np.tile(u[~moved, 0], 3)
    shifted = [step.shifted(u, before, tap)[moved].T for tap in range(3)]
    regressors = np.hstack([run.states, *shifted, run.values, np.ones((len(run.states), 1))])
    forcing, direct = (
        np.concatenate([each[kept], np.tensordot(still, each[~kept], 1)[None]]) for each in (forcing, direct)
    )
    seen = -np.einsum("ab,cbp->cap", whitening, direct).reshape(len(direct), -1)
    # What no parameter shows at once moves with the states alone.
    moving = np.flatnonzero(seen.any(axis=0))
    seen = seen[:, moving]
    measured = np.ascontiguousarray(-whitening @ model.C)
    closed = np.ascontiguousarray(step.transition - gain @ model.C)
    count = forcing.shape[2]
    now = np.zeros((order, count))
    for first in range(0, len(regressors), _CHUNK):
        z = regressors[first : first + _CHUNK]
        pushed = (z @ forcing.reshape(len(forcing), -1)).reshape(len(z), order, count)
        flat = np.zeros((len(z), len(measured) * count))
        flat[:, moving] = z @ seen
        slopes = flat.reshape(len(z), -1, count)
        now = advance(closed, pushed, measured, now, slopes)
        yield slopes


_UNSEEN = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class StateEstimate(Immutable):
    """A state and how well it is known.

    Parameters
    ----------
    state
        Shape ``(x,)``, what :func:`rotorid.simulation.linear.simulate_linear` takes as ``x0``.
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
    which the covariance includes. The stretch must be flown: repeating the first sample in front of a record would
    pretend a rest that never was.

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
    for measured, direct, forcing in zip(y.T, model.direct, model.forcing, strict=True):
        gain = np.linalg.solve(model.C @ P @ model.C.T + R, model.C @ P).T
        state = state + gain @ (measured - direct - model.C @ state)
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

    Parameters
    ----------
    system
        The model.
    u
        Inputs, shape ``(inputs, samples)``.
    y
        Measured outputs, shape ``(outputs, samples)``; not a number where one is missing.
    sample_rate_hz
        Samples per second.
    output_std
        Noise of each output, shape ``(outputs,)``.
    before
        Inputs ahead of the record, which its delays reach; the first ones by default.
    hold
        How inputs go on between samples.

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
    for measured, direct, forcing in zip(y.T, model.direct, model.forcing, strict=True):
        rows.append(model.C @ free / std[:, None])
        left.append((measured - direct - model.C @ forced) / std)
        forced = model.transition @ forced + forcing
        free = model.transition @ free
    columns = np.concatenate(rows)
    _, sizes, right = np.linalg.svd(columns, full_matrices=False)
    if sizes[-1] <= _UNSEEN * sizes[0]:
        raise InsufficientDataError(
            f"only {int(np.sum(sizes > _UNSEEN * sizes[0]))} of {len(model.A)} states can be observed from the outputs",
            remedy="use a model without the other states",
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
            f"inputs and outputs have shapes {np.shape(u)} and {np.shape(y)}",
            needed=f"({inputs}, samples) and ({outputs}, samples)",
        )
    A, B, C, D = system.proper()
    late_s = system.output_delays_s
    if len(A) != len(system.F) or np.ptp(late_s) > 0.0:
        raise UsageError(
            "the model has algebraic rows, or outputs with different delays",
            needed="dynamic states, and the same delay at all outputs",
            remedy="condense the structure, or use outputs with one delay",
        )
    past = checked_past(before, inputs)
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
        raise UsageError(
            "a standard deviation of an output is not positive", needed="the standard deviation of each output's noise"
        )
    return std


def _shaped(values: FloatArray, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise UsageError(f"{name} has shape {array.shape}", needed=f"{shape}")
    return array
