"""Models and methods side by side: what each says of itself, and how each does on the same logs.

What results say of themselves stands on different data and rules and does not compare. So every model is scored on the
same logs by the same rules, within one band and over one horizon, with all parameters held (:func:`score_on_logs`).
Means are taken over the maneuvers that no model has seen, where there are any.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from rotorid.checking.candidate import identified_motors
from rotorid.checking.flown_motors import motor_scores, predicted_by
from rotorid.checking.flown_nonlinear import verified_through, whole_flights
from rotorid.checking.unseen import fitted_logs, has_seen
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of, is_command
from rotorid.flights.selection import (
    each_once,
    require_inside,
    require_reached,
    select_records,
    wholly_flown,
)
from rotorid.identifying.cross_validation import common_horizon_s, fitted_band, score_flights
from rotorid.results.model import IdentifiedModel, Records
from rotorid.results.provenance import Provenance
from rotorid.settings.settings import IdentifySettings, as_records, as_settings
from rotorid.signal.excitations import find_excitations
from rotorid.verification.fixed_parameters import FixedParameterScores, OutputScore, fit_percent
from rotorid.verification.verification import Verification

_PROGRESS = logging.getLogger("rotorid.progress")


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry(Immutable):
    """One identified model in a comparison.

    Parameters
    ----------
    label
        What it is called there.
    model
        The model.
    sha256
        Hash of the ``result.json`` that it was read from, empty for one that was not.
    scored
        Whether its equations are known, so that it can be scored on logs: not of a result without its ``model.toml``.
    """

    label: str
    model: IdentifiedModel
    sha256: str = ""
    scored: bool = True

    def has_seen(self, record: FlightRecord, maneuver: Maneuver) -> bool:
        """Whether any part of a maneuver was fitted, see :func:`rotorid.checking.unseen.has_seen`."""
        return has_seen(self.model.provenance, record, maneuver)

    @cached_property
    def fitted_logs(self) -> frozenset[str]:
        """Hashes of the logs that it was fitted to."""
        return fitted_logs(self.model.provenance)


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

    Raises
    ------
    UsageError
        No given segment lies inside a log.
    """
    require_inside(records, settings.segments)
    findings: list[Finding] = []
    flights: dict[str, list[Flight]] = {}
    for entry in entries:
        flights[entry.label] = []
        for record in () if _has_own_scores(entry) else records:
            try:
                flights[entry.label] += _maneuvers(entry, record, settings)
            except InsufficientDataError as error:
                findings.append(_not_scored(entry, record, error))
    band_rad_s = fitted_band([entry.model for entry in entries])
    of_motors, not_scored = _scores_of_motors(entries, records, settings)
    of_flights, not_flown = _scores_of_flights(entries, records, settings)
    findings += [*not_scored, *not_flown]
    found, failed = _scores(entries, flights, settings, None, band_rad_s)
    horizon_s = common_horizon_s([one for each in found for group in each.scores.values() for one in group])
    if horizon_s is not None:
        found, failed = _scores(entries, flights, settings, horizon_s, band_rad_s)
    found = _together(found, [*of_motors, *of_flights])
    return OnLogs(maneuvers=tuple(found), band_rad_s=band_rad_s, findings=(*findings, *failed))


def _has_own_scores(entry: Entry) -> bool:
    """Whether a model is scored in its own way: motors by accelerations, large motion over whole flights."""
    return entry.model.motors is not None or entry.model.nonlinear is not None


def _scores_of_flights(
    entries: Sequence[Entry], records: Sequence[FlightRecord], settings: IdentifySettings
) -> tuple[list[ComparedManeuver], list[Finding]]:
    """Nonlinear models: whole flights, or given intervals, simulated from their start on."""
    found: dict[tuple[str, float], ComparedManeuver] = {}
    findings: list[Finding] = []
    for entry in entries:
        equations = entry.model.nonlinear
        for record in records if equations is not None else ():
            _PROGRESS.info(f"{entry.label} on {record.source.name}")
            try:
                assert equations is not None
                require_reached(record, settings.segments)
                flights = whole_flights([record], settings.segments)
                checks, _ = verified_through(equations, equations.parameters, flights)
            except InsufficientDataError as error:
                findings.append(_not_scored(entry, record, error))
                continue
            for one in checks:
                here = found.setdefault(
                    (record.source.sha256, round(one.maneuver.start_s, 3)),
                    ComparedManeuver(
                        record=record.source.name,
                        maneuver=one.maneuver,
                        scores={},
                        seen=tuple(other.label for other in entries if other.has_seen(record, one.maneuver)),
                    ),
                )
                place = record.source.sha256, round(one.maneuver.start_s, 3)
                found[place] = replace(here, scores={**here.scores, entry.label: (_flight_scores(one),)})
    return list(found.values()), findings


