r"""One-step predictions of a linear model that follows its measured outputs, with exact sensitivities.

.. math:: \hat x_{k+1} = \Phi \hat x_k + \sum_j \Gamma_j u_{k-n-1+j} + K e_k, \qquad
    e_k = y_k - C \hat x_k - D \, u(t_k - \tau)

The predictor's own transition is :math:`\Phi - K C`. With the gain of a Kalman filter it is stable however unstable the
vehicle is, and so are its sensitivities: the innovations :math:`e` of an unstable model never diverge.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import Discretized, Hold
from rotorid.simulate.hold_tangent import DiscretizedTangent, discretize_tangent
from rotorid.simulate.sensitivity import Slopes, proper_tangent
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
            "a model with a delay of an output came",
            needed="outputs that show the state at their own time: a late one corrects a state of the past",
            remedy="move a delay that all outputs share to the inputs, or use the output-error fit",
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
    """What a predictor makes of a record.

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
    from rotorid.simulate.kernels import recursion

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
    from rotorid.simulate.sensitivity_kernels import free_responses

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
    run
        The innovations of this record.
    whitening
        A matrix that multiplies every innovation, shape ``(y, y)``.

    Yields
    ------
    numpy.ndarray
        Shape ``(m, y, p)``, in the order of time; its memory is used again for the next piece.
    """
    from rotorid.simulate.predictor_kernels import advance

    step, tangent, order = model.step, model.tangent, len(gain)
    through = [model.dD * step.weights[tap] + model.D * tangent.weights[:, tap, None] for tap in range(2)]
    direct = np.concatenate([part.transpose(2, 1, 0) for part in (model.dC, *through)])
    into = [tangent.transition - gain @ model.dC]
    into += [tangent.taps[:, tap].swapaxes(1, 2) - gain @ through[tap] for tap in range(2)]
    into += [tangent.taps[:, 2].swapaxes(1, 2), dgain]
    forcing = np.concatenate([part.transpose(2, 1, 0) for part in into])
    regressors = np.hstack([run.states, *(step.shifted(u, before, tap).T for tap in range(3)), run.values])
    seen = -np.einsum("ab,cbp->cap", whitening, direct)
    measured = np.ascontiguousarray(-whitening @ model.C)
    closed = np.ascontiguousarray(step.transition - gain @ model.C)
    count = forcing.shape[2]
    now = np.zeros((order, count))
    for first in range(0, len(regressors), _CHUNK):
        z = regressors[first : first + _CHUNK]
        pushed = (z @ forcing.reshape(len(forcing), -1)).reshape(len(z), order, count)
        slopes = (z[:, : len(seen)] @ seen.reshape(len(seen), -1)).reshape(len(z), -1, count)
        now = advance(closed, pushed, measured, now, slopes)
        yield slopes
