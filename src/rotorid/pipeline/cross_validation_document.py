"""The part of ``result.json`` that says how a cross-validation went."""

from __future__ import annotations

import math

from pydantic import Field

from rotorid.pipeline.document_base import Document
from rotorid.verify.cross_validation import CrossValidation, Kind, Model, fit_percent
from rotorid.verify.frozen import FrozenScores


class FrozenScoreDocument(Document):
    """How one output was predicted with frozen parameters; a fit is ``null`` where the output did not move."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float


class FoldParameterDocument(Document):
    """A parameter as one fold has it."""

    value: float
    std: float | None = None


class FoldDocument(Document):
    """One identification: on which records, and its scores by record and output, seen records included.

    ``mean_percent`` and ``spread_percent``, a standard deviation over records, are those of unseen records only.
    """

    identified: list[str]
    unseen: list[str]
    scores: dict[str, dict[str, FrozenScoreDocument]]
    mean_percent: float | None = None
    spread_percent: float | None = None
    parameters: dict[str, FoldParameterDocument] = Field(default_factory=dict)
    cause: str = ""


class BestFoldDocument(Document):
    """The record that is best to identify on, chosen by the very scores that stand here: optimistic."""

    record: str
    mean_percent: float
    spread_percent: float | None = None


class CrossValidationDocument(Document):
    """A cross-validation: ``each`` record alone or ``leave_one_out``, scored on records that were not identified on.

    ``mean_percent`` is over all unseen scores, ``spread_percent`` their standard deviation. ``horizon_s`` is ``null``
    where records were simulated whole; else the models are unstable and were predicted so far ahead, again and again.
    ``band_rad_s`` is what was looked at, ``null`` for everything.
    """

    kind: Kind
    records: list[str]
    outputs: list[str]
    horizon_s: float | None = None
    band_rad_s: tuple[float, float] | None = None
    folds: list[FoldDocument]
    mean_percent: float | None = None
    spread_percent: float | None = None
    best: BestFoldDocument | None = None


def frozen_scores(group: tuple[FrozenScores, ...]) -> dict[str, FrozenScoreDocument]:
    """Scores of a group of records by output, as means over its records."""
    names = dict.fromkeys(name for one in group for name in one.scores)
    return {name: _mean_score(group, name) for name in names}


def _mean_score(group: tuple[FrozenScores, ...], name: str) -> FrozenScoreDocument:
    every = [one.scores[name] for one in group if name in one.scores]
    return FrozenScoreDocument(
        nrmse_fit_percent=finite(fit_percent(group, name)),
        tic=sum(score.tic for score in every) / len(every),
        rms=sum(score.rms for score in every) / len(every),
    )


def finite(value: float) -> float | None:
    """A number, or ``None`` where it is not finite."""
    return float(value) if math.isfinite(value) else None


def cross_validation_document(
    found: CrossValidation[Model],
    parameters: tuple[dict[str, FoldParameterDocument], ...],
    band_rad_s: tuple[float, float] | None = None,
) -> CrossValidationDocument:
    """A cross-validation as a document.

    Parameters
    ----------
    found
        What was found.
    parameters
        Those of the model of each fold.
    band_rad_s
        What was looked at.
    """
    means, spreads = found.fold_means, found.fold_spreads
    best = found.best
    horizons_s = found.horizons_s
    return CrossValidationDocument(
        kind=found.kind,
        records=list(found.records),
        outputs=list(found.outputs),
        horizon_s=finite(horizons_s[0]) if horizons_s else None,
        band_rad_s=band_rad_s,
        folds=[
            FoldDocument(
                identified=list(fold.identified),
                unseen=[name for name in found.records if name not in fold.identified],
                scores={
                    name: frozen_scores(group) for name, group in zip(found.records, fold.scores, strict=True) if group
                },
                mean_percent=finite(means[row]),
                spread_percent=finite(spreads[row]),
                parameters=parameters[row],
                cause=fold.cause,
            )
            for row, fold in enumerate(found.folds)
        ],
        mean_percent=finite(found.mean),
        spread_percent=finite(found.spread),
        best=None
        if best is None
        else BestFoldDocument(
            record=found.records[best], mean_percent=float(means[best]), spread_percent=finite(spreads[best])
        ),
    )
