"""Cross-validation: identify on some logs, score on the others, each in its turn, with the method of the run.

Every fold goes through the whole identification anew (:func:`cross_validate`). Scores are those of a model with all
parameters held (:func:`score_flights`), by the same data and the same rules for any method, so that they serve
:mod:`rotorid.identifying.comparison` too. :func:`cross_validated` adds the scores to an identified model.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, count
from pathlib import Path
from typing import Any, get_args

from rotorid.checking.scores import common_band, common_horizon_s, score_flights
from rotorid.checking.sweeps import nothing_left
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fits.time.remarks import nothing_unseen
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import is_command
from rotorid.flights.selection import each_once, require_inside, require_reached, select_records
from rotorid.identifying.families import logged_by_all
from rotorid.identifying.identification import identify
from rotorid.models.structure import LinearStructure
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import BestFold, CrossValidationSummary, FoldParameter, FoldSummary, SignalScore, finite
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import resolve_model
from rotorid.verification import fixed_parameters as engine
from rotorid.verification.fixed_parameters import CrossValidation, FixedParameterScores, Fold, fit_percent
from rotorid.verification.verification import Kind

_PROGRESS = logging.getLogger("rotorid.progress")


Identify = Callable[[Sequence[FlightRecord], IdentifySettings], IdentifiedModel]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidated(Immutable):
    """A finished cross-validation.

    Parameters
    ----------
    summary
        Its scores in numbers.
    found
        Scores with measured and predicted outputs, and the identification behind each fold.
    findings
        Remarks: records that could not be used.
    """

    summary: CrossValidationSummary
    found: CrossValidation[IdentifiedModel]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Group:
    """Maneuvers kept together: those of one log, or a single one if there is one log."""

    name: str
    flights: tuple[Flight, ...]


def cross_validate(
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    identify: Identify,
    kind: Kind,
    settings: IdentifySettings,
) -> CrossValidated:
    """Identify a model on some logs and score it on the others, each in its turn, with any method.

    Several logs are kept whole, because maneuvers of one flight share its battery, wind and trim; of a single log each
    maneuver stands for itself, which is the weaker test. Every fold goes through the whole identification anew, the
    choice of band, start and reduction included, so nothing of what is scored has been seen. Models of frequency
    responses are scored within the band that all folds were fitted in.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them.
    model
        As for :func:`rotorid.identify`; a model that takes its channels from the logs must be resolved before.
    identify
        Identifies the model on records with settings.
    kind
        On ``each`` one alone, or on all but one.
    settings
        Choices of the run.

    Raises
    ------
    InsufficientDataError
        No fold has a model that could be scored.
    UsageError
        There is one record only, or the same one twice, or maneuvers of one log overlap.
    """
    each_once(records)
    structure = resolve_model(model)
    groups, findings = _groups(structure, records, settings)
    every_axis = {flight.axis for group in groups for flight in group.flights}
    commands = all(is_command(name) for name in structure.inputs)

    def fit(training: tuple[_Group, ...]) -> IdentifiedModel:
        flights = [item for group in training for item in group.flights]
        missing = sorted(every_axis - {flight.axis for flight in flights})
        if missing and commands:
            names = ", ".join(group.name for group in training)
            raise InsufficientDataError(f"{names} does not excite {' and '.join(missing)}")
        kept = [record for record in records if any(record is flight.record for flight in flights)]
        chosen = (
            replace(settings, segments=tuple(flight.maneuver for flight in flights)) if len(records) == 1 else settings
        )
        return identify(kept, chosen)

    def score(model: IdentifiedModel, group: _Group, **within: Any) -> tuple[FixedParameterScores, ...]:
        return score_flights(model.structure, group.flights, settings, **within)

    folds = count()

    def say(text: str) -> None:
        _PROGRESS.info(text, extra={"done": next(folds), "total": len(groups)})

    found = engine.cross_validate(
        groups, names=[group.name for group in groups], kind=kind, fit=fit, score=score, progress=say
    )
    horizon_s = common_horizon_s([score for fold in found.folds for scores in fold.scores for score in scores])
    band_rad_s = common_band([fold.model for fold in found.folds if fold.model])
    if horizon_s is not None or band_rad_s is not None:
        # Known only when all models are: what they have in common.
        found = engine.rescored(found, groups, partial(score, horizon_s=horizon_s, band_rad_s=band_rad_s))
    return CrossValidated(
        summary=summary_of(found, tuple(_parameters(fold.model) for fold in found.folds), band_rad_s),
        found=found,
        findings=(*findings, *_empty_folds(found)),
    )


def signal_scores(group: tuple[FixedParameterScores, ...]) -> dict[str, SignalScore]:
    """Scores of a group of records by output, as means over its records."""
    names = dict.fromkeys(name for scores in group for name in scores.scores)
    return {name: _mean_score(group, name) for name in names}


def _mean_score(group: tuple[FixedParameterScores, ...], name: str) -> SignalScore:
    every = [scores.scores[name] for scores in group if name in scores.scores]
    return SignalScore(
        nrmse_fit_percent=finite(fit_percent(group, name)),
        tic=sum(score.tic for score in every) / len(every),
        rms=sum(score.rms for score in every) / len(every),
    )


def summary_of(
    found: CrossValidation[IdentifiedModel],
    parameters: tuple[dict[str, FoldParameter], ...],
    band_rad_s: tuple[float, float] | None = None,
) -> CrossValidationSummary:
    """A cross-validation in numbers.

    Parameters
    ----------
    parameters
        Those of the model of each fold.
    band_rad_s
        What was looked at.
    """
    means, spreads = found.fold_means, found.fold_spreads
    best = found.best
    horizons_s = found.horizons_s
    return CrossValidationSummary(
        kind=found.kind,
        records=tuple(found.records),
        outputs=tuple(found.outputs),
        horizon_s=finite(horizons_s[0]) if horizons_s else None,
        band_rad_s=band_rad_s,
        folds=tuple(
            FoldSummary(
                identified=tuple(fold.identified),
                unseen=tuple(name for name in found.records if name not in fold.identified),
                scores={
                    name: signal_scores(group) for name, group in zip(found.records, fold.scores, strict=True) if group
                },
                mean_percent=finite(means[row]),
                spread_percent=finite(spreads[row]),
                parameters=parameters[row],
                cause=fold.cause,
            )
            for row, fold in enumerate(found.folds)
        ),
        mean_percent=finite(found.mean),
        spread_percent=finite(found.spread),
        best=None
        if best is None
        else BestFold(
            record=found.records[best], mean_percent=float(means[best]), spread_percent=finite(spreads[best])
        ),
    )


def _groups(
    structure: LinearStructure, records: Sequence[FlightRecord], settings: IdentifySettings
) -> tuple[list[_Group], list[Finding]]:
    if len(records) == 1:
        fitted = select_records(structure, records, settings).selection.fitted
        if len(fitted) < 2:
            raise UsageError(
                f"{records[0].source.name} contains only one maneuver to cross-validate on",
                needed="at least two maneuvers or two logs",
                remedy="give more logs, or parts of this one with --segment",
            )
        _require_disjoint([flight.maneuver for flight in fitted])
        return [
            _Group(name=f"{flight.axis} {flight.maneuver.kind} at {flight.maneuver.start_s:.1f} s", flights=(flight,))
            for flight in fitted
        ], []
    groups, findings = [], []
    require_inside(records, settings.segments)
    for name, record in zip(_names(records), records, strict=True):
        try:
            require_reached(record, settings.segments)
            groups.append(_Group(name=name, flights=select_records(structure, [record], settings).selection.fitted))
        except InsufficientDataError as error:
            findings.append(_left_out(name, f"{name} was not used in the cross-validation: {error.came}"))
    return groups, findings


def _require_disjoint(maneuvers: Sequence[Maneuver]) -> None:
    """Refuse maneuvers that overlap: they would be fitted in one fold and count as unseen in it."""
    ordered = sorted(maneuvers, key=lambda m: m.start_s)
    for maneuver, other in combinations(ordered, 2):
        if other.start_s < maneuver.stop_s:
            spans = [f"{m.axis}:{m.start_s:g}:{m.stop_s:g}" for m in (maneuver, other)]
            raise UsageError(
                f"{spans[0]} and {spans[1]} overlap",
                needed="maneuvers that do not overlap, so that each can be unseen by the others",
                remedy="give parts that do not overlap with --segment",
            )


def _names(records: Sequence[FlightRecord]) -> list[str]:
    """A name for each record; those of one file name are distinguished by a number."""
    names: list[str] = []
    for record in records:
        name, count = record.source.name, 1
        while name in names:
            count += 1
            name = f"{record.source.name} ({count})"
        names.append(name)
    return names


def _parameters(model: IdentifiedModel | None) -> dict[str, FoldParameter]:
    parameters = model.parameters if model else {}
    return {name: FoldParameter(value=estimate.value, std=estimate.std) for name, estimate in parameters.items()}


def _empty_folds(found: CrossValidation[IdentifiedModel]) -> list[Finding]:
    return [
        _left_out(name, f"The cross-validation fold of {name} {_lacks(fold)}: {fold.cause}")
        for name, fold in zip(found.records, found.folds, strict=True)
        if fold.cause
    ]


def _lacks(fold: Fold[IdentifiedModel]) -> str:
    return "is empty" if fold.model is None else "has no scores"


def _left_out(name: str, message: str) -> Finding:
    return warn("not_verified", name, f"{message.rstrip('.')}.")


def parse_kind(text: str | None) -> Kind | None:
    """Read ``each`` or ``leave_one_out``; ``None`` for no cross-validation.

    Examples
    --------
    >>> parse_kind("each")
    'each'
    """
    if text is None or text in get_args(Kind):
        return text  # type: ignore[return-value]
    raise UsageError(f"unknown cross-validation {text!r}", needed=f"one of {', '.join(get_args(Kind))}")


def cross_validated(
    identified: IdentifiedModel,
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    kind: Kind,
    settings: IdentifySettings,
) -> IdentifiedModel:
    """The identified model with its cross-validation.

    Parameters
    ----------
    identified
        The model of all records.
    records, model, settings
        What it came from.
    kind
        Which records each model is identified on.

    Raises
    ------
    InsufficientDataError
        No fold has a model that could be scored.
    UsageError
        There is one record only.
    """
    structure = resolve_model(model, outputs=settings.outputs, logged=logged_by_all(records))
    crossed = cross_validate(
        records,
        structure,
        identify=lambda some, choices: identify(some, structure, settings=choices),
        kind=kind,
        settings=settings,
    )
    # A model that was judged on unseen records is verified; why another log failed to verify it stays of interest.
    names = [record.record for record in identified.data.segments]
    answered = (nothing_unseen(names), nothing_left(structure))
    kept = [finding for finding in identified.findings if finding not in answered]
    own = [finding for finding in worst_first(crossed.findings) if finding not in identified.findings]
    return replace(identified, cross_validation=crossed.summary, findings=(*kept, *own))
