"""Predict an unseen maneuver in the time domain, with every parameter of the model frozen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.models.state_space import StateSpace
from rotorid.simulate.linear import simulate_linear
from rotorid.typing import FloatArray
from rotorid.verify.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verify.unknowns import adjust
from rotorid.verify.verification import Scores, Verification

_LEAST_PERIODS = 1.5
_LEAST_PADDING_S = 3.0
_FILTER_ORDER = 2


def verify_in_time(
    system: StateSpace,
    history: TimeHistory,
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    band_rad_s: tuple[float, float],
    record: str,
    maneuver: Maneuver,
) -> Verification:
    r"""Drive a model with measured inputs and compare its outputs with the measured ones.

    What the model cannot know is estimated by linear least squares, everything else is frozen: reference shifts
    :math:`c` of the outputs, the initial state :math:`x_0`, and a constant bias :math:`b` of the first state equation
    (trim, steady wind), as far as they can be told apart, see :func:`rotorid.verify.unknowns.adjust`,

    .. math:: \hat y = y_{model}(u) + c + \Phi(t) x_0 + \Psi(t) b

    A model is judged where it was identified: measurement and prediction pass the same zero-phase filter, a low-pass
    at the upper end of the fitted band and, where the maneuver holds 1.5 periods of it, a high-pass at the lower end.

    Open loop: an unstable airframe diverges after a while, which is no verdict on the model; take short maneuvers.

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
    """
    rate = history.sample_rate_hz
    band_pass = _band_pass(band_rad_s, rate, history.duration_s)
    u = np.stack([history[name] for name in inputs])
    u = u - u.mean(axis=1, keepdims=True)
    measured = band_pass(np.stack([history[name] for name in outputs]))
    # What came before is not known; that an input began as it first shows costs a late one the least.
    forced = band_pass(simulate_linear(system, u, sample_rate_hz=rate, before=u[:, 0], hold="first"))
    adjustment = adjust(system, measured - forced, sample_rate_hz=rate, band_pass=band_pass)
    predicted = forced + adjustment.response
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
            name: _scores(measured[row], predicted[row], bias=adjustment.bias, shift=float(adjustment.shifts[row]))
            for row, name in enumerate(outputs)
        },
    )


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


def _band_pass(
    band_rad_s: tuple[float, float], rate_hz: float, duration_s: float
) -> Callable[[FloatArray], FloatArray]:
    from scipy.signal import butter, sosfiltfilt

    low, high = (edge / (np.pi * rate_hz) for edge in band_rad_s)
    sections = []
    if high < 0.9:
        sections.append(butter(_FILTER_ORDER, high, output="sos"))
    least_s = _LEAST_PERIODS * 2.0 * np.pi / band_rad_s[0]
    high_pass = duration_s >= least_s and low < min(high, 0.9)
    if high_pass:
        sections.append(butter(_FILTER_ORDER, low, btype="high", output="sos"))
    if not sections:
        return np.asarray
    stacked = np.vstack(sections)
    # The high-pass filter rings at the ends of a trend; a padding as long as its slowest wave keeps that outside.
    padding_s = max(_LEAST_PADDING_S, least_s if high_pass else 0.0)
    return lambda values: np.asarray(
        sosfiltfilt(stacked, values, axis=-1, padlen=min(values.shape[-1] - 1, round(padding_s * rate_hz)))
    )
