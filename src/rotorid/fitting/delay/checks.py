"""Checks of an estimated delay: outputs that move before their inputs, and the delay in whole samples.

Outputs that move first bear the mark of a zero-phase filter on the outputs alone. A whole number of samples is what
toolboxes estimate, for comparison with published numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.fitting.equations.regression import regress
from rotorid.typing import FloatArray

_LEADS, _LAGS = 6, 30
_SURELY = 1e-3
_BANDS_PER_OCTAVE = 4
_FEWEST_LINES = 3
_STEEPEST_LAG_DB = 30.0
"""A lag of fifth order falls so much in an octave. Lags of a vehicle are not that steep; filters made to be are."""

_PASSED = 0.75
"""Share of the frequency where the fall begins up to which a filter leaves magnitudes nearly as they are."""

_INPUT_FLOOR_DB = -40.0


@dataclass(frozen=True, kw_only=True)
class Acausal(Immutable):
    """An output that a steep low-pass went over, and how surely it runs ahead of its input.

    Parameters
    ----------
    cutoff_rad_s
        Where the output begins to fall faster than any vehicle.
    fall_db
        By how much it falls in the octave from there, against the input.
    lead_s
        How far ahead of the input it moves significantly; zero where that could not be shown.
    probability
        That a causal response shows as much before its input by chance, over all records.
    """

    cutoff_rad_s: float
    fall_db: float
    lead_s: float
    probability: float

    @property
    def ahead(self) -> bool:
        """Whether the output surely answers before its input."""
        return self.probability <= _SURELY

    @property
    def passed_rad_s(self) -> float:
        """Up to where the filter leaves the response alone."""
        return _PASSED * self.cutoff_rad_s


def steep_output(histories: Sequence[TimeHistory], *, input: str, output: str) -> Acausal | None:
    """Tell whether an output was low-passed without phase while its input was not.

    Two marks are needed. Against the input, the power of the output falls by more than 30 dB in an octave, as no lag of
    a vehicle does; and either the output answers before its input, in a regression on inputs to come, or there is
    a causal filter as steep would have delayed it by several periods instead. Holds for inputs that
    contain no feedback of the output; feedback runs ahead by nature.

    Parameters
    ----------
    histories
        Records of one rate.

    Returns
    -------
    Acausal or None
        What was found.
    """
    found = [fall for history in histories if (fall := _fall(history[input], history[output], history.sample_rate_hz))]
    if 2 * len(found) <= len(histories):
        return None
    cutoff = float(np.median([value for value, _ in found]))
    tests = [test for history in histories if (test := _ahead(history[input], history[output]))]
    if not tests:
        return None
    chance, lead = _together(tests)
    return Acausal(
        cutoff_rad_s=cutoff,
        fall_db=float(np.median([fall for _, fall in found])),
        lead_s=lead / histories[0].sample_rate_hz,
        probability=chance,
    )


def _fall(u: FloatArray, y: FloatArray, sample_rate_hz: float) -> tuple[float, float] | None:
    """Frequency at which the steepest octave of output over input begins, and its fall in dB, where it is steep."""
    taper = np.hanning(y.size)
    power = [np.abs(np.fft.rfft((signal - signal.mean()) * taper)) ** 2 for signal in (u, y)]
    omega = 2.0 * np.pi * np.fft.rfftfreq(y.size, 1.0 / sample_rate_hz)
    lowest = 2.0 * np.pi * sample_rate_hz * _FEWEST_LINES * _BANDS_PER_OCTAVE / y.size
    count = int(np.log2(max(omega[-1] / lowest, 1.0)) * _BANDS_PER_OCTAVE)
    edges = lowest * 2.0 ** (np.arange(count + 1) / _BANDS_PER_OCTAVE)
    if count <= _BANDS_PER_OCTAVE or not power[0].any() or not power[1].any():
        return None
    which = np.digitize(omega, edges) - 1
    levels = [
        10.0 * np.log10(np.maximum([p[which == band].mean() for band in range(count)], np.finfo(float).tiny))
        for p in power
    ]
    ratio = np.where(levels[0] > levels[0].max() + _INPUT_FLOOR_DB, levels[1] - levels[0], np.nan)
    falls = ratio[:-_BANDS_PER_OCTAVE] - ratio[_BANDS_PER_OCTAVE:]
    if np.isnan(falls).all() or np.nanmax(falls) < _STEEPEST_LAG_DB:
        return None
    steepest = int(np.nanargmax(falls))
    return float(np.sqrt(edges[steepest] * edges[steepest + 1])), float(falls[steepest])


def _ahead(u: FloatArray, y: FloatArray) -> tuple[float, FloatArray] | None:
    """Wald statistic of the response before the input, and each component in standard deviations, largest first."""
    lags = np.arange(-_LEADS, _LAGS + 1)
    k = np.arange(_LAGS, y.size - _LEADS)
    if k.size < 2 * lags.size:
        return None
    try:
        fit = regress(u[k[:, None] - lags], y[k], [str(lag) for lag in lags])
    except InsufficientDataError:
        return None
    # A sample of either clock may be late by one; what comes two samples ahead is no matter of stamps.
    ahead = np.arange(_LEADS - 1)
    part = fit.estimates[ahead]
    covariance = fit.colored_covariance[np.ix_(ahead, ahead)]
    white = fit.covariance[np.ix_(ahead, ahead)]
    # Of two estimates of one covariance the wider: residuals of an unfinished response make the other too small.
    statistic = min(float(part @ np.linalg.pinv(matrix) @ part) for matrix in (covariance, white))
    spread = np.sqrt(np.maximum(np.diag(covariance), np.diag(white)))
    return statistic, part / spread


def _together(tests: Sequence[tuple[float, FloatArray]]) -> tuple[float, int]:
    """Probability of all records together by chance, and the farthest sample that moves ahead."""
    from scipy.stats import chi2

    total = sum(statistic for statistic, _ in tests)
    chance = float(chi2.sf(total, len(tests) * (_LEADS - 1)))
    joint = np.sum([strength for _, strength in tests], axis=0) / np.sqrt(len(tests))
    moving = np.flatnonzero(np.abs(joint) > 3.0)
    return chance, int(_LEADS - moving[0]) if moving.size else 0


_ORDER = 2
_NEGLIGIBLE = 4.0
_ROUNDING = 1e-20
_NOTHING = 1e-300
_ENOUGH = 20_000
"""Predictions that are compared; of longer records some are left out, evenly spread."""


def delay_in_samples(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], *, least: int, most: int) -> int:
    r"""Delay of the ARX model of second order that predicts best.

    .. math:: y_k + a_1 y_{k-1} + a_2 y_{k-2} = b_1 u_{k-d} + b_2 u_{k-d-1} + e_k

    This is what ``delayest`` of MATLAB's System Identification Toolbox does with its defaults; of delays that predict
    alike the longest is taken. A held input acts on a
    sampled output one sample later at the earliest, so :math:`d = 1` means no delay, and :math:`d - 1` is returned.
    Noise on the output makes the ARX model prefer the delay that suits its one-step prediction, not the vehicle's.

    Parameters
    ----------
    inputs, outputs
        One array of samples for each record.
    least, most
        Delays to try, in samples; negative ones look for outputs that run ahead.

    Raises
    ------
    InsufficientDataError
        No record is long enough.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> u, y = rng.choice([-1.0, 1.0], size=300), np.zeros(300)
    >>> for k in range(5, 300):
    ...     y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 4] + 0.01 * rng.normal()
    >>> delay_in_samples([u], [y], least=0, most=8)
    3
    """
    tried = range(least, most + 1)
    losses = _losses(inputs, outputs, tried)
    if losses.size == 0 or not np.isfinite(losses).any():
        raise InsufficientDataError(
            "the records are shorter than the delays to try", needed=f"more than {most + 3 * _ORDER + 8} samples"
        )
    samples = min(sum(y.size for y in outputs), _ENOUGH)
    # A model whose first coefficient of the input is zero predicts as well with a delay of one sample less.
    alike = np.flatnonzero(losses <= losses.min() * (1.0 + _NEGLIGIBLE / samples) + _ROUNDING)
    return list(tried)[int(alike[-1])]


def _losses(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], tried: range) -> FloatArray:
    """Sum of squared one-step errors for each delay, over the samples that all delays can predict."""
    least, most = tried.start + 1, tried.stop
    step = 1 + sum(y.size for y in outputs) // _ENOUGH
    spans = [np.arange(max(most, 0) + _ORDER, y.size + min(least, 0), step) for y in outputs]
    if sum(k.size for k in spans) <= 2 * _ORDER:
        return np.full(len(tried), np.inf)
    past = np.concatenate([np.stack([y[k - 1], y[k - 2]], axis=1) for y, k in zip(outputs, spans, strict=True)])
    own = np.linalg.qr(past)[0]

    def beyond(signals: Sequence[FloatArray], lag: int) -> FloatArray:
        """The part of a late signal that the past of the output does not predict."""
        late = np.concatenate([signal[k - lag] for signal, k in zip(signals, spans, strict=True)])
        return np.asarray(late - own @ (own.T @ late))

    target, losses, here = beyond(outputs, 0), [], beyond(inputs, least)
    for delay in tried:
        before, here = here, beyond(inputs, delay + 2)
        left = _without(target, before)
        left = _without(left, _without(here, before))
        losses.append(float(left @ left))
    return np.array(losses)


def _without(values: FloatArray, other: FloatArray) -> FloatArray:
    """``values`` with ``other`` projected out; all of them if the other is only rounding."""
    power = float(other @ other)
    return values - other * (float(other @ values) / power) if power > _NOTHING else values
