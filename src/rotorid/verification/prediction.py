"""Predict a little ahead, again and again: how far a model carries from a state that the measurement shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.typing import BoolArray, FloatArray
from rotorid.verification.sampled import Sampled, bounded_states
from rotorid.verification.scores import GOOD_FIT_PERCENT, nrmse_fit_percent, rms, theil_inequality

HORIZONS_S = (0.5, 1.0)
"""How far ahead is predicted by default, the shortest first."""

_WINDOW_S = 0.3
"""Measured time from which the state of each restart is estimated."""

_LEAST_WINDOW = 12
"""Samples of that window at least."""

_LEAST_RESTARTS = 20
"""Least number of predictions for a score at the longest horizon."""

_REWEIGHTED = 3
_UNSEEN = 1e-6

_CHANCE = 0.05
"""Chance at which gusts alone pass the limit to the error before the maneuver."""

_LOOK_AHEAD = 2.0
"""The time for which predictions hold is looked for up to this many times the longest horizon."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HorizonScores:
    """How one output was predicted over one horizon.

    Parameters
    ----------
    nrmse_fit_percent, tic, rms
        As in :class:`rotorid.verification.verification.Scores`.
    skill
        One minus the error over that of the trivial predictor "stays as it is": 1 is perfect, 0 no better than that.
    over_quiet
        The error over that before the maneuver, or ``None`` where it is unknown.
    over_quiet_limit
        What the same gusts in both would exceed in one of twenty cases.
    """

    nrmse_fit_percent: float
    tic: float
    rms: float
    skill: float
    over_quiet: float | None = None
    over_quiet_limit: float = math.inf

    @property
    def above_gusts(self) -> bool:
        """Whether the error is larger than what disturbed the vehicle before the maneuver explains."""
        return self.over_quiet is None or self.over_quiet > self.over_quiet_limit


@dataclass(frozen=True, kw_only=True, eq=False)
class Horizon(Immutable):
    """All predictions over one horizon.

    Parameters
    ----------
    horizon_s
        How far ahead.
    time_s
        Instants that were predicted, on the log's own clock, shape ``(n,)``.
    measured, predicted
        Outputs at those instants about their mean, shape ``(y, n)``.
    scores
        Output name to scores over the maneuver, with one horizon after it.
    """

    horizon_s: float
    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    scores: Mapping[str, HorizonScores]

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            measured=read_only(self.measured, np.float64, ndim=2),
            predicted=read_only(self.predicted, np.float64, ndim=2),
            scores=self.scores,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Immutable):
    """Predictions over several horizons, restarted at every sample.

    Parameters
    ----------
    window_s
        Length of the past from which each start was estimated.
    horizons
        The shortest one first.
    holds_s
        Output name to the horizon up to which the fit stays at 50 % and more, as far as the record lets it be seen.
    """

    window_s: float
    horizons: tuple[Horizon, ...]
    holds_s: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(horizons=tuple(self.horizons), holds_s=self.holds_s)


