"""Time response of a linear model with delays that are fractions of a sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import Hold, discretize
from rotorid.typing import BoolArray, FloatArray


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
        Inputs before the first sample, shape ``(u,)``, which a delayed input still shows. Zero by default.
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
    start = _vector(x0, states, "x0")
    drive, past = np.asarray(u, dtype=np.float64), _vector(before, inputs, "before")
    if bias is not None:
        # A constant in the state equation is one more input that has always been one.
        system = _with_input(system, _vector(bias, states, "bias"))
        drive, past = np.vstack([drive, np.ones(samples)]), np.append(past, 1.0)
    y = np.empty((system.H0.shape[0], samples))
    # A late output sees the whole system late: the same as inputs that are later by as much.
    for delay_s in np.unique(system.output_delays_s):
        rows = system.output_delays_s == delay_s
        y[rows] = _respond(_late(system, rows, delay_s), drive, past, 1.0 / sample_rate_hz, start, hold)
    return y


def _respond(
    system: StateSpace, u: FloatArray, past: FloatArray, step_s: float, x0: FloatArray, hold: Hold
) -> FloatArray:
    """Outputs of a system that has input delays only."""
    from rotorid.simulate.kernels import recursion

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


def _late(system: StateSpace, rows: BoolArray, delay_s: float) -> StateSpace:
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
        raise UsageError(f"inputs of shape {np.shape(u)} came", needed=f"shape ({inputs}, samples)")
    if min(system.input_delays_s.min(initial=0.0), system.output_delays_s.min(initial=0.0)) < 0.0:
        raise UsageError("a delay is negative", needed="inputs that act after they are given", remedy="bound the delay")
    return inputs, u.shape[1]


def _vector(values: FloatArray | None, size: int, name: str) -> FloatArray:
    vector = np.zeros(size) if values is None else np.asarray(values, dtype=np.float64)
    if vector.shape != (size,):
        raise UsageError(f"{name} of shape {vector.shape} came", needed=f"shape ({size},)")
    return vector
