"""Models side by side: their scores with spread, and their predictions over one measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rotorid.plot.figure import Figure, Trace, numbers, text
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, DASHES, INPUT, MEASURED, MODEL, SERIES
from rotorid.plot.time import TIME_AXIS, line
from rotorid.typing import FloatArray

_ROW_PX, _LEAST_PX = 34.0, 90.0
_HEIGHT_PX = 210.0
_KINDS = ((BESIDE, "circle-open"), (MEASURED, "diamond"), (MODEL, "circle"), (INPUT, "square"))
_APART = 0.16


class Score(NamedTuple):
    """Fit percent and its standard deviation; not a number where there is none."""

    mean: float
    spread: float = float("nan")


class Curve(NamedTuple):
    """Samples of one signal, each shape ``(n,)``."""

    time_s: FloatArray
    values: FloatArray


def score_dots(labels: Sequence[str], scores: Mapping[str, Sequence[Score]]) -> Figure:
    """Fit percent of every model, a row for each, with bars of one standard deviation.

    Parameters
    ----------
    labels
        Of the models, from top to bottom.
    scores
        Kind of score to one for each model; up to four kinds, which keep apart in the row and keep their colors also
        where another kind has no numbers and is left out.

    Examples
    --------
    >>> figure = score_dots(["first", "second"], {"unseen": [Score(72.5, 2.9), Score(81.4, 2.8)]})
    >>> figure["data"][0]["x"], figure["data"][0]["error_x"]["array"]
    ([72.5, 81.4], [2.9, 2.8])
    """
    rows = np.arange(len(labels), dtype=np.float64)
    known = {kind for kind, found in scores.items() if any(math.isfinite(one.mean) for one in found)}
    offsets = iter(_APART * (np.arange(len(known)) - (len(known) - 1) / 2.0))
    traces = [
        _dots(rows + next(offsets), kind, found, labels, number)
        for number, (kind, found) in enumerate(scores.items())
        if kind in known
    ]
    axis: dict[str, Any] = {
        "tickmode": "array",
        "tickvals": numbers(rows),
        "ticktext": [text(label) for label in labels],
        "range": [len(labels) - 0.5, -0.5],
        "zeroline": False,
    }
    height_px = max(_LEAST_PX, _ROW_PX * len(labels))
    panel = Panel(label="Fit, mean of the outputs", traces=traces, height_px=height_px, axis=axis)
    return stacked([panel], x_axis={"title": {"text": "Fit [%]"}, "zeroline": False})


def _dots(rows: FloatArray, kind: str, found: Sequence[Score], labels: Sequence[str], number: int) -> Trace:
    color, symbol = _KINDS[number % len(_KINDS)]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(np.array([one.mean for one in found])),
        "y": numbers(rows),
        "error_x": {
            "type": "data",
            "array": numbers(np.array([one.spread for one in found])),
            "color": color,
            "thickness": 1.4,
        },
        "marker": {"color": color, "symbol": symbol, "size": 9, "line": {"color": color, "width": 1.6}},
        "text": [text(label) for label in labels],
        "hovertemplate": "%{text}<br>%{x:.4~g} %",
        "name": kind,
        "legendgroup": kind,
        "showlegend": True,
    }


def predictions(
    outputs: Sequence[str], measured: Mapping[str, Curve], models: Mapping[str, Mapping[str, Curve]]
) -> Figure:
    """Measured outputs, and what every model predicted of them.

    Parameters
    ----------
    outputs
        Names of the outputs, a panel for each.
    measured
        Output to its samples.
    models
        Label of a model to its outputs; one that lacks an output is not drawn there.
    """
    panels = []
    for row, name in enumerate(outputs):
        traces = [line(*measured[name], name, words="measured", color=MEASURED, legend=row == 0)]
        for number, (label, curves) in enumerate(models.items()):
            if name in curves:
                first = all(name == found or found not in curves for found in outputs[: row + 1])
                traces.append(_model_line(curves[name], name, label, number, legend=first))
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)


def _model_line(curve: Curve, name: str, label: str, number: int, *, legend: bool) -> Trace:
    colors = SERIES[1:]
    return line(
        *curve,
        name,
        words=text(label),
        color=colors[number % len(colors)],
        dash=DASHES[1 + number % (len(DASHES) - 1)],
        legend=legend,
        width=1.4,
    )