def predict_ahead(
    model: Sampled,
    measured: FloatArray,
    *,
    names: Sequence[str],
    time_s: FloatArray,
    horizons_s: Sequence[float] = HORIZONS_S,
    maneuver_s: tuple[float, float] = (-math.inf, math.inf),
) -> Prediction:
    r"""Predict a record k steps ahead from each of its samples.

    At each restart the state is the one that fits the last 0.3 s best, in least squares weighted with the errors that
    it leaves; from there the model runs on the measured inputs alone. Constant biases in the state equations and
    shifts of the outputs are the same for the whole record, estimated together with all states:

    .. math:: \min_{x_r, \beta} \sum_r || y_r - y_{model}(u)_r - \Phi x_r - \Psi \beta ||^2_R

    Nothing of what is predicted enters its own state. An unstable airframe can be judged so: over a horizon of about
    its time to double, errors of start and wind have not grown much, but a wrong derivative or delay shows. Gusts
    within the horizon are not predicted and count as error; so the error is compared with that before the maneuver,
    which the same gusts cause: their ratio is that of two variances, each of as many independent errors as horizons fit
    in. A model that has all its dynamics far above
    one over the horizon only shows its steady gain.

    Parameters
    ----------
    model
        The model on the samples of the record.
    measured
        Outputs, shape ``(y, samples)``, filtered as the inputs of ``model``.
    names
        Names of the outputs.
    time_s
        Stamps, shape ``(samples,)``.
    horizons_s
        How far ahead, the shortest first.
    maneuver_s
        Start and stop of the maneuver, which is scored; what lies before it is quiet. By default all is scored.

    Raises
    ------
    InsufficientDataError
        The record is shorter than window and shortest horizon.
    """
    rate = (time_s.size - 1) / (time_s[-1] - time_s[0]) if time_s.size > 1 else 1.0
    window = max(_LEAST_WINDOW, round(_WINDOW_S * rate))
    least = window + round(horizons_s[0] * rate) + _LEAST_RESTARTS
    if time_s.size < least:
        raise InsufficientDataError(
            f"{time_s.size / rate:.2f} s of data are too short",
            needed=f"at least {least / rate:.2f} s to predict {horizons_s[0]:g} s ahead",
        )
    furthest = min(time_s.size - _LEAST_RESTARTS, window + 1 + round(_LOOK_AHEAD * max(horizons_s) * rate))
    mean = measured.mean(axis=1, keepdims=True)
    target = measured - mean
    ahead = _ahead(model, target, window, furthest)
    horizons = [
        _horizon(horizon_s, round(horizon_s * rate), ahead, target, window, names, time_s, maneuver_s)
        for horizon_s in horizons_s
        if window + round(horizon_s * rate) < furthest
    ]
    return Prediction(
        window_s=window / rate,
        horizons=tuple(horizons),
        holds_s=dict(zip(names, _holds(ahead, target, window) / rate, strict=True)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ahead:
    r"""Predictions from every restart, any number of steps ahead.

    Two motions under the same inputs differ by a free one. So one motion of the whole record serves all restarts, and
    nothing need be simulated from each of them:

    .. math:: y_{r,j} = y_{r+j} + C \Phi^j (x_r - x^{whole}_r)

    ``whole`` are the outputs of that motion, shape ``(samples, y)``, and ``start_offsets`` is how far the start of each
    restart lies from it, shape ``(restarts, x)``. What each state and all constants do, step by step, are ``free`` and
    ``constant``, shapes ``(length, y, x)`` and ``(length, y)``.
    """

    whole: FloatArray
    start_offsets: FloatArray
    free: FloatArray
    constant: FloatArray

    @property
    def furthest(self) -> int:
        """The most steps ahead that there are."""
        return len(self.free) - 1

    def at(self, steps: int) -> FloatArray:
        """Outputs so many steps after each restart within the record, shape ``(y, restarts inside)``."""
        late = self.whole[steps:]
        predicted: FloatArray = late + self.start_offsets[: len(late)] @ self.free[steps].T + self.constant[steps]
        return predicted.T


def _ahead(model: Sampled, target: FloatArray, window: int, furthest: int) -> _Ahead:
    """Restart at every sample that has a window before it."""
    restarts = target.shape[1] - window
    states = bounded_states(model)
    whole, before = model.outputs_of(states) + model.direct, states[:restarts]
    free, constant = _free(model, furthest), _constant(model, furthest)
    responses, common = free[: window + 1], constant[: window + 1]
    past = sliding_window_view(target.T - whole, window + 1, axis=0).swapaxes(1, 2)
    left = past + np.tensordot(before, responses, axes=(1, 2))
    size = target.std(axis=1)
    least = _UNSEEN * np.where(size > 0.0, size, 1.0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    for _ in range(_REWEIGHTED):
        starts, beta = _estimate(left * weights, *(part * weights[:, None] for part in (responses, common)))
        rest = left - np.tensordot(starts, responses, axes=(1, 2)) - common @ beta
        weights = 1.0 / np.maximum(np.sqrt(np.mean(rest**2, axis=(0, 1))), least)
    return _Ahead(whole=whole, start_offsets=starts - before, free=free, constant=constant @ beta)


def _estimate(left: FloatArray, free: FloatArray, constant: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The state of each restart ``(r, x)`` and the constants of all ``(c,)``, by separable least squares."""
    restarts = left.shape[0]
    flat = left.reshape(restarts, -1)
    columns, common = free.reshape(flat.shape[1], -1), constant.reshape(flat.shape[1], -1)
    scale, size = _norms(columns), _norms(common)
    basis, values, rows = np.linalg.svd(columns / scale, full_matrices=False)
    determined = values > _UNSEEN * values[0]
    basis, inverse = basis[:, determined], (rows[determined].T / values[determined]) / scale[:, None]
    # What no state of a window explains on the average is what the constants are for.
    orthogonal = common / size - basis @ (basis.T @ (common / size))
    rest = flat.mean(axis=0)
    rest = rest - basis @ (basis.T @ rest)
    beta = np.linalg.lstsq(orthogonal, rest, rcond=1e-3)[0] / size
    return (flat - common @ beta) @ basis @ inverse.T, beta


def _norms(columns: FloatArray) -> FloatArray:
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _free(model: Sampled, length: int) -> FloatArray:
    """Free responses of unit states, shape ``(length, y, x)``."""
    order = len(model.transition)
    states = np.empty((order, model.lead + length, order))
    states[:, 0] = np.eye(order)
    for step in range(model.lead + length - 1):
        states[:, step + 1] = states[:, step] @ model.transition.T
    free: FloatArray = np.moveaxis(model.outputs_of(states), 0, -1)
    return free


def _constant(model: Sampled, length: int) -> FloatArray:
    """Responses to a unit bias in each equation and to a unit shift of each output, shape ``(length, y, e + y)``."""
    states = np.zeros((len(model.biases), model.lead + length, len(model.transition)))
    for step in range(model.lead + length - 1):
        states[:, step + 1] = states[:, step] @ model.transition.T + model.biases
    biased = np.moveaxis(model.outputs_of(states) + model.direct_biases[:, None], 0, -1)
    outputs = model.measured.shape[0]
    return np.concatenate([biased, np.broadcast_to(np.eye(outputs), (length, outputs, outputs))], axis=-1)


def _horizon(
    horizon_s: float,
    steps: int,
    ahead: _Ahead,
    target: FloatArray,
    window: int,
    names: Sequence[str],
    time_s: FloatArray,
    maneuver_s: tuple[float, float],
) -> Horizon:
    inside = target.shape[1] - window - steps
    predicted, measured = ahead.at(window + steps), target[:, window + steps :]
    trivial = target[:, window : window + inside]
    late_s = time_s[window + steps :]
    quiet, scored = late_s < maneuver_s[0], (late_s >= maneuver_s[0]) & (late_s <= maneuver_s[1] + horizon_s)
    if not scored.any():
        quiet, scored = np.zeros_like(scored), np.ones_like(scored)
    limit = _limit(*(np.count_nonzero(part) / steps for part in (scored, quiet)))
    return Horizon(
        horizon_s=horizon_s,
        time_s=late_s,
        measured=measured,
        predicted=predicted,
        scores={
            name: _scores(y, y_hat, stays, scored, quiet, limit)
            for name, y, y_hat, stays in zip(names, measured, predicted, trivial, strict=True)
        },
    )


def _scores(
    measured: FloatArray, predicted: FloatArray, stays: FloatArray, scored: BoolArray, quiet: BoolArray, limit: float
) -> HorizonScores:
    error, mean = rms((measured - predicted)[scored]), measured[scored].mean()
    trivial = rms((measured - stays)[scored])
    before = rms((measured - predicted)[quiet]) if math.isfinite(limit) else 0.0
    return HorizonScores(
        nrmse_fit_percent=nrmse_fit_percent(measured[scored], predicted[scored]),
        tic=theil_inequality(measured[scored] - mean, predicted[scored] - mean),
        rms=error,
        skill=1.0 - error / trivial if trivial > 0.0 else 0.0,
        over_quiet=error / before if before > 0.0 else None,
        over_quiet_limit=limit,
    )


def _limit(scored: float, quiet: float) -> float:
    """Ratio of two errors of the same gusts that is exceeded in one of twenty cases, by Fisher's distribution.

    Both arguments are numbers of independent errors; infinite where there is not even one before the maneuver.
    """
    from scipy.stats import f

    return float(np.sqrt(f.ppf(1.0 - _CHANCE, scored, quiet))) if quiet >= 1.0 else math.inf


def _holds(ahead: _Ahead, target: FloatArray, window: int) -> FloatArray:
    """Steps ahead up to which the fit stays good, for each output."""
    motion = target.std(axis=1)
    limit = (1.0 - GOOD_FIT_PERCENT / 100.0) * motion
    furthest = ahead.furthest - window
    horizons, holding = np.full(motion.size, float(furthest)), np.ones(motion.size, dtype=bool)
    for steps in range(1, furthest + 1):
        error = np.sqrt(np.mean((ahead.at(window + steps) - target[:, window + steps :]) ** 2, axis=1))
        ends = holding & (error > limit)
        horizons[ends], holding = steps - 1.0, holding & ~ends
        if not holding.any():
            break
    return horizons
