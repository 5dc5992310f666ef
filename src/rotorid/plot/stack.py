"""Panels above each other on one horizontal axis: the frame of every picture here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rotorid.plot.figure import Figure, Trace, text
from rotorid.plot.theme import BESIDE, SHADE, template

_GAP_PX = 34.0
# The tools of the page stand in the corner above the legend.
_TOP_PX, _BOTTOM_PX = 72.0, 46.0
_LEGEND_PX, _LEGEND_ROW_PX, _SYMBOL_PX, _LETTER_PX = 860.0, 30.0, 45.0, 6.5


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One panel of a picture.

    Parameters
    ----------
    label
        Written above the panel.
    traces
        Plotly traces, without their axes.
    height_px
        Height of the drawing area.
    axis
        What the vertical axis needs beyond the theme.
    shaded
        Intervals of the horizontal axis to shade.
    level
        A guideline to draw across, in units of the vertical axis.
    """

    label: str
    traces: Sequence[Trace]
    height_px: float
    axis: Mapping[str, Any] = field(default_factory=dict)
    shaded: Sequence[tuple[float, float]] = ()
    level: float | None = None


def stacked(panels: Sequence[Panel], *, x_axis: Mapping[str, Any]) -> Figure:
    """One figure with the panels from top to bottom, sharing a horizontal axis and one legend.

    Parameters
    ----------
    panels
        From top to bottom.
    x_axis
        Title and kind of the shared axis.
    """
    inner = sum(panel.height_px for panel in panels) + _GAP_PX * (len(panels) - 1)
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    over = _TOP_PX + _LEGEND_ROW_PX * (_legend_rows(panels) - 1)
    layout: dict[str, Any] = {
        "template": template(),
        "height": round(inner + over + _BOTTOM_PX),
        "margin": {"l": 56, "r": 16, "t": over, "b": _BOTTOM_PX},
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1 + 22 / inner,
            "yanchor": "bottom",
            # A curve that the reader hid stays hidden when the figure is drawn again in other units or colors.
            "uirevision": "kept",
        },
        "hovermode": "closest",
        "annotations": annotations,
        "shapes": shapes,
    }
    axis, top = "y", 1.0
    for number, panel in enumerate(panels, start=1):
        axis = "y" if number == 1 else f"y{number}"
        bottom = max(top - panel.height_px / inner, 0.0)
        layout[f"yaxis{axis[1:]}"] = {"domain": [round(bottom, 5), round(top, 5)], "anchor": "x", **panel.axis}
        annotations.append(_label(panel.label, top))
        traces += [{**trace, "xaxis": "x", "yaxis": axis} for trace in panel.traces]
        shapes += _shapes(panel, axis)
        top = bottom - _GAP_PX / inner
    layout["xaxis"] = {"anchor": axis, "domain": [0, 1], **x_axis}
    return Figure(data=traces, layout=layout)


def _legend_rows(panels: Sequence[Panel]) -> int:
    """About how many rows the legend takes on a wide page, so that its first stays clear of the page's tools."""
    names = [trace["name"] for panel in panels for trace in panel.traces if trace.get("showlegend")]
    return max(1, math.ceil(sum(_SYMBOL_PX + _LETTER_PX * len(name) for name in names) / _LEGEND_PX))


def _shapes(panel: Panel, axis: str) -> list[dict[str, Any]]:
    quiet = {"layer": "below", "line": {"width": 0}, "fillcolor": SHADE}
    shapes: list[dict[str, Any]] = [
        {"type": "rect", "x0": start, "x1": stop, "yref": f"{axis} domain", "y0": 0, "y1": 1, **quiet}
        for start, stop in panel.shaded
    ]
    if panel.level is not None:
        line = {"color": BESIDE, "width": 1, "dash": "dot"}
        shapes.append(
            {
                "type": "line",
                "xref": "paper",
                "x0": 0,
                "x1": 1,
                "yref": axis,
                "line": line,
                "y0": panel.level,
                "y1": panel.level,
            }
        )
    return shapes


def _label(label: str, top: float) -> dict[str, Any]:
    # A line above each panel reads better than turned text, and fits panels of any height.
    return {
        "text": text(label),
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": round(top, 5),
        "xanchor": "left",
        "yanchor": "bottom",
        "yshift": 3,
        "showarrow": False,
        "font": {"size": 12},
    }