def _flight_scores(check: Verification) -> FixedParameterScores:
    """A simulated flight as a comparison has it."""
    return FixedParameterScores(
        record=check.record,
        horizon_s=math.inf,
        scores={
            name: OutputScore(nrmse_fit_percent=one.nrmse_fit_percent, tic=one.tic, rms=one.rms)
            for name, one in check.scores.items()
        },
        time_s=check.time_s - check.time_s[0],
        measured=check.measured,
        predicted=check.predicted,
    )


def _scores_of_motors(
    entries: Sequence[Entry], records: Sequence[FlightRecord], settings: IdentifySettings
) -> tuple[list[ComparedManeuver], list[Finding]]:
    """Results of ``physical.motors``: accelerations from the motors of each log, which no other model predicts."""
    found: dict[tuple[str, float], ComparedManeuver] = {}
    findings: list[Finding] = []
    for entry in entries:
        known = identified_motors(entry.model)
        for record in records if known is not None else ():
            _PROGRESS.info(f"{entry.label} on {record.source.name}")
            try:
                require_reached(record, settings.segments)
                moved = predicted_by(known, record, settings.segments).moved if known else ()
            except InsufficientDataError as error:
                findings.append(_not_scored(entry, record, error))
                continue
            for one in moved:
                maneuver = replace(one.flight.maneuver, start_s=one.flight.record.start_s)
                place = record.source.sha256, round(maneuver.start_s, 3)
                here = found.setdefault(
                    place,
                    ComparedManeuver(
                        record=record.source.name,
                        maneuver=maneuver,
                        scores={},
                        seen=tuple(other.label for other in entries if other.has_seen(record, maneuver)),
                    ),
                )
                found[place] = replace(here, scores={**here.scores, entry.label: (motor_scores(one),)})
    return list(found.values()), findings


_SAME_INTERVAL_S = 0.1


def _together(others: Sequence[ComparedManeuver], more: Sequence[ComparedManeuver]) -> list[ComparedManeuver]:
    """Maneuvers of all models, in the order of the flight; one interval that several models were scored on is one."""
    found = [*others]
    for one in more:
        for place, other in enumerate(found):
            apart_s = [one.maneuver.start_s - other.maneuver.start_s, one.maneuver.stop_s - other.maneuver.stop_s]
            if one.record == other.record and max(map(abs, apart_s)) < _SAME_INTERVAL_S:
                found[place] = replace(other, scores={**other.scores, **one.scores})
                break
        else:
            found.append(one)
    return sorted(found, key=lambda one: (one.record, one.maneuver.start_s)) if more else found


def _maneuvers(entry: Entry, record: FlightRecord, settings: IdentifySettings) -> list[Flight]:
    if not entry.scored:
        raise InsufficientDataError("no model.toml stands beside its result.json")
    structure = entry.model.structure
    axes = axes_of(structure.inputs, structure.outputs)
    commands = all(is_command(name) for name in structure.inputs)
    own = tuple(one for one in settings.segments if one.axis in axes or not commands)
    if settings.segments and not own:
        raise InsufficientDataError(f"no given segment is of {' or '.join(axes)}")
    require_reached(record, own)
    if own or not commands:
        return list(select_records(structure, [record], replace(settings, segments=own)).selection.fitted)
    found = wholly_flown([Flight(record, m) for axis in axes for m in find_excitations(record, axis)])
    if not found:
        raise InsufficientDataError(f"it holds no excitation of {' or '.join(axes)}")
    return _with_rest(record, found)


def _with_rest(record: FlightRecord, flights: Sequence[Flight]) -> list[Flight]:
    """Short maneuvers with the time around them, up to half way to their neighbors: what follows one answers to it."""
    ordered = sorted({(m.start_s, m.stop_s): m for _, m in flights}.values(), key=lambda m: m.start_s)
    wider = []
    for number, m in enumerate(ordered):
        before_s = (ordered[number - 1].stop_s + m.start_s) / 2.0 if number else record.start_s
        after_s = (m.stop_s + ordered[number + 1].start_s) / 2.0 if number + 1 < len(ordered) else record.stop_s
        around = (max(m.start_s - _REST_S, before_s), min(m.stop_s + _REST_S, after_s))
        start_s, stop_s = (m.start_s, m.stop_s) if m.kind in RICH_KINDS else around
        wider.append(Flight(record, replace(m, start_s=min(m.start_s, start_s), stop_s=max(m.stop_s, stop_s))))
    return wider


