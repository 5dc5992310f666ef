"""What was measured over time, and what the model predicted."""

from __future__ import annotations

from rotorid.plot.figure import Figure, Trace, envelope, numbers, stamps
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import INPUT, MEASURED, MODEL
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
    """
    paper = quantity(name)
    shown_time, shown = envelope(time_s, values * paper.factor)
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
