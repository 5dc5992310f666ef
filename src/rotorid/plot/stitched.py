"""Pictures of a model over speed: parameters with their bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rotorid.data.quantity import TWO_SIDED_95
from rotorid.plot.figure import MEASURED, Figure, Panel, Trace, numbers, stacked, text, translucent
from rotorid.typing import FloatArray

_POINTS = 61
_HEIGHT_PX = 110


class OverSpeed(NamedTuple):
    """A parameter over speed: its unit, where it is known, and value and standard deviation on a grid of speeds."""

    unit: str
    known_m_s: FloatArray
    known: FloatArray
    speed_m_s: FloatArray
    value: FloatArray
    std: FloatArray


def speed_grid(speed_m_s: FloatArray) -> FloatArray:
    """Speeds from the lowest to the highest, those given among them."""
    return np.unique([*np.linspace(speed_m_s.min(), speed_m_s.max(), _POINTS), *speed_m_s])


def over_speed(curves: Mapping[str, OverSpeed]) -> Figure:
    """Parameters over speed, a panel for each, with bands of 95 %.

    Parameters
    ----------
    curves
        Name to its curve. No band is drawn where the standard deviation is not a number.
    """
    panels = [
        Panel(label=f"{name} [{curve.unit}]", traces=_traces(name, curve, legend=row == 0), height_px=_HEIGHT_PX)
        for row, (name, curve) in enumerate(curves.items())
    ]
    return stacked(panels, x_axis={"title": {"text": "Forward speed [m/s]"}})


def _traces(name: str, curve: OverSpeed, *, legend: bool) -> list[Trace]:
    inside = np.isfinite(curve.std)
    x, low, high = (
        numbers(row[inside])
        for row in (curve.speed_m_s, curve.value - TWO_SIDED_95 * curve.std, curve.value + TWO_SIDED_95 * curve.std)
    )
    tip = f"%{{x:.3~g}} m/s<br>{text(name)} %{{y:.4~g}}"
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": [*x, *x[::-1]],
            "y": [*low, *high[::-1]],
            "fill": "toself",
            "fillcolor": translucent(MEASURED, 0.2),
            "line": {"width": 0},
            "hoverinfo": "skip",
            "name": "95 %",
            "legendgroup": "95 %",
            "showlegend": legend,
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(curve.speed_m_s),
            "y": numbers(curve.value),
            "line": {"color": MEASURED, "width": 1.6},
            "hovertemplate": tip,
            "name": "stitched",
            "legendgroup": "stitched",
            "showlegend": legend,
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": numbers(curve.known_m_s),
            "y": numbers(curve.known),
            "marker": {"color": MEASURED, "size": 7},
            "hovertemplate": tip,
            "name": "identified",
            "legendgroup": "identified",
            "showlegend": legend,
        },
    ]
