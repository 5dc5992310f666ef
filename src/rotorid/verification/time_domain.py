"""Predict an unseen maneuver in the time domain, with every parameter of the model frozen."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.models.state_space import StateSpace
from rotorid.typing import FloatArray
from rotorid.verification.prediction import HORIZONS_S, Prediction, predict_ahead
from rotorid.verification.sampled import (
    Filter,
    LowPass,
    adjust,
    band_pass,
    bounded_responses,
    chosen_low_pass,
    low_pass,
    sampled,
)
from rotorid.verification.scores import j_rms, nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores, Verification, shortest_horizon

MOVED = 2.0
"""An output that moves this many times as much as before the maneuver was moved by it."""

_QUIET_S = 0.5
"""Time before a maneuver with which its motion is compared, at least."""

_SETTLED_S = 0.8
"""Initial quiet part to skip: it contains the end of the maneuver before and of the filter."""


def verify_in_time(
    system: StateSpace,
    history: TimeHistory,
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    band_rad_s: tuple[float, float],
    record: str,
    maneuver: Maneuver,
    around: TimeHistory | None = None,
    vibration_filter: LowPass = "auto",
) -> Verification:
    r"""Drive a model with measured inputs and compare its outputs with the measured ones.

    What the model cannot know is estimated by linear least squares, everything else is frozen: reference shifts
    :math:`c` of the outputs, the initial state :math:`x_0`, and a constant bias :math:`b` of every dynamic state
    equation (trim, steady wind), where they can be separated, see :func:`rotorid.verification.sampled.adjust`,

    .. math:: \hat y = y_{model}(u) + c + \Phi(t) x_0 + \Psi(t) b

    A model is judged where it was identified: measurement and prediction pass the same zero-phase filter, a low-pass
    at the upper end of the fitted band and, where the maneuver holds 1.5 periods of it, a high-pass at the lower end.
    Where more than a tenth of the power of an output lies above the band, both pass a first-order low-pass of
    100 rad/s too.

    Beside this open loop, the model predicts a little ahead from every sample, see
    :func:`rotorid.verification.prediction.predict_ahead`. For an unstable airframe that is what counts: in open loop it
    diverges after a while, which is no verdict on the model, and an initial state that is fitted to the whole maneuver
    hides more than it does for a stable one.

    Parameters
    ----------
    system
        The identified system.
    history
        One maneuver with all inputs and outputs.
    inputs, outputs
        Channel names, in the order of the system.
    band_rad_s
        The fitted band.
    record, maneuver
        Where the data came from.
    around
        The same with more time on either side, for the prediction ahead and to see what moved; ``history`` by default.
    vibration_filter
        Cutoff of the first-order low-pass in rad/s, ``None`` for none, ``auto`` to decide by the data.
    """
    rate = history.sample_rate_hz
    raw = np.stack([history[name] for name in outputs])
    cutoff = chosen_low_pass(vibration_filter, raw, band_rad_s, rate)
    filtered = matched(band_rad_s, cutoff, history)
    u = np.stack([history[name] for name in inputs])
    u = u - u.mean(axis=1, keepdims=True)
    measured = filtered(raw)
    # The input before the record is unknown; a constant first value is the best guess for a delayed input.
    responses = bounded_responses(sampled(system, u, sample_rate_hz=rate, before=u[:, 0]))
    forced = filtered(responses.forced)
    adjustment = adjust(responses, measured - forced, weights=_weights(measured), filtered=filtered)
    predicted = forced + adjustment.response
    dynamic = np.flatnonzero(np.abs(system.M).sum(axis=1) > 0.0)
    bias = float(adjustment.biases[dynamic[0]])
    growth = float(system.poles().real.max(initial=0.0))
    return Verification(
        record=record,
        maneuver=maneuver,
        time_s=history.time_s,
        inputs=u,
        measured=measured,
        predicted=predicted,
        input_names=inputs,
        output_names=outputs,
        scores={
            name: _scores(measured[row], predicted[row], bias=bias, shift=float(adjustment.shifts[row]))
            for row, name in enumerate(outputs)
        },
        biases=adjustment.biases,
        j_rms=j_rms(measured - predicted, [_unit(history, name) for name in outputs]),
        growth_1_s=max(growth, 0.0),
        low_pass_rad_s=cutoff,
        moved=_moved(around or history, maneuver, outputs, band_rad_s),
        ahead=_ahead(system, around or history, maneuver, inputs, outputs, band_rad_s, growth),
    )


def matched(band_rad_s: tuple[float, float], cutoff_rad_s: float | None, history: TimeHistory) -> Filter:
    """The filter that measurement and prediction of a record pass: the fitted band, and a low-pass where there is one.

    Parameters
    ----------
    band_rad_s
        The fitted band.
    cutoff_rad_s
        Of the low-pass against vibration, or ``None``.
    history
        The record; its rate and length decide.
    """
    band = band_pass(band_rad_s, history.sample_rate_hz, history.duration_s)
    if cutoff_rad_s is None:
        return band
    smooth = low_pass(cutoff_rad_s, history.sample_rate_hz)
    return lambda values: smooth(band(values))


def _weights(measured: FloatArray) -> FloatArray:
    size = measured.std(axis=1)
    return np.asarray(1.0 / np.where(size > 0.0, size, 1.0))


def _unit(history: TimeHistory, name: str) -> str:
    return history.channels[history.names.index(name)].unit


def _scores(measured: FloatArray, predicted: FloatArray, *, bias: float, shift: float) -> Scores:
    """Scores of one output about its trim: a hover of -9.81 m/s^2 that is predicted as such is no merit of a model."""
    trim = measured.mean()
    return Scores(
        nrmse_fit_percent=nrmse_fit_percent(measured - trim, predicted - trim),
        tic=theil_inequality(measured - trim, predicted - trim),
        rms=rms(measured - predicted),
        bias=bias,
        reference_shift=shift,
    )


def _moved(
    history: TimeHistory, maneuver: Maneuver, outputs: tuple[str, ...], band_rad_s: tuple[float, float]
) -> tuple[str, ...]:
    """Outputs that move clearly more in a maneuver than before it, within the band; all if unknown."""
    time_s, rate = history.time_s, history.sample_rate_hz
    settled_s = min(history.start_s + _SETTLED_S, maneuver.start_s - _QUIET_S)
    quiet = (time_s >= settled_s) & (time_s < maneuver.start_s)
    flown = (time_s >= maneuver.start_s) & (time_s <= maneuver.stop_s)
    if settled_s < history.start_s - 1.0 / rate or not flown.any():
        return outputs
    motion = band_pass(band_rad_s, rate, history.duration_s)(np.stack([history[name] for name in outputs]))
    before, during = (motion[:, part].std(axis=1) for part in (quiet, flown))
    return tuple(name for name, a, b in zip(outputs, before, during, strict=True) if b > MOVED * a)


def _ahead(
    system: StateSpace,
    history: TimeHistory,
    maneuver: Maneuver,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    band_rad_s: tuple[float, float],
    growth_1_s: float,
) -> Prediction | None:
    rate = history.sample_rate_hz
    # The model is linear, so filtered inputs drive it to filtered outputs; only the ends of the record separate them.
    band = band_pass(band_rad_s, rate, history.duration_s)
    u = np.stack([history[name] for name in inputs])
    u = band(u - u.mean(axis=1, keepdims=True))
    model = sampled(system, u, sample_rate_hz=rate, before=u[:, 0])
    horizons = sorted({shortest_horizon(growth_1_s), *HORIZONS_S})
    try:
        return predict_ahead(
            model,
            band(np.stack([history[name] for name in outputs])),
            names=outputs,
            time_s=history.time_s,
            horizons_s=horizons,
            maneuver_s=(maneuver.start_s, maneuver.stop_s),
        )
    except InsufficientDataError:
        return None
