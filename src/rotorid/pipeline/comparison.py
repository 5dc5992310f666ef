"""Put models and methods side by side: what each says of itself, and how each does on the same logs.

Results of ``identify`` that are to be compared: their documents, and their models with values.

Every model on the same maneuvers, by the same rules: the honest part of a comparison.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rotorid import __version__
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.documents.compare import (
    ComparedManeuverDocument,
    ComparedModelDocument,
    CompareDocument,
    ComparedParameterDocument,
    ComparedScoreDocument,
    ComparedValueDocument,
    CrossValidatedDocument,
    OnLogsDocument,
)
from rotorid.documents.result import ParameterDocument, ProvenanceDocument, ResultDocument, finite, frozen_scores
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.candidate import motors_refused
from rotorid.pipeline.cross_validation import common_horizon_s, fitted_band, score_flown
from rotorid.pipeline.instruments import Flown, axes_of, is_command
from rotorid.pipeline.selection import RICH_KINDS, each_once, select_records, wholly_flown
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.unseen import fitted_logs, has_seen
from rotorid.signal.excitations import find_excitations
from rotorid.verification.fixed_parameters import FixedParameterScores, fit_percent

_PROGRESS = logging.getLogger("rotorid.progress")


RESULT, MODEL, SCHEMA = "result.json", "model.toml", "rotorid.result/1"

_WANTED = f"a folder that rotorid identify wrote, or its {RESULT}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry(Immutable):
    """One result.

    Parameters
    ----------
    label
        What it is called in the comparison.
    document
        What its ``result.json`` holds.
    structure
        The model with its values, ``None`` where no ``model.toml`` stands beside.
    sha256
        Hash of the ``result.json``.
    """

    label: str
    document: ResultDocument
    structure: LinearStructure | None
    sha256: str

    def has_seen(self, record: FlightRecord, maneuver: Maneuver) -> bool:
        """Whether any part of a maneuver was fitted, see :func:`rotorid.pipeline.unseen.has_seen`."""
        return has_seen(self.document.provenance, record, maneuver)

    @cached_property
    def fitted_logs(self) -> frozenset[str]:
        """Hashes of the logs that it was fitted to."""
        return fitted_logs(self.document.provenance)


def read_results(paths: Sequence[Path]) -> tuple[Entry, ...]:
    """Read what ``identify`` wrote.

    Parameters
    ----------
    paths
        Folders, or ``result.json`` files; at least two different ones. The ``model.toml`` beside gives the model.

    Raises
    ------
    UsageError
        A path leads to no result, one came twice, or fewer than two came.
    ModelError
        A ``model.toml`` is wrong.
    """
    files = [path / RESULT if path.is_dir() else path for path in paths]
    if len(files) < 2:
        raise UsageError(f"{len(files)} result came to compare", needed="at least two", remedy="give another folder")
    for number, file in enumerate(files):
        if file.resolve() in [other.resolve() for other in files[:number]]:
            raise UsageError(f"{file} came twice", needed="each result once")
    return tuple(_read(file, label) for file, label in zip(files, _labels(files), strict=True))


def _labels(files: Sequence[Path]) -> list[str]:
    """Names of the folders, with as many of those above as it takes to tell them apart."""
    folders = [file.resolve().parent.parts for file in files]
    count = 1
    while len({parts[-count:] for parts in folders}) < len(folders) and count < max(map(len, folders)):
        count += 1
    labels = ["/".join(parts[-count:]) for parts in folders]
    # Two results in one folder differ by the names of their files.
    return [
        f"{label}/{file.name}" if labels.count(label) > 1 else label for label, file in zip(labels, files, strict=True)
    ]


def _read(file: Path, label: str) -> Entry:
    text = _text(file)
    document = _read_document(file, text)
    model = file.parent / MODEL
    structure = from_toml(_text(model), where=str(model)) if model.exists() else None
    if structure is not None and structure.name != document.model:
        raise UsageError(f"{model} holds {structure.name} and {file} {document.model}", needed="files of one result")
    return Entry(label=label, document=document, structure=structure, sha256=hashlib.sha256(text.encode()).hexdigest())


def _read_document(file: Path, text: str) -> ResultDocument:
    from pydantic import ValidationError

    try:
        table = json.loads(text)
    except ValueError as error:
        raise UsageError(f"{file} is no JSON: {error}", needed=_WANTED) from error
    schema = table.get("schema") if isinstance(table, dict) else None
    if schema != SCHEMA:
        came = f"has the schema {schema}" if isinstance(schema, str) else "names no schema"
        raise UsageError(f"{file} {came}", needed=f"a {RESULT} with the schema {SCHEMA}")
    try:
        document = ResultDocument.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise UsageError(
            f"{file} does not fit its schema at {where}: {first['msg']}",
            needed=f"a {RESULT} of this version",
            remedy="identify anew",
        ) from error
    if not document.parameters:
        raise UsageError(f"{file} holds no model: its data did not support one", needed="results with parameters")
    return document


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}", needed=_WANTED) from error


_REST_S = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedManeuver(Immutable):
    """One maneuver under all models.

    Parameters
    ----------
    record
        Name of the log.
    maneuver
        What was flown.
    scores
        Label of a result to its scores, one for each stretch without a gap; measured and predicted stand in them.
    seen
        Labels of the results that were identified on it.
    """

    record: str
    maneuver: Maneuver
    scores: Mapping[str, tuple[FixedParameterScores, ...]]
    seen: tuple[str, ...]

    def __post_init__(self) -> None:
        self._set(scores=self.scores, seen=tuple(self.seen))

    def mean_percent(self, label: str, outputs: Sequence[str]) -> float:
        """Mean fit percent of some outputs that move; not a number where one is missing."""
        group = self.scores.get(label, ())
        if any(name not in one.scores for one in group for name in outputs):
            return math.nan
        found = [percent for name in outputs if math.isfinite(percent := fit_percent(group, name))]
        return float(np.mean(found)) if found else math.nan


@dataclass(frozen=True, kw_only=True)
class OnLogs(Immutable):
    """All maneuvers of all logs.

    Parameters
    ----------
    maneuvers
        Those that at least one model could be scored on.
    band_rad_s
        What was looked at, ``None`` for everything.
    findings
        Remarks: what could not be scored.
    """

    maneuvers: tuple[ComparedManeuver, ...]
    band_rad_s: tuple[float, float] | None = None
    findings: tuple[Finding, ...] = ()


def score_on_logs(
    entries: Sequence[Entry],
    records: Sequence[FlightRecord],
    settings: IdentifySettings,
) -> OnLogs:
    """Score every model on every log.

    A model is scored on the excitations of its own axes, or on whole records where its inputs are set-points. All are
    simulated, or, as soon as one of them is unstable, all predicted over the same short horizon; within the band in
    which all models of frequency responses were fitted, if there are any.

    Parameters
    ----------
    entries
        Results with their models.
    records
        Logs.
    settings
        Whose segments, shifts and hold count.
    """
    findings: list[Finding] = []
    flown: dict[str, list[Flown]] = {}
    for entry in entries:
        flown[entry.label] = []
        for record in records:
            try:
                flown[entry.label] += _maneuvers(entry.structure, record, settings)
            except InsufficientDataError as error:
                findings.append(_not_scored(entry, record, error))
    band_rad_s = fitted_band([entry.document for entry in entries])
    found, failed = _scores(entries, flown, settings, None, band_rad_s)
    horizon_s = common_horizon_s([one for each in found for group in each.scores.values() for one in group])
    if horizon_s is not None:
        found, failed = _scores(entries, flown, settings, horizon_s, band_rad_s)
    return OnLogs(maneuvers=tuple(found), band_rad_s=band_rad_s, findings=(*findings, *failed))


def _maneuvers(structure: LinearStructure | None, record: FlightRecord, settings: IdentifySettings) -> list[Flown]:
    if structure is None:
        raise InsufficientDataError("no model.toml stands beside its result.json")
    axes = axes_of(structure.inputs, structure.outputs)
    commands = all(is_command(name) for name in structure.inputs)
    own = tuple(one for one in settings.segments if one.axis in axes or not commands)
    if settings.segments and not own:
        raise InsufficientDataError(f"no given segment is of {' or '.join(axes)}")
    if own or not commands:
        return list(select_records(structure, [record], replace(settings, segments=own)).selection.fitted)
    found = wholly_flown([(record, m) for axis in axes for m in find_excitations(record, axis)])
    if not found:
        raise InsufficientDataError(f"it holds no excitation of {' or '.join(axes)}")
    return _with_rest(record, found)


def _with_rest(record: FlightRecord, flown: Sequence[Flown]) -> list[Flown]:
    """Short maneuvers with the time around them, up to half way to their neighbors: what follows one answers to it."""
    ordered = sorted({(m.start_s, m.stop_s): m for _, m in flown}.values(), key=lambda m: m.start_s)
    wider = []
    for number, m in enumerate(ordered):
        before_s = (ordered[number - 1].stop_s + m.start_s) / 2.0 if number else record.start_s
        after_s = (m.stop_s + ordered[number + 1].start_s) / 2.0 if number + 1 < len(ordered) else record.stop_s
        around = (max(m.start_s - _REST_S, before_s), min(m.stop_s + _REST_S, after_s))
        start_s, stop_s = (m.start_s, m.stop_s) if m.kind in RICH_KINDS else around
        wider.append((record, replace(m, start_s=min(m.start_s, start_s), stop_s=max(m.stop_s, stop_s))))
    return wider


def _scores(
    entries: Sequence[Entry],
    flown: Mapping[str, Sequence[Flown]],
    settings: IdentifySettings,
    horizon_s: float | None,
    band_rad_s: tuple[float, float] | None,
) -> tuple[list[ComparedManeuver], list[Finding]]:
    by_label = {entry.label: entry for entry in entries}
    places: dict[tuple[str, float, float], Flown] = {}
    scores: dict[tuple[str, float, float], dict[str, tuple[FixedParameterScores, ...]]] = {}
    findings = []
    for label, items in flown.items():
        structure = by_label[label].structure
        for record, maneuver in items:
            _PROGRESS.info(f"{label} on {record.source.name}")
            place = (record.source.sha256, maneuver.start_s, maneuver.stop_s)
            try:
                assert structure is not None
                group = score_flown(
                    structure, [(record, maneuver)], settings, horizon_s=horizon_s, band_rad_s=band_rad_s
                )
            except (InsufficientDataError, ModelError) as error:
                findings.append(_not_scored(by_label[label], record, error))
                continue
            places.setdefault(place, (record, maneuver))
            scores.setdefault(place, {})[label] = group
    return [
        ComparedManeuver(
            record=record.source.name,
            maneuver=maneuver,
            scores=scores[place],
            seen=tuple(entry.label for entry in entries if entry.has_seen(record, maneuver)),
        )
        for place, (record, maneuver) in places.items()
    ], findings


def common_outputs(entries: Sequence[Entry], maneuvers: Sequence[ComparedManeuver]) -> tuple[str, ...]:
    """Outputs that every model has been scored on, wherever it was scored."""
    names = [
        {name for each in maneuvers for one in each.scores.get(entry.label, ()) for name in one.scores}
        for entry in entries
    ]
    shared = set.intersection(*(one for one in names if one)) if any(names) else set()
    every = dict.fromkeys(
        n for each in maneuvers for group in each.scores.values() for one in group for n in one.scores
    )
    return tuple(name for name in every if name in shared)


def _not_scored(entry: Entry, record: FlightRecord, error: InsufficientDataError | ModelError) -> Finding:
    return warn(
        "not_verified",
        f"{entry.label} on {record.source.name}",
        f"{record.source.name} does not score {entry.label}: {error.came.rstrip('.')}.",
    )


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
    scored = score_on_logs(entries, records, settings)
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


def _own(group: Sequence[FixedParameterScores]) -> tuple[str, ...]:
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
            warn(
                "seen_data",
                labels,
                f"Every maneuver that all models were scored on was fitted by {labels}: there a model with more "
                "parameters looks better than it is. Give a log that none has seen.",
            )
        )
    if maneuvers and not shared:
        found.append(
            warn(
                "different_outputs",
                ", ".join(entry.label for entry in entries),
                "The models have no output in common on these logs, so the mean of each is over its own outputs, "
                "and the means do not compare.",
            )
        )
    return found
