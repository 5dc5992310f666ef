"""Scores of a model with fixed parameters on a record, where only what no model can know is estimated.

Cross-validation is made of them: a model is identified on some records and scored on others, each in its turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.display import counted
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.time.output_error import InitialCondition, TimeData, TimeProblem, moving
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold
from rotorid.typing import BoolArray, FloatArray
from rotorid.verification.driven import driven
from rotorid.verification.prediction import predict_ahead
from rotorid.verification.sampled import sampled
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Kind, shortest_horizon

_GROWTHS = 1.0
"""E-folds of an error within a record beyond which an unstable model is judged by its prediction ahead."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputScore:
    """How one output of one record was predicted.

    Parameters
    ----------
    nrmse_fit_percent, tic
        As in :mod:`rotorid.verification.scores`, about the mean of the measurement.
    rms
        Of the error, in the unit of the output.
    """

    nrmse_fit_percent: float
    tic: float
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedParameterScores(Immutable):
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

    Returns
    -------
    float
        Infinity, or half a second and less for an unstable model, see
        :func:`rotorid.verification.verification.shortest_horizon`.
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
    unknowns: Sequence[InitialCondition] = ("initial_state", "output_shift"),
) -> FixedParameterScores:
    """Score a model on one record, with every parameter frozen.

    A stable model is simulated through the record; what is unknown of the record is estimated by linear least squares,
    outputs weighed by their size. An unstable one leaves any measurement, and an initial state fitted to a record of
    several e-foldings explains whatever it likes; it is predicted a short horizon ahead from every sample instead, see
    :func:`rotorid.verification.prediction.predict_ahead`, and inputs then go straight from sample to sample. Scores
    over different horizons do not compare: that over a shorter one is the higher.

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
    >>> from rotorid.models.library import response_model
    >>> model = response_model("response.first_order", [("phi_setpoint", "phi")])
    >>> step = TimeData(name="step", inputs=np.ones((1, 40)), outputs=np.ones((1, 40)), sample_rate_hz=20.0)
    >>> half = score_frozen(model, {"K_phi": 0.5, "T_phi": 0.2}, step, unknowns=("initial_state",))
    >>> round(half.scores["phi"].rms, 2)
    0.45
    """
    if horizon_s is None:
        horizon_s = natural_horizon_s(structure, values, record.duration_s)
    if math.isfinite(horizon_s):
        return _shown(structure, record, _ahead(structure, values, record, horizon_s))
    problem = TimeProblem(
        structure=structure,
        parameters=structure.parameters.with_values(values),
        records=(record,),
        hold=hold,
        unknowns=tuple(unknowns),
    )
    (fitted,) = problem.predicted(problem.parameters.pack())
    return _shown(structure, record, _scores(structure, record, fitted.predicted))


def _shown(structure: LinearStructure, record: TimeData, found: FixedParameterScores) -> FixedParameterScores:
    """Scores without the fit of outputs that no input of the record moved."""
    moved = driven(structure, record.inputs)
    return replace(
        found,
        scores={
            name: replace(score, nrmse_fit_percent=moved.judged(name, score.nrmse_fit_percent))
            for name, score in found.scores.items()
        },
    )


def _scores(structure: LinearStructure, record: TimeData, predicted: FloatArray) -> FixedParameterScores:
    return FixedParameterScores(
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
        # An output that is constant but for rounding has no motion to explain.
        nrmse_fit_percent=nrmse_fit_percent(measured, predicted) if moving(measured[None])[0] else -math.inf,
        tic=theil_inequality(measured - mean, predicted - mean),
        rms=rms(measured - predicted),
    )


def _ahead(
    structure: LinearStructure, values: Mapping[str, float], record: TimeData, horizon_s: float
) -> FixedParameterScores:
    time_s = np.arange(record.samples) / record.sample_rate_hz
    model = sampled(
        structure.matrices(values), record.inputs, sample_rate_hz=record.sample_rate_hz, before=record.before
    )
    prediction = predict_ahead(model, record.outputs, names=structure.outputs, time_s=time_s, horizons_s=(horizon_s,))
    (horizon,) = prediction.horizons
    return FixedParameterScores(
        record=record.name,
        horizon_s=horizon.horizon_s,
        scores={
            name: OutputScore(nrmse_fit_percent=scores.nrmse_fit_percent, tic=scores.tic, rms=scores.rms)
            for name, scores in horizon.scores.items()
        },
        time_s=horizon.time_s,
        measured=horizon.measured,
        predicted=horizon.predicted,
    )


