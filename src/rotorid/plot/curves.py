"""What frequency pictures are made of: points, lines and bands over a frequency axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rotorid.plot.figure import Trace, numbers, text
from rotorid.plot.ticks import magnitude_range_db, phase_step_deg
from rotorid.plot.view import View
from rotorid.typing import BoolArray, FloatArray

SIGMAS = 2.0
"""Half width of the error bands in standard deviations: about 95 % for each point on its own."""


@dataclass(frozen=True, kw_only=True)
class Style:
    """How the traces of one curve are drawn and named.

    Parameters
    ----------
    name
        In the legend; traces of one name are switched together.
    color, width, dash, symbol, size, opacity
        As plotly has them.
    legend
        Whether this trace stands for its group in the legend.
    unit
        Unit of the vertical axis, for the text that follows the pointer.
    """

    name: str
    color: str
    width: float = 1.6
    dash: str = "solid"
    symbol: str = "circle"
    size: float = 5.0
    opacity: float = 1.0
    legend: bool = False
    unit: str = ""


def line(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    """A line through values of shape ``(f,)``."""
    drawn = {"mode": "lines", "line": {"color": style.color, "width": style.width, "dash": style.dash}}
    return {**_trace(view, omega_rad_s, values, style), **drawn}


def points(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    """Markers at values of shape ``(f,)``."""
    marker = {"color": style.color, "size": style.size, "opacity": style.opacity, "symbol": style.symbol}
    return {**_trace(view, omega_rad_s, values, style), "mode": "markers", "marker": marker}


def _trace(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    return {
        "type": "scatter",
        "x": numbers(view.across(omega_rad_s)),
        "y": numbers(values),
        "customdata": numbers(view.other(omega_rad_s)),
        "hovertemplate": f"{view.pointed}%{{y:.4~g}} {style.unit}",
        "name": text(style.name),
        "legendgroup": text(style.name),
        "showlegend": style.legend,
    }


def band(
    view: View, omega_rad_s: FloatArray, low: FloatArray, high: FloatArray, used: BoolArray, style: Style
) -> list[Trace]:
    """The area between two curves of shape ``(f,)``, in unbroken runs of the used points; a list of one, or empty."""
    x: list[float | None] = []
    y: list[float | None] = []
    for run in runs(used & np.isfinite(low) & np.isfinite(high)):
        across = numbers(view.across(omega_rad_s[run]))
        x += [*across, *across[::-1], None]
        y += [*numbers(low[run]), *numbers(high[run][::-1]), None]
    area: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": x[:-1],
        "y": y[:-1],
        "fill": "toself",
        "fillcolor": style.color,
        "line": {"width": 0, "color": style.color},
        "hoverinfo": "skip",
        "name": text(style.name),
        "legendgroup": text(style.name),
        "showlegend": style.legend,
    }
    return [area] if x else []


def runs(used: BoolArray) -> list[slice]:
    """Unbroken runs of ``True`` as slices.

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(3, 4, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], used, [False])).astype(int)))
    return [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def shown(traces: list[Trace]) -> FloatArray:
    """All heights that are drawn, to fit an axis to them."""
    return np.array([value for trace in traces for value in trace["y"] if value is not None], dtype=np.float64)


def magnitude_axis(view: View, traces: list[Trace]) -> dict[str, Any]:
    """A vertical axis of magnitudes; a linear one starts at zero, as factors are compared by their length."""
    if view.magnitude == "linear":
        return {"rangemode": "tozero"}
    narrow = magnitude_range_db(shown(traces))
    return {"range": list(narrow)} if narrow else {}


def phase_axis(traces: list[Trace]) -> dict[str, Any]:
    """A vertical axis of phases in degrees, with ticks at parts of a right angle."""
    heights = shown(traces)
    return {"dtick": phase_step_deg(float(np.ptp(heights)))} if heights.size else {}
