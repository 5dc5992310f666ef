"""A model on the samples of a record, and the adjustments of a prediction.

The initial state, steady biases and reference shifts are what no model can know, and they enter linearly. Measurement
and prediction pass the same filters before they are compared. Of an unstable model growing motions are computed
backward in time, so that its response stays bounded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import WHOLE_SAMPLE, checked_past, discretize, earlier
from rotorid.typing import BoolArray, FloatArray

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

    def outputs_of(self, states: FloatArray) -> FloatArray:
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
    u
        Inputs, shape ``(u, samples)``, as differences from trim.
    before
        Inputs before the first sample, shape ``(u,)`` or ``(u, k)`` with the latest last.
    """
    inputs, equations = system.G.shape[1], system.F.shape[0]
    past = checked_past(before, inputs)
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
    padded = np.hstack([earlier(past, lead), u])
    return Sampled(
        transition=step.transition,
        forcing=step.forcing(padded, past[:, : max(past.shape[1] - lead, 1)]),
        measured=C,
        direct=_direct(wide, D[:, :inputs], u, past, 1.0 / sample_rate_hz),
        biases=constant.taps.sum(axis=0),
        direct_biases=D[:, inputs:].T,
        lags=lags,
        lead=lead,
    )


def _direct(system: StateSpace, D: FloatArray, u: FloatArray, past: FloatArray, step_s: float) -> FloatArray:
    """Feedthrough of the delayed inputs to each output, shape ``(samples, y)``."""
    knots_s = np.arange(-past.shape[1], u.shape[1]) * step_s
    known = np.hstack([past, u])
    direct = np.zeros((u.shape[1], D.shape[0]))
    for y, i in zip(*np.nonzero(D), strict=True):
        late_s = system.input_delays_s[i] + system.output_delays_s[y]
        direct[:, y] += D[y, i] * np.interp(knots_s[past.shape[1] :] - late_s, knots_s, known[i])
    return direct


def _weights(lag: float) -> tuple[int, FloatArray]:
    """Age of the oldest of some samples, and their weights, oldest first."""
    whole = int(np.floor(lag + WHOLE_SAMPLE))
    share = lag - whole
    if share < WHOLE_SAMPLE:
        return whole, np.array([1.0])
    # Lagrange's cubic through four samples, the place between the newest two: none newer may exist at the end.
    weights = np.array([np.prod([(share - other) / (age - other) for other in _AGES if other != age]) for age in _AGES])
    return whole + _AGES.size - 1, weights


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedResponses(Immutable):
    """Responses of a model to the inputs, and to each of its unknowns.

    Parameters
    ----------
    forced
        Response to the inputs, shape ``(y, samples)``; one of many that differ by free responses.
    free
        Free responses, one for each dynamic state, shape ``(x, y, samples)``. They span all free responses.
    biased
        Response to a unit constant in each state equation, shape ``(e, y, samples)``, up to free responses.
    """

    forced: FloatArray
    free: FloatArray
    biased: FloatArray

    def __post_init__(self) -> None:
        self._set(
            forced=read_only(self.forced, np.float64, ndim=2),
            free=read_only(self.free, np.float64, ndim=3),
            biased=read_only(self.biased, np.float64, ndim=3),
        )


def bounded_responses(model: Sampled) -> BoundedResponses:
    r"""Forced, free and biased responses of a model on a record of any length.

    Since the initial state is to be estimated, any response that obeys the equations will do. Motions that grow more
    than e-fold in the record are split off and computed backward from rest at its end, where they decay:

    .. math:: s_{k+1} = \Phi_s s_k + f_{s,k}, \qquad v_k = \Phi_u^{-1} (v_{k+1} - f_{u,k}), \quad v_{end} = 0

    Forward, an unstable airframe of 3 1/s loses all digits within 12 s; so it loses none.

    Parameters
    ----------
    model
        The model on the samples of the record.
    """
    motions = _Motions.of(model)
    nothing, rest = np.zeros_like(model.forcing), np.zeros(len(model.transition))
    constants = zip(model.biases, model.direct_biases, strict=True)

    def outputs(forcing: FloatArray, ends: FloatArray) -> FloatArray:
        return model.outputs_of(motions.states(forcing, ends)).T

    return BoundedResponses(
        forced=outputs(model.forcing, rest) + model.direct.T,
        free=np.array([outputs(nothing, end) for end in np.eye(rest.size)]),
        biased=np.array([outputs(nothing + bias, rest) + direct[:, None] for bias, direct in constants]),
    )


