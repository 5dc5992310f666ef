"""Time response of a linear model whose sampled inputs are delayed by any fraction of a sample.

The discretization is exact: the inputs are taken as steps or straight lines between samples, and nothing else is
assumed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.typing import BoolArray, FloatArray, IntArray

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
            Inputs before the first sample, shape ``(u,)`` or ``(u, k)``, the latest last; before them the first stood.
        """
        terms = (self.shifted(u, past, tap).T @ self.taps[tap] for tap in range(3))
        total: FloatArray = sum(terms, start=np.zeros((u.shape[1], self.taps.shape[2])))
        return total

    def delayed(self, u: FloatArray, past: FloatArray) -> FloatArray:
        """The delayed inputs at the sample instants, shape ``(u, samples)``."""
        delayed: FloatArray = sum(
            (self.weights[tap, :, None] * self.shifted(u, past, tap) for tap in range(2)), start=np.zeros_like(u)
        )
        return delayed

    def shifted(self, u: FloatArray, past: FloatArray, tap: int) -> FloatArray:
        """The samples of each input that a tap weighs in every step, shape ``(u, samples)``."""
        delayed = np.empty_like(u)
        history = past if past.ndim == 2 else past[:, None]
        for row, values, known, lag in zip(delayed, u, history, self.lags + 1 - tap, strict=True):
            # A lag of -1 is the sample at the end of the step, which a first-order hold goes to.
            kept = values[max(-lag, 0) : max(values.size - lag, 0)]
            ahead = min(max(lag, 0), values.size)
            row[:ahead] = known[np.maximum(np.arange(ahead) - lag, -known.size)]
            row[ahead : ahead + kept.size] = kept
            row[ahead + kept.size :] = values[-1]
        return delayed


@np.errstate(over="ignore", invalid="ignore")  # a model of a document may be one that no vehicle has
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


def simulate_linear(
    system: StateSpace,
    u: FloatArray,
    *,
    sample_rate_hz: float,
    x0: FloatArray | None = None,
    bias: FloatArray | None = None,
    before: FloatArray | None = None,
    hold: Hold = "zero",
) -> FloatArray:
    r"""Outputs of a linear system at the sample instants, exact for the held input.

    .. math:: M \dot x = F x + G u(t - \tau_u) + b, \qquad y(t + \tau_y) = H_0 x + H_1 \dot x

    No delay is rounded to a sample, no derivative is differenced. An unstable model diverges as its equations say.
    A logged command that the autopilot held is a ``zero`` hold; one that was resampled or logged slowly is closer to a
    ``first`` hold, and a zero hold of it arrives half a sample late.

    Parameters
    ----------
    system
        The model; rows of ``M`` may be algebraic.
    u
        Inputs, shape ``(u, samples)``, as differences from trim.
    sample_rate_hz
        Rate of inputs and outputs.
    x0
        States that the first sample shows, shape ``(x,)``: those at :math:`t_0 - \tau_y` for an output that is
        :math:`\tau_y` late. States with an algebraic row follow the others, and their start is not used. Zero by
        default.
    bias
        Constant b in the state equation, shape ``(x,)``. Zero by default.
    before
        Inputs before the first sample, shape ``(u,)`` or ``(u, k)`` with the latest last, which a delayed input still
        shows. Zero by default.
    hold
        What the inputs do between their samples: ``zero`` or ``first`` order.

    Returns
    -------
    FloatArray
        Shape ``(y, samples)``. Where an output jumps with its input at a sample, it is the value just after the jump.

    Raises
    ------
    UsageError
        A shape does not match the model, or a delay is negative.
    ModelError
        The algebraic rows of ``M`` do not determine their states.

    Examples
    --------
    A first-order lag of 0.1 s behind a delay of 12 ms, sampled at 100 Hz:

    >>> one = np.ones((1, 1))
    >>> lag = StateSpace(M=0.1 * one, F=-one, G=one, H0=one, H1=0.0 * one,
    ...                  input_delays_s=np.array([0.012]), output_delays_s=np.zeros(1))
    >>> step = simulate_linear(lag, np.ones((1, 4)), sample_rate_hz=100.0)
    >>> bool(np.allclose(step[0], [0.0, 0.0, 1 - np.exp(-0.08), 1 - np.exp(-0.18)]))
    True
    """
    inputs, samples = _checked(system, u)
    states = system.M.shape[0]
    start = checked_vector(x0, states, "x0")
    drive, past = np.asarray(u, dtype=np.float64), checked_past(before, inputs)
    if bias is not None:
        # A constant in the state equation is one more input that has always been one.
        system = _with_input(system, checked_vector(bias, states, "bias"))
        drive, past = np.vstack([drive, np.ones(samples)]), np.vstack([past, np.ones(past.shape[1])])
    y = np.empty((system.H0.shape[0], samples))
    # A delayed output delays the whole system: the same as inputs that are delayed by as much.
    for delay_s in np.unique(system.output_delays_s):
        rows = system.output_delays_s == delay_s
        y[rows] = _respond(_delayed(system, rows, delay_s), drive, past, 1.0 / sample_rate_hz, start, hold)
    return y


