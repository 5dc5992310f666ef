"""Cross-validate a model with the method of a run: identify on some logs, score on the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.description import from_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.cross_validation_document import (
    CrossValidationDocument,
    FoldParameterDocument,
    cross_validation_document,
)
from rotorid.pipeline.document import ParameterDocument
from rotorid.pipeline.frozen import common_horizon_s, fitted_band, score_flown
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.instruments import Flown, is_command
from rotorid.pipeline.resolve import resolve_model
from rotorid.pipeline.selection import each_once
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_selection import select_records
from rotorid.verify import cross_validation as engine
from rotorid.verify.cross_validation import CrossValidation, Fold, Kind
from rotorid.verify.frozen import FrozenScores

Identify = Callable[[Sequence[FlightRecord], IdentifySettings], Identification]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidated(Immutable):
    """A finished cross-validation.

    Parameters
    ----------
    document
        The part ``cross_validation`` of ``result.json``.
    found
        Scores with measured and predicted outputs, and the identification behind each fold.
    findings
        Remarks: records that could not be used.
    """

    document: CrossValidationDocument
    found: CrossValidation[Identification]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Group:
    """What is kept together: the maneuvers of one log, or one maneuver where there is one log."""

    name: str
    flown: tuple[Flown, ...]


def cross_validate(
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    identify: Identify,
    kind: Kind,
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
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
    progress
        Told what is being done.

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
    every_axis = {maneuver.axis for group in groups for _, maneuver in group.flown}
    commands = all(is_command(name) for name in structure.inputs)

    def fit(training: tuple[_Group, ...]) -> Identification:
        flown = [item for group in training for item in group.flown]
        missing = sorted(every_axis - {maneuver.axis for _, maneuver in flown})
        if missing and commands:
            names = ", ".join(group.name for group in training)
            raise InsufficientDataError(f"{names} does not excite {' and '.join(missing)}")
        kept = [record for record in records if any(record is one for one, _ in flown)]
        chosen = replace(settings, segments=tuple(m for _, m in flown)) if len(records) == 1 else settings
        return identify(kept, chosen)

    def score(model: Identification, group: _Group) -> tuple[FrozenScores, ...]:
        return score_flown(_structure(model), group.flown, settings)

    found = engine.cross_validate(
        groups, names=[group.name for group in groups], kind=kind, fit=fit, score=score, progress=progress
    )
    horizon_s = common_horizon_s([one for fold in found.folds for scores in fold.scores for one in scores])
    band_rad_s = fitted_band([fold.model.document for fold in found.folds if fold.model])
    if horizon_s is not None or band_rad_s is not None:
        # Known only when all models are: what they have in common.
        def alike(model: Identification, group: _Group) -> tuple[FrozenScores, ...]:
            return score_flown(_structure(model), group.flown, settings, horizon_s=horizon_s, band_rad_s=band_rad_s)

        found = engine.rescored(found, groups, alike)
    return CrossValidated(
        document=cross_validation_document(found, tuple(_parameters(fold.model) for fold in found.folds), band_rad_s),
        found=found,
        findings=(*findings, *_empty_folds(found)),
    )


def _structure(model: Identification) -> LinearStructure:
    return from_toml(model.model_toml, where=model.document.model)


def _groups(
    structure: LinearStructure, records: Sequence[FlightRecord], settings: IdentifySettings
) -> tuple[list[_Group], list[Finding]]:
    if len(records) == 1:
        fitted = select_records(structure, records, settings).selection.fitted
        if len(fitted) < 2:
            raise UsageError(
                f"{records[0].source.name} holds one maneuver to cross-validate on",
                needed="at least two maneuvers or two logs",
                remedy="give more logs, or parts of this one with --segment",
            )
        _require_apart([m for _, m in fitted])
        return [_Group(name=f"{m.axis} {m.kind} at {m.start_s:.1f} s", flown=((r, m),)) for r, m in fitted], []
    groups, findings = [], []
    for name, record in zip(_names(records), records, strict=True):
        try:
            groups.append(_Group(name=name, flown=select_records(structure, [record], settings).selection.fitted))
        except InsufficientDataError as error:
            findings.append(_left_out(name, f"{name} takes no part in the cross-validation: {error.came}"))
    return groups, findings


def _require_apart(maneuvers: Sequence[Maneuver]) -> None:
    """What two maneuvers share would be fitted in one fold and count as unseen in it."""
    ordered = sorted(maneuvers, key=lambda m: m.start_s)
    for one, other in combinations(ordered, 2):
        if other.start_s < one.stop_s:
            spans = [f"{m.axis}:{m.start_s:g}:{m.stop_s:g}" for m in (one, other)]
            raise UsageError(
                f"{spans[0]} and {spans[1]} overlap",
                needed="maneuvers apart from each other, of which each can be unseen by the others",
                remedy="name parts that do not overlap with --segment",
            )


def _names(records: Sequence[FlightRecord]) -> list[str]:
    """A name for each record; those of one file name are told apart by a number."""
    names: list[str] = []
    for record in records:
        name, count = record.source.name, 1
        while name in names:
            count += 1
            name = f"{record.source.name} ({count})"
        names.append(name)
    return names


def _parameters(model: Identification | None) -> dict[str, FoldParameterDocument]:
    def short(parameter: ParameterDocument) -> FoldParameterDocument:
        return FoldParameterDocument(value=parameter.value, std=parameter.std)

    return {name: short(one) for name, one in model.document.parameters.items()} if model else {}


def _empty_folds(found: CrossValidation[Identification]) -> list[Finding]:
    return [
        _left_out(name, f"The fold of {name} in the cross-validation {_lacks(fold)}: {fold.cause}")
        for name, fold in zip(found.records, found.folds, strict=True)
        if fold.cause
    ]


def _lacks(fold: Fold[Identification]) -> str:
    return "is empty" if fold.model is None else "lacks scores"


def _left_out(name: str, message: str) -> Finding:
    return Finding(kind="not_verified", severity="warning", where=name, message=f"{message.rstrip('.')}.")
