"""Score a model with frozen parameters on a record: only what no model can know is estimated there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.fit.time_data import TimeData, moving
from rotorid.fit.time_problem import TimeProblem, Unknown
from rotorid.models.structure import LinearStructure
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray
from rotorid.verify.prediction import predict_ahead
from rotorid.verify.sampled import sampled
from rotorid.verify.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verify.verdict import shortest_horizon

_GROWTHS = 1.0


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputScore:
    """How one output of one record was predicted.

    Parameters
    ----------
    nrmse_fit_percent, tic
        As in :mod:`rotorid.verify.scores`, about the mean of the measurement.
    rms
        Of the error, in the unit of the output.
    """

    nrmse_fit_percent: float
    tic: float
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FrozenScores(Immutable):
    """A model with frozen parameters on one record.

    Parameters
    ----------
    record
        Its name.
    horizon_s
        How far ahead it was predicted, again from every sample; infinite for a simulation through the record.
    scores
        Output name to its scores.
    time_s
        Seconds since the first sample of the record, shape ``(n,)``.
    measured, predicted
        Shape ``(y, n)``; of a prediction ahead without the first window and horizon, and about the mean.
    """

    record: str
    horizon_s: float
    scores: Mapping[str, OutputScore]
    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray

    def __post_init__(self) -> None:
        self._set(
            scores=self.scores,
            time_s=read_only(self.time_s, np.float64, ndim=1),
            measured=read_only(self.measured, np.float64, ndim=2),
            predicted=read_only(self.predicted, np.float64, ndim=2),
        )

    @property
    def mean_fit_percent(self) -> float:
        """Mean of the outputs."""
        return float(np.mean([score.nrmse_fit_percent for score in self.scores.values()]))


def natural_horizon_s(structure: LinearStructure, values: Mapping[str, float], duration_s: float) -> float:
    """How far ahead a model can be judged on a record: all through it, unless an error grows e-fold within it.

    Parameters
    ----------
    structure, values
        The model.
    duration_s
        Length of the record.

    Returns
    -------
    float
        Infinity, or half a second and less for an unstable model, see :func:`rotorid.verify.verdict.shortest_horizon`.
    """
    growth_1_s = float(structure.matrices(values).poles().real.max(initial=0.0))
    return shortest_horizon(growth_1_s) if growth_1_s * duration_s > _GROWTHS else math.inf


def score_frozen(
    structure: LinearStructure,
    values: Mapping[str, float],
    record: TimeData,
    *,
    horizon_s: float | None = None,
    hold: Hold = "first",
    unknowns: Sequence[Unknown] = ("initial_state", "output_shift"),
) -> FrozenScores:
    """Score a model on one record, with every parameter frozen.

    A stable model is simulated through the record; what is unknown of the record is estimated by linear least squares,
    outputs weighed by their size. An unstable one leaves any measurement, and an initial state fitted to a record of
    several e-foldings explains whatever it likes; it is predicted a short horizon ahead from every sample instead, see
    :func:`rotorid.verify.prediction.predict_ahead`, and inputs then go straight from sample to sample. Scores over
    different horizons do not compare: that over a shorter one is the higher.

    Parameters
    ----------
    structure
        The model.
    values
        All its parameters.
    record
        Inputs and outputs in the order of the structure.
    horizon_s
        How far ahead to predict, infinite for a simulation; by default :func:`natural_horizon_s`.
    hold
        What the inputs do between their samples, for a simulation.
    unknowns
        What is estimated of the record in a simulation.

    Raises
    ------
    UsageError
        The record has other rows than the structure.
    InsufficientDataError
        The record is too short to predict ahead.

    Examples
    --------
    >>> from rotorid.models.response import response_model
    >>> model = response_model("response.first_order", [("phi_setpoint", "phi")])
    >>> step = TimeData(name="step", inputs=np.ones((1, 40)), outputs=np.ones((1, 40)), sample_rate_hz=20.0)
    >>> half = score_frozen(model, {"K_phi": 0.5, "T_phi": 0.2}, step, unknowns=("initial_state",))
    >>> round(half.scores["phi"].rms, 2)
    0.45
    """
    if horizon_s is None:
        horizon_s = natural_horizon_s(structure, values, record.duration_s)
    if math.isfinite(horizon_s):
        return _ahead(structure, values, record, horizon_s)
    problem = TimeProblem(
        structure=structure,
        parameters=structure.parameters.with_values(values),
        records=(record,),
        hold=hold,
        unknowns=tuple(unknowns),
    )
    (fitted,) = problem.predicted(problem.parameters.pack())
    return _scores(structure, record, fitted.predicted)


def _scores(structure: LinearStructure, record: TimeData, predicted: FloatArray) -> FrozenScores:
    return FrozenScores(
        record=record.name,
        horizon_s=math.inf,
        scores={
            name: _score(y, y_hat) for name, y, y_hat in zip(structure.outputs, record.outputs, predicted, strict=True)
        },
        time_s=np.arange(record.samples) / record.sample_rate_hz,
        measured=record.outputs,
        predicted=predicted,
    )


def _score(measured: FloatArray, predicted: FloatArray) -> OutputScore:
    mean = measured.mean()
    return OutputScore(
        # What stands still but for rounding has no motion to explain.
        nrmse_fit_percent=nrmse_fit_percent(measured, predicted) if moving(measured[None])[0] else -math.inf,
        tic=theil_inequality(measured - mean, predicted - mean),
        rms=rms(measured - predicted),
    )


def _ahead(structure: LinearStructure, values: Mapping[str, float], record: TimeData, horizon_s: float) -> FrozenScores:
    time_s = np.arange(record.samples) / record.sample_rate_hz
    model = sampled(
        structure.matrices(values), record.inputs, sample_rate_hz=record.sample_rate_hz, before=record.before
    )
    prediction = predict_ahead(model, record.outputs, names=structure.outputs, time_s=time_s, horizons_s=(horizon_s,))
    (horizon,) = prediction.horizons
    return FrozenScores(
        record=record.name,
        horizon_s=horizon.horizon_s,
        scores={
            name: OutputScore(nrmse_fit_percent=one.nrmse_fit_percent, tic=one.tic, rms=one.rms)
            for name, one in horizon.scores.items()
        },
        time_s=horizon.time_s,
        measured=horizon.measured,
        predicted=horizon.predicted,
    )