def _respond(
    system: StateSpace, u: FloatArray, past: FloatArray, step_s: float, x0: FloatArray, hold: Hold
) -> FloatArray:
    """Outputs of a system that has input delays only."""
    from rotorid.simulation.linear_kernels import recursion

    A, B, C, D = system.proper()
    step = discretize(A, B, delays_s=system.input_delays_s, step_s=step_s, hold=hold)
    states = recursion(step.transition, step.forcing(u, past), _dynamic(system, x0))
    y: FloatArray = C @ states.T + D @ step.delayed(u, past)
    return y


def _dynamic(system: StateSpace, x0: FloatArray) -> FloatArray:
    """The start of the states that remain when the algebraic ones are eliminated.

    With x = C z + D u the algebraic part lies in the null space of M, so M x0 = M C z holds whatever the input is.
    """
    states = replace(system, H0=np.eye(x0.size), H1=np.zeros((x0.size, x0.size)), output_delays_s=np.zeros(x0.size))
    C = states.proper()[2]
    if C.shape[1] == x0.size:
        return x0
    start: FloatArray = np.linalg.lstsq(system.M @ C, system.M @ x0, rcond=None)[0].astype(np.float64)
    return start


def _delayed(system: StateSpace, rows: BoolArray, delay_s: float) -> StateSpace:
    return replace(
        system,
        H0=system.H0[rows],
        H1=system.H1[rows],
        input_delays_s=system.input_delays_s + delay_s,
        output_delays_s=np.zeros(int(np.sum(rows))),
    )


def _with_input(system: StateSpace, column: FloatArray) -> StateSpace:
    return replace(
        system,
        G=np.column_stack([system.G, column]),
        input_delays_s=np.append(system.input_delays_s, 0.0),
    )


def _checked(system: StateSpace, u: FloatArray) -> tuple[int, int]:
    inputs = system.G.shape[1]
    if np.ndim(u) != 2 or u.shape[0] != inputs or u.shape[1] == 0:
        raise UsageError(f"the inputs have shape {np.shape(u)}", needed=f"({inputs}, samples)")
    if min(system.input_delays_s.min(initial=0.0), system.output_delays_s.min(initial=0.0)) < 0.0:
        raise UsageError("a delay is negative", needed="zero or more", remedy="bound the delay")
    return inputs, u.shape[1]


def checked_past(before: FloatArray | None, size: int) -> FloatArray:
    """Inputs before a record, shape ``(u, k)``, the latest last; zeros where none were given.

    Raises
    ------
    UsageError
        They are of another number of inputs.
    """
    given = np.zeros(size) if before is None else np.asarray(before, dtype=np.float64)
    past = given[:, None] if given.ndim == 1 else given
    if past.ndim != 2 or past.shape[0] != size or not past.shape[1]:
        raise UsageError(f"before has shape {given.shape}", needed=f"({size},) or ({size}, samples)")
    return past


def earlier(past: FloatArray, samples: int) -> FloatArray:
    """The last inputs before a record, shape ``(u, samples)``; before the first that is known it stood.

    Parameters
    ----------
    past
        Shape ``(u, k)``, the latest last.
    samples
        How many are wanted.
    """
    taken: FloatArray = past[:, np.maximum(np.arange(-samples, 0), -past.shape[1])]
    return taken


def checked_vector(values: FloatArray | None, size: int, name: str) -> FloatArray:
    """A vector of the right size, which is nobody else's; zeros where none was given.

    Raises
    ------
    UsageError
        It has another size.
    """
    vector = np.zeros(size) if values is None else np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise UsageError(f"{name} has shape {vector.shape}", needed=f"({size},)")
    return vector