def bounded_states(model: Sampled) -> FloatArray:
    """States of one motion under the inputs that stays bounded, shape ``(lead + samples, x)``.

    Parameters
    ----------
    model
        The model on the samples of the record.
    """
    return _Motions.of(model).states(model.forcing, np.zeros(len(model.transition)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motions:
    """A recursion in a basis that separates decaying (``slow``) from growing (``fast``) states."""

    basis: FloatArray
    inverse: FloatArray
    slow: FloatArray
    fast: FloatArray

    @classmethod
    def of(cls, model: Sampled) -> _Motions:
        basis, kept = _split(model.transition, len(model.forcing))
        inverse = np.asarray(np.linalg.inv(basis), dtype=np.float64)
        transition = inverse @ model.transition @ basis
        return cls(basis=basis, inverse=inverse, slow=transition[:kept, :kept], fast=transition[kept:, kept:])

    def states(self, forcing: FloatArray, ends: FloatArray) -> FloatArray:
        """Response to a forcing, with the start of what decays and the end of what grows."""
        kept, parts = len(self.slow), forcing @ self.inverse.T
        decaying = _forward(self.slow, parts[:, :kept], ends[:kept])
        growing = _backward(self.fast, parts[:, kept:], ends[kept:])
        both: FloatArray = np.hstack([decaying, growing]) @ self.basis.T
        return both


def _split(transition: FloatArray, steps: int) -> tuple[FloatArray, int]:
    """A basis whose first vectors span what does not grow e-fold in a record, and the number of those."""
    from scipy.linalg import schur, solve_sylvester

    # Slower growth goes forward: an integrator must not fall on both sides by rounding.
    triangle, vectors, kept = schur(transition * np.exp(-1.0 / steps), sort="iuc")
    if kept == len(transition):
        return np.eye(kept), kept
    coupling = solve_sylvester(triangle[:kept, :kept], -triangle[kept:, kept:], -triangle[:kept, kept:])
    return np.hstack([vectors[:, :kept], vectors[:, :kept] @ coupling + vectors[:, kept:]]), kept


def _forward(transition: FloatArray, forcing: FloatArray, start: FloatArray) -> FloatArray:
    from rotorid.simulation.linear_kernels import recursion

    return recursion(np.ascontiguousarray(transition), np.ascontiguousarray(forcing), start)


def _backward(transition: FloatArray, forcing: FloatArray, end: FloatArray) -> FloatArray:
    """States with ``v[k] = inv(transition) (v[k+1] - forcing[k])`` that come to ``end`` after the last step."""
    from rotorid.simulation.linear_kernels import recursion

    back = np.linalg.inv(transition)
    reverse = np.vstack([-(forcing @ back.T)[::-1], np.zeros((1, len(back)))])
    return recursion(np.ascontiguousarray(back), reverse, end)[:0:-1]


LEAST_REMAINDER = 1e-3
"""Share of a column that must survive the filter, and the columns before it, for the column to be estimated."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjustment(Immutable):
    """Adjustments of the response of a model, with their coefficients.

    Parameters
    ----------
    response
        Shape ``(y, samples)``, filtered like the measurement.
    shifts
        Constant offset of each output, shape ``(y,)``; 0 where the data do not show it.
    biases
        Constant in each state equation, shape ``(x,)``; 0 where the data do not show it, and for an equation without
        dynamics.
    """

    response: FloatArray
    shifts: FloatArray
    biases: FloatArray

    def __post_init__(self) -> None:
        self._set(
            response=read_only(self.response, np.float64, ndim=2),
            shifts=read_only(self.shifts, np.float64, ndim=1),
            biases=read_only(self.biases, np.float64, ndim=1),
        )


def adjust(
    responses: BoundedResponses,
    residual: FloatArray,
    *,
    weights: FloatArray,
    filtered: Callable[[FloatArray], FloatArray],
) -> Adjustment:
    r"""Explain what the forced response leaves over by shifts, initial states and biases, by weighted least squares.

    .. math:: y - y_{model}(u) \approx c + \Phi(t) x_0 + \sum_i b_i \Psi_i(t)

    Often some look alike: of a damped rate a steady torque ends in a steady rate, as a shifted sensor shows it,
    and without damping a steady force is a shifted accelerometer. Then the first of shifts, initial states and biases
    takes the whole effect and the later ones are zero, so the coefficients are a description and no measurement of the
    sensor or the wind. The response is the same whichever takes it. A bias of its own is seen where its equation leads
    into an integration, as a steady force on an undamped velocity does. What a high-pass filter removes is not
    estimated: a tiny remainder of a ramp would otherwise explain anything, with an enormous coefficient.

    Parameters
    ----------
    responses
        The model's response to each unknown.
    residual
        Filtered measurement minus filtered forced response, shape ``(y, samples)``.
    weights
        One over the size of each output, shape ``(y,)``, so that outputs of different units count alike.
    filtered
        The filter that measurement and forced response have passed, for arrays ``(..., samples)``.
    """
    outputs, samples = residual.shape
    shifts = np.kron(np.eye(outputs), np.ones(samples)).reshape(outputs, outputs, samples)
    whole = np.concatenate([shifts, responses.free, responses.biased])
    columns = filtered(whole)
    weighted = (columns * weights[:, None]).reshape(len(whole), -1)
    distinct = independent_columns(weighted, np.linalg.norm((whole * weights[:, None]).reshape(len(whole), -1), axis=1))
    coefficients = np.zeros(len(whole))
    if distinct.any():
        scale = np.linalg.norm(weighted[distinct], axis=1)
        target = (residual * weights[:, None]).ravel()
        coefficients[distinct] = np.linalg.lstsq((weighted[distinct] / scale[:, None]).T, target, rcond=None)[0] / scale
    return Adjustment(
        response=np.tensordot(coefficients, columns, axes=1),
        shifts=coefficients[:outputs],
        biases=coefficients[outputs + len(responses.free) :],
    )


def independent_columns(columns: FloatArray, whole: FloatArray) -> BoolArray:
    """Columns that a filter leaves and that differ from those kept before them, shape ``(k,)``.

    Parameters
    ----------
    columns
        Filtered columns, shape ``(k, n)``; the first ones go before the last ones.
    whole
        Norms before the filter, shape ``(k,)``.

    Examples
    --------
    >>> independent_columns(np.array([[1.0, 1.0], [2.0, 2.0], [1e-6, 0.0], [0.0, 1.0]]), np.array([1.0, 3.0, 1.0, 1.0]))
    array([ True, False, False,  True])
    """
    kept = np.zeros(len(columns), dtype=bool)
    basis = np.zeros((0, columns.shape[1]))
    for index, column in enumerate(columns):
        size = float(np.linalg.norm(column))
        rest = column - basis.T @ (basis @ column)
        # Once more, because the first projection leaves a rounding error along the basis.
        rest = rest - basis.T @ (basis @ rest)
        remainder = float(np.linalg.norm(rest))
        if size > LEAST_REMAINDER * whole[index] and remainder > LEAST_REMAINDER * size:
            kept[index] = True
            basis = np.vstack([basis, rest / remainder])
    return kept


Filter: TypeAlias = Callable[[FloatArray], FloatArray]
LowPass: TypeAlias = float | Literal["auto"] | None

VIBRATION_LOW_PASS_RAD_S = 100.0
"""First order, as the Hummingbird was verified (Niermeyer, Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics
Identification in Frequency Domain via Closed-Loop Flight Testing*, section V)."""

VIBRATING = 0.1
"""Share of power above the fitted band, relative to that in it, from which a low-pass is asked for."""

_LEAST_PERIODS = 1.5
_LEAST_PADDING_S = 3.0
_ORDER = 2
_HIGHEST = 0.9


def band_pass(band_rad_s: tuple[float, float], rate_hz: float, duration_s: float) -> Filter:
    """A zero-phase filter on the fitted band, for arrays ``(..., samples)``.

    A low-pass at the upper end and, where the record holds 1.5 periods of it, a high-pass at the lower end.

    Parameters
    ----------
    band_rad_s
        The fitted band.
    rate_hz, duration_s
        Of the record.
    """
    from scipy.signal import butter, sosfiltfilt

    low, high = (edge / (np.pi * rate_hz) for edge in band_rad_s)
    sections = []
    if high < _HIGHEST:
        sections.append(butter(_ORDER, high, output="sos"))
    least_s = _LEAST_PERIODS * 2.0 * np.pi / band_rad_s[0]
    high_pass = duration_s >= least_s and low < min(high, _HIGHEST)
    if high_pass:
        sections.append(butter(_ORDER, low, btype="high", output="sos"))
    if not sections:
        return np.asarray
    stacked = np.vstack(sections)
    # The high-pass filter rings at the ends of a trend; a padding as long as its slowest wave keeps that outside.
    padding_s = max(_LEAST_PADDING_S, least_s if high_pass else 0.0)
    return lambda values: np.asarray(
        sosfiltfilt(stacked, values, axis=-1, padlen=min(values.shape[-1] - 1, round(padding_s * rate_hz)))
    )


def low_pass(cutoff_rad_s: float, rate_hz: float) -> Filter:
    """A causal first-order low-pass that begins settled on the first sample, for arrays ``(..., samples)``.

    The model is linear: the filter on the inputs of a simulation, or on its outputs, is the same.

    Parameters
    ----------
    cutoff_rad_s
        Where the magnitude has fallen by 3 dB.
    rate_hz
        Of the record.

    Raises
    ------
    UsageError
        The cutoff does not lie between zero and half of the sample rate.
    """
    from scipy.signal import butter, lfilter, lfilter_zi

    if not 0.0 < cutoff_rad_s < np.pi * rate_hz:
        raise UsageError(
            f"a low-pass at {cutoff_rad_s:.4g} rad/s is not possible",
            needed=f"between 0 and the Nyquist frequency of {np.pi * rate_hz:.4g} rad/s",
        )
    b, a = butter(1, cutoff_rad_s / (np.pi * rate_hz))
    settled = lfilter_zi(b, a)
    return lambda values: np.asarray(lfilter(b, a, values, axis=-1, zi=values[..., :1] * settled)[0])


def vibration(measured: FloatArray, band_rad_s: tuple[float, float], rate_hz: float) -> FloatArray:
    """Power of each output above the band relative to that below its upper end, shape ``(y,)``.

    Parameters
    ----------
    measured
        Shape ``(y, samples)``.
    band_rad_s
        The fitted band.
    """
    spectrum = np.abs(np.fft.rfft((measured - measured.mean(axis=1, keepdims=True)) * np.hanning(measured.shape[1])))
    omega = 2.0 * np.pi * np.fft.rfftfreq(measured.shape[1], 1.0 / rate_hz)
    power = spectrum**2
    inside = power[:, omega <= band_rad_s[1]].sum(axis=1)
    share: FloatArray = power[:, omega > band_rad_s[1]].sum(axis=1) / np.where(inside > 0.0, inside, np.inf)
    return share


def chosen_low_pass(
    choice: LowPass, measured: FloatArray, band_rad_s: tuple[float, float], rate_hz: float
) -> float | None:
    """The low-pass to use: the one given, or 100 rad/s where an output vibrates, or none.

    Parameters
    ----------
    choice
        A cutoff in rad/s, ``auto`` to decide by the data, ``None`` for none.
    measured
        Shape ``(y, samples)``.
    band_rad_s
        The fitted band.
    """
    if choice != "auto":
        return choice
    fast_enough = np.pi * rate_hz > VIBRATION_LOW_PASS_RAD_S
    if fast_enough and vibration(measured, band_rad_s, rate_hz).max() > VIBRATING:
        return VIBRATION_LOW_PASS_RAD_S
    return None
