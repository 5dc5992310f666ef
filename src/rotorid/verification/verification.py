"""A verification: measurement, prediction, and the difference between them.

:func:`verdict` reads its numbers: a good model, a poor one, a disturbance that does not let the maneuver decide, or an
unstable airframe, whose open loop leaves the measurement although its prediction ahead is good.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import Maneuver
from rotorid.typing import FloatArray
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.flight import FlightJudgement
from rotorid.verification.prediction import HORIZONS_S, Horizon, Prediction
from rotorid.verification.scores import GUIDELINES, guidelines_met, nrmse_fit_percent, rms, theil_inequality

Kind: TypeAlias = Literal["each", "leave_one_out"]
"""``each``: identified on each record alone and scored on all others. ``leave_one_out``: identified on all records but
one and scored on that one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Scores:
    r"""How one output was predicted.

    Parameters
    ----------
    nrmse_fit_percent
        :math:`100 (1 - ||y - \hat y|| / ||y - \bar y||)`.
    tic
        Theil inequality coefficient of the motion about the trim: the mean of the measurement is taken off both
        signals. Up to 0.25 is good.
    rms
        Root mean square of the error, in the unit of the output.
    bias
        Estimated constant input to the first dynamic state equation. 0 where none was estimated: where it cannot be
        separated from a reference shift or the initial state, or where the filter removes what it does.
    reference_shift
        Estimated constant offset of the output, in its unit, 0 where the filter removes it.
    """

    nrmse_fit_percent: float
    tic: float
    rms: float
    bias: float
    reference_shift: float

    @classmethod
    def plain(cls, measured: FloatArray, predicted: FloatArray) -> Scores:
        """Those of a prediction from which neither bias nor reference shift was taken off, shape ``(n,)`` both."""
        mean = measured.mean()
        return cls(
            nrmse_fit_percent=nrmse_fit_percent(measured, predicted),
            tic=theil_inequality(measured - mean, predicted - mean),
            rms=rms(measured - predicted),
            bias=0.0,
            reference_shift=0.0,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification(Immutable):
    """One unseen maneuver, measured and predicted in open loop.

    Parameters
    ----------
    record
        Name of the file.
    maneuver
        The interval that was predicted.
    time_s
        Stamps on the log's own clock, shape ``(samples,)``.
    inputs
        Inputs of the model, shape ``(u, samples)``, trim removed.
    measured, predicted
        Outputs, shape ``(y, samples)``.
    input_names, output_names
        Channel names of the rows.
    scores
        Output name to scores.
    biases
        Estimated constants in all state equations, shape ``(x,)``.
    j_rms
        Root mean square of all errors in degrees and feet, see :func:`rotorid.verification.scores.j_rms`.
    growth_1_s
        Largest real part of a pole; above zero the airframe is unstable without its controller.
    low_pass_rad_s
        Matched low-pass that measurement and prediction passed beside the fitted band, or ``None``.
    moved
        Outputs that the maneuver moved clearly more than they moved before it: those that test the model.
    ahead
        Predictions over short horizons, restarted at every sample, or ``None`` where the record is too short.
    closed_loop
        The model under the controller that flew, or ``None`` where that is not known.
    flight
        Force, moment and many steps of a physical model; ``None`` for all others.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    predicted: FloatArray
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    scores: Mapping[str, Scores]
    biases: FloatArray = field(default_factory=lambda: np.zeros(0))
    j_rms: float = 0.0
    growth_1_s: float = 0.0
    low_pass_rad_s: float | None = None
    moved: tuple[str, ...] = ()
    ahead: Prediction | None = None
    closed_loop: ClosedLoop | None = None
    flight: FlightJudgement | None = None

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            inputs=read_only(self.inputs, np.float64, ndim=2),
            measured=read_only(self.measured, np.float64, ndim=2),
            predicted=read_only(self.predicted, np.float64, ndim=2),
            scores=self.scores,
            biases=read_only(self.biases, np.float64, ndim=1),
            moved=tuple(self.moved),
        )


Verdict: TypeAlias = Literal["good", "poor", "diverges", "disturbed"]
"""``diverges``: in open loop the prediction leaves the measurement, as that of an unstable airframe must, while it is
good over a horizon in which errors have not grown yet. ``disturbed``: it is not good over that horizon either, but no
worse than before the maneuver, so gusts are as likely a cause as the model."""

_GROWTHS = 1.5
"""E-folds of an error over the horizon of an unstable model: noise and gusts grow by less than five."""


def shortest_horizon(growth_1_s: float) -> float:
    r"""Horizon over which an airframe is judged by prediction ahead, seconds.

    Half a second, or 1.5 times the time :math:`1/\sigma` in which an error grows e-fold if that is shorter: long enough
    that the dynamics show, short enough that noise and gusts have not been multiplied by more than five.

    Parameters
    ----------
    growth_1_s
        Largest real part of a pole.

    Examples
    --------
    >>> shortest_horizon(0.0), shortest_horizon(6.0)
    (0.5, 0.25)
    """
    return min(HORIZONS_S[0], _GROWTHS / growth_1_s) if growth_1_s > 0.0 else HORIZONS_S[0]


def judged_horizon(check: Verification) -> Horizon | None:
    """The prediction ahead that judges an unstable airframe; ``None`` for a stable one, or where there is none."""
    if check.ahead is None or not grows(check):
        return None
    return check.ahead.horizons[0]


def grows(check: Verification) -> bool:
    """Whether an error of the model grows e-fold within the maneuver."""
    duration_s = float(check.time_s[-1] - check.time_s[0])
    return check.growth_1_s * duration_s > 1.0


def poor_outputs(check: Verification) -> tuple[str, ...]:
    """Outputs that the maneuver moved and that the open loop misses."""
    return tuple(
        name
        for name, scores in check.scores.items()
        if name in (check.moved or check.output_names)
        and guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES
    )


def poor_ahead(check: Verification) -> tuple[str, ...]:
    """Outputs that the prediction ahead misses by more than gusts explain, where that is what judges."""
    horizon = judged_horizon(check)
    return () if horizon is None else tuple(n for n in _missed(check, horizon) if horizon.scores[n].above_gusts)


def disturbed_ahead(check: Verification) -> tuple[str, ...]:
    """Outputs that the prediction ahead misses by no more than before the maneuver."""
    horizon = judged_horizon(check)
    return () if horizon is None else tuple(n for n in _missed(check, horizon) if not horizon.scores[n].above_gusts)


def _missed(check: Verification, horizon: Horizon) -> list[str]:
    return [
        name
        for name, scores in horizon.scores.items()
        if name in (check.moved or check.output_names)
        and guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES
    ]


def verdict(check: Verification) -> Verdict:
    """Judge one maneuver.

    A stable model is judged by its open loop. An unstable one is judged by its prediction ahead: if that is poor, so is
    the model, however well a fitted initial state makes the open loop look; if it is good, an open loop that leaves
    the measurement only shows that the airframe is unstable.

    Parameters
    ----------
    check
        One maneuver, measured and predicted.
    """
    if judged_horizon(check) is None:
        return "poor" if poor_outputs(check) else "good"
    if poor_ahead(check):
        return "poor"
    if disturbed_ahead(check):
        return "disturbed"
    return "diverges" if poor_outputs(check) else "good"
