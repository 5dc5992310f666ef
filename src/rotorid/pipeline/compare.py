"""Put models and methods side by side: what each says of itself, and how each does on the same logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid import __version__
from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.compare_document import (
    ComparedManeuverDocument,
    ComparedModelDocument,
    CompareDocument,
    ComparedParameterDocument,
    ComparedScoreDocument,
    ComparedValueDocument,
    CrossValidatedDocument,
    OnLogsDocument,
)
from rotorid.pipeline.compare_results import Entry, read_results
from rotorid.pipeline.compare_scores import ComparedManeuver, OnLogs, common_outputs, score_on_logs
from rotorid.pipeline.cross_validation_document import finite, frozen_scores
from rotorid.pipeline.document import ParameterDocument, ProvenanceDocument
from rotorid.pipeline.selection import each_once
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.verify_model import motors_refused
from rotorid.verify.frozen import FrozenScores


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared(Immutable):
    """A finished comparison.

    Parameters
    ----------
    document
        What ``compare.json`` holds.
    maneuvers
        Of the logs, measured and predicted by each model.
    """

    document: CompareDocument
    maneuvers: tuple[ComparedManeuver, ...] = ()


def compare(
    results: Sequence[Path | Entry],
    records: Sequence[FlightRecord] = (),
    *,
    settings: IdentifySettings | None = None,
    command: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Compared:
    """Compare identified models.

    What results say of themselves stands on different data and by different rules: a cost of responses is no fit of
    outputs, and a fit on its own data rises with every parameter. With logs every model is scored on the same
    maneuvers, its parameters frozen; logs that none has seen decide.

    Parameters
    ----------
    results
        Folders that ``identify`` wrote, or their ``result.json``, or entries that were read; at least two.
    records
        Logs to score every model on.
    settings
        Segments, shifts and hold for the logs.
    command
        For the provenance.
    progress
        Told what is being done.

    Raises
    ------
    UsageError
        A result cannot be read, one came twice, or logs came with one of ``physical.motors``.
    InsufficientDataError
        Logs came, and no model could be scored on any of them; the findings say why.
    """
    settings = settings or IdentifySettings()
    entries = entries_of(results)
    if not records:
        return Compared(document=_document(entries, (), OnLogs(maneuvers=()), settings, command))
    if motors := [entry.label for entry in entries if entry.document.motors is not None]:
        raise motors_refused(motors[0])
    each_once(records)
    scored = score_on_logs(entries, records, settings, progress)
    if not scored.maneuvers:
        causes = "; ".join(dict.fromkeys(finding.message.rstrip(".") for finding in scored.findings))
        raise InsufficientDataError(
            causes or "no model could be scored",
            needed="logs with the channels of the models and an excitation of their axes",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=scored.findings,
        )
    return Compared(document=_document(entries, records, scored, settings, command), maneuvers=scored.maneuvers)


def refused_comparison(
    error: InsufficientDataError,
    results: Sequence[Path | Entry],
    records: Sequence[FlightRecord],
    *,
    settings: IdentifySettings,
    command: Sequence[str] = (),
) -> CompareDocument:
    """The comparison of what results say of themselves, with the findings why logs say nothing."""
    nothing = OnLogs(maneuvers=(), findings=tuple(error.findings))
    return _document(entries_of(results), records, nothing, settings, command)


def entries_of(results: Sequence[Path | Entry]) -> tuple[Entry, ...]:
    """Results that are read already, or where they are."""
    read = [one for one in results if isinstance(one, Entry)]
    return tuple(read) if len(read) == len(results) > 1 else read_results([Path(one) for one in results])  # type: ignore[arg-type]


def _document(
    entries: Sequence[Entry],
    records: Sequence[FlightRecord],
    scored: OnLogs,
    settings: IdentifySettings,
    command: Sequence[str],
) -> CompareDocument:
    maneuvers, shared = scored.maneuvers, common_outputs(entries, scored.maneuvers)
    summaries = _on_logs(entries, maneuvers, shared)
    horizons_s = [one.horizon_s for each in maneuvers for group in each.scores.values() for one in group]
    return CompareDocument(
        models=[_model(entry, summaries.get(entry.label)) for entry in entries],
        parameters=_parameters(entries),
        maneuvers=[_maneuver(each, shared) for each in maneuvers],
        common_outputs=list(shared),
        horizon_s=finite(min(horizons_s, default=math.inf)),
        band_rad_s=scored.band_rad_s,
        findings=finding_documents([*scored.findings, *_remarks(entries, maneuvers, shared, summaries)]),
        provenance=ProvenanceDocument(
            version=__version__,
            command=list(command),
            inputs={
                **{f"{entry.label}/result.json": entry.sha256 for entry in entries},
                **{record.source.name: record.source.sha256 for record in records},
            },
            settings={name: settings.as_json()[name] for name in ("segments", "shifts", "hold")},
            seed=settings.seed,
        ),
    )


def _model(entry: Entry, summary: OnLogsDocument | None) -> ComparedModelDocument:
    document = entry.document
    validated = document.cross_validation
    return ComparedModelDocument(
        label=entry.label,
        model=document.model,
        method=document.method,
        inputs=document.inputs,
        outputs=document.outputs,
        order=len(document.states),
        free_parameters=sum(parameter.status == "free" for parameter in document.parameters.values()),
        fit_percent=document.fit_percent,
        cross_validation=None
        if validated is None
        else CrossValidatedDocument(
            kind=validated.kind,
            mean_percent=validated.mean_percent,
            spread_percent=validated.spread_percent,
            best_percent=validated.best.mean_percent if validated.best else None,
            horizon_s=validated.horizon_s,
        ),
        on_logs=summary,
        cost=document.cost.average if document.cost else None,
        aic=document.information.aic if document.information else None,
        bic=document.information.bic if document.information else None,
        poles=document.poles,
        delays=document.delays,
    )


def _parameters(entries: Sequence[Entry]) -> dict[str, ComparedParameterDocument]:
    """Every parameter by its name; where units differ it is another one, and is called so."""
    logs = {entry.label: entry.fitted_logs for entry in entries}
    found: dict[str, tuple[str, dict[str, ParameterDocument]]] = {}
    for entry in entries:
        for name, parameter in entry.document.parameters.items():
            unit, _ = found.setdefault(name, (parameter.unit, {}))
            own = name if unit == parameter.unit else f"{name} [{parameter.unit}]"
            found.setdefault(own, (parameter.unit, {}))[1][entry.label] = parameter
    return {
        name: ComparedParameterDocument(unit=unit, values=_values(values, logs))
        for name, (unit, values) in found.items()
    }


def _values(
    values: Mapping[str, ParameterDocument], logs: Mapping[str, frozenset[str]]
) -> dict[str, ComparedValueDocument]:
    """Values with their distance from the first, where no log stands behind both."""
    first = next((label for label, one in values.items() if one.std is not None), None)
    return {
        label: ComparedValueDocument(
            value=one.value,
            std=one.std,
            status=one.status,
            z=None if first is None or logs[label] & logs[first] else z_score(one, values[first]),
        )
        for label, one in values.items()
    }


def z_score(one: ParameterDocument, other: ParameterDocument | None) -> float | None:
    """Difference of two independent estimates over its standard deviation; ``None`` for one and the same.

    Examples
    --------
    >>> a, b = (ParameterDocument(value=x, unit="1/s", std=s, status="free") for x, s in ((-2.0, 0.3), (-3.0, 0.4)))
    >>> z_score(b, a)
    -2.0
    """
    if other is None or one is other or one.std is None or other.std is None:
        return None
    std = math.hypot(one.std, other.std)
    return (one.value - other.value) / std if std > 0.0 else None


def _maneuver(each: ComparedManeuver, shared: Sequence[str]) -> ComparedManeuverDocument:
    return ComparedManeuverDocument(
        record=each.record,
        axis=each.maneuver.axis,
        kind=each.maneuver.kind,
        start_s=each.maneuver.start_s,
        stop_s=each.maneuver.stop_s,
        models={
            label: ComparedScoreDocument(
                seen=label in each.seen,
                mean_percent=finite(each.mean_percent(label, shared or _own(group))),
                scores=frozen_scores(group),
            )
            for label, group in each.scores.items()
        },
    )


def _on_logs(
    entries: Sequence[Entry], maneuvers: Sequence[ComparedManeuver], shared: Sequence[str]
) -> dict[str, OnLogsDocument]:
    """Means over the maneuvers on which all models were scored; over those that none has seen, if there are any."""
    scored = [entry.label for entry in entries if any(entry.label in each.scores for each in maneuvers)]
    tables = [
        [each.mean_percent(name, shared or _own(each.scores.get(name, ()))) for name in scored] for each in maneuvers
    ]
    counted = [(each, row) for each, row in zip(maneuvers, tables, strict=True) if scored and np.isfinite(row).all()]
    unseen = [(each, row) for each, row in counted if not each.seen]
    kept = unseen or counted
    if not kept:
        return {}
    table = np.array([row for _, row in kept])
    return {
        label: OnLogsDocument(
            mean_percent=float(column.mean()),
            spread_percent=float(column.std(ddof=1)) if column.size > 1 else None,
            maneuvers=column.size,
            seen=not unseen,
        )
        for label, column in zip(scored, table.T, strict=True)
    }


def _own(group: Sequence[FrozenScores]) -> tuple[str, ...]:
    """Outputs that were scored."""
    return tuple(dict.fromkeys(name for one in group for name in one.scores))


def _remarks(
    entries: Sequence[Entry],
    maneuvers: Sequence[ComparedManeuver],
    shared: Sequence[str],
    summaries: Mapping[str, OnLogsDocument],
) -> list[Finding]:
    found = []
    seen = {label: [each for each in maneuvers if label in each.seen] for label in summaries}
    if any(summary.seen for summary in summaries.values()):
        labels = ", ".join(label for label, them in seen.items() if them)
        found.append(
            Finding(
                kind="seen_data",
                severity="warning",
                where=labels,
                message=(
                    f"Every maneuver that all models were scored on was fitted by {labels}: there a model with more "
                    "parameters looks better than it is. Give a log that none has seen."
                ),
            )
        )
    if maneuvers and not shared:
        found.append(
            Finding(
                kind="different_outputs",
                severity="warning",
                where=", ".join(entry.label for entry in entries),
                message=(
                    "The models have no output in common on these logs, so the mean of each is over its own outputs, "
                    "and the means do not compare."
                ),
            )
        )
    return found
