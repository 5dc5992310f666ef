"""What was measured over time, and what the model predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rotorid.plot.figure import MOST_POINTS, Figure, Trace, envelope, numbers, stamps
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, DASHES, INPUT, MEASURED, MODEL, SERIES
from rotorid.typing import FloatArray
from rotorid.verify.verification import Verification

TIME_AXIS = {"title": {"text": "Time on the log's clock [s]"}}


def verification(check: Verification) -> Figure:
    """Measured and predicted outputs of one unseen maneuver, the inputs below.

    Parameters
    ----------
    check
        The maneuver; angles and rates are drawn in degrees.
    """
    panels = [
        Panel(
            label=quantity(name).label,
            traces=(
                line(check.time_s, check.measured[row], name, words="measured", color=MEASURED, legend=row == 0),
                line(
                    check.time_s,
                    check.predicted[row],
                    name,
                    words="predicted",
                    color=MODEL,
                    legend=row == 0,
                    dash="5 3",
                ),
            ),
            height_px=190,
        )
        for row, name in enumerate(check.output_names)
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


def _driven(trace: Trace, held: bool) -> Trace:
    return {**trace, "line": {**trace["line"], "shape": "hv"}} if held else trace


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
    style = {"line": {"color": BESIDE, "width": 1.0, "dash": "2 2"}, "hoverinfo": "skip", "name": "white noise, ± 2 σ"}
    bounds = [{**one, **style, "legendgroup": "chance", "showlegend": number == 0} for number, one in enumerate(edge)]
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
