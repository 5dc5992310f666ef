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
from rotorid.verify.verification import Scores, Verification

_LEAST_PERIODS = 1.5
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

    What the model cannot know is estimated by linear least squares, everything else is frozen: the initial state
    :math:`x_0`, a constant bias :math:`b` of the first state equation (trim, steady wind) and reference shifts
    :math:`c` of the outputs,

    .. math:: \hat y = y_{model}(u) + \Phi(t) x_0 + \Psi(t) b + c

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
    columns = [band_pass(column) for column in _free_responses(system, u.shape, rate)]
    shifts = np.kron(np.eye(len(outputs)), np.ones(measured.shape[1]))
    regressors = np.vstack([*(column.ravel() for column in columns), shifts]).T
    coefficients = np.linalg.lstsq(regressors, (measured - forced).ravel(), rcond=1e-9)[0]
    predicted = forced + (regressors @ coefficients).reshape(measured.shape)
    offsets, bias = coefficients[len(columns) :], float(coefficients[len(columns) - 1])
    scores = {
        name: Scores(
            nrmse_fit_percent=nrmse_fit_percent(measured[row], predicted[row]),
            tic=theil_inequality(measured[row] - offsets[row], predicted[row] - offsets[row]),
            rms=rms(measured[row] - predicted[row]),
            bias=bias,
            reference_shift=float(offsets[row]),
        )
        for row, name in enumerate(outputs)
    }
    return Verification(
        record=record,
        maneuver=maneuver,
        time_s=history.time_s,
        inputs=u,
        measured=measured,
        predicted=predicted,
        input_names=inputs,
        output_names=outputs,
        scores=scores,
    )


def _free_responses(system: StateSpace, shape: tuple[int, ...], rate_hz: float) -> list[FloatArray]:
    """Responses to each initial state, and last to a constant bias of the first state equation."""
    quiet = np.zeros(shape)
    states = np.eye(system.F.shape[0])
    dynamic = np.flatnonzero(np.abs(system.M).sum(axis=1) > 0.0)
    free = [simulate_linear(system, quiet, sample_rate_hz=rate_hz, x0=states[state]) for state in dynamic]
    return [*free, simulate_linear(system, quiet, sample_rate_hz=rate_hz, bias=states[dynamic[0]])]


def _band_pass(
    band_rad_s: tuple[float, float], rate_hz: float, duration_s: float
) -> Callable[[FloatArray], FloatArray]:
    from scipy.signal import butter, sosfiltfilt

    low, high = (edge / (np.pi * rate_hz) for edge in band_rad_s)
    sections = []
    if high < 0.9:
        sections.append(butter(_FILTER_ORDER, high, output="sos"))
    if band_rad_s[0] * duration_s / (2.0 * np.pi) >= _LEAST_PERIODS and low < min(high, 0.9):
        sections.append(butter(_FILTER_ORDER, low, btype="high", output="sos"))
    if not sections:
        return np.asarray
    stacked = np.vstack(sections)
    return lambda values: np.asarray(
        sosfiltfilt(stacked, values, axis=-1, padlen=min(values.shape[-1] - 1, 3 * round(rate_hz)))
    )