def _scores(
    entries: Sequence[Entry],
    flights: Mapping[str, Sequence[Flight]],
    settings: IdentifySettings,
    horizon_s: float | None,
    band_rad_s: tuple[float, float] | None,
) -> tuple[list[ComparedManeuver], list[Finding]]:
    by_label = {entry.label: entry for entry in entries}
    places: dict[tuple[str, float, float], Flight] = {}
    scores: dict[tuple[str, float, float], dict[str, tuple[FixedParameterScores, ...]]] = {}
    findings = []
    for label, items in flights.items():
        structure = by_label[label].model.structure
        for record, maneuver in items:
            _PROGRESS.info(f"{label} on {record.source.name}")
            place = (record.source.sha256, maneuver.start_s, maneuver.stop_s)
            try:
                group = score_flights(
                    structure, [Flight(record, maneuver)], settings, horizon_s=horizon_s, band_rad_s=band_rad_s
                )
            except (InsufficientDataError, ModelError) as error:
                findings.append(_not_scored(by_label[label], record, error))
                continue
            places.setdefault(place, Flight(record, maneuver))
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


@dataclass(frozen=True, kw_only=True, slots=True)
class OnLogsSummary:
    """Mean fit on the maneuvers that count, and its standard deviation over them; the same ones for all models.

    ``seen`` says whether any model was identified on one of them; then the comparison flatters that model.
    """

    mean_percent: float
    spread_percent: float | None
    maneuvers: int
    seen: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(Immutable):
    """A finished comparison.

    Parameters
    ----------
    entries
        The models.
    maneuvers
        Of the logs, measured and predicted by each model.
    common_outputs
        Outputs that every model has been scored on, over which means are taken.
    on_logs
        Label of a model to its mean on the maneuvers that count.
    band_rad_s
        What was looked at, ``None`` for everything.
    findings
        Remarks, the worst first.
    provenance
        What was compared, and on which logs.
    """

    entries: tuple[Entry, ...]
    maneuvers: tuple[ComparedManeuver, ...]
    common_outputs: tuple[str, ...]
    on_logs: Mapping[str, OnLogsSummary]
    band_rad_s: tuple[float, float] | None
    findings: tuple[Finding, ...]
    provenance: Provenance

    @property
    def horizon_s(self) -> float:
        """How far ahead was predicted, infinite for simulations."""
        groups = (group for each in self.maneuvers for group in each.scores.values())
        return min((one.horizon_s for group in groups for one in group), default=math.inf)


Compared: TypeAlias = IdentifiedModel | Entry
"""A model to compare."""


def compare(
    models: Sequence[Compared],
    records: Records = (),
    *,
    settings: IdentifySettings | None = None,
    **options: Any,
) -> Comparison:
    """Compare identified models.

    What results say of themselves stands on different data and by different rules: a cost of responses is no fit of
    outputs, and a fit on its own data rises with every parameter. With logs every model is scored on the same
    maneuvers, its parameters frozen; logs that none has seen decide.

    Parameters
    ----------
    models
        What ``identify`` answered or :func:`rotorid.load` read; at least two.
    records
        Logs to score every model on, or their files.
    settings
        Segments, shifts and hold for the logs.
    **options
        Fields of :class:`rotorid.settings.settings.IdentifySettings`, which go before ``settings``.

    Raises
    ------
    UsageError
        Fewer than two models came.
    InsufficientDataError
        Logs came, and no model could be scored on any of them; the findings say why.
    """
    settings, records = as_settings(IdentifySettings, settings, options), as_records(records)
    entries = entries_of(models)
    if not records:
        return _comparison(entries, (), OnLogs(maneuvers=()), settings)
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
    return _comparison(entries, records, scored, settings)


def refused_comparison(
    error: InsufficientDataError,
    models: Sequence[Compared],
    records: Sequence[FlightRecord],
    *,
    settings: IdentifySettings,
) -> Comparison:
    """The comparison of what models say of themselves, with the findings why logs say nothing."""
    nothing = OnLogs(maneuvers=(), findings=tuple(error.findings))
    return _comparison(entries_of(models), records, nothing, settings)


