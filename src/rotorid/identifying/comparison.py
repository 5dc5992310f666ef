"""Comparison of models and methods: their own results, and their scores on the same logs.

What results say of themselves stands on different data and rules and does not compare. So every model is scored on the
same logs by the same rules, within one band and over one horizon, with all parameters held (:func:`score_on_logs`).
Means are taken over the maneuvers that no model has seen, where there are any.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, Unpack

import numpy as np

from rotorid.checking.candidate import candidate_model
from rotorid.checking.predictions import Trial, fitted_logs, not_moved, was_fitted
from rotorid.checking.predictors import predictor_of
from rotorid.checking.scores import common_band, common_horizon_s
from rotorid.data.base import Immutable, ShownByDocument
from rotorid.data.display import counted
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.selection import (
    each_once,
    require_inside,
)
from rotorid.io.records import as_records
from rotorid.results.model import IdentifiedModel, Records, as_models
from rotorid.results.provenance import Provenance
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import as_settings
from rotorid.verification.fixed_parameters import FixedParameterScores, fit_percent

if TYPE_CHECKING:
    from rotorid.settings.option_types import IdentifyOptions

_PROGRESS = logging.getLogger("rotorid.progress")


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry(Immutable):
    """One identified model in a comparison.

    Parameters
    ----------
    label
        What it is called there.
    sha256
        Hash of the ``result.json`` that it was read from, empty for one that was not.
    scored
        Whether its equations are known, so that it can be scored on logs: not of a result without its ``model.toml``.
    """

    label: str
    model: IdentifiedModel
    sha256: str = ""
    scored: bool = True

    def was_fitted(self, flight: Flight) -> bool:
        """Whether any part of a flight was fitted, see :func:`rotorid.checking.predictions.was_fitted`."""
        return was_fitted(self.model.provenance, flight)

    @cached_property
    def fitted_logs(self) -> frozenset[str]:
        """Hashes of the logs that it was fitted to."""
        return fitted_logs(self.model.provenance)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedManeuver(Immutable):
    """One maneuver under all models.

    Parameters
    ----------
    record
        Name of the log.
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
        if any(name not in scores.scores for scores in group for name in outputs):
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
    settings
        Whose segments, shifts and hold count.

    Raises
    ------
    UsageError
        No given segment lies inside a log.
    """
    require_inside(records, settings.segments)
    trials, findings = _trials(entries, records, settings)
    band_rad_s = common_band([entry.model for entry in entries])
    found, failed = _scores(entries, trials, None, band_rad_s)
    horizon_s = common_horizon_s([scores for each in found for group in each.scores.values() for scores in group])
    if horizon_s is not None:
        found, failed = _scores(entries, trials, horizon_s, band_rad_s)
    return OnLogs(maneuvers=tuple(found), band_rad_s=band_rad_s, findings=(*findings, *failed))


_SAME_INTERVAL_S = 0.1
"""Whole flights whose ends lie closer than this are one; maneuvers of models about trim are found alike by all."""


class _Trial(NamedTuple):
    """A flight on which a model is to be scored, and how far its ends may lie from those that others are scored on."""

    entry: Entry
    trial: Trial
    slack_s: float

    def is_of(self, flight: Flight) -> bool:
        """Whether it is the same interval of the same log."""
        own, other = self.trial.flight, flight
        apart_s = (own.maneuver.start_s - other.maneuver.start_s, own.maneuver.stop_s - other.maneuver.stop_s)
        return own.record.source == other.record.source and max(map(abs, apart_s)) <= self.slack_s


def _trials(
    entries: Sequence[Entry], records: Sequence[FlightRecord], settings: IdentifySettings
) -> tuple[list[_Trial], list[Finding]]:
    """Flights on which each model can be scored, those of models about trim first."""
    found: list[_Trial] = []
    findings: list[Finding] = []
    predictors = [(entry, predictor_of(candidate_model(entry.model))) for entry in entries]
    for entry, predictor in sorted(predictors, key=lambda pair: not pair[1].about_trim):
        slack_s = 0.0 if predictor.about_trim else _SAME_INTERVAL_S
        for record in records:
            _PROGRESS.info(f"{entry.label} on {record.source.name}")
            try:
                if predictor.about_trim and not entry.scored:
                    raise InsufficientDataError("there is no model.toml next to its result.json")
                found += [_Trial(entry, trial, slack_s) for trial in predictor.trials(record, settings)]
            except InsufficientDataError as error:
                findings.append(_not_scored(entry, record, error))
    return found, findings


def _scores(
    entries: Sequence[Entry],
    trials: Sequence[_Trial],
    horizon_s: float | None,
    band_rad_s: tuple[float, float] | None,
) -> tuple[list[ComparedManeuver], list[Finding]]:
    """Maneuvers with the scores of all models."""
    flights: list[Flight] = []
    scores: list[dict[str, tuple[FixedParameterScores, ...]]] = []
    findings = []
    for trial in trials:
        flight, label = trial.trial.flight, trial.entry.label
        _PROGRESS.info(f"{label} on {flight.record.source.name}")
        try:
            group = trial.trial.score(horizon_s, band_rad_s)
        except (InsufficientDataError, ModelError) as error:
            findings.append(_not_scored(trial.entry, flight.record, error))
            continue
        place = next((place for place, other in enumerate(flights) if trial.is_of(other)), len(flights))
        if place == len(flights):
            flights.append(flight)
            scores.append({})
        scores[place][label] = group
    found = [
        ComparedManeuver(
            record=flight.record.source.name,
            maneuver=flight.maneuver,
            scores=here,
            seen=tuple(entry.label for entry in entries if entry.was_fitted(flight)),
        )
        for flight, here in zip(flights, scores, strict=True)
    ]
    if any(trial.slack_s for trial in trials):
        found.sort(key=lambda maneuver: (maneuver.record, maneuver.maneuver.start_s))
    return found, findings


def common_outputs(entries: Sequence[Entry], maneuvers: Sequence[ComparedManeuver]) -> tuple[str, ...]:
    """Outputs that every model has been scored on, wherever it was scored."""
    names = [
        {name for each in maneuvers for scores in each.scores.get(entry.label, ()) for name in scores.scores}
        for entry in entries
    ]
    shared = set.intersection(*(channel_names for channel_names in names if channel_names)) if any(names) else set()
    every = dict.fromkeys(
        n for each in maneuvers for group in each.scores.values() for scores in group for n in scores.scores
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
class Comparison(ShownByDocument, Immutable):
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
    records
        These logs.
    """

    entries: tuple[Entry, ...]
    maneuvers: tuple[ComparedManeuver, ...]
    common_outputs: tuple[str, ...]
    on_logs: Mapping[str, OnLogsSummary]
    band_rad_s: tuple[float, float] | None
    findings: tuple[Finding, ...]
    provenance: Provenance
    records: tuple[FlightRecord, ...] = ()

    @property
    def horizon_s(self) -> float:
        """How far ahead was predicted, infinite for simulations."""
        groups = (group for each in self.maneuvers for group in each.scores.values())
        return min((scores.horizon_s for group in groups for scores in group), default=math.inf)


