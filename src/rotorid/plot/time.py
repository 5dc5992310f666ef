"""Pictures over time: excitations, what was measured, what models predict, and how these compare."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from rotorid.data.record import Maneuver, TimeHistory
from rotorid.plot.figure import (
    DASHES,
    INPUT,
    MEASURED,
    MODEL,
    MOST_POINTS,
    SECONDARY,
    SERIES,
    Figure,
    Panel,
    Trace,
    envelope,
    numbers,
    quantity,
    stacked,
    stamps,
    text,
    translucent,
)
from rotorid.typing import FloatArray
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.prediction import Prediction
from rotorid.verification.verification import Verification

TIME_AXIS = {"title": {"text": "Time on the log's clock [s]"}}


def verification(check: Verification) -> Figure:
    """Measured and predicted outputs of one unseen maneuver, the inputs below.

    Outputs that the maneuver hardly moved are not judged and not drawn.

    Parameters
    ----------
    check
        The maneuver; angles and rates are drawn in degrees.
    """
    moved = [row for row, name in enumerate(check.output_names) if name in (check.moved or check.output_names)]
    panels = [
        Panel(
            label=quantity(name).label,
            traces=(
                line(check.time_s, check.measured[row], name, words="measured", color=MEASURED, legend=place == 0),
                line(
                    check.time_s,
                    check.predicted[row],
                    name,
                    words="predicted",
                    color=MODEL,
                    legend=place == 0,
                    dash="5 3",
                ),
            ),
            height_px=190,
        )
        for place, (row, name) in enumerate((row, check.output_names[row]) for row in moved)
    ]
    panels += [
        Panel(
            label=quantity(name).label,
            traces=(line(check.time_s, check.inputs[row], name, words="input", color=INPUT, legend=row == 0),),
            height_px=85,
        )
        for row, name in enumerate(check.input_names)
    ]
    return stacked(panels, x_axis=TIME_AXIS)


def simulated(
    time_s: FloatArray,
    inputs: FloatArray,
    measured: FloatArray,
    model: FloatArray,
    *,
    input_names: Sequence[str],
    output_names: Sequence[str],
    held: bool = False,
    most: int = MOST_POINTS,
) -> Figure:
    """Measured and simulated outputs of a record that was fitted, its inputs below.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    inputs, measured, model
        Shapes ``(u, samples)`` and twice ``(y, samples)``, SI units; angles and rates are drawn in degrees.
    input_names, output_names
        Names of the rows.
    held
        Whether inputs are drawn as steps.
    most
        Points of a trace, from which it is thinned.
    """
    panels = [
        Panel(
            label=quantity(name).label,
            traces=(
                line(time_s, measured[row], name, words="measured", color=MEASURED, legend=row == 0, most=most),
                line(
                    time_s,
                    model[row],
                    name,
                    words="simulated",
                    color=MODEL,
                    legend=row == 0,
                    dash="5 3",
                    most=most,
                ),
            ),
            height_px=170,
        )
        for row, name in enumerate(output_names)
    ]
    panels += [
        Panel(
            label=quantity(name).label,
            traces=(
                _driven(line(time_s, inputs[row], name, words="input", color=INPUT, legend=row == 0, most=most), held),
            ),
            height_px=85,
        )
        for row, name in enumerate(input_names)
    ]
    return stacked(panels, x_axis=TIME_AXIS)


def flown(
    time_s: FloatArray,
    inputs: FloatArray,
    measured: FloatArray,
    model: FloatArray,
    band: tuple[FloatArray, FloatArray],
    *,
    input_names: Sequence[str],
    output_names: Sequence[str],
    held: bool = False,
) -> Figure:
    """Outputs of a flight, measured where they were, with those of a model and its band; the inputs below.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    inputs, measured, model
        Shapes ``(u, samples)`` and twice ``(y, samples)``, SI units; rows of ``measured`` that are no numbers are left
        out.
    band
        Lower and upper edge, shapes ``(y, samples)``.
    input_names, output_names
        Names of the rows.
    held
        Whether inputs are drawn as steps.
    """
    panels = []
    for row, name in enumerate(output_names):
        edges = [
            line(time_s, edge[row], name, words="band of the parameters, 95 %", color=MODEL, width=0.0) for edge in band
        ]
        shade: Trace = {"hoverinfo": "skip", "fillcolor": translucent(MODEL, _FLOWN_OPACITY)}
        filled: Trace = {**edges[1], **shade, "fill": "tonexty", "showlegend": row == 0}
        traces = [{**edges[0], "hoverinfo": "skip"}, filled]
        if np.isfinite(measured[row]).all():
            words = "measured"
            traces.append(line(time_s, measured[row], name, words=words, color=MEASURED, legend=row == 0))
        traces.append(line(time_s, model[row], name, words="model", color=MODEL, legend=row == 0, dash="5 3"))
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=150))
    panels += [
        Panel(
            label=quantity(name).label,
            traces=(_driven(line(time_s, inputs[row], name, words="input", color=INPUT, legend=row == 0), held),),
            height_px=85,
        )
        for row, name in enumerate(input_names)
    ]
    return stacked(panels, x_axis=TIME_AXIS)


_FLOWN_OPACITY = 0.22


def _driven(trace: Trace, held: bool) -> Trace:
    return {**trace, "line": {**trace["line"], "shape": "hv"}} if held else trace


_UNSEEN_HEIGHT_PX = 150.0
_AHEAD = (MODEL, *SERIES[3:])
_DASHES = ("5 3", "2 2", "9 3 2 3")


def ahead(prediction: Prediction, names: Sequence[str], *, of: Sequence[str]) -> Figure:
    """Measured outputs about their mean, and what was predicted for each instant some time before it.

    Parameters
    ----------
    prediction
        At least one horizon.
    names
        Outputs to show.
    of
        All outputs, in the order of the rows.
    """
    panels = []
    for number, name in enumerate(names):
        row, first = list(of).index(name), prediction.horizons[0]
        legend = number == 0
        traces = [line(first.time_s, first.measured[row], name, words="measured", color=MEASURED, legend=legend)]
        traces += [
            line(
                horizon.time_s,
                horizon.predicted[row],
                name,
                words=f"predicted {horizon.horizon_s:.2g} s ahead",
                color=color,
                dash=dash,
                legend=legend,
            )
            for horizon, color, dash in zip(prediction.horizons, _AHEAD, _DASHES, strict=False)
        ]
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_UNSEEN_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)


def closed_loop(flown: ClosedLoop, names: Sequence[str]) -> Figure:
    """Measured outputs and commands, and those of the model under the same controller.

    Parameters
    ----------
    flown
        The flight.
    names
        Outputs to show; the commands come below them.
    """
    panels: list[Panel] = []
    for row, name in enumerate(flown.names):
        command = row >= flown.outputs
        if not command and name not in names:
            continue
        first = not panels
        traces = (
            line(flown.time_s, flown.measured[row], name, words="measured", color=MEASURED, legend=first),
            line(flown.time_s, flown.predicted[row], name, words="model", color=MODEL, legend=first, dash="5 3"),
        )
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_UNSEEN_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)


def residual_memory(lags_s: FloatArray, correlation: Mapping[str, FloatArray], *, chance: float) -> Figure:
    """Autocorrelation of the residuals of every output.

    Parameters
    ----------
    lags_s
        Shape ``(lags,)``.
    correlation
        Output to its autocorrelation, shape ``(lags,)``.
    chance
        What white residuals stay within.
    """
    traces = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "x": stamps(lags_s),
            "y": numbers(values),
            "line": {"color": SERIES[number % len(SERIES)], "width": 1.6, "dash": DASHES[number % len(DASHES)]},
            "marker": {"size": 4},
            "hovertemplate": "%{x:.3f} s<br>%{y:.2f}",
            "name": quantity(name).words,
            "showlegend": True,
        }
        for number, (name, values) in enumerate(correlation.items())
    ]
    edge = [
        {"type": "scatter", "mode": "lines", "x": stamps(lags_s[[0, -1]]), "y": [level, level]}
        for level in (-chance, chance)
    ]
    style = {
        "line": {"color": SECONDARY, "width": 1.0, "dash": "2 2"},
        "hoverinfo": "skip",
        "name": "white noise, ± 2 σ",
    }
    bounds = [
        {**bound, **style, "legendgroup": "chance", "showlegend": number == 0} for number, bound in enumerate(edge)
    ]
    panel = Panel(label="Autocorrelation of the residuals", traces=(*traces, *bounds), height_px=230)
    return stacked([panel], x_axis={"title": {"text": "Lag [s]"}})


def line(
    time_s: FloatArray,
    values: FloatArray,
    name: str,
    *,
    words: str,
    color: str,
    legend: bool = False,
    dash: str = "solid",
    width: float = 1.6,
    most: int = MOST_POINTS,
) -> Trace:
    """A trace of one channel on paper units, thinned for display.

    Parameters
    ----------
    time_s, values
        Shape ``(samples,)``, SI units.
    name
        Channel name, which decides the unit of paper.
    words
        Name in the legend.
    color, legend, dash, width
        How it is drawn.
    most
        Points from which it is thinned.
    """
    paper = quantity(name)
    shown_time, shown = envelope(time_s, values * paper.factor, most=most)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": stamps(shown_time),
        "y": numbers(shown),
        "line": {"color": color, "width": width, "dash": dash},
        "hovertemplate": f"%{{x:.3f}} s<br>%{{y:.4~g}} {paper.unit}",
        "name": words,
        "legendgroup": words,
        "showlegend": legend,
    }


class Excited(Protocol):
    """A maneuver with the data around it; ``rotorid.results.model.Segment`` is one."""

    @property
    def maneuver(self) -> Maneuver: ...

    @property
    def history(self) -> TimeHistory: ...


def timeline(
    segments: Sequence[Excited],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    shaded: Sequence[tuple[float, float]] | None = None,
) -> Figure:
    """Inputs and outputs of one record over time, its maneuvers shaded.

    Parameters
    ----------
    segments
        Data on one clock: those of one record.
    inputs, outputs
        Channels to draw, one panel each; a segment that lacks one leaves a gap.
    shaded
        Maneuvers ``(start, stop)`` in seconds on the log's own clock, where they are not those of the segments: data
        may be cut wide around several of them.
    """
    if shaded is None:
        shaded = [(segment.maneuver.start_s, segment.maneuver.stop_s) for segment in segments]
    panels = [
        Panel(
            label=quantity(name).label,
            traces=_traces(segments, name, words=words, color=color, legend=name == names[0]),
            height_px=height_px,
            shaded=shaded,
        )
        for words, names, color, height_px in (("input", inputs, INPUT, 110), ("output", outputs, MEASURED, 130))
        for name in names
    ]
    return stacked(panels, x_axis=TIME_AXIS)


def _traces(segments: Sequence[Excited], name: str, *, words: str, color: str, legend: bool) -> list[Trace]:
    histories = [segment.history for segment in segments if name in segment.history.names]
    return [
        line(
            history.time_s,
            history[name],
            name,
            words=words,
            color=color,
            legend=legend and index == 0,
            width=1.0,
        )
        for index, history in enumerate(histories)
    ]


_ROW_PX, _LEAST_PX = 34.0, 90.0
_COMPARED_HEIGHT_PX = 210.0
_KINDS = ((SECONDARY, "circle-open"), (MEASURED, "diamond"), (MODEL, "circle"), (INPUT, "square"))
_MARKER_SPACING = 0.16


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
    known = {kind for kind, found in scores.items() if any(math.isfinite(score.mean) for score in found)}
    offsets = iter(_MARKER_SPACING * (np.arange(len(known)) - (len(known) - 1) / 2.0))
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
        "x": numbers(np.array([score.mean for score in found])),
        "y": numbers(rows),
        "error_x": {
            "type": "data",
            "array": numbers(np.array([score.spread for score in found])),
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
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_COMPARED_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)


def steps(
    time_s: FloatArray,
    pairs: Sequence[tuple[str, str]],
    models: Sequence[Mapping[str, tuple[FloatArray, FloatArray, FloatArray]]],
    labels: Sequence[str],
    measured: Sequence[Mapping[str, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]] = (),
) -> Figure:
    """Answers of several models to a unit step, with the bands of their parameters, and what logs show.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    pairs
        Input and output of each panel.
    models
        For each panel, label to response, lower and upper edge, shapes ``(samples,)``.
    labels
        All labels, in the order of their colors.
    measured
        For each panel, label to time, response, lower and upper edge of a log; empty arrays show nothing.
    """
    colors, panels, named = SERIES[1:], [], set[str]()
    for (given, output), found, seen in zip(pairs, models, measured or [{} for _ in pairs], strict=True):
        traces: list[Trace] = []
        step = quantity(given)
        for label, (own_s, *curves) in seen.items():
            inside = own_s <= time_s[-1]
            if not inside.any():
                continue
            value, lower, upper = (row[inside] / step.factor for row in curves)
            edges = [
                line(own_s[inside], edge, output, words=text(label), color=MEASURED, width=0.0)
                for edge in (lower, upper)
            ]
            filled = {"hoverinfo": "skip", "fillcolor": translucent(MEASURED, _FLOWN_OPACITY), "fill": "tonexty"}
            legend = label not in named
            curve = line(own_s[inside], value, output, words=text(label), color=MEASURED, width=2.0, legend=legend)
            traces += [{**edges[0], "hoverinfo": "skip"}, {**edges[1], **filled}, curve]
            named.add(label)
        for label, (response, lower, upper) in found.items():
            number = labels.index(label)
            color = colors[number % len(colors)]
            edges = [
                line(time_s, edge / step.factor, output, words=text(label), color=color, width=0.0)
                for edge in (lower, upper)
            ]
            shade: Trace = {"hoverinfo": "skip", "fillcolor": translucent(color, _FLOWN_OPACITY), "fill": "tonexty"}
            dash = DASHES[1 + number % (len(DASHES) - 1)]
            own = line(
                time_s,
                response / step.factor,
                output,
                words=text(label),
                color=color,
                dash=dash,
                width=1.4,
                legend=label not in named,
            )
            traces += [{**edges[0], "hoverinfo": "skip"}, {**edges[1], **shade}, own]
            named.add(label)
        size = f"1 {step.unit}".strip() if step.unit != "1" else "1"
        words = f"{quantity(output).label}, after {size} of {text(step.words)}"
        panels.append(Panel(label=words, traces=traces, height_px=_COMPARED_HEIGHT_PX))
    return stacked(panels, x_axis={"title": {"text": "Time after the step [s]"}})


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