def entries_of(models: Sequence[Compared]) -> tuple[Entry, ...]:
    """Models with labels: those of one name are told apart by a number.

    Raises
    ------
    UsageError
        Fewer than two came.
    """
    if len(models) < 2:
        raise UsageError(f"{len(models)} result came to compare", needed="at least two", remedy="give another folder")
    names = [model.label if isinstance(model, Entry) else model.name for model in models]
    labels = [
        name if names.count(name) == 1 else f"{name} ({names[: number + 1].count(name)})"
        for number, name in enumerate(names)
    ]
    return tuple(
        model if isinstance(model, Entry) else Entry(label=label, model=model)
        for model, label in zip(models, labels, strict=True)
    )


def _comparison(
    entries: tuple[Entry, ...],
    records: Sequence[FlightRecord],
    scored: OnLogs,
    settings: IdentifySettings,
) -> Comparison:
    maneuvers, shared = scored.maneuvers, common_outputs(entries, scored.maneuvers)
    summaries = _on_logs(entries, maneuvers, shared)
    results = {f"{entry.label}/result.json": entry.sha256 for entry in entries if entry.sha256}
    return Comparison(
        entries=entries,
        maneuvers=maneuvers,
        common_outputs=shared,
        on_logs=summaries,
        band_rad_s=scored.band_rad_s,
        findings=worst_first([*scored.findings, *_remarks(entries, maneuvers, shared, summaries)]),
        provenance=Provenance(
            inputs={**results, **{record.source.name: record.source.sha256 for record in records}},
            settings={name: settings.as_json()[name] for name in ("segments", "shifts", "hold")},
            seed=settings.seed,
        ),
    )


def _on_logs(
    entries: Sequence[Entry], maneuvers: Sequence[ComparedManeuver], shared: Sequence[str]
) -> dict[str, OnLogsSummary]:
    """Means over the maneuvers on which all models were scored; over those that none has seen, if there are any."""
    scored = [entry.label for entry in entries if any(entry.label in each.scores for each in maneuvers)]
    tables = [
        [each.mean_percent(name, shared or scored_outputs(each.scores.get(name, ()))) for name in scored]
        for each in maneuvers
    ]
    counted = [(each, row) for each, row in zip(maneuvers, tables, strict=True) if scored and np.isfinite(row).all()]
    unseen = [(each, row) for each, row in counted if not each.seen]
    kept = unseen or counted
    if not kept:
        return {}
    table = np.array([row for _, row in kept])
    return {
        label: OnLogsSummary(
            mean_percent=float(column.mean()),
            spread_percent=float(column.std(ddof=1)) if column.size > 1 else None,
            maneuvers=column.size,
            seen=not unseen,
        )
        for label, column in zip(scored, table.T, strict=True)
    }


def scored_outputs(group: Sequence[FixedParameterScores]) -> tuple[str, ...]:
    """Outputs that were scored."""
    return tuple(dict.fromkeys(name for one in group for name in one.scores))


def _remarks(
    entries: Sequence[Entry],
    maneuvers: Sequence[ComparedManeuver],
    shared: Sequence[str],
    summaries: Mapping[str, OnLogsSummary],
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


_TIMES = ("tau_", "T_")


def basis_of(model: IdentifiedModel, parameter: str) -> str:
    """What a delay or a lag was measured beside and by, in words; two are of one quantity where this is equal.

    Without a motor lag beside it a delay holds that lag, and a rate that the autopilot has filtered comes later than
    one that it has not. Gains and damping hardly depend on either, and have no such basis.

    Parameters
    ----------
    model
        A result.
    parameter
        Name of one of its parameters.
    """
    if not parameter.startswith(_TIMES):
        return ""
    dropped = [name for name, one in model.parameters.items() if name.startswith(_TIMES) and one.status == "dropped"]
    words = [f"without {name}" for name in sorted(dropped)]
    return ", ".join([*words, *(f"{name} from {source}" for name, source in sorted(model.provenance.sources.items()))])


def other_basis(basis: str, usual: str) -> str:
    """What sets one basis apart from the usual one, in words.

    Examples
    --------
    >>> other_basis("r from gyro", "without T_motor, r from gyro")
    'with T_motor'
    >>> other_basis("r from RATE.Y", "r from SIDD.Gz")
    'r from RATE.Y'
    """
    own, others = ({part for part in one.split(", ") if part} for one in (basis, usual))
    beside = (part.replace("without", "with", 1) for part in others - own if part.startswith("without "))
    return ", ".join(sorted([*(own - others), *beside])) or "measured otherwise"
