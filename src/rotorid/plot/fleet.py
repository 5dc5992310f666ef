"""Flights of a fleet as points over what they were flown with, with lines of the slopes that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.plot.figure import INPUT, MEASURED, MODEL, Figure, Panel, Trace, numbers, stacked, text
from rotorid.typing import FloatArray

_HEIGHT_PX = 240


def over_voltage(
    volts: FloatArray,
    values: FloatArray,
    half: FloatArray,
    *,
    label: str,
    names: Sequence[str],
    slopes: Mapping[str, float],
) -> Figure:
    """Flights over their mean voltage with 95 % intervals, and slopes through their middle.

    Parameters
    ----------
    volts, values, half
        Of each flight: voltage, value, half of its interval, shape ``(flights,)``.
    label
        What the values are.
    names
        Of the flights, for those who point at them.
    slopes
        Up to two, by name.
    """
    points: Trace = {
        "type": "scatter",
        "mode": "markers",
        "name": "flights, 95 % intervals",
        "x": numbers(volts),
        "y": numbers(values),
        "text": [text(name) for name in names],
        "error_y": {"type": "data", "array": numbers(half), "thickness": 1, "width": 0},
        "marker": {"color": MEASURED, "size": 7},
        "showlegend": True,
        "hovertemplate": "%{text}: %{y:.3g} at %{x:.2f} V<extra></extra>",
    }
    weight = 1.0 / np.maximum(half, 1e-3 * float(np.max(half)) or 1.0) ** 2
    middle = float(np.average(volts, weights=weight)), float(np.average(values, weights=weight))
    ends = np.array([float(volts.min()), float(volts.max())])
    if ends[1] - ends[0] < 0.2:
        ends = middle[0] + np.array([-0.1, 0.1])
    lines: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": numbers(ends),
            "y": numbers(middle[1] + slope * (ends - middle[0])),
            "line": {"color": color, "width": 2, "dash": dash},
            "showlegend": True,
            "hoverinfo": "skip",
        }
        for (name, slope), color, dash in zip(slopes.items(), (MODEL, INPUT), ("solid", "7 3"), strict=False)
    ]
    panel = Panel(label=label, traces=[points, *lines], height_px=_HEIGHT_PX)
    return stacked([panel], x_axis={"title": {"text": "Mean battery voltage [V]"}, "zeroline": False})