Compared: TypeAlias = IdentifiedModel | Entry
"""A model to compare."""


def compare(
    models: Sequence[Compared],
    records: Records = (),
    *,
    settings: IdentifySettings | None = None,
    **options: Unpack[IdentifyOptions],
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
        Fields of :class:`rotorid.settings.identifying.IdentifySettings`, which go before ``settings``.

    Raises
    ------
    UsageError
        Fewer than two models came.
    InsufficientDataError
        Logs came, and no model could be scored on any of them; the findings say why.
    """
    settings, records = as_settings(IdentifySettings, settings, options), as_records(records, optional=True)
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
    """The comparison of models by their own results, with findings on why no log could be used."""
    nothing = OnLogs(maneuvers=(), findings=tuple(error.findings))
    return _comparison(entries_of(models), records, nothing, settings)


def entries_of(models: Sequence[Compared]) -> tuple[Entry, ...]:
    """Models with labels: those of one name are distinguished by a number.

    Raises
    ------
    UsageError
        Fewer than two came, or what is no model.
    """
    as_models([model.model if isinstance(model, Entry) else model for model in models])
    if len(models) < 2:
        raise UsageError(
            f"only {counted(len(models), 'result')} to compare", needed="at least two", remedy="add another folder"
        )
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
        records=tuple(records),
    )


def _on_logs(
    entries: Sequence[Entry], maneuvers: Sequence[ComparedManeuver], shared: Sequence[str]
) -> dict[str, OnLogsSummary]:
    """Means over the maneuvers on which all models were scored, if possible unseen ones only."""
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
    return tuple(dict.fromkeys(name for scores in group for name in scores.scores))


def _remarks(
    entries: Sequence[Entry],
    maneuvers: Sequence[ComparedManeuver],
    shared: Sequence[str],
    summaries: Mapping[str, OnLogsSummary],
) -> list[Finding]:
    found = [*_unmoved(maneuvers)]
    fitted_maneuvers = {label: [each for each in maneuvers if label in each.seen] for label in summaries}
    if any(summary.seen for summary in summaries.values()):
        labels = ", ".join(label for label, them in fitted_maneuvers.items() if them)
        found.append(
            warn(
                "seen_data",
                labels,
                f"{labels} used every common maneuver for the fit, which favors models with more parameters. "
                "Give a log that none of them has seen.",
            )
        )
    if maneuvers and not shared:
        found.append(
            warn(
                "different_outputs",
                ", ".join(entry.label for entry in entries),
                "The models share no output on these logs. Each mean is over the outputs of its model, so the "
                "means do not compare.",
            )
        )
    return found


def _unmoved(maneuvers: Sequence[ComparedManeuver]) -> Iterator[Finding]:
    """A note on each log with outputs that no input of a model moved: they are no part of its means."""
    still: dict[str, dict[str, None]] = {}
    for each in maneuvers:
        for group in each.scores.values():
            for name in scored_outputs(group):
                if not math.isfinite(fit_percent(group, name)):
                    still.setdefault(each.record, {})[name] = None
    for record, names in still.items():
        yield not_moved(record, list(names))


_TIMES = ("tau_", "T_")


def basis_of(model: IdentifiedModel, parameter: str) -> str:
    """Basis of a delay or a lag in words; two values are comparable if it is equal.

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
    dropped = [
        name for name, estimate in model.parameters.items() if name.startswith(_TIMES) and estimate.status == "dropped"
    ]
    words = [f"without {name}" for name in sorted(dropped)]
    return ", ".join([*words, *(f"{name} from {source}" for name, source in sorted(model.provenance.sources.items()))])


def other_basis(basis: str, usual: str) -> str:
    """Difference of one basis from the usual one, in words.

    Examples
    --------
    >>> other_basis("r from gyro", "without T_motor, r from gyro")
    'with T_motor'
    >>> other_basis("r from RATE.Y", "r from SIDD.Gz")
    'r from RATE.Y'
    """
    own, others = ({part for part in one.split(", ") if part} for one in (basis, usual))
    counterparts = (part.replace("without", "with", 1) for part in others - own if part.startswith("without "))
    return ", ".join(sorted([*(own - others), *counterparts])) or "measured differently"