Group = TypeVar("Group")
Model = TypeVar("Model")


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold(Immutable, Generic[Model]):
    """One identification, and how its model does on every record.

    Parameters
    ----------
    identified
        Names of the records that the fit has seen.
    model
        What was identified; ``None`` where the data did not support it.
    scores
        For each group in the order of all, seen ones included: one for each record of it, none where the model could
        not be scored.
    cause
        Why there is no model, or no score of a record.
    """

    identified: tuple[str, ...]
    model: Model | None
    scores: tuple[tuple[FixedParameterScores, ...], ...]
    cause: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidation(Immutable, Generic[Model]):
    """All identifications, scored on all records.

    Parameters
    ----------
    kind
        What each fold is identified on.
    records
        Names of the groups of records, one for each fold.
    folds
        One for each record.
    """

    kind: Kind
    records: tuple[str, ...]
    folds: tuple[Fold[Model], ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs that were scored."""
        every = (scores for fold in self.folds for group in fold.scores for scores in group)
        return tuple(dict.fromkeys(name for scores in every for name in scores.scores))

    @property
    def horizons_s(self) -> tuple[float, ...]:
        """How far ahead was predicted, shortest first; scores compare where this is one number."""
        return tuple(sorted({scores.horizon_s for fold in self.folds for group in fold.scores for scores in group}))

    @property
    def fit_percent(self) -> FloatArray:
        """Fit percent by fold, scored record and output, shape ``(f, r, y)``; not a number where there is none.

        Of a group with several records it is the mean.
        """
        return np.array(
            [[[fit_percent(group, name) for name in self.outputs] for group in fold.scores] for fold in self.folds]
        )

    @property
    def table(self) -> FloatArray:
        """Mean fit percent of the outputs by fold and scored record, shape ``(f, r)``.

        Outputs that no record moves are left out; where one of the others is missing there is no number.
        """
        every = self.fit_percent
        moved = np.isfinite(every).any(axis=(0, 1))
        if not moved.any():
            return np.full(every.shape[:2], np.nan)
        return np.asarray(every[:, :, moved].mean(axis=2))

    @property
    def unseen(self) -> BoolArray:
        """Whether a record was scored and is unseen by the fold, shape ``(f, r)``."""
        return np.array([[name not in fold.identified for name in self.records] for fold in self.folds])

    @property
    def fold_means(self) -> FloatArray:
        """Mean fit percent of each fold on unseen records, shape ``(f,)``; not a number without a score."""
        return np.array([_mean(row[new]) for row, new in zip(self.table, self.unseen, strict=True)])

    @property
    def fold_spreads(self) -> FloatArray:
        """Standard deviation over the unseen records of each fold, shape ``(f,)``."""
        return np.array([_spread(row[new]) for row, new in zip(self.table, self.unseen, strict=True)])

    @property
    def best(self) -> int | None:
        """The fold with the highest mean, if each has one record.

        Choosing it by the very scores that are then reported is optimistic; :attr:`mean` is not.
        """
        means = self.fold_means
        return None if self.kind != "each" or np.isnan(means).all() else int(np.nanargmax(means))

    @property
    def mean(self) -> float:
        """Mean fit percent on unseen records over all folds."""
        return _mean(self.table[self.unseen])

    @property
    def spread(self) -> float:
        """Standard deviation of the fit percent on unseen records, over all folds and records."""
        return _spread(self.table[self.unseen])


def cross_validate(
    groups: Sequence[Group],
    *,
    names: Sequence[str],
    kind: Kind,
    fit: Callable[[tuple[Group, ...]], Model],
    score: Callable[[Model, Group], Sequence[FixedParameterScores]],
    progress: Callable[[str], None] = lambda _: None,
) -> CrossValidation[Model]:
    """Identify and score, each group of records in its turn.

    What belongs to one flight stays in one group: neighboring maneuvers share battery, wind and trim, and a model that
    has seen one of them has seen more than a new flight would show it. The order of the groups changes nothing but the
    order of the table.

    Parameters
    ----------
    groups
        Records, or what is flown together; at least two.
    names
        One for each, all different.
    kind
        What to identify on.
    fit
        Identifies a model on groups. Where it raises :class:`InsufficientDataError`, the fold stays empty and says so.
    score
        Scores a model on the records of a group; where it raises the same, that place in the table stays empty, and
        the fold says so.
    progress
        Called with what is identified next.

    Raises
    ------
    UsageError
        There are fewer than two groups, or a name stands twice.
    InsufficientDataError
        No fold found a model that could be scored on what it has not seen.

    References
    ----------
    *System Identification of the Parrot Bebop 2*, section IV-B3: identified on each record, scored on all others, and
    the model with the highest mean is chosen.

    Examples
    --------
    >>> from rotorid.verification.fixed_parameters import OutputScore
    >>> def score(model, group):
    ...     fit = 100.0 - abs(model - group)
    ...     one = OutputScore(nrmse_fit_percent=fit, tic=0.0, rms=0.0)
    ...     return [FixedParameterScores(record="", horizon_s=1.0, scores={"p": one},
    ...                          time_s=np.zeros(0), measured=np.zeros((0, 0)), predicted=np.zeros((0, 0)))]
    >>> found = cross_validate([1.0, 2.0, 6.0], names="abc", kind="each", fit=sum, score=score)
    >>> found.fold_means.tolist(), found.best, round(found.mean, 2)
    ([97.0, 97.5, 95.5], 1, 96.67)
    """
    _require(groups, names, kind)
    folds: list[Fold[Model]] = []
    named = tuple(zip(names, groups, strict=True))
    for number, name in enumerate(names):
        others = kind == "leave_one_out"
        used = [index for index in range(len(groups)) if (index == number) != others]
        progress(f"identifying {'without' if others else 'on'} {name}")
        folds.append(_fold(named, used, fit, score))
    found = CrossValidation(kind=kind, records=tuple(names), folds=tuple(folds))
    if np.isnan(found.fold_means).all():
        causes = "; ".join(dict.fromkeys(fold.cause.rstrip(".") for fold in folds if fold.cause))
        raise InsufficientDataError(
            causes or "no model could be scored on an unseen record",
            needed="records that each support the model",
            remedy="give more records, or leave one out instead of identifying on each",
        )
    return found


def _fold(
    named: Sequence[tuple[str, Group]],
    used: Sequence[int],
    fit: Callable[[tuple[Group, ...]], Model],
    score: Callable[[Model, Group], Sequence[FixedParameterScores]],
) -> Fold[Model]:
    identified = tuple(named[index][0] for index in used)
    try:
        model = fit(tuple(named[index][1] for index in used))
    except InsufficientDataError as error:
        return Fold(identified=identified, model=None, scores=((),) * len(named), cause=error.came)
    return _scored(Fold(identified=identified, model=model, scores=()), model, named, score)


def rescored(
    found: CrossValidation[Model],
    groups: Sequence[Group],
    score: Callable[[Model, Group], Sequence[FixedParameterScores]],
) -> CrossValidation[Model]:
    """The same models, scored in another way.

    Parameters
    ----------
    found
        A finished cross-validation.
    groups
        Those of it, in its order.
    score
        As for :func:`cross_validate`.
    """
    named = tuple(zip(found.records, groups, strict=True))

    def anew(fold: Fold[Model]) -> Fold[Model]:
        return fold if fold.model is None else _scored(fold, fold.model, named, score)

    return replace(found, folds=tuple(anew(fold) for fold in found.folds))


def fit_percent(group: Sequence[FixedParameterScores], output: str) -> float:
    """Mean fit percent of an output over the records that have it and move it; not a number without any."""
    every = [scores.scores[output].nrmse_fit_percent for scores in group if output in scores.scores]
    known = [value for value in every if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan


def _scored(
    fold: Fold[Model],
    model: Model,
    named: Sequence[tuple[str, Group]],
    score: Callable[[Model, Group], Sequence[FixedParameterScores]],
) -> Fold[Model]:
    """A fold with scores on all groups, and the causes why some have none."""
    scores: list[tuple[FixedParameterScores, ...]] = []
    causes = []
    for name, group in named:
        try:
            scores.append(tuple(score(model, group)))
        except (InsufficientDataError, ModelError) as error:
            scores.append(())
            causes.append(f"{name} gives no score: {error.came.rstrip('.')}")
    return replace(fold, scores=tuple(scores), cause="; ".join(causes))


def _require(groups: Sequence[Group], names: Sequence[str], kind: Kind) -> None:
    if kind not in get_args(Kind):
        raise UsageError(f"unknown cross-validation {kind!r}", needed=f"one of {', '.join(get_args(Kind))}")
    if len(groups) < 2:
        raise UsageError(
            f"only {counted(len(groups), 'record')} to cross-validate",
            needed="at least two: one to identify on, one to score on",
            remedy="give more logs, or more segments of one",
        )
    if len(set(names)) != len(groups) or len(names) != len(groups):
        raise UsageError(f"the record names {', '.join(names)} are not unique", needed=f"{len(groups)} different names")


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")


def _spread(values: FloatArray) -> float:
    """Standard deviation of a sample; not a number for fewer than two."""
    known = values[~np.isnan(values)]
    return float(known.std(ddof=1)) if known.size > 1 else float("nan")
