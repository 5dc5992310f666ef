"""A model on the samples of a record, with what a prediction may add to it: a start, and constants in the equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import WHOLE_SAMPLE, discretize
from rotorid.typing import FloatArray

_AGES = np.array([3.0, 2.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Immutable):
    r"""A linear model with its delays, step by step on the samples of one record.

    .. math:: x_{k+1} = \Phi x_k + f_k + \sum_i b_i \gamma_i, \qquad
        y_k = C x(t_k - \tau_y) + d_k + \sum_i b_i \delta_i

    States begin ``lead`` samples before the record, so that an output that is late shows the same states as the
    others, only later.

    Parameters
    ----------
    transition
        :math:`\Phi`, shape ``(x, x)``.
    forcing
        :math:`f`, shape ``(lead + samples, x)``.
    measured
        :math:`C`, shape ``(y, x)``.
    direct
        :math:`d`, what the inputs add to the outputs at once, shape ``(samples, y)``.
    biases, direct_biases
        :math:`\gamma` and :math:`\delta` of a unit constant in each state equation, shapes ``(e, x)`` and ``(e, y)``;
        zero for an equation without dynamics.
    lags
        Samples by which each output is later than the earliest one, shape ``(y,)``.
    lead
        Samples before the record.
    """

    transition: FloatArray
    forcing: FloatArray
    measured: FloatArray
    direct: FloatArray
    biases: FloatArray
    direct_biases: FloatArray
    lags: FloatArray
    lead: int

    def __post_init__(self) -> None:
        names = ("transition", "forcing", "measured", "direct", "biases", "direct_biases")
        arrays = {name: read_only(getattr(self, name), np.float64, ndim=2) for name in names}
        self._set(**arrays, lags=read_only(self.lags, np.float64, ndim=1))

    def seen(self, states: FloatArray) -> FloatArray:
        """Outputs, feedthrough aside, of states ``(..., lead + n, x)``: shape ``(..., n, y)``.

        Between two samples a late output takes the cubic through the four states around it.
        """
        count = states.shape[-2] - self.lead
        outputs = np.empty((*states.shape[:-2], count, self.measured.shape[0]))
        for row, lag in enumerate(self.lags):
            whole, weights = _weights(float(lag))
            late = sum(
                weight * states[..., self.lead - whole + tap : self.lead - whole + tap + count, :]
                for tap, weight in enumerate(weights)
            )
            outputs[..., row] = late @ self.measured[row]
        return outputs


def sampled(system: StateSpace, u: FloatArray, *, sample_rate_hz: float, before: FloatArray) -> Sampled:
    """Put a model on the samples of a record.

    Inputs go straight from sample to sample, which suits a command that was resampled.

    Parameters
    ----------
    system
        The model.
    u
        Inputs, shape ``(u, samples)``, as differences from trim.
    sample_rate_hz
        Their rate.
    before
        Inputs before the first sample, shape ``(u,)``.
    """
    inputs, equations = system.G.shape[1], system.F.shape[0]
    common = float(system.output_delays_s.min())
    lags = (system.output_delays_s - common) * sample_rate_hz
    lead = max((_weights(float(lag))[0] for lag in lags), default=0)
    moving = np.diag((np.abs(system.M).sum(axis=1) > 0.0).astype(np.float64))
    wide = replace(
        system,
        G=np.hstack([system.G, moving]),
        # A delay that all outputs share is the same as inputs that are later by as much.
        input_delays_s=np.concatenate([system.input_delays_s + common, np.zeros(equations)]),
        output_delays_s=system.output_delays_s - common,
    )
    A, B, C, D = wide.proper()
    step = discretize(
        A, B[:, :inputs], delays_s=wide.input_delays_s[:inputs], step_s=1.0 / sample_rate_hz, hold="first"
    )
    constant = discretize(A, B[:, inputs:], delays_s=np.zeros(equations), step_s=1.0 / sample_rate_hz, hold="zero")
    padded = np.hstack([np.repeat(before[:, None], lead, axis=1), u])
    return Sampled(
        transition=step.transition,
        forcing=step.forcing(padded, before),
        measured=C,
        direct=_direct(wide, D[:, :inputs], u, before, 1.0 / sample_rate_hz),
        biases=constant.taps.sum(axis=0),
        direct_biases=D[:, inputs:].T,
        lags=lags,
        lead=lead,
    )


def _direct(system: StateSpace, D: FloatArray, u: FloatArray, before: FloatArray, step_s: float) -> FloatArray:
    """Feedthrough of the delayed inputs to each output, shape ``(samples, y)``."""
    knots_s = np.arange(-1, u.shape[1]) * step_s
    known = np.column_stack([before, u])
    direct = np.zeros((u.shape[1], D.shape[0]))
    for y, i in zip(*np.nonzero(D), strict=True):
        late_s = system.input_delays_s[i] + system.output_delays_s[y]
        direct[:, y] += D[y, i] * np.interp(knots_s[1:] - late_s, knots_s, known[i])
    return direct


def _weights(lag: float) -> tuple[int, FloatArray]:
    """How many samples back the oldest of some samples stands, and the weights of them, oldest first."""
    whole = int(np.floor(lag + WHOLE_SAMPLE))
    share = lag - whole
    if share < WHOLE_SAMPLE:
        return whole, np.array([1.0])
    # Lagrange's cubic through four samples, the place between the newest two: none newer may exist at the end.
    weights = np.array([np.prod([(share - other) / (age - other) for other in _AGES if other != age]) for age in _AGES])
    return whole + _AGES.size - 1, weights
