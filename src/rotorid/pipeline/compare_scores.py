"""Every model on the same maneuvers, by the same rules: the honest part of a comparison."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.compare_results import Entry
from rotorid.pipeline.frozen import common_horizon_s, fitted_band, score_flown
from rotorid.pipeline.instruments import Flown, axes_of, is_command
from rotorid.pipeline.selection import RICH_KINDS, wholly_flown
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_selection import select_records
from rotorid.signal.segment import find_excitations
from rotorid.verify.cross_validation import fit_percent
from rotorid.verify.frozen import FrozenScores

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
    scores: Mapping[str, tuple[FrozenScores, ...]]
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
    progress: Callable[[str], None] = lambda _: None,
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
    progress
        Told what is being done.
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
    found, failed = _scores(entries, flown, settings, None, band_rad_s, progress)
    horizon_s = common_horizon_s([one for each in found for group in each.scores.values() for one in group])
    if horizon_s is not None:
        found, failed = _scores(entries, flown, settings, horizon_s, band_rad_s, progress)
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
    progress: Callable[[str], None],
) -> tuple[list[ComparedManeuver], list[Finding]]:
    by_label = {entry.label: entry for entry in entries}
    places: dict[tuple[str, float, float], Flown] = {}
    scores: dict[tuple[str, float, float], dict[str, tuple[FrozenScores, ...]]] = {}
    findings = []
    for label, items in flown.items():
        structure = by_label[label].structure
        for record, maneuver in items:
            progress(f"{label} on {record.source.name}")
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
    return Finding(
        kind="not_verified",
        severity="warning",
        where=f"{entry.label} on {record.source.name}",
        message=f"{record.source.name} does not score {entry.label}: {error.came.rstrip('.')}.",
    )
