"""The report of ``compare``: models and methods on their own data and on the same logs.

A comparison becomes rows, one for each model, each shared parameter and each maneuver, with pictures of the maneuvers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.data.display import counted
from rotorid.data.quantity import MISSING, milliseconds, minus, significant, unit, with_error
from rotorid.documents.compare import (
    ComparedManeuverDocument,
    ComparedModelDocument,
    CompareDocument,
    ComparedParameterDocument,
    compare_document,
    steps_of,
)
from rotorid.flying.step_responses import StepPair
from rotorid.identifying.comparison import ComparedManeuver, Comparison
from rotorid.plot.figure import quantity
from rotorid.plot.time import Curve, Score, predictions, score_dots, steps
from rotorid.report.files import write_together
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, render
from rotorid.report.parts import FAR_SIGMAS, Cell
from rotorid.results.summary import METHODS, PoleEstimate
from rotorid.results.verdicts import NOT_IDENTIFIED, Verdict, badge
from rotorid.verification.fixed_parameters import FixedParameterScores

_KINDS = {"each": "on each", "leave_one_out": "leave one out"}


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelRow:
    """One result; numbers are text."""

    label: str
    model: str
    method: str
    outputs: str
    order: str
    parameters: str
    fit: Verdict | None
    own: str
    validated: str
    validated_kind: str
    on_logs: str
    cost: str
    aic: str
    bic: str
    poles: tuple[str, ...]
    delays: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SharedRow:
    """One parameter: for each result its value, and the distance from the first."""

    name: str
    unit: str
    values: tuple[Cell, ...]
    distances: tuple[Cell, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverRow:
    """One maneuver: fit of every model, marked where it was fitted."""

    record: str
    what: str
    fits: tuple[Cell, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class StepRow:
    """The answer of one model to a step; numbers are text."""

    pair: str
    label: str
    final: str
    start: str
    rise: str


def model_rows(document: CompareDocument) -> tuple[ModelRow, ...]:
    """One row for each result."""
    return tuple(_model_row(model) for model in document.models)


def _model_row(model: ComparedModelDocument) -> ModelRow:
    validated, logs = model.cross_validation, model.on_logs
    return ModelRow(
        label=model.label,
        model=model.model,
        method=METHODS[model.method].name if model.method in METHODS else model.method,
        outputs=", ".join(model.outputs),
        order=str(model.order),
        parameters=str(model.free_parameters),
        fit=badge(model.verdict) if model.verdict is not None else None,
        own=significant(own_percent(model)),
        validated=with_error(validated.mean_percent, validated.spread_percent, digits=3) if validated else MISSING,
        validated_kind=_KINDS[validated.kind] if validated else "",
        on_logs=with_error(logs.mean_percent, logs.spread_percent, digits=3) if logs else MISSING,
        cost=significant(model.cost),
        aic=_criterion(model.aic),
        bic=_criterion(model.bic),
        poles=tuple(_pole(pole) for pole in model.poles if pole.imag >= 0.0),
        delays=tuple(
            (name, milliseconds(delay.total_s, delay.total_std_s))
            for name, delay in model.delays.items()
            if delay.total_s > 0.0
        ),
    )


def own_percent(model: ComparedModelDocument) -> float | None:
    """Mean fit of the outputs on the data that were fitted."""
    fits = list((model.fit_percent or {}).values())
    return sum(fits) / len(fits) if fits else None


def _criterion(value: float | None) -> str:
    return MISSING if value is None else minus(f"{value:.0f}")


def _pole(pole: PoleEstimate) -> str:
    real = significant(pole.real)
    return real if pole.imag == 0.0 else f"{real} ± {significant(pole.imag)}j"


def shared_rows(document: CompareDocument) -> tuple[SharedRow, ...]:
    """Parameters that at least two results share and have not dropped; those of all results first."""
    labels = [model.label for model in document.models]
    kept = {
        name: parameter
        for name, parameter in document.parameters.items()
        if sum(value.status != "dropped" for value in parameter.values.values()) > 1
    }
    ordered = sorted(kept.items(), key=lambda item: -len(item[1].values))
    return tuple(_shared_row(name, parameter, labels) for name, parameter in ordered)


def unshared_parameters(document: CompareDocument) -> dict[str, int]:
    """Label to the number of parameters that no other result has."""
    names = {row.name for row in shared_rows(document)}
    return {
        model.label: sum(
            name not in names and model.label in parameter.values and parameter.values[model.label].status != "dropped"
            for name, parameter in document.parameters.items()
        )
        for model in document.models
    }


def _shared_row(name: str, parameter: ComparedParameterDocument, labels: list[str]) -> SharedRow:
    def value(label: str) -> Cell:
        found = parameter.values.get(label)
        if found is None:
            return Cell(MISSING)
        if not found.identified:
            return Cell(NOT_IDENTIFIED)
        return Cell("dropped" if found.status == "dropped" else with_error(found.value, found.std))

    def distance(label: str) -> Cell:
        found = parameter.values.get(label)
        if found is None or found.z is None:
            return Cell("")
        size = f"{abs(found.z):.1f}"
        sign = "" if size == "0.0" else "+" if found.z >= 0.0 else "−"
        return Cell(f"{sign}{size} σ", abs(found.z) > FAR_SIGMAS)

    return SharedRow(
        name=name.partition(" [")[0],
        unit=unit(parameter.unit),
        values=tuple(value(label) for label in labels),
        distances=tuple(distance(label) for label in labels),
    )


def maneuver_rows(document: CompareDocument) -> tuple[ManeuverRow, ...]:
    """One row for each maneuver."""
    return tuple(_maneuver_row(maneuver, [model.label for model in document.models]) for maneuver in document.maneuvers)


def _maneuver_row(maneuver: ComparedManeuverDocument, labels: list[str]) -> ManeuverRow:
    def fit(label: str) -> Cell:
        found = maneuver.models.get(label)
        return Cell(MISSING) if found is None else Cell(significant(found.mean_percent), found.seen)

    return ManeuverRow(
        record=maneuver.record,
        what=f"{maneuver_words(maneuver.axis, maneuver.kind)}{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s",
        fits=tuple(fit(label) for label in labels),
    )


def scored_words(document: CompareDocument) -> str:
    """How models were scored on logs, for a title: the band and the horizon."""
    band = " to ".join(significant(edge) for edge in document.band_rad_s or ())
    ahead = f", {significant(document.horizon_s, digits=2)} s ahead" if document.horizon_s else ""
    return f"{f', {band} rad/s' if band else ''}{ahead}"


def maneuver_words(axis: str, kind: str) -> str:
    """Axis and kind of a maneuver, before its times; empty for a stretch without a name.

    Examples
    --------
    >>> maneuver_words("roll", "random_binary"), maneuver_words("roll", "other")
    ('roll random binary, ', '')
    """
    return "" if kind == "other" else f"{axis} {kind.replace('_', ' ')}, "


JSON, PAGE = "compare.json", "report.html"
_MOST_PICTURES = 8


def write_comparison(folder: Path, compared: Comparison, *, title: str) -> None:
    """Write ``compare.json`` and ``report.html``, both or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    """
    steps = steps_of(compared)
    document = compare_document(compared, steps)
    page = render_documents(document, compared.maneuvers, steps, title=title)
    write_together(folder, {JSON: document, PAGE: page})


def render_comparison(compared: Comparison, *, title: str) -> str:
    """The report as one self-contained HTML document.

    Parameters
    ----------
    compared
        What ``compare`` found.
    """
    steps = steps_of(compared)
    return render_documents(compare_document(compared, steps), compared.maneuvers, steps, title=title)


def render_documents(
    document: CompareDocument, flown: Sequence[ComparedManeuver], steps: Sequence[StepPair] = (), *, title: str
) -> str:
    """The same of a document and the signals behind it."""
    dots, overlays, stepped = _dots(document), _overlays(flown), _stepped(document, steps)
    return render(
        "compare.html",
        logs=document.provenance.inputs,
        title=title,
        document=document,
        sentences=comparison_summary(document),
        labels=[model.label for model in document.models],
        models=model_rows(document),
        parameters=shared_rows(document),
        lone={label: count for label, count in unshared_parameters(document).items() if count},
        maneuvers=maneuver_rows(document),
        dots=dots,
        overlays=overlays,
        stepped=stepped,
        step_rows=(*step_rows(document), *measured_rows(document)),
        unmeasured=unmeasured_steps(document),
        undrawn=len(flown) - len(overlays),
        horizon=significant(document.horizon_s, digits=2) if document.horizon_s else "",
        band=" to ".join(significant(edge) for edge in document.band_rad_s or ()),
        remarks=finding_rows(document.findings),
        pictures=[*([dots] if dots else []), *overlays, *stepped],
    )


def pictures_of(
    document: CompareDocument, flown: Sequence[ComparedManeuver], steps: Sequence[StepPair] = ()
) -> Sequence[Picture]:
    """All pictures of the page."""
    dots = _dots(document)
    return [*([dots] if dots else []), *_overlays(flown), *_stepped(document, steps)]


def step_rows(document: CompareDocument) -> tuple[StepRow, ...]:
    """One row for each pair and model: where a step ends, and how long it takes."""
    return tuple(
        StepRow(
            pair=f"{quantity(pair.output).words} after {quantity(pair.input).words}",
            label=label,
            final=significant(step.final * quantity(pair.output).factor / quantity(pair.input).factor),
            start=f"{1e3 * step.start_s:.0f}" if step.start_s is not None else MISSING,
            rise=milliseconds(step.rise_s, step.rise_std_s) if step.rise_s is not None else MISSING,
        )
        for pair in document.steps
        for label, step in pair.models.items()
    )


def measured_rows(document: CompareDocument) -> tuple[StepRow, ...]:
    """One row for each pair and log that shows its step."""
    return tuple(
        StepRow(
            pair=f"{quantity(pair.output).words} after {quantity(pair.input).words}",
            label=f"measured in {step.log}",
            final=MISSING,
            start=MISSING,
            rise=milliseconds(step.rise_time_s.value, step.rise_time_s.std) if step.rise_time_s else MISSING,
        )
        for pair in document.steps
        for step in pair.measured
        if not step.why
    )


def unmeasured_steps(document: CompareDocument) -> tuple[str, ...]:
    """Why logs show no step of a pair, one sentence for each reason."""
    return tuple(
        dict.fromkeys(
            f"{step.log} shows no step of {quantity(pair.output).words}. {step.why}"
            for pair in document.steps
            for step in pair.measured
            if step.why
        )
    )


def _stepped(document: CompareDocument, pairs: Sequence[StepPair]) -> list[Picture]:
    """Step responses of all models in one picture; none without a pair that they share."""
    if not pairs:
        return []
    figure = drawn(
        steps,
        pairs[0].time_s,
        [(pair.input, pair.output) for pair in pairs],
        [{label: (own.response, own.lower, own.upper) for label, own in pair.models.items()} for pair in pairs],
        [model.label for model in document.models],
        [
            {f"measured in {step.log}": (step.time_s, step.response, step.lower, step.upper) for step in pair.measured}
            for pair in pairs
        ],
    )
    names = ", ".join(f"{pair.output} after {pair.input}" for pair in pairs)
    return [Picture(key="steps", description=f"Step responses of the models: {names}", figure=figure)]


def _overlays(flown: Sequence[ComparedManeuver]) -> Sequence[Picture]:
    return [_overlay(each, f"maneuver-{number}") for number, each in enumerate(flown[:_MOST_PICTURES])]


def comparison_summary(document: CompareDocument) -> tuple[str, ...]:
    """Which model is best and by how much: on logs, then by cross-validation."""
    sentences = []
    on_logs = {model.label: model.on_logs for model in document.models if model.on_logs}
    if on_logs:
        best = max(on_logs, key=lambda label: on_logs[label].mean_percent)
        won = on_logs[best]
        unseen = " (some were used for a fit)" if won.seen else " unseen by all models"
        maneuvers = counted(won.maneuvers, "maneuver")
        fit = with_error(won.mean_percent, won.spread_percent, digits=3)
        sentences.append(
            f"Best on {maneuvers}{unseen}: {best}, with a fit of {fit} "
            f"%{_runner_up({label: one.mean_percent for label, one in on_logs.items()}, best, won.spread_percent)}."
        )
    means = {
        model.label: model.cross_validation.mean_percent
        for model in document.models
        if model.cross_validation and model.cross_validation.mean_percent is not None
    }
    if len(means) > 1:
        best = max(means, key=means.__getitem__)
        sentences.append(
            f"Best by cross-validation: {best}, with {significant(means[best])} %{_runner_up(means, best)}."
        )
    count = len(document.models)
    why = (
        "no maneuver of the logs has a score of every model."
        if document.maneuvers
        else "each was scored on its own data. Add --log LOG to score all on the same data."
    )
    ranked = sentences or [f"No ranking of these {count} results: {why}"]
    return (*ranked, *_changes(document))


def _changes(document: CompareDocument) -> list[str]:
    """Whether numbers changed between results of different logs, by the rule of ``fleet``."""
    verdicts = [
        (name, label, value.verdict)
        for name, parameter in document.parameters.items()
        for label, value in parameter.values.items()
        if value.verdict is not None
    ]
    if not verdicts:
        return []
    decided = sum(verdict != "undecided" for _, _, verdict in verdicts)
    changed = [f"{name} in {label}" for name, label, verdict in verdicts if verdict == "changed"]
    checked = f"{decided} of {len(verdicts)} comparisons had enough data"
    if changed:
        return [f"Changed since the first result: {', '.join(changed)} ({checked})."]
    return [f"No change between the results ({checked})." if decided else "Not enough data to detect a change."]


def _runner_up(means: Mapping[str, float], best: str, spread: float | None = None) -> str:
    others = {label: mean for label, mean in means.items() if label != best}
    if not others:
        return ""
    second = max(others, key=others.__getitem__)
    close = spread is not None and means[best] - others[second] < spread
    return f" (next: {second}, {significant(others[second])} %{', within the spread' if close else ''})"


def _dots(document: CompareDocument) -> Picture | None:
    models = document.models
    kinds = {
        "on its own data": [_score(own_percent(model), None) for model in models],
        "cross-validated": [_validated(model) for model in models],
        "on the logs": [
            _score(model.on_logs.mean_percent, model.on_logs.spread_percent) if model.on_logs else _score(None, None)
            for model in models
        ],
    }
    there = {kind: scores for kind, scores in kinds.items() if any(math.isfinite(score.mean) for score in scores)}
    if not there:
        return None
    figure = drawn(score_dots, [model.label for model in models], kinds)
    return Picture(key="scores", description=f"Fit percent of each model: {', '.join(there)}", figure=figure)


def _validated(model: ComparedModelDocument) -> Score:
    found = model.cross_validation
    return _score(found.mean_percent, found.spread_percent) if found else _score(None, None)


def _score(mean: float | None, spread: float | None) -> Score:
    return Score(math.nan if mean is None else mean, math.nan if spread is None else spread)


def _overlay(each: ComparedManeuver, key: str) -> Picture:
    curves = {label: _curves(group) for label, group in each.scores.items()}
    measured: dict[str, Curve] = {}
    for found in curves.values():
        measured = {name: curves[0] for name, curves in found.items()} | measured
    models = {label: {name: curves[1] for name, curves in found.items()} for label, found in curves.items()}
    figure = drawn(predictions, list(measured), measured, models)
    maneuver = each.maneuver
    when = f"{maneuver_words(maneuver.axis, maneuver.kind)}{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s"
    return Picture(key=key, description=f"{each.record}, {when}: measured and predicted", figure=figure)


def _curves(group: tuple[FixedParameterScores, ...]) -> dict[str, tuple[Curve, Curve]]:
    """Output to measured and predicted samples, with a gap between two stretches."""
    found = {}
    for row, name in enumerate(group[0].scores):
        time_s = np.concatenate([np.append(scores.time_s, np.nan) for scores in group])[:-1]
        measured, predicted = (
            np.concatenate([np.append(values[row], np.nan) for values in arrays])[:-1]
            for arrays in ([scores.measured for scores in group], [scores.predicted for scores in group])
        )
        found[name] = Curve(time_s, measured), Curve(time_s, predicted)
    return found
