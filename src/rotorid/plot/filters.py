"""Picture of filters with gains: noise at the motors against attitude error, a point for each choice."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.plot.figure import MEASURED, MODEL, Figure, Panel, stacked

_HEIGHT_PX = 260.0


def choices(
    numbers: Sequence[int], noise_percent: Sequence[float], attitude_percent: Sequence[float], *, marked: int
) -> Figure:
    """Attitude error over noise, both per cent of today's; lower left is better.

    Parameters
    ----------
    numbers, noise_percent, attitude_percent
        Of the points; zero has the flown filters.
    marked
        The point to be seen first.
    """
    colors = [MODEL if number == marked else MEASURED for number in numbers]
    trace = {
        "type": "scatter",
        "mode": "lines+markers+text",
        "name": "choice",
        "x": list(noise_percent),
        "y": list(attitude_percent),
        "text": [str(number) for number in numbers],
        "textposition": "top right",
        "line": {"dash": "dot", "width": 1.2, "color": MEASURED},
        "marker": {"color": colors, "size": [12 if number == marked else 9 for number in numbers]},
        "hovertemplate": "choice %{text}<br>%{x:.3~g} % noise<br>%{y:.3~g} % attitude error",
        "showlegend": False,
    }
    panel = Panel(label="Attitude error [% of today]", traces=[trace], height_px=_HEIGHT_PX)
    return stacked([panel], x_axis={"title": {"text": "Noise at the motors [% of today]"}, "rangemode": "tozero"})
