"""The report of ``compare``: models and methods side by side, on their own data and on the same logs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rotorid.io.store import write_atomically
from rotorid.pipeline.compare import Compared
from rotorid.pipeline.compare_document import ComparedModelDocument, CompareDocument
from rotorid.pipeline.compare_scores import ComparedManeuver
from rotorid.plot.compare import Curve, Score, predictions, score_dots
from rotorid.report.compare_rows import (
    lone_parameters,
    maneuver_rows,
    maneuver_words,
    model_rows,
    own_percent,
    percents,
    shared_rows,
)
from rotorid.report.frame import render
from rotorid.report.numbers import significant
from rotorid.report.output import to_json, write_together
from rotorid.report.picture import Picture
from rotorid.report.tables import finding_rows
from rotorid.verify.frozen import FrozenScores

JSON, PAGE = "compare.json", "report.html"
_MOST_PICTURES = 8


def write_comparison(folder: Path, compared: Compared, *, title: str) -> None:
    """Write ``compare.json`` and ``report.html``, both or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    compared
        What to write.
    title
        Heading of the report.
    """
    text, page = to_json(compared.document), render_comparison(compared, title=title)
    write_together(
        folder,
        {JSON: lambda path: write_atomically(path, text), PAGE: lambda path: write_atomically(path, page)},
    )


def render_comparison(compared: Compared, *, title: str) -> str:
    """The report as one HTML document, which holds everything it shows and lets no text of a result act.

    Parameters
    ----------
    compared
        What ``compare`` found.
    title
        Heading of the page.
    """
    document = compared.document
    dots = _dots(document)
    overlays = [_overlay(each, f"maneuver-{number}") for number, each in enumerate(compared.maneuvers[:_MOST_PICTURES])]
    return render(
        "compare.html",
        title=title,
        document=document,
        sentences=comparison_summary(document),
        labels=[one.label for one in document.models],
        models=model_rows(document),
        parameters=shared_rows(document),
        lone={label: count for label, count in lone_parameters(document).items() if count},
        maneuvers=maneuver_rows(document),
        dots=dots,
        overlays=overlays,
        undrawn=len(compared.maneuvers) - len(overlays),
        horizon=significant(document.horizon_s, digits=2) if document.horizon_s else "",
        band=" to ".join(significant(edge) for edge in document.band_rad_s or ()),
        remarks=finding_rows(document.findings),
        pictures=[*([dots] if dots else []), *overlays],
    )


def comparison_summary(document: CompareDocument) -> tuple[str, ...]:
    """Which model does best where, in sentences: on logs, then by cross-validation."""
    sentences = []
    on_logs = {one.label: one.on_logs for one in document.models if one.on_logs}
    if on_logs:
        best = max(on_logs, key=lambda label: on_logs[label].mean_percent)
        won = on_logs[best]
        unseen = "fitted by at least one of the models" if won.seen else "that no model has seen"
        maneuvers = f"{won.maneuvers} maneuver{'' if won.maneuvers == 1 else 's'}"
        sentences.append(
            f"On {maneuvers} {unseen}, {best} does best with a fit of {percents(won.mean_percent, won.spread_percent)} "
            f"%{_runner_up({label: one.mean_percent for label, one in on_logs.items()}, best, won.spread_percent)}."
        )
    means = {
        one.label: one.cross_validation.mean_percent
        for one in document.models
        if one.cross_validation and one.cross_validation.mean_percent is not None
    }
    if len(means) > 1:
        best = max(means, key=means.__getitem__)
        sentences.append(
            f"Cross-validated, {best} does best with {percents(means[best], None)} %{_runner_up(means, best)}."
        )
    count = len(document.models)
    return tuple(sentences) or (
        f"{count} results side by side. What each says of itself stands on its own data; with --log all are scored on "
        "the same.",
    )


def _runner_up(means: Mapping[str, float], best: str, spread: float | None = None) -> str:
    others = {label: mean for label, mean in means.items() if label != best}
    if not others:
        return ""
    second = max(others, key=others.__getitem__)
    close = spread is not None and means[best] - others[second] < spread
    return f", before {second} with {percents(others[second], None)} %{', within the spread' if close else ''}"


def _dots(document: CompareDocument) -> Picture | None:
    models = document.models
    kinds = {
        "on its own data": [_score(own_percent(one), None) for one in models],
        "cross-validated": [_validated(one) for one in models],
        "on the logs": [
            _score(one.on_logs.mean_percent, one.on_logs.spread_percent) if one.on_logs else _score(None, None)
            for one in models
        ],
    }
    there = {kind: scores for kind, scores in kinds.items() if any(math.isfinite(one.mean) for one in scores)}
    if not there:
        return None
    figure = score_dots([one.label for one in models], kinds)
    return Picture(key="scores", description=f"Fit percent of each model: {', '.join(there)}", figure=figure)


def _validated(one: ComparedModelDocument) -> Score:
    found = one.cross_validation
    return _score(found.mean_percent, found.spread_percent) if found else _score(None, None)


def _score(mean: float | None, spread: float | None) -> Score:
    return Score(math.nan if mean is None else mean, math.nan if spread is None else spread)


def _overlay(each: ComparedManeuver, key: str) -> Picture:
    curves = {label: _curves(group) for label, group in each.scores.items()}
    measured: dict[str, Curve] = {}
    for found in curves.values():
        measured = {name: one[0] for name, one in found.items()} | measured
    models = {label: {name: one[1] for name, one in found.items()} for label, found in curves.items()}
    figure = predictions(list(measured), measured, models)
    maneuver = each.maneuver
    when = f"{maneuver_words(maneuver.axis, maneuver.kind)}{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s"
    return Picture(key=key, description=f"{each.record}, {when}: measured and predicted", figure=figure)


def _curves(group: tuple[FrozenScores, ...]) -> dict[str, tuple[Curve, Curve]]:
    """Output to measured and predicted samples; a gap between two stretches is a gap in the curve."""
    found = {}
    for row, name in enumerate(group[0].scores):
        time_s = np.concatenate([np.append(one.time_s, np.nan) for one in group])[:-1]
        measured, predicted = (
            np.concatenate([np.append(values[row], np.nan) for values in arrays])[:-1]
            for arrays in ([one.measured for one in group], [one.predicted for one in group])
        )
        found[name] = Curve(time_s, measured), Curve(time_s, predicted)
    return found
